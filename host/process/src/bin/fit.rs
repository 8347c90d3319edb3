//! Fits what is named calibration, and nothing else, and writes it into the source.

use clap::Parser;
use edm_process::gates::{charging_error, removal, thesis_swing};
use edm_process::harness::Voltage;
use edm_process::parameters::{Fitted, Parameters, SINKER, XIN};
use std::fs;
use std::process::ExitCode;

/// Fits the simulated process to \[X\] tables 2 and 4 and to \[R\]'s swing of 40 um at 20 Hz.
#[derive(Parser)]
struct Arguments {
    /// Version of the model.
    #[arg(long, value_name = "VERSION", default_value_t = edm_process::frozen::VERSION, value_parser = clap::value_parser!(u32).range(1..=2))]
    model: u32,
    /// Only says by how much the values in the source are off the fit; fails when one is by more than a hundredth.
    #[arg(long)]
    check: bool,
}

const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/src/parameters/fitted.rs");
const SWING_UM: f64 = 40.0;
const SWING_HZ: f64 = 20.0;

/// Where a function of one variable with one minimum has it.
fn minimum(mut low: f64, mut high: f64, times: u32, of: impl Fn(f64) -> f64) -> f64 {
    const GOLDEN: f64 = 0.618_033_988_749_895;
    let (mut a, mut b) = (high - GOLDEN * (high - low), low + GOLDEN * (high - low));
    let (mut at_a, mut at_b) = (of(a), of(b));
    for _ in 0..times {
        if at_a < at_b {
            (high, b, at_b) = (b, a, at_a);
            a = high - GOLDEN * (high - low);
            at_a = of(a);
        } else {
            (low, a, at_a) = (a, b, at_b);
            b = low + GOLDEN * (high - low);
            at_b = of(b);
        }
    }
    0.5 * (low + high)
}

/// Charging resistance and rounding: smallest largest error over \[X\] table 2.
fn charging(version: u32) -> (f64, f64) {
    let with = |charge_ohm, rounding_um| Parameters { charge_ohm, rounding_um, ..XIN.of(version) };
    let ohm = |rounding| minimum(10e3, 100e3, 40, |ohm| charging_error(&with(ohm, rounding)).0);
    let rounding = minimum(5.0, 60.0, 30, |rounding| charging_error(&with(ohm(rounding), rounding)).0);
    (ohm(rounding), rounding)
}

/// Ignition of all machines and removal of \[X\]'s: smallest largest error over \[X\] table 4. What counts for removal is its
/// middle, so that the slope is ignition's.
fn ignition(version: u32) -> (f64, f64) {
    let largest = |ignition: f64, removal_um3_uj: f64| {
        let p = Parameters { ignition, removal_um3_uj, ..XIN.of(version) };
        let ratios: Vec<f64> = removal(&p, 4, 100.0).iter().map(|r| r.simulated.of / r.published).collect();
        let (low, high) = (ratios.iter().copied().fold(f64::MAX, f64::min), ratios.iter().copied().fold(0.0, f64::max));
        ((high - 1.0).max(1.0 - low), (low * high).sqrt())
    };
    let scaled = |ignition: f64| {
        let mut removal = 10.0;
        for _ in 0..3 {
            removal /= largest(ignition, removal).1;
        }
        removal
    };
    let log = minimum(libm::log(200.0), libm::log(1500.0), 14, |log| {
        let ignition = libm::exp(log);
        largest(ignition, scaled(ignition)).0
    });
    let ignition = libm::exp(log);
    (ignition, scaled(ignition))
}

/// Slow disturbance and gain of the thesis machine's servo: its swing and its frequency, in turns.
fn swing(version: u32, ignition: f64) -> (f64, f64) {
    const SEEDS: u64 = 12;
    let seeds = if version == 1 { SEEDS } else { 4 };
    let at = |slow_log: f64, gain: f64| {
        let p = Parameters { ignition, slow_log, ..SINKER.of(version) };
        let (um, hz, _) = thesis_swing(&p, Voltage { gain, ..Voltage::thesis_of(version, 50.0) }, seeds);
        (um.of, hz.of)
    };
    if version > 1 {
        // In turns they would not meet: arcs of a wide swing slow it down. The gain of the swing, then the slow of its frequency.
        let gain = |slow| crossing(100.0, 250.0, |gain| at(slow, gain).0 - SWING_UM);
        let slow = crossing(0.3, 0.8, |slow| SWING_HZ - at(slow, gain(slow)).1);
        println!("  gain {:.1} um/s per V, slow {slow:.4}", gain(slow));
        return (slow, gain(slow));
    }
    let (mut slow, mut gain) = (0.8, 150.0);
    for _ in 0..4 {
        gain = crossing(50.0, 500.0, |gain| at(slow, gain).1 - SWING_HZ);
        slow = crossing(0.0, 2.0, |slow| at(slow, gain).0 - SWING_UM);
        println!("  gain {gain:.1} um/s per V, slow {slow:.4}");
    }
    (slow, gain)
}

/// Where a rising function passes zero.
fn crossing(mut low: f64, mut high: f64, of: impl Fn(f64) -> f64) -> f64 {
    for _ in 0..12 {
        let middle = 0.5 * (low + high);
        if of(middle) < 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// Four digits.
fn rounded(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}

fn main() -> ExitCode {
    let Arguments { check, model: version } = Arguments::parse();
    println!("[X] table 2: charging");
    let (charge_ohm, rounding_um) = charging(version);
    println!("  {charge_ohm:.0} ohm, {rounding_um:.2} um");
    println!("[X] table 4: ignition, removal");
    let (ignition, xin_removal) = ignition(version);
    println!("  {ignition:.1} 1/(s mm^2), {xin_removal:.3} um^3/uJ");
    println!("[R] section 4.3: swing");
    let (slow_log, thesis_gain) = swing(version, rounded(ignition));
    let found = [charge_ohm, rounding_um, ignition, xin_removal, slow_log, thesis_gain].map(rounded);
    let Fitted { charge_ohm, rounding_um, ignition, xin_removal, slow_log, thesis_gain } = Fitted::of(version);
    let mut off = false;
    let section = if version == 1 { "const VALUES" } else { "const SECOND" };
    let Ok(mut text) = fs::read_to_string(FILE) else {
        eprintln!("{FILE} cannot be read");
        return ExitCode::from(2);
    };
    for ((name, is), found) in [
        ("charge_ohm", charge_ohm),
        ("rounding_um", rounding_um),
        ("ignition", ignition),
        ("xin_removal", xin_removal),
        ("slow_log", slow_log),
        ("thesis_gain", thesis_gain),
    ]
    .into_iter()
    .zip(found)
    {
        println!("{name}: {found} fitted, {is} in the source");
        off |= (found / is - 1.0).abs() > 0.01;
        let mut own = false;
        let set = |line: &str| {
            own = if line.contains("    pub const ") { line.contains(section) } else { own };
            match line.split_once(&format!("        {name}: ")) {
                Some(("", _)) if own => format!("        {name}: {found:?},"),
                _ => line.to_string(),
            }
        };
        text = text.lines().map(set).collect::<Vec<_>>().join("\n") + "\n";
    }
    if check {
        return if off { ExitCode::FAILURE } else { ExitCode::SUCCESS };
    }
    match fs::write(FILE, text) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{FILE} cannot be written: {error}");
            ExitCode::from(2)
        }
    }
}
