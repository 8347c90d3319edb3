//! The hole that the firmware bores on the chip, beside the one that the native core bores.

use crate::common;
use edm_fil::image::Image;
use edm_sim::bore::{self, Setup};
use edm_sim::run::{Job, Observer, Outcome, Sample};

/// Means while eroding.
#[derive(Default, Debug, PartialEq)]
struct Means {
    ticks: f64,
    volts: f64,
    gap: f64,
}

impl Observer for Means {
    fn sample(&mut self, sample: &Sample) {
        if sample.state == "eroding" {
            self.ticks += 1.0;
            self.volts += (f64::from(sample.filtered_v) - self.volts) / self.ticks;
            self.gap += (sample.gap_um - self.gap) / self.ticks;
        }
    }
}

fn job(depth_mm: f64) -> Job {
    let mut setup = Setup::load("default").unwrap();
    // A short way to the work.
    setup.set("workpiece.surface_mm=0.3").unwrap();
    Job { setup, depth_mm, path: None, seed: 1, surrogate: false, coarse_error_um: 0.0 }
}

fn chip(depth_mm: f64) -> (Outcome, Means) {
    let image = Image::parse(common::firmware().to_vec()).unwrap();
    let mut means = Means::default();
    let outcome = edm_fil::rig::bore(&image, false, false, &job(depth_mm), &mut means, &mut |_| {}).unwrap();
    (outcome, means)
}

#[test]
fn the_chip_bores_the_hole_of_the_native_core_within_the_stated_statistics() {
    let (there, chip_means) = chip(0.05);
    let mut means = Means::default();
    let here = bore::bore(&job(0.05), &mut means, &mut |_| {}).unwrap();
    assert!(there.completed && here.completed, "{} {}", there.stop_reason, here.stop_reason);
    assert_eq!((there.lost_counts, there.illegal_transitions, &there.faults), (0, 0, &Vec::new()));
    let near = |what: &str, chip: f64, native: f64, bound: f64| {
        assert!((chip - native).abs() <= bound, "{what}: {chip} on the chip, {native} natively");
    };
    // docs/emulated-chip.md states these.
    near("depth, mm", there.depth_mm, here.depth_mm, 0.001);
    near("time, relative", there.sim_time_s / here.sim_time_s, 1.0, 0.05);
    near("mean gap voltage, V", chip_means.volts, means.volts, 0.5);
    near("mean gap, um", chip_means.gap, means.gap, 0.5);
    let sparks = |o: &Outcome| o.pulses.spark as f64 / (o.pulses.spark + o.pulses.open) as f64;
    near("share of sparks", sparks(&there), sparks(&here), 0.01);
}

#[test]
fn the_same_seed_bores_the_same_hole() {
    assert_eq!(chip(0.003), chip(0.003));
}

#[test]
fn the_chip_asks_for_a_coarse_axis_and_goes_on_at_the_same_count() {
    let mut job = job(0.02);
    // The head ends 0.1 mm above the end of a stroke of 1 mm, and the work begins below that.
    for assignment in [
        "workpiece.surface_mm=1.1",
        "axis.stroke_um=1000",
        "inch.step_um=150",
        "inch.reserve_um=100",
        "inch.clearance_um=50",
        "inch.tolerance_um=20",
        "seek.velocity_um_s=1000",
    ] {
        job.setup.set(assignment).unwrap();
    }
    job.coarse_error_um = 5.0;
    let image = Image::parse(common::firmware().to_vec()).unwrap();
    let there = edm_fil::rig::bore(&image, false, false, &job, &mut Means::default(), &mut |_| {}).unwrap();
    assert!(there.completed, "{there:?}");
    assert_eq!((there.inches, there.lost_counts), (2, 0));
    let off_um = 1e3 * (there.depth_mm + there.wear_mm - 0.02);
    assert!(off_um.abs() <= 2.0, "{off_um} um");
}
