//! A case on a virtual head, and what must hold in every tick of it.

use super::case::{Action, Case};
use super::script::ID;
use crate::contact::Approach;
use crate::process::Truth;
use crate::run::Setup;
use crate::serve::head::Head;
use crate::store::Store;
use edm_bus::Frame;
use edm_hal_shim::bridge::Drive;
use edm_servo_head::canopen::NodeId;
use edm_servo_head::head::State;
use edm_servo_head::settings::{Settings, Value};
use edm_servo_head::units::{TICK_HZ, TICKS_PER_MS};
use embedded_can::{Frame as _, StandardId};

/// Ticks that outputs may follow the state that a host sees: a plan comes into force two ticks after its estimate.
const LAG: u32 = 3;
/// Time that the motor may draw more than its peak, ticks: as long as the supervision waits, and a millisecond for its look.
const OVER_PEAK: u32 = 6 * TICKS_PER_MS;
/// Time after which a head in a fault draws less than the continuous current, ticks.
const SETTLED: u32 = TICK_HZ;
/// Gap left when a workpiece is placed, um.
const LEFT_UM: f64 = 100.0;

/// An invariant that was broken.
#[derive(Clone, Debug, PartialEq)]
pub struct Broken {
    /// Steps that were done before.
    pub steps: usize,
    /// Which one: the same for all cases that break it.
    pub what: &'static str,
    /// The figures.
    pub how: String,
}

/// What a life has seen: a soak in which nothing happens shows nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Observed {
    /// Ticks.
    pub ticks: u64,
    /// Ticks in which the head eroded, positioned or homed.
    pub worked: u64,
    /// Faults.
    pub faults: u64,
    /// Contacts.
    pub contacts: u64,
    /// Greatest contact force, N.
    pub contact_n: f64,
}

/// What is watched from tick to tick.
#[derive(Default)]
struct Watch {
    state: State,
    /// Ticks in this state.
    held: u32,
    /// Ticks with more current than the peak.
    over_peak: u32,
    /// Mean square of the current, A^2.
    heat: f64,
    /// Sum of the current of the last ticks, A, and how many.
    drawn: (f64, u32),
    approach: Approach,
    touching: bool,
}

/// Plays a case: what was seen, and the first invariant that was broken, if one was. Changes of state and contacts are reported
/// as they come.
///
/// # Errors
/// When a head cannot be made of the scenario.
pub fn play(setup: &Setup, case: &Case, tell: &mut dyn FnMut(&str)) -> Result<(Observed, Option<Broken>), String> {
    let id = (NodeId::new(ID), ID.into());
    let mut head = Head::new(setup, id, case.seed, Store::memory(None))?;
    let (mut seen, mut watch, mut sent) = (Observed::default(), Watch::default(), Vec::new());
    for (steps, step) in case.steps.iter().enumerate() {
        // A frame is taken by the tick that follows it.
        for _ in 0..step.after {
            head.tick([].iter(), &mut sent);
            sent.clear();
            let before = (watch.state, watch.touching);
            let outputs = (head.pulses(), head.drive());
            let found = watch.tick(head.status().state, &head.process.truth(), outputs, &setup.head, &mut seen);
            if before != (watch.state, watch.touching) {
                tell(&reported(steps, &head));
            }
            if let Some((what, how)) = found {
                return Ok((seen, Some(Broken { steps, what, how })));
            }
        }
        match &step.action {
            Action::Frame(frame_id, data) => arrives(&mut head, *frame_id, data),
            Action::Enabled(frame_id, data) if head.status().state.follows() => arrives(&mut head, *frame_id, data),
            Action::Enabled(..) => {}
            Action::Wire(signal, value) => happens(&mut head, signal, *value),
        }
    }
    Ok((seen, None))
}

fn reported(steps: usize, head: &Head) -> String {
    let (status, truth) = (head.status(), head.process.truth());
    format!(
        "{:9.4} s, {steps} steps: {}{}; at {:.1} um, {:.1} mm/s, gap {:.1} um, {:.1} N",
        truth.t_s,
        status.state.name(),
        status.fault.map_or_else(String::new, |fault| format!(" ({})", fault.name())),
        truth.position_um,
        truth.velocity_um_s * 1e-3,
        truth.gap_um,
        truth.contact_n
    )
}

fn arrives(head: &mut Head, id: u16, data: &[u8]) {
    // A case has only frames that can be.
    if let Some(frame) = StandardId::new(id).and_then(|id| Frame::new(id, data)) {
        head.receive(&frame);
    }
}

/// The work is never pushed into the electrode: no loop holds against that.
fn happens(head: &mut Head, signal: &str, value: Value<'static>) {
    if let ("workpiece.raised_mm", Value::Number(raised)) = (signal, value) {
        let by = raised - head.process.fault_inputs.raised_mm;
        if head.process.truth().gap_um - by * 1e3 < LEFT_UM {
            return;
        }
    }
    // A case has only events that can be.
    let _ = head.process.happen(signal, value);
}

impl Watch {
    /// Checks a tick: the state that a host sees, the truth, and whether the outputs allow pulses and drive.
    fn tick(
        &mut self,
        state: State,
        truth: &Truth,
        (pulses, drive): (bool, Drive),
        settings: &Settings,
        seen: &mut Observed,
    ) -> Option<(&'static str, String)> {
        seen.ticks += 1;
        seen.worked += u64::from(matches!(state, State::Eroding | State::Positioning | State::Homing));
        if state != self.state {
            (self.state, self.held, self.drawn) = (state, 0, (0.0, 0));
            seen.faults += u64::from(state == State::Fault);
        }
        self.held = self.held.saturating_add(1);
        let name = state.name();
        let lasts = self.held > LAG;

        if lasts && pulses && !state.pulses() {
            return Some(("pulses in a state without pulses", name.into()));
        }
        if lasts && state == State::Disabled && drive != Drive::Coast {
            return Some(("motion commanded while disabled", format!("{drive:?}")));
        }
        let limit = f64::from(settings.axis_duty_limit) * f64::from(Drive::FULL) + 1.0;
        if let Drive::Duty(duty) = drive
            && f64::from(duty).abs() > limit
        {
            return Some(("duty beyond its limit", format!("{duty} in {name}")));
        }
        self.current(truth, settings).or_else(|| self.contact(truth, name, seen))
    }

    fn current(&mut self, truth: &Truth, settings: &Settings) -> Option<(&'static str, String)> {
        let amps = truth.current_a.abs();
        let over = amps > f64::from(settings.motor_peak) * 1.05;
        self.over_peak = if over { self.over_peak + 1 } else { 0 };
        if self.over_peak > OVER_PEAK {
            return Some(("current beyond its peak", format!("{amps:.2} A")));
        }
        let continuous = f64::from(settings.motor_continuous);
        let share = 1.0 / (f64::from(settings.motor_thermal) * f64::from(TICK_HZ));
        self.heat += (amps * amps - self.heat) * share;
        if self.heat > continuous * continuous * 1.1 {
            return Some(("winding too hot", format!("{:.2} A for {} s", self.heat.sqrt(), settings.motor_thermal)));
        }
        if self.state == State::Fault && self.held > SETTLED {
            self.drawn = (self.drawn.0 + truth.current_a, self.drawn.1 + 1);
            if self.drawn.1 == 10 * TICKS_PER_MS {
                let mean = self.drawn.0.abs() / f64::from(self.drawn.1);
                self.drawn = (0.0, 0);
                if mean >= continuous {
                    return Some(("current not below continuous a second after a fault", format!("{mean:.2} A")));
                }
            }
        }
        None
    }

    fn contact(&mut self, truth: &Truth, name: &str, seen: &mut Observed) -> Option<(&'static str, String)> {
        self.approach.tick(truth);
        let touching = truth.contact_n > 0.0;
        seen.contacts += u64::from(touching && !self.touching);
        self.touching = touching;
        seen.contact_n = seen.contact_n.max(truth.contact_n);
        (truth.contact_n > self.approach.bound()).then(|| {
            let mm_s = self.approach.fastest_mm_s();
            ("contact beyond its bound", format!("{:.1} N in {name}, approached at {mm_s:.1} mm/s", truth.contact_n))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is broken when a head is like this for so many ticks.
    fn after(ticks: u32, state: State, truth: &Truth, outputs: (bool, Drive)) -> Option<&'static str> {
        let (mut watch, mut seen, settings) = (Watch::default(), Observed::default(), Settings::default());
        (0..ticks).find_map(|_| watch.tick(state, truth, outputs, &settings, &mut seen)).map(|(what, _)| what)
    }

    fn amps(current_a: f64) -> Truth {
        Truth { current_a, gap_um: 100.0, ..Truth::default() }
    }

    #[test]
    fn every_invariant_can_be_broken_and_is_kept_up_to_its_bound() {
        const OFF: (bool, Drive) = (false, Drive::Coast);
        const SECOND: u32 = TICK_HZ;
        let still = amps(0.0);
        for (ticks, state, truth, outputs, broken) in [
            (LAG, State::Fault, still, (true, Drive::Coast), None),
            (LAG + 1, State::Fault, still, (true, Drive::Coast), Some("pulses in a state without pulses")),
            (SECOND, State::Eroding, still, (true, Drive::Duty(0)), None),
            (LAG + 1, State::Disabled, still, (false, Drive::Duty(1)), Some("motion commanded while disabled")),
            (LAG + 1, State::Disabled, still, (false, Drive::Brake), Some("motion commanded while disabled")),
            (1, State::Ready, still, (false, Drive::Duty(9000)), None),
            (1, State::Ready, still, (false, Drive::Duty(-9002)), Some("duty beyond its limit")),
            (OVER_PEAK, State::Ready, amps(-3.5), OFF, None),
            (OVER_PEAK + 1, State::Ready, amps(-3.5), OFF, Some("current beyond its peak")),
            (2 * SECOND, State::Ready, amps(3.0), OFF, None),
            (4 * SECOND, State::Ready, amps(3.0), OFF, Some("winding too hot")),
            (2 * SECOND, State::Fault, amps(0.9), OFF, None),
            (2 * SECOND, State::Fault, amps(1.1), OFF, Some("current not below continuous a second after a fault")),
        ] {
            assert_eq!(after(ticks, state, &truth, outputs), broken, "{ticks} ticks {state:?}, {outputs:?}");
        }
    }

    #[test]
    fn a_contact_is_bounded_by_how_fast_the_head_came() {
        for (mm_s, newtons, broken) in [(5.0, 4.9, false), (5.0, 5.1, true), (20.0, 14.9, false), (20.0, 15.1, true)] {
            let (mut watch, mut seen, settings) = (Watch::default(), Observed::default(), Settings::default());
            let coming = Truth { gap_um: 1.0, velocity_um_s: mm_s * 1e3, ..Truth::default() };
            let there = Truth { gap_um: -newtons / 2.0, contact_n: newtons, ..Truth::default() };
            let off = (false, Drive::Coast);
            assert_eq!(watch.tick(State::Ready, &coming, off, &settings, &mut seen), None);
            let found = watch.tick(State::Ready, &there, off, &settings, &mut seen);
            assert_eq!(found.is_some(), broken, "{newtons} N at {mm_s} mm/s: {found:?}");
            assert_eq!((seen.contacts, seen.contact_n), (1, newtons));
        }
    }
}
