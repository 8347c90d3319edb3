//! Published numbers that parameters were fitted to.

use super::gate::{Gate, Kind, Wanted};
use super::statistics::{Mean, each, largest};
use edm_process::harness::{Law, Motion, Rig, Swing, Voltage, swing};
use edm_process::parameters::{Parameters, SINKER, XIN};
use edm_process::{Orders, Process, Stretch, Wires};
use edm_sim::plot::Figure;

/// \[X\] table 2: gap in um, three charging times in us.
pub const TABLE_2: [(f64, [f64; 3]); 15] = [
    (10.0, [1.62, 1.63, 1.64]),
    (15.0, [1.58, 1.57, 1.57]),
    (20.0, [1.51, 1.52, 1.49]),
    (25.0, [1.37, 1.39, 1.36]),
    (30.0, [1.23, 1.22, 1.24]),
    (35.0, [1.13, 1.13, 1.12]),
    (40.0, [1.02, 1.05, 1.04]),
    (45.0, [0.95, 0.93, 0.94]),
    (50.0, [0.86, 0.88, 0.87]),
    (55.0, [0.78, 0.77, 0.77]),
    (60.0, [0.71, 0.72, 0.70]),
    (65.0, [0.66, 0.65, 0.65]),
    (70.0, [0.61, 0.62, 0.60]),
    (75.0, [0.57, 0.58, 0.57]),
    (80.0, [0.54, 0.55, 0.54]),
];

/// \[X\] table 4: gap in um, removal in mg/min.
pub const TABLE_4: [(f64, f64); 3] = [(40.0, 51.0), (50.0, 46.0), (60.0, 39.0)];
/// Density of silicon, mg/um^3: \[X\] table 1.
const SILICON: f64 = 2.33e-9;
/// Share of the end voltage at which the charging time is taken: \[X\] section 2.
const CAPTURE: f64 = 0.63;

/// A comparator on the gap that captures when the voltage of a pulse passes a share of the open one.
struct Capture {
    volts: f64,
    captured: Vec<f64>,
}

impl Wires for Capture {
    fn stretch(&mut self, stretch: &Stretch) {
        let (from, to) = (stretch.volts.from, stretch.volts.to);
        if stretch.gate.0 == stretch.from && from < self.volts && self.volts < to {
            self.captured.push(stretch.volts.us * libm::log((to - from) / (to - self.volts)));
        }
    }
}

/// Charging time that is captured at a gap (um), us.
fn charging_time(p: &Parameters, gap: f64) -> f64 {
    let p = Parameters { sense_v: 0.0, ..*p };
    let Ok(mut process) = Process::new(&p, gap, 1) else { return f64::NAN };
    process.hold(0.0);
    let mut wires = Capture { volts: CAPTURE * p.open_v, captured: Vec::new() };
    process.advance(10.0 * (p.on_us + p.off_us), -gap, &Orders::default(), &mut wires);
    Mean::new(&wires.captured).of
}

/// Mean of the three times of a row of \[X\] table 2, us.
fn published_time(times: &[f64; 3]) -> f64 {
    times.iter().sum::<f64>() / 3.0
}

/// Largest share by which a captured charging time is off \[X\] table 2, percent, and where, um.
pub fn charging_error(p: &Parameters) -> (f64, f64) {
    let mut worst = (0.0, 0.0);
    for (gap, times) in TABLE_2 {
        let seen = charging_time(p, gap);
        let wanted = published_time(&times);
        let off = 100.0 * (seen / wanted - 1.0);
        if off.is_nan() || off.abs() > f64::abs(worst.0) {
            worst = (off, gap);
        }
    }
    (worst.0.abs(), worst.1)
}

pub fn charging() -> Vec<Gate> {
    let (off, at) = charging_error(&XIN.of());
    let figure = Figure::new("Charging time to 63 % against gap", "gap, um", "charging time, us")
        .published("[X] table 2", TABLE_2.map(|(gap, times)| (gap, published_time(&times))))
        .line("simulated", (8..=84).step_by(4).map(|um| (um.into(), charging_time(&XIN.of(), um.into()))));
    vec![
        Gate::new(
            Kind::Calibration,
            "[X] table 2, charging time: largest error, %",
            off,
            Wanted::AtMost(6.0),
            format!("at {at} um, of 15 gaps from 10 to 80 um"),
        )
        .drawn([figure]),
    ]
}

/// Removal at a gap.
pub struct Removal {
    /// Gap, um.
    pub gap_um: f64,
    /// Published, mg/min.
    pub published: f64,
    /// Simulated, mg/min.
    pub simulated: Mean,
}

/// Removal at the gaps of \[X\] table 4, by these seeds.
pub fn removal(p: &Parameters, seeds: u64, seconds: f64) -> Vec<Removal> {
    let runs: Vec<(f64, u64)> = TABLE_4.iter().flat_map(|&(gap, _)| (1..=seeds).map(move |seed| (gap, seed))).collect();
    let rates = each(&runs, |&(gap, seed)| {
        let Ok(mut rig) = Rig::new(p, Law::Gap(gap), Motion::default(), seed) else { return f64::NAN };
        const SETTLES_S: f64 = 10.0;
        rig.run(SETTLES_S);
        let before = rig.process.depth_um();
        rig.run(SETTLES_S + seconds);
        (rig.process.depth_um() - before) * p.area_um2() * SILICON / seconds * 60.0
    });
    let by_gap = TABLE_4.iter().zip(rates.chunks(seeds as usize));
    by_gap.map(|(&(gap_um, published), rates)| Removal { gap_um, published, simulated: Mean::new(rates) }).collect()
}

pub fn removals() -> Vec<Gate> {
    let all = removal(&XIN.of(), 4, 200.0);
    let off = |r: &Removal| 100.0 * (r.simulated.of / r.published - 1.0).abs();
    let said = all.iter().map(|r| {
        format!("{} um: {:.1} +- {:.1} mg/min ({} published)", r.gap_um, r.simulated.of, r.simulated.error, r.published)
    });
    vec![
        Gate::new(
            Kind::Calibration,
            "[X] table 4, removal: largest error, %",
            largest(all.iter().map(off)),
            Wanted::AtMost(5.0),
            said.collect::<Vec<_>>().join("; "),
        )
        .drawn([Figure::new("Removal against gap", "gap, um", "removal, mg/min")
            .published("[X] table 4", TABLE_4)
            .curve("simulated", all.iter().map(|r| (r.gap_um, r.simulated)))]),
    ]
}

/// Electrode about its mean for a second after ten, um over s.
pub fn motion(p: &Parameters, servo: Voltage) -> Vec<(f64, f64)> {
    let Ok(mut rig) = Rig::new(p, Law::Voltage(servo), Motion::default(), 1) else { return Vec::new() };
    rig.run(10.0);
    let mut all = Vec::new();
    for ms in 0..1000 {
        rig.run(10.0 + 1e-3 * f64::from(ms));
        all.push((1e-3 * f64::from(ms), rig.x));
    }
    let mean = all.iter().map(|(_, x)| x).sum::<f64>() / all.len() as f64;
    all.iter().map(|(t, x)| (*t, x - mean)).collect()
}

/// Swing of a servo's electrode, mean of these seeds.
pub fn thesis_swing(p: &Parameters, servo: Voltage, seeds: u64) -> (Mean, Mean, Mean) {
    let seeds: Vec<u64> = (1..=seeds).collect();
    let all: Vec<Swing> = each(&seeds, |&seed| {
        let nothing = Swing { um: f64::NAN, hz: f64::NAN, volts: f64::NAN };
        Rig::new(p, Law::Voltage(servo), Motion::default(), seed).map_or(nothing, |mut rig| swing(&mut rig, 10.0, 40.0))
    });
    let mean = |of: fn(&Swing) -> f64| Mean::new(&all.iter().map(of).collect::<Vec<_>>());
    (mean(|s| s.um), mean(|s| s.hz), mean(|s| s.volts))
}

pub fn swings() -> Vec<Gate> {
    let (um, hz, volts) = thesis_swing(&SINKER.of(), Voltage::thesis(50.0), 6);
    vec![
        Gate::new(
            Kind::Calibration,
            "[R] section 4.3, thesis machine: swing, um peak to peak",
            um.of,
            Wanted::Between(36.0, 44.0),
            format!("+- {:.1}; sine of the same rms; published about 40", um.error),
        )
        .drawn([Figure::new(
            "Thesis machine at 50 V, one seed; [R]: 40 um p-p, 20 Hz",
            "time, s",
            "about its mean, um",
        )
        .line("simulated", motion(&SINKER.of(), Voltage::thesis(50.0)))
        .limit("", 20.0)
        .limit("", -20.0)]),
        Gate::new(
            Kind::Calibration,
            "[R] section 4.3, thesis machine: frequency of the swing, Hz",
            hz.of,
            Wanted::Between(18.0, 22.0),
            format!("+- {:.1}; published about 20, 17.6 of its motor voltage; mean {:.1} V", hz.error, volts.of),
        ),
    ]
}
