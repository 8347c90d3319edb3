//! What servo users look for beside the modes of before: velocities cycle by cycle, limits of acceleration, relative set points, the
//! motor's current.

use crate::rig::Rig;
use edm_servo_head::head::State;
use edm_servo_head::units::TICK_HZ;

/// Cyclic velocity by RPDO 3 with every SYNC, 1 ms apart.
fn cyclic() -> Rig {
    let mut rig = Rig::ready();
    rig.write(0x1402, 2, &[1]);
    rig.mode(9);
    rig
}

fn streams(rig: &mut Rig, ms: u32, velocity: i32) {
    for _ in 0..ms {
        rig.send(0x405, &velocity.to_le_bytes());
        rig.send(0x80, &[]);
        rig.run(1);
    }
}

#[test]
fn velocities_are_followed_cycle_by_cycle_and_no_count_is_lost() {
    let mut rig = cyclic();
    let start = rig.position();
    assert_eq!(rig.read(0x6502, 0) & 0x100, 0x100);
    streams(&mut rig, 300, 3000);
    assert_eq!(rig.machine.status().state, State::Positioning);
    assert_ne!(rig.status() & 0x1000, 0, "follows");
    streams(&mut rig, 100, -1500);
    streams(&mut rig, 333, 1);
    // 900 down and 150 up, and a third of a count.
    rig.run(50);
    assert!((rig.position() - start - 750).abs() <= 1, "{} from {start}", rig.position());
    let demand = rig.machine.status().setpoint.to_f32();
    assert!((f64::from(demand) - start as f64 - 750.333).abs() < 0.01, "{demand} from {start}");
    // The offset of the host's own loop.
    rig.write32(0x60B1, 0, 1000);
    streams(&mut rig, 100, 0);
    rig.run(50);
    assert!((rig.position() - start - 850).abs() <= 1);
}

/// Least, mean and most.
fn range(values: &[f64]) -> [f64; 3] {
    let [least, most] = values.iter().fold([f64::INFINITY, -f64::INFINITY], |[l, m], x| [l.min(*x), m.max(*x)]);
    [least, values.iter().sum::<f64>() / values.len() as f64, most]
}

#[test]
fn a_slow_head_reads_as_fast_as_it_goes_and_deviates_little_from_its_path() {
    for velocity in [100, 200, 500, 1000, 2000] {
        let mut rig = cyclic();
        streams(&mut rig, 300, velocity);
        let (mut read, mut way) = (Vec::new(), Vec::new());
        for _ in 0..500 {
            streams(&mut rig, 1, velocity);
            let pdo = rig.sent.iter().rev().find(|(_, frame)| frame.id() == 0x285).expect("TPDO 2 with every SYNC");
            read.push(f64::from(i32::from_le_bytes(pdo.1.data()[4..8].try_into().unwrap())));
            way.push((
                f64::from(rig.machine.status().tick) / f64::from(TICK_HZ),
                rig.machine.process.truth().position_um,
            ));
        }
        // The rig takes a little longer than a millisecond for a SYNC.
        let ((from_s, from_um), (to_s, to_um)) = (way[0], way[499]);
        let goes = (to_um - from_um) / (to_s - from_s);
        let off: Vec<f64> = way.iter().map(|(s, um)| um - from_um - goes * (s - from_s)).collect();
        let ([least, mean, most], [up, _, down]) = (range(&read), range(&off));
        println!("{goes:.0} counts/s: reads {least:.0} to {most:.0}, mean {mean:.1}; deviates by {:.2} um", down - up);
        // A count is 50 counts/s, and the head goes in steps of one or two, which its friction makes uneven.
        assert!((mean - goes).abs() < 3.0 + 0.01 * goes, "{goes}: {mean}");
        assert!(least > 0.95 * goes - 60.0 && most < 1.05 * goes + 60.0, "{goes}: {least} to {most}");
        assert!(down - up < 4.0, "{goes}: {} um", down - up);
    }
}

#[test]
fn a_head_whose_velocities_stop_coming_stops() {
    let mut rig = cyclic();
    streams(&mut rig, 200, 4000);
    rig.run(5);
    let here = rig.position();
    rig.run(200);
    assert!((rig.position() - here).abs() <= 3);
    // From a new mode on nothing is gone on with.
    rig.mode(1);
    rig.mode(9);
    rig.run(50);
    assert_eq!(rig.read(0x60FF, 0), 0);
    assert!((rig.position() - here).abs() <= 3);
}

#[test]
fn cyclic_velocity_ends_at_the_limits_and_is_followed_with_pulses_on() {
    let mut rig = cyclic();
    rig.write32(0x607D, 2, 200);
    streams(&mut rig, 200, 4000);
    rig.run(50);
    assert!((rig.position() - 200).abs() <= 1);
    assert_ne!(rig.status() & 0x0800, 0, "limited");
    rig.write32(0x607D, 2, 12_000);
    rig.write(0x2001, 1, &[2]);
    streams(&mut rig, 100, -1000);
    assert_eq!(rig.machine.status().state, State::Guiding);
    rig.run(50);
    assert!((rig.position() - 100).abs() <= 1, "{}", rig.position());
}

#[test]
fn accelerations_are_bound_by_those_that_are_the_most() {
    let time = |acceleration: i32, deceleration: i32| {
        let mut rig = Rig::ready();
        rig.mode(1);
        rig.write32(0x6081, 0, 5000);
        rig.write32(0x60C5, 0, acceleration);
        rig.write32(0x60C6, 0, deceleration);
        let begin = rig.ms;
        rig.move_to(1000, 5000);
        rig.ms - begin
    };
    let most = i32::MAX;
    // v / 2a more at either end: 5 mm/s and 50 mm/s^2.
    let (both, up, down, neither) = (time(50_000, 50_000), time(50_000, most), time(most, 50_000), time(most, most));
    assert!((both - neither).abs_diff(100) < 15, "{both} {up} {down} {neither}");
    assert!((up - neither).abs_diff(50) < 12 && (down - neither).abs_diff(50) < 12, "{up} {down} {neither}");
}

#[test]
fn a_relative_set_point_is_reckoned_from_what_60f2h_says() {
    for (option, from) in [(0u8, 400), (1, 150), (2, 150)] {
        let mut rig = Rig::ready();
        rig.mode(1);
        rig.write(0x60F2, 0, &[option, 0]);
        rig.write32(0x6081, 0, 500);
        rig.write32(0x607A, 0, 400);
        rig.control(0x1F);
        rig.until(1000, |rig| rig.position() >= 150);
        rig.control(0x0F);
        rig.write32(0x607A, 0, 100);
        // Relative, at once.
        rig.control(0x7F);
        rig.until(3000, |rig| rig.status() & 0x0400 != 0);
        assert!((rig.position() - from - 100).abs() <= 8, "{option}: {}", rig.position());
    }
    assert_eq!(Rig::ready().try_write(0x60F2, 0, &[3, 0]), Err(0x0609_0031));
}

#[test]
fn current_and_force_are_told_per_mille_of_what_can_flow_for_ever() {
    let mut rig = Rig::ready();
    let rated = rig.read(0x6075, 0) as i32;
    let most = edm_servo_head::canopen::objects::setting_address("motor.continuous_a").unwrap();
    assert_eq!(rated, (rig.read_real(most) * 1000.0) as i32);
    rig.mode(1);
    rig.write32(0x607A, 0, 1000);
    rig.control(0x1F);
    let mut largest = 0;
    for _ in 0..40 {
        rig.run(1);
        let status = *rig.machine.status();
        let permille = rig.read(0x6078, 0) as u16 as i16;
        let of_the_head = |amps: f32| (amps * 1e6 / rated as f32) as i32;
        // That of the millisecond in which it was read, or of one beside it.
        let near = [status.current.0, rig.machine.status().current.0].map(of_the_head);
        let (low, high) = (near[0].min(near[1]) - 150, near[0].max(near[1]) + 150);
        assert!((low..=high).contains(&permille.into()), "{permille} not in {low}..={high}");
        largest = largest.max(permille.unsigned_abs());
    }
    assert!(largest > 50, "{largest} per mille");
    rig.run(500);
    let [force, current] = [0x6077, 0x6078].map(|index| rig.read(index, 0) as u16 as i16);
    assert!(force.abs_diff(current) < 100, "{force} and {current}");
}

#[test]
fn positions_do_not_wrap() {
    let mut rig = Rig::ready();
    assert_eq!((rig.read(0x607B, 1) as i32, rig.read(0x607B, 2) as i32), (i32::MIN, i32::MAX));
    assert_eq!(rig.try_write(0x607B, 1, &[0; 4]), Err(0x0601_0002));
}

#[test]
fn a_position_offset_moves_the_set_point_of_a_cyclic_host_and_of_no_other() {
    let mut rig = Rig::ready();
    rig.mode(1);
    rig.move_to(1000, 3000);
    rig.mode(8);
    rig.write(0x60C2, 1, &[10]);
    rig.write32(0x607A, 0, 1000);
    rig.write32(0x60B0, 0, 40);
    rig.run(100);
    assert!((rig.position() - 1040).abs() <= 2, "{}", rig.position());
    rig.write32(0x607A, 0, 1010);
    rig.run(100);
    assert!((rig.position() - 1050).abs() <= 2, "{}", rig.position());
    // Whoever comes back to the mode stays where it is.
    rig.mode(1);
    rig.mode(8);
    rig.run(200);
    assert!((rig.position() - 1050).abs() <= 2, "{}", rig.position());
    rig.mode(1);
    rig.move_to(900, 3000);
    assert!((rig.position() - 900).abs() <= 2, "{}", rig.position());
}

#[test]
fn a_torque_offset_pushes_at_once_in_a_cyclic_mode_until_the_loops_have_made_up_for_it() {
    // Largest deviation of the position in either direction, counts.
    let deviates = |mode: u8, per_mille: i16| {
        let mut rig = Rig::ready();
        rig.mode(1);
        rig.move_to(1000, 3000);
        rig.mode(mode);
        rig.write(0x60C2, 1, &[1]);
        if mode == 8 {
            rig.write32(0x607A, 0, 1000);
        }
        rig.run(200);
        let at = rig.position();
        rig.write(0x60B2, 0, &per_mille.to_le_bytes());
        let (mut least, mut most) = (0, 0);
        for _ in 0..100 {
            rig.step();
            (least, most) = (least.min(rig.position() - at), most.max(rig.position() - at));
        }
        rig.run(300);
        assert!((rig.position() - at).abs() <= 2, "{per_mille}: {:?}", rig.machine.status());
        (least, most)
    };
    let (up, down) = deviates(8, 150);
    assert!(down >= 3 && up >= -2, "{up} to {down} counts");
    let (up, down) = deviates(8, -150);
    assert!(up <= -3 && down <= 2, "{up} to {down} counts");
    let (up, down) = deviates(1, 150);
    assert!(up >= -1 && down <= 1, "{up} to {down} counts in profile position");
}

#[test]
fn the_outputs_of_a_head_and_the_version_of_its_profile_can_be_read() {
    let mut rig = Rig::ready();
    assert_eq!((rig.read(0x67FE, 0), rig.read(0x60FE, 2)), (0x0003_0000, 0));
    assert_eq!(rig.read(0x60FE, 1), 1 << 17, "the loop is closed");
    rig.mode(1);
    rig.write(0x2001, 1, &[1]);
    rig.write32(0x607A, 0, 4000);
    rig.control(0x1F);
    rig.run(100);
    assert_eq!(rig.read(0x60FE, 1), 1 << 17 | 1 << 16, "pulses are allowed");
    rig.control(0);
    rig.run(10);
    assert_eq!(rig.read(0x60FE, 1), 0);
}
