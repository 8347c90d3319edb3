//! RM0090 §32, driven as a driver would.

use super::*;
use crate::soc::tests::Bench;

/// 1 Mbit/s at 42 MHz: prescaler 3, 1 + 11 + 2 quanta.
const BTR: u32 = 10 << 16 | 1 << 20 | 2;

fn can() -> Can {
    let mut c = Can::new();
    (c.clock, c.connected) = (4, true);
    c
}

fn started(btr: u32, mcr: u32) -> (Can, Bench) {
    let (mut c, mut w) = (can(), Bench::default());
    c.write(0, mcr | mcr::INRQ, 0).unwrap();
    c.fire(10, &mut w);
    c.write(0x1c, btr, 10).unwrap();
    c.write(0x200, 0x2a1c_0e01, 10).unwrap();
    c.write(0x20c, 1, 10).unwrap();
    c.write(0x21c, 1, 10).unwrap();
    c.write(0x200, 0x2a1c_0e00, 10).unwrap();
    c.write(0, mcr, 10).unwrap();
    let t = c.due();
    c.fire(t, &mut w);
    (c, w)
}

fn send(c: &mut Can, mailbox: u32, id: u32, at: u64) {
    let base = 0x180 + 16 * mailbox;
    c.write(base + 4, 2, at).unwrap();
    c.write(base + 8, 0xbbaa, at).unwrap();
    c.write(base, id << 21 | 1, at).unwrap();
}

#[test]
fn reset_state_is_sleep_and_registers_read_their_reset_values() {
    let c = can();
    let read = |o| c.read(o, 0).unwrap();
    assert_eq!((read(0), read(4), read(8), read(0x200)), (0x1_0002, 0xc02, 0x1c00_0000, 0x2a1c_0e01));
}

#[test]
fn a_mode_is_acknowledged_later_than_asked_for() {
    let (mut c, mut w) = (can(), Bench::default());
    c.write(0, mcr::INRQ, 0).unwrap();
    assert_eq!(c.read(4, 0).unwrap() & 3, 2);
    c.fire(c.due(), &mut w);
    assert_eq!(c.read(4, 10).unwrap() & 3, 1);
    c.write(0x1c, BTR, 10).unwrap();
    c.write(0, 0, 100).unwrap();
    c.write(0, 0, 500).unwrap(); // asking again does not delay it
    assert_eq!(c.due(), 100 + 11 * 168);
}

#[test]
fn bit_timing_is_writable_in_initialisation_only_and_gives_the_rate() {
    let (mut c, _) = started(BTR, 0);
    assert_eq!(c.bit(), 168);
    assert_eq!(c.sample_point(), 857);
    assert!(c.write(0x1c, 0, 0).is_err());
}

#[test]
fn a_frame_arrives_after_its_bits_and_frees_its_mailbox() {
    let (mut c, mut w) = started(BTR, 0);
    send(&mut c, 0, 0x123, 10_000);
    assert_eq!(c.read(8, 10_000).unwrap() >> 26 & 7, 0b110);
    let expected = Frame::new(0x123, &[0xaa, 0xbb]);
    assert_eq!(c.due(), 10_000 + expected.bits() * 168);
    c.fire(c.due(), &mut w);
    assert_eq!(w.frames, [expected]);
    assert_eq!(c.read(8, 0).unwrap() & 0xf, 3);
    c.write(8, 1, 0).unwrap();
    assert_eq!(c.read(8, 0).unwrap(), 0x1c00_0000);
}

#[test]
fn mailboxes_go_out_by_identifier_or_by_request() {
    for (mode, order) in [(0, [0x300, 0x100, 0x200]), (mcr::TXFP, [0x300, 0x200, 0x100])] {
        let (mut c, mut w) = started(BTR, mode);
        send(&mut c, 0, 0x300, 0);
        send(&mut c, 1, 0x200, 0);
        send(&mut c, 2, 0x100, 0);
        for _ in 0..3 {
            let t = c.due();
            c.fire(t, &mut w);
        }
        assert_eq!(w.frames.iter().map(|f| f.id).collect::<Vec<_>>(), order);
    }
}

#[test]
fn without_acknowledge_a_node_turns_passive_but_never_bus_off() {
    let (mut c, mut w) = started(BTR, 0);
    w.reply = Some(CanReply::NoAcknowledge);
    send(&mut c, 0, 1, 0);
    for _ in 0..100 {
        let t = c.due();
        c.fire(t, &mut w);
    }
    assert_eq!(c.read(0x18, 0).unwrap() & 0xff_0077, 128 << 16 | 3 << 4 | 3);
}

#[test]
fn thirty_two_bit_errors_are_bus_off_and_recovery_takes_128_times_11_bits() {
    for abom in [true, false] {
        let (mut c, mut w) = started(BTR, if abom { mcr::ABOM } else { 0 });
        w.reply = Some(CanReply::BitError);
        send(&mut c, 0, 1, 0);
        let mut t = 0;
        for n in 1..=32 {
            t = c.due();
            c.fire(t, &mut w);
            assert_eq!(c.read(0x18, 0).unwrap() >> 2 & 1, u32::from(n == 32), "{n}");
        }
        assert_eq!(c.due(), if abom { t + 128 * 11 * 168 } else { NEVER });
    }
}

#[test]
fn error_interrupt_needs_its_own_and_the_common_enable() {
    for (ier, fires) in [(1 << 10 | 1 << 15, true), (1 << 10, false), (1 << 15, false)] {
        let (mut c, mut w) = started(BTR, 0);
        c.write(0x14, ier, 0).unwrap();
        w.reply = Some(CanReply::BitError);
        send(&mut c, 0, 1, 0);
        for _ in 0..32 {
            let t = c.due();
            c.fire(t, &mut w);
        }
        assert_eq!(c.requests()[3], fires);
    }
}

#[test]
fn single_shot_gives_up_after_one_failure() {
    let (mut c, mut w) = started(BTR, mcr::NART);
    w.reply = Some(CanReply::NoAcknowledge);
    send(&mut c, 0, 1, 0);
    c.fire(c.due(), &mut w);
    assert_eq!(c.read(8, 0).unwrap() & 0xf, 0b1001);
    assert_eq!(c.due(), NEVER);
}

#[test]
fn a_fourth_message_overruns_and_replaces_the_third_or_is_lost() {
    for (mode, last) in [(0, 4), (mcr::RFLM, 3)] {
        let (mut c, _) = started(BTR, mode);
        c.write(0x14, 1 << 3, 0).unwrap();
        for id in 1..=4 {
            assert!(!c.requests()[1]);
            c.bus_frame(Frame::new(id, &[]));
        }
        assert!(c.requests()[1]);
        assert_eq!(c.read(0x0c, 0).unwrap(), 3 | 8 | 16);
        for id in [1, 2, last] {
            assert_eq!(c.read(0x1b0, 0).unwrap() >> 21, id);
            c.write(0x0c, 32 | 8 | 16, 0).unwrap();
        }
        assert_eq!(c.read(0x0c, 0).unwrap(), 0);
    }
}

#[test]
fn loop_back_receives_its_own_frame_and_not_the_bus() {
    let (mut c, mut w) = started(BTR | 1 << 30, 0);
    c.bus_frame(Frame::new(7, &[]));
    assert_eq!(c.read(0x0c, 0).unwrap() & 3, 0);
    w.reply = Some(CanReply::NoAcknowledge);
    send(&mut c, 0, 0x42, 0);
    c.fire(c.due(), &mut w);
    assert_eq!(c.read(0x0c, 0).unwrap() & 3, 1);
    assert_eq!(c.read(0x1b8, 0).unwrap(), 0xbbaa);
}

#[test]
fn a_pending_mailbox_can_be_aborted_the_one_on_the_bus_cannot() {
    let (mut c, _) = started(BTR, 0);
    send(&mut c, 0, 1, 0);
    send(&mut c, 1, 2, 0);
    c.write(8, 1 << 7 | 1 << 15, 0).unwrap();
    assert_eq!(c.read(8, 0).unwrap() & 0xf0f, 0x100);
    assert_eq!(c.read(8, 0).unwrap() >> 26 & 7, 0b110);
}
