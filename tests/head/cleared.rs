//! Where the way toward the work counts as clear, so that the head may go down fast, and where it does not.

use crate::bench::Bench;
use edm_servo_head::head::{Command, Fault, MotionLimits, State};
use edm_servo_head::units::{MicrometresPerSecond, MicrometresPerSecond2, Nanometres};

fn to(um: i64, mm_s: f32) -> (Nanometres, MotionLimits) {
    let acceleration = MicrometresPerSecond2(5e6);
    let limits = MotionLimits { velocity: MicrometresPerSecond(mm_s * 1e3), acceleration, deceleration: acceleration };
    (Nanometres(um * 1000), limits)
}

fn go(bench: &mut Bench, um: i64, mm_s: f32) {
    let (to, limits) = to(um, mm_s);
    bench.command(Command::Position(to, limits));
    bench.run_until(5.0, |bench| bench.state() == State::Ready);
    bench.run(0.1);
}

/// A head that has been at 1.9 mm, above the surface, and is at 0.2 mm again.
fn lowered() -> Bench {
    let mut bench = Bench::ready();
    go(&mut bench, 1900, 5.0);
    go(&mut bench, 200, 100.0);
    bench
}

/// Goes down by 3 mm, pulses off, until it touches; how fast it does, mm/s. 5 mm/s are allowed where it has never been.
fn touches_at(bench: &mut Bench, command: impl FnOnce(Nanometres, MotionLimits) -> Command) -> f64 {
    let um = bench.head.status().position + 3000;
    let (to, limits) = to(um, 100.0);
    bench.command(command(to, limits));
    for _ in 0..20_000 {
        bench.tick();
        if bench.um() >= bench.surface_um {
            return bench.v * 1e3;
        }
    }
    panic!("it does not touch: {:?}", bench.head.status());
}

#[test]
fn where_the_head_has_been_it_goes_fast_and_beyond_that_slowly() {
    let mut bench = lowered();
    let (to, limits) = to(2500, 100.0);
    bench.command(Command::Position(to, limits));
    let mut fastest = 0.0f64;
    bench.run_until(1.0, |bench| {
        fastest = fastest.max(bench.v * 1e3);
        bench.fault().is_some()
    });
    assert_eq!(bench.fault(), Some(Fault::Contact));
    assert!(fastest > 80.0, "{fastest} mm/s");
    let mut bench = lowered();
    let mm_s = touches_at(&mut bench, Command::Position);
    assert!(mm_s < 5.5, "{mm_s} mm/s");
}

#[test]
fn where_the_head_was_pressed_into_the_work_the_way_is_not_clear() {
    let mut bench = Bench::ready();
    go(&mut bench, 1990, 5.0);
    bench.push = 12.0;
    let mut deepest = 0.0f64;
    for _ in 0..400 {
        bench.tick();
        deepest = deepest.max(bench.um());
    }
    bench.push = 0.0;
    bench.run(0.2);
    assert!(deepest > 2015.0 && bench.fault().is_none(), "{deepest} um, {:?}", bench.fault());
    go(&mut bench, 500, 100.0);
    // It comes down to 5 mm/s right at the surface; a way of 15 um more would be 13 mm/s there.
    let mm_s = touches_at(&mut bench, Command::Position);
    assert!(mm_s < 8.0, "{mm_s} mm/s");
}

#[test]
fn another_home_does_not_clear_a_way_that_was_not() {
    let mut bench = Bench::ready();
    go(&mut bench, 1500, 5.0);
    bench.command(Command::SetHome(Nanometres(0)));
    let mm_s = touches_at(&mut bench, Command::Position);
    assert!(mm_s < 5.5, "{mm_s} mm/s");
}

#[test]
fn what_was_clear_before_the_head_was_disabled_is_not_so_afterwards() {
    let mut bench = lowered();
    bench.command(Command::Disable);
    bench.run(0.1);
    // Other work lies there.
    bench.surface_um = 1500.0;
    bench.command(Command::Enable);
    bench.run(0.01);
    let mm_s = touches_at(&mut bench, Command::Position);
    assert!(mm_s < 5.5, "{mm_s} mm/s");
}

#[test]
fn what_is_to_touch_goes_slowly_wherever_it_has_been() {
    let mut bench = lowered();
    bench.surface_um = 1500.0;
    let mm_s = touches_at(&mut bench, Command::Touch);
    assert!(mm_s < 5.5, "{mm_s} mm/s");
}
