//! The page of settings.

use edm_servo_head::settings::{Change, Declared, Settings};
use std::fmt::Write;

/// Before the list of those that are guarded.
const GUARDED: &str = "
## Guarded while the head is enabled

While the head is enabled, no setting may change in a way that weakens supervision, loop or reflex. Such a write is refused with
abort 0800 0022h; 2002h names the setting and its rule. Every accepted change of these settings, enabled or disabled, toggles
bit 14 of the statusword, so TPDO1 is sent at once. 200Ch:5 counts the changes and has the address of the last one.
All others may change at any time.

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
