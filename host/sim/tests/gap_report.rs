//! `edm-sim gap-report` as a person meets it, and the page that it writes.

use edm_servo_head::gap::pulses::Class;
use edm_sim::gap_report::classifier::{Case, recall, uncertain};
use edm_sim::gap_report::notch;
use edm_sim::page::Page;
use serde_json::Value;
use std::path::Path;
use std::process::Command;

#[test]
fn the_figures_are_a_file_and_the_exit_code_says_whether_they_hold() {
    let folder = tempfile::tempdir().unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_edm-sim"))
        .args(["gap-report", "--short", "--json", "gap.json"])
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let json: Value = serde_json::from_slice(&std::fs::read(folder.path().join("gap.json")).unwrap()).unwrap();
    let keys: Vec<&str> = json.as_object().unwrap().keys().map(String::as_str).collect();
    assert_eq!(keys.len(), 12, "{keys:?}");
    for (pointer, low, high) in [
        ("/filter_error_counts_rms_max", 0.0, 0.01),
        ("/notch_drift_db_min", 40.0, 100.0),
        ("/classifier/open_spark_short_20db", 0.995, 1.0),
        ("/classifier/arc_16_20db", 0.97, 1.0),
        ("/classifier/arc_16_10db", 0.96, 0.98),
        ("/classifier/short_as_spark_20db", 0.0, 1.0),
        ("/likelihood/efficiency_min", 0.909, 1.1),
        ("/likelihood/chi2", 0.8, 1.2),
        ("/gated_average_shift", 0.0, 0.01),
        ("/plain_average_shift", 0.5, 1.0),
        ("/tau_error_um_single_rms", 0.1, 0.35),
        ("/tau_error_um_mean16_rms", 0.01, 0.1),
        ("/tau_error_um_single_max", 0.35, 0.75),
        ("/tau_error_um_mean16_max", 0.1, 0.3),
        ("/arc_named_ms_max", 0.0, 200.0),
        ("/arc_false", 0.0, 0.0),
    ] {
        let measured = json.pointer(pointer).and_then(Value::as_f64);
        assert!(measured.is_some_and(|measured| (low..=high).contains(&measured)), "{pointer}: {measured:?}");
    }
}

#[test]
fn a_short_report_is_not_written_into_the_page() {
    let folder = tempfile::tempdir().unwrap();
    for arguments in [&["--short", "--docs"][..], &["--long"], &["3"], &["--json", "no/such/folder.json"]] {
        let output = Command::new(env!("CARGO_BIN_EXE_edm-sim"))
            .arg("gap-report")
            .args(arguments)
            .current_dir(folder.path())
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert_eq!(String::from_utf8(output.stderr).unwrap().lines().count(), 1, "{arguments:?}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}

#[test]
fn the_page_has_every_table() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/gap-sensing.md");
    let page = Page::read(&page, "cargo sim gap-report").unwrap();
    let report = edm_sim::gap_report::measure(&edm_sim::gap_report::Size::SHORT).unwrap();
    // The full report has other figures, but the same rows.
    let rows = |text: &str| text.lines().filter(|line| line.starts_with('|')).count();
    assert_eq!(rows(page.section()), rows(&report.tables), "run `cargo sim gap-report --docs`");
}

#[test]
fn the_measurements_can_tell_a_bad_estimator() {
    // Noise that the classifier was not made for leaves more than the bound wrong.
    let confusion = Case::new(6.0, 16).run(20_000, 1);
    assert!(recall(&confusion, Class::Spark) < 0.96 && uncertain(&confusion, Class::Arc) > 0.9);
    // A notch at rest does not reach what is asked.
    let at_rest = notch::attenuation(&notch::CASES[0]).fixed;
    assert!(at_rest < 30.0, "{at_rest}");
}
