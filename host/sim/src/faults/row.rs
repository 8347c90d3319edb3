//! A row: one fault that a campaign has injected, and the reaction of the head. `cargo sim faults` and `cargo fil faults` both
//! make rows, count them and write them here; docs/robustness.md says how they are evaluated.

use serde::{Deserialize, Serialize};
use std::fmt::Write;

/// Least share of the injected faults that is covered.
pub const COVERED: f64 = 0.99;
/// Largest share of them that is proved harmless instead of being named.
pub const HARMLESS: f64 = 0.1;
/// Rows that a page shows; `--json` has all of them.
const SHOWN: usize = 10;

/// A fault and the reaction of the head; of several runs the worst.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// What was injected.
    pub fault: String,
    /// What the head did about it.
    pub reaction: String,
    /// From the fault until the pulses were off, us; `None` when they were off before, or continued.
    pub time_us: Option<f64>,
    /// Faults and warnings that the head reported, by name; `None` when it reported nothing.
    pub reported: Option<String>,
    /// Greatest force between electrode and work, N.
    pub contact_n: f64,
    /// Greatest motor current from a second after the fault on, A.
    pub current_a: f64,
    /// The head works again when the cause is taken away and the fault reset.
    pub recovers: bool,
    /// Every bound of the campaign is kept; where nothing was reported, the fault is proved to do no harm.
    pub pass: bool,
}

/// What an injected fault counts as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The head has named it.
    Detected,
    /// Not named, and proved to do no harm.
    Harmless,
    /// Neither.
    Missed,
}

impl Row {
    /// What the fault counts as.
    pub fn outcome(&self) -> Outcome {
        match (&self.reported, self.pass) {
            (Some(_), _) => Outcome::Detected,
            (None, true) => Outcome::Harmless,
            (None, false) => Outcome::Missed,
        }
    }
}

/// The rows of a campaign, counted.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Campaign {
    /// Every fault that was injected.
    pub rows: Vec<Row>,
    /// Rows.
    pub injected: usize,
    /// Those that are [`Outcome::Detected`].
    pub detected: usize,
    /// Those that are [`Outcome::Harmless`].
    pub harmless: usize,
    /// Those that are [`Outcome::Missed`].
    pub missed: usize,
}

impl Campaign {
    /// Counts rows.
    pub fn new(rows: Vec<Row>) -> Campaign {
        let count = |outcome| rows.iter().filter(|row| row.outcome() == outcome).count();
        Campaign {
            injected: rows.len(),
            detected: count(Outcome::Detected),
            harmless: count(Outcome::Harmless),
            missed: count(Outcome::Missed),
            rows,
        }
    }

    /// Covered over injected; 1 when nothing was injected.
    pub fn coverage(&self) -> f64 {
        share(self.detected + self.harmless, self.injected).unwrap_or(1.0)
    }

    /// Whether every row passes, and the shares of covered and harmless rows are kept.
    pub fn passes(&self) -> bool {
        self.rows.iter().all(|row| row.pass)
            && self.coverage() >= COVERED
            && share(self.harmless, self.injected).is_none_or(|share| share <= HARMLESS)
    }

    /// The counts in a line, then every row that is harmless, missed or breaks a bound.
    pub fn summary(&self) -> String {
        let mut text = format!(
            "{} injected: {} detected, {} harmless, {} missed; {:.1} % covered (bounds: at least {:.0} % covered, at most {:.0} % \
             harmless)\n",
            self.injected,
            self.detected,
            self.harmless,
            self.missed,
            100.0 * self.coverage(),
            100.0 * COVERED,
            100.0 * HARMLESS
        );
        let mut list = |title: &str, chosen: &dyn Fn(&Row) -> bool| {
            for row in self.rows.iter().filter(|row| chosen(row)) {
                // A string takes everything.
                let _ = writeln!(text, "{title}: {}", row.words());
            }
        };
        list("harmless", &|row| row.outcome() == Outcome::Harmless);
        list("missed", &|row| row.outcome() == Outcome::Missed);
        list("failed", &|row| !row.pass && row.outcome() != Outcome::Missed);
        text
    }

    /// The section of a page: the counts, what is harmless, and a table of the rows with the greatest forces and of all that do not pass.
    pub fn section(&self) -> String {
        let harmless: Vec<_> = self.rows.iter().filter(|row| row.outcome() == Outcome::Harmless).collect();
        let names: Vec<_> = harmless.iter().map(|row| row.fault.as_str()).collect();
        let mut text = format!(
            "{} faults injected: {} detected, {} harmless, {} missed; {:.1} % covered.\n\nHarmless: {}.\n\n\
             | fault | reaction | pulses off | reported | contact N | current A | recovers | |\n\
             | --- | --- | --- | --- | --- | --- | --- | --- |\n",
            self.injected,
            self.detected,
            self.harmless,
            self.missed,
            100.0 * self.coverage(),
            if names.is_empty() { "none".into() } else { names.join("; ") }
        );
        let mut rows: Vec<_> = self.rows.iter().collect();
        // The order of the campaign, among equals.
        rows.sort_by(|a, b| a.pass.cmp(&b.pass).then(b.contact_n.total_cmp(&a.contact_n)));
        let fail = rows.iter().filter(|row| !row.pass).count();
        rows.truncate(fail.max(SHOWN));
        for row in rows {
            let said = match row.outcome() {
                Outcome::Detected => row.reported.as_deref().unwrap_or_default(),
                Outcome::Harmless => "nothing: harmless",
                Outcome::Missed => "nothing: **missed**",
            };
            let _ = writeln!(
                text,
                "| {} | {} | {} | {said} | {:.1} | {:.2} | {} | {} |",
                row.fault,
                row.reaction,
                row.time(),
                row.contact_n,
                row.current_a,
                if row.recovers { "yes" } else { "no" },
                if row.pass { "" } else { "**fails**" }
            );
        }
        text
    }
}

impl Row {
    /// From the fault until the pulses were off, with the unit that suits it.
    fn time(&self) -> String {
        match self.time_us {
            None => "-".into(),
            Some(us) if us < 1e3 => format!("{us:.1} us"),
            Some(us) if us < 1e6 => format!("{:.1} ms", us / 1e3),
            Some(us) => format!("{:.2} s", us / 1e6),
        }
    }

    /// The row in a line.
    pub fn words(&self) -> String {
        format!(
            "{}: {}; reported {}; pulses off {}; {:.1} N; {:.2} A; {}",
            self.fault,
            self.reaction,
            self.reported.as_deref().unwrap_or("nothing"),
            self.time(),
            self.contact_n,
            self.current_a,
            if self.recovers { "recovers" } else { "does not recover" }
        )
    }
}

fn share(part: usize, whole: usize) -> Option<f64> {
    (whole > 0).then(|| part as f64 / whole as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(fault: &str, reported: Option<&str>, pass: bool) -> Row {
        Row {
            fault: fault.into(),
            reaction: "coast".into(),
            time_us: Some(150.0),
            reported: reported.map(str::to_owned),
            contact_n: 1.25,
            current_a: 0.5,
            recovers: true,
            pass,
        }
    }

    fn campaign(detected: usize, harmless: usize, missed: usize) -> Campaign {
        let rows = |n, reported, pass| (0..n).map(move |_| row("a wire", reported, pass));
        let all = rows(detected, Some("gate missing"), true).chain(rows(harmless, None, true));
        Campaign::new(all.chain(rows(missed, None, false)).collect())
    }

    #[test]
    fn a_fault_is_covered_when_it_is_named_or_proved_harmless() {
        let mixed = campaign(5, 3, 2);
        assert_eq!((mixed.injected, mixed.detected, mixed.harmless, mixed.missed), (10, 5, 3, 2));
        assert!((mixed.coverage() - 0.8).abs() < 1e-12);
        // Named, and yet not safe.
        let failed = Campaign::new(vec![row("a wire", Some("gate missing"), false)]);
        assert_eq!((failed.detected, failed.coverage()), (1, 1.0));
        assert!(!failed.passes() && failed.summary().contains("failed: a wire"));
    }

    #[test]
    fn a_campaign_passes_with_nothing_missed_and_a_tenth_harmless_at_most() {
        assert!(campaign(90, 10, 0).passes());
        assert!(!campaign(89, 11, 0).passes());
        assert!(!campaign(199, 0, 1).passes(), "a miss is a row that does not pass");
        assert!(campaign(0, 0, 0).passes());
    }

    #[test]
    fn every_miss_and_every_harmless_fault_is_named() {
        let summary = Campaign::new(vec![row("wire A", None, true), row("wire B", None, false)]).summary();
        assert!(summary.contains("harmless: wire A") && summary.contains("missed: wire B"), "{summary}");
    }

    #[test]
    fn the_json_has_the_counts_beside_the_rows_and_comes_back() {
        let campaign = campaign(1, 1, 1);
        let json = serde_json::to_value(&campaign).unwrap();
        for (key, value) in [("injected", 3), ("detected", 1), ("harmless", 1), ("missed", 1)] {
            assert_eq!(json[key], value);
        }
        let keys: Vec<&String> = json["rows"][0].as_object().unwrap().keys().collect();
        let mut wanted = ["fault", "reaction", "time_us", "reported", "contact_n", "current_a", "recovers", "pass"];
        wanted.sort_unstable();
        assert_eq!(keys, wanted);
        assert_eq!(serde_json::from_value::<Campaign>(json).unwrap(), campaign);
    }

    #[test]
    fn a_long_campaign_shows_the_hardest_rows_and_all_that_fail() {
        let pressed =
            |n: usize, pass| Row { contact_n: n as f64, ..row(&format!("wire {n}."), Some("gate missing"), pass) };
        let shown = |failing: std::ops::Range<usize>| -> Vec<usize> {
            let section = Campaign::new((0..30).map(|n| pressed(n, !failing.contains(&n))).collect()).section();
            let rows = section.lines().filter_map(|line| line.strip_prefix("| wire "));
            rows.map(|row| row.split('.').next().unwrap().parse().unwrap()).collect()
        };
        assert_eq!(shown(0..0), (20..30).rev().collect::<Vec<_>>());
        assert_eq!(shown(3..4)[..3], [3, 29, 28], "what fails comes first");
        assert_eq!(shown(0..15), (0..15).rev().collect::<Vec<_>>(), "no failure is cut off");
    }

    #[test]
    fn the_table_has_a_line_for_every_row() {
        let section = campaign(2, 1, 1).section();
        assert_eq!(section.lines().filter(|line| line.starts_with("| a wire")).count(), 4, "{section}");
        assert!(section.contains("150.0 us") && section.contains("**missed**"), "{section}");
    }
}
