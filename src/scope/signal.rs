//! What can be recorded: the one table of signals, with the name and the unit of each.

use crate::gap::GapReading;
use crate::gap::pulses::Class;
use crate::head::{Axis, Follower, TickInput};
use crate::units::FRACTION_BITS;

/// Binary places that a coordinate keeps in a word.
const PLACES: u32 = 8;

macro_rules! signals {
    ($($number:literal $signal:ident $name:literal $factor:literal $unit:literal $means:literal;)+) => {
        /// A signal; its number never changes.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        #[repr(u8)]
        pub enum Signal {
            $(#[doc = $means] $signal = $number,)+
        }

        impl Signal {
            /// Number of the last one.
            pub const LAST: u8 = { let mut last = 0; $(if $number > last { last = $number; })+ last };

            /// The signal of a number.
            pub const fn numbered(number: u8) -> Option<Signal> {
                match number {
                    $($number => Some(Signal::$signal),)+
                    _ => None,
                }
            }
        }

        /// Number, name, value of one step, its unit, and what it is: by rising number. The chip has no use for them.
        #[cfg(not(target_os = "none"))]
        pub const SIGNAL_TEXTS: &[(u8, &str, f64, &str, &str)] = &[$(($number, $name, $factor, $unit, $means),)+];
    };
}

signals! {
    1 Position "position" 1.0 "counts" "position from home, as 6063h";
    2 SetPoint "set_point" 0.00390625 "counts" "position demanded in this tick";
    3 Velocity "velocity" 1.0 "counts/s" "velocity of the axis";
    4 Following "following_error" 0.00390625 "counts" "set point less position";
    5 Duty "duty" 0.01 "%" "duty of the motor, positive toward the work";
    6 Current "current" 1.0 "mA" "motor current, positive toward the work";
    7 GapVoltage "gap_voltage" 0.01 "V" "gap voltage after the filters";
    8 GapBlock "gap_block" 0.01 "V" "gap voltage of the newest block of 50 us, before the filters";
    9 Path "path" 0.00390625 "um" "path coordinate";
    10 State "state" 1.0 "" "state, as 2000h:1";
    11 Feed "feed" 0.1 "um/s" "velocity along the path";
    12 Open "open_pulses" 1.0 "" "open pulses since power-on, modulo 2^32";
    13 Sparks "sparks" 1.0 "" "sparks, the same";
    14 Arcs "arcs" 1.0 "" "arcs, the same";
    15 Shorts "short_pulses" 1.0 "" "short pulses, the same";
    16 Uncertain "uncertain_pulses" 1.0 "" "pulses that could not be classified, the same";
    17 ShortTime "short_time" 0.05 "ms" "duration of the present short";
    18 Bus "bus_voltage" 0.01 "V" "voltage of the bus";
    19 Fault "fault" 1.0 "" "fault, as 2000h:2";
    20 Flags "flags" 1.0 "" "bits: 0 pulses are permitted, 1 the reflex has begun a retreat in this tick, 2 the duty is at its limit, 3 the loop is closed";
}

/// What makes units of converter codes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Scales {
    /// Milliamps of a code about mid-scale, positive toward the work.
    milliamps: f32,
    /// Hundredths of a volt of a code of the bus.
    bus: f32,
}

impl Scales {
    /// Those of an axis.
    pub fn of(axis: &Axis) -> Scales {
        let sign = if axis.motor_reversed { -1000.0 } else { 1000.0 };
        Scales { milliamps: sign * axis.amps_per_code.0, bus: 100.0 * axis.bus_per_code.0 }
    }
}

/// What a servo tick has seen and done.
#[derive(Clone, Copy)]
pub struct View<'a> {
    /// Position, set point, plan in force.
    pub follower: &'a Follower,
    /// What it saw.
    pub input: &'a TickInput,
    /// Newest gap reading.
    pub reading: &'a GapReading,
    /// Units of the converters.
    pub scales: &'a Scales,
}

impl Signal {
    /// Its value in a tick, in steps as its row says; what does not fit saturates, or wraps where it counts.
    #[inline]
    pub fn read(self, view: &View<'_>) -> i32 {
        let View { follower, input, reading, scales } = view;
        let (plan, places) = (follower.plan(), FRACTION_BITS - PLACES);
        let pulses = |class| reading.pulses.class(class).cast_signed();
        match self {
            Signal::Position => follower.position() as i32,
            Signal::SetPoint => (plan.setpoint.0 >> places) as i32,
            Signal::Velocity => follower.velocity().0 as i32,
            Signal::Following => (follower.following() * 256.0) as i32,
            Signal::Duty => (follower.duty() * 10_000.0) as i32,
            Signal::Current => (follower.current_code() as f32 * scales.milliamps) as i32,
            Signal::GapVoltage => (reading.filtered.0 * 100.0) as i32,
            Signal::GapBlock => (reading.block.0 * 100.0) as i32,
            Signal::Path => (plan.path.0 >> places) as i32,
            Signal::State => plan.state as i32,
            Signal::Feed => (plan.trajectory.along.0 * 10.0) as i32,
            Signal::Open => pulses(Class::Open),
            Signal::Sparks => pulses(Class::Spark),
            Signal::Arcs => pulses(Class::Arc),
            Signal::Shorts => pulses(Class::Short),
            Signal::Uncertain => pulses(Class::Uncertain),
            Signal::ShortTime => input.short_ticks.cast_signed(),
            Signal::Bus => (f32::from(input.drive.bus_voltage) * scales.bus) as i32,
            Signal::Fault => plan.fault.map_or(0, |fault| fault.number().into()),
            Signal::Flags => {
                i32::from(plan.pulses)
                    | i32::from(input.reflex) << 1
                    | i32::from(follower.is_saturated()) << 2
                    | i32::from(plan.closed) << 3
            }
        }
    }

    /// Whether it is of the gap reading.
    pub fn is_of_gap(self) -> bool {
        matches!(
            self,
            Signal::GapVoltage
                | Signal::GapBlock
                | Signal::Open
                | Signal::Sparks
                | Signal::Arcs
                | Signal::Shorts
                | Signal::Uncertain
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_rise_without_a_gap_and_lead_to_their_signal() {
        for ((number, name, ..), expected) in SIGNAL_TEXTS.iter().zip(1..) {
            assert_eq!(*number, expected, "{name}");
            assert_eq!(Signal::numbered(*number).map(|signal| signal as u8), Some(*number), "{name}");
        }
        assert_eq!(SIGNAL_TEXTS.last().map(|row| row.0), Some(Signal::LAST));
        assert_eq!((Signal::numbered(0), Signal::numbered(Signal::LAST + 1)), (None, None));
    }
}
