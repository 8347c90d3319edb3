//! Every fault, from what causes it on the running head: nothing here raises one by hand.
//!
//! The rows of the table, with what the head does then, are in `faults.rs`.

use crate::bench::Bench;
use edm_servo_head::gap::Quality;
use edm_servo_head::head::{Command, Fault, LEAD, MotionLimits, State};
use edm_servo_head::units::{MicrometresPerSecond, MicrometresPerSecond2, Nanometres};

/// A head to which what causes the fault has just happened, and which runs on. A fault without its cause here does not
/// compile.
fn caused(fault: Fault) -> Option<Bench> {
    let mut bench = match fault {
        // This head makes its plans in time: tests/runtime/late_plans.rs.
        Fault::PlanLate => return None,
        // This board has passed: tests/runtime/self_test.rs.
        Fault::SelfTestFailed => return None,
        // The circuit is outside, and so is the clock: tests/runtime/live.rs.
        Fault::LiveLost | Fault::LiveStuck | Fault::ClockLost => return None,
        // No bit flips by itself here: tests/runtime/settings_damaged.rs.
        Fault::SettingsDamaged => return None,
        Fault::HostSilent => {
            let mut bench = Bench::with(|settings| settings.host_ms = 100);
            bench.make_ready();
            bench
        }
        Fault::PolarityWrong => {
            // It runs to the end of its stroke before anything else would show.
            let mut bench = Bench::with(|settings| {
                settings.following_limit = 100_000.0;
                settings.following_ms = 2;
            });
            bench.x = 0.006;
            bench.make_ready();
            bench
        }
        // With pulses off.
        Fault::Contact | Fault::UnpermittedPulses | Fault::StepsNotFollowed => Bench::ready(),
        Fault::OpenCircuitLow => {
            let mut bench = Bench::ready();
            bench.open_v = 65.0;
            bench.command(Command::MoveTo(Nanometres(4_000_000)));
            bench.command(Command::Start);
            bench
        }
        _ => Bench::eroding(),
    };
    match fault {
        Fault::PersistentArc => bench.arcs = 100,
        Fault::PlanLate | Fault::SelfTestFailed | Fault::SettingsDamaged | Fault::OpenCircuitLow => {}
        Fault::LiveLost | Fault::LiveStuck | Fault::ClockLost => {}
        Fault::PersistentShort => bench.follows = Some(-1.0),
        Fault::GapSignalInvalid => bench.quality = Quality::Missing,
        Fault::GapReversed => bench.quality = Quality::Reversed,
        Fault::BurningUnclear => bench.quality = Quality::Unclear,
        Fault::GateMissing => bench.quality = Quality::NoGate,
        Fault::ReflexLost | Fault::UnpermittedPulses => bench.edges = 8,
        Fault::DielectricNotOk => bench.safety.dielectric = true,
        Fault::HostSilent => bench.host_alive = false,
        Fault::LowerLimit => bench.safety.lower_limit = true,
        Fault::UpperLimit => bench.safety.upper_limit = true,
        Fault::BothLimits => (bench.safety.lower_limit, bench.safety.upper_limit) = (true, true),
        Fault::FollowingError => bench.push = 60.0,
        Fault::EncoderLost => {
            bench.watch_offset = Some(0);
            bench.run(0.01);
            bench.watch_offset = Some(100);
        }
        Fault::PolarityWrong => (bench.motor_sign, bench.push) = (-1.0, 5.0),
        Fault::BusSag => bench.bus = 10.0,
        Fault::EmergencyStop => bench.safety.emergency_stop = true,
        Fault::DriveSignalLost => bench.drive_stands = true,
        Fault::OverCurrent => bench.extra_amps = 4.0,
        Fault::BridgeFault => bench.safety.bridge_fault = true,
        Fault::StepsNotFollowed => {
            bench.command(Command::Step(Nanometres(0), Nanometres(3_000_000)));
            bench.head.step(5000);
        }
        Fault::SupplyLow => bench.safety.supply_low = true,
        Fault::Contact => {
            let ramp = MicrometresPerSecond2(1e6);
            let velocity = MicrometresPerSecond(5000.0);
            let limits = MotionLimits { velocity, acceleration: ramp, deceleration: ramp };
            bench.command(Command::Position(Nanometres(2_500_000), limits));
        }
    }
    Some(bench)
}

#[test]
fn every_fault_is_found_from_its_cause_switches_the_pulses_off_and_stays() {
    for &fault in Fault::ALL {
        let Some(mut bench) = caused(fault) else { continue };
        bench.changes();
        for _ in 0..40_000 {
            if bench.fault().is_some() {
                break;
            }
            bench.tick();
        }
        assert_eq!((bench.state(), bench.fault()), (State::Fault, Some(fault)));
        (0..LEAD).for_each(|_| bench.tick());
        for _ in 0..2000 {
            assert!(!bench.output.pulses, "{}", fault.name());
            bench.tick();
        }
        assert_eq!(bench.state(), State::Fault, "{}", fault.name());
        let (first, reaction) = (bench.head.status().first, bench.head.in_force().reaction);
        assert_eq!(first, Some(fault));
        assert!(reaction >= Some(fault.reaction()), "{}: {reaction:?}", fault.name());
        assert!(bench.head.command(Command::Enable).is_err(), "{}", fault.name());
    }
}
