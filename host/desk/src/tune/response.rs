//! The response of a loop as its head has measured it: margins, and what they would be with other gains.
//!
//! The loop is opened at the duty. With V the velocity as the head sees it, X the position, each to a duty of 1, and the cascade of
//! `src/servo`: L = PI (V + wp X) + k wp X, PI = p + i / (1 - exp(-j w T)), T the servo tick, wp the gain of the position loop, k the
//! back-EMF. V comes of the measured L, for X is V / (j w), and later than V by `LATE_S`, so that nothing but L is taken from the head.
//! Of other gains L is calculated with the same V: motor, mass, delays and whatever else there is are those that were measured.

use serde::Serialize;
use std::f64::consts::{PI, TAU};

/// A servo tick, s.
const TICK_S: f64 = 50e-6;
/// By how much the velocity of the encoder is later than its position, s, at a count in each tick: half of four ticks, and half an edge. The
/// position counts below the cross-over, where another value hardly shows.
const LATE_S: f64 = 120e-6;
/// Frequencies at which a loop is calculated, and how far beyond the highest one that was measured.
const GRID: usize = 400;
const BEYOND: f64 = 2.0;

/// Margins that a proposal keeps, by which it chooses: what [`Margins::holds`] asks for, and a reserve.
pub const PHASE_DEG: f64 = 45.0;
/// See [`PHASE_DEG`].
pub const GAIN_DB: f64 = 6.0;
const RESERVE_DEG: f64 = 7.0;
const RESERVE_DB: f64 = 2.0;
/// Gain of the position loop, of the bandwidth of the velocity loop; and integral time times that bandwidth: those of the defaults, 60 Hz and 15 ms
/// at 200 Hz.
const POSITION: f64 = 0.3;
const INTEGRAL: f64 = 3.0;
/// Range of servo.velocity_hz in which a proposal is sought, Hz.
const VELOCITY_HZ: (f64, f64) = (10.0, 500.0);

/// Real and imaginary part.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Complex(pub f64, pub f64);

impl Complex {
    /// exp(j angle) times a size.
    pub fn polar(size: f64, angle: f64) -> Complex {
        Complex(size * angle.cos(), size * angle.sin())
    }

    /// Distance from zero.
    pub fn size(self) -> f64 {
        self.0.hypot(self.1)
    }

    /// Angle, from -pi to pi.
    pub fn angle(self) -> f64 {
        self.1.atan2(self.0)
    }

    fn times(self, other: Complex) -> Complex {
        Complex(self.0 * other.0 - self.1 * other.1, self.0 * other.1 + self.1 * other.0)
    }

    fn plus(self, other: Complex) -> Complex {
        Complex(self.0 + other.0, self.1 + other.1)
    }

    fn over(self, other: Complex) -> Complex {
        let square = other.0 * other.0 + other.1 * other.1;
        self.times(Complex(other.0 / square, -other.1 / square))
    }
}

/// A frequency that was measured.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Point {
    /// Frequency.
    pub hz: f64,
    /// Amplitude of the sine, duty.
    pub duty: f64,
    /// The loop opened at the duty.
    pub open: Complex,
    /// Its standard deviation.
    pub open_off: f64,
    /// Velocity of the head to a duty of 1, by position, mm/s.
    pub plant: Complex,
    /// Its standard deviation.
    pub plant_off: f64,
}

impl Point {
    /// Points as an object has them: eight REAL32 each.
    pub fn decode(bytes: &[u8]) -> Vec<Point> {
        let words: Vec<f64> =
            bytes.as_chunks::<4>().0.iter().map(|word| f64::from(f32::from_le_bytes(*word))).collect();
        let point = |&[hz, duty, re, im, open_off, plant_re, plant_im, plant_off]: &[f64; 8]| Point {
            hz,
            duty,
            open: Complex(re, im),
            open_off,
            plant: Complex(plant_re, plant_im),
            plant_off,
        };
        words.as_chunks::<8>().0.iter().map(point).collect()
    }
}

/// What a person tunes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Gains {
    /// `servo.velocity_hz`.
    pub velocity_hz: f64,
    /// `servo.position_hz`.
    pub position_hz: f64,
    /// `servo.integral_ms`.
    pub integral_ms: f64,
}

/// What the settings say of the axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Axis {
    /// Acceleration of a duty of 1, m/s^2: K U / (R m).
    pub acceleration: f64,
    /// Duty that cancels the back-EMF of 1 m/s: K / U.
    pub back_emf: f64,
}

/// The motor as the response shows it: acceleration exp(-j w delay) / ((j w + damping) (1 + j w lag)).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Plant {
    /// Acceleration of a duty of 1, m/s^2.
    pub acceleration: f64,
    /// What its own velocity takes away, 1/s.
    pub damping: f64,
    /// Time constant of the winding, s.
    pub lag_s: f64,
    /// Delay, s: of the held duty and of the velocity.
    pub delay_s: f64,
}

impl Plant {
    fn at(&self, hz: f64) -> Complex {
        let w = TAU * hz;
        let below = Complex(self.damping, w).times(Complex(1.0, w * self.lag_s));
        Complex::polar(self.acceleration, -w * self.delay_s).over(below)
    }
}

/// How far a loop is from ringing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Margins {
    /// Cross-over, where |L| = 1: the bandwidth.
    pub crossover_hz: f64,
    /// Phase margin there, degrees.
    pub phase_deg: f64,
    /// Gain margin, dB: by how much more gain it rings.
    pub gain_db: f64,
    /// Where.
    pub gain_hz: f64,
    /// By how much less gain it rings as well, dB; its integrators need some.
    pub less_db: f64,
    /// Largest 1 / |1 + L|: how much more a disturbance may do than without a loop.
    pub peak: f64,
    /// What the phase margin and the gain margin may be wrong by.
    pub phase_off_deg: f64,
    /// See [`phase_off_deg`](Margins::phase_off_deg).
    pub gain_off_db: f64,
}

impl Margins {
    /// Whether it keeps what is asked for, with so much in reserve.
    pub fn keeps(&self, reserve_deg: f64, reserve_db: f64) -> bool {
        self.phase_deg >= PHASE_DEG + reserve_deg
            && self.gain_db >= GAIN_DB + reserve_db
            && self.less_db >= GAIN_DB + reserve_db
    }

    /// Whether it keeps 45 degrees and 6 dB.
    pub fn holds(&self) -> bool {
        self.keeps(0.0, 0.0)
    }
}

/// A loop as a picture has it: one value a frequency. The phase does not jump; a loop whose position counts begins near -270 degrees.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Bode {
    /// Frequencies.
    pub hz: Vec<f64>,
    /// Size, dB.
    pub db: Vec<f64>,
    /// Phase, degrees.
    pub deg: Vec<f64>,
    /// What both may be wrong by: dB, degrees. Empty for what is calculated.
    pub off_db: Vec<f64>,
    /// See [`off_db`](Bode::off_db).
    pub off_deg: Vec<f64>,
}

impl Bode {
    fn of(curve: impl Iterator<Item = (f64, Complex)>) -> Bode {
        let mut bode = Bode::default();
        for (hz, open) in curve {
            let angle = open.angle().to_degrees();
            // Near to the one before; the first one below zero.
            let near = bode.deg.last().copied().unwrap_or(-180.0);
            bode.hz.push(hz);
            bode.db.push(20.0 * open.size().log10());
            bode.deg.push(angle + 360.0 * ((near - angle) / 360.0).round());
        }
        bode
    }
}

/// A measured loop.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Response {
    /// Gains that it was measured with.
    pub gains: Gains,
    /// The settings of the axis.
    pub axis: Axis,
    /// What was measured, by rising frequency.
    pub points: Vec<Point>,
    /// The motor.
    pub plant: Plant,
    /// Its margins.
    pub margins: Option<Margins>,
    /// As a picture.
    pub bode: Bode,
}

/// Share by which a response may be wrong in addition to three deviations: what a held sine brings back, simulated (docs/commissioning.md).
const SHARE: f64 = 0.015;

impl Response {
    /// Of a head.
    pub fn new(gains: Gains, axis: Axis, points: Vec<Point>) -> Option<Response> {
        let usable = |point: &Point| point.hz > 0.0 && point.open.size() > 0.0 && point.open_off < point.open.size();
        let points: Vec<Point> = points.into_iter().filter(usable).collect();
        let plant = fit(&gains, &axis, &points)?;
        let mut bode = Bode::of(points.iter().map(|point| (point.hz, point.open)));
        let off = |point: &Point| 3.0 * point.open_off / point.open.size() + SHARE;
        bode.off_db = points.iter().map(|point| 20.0 * (1.0 + off(point)).log10()).collect();
        bode.off_deg = points.iter().map(|point| off(point).min(1.0).asin().to_degrees()).collect();
        let mut response = Response { gains, axis, points, plant, margins: None, bode };
        response.margins = response.with(&gains);
        Some(response)
    }

    /// What a loop with other gains would look like, over the frequencies that were measured.
    pub fn bode(&self, gains: &Gains) -> Bode {
        let last = self.points.last().map_or(0.0, |point| point.hz);
        Bode::of(self.curve(gains).into_iter().step_by(4).take_while(|(hz, _)| *hz <= last))
    }

    /// Margins with other gains; nothing where the loop crosses nowhere.
    pub fn with(&self, gains: &Gains) -> Option<Margins> {
        margins(&self.curve(gains), &self.points)
    }

    /// The loop with other gains, on a grid: frequency and L.
    pub fn curve(&self, gains: &Gains) -> Vec<(f64, Complex)> {
        let (Some(first), Some(last)) = (self.points.first(), self.points.last()) else { return Vec::new() };
        let motions: Vec<Motion> = self.points.iter().map(|point| Motion::of(point, &self.gains, &self.axis)).collect();
        let ratio = (BEYOND * last.hz / first.hz).powf(1.0 / (GRID - 1) as f64);
        let mut hz = first.hz;
        let mut curve = Vec::with_capacity(GRID);
        for _ in 0..GRID {
            curve.push((hz, open(self.velocity(&motions, hz), hz, gains, &self.axis)));
            hz *= ratio;
        }
        curve
    }

    /// Velocity to a duty of 1: between measured points by size and phase, beyond them as the motor does.
    fn velocity(&self, motions: &[Motion], hz: f64) -> Complex {
        let after = motions.partition_point(|motion| motion.hz < hz);
        let (Some(a), Some(b)) = (motions.get(after.wrapping_sub(1)), motions.get(after)) else {
            let end = if after == 0 { motions.first() } else { motions.last() };
            let Some(end) = end else { return Complex::default() };
            // On from what was measured there.
            return self.plant.at(hz).times(end.velocity.over(self.plant.at(end.hz)));
        };
        // What is measured differs from the motor by little, and slowly.
        let [low, high] = [a, b].map(|motion| motion.velocity.over(self.plant.at(motion.hz)));
        let share = (hz / a.hz).ln() / (b.hz / a.hz).ln();
        let turn = high.over(low).angle();
        let size = low.size() * (high.size() / low.size()).powf(share);
        Complex::polar(size, low.angle() + turn * share).times(self.plant.at(hz))
    }

    /// The highest gains of this form that keep the margins, and cross over no higher than `wanted_hz`, if that is given. Nothing where
    /// no gains do.
    pub fn propose(&self, wanted_hz: Option<f64>) -> Option<(Gains, Margins)> {
        let (low, high) = VELOCITY_HZ;
        let mut best = None;
        for step in 0..=240 {
            let velocity_hz = low * (high / low).powf(f64::from(step) / 240.0);
            let gains = self.formed(velocity_hz);
            let Some(margins) = self.with(&gains) else { continue };
            // What was not measured is not promised.
            let wanted = margins.crossover_hz <= self.highest_hz().min(wanted_hz.unwrap_or(f64::MAX));
            if wanted && margins.keeps(RESERVE_DEG, RESERVE_DB) {
                best = Some((gains, margins));
            }
        }
        best
    }

    /// Highest frequency that was measured, Hz.
    pub fn highest_hz(&self) -> f64 {
        self.points.last().map_or(0.0, |point| point.hz)
    }

    /// Gains of one form: position loop and integral time by the bandwidth that the motor, not its settings, gives the velocity loop.
    fn formed(&self, velocity_hz: f64) -> Gains {
        let true_hz = velocity_hz * self.plant.acceleration / self.axis.acceleration;
        rounded(&Gains {
            velocity_hz,
            position_hz: (POSITION * true_hz).min(0.5 * velocity_hz),
            integral_ms: INTEGRAL * 1e3 / true_hz,
        })
    }

    /// By the rules of Ziegler and Nichols for a PI controller and a reaction curve, as \[A\] has them: P = 0.9 T / (k L), I = 0.27 T / (k L^2),
    /// with dead time L, time constant T and gain k of the velocity to a duty, of which only k / T, the acceleration, matters. They hold for
    /// what does not integrate, so for the velocity loop alone: the position loop keeps its share.
    pub fn ziegler_nichols(&self) -> Gains {
        let dead = self.plant.delay_s + self.plant.lag_s;
        let p = 0.9 / (self.plant.acceleration * dead);
        let i = 0.27 / (self.plant.acceleration * dead * dead);
        let velocity_hz = p * self.axis.acceleration / TAU;
        rounded(&Gains { velocity_hz, position_hz: POSITION * velocity_hz, integral_ms: p / i * 1e3 })
    }
}

/// As a person writes them, within what the settings allow.
fn rounded(gains: &Gains) -> Gains {
    let velocity_hz = gains.velocity_hz.clamp(10.0, 500.0).floor();
    Gains {
        velocity_hz,
        position_hz: gains.position_hz.clamp(5.0, 200.0).min(0.5 * velocity_hz).floor(),
        integral_ms: (gains.integral_ms.clamp(1.0, 10_000.0) * 10.0).ceil() / 10.0,
    }
}

/// PI and the gain of the position loop.
fn controller(hz: f64, gains: &Gains, axis: &Axis) -> (Complex, f64) {
    let p = TAU * gains.velocity_hz / axis.acceleration;
    let i = p * TICK_S / (gains.integral_ms * 1e-3);
    let back = Complex::polar(1.0, -TAU * hz * TICK_S);
    let integral = Complex(i, 0.0).over(Complex(1.0 - back.0, -back.1));
    (Complex(p, 0.0).plus(integral), TAU * gains.position_hz)
}

/// What L is to V: X = V exp(j w late) / (j w).
fn answer(hz: f64, gains: &Gains, axis: &Axis) -> Complex {
    let (pi, position) = controller(hz, gains, axis);
    let w = TAU * hz;
    let place = Complex::polar(position / w, w * LATE_S - PI / 2.0);
    pi.times(Complex(1.0 + place.0, place.1)).plus(Complex(place.0 * axis.back_emf, place.1 * axis.back_emf))
}

fn open(velocity: Complex, hz: f64, gains: &Gains, axis: &Axis) -> Complex {
    velocity.times(answer(hz, gains, axis))
}

/// Velocity, m/s to a duty of 1, as the head sees it.
struct Motion {
    hz: f64,
    velocity: Complex,
    /// Share by which it may be wrong.
    off: f64,
}

impl Motion {
    fn of(point: &Point, gains: &Gains, axis: &Axis) -> Motion {
        let velocity = point.open.over(answer(point.hz, gains, axis));
        Motion { hz: point.hz, velocity, off: point.open_off / point.open.size() }
    }
}

/// The motor that explains the points best. Damping and lag are tried; acceleration and delay follow.
fn fit(gains: &Gains, axis: &Axis, points: &[Point]) -> Option<Plant> {
    let motions: Vec<Motion> = points.iter().map(|point| Motion::of(point, gains, axis)).collect();
    if motions.len() < 3 {
        return None;
    }
    let weigh = |motion: &Motion| 1.0 / (motion.off * motion.off + 1e-4);
    let whole: f64 = motions.iter().map(weigh).sum();
    let mut best: Option<(f64, Plant)> = None;
    for damping in (0..=20).map(|step| if step == 0 { 0.0 } else { 2.0 * 1.25f64.powi(step) }) {
        for lag_s in (0..=40).map(|step| 50e-6 * f64::from(step)) {
            let bare = Plant { acceleration: 1.0, damping, lag_s, delay_s: 0.0 };
            let rests: Vec<(f64, f64, Complex)> = motions
                .iter()
                .map(|motion| (weigh(motion), TAU * motion.hz, motion.velocity.over(bare.at(motion.hz))))
                .collect();
            let size: f64 = rests.iter().map(|(weight, _, rest)| weight * rest.size().ln()).sum::<f64>() / whole;
            // A delay turns what is left by w each: over a phase that has not gone round.
            let (mut top, mut bottom) = (0.0, 0.0);
            for (weight, w, rest) in &rests {
                top -= weight * w * rest.angle();
                bottom += weight * w * w;
            }
            let delay_s = (top / bottom).max(0.0);
            let left: f64 = rests
                .iter()
                .map(|(weight, w, rest)| {
                    let (by, turn) = (rest.size().ln() - size, rest.angle() + w * delay_s);
                    weight * (by * by + turn * turn)
                })
                .sum();
            if best.as_ref().is_none_or(|(least, _)| left < *least) {
                best = Some((left, Plant { acceleration: size.exp(), damping, lag_s, delay_s }));
            }
        }
    }
    best.map(|(_, plant)| plant)
}

/// Margins of a loop on a grid of rising frequencies; how far they may be off is that of the nearest points. Nothing where it crosses over
/// nowhere.
pub fn margins(curve: &[(f64, Complex)], points: &[Point]) -> Option<Margins> {
    let degrees = |l: Complex| {
        let turned = l.angle().to_degrees() + 180.0;
        if turned > 180.0 { turned - 360.0 } else { turned }
    };
    let mut found: Option<Margins> = None;
    let (mut gain, mut less, mut peak) = ((f64::INFINITY, 0.0), f64::INFINITY, 0.0f64);
    let mut crossings: Vec<(f64, f64)> = Vec::new();
    for pair in curve.windows(2) {
        let [(low, a), (high, b)] = pair else { continue };
        peak = peak.max(1.0 / Complex(1.0 + a.0, a.1).size());
        let (size_a, size_b) = (a.size().ln(), b.size().ln());
        if (size_a > 0.0) != (size_b > 0.0) {
            let share = size_a / (size_a - size_b);
            let hz = low * (high / low).powf(share);
            crossings.push((hz, degrees(*a) + b.over(*a).angle().to_degrees() * share));
        }
        // Phase of -180 degrees: the imaginary part changes its sign on the left.
        if a.0 < 0.0 && b.0 < 0.0 && (a.1 > 0.0) != (b.1 > 0.0) {
            let share = a.1 / (a.1 - b.1);
            let db = -20.0 * (size_a + (size_b - size_a) * share) / std::f64::consts::LN_10;
            if db > 0.0 && db < gain.0 {
                gain = (db, low * (high / low).powf(share));
            } else if db <= 0.0 {
                less = less.min(-db);
            }
        }
    }
    // The loop that crosses more than once is as good as its worst crossing; its bandwidth is the last.
    let worst = crossings.iter().map(|(_, phase)| *phase).fold(f64::INFINITY, f64::min);
    if let Some(&(crossover_hz, _)) = crossings.last() {
        let off = |hz: f64| {
            let near = points.iter().min_by(|a, b| (a.hz / hz).ln().abs().total_cmp(&(b.hz / hz).ln().abs()));
            near.map_or(1.0, |point| 3.0 * point.open_off / point.open.size() + SHARE)
        };
        let gain_hz = if gain.0.is_finite() { gain.1 } else { curve.last().map_or(0.0, |(hz, _)| *hz) };
        found = Some(Margins {
            crossover_hz,
            phase_deg: worst,
            gain_db: gain.0.min(60.0),
            gain_hz,
            less_db: less.min(60.0),
            peak,
            phase_off_deg: off(crossover_hz).min(1.0).asin().to_degrees(),
            gain_off_db: 20.0 * (1.0 + off(gain_hz)).log10(),
        });
    }
    found
}
