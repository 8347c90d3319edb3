//! The hole that the firmware bores on the chip, beside the one that the native core bores.

use crate::common;
use edm_fil::host::{self, Bus as _};
use edm_fil::image::Image;
use edm_fil::rig::{Emulated, Witness};
use edm_hal_shim::board::F405;
use edm_servo_head::head::{Command, Inch};
use edm_servo_head::settings::Settings;
use edm_servo_head::units::{Nanometres, TICK_HZ};
use edm_sim::bore::{self, Setup};
use edm_sim::machine::Rig as _;
use edm_sim::process::Plant;
use edm_sim::run::{Job, Observer, Outcome, Sample};
use edm_sim::scenario;

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
    Job { setup, depth_mm, path: None, table: None, seed: 1, surrogate: false, coarse_error_um: 0.0 }
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
fn the_chip_bores_micro_holes_in_whose_shorts_no_current_is_left_and_loses_no_count() {
    let image = Image::parse(common::firmware().to_vec()).unwrap();
    let mut shorts = 0;
    for scenario in ["micro-blind", "micro-through-clear"] {
        let mut setup = Setup::load(scenario).unwrap();
        setup.set("workpiece.surface_mm=0.05").unwrap();
        let job = Job { setup, ..job(0.004) };
        let there = edm_fil::rig::bore(&image, false, true, &job, &mut Means::default(), &mut |_| {}).unwrap();
        assert!(there.completed, "{scenario}: {}", there.stop_reason);
        shorts += there.pulses.short;
        assert_eq!((there.lost_counts, there.illegal_transitions, &there.faults), (0, 0, &Vec::new()), "{scenario}");
    }
    assert!(shorts > 100, "{shorts}");
}

/// Part I of N of the scenarios, as EDM_SCENARIOS=I/N names it: each bores 0.02 mm, or for a minute, beside the native core.
#[test]
#[ignore = "five minutes: .ci/campaigns/chip-scenarios"]
fn every_scenario_bores_on_the_chip_tick_by_tick_as_natively_and_loses_no_count() {
    let shard = std::env::var("EDM_SCENARIOS").unwrap_or_else(|_| "1/1".into());
    let (part, of) = shard.split_once('/').unwrap();
    let [part, of]: [usize; 2] = [part, of].map(|number| number.parse().unwrap());
    let image = Image::parse(common::firmware().to_vec()).unwrap();
    for (scenario, _) in scenario::BUILT_IN.iter().skip(part - 1).step_by(of) {
        let mut setup = Setup::load(scenario).unwrap();
        setup.set("workpiece.surface_mm=0.2").unwrap();
        let settings = Settings { commissioned: true, ..setup.head };
        let mut rig = Emulated::start(&image, setup.process, &settings, 1, Witness::twin(&settings).unwrap()).unwrap();
        host::begin(&mut rig).unwrap();
        // Truth and count are not of the same moment to the microsecond, and a head that holds its place sways.
        let lost = |rig: &mut Emulated| {
            let mut offsets = [(); 4001].map(|()| {
                rig.tick().unwrap();
                rig.true_count() - rig.status().position
            });
            offsets.sort_unstable();
            offsets[2000]
        };
        let surface = rig.process().truth().surface_um;
        common::bore(&mut rig, Nanometres(3_000_000));
        // From the home that it has now.
        let first = lost(&mut rig);
        let mut ticks = 0;
        while ticks < 60 * TICK_HZ && rig.process().truth().surface_um < surface + 20.0 {
            rig.tick().unwrap_or_else(|error| panic!("{scenario}: {error}"));
            assert_eq!(rig.status().fault, None, "{scenario}: {ticks}");
            ticks += 1;
        }
        rig.command(Command::Hold).unwrap();
        (0..TICK_HZ).for_each(|_| rig.tick().unwrap());
        let (truth, status) = (rig.process().truth(), *rig.status());
        let bored = truth.surface_um - surface;
        println!("{scenario}: {bored:.1} um in {:.1} s, {:?}", ticks as f32 / TICK_HZ as f32, truth.pulses);
        assert!(bored > 1.0 && status.fault.is_none() && status.illegal_transitions == 0, "{scenario}: {status:?}");
        assert_eq!(lost(&mut rig), first, "{scenario}");
    }
}

#[test]
fn the_same_seed_bores_the_same_hole() {
    let image = Image::parse(common::firmware().to_vec()).unwrap();
    let [first, second] = [(); 2].map(|()| {
        let Setup { process, head, .. } = job(0.001).setup;
        let settings = Settings { commissioned: true, ..head };
        let mut rig = Emulated::start(&image, process, &settings, 1, Witness::None).unwrap();
        host::begin(&mut rig).unwrap();
        common::bore(&mut rig, Nanometres(1_000_000));
        // A second of it in the work.
        (0..2 * TICK_HZ).for_each(|_| rig.tick().unwrap());
        assert!(rig.process().truth().pulses.discharges() > 2000);
        (rig.process().truth(), *rig.status())
    });
    assert_eq!(first, second);
}

#[test]
fn the_chip_runs_the_rows_of_a_table_one_after_the_other() {
    let rows = "electrode = 'copper'\nwork = 'steel'\n\
        [[row]]\nname = 'rough'\nleaves_um = 2\ngenerator.on_us = 160\nsettings.gap.setpoint_v = 65\n\
        [[row]]\nname = 'fine'\ngenerator.on_us = 60\ngenerator.off_us = 20\nsettings.gap.setpoint_v = 60\nsettings.feed.law = 'two_thresholds'";
    let table = Some(edm_technology::File::parse(rows).unwrap());
    let image = Image::parse(common::firmware().to_vec()).unwrap();
    let job = Job { table, ..job(0.004) };
    let outcome = edm_fil::rig::bore(&image, false, false, &job, &mut Means::default(), &mut |_| {}).unwrap();
    assert!(outcome.completed, "{}", outcome.stop_reason);
    let rows: Vec<_> = outcome.rows.iter().map(|row| (row.name.as_str(), row.off_counts.abs() <= 1)).collect();
    assert_eq!(rows, [("rough", true), ("fine", true)]);
    assert_eq!((outcome.lost_counts, outcome.illegal_transitions), (0, 0));
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

/// The line that asks a machine for its coarse axis is the bit of 60FEh, on the pin of the board.
#[test]
fn the_chip_asks_for_the_coarse_axis_on_a_pin_until_it_has_moved() {
    /// Output register of port B (RM0090 8.4.6).
    const GPIOB_ODR: u32 = 0x4002_0414;
    let pin = F405::TABLE.pin("carry");
    assert_eq!(pin.port, 'B');
    let settings = Settings {
        commissioned: true,
        axis_stroke: 1000.0,
        inch_step: 150.0,
        inch_reserve: 100.0,
        inch_clearance: 50.0,
        inch_tolerance: 20.0,
        seek_velocity: 1000.0,
        ..Settings::default()
    };
    let plant = Plant::with(&[("workpiece.surface_mm", 1.1)]).unwrap();
    let image = Image::parse(common::firmware().to_vec()).unwrap();
    let mut rig = Emulated::start(&image, plant, &settings, 1, Witness::None).unwrap();
    host::begin(&mut rig).unwrap();
    let asks = |rig: &mut Emulated| {
        let line = rig.machine_mut().soc().read(GPIOB_ODR, 4).unwrap() >> pin.number & 1 == 1;
        let [told, outputs] = [(0x2014, 2), (0x60FE, 1)].map(|(index, sub)| host::read(rig, index, sub).unwrap());
        assert_eq!((told == 1, outputs >> 18 & 1 == 1), (line, line));
        line
    };
    assert!(!asks(&mut rig));
    common::bore(&mut rig, Nanometres(1_300_000));
    let mut passes = 0;
    while rig.status().inch != Inch::Asks {
        rig.pass().unwrap();
        passes += 1;
        assert!(passes < 20_000, "{:?}", rig.status());
    }
    (0..3).for_each(|_| rig.pass().unwrap());
    assert!(asks(&mut rig));
    // Refused: the head goes back, and asks no more.
    host::write(&mut rig, 0x2014, 5, 2, 1).unwrap();
    (0..20).for_each(|_| rig.pass().unwrap());
    assert!(!asks(&mut rig));
}
