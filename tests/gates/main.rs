//! Gates: what the process model, the path and the gap estimators have to keep, a test for each group. Everything is simulated.
//!
//! `cargo test -p edm-tests --test gates -- [NAME..]` runs the groups of a push, `--include-ignored` all. `--csv FILE` writes a row
//! for each gate of what ran, `--plot DIR` a picture for each group that has one; both paths are relative to this package.

mod calibration;
mod findings;
mod gap;
mod gate;
mod mixed;
mod order;
mod path;
mod physics;
mod sensitivity;
mod statistics;
mod validation;

use edm_sim::plot;
use gap::Size;
use gate::Gate;
use libtest_mimic::{Arguments, Failed, Trial};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::{Arc, Mutex, PoisonError};

/// Gates that are run together.
#[derive(Clone, Copy)]
struct Group {
    name: &'static str,
    about: &'static str,
    run: fn() -> Vec<Gate>,
}

const fn group(name: &'static str, about: &'static str, run: fn() -> Vec<Gate>) -> Group {
    Group { name, about, run }
}

/// Groups that a push runs; the others are for a release.
const SHORT: [&str; 15] = [
    "charging",
    "removal",
    "swing",
    "depth",
    "monotony",
    "order",
    "hunting",
    "path",
    "gap-filter",
    "gap-notch",
    "gap-classes",
    "gap-likelihood",
    "gap-average",
    "gap-charging",
    "gap-arcs",
];

/// All groups, in the order in which they should hold.
const GROUPS: [Group; 32] = [
    group("charging", "[X] table 2: charging time against gap", calibration::charging),
    group("removal", "[X] table 4: removal against gap", calibration::removals),
    group("swing", "[R] section 4.3: the thesis machine's swing", calibration::swings),
    group("buzz", "a fast small motion of the electrode gains nothing", physics::buzz),
    group("set-point", "there is a best set point", physics::set_point),
    group("depth", "a deep hole is slow, jumps help", physics::depth),
    group("monotony", "a wider gap never lowers the voltage or raises the hazard", physics::monotony),
    group("mass", "debris is neither made nor lost", physics::mass),
    group("steps", "halving the step changes nothing", physics::steps),
    group("arcing", "arcs do not pay, in any scenario", findings::arcing),
    group("flushing", "jumps and flushing can be too little and too much", findings::flushing),
    group("reach", "[R]: the gap is 20 to 100 um, whatever the face", findings::reach),
    group("micro-buzz", "a buzz of [G]'s machine gains nothing", findings::micro_buzz),
    group("rc", "a plain RC generator sparks", findings::rc),
    group("threshold", "[G] figs. 6 and 7: discharge holding threshold", validation::threshold),
    group("retreats", "[G] figs. 11 and 14: long retreats and times", validation::retreats),
    group("off-time", "[G] fig. 9: short rate against off-time", validation::off_time),
    group("order", "[X] section 3: the order of the gap", order::orders),
    group("hunting", "[R] section 4.5: the slow CNC axis", validation::hunting),
    group("sensitivity", "each unpublished number by 1.5, down and up", sensitivity::sensitivity),
    group("path", "accuracy of the path in both directions", || path::gates(100_000)),
    group("path-full", "the same, a million reversals", || path::gates(1_000_000)),
    group("gap-filter", "the filters against scipy", gap::filters),
    group("gap-notch", "hum that drifts", gap::notches),
    group("gap-classes", "classes of labelled pulses", || gap::classes(&Size::SHORT)),
    group("gap-classes-full", "the same, a million of each case", || gap::classes(&Size::FULL)),
    group("gap-likelihood", "hazard of ignition", || gap::hazards(&Size::SHORT)),
    group("gap-likelihood-full", "the same, 20 000 estimates", || gap::hazards(&Size::FULL)),
    group("gap-average", "plain and gated average at two off-times", gap::averages),
    group("gap-charging", "gap by charging time", gap::captures),
    group("gap-arcs", "arcs that stay are named, and no others", || gap::persistent(&Size::SHORT)),
    group("gap-arcs-full", "the same, twenty seeds", || gap::persistent(&Size::FULL)),
];

/// Takes the value of an option of these tests from the arguments; the rest is for the harness.
fn take(arguments: &mut Vec<String>, option: &str) -> Result<Option<PathBuf>, String> {
    let Some(at) = arguments.iter().position(|argument| argument == option) else { return Ok(None) };
    if at + 1 >= arguments.len() {
        return Err(format!("{option}: a path is missing"));
    }
    let value = arguments.remove(at + 1);
    arguments.remove(at);
    Ok(Some(value.into()))
}

/// Draws what a group has to show.
fn draw(group: &Group, gates: &[Gate], folder: &Path) -> Result<(), String> {
    let figures: Vec<plot::Figure> = gates.iter().flat_map(|gate| gate.figures.clone()).collect();
    if figures.is_empty() {
        return Ok(());
    }
    let more = "simulated; bars: standard errors; black: published";
    let svg = plot::figures(&format!("{}: {}", group.name, group.about), more, &figures)?;
    let file = folder.join(format!("{}.svg", group.name));
    fs::create_dir_all(folder)
        .and_then(|()| fs::write(&file, svg))
        .map_err(|error| format!("{}: {error}", file.display()))
}

/// Writes a row for each gate, in the order of the groups.
fn write(file: &Path, done: &[(usize, Vec<Gate>)]) -> Result<(), csv::Error> {
    let mut table = csv::Writer::from_path(file)?;
    table.write_record(["group", "gate", "kind", "value", "wanted", "met", "note"])?;
    for (at, gates) in done {
        for gate in gates {
            let (kind, value) = (format!("{:?}", gate.kind).to_lowercase(), gate.value.to_string());
            let (wanted, met) = (gate.wanted.to_string(), if gate.pass { "yes" } else { "no" });
            table.write_record([GROUPS[*at].name, &gate.name, &kind, &value, &wanted, met, &gate.note])?;
        }
    }
    table.flush()?;
    Ok(())
}

fn run() -> Result<ExitCode, String> {
    let mut arguments: Vec<String> = std::env::args().collect();
    let (csv, plot) = (take(&mut arguments, "--csv")?, take(&mut arguments, "--plot")?);
    // The harness knows one filter: whole names of groups are taken here, as many as there are.
    let mut names = Vec::new();
    let mut before = String::new();
    arguments.retain(|argument| {
        let named = before != "--skip" && GROUPS.iter().any(|group| group.name == argument);
        before.clone_from(argument);
        if named {
            names.push(argument.clone());
        }
        !named
    });
    let mut arguments = Arguments::from_iter(arguments);
    // A group runs on all processors by itself.
    arguments.test_threads.get_or_insert(1);
    let done = Arc::new(Mutex::new(Vec::new()));
    let wanted = |name: &str| names.is_empty() || names.iter().any(|other| other == name);
    let trials = GROUPS.iter().enumerate().filter(|(_, group)| wanted(group.name)).map(|(at, group)| {
        let (done, plot) = (Arc::clone(&done), plot.clone());
        let test = move || {
            let gates = (group.run)();
            let said: Vec<String> = gates.iter().map(|gate| format!("\n  {gate}")).collect();
            println!("{}", said.concat());
            let failed: Vec<String> = gates.iter().filter(|gate| gate.fails()).map(Gate::to_string).collect();
            let drawn = plot.map_or(Ok(()), |folder| draw(group, &gates, &folder));
            done.lock().unwrap_or_else(PoisonError::into_inner).push((at, gates));
            drawn?;
            if failed.is_empty() { Ok(()) } else { Err(Failed::from(failed.join("\n"))) }
        };
        Trial::test(group.name, test).with_ignored_flag(!SHORT.contains(&group.name))
    });
    let conclusion = libtest_mimic::run(&arguments, trials.collect());
    if let Some(file) = csv {
        let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
        done.sort_by_key(|(at, _)| *at);
        write(&file, &done).map_err(|error| format!("{}: {error}", file.display()))?;
    }
    Ok(conclusion.exit_code())
}

fn main() -> ExitCode {
    run().unwrap_or_else(|error| {
        eprintln!("gates: {error}");
        ExitCode::from(2)
    })
}
