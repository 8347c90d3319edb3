//! One case with one seed: a head that erodes, wires that break, the reaction, and whether the head erodes again after the
//! repair. And a head with settings that may be wrong: the result of its guided check, and, once it has passed, how hard it
//! presses under faults.

use super::wires::{BURR, BURR_MM_S, Case, WIRES, Wire};
use crate::contact::Approach;
use crate::machine::Machine;
use crate::run::Setup;
use edm_servo_head::head::{Command, Fault, MotionLimits, Reaction, Reason, State};
use edm_servo_head::settings::{Settings, Value};
use edm_servo_head::units::{MicrometresPerSecond, MicrometresPerSecond2, Nanometres, TICK_HZ, TICKS_PER_MS};

/// Times between two wires, s: in the same tick, before the supervision has run, before slow reactions have begun, in the
/// middle of the emergency lift (300 ms), and when every reaction rests.
pub const DELAYS_S: [f64; 5] = [0.0, 0.001, 0.02, 0.2, 2.0];
/// Time after which the motor current has to be below the continuous one, s.
const SETTLED_S: f64 = 1.0;
/// Time for which the motor current is averaged, as the winding does for much longer: 10 ms.
const MEAN_TICKS: u32 = 10 * TICKS_PER_MS;
/// Time that a case is watched for after the last wire, s.
const WATCHED_S: f64 = 2.0;
/// Longest time until a fault is named, s: the persistent short takes a second by its setting.
const NAMED_S: f64 = 5.0;
/// Time-out of each step of the recovery, s.
const STEP_S: f64 = 5.0;
/// Time-out of the guided check, s.
const CHECK_S: f64 = 60.0;
/// Time that a head with settings that may be wrong is watched for after its wires broke, s: a lift takes 0.3, a proof less.
const REACTED_S: f64 = 1.2;
/// Eroding before a wire breaks, s.
const ERODED_S: f64 = 0.5;

/// Gap from which a start finds the voltage of an open gap, um.
const CLEAR_UM: f64 = 500.0;
/// How a head is lifted before it starts again.
const LIFT: MotionLimits = MotionLimits {
    velocity: MicrometresPerSecond(5e3),
    acceleration: MicrometresPerSecond2(2e6),
    deceleration: MicrometresPerSecond2(2e6),
};

/// Result of a case at one delay.
#[derive(Clone, Debug, Default)]
pub struct Observed {
    /// From the first wire with a name until the pulses were off, us; `None`: they continued.
    pub time_us: Option<f64>,
    /// Faults in their order.
    pub named: Vec<Fault>,
    /// What ran in the end.
    pub reaction: Option<Reaction>,
    /// Greatest force between electrode and work, N.
    pub contact_n: f64,
    /// The same beyond what the speed of its approach allows, and that speed, N and mm/s.
    pub pressed: Option<(f64, f64)>,
    /// Greatest motor current, a mean of 10 ms, from a second after the last wire on, A.
    pub current_a: f64,
    /// Why it does not work again, if it does not.
    pub stuck: Option<String>,
}

impl Observed {
    /// What fails, in a few words each.
    pub fn broken(&self, case: &Case) -> Vec<String> {
        let names = case.names();
        let mut broken = Vec::new();
        let mut demand = |kept: bool, what: String| {
            if !kept {
                broken.push(what);
            }
        };
        // Who has to notice names one of them at least; who need not names nothing else.
        let known = |fault: &Fault| names.contains(fault);
        let right = if case.shows() { self.named.iter().any(known) } else { self.named.iter().all(known) };
        demand(right, format!("named {:?}", self.named));
        demand(!case.shows() || self.time_us.is_some(), "pulses continued".into());
        let (newtons, mm_s) = self.pressed.unwrap_or_default();
        demand(self.pressed.is_none(), format!("{newtons:.1} N at {mm_s:.1} mm/s"));
        demand(self.current_a < f64::from(Settings::default().motor_continuous), format!("{:.2} A", self.current_a));
        demand(self.stuck.is_none(), self.stuck.clone().unwrap_or_default());
        broken
    }
}

/// State of a head when its wires break.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum At {
    Positioning,
    Seeking,
    Eroding,
    Jumping,
}

/// What is broken in a head with settings that may be wrong: 20 ms after each other, so that the encoder is lost in the
/// reaction to another fault.
const BROKEN: [(At, &[&str]); 8] = [
    (At::Eroding, &["encoder.cut"]),
    (At::Seeking, &["encoder.cut"]),
    (At::Positioning, &["encoder.cut"]),
    (At::Jumping, &["encoder.cut"]),
    (At::Eroding, &["stop.open", "encoder.cut"]),
    (At::Eroding, &["gap.short", "encoder.cut"]),
    (At::Eroding, &["generator.off", "encoder.cut"]),
    (At::Eroding, &["bus.sag_v", "encoder.cut"]),
];

/// Result of settings.
#[derive(Clone, Debug)]
pub enum Became {
    /// They do not fit together, or the guided check has refused them.
    Refused(String),
    /// It has passed: the worst of all that was broken, and what that was.
    Accepted(Observed, String),
}

/// Tries settings: the guided check above no work, what it has learnt, the work put back,
/// and then every fault of [`BROKEN`] in a bore.
///
/// # Errors
/// When a machine cannot be made.
pub fn of_settings(setup: &Setup, settings: &Settings, seed: u64) -> Result<Became, String> {
    let settings = Settings { commissioned: false, ..*settings };
    if let Err(error) = settings.build() {
        return Ok(Became::Refused(error.to_string()));
    }
    let mut trial = Trial::with(setup, &settings, seed)?;
    let learnt = match trial.check(&settings) {
        Ok(learnt) => learnt,
        Err(why) => return Ok(Became::Refused(why)),
    };
    let (mut all, mut worst) = (Observed::default(), String::new());
    for (at, signals) in BROKEN {
        let wires: Vec<&Wire> = WIRES.iter().filter(|wire| signals.contains(&wire.signal)).collect();
        // Settings with which it does not get there are no failure: the wires break where it is.
        let _ = trial.until_at(at);
        for signal in signals {
            for wire in wires.iter().filter(|wire| wire.signal == *signal) {
                trial.breaks(wire, 0.02, 0);
            }
        }
        trial.watch(REACTED_S);
        let recovered = trial.repair(&wires);
        let seen = std::mem::take(&mut trial.seen);
        if seen.contact_n > all.contact_n {
            all.contact_n = seen.contact_n;
            worst = format!("{at:?}, {}", signals.join(", ")).to_lowercase();
        }
        all.named.extend(seen.named.iter().filter(|fault| !all.named.contains(fault)).collect::<Vec<_>>());
        if recovered.is_err() {
            trial = Trial::with(setup, &learnt, seed)?;
        }
    }
    Ok(Became::Accepted(all, worst))
}

/// A head at work.
struct Trial {
    machine: Machine,
    seen: Observed,
    approach: Approach,
    /// Sum of the current of the running 10 ms, and its ticks.
    sum: (f64, u32),
    /// Height of the burr, and the one that it comes up to, mm.
    burr: (f64, f64),
}

/// What came of a case at every delay, one after the other in the same head: it has to recover from each.
pub fn run(setup: &Setup, case: &Case, seed: u64) -> Result<Vec<(f64, Observed)>, String> {
    let delays = if case.second.is_some() { &DELAYS_S[..] } else { &DELAYS_S[..1] };
    let mut trial = None;
    delays
        .iter()
        .map(|&delay_s| {
            let mut head = match trial.take() {
                Some(head) => head,
                None => Trial::new(setup, seed)?,
            };
            head.injected(case, delay_s);
            let seen = std::mem::take(&mut head.seen);
            // One that is stuck is no head to begin the next delay with.
            trial = seen.stuck.is_none().then_some(head);
            Ok((delay_s, seen))
        })
        .collect()
}

impl Trial {
    fn new(setup: &Setup, seed: u64) -> Result<Trial, String> {
        // The virtual head's commissioning counts as passed; a fast seek shortens the campaign.
        let settings = Settings { commissioned: true, seek_velocity: 5000.0, ..setup.head };
        let mut trial = Trial::with(setup, &settings, seed)?;
        trial.start()?;
        trial.seen = Observed::default();
        Ok(trial)
    }

    /// A head at rest at its upper stop.
    fn with(setup: &Setup, settings: &Settings, seed: u64) -> Result<Trial, String> {
        let machine = Machine::new(setup.process, settings, seed).map_err(|error| setup.refusal(error))?;
        let mut trial = Trial {
            machine,
            seen: Observed::default(),
            approach: Approach::default(),
            sum: (0.0, 0),
            burr: (0.0, 0.0),
        };
        trial.watch(0.01);
        Ok(trial)
    }

    /// The guided check above no work; the settings with what it has learnt, or what it has found.
    fn check(&mut self, settings: &Settings) -> Result<Settings, String> {
        // The signal is known, and can have these values.
        let mut raise = |mm| self.machine.process.happen(BURR, Value::Number(mm)).map_err(|_| BURR.to_owned());
        raise(-100.0)?;
        self.command(Command::Commission)?;
        let end = |state| matches!(state, State::Disabled | State::Fault);
        self.until_within(CHECK_S, "ends its check", end)?;
        self.watch(0.01);
        let report = match self.machine.next_check() {
            Some(Ok(report)) => report,
            Some(Err(finding)) => return Err(finding.to_string()),
            None => return Err(format!("check aborted: {:?}", self.machine.status().fault)),
        };
        let learnt = Settings { commissioned: true, ..settings.learnt(&report) };
        let active = learnt.build().map_err(|error| error.to_string())?;
        self.machine.configure(&active).map_err(|refused| refused.to_string())?;
        self.machine.process.happen(BURR, Value::Number(0.0)).map_err(|_| BURR.to_owned())?;
        self.seen = Observed::default();
        Ok(learnt)
    }

    /// From disabled to where wires break.
    fn until_at(&mut self, at: At) -> Result<(), String> {
        self.make_ready()?;
        let surface = self.machine.process.truth().first_surface_um;
        if at == At::Positioning {
            let down = MotionLimits { velocity: MicrometresPerSecond(20e3), ..LIFT };
            self.command(Command::Position(nm(surface - 100.0), down))?;
            self.watch(0.05);
            return Ok(());
        }
        self.command(Command::MoveTo(nm(surface + 1000.0)))?;
        self.command(Command::Start)?;
        if at == At::Seeking {
            self.until("seeks", |state| state == State::Seeking)?;
            self.watch(0.2);
            return Ok(());
        }
        self.until("erodes", |state| state == State::Eroding)?;
        self.watch(0.2);
        if at == At::Jumping {
            self.command(Command::Jump)?;
            self.watch(0.015);
        }
        Ok(())
    }

    /// Repairs the wires, resets the fault, and disables.
    fn repair(&mut self, wires: &[&Wire]) -> Result<(), String> {
        for wire in wires {
            let _ = self.machine.process.happen(wire.signal, wire.sound());
        }
        self.watch(0.05);
        if self.machine.status().fault.is_some() {
            self.command(Command::ResetFault)
        } else {
            self.command(Command::Disable)
        }
    }

    fn injected(&mut self, case: &Case, delay_s: f64) {
        let ahead = if case.first.named.is_some() { 0.0 } else { delay_s };
        let mut last_pulse = self.breaks(case.first, delay_s, 0);
        if let Some(second) = case.second {
            last_pulse = self.breaks(second, 0.0, last_pulse);
        }
        let before = (delay_s * f64::from(TICK_HZ)) as u32;
        let mut after = 0;
        let settled = (SETTLED_S * f64::from(TICK_HZ)) as u32;
        self.sum = (0.0, 0);
        let longest = if case.shows() { NAMED_S } else { WATCHED_S };
        while f64::from(after) < longest * f64::from(TICK_HZ) {
            self.tick();
            after += 1;
            if self.machine.pulses() {
                last_pulse = before + after;
            }
            if after > settled {
                self.current();
            }
            if f64::from(after) >= WATCHED_S * f64::from(TICK_HZ) && self.machine.status().fault.is_some() {
                break;
            }
        }
        if !self.machine.pulses() {
            self.seen.time_us = Some((f64::from(last_pulse + 1) / f64::from(TICK_HZ) - ahead).max(0.0) * 1e6);
        }
        self.seen.reaction = self.machine.status().fault.map(Fault::reaction);
        self.seen.stuck = self.recover(case).err();
    }

    /// A wire breaks, and this time passes: the last tick with pulses.
    fn breaks(&mut self, wire: &Wire, then_s: f64, mut last_pulse: u32) -> u32 {
        match wire.broken {
            Value::Number(mm) if wire.signal == BURR => self.burr.1 = mm,
            // The table of wires was checked.
            broken => drop(self.machine.process.happen(wire.signal, broken)),
        }
        for tick in 1..=(then_s * f64::from(TICK_HZ)) as u32 {
            self.tick();
            if self.machine.pulses() {
                last_pulse = tick;
            }
        }
        last_pulse
    }

    fn tick(&mut self) {
        let (height, to) = &mut self.burr;
        if height < to {
            *height = (*height + BURR_MM_S / f64::from(TICK_HZ)).min(*to);
            let _ = self.machine.process.happen(BURR, Value::Number(*height));
        }
        self.machine.tick();
        let truth = self.machine.process.truth();
        self.approach.tick(&truth);
        self.seen.contact_n = self.seen.contact_n.max(truth.contact_n);
        if truth.contact_n > self.approach.bound() && self.seen.pressed.is_none_or(|(most, _)| truth.contact_n > most) {
            self.seen.pressed = Some((truth.contact_n, self.approach.fastest_mm_s()));
        }
        while let Some(change) = self.machine.next_change() {
            if let Reason::Fault(fault) = change.reason
                && !self.seen.named.contains(&fault)
            {
                self.seen.named.push(fault);
            }
        }
    }

    fn current(&mut self) {
        let (sum, ticks) = &mut self.sum;
        *sum += self.machine.process.truth().current_a;
        *ticks += 1;
        if *ticks == MEAN_TICKS {
            self.seen.current_a = self.seen.current_a.max((*sum / f64::from(MEAN_TICKS)).abs());
            self.sum = (0.0, 0);
        }
    }

    fn watch(&mut self, seconds: f64) {
        for _ in 0..(seconds * f64::from(TICK_HZ)) as u32 {
            self.tick();
        }
    }

    /// Removes the causes, resets the fault, and starts again.
    fn recover(&mut self, case: &Case) -> Result<(), String> {
        self.burr = (0.0, 0.0);
        for wire in case.wires() {
            let _ = self.machine.process.happen(wire.signal, wire.sound());
        }
        self.watch(0.05);
        if self.machine.status().fault.is_none() {
            return self.until("erodes", |state| state == State::Eroding);
        }
        // A lift may just have begun: a host asks again until the reaction has come to its end.
        for _ in 0..(STEP_S / 0.05) as u32 {
            if !self.machine.status().reacting {
                break;
            }
            self.watch(0.05);
        }
        self.command(Command::ResetFault)?;
        self.watch(0.05);
        let begun = self.start();
        // An encoder that was cut while another fault had let the head go has lost counts that nobody missed. The next index mark
        // shows it, which is the fault that it has to be, and a host resets that as well.
        let late = self.machine.status().fault == Some(Fault::EncoderLost)
            && self.seen.reaction != Some(Fault::EncoderLost.reaction())
            && case.wires().any(|wire| wire.signal == "encoder.cut");
        // An arc of the process that has begun again, named as it has to be: whether one burns on is chance, not what the wires left.
        let arc = self.machine.status().fault == Some(Fault::PersistentArc);
        if begun.is_ok() || !(late || arc) {
            return begun;
        }
        let (mut last, attempts) = (begun, if arc { 3 } else { 1 });
        for _ in 0..attempts {
            self.watch(3.0);
            self.command(Command::ResetFault)?;
            self.watch(0.05);
            last = self.start();
            if last.is_ok() {
                break;
            }
        }
        last
    }

    /// From disabled to eroding.
    fn start(&mut self) -> Result<(), String> {
        self.make_ready()?;
        let surface = self.machine.process.truth().first_surface_um;
        for command in [Command::MoveTo(nm(surface + 1000.0)), Command::Start] {
            self.command(command)?;
        }
        self.until("erodes", |state| state == State::Eroding)?;
        self.watch(ERODED_S);
        match self.machine.status().fault {
            None => Ok(()),
            Some(fault) => Err(format!("{} soon after", fault.name())),
        }
    }

    /// From disabled to ready, clear of the work.
    fn make_ready(&mut self) -> Result<(), String> {
        self.command(Command::Enable)?;
        self.until("is ready", |state| state == State::Ready)?;
        // After a lost encoder it has no home. Whoever starts it again sees where it stands, and lifts it off the work: pulses
        // begin with the voltage of an open gap.
        let truth = self.machine.process.truth();
        self.command(Command::SetHome(nm(truth.position_um.max(0.0))))?;
        if truth.gap_um < CLEAR_UM {
            self.command(Command::Position(nm(truth.surface_um - 2.0 * CLEAR_UM), LIFT))?;
            self.until("is lifted", |state| state == State::Ready)?;
        }
        Ok(())
    }

    fn command(&mut self, command: Command) -> Result<(), String> {
        self.machine.command(command).map_err(|refused| format!("{command:?} was refused: {refused}"))
    }

    fn until(&mut self, what: &str, wanted: impl Fn(State) -> bool) -> Result<(), String> {
        self.until_within(STEP_S, what, wanted)
    }

    fn until_within(&mut self, seconds: f64, what: &str, wanted: impl Fn(State) -> bool) -> Result<(), String> {
        for _ in 0..(seconds * f64::from(TICK_HZ)) as u32 {
            if wanted(self.machine.status().state) {
                return Ok(());
            }
            self.tick();
        }
        let status = self.machine.status();
        Err(format!(
            "never {what}: {}, {:?} {:?} {:?}",
            status.state.name(),
            status.fault.map(Fault::name),
            self.machine.process.truth(),
            status
        ))
    }
}

fn nm(um: f64) -> Nanometres {
    Nanometres((um * 1e3) as i64)
}
