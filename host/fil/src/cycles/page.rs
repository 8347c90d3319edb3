//! The section of the documentation: written, and compared with what was committed.

use super::bounds;
use super::report::{Measured, Scene};
use std::collections::BTreeMap;

/// Growth over the committed page that is a regression, percent.
const TOLERANCE: f64 = 5.0;
/// What the section begins with.
const INTRODUCTION: &str =
    "Cycles of a Cortex-M4F at 168 MHz, from the release image on the modelled chip: instructions are exact, cycles an
estimate (a model, not silicon). A run is from entry to return, both included, interruptions not. *Mean*, *median* and
*worst* are estimated with the flash accelerator and the waits of the peripheral buses as they come
(`host/fil/src/cycles`), and are what the bounds are about. The other columns are of the median run: instructions,
estimate from *warm* flash and peripherals that do not wait, with its bounds *low* and *high*, and *cold*, which adds to
*high* five wait states for every line of flash that the run touches.
";

/// The section as Markdown.
pub fn markdown(measured: &Measured) -> String {
    let mut page = String::from(INTRODUCTION);
    let titles = [
        "rest: eroding, 25 000 pulses/s",
        "moving: eroding, 100 kcount/s, 10 000 shorts/s, SYNC at 1 kHz, 2 RPDO, 4 TPDO, SDO back to back",
    ];
    for (((name, scene), title), bound) in measured.scenes().into_iter().zip(titles).zip(bounds::TASKS) {
        page += &format!(
            "\n| {title} | runs | instructions | low | warm | high | cold | median | mean | worst | bounds |\n\
             | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n"
        );
        for (task, f) in &scene.tasks {
            let t = f.typical;
            let most = bound.iter().find(|b| b.0 == task).map_or_else(String::new, |b| format!("{}, {}", b.1, b.2));
            page += &format!(
                "| {name}: {task} | {} | {} | {} | {} | {} | {} | {} | {:.1} | {} | {most} |\n",
                f.runs,
                t.instructions,
                t.low,
                t.warm,
                t.high,
                t.cold(),
                f.median,
                f.mean,
                f.worst
            );
        }
    }
    page += "\n| load, % of the processor | rest | moving |\n| --- | --- | --- |\n";
    let [(_, rest), (_, moving)] = measured.scenes();
    for task in moving.load.keys() {
        let of = |scene: &Scene| scene.load.get(task).copied().unwrap_or(0.0);
        page += &format!("| {task} | {:.2} | {:.2} |\n", of(rest), of(moving));
    }
    page += &format!("| all | {:.1} | {:.1} |\n", rest.load_percent, moving.load_percent);
    page += &format!("| at most | {:.0} | {:.0} |\n", bounds::LOAD[0], bounds::LOAD[1]);
    page += "\n| function or path | cycles a run | at most |\n| --- | --- | --- |\n";
    for (name, cycles) in &measured.functions {
        let most = bounds::FUNCTIONS.iter().find(|b| b.0 == name).map_or_else(String::new, |b| b.1.to_string());
        page += &format!("| {name} | {cycles:.1} | {most} |\n");
    }
    page
}

/// Figures that are compared, by name.
fn figures(measured: &Measured) -> BTreeMap<String, f64> {
    let mut list = BTreeMap::new();
    for (name, scene) in measured.scenes() {
        list.insert(format!("{name}: load, %"), scene.load_percent);
        for (task, f) in &scene.tasks {
            list.insert(format!("{name}: {task}, mean"), f.mean);
            list.insert(format!("{name}: {task}, worst"), f.worst as f64);
        }
    }
    list.extend(measured.functions.iter().map(|(name, cycles)| (name.clone(), *cycles)));
    list
}

/// The same from a committed section.
fn committed(section: &str) -> BTreeMap<String, f64> {
    let mut list = BTreeMap::new();
    for line in section.lines() {
        let cells: Vec<_> = line.split('|').map(str::trim).collect();
        let number = |i: usize| cells.get(i).and_then(|c| c.parse::<f64>().ok());
        let mut add = |name: String, value: Option<f64>| value.map(|value| list.insert(name, value));
        match (cells.len(), cells.get(1)) {
            (13, Some(task)) => {
                add(format!("{task}, mean"), number(9));
                add(format!("{task}, worst"), number(10));
            }
            (5, Some(&"all")) => {
                add("rest: load, %".to_owned(), number(2));
                add("moving: load, %".to_owned(), number(3));
            }
            // A row of the functions: the third cell is a bound or nothing. Rows of the load have figures of two places.
            (5, Some(name)) if cells[2].split('.').nth(1).is_some_and(|places| places.len() == 1) => {
                add((*name).to_owned(), number(2));
            }
            _ => {}
        }
    }
    list
}

/// What has grown against the committed section, or is gone from either.
pub fn regressions(measured: &Measured, section: &str) -> Vec<String> {
    let (new, old) = (figures(measured), committed(section));
    let mut list = Vec::new();
    for (name, value) in &new {
        match old.get(name) {
            None => list.push(format!("{name}: not in the committed table")),
            Some(was) if *value > was * (1.0 + TOLERANCE / 100.0) => {
                list.push(format!("{name}: {value}, {was} committed"))
            }
            Some(_) => {}
        }
    }
    let gone = old.keys().filter(|name| !new.contains_key(*name));
    list.extend(gone.map(|name| format!("{name}: committed, but not measured")));
    list
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cycles::report::{Figures, Pair};

    fn measured(servo: f64, worst: u64, filter: f64) -> Measured {
        let figures = |mean, worst| Figures { mean, median: 1, worst, runs: 2, ..Figures::default() };
        let scene = |mean, worst, load_percent| Scene {
            load_percent,
            tasks: [("servo".to_owned(), figures(mean, worst)), ("gap".to_owned(), figures(900.0, 950))].into(),
            load: [("servo".to_owned(), 9.25), ("gap".to_owned(), load_percent - 9.25)].into(),
            ..Scene::default()
        };
        Measured {
            scenes: Pair { rest: scene(servo, worst, 20.1), moving: scene(600.0, 850, 40.2) },
            functions: [("gap filter".to_owned(), filter), ("PID".to_owned(), 40.0)].into(),
        }
    }

    #[test]
    fn a_page_says_what_was_measured() {
        let page = markdown(&measured(490.0, 700, 79.0));
        assert_eq!(committed(&page), figures(&measured(490.0, 700, 79.0)));
    }

    #[test]
    fn growth_beyond_the_tolerance_is_a_regression_of_mean_worst_load_and_functions() {
        let page = markdown(&measured(490.0, 700, 79.0));
        assert_eq!(regressions(&measured(510.0, 730, 82.0), &page), Vec::<String>::new());
        let found = regressions(&measured(520.0, 740, 84.0), &page);
        assert_eq!(
            found,
            [
                "gap filter: 84, 79 committed",
                "rest: servo, mean: 520, 490 committed",
                "rest: servo, worst: 740, 700 committed"
            ]
        );
        let mut heavy = measured(490.0, 700, 79.0);
        heavy.scenes.moving.load_percent = 43.0;
        assert_eq!(regressions(&heavy, &page), ["moving: load, %: 43, 40.2 committed"]);
    }

    #[test]
    fn what_is_gone_or_new_is_a_regression() {
        let page = markdown(&measured(490.0, 700, 79.0));
        let mut other = measured(490.0, 700, 79.0);
        other.functions.remove("PID");
        other.functions.insert("new".to_owned(), 1.0);
        assert_eq!(regressions(&other, &page), ["new: not in the committed table", "PID: committed, but not measured"]);
    }

    #[test]
    fn bounds_are_about_mean_worst_load_and_functions() {
        let kept = |m: &Measured, what: &str| {
            bounds::check(m).into_iter().find(|f| f.what.starts_with(what)).map(|f| f.kept())
        };
        let good = measured(500.0, 800, 80.0);
        let bad = measured(500.1, 801, 80.1);
        for what in ["rest: servo, mean", "rest: servo, worst", "gap filter"] {
            assert_eq!((kept(&good, what), kept(&bad, what)), (Some(true), Some(false)), "{what}");
        }
        // What did not run keeps no bound.
        assert_eq!(kept(&good, "encoder edge"), Some(false));
    }
}
