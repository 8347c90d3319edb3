//! `edm-sim sweep` over a grid: rows, resume, shards, merge; the real program, in a folder of its own.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use tempfile::TempDir;

/// Four combinations and two seeds of a hole shallow enough for a test; one combination cannot be.
const GRID: &str = "\
scenarios = [\"default\", \"sinker-dirty\"]
seeds = [3, 1]
depth_mm = 0.003
[set]
workpiece.surface_mm = 0.3
\"gap.setpoint_v\" = [55, 80]
";
const RUNS: usize = 8;

fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("g.toml"), GRID).unwrap();
    folder
}

fn command(folder: &Path, words: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_edm-sim"));
    command.arg("sweep").args(words).current_dir(folder);
    command
}

fn run(folder: &Path, words: &[&str]) -> Output {
    command(folder, words).output().unwrap()
}

fn read(folder: &Path, name: &str) -> String {
    fs::read_to_string(folder.join(name)).unwrap()
}

/// Every file with its content.
fn listing(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let name = |entry: &fs::DirEntry| entry.file_name().into_string().unwrap();
    fs::read_dir(folder)
        .unwrap()
        .map(Result::unwrap)
        .map(|entry| (name(&entry), fs::read(entry.path()).unwrap()))
        .collect()
}

/// The table of the whole grid, in both formats.
fn whole() -> (String, String) {
    let folder = folder();
    let output = run(folder.path(), &["--grid", "g.toml", "--csv", "a.csv", "--jsonl", "a.jsonl"]);
    let stderr = String::from_utf8(output.stderr).unwrap();
    // Runs that fail break a bound.
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert_eq!(stderr, "", "no progress bar where nobody looks");
    (read(folder.path(), "a.csv"), read(folder.path(), "a.jsonl"))
}

#[test]
fn every_combination_is_a_row_and_one_that_fails_loses_no_other() {
    let (csv, jsonl) = whole();
    let mut table = csv::Reader::from_reader(csv.as_bytes());
    let names = table.headers().unwrap().clone();
    let cell =
        |row: &csv::StringRecord, name: &str| row[names.iter().position(|other| other == name).unwrap()].to_owned();
    let rows: Vec<csv::StringRecord> = table.records().map(Result::unwrap).collect();
    assert_eq!(rows.len(), RUNS);
    for (k, row) in rows.iter().enumerate() {
        let (scenario, volts, seed) = (["default", "sinker-dirty"][k / 4], ["55", "80"][k / 2 % 2], ["3", "1"][k % 2]);
        assert_eq!((cell(row, "run"), cell(row, "runs")), ((k + 1).to_string(), RUNS.to_string()));
        assert!(cell(row, "scenario").starts_with(scenario), "{row:?}");
        assert_eq!((cell(row, "gap.setpoint_v"), cell(row, "seed")), (volts.into(), seed.into()));
        if volts == "80" {
            assert!(cell(row, "error").contains("must be below gap.open_min_v"), "{row:?}");
            assert_eq!(cell(row, "depth_mm"), "");
        } else {
            assert_eq!((cell(row, "error"), cell(row, "stop_reason")), (String::new(), "depth reached".into()));
            assert!((cell(row, "depth_mm").parse::<f64>().unwrap() - 0.003).abs() < 0.001);
        }
    }
    // The lines of JSON are the same rows.
    let objects: Vec<serde_json::Value> = jsonl.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(objects.len(), RUNS);
    for (object, row) in objects.iter().zip(&rows) {
        for name in &names {
            let text = match &object[name] {
                serde_json::Value::Null => String::new(),
                serde_json::Value::String(text) => text.clone(),
                other => other.to_string(),
            };
            assert_eq!(text, cell(row, name), "{name}");
        }
    }
}

#[test]
fn a_row_is_the_report_of_the_same_bore() {
    let folder = folder();
    let bore =
        ["bore", "--scenario", "sinker-dirty", "--seed", "1", "--depth-mm", "0.003", "--quiet", "--json", "r.json"];
    let sets = ["--set", "gap.setpoint_v=55", "--set", "workpiece.surface_mm=0.3"];
    let done = Command::new(env!("CARGO_BIN_EXE_edm-sim")).args(bore).args(sets).current_dir(folder.path()).status();
    assert!(done.unwrap().success());
    let report: serde_json::Value = serde_json::from_str(&read(folder.path(), "r.json")).unwrap();
    let row: serde_json::Value = serde_json::from_str(whole().1.lines().nth(5).unwrap()).unwrap();
    assert_eq!(row["seed"], report["seed"]);
    // A scenario with other values has a name of its own; what it took is of the computer; jumps have no column.
    let others = ["schema", "scenario", "wall_time_s", "jumps", "jumps_cramped"];
    let figures: Vec<_> =
        report.as_object().unwrap().iter().filter(|(name, _)| !others.contains(&name.as_str())).collect();
    for (name, figure) in figures.into_iter().filter(|(_, figure)| !figure.is_object() && !figure.is_array()) {
        assert_eq!(row.get(name), Some(figure), "{name}");
    }
}

#[test]
fn the_deepest_pit_of_arcs_is_in_the_row() {
    let folder = folder();
    let words = ["--scenario", "sinker-deep", "--seeds", "1", "--depth-mm", "0.003", "--jsonl", "pits.jsonl"];
    run(folder.path(), &words);
    let row: serde_json::Value = serde_json::from_str(&read(folder.path(), "pits.jsonl")).unwrap();
    assert!(row["pit_um"].as_f64().is_some_and(|um| um > 0.0), "{row}");
}

#[test]
fn shards_merge_to_the_rows_of_an_unsharded_run() {
    let (csv, jsonl) = whole();
    let folder = folder();
    for shard in ["1/3", "2/3", "3/3"] {
        let names = [format!("{}.csv", &shard[..1]), format!("{}.jsonl", &shard[..1])];
        run(folder.path(), &["--grid", "g.toml", "--shard", shard, "--csv", &names[0], "--jsonl", &names[1]]);
    }
    let merged = run(folder.path(), &["merge", "3.csv", "1.csv", "2.csv", "--out", "m.csv"]);
    assert_eq!(merged.status.code(), Some(1), "the runs that failed count");
    assert_eq!(read(folder.path(), "m.csv"), csv);
    let merged = run(folder.path(), &["merge", "2.jsonl", "1.jsonl", "3.jsonl", "3.jsonl"]);
    assert_eq!(String::from_utf8(merged.stdout).unwrap(), jsonl);

    let before = listing(folder.path());
    fs::write(folder.path().join("other.csv"), csv.replace("default", "another")).unwrap();
    fs::write(folder.path().join("nothing.csv"), "").unwrap();
    for (files, reason) in [
        (&["1.csv", "3.csv"][..], "3 of 8 runs are missing, the first of them is run 2"),
        (&["1.csv", "2.jsonl"], "2.jsonl: is not a table of the same grid"),
        (&["1.csv", "other.csv"], "run 1 is twice in the files, with different content"),
        (&["g.toml"], "g.toml: is not a table of a sweep"),
        (&["nothing.csv"], "nothing.csv: is not a table of a sweep"),
        (&["nowhere.csv"], "nowhere.csv: cannot be read"),
    ] {
        refused(folder.path(), &[&["merge"], files, &["--out", "x.csv"]].concat(), reason);
    }
    fs::remove_file(folder.path().join("other.csv")).unwrap();
    fs::remove_file(folder.path().join("nothing.csv")).unwrap();
    assert_eq!(listing(folder.path()), before);
}

#[test]
fn a_sweep_that_was_killed_goes_on_where_it_was() {
    let (csv, jsonl) = whole();
    let folder = folder();
    let words = ["--grid", "g.toml", "--csv", "a.csv", "--jsonl", "a.jsonl", "--jobs", "1"];
    let rows = |name: &str| fs::read_to_string(folder.path().join(name)).map_or(0, |text| text.lines().count());
    let mut child = command(folder.path(), &words).stdout(Stdio::null()).spawn().unwrap();
    while rows("a.csv") < 3 && child.try_wait().unwrap().is_none() {
        std::thread::yield_now();
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(rows("a.csv") >= 3);
    run(folder.path(), &words);
    assert_eq!((read(folder.path(), "a.csv"), read(folder.path(), "a.jsonl")), (csv, jsonl));
}

#[test]
fn a_file_that_was_cut_off_anywhere_is_continued() {
    let (csv, jsonl) = whole();
    let folder = folder();
    // In the names of the columns, at their end, in the first row and in a later one.
    let first = csv.find('\n').unwrap() + 1;
    for cut in [0, 10, first, first + 20, csv.len() * 2 / 3] {
        fs::write(folder.path().join("a.csv"), &csv[..cut]).unwrap();
        run(folder.path(), &["--grid", "g.toml", "--csv", "a.csv"]);
        assert_eq!(read(folder.path(), "a.csv"), csv, "cut at {cut}");
    }
    for cut in [5, 30, jsonl.len() / 2] {
        fs::write(folder.path().join("a.jsonl"), &jsonl[..cut]).unwrap();
        run(folder.path(), &["--grid", "g.toml", "--jsonl", "a.jsonl"]);
        assert_eq!(read(folder.path(), "a.jsonl"), jsonl, "cut at {cut}");
    }
}

#[test]
fn a_finished_row_is_not_made_again() {
    let (csv, _) = whole();
    let folder = folder();
    let marked = csv.replacen("depth reached", "as it was", 1);
    fs::write(folder.path().join("a.csv"), &marked).unwrap();
    run(folder.path(), &["--grid", "g.toml", "--csv", "a.csv"]);
    assert_eq!(read(folder.path(), "a.csv"), marked);
    // Lines in the order in which they finished are put in that of the runs.
    let mut lines: Vec<&str> = marked.lines().collect();
    lines[1..].reverse();
    fs::write(folder.path().join("a.csv"), lines.join("\n") + "\n").unwrap();
    run(folder.path(), &["--grid", "g.toml", "--csv", "a.csv"]);
    assert_eq!(read(folder.path(), "a.csv"), marked);
}

/// One line on stderr with these words, exit code 2, nothing on stdout.
fn refused(folder: &Path, words: &[&str], reason: &str) {
    let output = run(folder, words);
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{words:?}: {stderr}");
    assert_eq!(stderr.trim_end().lines().count(), 1, "{words:?}: {stderr}");
    assert!(stderr.contains(reason), "{words:?}: {reason:?} is not in {stderr}");
    assert!(output.stdout.is_empty());
}

#[test]
fn bad_input_is_one_line_and_nothing_is_written() {
    let folder = folder();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    write("empty.toml", "seeds = []\n");
    write("key.toml", "[set]\ngap.setpont_v = 55\n");
    write("value.toml", "[set]\n\"gap.setpoint_v\" = [55, 999]\n");
    write("entry.toml", "seed = 1\n");
    write("broken.toml", "seeds = [\n");
    write("notes.csv", "what I wanted to keep");
    write("notes.jsonl", "{\"what\": \"I wanted to keep\"}\n");
    write("unrelated.csv", "a,b\n1,2\n");
    let before = listing(folder.path());
    for (words, reason) in [
        (&["--set", "gap.setpont_v=55"][..], "did you mean gap.setpoint_v?"),
        (&["--set", "gap.setpoint_v=55,999"], "gap.setpoint_v = 999: must be a number"),
        (&["--set", "gap.setpoint_v="], "must be key=value,value,..."),
        (&["--set", "gap.setpoint_v"], "must be key=value,value,..."),
        (&["--set", "gap.setpoint_v=55,,60"], "must be key=value,value,..."),
        (&["--set", "gap.setpoint_v=80"], "must be below gap.open_min_v"),
        (&["--seeds", ""], "--seeds"),
        (&["--seeds", "5..1"], "--seeds 5..1: must be N for 1 to N"),
        (&["--seeds", "x"], "--seeds x: must be"),
        (&["--seeds", "0"], "--seeds 0: must be"),
        (&["--scenario", "defualt"], "did you mean default?"),
        (&["--scenario", "default,default"], "--scenario: is twice in its list"),
        (&["--depth-mm", "99"], "--depth-mm 99: must be a number from"),
        (&["--depth-mm", "NaN"], "--depth-mm NaN: must be a number from"),
        (&["--depth-mm", "deep"], "--depth-mm"),
        (&["--jobs", "0"], "--jobs"),
        (&["--shard", "0/3"], "must be I/N with I from 1 to N"),
        (&["--shard", "4/3"], "must be I/N with I from 1 to N"),
        (&["--shard", "3"], "must be I/N with I from 1 to N"),
        (&["--shard", "1/0"], "must be I/N with I from 1 to N"),
        (&["--shard", "9/9", "--scenario", "default", "--seeds", "2"], "the grid has only 2 runs"),
        (&["--grid", "nowhere.toml"], "--grid nowhere.toml: cannot be read"),
        (&["--grid", "empty.toml"], "empty.toml:1: seeds: the list is empty"),
        (&["--grid", "key.toml"], "gap.setpont_v = 55: no such setting"),
        (&["--grid", "value.toml"], "gap.setpoint_v = 999: must be a number"),
        (&["--grid", "entry.toml"], "entry.toml:1: seed: no such entry"),
        (&["--grid", "broken.toml"], "broken.toml:1: not TOML"),
        (&["--csv", "nowhere/a.csv"], "--csv nowhere/a.csv: must be a file that can be written"),
        (&["--csv", "notes.csv"], "--csv notes.csv: has other content than rows of this grid"),
        (&["--csv", "unrelated.csv"], "--csv unrelated.csv: has other content than rows of this grid"),
        (&["--jsonl", "notes.jsonl"], "--jsonl notes.jsonl: has other content than rows of this grid"),
        (&["--jsonl", "notes.csv"], "--jsonl notes.csv: has other content than rows of this grid"),
        (&["--csv", "x", "--jsonl", "./x"], "must be different files"),
        (&["--grid", "g.toml", "--csv", "g.toml"], "--csv g.toml"),
        (&["merge"], "FILE"),
    ] {
        let outputs: &[&str] = match words {
            ["merge"] => &[],
            _ if words.contains(&"--csv") || words.contains(&"--jsonl") => &[],
            _ => &["--csv", "r.csv", "--jsonl", "r.jsonl"],
        };
        refused(folder.path(), &[words, outputs].concat(), reason);
        assert_eq!(listing(folder.path()), before, "{words:?}");
    }
}

#[test]
fn the_rows_of_another_grid_are_left_alone() {
    let folder = folder();
    let shallow =
        ["--scenario", "default", "--set", "workpiece.surface_mm=0.3", "--depth-mm", "0.003", "--csv", "a.csv"];
    let with = |seeds: &'static str| [&shallow[..], &["--seeds", seeds]].concat();
    assert_eq!(run(folder.path(), &with("1")).status.code(), Some(0));
    let before = listing(folder.path());
    refused(folder.path(), &with("2"), "--csv a.csv: has other content than rows of this grid");
    assert_eq!(listing(folder.path()), before);
}
