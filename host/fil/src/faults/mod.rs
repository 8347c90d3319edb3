//! `cargo fil faults`: faults injected one by one on the modelled chip with the unmodified ELF, and the reactions of the head.
//!
//! | file | responsible for |
//! | --- | --- |
//! | `stage` | the head when faults are injected, its observed behaviour and its reports |
//! | `case` | a fault with the expected reaction, and its row |
//! | `limits` | expected times and reports |
//! | `rows` | the fault table |
//! | `pins` | each input stuck or open |
//! | `bus` | frames, lines, neighbours, a second master |
//! | `chip` | peripherals, tasks, clocks, program ends, memories |
//! | `constants` | settings that do not fit the machine |
//!
//! The head is brought to its work once; each row continues from there ([`crate::machine::Snapshot`]). docs/robustness.md says
//! how rows are evaluated.

mod bus;
mod case;
mod chip;
mod constants;
mod limits;
mod pins;
mod rows;
mod stage;

use crate::command::BadInput;
use crate::image::Image;
use anyhow::{Result, anyhow};
use case::{Case, Undisturbed};
use clap::Args;
use edm_sim::faults::row::Campaign;
use edm_sim::inputs::shard;
use edm_sim::output::Output;
use edm_sim::page::Page;
use stage::{Scene, Stage};
use std::path::PathBuf;

/// Who writes a section of the page.
const COMMAND: &str = "cargo fil faults";

/// Every case, in the order of the page.
fn all() -> Vec<Case> {
    let mut cases = Vec::new();
    rows::table(&mut cases);
    pins::pins(&mut cases);
    chip::stopped(&mut cases);
    chip::silent(&mut cases);
    chip::clocks(&mut cases);
    chip::deaths(&mut cases);
    bus::bus(&mut cases);
    chip::stored(&mut cases);
    chip::flips(&mut cases);
    constants::wrong(&mut cases);
    cases
}

/// Arguments of `cargo fil faults`.
#[derive(Debug, Args)]
pub struct Faults {
    /// Write rows and counts as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Only faults whose name contains this
    #[arg(long, value_name = "PATTERN")]
    rows: Option<String>,
    /// Only one fault of each kind: 15 seconds
    #[arg(long)]
    short: bool,
    /// List the faults without injecting them
    #[arg(long)]
    list: bool,
    /// Only part I of N: every Nth fault, beginning with the Ith
    #[arg(long, value_name = "I/N", value_parser = shard)]
    shard: Option<(usize, usize)>,
    /// Write the table into its section of this page (docs/robustness.md)
    #[arg(long, value_name = "FILE")]
    page: Option<PathBuf>,
}

impl Faults {
    /// Injects what was chosen, with the firmware's log on request; whether the campaign passes.
    ///
    /// # Errors
    /// Bad input, or a head that does not begin to erode.
    pub fn execute(&self, image: &Image, log: bool) -> Result<bool> {
        let (i, n) = self.shard.unwrap_or((1, 1));
        let chosen = |case: &Case| {
            self.rows.as_ref().is_none_or(|pattern| case.title().contains(pattern)) && (!self.short || case.short)
        };
        let cases: Vec<Case> = all().into_iter().filter(chosen).skip(i - 1).step_by(n).collect();
        if self.list {
            cases.iter().for_each(|case| println!("{}", case.title()));
            return Ok(true);
        }
        if cases.is_empty() {
            return Err(BadInput("--rows, --shard: select at least one fault; --list shows all".into()).into());
        }
        let bad = |message: String| anyhow!(BadInput(message));
        let json = Output::claim_any("--json", self.json.as_deref()).map_err(bad)?;
        let page = self.page.as_deref().map(|path| Page::claimed(path, COMMAND)).transpose().map_err(bad)?;

        let campaign = run(image, &cases, log)?;
        print!("{}", campaign.summary());
        if let Some(output) = json {
            output.write_json(&campaign).map_err(|e| anyhow!(e))?;
        }
        if let Some((page, output)) = page {
            page.write(output, &campaign.section()).map_err(|e| anyhow!(e))?;
        }
        Ok(campaign.passes())
    }
}

fn run(image: &Image, cases: &[Case], log: bool) -> Result<Campaign> {
    let mut stage = Stage::new(image)?;
    stage.log = log;
    let undisturbed = undisturbed(&mut stage)?;
    let mut rows = Vec::new();
    for case in cases {
        let (row, why) = case.run(&mut stage, &undisturbed).unwrap_or_else(|error| case.lost(&stage, &error));
        println!(
            "{}{}",
            row.words(),
            if why.is_empty() { String::new() } else { format!("; FAILS: {}", why.join("; ")) }
        );
        rows.push(row);
    }
    Ok(Campaign::new(rows))
}

/// What the head does when nothing breaks.
fn undisturbed(stage: &mut Stage) -> Result<Undisturbed> {
    stage.go(Scene::Eroding)?;
    let before = stage.truth().surface_um;
    stage.rest(case::WATCHED_MS)?;
    Ok(Undisturbed { removed_um: stage.truth().surface_um - before })
}

#[cfg(test)]
mod tests {
    use super::case::Expect;
    use super::*;
    use edm_servo_head::head::Fault;
    use std::collections::BTreeSet;

    #[test]
    fn every_fault_of_the_table_is_expected_of_some_row() {
        let cases = all();
        let expected = |fault: &Fault| {
            cases.iter().any(|case| matches!(case.expect, Expect::Named(names, _) if names.contains(&fault.name())))
        };
        let without: Vec<_> = Fault::ALL.iter().filter(|fault| !expected(fault)).collect();
        assert_eq!(without, Vec::<&Fault>::new());
    }

    #[test]
    fn rows_have_names_of_their_own_and_the_short_form_has_some_of_each_kind() {
        let cases = all();
        let names: BTreeSet<_> = cases.iter().map(Case::title).collect();
        assert_eq!(names.len(), cases.len());
        let short = cases.iter().filter(|case| case.short).count();
        assert!((5..=12).contains(&short), "{short}");
    }

    #[test]
    fn a_shard_is_one_of_some() {
        assert_eq!(shard("2/4"), Ok((2, 4)));
        for text in ["0/4", "5/4", "2", "2/", "/4", "2/0", "-1/4"] {
            assert!(shard(text).is_err(), "{text}");
        }
    }
}
