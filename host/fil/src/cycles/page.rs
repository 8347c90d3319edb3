//! The section of the documentation.

use super::bounds;
use super::report::{Measured, Scene};

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
        "pulses-100khz: eroding, 100 000 pulses/s",
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
    page += "\n| load, % of the processor | rest | moving | pulses-100khz |\n| --- | --- | --- | --- |\n";
    let [(_, rest), (_, moving), (_, fast)] = measured.scenes();
    for task in moving.load.keys() {
        let of = |scene: &Scene| scene.load.get(task).copied().unwrap_or(0.0);
        page += &format!("| {task} | {:.2} | {:.2} | {:.2} |\n", of(rest), of(moving), of(fast));
    }
    page += &format!("| all | {:.1} | {:.1} | {:.1} |\n", rest.load_percent, moving.load_percent, fast.load_percent);
    for (what, bounds) in [("gap, at most", bounds::GAP), ("all, at most", bounds::LOAD)] {
        let [rest, moving, fast] = bounds.map(|bound| bound.map_or_else(String::new, |bound| format!("{bound:.0}")));
        page += &format!("| {what} | {rest} | {moving} | {fast} |\n");
    }
    page += "\n| function or path | cycles a run | at most |\n| --- | --- | --- |\n";
    for (name, cycles) in &measured.functions {
        let most = bounds::FUNCTIONS.iter().find(|b| b.0 == name).map_or_else(String::new, |b| b.1.to_string());
        page += &format!("| {name} | {cycles:.1} | {most} |\n");
    }
    page
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
        };
        Measured {
            scenes: Pair {
                rest: scene(servo, worst, 20.1),
                moving: scene(600.0, 850, 40.2),
                fast: scene(servo, 700, 30.0),
            },
            functions: [("gap filter".to_owned(), filter), ("PID".to_owned(), 40.0)].into(),
        }
    }

    #[test]
    fn a_page_says_what_was_measured() {
        let page = markdown(&measured(490.0, 700, 79.0));
        assert!(page.contains("| rest: servo | 2 | 0 | 0 | 0 | 0 | 0 | 1 | 490.0 | 700 | 650, 1000 |"), "{page}");
        assert!(page.contains("| gap filter | 79.0 | 85 |"), "{page}");
    }

    #[test]
    fn bounds_are_about_mean_worst_load_and_functions() {
        let kept = |m: &Measured, what: &str| {
            bounds::wanted(m).into_iter().find(|f| f.what.starts_with(what)).map(|f| f.kept())
        };
        let good = measured(650.0, 1000, 85.0);
        let bad = measured(650.1, 1001, 85.1);
        for what in ["rest: servo, mean", "rest: servo, worst", "gap filter"] {
            assert_eq!((kept(&good, what), kept(&bad, what)), (Some(true), Some(false)), "{what}");
        }
        // What did not run keeps no bound.
        assert_eq!(kept(&good, "encoder edge"), Some(false));
    }

    #[test]
    fn a_task_that_is_too_long_for_its_period_and_a_full_processor_are_beyond_a_limit() {
        let over =
            |m: &Measured| bounds::limits(m).into_iter().filter(|f| !f.kept()).map(|f| f.what).collect::<Vec<_>>();
        assert_eq!(over(&measured(490.0, 4200, 79.0)), Vec::<String>::new());
        assert_eq!(over(&measured(490.0, 4201, 79.0)), ["rest: servo, worst, cycles"]);
        let mut heavy = measured(490.0, 700, 79.0);
        heavy.scenes.moving.load_percent = bounds::FULL[1];
        assert_eq!(over(&heavy), Vec::<String>::new());
        heavy.scenes.moving.load_percent = bounds::FULL[1] + 0.1;
        assert_eq!(over(&heavy), ["moving: load, %"]);
        let mut absent = measured(490.0, 700, 79.0);
        absent.scenes.rest.tasks.remove("gap");
        assert_eq!(over(&absent), ["rest: gap, worst, cycles"]);
    }
}
