//! What version 2 changes of version 1's machines.

use super::Basis::{Assumed, Chosen, Fitted, Source};
use super::Fitted as Values;
use super::machines::{Difference, of as to};

/// Of all machines.
pub(super) const ALL: [Difference; 19] = [
    to("reach_um_v", 1.0, Source("[R]: the gap is 20 to 100 um at 100 V")),
    to("recovery_heats", 1.0, Assumed("a surface that was heated for a time cools in as much")),
    to("arc_heat", 2.0, Chosen("the gates of arcing")),
    to("arc_stays", 3.0, Chosen("the gates of arcing")),
    to("arc_cool_ms", 10.0, Assumed("diffusion over a third of a millimetre of steel")),
    to("arc_tear_um", 10.0, Assumed("a fraction of the gap")),
    to("hurt", 0.06, Chosen("the gates of arcing")),
    to("hurt_half", 1.0, Assumed("")),
    to("saturate_w_mm2", 4.0, Source("the rule of 10 A/cm^2, at 40 V")),
    to("saturate_edge_um", 1500.0, Assumed("")),
    to("reynolds", 15.0, Assumed("inertia beside viscosity")),
    to("buffer_um", 3000.0, Chosen("the gates of depth")),
    to("gas_level_um_s", 30.0, Chosen("the gates of arcing")),
    to("gas_back", 1500.0, Assumed("1.4 mm^3 a joule")),
    to("tear_ms", 20.0, Assumed("a bridge that touches again within this is not torn")),
    to("ignition_debris", 1.0, Assumed("most ignitions of a dirty gap are at particles")),
    to("ignites_above", 1.0, Source("the burn voltage: below it no channel burns")),
    to("recovery_rc", 5.8, Chosen("the textbooks' least resistance of an RC generator")),
    to("ignition", Values::SECOND.ignition, Fitted("[X] table 4")),
];

/// Of the sinker.
const SINKER: [Difference; 3] = [
    to("slow_log", Values::SECOND.slow_log, Fitted("[R]'s swing of 40 um")),
    to("removal_um3_uj", 0.9, Chosen("the 0.2 mm/min of [R] section 4.2, at its power density")),
    to("gas_front", 14.6, Assumed("as much a joule as in version 1")),
];

/// Of \[X\]'s machine.
const XIN: [Difference; 2] = [
    to("removal_um3_uj", Values::SECOND.xin_removal, Fitted("[X] table 4")),
    to("rest_mm3_s", 30.0, Chosen("debris well below 5 %, as in version 1")),
];

/// Of one machine.
pub(super) fn of(machine: &str) -> &'static [Difference] {
    match machine {
        "sinker" => &SINKER,
        "xin" => &XIN,
        _ => &[],
    }
}
