//! What a run leaves behind, driven end to end by a machine that is made up: its truth is known, so the figures, the
//! table and the picture can be checked against it.

use clap::Parser;
use edm_sim::cli::{Bore, Failure};
use edm_sim::observe::Recorder;
use edm_sim::process::Pulses;
use edm_sim::run::{FaultEvent, Job, Observer, Outcome, Progress, Sample};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::fs;
use std::path::Path;

const TICK_S: f64 = 1.0 / 20_000.0;
const SETPOINT_V: f64 = 55.0;

/// Seeks 300 um, keeps a gap of 40 um at 1.1 V/um while the surface recedes, backs off 12 um every 7 s, rings at 12 Hz.
fn made_up(job: &Job, recorder: &mut Recorder, progress: &mut dyn FnMut(&Progress)) -> Result<Outcome, String> {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(job.seed);
    let target_um = job.depth_mm * 1000.0;
    let (mut x, mut surface, mut filtered, mut wander) = (-300.0, 0.0, 100.0, 0.0);
    let mut eroding_s = 0.0;
    let mut tick = 0u32;
    while x < target_um {
        let t_s = f64::from(tick) * TICK_S;
        let gap = surface - x;
        let seeking = eroding_s == 0.0 && gap > 45.0;
        let retreating = !seeking && eroding_s % 7.0 > 6.9;
        let before = x;
        wander += random.random_range(-0.02..0.02) - wander * 3.0 * TICK_S;
        if seeking {
            x += 1000.0 * TICK_S;
        } else {
            eroding_s += TICK_S;
            surface += if retreating { 0.0 } else { 12.0 * TICK_S };
            let ring = 0.8 * (std::f64::consts::TAU * 12.0 * t_s).sin();
            let back = if retreating { 12.0 } else { 0.0 };
            let wanted = surface - 40.0 + ring + wander - back;
            x += (wanted - x).clamp(-2000.0 * TICK_S, 300.0 * TICK_S);
        }
        let volts = (SETPOINT_V + 1.1 * (surface - x - 40.0)).clamp(0.0, 100.0) + random.random_range(-20.0..20.0);
        filtered += (volts - filtered) * 0.03;
        let state = match () {
            () if seeking => "seeking",
            () if retreating => "retreating",
            () => "eroding",
        };
        recorder.sample(&Sample {
            t_s,
            position_um: x,
            setpoint_um: x.round(),
            velocity_um_s: (x - before) / TICK_S,
            surface_um: surface,
            gap_um: surface - x,
            gap_v: volts as f32,
            filtered_v: filtered as f32,
            setpoint_v: SETPOINT_V as f32,
            duty: (-0.085 + (x - before) * 0.02 + wander * 0.002) as f32,
            state,
            ..Sample::default()
        });
        if tick.is_multiple_of(2000) {
            progress(&Progress { sim_time_s: t_s, done_mm: x / 1000.0, state });
        }
        tick += 1;
    }
    Ok(Outcome {
        completed: true,
        stop_reason: "depth reached".into(),
        depth_mm: job.depth_mm,
        hole_depth_mm: surface / 1000.0,
        sim_time_s: f64::from(tick) * TICK_S,
        shot_floor_rms_v: Some(1.4),
        pulses: Pulses { open: 300, spark: 680, arc: 8, short: 12, stable_arc: 0 },
        ..Outcome::default()
    })
}

#[derive(Parser)]
struct Line {
    #[command(flatten)]
    bore: Bore,
}

/// A bore command with these words after it; it prints nothing.
fn bore(words: &[&str]) -> Bore {
    let line = ["bore", "--quiet"].iter().chain(words);
    Line::try_parse_from(line).unwrap().bore
}

fn path(folder: &Path, name: &str) -> String {
    folder.join(name).display().to_string()
}

#[test]
fn a_run_leaves_a_report_a_table_and_a_picture_that_agree_with_its_truth() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let [json, trace, plot] = ["run.json", "run.csv", "run.svg"].map(|name| path(folder, name));
    let words = ["--json", &json, "--trace", &trace, "--plot", &plot, "--depth-mm", "0.3", "--seed", "3"];
    assert_eq!(bore(&words).execute(made_up), Ok(true));

    let report: serde_json::Value = serde_json::from_str(&fs::read_to_string(json).unwrap()).unwrap();
    let near = |value: &serde_json::Value, expected: f64, tolerance: f64| {
        let value = value.as_f64().unwrap();
        assert!((value - expected).abs() < tolerance, "{value}, not {expected}");
    };
    near(&report["gap_voltage_v"]["mean"], SETPOINT_V, 0.3);
    near(&report["gap_voltage_v"]["rms_error_100ms"], 0.6, 0.3);
    near(&report["gap_um"]["mean"], 40.0, 0.3);
    near(&report["position_line_um"]["amplitude"], 0.8, 0.1);
    near(&report["position_line_um"]["hz"], 12.0, 0.3);
    near(&report["spark_ratio"], 0.68, 1e-9);
    // The hole is the electrode's depth and the gap; it recedes by 12 um/s, less the time of the retreats.
    near(&report["depth_mm"], 0.3, 0.001);
    near(&report["hole_depth_mm"], 0.34, 0.002);
    near(&report["rate_mm_min"], 0.72, 0.01);
    assert_eq!(report["findings"], serde_json::json!([]));
    assert_eq!(report["long_retreats"], 4);
    assert_eq!(report["seed"], 3);

    let sim_time_s = report["sim_time_s"].as_f64().unwrap();
    let mut table = csv::Reader::from_path(trace).unwrap();
    assert_eq!(table.headers().unwrap().iter().collect::<Vec<_>>(), edm_sim::trace::COLUMNS);
    let rows: Vec<csv::StringRecord> = table.records().map(Result::unwrap).collect();
    assert_eq!(rows.len(), (sim_time_s * 1000.0).ceil() as usize);
    assert_eq!(&rows[0][9], "seeking");
    assert!(rows.iter().all(|row| row.iter().take(9).all(|cell| cell.parse::<f64>().unwrap().is_finite())));

    let svg = fs::read_to_string(plot).unwrap();
    assert!(svg.len() < 1_500_000, "{} bytes", svg.len());
    for words in ["Simulated bore", "seed 3", "Gap voltage, V", "time, s", "One second of eroding"] {
        assert!(svg.contains(words), "{words}");
    }
    let families = svg.matches("font-family=").count();
    assert_eq!(svg.matches("font-family=\"sans-serif\"").count(), families);
}

#[test]
fn the_picture_of_a_long_restless_run_stays_small() {
    let folder = tempfile::tempdir().unwrap();
    let plot = path(folder.path(), "run.svg");
    assert_eq!(bore(&["--plot", &plot, "--depth-mm", "5"]).execute(made_up), Ok(true));
    assert!(fs::metadata(&plot).unwrap().len() < 1_500_000);
}

#[test]
fn a_run_too_short_to_judge_still_leaves_all_three() {
    let folder = tempfile::tempdir().unwrap();
    let [json, trace, plot] = ["run.json", "run.csv", "run.svg"].map(|name| path(folder.path(), name));
    let still = |_: &Job, _: &mut Recorder, _: &mut dyn FnMut(&Progress)| {
        Ok(Outcome {
            completed: false,
            stop_reason: "encoder lost".into(),
            depth_mm: f64::NAN,
            hole_depth_mm: f64::NAN,
            sim_time_s: 0.0,
            shot_floor_rms_v: None,
            pulses: Pulses::default(),
            lost_counts: 3,
            illegal_transitions: 1,
            faults: vec![FaultEvent { t_s: 0.0, fault: "encoder lost".into() }],
            ..Outcome::default()
        })
    };
    assert_eq!(bore(&["--json", &json, "--trace", &trace, "--plot", &plot]).execute(still), Ok(false));
    let report: serde_json::Value = serde_json::from_str(&fs::read_to_string(json).unwrap()).unwrap();
    assert_eq!(report["depth_mm"], serde_json::Value::Null);
    assert_eq!(report["faults"][0]["fault"], "encoder lost");
    assert_eq!(fs::read_to_string(trace).unwrap().lines().count(), 1);
    assert!(fs::read_to_string(plot).unwrap().contains("stopped: encoder lost"));
}

#[test]
fn a_run_that_cannot_be_made_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let [json, trace, plot] = ["run.json", "run.csv", "run.svg"].map(|name| path(folder.path(), name));
    let broken = |_: &Job, _: &mut Recorder, _: &mut dyn FnMut(&Progress)| Err("no machine".into());
    let failure = bore(&["--json", &json, "--trace", &trace, "--plot", &plot]).execute(broken);
    assert_eq!(failure, Err(Failure::Failed("no machine".into())));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn the_scenario_as_it_was_changed_is_named_in_the_report() {
    let folder = tempfile::tempdir().unwrap();
    let json = path(folder.path(), "run.json");
    let words = ["--json", &json, "--depth-mm", "0.01", "--set", "gap.setpoint_v=50", "--surrogate"];
    assert_eq!(bore(&words).execute(made_up), Ok(true));
    let report: serde_json::Value = serde_json::from_str(&fs::read_to_string(json).unwrap()).unwrap();
    assert_eq!(report["scenario"], "default, gap.setpoint_v=50, surrogate");
}

/// What is wrong with a machine that otherwise keeps 55 V and 40 um.
#[derive(Clone, Copy, Default)]
struct Wrong {
    /// Voltage off the one wanted, and its slow sway, V.
    off_v: f64,
    sway_v: f64,
    /// Motion of the electrode: amplitude, um, and frequency, Hz.
    moves: (f64, f64),
    /// Share of the time with the duty at its limit.
    at_limit: f64,
    /// Of 1000 pulses.
    arcs: u64,
    shorts: u64,
    lost_counts: u64,
}

impl Wrong {
    /// Fourteen seconds of eroding.
    fn run(self, _: &Job, recorder: &mut Recorder, _: &mut dyn FnMut(&Progress)) -> Result<Outcome, String> {
        use std::f64::consts::TAU;
        for tick in 0..280_000u32 {
            let t_s = f64::from(tick) * TICK_S;
            let ((um, hz), surface_um) = (self.moves, 3.0 * t_s);
            let position_um = surface_um - 40.0 + um * (TAU * hz * t_s).sin();
            let volts = (SETPOINT_V + self.off_v + self.sway_v * (TAU * 0.5 * t_s).sin()) as f32;
            recorder.sample(&Sample {
                t_s,
                position_um,
                setpoint_um: position_um,
                velocity_um_s: 3.0 + um * TAU * hz * (TAU * hz * t_s).cos(),
                surface_um,
                gap_um: surface_um - position_um,
                gap_v: volts,
                filtered_v: volts,
                setpoint_v: SETPOINT_V as f32,
                // The limit of the default settings.
                duty: if t_s.fract() < self.at_limit { -0.9 } else { 0.1 },
                state: "eroding",
                ..Sample::default()
            });
        }
        let spark = 900 - self.arcs - self.shorts;
        let pulses = Pulses { open: 100, spark, arc: self.arcs, short: self.shorts, stable_arc: 0 };
        Ok(Outcome {
            completed: true,
            stop_reason: "depth reached".into(),
            depth_mm: 0.5,
            hole_depth_mm: 0.54,
            sim_time_s: 14.0,
            shot_floor_rms_v: None,
            pulses,
            lost_counts: self.lost_counts,
            ..Outcome::default()
        })
    }
}

#[test]
fn the_verdict_names_what_is_wrong_with_its_value_and_limit() {
    let verdict = |wrong: Wrong| {
        let folder = tempfile::tempdir().unwrap();
        let json = path(folder.path(), "run.json");
        let run = |job: &Job, recorder: &mut Recorder, progress: &mut dyn FnMut(&Progress)| {
            wrong.run(job, recorder, progress)
        };
        assert_eq!(bore(&["--json", &json]).execute(run), Ok(true));
        let report: serde_json::Value = serde_json::from_str(&fs::read_to_string(json).unwrap()).unwrap();
        let texts = report["findings"].as_array().unwrap().iter().map(|finding| finding["text"].as_str().unwrap());
        texts.map(String::from).collect::<Vec<_>>()
    };
    let right = Wrong { arcs: 4, shorts: 1, moves: (1.0, 8.0), ..Wrong::default() };
    for (wrong, texts) in [
        (right, &[][..]),
        (
            Wrong { off_v: 27.7, ..right },
            &[
                "mean gap voltage 82.7 V, 27.7 V above the set point of 55.0 V (limit 4.1 V): the gap is too wide",
                "100 ms mean of the gap voltage 27.7 V rms about the set point (limit 5.5 V)",
            ],
        ),
        (
            Wrong { off_v: -5.0, ..right },
            &["mean gap voltage 50.0 V, 5.0 V below the set point of 55.0 V (limit 4.1 V): the gap is too narrow"],
        ),
        (
            Wrong { sway_v: 12.0, ..right },
            &["100 ms mean of the gap voltage 8.5 V rms about the set point (limit 5.5 V)"],
        ),
        // The trend that is taken out of half a second of a sine is not quite level.
        (
            Wrong { moves: (10.0, 20.0), ..right },
            &["position ripple 21.6 um p-p (limit 15 um)", "largest tone 9.9 um at 20 Hz (limit 3 um)"],
        ),
        // 5.8 mm/s of velocity in 3 um of motion.
        (Wrong { moves: (3.077, 300.0), ..right }, &["vibration 4.1 mm/s rms above 50 Hz (limit 1 mm/s)"]),
        (Wrong { at_limit: 0.3, ..right }, &["duty at its limit for 30 % of the time (limit 1 %)"]),
        (
            Wrong { arcs: 260, shorts: 100, lost_counts: 2, ..right },
            &[
                "arcs 26 % of the pulses (limit 5 %)",
                "shorts 10 % of the pulses (limit 5 %)",
                "2 lost counts (limit 0)",
            ],
        ),
    ] {
        assert_eq!(verdict(wrong), texts);
    }
}
