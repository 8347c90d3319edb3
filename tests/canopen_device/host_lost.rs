//! What the loss of the host does, as 6007h has it (docs/canopen.md has this as a table).

use crate::rig::{ID, Rig};
use edm_servo_head::head::{Fault, State};

/// A way to lose the host.
type Loss = (&'static str, fn(&mut Rig));

const LOSSES: [Loss; 6] = [
    ("pre-operational", |rig| rig.send(0, &[128, ID])),
    ("stopped", |rig| rig.send(0, &[2, ID])),
    ("reset of communication", |rig| rig.send(0, &[130, ID])),
    ("heartbeat", |rig| {
        rig.write32(0x1016, 1, 0x64 << 16 | 20);
        rig.send(0x764, &[5]);
        rig.run(40);
    }),
    ("SYNC", |rig| {
        rig.write32(0x1006, 0, 10_000);
        rig.send(0x80, &[]);
        rig.run(40);
    }),
    ("RPDO", |rig| {
        rig.write32(0x1400, 1, (1 << 31) | (0x200 + i32::from(ID)));
        rig.write(0x1400, 5, &20u16.to_le_bytes());
        rig.write32(0x1400, 1, 0x200 + i32::from(ID));
        rig.send(0x200 + u16::from(ID), &[0x0F, 0]);
        rig.run(40);
    }),
];

fn holding() -> Rig {
    Rig::ready()
}

fn eroding() -> Rig {
    let mut rig = Rig::ready();
    rig.write32(0x2004, 1, 4000);
    rig.write(0x2001, 1, &[1]);
    rig.until(20_000, |rig| rig.machine.status().state == State::Eroding);
    rig
}

#[test]
fn each_loss_of_the_host_does_what_6007h_says() {
    for (name, begin) in [("holding", holding as fn() -> Rig), ("eroding", eroding)] {
        for (what, lose) in LOSSES {
            for option in 0..=3 {
                let mut rig = begin();
                let context = format!("{what} while {name}, 6007h {option}");
                if option == 0 {
                    assert_eq!(rig.try_write(0x6007, 0, &[0, 0]), Err(0x0800_0022), "{context}: nobody would watch");
                    continue;
                }
                rig.write(0x6007, 0, &[option, 0]);
                lose(&mut rig);
                rig.run(5);
                let status = *rig.machine.status();
                match option {
                    1 => assert_eq!((status.state, status.fault), (State::Fault, Some(Fault::HostSilent)), "{context}"),
                    2 => assert_eq!((status.state, status.fault), (State::Disabled, None), "{context}"),
                    _ => {
                        assert!(!status.state.pulses() && status.state.follows(), "{context}: {:?}", status.state);
                        assert_eq!(status.fault, None, "{context}");
                    }
                }
            }
        }
    }
}

#[test]
fn a_head_that_was_told_so_before_goes_on_alone() {
    for (what, lose) in LOSSES {
        let mut rig = Rig::new(|_, _| {});
        rig.write(0x6007, 0, &[0, 0]);
        rig.send(0, &[1, ID]);
        rig.enable();
        lose(&mut rig);
        rig.run(5);
        assert_eq!(rig.machine.status().state, State::Ready, "{what}");
    }
}

#[test]
fn who_never_was_operational_commands_by_sdo_alone() {
    let mut rig = Rig::new(|_, _| {});
    rig.send(0, &[128, ID]);
    for word in [6u8, 7, 15] {
        rig.write(0x6040, 0, &[word, 0]);
        rig.run(30);
    }
    assert_eq!(rig.machine.status().state, State::Ready);
    rig.send(0, &[128, ID]);
    rig.run(50);
    assert_eq!(rig.machine.status().state, State::Ready);
}

#[test]
fn a_host_that_is_lost_while_the_head_is_being_enabled_leaves_it_open() {
    let mut closed = vec![];
    for option in 1..=3 {
        for after in 0..3 {
            let mut rig = Rig::new(|_, _| {});
            rig.send(0, &[1, ID]);
            rig.write(0x6007, 0, &[option, 0]);
            rig.control(0x06);
            rig.control(0x07);
            rig.send(0x200 + u16::from(ID), &[0x0F, 0]);
            rig.run(after);
            rig.send(0, &[128, ID]);
            rig.run(300);
            let state = rig.machine.status().state;
            // Enabled in time to stop quickly, which by 605Ah ends in holding.
            let stopped = option == 3 && rig.status() & 0x6F == 0x07;
            if state.follows() && !stopped {
                closed.push((option, after, state));
            }
        }
    }
    assert!(closed.is_empty(), "6007h, ms since enabling, state: {closed:?}");
}

#[test]
fn a_head_that_loses_its_node_id_is_not_left_enabled() {
    let mut enabled = vec![];
    for option in 0..=3 {
        for begin in [holding as fn() -> Rig, eroding] {
            let mut rig = begin();
            let _ = rig.try_write(0x605A, 0, &[6, 0]);
            if option == 0 {
                rig.control(0);
                rig.write(0x6007, 0, &[0, 0]);
                rig.enable();
            } else {
                rig.write(0x6007, 0, &[option, 0]);
            }
            rig.send(0x7E5, &[4, 1, 0, 0, 0, 0, 0, 0]);
            rig.send(0x7E5, &[0x11, 255, 0, 0, 0, 0, 0, 0]);
            rig.send(0, &[130, ID]);
            rig.run(1500);
            assert_eq!(rig.node.bus().node, None);
            let state = rig.machine.status().state;
            if state.follows() {
                enabled.push((option, state));
            }
        }
    }
    assert!(enabled.is_empty(), "6007h and state of heads that nobody can reach: {enabled:?}");
}

#[test]
fn whatever_the_head_does_it_comes_to_rest_without_pulses() {
    type Begin = (&'static str, fn(&mut Rig));
    let begins: [Begin; 4] = [
        ("homing", |rig| {
            rig.write(0x6098, 0, &[17]);
            rig.mode(6);
            rig.control(0x1F);
        }),
        ("velocity", |rig| {
            rig.mode(3);
            rig.write32(0x60FF, 0, 2000);
        }),
        ("position", |rig| {
            rig.mode(1);
            rig.write32(0x607A, 0, 20_000);
            rig.control(0x1F);
        }),
        ("guiding", |rig| {
            rig.mode(8);
            rig.write(0x2001, 1, &[2]);
        }),
    ];
    for (what, begin) in begins {
        for (how, lose) in LOSSES {
            for option in 1..=3 {
                let mut rig = Rig::ready();
                rig.write(0x6007, 0, &[option, 0]);
                begin(&mut rig);
                rig.run(10);
                let state = rig.machine.status().state;
                assert!(!matches!(state, State::Ready | State::HoldingPosition), "{what}: {state:?}");
                lose(&mut rig);
                rig.run(1500);
                let before = *rig.machine.status();
                rig.run(100);
                let status = *rig.machine.status();
                let context = format!("{what}, {how}, 6007h {option}: {:?}", status.state);
                assert!(!status.state.pulses(), "{context}");
                assert!((status.position - before.position).abs() <= 2, "{context}");
            }
        }
    }
}

/// In the guided check, for so many ms.
fn checking(ms: u64) -> Rig {
    let mut rig = Rig::new(|_, _| {});
    rig.send(0, &[1, ID]);
    rig.write(0x2001, 3, &[1]);
    rig.run(ms);
    rig
}

#[test]
fn a_guided_check_ends_with_the_host_that_asked_for_it() {
    for (what, lose) in LOSSES {
        for ms in [1, 30, 400] {
            let mut rig = checking(ms);
            let state = rig.machine.status().state;
            assert!(matches!(state, State::Proving | State::Commissioning), "{what}: {state:?} after {ms} ms");
            lose(&mut rig);
            rig.run(5);
            assert_eq!((rig.machine.status().state, rig.machine.status().fault), (State::Disabled, None), "{what}");
        }
    }
}

#[test]
fn a_guided_check_can_be_ended() {
    let ways: [Loss; 5] = [
        ("2001h:3 = 0", |rig| rig.write(0x2001, 3, &[0])),
        ("2001h:2 = 1", |rig| rig.write(0x2001, 2, &[1])),
        ("disable voltage", |rig| {
            rig.control(6);
            rig.control(0);
        }),
        ("quick stop", |rig| {
            rig.control(6);
            rig.control(2);
        }),
        ("quick stop from switched on", |rig| {
            rig.control(6);
            rig.control(7);
            rig.control(3);
        }),
    ];
    for (what, end) in ways {
        for ms in [1, 30, 400] {
            let mut rig = checking(ms);
            end(&mut rig);
            rig.run(5);
            assert_eq!((rig.machine.status().state, rig.machine.status().fault), (State::Disabled, None), "{what}");
            assert_eq!(rig.read(0x2001, 4), 0, "{what}: no result");
        }
    }
    // A controlword that comes again and again says nothing new.
    let mut rig = checking(30);
    rig.control(0);
    rig.run(5);
    assert_eq!(rig.machine.status().state, State::Commissioning);
}
