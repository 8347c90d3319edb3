//! `edm-sim faults` and `edm-sim soak` as a person meets them.

use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

fn run(folder: &Path, words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_edm-sim")).args(words).current_dir(folder).output().unwrap()
}

/// One line on stderr that has this, exit code 2, nothing written.
fn refused(folder: &Path, words: &[&str], part: &str) {
    let before = fs::read_dir(folder).unwrap().count();
    let output = run(folder, words);
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!((output.status.code(), error.lines().count()), (Some(2), 1), "{words:?}: {error}");
    assert!(error.contains(part), "{words:?}: {error}");
    assert_eq!(fs::read_dir(folder).unwrap().count(), before, "{words:?}");
}

#[test]
fn a_pair_of_wires_is_a_row_of_json_and_of_the_page() {
    let folder = tempfile::tempdir().unwrap();
    let page =
        "# P\n<!-- cargo sim faults writes this section -->\nold\n<!-- end of what cargo sim faults writes -->\n";
    fs::write(folder.path().join("page.md"), page).unwrap();
    let words = ["faults", "--rows", "stop.open, then encoder.cut", "--json", "f.json", "--page", "page.md"];
    let output = run(folder.path(), &words);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let json: Value = serde_json::from_slice(&fs::read(folder.path().join("f.json")).unwrap()).unwrap();
    assert_eq!((&json["injected"], &json["detected"], &json["missed"]), (&1.into(), &1.into(), &0.into()));
    assert_eq!(json["rows"][0]["reported"], "emergency stop, encoder lost");
    let written = fs::read_to_string(folder.path().join("page.md")).unwrap();
    assert!(
        written.contains("| stop.open, then encoder.cut | open-loop lift, emergency lift |")
            && !written.contains("old"),
        "{written}"
    );
}

#[test]
fn parts_of_a_campaign_are_the_whole_campaign() {
    let folder = tempfile::tempdir().unwrap();
    let faults = |shard: &str| {
        run(folder.path(), &["faults", "--rows", "bridge.fault, then", "--shard", shard, "--json", "f.json"]);
        let json: Value = serde_json::from_slice(&fs::read(folder.path().join("f.json")).unwrap()).unwrap();
        json["rows"].as_array().unwrap().iter().map(|row| row["fault"].to_string()).collect::<Vec<_>>()
    };
    let mut parts = [faults("1/2"), faults("2/2")].concat();
    let mut whole = faults("1/1");
    parts.sort();
    whole.sort();
    assert_eq!((parts.len(), &parts), (17, &whole));
}

/// Rows of a campaign of settings.
fn settings(words: &[&str]) -> (Option<i32>, Vec<Value>) {
    let folder = tempfile::tempdir().unwrap();
    let output = run(folder.path(), &[&["faults", "--json", "f.json", "--settings"], words].concat());
    let json: Value = serde_json::from_slice(&fs::read(folder.path().join("f.json")).unwrap()).unwrap();
    (output.status.code(), json["rows"].as_array().unwrap().clone())
}

#[test]
fn constants_that_are_wrong_are_refused_with_the_reason_or_press_no_harder_than_5_n() {
    let (code, rows) = settings(&["constants", "--shard", "1/7"]);
    assert_eq!((code, rows.len()), (Some(0), 38));
    let (code, rows) = settings(&["constants", "--rows", "axis.counterbalance_n x 1.5"]);
    assert_eq!((code, rows.len()), (Some(0), 21));
    let alone = rows.iter().find(|row| row["fault"] == "axis.counterbalance_n x 1.5").unwrap();
    let why = alone["reported"].as_str().unwrap();
    assert!(why.starts_with("axis.counterbalance_n measures 2.2") && alone["reaction"] == "refused", "{why}");
}

#[test]
fn settings_at_their_ends_and_random_ones_press_no_harder_than_5_n() {
    // Each pressed 12 to 141 N once: no bound of velocity, a slow ramp under a dead encoder, a film that is not there.
    for end in ["feed.structure = \"single_loop\"", "seek.velocity_um_s = 50", "supervise.face_um = 30000"] {
        assert_eq!(settings(&["ends", "--rows", end]).0, Some(0), "{end}");
    }
    // 5 to 66 N: a film again, slow ramps while eroding and after a jump, a rise onto the upper stop that the lift did not see.
    for seed in ["10", "93", "137", "219", "335", "413"] {
        let set = format!("random set {seed}");
        assert_eq!(settings(&["random", "--seeds", seed, "--rows", &set]).0, Some(0), "{set}");
    }
}

#[test]
fn a_case_that_presses_is_told_and_one_that_does_not_is_sound() {
    let folder = tempfile::tempdir().unwrap();
    let case = |name: &str, steps: &str| fs::write(folder.path().join(name), format!("seed 1\n{steps}")).unwrap();
    // Far more than any head holds.
    case("hand", "+10 wire hand.force_n=40\n+4000 can 080#\n");
    let output = run(folder.path(), &["soak", "--case", "hand"]);
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.code() == Some(1) && said.contains("# contact beyond its bound"), "{said}");
    case("rest", "+10 can 000#0105\n+4000 can 080#\n");
    let output = run(folder.path(), &["soak", "--case", "rest"]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
}

#[test]
fn what_cannot_be_run_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("page.md"), "no section\n").unwrap();
    fs::write(folder.path().join("case"), "seed 1\n+1 sleep\n").unwrap();
    for (words, part) in [
        (&["faults", "--rows", "nothing"][..], "--rows nothing: must be part of the name of a fault"),
        (&["faults", "--rows", "sense.off", "--shard", "100/100"], "no name matches in part 100/100"),
        (&["faults", "--page", "page.md"], "has no section of `cargo sim faults`"),
        (&["faults", "--seeds", "0"], "--seeds"),
        (&["soak", "--hours", "0"], "must be a number from 0.001 to 100000"),
        (&["soak", "--hours", "0.001", "--shard", "2/2"], "there are only 1 runs"),
        (&["soak", "--case", "case"], "--case case:2: +1 sleep: must be"),
        (&["soak", "--case", "gone"], "cannot be read"),
    ] {
        refused(folder.path(), words, part);
    }
}
