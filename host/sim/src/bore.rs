//! A blind hole from power-up to depth: what a host would do, and what the model knows afterwards.

use crate::machine::Machine;
use crate::process::{Parameters, Process, Truth};
use crate::run::{FaultEvent, Job, Observer, Outcome, Progress, Sample};
use crate::scenario::Scenario;
use edm_hal_shim::bridge::Drive;
use edm_servo_head::gap::{GapSource, Voltage};
use edm_servo_head::head::{Command, Reason, State, Status};
use edm_servo_head::settings::{SettingError, Settings};
use edm_servo_head::units::{Nanometres, TICK_HZ};
use std::ops::RangeInclusive;

/// Values for a run: the machine and the process as they are, and the head's settings.
pub type Setup = Scenario<Parameters, Settings>;

/// Ticks between two reports of progress.
const PROGRESS: u64 = TICK_HZ as u64 / 10;
/// A run that gains no depth for so long is given up, s.
const PATIENCE_S: f64 = 120.0;
/// What counts as a gain, mm.
const GAIN_MM: f64 = 1e-3;
/// Eroding time that is left out of means, s: the feed law settles.
const SETTLING_S: f64 = 2.0;
/// Open-loop time in which the shot floor is measured, s.
const FLOOR_S: f64 = 10.0;

/// Checks the values against each other.
pub fn check(setup: &Setup) -> Result<(), SettingError> {
    setup.process.validate()?;
    setup.head.build()?;
    if depth_range_mm(setup).is_empty() {
        let rule = "must lie above actuator.stroke_mm, limit.lower_mm and axis.stroke_um, or there is nothing to bore";
        return Err(SettingError::Conflict { field: "workpiece.surface_mm", rule });
    }
    Ok(())
}

/// Depths that can be bored, mm: from a micrometre to the lower end of the stroke, or to the lower limit switch.
pub fn depth_range_mm(setup: &Setup) -> RangeInclusive<f64> {
    let p = &setup.process;
    let lowest = p.stroke.min(p.lower_limit).min(setup.head.axis_stroke * 1e-3);
    // In whole micrometres, so that the limit reads as a person would write it.
    let um = (f64::from(lowest) - f64::from(p.surface)) * 1e3;
    0.001..=(um + 0.001).floor() / 1e3
}

/// Bores a hole: one sample a servo tick to `observer`, progress every 100 ms of simulated time.
///
/// A fault of the head is an [`Outcome`]; an error means that the run could not be made.
pub fn bore(job: &Job, observer: &mut impl Observer, progress: &mut dyn FnMut(&Progress)) -> Result<Outcome, String> {
    let setup = &job.setup;
    // The guided check is the subject of other runs; here it has passed.
    let settings = Settings { commissioned: true, ..setup.head };
    let mut parameters = setup.process;
    if job.surrogate {
        // The dry loop has no workpiece in its way: it lies at the very end of the stroke.
        parameters.surface = parameters.stroke * 0.999;
    }
    let mut machine = Machine::new(&parameters, &settings, job.seed).map_err(|error| setup.refusal(error))?;
    if job.surrogate {
        machine.run_dry(&settings, f64::from(setup.process.surface) * 1e3, job.seed);
    }
    start(&mut machine, job)?;

    let mut faults = Vec::new();
    let mut means = Means::default();
    let mut gained = (0.0, 0.0);
    let stop_reason = loop {
        machine.tick();
        let truth = machine.truth();
        let status = *machine.head.status();
        observer.sample(&sample(&truth, &status, settings.encoder_count.into()));
        means.take(&truth, &status);
        while let Some(change) = machine.head.next_change() {
            if let Reason::Fault(fault) = change.reason {
                faults.push(FaultEvent { t_s: truth.t_s, fault: fault.name().into() });
            }
        }
        let depth_mm = depth_mm(&truth);
        if u64::from(status.tick).is_multiple_of(PROGRESS) {
            progress(&Progress { sim_time_s: truth.t_s, depth_mm, state: status.state.name() });
        }
        if depth_mm > gained.1 + GAIN_MM || status.state == State::Seeking {
            gained = (truth.t_s, depth_mm);
        }
        match (status.state, status.fault) {
            (State::Done, _) => break "depth reached".into(),
            (State::Fault, Some(fault)) => break format!("fault: {}", fault.name()),
            _ if truth.t_s - gained.0 > PATIENCE_S => break format!("no progress for {PATIENCE_S} s"),
            _ => {}
        }
    };
    let truth = machine.truth();
    let status = machine.head.status();
    Ok(Outcome {
        completed: status.state == State::Done,
        stop_reason,
        depth_mm: depth_mm(&truth),
        sim_time_s: truth.t_s,
        shot_floor_rms_v: means
            .gap()
            .filter(|_| !job.surrogate)
            .map(|gap| shot_floor(job, &settings, gap))
            .transpose()?,
        pulses: truth.pulses,
        lost_counts: machine.decoder_count().abs_diff(truth.count),
        illegal_transitions: status.illegal_transitions.into(),
        faults,
    })
}

/// What a host does first: home where the head rests, enable, queue the move, start.
fn start(machine: &mut Machine, job: &Job) -> Result<(), String> {
    for _ in 0..TICK_HZ / 100 {
        machine.tick();
    }
    let target_mm = f64::from(job.setup.process.surface) + job.depth_mm;
    machine.command(Command::SetHome(Nanometres(0)))?;
    machine.command(Command::Enable)?;
    machine.command(Command::MoveTo(Nanometres((target_mm * 1e6).round() as i64)))?;
    machine.command(Command::Start)
}

/// How far the electrode face is below the first surface.
fn depth_mm(truth: &Truth) -> f64 {
    (truth.face_um - truth.first_surface_um) * 1e-3
}

fn sample(truth: &Truth, status: &Status, count_um: f64) -> Sample {
    let zero = truth.first_surface_um;
    Sample {
        t_s: truth.t_s,
        position_um: truth.face_um - zero,
        setpoint_um: f64::from(status.setpoint.to_f32()) * count_um - zero,
        velocity_um_s: truth.velocity_um_s,
        surface_um: truth.surface_um - zero,
        gap_um: truth.gap_um,
        gap_v: status.gap.block.0,
        filtered_v: status.gap.filtered.0,
        setpoint_v: status.gap_setpoint.0,
        duty: status.duty,
        state: status.state.name(),
    }
}

/// Mean gap and debris while eroding.
#[derive(Default)]
struct Means {
    ticks: f64,
    gap_um: f64,
    debris: f64,
    eroding_s: f64,
}

impl Means {
    fn take(&mut self, truth: &Truth, status: &Status) {
        if status.state == State::Eroding {
            self.eroding_s += 1.0 / f64::from(TICK_HZ);
            if self.eroding_s > SETTLING_S {
                self.ticks += 1.0;
                self.gap_um += truth.gap_um;
                self.debris += truth.debris;
            }
        }
    }

    fn gap(&self) -> Option<(f64, f64)> {
        (self.ticks > 0.0).then(|| (self.gap_um / self.ticks, self.debris / self.ticks))
    }
}

/// Scatter of the filtered gap voltage with the gap held still at the run's mean: chance alone, no control.
fn shot_floor(job: &Job, settings: &Settings, (gap_um, debris): (f64, f64)) -> Result<f64, String> {
    let refused = |error| job.setup.refusal(error);
    let mut process = Process::new(&job.setup.process, job.seed).map_err(refused)?;
    process.hold_gap(gap_um, debris);
    let mut source = Voltage::new(settings.build().map_err(refused)?.gap);
    let (mut sum, mut square, mut n) = (0.0, 0.0, 0.0);
    let settled = TICK_HZ / 2;
    for tick in 0..settled + (FLOOR_S * f64::from(TICK_HZ)) as u32 {
        let volts = f64::from(source.update(Some(&process.advance(Drive::Coast, true).block)).filtered.0);
        if tick >= settled {
            sum += volts;
            square += volts * volts;
            n += 1.0;
        }
    }
    let mean = sum / n;
    Ok((square / n - mean * mean).max(0.0).sqrt())
}
