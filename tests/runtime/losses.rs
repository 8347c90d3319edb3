//! What is lost is counted, shown and told, and nothing else breaks.

use crate::rig::{Host, ID, MS, place, setting};
use edm_servo_head::canopen::Abort;
use edm_servo_head::head::{Fault, State};
use edm_servo_head::settings::{Declared, Settings};
use edm_sim::schedule::Habits;

/// The protocol gets no turn for long, whatever comes.
const STARVED: Habits = Habits { protocol: 20_000, ..Habits::BUSY };

/// After a flood: the counts agree, the emergency of this code came, and a write is answered and runs.
fn recovers(host: &mut Host, code: u16) -> [u32; 2] {
    host.head.set_habits(Habits::BUSY);
    for _ in 0..1010 {
        host.run(MS);
        host.head.protocol_reports();
    }
    host.asked = host.answered;
    let lost = host.expect_counted();
    assert!(host.emergencies.contains(&code), "{:x?}", host.emergencies);
    host.head.set_habits(Habits::BUSY);
    let at = place("retreat.persistent_ms");
    host.exchange(setting(at, 123.0f32.to_bits())).unwrap();
    let mut known = Settings { commissioned: true, ..Settings::default() };
    host.learn(&mut known, 0..Settings::COUNT);
    assert_eq!(known.word(at), Some(123.0f32.to_bits()));
    host.expect_runs(&known);
    lost
}

#[test]
fn frames_beyond_what_the_protocol_can_keep_are_counted_and_an_emergency() {
    for seed in 0..10 {
        let mut host = Host::new(|_| {}, seed);
        host.head.set_habits(STARVED);
        for word in 0..400u16 {
            host.send(0x200 + u16::from(ID), &(word % 16).to_le_bytes());
        }
        while host.head.coming() > 0 {
            host.run(MS);
        }
        let [frames, _] = recovers(&mut host, 0x8110);
        assert!(frames > 100, "seed {seed}: {frames} frames lost");
    }
}

#[test]
fn frames_that_the_controller_had_to_drop_are_counted_and_an_emergency() {
    for seed in 0..10 {
        let mut host = Host::new(|_| {}, seed);
        host.head.set_habits(Habits { can: 60, ..Habits::BUSY });
        for n in 0..200u16 {
            host.send(0x200 + u16::from(ID), &(n % 16).to_le_bytes());
        }
        while host.head.coming() > 0 {
            host.run(MS);
        }
        let [frames, _] = recovers(&mut host, 0x8110);
        assert!(frames > 5, "seed {seed}: {frames} overruns");
    }
}

#[test]
fn changes_of_state_beyond_what_the_protocol_can_keep_are_counted_and_an_emergency() {
    for seed in 0..10 {
        let mut host = Host::new(|_| {}, seed);
        host.head.set_habits(Habits::PROMPT);
        host.enable();
        // Homed where it is, and a millimetre down: there is room for retreats.
        for (mode, method, target) in [(6, 35, 0), (1, 35, 1000)] {
            host.write(0x6060, 0, 1, mode);
            host.write(0x6098, 0, 1, method);
            host.write(0x607A, 0, 4, target);
            host.write(0x6040, 0, 2, 0x1F);
            host.run(1000 * MS);
            host.write(0x6040, 0, 2, 0x0F);
        }
        assert_eq!((host.head.status().state, host.head.status().position), (State::Ready, 1000));
        // The host keeps the path: each short is a retreat and its end.
        host.write(0x2001, 1, 1, 2);
        host.run(200 * MS);
        assert_eq!(host.head.status().state, State::Guiding);
        host.head.set_habits(STARVED);
        for _ in 0..60 {
            host.head.process().fault_inputs.short = true;
            host.run(3 * MS);
            host.head.process().fault_inputs.short = false;
            host.run(12 * MS);
            // A protocol that late ends the head by its watchdog, and by its live signal; here it is to be seen what else it
            // does.
            host.head.protocol_reports();
        }
        assert!(host.head.status().state.pulses(), "{:?}", host.head.status());
        let [frames, events] = recovers(&mut host, 0x6100);
        assert_eq!(frames, 0);
        assert!(events > 10, "seed {seed}: {events} events lost");
        assert_eq!(host.head.status().fault, None);
    }
}

#[test]
fn requests_beyond_those_that_can_wait_are_refused_and_not_lost() {
    for seed in 0..10 {
        let mut host = Host::new(|_| {}, seed);
        let at = place("retreat.persistent_ms");
        for n in 0..30 {
            host.ask(setting(at, (100.0 + n as f32).to_bits()));
        }
        host.hear();
        let answers = host.answers();
        assert_eq!(answers.len(), 30);
        let refused = answers.iter().filter(|answer| **answer == Err(Abort::OutOfMemory.code())).count();
        let done = answers.iter().filter(|answer| answer.is_ok()).count();
        assert_eq!(refused + done, 30, "{answers:x?}");
    }
}

#[test]
fn servo_ticks_and_blocks_that_do_not_come_are_counted_and_an_emergency() {
    for seed in 0..5 {
        let mut host = Host::new(|_| {}, seed);
        host.head.set_habits(Habits::PROMPT);
        host.enable();
        assert_eq!(host.read_all(&[(0x200D, 3), (0x200D, 4)]), [0, 0]);
        host.head.lose(1, 0);
        host.run(3 * MS);
        assert_eq!(host.read_all(&[(0x200D, 3), (0x200D, 4)]), [1, 0]);
        host.hear();
        assert!(host.emergencies.contains(&0x6100), "{:x?}", host.emergencies);
        assert_eq!(host.head.status().fault, None, "one is no fault");
        host.head.lose(0, 3);
        host.run(3 * MS);
        assert_eq!(host.read_all(&[(0x200D, 3), (0x200D, 4)]), [1, 3]);
        host.head.lose(3, 0);
        host.run(3 * MS);
        assert_eq!(host.head.status().fault, Some(Fault::ClockLost));
        assert_eq!(host.read_all(&[(0x200D, 3), (0x200D, 4)]), [4, 3]);
    }
}
