//! The model's version, and a fingerprint by which a changed model is noticed.
//!
//! A change of any parameter or equation is a new version, with its own fit and gates: run `fit`, then `model-report`, and
//! set both constants here together.

use crate::axis::{Axis, Load, Winding};
use crate::harness::{Law, Motion, Rig, Voltage};
use crate::parameters::{GAO, GAO_CLEAR, MACHINES, SINKER, XIN};
use crate::{Parameters, Refused};

/// Version of the model; 0 is the one in host/sim.
pub const VERSION: u32 = 1;
/// [`fingerprint`] of this version.
pub const FINGERPRINT: u64 = 0x203b_a920_66ac_1655;

/// FNV-1a over these words.
fn fnv(words: impl Iterator<Item = u64>) -> u64 {
    words.fold(0xcbf2_9ce4_8422_2325, |hash, word| {
        word.to_le_bytes().iter().fold(hash, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3))
    })
}

/// Everything that a run has come to, bit by bit.
pub fn outcome(rig: &Rig) -> u64 {
    let t = rig.process.truth();
    let n = t.pulses;
    let reals = [t.gap_um, t.depth_um, t.worn_um, t.dirt, t.damage, t.crater_um, t.energy_j, rig.x, rig.volts];
    fnv(reals.into_iter().map(f64::to_bits).chain([n.open, n.spark, n.arc, n.stable_arc, n.short]))
}

/// Of all numbers of all machines, five runs of the process and one of the axis.
///
/// # Errors
/// When a machine's numbers do not fit.
pub fn fingerprint() -> Result<u64, Refused> {
    let jumps = Motion { buzz: (5.0, 200.0), jump: (3000.0, 0.5, 100.0) };
    let deep = Parameters { depth_um: 3000.0, flush_kpa: 2.0, ..SINKER.parameters() };
    let runs = [
        (SINKER.parameters(), Law::Voltage(Voltage::thesis(45.0)), Motion::default()),
        (deep, Law::Voltage(Voltage::calm(55.0)), jumps),
        (XIN.parameters(), Law::Gap(45.0), Motion::default()),
        (GAO.parameters(), Law::Fc(200, true), Motion::default()),
        (GAO_CLEAR.parameters(), Law::Tav(20.0, 20.0), Motion::default()),
    ];
    let mut words: Vec<u64> =
        MACHINES.iter().flat_map(|machine| machine.parameters().values()).map(f64::to_bits).collect();
    for (p, law, motion) in runs {
        let mut rig = Rig::new(&p, law, motion, 1)?;
        rig.run(5.0);
        words.push(outcome(&rig));
    }
    let mut axis = Axis::new(&SINKER.parameters(), 12.5);
    for step in 0..4000 {
        axis.step(Winding::Volts(if step / 500 % 2 == 0 { 6.0 } else { -3.0 }), &Load::NONE);
    }
    words.extend([axis.x, axis.v, axis.i].map(f64::to_bits));
    Ok(fnv(words.into_iter()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_model_is_the_one_of_its_version() {
        assert_eq!(fingerprint(), Ok(FINGERPRINT), "changed: a new version with its own gates");
    }
}
