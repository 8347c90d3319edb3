//! A fault to inject, the expected reaction of the head, and its row.

use super::stage::{Observed, Scene, Stage};
use anyhow::{Error, Result};
use edm_servo_head::head::{Fault, Reaction, State};
use edm_sim::faults::row::Row;

/// Something that is done to the head.
pub type Act = Box<dyn Fn(&mut Stage) -> Result<()>>;

/// Time for which a case is watched at least, so that the current a second after the fault is seen.
pub const WATCHED_MS: u32 = 1050;
/// From the repair to the reset of the fault: late reports arrive, and reactions end.
const REPAIRED_MS: u32 = 250;
/// Greatest contact force, N, and motor current a second later, A: docs/robustness.md.
const CONTACT_N: f64 = 5.0;
const CURRENT_A: f64 = 1.0;
/// A hole continues when it removes this share of the undisturbed removal, and its gap stays within, um.
const PROGRESS: f64 = 0.5;
const GAP_UM: (f64, f64) = (3.0, 150.0);
/// A motion continues when it ends this near its target, counts.
const NEAR: i64 = 3;

/// What the head has to do.
pub enum Expect {
    /// It reports one of these, and its pulses, if they were on, are off within this time in us.
    Named(&'static [&'static str], f64),
    /// It reports nothing and continues its work; and if this happens as well, it is reported and the pulses are off in time: the
    /// function of the broken part is still fulfilled. Without names it is enough that the pulses are off.
    Harmless(Option<(Act, &'static [&'static str], f64)>),
    /// It reports nothing and continues its work, or one of these: it depends on where the axis is when the line changes.
    Doubted(&'static [&'static str]),
    /// It reports nothing, its pulses are off within this time in us, and it stays in one of these states: an order that hosts may
    /// give.
    Obeyed(&'static [State], f64),
}

/// What removes the cause.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Repair {
    /// The repair is outside the chip.
    Outside,
    /// A power cycle.
    Power,
}

/// A fault.
pub struct Case {
    /// Its name; the scene's follows.
    pub name: String,
    /// Where the head is.
    pub scene: Scene,
    /// What breaks.
    pub inject: Act,
    /// What happens every millisecond.
    pub meanwhile: Option<Act>,
    /// What is expected.
    pub expect: Expect,
    /// What removes it.
    pub repair: Repair,
    /// How long it is watched, ms.
    pub watched_ms: u32,
    /// It belongs to the short form.
    pub short: bool,
}

/// The undisturbed run.
#[derive(Clone, Copy, Debug)]
pub struct Undisturbed {
    /// Depth that is removed while a case is watched, um.
    pub removed_um: f64,
}

impl Case {
    /// A case that is repaired outside.
    pub fn new(
        name: impl Into<String>,
        scene: Scene,
        expect: Expect,
        inject: impl Fn(&mut Stage) -> Result<()> + 'static,
    ) -> Self {
        Self {
            name: name.into(),
            scene,
            inject: Box::new(inject),
            meanwhile: None,
            expect,
            repair: Repair::Outside,
            watched_ms: WATCHED_MS,
            short: false,
        }
    }

    /// Repaired by a power cycle alone.
    pub fn powered(mut self) -> Self {
        self.repair = Repair::Power;
        self
    }

    /// Also in the short form.
    pub fn short(mut self) -> Self {
        self.short = true;
        self
    }

    /// Watched for longer.
    pub fn watched(mut self, ms: u32) -> Self {
        self.watched_ms = ms;
        self
    }

    /// With something every millisecond.
    pub fn meanwhile(mut self, act: impl Fn(&mut Stage) -> Result<()> + 'static) -> Self {
        self.meanwhile = Some(Box::new(act));
        self
    }

    /// Name of the row.
    pub fn title(&self) -> String {
        format!("{}{}", self.name, self.scene.suffix())
    }

    /// Injects it and watches; `why` lists what was not as expected.
    ///
    /// # Errors
    /// What the machine refuses: nothing can be said then.
    pub fn run(&self, stage: &mut Stage, undisturbed: &Undisturbed) -> Result<(Row, Vec<String>)> {
        stage.go(self.scene)?;
        let mut why = Vec::new();
        let began = self.watch(stage)?;
        let continues = match self.continues(stage, began, undisturbed) {
            Ok(()) => true,
            Err(reason) => {
                if matches!(self.expect, Expect::Harmless(_) | Expect::Doubted(_)) {
                    why.push(reason);
                }
                false
            }
        };
        let (seen, off_us) = (stage.seen().clone(), stage.off_us());
        let state = stage.state().ok();
        let recovers = self.recover(stage, &seen)?;
        let said = stage.said().to_vec();
        let contact_n = stage.seen().contact_n;

        let named = |names: &[&str]| said.iter().any(|said| names.contains(&said.as_str()));
        let mut demand = |kept: bool, what: String| {
            if !kept {
                why.push(what);
            }
        };
        match &self.expect {
            Expect::Named(names, us) => {
                demand(named(names), format!("one of {names:?} was expected"));
                demand(off_us.is_none_or(|off| off <= *us), format!("pulses off within {us} us were expected"));
                let pulses = self.scene == Scene::Eroding && off_us.is_none();
                demand(!pulses || us.is_infinite(), "the pulses continue".into());
            }
            Expect::Harmless(_) => demand(said.is_empty(), "no report was expected".into()),
            Expect::Doubted(names) => {
                demand(said.is_empty() || named(names), format!("one of {names:?} was expected, or nothing"));
            }
            Expect::Obeyed(wanted, us) => {
                demand(said.is_empty(), "no report was expected".into());
                demand(state.is_some_and(|state| wanted.contains(&state)), format!("one of {wanted:?} was expected"));
                let off =
                    if self.scene == Scene::Eroding { off_us.is_some_and(|off| off <= *us) } else { off_us.is_none() };
                demand(off, format!("pulses off within {us} us were expected"));
            }
        }
        demand(contact_n <= CONTACT_N, format!("contact above {CONTACT_N} N"));
        demand(seen.current_a <= CURRENT_A, format!("current above {CURRENT_A} A"));
        demand(recovers, "does not recover".into());
        if let (Expect::Harmless(Some((act, names, us))), true) = (&self.expect, why.is_empty()) {
            why.extend(self.still_done(stage, act, names, *us)?);
        }
        let row = Row {
            fault: self.title(),
            reaction: reaction(&said, state, &seen, continues),
            time_us: off_us,
            reported: (!said.is_empty()).then(|| said.join(", ")),
            contact_n,
            current_a: seen.current_a,
            recovers,
            pass: why.is_empty(),
        };
        Ok((row, why))
    }

    /// The row of a fault after which the model cannot follow the chip: most likely a runaway program.
    pub fn lost(&self, stage: &Stage, error: &Error) -> (Row, Vec<String>) {
        let row = Row {
            fault: self.title(),
            reaction: "runaway program".into(),
            time_us: stage.off_us(),
            reported: None,
            contact_n: stage.seen().contact_n,
            current_a: stage.seen().current_a,
            recovers: false,
            pass: false,
        };
        (row, vec![format!("{error:#}")])
    }

    /// Injects it and lets the time pass in which it is watched; how deep the hole was before.
    fn watch(&self, stage: &mut Stage) -> Result<f64> {
        let surface = stage.truth().surface_um;
        (self.inject)(stage)?;
        stage.rig.machine_mut().soc().world_changed();
        for _ in 0..self.watched_ms {
            if let Some(act) = &self.meanwhile {
                act(stage)?;
            }
            stage.rest(1)?;
        }
        Ok(surface)
    }

    /// Whether the work continues as if nothing were broken.
    fn continues(&self, stage: &mut Stage, surface_um: f64, undisturbed: &Undisturbed) -> Result<(), String> {
        // A head that cannot answer may still work.
        let state = stage.state().ok();
        let truth = stage.truth();
        let (low, high) = stage.seen().gap_um;
        match self.scene {
            Scene::Eroding => {
                let removed = truth.surface_um - surface_um;
                let least = PROGRESS * undisturbed.removed_um * f64::from(self.watched_ms) / f64::from(WATCHED_MS);
                if let Some(state) = state
                    && !matches!(state, State::Eroding | State::Retreating)
                {
                    Err(format!("{} instead of eroding", state.name()))
                } else if removed < least {
                    Err(format!("{removed:.2} um removed, {least:.2} at least were expected"))
                } else if low < GAP_UM.0 || high > GAP_UM.1 {
                    Err(format!("gap from {low:.1} to {high:.1} um"))
                } else {
                    Ok(())
                }
            }
            Scene::Positioning => {
                let off = truth.count - i64::from(super::stage::TARGET);
                if off.abs() <= NEAR { Ok(()) } else { Err(format!("{off} counts from the target")) }
            }
            Scene::Disabled if state == Some(State::Disabled) => Ok(()),
            Scene::Disabled => Err("not disabled".into()),
        }
    }

    /// Assigns a node-ID to a head that has lost its settings, as a host does: without one it sends nothing.
    fn name(&self, stage: &mut Stage) -> Result<()> {
        if stage.boots == 0 && crate::host::name(stage)? {
            stage.say("unconfigured");
            for _ in 0..4 {
                if stage.boots == 0 {
                    stage.rest(REPAIRED_MS)?;
                }
            }
        }
        Ok(())
    }

    /// Removes the cause; whether the head works again. Its reports until its fault is reset belong to the row.
    fn recover(&self, stage: &mut Stage, seen: &Observed) -> Result<bool> {
        if seen.resets > 0 {
            self.name(stage)?;
        }
        stage.repair();
        stage.rest(REPAIRED_MS)?;
        self.ask(stage, seen);
        if self.repair == Repair::Power {
            stage.power();
            stage.rest(REPAIRED_MS)?;
        }
        let said = stage.said().len();
        let restarted = self.repair == Repair::Power || seen.resets > 0;
        let recovers = stage.recovers(restarted)?;
        // What the trial of an encoder in doubt says is not about the fault.
        stage.said_until(said);
        Ok(recovers)
    }

    /// Reads from objects what no emergency reports.
    fn ask(&self, stage: &mut Stage, seen: &Observed) {
        let said_by_emergency = |stage: &Stage, fault: &Fault| stage.said().iter().any(|said| said == fault.name());
        if let Ok(number) = crate::host::read(stage, 0x2000, 2)
            && let Some(fault) = Fault::ALL.iter().find(|fault| **fault as u32 + 1 == number)
            && !said_by_emergency(stage, fault)
        {
            stage.say(&format!("2000h:2 {}", fault.name()));
        }
        for (sub, name) in [(5, "200Dh:5 high comparator"), (6, "200Dh:6 low comparator")] {
            if let Ok(1..) = crate::host::read(stage, 0x200D, sub) {
                stage.say(name);
            }
        }
        if seen.resets == 0 && stage.boots > 0 {
            stage.say("boot-up");
        }
        if seen.resets > 0
            && let Ok(cause) = crate::host::read(stage, 0x2009, 1)
        {
            // Power goes where a row says so.
            match cause {
                2 => stage.say("2009h:1 reset by the program"),
                3 => stage.say("2009h:1 watchdog"),
                _ => {}
            }
            if let Ok(0) = crate::host::read(stage, 0x200B, 1) {
                stage.say("200Bh:1 nothing stored");
            }
        }
        for line in stage.rig.logged() {
            if stage.log {
                println!("  {line}");
            }
            for fault in Fault::ALL {
                let silent = stage.said().iter().all(|said| !said.ends_with(fault.name()));
                if silent && line.contains("Changed(") && line.contains(&format!("reason: Fault({fault:?})")) {
                    stage.say(&format!("log: {}", fault.name()));
                }
            }
            for (text, name) in DEATHS {
                if line.contains(text) {
                    stage.say(name);
                }
            }
        }
    }

    /// Whether the function of the broken part is still fulfilled: why not.
    fn still_done(&self, stage: &mut Stage, act: &Act, names: &[&str], us: f64) -> Result<Vec<String>> {
        stage.go(self.scene)?;
        (self.inject)(stage)?;
        stage.rig.machine_mut().soc().world_changed();
        stage.rest(50)?;
        stage.mark();
        act(stage)?;
        stage.rig.machine_mut().soc().world_changed();
        stage.rest(600)?;
        let mut why = Vec::new();
        if !names.is_empty() && !stage.said().iter().any(|said| names.contains(&said.as_str())) {
            why.push(format!("with a second fault {names:?} was expected, not {:?}", stage.said()));
        }
        if stage.off_us().is_none_or(|off| off > us) {
            why.push(format!("with a second fault the pulses were off after {:?} us", stage.off_us()));
        }
        Ok(why)
    }
}

/// Before what the guided check has found.
pub const CHECK: &str = "2001h:4 ";

/// Words of the log in which a program reports how the previous one ended, or why it does not start.
const DEATHS: [(&str, &str); 5] = [
    ("death: Panic", "log: panic"),
    ("death: HardFault", "log: hard fault"),
    ("death: Unexpected", "log: unexpected interrupt"),
    ("death: Silent", "log: task silent"),
    ("start: Crystal", "log: no crystal"),
];

/// What the head did, in words.
fn reaction(said: &[String], state: Option<State>, seen: &Observed, continues: bool) -> String {
    let faults = || Fault::ALL.iter().filter(|fault| said.iter().any(|said| said == fault.name()));
    if seen.resets > 0 {
        return "coast, reset".into();
    }
    if let Some(reaction) = faults().map(|fault| fault.reaction()).max() {
        return match reaction {
            Reaction::Retrace => "retrace",
            Reaction::RetractOffLimit => "retract",
            Reaction::HoldBelow | Reaction::Hold => "hold",
            Reaction::ForceLimitedRetract => "force-limited retract",
            Reaction::OpenLoopLift => "open-loop lift",
            Reaction::LiftOnStored => "lift on stored energy",
            Reaction::EmergencyLift => "emergency lift",
            Reaction::Coast => "coast",
        }
        .into();
    }
    match state {
        _ if said.iter().any(|said| said.starts_with(CHECK)) => "refused".into(),
        _ if continues => "continues".into(),
        Some(state) => state.name().replace('_', " "),
        None => "silent".into(),
    }
}
