//! The task table that the firmware prints on a PC is the one in `main.rs`, and priorities there are what the critical
//! section counts on.

use edm_hal_shim::board::TASKS;

const MAIN: &str = include_str!("../src/main.rs");

/// Priority and binding in the task attribute before `fn name(`.
fn attribute(name: &str) -> (u8, Option<&'static str>) {
    let function = MAIN.find(&format!("fn {name}(")).unwrap_or_else(|| panic!("no task {name}"));
    let start = MAIN[..function].rfind("#[task(").unwrap();
    let attribute = &MAIN[start..function];
    let after = |key: &str| attribute.split_once(key).map(|(_, rest)| rest.split([',', ')']).next().unwrap().trim());
    (after("priority =").unwrap().parse().unwrap(), after("binds ="))
}

#[test]
fn every_task_has_the_priority_and_the_source_of_the_table() {
    for task in TASKS.iter().filter(|task| task.priority > 0) {
        let (priority, binds) = attribute(task.name);
        assert_eq!(priority, task.priority, "{}", task.name);
        assert_eq!(binds.unwrap_or("software"), task.source, "{}", task.name);
    }
}

#[test]
fn every_task_of_the_firmware_is_in_the_table() {
    assert_eq!(MAIN.matches("#[task(").count(), TASKS.iter().filter(|task| task.priority > 0).count());
}

#[test]
fn each_task_says_its_deadline() {
    for task in TASKS.iter().filter(|task| task.priority > 0) {
        let function = MAIN.find(&format!("fn {}(", task.name)).unwrap();
        let comment = &MAIN[MAIN[..function].rfind("\n\n").unwrap()..function];
        assert!(comment.contains("Deadline:") || comment.contains("As `"), "{}", task.name);
    }
}

#[test]
fn nothing_but_the_registers_is_unsafe() {
    assert!(!MAIN.contains("unsafe"));
}
