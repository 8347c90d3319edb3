//! Writes that come too fast, or too late.

use crate::rig::{Host, ID, MS, download, frame, place, setting};
use edm_servo_head::canopen::Abort;
use edm_servo_head::head::{Fault, State};
use edm_servo_head::settings::{Declared, Settings};
use edm_sim::schedule::Habits;

/// A head in operation enabled.
fn enabled(seed: u64) -> Host {
    let mut host = Host::new(|_| {}, seed);
    host.head.set_habits(Habits::PROMPT);
    host.enable();
    // The supervision comes as late as it may: its period.
    host.head.set_habits(Habits { supervise: MS as u32, ..Habits::BUSY });
    host
}

/// Five writes of the time after which a silent host is a fault, without a pause. While the head is enabled it only falls.
fn five_times(host: &mut Host, last: u32) {
    let at = place("supervise.host_ms");
    for ms in [2000, 1000, 500, 250, last] {
        host.ask(setting(at, ms));
    }
}

#[test]
fn the_last_of_five_writes_without_a_pause_is_what_the_supervision_runs() {
    for seed in 0..12 {
        let mut host = enabled(seed);
        five_times(&mut host, 60);
        while host.head.coming() > 0 {
            host.run(1);
        }
        // From now on nothing comes from the host.
        let begin = host.head.periods();
        host.hear();
        assert_eq!(host.answers(), [Ok(0); 5], "seed {seed}");
        while host.head.status().fault.is_none() {
            host.run(1);
            assert!(host.head.periods() - begin < 200 * MS, "seed {seed}: no fault");
        }
        let ms = (host.head.periods() - begin) / MS;
        assert_eq!(host.head.status().fault, Some(Fault::HostSilent), "seed {seed}");
        // The habits make tasks late: 72 ms were the most of a hundred seeds.
        assert!((60..=75).contains(&ms), "seed {seed}: after {ms} ms");
    }
}

#[test]
fn of_five_writes_without_a_pause_the_last_is_refused_if_it_would_end_the_watch_and_the_one_before_holds() {
    for seed in 0..12 {
        let mut host = enabled(seed);
        five_times(&mut host, 0);
        host.hear();
        let refused = Abort::DeviceState as u32;
        assert_eq!(host.answers(), [Ok(0), Ok(0), Ok(0), Ok(0), Err(refused)], "seed {seed}");
        assert_eq!(host.read(0x210A, 8), 250);
        host.run(300 * MS);
        assert_eq!(host.head.status().fault, Some(Fault::HostSilent), "seed {seed}");
    }
}

#[test]
fn as_many_requests_as_can_wait_are_all_answered_in_turn() {
    for seed in 0..20 {
        let mut host = Host::new(|_| {}, seed);
        let at = place("retreat.persistent_ms");
        // One under way and eight behind it; what comes then is refused rather than lost.
        for ms in 100..109 {
            host.ask(setting(at, (ms as f32).to_bits()));
        }
        host.hear();
        assert_eq!(host.answers(), [Ok(0); 9], "seed {seed}");
        let mut known = Settings { commissioned: true, ..Settings::default() };
        host.learn(&mut known, 0..Settings::COUNT);
        assert_eq!(known.word(at), Some(108.0f32.to_bits()));
        host.expect_runs(&known);
    }
}

#[test]
fn a_write_that_the_head_refuses_is_aborted_and_the_dictionary_reads_what_runs() {
    let (mut refused, mut ran) = (0, 0);
    for seed in 0..200 {
        let mut host = Host::new(|_| {}, seed);
        host.head.set_habits(Habits::PROMPT);
        for word in [0x06, 0x07] {
            host.write(0x6040, 0, 2, word);
        }
        host.run(2 * MS);
        host.head.set_habits(Habits::BUSY);
        let mut known = Settings { commissioned: true, ..Settings::default() };
        let at = place("axis.stroke_um");
        let before = known.word(at).unwrap();
        // The loop is ordered closed while the write is on its way, or a little before or after.
        let enable = frame(0x200 + u16::from(ID), &[0x0F, 0]);
        if seed % 2 == 0 {
            host.head.send(&enable);
            host.run(seed % 5);
        }
        host.ask(setting(at, (f32::from_bits(before) * 0.9).to_bits()));
        host.run(seed % 7);
        if seed % 2 == 1 {
            host.head.send(&enable);
        }
        host.hear();
        let answer = host.answers();
        host.run(5 * MS);
        host.learn(&mut known, 0..Settings::COUNT);
        host.expect_runs(&known);
        let [newest, tasks @ ..] = host.generations();
        assert_eq!(tasks, [newest; 3]);
        match answer[..] {
            [Ok(_)] => {
                ran += 1;
                assert_ne!(known.word(at), Some(before), "seed {seed}");
            }
            [Err(abort)] => {
                refused += 1;
                assert_eq!(abort, Abort::DeviceState.code(), "seed {seed}");
                assert_eq!(known.word(at), Some(before), "seed {seed}");
            }
            _ => panic!("seed {seed}: {answer:?}"),
        }
    }
    assert!(refused > 20 && ran > 20, "{refused} refused, {ran} ran");
}

#[test]
fn a_setting_that_only_the_planner_can_refuse_is_aborted_and_every_task_runs_what_it_ran() {
    for seed in 0..12 {
        let mut host = enabled(seed);
        // A line beside the head, which no other structure than the path can go along.
        for (sub, size, value) in [(1, 4, 10_000), (2, 4, 1_000_000), (3, 4, 0), (6, 1, 0), (7, 1, 1), (8, 1, 1)] {
            host.write(0x200E, sub, size, value);
        }
        host.run(5 * MS);
        assert_eq!(host.read(0x200E, 9), 0, "the head has taken it");
        let at = place("feed.structure");
        assert_eq!(host.exchange(setting(at, 1)), Err(Abort::DeviceState.code()), "seed {seed}");
        let mut known = Settings { commissioned: true, ..Settings::default() };
        host.learn(&mut known, 0..Settings::COUNT);
        assert_eq!(known.word(at), Some(2), "seed {seed}");
        host.expect_runs(&known);
        let [newest, tasks @ ..] = host.generations();
        assert_eq!(tasks, [newest; 3], "seed {seed}");
        // What it does not refuse goes on.
        host.exchange(setting(place("retreat.persistent_ms"), 123.0f32.to_bits())).unwrap();
    }
}

#[test]
fn settings_of_a_reset_wait_until_the_head_is_disabled_and_show_that() {
    // Another stroke than the one that a reset brings back, then a fault that lasts.
    let mut host = Host::new(|_| {}, 1);
    let mut known = Settings { commissioned: true, ..Settings::default() };
    let at = place("axis.stroke_um");
    let other = f32::from_bits(known.word(at).unwrap()) * 0.9;
    host.exchange(setting(at, other.to_bits())).unwrap();
    host.enable();
    host.head.process().fault_inputs.safety.bridge_fault = true;
    host.run(5 * MS);
    assert_eq!(host.head.status().state, State::Fault);
    host.reset(129);
    let [newest, servo, ..] = host.generations();
    assert_eq!(newest, servo + 1, "on its way");
    assert_eq!(host.exchange(download(0x210A, 8, 4, 70)), Err(Abort::DeviceState.code()));
    host.head.process().fault_inputs.safety.bridge_fault = false;
    host.run(2 * MS);
    host.write(0x6040, 0, 2, 0x80);
    host.run(5 * MS);
    assert_eq!(host.head.status().state, State::Disabled);
    let [newest, tasks @ ..] = host.generations();
    assert_eq!(tasks, [newest; 3]);
    host.learn(&mut known, 0..Settings::COUNT);
    host.expect_runs(&known);
    assert_ne!(known.word(at), Some(other.to_bits()));
}

#[test]
fn a_write_that_is_overtaken_by_a_reset_leaves_nothing_behind() {
    for seed in 0..100 {
        let mut host = Host::new(|_| {}, seed);
        let at = place("axis.stroke_um");
        host.exchange(setting(at, 11_000.0f32.to_bits())).unwrap();
        host.head.set_habits(Habits::PROMPT);
        host.enable();
        host.head.process().fault_inputs.safety.bridge_fault = true;
        host.run(5 * MS);
        host.head.set_habits(Habits { supervise: 40, idle: 0, ..Habits::BUSY });
        host.ask(setting(place("supervise.host_ms"), 70));
        host.reset(129);
        // The head refuses another stroke until its fault is over.
        host.head.process().fault_inputs.safety.bridge_fault = false;
        host.run(2 * MS);
        host.write(0x6040, 0, 2, 0x80);
        host.run(5 * MS);
        let mut known = Settings::default();
        host.learn(&mut known, 0..Settings::COUNT);
        assert_eq!(known.axis_stroke, 12_000.0, "seed {seed}");
        assert_eq!(known.host_ms, 0, "seed {seed}");
        host.expect_runs(&known);
    }
}

#[test]
fn what_the_commissioning_has_found_holds_whatever_is_written_meanwhile() {
    let mut found = 0;
    for seed in 0..20 {
        let mut host = Host::new(|_| {}, seed);
        host.write(0x2001, 3, 1, 1);
        let mut ended = false;
        for n in 0.. {
            let answer = host.exchange(setting(place("retreat.persistent_ms"), (500.0 + (n % 9) as f32).to_bits()));
            // For the millisecond in which every task is told what the check has found.
            found += u32::from(answer == Err(Abort::DeviceState.code()));
            assert!(answer.is_ok() || answer == Err(Abort::DeviceState.code()), "{answer:x?}");
            if host.head.status().state != State::Commissioning {
                if ended {
                    break;
                }
                ended = true;
            }
            assert!(n < 20_000, "seed {seed}: the check does not end");
        }
        host.run(5 * MS);
        assert_eq!(host.head.status().fault, None, "seed {seed}");
        let mut known = Settings::default();
        host.learn(&mut known, 0..Settings::COUNT);
        host.expect_runs(&known);
        assert_eq!(host.read(0x2001, 4) & 0xFF == 1, known.commissioned, "seed {seed}");
    }
    assert!(found > 0, "no write was on its way when the check ended");
}
