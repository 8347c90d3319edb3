//! The controlword by its edges, and what a fault or a quick stop leaves behind.

use crate::rig::Rig;
use edm_servo_head::head::{Fault, State};
use edm_servo_head::settings::Settings;

/// Operating in profile position, on its way to 1800 counts at 10 mm/s; the controlword is 0x1F.
fn on_its_way() -> Rig {
    let mut rig = Rig::ready();
    rig.mode(1);
    // Where it has been before, it need not go slowly.
    rig.move_to(1900, 1000);
    rig.move_to(0, 1000);
    rig.write32(0x607A, 0, 1800);
    rig.control(0x1F);
    rig.run(50);
    assert_eq!(rig.machine.status().state, State::Positioning);
    rig
}

/// In fault, its reaction over and its cause gone.
fn in_fault(mut rig: Rig) -> Rig {
    rig.machine.process.fault_inputs.safety.emergency_stop = true;
    rig.until(1500, |rig| rig.status() & 0x4F == 0x08);
    rig.machine.process.fault_inputs.safety.emergency_stop = false;
    rig.run(5);
    assert_eq!(rig.status() & 0x4F, 0x08);
    rig
}

fn is_reset(rig: &mut Rig) -> bool {
    rig.run(5);
    rig.status() & 0x4F == 0x40
}

#[test]
fn a_fault_is_reset_by_the_edge_of_bit_7_and_not_by_its_level() {
    let mut rig = Rig::ready();
    // High since before the fault, and sent again and again, as by a cyclic master.
    rig.control(0x8F);
    let mut rig = in_fault(rig);
    for word in [0x8F, 0x80, 0x8F, 0x86] {
        rig.control(word);
        assert!(!is_reset(&mut rig), "{word:#x}");
    }
    rig.control(0x00);
    assert!(!is_reset(&mut rig), "a falling edge");
    rig.control(0x80);
    assert!(is_reset(&mut rig), "a rising edge");
}

#[test]
fn a_set_point_is_taken_by_the_edge_of_bit_4_and_not_by_its_level() {
    let mut rig = on_its_way();
    rig.write32(0x607A, 0, 300);
    for word in [0x1F, 0x3F, 0x1F] {
        rig.control(word);
    }
    rig.until(1000, |rig| rig.status() & 0x0400 != 0);
    assert!((rig.position() - 1800).abs() <= 2);
    for word in [0x1F, 0x3F, 0x0F] {
        rig.control(word);
        rig.run(50);
        assert!((rig.position() - 1800).abs() <= 2, "{word:#x}: at {}", rig.position());
    }
    rig.control(0x1F);
    rig.until(1000, |rig| rig.status() & 0x0400 != 0 && (rig.position() - 300).abs() <= 2);
}

#[test]
fn the_end_of_a_halt_goes_on_to_the_target_under_way_and_takes_no_other() {
    let mut rig = on_its_way();
    rig.control(0x11F);
    rig.run(50);
    rig.write32(0x607A, 0, 300);
    rig.control(0x11F);
    rig.control(0x1F);
    rig.until(1000, |rig| rig.status() & 0x0400 != 0);
    assert!((rig.position() - 1800).abs() <= 2, "at {}", rig.position());
}

#[test]
fn homing_begins_by_the_edge_of_bit_4_and_not_by_its_level() {
    let mut rig = Rig::ready();
    let homings = |rig: &Rig| rig.states.iter().filter(|state| **state == State::Homing).count();
    let before = homings(&rig);
    for (word, more) in [(0x1F, 1), (0x1F, 1), (0x0F, 1), (0x1F, 2)] {
        rig.control(word);
        rig.run(50);
        assert_eq!(homings(&rig) - before, more, "{word:#x}");
    }
}

#[test]
fn a_fault_takes_back_what_a_host_had_asked_for() {
    let mut rig = Rig::ready();
    rig.mode(1);
    rig.write(0x2001, 1, &[1]);
    rig.write32(0x607A, 0, 4000);
    rig.control(0x1F);
    rig.until(20_000, |rig| rig.machine.status().state.pulses());
    let mut rig = in_fault(rig);
    assert_eq!(rig.read(0x2001, 1), 0, "erosion is not enabled any more");
    rig.control(0x00);
    rig.control(0x80);
    assert!(is_reset(&mut rig));
    rig.enable();
    // A set point is a position again.
    rig.states.clear();
    rig.move_to(500, 2000);
    assert!((rig.position() - 500).abs() <= 2);
    assert!(!rig.states.iter().any(|state| state.pulses()), "{:?}", rig.states);
}

#[test]
fn a_fault_forgets_the_set_points_that_were_waiting() {
    let mut rig = on_its_way();
    // One waits for the one under way.
    rig.write32(0x607A, 0, 300);
    rig.control(0x0F);
    rig.control(0x1F);
    assert_ne!(rig.status() & 0x1000, 0);
    let mut rig = in_fault(rig);
    rig.control(0x00);
    rig.control(0x80);
    assert!(is_reset(&mut rig));
    rig.enable();
    let at = rig.position();
    rig.run(300);
    assert!((rig.position() - at).abs() <= 2, "from {at} to {}", rig.position());
}

#[test]
fn disable_voltage_opens_the_loop_at_once_from_every_state() {
    for (words, shown) in [(&[0x06][..], 0x21), (&[0x06, 0x07], 0x23), (&[0x06, 0x07, 0x0F], 0x27)] {
        let mut rig = Rig::new(|_, _| {});
        for &word in words {
            rig.control(word);
        }
        rig.until(5, |rig| rig.status() & 0x6F == shown);
        rig.control(0x00);
        assert_eq!((rig.status() & 0x4F, rig.machine.status().state), (0x40, State::Disabled), "from {shown:#x}");
    }
    // While a quick stop brakes, and while it holds.
    for ms in [0, 100] {
        let mut rig = on_its_way();
        rig.control(0x02);
        rig.run(ms);
        assert_eq!(rig.status() & 0x6F, 0x07);
        rig.control(0x00);
        assert_eq!((rig.status() & 0x4F, rig.machine.status().state), (0x40, State::Disabled), "after {ms} ms");
    }
}

#[test]
fn nothing_else_leaves_a_quick_stop_that_stays() {
    let mut rig = on_its_way();
    rig.control(0x02);
    for word in [0x06, 0x07, 0x02] {
        rig.control(word);
        rig.run(20);
        assert_eq!(rig.status() & 0x6F, 0x07, "{word:#x}");
    }
    rig.control(0x0F);
    assert_eq!(rig.status() & 0x6F, 0x27);
}

/// How far a head at 10 mm/s goes on after a controlword, and what the statusword shows when it has come to rest: 50 um by the
/// profile's deceleration, 10 um by the one of a quick stop, and some 20 until it is heard of.
fn stops(option: u16, code: i16, word: u16) -> (i64, u16, State) {
    let mut rig = on_its_way();
    rig.write(option, 0, &code.to_le_bytes());
    let before = rig.position();
    rig.control(word);
    let mut furthest = rig.position();
    for _ in 0..60 {
        rig.step();
        furthest = furthest.max(rig.position());
    }
    let status = rig.status();
    let mask = if status & 0x4F == 0x40 { 0x4F } else { 0x6F };
    (furthest - before, status & mask, rig.machine.status().state)
}

#[test]
fn option_codes_say_by_which_ramp_a_head_stops_and_where_that_leads() {
    let (gentle, hard) = (50..90, 0..45);
    for (option, code, word, length, shown, state) in [
        (0x605A, 1, 0x02, &gentle, 0x40, State::Disabled),
        (0x605A, 2, 0x02, &hard, 0x40, State::Disabled),
        (0x605A, 5, 0x02, &gentle, 0x07, State::Ready),
        (0x605A, 6, 0x02, &hard, 0x07, State::Ready),
        (0x605B, 1, 0x06, &gentle, 0x21, State::Disabled),
        (0x605C, 1, 0x07, &gentle, 0x23, State::Disabled),
        (0x605D, 1, 0x10F, &gentle, 0x27, State::Ready),
        (0x605D, 2, 0x10F, &hard, 0x27, State::Ready),
    ] {
        let (way, status, head) = stops(option, code, word);
        assert!(length.contains(&way), "{option:x}h = {code}: {way} um");
        assert_eq!((status, head), (shown, state), "{option:x}h = {code}");
    }
}

#[test]
fn option_code_0_opens_the_loop_at_once() {
    for (option, word, mask, shown) in
        [(0x605A, 0x02, 0x4F, 0x40), (0x605B, 0x06, 0x6F, 0x21), (0x605C, 0x07, 0x6F, 0x23)]
    {
        let mut rig = on_its_way();
        rig.write(option, 0, &0i16.to_le_bytes());
        rig.control(word);
        assert_eq!((rig.status() & mask, rig.machine.status().state), (shown, State::Disabled), "{option:x}h");
    }
}

#[test]
fn a_quick_stop_that_ends_in_switch_on_disabled_cannot_be_taken_back() {
    for code in [1i16, 2] {
        let mut rig = on_its_way();
        rig.write(0x605A, 0, &code.to_le_bytes());
        rig.write(0x6040, 0, &[0x02, 0]);
        rig.write(0x6040, 0, &[0x0F, 0]);
        assert_eq!(rig.status() & 0x6F, 0x07, "{code}");
        rig.until(60, |rig| rig.status() & 0x4F == 0x40);
        rig.run(20);
        assert_eq!((rig.status() & 0x4F, rig.machine.status().state), (0x40, State::Disabled), "{code}");
    }
}

#[test]
fn a_disable_that_still_brakes_can_be_taken_back() {
    for word in [0x06, 0x07] {
        let mut rig = on_its_way();
        rig.write(0x6040, 0, &[word, 0]);
        rig.write(0x6040, 0, &[0x0F, 0]);
        rig.run(100);
        assert_eq!((rig.status() & 0x6F, rig.machine.status().state), (0x27, State::Ready), "{word:#x}");
    }
}

#[test]
fn every_controlword_leads_from_every_state_where_the_table_of_the_standard_says() {
    const WORDS: [u16; 5] = [0x00, 0x02, 0x06, 0x07, 0x0F];
    for (way, table) in [
        (&[0x00][..], [0x40, 0x40, 0x21, 0x40, 0x40]),
        (&[0x06], [0x40, 0x40, 0x21, 0x23, 0x27]),
        (&[0x06, 0x07], [0x40, 0x40, 0x21, 0x23, 0x27]),
        (&[0x06, 0x07, 0x0F], [0x40, 0x07, 0x21, 0x23, 0x27]),
        (&[0x06, 0x07, 0x0F, 0x02], [0x40, 0x07, 0x07, 0x07, 0x27]),
    ] {
        for (word, shown) in WORDS.into_iter().zip(table) {
            let mut rig = Rig::new(|_, _| {});
            for &word in way.iter().chain(&[word]) {
                rig.control(word);
                rig.run(20);
            }
            let mask = if shown == 0x40 { 0x4F } else { 0x6F };
            assert_eq!(rig.status() & mask, shown, "{word:#x} after {way:x?}");
            let closed = matches!(shown, 0x07 | 0x27);
            assert_eq!(rig.machine.status().state, if closed { State::Ready } else { State::Disabled });
        }
    }
}

/// Milliseconds for which the reaction to a fault shows, at 1800 um and with `change`.
fn reaction_shows(change: impl FnOnce(&mut Settings)) -> u64 {
    let mut rig = Rig::new(|settings, _| change(settings));
    rig.enable();
    rig.mode(1);
    rig.move_to(1800, 1000);
    rig.machine.raise(Fault::HostSilent);
    rig.until(3, |rig| rig.status() & 0x4F == 0x0F);
    let began = rig.ms;
    rig.until(3000, |rig| rig.status() & 0x4F == 0x08);
    rig.ms - began
}

#[test]
fn a_reaction_shows_for_as_long_as_it_moves_the_head_and_long_enough_to_be_seen() {
    let rests = reaction_shows(|settings| settings.retreat_safe = 0.0);
    assert!((19..25).contains(&rests), "{rests} ms at rest");
    // A millimetre at 5 mm/s, and until the loop trembles no more.
    let moves = reaction_shows(|_| {});
    assert!((190..270).contains(&moves), "{moves} ms of moving");
    // 1.7 mm at 1.4 mm/s are 1.2 s.
    let long = reaction_shows(|settings| (settings.retreat_safe, settings.retreat_velocity) = (1700.0, 1400.0));
    assert!((1205..1260).contains(&long), "{long} ms of moving slowly");
}

#[test]
fn a_set_point_before_operation_is_enabled_is_none() {
    let mut rig = Rig::new(|_, _| {});
    rig.mode(1);
    rig.write32(0x607A, 0, 500);
    // With the edge of bit 4 in each state, the last one in that in which operation is enabled.
    for word in [0x10, 0x00, 0x16, 0x06, 0x17, 0x07, 0x1F] {
        rig.control(word);
        assert_eq!(rig.status() & 0x3000, 0, "{word:#x}");
    }
    rig.run(100);
    assert_eq!(rig.status() & 0x6F, 0x27);
    assert_eq!((rig.machine.status().state, rig.read(0x2000, 4)), (State::Ready, 0), "nothing was asked of the head");
}

#[test]
fn bit_4_of_the_statusword_says_whether_the_bus_carries() {
    let mut rig = Rig::new(|_, _| {});
    // 36 V are needed.
    for (volts, shown) in [(48.0, true), (36.1, true), (35.9, false), (0.0, false), (48.0, true)] {
        rig.machine.process.fault_inputs.bus_v = Some(volts);
        rig.run(5);
        assert_eq!(rig.status() & 0x10 != 0, shown, "{volts} V");
    }
}

#[test]
fn a_set_point_while_the_head_brakes_to_be_disabled_is_none() {
    let mut rig = on_its_way();
    rig.write(0x6040, 0, &[0x07, 0]);
    let from = rig.position();
    rig.write(0x6040, 0, &[0x17, 0]);
    assert_eq!(rig.status() & 0x1000, 0);
    rig.until(100, |rig| rig.status() & 0x6F == 0x23);
    assert_eq!(rig.machine.status().state, State::Disabled);
    assert!((rig.position() - from).abs() < 100, "went on by {}", rig.position() - from);
}

#[test]
fn set_points_of_every_mode_wait_for_the_end_of_a_halt_and_for_operation() {
    // Velocity, interpolated, cyclic; bit 4 enables interpolation.
    for (mode, index, sub, value) in [(3, 0x60FF, 0, 5000), (7, 0x60C1, 1, 300), (8, 0x607A, 0, 300)] {
        for (ready, goes_on) in [(0x11F, 0x1F), (0x07, 0x1F)] {
            let mut rig = Rig::ready();
            rig.mode(mode);
            rig.control(ready);
            rig.run(50);
            let at = rig.position();
            rig.write32(index, sub, value);
            rig.run(100);
            assert!((rig.position() - at).abs() <= 1, "mode {mode} after {ready:#x}: at {}", rig.position());
            assert_eq!(rig.read(0x2000, 4), 0, "mode {mode} after {ready:#x}: asked in vain");
            rig.control(goes_on);
            rig.run(100);
            // A cyclic host says it anew in its next cycle; a buffer is empty when operation is enabled.
            let anew = mode == 8 || mode == 7 && ready == 0x07;
            assert_eq!((rig.position() - at).abs() <= 1, anew, "mode {mode} after {ready:#x}");
        }
    }
}
