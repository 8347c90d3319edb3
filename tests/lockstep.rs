//! What a chip saw, replayed: the native core must make the same of it.
//!
//! The chip is a modelled one (docs/emulated-chip.md), the recording is made at a release (`cargo fil record`). It protects the
//! senses: counts, shorts and the quality of the gap signal are those of the recording, the filtered voltage is within 1 V. What
//! the head does with them may change from commit to commit; that chip and core do the same, bit for bit, is a test of host/fil.

use edm_sim::lockstep::{Error, replay_senses};

const DAY: &[u8] = include_bytes!("recordings/day.edmr");

#[test]
fn the_native_core_makes_the_same_of_the_signals_of_seconds_of_the_chip() {
    let ticks = replay_senses(DAY).unwrap_or_else(|e| panic!("{e}; where that is meant: cargo fil record"));
    assert!(ticks > 20_000, "{ticks}");
}

#[test]
fn a_recording_cut_short_is_noticed() {
    assert!(matches!(replay_senses(&DAY[..DAY.len() / 2]), Err(Error::Io(_))));
}
