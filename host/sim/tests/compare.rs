//! `edm-sim compare`: laws side by side; the real program, in a folder of its own.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

/// A hole shallow enough for a test, near the work.
const SCENARIO: &str = "\
title = \"Short\"
description = \"A shallow hole.\"
[process]
\"workpiece.surface_mm\" = 0.3
";
const OF_ALL: [&str; 10] = [
    "--scenarios",
    "s.toml",
    "--laws",
    "increment_by_error,fixed_rate",
    "--variants",
    "reflex,late-reflex",
    "--seeds",
    "2",
    "--depth-mm",
    "0.003",
];

fn run(folder: &Path, words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_edm-sim")).arg("compare").args(words).current_dir(folder).output().unwrap()
}

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("s.toml"), SCENARIO).unwrap();
    folder
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

fn with(others: &[&'static str]) -> Vec<&'static str> {
    [&OF_ALL[..], others].concat()
}

#[test]
fn laws_are_compared_by_mean_and_confidence_in_words_json_and_pictures() {
    let folder = folder();
    let output = run(folder.path(), &with(&["--json", "c.json", "--plot", "p", "--csv", "c.csv"]));
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(text(&output.stdout).contains("| fixed_rate | 2 of 2 |"), "{}", text(&output.stdout));
    let json: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(folder.path().join("c.json")).unwrap()).unwrap();
    let cell = &json["variants"]["reflex 1 ms"]["laws"]["increment_by_error"]["s.toml"];
    // The mean of the rows.
    let mut rows = csv::Reader::from_path(folder.path().join("c.csv")).unwrap();
    let names = rows.headers().unwrap().clone();
    let at = |name: &str| names.iter().position(|other| other == name).unwrap();
    let times: Vec<f64> = rows
        .records()
        .map(Result::unwrap)
        .filter(|row| &row[at("law")] == "increment_by_error" && row[at("variant")].starts_with("reflex 1 ms"))
        .map(|row| row[at("machining_time_s")].parse().unwrap())
        .collect();
    assert_eq!(times.len(), 2);
    let mean = (times[0] + times[1]) / 2.0;
    assert!((cell["machining_time_s"]["mean"].as_f64().unwrap() - mean).abs() < 1e-9);
    // Of two values: t(0.975, 1) = 12.706, times half of their difference.
    let ci95 = 12.706_205 * (times[0] - times[1]).abs() / 2.0;
    assert!((cell["machining_time_s"]["ci95"].as_f64().unwrap() - ci95).abs() < 1e-4 * ci95.max(1e-3));
    for metric in ["mrr_mm3_min", "short_ratio", "ldr_short", "retreats_5um", "gap_rms_um", "wear_um"] {
        assert!(!cell[metric].is_null(), "{metric}");
    }
    let pictures: Vec<_> = fs::read_dir(folder.path().join("p")).unwrap().collect();
    assert_eq!(pictures.len(), 2, "one a variant");
}

#[test]
fn machining_time_is_the_whole_time_from_the_first_pulse_to_the_depth() {
    let folder = folder();
    let words =
        ["bore", "--scenario", "micro-blind", "--depth-mm", "0.006", "--json", "r.json", "--trace", "t.csv", "-q"];
    let program = env!("CARGO_BIN_EXE_edm-sim");
    assert!(Command::new(program).args(words).current_dir(folder.path()).status().unwrap().success());
    let report: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(folder.path().join("r.json")).unwrap()).unwrap();
    let mut trace = csv::Reader::from_path(folder.path().join("t.csv")).unwrap();
    let state = trace.headers().unwrap().iter().position(|name| name == "state").unwrap();
    // A row a millisecond.
    let states: Vec<String> = trace.records().map(|row| row.unwrap()[state].to_owned()).collect();
    let works = |state: &String| state == "eroding" || state == "retreating";
    let first = states.iter().position(works).unwrap();
    let last = states.iter().rposition(works).unwrap();
    let retreats = states[first..=last].iter().filter(|state| *state == "retreating").count();
    let [whole, eroding] = ["machining_time_s", "eroding_time_s"].map(|name| report[name].as_f64().unwrap());
    assert!((whole - (last - first + 1) as f64 * 1e-3).abs() < 2.5e-3, "{whole} s, {first} to {last} ms");
    assert!(
        retreats > 20 && whole > eroding + 0.9e-3 * retreats as f64,
        "{whole} {eroding} s, {retreats} ms of retreats"
    );
}

#[test]
fn shards_merge_to_the_same_comparison_and_rows_can_be_made_again() {
    let folder = folder();
    let whole = run(folder.path(), &with(&["--json", "whole.json", "--csv", "whole.csv"]));
    for (shard, csv) in [("1/2", "a.csv"), ("2/2", "b.csv")] {
        let part = run(folder.path(), &with(&["--shard", shard, "--csv", csv]));
        assert!(text(&part.stdout).contains("Part of the runs"), "{}", text(&part.stdout));
    }
    let merged = run(folder.path(), &["merge", "b.csv", "a.csv", "--json", "merged.json"]);
    assert_eq!((merged.status.code(), text(&merged.stdout)), (Some(0), text(&whole.stdout)));
    let read = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap();
    assert_eq!(read("merged.json"), read("whole.json"));
    let alone = run(folder.path(), &["merge", "a.csv"]);
    assert_eq!(alone.status.code(), Some(2));
    assert!(text(&alone.stderr).contains("4 of 8 runs are missing"), "{}", text(&alone.stderr));

    let again = run(folder.path(), &with(&["--csv", "whole.csv", "--recompute", "3"]));
    assert_eq!(again.status.code(), Some(0), "{}", text(&again.stdout));
    // Another last digit of a figure.
    let line = read("whole.csv").lines().nth(1).unwrap().to_owned();
    let cell = line.split(',').find(|cell| cell.starts_with("0.00") && cell.len() > 5).unwrap();
    let other = format!("{}{}", &cell[..cell.len() - 1], if cell.ends_with('1') { '2' } else { '1' });
    fs::write(folder.path().join("whole.csv"), read("whole.csv").replacen(cell, &other, 1)).unwrap();
    let again = run(folder.path(), &with(&["--csv", "whole.csv", "--recompute", "3"]));
    assert_eq!(again.status.code(), Some(1));
    assert!(text(&again.stdout).contains("run 1 differs"), "{}", text(&again.stdout));
}

#[test]
fn a_perturbed_model_is_another_run_and_its_variant_says_so() {
    let folder = folder();
    let rows = |others: &[&str]| -> Vec<(String, String, String, String)> {
        let words = ["--scenarios", "micro-blind", "--laws", "1tav,2tav", "--seeds", "2", "--depth-mm", "0.001"];
        let output = run(folder.path(), &[&words[..], others].concat());
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        let name = others.last().unwrap();
        let mut rows = csv::Reader::from_path(folder.path().join(name)).unwrap();
        let names = rows.headers().unwrap().clone();
        let at = |name: &str| names.iter().position(|other| other == name).unwrap();
        let cell = |row: &csv::StringRecord, name: &str| row[at(name)].to_owned();
        let cells = rows
            .records()
            .map(Result::unwrap)
            .map(|row| (cell(&row, "law"), cell(&row, "seed"), cell(&row, "sim_time_s"), cell(&row, "variant")));
        cells.collect()
    };
    let (published, perturbed) = (rows(&["--csv", "p.csv"]), rows(&["--perturb", "30", "--csv", "q.csv"]));
    assert_eq!(published.len(), perturbed.len());
    assert!(perturbed.iter().all(|row| row.3.ends_with("model +-30 %")), "{perturbed:?}");
    assert!(published.iter().zip(&perturbed).all(|(a, b)| a.2 != b.2), "{published:?} {perturbed:?}");
}

#[test]
fn set_points_are_tried_for_every_law_and_the_front_is_told() {
    let folder = folder();
    let output = run(folder.path(), &with(&["--set-points", "0.9,1", "--csv", "c.csv"]));
    let said = text(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(said.contains("### s.toml, reflex 1 ms, set point x 0.9\n"), "{said}");
    let front = said.split("### Pareto front of s.toml, reflex 1 ms\n").nth(1).unwrap();
    let first = front.lines().nth(3).unwrap();
    assert!(first.starts_with("| increment_by_error | ") || first.starts_with("| fixed_rate | "), "{front}");
    // 54 and 60 V.
    let rows = fs::read_to_string(folder.path().join("c.csv")).unwrap();
    assert!(rows.lines().any(|row| row.contains(",54.0,")) && rows.lines().any(|row| row.contains(",60.0,")));
    assert_eq!(rows.lines().count(), 1 + 16);
}

#[test]
fn bad_input_is_one_line_and_nothing_is_written() {
    let folder = folder();
    fs::write(folder.path().join("other.csv"), "a,b\n").unwrap();
    for (words, message) in [
        (&["--laws", "pid"][..], "--laws pid: no such law; the laws are increment_by_error, "),
        (&["--seeds", "0"], "--seeds 0: must be "),
        (&["--variants", "none"], "--variants none: no such variant; the variants are reflex, late-reflex, pauses"),
        (&["--perturb", "51"], "--perturb 51: must be a number from 0 to 50 %"),
        (&["--set-points", "1.6"], "--set-points 1.6: must be a number from 0.5 to 1.5"),
        (&["--scenarios", "nowhere"], "--scenario nowhere: no such scenario"),
        (&["--csv", "other.csv"], "--csv other.csv: has other content"),
        (&["--plot", "other.csv"], "--plot other.csv: must be a folder"),
        (&["--csv", "none.csv", "--recompute", "2"], "--csv none.csv: has no run 1 of "),
        (&["merge", "other.csv"], "other.csv: is not a table of a sweep"),
    ] {
        let output = run(folder.path(), words);
        let stderr = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{words:?}: {stderr}");
        assert!(stderr.starts_with(&format!("edm-sim: {message}")) && stderr.lines().count() == 1, "{stderr}");
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
}
