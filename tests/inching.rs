//! The inch-worm in the closed loop: holes deeper than the stroke, on the process model, carried by a coarse axis with errors.

use edm_servo_head::head::SeenBy;
use edm_servo_head::settings::Settings;
use edm_sim::bore;
use edm_sim::run::{Job, Observer, Outcome, Sample, Setup};

struct Nobody;

impl Observer for Nobody {
    fn sample(&mut self, _: &Sample) {}
}

/// A hole of 0.5 mm by a head with 1 mm of stroke, begun near its end: two moves of 0.15 mm. The axis errs by at most 5 um.
fn short_stroke(seen: SeenBy, seed: u64) -> Outcome {
    let mut setup = Setup::load("default").unwrap();
    setup.set("workpiece.surface_mm=0.75").unwrap();
    setup.head = Settings {
        axis_stroke: 1000.0,
        inch_step: 150.0,
        inch_reserve: 100.0,
        inch_clearance: 50.0,
        inch_tolerance: 20.0,
        inch_seen: seen,
        touch_back: 30.0,
        jump_float: 20.0,
        ..setup.head
    };
    bore::check(&setup).unwrap();
    let job = Job { setup, depth_mm: 0.5, path: None, table: None, seed, surrogate: false, coarse_error_um: 5.0 };
    bore::bore(&job, &mut Nobody, &mut |_| {}).unwrap()
}

#[test]
fn a_hole_deeper_than_the_stroke_ends_at_its_depth_to_two_counts() {
    for (seen, seed) in [(SeenBy::Word, 1), (SeenBy::Touch, 2)] {
        let outcome = short_stroke(seen, seed);
        assert!(outcome.completed, "{seen:?}: {outcome:?}");
        assert!(outcome.inches >= 2, "{seen:?}: {outcome:?}");
        let off_um = 1e3 * (outcome.depth_mm + outcome.wear_mm - 0.5);
        assert!(off_um.abs() <= 2.0, "{seen:?}: {off_um} um, {outcome:?}");
        assert_eq!(outcome.lost_counts, 0);
    }
}
