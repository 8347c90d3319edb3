//! The rooms of this package use each other without a circle, as the sources say.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// Rooms that each room names by `crate::`, in its own sources, comments and tests left out.
fn uses() -> BTreeMap<String, BTreeSet<String>> {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut uses = BTreeMap::new();
    for entry in fs::read_dir(src).unwrap() {
        let path = entry.unwrap().path();
        let room = path.file_stem().unwrap().to_str().unwrap().to_owned();
        if room != "lib" && room != "main" {
            let named = uses.entry(room.clone()).or_default();
            gather(&path, named);
            named.remove(&room);
        }
    }
    uses
}

fn gather(path: &Path, named: &mut BTreeSet<String>) {
    if path.is_dir() {
        fs::read_dir(path).unwrap().for_each(|entry| gather(&entry.unwrap().path(), named));
        return;
    }
    if path.file_name().is_some_and(|name| name == "tests.rs") {
        return;
    }
    let text = fs::read_to_string(path).unwrap();
    let body = text.split("#[cfg(test)]\nmod tests").next().unwrap();
    for line in body.lines().filter(|line| !line.trim_start().starts_with("//")) {
        for behind in line.split("crate::").skip(1) {
            named.insert(behind.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect());
        }
    }
}

#[test]
fn no_room_uses_one_that_uses_it() {
    let mut left = uses();
    assert!(left["cli"].contains("sweep") && left["process"].contains("events"), "{left:?}");
    while !left.is_empty() {
        let rooms: BTreeSet<String> = left.keys().cloned().collect();
        let before = left.len();
        // Those that use none of what is left.
        left.retain(|_, uses| uses.intersection(&rooms).next().is_some());
        assert!(left.len() < before, "in a circle, or above one: {left:?}");
    }
}
