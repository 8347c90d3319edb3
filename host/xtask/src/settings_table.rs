//! The page of settings.

use edm_servo_head::settings::{Change, Declared, Settings};
use std::fmt::Write;

/// Before the list of those that are guarded.
const GUARDED: &str = "
## Guarded while the head is enabled

What supervision, loop and reflex judge by is not widened under a live electrode. A host's write that would is refused with
abort 0800 0022h, and 2002h tells which setting and what it has to satisfy. Whatever is accepted of them, then or while
disabled, is told: bit 14 of the statusword turns over, so that TPDO1 is sent at once, and 200Ch:5 counts the changes and has
the address of the last. All others may change at any time.

| key | rule | else |
| --- | --- | --- |
";

/// The page, as Markdown.
pub fn render() -> String {
    let mut page = String::from(
        "# Settings of the head\n\n\
         Generated from src/settings/table.rs by `cargo xtask docs`. Set one with `--set key=value`, under `[head]` in a\n\
         scenario file, or by its object. \"assumed\" means that no source gives the value; [R] is Roberts 2014, [L] Lemeni.\n",
    );
    let defaults = Settings::default();
    let mut group = "";
    for (place, (field, (index, sub))) in Settings::FIELDS.iter().zip(Settings::ADDRESSES).enumerate() {
        let (prefix, _) = field.key.split_once('.').unwrap_or((field.key, ""));
        if prefix != group {
            group = prefix;
            let _ = write!(
                page,
                "\n## {group}\n\n| key | object | what it does | default | allowed | source |\n| --- | --- | --- | --- | --- | --- |\n"
            );
        }
        let default = defaults.get(place).map(|value| value.to_string().replace('"', "")).unwrap_or_default();
        let unit = if field.unit.is_empty() { String::new() } else { format!(" {}", field.unit) };
        let _ = writeln!(
            page,
            "| `{}` | {index:04X}h:{sub} | {} | {}{} | {} | {} |",
            field.key,
            field.doc.trim(),
            default,
            unit,
            field.allowed(),
            field.source
        );
    }
    page.push_str(GUARDED);
    for field in Settings::FIELDS.iter().filter(|field| field.change != Change::Live) {
        let _ = writeln!(page, "| `{}` | {} | {} |", field.key, field.change.rule(), field.hazard);
    }
    page
}
