//! WritePermit to store settings: given by a head that neither drives nor sparks, and it keeps still until it has it back.

use crate::bench::Bench;
use edm_hal_shim::store::Permit;
use edm_servo_head::head::{Command, Fault, Refused, State};

#[test]
fn only_a_disabled_head_gives_leave_and_only_once() {
    let mut bench = Bench::eroding();
    assert_eq!(bench.head.permit_write().unwrap_err(), Refused::State(State::Eroding));
    bench.command(Command::Hold);
    assert_eq!(bench.head.permit_write().unwrap_err(), Refused::State(State::HoldingPosition));
    bench.command(Command::Disable);
    let permit = bench.head.permit_write().unwrap();
    assert!(permit.holds());
    assert_eq!(bench.head.permit_write().unwrap_err(), Refused::Storing);
    bench.head.end_write(permit);
    assert!(bench.head.permit_write().is_ok());
}

#[test]
fn a_head_whose_leave_is_out_is_not_enabled_and_not_checked() {
    let mut bench = Bench::new();
    bench.run(0.01);
    let permit = bench.head.permit_write().unwrap();
    assert_eq!(bench.head.command(Command::Enable), Err(Refused::Storing));
    assert_eq!(bench.head.command(Command::Commission), Err(Refused::Storing));
    bench.run(0.01);
    assert!(bench.coasts() && !bench.output.pulses);
    bench.head.end_write(permit);
    bench.command(Command::Enable);
}

#[test]
fn whatever_fault_is_raised_meanwhile_nothing_moves() {
    for fault in Fault::ALL {
        let mut bench = Bench::new();
        bench.run(0.01);
        let permit = bench.head.permit_write().unwrap();
        bench.head.raise(*fault);
        for _ in 0..2000 {
            bench.tick();
            assert!(bench.coasts() && !bench.output.pulses, "{}", fault.name());
        }
        bench.head.end_write(permit);
    }
}
