//! Events: faults of the machine, and when they happen.
//!
//! A scenario file says `[[event]]` with `at_s`, `signal` and `value`; the signals are declared in [`Wires`], and are listed
//! by `edm-sim settings`. Their defaults are those of a sound machine; an event with the default repairs what another broke.

use edm_hal_shim::safety::SafetyInputs;
use edm_servo_head::declare;
use edm_servo_head::settings::{Change, Declared, Field, Kind, SettingError, Value};
use edm_servo_head::units::TICK_HZ;

declare! {
    /// Wires and contacts of the machine.
    pub struct Wires {
        /// The upper limit switch, or its wire, is open.
        upper_limit: bool = false, (), "limit.upper_open", "", "the head holds";
        /// The lower limit switch, or its wire, is open.
        lower_limit: bool = false, (), "limit.lower_open", "", "the head retracts by 0.5 mm at least";
        /// The emergency stop is open.
        emergency_stop: bool = false, (), "stop.open", "", "the head lifts for 300 ms at most, then coasts";
        /// Level, flow or temperature of the dielectric is not right.
        dielectric: bool = false, (), "dielectric.lost", "", "the head retraces to its safe height";
        /// The H-bridge reports a fault and opens.
        bridge_fault: bool = false, (), "bridge.fault", "", "the head coasts";
        /// Drop of the bus voltage.
        sag: f32 = 0.0, (0.0, 60.0), "bus.sag_v", "V", "the head lifts on stored energy";
        /// Encoder lines A and B are cut.
        encoder: bool = false, (), "encoder.cut", "", "the head lifts without its encoder";
        /// The gap converter is at the end of its range.
        saturated: bool = false, (), "gap.saturated", "", "the head retraces to its safe height";
        /// A wire lies across the gap.
        short: bool = false, (), "gap.short", "", "the head retraces to its safe height when retreating does not help";
        /// Share of pulses that arc, whatever the gap.
        arcs: f32 = 0.0, (0.0, 100.0), "gap.arcs_percent", "%", "above supervise.arc_percent the head retraces to its safe height";
        /// The generator makes no pulses.
        generator: bool = false, (), "generator.off", "", "the gate is missing: the head retraces to its safe height";
        /// The surface of the work is higher by this; -100 removes the work.
        raised: f32 = 0.0, (-100.0, 100.0), "workpiece.raised_mm", "mm", "a head that moves into the work stops on contact";
        /// A coarse axis has carried the head toward the work by this.
        carried: f32 = 0.0, (-1000.0, 1000.0), "coarse.carried_mm", "mm", "the head takes no notice before its host says so (2014h)";
        /// Force of a hand on the head, positive toward the work.
        hand: f32 = 0.0, (-50.0, 50.0), "hand.force_n", "N", "a disabled head moves and counts; a closed loop resists";
        /// Steps at the step and direction inputs, positive toward the work.
        steps: f32 = 0.0, (-500_000.0, 500_000.0), "step.hz", "1/s", "2016h counts them; in mode -1 the axis follows";
        /// The host that sends these steps waits while the line *ready for steps* is low.
        waits: bool = false, (), "step.waits", "", "no step is sent before the head takes it";
        /// The contact sense supply is off.
        sense: bool = false, (), "sense.off", "", "with pulses off nothing moves toward the work";
        /// The wire of the generator's gate is cut; pulses continue.
        gate: bool = false, (), "gate.cut", "", "the head retraces to its safe height";
        /// The branch of the gate wire to the reflex is cut.
        start: bool = false, (), "gate.start_cut", "", "the reflex is lost: the head retraces to its safe height";
        /// The generator pulses without permission of the head.
        disobeys: bool = false, (), "generator.disobeys", "", "pulses without permission: the head retraces to its safe height";
    }
}

/// What is wrong with the cable of the encoder.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cable {
    /// Receiver A keeps the level that it had.
    pub a_cut: bool,
    /// Receiver B keeps the level that it had.
    pub b_cut: bool,
    /// A contact of both opens and closes at random.
    pub loose: bool,
    /// Receiver A changes at random, whatever the line does.
    pub trembles: bool,
}

impl Cable {
    /// Both lines are cut.
    pub const CUT: Cable = Cable { a_cut: true, b_cut: true, loose: false, trembles: false };

    /// Nothing is wrong with it.
    pub(crate) fn is_sound(&self) -> bool {
        *self == Cable::default()
    }
}

/// State of wires and contacts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FaultInputs {
    /// Contacts opened in addition to those that the axis opens. A bridge fault also opens the bridge.
    pub safety: SafetyInputs,
    /// Bus voltage instead of the set one.
    pub bus_v: Option<f64>,
    /// Converter code whatever the gap does.
    pub stuck_code: Option<u16>,
    /// Cable of the encoder.
    pub encoder: Cable,
    /// The generator makes no pulses.
    pub generator_dead: bool,
    /// The wire of the gate signal is broken; pulses continue.
    pub gate_lost: bool,
    /// The reflex does not see the pulses.
    pub start_lost: bool,
    /// The generator does not obey the inhibit line.
    pub disobeys: bool,
    /// A wire across the gap.
    pub short: bool,
    /// The contact sense supply gives nothing.
    pub sense_off: bool,
    /// The workpiece is higher by this, mm.
    pub raised_mm: f64,
    /// A coarse axis has carried the head toward the work by this, mm.
    pub carried_mm: f64,
    /// Force on the head, N.
    pub hand_n: f64,
    /// Steps a second at the step input, positive toward the work.
    pub step_hz: f64,
    /// The host that sends them waits while the head takes none.
    pub step_waits: bool,
    /// Share of the pulses that arc whatever the gap is like.
    pub arcs: f64,
}

/// When an event may happen.
pub const AT: Field = Field {
    key: "at_s",
    unit: "s",
    doc: "Time since the machine was switched on.",
    source: "in steps of a servo tick, 50 us",
    kind: Kind::Number { min: 0.0, max: 100_000.0 },
    change: Change::Live,
    hazard: "",
};

/// Largest code of the converter.
const END_OF_RANGE: u16 = 4095;

/// Something happens to a wire.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Event {
    /// Servo ticks since the machine was switched on.
    tick: u64,
    /// Index in [`Wires::FIELDS`].
    signal: usize,
    value: Value<'static>,
}

/// Why there is no such event.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EventError {
    /// Not a time within the limits of [`AT`].
    Time,
    /// No signal has this name.
    Signal,
    /// Not a value that the signal can have.
    Value(&'static Field),
}

impl Event {
    /// An event `at_s` seconds after the machine was switched on.
    ///
    /// # Errors
    /// Which of the three is not possible.
    pub fn new(at_s: f64, signal: &str, value: Value<'_>) -> Result<Event, EventError> {
        let Kind::Number { min, max } = AT.kind else { return Err(EventError::Time) };
        if !(f64::from(min)..=f64::from(max)).contains(&at_s) {
            return Err(EventError::Time);
        }
        let index = Wires::FIELDS.iter().position(|field| field.key == signal).ok_or(EventError::Signal)?;
        let field = Wires::FIELDS.get(index).ok_or(EventError::Signal)?;
        let mut tried = Wires::default();
        tried.put(index, value).map_err(|_| EventError::Value(field))?;
        let value = tried.get(index).ok_or(EventError::Value(field))?;
        Ok(Event { tick: (at_s * f64::from(TICK_HZ)).round() as u64, signal: index, value })
    }
}

/// The events of a run, and how the wires are.
#[derive(Clone, Debug, Default)]
pub struct Timeline {
    /// Latest first.
    ahead: Vec<Event>,
    wires: Wires,
}

impl Timeline {
    /// Events in any order; of two in the same tick the later of the list holds.
    pub fn new(events: &[Event]) -> Timeline {
        let mut ahead = events.to_vec();
        ahead.sort_by_key(|event| event.tick);
        ahead.reverse();
        Timeline { ahead, wires: Wires::default() }
    }

    /// Adds an event that is due at once.
    pub fn now(&mut self, signal: &str, value: Value<'_>) -> Result<(), EventError> {
        let event = Event::new(0.0, signal, value)?;
        // Nothing is due before it.
        self.ahead.push(event);
        Ok(())
    }

    /// Lets happen what is due at this tick.
    pub fn advance(&mut self, tick: u64, fault_inputs: &mut FaultInputs, bus_v: f64) {
        while let Some(event) = self.ahead.pop_if(|event| event.tick <= tick) {
            let mut wires = self.wires;
            // An event was checked when it was made.
            let _: Result<(), SettingError> = wires.put(event.signal, event.value);
            self.wires.become_these(&wires, fault_inputs, bus_v);
            self.wires = wires;
        }
    }
}

impl Wires {
    /// Changes the wires that differ; the others stay as they are.
    fn become_these(&self, to: &Wires, fault_inputs: &mut FaultInputs, bus_v: f64) {
        let safety = &mut fault_inputs.safety;
        for (was, is, wire) in [
            (self.upper_limit, to.upper_limit, &mut safety.upper_limit),
            (self.lower_limit, to.lower_limit, &mut safety.lower_limit),
            (self.emergency_stop, to.emergency_stop, &mut safety.emergency_stop),
            (self.dielectric, to.dielectric, &mut safety.dielectric),
            (self.bridge_fault, to.bridge_fault, &mut safety.bridge_fault),
            (self.short, to.short, &mut fault_inputs.short),
            (self.generator, to.generator, &mut fault_inputs.generator_dead),
            (self.gate, to.gate, &mut fault_inputs.gate_lost),
            (self.start, to.start, &mut fault_inputs.start_lost),
            (self.disobeys, to.disobeys, &mut fault_inputs.disobeys),
            (self.sense, to.sense, &mut fault_inputs.sense_off),
            (self.waits, to.waits, &mut fault_inputs.step_waits),
        ] {
            if was != is {
                *wire = is;
            }
        }
        if self.encoder != to.encoder {
            fault_inputs.encoder = if to.encoder { Cable::CUT } else { Cable::default() };
        }
        if self.hand != to.hand {
            fault_inputs.hand_n = to.hand.into();
        }
        if self.steps != to.steps {
            fault_inputs.step_hz = to.steps.into();
        }
        if self.arcs != to.arcs {
            fault_inputs.arcs = f64::from(to.arcs) * 0.01;
        }
        if self.carried != to.carried {
            fault_inputs.carried_mm = to.carried.into();
        }
        if self.raised != to.raised {
            fault_inputs.raised_mm = to.raised.into();
        }
        if self.sag != to.sag {
            fault_inputs.bus_v = (to.sag > 0.0).then(|| (bus_v - f64::from(to.sag)).max(0.0));
        }
        if self.saturated != to.saturated {
            fault_inputs.stuck_code = to.saturated.then_some(END_OF_RANGE);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(at_s: f64, signal: &str, value: Value<'_>) -> Event {
        Event::new(at_s, signal, value).unwrap()
    }

    #[test]
    fn an_event_happens_in_its_tick_and_not_before() {
        let mut timeline = Timeline::new(&[
            event(0.2, "limit.upper_open", Value::Flag(false)),
            event(0.1, "limit.upper_open", Value::Flag(true)),
        ]);
        let mut fault_inputs = FaultInputs::default();
        for (tick, open) in [(0, false), (1999, false), (2000, true), (3999, true), (4000, false), (9999, false)] {
            timeline.advance(tick, &mut fault_inputs, 48.0);
            assert_eq!(fault_inputs.safety.upper_limit, open, "{tick}");
        }
    }

    #[test]
    fn every_signal_does_something_and_its_default_mends_it() {
        for field in Wires::FIELDS {
            let (value, default) = match field.kind {
                Kind::Flag => (Value::Flag(true), Value::Flag(false)),
                _ => (Value::Number(20.0), Value::Number(0.0)),
            };
            let mut timeline = Timeline::new(&[event(0.1, field.key, default), event(0.0, field.key, value)]);
            let mut fault_inputs = FaultInputs::default();
            timeline.advance(0, &mut fault_inputs, 48.0);
            assert_ne!(fault_inputs, FaultInputs::default(), "{}", field.key);
            timeline.advance(2000, &mut fault_inputs, 48.0);
            assert_eq!(fault_inputs, FaultInputs::default(), "{}", field.key);
        }
    }

    #[test]
    fn a_sagging_bus_keeps_the_rest_but_never_turns_over() {
        for (sag, left) in [(20.0, 28.0), (60.0, 0.0)] {
            let mut fault_inputs = FaultInputs::default();
            Timeline::new(&[event(0.0, "bus.sag_v", Value::Number(sag))]).advance(0, &mut fault_inputs, 48.0);
            assert_eq!(fault_inputs.bus_v, Some(left));
        }
    }

    #[test]
    fn a_wire_that_somebody_else_has_cut_stays_cut() {
        let mut fault_inputs = FaultInputs { generator_dead: true, ..FaultInputs::default() };
        Timeline::new(&[event(0.0, "gap.short", Value::Flag(true))]).advance(0, &mut fault_inputs, 48.0);
        assert!(fault_inputs.generator_dead && fault_inputs.short);
    }

    #[test]
    fn what_cannot_happen_is_no_event() {
        let no = |at_s, signal, value| Event::new(at_s, signal, value).unwrap_err();
        for at_s in [-0.001, 100_000.1, f64::NAN, f64::INFINITY] {
            assert_eq!(no(at_s, "gap.short", Value::Flag(true)), EventError::Time);
        }
        assert_eq!(no(0.0, "gap.shorts", Value::Flag(true)), EventError::Signal);
        assert!(
            matches!(no(0.0, "gap.short", Value::Number(1.0)), EventError::Value(field) if field.key == "gap.short")
        );
        for volts in [-0.1, 60.1, f64::NAN] {
            assert!(matches!(no(0.0, "bus.sag_v", Value::Number(volts)), EventError::Value(_)), "{volts}");
        }
        for at_s in [0.0, 100_000.0] {
            event(at_s, "bus.sag_v", Value::Number(60.0));
        }
    }
}
