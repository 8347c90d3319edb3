//! The tasks by priority and the data between them: an N-squared chart of the task table and of the declarations in
//! runtime/src/crossings.rs.

use super::svg::{Anchor, Fill, Sheet};
use edm_hal_shim::board::TASKS;

const DECLARATIONS: &str = include_str!("../../../../runtime/src/crossings.rs");

/// A block: its name, its tasks in the table, and what crossings.rs calls it.
struct Block {
    name: &'static str,
    tasks: &'static [&'static str],
    called: &'static [&'static str],
}

const BLOCKS: [Block; 9] = [
    Block {
        name: "reflex, stop",
        tasks: &["reflex", "stop", "bridge_fault", "supply", "pulse_end", "pause_over"],
        called: &[],
    },
    Block { name: "encoder", tasks: &["encoder_a", "encoder_b", "encoder_index"], called: &[] },
    Block { name: "gap", tasks: &["gap"], called: &["gap task"] },
    Block { name: "servo", tasks: &["servo"], called: &["servo task"] },
    Block {
        name: "CAN",
        tasks: &["can_receive", "can_sync", "can_transmit"],
        called: &["receive interrupts", "transmit interrupt"],
    },
    Block { name: "plan", tasks: &["plan"], called: &["planner"] },
    Block { name: "supervise", tasks: &["supervise"], called: &["supervision"] },
    Block { name: "protocol", tasks: &["protocol"], called: &["protocol"] },
    Block { name: "idle", tasks: &["idle"], called: &["idle"] },
];

/// What crosses as atomics, which name no ends in crossings.rs: from, to, name.
const ATOMICS: [(&str, &str, &str); 7] = [
    ("reflex, stop", "servo", "retreats"),
    ("encoder", "servo", "count"),
    ("gap", "servo", "short_ticks"),
    ("gap", "servo", "touches"),
    ("CAN", "servo", "syncs"),
    ("protocol", "reflex, stop", "reflex"),
    ("protocol", "reflex, stop", "pauses"),
];

/// Size of a cell and the corner of the first.
const CELL: (f64, f64) = (102.0, 74.0);
const CORNER: (f64, f64) = (12.0, 12.0);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Latest,
    Ring,
    Atomic,
}

fn block(called: &str) -> Result<usize, String> {
    let called = called.to_lowercase();
    let found = BLOCKS.iter().position(|block| block.called.contains(&called.as_str()));
    found.ok_or(format!("runtime/src/crossings.rs: no block of the picture is called \"{called}\""))
}

/// Every crossing: from, to, kind, name.
fn crossings() -> Result<Vec<(usize, usize, Kind, &'static str)>, String> {
    let mut body = Vec::new();
    for structure in ["pub struct TickCrossings {", "pub struct Crossings {"] {
        let from = DECLARATIONS.find(structure).ok_or(format!("runtime/src/crossings.rs: no {structure}"))?;
        body.extend(DECLARATIONS[from..].lines().skip(1).take_while(|line| *line != "}"));
    }
    let (mut found, mut ends) = (Vec::new(), None);
    for line in body.into_iter().map(str::trim) {
        if let Some(doc) = line.strip_prefix("/// ") {
            let sentence = doc.split([':', '.']).next().unwrap_or(doc);
            let (from, to) =
                sentence.split_once(" to ").ok_or(format!("crossings.rs: \"{doc}\" names no two tasks"))?;
            ends = Some((block(from)?, block(to)?));
        } else if let Some((name, kind)) = line.trim_start_matches("pub(crate) ").split_once(": ") {
            let (from, to) = ends.take().ok_or(format!("crossings.rs: {name} does not say between whom"))?;
            let kind = match kind.split('<').next() {
                Some("Latest") => Kind::Latest,
                Some("Ring") => Kind::Ring,
                _ => return Err(format!("crossings.rs: {name} is of no kind that the picture knows")),
            };
            found.push((from, to, kind, name));
        }
    }
    for (from, to, name) in ATOMICS {
        let place = |name| BLOCKS.iter().position(|block| block.name == name).ok_or("an atomic names no block");
        found.push((place(from)?, place(to)?, Kind::Atomic, name));
    }
    Ok(found)
}

fn corner(row: usize, column: usize) -> (f64, f64) {
    (CORNER.0 + column as f64 * CELL.0, CORNER.1 + row as f64 * CELL.1)
}

pub fn draw() -> Result<String, String> {
    for task in TASKS {
        let blocks = BLOCKS.iter().filter(|block| block.tasks.contains(&task.name)).count();
        if blocks != 1 {
            return Err(format!("the task {} is in {blocks} blocks of the picture", task.name));
        }
    }
    let crossings = crossings()?;
    let side = BLOCKS.len() as f64;
    let (width, height) = (2.0 * CORNER.0 + side * CELL.0, CORNER.1 + side * CELL.1);
    let mut sheet =
        Sheet::new(width as u32, (height + 64.0) as u32, "Tasks, their priorities, and the data between them");
    for (place, Block { name, tasks, .. }) in BLOCKS.iter().enumerate() {
        for column in 0..BLOCKS.len() {
            let (x, y) = corner(place, column);
            sheet.rule(&[(x, y), (x + CELL.0, y), (x + CELL.0, y + CELL.1), (x, y + CELL.1), (x, y)]);
        }
        let (x, y) = corner(place, place);
        sheet.labelled((x + 4.0, y + 12.0), (CELL.0 - 8.0, CELL.1 - 24.0), Fill::Blue, "");
        let mut priorities: Vec<_> =
            TASKS.iter().filter(|task| tasks.contains(&task.name)).map(|task| task.priority.to_string()).collect();
        priorities.dedup();
        sheet.text((x + CELL.0 / 2.0, y + 34.0), 14, Anchor::Middle, name);
        let priority = format!("priority {}", priorities.join(", "));
        sheet.text((x + CELL.0 / 2.0, y + 52.0), 12, Anchor::Middle, &priority);
    }
    for from in 0..BLOCKS.len() {
        for to in 0..BLOCKS.len() {
            let here: Vec<_> = crossings.iter().filter(|crossing| (crossing.0, crossing.1) == (from, to)).collect();
            let (x, y) = corner(from, to);
            let first = y + CELL.1 / 2.0 + 5.0 - 8.0 * (here.len() as f64 - 1.0);
            for (line, (_, _, kind, name)) in here.iter().enumerate() {
                let at = (x + CELL.0 / 2.0, first + 16.0 * line as f64);
                match kind {
                    Kind::Latest => sheet.text(at, 13, Anchor::Middle, name),
                    Kind::Ring => sheet.slanted(at, 13, Anchor::Middle, name),
                    Kind::Atomic => sheet.text(at, 13, Anchor::Middle, &format!("({name})")),
                }
            }
        }
    }
    let legend = "A row shows the outputs of its task, a column its inputs. A higher number preempts a lower one.";
    sheet.text((CORNER.0, height + 26.0), 13, Anchor::Start, legend);
    sheet.text((CORNER.0, height + 46.0), 13, Anchor::Start, "upright: the newest value wins");
    sheet.slanted((CORNER.0 + 230.0, height + 46.0), 13, Anchor::Start, "slanted: a ring; lost entries are counted");
    sheet.text((CORNER.0 + 540.0, height + 46.0), 13, Anchor::Start, "(in brackets): an atomic; not all are shown");
    Ok(sheet.finish())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_declared_crossing_is_drawn() {
        let declared = DECLARATIONS.matches("pub(crate) ").count();
        assert_eq!(crossings().unwrap().len(), declared + ATOMICS.len());
        let picture = draw().unwrap();
        for (_, _, _, name) in crossings().unwrap() {
            assert!(picture.contains(name), "{name}");
        }
        for (_, _, name) in ATOMICS {
            // Two are published by hal-shim and by the decoder.
            let elsewhere = ["retreats", "count"].contains(&name);
            assert!(elsewhere || DECLARATIONS.contains(&format!("pub {name}: ")), "{name}");
        }
    }
}
