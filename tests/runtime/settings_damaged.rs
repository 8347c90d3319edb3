//! Settings that change by themselves in the memory of a task, and registers of the chip.

use crate::rig::{Host, MS};
use edm_hal_shim::bridge::Drive;
use edm_servo_head::head::{Fault, State};
use edm_sim::schedule::{Habits, Scheduler};

#[test]
fn a_task_whose_settings_have_changed_stops_the_head_and_no_reset_starts_it_again() {
    stops_for_good(Scheduler::damage_gap_settings);
}

#[test]
fn so_does_a_register_that_has_changed() {
    stops_for_good(Scheduler::change_register);
}

fn stops_for_good(damage: fn(&Scheduler)) {
    for seed in 0..5 {
        let mut host = Host::new(|_| {}, seed);
        host.head.set_habits(Habits::PROMPT);
        host.enable();
        host.run(100 * MS);
        assert_eq!((host.head.status().state, host.head.status().fault), (State::Ready, None));
        damage(&host.head);
        host.run(3 * MS);
        for _ in 0..2 {
            let status = host.head.status();
            assert_eq!((status.state, status.fault), (State::Fault, Some(Fault::SettingsDamaged)), "seed {seed}");
            assert_eq!(host.head.drive(), Drive::Coast);
            host.run(20 * MS);
            host.hear();
            assert!(host.emergencies.contains(&0xFF0E), "{:x?}", host.emergencies);
            host.emergencies.clear();
            host.write(0x6040, 0, 2, 0x80);
            host.run(20 * MS);
            host.write(0x6040, 0, 2, 0x00);
        }
    }
}
