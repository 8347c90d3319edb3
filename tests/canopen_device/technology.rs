//! A table of technology over the bus: written, checked, run row after row.

use crate::rig::Rig;
use edm_servo_head::canopen::Group;
use edm_servo_head::canopen::drive::TechnologyPhase as Phase;
use edm_servo_head::canopen::objects::setting_address;
use edm_servo_head::head::{Fault, State};

/// What a row leaves, um, and its settings.
type Row<'a> = (u32, &'a [(&'a str, u32)]);

fn number(key: &str) -> u32 {
    let (index, sub) = setting_address(key).unwrap();
    u32::from(index) << 8 | u32::from(sub)
}

impl Rig {
    fn write_rows(&mut self, rows: &[Row<'_>]) {
        for (place, (leaves, settings)) in (1u8..).zip(rows) {
            self.write(0x201C, 7, &[place]);
            self.write(0x201C, 10, &(1000 * leaves).to_le_bytes());
            self.write(0x201C, 11, &(1000 * u32::from(place)).to_le_bytes());
            for (key, word) in *settings {
                self.write(0x201C, 8, &number(key).to_le_bytes());
                self.write(0x201C, 9, &word.to_le_bytes());
            }
        }
    }

    fn use_rows(&mut self) -> u32 {
        self.write(0x201C, 2, &[1]);
        self.until(20, |rig| rig.phase() != Phase::Checks);
        self.read(0x201C, 6)
    }

    fn phase(&self) -> Phase {
        self.drive.technology().0
    }

    fn row(&self) -> u8 {
        self.drive.technology().1
    }

    fn setpoint(&self) -> f32 {
        self.drive.settings().gap_setpoint
    }

    /// Position at which the electrode is so deep in the work.
    fn depth(&self, um: i32) -> i32 {
        let truth = self.machine.process.truth();
        truth.first_surface_um as i32 + um - (truth.position_um as i32 - self.position() as i32)
    }

    fn erode_to(&mut self, target: i32) {
        self.mode(1);
        self.write(0x2001, 1, &[1]);
        self.write32(0x607A, 0, target);
        self.control(0x1F);
    }
}

fn volts(volts: f32) -> u32 {
    volts.to_bits()
}

const THREE: [Row<'_>; 3] = [
    (20, &[("gap.setpoint_v", 0x4282_0000), ("jump.height_um", 0x4396_0000)]),
    (8, &[("gap.setpoint_v", 0x4278_0000), ("end.spark_out_ms", 0x4348_0000)]),
    (0, &[("gap.setpoint_v", 0x425C_0000), ("feed.law", 1)]),
];

fn with_three() -> Rig {
    let mut rig = Rig::ready();
    rig.write_rows(&THREE);
    assert_eq!(rig.use_rows(), 2);
    rig
}

#[test]
fn a_hole_is_made_row_after_row_and_its_target_is_reached_after_the_last() {
    assert_eq!(THREE[0].1[0].1, volts(65.0));
    let mut rig = with_three();
    let (before, target) = (*rig.drive.settings(), rig.depth(40));
    assert_eq!((rig.read(0x201C, 1), rig.read(0x201C, 5), rig.read(0x201C, 15)), (3, 1, 1000));
    rig.erode_to(target);
    let mut ends = Vec::new();
    let mut seen = (0, 0.0);
    rig.until(240_000, |rig| {
        let eroding = rig.machine.status().state == State::Eroding;
        if eroding && seen.0 != rig.row() {
            seen = (rig.row(), rig.machine.status().gap_setpoint.0);
            ends.push((seen.0, seen.1, target - rig.position() as i32));
        }
        rig.status() & 0x0400 != 0
    });
    // The next row begins about where the one before has ended.
    let [(1, first, _), (2, second, after_first), (3, third, after_second)] = ends[..] else { panic!("{ends:?}") };
    assert_eq!((first, second, third), (65.0, 62.0, 55.0));
    assert!((after_first - 20).abs() <= 3 && (after_second - 8).abs() <= 3, "{ends:?}");
    assert_eq!((rig.phase(), rig.machine.status().state), (Phase::Done, State::Done));
    assert!((rig.position() as i32 - target).abs() <= 1);
    rig.run(5);
    assert_eq!(*rig.drive.settings(), before, "as before the table");
    assert_eq!((rig.read(0x201A, 15), rig.read(0x2003, 3)), (1, 1), "one hole, ended by depth");
    assert!(rig.read(0x2006, 3) > 2000, "eroding time of all rows");
    // And the table is ready for the next.
    assert_eq!(rig.row(), 1);
}

#[test]
fn what_is_wrong_is_said_with_row_and_setting_and_nothing_is_lost() {
    let mut rig = Rig::ready();
    assert_eq!(rig.use_rows(), 0);
    assert_eq!(rig.read(0x201C, 3), 1, "no row");
    let good: [Row<'_>; 1] = [(20, &[("gap.setpoint_v", 0x4282_0000)])];
    for (second, why, key) in [
        ((20, &[][..]), 2, None),
        ((0, &[("retreat.clearance_um", volts(500.0))][..]), 3, Some("retreat.clearance_um")),
        ((0, &[("gap.setpoint_v", volts(301.0))][..]), 4, Some("gap.setpoint_v")),
        ((0, &[("jump.height_um", volts(900_000.0))][..]), 5, Some("jump.height_um")),
    ] {
        rig.write_rows(&[good[0], second]);
        let settings = *rig.drive.settings();
        assert_eq!(rig.use_rows(), 0, "{key:?}");
        assert_eq!((rig.read(0x201C, 3), rig.read(0x201C, 4)), (why, 2), "{key:?}");
        if let Some(key) = key {
            assert_eq!(rig.read(0x2002, 1), number(key));
        }
        assert_eq!((*rig.drive.settings(), rig.read(0x201C, 1)), (settings, 2));
        // The row that was wrong is written anew, the one before it is still there.
        rig.write(0x201C, 7, &[2]);
        assert_eq!(rig.use_rows(), 2);
        rig.write(0x201C, 2, &[0]);
    }
    // Beyond its ends, and while it is in use.
    assert_eq!(rig.try_write(0x201C, 7, &[4]), Err(0x0609_0030));
    assert_eq!(rig.try_write(0x201C, 8, &0x0021_00FFu32.to_le_bytes()), Err(0x0609_0030));
    assert_eq!(rig.try_write(0x201C, 9, &0u32.to_le_bytes()), Err(0x0800_0022), "of no setting");
    rig.write(0x201C, 7, &[1]);
    for _ in 0..12 {
        rig.write(0x201C, 8, &number("gap.setpoint_v").to_le_bytes());
        rig.write(0x201C, 9, &volts(60.0).to_le_bytes());
    }
    rig.write(0x201C, 8, &number("gap.setpoint_v").to_le_bytes());
    assert_eq!(rig.try_write(0x201C, 9, &volts(60.0).to_le_bytes()), Err(0x0504_0005));
    assert_eq!(rig.use_rows(), 2);
    assert_eq!(rig.try_write(0x201C, 10, &0u32.to_le_bytes()), Err(0x0800_0022));
    assert_eq!(rig.try_write(0x201C, 5, &[2]), Err(0x0609_0030));
}

#[test]
fn a_hold_in_the_middle_of_a_row_ends_it_and_the_next_start_goes_on_with_it() {
    let mut rig = with_three();
    let (before, target) = (rig.setpoint(), rig.depth(40));
    rig.write(0x201C, 5, &[2]);
    rig.erode_to(target);
    rig.until(120_000, |rig| rig.machine.status().state == State::Eroding);
    rig.run(500);
    assert_eq!((rig.row(), rig.setpoint(), rig.phase()), (2, 62.0, Phase::Runs));
    // Its rows lead to one depth.
    rig.control(0x0F);
    rig.write32(0x607A, 0, target + 100);
    rig.control(0x1F);
    assert_eq!((rig.read(0x2000, 4), rig.phase()), (12, Phase::Runs));
    rig.write(0x2001, 1, &[0]);
    rig.run(5);
    assert_eq!((rig.row(), rig.setpoint(), rig.phase()), (2, before, Phase::Interrupted));
    assert_eq!(rig.machine.status().state, State::HoldingPosition);
    rig.write(0x2001, 1, &[1]);
    rig.until(5000, |rig| rig.machine.status().state == State::Eroding);
    assert_eq!((rig.row(), rig.setpoint()), (2, 62.0));
    // What goes on may give the depth again.
    rig.control(0x0F);
    rig.write32(0x607A, 0, target);
    rig.control(0x1F);
    assert_eq!((rig.status() & 0x1000, rig.phase()), (0x1000, Phase::Runs));
    // A halt, and a fault.
    rig.control(0x11F);
    rig.run(200);
    assert_eq!((rig.setpoint(), rig.phase()), (before, Phase::Interrupted));
    rig.control(0x1F);
    rig.until(5000, |rig| rig.machine.status().state == State::Eroding);
    assert_eq!((rig.row(), rig.setpoint()), (2, 62.0));
    rig.machine.raise(Fault::HostSilent);
    rig.run(20);
    assert_eq!((rig.row(), rig.setpoint(), rig.phase()), (2, before, Phase::Interrupted));
}

#[test]
fn what_a_host_writes_during_a_row_stays_and_what_the_row_has_is_never_stored() {
    let mut rig = with_three();
    let (before, jump, target) = (rig.setpoint(), rig.drive.settings().jump_height, rig.depth(40));
    rig.erode_to(target);
    rig.until(120_000, |rig| rig.machine.status().state == State::Eroding);
    rig.run(20);
    assert_eq!((rig.setpoint(), rig.drive.settings().jump_height), (65.0, 300.0));
    // As if the head had been disabled in this moment.
    rig.image.keep(Group::All, &rig.drive, &rig.node).unwrap();
    let (index, sub) = setting_address("gap.setpoint_v").unwrap();
    rig.write(index, sub, &volts(58.0).to_le_bytes());
    assert_eq!(rig.setpoint(), 58.0);
    rig.write(0x2001, 1, &[0]);
    rig.run(5);
    assert_eq!((rig.setpoint(), rig.drive.settings().jump_height), (58.0, jump));
    rig.send(0, &[129, 5]);
    rig.run(5);
    assert_eq!((rig.setpoint(), rig.drive.settings().jump_height), (before, jump));
}

#[test]
fn pulses_are_off_until_the_generator_has_the_row_or_its_time_is_over() {
    let mut rig = Rig::ready();
    let (index, sub) = setting_address("technology.answer_s").unwrap();
    rig.write(index, sub, &0.3f32.to_le_bytes());
    rig.write_rows(&THREE);
    assert_eq!(rig.use_rows(), 2);
    let target = rig.depth(40);
    rig.erode_to(target);
    rig.run(250);
    assert_eq!((rig.phase(), rig.machine.status().state, rig.setpoint()), (Phase::Waits, State::Ready, 65.0));
    rig.until(80, |rig| rig.phase() == Phase::Unanswered);
    rig.run(3);
    assert_eq!(rig.machine.status().state, State::Ready);
    // Another row's answer is none.
    rig.write(0x2001, 1, &[1]);
    rig.run(10);
    assert_eq!(rig.phase(), Phase::Waits);
    rig.write(0x201C, 19, &[2]);
    rig.run(10);
    assert_eq!(rig.phase(), Phase::Waits);
    rig.write(0x201C, 19, &[1]);
    rig.run(10);
    assert_eq!((rig.phase(), rig.machine.status().state), (Phase::Runs, State::Seeking));
}
