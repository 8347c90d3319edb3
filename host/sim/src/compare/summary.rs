//! Means of the runs of a law, and how sure they are.
//!
//! The confidence is that of Student's t over seeds: half the width of the interval that holds the mean in 95 of 100
//! repetitions. Laws bored with the same seeds, so that a difference is evaluated pair by pair. Runs that did not reach their
//! depth have no machining time; their number is next to each mean.

use super::laws::LAWS;
use crate::sweep::grid::SET_POINT_FACTOR;
use crate::sweep::row::Row;
use serde_json::{Map, Value, json};
use statrs::distribution::{ContinuousCDF, StudentsT};
use std::fmt::Write;

/// A figure of a run; `None` where it has none.
type Figure = fn(&Row) -> Option<f64>;

/// The metrics, by their names in the JSON.
pub const METRICS: [(&str, Figure); 19] = [
    ("machining_time_s", |r| r.number("machining_time_s").filter(|_| is_complete(r))),
    // Over the machining time too: that of the row is over the eroding time.
    ("mrr_mm3_min", |r| {
        Some(r.number("removal_mm3_min")? * r.number("eroding_time_s")? / r.number("machining_time_s")?)
    }),
    ("discharges_per_s", |r| Some(r.number("discharges")? / r.number("sim_time_s")?)),
    ("discharges_per_100um", |r| Some(r.number("discharges")? / (r.number("hole_depth_mm")? * 10.0))),
    ("short_ratio", |r| r.number("short_ratio")),
    ("open_ratio", |r| r.number("open_ratio")),
    ("arc_ratio", |r| r.number("arc_ratio")),
    ("spark_ratio", |r| r.number("spark_ratio")),
    ("short_cycle_ratio", |r| r.number("short_cycle_ratio")),
    ("ldr_short", |r| r.number("long_retreats_shorted")),
    ("ldr_per_bridge", |r| {
        let shorts = r.number("shorts")?;
        (shorts > 0.0).then_some(r.number("long_retreats_shorted")? / shorts)
    }),
    ("retreats_5um", |r| r.number("long_retreats")),
    ("gap_rms_um", |r| r.number("gap_um.rms_error")),
    ("wear_um", |r| Some(r.number("wear_mm")? * 1e3)),
    ("damage", |r| r.number("damage_mean")),
    ("pit_um", |r| r.number("pit_um")),
    ("roughness_um", |r| r.number("crater_um")),
    ("servo_rms_mm_s", |r| r.number("velocity_mm_s")),
    ("depth_mm", |r| r.number("hole_depth_mm")),
];
/// Velocity above which a law trembles, mm/s rms.
const TREMBLES: f64 = 2.0;

/// Between the name of a variant and the factor of the set point.
const AT: &str = ", set point x ";
/// What a law that is not behind another in all of them is on the Pareto front by.
const FRONT: [&str; 5] = ["machining_time_s", "arc_ratio", "short_ratio", "wear_um", "damage"];

/// A mean over seeds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mean {
    pub of: f64,
    /// Half of the 95 % interval; `None` for a single run.
    pub ci95: Option<f64>,
}

/// The runs of a law in a scenario.
#[derive(Clone, Debug)]
pub struct Entry {
    pub variant: String,
    pub scenario: String,
    pub law: String,
    pub runs: usize,
    /// Those that reached their depth.
    pub complete: usize,
    /// In the order of [`METRICS`].
    pub means: Vec<Option<Mean>>,
    /// Difference of the machining time to that of the first law, by pairs of the same seed, as a share of it.
    pub longer: Option<Mean>,
}

/// All of them.
#[derive(Debug)]
pub struct Comparison {
    pub entries: Vec<Entry>,
    /// Runs that could not be made.
    pub failed: usize,
    /// Why, each with its run.
    failures: String,
}

fn is_complete(row: &Row) -> bool {
    row.text("completed").as_deref() == Some("true")
}

fn mean(values: &[f64]) -> Option<Mean> {
    let n = values.len() as f64;
    if values.is_empty() {
        return None;
    }
    let of = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|x| (x - of).powi(2)).sum::<f64>() / (n - 1.0);
    let student = StudentsT::new(0.0, 1.0, n - 1.0).ok();
    Some(Mean { of, ci95: student.map(|student| student.inverse_cdf(0.975) * (variance / n).sqrt()) })
}

impl Comparison {
    /// What the rows of a comparison hold.
    pub fn of(rows: &[Row]) -> Comparison {
        let key = |row: &Row| {
            let [mut variant, scenario, law] =
                ["variant", "scenario", "law"].map(|name| row.text(name).unwrap_or_default());
            if let Some(factor) = row.text(SET_POINT_FACTOR) {
                let _ = write!(variant, "{AT}{factor}");
            }
            [variant, scenario, law]
        };
        let mut keys: Vec<[String; 3]> = Vec::new();
        for row in rows {
            let key = key(row);
            if !keys.contains(&key) {
                keys.push(key);
            }
        }
        let seconds = METRICS[0].1;
        let entries = keys.iter().map(|of| {
            let runs: Vec<&Row> = rows.iter().filter(|row| key(row) == *of).collect();
            let first = keys.iter().find(|other| other[..2] == of[..2]).filter(|first| *first != of);
            let pair = |row: &&Row| {
                let other =
                    rows.iter().find(|other| Some(&key(other)) == first && other.text("seed") == row.text("seed"));
                let (mine, other) = (seconds(row)?, seconds(other?)?);
                Some(mine / other - 1.0)
            };
            let [variant, scenario, law] = of.clone();
            Entry {
                variant,
                scenario,
                law,
                runs: runs.len(),
                complete: runs.iter().filter(|row| is_complete(row)).count(),
                means: METRICS
                    .iter()
                    .map(|(_, figure)| mean(&runs.iter().filter_map(|row| figure(row)).collect::<Vec<_>>()))
                    .collect(),
                longer: mean(&runs.iter().filter_map(pair).collect::<Vec<_>>()),
            }
        });
        let entries = entries.collect();
        let mut failures = String::new();
        let failed = rows.iter().filter_map(|row| Some((row, row.text("error")?)));
        let failed = failed.map(|(row, error)| {
            let _ = writeln!(
                failures,
                "{}, seed {}: failed: {error}",
                key(row).join(", "),
                row.text("seed").unwrap_or_default()
            );
        });
        let failed = failed.count();
        Comparison { entries, failed, failures }
    }

    /// Variants and scenarios, each once.
    pub fn groups(&self) -> Vec<(&str, &str)> {
        let mut groups: Vec<(&str, &str)> =
            self.entries.iter().map(|e| (e.variant.as_str(), e.scenario.as_str())).collect();
        groups.dedup();
        let mut once = Vec::new();
        groups.into_iter().for_each(|group| {
            if !once.contains(&group) {
                once.push(group)
            }
        });
        once
    }

    /// The laws of a variant and scenario.
    pub fn laws<'a>(&'a self, (variant, scenario): (&'a str, &'a str)) -> impl Iterator<Item = &'a Entry> {
        self.entries.iter().filter(move |entry| entry.variant == variant && entry.scenario == scenario)
    }

    /// A table for each variant and scenario.
    pub fn table(&self, partly: bool) -> String {
        let mut text = String::new();
        for group in self.groups() {
            let _ = writeln!(text, "### {}, {}\n", group.1, group.0);
            text.push_str(
                "| law | done | time s | to the first, % | arcs % | shorts % | short cycles % | long retreats in a short | gap rms um | wear um |\n\
                 | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
            );
            for entry in self.laws(group) {
                let _ = writeln!(text, "{}", entry.row());
            }
            text.push('\n');
        }
        text.push_str(&self.fronts());
        text.push_str("Mean +- half of the 95 % confidence interval over seeds; simulated. *Time* is from the first pulse to the depth, without the seek, of completed holes;\n*to the first* is the difference to the first law, by pairs of the same seed. A law marked with ~ moves its axis at more than 2 mm/s rms.\n");
        let named = LAWS.iter().filter(|law| self.entries.iter().any(|entry| entry.law == law.name));
        named.for_each(|law| _ = writeln!(text, "- `{}`: {}", law.name, law.source));
        if partly {
            text.push_str("Part of the runs: `edm-sim compare merge` combines all parts.\n");
        }
        text.push_str(&self.failures);
        text
    }

    /// Laws at set points that no other one is better than or as good as in everything, for each scenario; nothing where no set
    /// points were tried.
    pub fn fronts(&self) -> String {
        let base = |entry: &Entry| entry.variant.split_once(AT).map(|(base, _)| base.to_owned());
        let mut text = String::new();
        let mut groups: Vec<(String, &str)> = Vec::new();
        for group in self.entries.iter().filter_map(|entry| Some((base(entry)?, entry.scenario.as_str()))) {
            if !groups.contains(&group) {
                groups.push(group);
            }
        }
        for (variant, scenario) in groups {
            let of_group = |entry: &&Entry| base(entry).as_ref() == Some(&variant) && entry.scenario == scenario;
            let all: Vec<(&Entry, [f64; FRONT.len()])> = self
                .entries
                .iter()
                .filter(of_group)
                .filter(|entry| entry.complete == entry.runs)
                .map(|entry| (entry, FRONT.map(|name| entry.metric(name).map_or(f64::INFINITY, |mean| mean.of))))
                .collect();
            let _ = writeln!(text, "### Pareto front of {scenario}, {variant}\n");
            text.push_str("| law | set point x | time s | arcs % | shorts % | wear um | damage |\n| --- | --- | --- | --- | --- | --- | --- |\n");
            let mut front: Vec<_> =
                all.iter().filter(|(_, mine)| !all.iter().any(|(_, other)| beats(other, mine))).collect();
            front.sort_by(|(_, a), (_, b)| a[0].total_cmp(&b[0]));
            for (entry, [time, arcs, shorts, wear, damage]) in front {
                let factor = entry.variant.split_once(AT).map_or("", |(_, factor)| factor);
                let _ = writeln!(
                    text,
                    "| {} | {factor} | {time:.1} | {:.2} | {:.2} | {wear:.1} | {damage:.3} |",
                    entry.law,
                    arcs * 100.0,
                    shorts * 100.0
                );
            }
            text.push('\n');
        }
        text
    }

    /// `{variants: {VARIANT: {laws: {NAME: {SCENARIO: {METRIC: {mean, ci95}}}}}}}`.
    pub fn json(&self) -> String {
        let mut variants = Map::new();
        for entry in &self.entries {
            let of_variant = variants.entry(entry.variant.clone()).or_insert_with(|| json!({ "laws": {} }));
            let laws = &mut of_variant["laws"];
            if laws.get(&entry.law).is_none() {
                laws[&entry.law] = json!({});
            }
            let mut cells: Map<String, Value> =
                METRICS.iter().zip(&entry.means).map(|((name, _), mean)| ((*name).to_owned(), value(*mean))).collect();
            cells.insert("longer_than_first_ratio".into(), value(entry.longer));
            cells.insert("runs".into(), json!(entry.runs));
            cells.insert("complete".into(), json!(entry.complete));
            laws[&entry.law][&entry.scenario] = Value::Object(cells);
        }
        serde_json::to_string_pretty(&json!({ "schema": "edm-sim.compare/1", "variants": variants }))
            .unwrap_or_default()
            + "\n"
    }
}

/// Nowhere worse, and somewhere better.
fn beats(a: &[f64], b: &[f64]) -> bool {
    a.iter().zip(b).all(|(a, b)| a <= b) && a.iter().zip(b).any(|(a, b)| a < b)
}

fn value(mean: Option<Mean>) -> Value {
    mean.map_or(Value::Null, |mean| json!({ "mean": mean.of, "ci95": mean.ci95 }))
}

impl Entry {
    /// A metric by its name.
    pub fn metric(&self, name: &str) -> Option<Mean> {
        let at = METRICS.iter().position(|(other, _)| *other == name)?;
        *self.means.get(at)?
    }

    fn row(&self) -> String {
        let cell = |mean: Option<Mean>, factor: f64, places: usize| match mean {
            None => "".into(),
            Some(Mean { of, ci95: None }) => format!("{:.places$}", of * factor),
            Some(Mean { of, ci95: Some(ci95) }) => format!("{:.places$} +- {:.places$}", of * factor, ci95 * factor),
        };
        let of = |name: &str, factor, places| cell(self.metric(name), factor, places);
        let mark = self.metric("servo_rms_mm_s").is_some_and(|mean| mean.of > TREMBLES);
        let cells = [
            format!("{}{}", self.law, if mark { " ~" } else { "" }),
            format!("{} of {}", self.complete, self.runs),
            of("machining_time_s", 1.0, 1),
            cell(self.longer, 100.0, 1),
            of("arc_ratio", 100.0, 2),
            of("short_ratio", 100.0, 2),
            of("short_cycle_ratio", 100.0, 2),
            of("ldr_short", 1.0, 1),
            of("gap_rms_um", 1.0, 2),
            of("wear_um", 1.0, 1),
        ];
        format!("| {} |", cells.join(" | "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mean_has_the_confidence_of_student() {
        // t(0.975, 4) = 2.776; deviation sqrt(2.5), error sqrt(0.5).
        let Mean { of, ci95 } = mean(&[1.0, 2.0, 3.0, 4.0, 5.0]).unwrap();
        assert_eq!(of, 3.0);
        assert!((ci95.unwrap() - 2.776_445 * 0.5f64.sqrt()).abs() < 1e-4);
        assert_eq!(mean(&[7.0]), Some(Mean { of: 7.0, ci95: None }));
        assert_eq!(mean(&[]), None);
    }

    #[test]
    fn who_is_nowhere_worse_and_somewhere_better_beats() {
        assert!(beats(&[1.0, 2.0], &[1.0, 3.0]));
        assert!(!beats(&[1.0, 2.0], &[1.0, 2.0]), "not itself");
        assert!(!beats(&[1.0, 4.0], &[2.0, 3.0]));
    }
}
