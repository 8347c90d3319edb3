//! Settings -> what the ticks run, or the setting that stands in the way.

use super::{Declared, SetpointUnit, SettingError, Settings, Value, place};
use crate::dsp::chain;
use crate::encoder::{MarkSpacing, PlausibilityLimits};
use crate::feed::Limits;
use crate::gap::charging::Material;
use crate::gap::controlled::ControlledName;
use crate::gap::pulses::BoundaryConfig;
use crate::gap::{Sight, pulses, senses, voltage};
use crate::head::{
    Axis, Breakaway, CommissioningConfig, Config, Contact, EndsConfig, Escape, IdentifyConfig, InchConfig, JumpConfig,
    JumpRhythm, Lift, OrbitConfig, OrbitShape, Report, RestraintConfig, Retreat, Seek, SeenBy, Setpoint, StepConfig,
    Structure, SupervisionLimits, TouchConfig, TuneConfig,
};
use crate::motion::JerkLimits;
use crate::servo::{CurrentLimits, GRAVITY, Gains, PidGains, Plant, PreslidingConfig, Tuning};
use crate::units::{
    ADC_FULL_SCALE, Amps, CLOCK_HZ, CountsPerSecond, CountsPerSecond2, Fixed, Hertz, Micrometres, MicrometresPerSecond,
    MicrometresPerSecond2, Nanometres, Newtons, PLAN_TICKS, Seconds, TICK_S, Volts,
};
use edm_hal_shim::steps::Polarity;
use edm_hal_shim::timing::adc::Scale;
use edm_hal_shim::{pause, reflex};

/// What the ticks run.
#[derive(Clone, Debug, PartialEq)]
pub struct Active {
    /// For the gap source.
    pub gap: voltage::Active,
    /// For the reflex.
    pub reflex: reflex::Config,
    /// Off-time requested of the generator, ns; `None` leaves its own.
    pub off_time_ns: Option<u32>,
    /// For the pauses between pulses.
    pub pause: pause::Config,
    /// For the servo tick.
    pub head: Config,
}

/// Longest that a jump may take each way, s: [`crate::motion::LONGEST`] with a tenth to spare.
const JUMP_S: f32 = 0.7;
/// Rate of counts for which the edge decoder is rated, 1/s: docs/architecture.md.
const ENCODER_RATE: f32 = 300_000.0;

/// Velocity, mm/s, and counts from which on an identification takes a head for moving: presliding is slower, and friction hardly less
/// there than at rest (assumed).
const BEGUN: (f32, i64) = (1.0, 3);
/// Times its breakaway, as set, by which the force of a push grows in a second, and the share of the current's duty that it does at
/// least.
const GROWS: (f32, f32) = (1.5, 0.05);

/// Share of tune.current_a with which its strokes turn round, of tune.travel_um that this may take, and of supervise.following_um by which the
/// head may swing.
const RAMP: f32 = 0.5;
const TURNS: f32 = 0.2;
const SWING: f32 = 0.15;

/// Most friction that is believed, N: the end of the range of axis.breakaway_n.
const BREAKAWAY_MOST: f32 = 20.0;

/// Servo ticks in so many milliseconds, at least one.
pub(super) fn ticks(ms: f32) -> u32 {
    Seconds(ms * 1e-3).ticks().max(1)
}

/// The number from 1 to `of` that `times` of make it, by halving: less than a power of a library takes.
#[inline(never)]
fn root(of: f32, times: u32) -> f32 {
    let halved = |(low, high): (f32, f32), _| {
        let middle = 0.5 * (low + high);
        if (0..times).fold(1.0, |product, _| product * middle) > of { (low, middle) } else { (middle, high) }
    };
    (0..32).fold((1.0, of), halved).0
}

fn um(length: f32) -> Fixed {
    Fixed::whole(length as i64)
}

/// A key, in a constant: there one that no setting has does not compile.
const fn name(key: &'static str) -> &'static str {
    place(Settings::KEYS, key);
    key
}

fn conflict(condition: bool, field: &'static str, rule: &'static str) -> Result<(), SettingError> {
    if condition { Err(SettingError::Conflict { field, rule }) } else { Ok(()) }
}

impl Settings {
    /// The defaults, but for those of a board: keys with other values.
    pub fn with(others: &[(&str, f32)]) -> Result<Settings, SettingError> {
        let mut settings = Settings::default();
        for (key, value) in others {
            settings.set(key, Value::Number((*value).into()))?;
        }
        Ok(settings)
    }

    /// Checks every setting, alone and against the others, and computes what the ticks run.
    pub fn build(&self) -> Result<Active, SettingError> {
        self.check()?;
        conflict(
            self.gap_setpoint_unit == SetpointUnit::Volts && self.gap_setpoint >= self.gap_open_min,
            const { name("gap.setpoint_v") },
            "must be below gap.open_min_v, or the head would only ever feed",
        )?;
        conflict(
            self.law.needs_pulses() && self.gap_average == voltage::Average::Plain,
            const { name("feed.law") },
            "counts pulses, which gap.average = plain does not show: set gap.average to gated, or another law",
        )?;
        conflict(self.gap_short >= self.gap_open_min, const { name("gap.short_v") }, "must be below gap.open_min_v")?;
        conflict(
            self.motor_continuous > self.motor_peak,
            const { name("motor.continuous_a") },
            "must not be above motor.peak_a",
        )?;
        conflict(
            self.servo_position_hz * 2.0 > self.servo_velocity_hz,
            const { name("servo.position_hz") },
            "must be at most half of servo.velocity_hz, or the cascade rings",
        )?;
        conflict(self.motor_bus_min >= self.axis_bus, const { name("motor.bus_min_v") }, "must be below axis.bus_v")?;
        conflict(
            self.lift_bus_dead >= self.motor_bus_min,
            const { name("lift.bus_dead_v") },
            "must be below motor.bus_min_v",
        )?;
        conflict(
            self.generator_off_time_us > 0.0 && self.generator_off_time_us < 16.0,
            const { name("generator.off_time_us") },
            "must be 0 or at least 16: a smaller request means the generator's own off-time (docs/wiring.md)",
        )?;
        conflict(
            self.touch_second > self.touch_first,
            const { name("touch.second_mm_s") },
            "must not be above touch.first_mm_s",
        )?;
        conflict(
            self.structure == Structure::SingleLoop && self.controlled != ControlledName::GapVoltage,
            const { name("gap.controlled") },
            "must be voltage with feed.structure = single_loop, which runs on every block of conversions",
        )?;
        let nm_per_count = (self.encoder_count * 1000.0 + 0.5) as i64;
        let counts_per_um = 1000.0 / nm_per_count as f32;
        let axis = self.axis(nm_per_count, counts_per_um);
        let can_lift = self.axis_duty_limit > axis.plant.duty(axis.plant.weight()) * 1.2;
        conflict(
            !can_lift,
            const { name("axis.duty_limit") },
            "must be able to lift axis.mass_kg with a fifth to spare",
        )?;
        let highest =
            if self.jump_adaptive > 0.0 { self.jump_height.max(self.jump_height_most) } else { self.jump_height };
        let jump_s = [
            highest * counts_per_um / self.jump_velocity(counts_per_um).0,
            self.jump_velocity * 1e-3 / self.jump_acceleration,
            self.jump_acceleration / self.jump_jerk,
        ];
        conflict(
            self.jump_adaptive > 0.0 && self.jump_every_ms == 0.0,
            const { name("jump.adaptive_percent") },
            "needs jump.every_ms, the longest interval",
        )?;
        conflict(
            self.jump_adaptive > 0.0 && self.gap_average == voltage::Average::Plain,
            const { name("jump.adaptive_percent") },
            "counts pulses, which gap.average = plain does not show",
        )?;
        conflict(
            jump_s.iter().sum::<f32>() > JUMP_S,
            const { name("jump.height_um") },
            "takes longer than 0.7 s each way with jump.velocity_mm_s, jump.acceleration_m_s2 and jump.jerk_m_s3",
        )?;
        conflict(
            self.structure != Structure::Path && [self.escape_up, self.escape_x, self.escape_y] != [0.0; 3],
            const { name("escape.up_um") },
            "and escape.x_um, escape.y_um need feed.structure = path, or must be 0",
        )?;
        conflict(
            self.structure != Structure::Path && self.orbit_shape != OrbitShape::None,
            const { name("orbit.shape") },
            "must be none without feed.structure = path",
        )?;
        let taken = self.inch_step + self.inch_reserve + self.inch_clearance + self.retreat_off_limit;
        conflict(
            self.inch_step > 0.0 && taken > self.axis_stroke,
            const { name("inch.step_um") },
            "leaves, with inch.reserve_um, inch.clearance_um and retreat.off_limit_um, nothing of axis.stroke_um",
        )?;
        conflict(
            self.inch_step > 0.0 && self.inch_tolerance >= self.inch_clearance,
            const { name("inch.tolerance_um") },
            "must be below inch.clearance_um",
        )?;
        conflict(
            self.inch_step > 0.0 && self.inch_seen == SeenBy::Touch && self.contact_below == 0.0,
            const { name("inch.seen") },
            "must be word without a sense supply: contact.below_v is 0",
        )?;
        conflict(
            self.identify_current > self.motor_peak,
            const { name("identify.current_a") },
            "must not be above motor.peak_a",
        )?;
        conflict(
            self.tune_current > self.motor_peak,
            const { name("tune.current_a") },
            "must not be above motor.peak_a",
        )?;
        conflict(
            self.tune_lowest * 2.0 > self.tune_highest,
            const { name("tune.lowest_hz") },
            "must be at most half of tune.highest_hz",
        )?;
        let off_time_ns = (self.generator_off_time_us * 1000.0) as u32;
        let (gap, reflex, pause) = (self.gap()?, self.reflex()?, self.pause()?);
        let mut head = self.head(axis, self.senses()?);
        head.supervise.sight = self.sight(&reflex);
        Ok(Active { gap, reflex, off_time_ns: (off_time_ns > 0).then_some(off_time_ns), pause, head })
    }

    /// The same with what the guided check has measured instead of what was set: friction, and the counterbalance that
    /// leaves the net weight.
    pub fn learnt(&self, report: &Report) -> Settings {
        let counterbalance = self.axis_mass * GRAVITY - report.net_weight.value;
        Settings {
            axis_breakaway: report.friction.value.min(BREAKAWAY_MOST),
            axis_counterbalance: counterbalance.max(0.0),
            ..*self
        }
    }

    /// Thresholds of the reflex in converter codes and clock ticks.
    fn reflex(&self) -> Result<reflex::Config, SettingError> {
        // A converter spans 4096 codes; 1000 mV to the volt, mA to the ampere.
        let scale = |zero: u32, per_code: f32| Scale { zero: zero as u16, span_mv: (per_code * 4_096_000.0) as u32 };
        let volts = scale(self.gap_zero_code, self.gap_volts_per_code);
        let short = (self.gap_short * 1000.0) as i32;
        let voltage = if self.gap_reversed {
            volts.high(-short).map(|high| (0, high))
        } else {
            volts.low(short).map(|low| (low, ADC_FULL_SCALE))
        };
        let amps = scale(self.gap_current_zero_code, self.gap_amps_per_code);
        let refused = |field| SettingError::Conflict { field, rule: "lies outside the range of the converter" };
        Ok(reflex::Config {
            run: self.retreat_after_shorts,
            ticks: (self.retreat_after_ms * (CLOCK_HZ / 1000) as f32) as u32,
            current: amps
                .code((self.gap_short_amps * 1000.0) as i32)
                .map_err(|_| refused(const { name("gap.short_a") }))?,
            voltage: voltage.map_err(|_| refused(const { name("gap.short_v") }))?,
            tau_ns: (self.gap_charging_us * 1000.0) as u32,
            motor_reversed: self.motor_reversed,
        })
    }

    /// Thresholds of the reflex, converter codes: not ignited is what lies above the middle of open circuit and spark.
    fn sight(&self, reflex: &reflex::Config) -> Sight {
        let BoundaryConfig { open, spark, .. } = self.boundaries();
        let codes = (0.5 * (open.0 + spark.0) / self.gap_volts_per_code) as u32;
        let most = u32::from(ADC_FULL_SCALE);
        let open = if self.gap_reversed {
            [0, self.gap_zero_code.saturating_sub(codes) as u16]
        } else {
            [self.gap_zero_code.saturating_add(codes).min(most) as u16, ADC_FULL_SCALE]
        };
        let (lowest, highest) = reflex.voltage;
        Sight { current: reflex.current, voltage: [lowest, highest], open }
    }

    /// Pauses in clock cycles, and what tells pulses apart at their end: the levels of [`Settings::boundaries`].
    fn pause(&self) -> Result<pause::Config, SettingError> {
        const CYCLES_PER_US: f32 = (CLOCK_HZ / 1_000_000) as f32;
        let pauses = [
            (self.generator_pause_open_us, const { name("generator.pause_open_us") }),
            (self.generator_pause_spark_us, const { name("generator.pause_spark_us") }),
            (self.generator_pause_arc_us, const { name("generator.pause_arc_us") }),
            (self.generator_pause_short_us, const { name("generator.pause_short_us") }),
        ];
        for (us, key) in pauses {
            conflict(
                us > 0.0 && self.gap_average == voltage::Average::Plain,
                key,
                "must be 0 with gap.average = plain: without the generator's gate nothing shows the end of a pulse",
            )?;
        }
        let levels = self.boundaries();
        let ignited = 0.5 * (levels.spark.0 + levels.open.0);
        let code = |volts: f32| {
            let above = libm::roundf(volts / levels.volts_per_code);
            let code = f32::from(levels.zero) + if levels.reversed { -above } else { above };
            code.clamp(0.0, f32::from(ADC_FULL_SCALE)) as u16
        };
        Ok(pause::Config {
            hold: pauses
                .map(|(us, _)| if us > 0.0 { ((self.generator_off_time_us + us) * CYCLES_PER_US) as u32 } else { 0 }),
            levels: [levels.short_below.0, levels.arc_below.0, ignited].map(code),
            reversed: levels.reversed,
            blanking: (levels.blanking.0 * CLOCK_HZ as f32) as u32,
            asked: self.law.asks_off_time(),
        })
    }

    /// Low-pass and notch of the gap voltage.
    pub fn gap_filter(&self) -> chain::Config {
        chain::Config {
            corner: Hertz(self.gap_corner),
            mains: Hertz(self.gap_mains),
            notch_q: self.gap_notch_q,
            second_harmonic: self.gap_second_harmonic,
            follow: self.gap_follow_mains,
        }
    }

    fn gap(&self) -> Result<voltage::Active, SettingError> {
        let polarity = if self.gap_reversed { voltage::Polarity::Negative } else { voltage::Polarity::Positive };
        let config = voltage::Config {
            average: self.gap_average,
            zero_code: self.gap_zero_code as u16,
            volts_per_code: self.gap_volts_per_code,
            polarity,
            filter: self.gap_filter(),
            short: Volts(self.gap_short),
            contact: Volts(self.contact_below),
            shorts: self.retreat_after_shorts,
            worth: Seconds(self.retreat_after_ms * 1e-3),
            charging: Seconds(self.gap_charging_us * 1e-6),
            hold_limit: Seconds(self.gap_hold_ms * 1e-3),
            transfer: Seconds(self.transfer_ms * 1e-3),
            pulses: self.boundaries(),
            ..voltage::Config::default()
        };
        let rule = "with the other gap settings it leaves the converter's range";
        config.build().map_err(|_| SettingError::Conflict { field: const { name("gap.zero_code") }, rule })
    }

    fn axis(&self, nm_per_count: i64, counts_per_um: f32) -> Axis {
        let plant = Plant {
            mass_kg: self.axis_mass,
            resistance_ohm: self.axis_resistance,
            inductance_h: self.axis_inductance * 1e-3,
            force_constant: self.axis_force_constant,
            bus: Volts(self.axis_bus),
            counterbalance: Newtons(self.axis_counterbalance),
            counts_per_m: counts_per_um * 1e6,
        };
        // Twice the fastest motion, and never so little that a disturbance outruns the correction: 0.1 m/s.
        let fastest = self.retreat_velocity.max(self.seek_velocity).max(self.feed_retreat_max);
        let fastest = fastest.max(self.jump_velocity(counts_per_um).0 / counts_per_um);
        let fastest = (fastest * 2.0).max(100_000.0);
        let tuning = Tuning {
            velocity_hz: self.servo_velocity_hz,
            position_hz: self.servo_position_hz,
            integral_time_s: self.servo_integral_ms * 1e-3,
            velocity: CountsPerSecond(fastest * counts_per_um),
        };
        Axis {
            plant,
            gains: Gains::build(&plant, &tuning),
            counts_per_um,
            nm_per_count,
            marks: MarkSpacing {
                counts: (self.encoder_marks * counts_per_um) as u32,
                tolerance: self.encoder_mark_tolerance,
            },
            plausibility: PlausibilityLimits {
                difference: self.encoder_difference,
                illegal: self.encoder_illegal,
                ..PlausibilityLimits::default()
            },
            encoder_reversed: self.encoder_reversed,
            motor_reversed: self.motor_reversed,
            duty_limit: self.axis_duty_limit,
            current: CurrentLimits {
                peak: Amps(self.motor_peak),
                continuous: Amps(self.motor_continuous),
                thermal: Seconds(self.motor_thermal),
            },
            travel: (Nanometres(0), Nanometres((self.axis_stroke * 1000.0) as i64)),
            off_limit: (self.retreat_off_limit * counts_per_um) as i64,
            escape: Micrometres(self.axis_stroke),
            amps_per_code: Amps(self.motor_amps_per_code),
            bus_per_code: Volts(self.motor_bus_per_code),
        }
    }

    /// What is made of a depth.
    fn orbit(&self) -> Option<OrbitConfig> {
        let nm = |um: f32| (um * 1e3) as i64;
        let (radius, pitch) = (nm(self.orbit_radius), nm(self.orbit_pitch));
        (self.orbit_shape != OrbitShape::None).then_some(OrbitConfig { shape: self.orbit_shape, radius, pitch })
    }

    /// Where a retreat from a short leads off the path, if it does.
    fn escape(&self, counts_per_um: f32) -> Option<Escape> {
        let by = [-self.escape_up, self.escape_x, self.escape_y];
        let length = libm::sqrtf(by.iter().map(|um| um * um).sum());
        let down = self.escape_up / length * counts_per_um;
        (length > 0.0).then_some(Escape { by: by.map(|um| (um * 1e3) as i32), down })
    }

    /// Largest velocity of a jump.
    fn jump_velocity(&self, counts_per_um: f32) -> CountsPerSecond {
        CountsPerSecond((self.jump_velocity * 1e3 * counts_per_um).min(ENCODER_RATE))
    }

    /// What the estimators of hazard, distance and spark frequency run on.
    fn senses(&self) -> Result<senses::Config, SettingError> {
        let coefficients = [self.charging_c3, self.charging_c2, self.charging_c1, self.charging_c0];
        let rule = "must not be above gap.charging_longest_us";
        let material = Material::new(coefficients, self.charging_shortest, self.charging_longest)
            .map_err(|_| SettingError::Conflict { field: const { name("gap.charging_shortest_us") }, rule })?;
        let rule = "is out of its range";
        senses::Config::new(self.sense_memory, material)
            .map_err(|_| SettingError::Conflict { field: const { name("gap.memory_ms") }, rule })
    }

    /// What tells pulses apart. Where shorts reach as far as arcs there are no arcs, and so on up.
    pub fn boundaries(&self) -> pulses::BoundaryConfig {
        let arc_below = self.gap_arc.max(self.gap_short);
        let spark = self.gap_spark.max(arc_below);
        pulses::BoundaryConfig {
            open: Volts(self.gap_open.max(spark)),
            spark: Volts(spark),
            arc_below: Volts(arc_below),
            short_below: Volts(self.gap_short),
            noise: Volts(self.gap_noise),
            volts_per_code: self.gap_volts_per_code,
            zero: self.gap_zero_code as u16,
            reversed: self.gap_reversed,
            // The gap has 86 % of its voltage then.
            blanking: Seconds(2e-6 * self.gap_charging_us),
            arc_delay: Seconds(1e-6 * self.gap_arc_delay_us),
        }
    }

    fn head(&self, axis: Axis, senses: senses::Config) -> Config {
        let plant = &axis.plant;
        let holding = axis.gains.holding();
        let weight = plant.duty(plant.weight());
        let limited = plant.duty(Newtons(self.lift_force));
        Config {
            setpoint: match self.gap_setpoint_unit {
                SetpointUnit::Volts => Setpoint::Volts(Volts(self.gap_setpoint)),
                SetpointUnit::PercentOfOpen => Setpoint::ShareOfOpen(self.gap_setpoint_percent * 0.01),
            },
            controlled: self.controlled.build(self),
            transfer: (PLAN_TICKS as f32 * TICK_S * 1e3 / self.transfer_ms).min(1.0),
            structure: self.structure,
            law: self.law.build(self),
            single: PidGains {
                p: self.single_p,
                i: self.single_i * TICK_S,
                d: self.single_d,
                integral_error: self.single_clip,
                integral: self.axis_duty_limit,
            },
            limits: Limits {
                feed: MicrometresPerSecond(self.feed_max),
                retreat: MicrometresPerSecond(self.feed_retreat_max),
            },
            acceleration: MicrometresPerSecond2(self.acceleration * 1e6),
            seek: Seek {
                velocity: MicrometresPerSecond(self.seek_velocity),
                threshold: self.seek_threshold * 0.01,
                settle: Seconds(self.seek_settle_ms * 1e-3),
                open_min: Volts(self.gap_open_min),
            },
            retreat: Retreat {
                trigger: ticks(self.retreat_after_ms),
                velocity: MicrometresPerSecond(self.retreat_velocity),
                clearance: (self.retreat_clearance * axis.counts_per_um) as i64,
                limit: um(self.retreat_limit),
                persistent: ticks(self.retreat_persistent_ms),
                safe: um(self.retreat_safe),
                off_limit: um(self.retreat_off_limit),
                escape: self.escape(axis.counts_per_um),
            },
            orbit: self.orbit(),
            jump: JumpConfig {
                every: Seconds(self.jump_every_ms * 1e-3).ticks(),
                height: (self.jump_height * axis.counts_per_um) as u32,
                adaptive: JumpRhythm {
                    share: self.jump_adaptive / 100.0,
                    interval: (ticks(self.jump_least_ms.min(self.jump_every_ms)), ticks(self.jump_every_ms)),
                    height: {
                        let counts = |um: f32| (um * axis.counts_per_um) as u32;
                        (counts(self.jump_height), counts(self.jump_height_most.max(self.jump_height)))
                    },
                },
                limits: JerkLimits {
                    velocity: self.jump_velocity(axis.counts_per_um),
                    acceleration: CountsPerSecond2(self.jump_acceleration * 1e6 * axis.counts_per_um),
                    jerk: self.jump_jerk * 1e6 * axis.counts_per_um,
                },
                float: self.jump_float as u32,
            },
            inch: InchConfig {
                step: (self.inch_step * axis.counts_per_um) as i64,
                reserve: (self.inch_reserve * axis.counts_per_um) as i64,
                clearance: (self.inch_clearance * axis.counts_per_um) as i64,
                tolerance: (self.inch_tolerance * axis.counts_per_um) as i64,
                patience: Seconds(self.inch_patience).ticks().max(1),
                seen: self.inch_seen,
            },
            step: StepConfig {
                polarity: Polarity { rises: self.step_inverted, reversed: self.step_reversed },
                counts: self.step_counts,
                steps: self.step_steps,
                smooth: ticks(self.step_smooth_ms).max(PLAN_TICKS),
            },
            ends: EndsConfig {
                spark_out: Seconds(self.end_spark_out_ms * 1e-3).ticks(),
                rare: self.end_discharge * 0.01,
                look: Seconds(self.end_window_ms * 1e-3).ticks(),
                // Less than a micrometre is one, and not none.
                through: libm::ceilf(self.end_through) as u32,
                lift: libm::ceilf(self.end_lift) as u32,
            },
            lift: Lift {
                duty: (holding - (0.2 * weight + plant.duty(Newtons(self.axis_breakaway))).min(limited)).min(0.0),
                hold: (holding - 0.1 * weight).min(0.0),
                ticks: ticks(self.lift_ms),
                limited,
                bus_dead: Volts(self.lift_bus_dead),
            },
            presliding: PreslidingConfig {
                duty: plant.duty(Newtons(self.axis_breakaway)) * self.servo_friction * 0.01,
                per_count: 1.0 / (self.servo_presliding * axis.counts_per_um),
            },
            contact: Contact {
                sensed: self.contact_below > 0.0,
                approach: CountsPerSecond(self.contact_approach * 1000.0 * axis.counts_per_um),
                press: holding + plant.duty(Newtons(self.contact_press + self.axis_breakaway)),
            },
            touch: TouchConfig {
                first: CountsPerSecond(self.touch_first * 1000.0 * axis.counts_per_um),
                second: CountsPerSecond(self.touch_second * 1000.0 * axis.counts_per_um),
                back: (self.touch_back * axis.counts_per_um) as u32,
            },
            restraint: RestraintConfig::of(plant, Newtons(self.axis_breakaway), Newtons(self.contact_press), self.face),
            supervise: SupervisionLimits {
                following: self.following_limit * axis.counts_per_um,
                following_ms: self.following_ms,
                breakaway: Breakaway::of(
                    plant,
                    &axis.gains,
                    Newtons(self.axis_breakaway),
                    self.servo_friction * 0.01,
                    Micrometres(self.face),
                ),
                runaway: CountsPerSecond(self.runaway * 1000.0 * axis.counts_per_um),
                velocity: CountsPerSecond(self.emf_velocity * 1000.0 * axis.counts_per_um),
                resistance: self.emf_resistance * 0.01,
                encoder_ms: self.encoder_ms,
                gated: self.gap_average == voltage::Average::Gated,
                gap_ms: self.gap_bad_ms,
                host_ms: self.host_ms,
                bus_min: Volts(self.motor_bus_min),
                current_max: Amps(self.motor_peak * 1.25),
                current_ms: 2,
                arcs: pulses::Config {
                    share: self.arc_share,
                    ms: self.arc_ms,
                    jump: self.jump_arcs,
                    undelayed: self.undelayed_ms,
                },
                senses,
                sight: Sight::default(),
            },
            commissioning: CommissioningConfig {
                duty: self.commission_duty,
                motion: (50.0 * axis.counts_per_um) as i64,
                // A quarter of a shorter stroke, and no faster than half of what the edge decoder is rated for.
                push: ((self.axis_stroke.min(2000.0) * 0.25 * axis.counts_per_um) as i64, 0.5 * ENCODER_RATE),
                stroke: (self.axis_stroke * axis.counts_per_um) as i64,
                stroke_tolerance: (self.axis_stroke * axis.counts_per_um * self.commission_tolerance * 0.01) as i64,
                velocity: CountsPerSecond(self.commission_velocity * 1000.0 * axis.counts_per_um),
                open_min: Volts(self.gap_open_min),
                open: Volts(self.gap_open),
            },
            identify: self.identify(&axis),
            tune: self.tune(&axis),
            commissioned: self.commissioned,
            axis,
        }
    }

    /// How an identification moves.
    fn identify(&self, axis: &Axis) -> IdentifyConfig {
        let Axis { plant, counts_per_um, gains, .. } = axis;
        let velocity = self.identify_velocity * 1000.0 * counts_per_um;
        let newtons = plant.force_constant * self.identify_current;
        let duty = (self.identify_current * plant.resistance_ohm / plant.bus.0).min(0.5 * self.axis_duty_limit);
        let grows = (GROWS.0 * plant.duty(Newtons(self.axis_breakaway))).max(GROWS.1 * duty);
        IdentifyConfig {
            travel: (self.identify_travel * counts_per_um) as i64,
            duty,
            // The edge decoder is the limit where counts are short.
            velocity: CountsPerSecond(velocity.min(0.5 * ENCODER_RATE).min(gains.velocity_limit().0)),
            acceleration: CountsPerSecond2(newtons / plant.mass_kg * plant.counts_per_m),
            grows: (grows * PLAN_TICKS as f32 * TICK_S, 2.0 * duty),
            begun: (CountsPerSecond(BEGUN.0 * 1000.0 * counts_per_um), BEGUN.1),
        }
    }

    /// How a tuning moves.
    #[inline(never)]
    fn tune(&self, axis: &Axis) -> TuneConfig {
        let Axis { plant, counts_per_um, gains, .. } = axis;
        let travel = self.tune_travel * counts_per_um;
        let newtons = RAMP * plant.force_constant * self.tune_current;
        let acceleration = newtons / plant.mass_kg * plant.counts_per_m;
        // The edge decoder is the limit where counts are short.
        let most = (0.5 * ENCODER_RATE).min(gains.velocity_limit().0).min(libm::sqrtf(TURNS * travel * acceleration));
        TuneConfig {
            travel: travel as i64,
            duty: (self.tune_current * plant.resistance_ohm / plant.bus.0).min(0.5 * self.axis_duty_limit),
            swing: SWING * self.following_limit * counts_per_um,
            velocity: CountsPerSecond((self.tune_velocity * 1000.0 * counts_per_um).min(most)),
            acceleration: CountsPerSecond2(acceleration),
            lowest: self.tune_lowest,
            ratio: root(self.tune_highest / self.tune_lowest, self.tune_points.max(2) - 1),
            points: self.tune_points,
            mm: 1e-3 / counts_per_um,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use edm_hal_shim::board::{BLANKING_CLOCK, BLANKING_MOST, BOARDS};
    use edm_hal_shim::timing::blanking;

    fn built(change: impl FnOnce(&mut Settings)) -> Result<Active, SettingError> {
        let mut settings = Settings::default();
        change(&mut settings);
        settings.build()
    }

    #[test]
    fn the_defaults_of_every_board_can_be_set_and_fit_together() {
        for (_, board) in BOARDS {
            let settings = Settings::with(board.defaults).unwrap_or_else(|error| panic!("{}: {error}", board.name));
            settings.build().unwrap_or_else(|error| panic!("{}: {error}", board.name));
        }
        assert_eq!(Settings::with(&[("gap.volts_per_volt", 1.0)]), Err(SettingError::UnknownKey));
    }

    fn conflicts(result: Result<Active, SettingError>, key: &str) {
        assert!(matches!(result, Err(SettingError::Conflict { field, .. }) if field == key), "{result:?}");
    }

    #[test]
    fn the_reflex_by_hand() {
        let reflex = built(|_| {}).unwrap().reflex;
        // 20 V of 0.1 V above code 410; 1 A of 16.1 mA above mid-scale; 1 ms of 168 MHz.
        assert_eq!(
            reflex,
            reflex::Config {
                run: 5,
                ticks: 168_000,
                current: 2048 + 62,
                voltage: (610, 4095),
                tau_ns: 500,
                motor_reversed: false
            }
        );
    }

    #[test]
    fn with_swapped_gap_leads_a_short_is_above() {
        let swapped = |zero| move |s: &mut Settings| (s.gap_reversed, s.gap_zero_code) = (true, zero);
        assert_eq!(built(swapped(3686)).unwrap().reflex.voltage, (0, 3486));
        assert_eq!(built(swapped(200)).unwrap().reflex.voltage, (0, 0));
        conflicts(built(swapped(199)), "gap.short_v");
    }

    #[test]
    fn a_threshold_that_no_code_reaches_is_refused() {
        let zero = |zero| move |s: &mut Settings| s.gap_zero_code = zero;
        assert_eq!(built(zero(3894)).unwrap().reflex.voltage, (4094, 4095));
        assert_eq!(built(zero(3895)).unwrap().reflex.voltage, (4095, 4095));
        conflicts(built(zero(3896)), "gap.short_v");
        let amps = |amps| move |s: &mut Settings| s.gap_short_amps = amps;
        assert_eq!(built(amps(32.95)).unwrap().reflex.current, 4095);
        conflicts(built(amps(33.0)), "gap.short_a");
    }

    #[test]
    fn every_charging_time_that_may_be_set_fits_the_blanking_timer() {
        let tau_ns = built(|s| s.gap_charging_us = 200.0).unwrap().reflex.tau_ns;
        assert_eq!(blanking(tau_ns, BLANKING_CLOCK, BLANKING_MOST), Ok(3 * 200 * 84));
        assert!(built(|s| s.gap_charging_us = 200.1).is_err());
    }

    #[test]
    fn no_off_time_set_leaves_the_generators_own() {
        assert_eq!(built(|_| {}).unwrap().off_time_ns, None);
        assert_eq!(built(|s| s.generator_off_time_us = 16.0).unwrap().off_time_ns, Some(16_000));
        conflicts(built(|s| s.generator_off_time_us = 15.9), "generator.off_time_us");
    }
    #[test]
    fn a_pause_lasts_beyond_the_off_time_that_is_requested() {
        assert_eq!(built(|_| {}).unwrap().pause.hold, [0; 4]);
        let both = |s: &mut Settings| {
            (s.generator_off_time_us, s.generator_pause_arc_us, s.generator_pause_short_us) = (40.0, 30.0, 1000.0);
        };
        let pause = built(both).unwrap().pause;
        assert_eq!(pause.hold, [0, 0, 70 * 168, 1040 * 168]);
        // 20, 34 and 70 V of 0.1 V above code 410; twice 0.5 us of charging.
        assert_eq!((pause.levels, pause.reversed, pause.blanking), ([610, 750, 1110], false, 168));
        let longest = |s: &mut Settings| (s.generator_off_time_us, s.generator_pause_open_us) = (200.0, 1000.0);
        assert_eq!(built(longest).unwrap().pause.hold[0], pause::LONGEST);
        let swapped = |s: &mut Settings| (s.gap_reversed, s.gap_zero_code) = (true, 3686);
        assert_eq!(built(swapped).unwrap().pause.levels, [3486, 3346, 2986]);
    }

    #[test]
    fn a_pause_without_a_gate_is_refused_by_its_name() {
        let plain = |s: &mut Settings| s.gap_average = voltage::Average::Plain;
        assert!(built(plain).is_ok());
        conflicts(
            built(|s| {
                plain(s);
                s.generator_pause_spark_us = 1.0;
            }),
            "generator.pause_spark_us",
        );
    }
}
