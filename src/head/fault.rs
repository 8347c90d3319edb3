//! Faults and what the head does about each: the table of docs/architecture.md.
//!
//! In every row the pulses go off at once and stay off until the fault is reset.
//!
//! A reaction that closes the loop is supervised like any other motion, and a second fault escalates it: from a retrace, a
//! retract or a hold to the force-limited retract or the open-loop lift, from a lift to coasting. Nothing escalates to a
//! motion that relies on more than the one before.

macro_rules! faults {
    ($($(#[$doc:meta])* $fault:ident = $name:literal => $reaction:ident),+ $(,)?) => {
        /// What went wrong.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        #[repr(u8)]
        pub enum Fault {
            $($(#[$doc])* $fault,)+
        }

        impl Fault {
            /// Every fault.
            pub const ALL: &'static [Fault] = &[$(Fault::$fault),+];

            /// Name in reports.
            pub const fn name(self) -> &'static str {
                match self { $(Fault::$fault => $name,)+ }
            }

            /// What the head does about it.
            pub const fn reaction(self) -> Reaction {
                match self { $(Fault::$fault => Reaction::$reaction,)+ }
            }
        }
    };
}

faults! {
    /// A short that retreating did not clear.
    PersistentShort = "persistent short" => Retrace,
    /// Discharges that stay at one spot.
    PersistentArc = "persistent arc" => Retrace,
    /// Converter silent, at the end of its range, or with one code.
    GapSignalInvalid = "gap signal invalid" => Retrace,
    /// Pulses are allowed but the generator's gate does not move.
    GateMissing = "gate missing" => Retrace,
    /// Dielectric level, flow or temperature.
    DielectricNotOk = "dielectric not OK" => Retrace,
    /// No life sign from host or leader.
    HostSilent = "host silent" => Retrace,
    /// Lower limit switch open.
    LowerLimit = "lower limit" => RetractOffLimit,
    /// Upper limit switch open.
    UpperLimit = "upper limit" => HoldBelow,
    /// Both limit switches open: a broken wire.
    BothLimits = "both limits open" => Hold,
    /// Position and setpoint drifted apart.
    FollowingError = "following error" => ForceLimitedRetract,
    /// The encoder contradicts its second counter or the back-EMF.
    EncoderLost = "encoder lost" => OpenLoopLift,
    /// The axis runs away against the duty.
    PolarityWrong = "polarity wrong" => Coast,
    /// Bus voltage too low to work with.
    BusSag = "bus voltage sag" => LiftOnStored,
    /// Emergency stop open.
    EmergencyStop = "emergency stop" => EmergencyLift,
    /// Motor current beyond its peak for longer than the loop needs to act.
    OverCurrent = "over-current" => Coast,
    /// The H-bridge reports a fault.
    BridgeFault = "bridge fault" => Coast,
    /// The plan task did not keep up with the servo for a millisecond.
    PlanLate = "plan late" => Coast,
    /// The electrode touches the work in a motion with pulses off that was not meant to touch.
    Contact = "contact" => RetractOffLimit,
    /// The live signal has stopped, or the circuit behind it does not take hold: pulses and bridge are off without it.
    LiveLost = "live signal lost" => Coast,
    /// The circuit behind the live signal does not let go, or takes hold unasked: it would not switch off a dead head.
    LiveStuck = "live circuit stuck" => Coast,
    /// The clock that times edges and tasks stands, or servo ticks are missing: neither velocity nor watch can be believed.
    ClockLost = "clock lost" => Coast,
    /// Pulses, or shorts, that the reflex does not see.
    ReflexLost = "reflex lost" => Retrace,
    /// Pulses without permission: the generator does not obey.
    UnpermittedPulses = "pulses without permission" => Retrace,
    /// The board has failed its self-test at the start: nothing may be enabled before it has started anew and passed.
    SelfTestFailed = "self-test failed" => Coast,
    /// The chip's own supply falls: it may not do much longer what the program says.
    SupplyLow = "supply low" => Coast,
    /// Settings that a task runs have changed by themselves in memory, or registers of the chip that are written once: gains,
    /// limits, signs and what measures can no longer be believed.
    SettingsDamaged = "settings damaged" => Coast,
    /// Motor current and bus voltage are not converted any more, or the bus voltage is beyond what can be converted: neither
    /// over-current nor a sag would be seen.
    DriveSignalLost = "drive signal lost" => Coast,
    /// The open gap has less than the least open-circuit voltage to work with.
    OpenCircuitLow = "open-circuit voltage low" => Retrace,
    /// The gap voltage has the wrong sign.
    GapReversed = "gap leads swapped" => Retrace,
    /// Steps of a host were to be followed and could not be: they came too fast, or their direction was lost.
    StepsNotFollowed = "steps not followed" => Hold,
    /// The generator burns so high that the comparator cannot tell it from the open circuit: neither gap nor arcs are seen.
    BurningUnclear = "burning not told from open circuit" => Retrace,
}

impl Fault {
    /// Its number to a host, 2000h:2; 0 is none.
    pub const fn number(self) -> u8 {
        (self as u8).wrapping_add(1)
    }

    /// Whether it casts doubt on the encoder: no loop is closed over it again before it has proved itself.
    pub const fn doubts_encoder(self) -> bool {
        matches!(self, Fault::EncoderLost | Fault::PolarityWrong | Fault::FollowingError)
    }
}

/// What the head does about a fault, mildest first: while one reaction runs, only a stronger one replaces it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Reaction {
    /// Back along the path to the safe height, then hold.
    Retrace,
    /// Back along the path by at least the set clearance, then hold.
    RetractOffLimit,
    /// Decelerate and hold; never further up.
    HoldBelow,
    /// Stop and hold; released manually.
    Hold,
    /// Integrators cleared, back along the path with limited force; becomes [`Reaction::OpenLoopLift`] when the following
    /// error does not shrink.
    ForceLimitedRetract,
    /// Weight plus 20 %, and friction, upward for a limited time, then weight plus 10 %.
    OpenLoopLift,
    /// Lift while the bus still carries, then coast.
    LiftOnStored,
    /// Lift for at most 300 ms, then coast.
    EmergencyLift,
    /// All switches open; the mechanics hold.
    Coast,
}

impl Reaction {
    /// Name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Reaction::Retrace => "retrace",
            Reaction::RetractOffLimit => "retract",
            Reaction::HoldBelow => "hold, never further up",
            Reaction::Hold => "hold",
            Reaction::ForceLimitedRetract => "force-limited retract",
            Reaction::OpenLoopLift => "open-loop lift",
            Reaction::LiftOnStored => "lift on stored energy",
            Reaction::EmergencyLift => "emergency lift",
            Reaction::Coast => "coast",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_has_the_reaction_of_the_architecture_page() {
        use Fault::*;
        for (faults, reaction) in [
            (
                &[
                    PersistentShort,
                    PersistentArc,
                    GapSignalInvalid,
                    OpenCircuitLow,
                    GapReversed,
                    BurningUnclear,
                    GateMissing,
                    ReflexLost,
                    UnpermittedPulses,
                    DielectricNotOk,
                    HostSilent,
                ][..],
                Reaction::Retrace,
            ),
            (&[LowerLimit, Contact], Reaction::RetractOffLimit),
            (&[UpperLimit], Reaction::HoldBelow),
            (&[BothLimits, StepsNotFollowed], Reaction::Hold),
            (&[FollowingError], Reaction::ForceLimitedRetract),
            (&[EncoderLost], Reaction::OpenLoopLift),
            (&[BusSag], Reaction::LiftOnStored),
            (&[EmergencyStop], Reaction::EmergencyLift),
            (
                &[
                    PolarityWrong,
                    BridgeFault,
                    OverCurrent,
                    PlanLate,
                    LiveLost,
                    LiveStuck,
                    ClockLost,
                    SelfTestFailed,
                    SupplyLow,
                    SettingsDamaged,
                    DriveSignalLost,
                ],
                Reaction::Coast,
            ),
        ] {
            for fault in faults {
                assert_eq!(fault.reaction(), reaction, "{}", fault.name());
            }
        }
        assert_eq!(Fault::ALL.len(), 31);
    }
}
