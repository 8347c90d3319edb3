//! The settings of a head, one declaration each.
//!
//! Index and sub-index of a setting as an object stand in front of its name: once released they never change, and are in
//! `docs/released-objects.csv`. The order of declaration means nothing to a host or to what is stored. A new setting gets the
//! next free sub-index of its group (a group is an index), and a line at the end of that list.

use crate::declare;
use crate::feed::LawName;
use crate::gap::controlled::ControlledName;
use crate::gap::voltage::Average;
use crate::head::{OrbitShape, SeenBy, Structure};

crate::choice!(Average { Plain = "plain", Gated = "gated" });

/// How the gap set point is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SetpointUnit {
    /// `gap.setpoint_v`.
    Volts,
    /// `gap.setpoint_percent` of the measured open-circuit voltage.
    PercentOfOpen,
}
crate::choice!(SetpointUnit { Volts = "volts", PercentOfOpen = "percent_of_open" });

crate::choice!(OrbitShape { None = "none", Circle = "circle", Square = "square", Sphere = "sphere" });
crate::choice!(SeenBy { Word = "word", Touch = "touch" });
crate::choice!(LawName);
crate::choice!(ControlledName);
crate::choice!(Structure { SingleLoop = "single_loop", VelocityCascade = "velocity_cascade", Path = "path" });

declare! {
    /// What a person sets on a head: physical units, ranges, defaults.
    pub struct Settings {
        /// How the gap voltage is averaged. With pulses on, the reading goes from one average to the other with gap.transfer_ms, and what
        /// was measured as the open circuit with it.
        0x2100:1 gap_average: Average = Average::Gated, (), "gap.average", "", "[R] section 6.5.1, the gated average designed there", live;
        /// Converter code of zero volts.
        0x2100:2 gap_zero_code: u32 = 410, (0, 4095), "gap.zero_code", "codes", "assumed: divider with offset, docs/wiring.md", disabled "loop and reflex rely on it";
        /// Gap voltage per converter code.
        0x2100:3 gap_volts_per_code: f32 = 0.1, (0.001, 1.0), "gap.volts_per_code", "V", "assumed: divider with offset, docs/wiring.md", disabled "loop and reflex rely on it";
        /// The gap leads are swapped.
        0x2100:4 gap_reversed: bool = false, (), "gap.reversed", "", "found by commissioning", disabled "loop and reflex rely on it";
        /// Corner of the low-pass; may be changed while eroding.
        0x2100:5 gap_corner: f32 = 200.0, (20.0, 2000.0), "gap.corner_hz", "Hz", "[R] section 6.5.3", live;
        /// Mains frequency that the notch removes.
        0x2100:6 gap_mains: f32 = 50.0, (45.0, 65.0), "gap.mains_hz", "Hz", "[R] section 6.5.3: 50; 60 elsewhere", live;
        /// Notch the second harmonic as well.
        0x2100:7 gap_second_harmonic: bool = false, (), "gap.second_harmonic", "", "[R] section 6.5.3: tried there, left out", live;
        /// Gap voltage below which a gated block is a short.
        0x2100:8 gap_short: f32 = 20.0, (1.0, 200.0), "gap.short_v", "V", "assumed: half the burn voltage of [R]", rises "a lower one would hide shorts";
        /// Converter code of no gap current.
        0x2100:9 gap_current_zero_code: u32 = 2048, (0, 4095), "gap.current_zero_code", "codes", "docs/wiring.md: mid-scale", disabled "loop and reflex rely on it";
        /// Gap current per converter code.
        0x2100:10 gap_amps_per_code: f32 = 0.0161, (0.0001, 1.0), "gap.amps_per_code", "A", "docs/wiring.md: 50 mV/A", disabled "loop and reflex rely on it";
        /// Gap current from which a low voltage inside a pulse is a short to the reflex.
        0x2100:11 gap_short_amps: f32 = 1.0, (0.05, 100.0), "gap.short_a", "A", "assumed: twice the zero error of docs/wiring.md", falls "a higher one would hide shorts from the reflex";
        /// Time constant with which the gap voltage rises in a pulse; the reflex samples after three of them, but not
        /// before 2 us.
        0x2100:12 gap_charging_us: f32 = 0.5, (0.0, 200.0), "gap.charging_us", "us", "assumed: transistor generator; R times C of an RC generator", falls "the reflex is blind for three of them";
        /// Longest hold through off-time before the gate counts as missing.
        0x2100:13 gap_hold_ms: f32 = 20.0, (1.0, 1000.0), "gap.hold_ms", "ms", "assumed: longer than the longest pulse period of [R], 1 ms", falls "a missing gate would be detected later";
        /// Centre of the notch over the distance of its -3 dB corners.
        0x2100:14 gap_notch_q: f32 = 2.5, (0.5, 30.0), "gap.notch_q", "", "[R] section 6.5.3: corners of 40 and 60 Hz about 50", live;
        /// How the set point is given.
        0x2100:15 gap_setpoint_unit: SetpointUnit = SetpointUnit::Volts, (), "gap.setpoint_unit", "", "[R] section 4.4", live;
        /// Gap voltage to keep.
        0x2100:16 gap_setpoint: f32 = 60.0, (1.0, 300.0), "gap.setpoint_v", "V", "[R] section 4.4: 40 to 60 V while eroding steadily", live;
        /// Gap voltage to keep, as a share of the measured open-circuit voltage.
        0x2100:17 gap_setpoint_percent: f32 = 60.0, (5.0, 95.0), "gap.setpoint_percent", "%", "[R] section 4.4", live;
        /// Lowest open-circuit voltage to start with.
        0x2100:18 gap_open_min: f32 = 70.0, (1.0, 300.0), "gap.open_min_v", "V", "assumed: 100 V of [R] less 30 %", rises "a lower one would start on a dead gap signal";

        /// Gap voltage below which a pulse with current, and no short, is an arc: below what sparks in this material burn with, or
        /// they are taken for arcs.
        0x2100:19 gap_arc: f32 = 34.0, (1.0, 200.0), "gap.arc_below_v", "V", "assumed: midway from arcs of 28 V to sparks of 40 V", rises "a lower one would hide arcs";
        /// Open-circuit voltage of the generator. A teach-in, 2013h, finds it, and the levels below; sparks and arcs are learned at work as well.
        0x2100:20 gap_open: f32 = 100.0, (10.0, 400.0), "gap.open_v", "V", "[R] section 4.4", live;
        /// Burning voltage of a spark. A pulse above the middle between this and gap.open_v has not ignited.
        0x2100:21 gap_spark: f32 = 40.0, (1.0, 300.0), "gap.spark_v", "V", "[R] section 4.4", live;
        /// Noise of one conversion of the gap voltage, standard deviation: more of it wants more conversions for a class.
        0x2100:22 gap_noise: f32 = 4.0, (0.05, 50.0), "gap.noise_v", "V", "assumed: 20 dB below the burning voltage", live;
        /// The notch follows the mains, from gap.mains_hz on, between 45 and 65 Hz.
        0x2100:23 gap_follow_mains: bool = false, (), "gap.follow_mains", "", "docs/gap-sensing.md: residue by drift", live;
        /// Quantity that is kept at its set point.
        0x2100:24 controlled: ControlledName = ControlledName::GapVoltage, (), "gap.controlled", "", "[R] section 6.5; distance: [X]; frequency: [L]", live;
        /// Time over which pulses are remembered for hazard, distance and spark frequency.
        0x2100:25 sense_memory: f32 = 10.0, (1.0, 10_000.0), "gap.memory_ms", "ms", "assumed: 80 pulses at 5 kHz, a hazard known to 12 %", live;
        /// Time constant with which the difference between two quantities fades after a change of gap.controlled or gap.average.
        0x2100:26 transfer_ms: f32 = 500.0, (1.0, 10_000.0), "gap.transfer_ms", "ms", "assumed: slower than the gap loop's 4 Hz", live;
        /// Hazard of ignition to keep, ignitions a second of waiting.
        0x2100:27 hazard_setpoint: f32 = 12_600.0, (1.0, 10_000_000.0), "gap.hazard_per_s", "1/s", "docs/gap-sensing.md: 34 um of the sinker at 5 kHz (simulated)", live;
        /// Gap error of a hazard that is 2.72 times too low.
        0x2100:28 hazard_weight: f32 = 13.0, (0.01, 1000.0), "gap.hazard_weight_v", "V", "assumed: a third of 36 um at 1.1 V/um", live;
        /// Gap to keep, by charging time.
        0x2100:29 distance_setpoint: f32 = 50.0, (5.0, 200.0), "gap.distance_um", "um", "[X] section 4: 40 to 60 um", live;
        /// Gap error of a micrometre.
        0x2100:30 distance_weight: f32 = 1.1, (0.01, 100.0), "gap.distance_weight_v", "V/um", "assumed: as the gap voltage of the sinker", live;
        /// Spark frequency to keep; below the pulse frequency.
        0x2100:31 frequency_setpoint: f32 = 3000.0, (1.0, 1_000_000.0), "gap.spark_per_s", "1/s", "assumed: 60 % of 5 kHz", live;
        /// Gap error of a spark frequency that is 2.72 times too low.
        0x2100:32 frequency_weight: f32 = 20.0, (0.01, 1000.0), "gap.spark_weight_v", "V", "assumed", live;
        /// Gap by charging time t: c3 t^3 + c2 t^2 + c1 t + c0.
        0x2100:33 charging_c3: f32 = -50.4, (-1e6, 1e6), "gap.charging_c3", "um/us^3", "[X] equation 9: 10 mm copper on silicon", disabled "a controlled distance relies on it";
        /// See gap.charging_c3.
        0x2100:34 charging_c2: f32 = 190.6, (-1e6, 1e6), "gap.charging_c2", "um/us^2", "[X] equation 9", disabled "a controlled distance relies on it";
        /// See gap.charging_c3.
        0x2100:35 charging_c1: f32 = -281.6, (-1e6, 1e6), "gap.charging_c1", "um/us", "[X] equation 9", disabled "a controlled distance relies on it";
        /// See gap.charging_c3.
        0x2100:36 charging_c0: f32 = 182.6, (-1e6, 1e6), "gap.charging_c0", "um", "[X] equation 9", disabled "a controlled distance relies on it";
        /// Shortest time constant for which the polynomial holds.
        0x2100:37 charging_shortest: f32 = 0.52, (0.0, 100.0), "gap.charging_shortest_us", "us", "[X] table 2: 80 um", disabled "a controlled distance relies on it";
        /// Longest time constant for which the polynomial holds.
        0x2100:38 charging_longest: f32 = 1.66, (0.0, 100.0), "gap.charging_longest_us", "us", "[X] table 2: 10 um", disabled "a controlled distance relies on it";
        /// Longest ignition delay of an arc, from 70 % of the open circuit on: what waits longer is a spark, whatever it burns at.
        0x2100:39 gap_arc_delay_us: f32 = 4.0, (0.5, 1000.0), "gap.arc_delay_us", "us", "assumed: arcs of the process model wait for 3 us at the most", falls "sparks would be taken for what they are not";

        /// Off-time requested of the generator; 0 leaves its own.
        0x2101:1 generator_off_time_us: f32 = 0.0, (0.0, 200.0), "generator.off_time_us", "us", "assumed: setting of the generator itself; range of docs/wiring.md", live;
        /// Pause after a pulse that stayed open: with generator.off_time_us, from the end of the on-time, for which the head inhibits the
        /// generator; 0: none. Without the gate it cannot be.
        0x2101:2 generator_pause_open_us: f32 = 0.0, (0.0, 1000.0), "generator.pause_open_us", "us", "assumed: none; [G]: as long as the off-time", live;
        /// The same after a spark, and after a pulse that nothing classifies.
        0x2101:3 generator_pause_spark_us: f32 = 0.0, (0.0, 1000.0), "generator.pause_spark_us", "us", "assumed: none", live;
        /// The same after an arc.
        0x2101:4 generator_pause_arc_us: f32 = 0.0, (0.0, 1000.0), "generator.pause_arc_us", "us", "assumed: none; [G]: as long as the off-time", live;
        /// The same after a short.
        0x2101:5 generator_pause_short_us: f32 = 0.0, (0.0, 1000.0), "generator.pause_short_us", "us", "assumed: none; [G]: as long as the off-time", live;

        /// How the gap error becomes a duty.
        0x2102:1 structure: Structure = Structure::Path, (), "feed.structure", "", "[R] sections 6.6 and 6.7, the last one built", live;
        /// Feed law.
        0x2102:2 law: LawName = LawName::IncrementByError, (), "feed.law", "", "[R] section 6.7.3", live;
        /// Path velocity of the law fixed_rate.
        0x2102:3 fixed_rate: f32 = 20.0, (0.1, 10_000.0), "feed.fixed_rate_um_s", "um/s", "assumed", live;
        /// Standard velocity of the law rate_by_error.
        0x2102:4 standard_velocity: f32 = 100.0, (0.1, 10_000.0), "feed.standard_um_s", "um/s", "assumed", live;
        /// Gap error at which rate_by_error gives its standard velocity.
        0x2102:5 standard_error: f32 = 5.0, (0.1, 300.0), "feed.standard_error_v", "V", "assumed", live;
        /// Largest velocity of the law rate_by_error.
        0x2102:6 rate_clamp: f32 = 500.0, (0.1, 10_000.0), "feed.rate_clamp_um_s", "um/s", "assumed", live;
        /// Path velocity per volt of gap error of the law increment_by_error.
        0x2102:7 feed_gain: f32 = 23.0, (0.01, 1000.0), "feed.gain_um_s_v", "um/s per V", "assumed: 4 Hz crossover at 1.1 V/um", live;
        /// Period of the law increment_by_error.
        0x2102:8 feed_period_ms: f32 = 1.0, (0.05, 1000.0), "feed.period_ms", "ms", "[R] section 6.7.3", live;
        /// Largest velocity toward the work under a feed law.
        0x2102:9 feed_max: f32 = 300.0, (0.1, 10_000.0), "feed.max_um_s", "um/s", "assumed", live;
        /// Largest velocity away from the work under a feed law.
        0x2102:10 feed_retreat_max: f32 = 2000.0, (0.1, 100_000.0), "feed.retreat_max_um_s", "um/s", "assumed", live;
        /// Acceleration along the path in every motion.
        0x2102:11 acceleration: f32 = 5.0, (0.01, 100.0), "feed.acceleration_m_s2", "m/s^2", "assumed: a tenth of what the actuator of [R] can do", live;
        /// Path velocity of the law two_thresholds, either way.
        0x2102:12 threshold_rate: f32 = 20.0, (0.1, 10_000.0), "feed.threshold_um_s", "um/s", "assumed; [G]: 1 um in a period of 100 ms, 10 um/s", live;
        /// Band below the set point in which the law two_thresholds holds: upper threshold minus lower threshold.
        0x2102:13 threshold_band: f32 = 10.0, (0.0, 300.0), "feed.band_v", "V", "[G]: 2TAV 30 and 20 V, or 30 and 10; 1TAV has none", live;
        /// Period of the law two_thresholds.
        0x2102:14 threshold_period_ms: f32 = 100.0, (0.05, 1000.0), "feed.threshold_period_ms", "ms", "[G]: 100 ms", live;
        /// Step of the laws pulse_counts and pulse_control, either way.
        0x2102:15 pulses_step: f32 = 1.0, (0.01, 100.0), "feed.pulses_step_um", "um", "[G]: 1 um", live;
        /// Period of pulse_counts and pulse_control.
        0x2102:16 pulses_period_ms: f32 = 100.0, (0.25, 1000.0), "feed.pulses_period_ms", "ms", "[G]: 100 ms", live;
        /// Share of shorts from which pulse_counts and pulse_control step back.
        0x2102:17 pulses_short_percent: f32 = 90.0, (1.0, 100.0), "feed.pulses_short_percent", "%", "[G]: 90 %", live;
        /// Discharges of a period from which they hold.
        0x2102:18 pulses_discharges: u32 = 150, (1, 1_000_000), "feed.pulses_discharges", "", "[G]: 100 to 300, best 150, of some 10 000 pulses", live;
        /// Share of open pulses from which they step forward, with fewer discharges.
        0x2102:19 pulses_open_percent: f32 = 50.0, (1.0, 100.0), "feed.pulses_open_percent", "%", "assumed: [G] does not publish it", live;
        /// Time for which they close the pulses after a period that is none of these; 0: never.
        0x2102:20 pulses_closed_ms: f32 = 10.0, (0.0, 1000.0), "feed.pulses_closed_ms", "ms", "assumed: [G] does not publish it", live;
        /// Weight w of the periods before in the mean direction of pulse_control.
        0x2102:21 direction_weight: f32 = 0.8, (0.0, 0.999), "feed.direction_weight", "", "assumed: [G] does not publish it; 5 periods", live;
        /// Periods over which pulse_control averages the share of shorts.
        0x2102:22 shorts_periods: u32 = 5, (1, 16), "feed.shorts_periods", "", "assumed: [G] does not publish it", live;
        /// Mean direction, either way, above which pulse_control may lengthen the off-time: 1 is a step in every period.
        0x2102:23 direction_limit: f32 = 0.3, (0.0, 1.0), "feed.direction_limit", "", "assumed: [G] does not publish it", live;
        /// Mean share of shorts above which it does.
        0x2102:24 shorts_limit_percent: f32 = 10.0, (0.0, 100.0), "feed.shorts_limit_percent", "%", "assumed: [G] does not publish it", live;
        /// Off-time that pulse_control asks for.
        0x2102:25 long_off_time_us: f32 = 12.0, (1.0, 1000.0), "feed.long_off_time_us", "us", "[G]: 6 us doubled", live;
        /// Time for which it does.
        0x2102:26 long_off_ms: f32 = 200.0, (1.0, 10_000.0), "feed.long_off_ms", "ms", "assumed: [G] does not publish it", live;
        /// Forgetting factor of the law minimum_variance. Its set point is gap.distance_um, held in 10 to 80 um.
        0x2102:27 forgetting: f32 = 0.98, (0.9, 1.0), "feed.forgetting", "", "assumed: 50 periods; [X] does not publish it", live;
        /// Period of minimum_variance.
        0x2102:28 variance_period_ms: f32 = 100.0, (1.0, 1000.0), "feed.variance_period_ms", "ms", "[X] section 4: 0.1 s", live;
        /// Path velocity of the law spark_frequency without sparks; at gap.spark_per_s it stands.
        0x2102:29 frequency_rate: f32 = 100.0, (0.1, 10_000.0), "feed.frequency_um_s", "um/s", "assumed: [L] publishes no gain", live;
        /// Share of open pulses that the law gap_ratio keeps.
        0x2102:30 ratio_open_percent: f32 = 25.0, (0.0, 100.0), "feed.ratio_open_percent", "%", "assumed", live;
        /// Weight of shorts and arcs against open pulses in gap_ratio.
        0x2102:31 ratio_weight: f32 = 2.0, (0.0, 100.0), "feed.ratio_weight", "", "assumed", live;
        /// Path velocity of gap_ratio for a share that is off by one.
        0x2102:32 ratio_gain: f32 = 100.0, (0.1, 10_000.0), "feed.ratio_um_s", "um/s", "assumed", live;
        /// Integral time of gap_ratio; 0: no integral.
        0x2102:33 ratio_integral_ms: f32 = 1000.0, (0.0, 100_000.0), "feed.ratio_integral_ms", "ms", "assumed", live;
        /// Period of gap_ratio.
        0x2102:34 ratio_period_ms: f32 = 10.0, (0.25, 1000.0), "feed.ratio_period_ms", "ms", "assumed", live;
        /// Gap that the law observed_gap keeps: the one that ignites at gap.hazard_per_s.
        0x2102:35 observed_gap: f32 = 34.0, (1.0, 200.0), "feed.observed_um", "um", "docs/gap-sensing.md: 34 um of the sinker (simulated)", live;
        /// Path velocity of observed_gap for a um too much.
        0x2102:36 observed_gain: f32 = 20.0, (0.1, 1000.0), "feed.observed_per_s", "1/s", "assumed", live;
        /// Standard deviations of the estimate by which observed_gap keeps a wider gap.
        0x2102:37 observed_caution: f32 = 0.0, (0.0, 10.0), "feed.observed_caution", "", "assumed", live;
        /// How much the gap wanders by what is not seen, in the root of a second, for observed_gap.
        0x2102:38 observed_noise: f32 = 5.0, (0.1, 1000.0), "feed.observed_noise_um", "um", "assumed", live;
        /// How much the velocity of the surface does.
        0x2102:39 observed_drift: f32 = 20.0, (0.0, 10_000.0), "feed.observed_drift_um_s", "um/s", "assumed", live;
        /// Share of the time that observed_gap may lose on the way back from retreats; above, it keeps a gap up to 2.5 times as wide.
        0x2102:40 observed_lost: f32 = 50.0, (5.0, 100.0), "feed.observed_lost_percent", "%", "src/feed/observed_gap.rs: most is removed at 50", live;

        /// Proportional gain of the single loop, duty per volt of gap error.
        0x2103:1 single_p: f32 = 0.001, (0.0, 1.0), "single.p", "1/V", "assumed", live;
        /// Integral gain of the single loop.
        0x2103:2 single_i: f32 = 0.0, (0.0, 10.0), "single.i", "1/(V s)", "assumed", live;
        /// Derivative gain of the single loop.
        0x2103:3 single_d: f32 = 0.0, (0.0, 0.1), "single.d", "s/V", "[R] section 7.1.2 needs one", live;
        /// Largest gap error that enters the integrator of the single loop.
        0x2103:4 single_clip: f32 = 20.0, (0.1, 300.0), "single.clip_v", "V", "[R] section 6.6.1", live;

        /// Path velocity toward the work until sparks begin.
        0x2104:1 seek_velocity: f32 = 1000.0, (50.0, 5000.0), "seek.velocity_um_s", "um/s", "assumed", live;
        /// Share of the open-circuit voltage below which the work is found.
        0x2104:2 seek_threshold: f32 = 85.0, (10.0, 99.0), "seek.threshold_percent", "%", "assumed", live;
        /// Time at rest with pulses on, to measure the open-circuit voltage.
        0x2104:3 seek_settle_ms: f32 = 100.0, (10.0, 10_000.0), "seek.settle_ms", "ms", "assumed: five times the settling of notch and low-pass", live;

        /// Consecutive short pulses after which the reflex retreats.
        0x2105:1 retreat_after_shorts: u32 = 5, (1, 1000), "retreat.after_shorts", "", "docs/architecture.md: 5 pulses or 1 ms", falls "the retreat would begin later";
        /// Uninterrupted short after which the head retreats.
        0x2105:2 retreat_after_ms: f32 = 1.0, (0.05, 100.0), "retreat.after_ms", "ms", "docs/architecture.md: 5 pulses or 1 ms", falls "the retreat would begin later";
        /// Path velocity of a retreat from a short or a fault.
        0x2105:3 retreat_velocity: f32 = 5000.0, (100.0, 200_000.0), "retreat.velocity_um_s", "um/s", "assumed", rises "the retreat would be slower";
        /// Length to go back from a short at least.
        0x2105:4 retreat_clearance: f32 = 10.0, (0.0, 10_000.0), "retreat.clearance_um", "um", "assumed", rises "the retreat would end closer to the work";
        /// Length to go back from a short at most; still shorted 100 ms later, the short is persistent.
        0x2105:5 retreat_limit: f32 = 2000.0, (1.0, 1_000_000.0), "retreat.limit_um", "um", "assumed", falls "a persistent short would burn longer";
        /// Time after which a short is persistent.
        0x2105:6 retreat_persistent_ms: f32 = 1000.0, (1.0, 60_000.0), "retreat.persistent_ms", "ms", "assumed", falls "a persistent short would burn longer";
        /// Safe height, behind the point where the work was found.
        0x2105:7 retreat_safe: f32 = 1000.0, (0.0, 1_000_000.0), "retreat.safe_um", "um", "assumed", rises "a fault would leave the head closer to the work";
        /// Length to retract off an open lower limit switch.
        0x2105:8 retreat_off_limit: f32 = 500.0, (500.0, 1_000_000.0), "retreat.off_limit_um", "um", "docs/architecture.md", rises "a fault would leave the head closer to the work";

        /// Moving mass with electrode.
        0x2106:1 axis_mass: f32 = 0.2, (0.02, 10.0), "axis.mass_kg", "kg", "[R] section 6.1", disabled "loop, lift and encoder check are calculated from it";
        /// Winding resistance.
        0x2106:2 axis_resistance: f32 = 12.4, (0.1, 200.0), "axis.resistance_ohm", "ohm", "[R] section 7.2, measured", disabled "loop, lift and encoder check are calculated from it";
        /// Winding inductance.
        0x2106:3 axis_inductance: f32 = 3.0, (0.0, 100.0), "axis.inductance_mh", "mH", "assumed; not measured in [R]", disabled "loop, lift and encoder check are calculated from it";
        /// Force constant; the back-EMF constant in V/(m/s) is the same number.
        0x2106:4 axis_force_constant: f32 = 7.5, (0.1, 200.0), "axis.force_constant_n_a", "N/A", "[R] section 7.2: 7 N/A and 8 V/(m/s) measured", disabled "loop, lift and encoder check are calculated from it";
        /// Bus voltage.
        0x2106:5 axis_bus: f32 = 48.0, (5.0, 60.0), "axis.bus_v", "V", "[R] section 6.1", disabled "loop, lift and encoder check are calculated from it";
        /// Lifting force of counterbalance or spring.
        0x2106:6 axis_counterbalance: f32 = 2.2, (0.0, 100.0), "axis.counterbalance_n", "N", "assumed: a little over the weight, docs/wiring.md", disabled "loop, lift and encoder check are calculated from it";
        /// Stroke between the stops.
        0x2106:7 axis_stroke: f32 = 12_000.0, (100.0, 1_000_000.0), "axis.stroke_um", "um", "[R] section 6.1", disabled "loop, lift and encoder check are calculated from it";
        /// Largest duty.
        0x2106:8 axis_duty_limit: f32 = 0.9, (0.01, 1.0), "axis.duty_limit", "", "assumed", disabled "loop, lift and encoder check are calculated from it";
        /// Dry friction at rest: the force, in addition to the net weight, that begins to move the head.
        0x2106:9 axis_breakaway: f32 = 0.3, (0.0, 20.0), "axis.breakaway_n", "N", "assumed; found by commissioning", falls "a dead encoder would be detected later";

        /// A positive duty moves away from the work.
        0x2107:1 motor_reversed: bool = false, (), "motor.reversed", "", "found by commissioning", disabled "the loop would move in the wrong direction, or too far";
        /// Largest motor current.
        0x2107:2 motor_peak: f32 = 3.0, (0.1, 20.0), "motor.peak_a", "A", "assumed", disabled "the winding could get hotter";
        /// Largest continuous motor current.
        0x2107:3 motor_continuous: f32 = 1.0, (0.1, 20.0), "motor.continuous_a", "A", "assumed", disabled "the winding could get hotter";
        /// Thermal time constant of the winding.
        0x2107:4 motor_thermal: f32 = 20.0, (0.1, 1000.0), "motor.thermal_s", "s", "assumed", disabled "the winding could get hotter";
        /// Motor current per converter code about mid-scale.
        0x2107:5 motor_amps_per_code: f32 = 0.00269, (0.0001, 0.1), "motor.amps_per_code", "A", "docs/wiring.md", disabled "the supervision relies on it";
        /// Bus voltage per converter code.
        0x2107:6 motor_bus_per_code: f32 = 0.0153, (0.001, 0.1), "motor.bus_volts_per_code", "V", "docs/wiring.md", disabled "the supervision relies on it";
        /// Lowest bus voltage to work with.
        0x2107:7 motor_bus_min: f32 = 36.0, (3.0, 60.0), "motor.bus_min_v", "V", "assumed: three quarters of 48 V", rises "a sagging bus would be detected later";

        /// Length of one encoder count.
        0x2108:1 encoder_count: f32 = 1.0, (0.05, 100.0), "encoder.count_um", "um", "[R] section 6.1; 0.5 and 5 exist", disabled "the loop would move in the wrong direction, or too far";
        /// The encoder counts down when moving toward the work.
        0x2108:2 encoder_reversed: bool = false, (), "encoder.reversed", "", "found by commissioning", disabled "the loop would move in the wrong direction, or too far";
        /// Distance between index marks; a wrong one means that the encoder lost counts.
        0x2108:3 encoder_marks: f32 = 10_000.0, (100.0, 1_000_000.0), "encoder.mark_distance_um", "um", "[L] section 3: a mark every 10 mm", disabled "the supervision relies on it";
        /// Counts by which the distance between marks may differ.
        0x2108:4 encoder_mark_tolerance: u32 = 2, (0, 1000), "encoder.mark_tolerance", "counts", "assumed", disabled "lost counts could stay unnoticed";
        /// Largest lasting difference between edge decoder and timer.
        0x2108:5 encoder_difference: u32 = 1, (0, 1000), "encoder.difference", "counts", "assumed: one lost edge pair, two counts, shows", disabled "lost counts could stay unnoticed";
        /// Illegal transitions in a second that are only counted.
        0x2108:6 encoder_illegal: u32 = 10, (0, 1_000_000), "encoder.illegal_per_s", "", "assumed", disabled "lost counts could stay unnoticed";

        /// Bandwidth of the velocity loop.
        0x2109:1 servo_velocity_hz: f32 = 200.0, (10.0, 500.0), "servo.velocity_hz", "Hz", "assumed: 64 degrees with L/R of 0.24 ms", live;
        /// Bandwidth of the position loop.
        0x2109:2 servo_position_hz: f32 = 60.0, (5.0, 200.0), "servo.position_hz", "Hz", "assumed: less than a third of the velocity loop's", live;
        /// Integral time of the velocity loop.
        0x2109:3 servo_integral_ms: f32 = 15.0, (1.0, 10_000.0), "servo.integral_ms", "ms", "assumed", live;

        /// Share of the breakaway force that the duty compensates, in addition to the loops; 0: none.
        0x2109:4 servo_friction: f32 = 80.0, (0.0, 100.0), "servo.friction_percent", "%", "assumed: sliding friction is less than breakaway force", live;
        /// Length over which the friction reverses.
        0x2109:5 servo_presliding: f32 = 0.7, (0.05, 100.0), "servo.presliding_um", "um", "assumed: 1 to 10 um of guides; the smallest voltage error of the scenario default", live;

        /// Largest following error.
        0x210A:1 following_limit: f32 = 200.0, (20.0, 100_000.0), "supervise.following_um", "um", "assumed", falls "a fault would be detected later";
        /// Longest duration of a following error or a runaway.
        0x210A:2 following_ms: u32 = 10, (1, 10_000), "supervise.following_ms", "ms", "assumed", falls "a fault would be detected later";
        /// Velocity against a saturated duty that means a wrong polarity.
        0x210A:3 runaway: f32 = 50.0, (1.0, 1000.0), "supervise.runaway_mm_s", "mm/s", "assumed", falls "a fault would be detected later";
        /// Difference between encoder velocity and back-EMF velocity above which the encoder is lost.
        0x210A:4 emf_velocity: f32 = 50.0, (1.0, 5000.0), "supervise.emf_mm_s", "mm/s", "assumed", falls "a fault would be detected later";
        /// Error of the winding resistance that the comparison with the back-EMF allows for.
        0x210A:5 emf_resistance: f32 = 20.0, (0.0, 100.0), "supervise.emf_resistance_percent", "%", "assumed: copper from 20 to 70 degrees C", falls "a fault would be detected later";
        /// Longest time for which the encoder may contradict the back-EMF.
        0x210A:6 encoder_ms: u32 = 10, (1, 1000), "supervise.encoder_ms", "ms", "assumed", falls "a fault would be detected later";
        /// Longest time for which the gap signal may be bad.
        0x210A:7 gap_bad_ms: u32 = 20, (1, 1000), "supervise.gap_ms", "ms", "assumed", falls "a fault would be detected later";
        /// Longest silence of the bus while the loop is closed; 0: not monitored. 1016h monitors one host by its heartbeats.
        0x210A:8 host_ms: u32 = 0, (0, 60_000), "supervise.host_ms", "ms", "CiA 301 7.2.8: guarding is off until a host requests it", falls_from_never "a silent host would be detected later, or never";

        /// Share of all pulses that are arcs above which arcs become persistent; 101 switches this off.
        0x210A:9 arc_share: u32 = 60, (1, 101), "supervise.arc_percent", "%", "assumed: above the 37 % of host/sim/tests/arcs.rs, where erosion continues", falls "persistent arcs would be detected later, or never";
        /// Longest time for which too many arcs may last; docs/gap-sensing.md has the rule.
        0x210A:10 arc_ms: u32 = 50, (0, 10_000), "supervise.arc_ms", "ms", "assumed", falls "a fault would be detected later";
        /// Radius of the electrode's face, as a disc: in a narrow gap the film of dielectric under a large one holds the head.
        0x210A:11 face: f32 = 1500.0, (0.0, 30_000.0), "supervise.face_um", "um", "assumed; of the electrode", falls "a dead encoder would be detected later";
        /// Longest time for which every pulse, 2000 at the least, may burn without one that waited longer than gap.arc_delay_us; 0: not supervised.
        0x210A:12 undelayed_ms: u32 = 300, (0, 10_000), "supervise.undelayed_ms", "ms", "assumed: a retreat takes less", falls_from_never "an arc would be detected later, or never, where its voltage is that of a spark";

        /// Longest lift of a head without a closed loop.
        0x210B:1 lift_ms: f32 = 300.0, (1.0, 300.0), "lift.ms", "ms", "docs/architecture.md", disabled "the lift of a fault is calculated from it";
        /// Force of a force-limited retract about the holding force.
        0x210B:2 lift_force: f32 = 3.0, (0.5, 15.0), "lift.limited_n", "N", "assumed", disabled "the lift of a fault is calculated from it";
        /// Bus voltage below which lifting on stored energy ends.
        0x210B:3 lift_bus_dead: f32 = 15.0, (1.0, 60.0), "lift.bus_dead_v", "V", "assumed", disabled "the lift of a fault is calculated from it";

        /// Gap voltage below which, with pulses off, the electrode touches the work; 0: no sense supply is fitted.
        0x210D:1 contact_below: f32 = 4.0, (0.0, 100.0), "contact.below_v", "V", "docs/wiring.md: an open gap reads 9.2 V at least, 100 ohm 0.9 V", disabled "contact would not be detected";
        /// Largest velocity toward the work, pulses off, where the axis has not been since it was enabled.
        0x210D:2 contact_approach: f32 = 5.0, (0.1, 5.0), "contact.approach_mm_s", "mm/s", "docs/bring-up.md: largest contact force", falls "the electrode would hit the work harder";
        /// Largest force toward the work, beyond weight and friction, while a feed law moves the head: more than film and flushing push back with.
        0x210D:3 contact_press: f32 = 5.0, (0.5, 20.0), "contact.press_n", "N", "docs/bring-up.md: largest contact force", falls "the electrode would press harder";

        /// Time of erosion from one jump to the next; 0 jumps on demand only.
        0x210E:1 jump_every_ms: f32 = 0.0, (0.0, 1e6), "jump.every_ms", "ms", "assumed: on demand only", live;
        /// Height of a jump, straight up.
        0x210E:2 jump_height: f32 = 1000.0, (10.0, 1_000_000.0), "jump.height_um", "um", "assumed", live;
        /// Largest velocity of a jump; never more than 300 000 counts/s, for which the edge decoder is rated.
        0x210E:3 jump_velocity: f32 = 50.0, (1.0, 2000.0), "jump.velocity_mm_s", "mm/s", "assumed", live;
        /// Largest acceleration of a jump.
        0x210E:4 jump_acceleration: f32 = 10.0, (0.1, 500.0), "jump.acceleration_m_s2", "m/s^2", "assumed: a fifth of what the actuator of [R] can do", live;
        /// Largest jerk of a jump.
        0x210E:5 jump_jerk: f32 = 2000.0, (10.0, 1e6), "jump.jerk_m_s3", "m/s^3", "assumed: 5 ms to the acceleration", live;
        /// Float point: length of path above the last eroding position down to which a jump or a long retreat returns at speed.
        0x210E:6 jump_float: f32 = 100.0, (1.0, 10_000.0), "jump.float_um", "um", "assumed: more than a working gap of [R]", rises "the head would come closer to the work at speed";
        /// Share of all pulses that are arcs above which the head jumps; three jumps without effect are a persistent arc; 0: never.
        0x210E:7 jump_arcs: u32 = 0, (0, 100), "jump.arcs_percent", "%", "assumed: on demand only", live;
        /// Adaptive jumps: share of arcs and shorts among burned pulses at the end of an interval, to which the head adapts interval and height; 0: periodic.
        0x210E:8 jump_adaptive: f32 = 0.0, (0.0, 50.0), "jump.adaptive_percent", "%", "assumed: periodic", live;
        /// Shortest interval of adaptive jumps; the longest is jump.every_ms.
        0x210E:9 jump_least_ms: f32 = 200.0, (10.0, 1e6), "jump.least_ms", "ms", "assumed", live;
        /// Largest height of adaptive jumps; the least is jump.height_um.
        0x210E:10 jump_height_most: f32 = 1000.0, (10.0, 1_000_000.0), "jump.height_most_um", "um", "assumed: all are alike", live;

        /// Longest spark-out at the end of the path: the feed law stays on until the share of discharges is below end.discharge_percent; 0: none.
        0x210F:1 end_spark_out_ms: f32 = 0.0, (0.0, 600_000.0), "end.spark_out_ms", "ms", "assumed: only on request", live;
        /// Share of discharges below which they are rare: mean gap voltage below the open-circuit voltage, in percent of it.
        0x210F:2 end_discharge: f32 = 5.0, (0.1, 50.0), "end.discharge_percent", "%", "assumed: beyond scatter of the voltage, far below the 15 % at which a seek finds the work", live;
        /// Window of that mean.
        0x210F:3 end_window_ms: f32 = 200.0, (10.0, 10_000.0), "end.window_ms", "ms", "assumed: 200 pulses at 1 kHz", live;
        /// Length of path below the surface from which rare discharges mean a break-through; 0: never.
        0x210F:4 end_through: f32 = 0.0, (0.0, 1_000_000.0), "end.through_um", "um", "assumed: only on request", live;
        /// Length of path to go back after the end of an erosion, with pulses off, at retreat.velocity_um_s; 0: the head stays.
        0x210F:5 end_lift: f32 = 0.0, (0.0, 1_000_000.0), "end.lift_um", "um", "assumed: only on request", live;

        /// Velocity of the first touch in a surface search, and of every return from a touch.
        0x2110:1 touch_first: f32 = 5.0, (0.01, 5.0), "touch.first_mm_s", "mm/s", "as contact.approach_mm_s, which it may not exceed", live;
        /// Velocity of the second touch, which gives the position of the surface.
        0x2110:2 touch_second: f32 = 0.5, (0.01, 5.0), "touch.second_mm_s", "mm/s", "assumed: 0.1 um in the 0.2 ms until a contact is known", live;
        /// Length to go back after a touch: before the next touch, and at the end.
        0x2110:3 touch_back: f32 = 100.0, (20.0, 10_000.0), "touch.back_um", "um", "assumed: far more than overshoot and play", live;

        /// Distance that the coarse axis is asked to move by when the stroke ends before the path; 0: it is not asked, and no path leads
        /// beyond the travel.
        0x2111:1 inch_step: f32 = 0.0, (0.0, 1_000_000.0), "inch.step_um", "um", "[R] section 8; assumed: no coarse axis answers", disabled "the travel of a path depends on it";
        /// Length above the lower end of the travel at which the coarse axis is asked for.
        0x2111:2 inch_reserve: f32 = 300.0, (20.0, 10_000.0), "inch.reserve_um", "um", "assumed: more than a gap and the overshoot of a touch", rises "a smaller one would lead the head closer to its lower stop";
        /// Length by which the head goes up beyond the step: so much the coarse axis may go too far.
        0x2111:3 inch_clearance: f32 = 500.0, (20.0, 10_000.0), "inch.clearance_um", "um", "assumed: many times the error of a machine axis", rises "a smaller one would leave the electrode closer to the bottom while the coarse axis moves";
        /// Largest difference between the move that was asked for and the one that the host or a touch of the bottom says.
        0x2111:4 inch_tolerance: f32 = 50.0, (1.0, 10_000.0), "inch.tolerance_um", "um", "assumed: more than the error of a machine axis", falls "a larger one would believe a wrong move";
        /// Time for the coarse axis to move.
        0x2111:5 inch_patience: f32 = 60.0, (0.1, 3600.0), "inch.patience_s", "s", "assumed: a person can look", live;
        /// What shows how far it has moved: the host's word, or a touch of the bottom before and after it.
        0x2111:6 inch_seen: SeenBy = SeenBy::Word, (), "inch.seen", "", "[R] section 8", disabled "the bottom must have been touched before the move";

        /// Counts by which step.steps steps of a host move the axis in mode -1.
        0x2112:1 step_counts: u32 = 1, (1, 1_000_000), "step.counts", "counts", "assumed: a step is a count", disabled "the place of the axis depends on it";
        /// Steps of a host that move the axis by step.counts.
        0x2112:2 step_steps: u32 = 1, (1, 1_000_000), "step.steps", "", "assumed: a step is a count", disabled "the place of the axis depends on it";
        /// The direction input leads away from the work while a current flows in it.
        0x2112:3 step_reversed: bool = false, (), "step.reversed", "", "docs/wiring.md: a current is toward the work", disabled "the direction of motion depends on it";
        /// A step begins where the current in the step input ends.
        0x2112:4 step_inverted: bool = false, (), "step.inverted", "", "docs/wiring.md: a step begins with the current", disabled "a step is counted where it begins";
        /// Time constant with which the set point follows the steps; at least that of a plan, 0.25 ms.
        0x2112:5 step_smooth_ms: f32 = 2.0, (0.0, 100.0), "step.smooth_ms", "ms", "assumed: a step a plan makes no step of the velocity", disabled "the place of the axis depends on it";

        /// Escape: a retreat from a short leads along this vector instead of back along the path, and no farther; here upward. With escape.x_um
        /// and escape.y_um 0 as well: along the path.
        0x2113:1 escape_up: f32 = 0.0, (0.0, 100_000.0), "escape.up_um", "um", "assumed: back along the path", live;
        /// The same along X: a set point for the drive of that axis.
        0x2113:2 escape_x: f32 = 0.0, (-100_000.0, 100_000.0), "escape.x_um", "um", "assumed: back along the path", live;
        /// The same along Y.
        0x2113:3 escape_y: f32 = 0.0, (-100_000.0, 100_000.0), "escape.y_um", "um", "assumed: back along the path", live;

        /// What the head makes of a depth that is given as a set point while it erodes, so that the cavity is wider than the electrode: circles or
        /// squares in which it sinks, or circles over half a sphere; X and Y are set points for their drives. From the next set point on.
        0x2116:1 orbit_shape: OrbitShape = OrbitShape::None, (), "orbit.shape", "", "assumed: straight down", live;
        /// Radius of the orbit: the undersize of the electrode on each side.
        0x2116:2 orbit_radius: f32 = 20.0, (10.0, 500_000.0), "orbit.radius_um", "um", "assumed", live;
        /// How far it sinks in a turn; on a sphere, length of its surface from one ring to the next.
        0x2116:3 orbit_pitch: f32 = 10.0, (1.0, 100_000.0), "orbit.pitch_um", "um", "assumed", live;

        /// Largest distance by which a touch may be above the kept place of a hole that is to be gone on with.
        0x2115:1 resume_agree: f32 = 10.0, (0.1, 100.0), "resume.agree_um", "um", "assumed: more than the roughness of both surfaces; a touch finds their peaks", live;
        /// Largest distance of the bottom, as touched, beyond the deepest place of the electrode.
        0x2115:2 resume_gap: f32 = 100.0, (1.0, 1000.0), "resume.gap_um", "um", "largest gap of docs/glossary.md: 5 to 100 um", live;
        /// Largest wear by which the surface, or the reference, may be touched deeper than before.
        0x2115:3 resume_wear: f32 = 50.0, (0.1, 10_000.0), "resume.wear_um", "um", "assumed: more would be another electrode", live;

        /// Longest wait, pulses off, at the beginning of each row of a technology table for the word that the generator is set for it (201Ch:19);
        /// 0: the head does not wait.
        0x2119:1 technology_answer: f32 = 0.0, (0.0, 3600.0), "technology.answer_s", "s", "assumed: nobody answers", live;

        /// Length above the head that an identification moves in.
        0x2114:1 identify_travel: f32 = 2000.0, (200.0, 50_000.0), "identify.travel_um", "um", "assumed: half of it is way enough for its fastest stroke", live;
        /// Current of the steps that an identification puts on the winding; its strokes accelerate with as much at the most.
        0x2114:2 identify_current: f32 = 0.3, (0.02, 10.0), "identify.current_a", "A", "assumed: a hundred codes of docs/wiring.md", live;
        /// Velocity of its fastest stroke.
        0x2114:3 identify_velocity: f32 = 50.0, (2.0, 200.0), "identify.velocity_mm_s", "mm/s", "assumed: its back-EMF is a hundred times what a conversion of the current is worth", live;

        /// Length above the head that a tuning moves in.
        0x2118:1 tune_travel: f32 = 3000.0, (500.0, 50_000.0), "tune.travel_um", "um", "assumed: a window and what comes before it at tune.velocity_mm_s", live;
        /// Current that the largest sine of a tuning drives at rest.
        0x2118:2 tune_current: f32 = 0.5, (0.02, 10.0), "tune.current_a", "A", "assumed: at 1 kHz it moves 0.2 kg by a quarter of a count of 1 um", live;
        /// Velocity of its strokes at the most; low frequencies take slower ones. The loop is measured as it is at that velocity: slower, the velocity
        /// of the encoder comes later.
        0x2118:3 tune_velocity: f32 = 25.0, (1.0, 200.0), "tune.velocity_mm_s", "mm/s", "assumed: an edge of 1 um in every tick", live;
        /// Lowest frequency.
        0x2118:4 tune_lowest: f32 = 10.0, (2.0, 200.0), "tune.lowest_hz", "Hz", "assumed: a sixth of servo.position_hz", live;
        /// Highest frequency.
        0x2118:5 tune_highest: f32 = 1000.0, (20.0, 1200.0), "tune.highest_hz", "Hz", "assumed: the loop has lost 180 degrees below", live;
        /// Frequencies, in equal ratios.
        0x2118:6 tune_points: u32 = 25, (3, 32), "tune.points", "", "assumed: twelve a decade", live;

        /// Commissioning has passed with these settings.
        0x210C:1 commissioned: bool = false, (), "commission.passed", "", "set by commissioning", disabled "it decides whether the head may be enabled";
        /// Largest duty of commissioning.
        0x210C:2 commission_duty: f32 = 0.1, (0.001, 0.5), "commission.duty_limit", "", "assumed", disabled "commissioning uses it";
        /// Velocity of the stroke measurement.
        0x210C:3 commission_velocity: f32 = 5.0, (0.1, 50.0), "commission.velocity_mm_s", "mm/s", "assumed", disabled "commissioning uses it";
        /// Share of the stroke by which the measured one may differ.
        0x210C:4 commission_tolerance: f32 = 10.0, (0.1, 50.0), "commission.stroke_tolerance_percent", "%", "assumed", disabled "commissioning uses it";
    }
}
