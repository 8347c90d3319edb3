//! A hole, from a head at rest to its depth or to the reason why not.

use crate::coarse::Coarse;
use crate::machine::{Machine, Rig};
use crate::process::{Process, Pulses, Truth};
use crate::run::{FaultEvent, Job, Observer, Outcome, Progress, RowOutcome, Sample};
use edm_gcode::Program;
use edm_servo_head::gap::{GapSource, Voltage};
use edm_servo_head::head::{Command, Finding, Reason, SeenBy, State, Structure};
use edm_servo_head::path::{AHEAD, Piece, Shape};
use edm_servo_head::settings::{Declared, SettingError, Settings, Value};
use edm_servo_head::units::{Fixed, Nanometres, TICK_HZ};
use edm_technology::File;
use std::ops::RangeInclusive;

pub use crate::run::Setup;

/// Rest before the head is switched on, ticks: the velocity estimate has seen the standstill.
const REST: u32 = 100;
/// Ticks between two reports of progress: 100 ms.
const PROGRESS: u64 = TICK_HZ as u64 / 10;
/// Ticks that a fault reaction is watched for: long enough for every reaction to come to rest.
const AFTERMATH: u64 = TICK_HZ as u64 / 2;
/// Slowest boring that is waited for, mm/min: a twentieth of the default scenario's. [`PATIENCE_S`] comes on top.
const SLOWEST: f64 = 0.01;
const PATIENCE_S: f64 = 60.0;
/// Open loop in which the shot floor is measured, and the settling of filters and debris before it, ticks.
const FLOOR: u32 = 5 * TICK_HZ;
const FLOOR_SETTLE: u32 = 2 * TICK_HZ;

/// Checks the values against each other.
pub fn check(setup: &Setup) -> Result<(), SettingError> {
    setup.process.validate()?;
    setup.head.build()?;
    if depth_range_mm(setup).is_empty() {
        let rule =
            "must lie above the end of the stroke, limit.lower_mm and axis.stroke_um, or there is nothing to bore";
        return Err(SettingError::Conflict { field: "workpiece.surface_mm", rule });
    }
    Ok(())
}

/// Signal that moves the workpiece.
const RAISED: &str = "workpiece.raised_mm";
/// Place of the workpiece during the guided check, mm above its usual one: out of the way.
const AWAY_MM: f64 = -100.0;
/// Longest guided check, its two strokes left out, s.
const CHECK_S: f64 = 60.0;

/// Why a guided check did not pass.
enum Ended {
    /// By what the head found.
    Found(Finding),
    /// By a refusal, a fault or the time, in words.
    Otherwise(String),
}

/// Whether a head passes the guided check. `scenario` has the values of a built-in scenario before a change: where the head there believes
/// in a wrong mass or counterbalance, and the change leaves both, the check is made with the right ones.
///
/// # Errors
/// Why the head does not pass: what it found, and each of its settings that the finding names, with the value.
pub fn guided_check(setup: &Setup, scenario: Option<&Setup>, seed: u64) -> Result<(), String> {
    let mut ended = commission(setup, &setup.head, seed);
    let believed = |head: &Settings| [head.axis_mass, head.axis_counterbalance];
    if let Some(scenario) = scenario
        && ended.is_err()
        && believed(&setup.head) == believed(&scenario.head)
    {
        let mut right = scenario.head;
        for _ in 0..2 {
            match commission(scenario, &right, seed) {
                Err(Ended::Found(Finding::Mass(found))) => right.axis_mass = found.measured as f32 * 1e-3,
                Err(Ended::Found(Finding::Counterbalance(found))) => {
                    right.axis_counterbalance = found.measured as f32 * 1e-3;
                }
                _ => break,
            }
        }
        if believed(&right) != believed(&scenario.head) {
            let [axis_mass, axis_counterbalance] = believed(&right);
            ended = commission(setup, &Settings { axis_mass, axis_counterbalance, ..setup.head }, seed);
        }
    }
    let why = match ended {
        Ok(()) => return Ok(()),
        Err(Ended::Found(finding)) => found(setup, &finding),
        Err(Ended::Otherwise(why)) => why,
    };
    Err(format!("{}: a real head stops in its guided check, and cannot be enabled: {why}", setup.name))
}

/// The guided check of a head with these settings, at its upper stop above no workpiece, in a machine of its own.
fn commission(setup: &Setup, settings: &Settings, seed: u64) -> Result<(), Ended> {
    let settings = Settings { commissioned: false, ..*settings };
    let mut plant = setup.process;
    plant.set("model.depth_um", Value::Number(0.0)).map_err(|error| Ended::Otherwise(error.to_string()))?;
    let mut machine = Machine::new(plant, &settings, seed).map_err(|error| Ended::Otherwise(setup.refusal(error)))?;
    machine.process.happen(RAISED, Value::Number(AWAY_MM)).map_err(|_| Ended::Otherwise(RAISED.into()))?;
    let rest = |machine: &mut Machine| (0..REST).for_each(|_| machine.tick());
    rest(&mut machine);
    machine.command(Command::Commission).map_err(|refused| Ended::Otherwise(refused.to_string()))?;
    // Each stroke may take twice the time that it should.
    let strokes_s = 4e-3 * f64::from(settings.axis_stroke / settings.commission_velocity);
    for _ in 0..((CHECK_S + strokes_s) * f64::from(TICK_HZ)) as u64 {
        if matches!(machine.status().state, State::Disabled | State::Fault) {
            break;
        }
        machine.tick();
    }
    rest(&mut machine);
    match (machine.next_check(), machine.status().fault) {
        (Some(Ok(_)), _) => Ok(()),
        (Some(Err(finding)), _) => Err(Ended::Found(finding)),
        (None, Some(fault)) => Err(Ended::Otherwise(format!("fault {}", fault.name()))),
        (None, None) => Err(Ended::Otherwise("no result".into())),
    }
}

/// A finding in words, with the settings that it names as they are.
fn found(setup: &Setup, finding: &Finding) -> String {
    let text = match *finding {
        Finding::Stroke(counts) if counts > 0 => {
            let um = counts as f64 * f64::from(setup.head.encoder_count);
            let share = f64::from(setup.head.commission_tolerance) * 1e-2;
            let [least, most] = [um / (1.0 + share), um / (1.0 - share)];
            format!(
                "axis.stroke_um measures {um:.0}, and may be set from {least:.0} to {most:.0}, unless encoder.count_um is wrong"
            )
        }
        _ => finding.to_string(),
    };
    let words: Vec<&str> = text.split([' ', ',', ':']).collect();
    let named = Settings::FIELDS.iter().map(|field| field.key).filter(|key| words.contains(key));
    let set: Vec<String> = named.filter_map(|key| Some(format!("{key} = {}", setup.value(key)?))).collect();
    if set.is_empty() { text } else { format!("{text}; set are {}", set.join(", ")) }
}

/// Deepest hole of a head that a coarse axis carries, mm.
const DEEPEST: f64 = 500.0;

/// Depths that can be bored, mm: from a micrometre to the lower end of the stroke, or to the lower limit switch. A coarse axis carries
/// the head on.
pub fn depth_range_mm(setup: &Setup) -> RangeInclusive<f64> {
    let p = &setup.process;
    if setup.head.inch_step > 0.0 {
        return 0.001..=DEEPEST;
    }
    let lowest = (p.stroke_mm() as f32).min(p.installation.lower_limit).min(setup.head.axis_stroke * 1e-3);
    // In whole micrometres, so that the limit reads as a person would write it.
    let whole = |mm: f64| (mm * 1000.0).floor() / 1000.0;
    0.001..=whole(f64::from(lowest) - f64::from(p.installation.surface) + 1e-6)
}

/// Checks a technology table against machine and settings.
///
/// # Errors
/// Row and setting, and what is allowed.
pub fn table(setup: &Setup, depth_mm: f64, table: File) -> Result<File, String> {
    table.check(&setup.head)?;
    let first = table.rows.first().map_or(0.0, |row| row.leaves_um);
    if depth_mm * 1e3 - first < 1.0 {
        return Err(format!("leaves {first} um in its first row, which is not less than the depth of {depth_mm} mm"));
    }
    Ok(table)
}

/// Checks a path against the machine.
///
/// # Errors
/// What cannot be carried out, with line and word.
pub fn program(setup: &Setup, program: Program) -> Result<Program, String> {
    if setup.head.structure != Structure::Path {
        return Err("other axes move only with feed.structure = path".into());
    }
    program.within(f64::from(setup.process.installation.surface), *depth_range_mm(setup).end())?;
    Ok(program)
}

/// Bores a hole: one sample a servo tick to `observer`, progress every 100 ms of simulated time.
///
/// A fault of the head is an [`Outcome`]; an error means that the run could not be made.
pub fn bore(job: &Job, observer: &mut impl Observer, progress: &mut dyn FnMut(&Progress)) -> Result<Outcome, String> {
    let setup = &job.setup;
    // The virtual head's commissioning counts as passed: it needs an axis without a workpiece.
    let settings = Settings { commissioned: true, ..setup.head };
    let refused = |error| setup.refusal(error);
    let first_surface_um = f64::from(setup.process.installation.surface) * 1e3;
    let mut plant = setup.process;
    if job.surrogate {
        // The dry loop is run without a workpiece: it lies at the very end of the stroke.
        plant.installation.surface = plant.stroke_mm() as f32 * 0.999;
    }
    let mut machine = Machine::new(plant, &settings, job.seed).map_err(refused)?;
    machine.process.schedule(&setup.events);
    if job.surrogate {
        machine.run_dry(&settings, first_surface_um, job.seed);
    }
    run(job, &mut machine, observer, progress)
}

/// Bores a hole with a commissioned head at rest at its upper stop, whatever it runs on.
///
/// # Errors
/// When the run cannot go on.
pub fn run(
    job: &Job,
    machine: &mut impl Rig,
    observer: &mut impl Observer,
    progress: &mut dyn FnMut(&Progress),
) -> Result<Outcome, String> {
    let setup = &job.setup;
    let first_surface_um = f64::from(setup.process.installation.surface) * 1e3;
    for _ in 0..REST {
        machine.tick()?;
    }
    // Home is where the head rests: not quite the stop's zero, because the stop gives way.
    let home = machine.true_count();
    let home_um = home as f64 * f64::from(setup.process.installation.count);
    let nm = |depth_um: f64| ((first_surface_um + depth_um - home_um) * 1e3).round() as i64;
    let surface = Fixed::whole(nm(0.0)).0 / 1000;
    machine.command(Command::SetHome(Nanometres(0)))?;
    machine.command(Command::Enable)?;
    // Pieces that wait until there is room for them.
    let pieces = || job.path.iter().flat_map(|path| &path.moves).map(|one| one.piece);
    let mut waiting = pieces();
    let mut rows = Rows::default();
    match pieces().next() {
        None if job.table.is_some() => {}
        None => machine.command(Command::MoveTo(Nanometres(nm(job.depth_mm * 1e3))))?,
        // Such a program is begun beside the work.
        Some(Piece { shape: Shape::Line, to: [..0, _, _], .. }) => {}
        Some(_) => machine.command(Command::MoveTo(Nanometres(nm(0.0))))?,
    }
    for piece in waiting.by_ref().take(AHEAD / 2) {
        machine.command(Command::AppendTo(below(piece, nm(0.0))))?;
    }
    match &job.table {
        Some(table) => machine.erode_by(table, Nanometres(nm(job.depth_mm * 1e3)))?,
        None => machine.command(Command::Start)?,
    }
    // What the program allows where the head is, um/s.
    let mut allowed = None;

    let length_mm = job.path.as_ref().map_or(job.depth_mm, |path| path.length_mm);
    let limit = ((length_mm / SLOWEST * 60.0 + PATIENCE_S) * f64::from(TICK_HZ)) as u64;
    let mut faults: Vec<FaultEvent> = Vec::new();
    let mut fault_tick = None;
    // Why the erosion ended, and where the face was before it was lifted.
    let mut ended = None;
    let mut lifted_from_um = None;
    let mut eroding = Means::default();
    let (mut jumps, mut cramped) = (0, false);
    let by_word = setup.head.inch_seen == SeenBy::Word;
    let mut coarse = Coarse::new(job.coarse_error_um, by_word, job.seed);
    let (mut tick, mut first, mut newest) = (0, Offset::default(), Offset::default());
    let state = loop {
        machine.tick()?;
        if setup.head.inch_step > 0.0 {
            let answer = coarse.tick(machine.status(), f64::from(setup.head.encoder_count) * 1e3);
            machine.carry(coarse.place_um() * 1e-3);
            if let Some(answer) = answer {
                machine.command(Command::Carry(answer))?;
            }
        }
        tick += 1;
        let offset = machine.status().position - machine.status().carried - machine.true_count();
        if tick <= OFFSETS as u64 {
            first.take(offset);
        }
        newest.take(offset);
        let truth = machine.process().truth();
        let sample = sample(machine, &truth, home_um);
        observer.sample(&sample);
        let state = machine.status().state;
        if let Some(table) = &job.table {
            // A row begins with a seek, and a head that is done may have more of them.
            if state != rows.state
                && matches!(state, State::Seeking | State::Retreating)
                && rows.state != State::Retreating
                || state == State::Done
            {
                rows.now = machine.row()?;
            }
            rows.state = state;
            let depth_um =
                machine.status().position as f64 * f64::from(setup.head.encoder_count) - nm(0.0) as f64 * 1e-3;
            rows.take(table, job.depth_mm, &setup.head, &sample, depth_um, machine.process().crater_um());
        }
        let feed = job.path.as_ref().and_then(|path| path.feed(Fixed(machine.status().path.0 - surface)));
        if feed != allowed && state == State::Eroding {
            allowed = feed;
            let feed_max = feed.map_or(setup.head.feed_max, |feed| setup.head.feed_max.min(feed as f32));
            machine.limit_feed(&Settings { feed_max, commissioned: true, ..setup.head })?;
        }
        if usize::from(machine.status().waiting) < AHEAD / 4 && state.pulses() {
            for piece in waiting.by_ref().take(AHEAD / 4) {
                machine.command(Command::AppendTo(below(piece, nm(0.0))))?;
            }
        }
        while let Some(change) = machine.next_change() {
            if let Reason::Fault(fault) = change.reason {
                faults.push(FaultEvent { t_s: sample.t_s, fault: fault.name().into() });
                fault_tick.get_or_insert(tick);
            }
            if change.from.pulses() && matches!(change.to, State::Lifting | State::Done) {
                ended = Some(change.reason);
            }
            jumps += u64::from(change.to == State::Jumping);
            if change.to == State::Lifting {
                lifted_from_um = Some(truth.face_um);
            }
        }
        cramped |= machine.status().cramped;
        if state == State::Eroding {
            eroding.take(sample.gap_um, truth.debris);
        }
        if tick % PROGRESS == 1 {
            let done_um = match job.path {
                Some(_) => f64::from(machine.status().path.to_f32()) - nm(0.0) as f64 * 1e-3,
                None => sample.position_um - first_surface_um,
            };
            progress(&Progress { sim_time_s: sample.t_s, done_mm: done_um * 1e-3, state: sample.state });
        }
        let over = fault_tick.is_some_and(|from| tick - from >= AFTERMATH);
        if state == State::Done && rows.now.is_none() || over || tick >= limit {
            break state;
        }
    };

    let truth = machine.process().truth();
    let completed = state == State::Done && faults.is_empty();
    let stop_reason = match faults.first() {
        _ if completed => {
            let end = if job.path.is_some() { "end of the path" } else { "depth reached" };
            match ended {
                Some(Reason::BrokenThrough) => "broken through".into(),
                Some(Reason::SparkedOut) => format!("{end}, sparked out"),
                Some(Reason::SparkOutTime) => format!("{end}, spark-out time over"),
                _ => end.into(),
            }
        }
        Some(event) => event.fault.clone(),
        None => format!(
            "{} not reached in {:.0} min",
            if job.path.is_some() { "end of the path" } else { "depth" },
            truth.t_s / 60.0
        ),
    };
    let sparks = !job.surrogate && eroding.ticks > 0.0;
    let shot_floor_rms_v = if sparks { Some(shot_floor(setup, job.seed, &eroding)?) } else { None };
    let removed_um = truth.surface_um - first_surface_um;
    Ok(Outcome {
        completed,
        stop_reason,
        depth_mm: (lifted_from_um.unwrap_or(truth.face_um) - first_surface_um) * 1e-3,
        wear_mm: truth.wear_um * 1e-3,
        through: truth.through,
        hole_depth_mm: (machine.imagined_surface_um().unwrap_or(truth.surface_um) - first_surface_um) * 1e-3,
        sim_time_s: truth.t_s,
        shot_floor_rms_v,
        pulses: truth.pulses,
        crater_um: machine.process().crater_um(),
        pit_um: machine.process().pit_um(),
        removed_mm3: setup.process.face_mm2() * removed_um * 1e-3,
        lost_counts: newest.median().abs_diff(first.median()),
        illegal_transitions: machine.status().illegal_transitions.into(),
        jumps,
        cramped,
        inches: coarse.moves(),
        carried_mm: coarse.place_um() * 1e-3,
        rows: rows.all,
        faults,
    })
}

/// Ticks of which an offset is known, an odd number.
const OFFSETS: usize = 21;

/// What the head counts less than there is, in the newest ticks. Truth and count are not of the same moment to the microsecond.
#[derive(Default)]
struct Offset([i64; OFFSETS], usize);

impl Offset {
    fn take(&mut self, counts: i64) {
        self.0[self.1 % OFFSETS] = counts;
        self.1 += 1;
    }

    fn median(&self) -> i64 {
        let mut sorted = self.0;
        sorted.sort_unstable();
        sorted[OFFSETS / 2]
    }
}

/// A piece of a path from the surface, which lies so many nm below home.
fn below(piece: Piece, surface: i64) -> Piece {
    let [down, x, y] = piece.to;
    Piece { to: [down + surface, x, y], ..piece }
}

fn sample(machine: &impl Rig, truth: &Truth, home_um: f64) -> Sample {
    let status = machine.status();
    let (surface_um, gap_um) = match machine.imagined_surface_um() {
        Some(surface_um) => (surface_um, surface_um - truth.position_um),
        None => (truth.surface_um, truth.gap_um),
    };
    Sample {
        t_s: truth.t_s,
        position_um: truth.face_um,
        beside_um: status.beside.map(|um| um.to_f32().into()),
        setpoint_um: home_um + f64::from(status.setpoint.to_f32()),
        velocity_um_s: truth.velocity_um_s,
        surface_um,
        gap_um,
        gap_v: machine.gap_block().0,
        filtered_v: status.gap.filtered.0,
        setpoint_v: status.gap_setpoint.0,
        duty: status.duty,
        state: status.state.name(),
        wear_um: truth.wear_um,
        debris: truth.debris,
        damage: truth.damage,
        contact_n: truth.contact_n,
        film_n: truth.film_n,
        pulses: truth.pulses,
        counts: status.gap.pulses,
        senses: status.senses,
    }
}

/// Rows of a table as they run.
#[derive(Default)]
struct Rows {
    state: State,
    /// The one under way, from 1.
    now: Option<u8>,
    all: Vec<RowOutcome>,
    number: u8,
    /// Pulses before the newest, ticks of it in erosion.
    before: Pulses,
    eroding: f64,
}

impl Rows {
    /// Takes a tick: its sample, and how deep the head is, um.
    fn take(&mut self, table: &File, target_mm: f64, head: &Settings, sample: &Sample, depth_um: f64, crater_um: f64) {
        if let Some(number) = self.now.filter(|number| *number != self.number) {
            let row = usize::from(number).checked_sub(1).and_then(|at| table.rows.get(at));
            let name = row.map_or(String::new(), |row| row.name.clone());
            self.all.push(RowOutcome { name, from_s: sample.t_s, ..RowOutcome::default() });
            (self.number, self.before, self.eroding) = (number, sample.pulses, 0.0);
        }
        let (Some(newest), Some(row)) =
            (self.all.last_mut(), usize::from(self.number).checked_sub(1).and_then(|at| table.rows.get(at)))
        else {
            return;
        };
        newest.to_s = sample.t_s;
        (newest.depth_mm, newest.crater_um) = (depth_um * 1e-3, crater_um);
        let ends_um = target_mm * 1e3 - row.leaves_um;
        newest.off_counts = ((depth_um - ends_um) / f64::from(head.encoder_count)).round() as i64;
        let pulses = sample.pulses.since(&self.before);
        let share = |pulses: u64, all: u64| pulses as f64 / all.max(1) as f64;
        newest.spark_ratio = share(pulses.spark, pulses.total());
        newest.arc_ratio = share(pulses.arc, pulses.total());
        if sample.state == State::Eroding.name() {
            self.eroding += 1.0;
            newest.eroding_s += 1.0 / f64::from(TICK_HZ);
            newest.gap_um += (sample.gap_um - newest.gap_um) / self.eroding;
            newest.gap_v += (f64::from(sample.filtered_v) - newest.gap_v) / self.eroding;
        }
    }
}

/// Sums over the eroding ticks.
#[derive(Default)]
struct Means {
    ticks: f64,
    gap_um: f64,
    debris: f64,
}

impl Means {
    fn take(&mut self, gap_um: f64, debris: f64) {
        self.ticks += 1.0;
        self.gap_um += gap_um;
        self.debris += debris;
    }
}

/// Scatter of the filtered gap voltage at a gap held still: what chance, noise and hum alone do, V rms.
fn shot_floor(setup: &Setup, seed: u64, means: &Means) -> Result<f64, String> {
    let refused = |error| setup.refusal(error);
    let active = setup.head.build().map_err(refused)?;
    let mut process = Process::new(setup.process, seed).map_err(refused)?;
    let mut source = Voltage::new(active.gap);
    process.hold_gap(means.gap_um / means.ticks, means.debris / means.ticks);
    let (mut n, mut sum, mut squares) = (0.0, 0.0, 0.0);
    for tick in 0..FLOOR_SETTLE + FLOOR {
        let sensors = process.advance(edm_hal_shim::bridge::Drive::Coast, true);
        let volts = f64::from(source.update(Some(&sensors.block)).filtered.0);
        if tick >= FLOOR_SETTLE {
            (n, sum, squares) = (n + 1.0, sum + volts, squares + volts * volts);
        }
    }
    let mean: f64 = sum / n;
    Ok((squares / n - mean * mean).max(0.0).sqrt())
}
