//! Parameters of a machine with its process: each with unit, range and what it rests on.

mod machines;

pub use machines::{Difference, GAO, GAO_CLEAR, MACHINES, Machine, SINKER, XIN};

use std::fmt;

/// What a number rests on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Basis {
    /// Published, or a constant of nature.
    Source(&'static str),
    /// Fitted to calibration data.
    Fitted(&'static str),
    /// Chosen by hand among what is plausible, with these gates in view.
    Chosen(&'static str),
    /// Assumed, with no gate in view.
    Assumed(&'static str),
}

impl fmt::Display for Basis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Basis::Source(what) => write!(f, "{what}"),
            Basis::Fitted(what) => write!(f, "fitted to {what}"),
            Basis::Chosen(what) => write!(f, "chosen with {what} in view"),
            Basis::Assumed("") => write!(f, "assumed"),
            Basis::Assumed(what) => write!(f, "assumed: {what}"),
        }
    }
}

/// How the generator makes pulses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kind {
    /// Transistor, on-time and off-time fixed from gate to gate: iso-frequency.
    #[default]
    IsoFrequency,
    /// Transistor, on-time counted from ignition: iso-energy.
    IsoEnergy,
    /// A capacitor is charged in off-time and lies across the gap in on-time.
    ControlledRc,
    /// A capacitor lies across the gap and is charged all the time.
    Rc,
}

impl Kind {
    /// All of them, with their names in a scenario.
    pub const ALL: [(Kind, &str); 4] = [
        (Kind::IsoFrequency, "iso_frequency"),
        (Kind::IsoEnergy, "iso_energy"),
        (Kind::ControlledRc, "controlled_rc"),
        (Kind::Rc, "rc"),
    ];
}

/// A parameter as declared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Declared {
    /// Name.
    pub key: &'static str,
    /// Name in a scenario.
    pub path: &'static str,
    /// Unit, empty for a ratio or a count.
    pub unit: &'static str,
    /// What it is.
    pub doc: &'static str,
    /// Smallest and largest value allowed.
    pub range: (f64, f64),
    /// What its default rests on.
    pub basis: Basis,
}

/// Why parameters are refused.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Refused {
    /// No parameter has this name.
    Unknown,
    /// A value outside the range of its parameter.
    Range(&'static Declared, f64),
    /// Two that do not go together.
    Conflict(&'static str),
}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Refused::Unknown => write!(f, "no parameter of the process has this name"),
            Refused::Range(Declared { key, unit, range: (min, max), .. }, value) => {
                write!(f, "{key} is {value} {unit}, not within {min} to {max}")
            }
            Refused::Conflict(rule) => write!(f, "{rule}"),
        }
    }
}

impl std::error::Error for Refused {}

macro_rules! declare {
    ($($(#[doc = $doc:expr])+ $name:ident = $value:expr, ($min:expr, $max:expr), $unit:expr, $basis:expr;)*) => {
        /// A machine and its process. The defaults are those of [`SINKER`].
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct Parameters {
            /// How the generator makes pulses.
            pub kind: Kind,
            $($(#[doc = $doc])+ pub $name: f64,)*
        }

        impl Default for Parameters {
            fn default() -> Parameters {
                Parameters { kind: Kind::IsoFrequency, $($name: $value,)* }
            }
        }

        /// All numbers, in the order of the struct.
        pub const DECLARED: &[Declared] = &[$(Declared {
            key: stringify!($name), path: concat!("model.", stringify!($name)), unit: $unit, doc: concat!($($doc),+), range: ($min, $max), basis: $basis,
        },)*];

        impl Parameters {
            /// The numbers, in the order of [`DECLARED`].
            pub fn values(&self) -> impl Iterator<Item = f64> + use<> {
                [$(self.$name,)*].into_iter()
            }

            fn slot(&mut self, key: &str) -> Option<&mut f64> {
                match key {
                    $(stringify!($name) => Some(&mut self.$name),)*
                    _ => None,
                }
            }
        }
    };
}

use Basis::{Assumed, Chosen, Fitted, Source};
const C2: &str = "[X] table 4";
const C3: &str = "[R]'s swing of 40 um";
const ARCING: &str = "the gates of arcing";

declare! {
    /// Open-circuit voltage.
    open_v = 100.0, (20.0, 300.0), "V", Source("[R] section 4.4");
    /// Burn voltage of a spark, almost independent of the gap.
    burn_v = 40.0, (10.0, 100.0), "V", Assumed("[R] section 4.4 erodes at mean voltages from 40 V up");
    /// Scatter of the burn voltage from one discharge to the next, rms.
    burn_scatter_v = 1.0, (0.0, 20.0), "V", Assumed("[R] section 6.5.1: it did not vary much");
    /// Share of the sparks that ignite as soon as the voltage can burn, with no delay that an instrument would show.
    prompt_sparks = 0.12, (0.0, 1.0), "", Assumed("5 to 20 %: a real gap is not as even as its model");
    /// Share of the arcs that ignite after a delay, evenly between 0.2 us and `late_arc_us`.
    late_arcs = 0.15, (0.0, 1.0), "", Assumed("10 to 20 %");
    /// Longest of these delays.
    late_arc_us = 3.0, (0.2, 100.0), "us", Assumed("");
    /// Burn voltage of an arc.
    arc_v = 28.0, (5.0, 100.0), "V", Assumed("lower than a spark's");
    /// Voltage of a short.
    short_v = 1.0, (0.0, 10.0), "V", Assumed("cable and contact");
    /// On-time.
    on_us = 160.0, (0.5, 5000.0), "us", Assumed("5 kHz at 80 %, inside the 1 to 100 kHz of [R]");
    /// Off-time, unless another is asked for.
    off_us = 40.0, (0.5, 5000.0), "us", Assumed("5 kHz at 80 %");
    /// Longest wait for ignition of an iso-energy pulse, or of an RC generator until a pulse counts as open.
    wait_us = 400.0, (1.0, 100_000.0), "us", Assumed("");
    /// Time constant of generator and cable, to which the gap's own is added.
    cable_us = 0.2, (0.01, 10.0), "us", Assumed("");
    /// Resistance through which the gap's own capacitance is charged.
    charge_ohm = 30140.0, (0.0, 1e6), "ohm", Fitted("[X] table 2");
    /// Relative permittivity of the dielectric.
    permittivity = 2.1, (1.0, 100.0), "", Source("hydrocarbon oil");
    /// Gap below which the apparent capacitance levels off.
    rounding_um = 25.86, (0.0, 100.0), "um", Fitted("[X] table 2");
    /// What the contact sense supply leaves over an open gap between pulses.
    sense_v = 11.1, (0.0, 60.0), "V", Source("docs/wiring.md");
    /// Resistance that limits the current of a discharge, or of a short; of an RC generator that of the short alone.
    burn_ohm = 15.0, (0.1, 1000.0), "ohm", Assumed("4 A; no source gives the current");
    /// Capacitor of an RC generator.
    capacitor_pf = 0.0, (0.0, 1e7), "pF", Assumed("none");
    /// Resistance through which that capacitor is charged.
    capacitor_ohm = 300.0, (1.0, 1e6), "ohm", Assumed("charged to 99 % in 6.5 us at 4700 pF");
    /// Inductance of its discharge circuit.
    loop_nh = 200.0, (1.0, 10_000.0), "nH", Assumed("0.2 m of leads");
    /// Shorted pulses in a row after which the generator suspends itself; 0 for never.
    suspend_after = 0.0, (0.0, 1e6), "pulses", Source("[R] section 6.5: some do; off by default");
    /// Time of a suspension.
    suspend_ms = 5.0, (0.1, 1000.0), "ms", Assumed("");

    /// Radius of the electrode.
    radius_um = 1500.0, (20.0, 50_000.0), "um", Assumed("");
    /// Gap at the electrode's side.
    side_um = 50.0, (0.5, 500.0), "um", Assumed("as wide as the front gap");
    /// Depth of the hole in which the electrode stands at the beginning.
    depth_um = 0.0, (0.0, 1e5), "um", Assumed("");
    /// Thickness of the workpiece; what is deeper is through.
    thickness_um = 1e6, (1.0, 1e7), "um", Assumed("a blind hole");
    /// Amplitude by which the gap swings once a turn of the electrode.
    runout_um = 0.0, (0.0, 100.0), "um", Assumed("none");
    /// Time of a turn; 0 for an electrode that does not turn.
    turn_ms = 0.0, (0.0, 10_000.0), "ms", Assumed("none");

    /// Ignitions a second and square millimetre of a clean gap of 50 um.
    ignition = 810.4, (1.0, 1e6), "1/(s mm^2)", Fitted(C2);
    /// Share by which debris of 5 % raises it.
    ignition_debris = 1.0, (0.0, 10.0), "", Assumed("most ignitions of a dirty gap are at particles");
    /// The slow disturbance of ignition: deviation of its logarithm.
    slow_log = 0.6594, (0.0, 3.0), "", Fitted(C3);
    /// The slow disturbance's corner: its spectrum is 1/(1 + (f/corner)^2).
    slow_hz = 5.3, (0.01, 1000.0), "Hz", Assumed("well below the 20 Hz of the swing");
    /// Mean height of the surfaces' peaks.
    peak_um = 3.0, (0.0, 50.0), "um", Assumed("roughness of both surfaces");
    /// Time in which the bubble of a discharge, shrinking evenly, gives back a face of its own size; 0 for a face that is larger.
    veil_us = 0.0, (0.0, 10_000.0), "us", Assumed("the face is larger");

    /// Volume that a microjoule in the discharge removes from the work.
    removal_um3_uj = 0.9, (0.0, 100.0), "um^3/uJ", Chosen("the 0.2 mm/min of [R] section 4.2, at its power density");
    /// Share of that which an arc achieves.
    arc_share = 0.05, (0.0, 1.0), "", Chosen("the gates of the set point");
    /// Volume that the electrode loses over that of the work, electrode positive.
    wear_positive = 0.01, (0.0, 100.0), "", Assumed("copper on steel, long pulses");
    /// The same, electrode negative.
    wear_negative = 0.2, (0.0, 100.0), "", Assumed("");
    /// 1 when the electrode is negative.
    negative = 0.0, (0.0, 1.0), "", Assumed("positive");

    /// Time constant with which a channel in a clean gap recovers.
    recovery_us = 5.5, (0.01, 1000.0), "us", Chosen("the gates of the set point");
    /// Power of the debris, in 5 %, that adds to the recovery time.
    recovery_power = 5.0, (0.0, 8.0), "", Chosen("the gates of the set point");
    /// Debris of a discharge counts on its own spot as if spread over this many crater widths squared.
    spot = 25.0, (1.0, 1000.0), "", Chosen("the gates of the set point");
    /// Damage that an arc leaves on its facet; at 1 the clean gap's recovery takes twice as long.
    hurt = 0.06, (0.0, 1.0), "", Chosen(ARCING);
    /// Share of the damage that a spark removes from its facet.
    heal = 0.015, (0.0, 1.0), "", Chosen("the gates of the set point");
    /// Most damage that a facet can have.
    most_hurt = 4.0, (0.0, 100.0), "", Assumed("");

    /// Bridges a second at 5 % of debris in a gap of `bridge_um`.
    bridge_hz = 0.3, (0.0, 1000.0), "1/s", Chosen("the share of shorts");
    /// That gap: the sixth power of its ratio to the gap multiplies the rate.
    bridge_um = 22.0, (0.1, 500.0), "um", Chosen("the share of shorts");
    /// Mean time after which a bridge has burnt away.
    bridge_ms = 10.0, (0.01, 10_000.0), "ms", Assumed("");
    /// Mean distance by which the gap must open to tear one.
    tear_um = 15.0, (0.01, 1000.0), "um", Assumed("");

    /// Gap at which the exchanges below are given.
    exchange_um = 35.0, (1.0, 500.0), "um", Assumed("the working gap");
    /// Fluid that gas exchanges between front and side, over the volume removed with it.
    gas_front = 14.6, (0.0, 1e5), "", Assumed("13 mm^3 a joule");
    /// The same between side and bath.
    gas_side = 100.0, (0.0, 1e5), "", Chosen("the gates of depth");
    /// Fluid that front, side and bath exchange without gas.
    rest_mm3_s = 0.1, (0.0, 1e4), "mm^3/s", Assumed("");
    /// Depth at which the exchange between side and bath is half of that at the top.
    half_depth_um = 1000.0, (1.0, 1e6), "um", Chosen("the gates of depth");
    /// Length outside the hole that the side gap counts for more, in side gaps.
    mouth = 20.0, (0.1, 1000.0), "side gaps", Chosen("the gates of buzz");
    /// Share of the side gap that can hold fluid which has just left the front and comes back first.
    memory = 0.5, (0.0, 1.0), "", Chosen("the gates of buzz");
    /// Share of a moved volume that mixes on its way.
    mixing = 0.02, (0.0, 1.0), "", Chosen("the gates of buzz");
    /// Share of the debris that goes with squeezed fluid however slow it is.
    lift_share = 0.8, (0.0, 1.0), "", Assumed("some lies on the wall");
    /// Speed of the fluid at the rim at which half of the rest goes too.
    lift_mm_s = 500.0, (0.1, 1e5), "mm/s", Assumed("");
    /// Time constant with which debris spreads over the face.
    spread_ms = 20.0, (0.01, 1e5), "ms", Assumed("");
    /// Flushing pressure through the electrode.
    flush_kpa = 0.0, (0.0, 1000.0), "kPa", Assumed("none");
    /// Viscosity of the dielectric.
    viscosity_mpas = 2.0, (0.1, 100.0), "mPa s", Source("kerosene at 20 degrees C");
    /// 1 in a machine, 0 for the false model in which nothing that was squeezed out comes back.
    comes_back = 1.0, (0.0, 1.0), "", Source("conservation; 0 is the negative control of the gates");

    /// Time for which the state of gap and fluid is taken as steady.
    step_us = 200.0, (10.0, 1000.0), "us", Assumed("a period; the gates halve it");

    /// Moving mass.
    mass_kg = 0.2, (0.01, 20.0), "kg", Assumed("the size of the actuator of [R] section 6.1");
    /// Winding resistance.
    coil_ohm = 12.4, (0.1, 200.0), "ohm", Source("[R] section 7.2, measured");
    /// Winding inductance.
    coil_mh = 3.0, (0.01, 100.0), "mH", Assumed("not measured in [R]");
    /// Force and back-EMF constant.
    force_n_a = 7.5, (0.1, 200.0), "N/A", Source("[R] section 7.2: 7 N/A and 8 V/(m/s) measured");
    /// Lifting force of the counterbalance at the upper stop.
    counterbalance_n = 2.2, (0.0, 500.0), "N", Assumed("a little over the weight");
    /// How much weaker it gets over a millimetre down.
    counterbalance_n_mm = 0.0, (-10.0, 10.0), "N/mm", Assumed("a constant force");
    /// Force of the cable over a millimetre, zero at mid-stroke.
    cable_n_mm = 0.01, (0.0, 10.0), "N/mm", Assumed("");
    /// Dry friction while it slides.
    friction_n = 0.3, (0.0, 100.0), "N", Assumed("");
    /// Dry friction that has to be overcome from rest.
    stiction_n = 0.36, (0.0, 100.0), "N", Assumed("a fifth above sliding");
    /// Speed at which half of the difference is gone.
    stribeck_mm_s = 1.0, (0.001, 1000.0), "mm/s", Assumed("");
    /// Deflection of the friction's bristles at sliding.
    presliding_um = 2.0, (0.01, 1000.0), "um", Assumed("a rolling guide: a few um");
    /// Damping of the bristles over critical.
    bristle_damping = 0.3, (0.0, 10.0), "", Assumed("");
    /// Viscous friction.
    viscous_n_s_m = 0.0, (0.0, 1000.0), "N s/m", Assumed("");
    /// Play between scale and electrode.
    play_um = 0.0, (0.0, 1000.0), "um", Assumed("none: the electrode is clamped");
    /// Stroke between the stops.
    stroke_mm = 12.0, (0.1, 1000.0), "mm", Source("[R] section 6.1");
    /// Stiffness of a contact of electrode and work.
    contact_n_um = 2.0, (0.01, 10.0), "N/um", Assumed("");
    /// Damping of that contact.
    contact_n_s_m = 20.0, (0.0, 10_000.0), "N s/m", Assumed("");

    /// Largest gap that ignites, over the open-circuit voltage; 0 for none.
    reach_um_v = 1.0, (0.0, 100.0), "um/V", Source("[R]: the gap is 20 to 100 um at 100 V");
    /// Power of the burning time, over half the on-time, with which the recovery time goes.
    recovery_heats = 1.0, (0.0, 2.0), "", Assumed("a surface that was heated for a time cools in as much");
    /// What a millisecond of an arc adds to the recovery of its place, in clean gap's recovery times.
    arc_heat = 2.0, (0.0, 1000.0), "1/ms", Chosen(ARCING);
    /// Heat from which on an arc stays until a retreat, in the same times.
    arc_stays = 3.0, (0.1, 1000.0), "", Chosen(ARCING);
    /// Damage at which a spark removes half of what it does on a clean place; 0 for none.
    hurt_half = 1.0, (0.0, 1000.0), "", Assumed("");
    /// Time constant with which the place of an arc cools.
    arc_cool_ms = 10.0, (0.01, 10_000.0), "ms", Assumed("diffusion over a third of a millimetre of steel");
    /// Distance of a retreat over which the heat of an arc's place counts for e times less.
    arc_tear_um = 10.0, (0.01, 1000.0), "um", Assumed("a fraction of the gap");
    /// Power density of a large face at which a discharge removes half of what it does alone; 0 for no such limit.
    saturate_w_mm2 = 4.0, (0.0, 1e6), "W/mm^2", Source("the rule of 10 A/cm^2, at 40 V");
    /// Radius below which a face stands more of that, as its edge is near.
    saturate_edge_um = 1500.0, (0.0, 1e5), "um", Assumed("");
    /// Reynolds number of the gap's motion at which half of the fluid that enters mixes; 0 for fluid that mixes all, at any pressure.
    reynolds = 15.0, (0.0, 1e6), "", Assumed("inertia beside viscosity");
    /// Depth of the side gap with which the front exchanges; 0 for all of it.
    buffer_um = 3000.0, (0.0, 1e6), "um", Chosen("the gates of depth");
    /// Speed of the gas in the side gap, in volume removed with it, above which more of it moves no more fluid; 0 for none.
    gas_level_um_s = 30.0, (0.0, 1e6), "um/s", Chosen(ARCING);
    /// Gas of the discharges that flushing has to push against, over the volume removed with it.
    gas_back = 1500.0, (0.0, 1e6), "", Assumed("1.4 mm^3 a joule");
    /// Time for which the gap must have opened to tear a bridge or an arc; 0 for none.
    tear_ms = 20.0, (0.0, 10_000.0), "ms", Assumed("a bridge that touches again within this is not torn");
    /// Share of the burn voltage below which nothing ignites.
    ignites_above = 1.0, (0.0, 1.0), "", Source("the burn voltage: below it no channel burns");
    /// Recovery time of a plain RC generator's channel in a clean gap, over the time that its discharge burned; 0 for that of a transistor.
    recovery_rc = 5.8, (0.0, 1000.0), "", Chosen("the textbooks' least resistance of an RC generator");
}

impl Parameters {
    /// Sets one by its name.
    ///
    /// # Errors
    /// When there is none, or the value is outside its range.
    pub fn set(&mut self, key: &str, value: f64) -> Result<(), Refused> {
        let declared = DECLARED.iter().find(|declared| declared.key == key).ok_or(Refused::Unknown)?;
        if !(declared.range.0..=declared.range.1).contains(&value) {
            return Err(Refused::Range(declared, value));
        }
        self.slot(key).map(|slot| *slot = value).ok_or(Refused::Unknown)
    }

    /// Checks every number, alone and against the others.
    ///
    /// # Errors
    /// The first that does not fit.
    pub fn check(&self) -> Result<(), Refused> {
        for (declared, value) in DECLARED.iter().zip(self.values()) {
            if !(declared.range.0..=declared.range.1).contains(&value) {
                return Err(Refused::Range(declared, value));
            }
        }
        let rc = matches!(self.kind, Kind::ControlledRc | Kind::Rc);
        let rules = [
            (self.burn_v >= self.open_v, "burn_v must be below open_v"),
            (self.arc_v > self.burn_v, "arc_v must not be above burn_v"),
            (rc && self.capacitor_pf <= 0.0, "an RC generator needs capacitor_pf above 0"),
            (self.stiction_n < self.friction_n, "stiction_n must not be below friction_n"),
            (self.runout_um > 0.0 && self.turn_ms <= 0.0, "runout_um needs turn_ms above 0"),
            (self.depth_um >= self.thickness_um, "depth_um must be below thickness_um"),
        ];
        rules.into_iter().find(|rule| rule.0).map_or(Ok(()), |rule| Err(Refused::Conflict(rule.1)))
    }

    /// Area of the electrode's face, um^2.
    pub fn area_um2(&self) -> f64 {
        std::f64::consts::PI * self.radius_um * self.radius_um
    }

    /// Volume of a crater of an undisturbed spark, um^3: in a transistor's pulse that of half the on-time.
    pub fn crater_um3(&self) -> f64 {
        let energy = match self.kind {
            Kind::IsoFrequency => 0.4 * self.on_us * self.burn_power(),
            Kind::IsoEnergy => self.on_us * self.burn_power(),
            Kind::ControlledRc | Kind::Rc => self.capacitor_uj(self.open_v, self.burn_v),
        };
        energy * self.removal_um3_uj
    }

    /// Power of a spark of a transistor generator, uJ/us.
    pub fn burn_power(&self) -> f64 {
        self.burn_v * (self.open_v - self.burn_v) / self.burn_ohm
    }

    /// Time in which a capacitor's discharge is over, us: half a period of its circuit.
    pub fn discharge_us(&self) -> f64 {
        std::f64::consts::PI * (self.capacitor_pf * 1e-12 * self.loop_nh * 1e-9).sqrt() * 1e6
    }

    /// Least charging resistance of a plain RC generator, ohm: 30 sqrt(L/C), a rule of textbooks; with less, sparks become arcs.
    pub fn least_ohm(&self) -> f64 {
        30.0 * (self.loop_nh * 1e-9 / (self.capacitor_pf * 1e-12)).sqrt()
    }

    /// Energy that the capacitor gives up between two voltages, uJ.
    pub fn capacitor_uj(&self, from: f64, to: f64) -> f64 {
        0.5e-6 * self.capacitor_pf * (from * from - to * to).max(0.0)
    }

    /// Capacitance of the electrodes, F: that of a plate, levelling off below `rounding_um`, which stands for what is
    /// seen in \[X\] table 2 and is no formula of a plate.
    pub fn gap_farad(&self, gap_um: f64) -> f64 {
        const VACUUM: f64 = 8.854_187_812_8e-12;
        let (g, r) = (gap_um.max(0.0), self.rounding_um.max(1e-3));
        VACUUM * self.permittivity * self.area_um2() * 1e-6 / libm::cbrt(g * g * g + r * r * r)
    }

    /// Time constant with which the voltage over an open gap rises, us.
    pub fn charging_us(&self, gap_um: f64) -> f64 {
        match self.kind {
            Kind::Rc => self.cable_us + self.capacitor_ohm * self.capacitor_pf * 1e-6,
            Kind::ControlledRc => self.cable_us,
            Kind::IsoFrequency | Kind::IsoEnergy => self.cable_us + self.charge_ohm * self.gap_farad(gap_um) * 1e6,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_machine_is_within_the_ranges_and_says_what_it_rests_on() {
        for machine in MACHINES {
            machine.of().check().unwrap();
            for difference in machine.differences {
                assert!(DECLARED.iter().any(|declared| declared.key == difference.key), "{}", difference.key);
            }
        }
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let mut p = Parameters::default();
        assert_eq!(p.set("radius", 1.0), Err(Refused::Unknown));
        let Err(refused) = p.set("radius_um", 1.0) else { panic!() };
        assert_eq!(refused.to_string(), "radius_um is 1 um, not within 20 to 50000");
        p.set("radius_um", 20.0).unwrap();
        assert_eq!(p.radius_um, 20.0);
        p.kind = Kind::Rc;
        assert_eq!(p.check().unwrap_err().to_string(), "an RC generator needs capacitor_pf above 0");
        assert!(Parameters { open_v: f64::NAN, ..Parameters::default() }.check().is_err());
    }
}
