//! The chip and the native core, tick by tick.

use crate::common;
use edm_fil::exercise;
use edm_fil::image::Image;
use edm_fil::rig::Witness;
use edm_servo_head::head::Fault;
use edm_servo_head::settings::Settings;
use std::collections::BTreeSet;

/// `EDM_SEEDS=2` runs a minute of two processes instead of one.
#[test]
fn the_native_core_comes_to_the_same_bit_for_bit_for_a_minute_of_retreats_and_faults() {
    let image = Image::parse(common::firmware().to_vec()).unwrap();
    let settings = Settings { commissioned: true, ..Settings::default() };
    let seeds = std::env::var("EDM_SEEDS").ok().and_then(|seeds| seeds.parse().ok()).unwrap_or(1);
    for seed in 1..=seeds {
        let witness = Witness::twin(&settings).unwrap();
        let (witness, met) =
            exercise::run(&image, 60.0, seed, witness).unwrap_or_else(|e| panic!("seed {seed}: {e:#}"));
        let Witness::Twin(twin) = witness else { unreachable!() };
        // One tick more: the first, before the day begins.
        assert!(twin.ticks() > met.ticks && met.ticks >= 60 * 20_000, "{} of {}", twin.ticks(), met.ticks);
        assert!(met.retreats >= 10, "seed {seed}: {met:?}");
        let kinds: BTreeSet<_> = met.faults.iter().map(|f| Fault::name(*f)).collect();
        assert!(kinds.len() >= 10, "seed {seed}: {kinds:?}");
    }
}
