//! From any start within a factor of 4 of the default gains that a head can hold, what is proposed by the measured response keeps 45 degrees
//! and 6 dB in the true loop of the model.
//!
//! A push takes the corners of the gains on one machine and some random starts on all five; `EDM_TUNE=20` so many random starts on each.

use edm_desk::tune::response::{Axis, Complex, GAIN_DB, Gains, Margins, PHASE_DEG, Point, Response, margins};
use edm_servo_head::head::{Command, Evidence, Reason};
use edm_servo_head::settings::Settings;
use edm_sim::kinds::{KINDS, Kind, open_loop, run, try_with};
use edm_sim::machine::Machine;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus as Random;

/// The defaults.
const DEFAULTS: Gains = Gains { velocity_hz: 200.0, position_hz: 60.0, integral_ms: 15.0 };

/// Within what the settings allow.
fn allowed(velocity: f64, position: f64, integral: f64) -> Gains {
    let velocity_hz = (DEFAULTS.velocity_hz * velocity).clamp(10.0, 500.0);
    Gains {
        velocity_hz,
        position_hz: (DEFAULTS.position_hz * position).clamp(5.0, (0.5 * velocity_hz).min(200.0)),
        integral_ms: DEFAULTS.integral_ms * integral,
    }
}

fn set(settings: &mut Settings, gains: &Gains) {
    settings.servo_velocity_hz = gains.velocity_hz as f32;
    settings.servo_position_hz = gains.position_hz as f32;
    settings.servo_integral_ms = gains.integral_ms as f32;
}

/// Margins of the loop as it is, at the velocity of the measurement.
fn true_margins(kind: &Kind, settings: &Settings, gains: &Gains) -> Option<Margins> {
    let mut settings = *settings;
    set(&mut settings, gains);
    let counts_s = f64::from(settings.tune_velocity) * 1e3 / kind.count_um;
    let curve: Vec<(f64, Complex)> = (0..600)
        .map(|step| 5.0 * 500f64.powf(f64::from(step) / 599.0))
        .map(|hz| {
            let (re, im) = open_loop(kind, &settings, hz, counts_s);
            (hz, Complex(re, im))
        })
        .collect();
    margins(&curve, &[])
}

/// What is measured, or why the head does not hold.
fn measured(machine: &mut Machine, settings: &Settings, gains: Gains) -> Result<Response, String> {
    machine.command(Command::Tune).map_err(|refused| refused.to_string())?;
    let (mut bytes, mut reason) = (Vec::new(), None);
    run(machine, 300.0, |machine| {
        if let Some(Evidence::Point(point)) = machine.next_evidence() {
            bytes.extend(point.words().into_iter().flat_map(f32::to_le_bytes));
        }
        while let Some(change) = machine.next_change() {
            reason = Some(change.reason);
        }
        reason == Some(Reason::Tuned) || machine.status().fault.is_some()
    });
    if let Some(fault) = machine.status().fault {
        return Err(fault.name().into());
    }
    let value = |value: f32| f64::from(value);
    let (constant, bus) = (value(settings.axis_force_constant), value(settings.axis_bus));
    let acceleration = constant * bus / (value(settings.axis_resistance) * value(settings.axis_mass));
    let axis = Axis { acceleration, back_emf: constant / bus };
    Response::new(gains, axis, Point::decode(&bytes)).ok_or_else(|| "no points".into())
}

/// One start: whether it counts, and the true margins of before, and of the proposal.
fn proposed(kind: &Kind, seed: u64, gains: Gains) -> Result<(Margins, Margins, Response), String> {
    let before = |settings: &Settings| true_margins(kind, settings, &gains);
    let Some((mut machine, settings)) = try_with(kind, seed, 3.0, |settings, _| set(settings, &gains)) else {
        return Err("the head does not get there".into());
    };
    let Some(was) = before(&settings).filter(|was| was.phase_deg > 0.0 && was.gain_db > 0.0) else {
        return Err("the loop is not stable".into());
    };
    while machine.next_change().is_some() {}
    let response = measured(&mut machine, &settings, gains)
        .map_err(|why| format!("{why} (margins {:.0} deg, {:.1} dB)", was.phase_deg, was.gain_db))?;
    let (new, _) = response.propose(None).ok_or("no proposal")?;
    let is = true_margins(kind, &settings, &new).ok_or("crosses over nowhere")?;
    Ok((was, is, response))
}

#[test]
fn from_any_start_that_a_head_can_hold_the_proposal_keeps_its_margins_in_the_model() {
    let many: Option<u64> = std::env::var("EDM_TUNE").ok().and_then(|count| count.parse().ok());
    let mut starts: Vec<(usize, u64, Gains)> = Vec::new();
    let machines = if many.is_some() { KINDS.len() } else { 1 };
    for kind in 0..machines {
        for velocity in [0.25, 1.0, 4.0] {
            for position in [0.25, 1.0, 4.0] {
                for integral in [0.25, 1.0, 4.0] {
                    let middle = [velocity, position, integral].iter().filter(|factor| **factor == 1.0).count();
                    // The corners; the edges and faces in the campaign.
                    if many.is_some() || middle == 0 || middle == 3 {
                        starts.push((kind, 0, allowed(velocity, position, integral)));
                    }
                }
            }
        }
    }
    let mut random = Random::seed_from_u64(39);
    for kind in 0..KINDS.len() {
        for seed in 0..many.unwrap_or(1) {
            let mut factor = || 4f64.powf(random.random_range(-1.0..1.0));
            starts.push((kind, 100 + seed, allowed(factor(), factor(), factor())));
        }
    }
    let (mut bad, mut held, mut not) = (Vec::new(), Vec::new(), 0);
    for (number, seed, gains) in starts {
        let kind = &KINDS[number];
        let name = format!(
            "{:7} {seed:3} {:5.0} Hz {:5.0} Hz {:5.1} ms",
            kind.name, gains.velocity_hz, gains.position_hz, gains.integral_ms
        );
        match proposed(kind, seed, gains) {
            Ok((was, is, response)) => {
                let said = response.margins.map_or((0.0, 0.0), |margins| (margins.phase_deg, margins.gain_db));
                println!(
                    "{name}: {:5.1} deg {:5.1} dB, measured {:5.1} {:5.1}; proposal {:5.1} deg {:5.1} dB at {:.0} Hz",
                    was.phase_deg, was.gain_db, said.0, said.1, is.phase_deg, is.gain_db, is.crossover_hz
                );
                if is.phase_deg < PHASE_DEG || is.gain_db < GAIN_DB || is.less_db < GAIN_DB {
                    bad.push(format!("{name}: {:.1} deg, {:.1} dB", is.phase_deg, is.gain_db));
                }
                held.push((is.phase_deg, is.gain_db, (said.0 - was.phase_deg).abs(), (said.1 - was.gain_db).abs()));
            }
            Err(why) => {
                println!("{name}: {why}");
                not += 1;
            }
        }
    }
    let worst = |of: fn(&(f64, f64, f64, f64)) -> f64| held.iter().map(of).fold(f64::INFINITY, f64::min);
    let mean = |of: fn(&(f64, f64, f64, f64)) -> f64| held.iter().map(of).sum::<f64>() / held.len() as f64;
    let most = |of: fn(&(f64, f64, f64, f64)) -> f64| held.iter().map(of).fold(0.0, f64::max);
    println!(
        "{} starts hold, {not} do not; proposals: phase margin mean {:.1}, worst {:.1} degrees; gain margin mean {:.1}, worst {:.1} dB; measured margins off by {:.1} degrees, {:.1} dB at most",
        held.len(),
        mean(|at| at.0),
        worst(|at| at.0),
        mean(|at| at.1),
        worst(|at| at.1),
        most(|at| at.2),
        most(|at| at.3)
    );
    assert!(bad.is_empty(), "{bad:#?}");
    assert!(held.len() * 3 > not * 2 && held.len() >= 8, "{} hold, {not} do not", held.len());
}
