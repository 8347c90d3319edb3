//! The two surfaces, as facets that share the face.
//!
//! A facet has a depth, a height of its peaks, wear of the electrode before it, and damage: pits and carbon that arcs leave.
//! Sparks strike where the rate of ignition is high, and take material there, so that the facets stay together; mean gap,
//! smallest gap and the place of a spark differ by their depths and peaks.

use super::FACETS;
use crate::math::sum;
use crate::parameters::Parameters;
use crate::random::{Cause, Stream};

/// Peaks are no higher than so many of their mean.
const HIGHEST: f64 = 4.0;
/// Narrowest gap that ignition is calculated with, um.
const NARROWEST: f64 = 1.0;
/// Gap at which the rate of ignition is given, um.
const GIVEN_AT: f64 = 50.0;
/// Share by which the next crater moves what is shown as roughness.
const ROUGHNESS_MEAN: f64 = 1e-3;

/// State of the facets.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Depth removed, um.
    depth: [f64; FACETS],
    /// Length the electrode lost, um.
    worn: [f64; FACETS],
    peak: [f64; FACETS],
    damage: [f64; FACETS],
    /// Sums of depth and worn.
    sums: (f64, f64),
    /// Rates of ignition, 1/us, and their sum.
    rates: [f64; FACETS],
    rate: f64,
    /// Smallest gap, um, without what is through.
    least: f64,
    /// Smallest distance of the facets without their peaks, um, without what is through.
    solid: f64,
    /// Share of the face that is through.
    through: f64,
    /// Mean volume of the last craters, um^3.
    crater: f64,
    um_per_um3: f64,
    /// Rate of a facet in a clean gap of `GIVEN_AT`, 1/us.
    clean_rate: f64,
    per_dirt: f64,
    /// One over the square of the largest gap that ignites, 1/um^2; 0 where there is none.
    per_reach: f64,
    bridge_um: f64,
    mean_peak: f64,
    hurt: f64,
    heal: f64,
    most_hurt: f64,
    thickness: f64,
    turns: bool,
    random: Stream,
}

impl Surface {
    /// Even surfaces.
    pub fn new(p: &Parameters, seed: u64) -> Surface {
        let facet = p.area_um2() / FACETS as f64;
        Surface {
            depth: [0.0; FACETS],
            worn: [0.0; FACETS],
            peak: [p.peak_um; FACETS],
            damage: [0.0; FACETS],
            sums: (0.0, 0.0),
            rates: [0.0; FACETS],
            rate: 0.0,
            least: f64::INFINITY,
            solid: f64::INFINITY,
            through: 0.0,
            crater: 0.0,
            um_per_um3: 1.0 / facet,
            clean_rate: p.ignition * 1e-12 * facet,
            per_dirt: p.ignition_debris,
            per_reach: if p.reach_um_v > 0.0 { 1.0 / (p.reach_um_v * p.open_v * p.reach_um_v * p.open_v) } else { 0.0 },
            bridge_um: p.bridge_um,
            mean_peak: p.peak_um,
            hurt: p.hurt,
            heal: p.heal,
            most_hurt: p.most_hurt,
            thickness: p.thickness_um - p.depth_um,
            turns: p.turn_ms > 0.0,
            random: Stream::new(Cause::Peak, seed),
        }
    }

    /// Mean depth, um.
    pub fn depth_um(&self) -> f64 {
        self.sums.0 / FACETS as f64
    }

    /// Mean length that the electrode lost, um.
    pub fn worn_um(&self) -> f64 {
        self.sums.1 / FACETS as f64
    }

    /// Ignitions in a microsecond.
    #[inline]
    pub fn rate(&self) -> f64 {
        self.rate
    }

    /// Smallest gap, um, at the last look.
    pub fn least_um(&self) -> f64 {
        self.least
    }

    /// Smallest distance of the facets without their peaks, um, at the last look: below zero they push.
    pub fn solid_um(&self) -> f64 {
        self.solid
    }

    /// Share of the face before which nothing is left.
    pub fn through(&self) -> f64 {
        self.through
    }

    /// Mean damage.
    pub fn damage(&self) -> f64 {
        self.damage.iter().sum::<f64>() / FACETS as f64
    }

    /// Damage of a facet.
    pub fn damage_at(&self, facet: usize) -> f64 {
        self.damage.get(facet).copied().unwrap_or(0.0)
    }

    /// Mean size of the last craters, um: what roughness goes with.
    pub fn crater_um(&self) -> f64 {
        libm::cbrt(self.crater)
    }

    /// Updates all facets at a mean gap: `factor` multiplies every rate, `front` is their debris, and `dirt` of it is its
    /// concentration in 5 %; `hot` is the place of an arc, and its heat. Gives the mean rate at which bridges form, over that
    /// of 5 % in a gap of `bridge_um`.
    pub fn look(
        &mut self,
        gap_um: f64,
        factor: f64,
        front: &[f64; FACETS],
        dirt: f64,
        hot: Option<(usize, f64)>,
    ) -> f64 {
        let base = gap_um - (self.sums.0 + self.sums.1) / FACETS as f64;
        let rate = self.clean_rate * factor * (GIVEN_AT * GIVEN_AT * GIVEN_AT);
        let bridge = self.bridge_um;
        let (mut bridges, mut gaps, mut solid) = ([0.0; FACETS], [0.0; FACETS], [0.0; FACETS]);
        let bridge_cubed = bridge * bridge * bridge;
        for i in 0..FACETS {
            let flat = base + self.depth[i] + self.worn[i];
            let gap = flat - self.peak[i];
            let gap_at_least = if gap > NARROWEST { gap } else { NARROWEST };
            let near = 1.0 / gap_at_least;
            let beyond = 1.0 - gap_at_least * gap_at_least * self.per_reach;
            let reaches = if beyond > 0.0 { beyond } else { 0.0 };
            let dirt = front[i] * dirt;
            let cube = near * near * near;
            let closeness = bridge_cubed * cube;
            self.rates[i] = rate * (1.0 + self.per_dirt * dirt) * cube * reaches;
            bridges[i] = dirt * closeness * closeness * (1.0 + self.damage[i]);
            (gaps[i], solid[i]) = (gap, flat);
        }
        if self.through > 0.0 {
            for i in 0..FACETS {
                if self.depth[i] >= self.thickness {
                    (self.rates[i], bridges[i]) = (0.0, 0.0);
                    (gaps[i], solid[i]) = (f64::INFINITY, f64::INFINITY);
                }
            }
        }
        if let Some((facet, heat)) = hot {
            // Carbon and vapour of a hot place draw the discharges.
            self.rates[facet] *= 1.0 + heat;
        }
        (self.least, self.solid) = (least(&gaps), least(&solid));
        self.rate = sum(&self.rates);
        sum(&bridges) / FACETS as f64
    }

    /// The facet to which a share of the rate belongs.
    pub fn pick(&self, share: f64) -> usize {
        let mut left = share * self.rate();
        let found = self.rates.iter().position(|rate| {
            left -= rate;
            left < 0.0
        });
        // What rounding leaves over belongs to the last that can ignite.
        found.or_else(|| self.rates.iter().rposition(|&rate| rate > 0.0)).unwrap_or(0)
    }

    /// A discharge takes volumes (um^3) from work and electrode at a facet; an arc hurts it, so many times, a spark heals it.
    pub fn strike(&mut self, facet: usize, work: f64, electrode: f64, arc: Option<f64>) {
        if facet >= FACETS {
            return;
        }
        let (deeper, shorter) = (work * self.um_per_um3, electrode * self.um_per_um3);
        self.depth[facet] += deeper;
        self.sums = (self.sums.0 + deeper, self.sums.1 + shorter);
        if self.turns {
            self.worn.iter_mut().for_each(|worn| *worn += shorter / FACETS as f64);
        } else {
            self.worn[facet] += shorter;
        }
        if self.depth[facet] >= self.thickness {
            let through = self.depth.iter().filter(|&&depth| depth >= self.thickness).count();
            self.through = through as f64 / FACETS as f64;
        }
        if let Some(times) = arc {
            self.damage[facet] = (self.damage[facet] + self.hurt * times).min(self.most_hurt);
        } else {
            self.peak[facet] = (self.mean_peak * self.random.exponential()).min(HIGHEST * self.mean_peak);
            self.damage[facet] *= 1.0 - self.heal;
        }
        self.crater += (work - self.crater) * ROUGHNESS_MEAN;
    }
}

/// The least of all, in an order that can be done four at a time.
fn least(of: &[f64; FACETS]) -> f64 {
    let mut four = [f64::INFINITY; 4];
    for group in of.chunks_exact(4) {
        for (least, &gap) in four.iter_mut().zip(group) {
            *least = if gap < *least { gap } else { *least };
        }
    }
    four.into_iter().fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parameters::SINKER;

    #[test]
    fn a_wider_gap_ignites_less_and_bridges_less() {
        let mut surface = Surface::new(&SINKER.of(), 1);
        let mut last = (f64::INFINITY, f64::INFINITY);
        for k in 1..2000 {
            let bridges = surface.look(f64::from(k) * 0.1, 1.0, &[1e5; FACETS], 1e-6, None);
            let now = (surface.rate(), bridges);
            assert!(now.0 <= last.0 && now.1 <= last.1);
            last = now;
        }
    }

    #[test]
    fn sparks_strike_where_it_is_narrow_and_level_it() {
        let mut surface = Surface::new(&Parameters { peak_um: 0.0, reach_um_v: 0.0, ..SINKER.of() }, 1);
        surface.depth[3] = -10.0;
        surface.sums.0 = -10.0;
        surface.look(30.0 - 10.0 / 16.0, 1.0, &[0.0; FACETS], 0.0, None);
        assert!((surface.least_um() - 20.0).abs() < 1e-9);
        // (30/20)^3 of fifteen others.
        let struck = (0..18_375).filter(|&k| surface.pick((f64::from(k) + 0.5) / 18_375.0) == 3).count();
        assert_eq!(struck, 3375);
        surface.strike(3, 10.0 / surface.um_per_um3, 0.0, None);
        assert!(surface.depth_um().abs() < 1e-12);
    }

    #[test]
    fn a_facet_that_is_through_ignites_no_more() {
        let mut surface = Surface::new(&Parameters { thickness_um: 100.0, ..SINKER.of() }, 1);
        surface.strike(5, 101.0 / surface.um_per_um3, 0.0, None);
        assert_eq!(surface.through(), 1.0 / 16.0);
        surface.look(40.0, 1.0, &[0.0; FACETS], 0.0, None);
        assert!((0..1000).all(|k| surface.pick(f64::from(k) / 1000.0) != 5));
    }

    #[test]
    fn arcs_hurt_and_sparks_heal() {
        let mut surface = Surface::new(&SINKER.of(), 1);
        (0..100).for_each(|_| surface.strike(0, 1.0, 0.0, Some(1.0)));
        assert_eq!(surface.damage_at(0), 4.0);
        (0..100).for_each(|_| surface.strike(0, 1.0, 0.0, None));
        let left = 4.0 * libm::exp(100.0 * libm::log(1.0 - SINKER.of().heal));
        assert!((surface.damage_at(0) - left).abs() < 1e-9 && surface.damage_at(1) == 0.0);
    }
}
