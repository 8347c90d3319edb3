//! Statements about machine and process together.

use super::*;
use edm_servo_head::settings::{Declared, Settings};
use std::f64::consts::PI;

fn process(values: &[(&str, f64)]) -> Process {
    Process::new(Plant::with(values).unwrap(), 1).unwrap()
}

fn run(process: &mut Process, drive: Drive, pulses: bool, seconds: f64) {
    for _ in 0..(seconds * f64::from(TICK_HZ)).round() as u64 {
        process.advance(drive, pulses);
    }
}

/// Neither friction nor weight: what is left is put there by the test.
const WEIGHTLESS: [(&str, f64); 4] = [
    ("model.friction_n", 0.0),
    ("model.stiction_n", 0.0),
    ("model.counterbalance_n", 0.2 * 9.80665),
    ("model.cable_n_mm", 0.0),
];

fn weightless(values: &[(&str, f64)]) -> Process {
    process(&[&WEIGHTLESS, values].concat())
}

#[test]
fn the_same_seed_gives_the_same_run_and_another_seed_another() {
    let codes = |seed| {
        let mut process = Process::new(Plant::default(), seed).unwrap();
        process.hold_gap(30.0, 0.0);
        (0..1000).map(|_| process.advance(Drive::Coast, true).block).collect::<Vec<_>>()
    };
    assert_eq!(codes(1), codes(1));
    assert_ne!(codes(1), codes(2));
}

#[test]
fn what_one_cause_draws_leaves_the_others_as_they_were() {
    let truth = |values: &[(&str, f64)]| {
        let mut process = process(&[&[("workpiece.surface_mm", 0.05)], values].concat());
        run(&mut process, Drive::Coast, true, 5.0);
        process.truth()
    };
    let usual = truth(&[]);
    assert!(usual.pulses.spark > 10_000);
    assert_eq!(truth(&[("front_end.noise_v", 3.0), ("front_end.hum_v", 0.0), ("scale.edge_loss", 0.01)]), usual);
    assert_ne!(truth(&[("model.ignition_debris", 0.4)]), usual);
}

#[test]
fn the_resting_head_stays_at_its_stop_at_count_zero_with_no_switch_open() {
    let mut process = process(&[]);
    run(&mut process, Drive::Coast, false, 1.0);
    let truth = process.truth();
    assert_eq!(truth.count, 0);
    assert!(truth.position_um.abs() < 0.2, "{}", truth.position_um);
    assert!(process.sensors().edges.is_empty());
    assert_eq!(process.sensors().safety, SafetyInputs::default());
}

#[test]
fn a_head_left_alone_rises_to_its_upper_stop_when_friction_lets_it() {
    let mut process = process(&[("model.friction_n", 0.1), ("model.stiction_n", 0.12)]);
    run(&mut process, Drive::Duty(200), false, 0.3);
    assert!(process.truth().position_um > 1000.0);
    run(&mut process, Drive::Coast, false, 2.0);
    assert!(process.truth().position_um.abs() < 0.2, "{}", process.truth().position_um);
}

#[test]
fn a_squeezed_film_thins_as_its_formula_says() {
    // 1 N on a film of 3 pi mu R^4 / (2 h^3): 1/h^2 grows by 4 F / (3 pi mu R^4) a second.
    let mut process = weightless(&[
        ("model.counterbalance_n", 0.2 * 9.80665 - 1.0),
        ("workpiece.surface_mm", 0.05),
        ("model.viscosity_mpas", 100.0),
        ("model.radius_um", 10e3),
    ]);
    run(&mut process, Drive::Coast, false, 2.0);
    let growth = 4.0 / (3.0 * PI * 0.1 * 1e-8);
    let expected = 1e6 / (1.0 / (50e-6f64 * 50e-6) + growth * 2.0).sqrt();
    let gap = process.truth().gap_um;
    assert!((gap / expected - 1.0).abs() < 0.01, "{gap} {expected}");
}

#[test]
fn the_atmosphere_limits_how_hard_the_film_holds_the_electrode_down() {
    // The face has 314 mm^2: 31.8 N at most. The coil pulls up with 26 N, or 29 N and a weightless 6 N.
    let lift = |counterbalance, duty| {
        let mut process = weightless(&[
            ("model.counterbalance_n", counterbalance),
            ("workpiece.surface_mm", 1.0),
            ("model.viscosity_mpas", 100.0),
            ("model.radius_um", 10e3),
        ]);
        process.model.axis.x = 1e-3 - 3e-6;
        run(&mut process, Drive::Duty(duty), false, 0.01);
        1000.0 - process.truth().position_um
    };
    assert!(lift(0.2 * 9.80665, -9000) < 5.0, "{}", lift(0.2 * 9.80665, -9000));
    assert!(lift(0.2 * 9.80665 + 6.0, -10_000) > 100.0, "{}", lift(0.2 * 9.80665 + 6.0, -10_000));
}

#[test]
fn limit_switches_open_on_their_side_of_their_place() {
    let mut process = weightless(&[("limit.upper_mm", 0.05), ("limit.lower_mm", 11.8), ("workpiece.surface_mm", 11.9)]);
    for (mm, upper, lower) in
        [(0.0, true, false), (0.049, true, false), (0.051, false, false), (11.79, false, false), (11.81, false, true)]
    {
        process.model.axis.x = mm * 1e-3;
        let safety = process.advance(Drive::Brake, false).safety;
        assert_eq!((safety.upper_limit, safety.lower_limit), (upper, lower), "{mm} mm");
    }
}

#[test]
fn the_codes_of_current_and_bus_read_what_flows() {
    for motor_reversed in [false, true] {
        let mut process =
            process(&[("wiring.motor_reversed", f64::from(u8::from(motor_reversed))), ("model.stroke_mm", 2.5)]);
        run(&mut process, Drive::Duty(-1000), false, 0.5);
        let drive = process.sensors().drive;
        // -4.8 V over 12.4 ohm, against the upper stop or the work: 0.387 A, 144 codes.
        assert!((2048 - 146..=2048 - 142).contains(&drive.motor_current), "{drive:?}");
        assert_eq!(drive.bus_voltage, 3137);
        assert_eq!(process.truth().position_um > 1000.0, motor_reversed);
    }
}

#[test]
fn edges_timer_and_truth_agree_wherever_the_head_goes() {
    let mut process = process(&[]);
    let mut count = 0i64;
    let mut last = process.sensors().levels;
    for tick in 0..40_000u32 {
        let duty = if tick / 1000 % 2 == 0 { 400 } else { -300 };
        let began = process.sensors().now;
        let sensors = process.advance(Drive::Duty(duty), true);
        for &(time, levels) in &sensors.edges {
            assert!(time.wrapping_sub(began) <= TICK_CLOCK);
            // A leads B toward the work: B becomes what A was.
            count += if last.a == levels.b { 1 } else { -1 };
            assert!((last.a != levels.a) ^ (last.b != levels.b));
            last = levels;
        }
        assert_eq!(sensors.timer_count as i32, count as i32);
        assert_eq!(sensors.levels, last);
        assert_eq!(process.truth().count, count);
    }
    assert!(process.truth().position_um > 100.0);
}

#[test]
fn without_pulses_the_front_end_sees_the_sense_supply_with_hum_and_noise_and_no_gate() {
    let mut process = process(&[]);
    process.advance(Drive::Coast, false);
    for _ in 0..4000 {
        let block = process.advance(Drive::Coast, false).block;
        assert_eq!(block.gate, 0);
        // 1 V of hum and five times 0.5 V of noise.
        assert!(block.codes.iter().all(|code| code.abs_diff(410 + 111) <= 35), "{:?}", block.codes);
    }
}

#[test]
fn every_fault_input_shows_where_it_should() {
    let mut process = process(&[("workpiece.surface_mm", 0.03)]);
    run(&mut process, Drive::Coast, true, 0.01);
    assert_ne!(process.sensors().block.gate, 0);

    process.fault_inputs =
        FaultInputs { gate_lost: true, stuck_code: Some(7), bus_v: Some(30.0), ..FaultInputs::default() };
    let sensors = process.advance(Drive::Coast, true);
    let GapBlock { codes, gate, gate_edges, .. } = sensors.block;
    assert_eq!((codes, gate, gate_edges.count), ([7; edm_hal_shim::gap::BLOCK], 0, 0));
    assert_eq!(sensors.drive.bus_voltage, 1961);

    process.fault_inputs = FaultInputs { short: true, ..FaultInputs::default() };
    let before = process.truth().pulses;
    run(&mut process, Drive::Coast, true, 0.1);
    let after = process.truth().pulses;
    assert!((499..=501).contains(&(after.short - before.short)), "{before:?} {after:?}");
    assert!(after.discharges() - before.discharges() <= 1);

    process.fault_inputs = FaultInputs { generator_dead: true, ..FaultInputs::default() };
    run(&mut process, Drive::Coast, true, 0.1);
    assert_eq!(process.truth().pulses.total() - after.total(), 0);
}

#[test]
fn a_dead_encoder_hides_the_motion_and_a_faulty_bridge_stops_it() {
    let mut process = weightless(&[]);
    process.fault_inputs.encoder = Cable::CUT;
    run(&mut process, Drive::Duty(500), false, 0.02);
    assert_eq!((process.sensors().timer_count, process.sensors().edges.len()), (0, 0));
    assert!(process.truth().position_um > 50.0);

    process.fault_inputs = FaultInputs {
        safety: SafetyInputs { bridge_fault: true, ..SafetyInputs::default() },
        ..FaultInputs::default()
    };
    run(&mut process, Drive::Duty(-10_000), false, 0.005);
    assert!(process.sensors().safety.bridge_fault);
    assert!(process.sensors().drive.motor_current.abs_diff(2048) <= 2);
    assert!(process.truth().velocity_um_s > 0.0);
}

#[test]
fn no_parameter_has_the_name_of_a_setting_of_the_head() {
    for field in Plant::FIELDS {
        assert!(Settings::FIELDS.iter().all(|other| other.key != field.key), "{}", field.key);
        assert_eq!(Plant::FIELDS.iter().filter(|other| other.key == field.key).count(), 1, "{}", field.key);
    }
}

#[test]
fn permission_and_the_off_time_that_is_requested_are_obeyed() {
    let mut process = process(&[("workpiece.surface_mm", 0.04)]);
    let mut pulses_in = |off_time_ns, pulses| {
        process.off_time_ns = off_time_ns;
        let before = process.truth().pulses.total();
        run(&mut process, Drive::Coast, pulses, 0.2);
        process.truth().pulses.total() - before
    };
    // 160 us on; 40 us off of its own.
    assert!(pulses_in(None, true).abs_diff(1000) <= 1);
    assert!(pulses_in(Some(240_000), true).abs_diff(500) <= 1);
    assert_eq!(pulses_in(None, false), 0);
    process.pauses_us = [240.0; 4];
    let before = process.truth().pulses.total();
    run(&mut process, Drive::Coast, true, 0.2);
    assert!((process.truth().pulses.total() - before).abs_diff(500) <= 1);
    process.pauses_us = [0.0; 4];
    process.fault_inputs.disobeys = true;
    run(&mut process, Drive::Coast, false, 0.01);
    assert_ne!(process.sensors().block.gate, 0);
}

#[test]
fn driven_onto_the_work_it_is_stopped_by_contact_shorts_there_and_says_so() {
    let mut process = process(&[]);
    run(&mut process, Drive::Duty(700), true, 2.0);
    let truth = process.truth();
    // 2.03 N of coil and 0.24 N of counterbalance surplus, and what the bristles of the friction have taken up.
    assert!((1.4..2.2).contains(&truth.contact_n), "{}", truth.contact_n);
    assert!((1990.0..2010.0).contains(&truth.position_um), "{}", truth.position_um);
    run(&mut process, Drive::Duty(700), true, 0.1);
    assert_eq!(process.truth().pulses.short - truth.pulses.short, 500);
    // (100 V - 1 V)/15 ohm.
    let amps = process.pieces().filter(|piece| piece.gate).map(|piece| piece.amps_at(49.0)).last();
    assert!(amps.is_none_or(|amps| (amps - 6.6).abs() < 0.01), "{amps:?}");
}

#[test]
fn it_goes_through_a_sheet_without_a_contact_behind_it() {
    let mut process =
        process(&[("workpiece.surface_mm", 0.02), ("model.thickness_um", 10.0), ("model.removal_um3_uj", 100.0)]);
    run(&mut process, Drive::Coast, true, 5.0);
    assert_eq!(process.truth().through, 1.0);
    let pulses = process.truth().pulses;
    run(&mut process, Drive::Duty(700), true, 0.5);
    let truth = process.truth();
    assert!(truth.position_um > 1000.0 && truth.contact_n == 0.0, "{truth:?}");
    assert_eq!((truth.pulses.discharges(), truth.pulses.short), (pulses.discharges(), pulses.short));
}

#[test]
fn a_held_gap_stays_and_so_do_swapped_leads() {
    // The gap that the sinker works in.
    for (reversed, sign) in [(0.0, 1.0), (1.0, -1.0)] {
        let mut process = process(&[("wiring.gap_reversed", reversed)]);
        process.hold_gap(40.0, 0.5);
        let (mut sum, mut n) = (0.0, 0.0);
        for _ in 0..20_000 {
            let block = process.advance(Drive::Duty(3000), true).block;
            for (_, code) in block.codes.iter().enumerate().filter(|(k, _)| block.gate >> k & 1 == 1) {
                sum += (f64::from(*code) - 410.0) * 0.1;
                n += 1.0;
            }
        }
        // Of -100 V the converter sees -41.
        let mean: f64 = sign * sum / n;
        assert!(if sign > 0.0 { (55.0..75.0).contains(&mean) } else { (38.0..41.5).contains(&mean) }, "{mean}");
        assert_eq!((process.truth().wear_um, process.truth().pulses.short), (0.0, 0));
    }
}

#[test]
fn comparators_stay_where_somebody_has_set_them() {
    let volts = |values: &[(&str, f64)]| Plant::with(values).unwrap().comparators_v();
    assert_eq!(volts(&[]), [70.0, 20.0]);
    assert_eq!(volts(&[("model.open_v", 120.0)]), [70.0, 20.0]);
    let [high, low] = volts(&[("front_end.comparators_for_v", 80.0), ("front_end.comparator_error_percent", -20.0)]);
    assert!((high - 44.8).abs() < 1e-4 && (low - 12.8).abs() < 1e-4, "{high} {low}");
}

#[test]
fn a_discharge_shows_on_lines_that_do_not_carry_it_as_often_and_as_strongly_as_was_set() {
    // Pulses on A and B together, largest deviation of a bus code, and conversions that differ.
    let with = |spark_v: f64, bus_v: f64, edges: f64| {
        let values = [("front_end.spark_v", spark_v), ("front_end.spark_bus_v", bus_v), ("scale.spark_edges", edges)];
        let make = |values: &[(&str, f64)]| {
            let mut process = Process::new(Plant::with(values).unwrap(), 1).unwrap();
            process.hold_gap(30.0, 0.0);
            process
        };
        let (mut disturbed, mut clean) = (make(&values), make(&[]));
        let (mut pulses, mut bus, mut codes) = (0, 0, 0);
        for _ in 0..20_000 {
            let seen = disturbed.advance(Drive::Coast, true).clone();
            let plain = clean.advance(Drive::Coast, true);
            pulses += (seen.edges.len() - plain.edges.len()) / 2;
            assert!(seen.edges.is_sorted_by_key(|(time, _)| time.wrapping_sub(seen.now)));
            bus = bus.max(seen.drive.bus_voltage.abs_diff(plain.drive.bus_voltage));
            codes += seen.block.codes.iter().zip(&plain.block.codes).filter(|(a, b)| a != b).count();
        }
        assert_eq!(disturbed.truth().count, clean.truth().count);
        (disturbed.truth().pulses.discharges(), pulses as u64, bus, codes as u64)
    };
    let (discharges, pulses, bus, codes) = with(20.0, 2.0, 0.5);
    assert!(discharges > 3000, "{discharges}");
    assert!((0.45..0.55).contains(&(pulses as f64 / discharges as f64)), "{pulses} of {discharges}");
    assert!((100..=131).contains(&bus), "{bus} codes of 131");
    assert!(codes > discharges * 9 / 10 && codes <= discharges, "{codes} of {discharges}");
    let (_, pulses, bus, codes) = with(0.0, 0.0, 0.0);
    assert_eq!((pulses, bus, codes), (0, 0, 0));
}

#[test]
fn lines_that_are_cut_show_every_discharge_on_a_alone() {
    let values = [("scale.spark_edges", 1e-4)];
    let mut process = Process::new(Plant::with(&values).unwrap(), 1).unwrap();
    process.hold_gap(30.0, 0.0);
    process.fault_inputs.encoder = Cable::CUT;
    let (mut pulses, still) = (0, process.sensors().levels);
    for _ in 0..2000 {
        let seen = process.advance(Drive::Coast, true);
        for pulse in seen.edges.chunks(2) {
            let [(_, up), (_, down)] = pulse else { panic!("{pulse:?}") };
            assert_eq!((up.a, up.b), (!still.a, still.b));
            assert_eq!(*down, still);
            pulses += 1;
        }
    }
    let discharges = process.truth().pulses.discharges();
    assert!(discharges > 300 && pulses * 100 >= discharges * 99 && pulses <= discharges, "{pulses} of {discharges}");
}
