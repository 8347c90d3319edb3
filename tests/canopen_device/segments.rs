//! A path pushed segment by segment.

use crate::rig::Rig;
use edm_servo_head::head::State;

/// Cannot be done in the present state.
const DEVICE_STATE: u32 = 0x0800_0022;
const BY: u8 = 1;
const MARK: u8 = 2;
const STOP: u8 = 4;

/// Ready, in a mode, with the encoder of the defaults: 1 um.
fn ready() -> Rig {
    let mut rig = Rig::ready();
    rig.mode(1);
    rig
}

fn write_line(rig: &mut Rig, to: [i32; 3], options: u8) {
    write_segment(rig, 0, to, options);
}

fn write_segment(rig: &mut Rig, shape: u8, to: [i32; 3], options: u8) {
    for (axis, nm) in to.into_iter().enumerate() {
        rig.write32(0x200E, 1 + axis as u8, nm);
    }
    rig.write(0x200E, 6, &[shape]);
    rig.write(0x200E, 7, &[options]);
}

fn commit(rig: &mut Rig) -> Result<(), u32> {
    rig.try_write(0x200E, 8, &[1])
}

fn push_line(rig: &mut Rig, to: [i32; 3], options: u8) {
    write_line(rig, to, options);
    commit(rig).unwrap();
}

/// Segments appended, and why one was refused.
fn outcome(rig: &mut Rig) -> (u32, u32) {
    rig.run(2);
    (rig.read(0x200E, 10), rig.read(0x200E, 9))
}

#[test]
fn a_hundred_segments_and_more_are_pushed_in_a_second_and_none_is_lost() {
    let mut rig = ready();
    let begin = rig.ms;
    for number in 0..50 {
        push_line(&mut rig, [1000, 500 * (number % 3), 0], BY);
    }
    let ms = rig.ms - begin;
    assert!(ms <= 500, "50 segments in {ms} ms");
    assert_eq!(outcome(&mut rig), (50, 0));
    // One is under way.
    assert_eq!(rig.read(0x2004, 4), 256 - 49);
}

#[test]
fn segments_come_by_process_data_too_one_in_a_millisecond() {
    let mut rig = ready();
    let maps: [(u16, &[u32]); 2] =
        [(2, &[0x200E_0120, 0x200E_0220]), (3, &[0x200E_0320, 0x200E_0608, 0x200E_0708, 0x200E_0808])];
    for (number, entries) in maps {
        let (communication, mapping) = (0x1400 + number, 0x1600 + number);
        let id = 0x200 + 0x100 * u32::from(number) + 5;
        rig.write(communication, 1, &(id | 1 << 31).to_le_bytes());
        rig.write(communication, 2, &[255]);
        rig.write(mapping, 0, &[0]);
        for (sub, entry) in (1..).zip(entries) {
            rig.write(mapping, sub, &entry.to_le_bytes());
        }
        rig.write(mapping, 0, &[entries.len() as u8]);
        rig.write(communication, 1, &id.to_le_bytes());
    }
    let ends = |rig: &mut Rig, to: [i32; 2]| {
        let [down, x] = to.map(i32::to_le_bytes);
        rig.send(0x405, &[down, x].concat());
    };
    let rest = |rig: &mut Rig| rig.send(0x505, &[0, 0, 0, 0, 0, BY, 1]);
    for _ in 0..100 {
        ends(&mut rig, [1000, 200]);
        rest(&mut rig);
        rig.step();
    }
    assert_eq!(outcome(&mut rig), (100, 0));
    // Without its first half: what comes after it is not taken either, or the path would have a hole.
    rest(&mut rig);
    rig.step();
    ends(&mut rig, [1000, 200]);
    rest(&mut rig);
    assert_eq!(outcome(&mut rig), (100, 255));
    rig.write(0x200E, 8, &[0]);
    ends(&mut rig, [1000, 200]);
    rest(&mut rig);
    assert_eq!(outcome(&mut rig), (101, 0));
}

#[test]
fn a_half_written_segment_is_refused_and_so_are_the_next_until_the_host_has_taken_note() {
    let mut rig = ready();
    rig.write32(0x200E, 1, 100_000);
    assert_eq!(commit(&mut rig), Err(DEVICE_STATE));
    assert_eq!(outcome(&mut rig), (0, 255));
    write_line(&mut rig, [100_000, 0, 0], 0);
    assert_eq!(commit(&mut rig), Err(DEVICE_STATE));
    assert_eq!(outcome(&mut rig), (0, 255));
    rig.write(0x200E, 8, &[0]);
    push_line(&mut rig, [100_000, 0, 0], 0);
    assert_eq!(outcome(&mut rig), (1, 0));
    // What was written for that one is used up.
    assert_eq!(commit(&mut rig), Err(DEVICE_STATE));
    assert_eq!(outcome(&mut rig), (1, 255));
}

#[test]
fn an_arc_needs_its_centre_and_has_to_be_one() {
    let mut rig = ready();
    let quarter = |rig: &mut Rig, y: i32| write_segment(rig, 1, [0, 1_000_000, y], BY);
    quarter(&mut rig, 1_000_000);
    assert_eq!(commit(&mut rig), Err(DEVICE_STATE));
    assert_eq!(outcome(&mut rig), (0, 255));
    for (y, expected) in [(1_000_000, (1, 0)), (1_100_000, (1, 17))] {
        rig.write(0x200E, 8, &[0]);
        quarter(&mut rig, y);
        rig.write32(0x200E, 4, 0);
        rig.write32(0x200E, 5, 1_000_000);
        commit(&mut rig).unwrap();
        assert_eq!(outcome(&mut rig), expected);
    }
    assert_eq!(rig.read(0x2000, 4), 17, "the head's own refusal");
}

#[test]
fn what_leads_outside_of_the_travel_is_refused_also_in_the_middle_of_an_arc() {
    let mut rig = ready();
    // Half a turn in down-X, beginning and ending at the home, upward or downward in between.
    for (shape, expected) in [(4, (0, 4)), (3, (1, 0))] {
        rig.write(0x200E, 8, &[0]);
        let here = rig.position() as i32 * 1000;
        write_segment(&mut rig, shape, [here, 2_000_000, 0], 0);
        rig.write32(0x200E, 4, 0);
        rig.write32(0x200E, 5, 1_000_000);
        commit(&mut rig).unwrap();
        let outcome = outcome(&mut rig);
        assert_eq!(outcome, expected, "shape {shape}");
    }
}

#[test]
fn a_head_that_is_not_enabled_takes_no_segment() {
    let mut rig = ready();
    rig.control(0x06);
    rig.until(20, |rig| rig.machine.status().state == State::Disabled);
    write_line(&mut rig, [1000, 0, 0], BY);
    assert_eq!(commit(&mut rig), Err(DEVICE_STATE));
    assert_eq!(outcome(&mut rig), (0, 254));
}

/// Erodes along a line that leads X by as much as down, and is in the work.
fn slanted(options: u8) -> Rig {
    let mut rig = ready();
    let here = rig.position() as i32 * 1000;
    let truth = rig.machine.process.truth();
    let surface = here + ((truth.surface_um - truth.position_um) * 1000.0) as i32;
    push_line(&mut rig, [surface - 300_000, 0, 0], 0);
    rig.run(2);
    push_line(&mut rig, [surface + 700_000, 1_000_000, -500_000], options);
    rig.run(2);
    rig.write(0x2001, 1, &[1]);
    rig.until(20_000, |rig| rig.machine.status().state == State::Eroding);
    rig.run(500);
    rig
}

#[test]
fn x_and_y_go_along_in_the_ratio_of_the_path_while_the_gap_leads() {
    let mut rig = slanted(0);
    let mut furthest = 0;
    for _ in 0..1000 {
        rig.step();
        let status = rig.machine.status();
        let [x, y] = status.beside;
        assert!((x.to_f32() + 2.0 * y.to_f32()).abs() < 0.01, "{x:?} {y:?}");
        furthest = furthest.max(x.round());
    }
    assert!(furthest > 250, "{furthest} um");
    let (x, y) = (rig.read(0x200E, 12).cast_signed(), rig.read(0x200E, 13).cast_signed());
    assert!((x - furthest as i32 * 1000).abs() < 20_000 && (y + x / 2).abs() < 20_000, "{x} {y}");
}

#[test]
fn what_ended_a_retreat_is_known_after_the_fault_that_followed() {
    let mut rig = slanted(0);
    assert_eq!(rig.read(0x200E, 11), 0);
    rig.machine.process.fault_inputs.short = true;
    rig.until(5000, |rig| rig.machine.status().state == State::Fault);
    rig.run(500);
    assert_eq!(rig.read(0x200E, 11), 2, "the set distance");
}

#[test]
fn a_mark_ends_a_retreat_and_not_the_reaction_to_a_fault() {
    let mut rig = slanted(MARK);
    rig.machine.process.fault_inputs.short = true;
    rig.until(5000, |rig| rig.machine.status().state == State::Fault);
    let s = rig.machine.status().path;
    rig.run(1000);
    assert_eq!(rig.read(0x200E, 11), 3, "the mark");
    assert!(rig.machine.status().path < s.minus(edm_servo_head::units::Fixed::whole(100)));
}

#[test]
fn a_host_sets_stops_on_a_path_and_goes_on_from_each() {
    let mut rig = ready();
    let here = rig.position() as i32 * 1000;
    for (number, options) in [(1, BY | STOP), (2, BY | STOP), (3, BY)] {
        push_line(&mut rig, [100_000, 0, 0], options);
        rig.run(2);
        assert_eq!(rig.read(0x200E, 10), number);
    }
    for (number, ended_by) in [(1, 7), (2, 7), (3, 1)] {
        rig.write(0x2001, 1, &[1]);
        rig.until(20_000, |rig| rig.machine.status().state == State::Seeking);
        rig.until(20_000, |rig| rig.machine.status().state == State::Done);
        rig.run(50);
        assert_eq!(rig.read(0x2003, 3), ended_by);
        // It rests within a count of the stop.
        let off = rig.position() as i32 * 1000 - here - number * 100_000;
        assert!(off.abs() <= 1000, "{off} nm off stop {number}");
    }
}

#[test]
fn a_path_that_has_begun_anew_takes_nothing_before_the_host_has_taken_note() {
    let mut rig = ready();
    push_line(&mut rig, [1000, 0, 0], BY);
    write_line(&mut rig, [1000, 500, 0], BY);
    rig.control(6);
    rig.run(20);
    rig.control(7);
    rig.run(20);
    rig.control(15);
    rig.run(100);
    assert_eq!(outcome(&mut rig), (1, 252));
    assert_eq!(commit(&mut rig), Err(DEVICE_STATE));
    rig.write(0x200E, 8, &[0]);
    // What was half written before is none of it.
    rig.write32(0x200E, 3, 0);
    assert_eq!(commit(&mut rig), Err(DEVICE_STATE));
    assert_eq!(outcome(&mut rig), (1, 255));
    rig.write(0x200E, 8, &[0]);
    push_line(&mut rig, [1000, 0, 0], BY);
    assert_eq!(outcome(&mut rig), (2, 0));
}

#[test]
fn a_value_that_comes_twice_is_of_another_segment() {
    let mut rig = ready();
    write_line(&mut rig, [1000, 0, 0], BY);
    rig.write32(0x200E, 1, 2000);
    assert_eq!(commit(&mut rig), Err(DEVICE_STATE));
    assert_eq!(outcome(&mut rig), (0, 255));
}
