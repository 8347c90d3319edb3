//! Faults injected: every wire of [`Wires`], alone, and every ordered pair of them.

use crate::events::Wires;
use edm_servo_head::head::Fault;
use edm_servo_head::settings::{Declared, Value};

/// A wire, how it is broken, and the fault that an eroding head must report; `None`: it need not notice.
#[derive(Clone, Copy, Debug)]
pub struct Wire {
    /// Name of the signal.
    pub signal: &'static str,
    /// Its value when broken.
    pub broken: Value<'static>,
    /// Fault that the head must report.
    pub named: Option<Fault>,
}

/// Signal of the hand.
const HAND: &str = "hand.force_n";
/// Signal of the burr.
pub const BURR: &str = "workpiece.raised_mm";
/// Speed with which a burr comes up, mm/s: contact is bounded for what moves no faster. One that came in no time would press a
/// head that touches the work with 40 N, whatever the head did.
pub const BURR_MM_S: f64 = 5.0;

/// How each is broken: flags are set. The bus loses 20 of 48 V. A hand rests on the head with 0.5 N and the work has a burr of
/// 20 um: nothing that a head does bounds what a strong hand presses with through it, or a work that is pushed into it.
pub const WIRES: &[Wire] = &[
    flag("limit.upper_open", Some(Fault::UpperLimit)),
    flag("limit.lower_open", Some(Fault::LowerLimit)),
    flag("stop.open", Some(Fault::EmergencyStop)),
    flag("dielectric.lost", Some(Fault::DielectricNotOk)),
    flag("bridge.fault", Some(Fault::BridgeFault)),
    Wire { signal: "bus.sag_v", broken: Value::Number(20.0), named: Some(Fault::BusSag) },
    flag("encoder.cut", Some(Fault::EncoderLost)),
    flag("gap.saturated", Some(Fault::GapSignalInvalid)),
    flag("gap.short", Some(Fault::PersistentShort)),
    Wire { signal: "gap.arcs_percent", broken: Value::Number(90.0), named: Some(Fault::PersistentArc) },
    flag("generator.off", Some(Fault::GateMissing)),
    Wire { signal: BURR, broken: Value::Number(0.02), named: None },
    Wire { signal: HAND, broken: Value::Number(0.5), named: None },
    flag("sense.off", None),
    flag("gate.cut", Some(Fault::GateMissing)),
    flag("gate.start_cut", Some(Fault::ReflexLost)),
    // Noticed once the head wants no pulses.
    flag("generator.disobeys", None),
    // Only mode -1 follows them.
    Wire { signal: "step.hz", broken: Value::Number(100_000.0), named: None },
];

const fn flag(signal: &'static str, named: Option<Fault>) -> Wire {
    Wire { signal, broken: Value::Flag(true), named }
}

impl Wire {
    /// Its value when sound.
    pub fn sound(&self) -> Value<'static> {
        let at = Wires::FIELDS.iter().position(|field| field.key == self.signal);
        at.and_then(|at| Wires::default().get(at)).unwrap_or(Value::Flag(false))
    }
}

/// One wire, or two in their order.
#[derive(Clone, Copy, Debug)]
pub struct Case {
    /// Broken first.
    pub first: &'static Wire,
    /// Broken after that.
    pub second: Option<&'static Wire>,
}

impl Case {
    /// Every wire alone, then every ordered pair.
    pub fn all() -> Vec<Case> {
        let alone = WIRES.iter().map(|first| Case { first, second: None });
        let pairs = WIRES.iter().flat_map(|first| {
            let others = WIRES.iter().filter(|second| second.signal != first.signal);
            others.map(|second| Case { first, second: Some(second) })
        });
        alone.chain(pairs).collect()
    }

    /// Name in reports.
    pub fn name(&self) -> String {
        match self.second {
            None => self.first.signal.into(),
            Some(second) => format!("{}, then {}", self.first.signal, second.signal),
        }
    }

    /// The wires.
    pub fn wires(&self) -> impl Iterator<Item = &'static Wire> {
        [Some(self.first), self.second].into_iter().flatten()
    }

    /// Whether the head must report a fault.
    pub fn shows(&self) -> bool {
        self.wires().any(|wire| wire.named.is_some())
    }

    /// Faults that the head may report. The wire that it detects first decides about the other.
    pub fn names(&self) -> Vec<Fault> {
        let mut names: Vec<Fault> = self.wires().filter_map(|wire| wire.named).collect();
        if names.contains(&Fault::UpperLimit) && names.contains(&Fault::LowerLimit) {
            names.push(Fault::BothLimits);
        }
        // A hand that takes hold makes the loop push more than friction alone explains, and may hold the head still meanwhile.
        if self.wires().any(|wire| wire.signal == HAND) {
            names.push(Fault::EncoderLost);
        }
        names
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::process::{Plant, Process};

    #[test]
    fn every_wire_is_in_the_campaign_once_and_can_be_broken_and_mended() {
        // A coarse axis is no wire (tests/inching.rs), nor what a host heeds (tests/canopen_device/steps.rs).
        let others = ["coarse.carried_mm", "step.waits"];
        let wires = || Wires::FIELDS.iter().filter(|field| !others.contains(&field.key));
        assert_eq!(WIRES.len(), wires().count());
        let mut process = Process::new(Plant::default(), 1).unwrap();
        for field in wires() {
            let mut of = WIRES.iter().filter(|wire| wire.signal == field.key);
            let (wire, another) = (of.next().unwrap(), of.next());
            assert!(another.is_none(), "{}", field.key);
            assert_ne!(wire.broken, wire.sound(), "{}", field.key);
            for value in [wire.broken, wire.sound()] {
                process.happen(wire.signal, value).unwrap();
            }
        }
    }

    #[test]
    fn every_ordered_pair_is_a_case() {
        let names: std::collections::BTreeSet<String> = Case::all().iter().map(Case::name).collect();
        assert_eq!(names.len(), WIRES.len() * WIRES.len());
        assert!(names.contains("gap.short, then stop.open") && names.contains("stop.open, then gap.short"));
    }
}
