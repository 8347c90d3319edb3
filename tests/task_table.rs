//! The task table that the firmware prints on a PC is the one in `main.rs`, and priorities there are what the critical
//! section counts on.

use edm_hal_shim::board::{BOARDS, F405, TASKS, Task};
use edm_servo_head::head::Fault;
use std::fs;
use std::path::{Path, PathBuf};

const MAIN: &str = include_str!("../firmware/src/main.rs");

/// Tasks of the table that an interrupt runs.
fn tasks() -> impl Iterator<Item = &'static Task> {
    TASKS.iter().filter(|task| task.priority > 0)
}

/// Priority and binding in the task attribute before `fn name(`.
fn attribute(name: &str) -> (u8, &'static str) {
    let function = MAIN.find(&format!("fn {name}(")).unwrap_or_else(|| panic!("no task {name}"));
    let start = MAIN[..function].rfind("#[task(").unwrap();
    let attribute = &MAIN[start..function];
    let after = |key: &str| attribute.split_once(key).unwrap().1.split([',', ')']).next().unwrap().trim();
    (after("priority =").parse().unwrap(), after("binds ="))
}

#[test]
fn every_task_has_the_priority_and_the_source_of_the_table() {
    for task in tasks() {
        let (priority, binds) = attribute(task.name);
        assert_eq!(priority, task.priority, "{}", task.name);
        assert_eq!(binds, task.source, "{}", task.name);
    }
}

#[test]
fn every_task_of_the_firmware_is_in_the_table() {
    assert_eq!(MAIN.matches("#[task(").count(), tasks().count());
}

#[test]
fn each_task_says_its_deadline_its_cost_and_what_happens_when_it_is_late() {
    for Task { name, .. } in tasks() {
        let function = MAIN.find(&format!("fn {name}(")).unwrap();
        let comment = &MAIN[MAIN[..function].rfind("\n\n").unwrap()..function];
        let says = |word| comment.contains(word) || comment.contains("As `");
        assert!(says("Deadline:") && says("Cost:") && says("Late"), "{name}");
    }
}

/// Every Rust source file of a folder.
fn sources(folder: &Path) -> Vec<(PathBuf, String)> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(sources(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push((path.clone(), fs::read_to_string(path).unwrap()));
        }
    }
    found
}

#[test]
fn nothing_but_the_registers_is_unsafe() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let registers = root.join("hal-shim/src/stm32f4");
    for folder in ["src", "canopen", "runtime", "hal-shim/src", "host/sim", "host/xtask"] {
        for (path, text) in sources(&root.join(folder)) {
            let code = text.lines().map(|line| line.split("//").next().unwrap());
            let found = code.filter(|line| line.contains("unsafe ") && !line.contains("forbid(")).count();
            assert!(found == 0 || path.starts_with(&registers), "{}", path.display());
        }
    }
}

#[test]
fn no_register_is_waited_for_without_a_bound() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    for (path, text) in sources(&root.join("hal-shim/src/stm32f4")) {
        let endless = text.lines().filter(|line| {
            let line = line.trim_start();
            // A constant counts, for want of an iterator; nothing else does.
            (line.starts_with("while ") || line.starts_with("loop ")) && !line.starts_with("while i < ")
        });
        // The one that blinks without end, with the pins off, when the head did not start.
        let allowed = usize::from(path.ends_with("halt.rs"));
        assert_eq!(endless.count(), allowed, "{}", path.display());
    }
}

#[test]
fn the_wiring_page_has_every_pin_with_its_function() {
    let page = include_str!("../docs/wiring.md");
    for row in F405::TABLE.rows {
        let pin = row.pin.to_string();
        let claims = row.function.split([',', ' ']).filter(|word| word.contains('_') || word.starts_with("EXTI"));
        let claims: Vec<_> = claims.filter(|word| !word.starts_with("CAN")).collect();
        let mentions =
            |line: &str| line.starts_with('|') && line.contains(&pin) && claims.iter().all(|c| line.contains(c));
        assert!(page.lines().any(mentions), "{} on {pin}: {claims:?}", row.signal);
    }
    // Another board: what differs from the first.
    for (_, table) in BOARDS {
        assert!(page.contains(&format!("{} MHz", table.crystal_hz / 1_000_000)), "{}", table.name);
        for (row, first) in table.rows.iter().zip(F405::TABLE.rows).filter(|(row, first)| row.pin != first.pin) {
            let pins = [first.pin.to_string(), row.pin.to_string()];
            let mentions = |line: &str| line.starts_with('|') && pins.iter().all(|pin| line.contains(pin));
            assert!(page.lines().any(mentions), "{} of {}: {pins:?}", row.signal, table.name);
        }
        for (key, value) in table.defaults {
            let mentions = |line: &str| line.contains(key) && line.contains(&value.to_string());
            assert!(page.lines().any(mentions), "{key} = {value} of {}", table.name);
        }
    }
}

#[test]
fn the_architecture_page_has_a_row_for_every_fault() {
    let page = include_str!("../docs/architecture.md");
    let table = page.split("## Fault reactions").nth(1).unwrap().split("\n## ").next().unwrap();
    let rows: Vec<_> = table.lines().filter_map(|line| line.strip_prefix("| ")?.split(" |").next()).skip(2).collect();
    let names: Vec<_> = Fault::ALL.iter().map(|fault| fault.name()).collect();
    for name in &names {
        assert!(rows.contains(name), "no row for \"{name}\"");
    }
    for row in &rows {
        assert!(names.contains(row), "\"{row}\" is no fault");
    }
}
