//! A surface is found by touching it, becomes the datum of positions, and tells the wear of the electrode.

use crate::rig::Rig;
use edm_servo_head::head::State;
use edm_servo_head::settings::{Declared as _, Value};

/// Found, not within reach, not open: 2011h:3.
const FOUND: u32 = 2;
const MISSED: u32 = 3;

fn read(rig: &mut Rig, index: u16, sub: u8) -> i64 {
    i64::from(rig.read(index, sub).cast_signed())
}

/// Looks for the surface, and says how that ended.
fn find(rig: &mut Rig) -> u32 {
    rig.write(0x2011, 1, &[1]);
    rig.run(3);
    let refused = rig.read(0x2000, 4);
    assert_eq!(rig.read(0x2011, 3), 1, "refused: {refused}");
    rig.until(10_000, |rig| rig.machine.status().state != State::Touching);
    rig.run(2);
    rig.read(0x2011, 3)
}

/// Touches, which ends well, and says what it was.
fn touch(rig: &mut Rig, as_what: u8) {
    assert_eq!(find(rig), FOUND);
    rig.write(0x2011, 5, &[as_what]);
}

/// Homed, in profile position, with an electrode that loses half of what the work does.
fn worn() -> Rig {
    let mut rig = Rig::new(|settings, plant| {
        settings.seek_settle_ms = 10.0;
        settings.end_lift = 300.0;
        plant.installation.surface = 0.9;
        plant.set("model.wear_positive", Value::Number(0.5)).unwrap();
    });
    rig.send(0, &[1, crate::rig::ID]);
    rig.enable();
    rig.write(0x6060, 0, &[6]);
    rig.control(0x0F);
    rig.control(0x1F);
    rig.until(100, |rig| rig.status() & 0x3400 == 0x1400);
    rig.control(0x0F);
    rig.mode(1);
    rig
}

/// Erodes along a straight path to this position.
fn erode_to(rig: &mut Rig, position: i32) {
    rig.write32(0x2004, 1, position);
    rig.write(0x2001, 1, &[1]);
    rig.until(120_000, |rig| rig.machine.status().state == State::Done);
    rig.run(2);
    rig.write(0x2001, 1, &[0]);
    rig.run(5);
}

/// The electrode stands above work that was not eroded, or above the hole again.
fn beside_the_hole(rig: &mut Rig, beside: bool) {
    let truth = rig.machine.process.truth();
    let removed = if beside { truth.surface_um - truth.first_surface_um } else { 0.0 };
    rig.machine.process.happen("workpiece.raised_mm", Value::Number(removed * 1e-3)).unwrap();
    rig.run(2);
}

fn removed(rig: &Rig) -> f64 {
    rig.machine.process.truth().surface_um - rig.machine.process.truth().first_surface_um
}

#[test]
fn a_surface_becomes_the_datum_and_nothing_moves_for_it() {
    let mut rig = worn();
    assert_eq!(find(&mut rig), FOUND);
    let surface = rig.highest_peak();
    let home = rig.machine.process.truth().count - rig.position();
    let touched = read(&mut rig, 0x2001, 6);
    assert!((touched + home - surface).abs() <= 1, "{touched}");
    assert!(rig.read(0x2011, 4) <= 5, "overshoot");
    let (count, paths) = (rig.position(), rig.machine.status().paths);
    rig.write32(0x2011, 6, -250);
    rig.write(0x2011, 5, &[1]);
    rig.run(20);
    assert_eq!((rig.position(), rig.machine.status().paths), (count, paths), "the head knows nothing of it");
    assert_eq!(read(&mut rig, 0x2001, 6), -250);
    assert_eq!(read(&mut rig, 0x2011, 7), touched + 250);
    assert_eq!(read(&mut rig, 0x6063, 0), count);
    assert_eq!(read(&mut rig, 0x6064, 0), count - touched - 250);
    assert_eq!(read(&mut rig, 0x60FC, 0) - read(&mut rig, 0x6062, 0), touched + 250);
    assert_ne!(rig.status() & 1 << 10, 0, "and is where it should be");
    // Positions that a host gives mean the same place: profile, cyclic, path.
    rig.move_to(-400, 1000);
    assert!((rig.position() - (touched + 250 - 400)).abs() <= 2);
    assert!((read(&mut rig, 0x6064, 0) + 400).abs() <= 2);
    rig.mode(8);
    rig.run(5);
    assert!((read(&mut rig, 0x607A, 0) + 400).abs() <= 2, "a host that says nothing wants no motion");
    rig.write32(0x607A, 0, -405);
    rig.run(50);
    assert!((read(&mut rig, 0x6064, 0) + 405).abs() <= 1);
    rig.mode(1);
    rig.write32(0x2004, 1, -300);
    rig.run(5);
    assert_eq!(rig.machine.status().waiting, 1);
    rig.write(0x2001, 1, &[1]);
    rig.until(10_000, |rig| rig.machine.status().state == State::Done);
    rig.run(50);
    rig.write(0x2001, 1, &[0]);
    assert!(read(&mut rig, 0x2006, 4) >= -301 && read(&mut rig, 0x2006, 4) <= -299, "deepest");
}

#[test]
fn limits_and_travel_stay_where_they_are() {
    let mut rig = worn();
    rig.write32(0x2011, 6, 5000);
    touch(&mut rig, 1);
    let datum = read(&mut rig, 0x2011, 7);
    assert!(datum < -4000, "{datum}");
    // The upper end of the travel, and a software limit, both reckoned from the home.
    rig.move_to(-100_000, 2000);
    assert!(rig.position().abs() <= 1);
    rig.write32(0x607D, 1, 40);
    rig.move_to(0, 2000);
    assert!((rig.position() - 40).abs() <= 1);
    assert_ne!(rig.status() & 1 << 11, 0, "cut off at the limit");
    // An absolute piece of path beyond the travel is refused, one within it is taken.
    let push = |rig: &mut Rig, nm: i32| {
        for (sub, value) in [(1, nm), (2, 0), (3, 0)] {
            rig.write32(0x200E, sub, value);
        }
        rig.write(0x200E, 6, &[0]);
        rig.write(0x200E, 7, &[0]);
        rig.write(0x200E, 8, &[1]);
        rig.run(3);
        let refused = rig.read(0x200E, 9);
        rig.write(0x200E, 8, &[0]);
        refused
    };
    assert_eq!(push(&mut rig, ((12_001 - datum) * 1000) as i32), 4);
    assert_eq!(push(&mut rig, ((11_999 - datum) * 1000) as i32), 0);
    // A home is where positions begin anew.
    rig.write(0x2004, 3, &[1]);
    rig.mode(6);
    rig.control(0x0F);
    rig.control(0x1F);
    rig.until(100, |rig| rig.status() & 0x3400 == 0x1400);
    rig.run(5);
    assert_eq!(read(&mut rig, 0x2011, 7), 0);
    assert!((read(&mut rig, 0x6064, 0) - rig.position()).abs() <= 1);
    assert_eq!(rig.try_write(0x2011, 5, &[1]), Err(0x0800_0022), "and what was touched has no place any more");
}

#[test]
fn the_reference_touched_again_tells_the_wear_and_the_depth_of_the_hole() {
    let mut rig = worn();
    touch(&mut rig, 2);
    let before = rig.highest_peak();
    rig.write(0x2011, 5, &[1]);
    assert_eq!((read(&mut rig, 0x2011, 8), read(&mut rig, 0x2011, 10)), (0, 0));
    erode_to(&mut rig, 150);
    let travel = read(&mut rig, 0x2011, 9);
    assert_eq!(travel, read(&mut rig, 0x2011, 10), "nobody knows of wear yet");
    beside_the_hole(&mut rig, true);
    let worn = rig.highest_peak() - before;
    touch(&mut rig, 3);
    let truth = rig.machine.process.truth();
    let (wear, depth) = (read(&mut rig, 0x2011, 8), read(&mut rig, 0x2011, 10));
    beside_the_hole(&mut rig, false);
    let removed = removed(&rig);
    assert!(truth.wear_um > 30.0, "what the test is about: {}", truth.wear_um);
    // What is longest of the face meets the highest peak of the work: of 100 drawn runs the wear so felt was 0 to 10 um less than the mean.
    assert!((wear - worn).abs() <= 1, "{wear} counts of wear, the place of the touch is {worn} um lower");
    assert!((0.0..=12.0).contains(&(truth.wear_um - wear as f64)), "{wear} counts of wear for {} um", truth.wear_um);
    assert_eq!(depth, travel - wear);
    // The gap that was kept at both ends differs: new peaks grow under the sparks.
    assert!((depth as f64 - removed).abs() <= 15.0, "{depth} counts for {removed} um");
    assert!((travel as f64 - removed).abs() > 30.0, "{travel} counts of travel are not the depth");
}

#[test]
fn positions_of_the_worn_face_make_the_hole_as_deep_as_was_asked_for() {
    let depth = |compensates: bool| {
        let mut rig = worn();
        touch(&mut rig, 2);
        rig.write(0x2011, 5, &[1]);
        erode_to(&mut rig, 150);
        beside_the_hole(&mut rig, true);
        let before = read(&mut rig, 0x2011, 7);
        touch(&mut rig, if compensates { 4 } else { 3 });
        let wear = read(&mut rig, 0x2011, 8);
        let shift = if compensates { wear } else { 0 };
        assert_eq!(read(&mut rig, 0x2011, 7) - before, shift);
        // The reference is where it was.
        assert_eq!(read(&mut rig, 0x2001, 6), wear - shift);
        if compensates {
            // Once is enough.
            rig.write(0x2011, 5, &[4]);
            assert_eq!(read(&mut rig, 0x2011, 7) - before, shift);
        }
        beside_the_hole(&mut rig, false);
        let held = removed(&rig);
        erode_to(&mut rig, 150);
        (held, removed(&rig))
    };
    let (first, same) = depth(false);
    assert!(same - first < 5.0, "the electrode has been there: {first} to {same} um");
    let (first, deeper) = depth(true);
    assert!(deeper - first > 20.0, "{first} to {deeper} um");
}

#[test]
fn what_cannot_be_is_refused() {
    let mut rig = worn();
    let refused = Err(0x0800_0022);
    for as_what in 1..=4 {
        assert_eq!(rig.try_write(0x2011, 5, &[as_what]), refused, "{as_what}: nothing was touched");
    }
    assert_eq!(find(&mut rig), FOUND);
    for as_what in [3, 4] {
        assert_eq!(rig.try_write(0x2011, 5, &[as_what]), refused, "{as_what}: no reference");
    }
    // Set points that come by themselves would mean something else.
    for mode in [3, 7, 8, 9] {
        rig.mode(mode);
        assert_eq!(rig.try_write(0x2011, 5, &[1]), refused, "mode {mode}");
        assert_eq!(rig.try_write(0x2011, 1, &[1]), refused, "mode {mode}");
    }
    rig.mode(1);
    rig.write(0x2011, 5, &[2]);
    // Not on the way.
    rig.write32(0x6081, 0, 500);
    rig.write32(0x607A, 0, 300);
    rig.control(0x1F);
    rig.run(20);
    assert_eq!(rig.machine.status().state, State::Positioning);
    assert_eq!((rig.try_write(0x2011, 5, &[1]), rig.try_write(0x2011, 1, &[1])), (refused, refused));
    rig.until(5000, |rig| rig.status() & 0x0400 != 0);
    rig.control(0x0F);
    // Beyond the travel, told as all that the head judges.
    rig.write32(0x2011, 2, 20_000);
    rig.write(0x2011, 1, &[1]);
    rig.run(5);
    assert_eq!((rig.read(0x2000, 4), rig.read(0x2011, 3)), (4, FOUND));
    rig.write32(0x2011, 2, 100);
    assert_eq!(find(&mut rig), MISSED);
    assert_eq!((rig.read(0x2000, 2), rig.read(0x2000, 3)), (0, 26), "no fault; no surface");
    assert_eq!(rig.try_write(0x2011, 5, &[1]), refused, "none was found");
    rig.write32(0x2011, 2, 0);
    // An erosion changes the work, and a datum that was set after it has wear in it that nobody knows.
    assert_eq!(find(&mut rig), FOUND);
    erode_to(&mut rig, 1000);
    for as_what in 1..=4 {
        assert_eq!(rig.try_write(0x2011, 5, &[as_what]), refused, "{as_what}: it was eroded");
    }
    touch(&mut rig, 1);
    assert_eq!(rig.try_write(0x2011, 5, &[4]), refused);
    rig.write(0x2011, 5, &[3]);
    assert_eq!(rig.try_write(0x2011, 5, &[5]), Err(0x0609_0031), "out of range");
}

#[test]
fn a_lost_home_takes_the_reference_along_and_the_datum_stays() {
    let mut rig = worn();
    touch(&mut rig, 2);
    rig.write(0x2011, 5, &[1]);
    let datum = read(&mut rig, 0x2011, 7);
    rig.machine.raise(edm_servo_head::head::Fault::EncoderLost);
    rig.run(20);
    assert_eq!((rig.read(0x2000, 5), read(&mut rig, 0x2011, 7)), (0, datum));
    rig.until(3000, |rig| rig.status() & 0x4F == 0x08);
    rig.run(5);
    rig.control(0x80);
    for word in [6, 7, 15] {
        rig.control(word);
        rig.run(5);
    }
    rig.until(1000, |rig| rig.machine.status().state == State::Ready);
    for what in [2, 3] {
        assert_eq!(rig.try_write(0x2011, 5, &[what]), Err(0x0800_0022), "{what}");
    }
}

#[test]
fn a_reset_of_the_node_forgets_the_datum() {
    let mut rig = worn();
    rig.write32(0x2011, 6, 77);
    touch(&mut rig, 1);
    assert_ne!(read(&mut rig, 0x2011, 7), 0);
    rig.send(0, &[129, crate::rig::ID]);
    rig.run(100);
    assert_eq!(read(&mut rig, 0x2011, 7), 0);
}

#[test]
fn what_a_probe_has_kept_is_a_position_like_any_other() {
    let mut rig = worn();
    // The contact sense, where it begins.
    rig.write(0x60B8, 0, &0x11u16.to_le_bytes());
    assert_eq!(find(&mut rig), FOUND);
    let (kept, touched) = (read(&mut rig, 0x60BA, 0), read(&mut rig, 0x2001, 6));
    assert!(rig.read(0x60B9, 0) & 2 != 0 && (kept - touched).abs() <= 8, "{kept} {touched}");
    rig.write32(0x2011, 6, -250);
    rig.write(0x2011, 5, &[1]);
    rig.run(5);
    assert_eq!(read(&mut rig, 0x2001, 6), -250);
    assert_eq!(read(&mut rig, 0x60BA, 0), kept - touched - 250, "60BAh is where a host sent to it would go");
}

#[test]
fn a_datum_by_which_no_place_of_the_travel_can_be_told_is_refused() {
    let mut rig = worn();
    assert_eq!(find(&mut rig), FOUND);
    for position in [i32::MIN, -1_000_000_001, 1_000_000_001, i32::MAX] {
        assert!(rig.try_write(0x2011, 6, &position.to_le_bytes()).is_err(), "{position}");
    }
    for position in [-1_000_000_000, 1_000_000_000] {
        rig.write32(0x2011, 6, position);
        rig.write(0x2011, 5, &[1]);
        rig.run(5);
        let (told, from) = (read(&mut rig, 0x6064, 0), rig.position());
        rig.write32(0x607A, 0, told as i32 - 10);
        rig.control(0x0F);
        rig.control(0x1F);
        rig.run(500);
        assert!((rig.position() - from + 10).abs() <= 1, "{position}: {} from {from}", rig.position());
        rig.control(0x0F);
    }
}

#[test]
fn a_set_point_given_while_a_surface_is_looked_for_is_neither_acknowledged_nor_told_as_reached() {
    let mut rig = worn();
    rig.write(0x2011, 1, &[1]);
    rig.run(20);
    assert_eq!(rig.machine.status().state, State::Touching);
    rig.write32(0x607A, 0, 300);
    rig.control(0x1F);
    rig.run(2);
    assert_eq!((rig.read(0x2000, 4), rig.status() & 0x1000), (1, 0));
    rig.control(0x0F);
    rig.until(3000, |rig| rig.machine.status().state == State::Ready);
    rig.run(100);
    assert_eq!((rig.read(0x2011, 3), rig.status() & 0x1400), (FOUND, 0));
    // Given once more, it is gone to.
    rig.control(0x1F);
    rig.run(2);
    assert_eq!(rig.status() & 0x1400, 0x1000);
    rig.until(3000, |rig| rig.status() & 0x0400 != 0);
    assert!((read(&mut rig, 0x6064, 0) - 300).abs() <= 5);
}

#[test]
fn the_surface_that_a_host_keeps_with_its_hole_is_the_same_place_until_the_home_is_another() {
    let mut rig = worn();
    assert_eq!(read(&mut rig, 0x2011, 11), i64::from(i32::MIN), "none");
    touch(&mut rig, 2);
    let touched = read(&mut rig, 0x2001, 6);
    rig.write32(0x2011, 11, touched as i32);
    erode_to(&mut rig, touched as i32 + 60);
    assert_eq!(read(&mut rig, 0x2011, 11), touched, "an erosion leaves it");
    // The same place, told from another datum.
    beside_the_hole(&mut rig, true);
    rig.move_to(0, 5000);
    rig.write32(0x2011, 6, 0);
    touch(&mut rig, 1);
    let datum = read(&mut rig, 0x2011, 7);
    assert_eq!(read(&mut rig, 0x2011, 11), touched - datum);
    // A worn face meets it deeper, and positions are those of the face: the place does not change.
    rig.write32(0x2011, 6, 0);
    touch(&mut rig, 2);
    touch(&mut rig, 1);
    let place = read(&mut rig, 0x2011, 11);
    erode_to(&mut rig, 60);
    beside_the_hole(&mut rig, true);
    rig.move_to(-100, 5000);
    touch(&mut rig, 4);
    let more = read(&mut rig, 0x2011, 7) - datum;
    assert!(more > 10, "{more}");
    assert_eq!(read(&mut rig, 0x2011, 11), place);
    for none in [true, false] {
        if none {
            rig.write32(0x2011, 11, i32::MIN);
        } else {
            rig.write32(0x2011, 11, 5);
            rig.write(0x6060, 0, &[6]);
            rig.control(0x0F);
            rig.control(0x1F);
            rig.run(100);
        }
        assert_eq!(read(&mut rig, 0x2011, 11), i64::from(i32::MIN));
    }
}
