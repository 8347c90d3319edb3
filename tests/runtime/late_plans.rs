//! A plan task that does not keep up with the servo tick.

use crate::rig::{Host, MS};
use edm_hal_shim::bridge::Drive;
use edm_servo_head::head::{Fault, State};
use edm_sim::schedule::Habits;

#[test]
fn plans_that_stay_late_for_a_millisecond_coast_the_head_and_are_named() {
    for seed in 0..10 {
        let mut host = Host::new(|_| {}, seed);
        host.head.set_habits(Habits::PROMPT);
        host.enable();
        host.run(10 * MS);
        assert_eq!((host.head.status().state, host.head.status().late_plans), (State::Ready, 0));
        host.head.set_habits(Habits { plan: 4000, late_plans: true, ..Habits::PROMPT });
        // Whether the planner has run since or not, the follower coasts by itself.
        for _ in 0..1000 {
            host.run(MS);
            if host.head.drive() == Drive::Coast {
                break;
            }
        }
        assert_eq!(host.head.drive(), Drive::Coast, "seed {seed}");
        host.head.set_habits(Habits::PROMPT);
        host.run(5000);
        let status = host.head.status();
        assert_eq!((status.state, status.fault), (State::Fault, Some(Fault::PlanLate)), "seed {seed}");
        assert!(status.late_plans >= 4, "{} late", status.late_plans);
        assert_eq!(host.head.drive(), Drive::Coast);
        host.hear();
        assert!(host.emergencies.contains(&0xFF07), "{:x?}", host.emergencies);
    }
}
