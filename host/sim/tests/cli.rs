//! The command line as a person meets it: the real program, in a folder of its own.

use edm_servo_head::settings::{Declared, Settings};
use edm_sim::process::Plant;
use edm_sim::scenario::BUILT_IN;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};
use tempfile::TempDir;

/// A folder with a scenario that can be run, one that is broken, and something that must survive.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    let head = "title = \"T\"\ndescription = \"D\"\n";
    write("good.toml", &format!("{head}[head]\n\"gap.setpoint_v\" = 55\n"));
    write("broken.toml", &format!("{head}[head\n"));
    write("heavy.toml", &format!("{head}[head]\n\"axis.mass_kg\" = 0.4\n"));
    write("unknown.toml", &format!("{head}[head]\n\"gap.setpoint\" = 55\n"));
    write("range.toml", &format!("{head}[process]\n\n\"model.on_us\" = nan\n"));
    write("type.toml", &format!("{head}[head]\n\"gap.setpoint_v\" = true\n"));
    write("conflict.toml", &format!("{head}[process]\n\"model.burn_v\" = 90\n\"model.open_v\" = 80\n"));
    write("kept.json", "older");
    fs::create_dir(folder.path().join("sub")).unwrap();
    folder
}

fn run(folder: &Path, words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_edm-sim")).args(words).current_dir(folder).output().unwrap()
}

/// Every file with its content, every folder.
fn listing(folder: &Path) -> BTreeMap<String, Option<Vec<u8>>> {
    fs::read_dir(folder)
        .unwrap()
        .map(|entry| {
            let entry = entry.unwrap();
            (entry.file_name().into_string().unwrap(), fs::read(entry.path()).ok())
        })
        .collect()
}

/// What a setting may be, as its declaration says.
fn allowed(key: &str) -> String {
    let mut fields = Plant::FIELDS.iter().chain(Settings::FIELDS);
    fields.find(|field| field.key == key).unwrap().allowed().to_string()
}

/// Runs with these words after `bore` and every output asked for: one line on stderr with all these parts, exit code 2,
/// nothing on stdout, nothing written.
fn refused(words: &[&str], parts: &[&str]) {
    let folder = folder();
    let before = listing(folder.path());
    let mut all = vec!["bore"];
    for (option, path) in [("--json", "r.json"), ("--trace", "r.csv"), ("--plot", "r.svg")] {
        if !words.contains(&option) {
            all.extend([option, path]);
        }
    }
    all.extend(words);
    let output = run(folder.path(), &all);
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{words:?}: {stderr}");
    assert_eq!(stderr.trim_end().lines().count(), 1, "{words:?}: {stderr}");
    for part in parts {
        assert!(stderr.contains(part), "{words:?}: {part:?} is not in {stderr}");
    }
    assert!(output.stdout.is_empty());
    assert_eq!(listing(folder.path()), before, "{words:?}");
}

#[test]
fn a_value_out_of_range_of_the_wrong_type_or_not_a_number_is_refused() {
    for (key, value) in [
        ("gap.setpoint_v", "301"),
        ("gap.setpoint_v", "0.99"),
        ("gap.setpoint_v", "NaN"),
        ("gap.setpoint_v", "-inf"),
        ("gap.setpoint_v", "1e300"),
        ("gap.setpoint_v", "sixty"),
        ("gap.setpoint_v", ""),
        ("gap.second_harmonic", "1"),
        ("gap.average", "median"),
        ("model.on_us", "0"),
        ("front_end.zero_code", "4096"),
        ("front_end.zero_code", "1.5"),
        ("front_end.zero_code", "-1"),
    ] {
        let assignment = format!("{key}={value}");
        refused(&["--set", &assignment], &[&format!("--set {key} = {value}"), &allowed(key)]);
    }
}

#[test]
fn an_unknown_key_is_refused_with_the_nearest() {
    refused(&["--set", "gap.setpont_v=60"], &["--set gap.setpont_v = 60", "did you mean gap.setpoint_v?"]);
    refused(&["--set", "model.on=160"], &["did you mean model.on_us?"]);
    refused(&["--set", "nonsense=160"], &["nonsense = 160", "no such setting", "edm-sim settings"]);
    refused(&["--set", "gap.setpoint_v"], &["gap.setpoint_v", "must be key=value"]);
}

#[test]
fn one_bad_value_among_good_ones_is_enough() {
    refused(
        &["--set", "gap.setpoint_v=50", "--set", "gap.corner_hz=5"],
        &["gap.corner_hz = 5", &allowed("gap.corner_hz")],
    );
}

#[test]
fn values_that_do_not_fit_together_are_refused() {
    refused(&["--set", "model.burn_v=100"], &["model", "burn_v must be below open_v"]);
    refused(&["--set", "gap.setpoint_v=80"], &["gap.setpoint_v = 80", "must be below gap.open_min_v"]);
    refused(&["--set", "workpiece.surface_mm=11.9"], &["workpiece.surface_mm = 11.9", "limit.lower_mm"]);
    refused(&["--scenario", "conflict.toml"], &["model", "burn_v must be below open_v"]);
}

#[test]
fn a_head_that_does_not_pass_its_guided_check_does_not_bore() {
    let check = "a real head stops in its guided check";
    let open = ["gap.open_v measures 149.9", "may be set from 112.4", "gap.open_v = 100"];
    refused(&["--set", "axis.counterbalance_n=100"], &[check, "axis.counterbalance_n=100", "polarity wrong"]);
    let scaled = ["--set", "gap.volts_per_code=0.15", "--set", "retreat.velocity_um_s=50000"];
    refused(&scaled, &[&[check][..], &open].concat());
    // Where the scenario's own head believes in another mass, the check goes past the mass.
    refused(&["--scenario", "sinker-0.4kg", "--set", "gap.volts_per_code=0.15"], &[&[check][..], &open].concat());
    refused(
        &["--scenario", "sinker-0.4kg", "--set", "axis.mass_kg=0.1"],
        &["axis.mass_kg measures 0.400", "axis.mass_kg = 0.1"],
    );
    refused(&["--set", "axis.stroke_um=18000"], &["axis.stroke_um measures 12000", "from 10909 to 13333", "= 18000"]);
    refused(&["--set", "wiring.gap_reversed=true"], &[check, "change gap.reversed", "gap.reversed = false"]);
    refused(&["--set", "gap.open_min_v=110"], &[check, "less than gap.open_min_v"]);
    refused(&["--scenario", "heavy.toml"], &[check, "heavy.toml", "axis.mass_kg = 0.4"]);
}

#[test]
fn the_guided_check_leaves_the_hole_as_it_was() {
    let folder = folder();
    let bored = |words: &[&str]| {
        let output = run(folder.path(), &[&["bore", "--depth-mm", "0.002", "--json", "r.json"], words].concat());
        assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
        let report = report(folder.path());
        ["depth_mm", "sim_time_s", "gap_um"].map(|key| (key, report[key].clone()))
    };
    // Set to what the scenario says anyway.
    for (scenario, set) in [("default", "gap.setpoint_v=65"), ("cavity", "model.radius_um=10000")] {
        let alone = bored(&["--scenario", scenario]);
        assert!(alone.iter().all(|(_, value)| !value.is_null()), "{alone:?}");
        assert_eq!(bored(&["--scenario", scenario, "--set", set]), alone, "{scenario}");
    }
}

#[test]
fn a_depth_that_is_no_number_or_outside_the_stroke_is_refused() {
    for depth in ["NaN", "inf", "-inf", "0", "-1", "0.0009", "9.801", "12", "deep", ""] {
        refused(&["--depth-mm", depth], &[&format!("--depth-mm {depth}"), "must be a number from 0.001 to 9.8 mm"]);
    }
    // The range follows the machine that is asked for.
    refused(&["--depth-mm", "5", "--set", "workpiece.surface_mm=7.5"], &["--depth-mm 5", "from 0.001 to 4.3 mm"]);
}

#[test]
fn a_seed_that_is_no_whole_number_is_refused() {
    for seed in ["x", "-1", "1.5", "18446744073709551616"] {
        refused(&["--seed", seed], &["--seed", seed, "a whole number from 0 to 18446744073709551615"]);
    }
}

#[test]
fn a_scenario_that_is_missing_or_malformed_is_refused() {
    refused(&["--scenario", "defualt"], &["--scenario defualt", "did you mean default?", "roberts-original"]);
    refused(&["--scenario", "missing.toml"], &["--scenario missing.toml", "cannot be read"]);
    refused(&["--scenario", "sub"], &["--scenario sub", "cannot be read"]);
    refused(&["--scenario", "broken.toml"], &["broken.toml:3", "not TOML"]);
    refused(&["--scenario", "unknown.toml"], &["unknown.toml:4", "gap.setpoint = 55", "did you mean gap.setpoint_v?"]);
    refused(&["--scenario", "range.toml"], &["range.toml:5", "model.on_us = nan", &allowed("model.on_us")]);
    refused(&["--scenario", "type.toml"], &["type.toml:4", "gap.setpoint_v = true", &allowed("gap.setpoint_v")]);
}

#[test]
fn an_output_that_cannot_be_written_is_refused_before_anything_runs() {
    for option in ["--json", "--trace", "--plot"] {
        for path in ["nowhere/r.out", "sub", "kept.json/r.out", ".."] {
            refused(&[option, path], &[&format!("{option} {path}"), "must be a file that can be written"]);
        }
    }
}

#[cfg(target_os = "linux")]
#[test]
fn an_output_in_a_folder_without_leave_to_write_is_refused() {
    refused(&["--json", "/proc/r.json"], &["--json /proc/r.json", "must be a file that can be written"]);
}

#[test]
fn two_outputs_in_one_file_and_an_output_over_its_scenario_are_refused() {
    refused(
        &["--json", "sub/../same", "--plot", "same"],
        &["--json sub/../same", "--plot same", "must be different files"],
    );
    refused(&["--json", "kept.json", "--trace", "./kept.json"], &["must be different files"]);
    refused(
        &["--scenario", "good.toml", "--json", "good.toml"],
        &["--json good.toml", "must not be the scenario file"],
    );
}

#[test]
fn an_unknown_option_or_command_is_refused_in_one_line() {
    refused(&["--depht-mm", "1"], &["--depht-mm"]);
    refused(&["1"], &["'1'"]);
    refused(&["--json", ""], &["--json"]);
    for words in [&["boer"][..], &["settings", "x"], &["bench", "--runs", "0"], &[]] {
        let output = run(folder().path(), words);
        assert_eq!(output.status.code(), Some(2), "{words:?}");
        assert_eq!(String::from_utf8(output.stderr).unwrap().trim_end().lines().count(), 1, "{words:?}");
    }
}

#[test]
fn a_bench_with_bad_input_is_refused_too() {
    let folder = folder();
    let before = listing(folder.path());
    for words in [&["bench", "--json", "nowhere/b.json"][..], &["bench", "--json", "b.json", "--depth-mm", "99"]] {
        assert_eq!(run(folder.path(), words).status.code(), Some(2), "{words:?}");
    }
    assert_eq!(listing(folder.path()), before);
}

/// A hole shallow enough for a test.
const SHALLOW: [&str; 7] = ["bore", "--depth-mm", "0.01", "--set", "workpiece.surface_mm=0.3", "--json", "r.json"];

fn report(folder: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(folder.join("r.json")).unwrap()).unwrap()
}

#[test]
fn a_bored_hole_leaves_its_outputs_and_a_summary() {
    let folder = folder();
    let words: Vec<&str> = SHALLOW.into_iter().chain(["--trace", "r.csv", "--plot", "kept.json"]).collect();
    let output = run(folder.path(), &words);
    let stdout = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(0), "{stdout}");
    assert!(output.stderr.is_empty(), "no progress bar where nobody looks");
    for words in
        ["Simulated bore", "mm deep (simulated)", "mm deep, 0.010 mm requested", "Gap voltage", "Faults       none"]
    {
        assert!(stdout.contains(words), "{words} in {stdout}");
    }
    let report = report(folder.path());
    assert_eq!(report["completed"], true);
    assert_eq!(report["stop_reason"], "depth reached");
    assert!((report["depth_mm"].as_f64().unwrap() - 0.01).abs() < 0.001, "{report}");
    assert!(fs::read_to_string(folder.path().join("kept.json")).unwrap().starts_with("<svg"));
    assert_eq!(listing(folder.path()).len(), listing(self::folder().path()).len() + 2);
}

/// A program in a folder of its own.
fn with_program(text: &str) -> TempDir {
    let folder = folder();
    fs::write(folder.path().join("p.ngc"), text).unwrap();
    folder
}

#[test]
fn a_path_is_eroded_along_to_its_end_and_drawn() {
    let folder = with_program("G1 Z-0.002\nG3 X0.02 I0.01\nG91 G1 X-0.01 Y0.01 Z-0.004\nM2");
    let output = run(folder.path(), &["bore", "--path", "p.ngc", "--plot", "r.svg", "--json", "r.json"]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8(output.stderr).unwrap());
    let report = report(folder.path());
    assert_eq!(report["stop_reason"], "end of the path");
    assert_eq!(report["scenario"], "default, p.ngc");
    assert_eq!(report["target_depth_mm"], 0.006);
    assert!((report["depth_mm"].as_f64().unwrap() - 0.006).abs() < 0.001, "{report}");
    let svg = fs::read_to_string(folder.path().join("r.svg")).unwrap();
    assert!(svg.contains("From above: Y over X, mm") && svg.contains("From the side: Z over X, mm"));
}

#[test]
fn a_path_is_eroded_no_faster_than_its_feed_and_a_rapid_as_fast_as_the_gap_allows() {
    // 30 um/min are 0.5 um/s, for 4 of 8 um.
    let eroded_s = |program: &str| {
        let folder = with_program(program);
        let output = run(folder.path(), &["bore", "--path", "p.ngc", "--json", "r.json"]);
        assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8(output.stderr).unwrap());
        report(folder.path())["sim_time_s"].as_f64().unwrap()
    };
    let free = eroded_s("G0 Z-0.004\nG1 Z-0.008");
    let bounded = eroded_s("G0 Z-0.004\nG1 Z-0.008 F0.03");
    let rapid = eroded_s("F0.03 G0 Z-0.004\nG0 Z-0.008");
    assert!(bounded > free + 4.0, "{bounded} s bounded, {free} s free");
    assert!((rapid - free).abs() < 1.0, "{rapid} s rapid, {free} s free");
}

#[test]
fn a_path_longer_than_the_register_is_fed_as_it_is_eroded() {
    use std::fmt::Write;
    let mut program = "G1 Z-0.001\n".to_owned();
    for piece in 0..600 {
        writeln!(program, "G1 X{:.4} Z-{:.6}", f64::from(piece % 2) * 1e-4, 0.001 + f64::from(piece) * 1e-6).unwrap();
    }
    let folder = with_program(&program);
    let output = run(folder.path(), &["bore", "--path", "p.ngc", "--json", "r.json"]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8(output.stderr).unwrap());
    assert_eq!(report(folder.path())["stop_reason"], "end of the path");
}

#[test]
fn a_path_that_cannot_be_is_refused_with_line_and_word() {
    for (program, message) in [
        ("G1 Z-1\nG7 X1", "line 2: G7: must be one of G0 to G4, G10, G17 to G21, G40, G49"),
        ("G1 Z-1\nG1 Z-50", "line 2: Z-50: leads to Z-50.000; the stroke ends at Z-9.800"),
        ("G1 Z2.1", "line 1: Z2.1: leads to Z2.100; the stroke ends at Z2.000"),
        ("G3 X0.001 I0.0005", "line 1: X0.001: a radius of 500 nm is outside 10000 to 536870912 nm"),
        ("G3 X1 I0.4", "line 1: X1: start and end are 400000 and 600000 nm from the centre"),
        ("G1 Z-1\nG90 G91 Z-1", "line 2: G91: G90 is in the same line"),
        ("G1 Z-1 F-5", "line 1: F-5: a feed must be 0.006 or more"),
        ("; nothing", "no move"),
    ] {
        let folder = with_program(program);
        let before = listing(folder.path());
        let output = run(folder.path(), &["bore", "--path", "p.ngc", "--plot", "r.svg", "--json", "r.json"]);
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{stderr}");
        assert!(stderr.starts_with(&format!("edm-sim: --path p.ngc: {message}")), "{stderr}");
        assert_eq!(stderr.trim_end().lines().count(), 1, "{stderr}");
        assert_eq!(listing(folder.path()), before);
    }
    refused(&["--path", "good.toml", "--depth-mm", "1"], &["--path", "--depth-mm"]);
    refused(&["--path", "nowhere.ngc"], &["--path nowhere.ngc: cannot be read"]);
    let folder = with_program("G1 Z-1");
    let output = run(folder.path(), &["bore", "--path", "p.ngc", "--json", "p.ngc"]);
    assert_eq!(
        String::from_utf8(output.stderr).unwrap(),
        "edm-sim: --json p.ngc: must not be the G-code program itself\n"
    );
}

#[test]
fn the_same_seed_gives_the_same_report_and_another_seed_another() {
    let run_with = |seed: &str| {
        let folder = folder();
        let words: Vec<&str> = SHALLOW.into_iter().chain(["--quiet", "--seed", seed]).collect();
        let output = run(folder.path(), &words);
        assert!(output.stdout.is_empty() && output.stderr.is_empty());
        let mut report = report(folder.path());
        report["wall_time_s"] = Value::Null;
        report["seed"] = Value::Null;
        report
    };
    assert_eq!(run_with("7"), run_with("7"));
    assert_ne!(run_with("7"), run_with("8"));
}

#[test]
fn a_hole_that_is_not_bored_is_exit_code_1_and_says_why() {
    let folder = folder();
    for (signal, fault) in [("stop.open", "emergency stop"), ("dielectric.lost", "dielectric not OK")] {
        let text =
            format!("title = \"T\"\ndescription = \"D\"\n[[event]]\nat_s = 0.1\nsignal = \"{signal}\"\nvalue = true\n");
        fs::write(folder.path().join("event.toml"), text).unwrap();
        let words: Vec<&str> = SHALLOW.into_iter().chain(["--scenario", "event.toml"]).collect();
        let output = run(folder.path(), &words);
        let stdout = String::from_utf8(output.stdout).unwrap();
        assert_eq!(output.status.code(), Some(1), "{stdout}");
        for words in ["no hole (simulated)".into(), format!("0.010 mm requested, stopped: {fault}")] {
            assert!(stdout.contains(&words), "{words} in {stdout}");
        }
        let report = report(folder.path());
        assert_eq!(report["completed"], false);
        assert_eq!(report["faults"][0]["fault"], fault);
    }
}

#[test]
fn a_scenario_file_is_run_by_its_name() {
    let folder = folder();
    let words: Vec<&str> = SHALLOW.into_iter().chain(["--scenario", "good.toml"]).collect();
    assert_eq!(run(folder.path(), &words).status.code(), Some(0));
    assert_eq!(report(folder.path())["scenario"], "good.toml, workpiece.surface_mm=0.3");
}

#[test]
fn the_dry_loop_bores_without_a_spark() {
    let folder = folder();
    let words: Vec<&str> = SHALLOW.into_iter().chain(["--surrogate"]).collect();
    assert_eq!(run(folder.path(), &words).status.code(), Some(0));
    let report = report(folder.path());
    assert_eq!(report["discharges"], 0);
    assert_eq!(report["spark_ratio"], Value::Null);
    assert!((report["gap_um"]["mean"].as_f64().unwrap() - 40.0).abs() < 5.0, "{report}");
}

#[test]
fn the_lists_name_every_scenario_and_every_setting() {
    let folder = folder();
    let list = |word: &str| {
        let output = run(folder.path(), &[word]);
        assert_eq!(output.status.code(), Some(0));
        String::from_utf8(output.stdout).unwrap()
    };
    let scenarios = list("scenarios");
    for (name, _) in BUILT_IN {
        assert!(scenarios.lines().any(|line| line.starts_with(&format!("{name} "))), "{name}");
    }
    let settings = list("settings");
    for field in Plant::FIELDS.iter().chain(Settings::FIELDS) {
        assert!(settings.lines().any(|line| line.starts_with(&format!("{} ", field.key))), "{}", field.key);
    }
}

#[test]
fn the_bench_measures_relative_to_its_calibration_loop() {
    let folder = folder();
    let words =
        ["bench", "--runs", "1", "--depth-mm", "0.005", "--set", "workpiece.surface_mm=0.3", "--json", "b.json"];
    let output = run(folder.path(), &words);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let bench: Value = serde_json::from_str(&fs::read_to_string(folder.path().join("b.json")).unwrap()).unwrap();
    let median = &bench["median"];
    let number = |key: &str| median[key].as_f64().unwrap();
    assert!((number("relative_speed") / (number("realtime_cpu_ratio") * number("calibration_s")) - 1.0).abs() < 1e-9);
    assert_eq!(bench["realtime_cpu_ratio"], median["realtime_cpu_ratio"]);
    assert!((number("realtime_cpu_ratio") / (number("sim_time_s") / number("cpu_time_s")) - 1.0).abs() < 1e-9);
    // There is no bound for a scenario that was changed.
    assert_eq!(bench["bound"], Value::Null);
    assert!(bench["first_progress_s"].as_f64().is_some());
    assert_eq!(bench["runs"].as_array().unwrap().len(), 1);
}

#[test]
fn a_bench_below_its_bound_is_exit_code_1() {
    let folder = folder();
    let words = ["bench", "--runs", "1", "--depth-mm", "0.005", "--set", "workpiece.surface_mm=0.3", "--at-least"];
    for (bound, code) in [("0", 0), ("1000000", 1), ("-1", 2), ("x", 2)] {
        let output = run(folder.path(), &[&words[..], &[bound]].concat());
        assert_eq!(output.status.code(), Some(code), "{bound}");
    }
}

#[test]
fn descriptions_go_to_the_file_of_out_and_are_what_the_standard_output_gets() {
    let folder = folder();
    for words in [&["eds"][..], &["dbc", "--node-id", "7"]] {
        let shown = run(folder.path(), words);
        assert!(shown.status.success() && !shown.stdout.is_empty());
        let written = run(folder.path(), &[words, &["--out", "described"]].concat());
        assert!(written.status.success() && written.stdout.is_empty());
        assert_eq!(fs::read(folder.path().join("described")).unwrap(), shown.stdout);
        let before = listing(folder.path());
        let refused = run(folder.path(), &[words, &["--out", "sub"]].concat());
        assert_eq!(refused.status.code(), Some(2));
        let said = String::from_utf8(refused.stderr).unwrap();
        assert!(said.lines().count() == 1 && said.contains("--out sub: must be a file"), "{said}");
        assert!(refused.stdout.is_empty() && listing(folder.path()) == before);
    }
}
