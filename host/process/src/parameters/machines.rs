//! The machines that the sources describe.

use super::Basis::{self, Assumed, Chosen, Fitted, Source};
use super::{DECLARED, Kind, Parameters};

/// A number in which a machine differs from [`SINKER`].
#[derive(Clone, Copy, Debug)]
pub struct Difference {
    /// Name of the parameter.
    pub key: &'static str,
    /// Its value.
    pub value: f64,
    /// What it rests on.
    pub basis: Basis,
}

/// A machine.
#[derive(Clone, Copy, Debug)]
pub struct Machine {
    /// Name.
    pub name: &'static str,
    /// What it is.
    pub about: &'static str,
    /// Its generator.
    pub kind: Kind,
    /// Where it differs from [`SINKER`].
    pub differences: &'static [Difference],
}

impl Machine {
    /// Its parameters.
    pub fn of(&self) -> Parameters {
        let mut p = Parameters { kind: self.kind, ..Parameters::default() };
        for difference in self.differences {
            if let Some(slot) = p.slot(difference.key) {
                *slot = difference.value;
            }
        }
        p
    }

    /// What one of its numbers rests on.
    pub fn basis(&self, key: &str) -> Option<Basis> {
        let own = self.differences.iter().find(|difference| difference.key == key);
        let own = own.map(|difference| difference.basis);
        own.or_else(|| DECLARED.iter().find(|declared| declared.key == key).map(|declared| declared.basis))
    }

    /// Names of the numbers of its process that are assumed or chosen, and not zero.
    pub fn unpublished(&self) -> impl Iterator<Item = &'static str> {
        let at = |key: &str| DECLARED.iter().position(|declared| declared.key == key).unwrap_or(DECLARED.len());
        let of_axis = at("step_us")..at("reach_um_v");
        let numbers = DECLARED.iter().zip(self.of().values()).enumerate();
        let open = numbers.filter(|(k, (declared, value))| {
            let switch = matches!(declared.key, "negative" | "comes_back" | "depth_um" | "thickness_um");
            let rests = matches!(self.basis(declared.key), Some(Basis::Assumed(_) | Basis::Chosen(_)));
            *value != 0.0 && !switch && rests && !of_axis.contains(k)
        });
        open.map(|(_, (declared, _))| declared.key).collect::<Vec<_>>().into_iter()
    }
}

const fn of(key: &'static str, value: f64, basis: Basis) -> Difference {
    Difference { key, value, basis }
}

/// All of them.
pub const MACHINES: [Machine; 4] = [SINKER, XIN, GAO, GAO_CLEAR];

/// The sinker of \[R\] and its thesis: 3 mm copper on steel.
pub const SINKER: Machine =
    Machine { name: "sinker", about: "[R], 3 mm copper on steel, 5 kHz", kind: Kind::IsoFrequency, differences: &[] };

/// The machine of \[X\].
pub const XIN: Machine = Machine {
    name: "xin",
    about: "[X], 10 mm copper on silicon, 2 kHz",
    kind: Kind::IsoFrequency,
    differences: &[
        of("on_us", 100.0, Source("[X] section 2")),
        of("off_us", 400.0, Source("[X] section 2")),
        of("cable_us", 0.01, Assumed("all of table 2 is the gap's")),
        of("radius_um", 5000.0, Source("[X] section 2")),
        of("side_um", 60.0, Assumed("")),
        of("slow_log", 0.3, Assumed("a larger face averages")),
        of("burn_ohm", 12.0, Assumed("5 A; no source gives the current")),
        of("removal_um3_uj", 10.64, Fitted("[X] table 4")),
        of("exchange_um", 50.0, Assumed("the working gap")),
        of("gas_front", 35.0, Chosen("the gates of depth")),
        of("rest_mm3_s", 30.0, Chosen("debris well below 5 %, as removal does not fall at 40 um in [X] table 4")),
        of("step_us", 250.0, Assumed("half a period")),
    ],
};

const GAO_COMMON: [Difference; 28] = [
    of("open_v", 80.0, Source("[G] table 1")),
    of("burn_v", 25.0, Assumed("")),
    of("arc_v", 20.0, Assumed("")),
    of("on_us", 4.0, Source("[G] table 1")),
    of("off_us", 6.0, Source("[G] table 1")),
    of("cable_us", 0.05, Assumed("")),
    of("permittivity", 80.0, Source("water")),
    of("capacitor_pf", 4700.0, Source("[G] table 1")),
    of("burn_ohm", 10.0, Assumed("")),
    of("radius_um", 100.0, Source("[G] table 1")),
    of("side_um", 8.0, Assumed("")),
    of("runout_um", 1.0, Assumed("")),
    of("turn_ms", 30.0, Source("[G] table 1: 2000 r/min")),
    of("slow_log", 0.3, Assumed("")),
    of("slow_hz", 1.6, Assumed("")),
    of("peak_um", 0.5, Assumed("")),
    of("removal_um3_uj", 2.2, Assumed("30 um^3 a spark")),
    of("negative", 1.0, Source("[G] table 1")),
    of("recovery_us", 1.0, Assumed("water; a spark has the rest of its on-time too")),
    of("bridge_hz", 3.0, Chosen("about 200 discharges in a cycle, [G] fig. 7")),
    of("bridge_um", 5.5, Chosen("about 200 discharges in a cycle, [G] fig. 7")),
    of("bridge_ms", 600.0, Assumed("little energy burns it")),
    of("exchange_um", 8.0, Assumed("the working gap")),
    of("gas_front", 35.0, Chosen("the gates of depth")),
    of("rest_mm3_s", 0.001, Assumed("besides what turning exchanges")),
    of("half_depth_um", 1500.0, Assumed("")),
    of("step_us", 100.0, Assumed("ten periods; the gates halve it")),
    of("viscosity_mpas", 1.0, Source("water at 20 degrees C")),
];

const fn with<const N: usize>(more: [Difference; N]) -> [Difference; 32] {
    let mut all = [GAO_COMMON[0]; 32];
    let mut i = 0;
    while i < GAO_COMMON.len() {
        all[i] = GAO_COMMON[i];
        i += 1;
    }
    let mut k = 0;
    while k < N {
        all[i + k] = more[k];
        k += 1;
    }
    all
}

/// The machine of \[G\] with a bubble veil and long tears: one of two settings on which the order of its laws hangs.
pub const GAO: Machine = Machine {
    name: "gao",
    about: "[G], 0.2 mm tungsten carbide on stainless steel in water, 100 kHz",
    kind: Kind::ControlledRc,
    differences: &with([
        of("veil_us", 400.0, Chosen("the order of FC and 1TAV in [G]")),
        of("tear_um", 3.0, Chosen("the long retreats of [G]")),
        of("wear_negative", 0.3, Assumed("micro-EDM wears much")),
        of("spread_ms", 5.0, Assumed("it turns")),
    ]),
};

/// The machine of \[G\] without a veil and with short tears: the other setting.
pub const GAO_CLEAR: Machine = Machine {
    name: "gao-clear",
    about: "the same without bubble veil and with bridges that tear soon",
    kind: Kind::ControlledRc,
    differences: &with([
        of("veil_us", 0.0, Chosen("the other setting")),
        of("tear_um", 1.0, Chosen("the other setting")),
        of("wear_negative", 0.3, Assumed("micro-EDM wears much")),
        of("spread_ms", 5.0, Assumed("it turns")),
    ]),
};
