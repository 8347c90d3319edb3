//! No input, however wrong, makes a tick panic, drive beyond its limits, or pulse where it must not. (Tests run with
//! overflow checks.)

use edm_hal_shim::bridge::Drive;
use edm_hal_shim::encoder::RawCount;
use edm_hal_shim::safety::{DriveCodes, SafetyInputs};
use edm_servo_head::encoder::Snapshot;
use edm_servo_head::gap::{GapReading, Quality};
use edm_servo_head::head::{Command, Head, Inputs, State};
use edm_servo_head::path::Path;
use edm_servo_head::settings::Settings;
use edm_servo_head::units::{Nanometres, Volts};
use proptest::prelude::*;

fn volts() -> impl Strategy<Value = Volts> {
    prop_oneof![0.0f32..110.0, any::<f32>(), Just(f32::NAN), Just(f32::INFINITY)].prop_map(Volts)
}

fn quality() -> impl Strategy<Value = Quality> {
    prop_oneof![
        8 => Just(Quality::Valid),
        1 => Just(Quality::Missing),
        1 => Just(Quality::NoGate),
        1 => Just(Quality::Saturated),
        1 => Just(Quality::Reversed),
    ]
}

fn unlikely() -> impl Strategy<Value = bool> {
    prop::bool::weighted(0.002)
}

prop_compose! {
    fn input()(
        filtered in volts(), block in volts(), quality in quality(), touches in unlikely(), short_ticks in prop_oneof![9 => Just(0), 1 => any::<u32>()],
        count in prop_oneof![9 => 0u32..20_000, 1 => any::<u32>()], last_edge in any::<u32>(), now in any::<u32>(),
        toward_work in any::<bool>(), illegal in prop_oneof![9 => Just(0), 1 => any::<u32>()],
        safety in [unlikely(), unlikely(), unlikely(), unlikely(), unlikely(), unlikely()],
        motor_current in 0u16..4096, bus_voltage in prop_oneof![20 => Just(3137u16), 1 => any::<u16>()],
    ) -> Inputs {
        let [upper_limit, lower_limit, emergency_stop, dielectric, bridge_fault, supply_low] = safety;
        Inputs {
            gap: GapReading { filtered, block, mean: block, quality, touches, short_ticks, code: now as u16, ..GapReading::default() },
            encoder: Snapshot { raw: RawCount { count, last_edge, toward_work, now }, illegal, ..Snapshot::default() },
            safety: SafetyInputs { upper_limit, lower_limit, emergency_stop, dielectric, bridge_fault, supply_low }.unsafe_ones(),
            drive: DriveCodes { motor_current, bus_voltage },
            host_alive: true,
            ..Inputs::default()
        }
    }
}

fn command() -> impl Strategy<Value = Command> {
    let length = prop_oneof![-1_000_000i64..13_000_000, any::<i64>()].prop_map(Nanometres);
    prop_oneof![
        3 => Just(Command::Enable),
        1 => Just(Command::Disable),
        1 => length.clone().prop_map(Command::SetHome),
        2 => length.clone().prop_map(Command::MoveTo),
        2 => length.clone().prop_map(Command::MoveBy),
        2 => length.prop_map(Command::FindSurface),
        3 => Just(Command::Start),
        1 => Just(Command::Hold),
        1 => Just(Command::Commission),
        1 => Just(Command::Identify),
        1 => Just(Command::Tune),
        3 => Just(Command::ResetFault),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    #[test]
    fn no_input_breaks_a_tick(
        steps in prop::collection::vec((prop::collection::vec(command(), 0..3), input(), 1usize..60), 1..60),
    ) {
        let settings = Settings { commissioned: true, ..Settings::default() };
        let mut head = Head::new(settings.build().unwrap().head, Box::new(Path::EMPTY));
        let limit = (f32::from(Drive::FULL) * settings.axis_duty_limit) as i16 + 1;
        for (commands, input, ticks) in steps {
            for command in commands {
                let _ = head.command(command);
            }
            for _ in 0..ticks {
                let output = head.tick(&input);
                let state = head.in_force().state;
                prop_assert!(!output.pulses || state.pulses() || state == State::Commissioning);
                if let Drive::Duty(duty) = output.drive {
                    prop_assert!(duty.abs() <= limit, "{duty}");
                    prop_assert!(state != State::Disabled);
                }
            }
        }
    }
}
