//! Holes by a technology table, on a head that is commanded over its bus; everything is simulated, a count is 1 um.

use edm_servo_head::settings::{Declared, Value};
use edm_sim::bore::table;
use edm_sim::commanded::bore;
use edm_sim::run::{Job, Observer, Outcome, Sample, Setup};
use edm_technology::File;

const THREE: &str = r#"
electrode = "copper"
work = "steel"
[[row]]
name = "rough"
leaves_um = 16
generator.on_us = 160
generator.off_us = 40
generator.current_a = 4
settings.gap.setpoint_v = 65
[[row]]
name = "medium"
leaves_um = 6
generator.on_us = 60
generator.off_us = 20
generator.current_a = 3
settings.gap.setpoint_v = 60
settings.feed.law = "two_thresholds"
[[row]]
name = "fine"
generator.on_us = 20
generator.off_us = 10
generator.current_a = 1.5
settings.end.spark_out_ms = 300
"#;

/// Largest step of the demanded position from one tick to the next, um.
#[derive(Default)]
struct Steps {
    before: Option<f64>,
    largest: f64,
}

impl Observer for Steps {
    fn sample(&mut self, sample: &Sample) {
        // Commands pass ticks that are not seen: those of the start.
        if ["seeking", "eroding", "retreating", "done"].contains(&sample.state) {
            if let Some(before) = self.before {
                self.largest = self.largest.max((sample.setpoint_um - before).abs());
            }
            self.before = Some(sample.setpoint_um);
        }
    }
}

fn run(rows: &str, depth_mm: f64, seed: u64) -> (Outcome, Steps) {
    let mut setup = Setup::load("default").unwrap();
    setup.process.set("workpiece.surface_mm", Value::Number(0.3)).unwrap();
    let rows = table(&setup, depth_mm, File::parse(rows).unwrap()).unwrap();
    let job = Job { setup, depth_mm, path: None, table: Some(rows), seed, surrogate: false, coarse_error_um: 0.0 };
    let mut steps = Steps::default();
    let outcome = bore(&job, &mut steps, &mut |_| {}).unwrap();
    (outcome, steps)
}

#[test]
fn every_row_ends_at_its_depth_and_the_fine_one_leaves_smaller_craters_in_a_narrower_gap() {
    for seed in [1, 2, 3] {
        let (outcome, steps) = run(THREE, 0.03, seed);
        assert!(outcome.completed && outcome.faults.is_empty(), "seed {seed}: {outcome:?}");
        let names: Vec<&str> = outcome.rows.iter().map(|row| row.name.as_str()).collect();
        assert_eq!(names, ["rough", "medium", "fine"]);
        assert!(outcome.rows.iter().all(|row| row.off_counts.abs() <= 2), "seed {seed}: {:?}", outcome.rows);
        let [rough, _, fine] = &outcome.rows[..] else { panic!() };
        let gap_um = 1000.0 * (outcome.hole_depth_mm - outcome.depth_mm);
        assert!(gap_um < rough.gap_um - 5.0, "seed {seed}: {gap_um} um: {:?}", outcome.rows);
        assert!(fine.crater_um < 0.7 * rough.crater_um, "seed {seed}: {:?}", outcome.rows);
        // A tick at the velocity of a retreat, and the rounding of a position.
        assert!(steps.largest <= 5000.0 / 20_000.0 + 0.05, "seed {seed}: a step of {} um", steps.largest);
    }
}

#[test]
fn a_table_that_does_not_go_with_the_hole_or_the_head_is_refused_before_anything_moves() {
    let mut setup = Setup::load("default").unwrap();
    let rows = || File::parse(THREE).unwrap();
    let why = table(&setup, 0.01, rows()).unwrap_err();
    assert!(why.contains("leaves 16 um in its first row"), "{why}");
    setup.head.set("gap.open_min_v", Value::Number(62.0)).unwrap();
    setup.head.set("gap.setpoint_v", Value::Number(50.0)).unwrap();
    let why = table(&setup, 0.03, rows()).unwrap_err();
    assert!(why.starts_with("line 4: row \"rough\": gap.setpoint_v must be below gap.open_min_v"), "{why}");
}
