//! `edm-sim search`: the real program, in a folder of its own.

use std::path::Path;
use std::process::{Command, Output};

// The quicker of the two machines.
const SHORT: [&str; 6] = ["--machine", "micro", "--depth-mm", "0.001", "--evaluations", "12"];

fn run(folder: &Path, words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_edm-sim")).arg("search").args(words).current_dir(folder).output().unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8([&output.stdout[..], &output.stderr].concat()).unwrap()
}

#[test]
fn a_search_that_was_cut_goes_on_and_finds_what_it_would_have_found() {
    let folder = tempfile::tempdir().unwrap();
    let words = [&["--law", "fixed_rate", "--csv", "all.csv"][..], &SHORT].concat();
    let whole = run(folder.path(), &words);
    assert_eq!(whole.status.code(), Some(0), "{}", said(&whole));
    let table = std::fs::read_to_string(folder.path().join("all.csv")).unwrap();
    let lines: Vec<&str> = table.lines().collect();
    assert!(lines.len() > 11, "{table}");
    let cut = lines.len() * 3 / 4;
    std::fs::write(folder.path().join("part.csv"), lines[..cut].join("\n") + "\n").unwrap();
    let words = [&["--law", "fixed_rate", "--csv", "part.csv"][..], &SHORT].concat();
    let again = run(folder.path(), &words);
    assert_eq!(again.stdout, whole.stdout);
    assert_eq!(std::fs::read_to_string(folder.path().join("part.csv")).unwrap(), table);
    // The best of a table is what its search has said.
    assert_eq!(run(folder.path(), &["merge", "all.csv"]).stdout, whole.stdout);
    // Another swarm.
    let other = [&words[..], &["--shard", "2/2"]].concat();
    let refused = run(folder.path(), &other);
    assert_eq!(refused.status.code(), Some(2));
    assert!(said(&refused).contains("is of another search"), "{}", said(&refused));
}

#[test]
fn what_cannot_be_searched_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (words, message) in [
        (&["--law", "zigzag", "--machine", "sinker"][..], "no such law; the laws are increment_by_error,"),
        (&["--law", "fc", "--machine", "sinker", "--depth-mm", "100"], "--depth-mm 100: must be from"),
        (&["merge", "none.csv"], "none.csv: "),
        (&[], "--law <NAME> --machine <MACHINE>"),
    ] {
        let output = run(folder.path(), words);
        assert_eq!(output.status.code(), Some(2), "{words:?}: {}", said(&output));
        assert!(said(&output).contains(message), "{words:?}: {}", said(&output));
    }
}
