//! The grid: lists of scenarios, depths, values and seeds, whose every combination is a run.
//!
//! A grid file is TOML: `scenarios`, `seeds`, `depth_mm` and a table `[set]` with the keys of `edm-sim settings`, each with
//! one value or a list. Runs are numbered in a fixed order: scenarios outermost, then depths, the values of the keys, the
//! last key fastest, and seeds innermost.

use crate::bore;
use crate::run::{Job, Setup};
use crate::scenario::{BUILT_IN, read_toml};
use std::collections::BTreeSet;
use std::fmt::Display;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Most runs of a grid.
const MOST: usize = 1_000_000;
/// Name of this layout of runs and rows: files of another are not continued.
const LAYOUT: &str = concat!("edm-sim.sweep/4 ", env!("CARGO_PKG_VERSION"));

/// Column of [`Lists::set_points`].
pub const SET_POINT_FACTOR: &str = "set_point_factor";

/// What is varied; an empty list was not given.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Lists {
    /// Names or files.
    pub scenarios: Vec<String>,
    /// Seeds.
    pub seeds: Vec<u64>,
    /// Depths, mm; without any, that of each scenario.
    pub depths_mm: Vec<f64>,
    /// Keys with their values.
    pub values: Vec<(String, Vec<String>)>,
    /// What sets several keys at a time, varied before the keys; a column each.
    pub choices: Vec<Choice>,
    /// Factors of the set point that is chosen then, a column when there are any; a set point that cannot be is left out.
    pub set_points: Vec<f64>,
    /// Share by which unpublished numbers of the model are changed, each at random, by the seed.
    pub perturbed: f64,
}

/// Names that stand for assignments, which may depend on the scenario.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// Of the column.
    pub name: String,
    /// Each with its assignments; `None` where it is nothing for a scenario.
    pub options: Vec<(String, Assignments)>,
}

/// What a name stands for in a scenario.
pub type Assignments = fn(&Setup) -> Option<Vec<String>>;

/// All runs.
#[derive(Debug)]
pub struct Grid {
    points: Vec<Point>,
    seeds: Vec<u64>,
    perturbed: f64,
    /// Keys that are varied.
    pub keys: Vec<String>,
    /// Identifies this grid.
    pub fingerprint: String,
}

/// One combination of everything but the seed.
#[derive(Debug)]
struct Point {
    setup: Setup,
    values: Vec<String>,
    depth_mm: f64,
    /// Why it cannot be run.
    refusal: Option<String>,
}

/// One run of a grid.
#[derive(Debug)]
pub struct Run<'a> {
    /// Its number, from 1.
    pub number: usize,
    /// Values of the keys that are varied.
    pub values: &'a [String],
    /// What is run.
    pub job: Job,
    /// Why it cannot be.
    pub refusal: Option<&'a str>,
}

impl Lists {
    /// Reads a grid file; `name` is what messages call it.
    ///
    /// # Errors
    /// File and line of what cannot be, in one line.
    pub fn parse(name: &str, text: &str) -> Result<Lists, String> {
        let (root, at) = read_toml(name, text)?;
        let mut lists = Lists::default();
        for (key, value) in root.get_ref() {
            let refused = |message: String| format!("{}: {message}", at(value.span().start));
            match key.get_ref().as_ref() {
                "scenarios" => lists.scenarios = words(value, text, "scenarios").map_err(refused)?,
                "seeds" => {
                    let words = words(value, text, "seeds").map_err(refused)?;
                    let one = matches!(value.get_ref(), DeValue::String(_));
                    let text = if one { words.concat() } else { words.join(",") + "," };
                    lists.seeds = seeds(&text).map_err(|message| refused(format!("seeds: {message}")))?;
                }
                "depth_mm" => {
                    let words = words(value, text, "depth_mm").map_err(refused)?;
                    let depth = |word: &String| {
                        word.parse().map_err(|_| refused(format!("depth_mm = {word}: must be a number of mm")))
                    };
                    lists.depths_mm = words.iter().map(depth).collect::<Result<_, _>>()?;
                }
                "set" => {
                    let DeValue::Table(table) = value.get_ref() else {
                        return Err(refused("set must be a table".into()));
                    };
                    keys(table, "", text, &mut lists.values)
                        .map_err(|(offset, message)| format!("{}: {message}", at(offset)))?;
                }
                other => {
                    let known = "there are scenarios, seeds, depth_mm, set";
                    return Err(format!("{}: {other}: no such entry; {known}", at(key.span().start)));
                }
            }
        }
        Ok(lists)
    }

    /// Adds `key=value,value,...` of the command line; it replaces the key of the grid file.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn vary(&mut self, assignment: &str) -> Result<(), String> {
        let refused = || format!("--set {assignment}: must be key=value,value,...");
        let (key, list) = assignment.split_once('=').ok_or_else(refused)?;
        let values: Vec<String> = list.split(',').map(|word| word.trim().to_owned()).collect();
        if key.trim().is_empty() || values.iter().any(String::is_empty) {
            return Err(refused());
        }
        self.values.retain(|(other, _)| other != key.trim());
        self.values.push((key.trim().into(), values));
        Ok(())
    }
}

/// A value, or a list of them, as words.
fn words(value: &Spanned<DeValue<'_>>, text: &str, name: &str) -> Result<Vec<String>, String> {
    let word = |value: &Spanned<DeValue<'_>>| match value.get_ref() {
        DeValue::String(word) => Ok(word.to_string()),
        DeValue::Integer(_) | DeValue::Float(_) | DeValue::Boolean(_) => {
            Ok(text.get(value.span()).unwrap_or_default().to_owned())
        }
        _ => Err(format!("{name}: must be a value or a list of values")),
    };
    let list = match value.get_ref() {
        DeValue::Array(list) => list.iter().map(word).collect::<Result<Vec<_>, _>>()?,
        _ => vec![word(value)?],
    };
    if list.is_empty() { Err(format!("{name}: the list is empty")) } else { Ok(list) }
}

/// Keys of a table and their values; dotted keys may be quoted or nested. An error carries its offset in the text.
fn keys(
    table: &DeTable<'_>,
    prefix: &str,
    text: &str,
    values: &mut Vec<(String, Vec<String>)>,
) -> Result<(), (usize, String)> {
    for (name, value) in table {
        let key = if prefix.is_empty() { name.get_ref().to_string() } else { format!("{prefix}.{}", name.get_ref()) };
        match value.get_ref() {
            DeValue::Table(inner) => keys(inner, &key, text, values)?,
            _ => {
                let list = words(value, text, &key).map_err(|message| (name.span().start, message))?;
                values.push((key, list));
            }
        }
    }
    Ok(())
}

/// Seeds as a person writes them: `20` for 1 to 20, `5..8` with both ends, `1,4,9` or `1..3,9` for a list.
///
/// # Errors
/// What they have to be.
pub fn seeds(text: &str) -> Result<Vec<u64>, String> {
    let refused = || format!("{text}: must be N for 1 to N, A..B, or a list as 1,4,9, at most {MOST} seeds, each once");
    let whole = |word: &str| word.trim().parse::<u64>().map_err(|_| refused());
    let mut seeds = Vec::new();
    // A comma behind it makes a list of a single number.
    let list = text.strip_suffix(',').unwrap_or(text);
    for part in list.split(',') {
        let (from, to) = match part.split_once("..") {
            Some((from, to)) => (whole(from)?, whole(to)?),
            None if list.len() == text.len() && part == text => (1, whole(part)?),
            None => (whole(part)?, whole(part)?),
        };
        if to < from || to - from >= MOST as u64 || seeds.len() >= MOST {
            return Err(refused());
        }
        seeds.extend(from..=to);
    }
    let each: BTreeSet<u64> = seeds.iter().copied().collect();
    if each.len() == seeds.len() { Ok(seeds) } else { Err(refused()) }
}

impl Grid {
    /// Every combination, checked as far as it does not depend on the others.
    ///
    /// # Errors
    /// A scenario, key, value or depth that cannot be, or a grid of which nothing can be run.
    pub fn new(lists: &Lists) -> Result<Grid, String> {
        let twice = |name: &dyn Display| format!("{name}: is twice in its list");
        for (key, values) in &lists.values {
            let each: BTreeSet<&String> = values.iter().collect();
            if each.len() < values.len() {
                return Err(twice(key));
            }
        }
        let each: BTreeSet<&String> = lists.scenarios.iter().collect();
        if each.len() < lists.scenarios.len() {
            return Err(twice(&"--scenario"));
        }
        let mut size =
            lists.scenarios.len().saturating_mul(lists.depths_mm.len().max(1)).saturating_mul(lists.seeds.len());
        for (_, values) in &lists.values {
            size = size.saturating_mul(values.len());
        }
        if !(1..=MOST).contains(&size) {
            return Err(format!("the grid has {size} runs: must be 1 to {MOST}"));
        }
        let mut points = Vec::new();
        for name in &lists.scenarios {
            let setup = Setup::load(name)?;
            let own = [setup.depth_mm];
            for &depth_mm in if lists.depths_mm.is_empty() { &own[..] } else { &lists.depths_mm } {
                within(&setup, depth_mm).map_err(|message| format!("--depth-mm {message}"))?;
                let point = Point { setup: setup.clone(), values: Vec::new(), depth_mm, refusal: None };
                choose(point, &lists.choices, lists, &mut points)?;
            }
        }
        if let Some(message) = points.iter().map(|point| point.refusal.as_ref()).collect::<Option<Vec<_>>>() {
            return Err(message.into_iter().next().cloned().unwrap_or_default());
        }
        if points.is_empty() {
            return Err("the grid has 0 runs: no law applies to these scenarios".into());
        }
        let choices = lists.choices.iter().map(|choice| choice.name.clone());
        let factor = (!lists.set_points.is_empty()).then(|| SET_POINT_FACTOR.to_owned());
        let keys = choices.chain(factor).chain(lists.values.iter().map(|(key, _)| key.clone())).collect();
        let fingerprint = fingerprint(&(LAYOUT, &points, &lists.seeds, lists.perturbed));
        Ok(Grid { points, seeds: lists.seeds.clone(), perturbed: lists.perturbed, keys, fingerprint })
    }

    /// Number of runs.
    pub fn len(&self) -> usize {
        self.points.len() * self.seeds.len()
    }

    /// The run of a number, from 1 to [`Grid::len`].
    pub fn run(&self, number: usize) -> Option<Run<'_>> {
        let index = number.checked_sub(1)?;
        let point = self.points.get(index / self.seeds.len())?;
        let seed = *self.seeds.get(index % self.seeds.len())?;
        let mut setup = point.setup.clone();
        setup.process.perturb(self.perturbed, seed);
        let job = Job {
            setup,
            depth_mm: point.depth_mm,
            path: None,
            table: None,
            seed,
            surrogate: false,
            coarse_error_um: 0.0,
        };
        Some(Run { number, values: &point.values, job, refusal: point.refusal.as_deref() })
    }
}

/// The points that come of one when the choices behind it are made, then the keys varied.
fn choose(point: Point, choices: &[Choice], lists: &Lists, points: &mut Vec<Point>) -> Result<(), String> {
    let Some((choice, others)) = choices.split_first() else {
        if lists.set_points.is_empty() {
            return expand(point, &lists.values, points);
        }
        return lists.set_points.iter().try_for_each(|factor| {
            let mut setup = point.setup.clone();
            // In tenths of a volt, as a person would.
            let volts = (f64::from(setup.head.gap_setpoint) * factor * 10.0).round() / 10.0;
            setup.set(&format!("gap.setpoint_v={volts}"))?;
            setup.name.clone_from(&point.setup.name);
            // A set point that cannot be is not tried.
            if bore::check(&setup).is_err() {
                return Ok(());
            }
            let values = point.values.iter().cloned().chain([factor.to_string()]).collect();
            expand(Point { setup, values, depth_mm: point.depth_mm, refusal: None }, &lists.values, points)
        });
    };
    for (name, assignments) in &choice.options {
        let Some(assignments) = assignments(&point.setup) else { continue };
        let mut setup = point.setup.clone();
        for assignment in assignments {
            setup.set(&assignment)?;
        }
        // A report of it is named by the column.
        setup.name.clone_from(&point.setup.name);
        let chosen = point.values.iter().chain([name]).cloned().collect();
        let point = Point { setup, values: chosen, depth_mm: point.depth_mm, refusal: None };
        choose(point, others, lists, points)?;
    }
    Ok(())
}

/// The points that come of one when the keys behind it are varied.
fn expand(point: Point, values: &[(String, Vec<String>)], points: &mut Vec<Point>) -> Result<(), String> {
    let Some(((key, list), others)) = values.split_first() else {
        let setup = &point.setup;
        let checked = bore::check(setup).map_err(|error| setup.refusal(error));
        let refusal = checked.and_then(|()| within(setup, point.depth_mm)).err();
        points.push(Point { refusal, ..point });
        return Ok(());
    };
    for word in list {
        let mut setup = point.setup.clone();
        setup.set(&format!("{key}={word}")).map_err(|message| format!("--set {message}"))?;
        let values = point.values.iter().chain([word]).cloned().collect();
        expand(Point { setup, values, depth_mm: point.depth_mm, refusal: None }, others, points)?;
    }
    Ok(())
}

fn within(setup: &Setup, depth_mm: f64) -> Result<(), String> {
    let range = bore::depth_range_mm(setup);
    if range.contains(&depth_mm) {
        return Ok(());
    }
    Err(format!("{depth_mm}: must be a number from {} to {} mm", range.start(), range.end()))
}

/// FNV-1a with 64 bits of everything that the runs depend on.
fn fingerprint(of: &impl std::fmt::Debug) -> String {
    let hash = format!("{of:?}")
        .bytes()
        .fold(0xcbf2_9ce4_8422_2325u64, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3));
    format!("{hash:016x}")
}

/// Names of the scenarios that come with the program.
pub fn built_in() -> Vec<String> {
    BUILT_IN.iter().map(|(name, _)| (*name).to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lists() -> Lists {
        Lists { scenarios: vec!["default".into()], seeds: vec![1, 2], depths_mm: vec![0.1], ..Lists::default() }
    }

    #[test]
    fn seeds_are_a_count_a_range_or_a_list() {
        assert_eq!(seeds("3"), Ok(vec![1, 2, 3]));
        assert_eq!(seeds("5..7"), Ok(vec![5, 6, 7]));
        assert_eq!(seeds("0..0"), Ok(vec![0]));
        assert_eq!(seeds("3,"), Ok(vec![3]));
        assert_eq!(seeds("1,9, 4"), Ok(vec![1, 9, 4]));
        assert_eq!(seeds("1..3,9"), Ok(vec![1, 2, 3, 9]));
        for text in ["", ",", "0", "x", "3..1", "1,,2", "1,1", "1..3,2", "-1", "1.5", "1..2000000", "..3", "1.."] {
            assert!(seeds(text).unwrap_err().starts_with(&format!("{text}: must be ")), "{text}");
        }
    }

    #[test]
    fn a_file_says_what_is_varied() {
        let text = "scenarios = [\"default\", \"sinker-dirty\"]\nseeds = [3]\ndepth_mm = 0.2\n[set]\ngap.setpoint_v = [55, 60.5]\n\"feed.law\" = \"fixed_rate\"";
        let lists = Lists::parse("g.toml", text).unwrap();
        assert_eq!(lists.scenarios, ["default", "sinker-dirty"]);
        assert_eq!((lists.seeds, lists.depths_mm), (vec![3], vec![0.2]));
        let values = [("feed.law", vec!["fixed_rate"]), ("gap.setpoint_v", vec!["55", "60.5"])];
        let values = values.map(|(key, words)| (key.to_owned(), words.into_iter().map(String::from).collect()));
        assert_eq!(lists.values, values);
        assert_eq!(Lists::parse("g.toml", "seeds = \"2..4\"").unwrap().seeds, [2, 3, 4]);
    }

    #[test]
    fn a_file_that_says_nonsense_is_refused_with_its_line() {
        for (text, message) in [
            ("\nseeds = []", "g.toml:2: seeds: the list is empty"),
            ("seeds = [1, 1]", "g.toml:1: seeds: 1,1,: must be "),
            ("scenarios = [[1]]", "g.toml:1: scenarios: must be a value or a list of values"),
            ("depth_mm = \"deep\"", "g.toml:1: depth_mm = deep: must be a number of mm"),
            ("[set]\ngap.setpoint_v = []", "g.toml:2: gap.setpoint_v: the list is empty"),
            ("set = 1", "g.toml:1: set must be a table"),
            ("seed = 1", "g.toml:1: seed: no such entry; there are scenarios, seeds, depth_mm, set"),
            ("seeds = [", "g.toml:1: not TOML: "),
        ] {
            let error = Lists::parse("g.toml", text).unwrap_err();
            assert!(error.starts_with(message) && !error.contains('\n'), "{error}");
        }
    }

    #[test]
    fn every_combination_is_a_run_in_a_fixed_order() {
        let mut lists = Lists { depths_mm: vec![0.1, 0.2], ..lists() };
        lists.vary("gap.setpoint_v=55,60").unwrap();
        lists.vary("axis.stroke_um=5000, 6000").unwrap();
        let grid = Grid::new(&lists).unwrap();
        assert_eq!(grid.len(), 16);
        let run = |number| grid.run(number).map(|run| (run.job.depth_mm, run.values.join(" "), run.job.seed)).unwrap();
        assert_eq!(run(1), (0.1, "55 5000".into(), 1));
        assert_eq!(run(2), (0.1, "55 5000".into(), 2));
        assert_eq!(run(3), (0.1, "55 6000".into(), 1));
        assert_eq!(run(5), (0.1, "60 5000".into(), 1));
        assert_eq!(run(16), (0.2, "60 6000".into(), 2));
        assert!(grid.run(0).is_none() && grid.run(17).is_none());
        assert_eq!(grid.run(5).unwrap().job.label(), "default, gap.setpoint_v=60, axis.stroke_um=5000");
    }

    #[test]
    fn another_list_is_another_grid() {
        let print = |lists: &Lists| Grid::new(lists).unwrap().fingerprint;
        let mut all = BTreeSet::from([print(&lists())]);
        for other in [
            Lists { seeds: vec![2, 1], ..lists() },
            Lists { depths_mm: vec![0.11], ..lists() },
            Lists { scenarios: vec!["sinker-dirty".into()], ..lists() },
            Lists { values: vec![("gap.setpoint_v".into(), vec!["55".into()])], ..lists() },
            Lists { values: vec![("gap.setpoint_v".into(), vec!["56".into()])], ..lists() },
        ] {
            assert!(all.insert(print(&other)), "{other:?}");
        }
        assert!(!all.insert(print(&lists())));
    }

    #[test]
    fn what_cannot_be_is_refused_and_a_combination_that_cannot_be_is_a_run_that_fails() {
        let refused = |lists: &Lists| Grid::new(lists).unwrap_err();
        let vary = |words: &str| {
            let mut lists = lists();
            lists.vary(words).map(|()| lists)
        };
        for words in ["gap.setpoint_v", "gap.setpoint_v=", "gap.setpoint_v=55,,60", "=1"] {
            assert_eq!(vary(words).unwrap_err(), format!("--set {words}: must be key=value,value,..."));
        }
        assert!(refused(&vary("gap.setpont_v=55").unwrap()).starts_with("--set gap.setpont_v = 55: no such setting"));
        assert!(refused(&vary("gap.setpoint_v=55,999").unwrap()).starts_with("--set gap.setpoint_v = 999: must be"));
        assert_eq!(refused(&vary("gap.setpoint_v=55,55").unwrap()), "gap.setpoint_v: is twice in its list");
        assert!(
            refused(&Lists { depths_mm: vec![99.0], ..lists() }).starts_with("--depth-mm 99: must be a number from")
        );
        assert!(refused(&Lists { seeds: vec![], ..lists() }).starts_with("the grid has 0 runs"));
        // Of both values only one goes with the others.
        let grid = Grid::new(&vary("gap.setpoint_v=60,80").unwrap()).unwrap();
        let refusals: Vec<bool> = (1..=4).map(|run| grid.run(run).unwrap().refusal.is_some()).collect();
        assert_eq!(refusals, [false, false, true, true]);
        assert!(refused(&vary("gap.setpoint_v=80").unwrap()).contains("must be below gap.open_min_v"));
    }
}
