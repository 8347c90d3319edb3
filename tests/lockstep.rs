//! What a chip saw, replayed: the native core must come to what the firmware came to, bit for bit.
//!
//! The chip is a modelled one (docs/emulated-chip.md); `cargo fil record` makes the recording anew, which a change of the
//! core's arithmetic calls for.

use edm_sim::lockstep::{Error, replay};

const DAY: &[u8] = include_bytes!("recordings/day.edmr");

#[test]
fn the_native_core_repeats_seconds_of_the_chip_with_a_retreat_and_faults() {
    let ticks = replay(DAY).unwrap_or_else(|e| panic!("{e}; after a change of the core: cargo fil record"));
    assert!(ticks > 40_000, "{ticks}");
}

#[test]
fn a_recording_cut_short_is_noticed() {
    assert!(matches!(replay(&DAY[..DAY.len() / 2]), Err(Error::Io(_))));
}
