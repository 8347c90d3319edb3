//! Constants of the machine that are wrong in the settings: some of those that `cargo sim faults --settings constants` tries,
//! written over the bus. The guided check of the head refuses them; where it does not, the encoder is cut while the head
//! erodes, where they press hardest natively.

use super::case::{CHECK, Case, Expect};
use super::limits::{ENCODER, ON, STANDS_US};
use super::stage::{Scene, Stage};
use crate::host;
use anyhow::{Context, Result, ensure};
use edm_servo_head::canopen::drive::FINDINGS;
use edm_servo_head::head::{Command, State};
use edm_servo_head::settings::{Declared, Settings};
use edm_sim::faults::sets;
use edm_sim::process::Cable;

const MASS: Expect = Expect::Named(&["2001h:4 mass differs from the setting"], ON);
const COUNTERBALANCE: Expect = Expect::Named(&["2001h:4 counterbalance differs from the setting"], ON);
/// The check has passed, and the encoder was cut.
const PASSES: Expect = Expect::Named(ENCODER, STANDS_US);

/// Each constant half as much wrong as it is, toward the side that would press, and pairs that hide each other.
fn sample() -> [(&'static str, Expect); 8] {
    [
        ("axis.mass_kg x 0.5", MASS),
        ("axis.counterbalance_n x 1.5", COUNTERBALANCE),
        ("axis.breakaway_n x 1.5", PASSES),
        ("axis.force_constant_n_a x 0.5", MASS),
        ("axis.resistance_ohm x 1.5", MASS),
        ("encoder.count_um x 1.5", MASS),
        ("axis.mass_kg x 0.8, axis.counterbalance_n x 0.8", MASS),
        ("axis.force_constant_n_a x 1.5, axis.resistance_ohm x 1.2", PASSES),
    ]
}

/// One of the sample that belongs to the short form.
const SHORT: &str = "axis.mass_kg x 0.5";
/// The work is lower by this while the head is checked, mm.
const AWAY_MM: f64 = 100.0;
/// Longest check, and from one look at it to the next, ms.
const CHECK_MS: u32 = 60_000;
const LOOK_MS: u32 = 50;

/// Adds them.
pub fn wrong(cases: &mut Vec<Case>) {
    let all = sets::constants(&Settings::default());
    for (name, expect) in sample() {
        let set = all.iter().find(|set| set.name == name).map(|set| set.settings);
        let inject = move |stage: &mut Stage| through_the_check(stage, &set.context("no such set")?);
        let case = Case::new(format!("settings: {name}"), Scene::Disabled, expect, inject).powered();
        cases.push(if name == SHORT { case.short() } else { case });
    }
}

/// Writes settings over the bus, all of them numbers, and has the head checked above no work.
fn through_the_check(stage: &mut Stage, settings: &Settings) -> Result<()> {
    let right = Settings::default();
    for (place, (index, sub)) in Settings::ADDRESSES.iter().enumerate() {
        match settings.word(place) {
            Some(word) if right.word(place) != Some(word) => host::write(stage, *index, *sub, word, 4)?,
            _ => {}
        }
    }
    stage.wires().raised_mm = -AWAY_MM;
    stage.command(Command::Commission)?;
    let mut left = CHECK_MS / LOOK_MS;
    while matches!(stage.state()?, State::Commissioning | State::Proving) {
        ensure!(left > 0, "the guided check does not end");
        left -= 1;
        stage.rest(LOOK_MS)?;
    }
    stage.rest(LOOK_MS)?;
    let found = host::read(stage, 0x2001, 4)?;
    stage.wires().raised_mm = 0.0;
    if found == 1 {
        stage.erode()?;
        stage.mark();
        stage.wires().encoder = Cable::CUT;
        return Ok(());
    }
    let known = FINDINGS.iter().find(|(number, _)| u32::from(*number) == found);
    let (_, words) = known.with_context(|| format!("the guided check ends with {found}"))?;
    stage.mark();
    stage.say(&format!("{CHECK}{words}"));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_of_the_sample_is_tried_natively_too() {
        let all = sets::constants(&Settings::default());
        for (name, _) in sample() {
            assert!(all.iter().any(|set| set.name == name), "{name}");
        }
    }
}
