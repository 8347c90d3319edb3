//! Fluid and the debris in it.
//!
//! Four cells: the *front* gap, by facet; fluid that was *squeezed* out of it and stands at its rim; the *side* gap, which
//! grows with the hole; and the *bath*, large, filtered, clean. What discharges remove enters the front, and from then on
//! is only moved: every exchange is between two cells and an exact exponential, so none can give more than it has.
//!
//! - A gap that narrows squeezes fluid out. It stands at the rim, up to a share of the side gap, and pushes the rest on
//!   through the side gap to the bath.
//! - A gap that widens takes back what stands at the rim first, then fluid of the side gap, which takes clean fluid from
//!   the bath. A share of what moves mixes on its way: that, and no free exchange, is what small motions clean by.
//! - The gas of discharges, buoyancy and drift, and turning exchange front and side; gas, buoyancy and drift exchange side
//!   and bath, the less the deeper.
//! - The motion is reversible but for its Reynolds number. What enters a widening gap is a cell of its own, which mixes
//!   with the front as inertia lets it and leaves first when the gap narrows. What the side gap cannot deliver at one atmosphere
//!   is a void, which closes first.
//! - A flushing pressure drives bath fluid through the front and the side.
//! - The film and the side gap resist that flow: [`Fluid::film`] is the same motion's force on the electrode.

use super::FACETS;
use crate::math::{exponents, gone, sum};
use crate::parameters::Parameters;
use std::f64::consts::{PI, TAU};

/// Share of debris at which ignition, recovery and bridges are given.
pub const REFERENCE: f64 = 0.05;
/// Thinnest film that the fluid is calculated with, um: below that, roughness lets it through (assumed).
const THINNEST: f64 = 1.0;
/// The same for the film's force: 5 um (assumed).
const THINNEST_FILM: f64 = 5.0;
/// Widths over the exchange gap beyond which exchange grows no more: squared for gas, cubed for drift.
const WIDEST: (f64, f64) = (9.0, 30.0);
/// Radius of the flushing hole over that of the electrode (assumed).
const HOLE: f64 = 0.2;
/// Density of the dielectric, kg/m^3 (kerosene).
const DENSITY: f64 = 800.0;
/// Atmospheric pressure, Pa: no film pulls harder on the face.
const ATMOSPHERE: f64 = 101_325.0;

/// Volumes in um^3, debris in um^3 of solid.
#[derive(Clone, Debug)]
pub struct Fluid {
    p: Parameters,
    area: f64,
    volume: f64,
    /// Debris of the front, by facet.
    front: [f64; FACETS],
    squeezed: Cell,
    /// Fluid that has entered the front and not mixed with it: in its volume, but not in its facets.
    entered_front: Cell,
    /// Volume of the front that no fluid fills.
    void: f64,
    side: f64,
    bath: f64,
    entered: f64,
    /// Base of the gas since the last step.
    stirring: f64,
    /// Share of the gas that moves fluid in the side gap.
    rises: f64,
    /// What an electrode that turns exchanges at the exchange gap, um^3/us.
    turning: f64,
    /// Share by which the facets even out in a step.
    spread: f64,
    /// Film of the face times its thickness cubed, N s m^2, and what a metre of side gap adds to the damping, N s/m.
    film: (f64, f64),
    held: bool,
}

#[derive(Clone, Copy, Debug, Default)]
struct Cell {
    volume: f64,
    debris: f64,
}

impl Cell {
    /// Takes a share of it away.
    fn leaves(&mut self, share: f64) -> Cell {
        let gone = Cell { volume: self.volume * share, debris: self.debris * share };
        *self = Cell { volume: self.volume - gone.volume, debris: self.debris - gone.debris };
        gone
    }
}

/// What a film and a side gap do to a moving electrode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Film {
    /// Force over velocity, N s/m.
    pub damping: f64,
    /// Most that it can pull, N.
    pub suction: f64,
}

impl Fluid {
    /// Clean fluid in a gap.
    pub fn new(p: &Parameters, gap_um: f64) -> Fluid {
        let area = p.area_um2();
        let turns = if p.turn_ms > 0.0 { TAU / (p.turn_ms * 1e3) } else { 0.0 };
        Fluid {
            p: *p,
            area,
            volume: area * gap_um.max(THINNEST),
            front: [0.0; FACETS],
            squeezed: Cell::default(),
            entered_front: Cell::default(),
            void: 0.0,
            side: 0.0,
            bath: 0.0,
            entered: 0.0,
            stirring: 0.0,
            rises: 1.0,
            // A disc that turns drags fluid of its rim's speed through a gap squared: its order of magnitude (assumed).
            turning: turns * p.radius_um * p.exchange_um * p.exchange_um,
            spread: gone(p.step_us / (p.spread_ms * 1e3)),
            film: {
                let r = p.radius_um * 1e-6;
                let area = PI * r * r;
                (1.5 * PI * p.viscosity_mpas * 1e-3 * r * r * r * r, area * area * side_resistance(p, 1e6))
            },
            held: false,
        }
    }

    /// The gas of now, um^3/us on its base. What rises in the side gap moves no more fluid than a flow of its own.
    pub fn rises(&mut self, gas: f64) {
        let most = self.p.gas_level_um_s * 1e-6 * TAU * self.p.radius_um * self.p.side_um;
        self.rises = if gas > most { most / gas } else { 1.0 };
    }

    /// Keeps this concentration everywhere in the front, in units of [`REFERENCE`].
    pub fn hold(&mut self, dirt: f64) {
        self.front = [dirt * REFERENCE * self.volume / FACETS as f64; FACETS];
        self.held = true;
    }

    /// Debris of a discharge; `stirs` is the base of its gas.
    pub fn enter(&mut self, facet: usize, debris: f64, stirs: f64) {
        if self.held {
            return;
        }
        if let Some(front) = self.front.get_mut(facet) {
            *front += debris;
            self.entered += debris;
        }
        self.stirring += stirs;
    }

    /// Debris of each facet.
    pub fn front(&self) -> &[f64; FACETS] {
        &self.front
    }

    /// What debris of a facet is multiplied by to be its concentration in units of [`REFERENCE`].
    pub fn dirt_per_debris(&self) -> f64 {
        FACETS as f64 / (self.mixed() * REFERENCE)
    }

    /// Volume of the front's fluid in which its debris is.
    fn mixed(&self) -> f64 {
        self.volume - self.entered_front.volume - self.void
    }

    /// Concentration of the front, in units of [`REFERENCE`].
    pub fn dirt(&self) -> f64 {
        sum(&self.front) / (self.mixed() * REFERENCE)
    }

    /// By how much of what entered the debris of all cells is off.
    pub fn imbalance(&self) -> f64 {
        let all = sum(&self.front) + self.entered_front.debris + self.squeezed.debris + self.side + self.bath;
        (all - self.entered).abs() / self.entered.max(f64::MIN_POSITIVE)
    }

    /// A step of `us`, which is the one of the parameters, that ends at a mean gap, in a hole of a depth. Of the face, `through` has nothing before it.
    pub fn step(&mut self, us: f64, gap_um: f64, depth_um: f64, through: f64) {
        let p = &self.p;
        let volume = self.area * gap_um.max(THINNEST);
        if self.held {
            let same = volume / self.volume;
            self.volume = volume;
            self.front.iter_mut().for_each(|front| *front *= same);
            return;
        }
        let depth = depth_um.max(0.0);
        let reached = if p.buffer_um > 0.0 { depth / (1.0 + depth / p.buffer_um) } else { depth };
        let side_volume = TAU * p.radius_um * p.side_um * (reached + p.mouth * p.side_um);
        let (per_volume, per_side) = (1.0 / volume, 1.0 / side_volume);
        let change = volume - self.volume;
        let before = sum(&self.front);
        let mut front = before;

        if p.comes_back == 0.0 {
            let out = front * if change < 0.0 { -change / self.volume } else { 0.0 };
            front -= out;
            self.bath += out;
        } else if p.reynolds > 0.0 {
            front = self.moves(us, gap_um, depth, change, front, side_volume);
        } else if change < 0.0 {
            // Mean speed at the rim of a disc: R/(2 g) times that of the gap.
            let rim_mm_s = p.radius_um * -change * per_volume / (2e-3 * us);
            let lifts = p.lift_share + (1.0 - p.lift_share) * rim_mm_s / (rim_mm_s + p.lift_mm_s);
            let out = front * gone(lifts * exponents(-change / self.volume));
            front -= out;
            self.squeezed.volume -= change;
            self.squeezed.debris += out;
            let room = p.memory * side_volume;
            if self.squeezed.volume > room {
                let over = self.squeezed.volume - room;
                let pushed = self.squeezed.debris * over / self.squeezed.volume;
                let expelled = self.side * gone(over * per_side);
                self.squeezed = Cell { volume: room, debris: self.squeezed.debris - pushed };
                self.side += pushed - expelled;
                self.bath += expelled;
            }
        } else if change > 0.0 {
            let back = change.min(self.squeezed.volume);
            if back > 0.0 {
                let part = self.squeezed.debris * (back / self.squeezed.volume);
                front += part;
                self.squeezed.debris -= part;
                self.squeezed.volume -= back;
            }
            let drawn = self.side * gone((change - back) * per_side);
            front += drawn;
            self.side -= drawn;
        }

        let p = &self.p;
        let gas = std::mem::take(&mut self.stirring);
        let wide = gap_um.max(0.0) / p.exchange_um;
        let (gas_width, rest_width) = ((wide * wide).min(WIDEST.0), (wide * wide * wide).min(WIDEST.1));
        let rest = p.rest_mm3_s * 1e3 * us;
        let flow = gas * p.gas_front * gas_width + rest * rest_width + self.turning * us * gas_width;
        if self.entered_front.volume > 0.0 {
            front += self.entered_front.leaves(gone(flow * per_volume)).debris;
        }

        // What stands at the rim loses itself in the side gap, by moving to and fro and with the exchange.
        if self.squeezed.volume > 0.0 {
            let mixed = gone(p.mixing * change.abs() * per_volume + flow * per_side);
            let part = self.squeezed.debris * mixed;
            self.squeezed.debris -= part;
            self.squeezed.volume -= self.squeezed.volume * mixed;
            self.side += part;
        }
        // What is over the balance of the two.
        let level = (front + self.side) / (volume + side_volume);
        let out = (front - level * volume) * gone(flow * (per_volume + per_side));
        front -= out;
        self.side += out;
        let deep = depth_um.max(0.0) / p.half_depth_um;
        let gone_up = self.side * gone((gas * p.gas_side * self.rises + rest) * per_side / (1.0 + deep * deep));
        self.side -= gone_up;
        self.bath += gone_up;

        if p.flush_kpa > 0.0 {
            let mut flow = self.flushed_um3_us(gap_um, depth_um) * us;
            if p.gas_back > 0.0 {
                flow *= flow / (flow + gas * p.gas_back);
            }
            let out = front * gone(flow * per_volume);
            let up = self.side * gone(flow * per_side);
            front -= out;
            self.side += out - up;
            self.bath += up;
        }
        if through > 0.0 {
            // The bath below takes the front as the bath above takes a hole without depth.
            let out = front * gone(through * (gas * p.gas_side * self.rises + rest) * per_volume);
            front -= out;
            self.bath += out;
        }

        // In- and outflow act on all facets alike, then they even out.
        let (scale, even) = if before > 0.0 { (front / before, 0.0) } else { (0.0, front / FACETS as f64) };
        let mean = front / FACETS as f64;
        let (keeps, gets) = (1.0 - self.spread, mean * self.spread);
        for facet in &mut self.front {
            *facet = (*facet * scale + even) * keeps + gets;
        }
        self.volume = volume;
    }

    /// What a motion of the gap does to a front with so much debris; gives that it has after it.
    fn moves(&mut self, us: f64, gap_um: f64, depth: f64, change: f64, mut front: f64, side_volume: f64) -> f64 {
        let core = self.mixed();
        let p = &self.p;
        let speed = change.abs() / (self.area * us);
        let closing = if change < 0.0 { (-change - self.void).max(0.0) } else { 0.0 };
        self.void = (self.void + change.min(0.0)).max(0.0);
        if closing > 0.0 {
            let first =
                self.entered_front.leaves((closing / self.entered_front.volume.max(f64::MIN_POSITIVE)).min(1.0));
            let rest = closing - first.volume;
            let rim_mm_s = p.radius_um * speed / (2e-3 * gap_um.max(THINNEST));
            let lifts = p.lift_share + (1.0 - p.lift_share) * rim_mm_s / (rim_mm_s + p.lift_mm_s);
            let out = if rest < core { front * gone(lifts * exponents(rest / core)) } else { front };
            front -= out;
            self.squeezed.volume += closing;
            self.squeezed.debris += first.debris + out;
            let room = p.memory * side_volume;
            if self.squeezed.volume > room {
                let over = self.squeezed.volume - room;
                let pushed = self.squeezed.debris * over / self.squeezed.volume;
                let expelled = self.side * gone(over / side_volume);
                self.squeezed = Cell { volume: room, debris: self.squeezed.debris - pushed };
                self.side += pushed - expelled;
                self.bath += expelled;
            }
        }
        let wants = self.void + change.max(0.0);
        if wants > 0.0 {
            // Film of a disc, 3 mu/(2 pi g^3), and side gap, at one atmosphere.
            let g = gap_um.max(THINNEST_FILM) * 1e-6;
            let film = 1.5 * p.viscosity_mpas * 1e-3 / (PI * g * g * g);
            let enters = wants.min(ATMOSPHERE / (film + side_resistance(p, depth)) * 1e12 * us);
            self.void = wants - enters;
            let back = self.squeezed.leaves((enters / self.squeezed.volume.max(f64::MIN_POSITIVE)).min(1.0));
            front += back.debris;
            let fresh = enters - back.volume;
            let drawn = self.side * gone(fresh / side_volume);
            self.side -= drawn;
            self.entered_front.volume += fresh;
            self.entered_front.debris += drawn;
        }
        if self.entered_front.volume > 0.0 {
            // um times m/s over m^2/s.
            let reynolds = gap_um.max(THINNEST) * 1e-6 * speed * DENSITY / (p.viscosity_mpas * 1e-3);
            let mixes = reynolds / (reynolds + p.reynolds);
            front += self.entered_front.leaves(gone(mixes * change.abs() / self.volume)).debris;
        }
        front
    }

    /// Flow of the flushing pressure, um^3/us: through the film from the hole to the rim, then through the side gap.
    fn flushed_um3_us(&self, gap_um: f64, depth_um: f64) -> f64 {
        let p = &self.p;
        let g = gap_um.max(THINNEST_FILM) * 1e-6;
        let film = 6.0 * p.viscosity_mpas * 1e-3 * -libm::log(HOLE) / (PI * g * g * g);
        // m^3/s are 1e12 um^3/us.
        p.flush_kpa * 1e3 / (film + side_resistance(p, depth_um)) * 1e12
    }

    /// What moving the electrode meets: the film of its face, 3 pi mu R^4/(2 g^3), and the side gap through which the same
    /// fluid goes, at a thickness of film and in a hole of a depth. Suction ends at the weight of the atmosphere.
    #[inline]
    pub fn film(&self, gap_um: f64, depth_um: f64) -> Film {
        let g = if gap_um > THINNEST_FILM { gap_um * 1e-6 } else { THINNEST_FILM * 1e-6 };
        let side = self.film.1 * depth_um.max(0.0) * 1e-6;
        Film { damping: self.film.0 / (g * g * g) + side, suction: ATMOSPHERE * self.area * 1e-12 }
    }
}

/// Pressure over flow of the side gap, Pa s/m^3: 12 mu h/(2 pi R s^3).
fn side_resistance(p: &Parameters, depth_um: f64) -> f64 {
    let s = p.side_um * 1e-6;
    12.0 * p.viscosity_mpas * 1e-3 * depth_um.max(0.0) * 1e-6 / (TAU * p.radius_um * 1e-6 * s * s * s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::{GAO, SINKER};

    fn dirty(p: &Parameters, gap_um: f64) -> Fluid {
        let mut fluid = Fluid::new(p, gap_um);
        let each = REFERENCE * p.area_um2() * gap_um / FACETS as f64;
        (0..FACETS).for_each(|facet| fluid.enter(facet, each, 0.0));
        fluid
    }

    #[test]
    fn whatever_moves_no_debris_is_made_or_lost() {
        for p in [SINKER.of(), GAO.of(), Parameters { flush_kpa: 20.0, ..SINKER.of() }] {
            let g0 = p.exchange_um;
            let mut fluid = dirty(&p, g0);
            for k in 0..200_000 {
                let t = f64::from(k);
                let gap = g0 * (1.0 + 0.6 * libm::sin(t * 0.3) + if k % 5000 < 300 { 20.0 } else { 0.0 });
                fluid.enter(k as usize % FACETS, 50.0, 50.0);
                fluid.step(100.0, gap, t * 0.01, if k > 150_000 { 0.3 } else { 0.0 });
                assert!(fluid.front.iter().all(|&m| m >= 0.0) && fluid.side >= 0.0 && fluid.squeezed.debris >= 0.0);
            }
            assert!(fluid.imbalance() < 1e-9, "{}", fluid.imbalance());
        }
    }

    #[test]
    fn a_gap_that_narrows_and_opens_again_gets_its_debris_back() {
        let p = Parameters { rest_mm3_s: 0.0, mixing: 0.0, ..SINKER.of() };
        for (comes_back, kept) in [(1.0, 0.999..1.001), (0.0, 0.7..0.85)] {
            let mut fluid = dirty(&Parameters { comes_back, ..p }, 35.0);
            fluid.step(100.0, 28.0, 0.0, 0.0);
            fluid.step(100.0, 35.0, 0.0, 0.0);
            assert!(kept.contains(&fluid.dirt()), "{comes_back}: {}", fluid.dirt());
        }
    }

    /// Concentration after a jump.
    fn after_jump(p: &Parameters, stroke_um: f64, mm_s: f64, depth_um: f64) -> f64 {
        let mut fluid = dirty(p, 35.0);
        let steps = ((stroke_um / mm_s * 10.0) as u32).max(2);
        for k in (0..=steps).chain((0..steps).rev()) {
            fluid.step(100.0, 35.0 + stroke_um * f64::from(k) / f64::from(steps), depth_um, 0.0);
        }
        fluid.dirt()
    }

    #[test]
    fn a_jump_cleans_by_stroke_and_by_speed() {
        // Fluid that mixes all.
        let p = Parameters { reynolds: 0.0, ..SINKER.of() };
        let long = after_jump(&p, 3000.0, 100.0, 2000.0);
        let short = after_jump(&p, 300.0, 100.0, 2000.0);
        let slow = after_jump(&p, 3000.0, 1.0, 2000.0);
        assert!(long < 0.2, "{long}");
        assert!(short > 2.0 * long, "{short} {long}");
        assert!(slow > 1.2 * long, "{slow} {long}");
    }

    #[test]
    fn fluid_is_reversible_but_for_its_reynolds_number() {
        let p = Parameters { rest_mm3_s: 0.0, mixing: 0.0, ..SINKER.of() };
        // 5 um at 200 Hz, a hundred times.
        let mut fluid = dirty(&p, 35.0);
        (0..10_000).for_each(|k| fluid.step(50.0, 35.0 + 2.5 * libm::sin(f64::from(k) * TAU / 100.0), 2000.0, 0.0));
        assert!((0.9..1.03).contains(&fluid.dirt()), "{}", fluid.dirt());
        let (slow, fast) = (after_jump(&p, 1000.0, 1.0, 2000.0), after_jump(&p, 1000.0, 100.0, 2000.0));
        assert!(slow > 2.0 * fast, "{slow} {fast}");
        // In a deep hole the side gap cannot follow at one atmosphere.
        let (follows, torn) = (after_jump(&p, 1000.0, 100.0, 8000.0), after_jump(&p, 1000.0, 2000.0, 8000.0));
        assert!(torn > 1.5 * follows, "{torn} {follows}");
    }

    #[test]
    fn a_flushing_pressure_cleans() {
        let p = SINKER.of();
        let left = |flush_kpa| {
            let mut fluid = dirty(&Parameters { flush_kpa, ..p }, 35.0);
            (0..1000).for_each(|_| fluid.step(100.0, 35.0, 3000.0, 0.0));
            fluid.dirt()
        };
        assert!(left(20.0) < 0.1 * left(0.0), "{} {}", left(20.0), left(0.0));
    }

    #[test]
    fn the_film_is_that_of_a_disc_and_the_side_gap_adds_to_it() {
        let fluid = Fluid::new(&SINKER.of(), 50.0);
        // 3 pi mu R^4/(2 h^3) of 2 mPa s, 1.5 mm and 50 um.
        let film = fluid.film(50.0, 0.0);
        assert!((film.damping - 0.381_7).abs() < 1e-3, "{}", film.damping);
        assert!((film.suction - 0.716).abs() < 1e-3);
        assert!(fluid.film(50.0, 5000.0).damping > 10.0 * film.damping);
    }
}
