//! Parameters of the process model, each with its source.

use edm_servo_head::declare;
use edm_servo_head::settings::{Declared, SettingError};

declare! {
    /// The machine and the process, as they are; the head's settings describe them to the head.
    pub struct Parameters {
        /// Open-circuit voltage.
        open: f32 = 100.0, (20.0, 300.0), "generator.open_v", "V", "[R] section 4.4";
        /// Burn voltage of a spark, almost independent of the gap.
        burn: f32 = 40.0, (10.0, 100.0), "generator.burn_v", "V", "assumed; [R] section 4.4 erodes at mean voltages from 40 V up";
        /// Scatter of the burn voltage from one discharge to the next.
        burn_scatter: f32 = 1.0, (0.0, 20.0), "generator.burn_scatter_v", "V rms", "assumed; [R] section 6.5.1: it did not vary much";
        /// On-time.
        on: f32 = 160.0, (1.0, 5000.0), "generator.on_us", "us", "assumed: 5 kHz at 80 %, inside the 1 to 100 kHz of [R]";
        /// Off-time.
        off: f32 = 40.0, (0.5, 5000.0), "generator.off_us", "us", "assumed: 5 kHz at 80 %";
        /// Time constant with which the gap voltage rises and collapses.
        rise: f32 = 0.2, (0.01, 10.0), "generator.rise_us", "us", "assumed: cable and gap capacitance";
        /// Voltage of the contact sense supply over an open gap between pulses.
        sense: f32 = 11.1, (0.0, 60.0), "generator.sense_v", "V", "docs/wiring.md";
        /// Shorted pulses in a row after which the generator suspends itself; 0 for never.
        suspend_after: u32 = 0, (0, 1_000_000), "generator.suspend_after", "pulses", "[R] section 6.5: some do; off by default";
        /// Time of a suspension.
        suspend_ms: f32 = 5.0, (0.1, 1000.0), "generator.suspend_ms", "ms", "assumed";

        /// Median ignition delay as a multiple of 0.48 g^2 - 3.69 g + 14.05 us, g in um.
        ignition_scale: f32 = 0.1, (0.001, 10.0), "ignition.scale", "", "curve of a public wire-EDM model; scale assumed for a sinker";
        /// Share by which debris of concentration 1 raises the rate of ignition.
        ignition_debris: f32 = 0.2, (0.0, 10.0), "ignition.debris", "", "assumed";
        /// Gap beyond which no pulse ignites, however long it waits.
        ignition_reach: f32 = 150.0, (10.0, 10_000.0), "ignition.reach_um", "um", "assumed; [R] section 6.5.1 saw a range, [X] works to 80 um";
        /// Depth that a second of burning removes.
        removal: f32 = 6.25, (0.01, 1000.0), "erosion.um_per_burn_s", "um/s", "assumed so that 60 V gives the 0.2 mm/min of [R] section 4.2";
        /// Electrode wear over removed depth.
        wear: f32 = 0.05, (0.0, 100.0), "erosion.wear_percent", "%", "assumed: copper on steel, long pulses";
        /// Share of a spark's removal that an arc achieves.
        arc_removal: f32 = 0.1, (0.0, 1.0), "erosion.arc_share", "", "assumed";
        /// Burn voltage of an arc.
        arc_burn: f32 = 30.0, (5.0, 100.0), "arc.burn_v", "V", "assumed: lower than a spark's";
        /// Chance of an arc after a discharge without any off-time, per unit of debris concentration.
        arc_chance: f32 = 0.015, (0.0, 1.0), "arc.chance", "", "assumed: 0.2 % of pulses at the default off-time";
        /// Time constant with which the channel recovers in off-time.
        arc_recovery: f32 = 20.0, (0.1, 1000.0), "arc.recovery_us", "us", "assumed";
        /// Chance that an arc is followed by another, at a concentration of 1 and above.
        arc_repeats: f32 = 0.5, (0.0, 0.99), "arc.repeats", "", "assumed";
        /// Chance that a pulse finds a new bridge of debris, per square of the concentration.
        bridge_chance: f32 = 5e-5, (0.0, 1.0), "short.chance", "", "assumed: one in four seconds at 5 kHz";
        /// Mean time that a bridge lasts.
        bridge_ms: f32 = 5.0, (0.01, 10_000.0), "short.mean_ms", "ms", "assumed";
        /// Mean length by which the gap has to open to break a bridge.
        bridge_um: f32 = 20.0, (0.1, 1000.0), "short.break_um", "um", "assumed";
        /// Height of surface peaks: gaps of this width touch in one pulse of three.
        peaks: f32 = 3.0, (0.1, 50.0), "short.peak_um", "um", "assumed: roughness of both surfaces";
        /// Time constant of flushing at the surface.
        flush: f32 = 0.5, (0.01, 100.0), "flush.time_s", "s", "assumed";
        /// Depth at which flushing takes twice as long.
        flush_depth: f32 = 2.0, (0.01, 1000.0), "flush.depth_mm", "mm", "assumed";
        /// Share of the dielectric squeezed out of a narrowing gap that clean dielectric replaces.
        flush_exchange: f32 = 0.3, (0.0, 1.0), "flush.exchange", "", "assumed";

        /// Workpiece surface below the upper stop.
        surface: f32 = 2.0, (0.0, 1000.0), "workpiece.surface_mm", "mm", "assumed";
        /// Stiffness of a contact.
        contact: f32 = 2.0, (0.01, 10.0), "workpiece.stiffness_n_um", "N/um", "assumed";
        /// Radius of the electrode face.
        radius: f32 = 1.5, (0.05, 50.0), "electrode.radius_mm", "mm", "assumed";
        /// Viscosity of the dielectric.
        viscosity: f32 = 2.0, (0.1, 100.0), "dielectric.viscosity_mpa_s", "mPa s", "assumed: kerosene at 20 degrees C";

        /// Moving mass.
        mass: f32 = 0.2, (0.01, 20.0), "actuator.mass_kg", "kg", "assumed, the size of the actuator of [R] section 6.1";
        /// Winding resistance.
        resistance: f32 = 12.4, (0.1, 200.0), "actuator.resistance_ohm", "ohm", "[R] section 7.2, measured";
        /// Winding inductance.
        inductance: f32 = 3.0, (0.01, 100.0), "actuator.inductance_mh", "mH", "assumed; not measured in [R]";
        /// Force and back-EMF constant.
        force_constant: f32 = 7.5, (0.1, 200.0), "actuator.force_constant_n_a", "N/A", "[R] section 7.2: 7 N/A and 8 V/(m/s) measured";
        /// Bus voltage.
        bus: f32 = 48.0, (5.0, 60.0), "actuator.bus_v", "V", "[R] section 6.1";
        /// Dry friction.
        friction: f32 = 0.3, (0.0, 100.0), "actuator.friction_n", "N", "assumed";
        /// Viscous friction.
        damping: f32 = 0.0, (0.0, 1000.0), "actuator.damping_n_s_m", "N s/m", "assumed";
        /// Lifting force of counterbalance or spring.
        counterbalance: f32 = 2.2, (0.0, 500.0), "actuator.counterbalance_n", "N", "assumed: a little over the weight";
        /// Stroke between the stops.
        stroke: f32 = 12.0, (0.1, 1000.0), "actuator.stroke_mm", "mm", "[R] section 6.1";
        /// Upper limit switch; it opens above this position. Below zero it never does.
        upper_limit: f32 = -1.0, (-1.0, 1000.0), "limit.upper_mm", "mm", "assumed: none";
        /// Lower limit switch; it opens below this position.
        lower_limit: f32 = 11.8, (0.0, 1000.0), "limit.lower_mm", "mm", "assumed";
        /// The motor is connected in reverse.
        motor_reversed: bool = false, (), "wiring.motor_reversed", "", "for commissioning";
        /// The encoder is connected in reverse.
        encoder_reversed: bool = false, (), "wiring.encoder_reversed", "", "for commissioning";
        /// The gap leads are swapped.
        gap_reversed: bool = false, (), "wiring.gap_reversed", "", "for commissioning";

        /// Length of one encoder count.
        count: f32 = 1.0, (0.05, 100.0), "scale.count_um", "um", "[R] section 6.1; 0.5 and 5 exist";
        /// Distance between index marks.
        marks: f32 = 10.0, (0.1, 1000.0), "scale.mark_mm", "mm", "[L] section 3";
        /// Error of the quarter-period shift between A and B, in counts.
        phase_error: f32 = 0.0, (-0.9, 0.9), "scale.phase_error", "counts", "assumed: none";
        /// Chance that an edge is lost before the decoder.
        edge_loss: f32 = 0.0, (0.0, 0.1), "scale.edge_loss", "", "assumed: none";

        /// Converter code of zero volts.
        zero_code: u32 = 410, (0, 4095), "front_end.zero_code", "codes", "assumed: docs/wiring.md";
        /// Gap voltage per code.
        volts_per_code: f32 = 0.1, (0.001, 1.0), "front_end.volts_per_code", "V", "assumed: docs/wiring.md";
        /// Gain error.
        gain_error: f32 = 0.0, (-20.0, 20.0), "front_end.gain_error_percent", "%", "assumed: none";
        /// White noise of a conversion; without noise the head takes the converter for stuck.
        noise: f32 = 0.5, (0.0, 50.0), "front_end.noise_v", "V rms", "assumed";
        /// Amplitude of mains hum.
        hum: f32 = 1.0, (0.0, 50.0), "front_end.hum_v", "V", "[R] section 6.5: seen, amplitude assumed";
        /// Mains frequency.
        mains: f32 = 50.0, (45.0, 65.0), "front_end.mains_hz", "Hz", "[R] section 6.5";
        /// Largest drift of the mains frequency.
        mains_drift: f32 = 0.2, (0.0, 2.0), "front_end.mains_drift_hz", "Hz", "assumed: the band that European grids keep";
        /// Motor current per code.
        amps_per_code: f32 = 0.00269, (0.0001, 0.1), "front_end.amps_per_code", "A", "assumed: docs/wiring.md";
        /// Bus voltage per code.
        bus_per_code: f32 = 0.0153, (0.001, 0.1), "front_end.bus_volts_per_code", "V", "assumed: docs/wiring.md";
    }
}

impl Parameters {
    /// Checks every parameter, alone and against the others.
    pub fn validate(&self) -> Result<(), SettingError> {
        self.check()?;
        self.fits(self.stroke)?;
        let rules = [
            (self.burn >= self.open, "generator.burn_v", "must be below generator.open_v"),
            (self.arc_burn > self.burn, "arc.burn_v", "must not be above generator.burn_v"),
        ];
        broken(&rules)
    }

    /// Checks what both versions of the process model have against each other, and the stroke in mm.
    pub(super) fn fits(&self, stroke: f32) -> Result<(), SettingError> {
        let rules = [
            (
                self.surface >= stroke,
                "workpiece.surface_mm",
                "must lie inside the stroke, actuator.stroke_mm or model.stroke_mm",
            ),
            (self.marks * 1e3 < 4.0 * self.count, "scale.mark_mm", "must be at least four times scale.count_um"),
            (self.lower_limit <= self.upper_limit, "limit.lower_mm", "must be below limit.upper_mm"),
        ];
        broken(&rules)
    }
}

fn broken(rules: &[(bool, &'static str, &'static str)]) -> Result<(), SettingError> {
    let broken = rules.iter().find(|(broken, ..)| *broken);
    broken.map_or(Ok(()), |&(_, field, rule)| Err(SettingError::Conflict { field, rule }))
}
