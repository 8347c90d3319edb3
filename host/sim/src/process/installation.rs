//! What stands around machine and process: the work's place, the bus, switches, wiring, scale and front end.

use edm_servo_head::declare;
use edm_servo_head::settings::SettingError;

declare! {
    /// Surroundings of machine and process, as they are; the head's settings describe them to the head.
    pub struct Installation {
        /// Workpiece surface below the upper stop.
        surface: f32 = 2.0, (0.0, 1000.0), "workpiece.surface_mm", "mm", "assumed";
        /// Bus voltage.
        bus: f32 = 48.0, (5.0, 60.0), "actuator.bus_v", "V", "[R] section 6.1";
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
        /// Open-circuit voltage of which somebody has set the comparators to 70 and 20 %; 0: that of the machine as published. It does not
        /// move with the one there is.
        comparators_for: f32 = 0.0, (0.0, 300.0), "front_end.comparators_for_v", "V", "assumed: a potentiometer is set once";
        /// Error of the comparators' thresholds.
        comparator_error: f32 = 0.0, (-30.0, 30.0), "front_end.comparator_error_percent", "%", "assumed: up to 20 either way, by hand";
        /// Most by which a discharge disturbs the conversion of the gap voltage that it meets.
        spark_gap: f32 = 0.0, (0.0, 100.0), "front_end.spark_v", "V", "assumed: none";
        /// Most by which a discharge disturbs a conversion of the bus voltage.
        spark_bus: f32 = 0.0, (0.0, 50.0), "front_end.spark_bus_v", "V", "assumed: none";
        /// Chance that a discharge shows as a pulse on A and B together.
        spark_edges: f32 = 0.0, (0.0, 1.0), "scale.spark_edges", "", "assumed: none, with differential receivers";
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

impl Installation {
    /// Lets discharges couple into the lines beside theirs, as campaigns have them (assumed).
    pub fn couple(&mut self) {
        (self.spark_gap, self.spark_bus, self.spark_edges) = (10.0, 2.0, 1e-4);
    }

    /// Checks what stands around the machine against a stroke in mm.
    ///
    /// # Errors
    /// The first value that does not fit.
    pub(super) fn fits(&self, stroke: f32) -> Result<(), SettingError> {
        let rules = [
            (self.surface >= stroke, "workpiece.surface_mm", "must lie inside the stroke, model.stroke_mm"),
            (self.marks * 1e3 < 4.0 * self.count, "scale.mark_mm", "must be at least four times scale.count_um"),
            (self.lower_limit <= self.upper_limit, "limit.lower_mm", "must be below limit.upper_mm"),
        ];
        let broken = rules.iter().find(|(broken, ..)| *broken);
        broken.map_or(Ok(()), |&(_, field, rule)| Err(SettingError::Conflict { field, rule }))
    }
}
