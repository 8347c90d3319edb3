//! The H-bridge on mocked pins and PWM: exact transactions for every transition, and what every failure leaves behind.

use core::cell::RefCell;
use edm_hal_shim::bridge::{BridgeFault, Drive, HBridge, PwmBridge};
use embedded_hal::digital::{OutputPin, PinState};
use embedded_hal::pwm::SetDutyCycle;
use embedded_hal_mock::eh1::MockError;
use embedded_hal_mock::eh1::digital::{Mock as Pin, State, Transaction as Set};
use embedded_hal_mock::eh1::pwm::{Mock as Pwm, Transaction as Tx};
use proptest::prelude::*;
use std::io::ErrorKind;
use std::rc::Rc;

const MAX: u16 = 4200;

fn low() -> Set {
    Set::set(State::Low)
}
fn high() -> Set {
    Set::set(State::High)
}
fn off() -> Tx {
    Tx::set_duty_cycle(0)
}
fn broken() -> MockError {
    MockError::Io(ErrorKind::BrokenPipe)
}
fn duty(d: u16) -> [Tx; 2] {
    [Tx::max_duty_cycle(MAX), Tx::set_duty_cycle(d)]
}

struct Rig {
    bridge: PwmBridge<Pwm, Pin, Pin>,
    pwm: Pwm,
    forward: Pin,
    reverse: Pin,
}

impl Rig {
    /// A coasting bridge.
    fn new() -> Self {
        let (pwm, forward, reverse) = (Pwm::new(&[off()]), Pin::new(&[low()]), Pin::new(&[low()]));
        let bridge = PwmBridge::new(pwm.clone(), forward.clone(), reverse.clone()).unwrap();
        Rig { bridge, pwm, forward, reverse }
    }

    /// Applies `drive` and demands exactly these transactions.
    fn expect(&mut self, drive: Drive, result: Result<(), BridgeFault>, pwm: &[Tx], forward: &[Set], reverse: &[Set]) {
        self.done();
        self.pwm.update_expectations(pwm);
        self.forward.update_expectations(forward);
        self.reverse.update_expectations(reverse);
        assert_eq!(self.bridge.apply(drive), result, "{drive:?}");
    }

    fn done(&mut self) {
        self.pwm.done();
        self.forward.done();
        self.reverse.done();
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            self.done();
        }
    }
}

fn join(a: &[Tx], b: &[Tx]) -> Vec<Tx> {
    [a, b].concat()
}

#[test]
fn a_new_bridge_coasts() {
    Rig::new();
}

#[test]
fn driving_sets_the_direction_once_and_then_only_the_duty() {
    let mut rig = Rig::new();
    rig.expect(Drive::Duty(5000), Ok(()), &join(&[off()], &duty(2100)), &[high()], &[low()]);
    rig.expect(Drive::Duty(10_000), Ok(()), &duty(4200), &[], &[]);
    rig.expect(Drive::Duty(1), Ok(()), &duty(0), &[], &[]);
    rig.expect(Drive::Duty(2), Ok(()), &duty(1), &[], &[]);
}

#[test]
fn reversal_goes_through_off() {
    let mut rig = Rig::new();
    rig.expect(Drive::Duty(2500), Ok(()), &join(&[off()], &duty(1050)), &[high()], &[low()]);
    rig.expect(Drive::Duty(-2500), Ok(()), &join(&[off()], &duty(1050)), &[low()], &[high()]);
    rig.expect(Drive::Duty(2500), Ok(()), &join(&[off()], &duty(1050)), &[high()], &[low()]);
}

#[test]
fn zero_duty_keeps_the_direction() {
    let mut rig = Rig::new();
    rig.expect(Drive::Duty(-1000), Ok(()), &join(&[off()], &duty(420)), &[low()], &[high()]);
    rig.expect(Drive::Duty(0), Ok(()), &[off()], &[], &[]);
    rig.expect(Drive::Duty(-1000), Ok(()), &duty(420), &[], &[]);
    rig.expect(Drive::Duty(0), Ok(()), &[off()], &[], &[]);
    rig.expect(Drive::Duty(1000), Ok(()), &join(&[off()], &duty(420)), &[high()], &[low()]);
}

#[test]
fn brake_is_both_inputs_high_under_full_pwm() {
    let mut rig = Rig::new();
    rig.expect(Drive::Brake, Ok(()), &join(&[off()], &duty(MAX)), &[high()], &[high()]);
    rig.expect(Drive::Brake, Ok(()), &duty(MAX), &[], &[]);
    rig.expect(Drive::Duty(-10_000), Ok(()), &join(&[off()], &duty(MAX)), &[low()], &[high()]);
    rig.expect(Drive::Brake, Ok(()), &join(&[off()], &duty(MAX)), &[high()], &[high()]);
    rig.expect(Drive::Duty(0), Ok(()), &[off()], &[low()], &[low()]);
}

#[test]
fn coast_is_written_out_every_time() {
    let mut rig = Rig::new();
    rig.expect(Drive::Coast, Ok(()), &[off()], &[low()], &[low()]);
    rig.expect(Drive::Duty(10_000), Ok(()), &join(&[off()], &duty(MAX)), &[high()], &[low()]);
    rig.expect(Drive::Coast, Ok(()), &[off()], &[low()], &[low()]);
    rig.expect(Drive::Duty(0), Ok(()), &[off()], &[low()], &[low()]);
}

#[test]
fn duty_beyond_full_is_full() {
    let mut rig = Rig::new();
    rig.expect(Drive::Duty(i16::MAX), Ok(()), &join(&[off()], &duty(MAX)), &[high()], &[low()]);
    rig.expect(Drive::Duty(i16::MIN), Ok(()), &join(&[off()], &duty(MAX)), &[low()], &[high()]);
}

#[test]
fn a_dead_forward_pin_leaves_the_others_low() {
    let mut rig = Rig::new();
    let dead = [high().with_error(broken()), low().with_error(broken())];
    rig.expect(Drive::Duty(500), Err(BridgeFault::Forward), &[off(), off()], &dead, &[low(), low()]);
    // The fault has gone: the whole sequence runs again.
    rig.expect(Drive::Duty(500), Ok(()), &join(&[off()], &duty(210)), &[high()], &[low()]);
}

#[test]
fn a_dead_reverse_pin_never_lets_forward_rise() {
    let mut rig = Rig::new();
    let dead = [low().with_error(broken()), low().with_error(broken())];
    rig.expect(Drive::Duty(500), Err(BridgeFault::Reverse), &[off(), off()], &[low()], &dead);
    let dead = [high().with_error(broken()), low().with_error(broken())];
    rig.expect(Drive::Duty(-500), Err(BridgeFault::Reverse), &[off(), off()], &[low(), low()], &dead);
}

#[test]
fn a_pwm_that_does_not_switch_off_blocks_the_direction_change() {
    let mut rig = Rig::new();
    rig.expect(Drive::Duty(500), Ok(()), &join(&[off()], &duty(210)), &[high()], &[low()]);
    let dead = [off().with_error(broken()), off().with_error(broken())];
    rig.expect(Drive::Duty(-500), Err(BridgeFault::Pwm), &dead, &[low()], &[low()]);
}

#[test]
fn a_pwm_that_refuses_a_duty_is_switched_off() {
    let mut rig = Rig::new();
    let refused = [off(), Tx::max_duty_cycle(MAX), Tx::set_duty_cycle(210).with_error(broken()), off()];
    rig.expect(Drive::Duty(500), Err(BridgeFault::Pwm), &refused, &[high(), low()], &[low(), low()]);
    let refused = [off(), Tx::max_duty_cycle(MAX), Tx::set_duty_cycle(MAX).with_error(broken()), off()];
    rig.expect(Drive::Brake, Err(BridgeFault::Pwm), &refused, &[high(), low()], &[high(), low()]);
}

#[test]
fn failures_while_coasting_name_the_output() {
    for fault in [BridgeFault::Pwm, BridgeFault::Forward, BridgeFault::Reverse] {
        let dead = |output| if fault == output { Some(broken()) } else { None };
        let pin = |output| dead(output).map_or(low(), |e| low().with_error(e));
        let pwm = dead(BridgeFault::Pwm).map_or(off(), |e| off().with_error(e));
        // Outputs after the failing one are written once, by the clean-up; those before it twice.
        let count = |output: BridgeFault| if (output as u8) <= fault as u8 { 2 } else { 1 };
        let mut rig = Rig::new();
        rig.expect(
            Drive::Coast,
            Err(fault),
            &[pwm.clone(), pwm],
            &vec![pin(BridgeFault::Forward); count(BridgeFault::Forward)],
            &vec![pin(BridgeFault::Reverse); count(BridgeFault::Reverse)],
        );
        assert!(fault.to_string().contains("could not be set"));
    }
}

/// The three outputs of one bridge, watched together: each write is checked against the state of the others.
#[derive(Default)]
struct Outputs {
    duty: u16,
    forward: bool,
    reverse: bool,
}

struct WatchedPwm(Rc<RefCell<Outputs>>);
struct WatchedPin(Rc<RefCell<Outputs>>, fn(&mut Outputs) -> &mut bool);

impl embedded_hal::pwm::ErrorType for WatchedPwm {
    type Error = core::convert::Infallible;
}
impl SetDutyCycle for WatchedPwm {
    fn max_duty_cycle(&self) -> u16 {
        MAX
    }
    fn set_duty_cycle(&mut self, duty: u16) -> Result<(), Self::Error> {
        let mut o = self.0.borrow_mut();
        assert!(duty == 0 || duty == MAX || !(o.forward && o.reverse), "part duty with both inputs high");
        o.duty = duty;
        Ok(())
    }
}
impl embedded_hal::digital::ErrorType for WatchedPin {
    type Error = core::convert::Infallible;
}
impl OutputPin for WatchedPin {
    fn set_low(&mut self) -> Result<(), Self::Error> {
        self.set_state(PinState::Low)
    }
    fn set_high(&mut self) -> Result<(), Self::Error> {
        self.set_state(PinState::High)
    }
    fn set_state(&mut self, state: PinState) -> Result<(), Self::Error> {
        let mut o = self.0.borrow_mut();
        assert_eq!(o.duty, 0, "direction written while the PWM is on");
        *(self.1)(&mut o) = state == PinState::High;
        Ok(())
    }
}

fn any_drive() -> impl Strategy<Value = Drive> {
    prop_oneof![Just(Drive::Coast), Just(Drive::Brake), Just(Drive::Duty(0)), any::<i16>().prop_map(Drive::Duty)]
}

proptest! {
    #[test]
    fn no_sequence_moves_the_inputs_under_power(drives in prop::collection::vec(any_drive(), 1..60)) {
        let o = Rc::new(RefCell::new(Outputs::default()));
        let forward = WatchedPin(o.clone(), |o| &mut o.forward);
        let reverse = WatchedPin(o.clone(), |o| &mut o.reverse);
        let mut bridge = PwmBridge::new(WatchedPwm(o.clone()), forward, reverse).unwrap();
        for drive in drives {
            bridge.apply(drive).unwrap();
            let o = o.borrow();
            match drive {
                Drive::Coast => prop_assert!(o.duty == 0 && !o.forward && !o.reverse),
                Drive::Brake => prop_assert!(o.duty == MAX && o.forward && o.reverse),
                Drive::Duty(0) => prop_assert!(o.duty == 0),
                Drive::Duty(d) => {
                    prop_assert_eq!((o.forward, o.reverse), (d > 0, d < 0));
                    let share = f64::from(d.unsigned_abs()).min(10_000.0) / 10_000.0;
                    prop_assert_eq!(o.duty, (share * f64::from(MAX)).round() as u16);
                }
            }
        }
    }
}
