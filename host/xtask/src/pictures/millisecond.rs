//! One millisecond of the tasks: hand-overs and their ticks from a run of the native head, the rest from its constants.

use super::svg::{Anchor, Fill, Sheet};
use edm_hal_shim::board::{TASKS, TICK_HZ};
use edm_servo_head::head::{Head, Inputs, LEAD};
use edm_servo_head::path::Path;
use edm_servo_head::settings::Settings;
use edm_servo_head::units::{PLAN_TICKS, TICKS_PER_MS};

const LEFT: f64 = 118.0;
const TICK: f64 = 41.0;
const ROWS: [(&str, f64); 5] =
    [("gap", 60.0), ("servo", 110.0), ("plan", 175.0), ("supervise", 240.0), ("protocol", 290.0)];
const HEIGHT: f64 = 26.0;

/// Of the ticks of a millisecond, those that hand an estimate over.
fn hand_overs() -> Result<Vec<u32>, String> {
    let active = Settings::default().build().map_err(|error| error.to_string())?;
    let mut head = Head::new(active.head, Box::new(Path::EMPTY));
    // From the second millisecond on nothing is the first of its kind.
    let ticks = (0..2 * TICKS_PER_MS).filter(|_| head.tick(&Inputs::default()).hands_over);
    let found: Vec<_> = ticks.filter_map(|tick| tick.checked_sub(TICKS_PER_MS)).collect();
    if found.windows(2).any(|pair| pair[1] - pair[0] != PLAN_TICKS) || found.is_empty() {
        return Err(format!("a head hands over in the ticks {found:?} of a millisecond"));
    }
    Ok(found)
}

fn tick(number: u32) -> f64 {
    LEFT + f64::from(number) * TICK
}

pub fn draw() -> Result<String, String> {
    let hand_overs = hand_overs()?;
    let mut sheet = Sheet::new(960, 380, "One millisecond of the tasks");
    let right = tick(TICKS_PER_MS);
    for number in 0..=TICKS_PER_MS {
        sheet.rule(&[(tick(number), 44.0), (tick(number), 330.0)]);
        if number < TICKS_PER_MS {
            sheet.text((tick(number) + TICK / 2.0, 38.0), 12, Anchor::Middle, &number.to_string());
        }
    }
    let period = 1_000_000 / TICK_HZ;
    sheet.text(
        (LEFT, 18.0),
        13,
        Anchor::Start,
        &format!("servo ticks of {period} us; widths are not to scale, and span what interrupts a task"),
    );
    for (name, y) in ROWS {
        let task = TASKS.iter().find(|task| task.name == name).ok_or(format!("no task {name}"))?;
        sheet.text((LEFT - 10.0, y + 12.0), 14, Anchor::End, name);
        sheet.text((LEFT - 10.0, y + 27.0), 12, Anchor::End, &format!("priority {}", task.priority));
        sheet.rule(&[(LEFT, y + HEIGHT), (right, y + HEIGHT)]);
    }
    let [gap, servo, plan, supervise, protocol] = ROWS.map(|(_, y)| y);
    for number in 0..TICKS_PER_MS {
        // A block is there at the end of each tick, for the next one.
        sheet.rect((tick(number + 1) - 9.0, gap), (7.0, HEIGHT), Fill::Light);
        let handed = hand_overs.contains(&number);
        let in_force = number.checked_sub(LEAD).is_some_and(|begun| hand_overs.contains(&begun));
        let fill = if handed {
            Fill::Blue
        } else if in_force {
            Fill::Orange
        } else {
            Fill::Plain
        };
        sheet.rect((tick(number), servo), (12.0, HEIGHT), fill);
        if handed {
            sheet.arrow(&[(tick(number) + 6.0, servo + HEIGHT), (tick(number) + 20.0, plan)]);
            sheet.rect((tick(number) + 14.0, plan), (42.0, HEIGHT), Fill::Light);
            if number + LEAD < TICKS_PER_MS {
                sheet.arrow(&[(tick(number) + 56.0, plan), (tick(number + LEAD) + 4.0, servo + HEIGHT)]);
            }
        }
    }
    // One behind the other, as their priorities have it, and under the servo ticks.
    sheet.rect((tick(1) + 18.0, supervise), (20.0, HEIGHT), Fill::Light);
    sheet.rect((tick(2) + 14.0, protocol), (110.0, HEIGHT), Fill::Light);
    let legend = [
        (Fill::Blue, "hands its estimate over".to_owned()),
        (Fill::Orange, format!("the plan made of it is in force, {LEAD} ticks later, exactly")),
        (Fill::Plain, "follows the plan in force".to_owned()),
    ];
    let mut x = LEFT;
    for (fill, says) in legend {
        sheet.rect((x, 346.0), (12.0, 18.0), fill);
        sheet.text((x + 18.0, 360.0), 13, Anchor::Start, &says);
        x += 40.0 + 6.7 * says.len() as f64;
    }
    Ok(sheet.finish())
}
