//! `edm-sim path-report` as a person meets it, and the page that it writes.

use serde_json::Value;
use std::process::Command;

#[test]
fn the_figures_are_a_file_and_the_exit_code_says_whether_they_hold() {
    let folder = tempfile::tempdir().unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_edm-sim"))
        .args(["path-report", "--reversals", "20000", "--json", "path.json"])
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let json: Value = serde_json::from_slice(&std::fs::read(folder.path().join("path.json")).unwrap()).unwrap();
    assert_eq!((&json["reversals"], &json["segments"]), (&20_000.into(), &200.into()));
    assert_eq!((&json["retrace_error_counts"], &json["differing"]), (&0.0.into(), &0.into()));
    assert_eq!(json["reversal_ticks"], 0);
    let jumps = json["jump"].as_array().unwrap();
    for (jump, (height_mm, peak_m_s)) in jumps.iter().zip([(3.0, 0.30), (5.0, 0.45), (8.0, 0.60)]) {
        let figure = |name: &str| jump[name].as_f64().unwrap();
        assert!((figure("height_mm") - height_mm).abs() < 0.001 && figure("peak_m_s") >= peak_m_s, "{jump}");
        // Near its limits, or it would not have been a jump.
        assert!((0.85..=1.0).contains(&figure("acceleration_ratio")), "{jump}");
        assert!((0.85..=1.0).contains(&figure("jerk_ratio")), "{jump}");
        assert!(figure("overshoot_ratio") <= 0.1 && jump["touched"] == false, "{jump}");
    }
    assert_eq!(jumps.len(), 3);
    for (figure, bound) in [("ratio_error_counts_max", 0.5), ("arc_error_um_max", 0.1)] {
        let measured = json[figure].as_f64().unwrap();
        assert!(measured > 0.0 && measured <= bound, "{figure} {measured}");
    }
}

#[test]
fn too_few_reversals_are_bad_input() {
    let folder = tempfile::tempdir().unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_edm-sim"))
        .args(["path-report", "--reversals", "3", "--json", "path.json"])
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(!folder.path().join("path.json").exists());
}
