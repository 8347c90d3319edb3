//! The list of released objects against its own history: a line that was released stays, word for word and in its place.
//!
//! What the lines mean, and that the code keeps what they promise, is in tests/released_objects.rs.

use std::path::Path;
use std::process::Command;

/// The list, from the root.
const LIST: &str = "docs/released-objects.csv";
/// In the column of the version: not released yet, so the line may still change.
const NEXT: &str = "next";

/// Compares the list with every version of it that was ever committed, as far back as there is history; says what was compared.
///
/// # Errors
/// The first released line that is not what it was.
pub fn check(root: &Path) -> Result<String, String> {
    let now = std::fs::read_to_string(root.join(LIST)).map_err(|error| format!("{LIST}: {error}"))?;
    let Some(commits) = git(root, &["log", "--format=%H", "--", LIST]) else {
        return Ok(format!("{LIST}: no git history can be read here, not compared with earlier versions"));
    };
    let mut versions = 0;
    for commit in commits.lines() {
        // A commit that took the list away has none.
        let Some(then) = git(root, &["show", &format!("{commit}:{LIST}")]) else { continue };
        kept(&then, &now).map_err(|error| format!("{LIST}, compared with commit {commit:.12}: {error}"))?;
        versions += 1;
    }
    let shallow = git(root, &["rev-parse", "--is-shallow-repository"]).is_some_and(|answer| answer.trim() == "true");
    let as_far = if shallow { " of a history that was cut off" } else { "" };
    Ok(format!("{LIST}: keeps every released line of {versions} earlier versions{as_far}"))
}

/// What git prints; nothing without git, a repository, or what was asked for.
fn git(root: &Path, arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").arg("-C").arg(root).args(arguments).output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).into_owned())
}

/// Lines of a version of the list that were released when it was committed.
fn released(list: &str) -> impl Iterator<Item = &str> {
    list.lines().take_while(|line| line.split(',').nth(8) != Some(NEXT))
}

/// Whether a later version of the list begins with every released line of an earlier one.
fn kept(then: &str, now: &str) -> Result<(), String> {
    let mut lines = now.lines();
    for line in released(then) {
        match lines.next() {
            Some(same) if same == line => {}
            Some(other) => return Err(format!("a released line was changed, from\n  {line}\nto\n  {other}")),
            None => return Err(format!("a released line is gone:\n  {line}")),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "index,sub,type,unit,access,min,max,choices,since,name\n";
    const GAIN: &str = "0x2102,7,REAL32,um/s per V,rw,0.01,1000,,0.1.0,feed: gain, in the loop\n";
    const MASS: &str = "0x2106,1,REAL32,kg,rw,0.01,20,,0.1.0,axis: mass_kg\n";
    const NEWER: &str = "0x2106,9,REAL32,kg,rw,0.01,20,,next,axis: next_kg\n";

    fn list(lines: &[&str]) -> String {
        HEAD.to_owned() + &lines.concat()
    }

    #[test]
    fn lines_are_added_behind_those_that_were_released() {
        let then = list(&[GAIN, MASS]);
        for now in [list(&[GAIN, MASS]), list(&[GAIN, MASS, NEWER])] {
            assert_eq!(kept(&then, &now), Ok(()));
        }
        for now in [
            list(&[GAIN]),
            list(&[MASS]),
            list(&[MASS, GAIN]),
            list(&[GAIN, NEWER, MASS]),
            list(&[&GAIN.replace("1000", "100"), MASS]),
            list(&[GAIN, &MASS.replace("axis: ", "")]),
            then.replace("unit", "units"),
            String::new(),
        ] {
            assert!(kept(&then, &now).is_err(), "{now}");
        }
    }

    #[test]
    fn a_line_of_the_version_to_come_may_change_until_it_is_released() {
        let then = list(&[GAIN, NEWER]);
        let released = NEWER.replace(",next,", ",0.2.0,");
        for now in [list(&[GAIN]), list(&[GAIN, &NEWER.replace("20", "30")]), list(&[GAIN, &released])] {
            assert_eq!(kept(&then, &now), Ok(()));
        }
        assert!(kept(&list(&[GAIN, &released]), &then).is_err());
    }

    #[test]
    fn the_list_of_this_tree_keeps_its_history() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let said = check(&root).unwrap();
        assert!(said.starts_with(LIST), "{said}");
    }

    #[test]
    fn a_tree_without_history_says_so() {
        let root = tempfile::tempdir().unwrap();
        std::fs::create_dir(root.path().join("docs")).unwrap();
        std::fs::write(root.path().join(LIST), list(&[GAIN])).unwrap();
        assert!(check(root.path()).unwrap().contains("no git history"));
    }

    #[test]
    fn a_released_line_that_was_changed_is_named_with_the_commit_that_had_it() {
        let root = tempfile::tempdir().unwrap();
        let commit = |lines: &[&str]| {
            std::fs::create_dir_all(root.path().join("docs")).unwrap();
            std::fs::write(root.path().join(LIST), list(lines)).unwrap();
            git(root.path(), &["add", "."]).unwrap();
            let who = ["-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false"];
            git(root.path(), &[&who[..], &["commit", "-q", "-m", "list"]].concat()).unwrap();
        };
        git(root.path(), &["init", "-q"]).unwrap();
        commit(&[GAIN]);
        commit(&[GAIN, MASS]);
        assert!(check(root.path()).unwrap().ends_with("of 2 earlier versions"));
        // Also when the change itself was committed.
        commit(&[GAIN, &MASS.replace("20", "10"), NEWER]);
        let error = check(root.path()).unwrap_err();
        assert!(error.contains("axis: mass_kg") && error.contains("compared with commit "), "{error}");
    }
}
