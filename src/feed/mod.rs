//! Feed laws: how fast to go along the path, given the gap.
//!
//! A law is a value with its numbers, which are those of the settings, and a state of its own, which the planner keeps. It sees
//! the gap error, everything that is sensed of the gap and how the head has moved ([`View`]), and answers with a path velocity
//! and with what it wants of the generator ([`Answer`]). Limits come after the law, in [`Limiter`], so every law has the same ones.
//!
//! *Gap error* is that of the controlled variable: positive when the gap is too wide.
//!
//! Another law is a file here, a line in [`laws!`](self) and its settings: CONTRIBUTING.md.

mod limiter;
mod period;

pub use limiter::{Limiter, Limits};

use crate::gap::GapReading;
use crate::gap::senses::Senses;
use crate::units::{Fixed, Micrometres, MicrometresPerSecond, Seconds, Volts};

/// What a law sees, at every plan while the head erodes or is guided.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// Error of the controlled variable, positive when the gap is too wide; 0 where it is not known.
    pub error: Volts,
    /// Newest reading of the gap, with the count of every pulse so far.
    pub gap: &'a GapReading,
    /// What the pulses of late say.
    pub senses: &'a Senses,
    /// How the head moves.
    pub motion: Motion,
    /// Servo ticks of 50 us since the last call: 10 in slow erosion, else 5, fewer after an urgent event, at most 20.
    pub ticks: u32,
}

/// How the head moves along the path; beside a path, along its axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// Path coordinate, um; beside a path, where that was left.
    pub place: Fixed,
    /// Way since the last call, um, positive toward the work: what the law moved, and the limits have let through.
    pub moved: Micrometres,
    /// Velocity of now, um/s.
    pub velocity: MicrometresPerSecond,
}

/// What a law answers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Answer {
    /// Path velocity until the next call, um/s: positive feeds, negative retreats. [`Limits`] apply to it.
    pub velocity: MicrometresPerSecond,
    /// What the generator is to do until then.
    pub generator: Generator,
    /// What the law needs to see is not there. It stands; when that lasts longer than `supervise.gap_ms`, it is a fault.
    pub blind: bool,
}

impl Answer {
    /// A velocity, and nothing of the generator.
    pub const fn feed(velocity: f32) -> Answer {
        Answer { velocity: MicrometresPerSecond(velocity), generator: Generator::FREE, blind: false }
    }

    /// Nothing is seen.
    pub const BLIND: Answer = Answer { blind: true, ..Answer::feed(0.0) };
}

/// What a law wants of the generator.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Generator {
    /// Least off-time after every pulse, up to 1.2 ms; 0: as it is set. Only of laws with [`FeedLaw::ASKS_OFF_TIME`].
    pub off_time: Seconds,
    /// No pulses.
    pub closed: bool,
}

impl Generator {
    /// Nothing is wanted.
    pub const FREE: Generator = Generator { off_time: Seconds(0.0), closed: false };
}

/// Why a law begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum After {
    /// The work was found, or a host has begun to guide.
    Start,
    /// Another law has led.
    Change,
    /// A retreat from a short has ended, so far behind the place where the gap was bridged, um.
    Retreat(Micrometres),
    /// A jump has ended, so far behind the place where it began, um.
    Jump(Micrometres),
}

/// Turns what is known of the gap into a path velocity, at every plan while the head erodes or is guided.
pub trait FeedLaw {
    /// What it remembers.
    type State: Copy + Default + core::fmt::Debug;
    /// It needs pulses that are told apart: `gap.average` = plain shows none.
    const NEEDS_PULSES: bool = false;
    /// It acts on the error of the controlled variable, and on nothing else.
    const BY_ERROR: bool = false;
    /// It may ask for an off-time: the ends of pulses are watched.
    const ASKS_OFF_TIME: bool = false;

    /// What to do until the next call.
    fn act(&self, state: &mut Self::State, view: &View<'_>) -> Answer;

    /// It leads from here on. Most laws begin anew.
    fn resume(&self, state: &mut Self::State, _: After) {
        *state = Self::State::default();
    }
}

/// Declares the laws: `number file::Law;`. The file's name is the law's name to a host, the number its value on CAN: numbers
/// count from 0 and, once released, stay.
macro_rules! laws {
    ($($(#[doc = $doc:literal])+ $number:literal $name:ident::$law:ident;)+) => {
        $(
            mod $name;
            pub use $name::$law;
        )+

        /// The law in force, with its numbers.
        #[derive(Clone, Copy, Debug, PartialEq)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        pub enum Law {
            $($(#[doc = $doc])+ $law($law),)+
        }

        /// What the law in force remembers.
        #[derive(Clone, Copy, Debug)]
        enum State {
            $($law(<$law as FeedLaw>::State),)+
        }

        impl Law {
            fn state(&self) -> State {
                match self { $(Law::$law(_) => State::$law(Default::default()),)+ }
            }

            fn act(&self, state: &mut State, view: &View<'_>) -> Answer {
                match (self, state) {
                    $((Law::$law(law), State::$law(state)) => law.act(state, view),)+
                    // Never: see `Leading`.
                    _ => Answer::BLIND,
                }
            }

            fn resume(&self, state: &mut State, after: After) {
                match (self, state) {
                    $((Law::$law(law), State::$law(state)) => law.resume(state, after),)+
                    (_, state) => *state = self.state(),
                }
            }
        }

        /// A law by name, before it has its numbers.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum LawName {
            $($(#[doc = $doc])+ $law = $number,)+
        }

        impl LawName {
            /// Every law, by number.
            pub const ALL: &'static [LawName] = &[$(LawName::$law),+];
            /// Their names, by number; the number of a law that has gone has none.
            pub const NAMES: &'static [&'static str] = &{
                let mut names = [""; { [$($number),+] }[LawName::ALL.len() - 1] + 1];
                $(names[$number] = stringify!($name);)+
                $(assert!($number != GONE, "this number belonged to a law that has gone");)+
                names
            };

            /// See [`FeedLaw::NEEDS_PULSES`].
            pub fn needs_pulses(self) -> bool {
                match self { $(LawName::$law => <$law as FeedLaw>::NEEDS_PULSES,)+ }
            }

            /// See [`FeedLaw::BY_ERROR`].
            pub fn by_error(self) -> bool {
                match self { $(LawName::$law => <$law as FeedLaw>::BY_ERROR,)+ }
            }

            /// See [`FeedLaw::ASKS_OFF_TIME`].
            pub fn asks_off_time(self) -> bool {
                match self { $(LawName::$law => <$law as FeedLaw>::ASKS_OFF_TIME,)+ }
            }

            /// The law with the numbers that it takes of `settings`.
            pub fn build<'a, S>(self, settings: &'a S) -> Law
            where
                $($law: From<&'a S>,)+
            {
                match self { $(LawName::$law => Law::$law(settings.into()),)+ }
            }
        }
    };
}

/// Number of a law that has gone: a test that did not feed.
const GONE: usize = 10;

laws! {
    /// Section 6.7.1 of \[R\].
    0 fixed_rate::FixedRate;
    /// Section 6.7.2 of \[R\].
    1 rate_by_error::RateByError;
    /// Section 6.7.3 of \[R\], the default.
    2 increment_by_error::IncrementByError;
    /// 2TAV of \[G\]; with `feed.band_v` = 0 its 1TAV.
    3 two_thresholds::TwoThresholds;
    /// FC of \[G\]: a step a period, by the counts of its pulses.
    4 pulse_counts::PulseCounts;
    /// FPCC of \[G\]: the same, with pulse control.
    5 pulse_control::PulseControl;
    /// Minimum variance with a model that is identified, on the gap distance (\[X\]).
    6 minimum_variance::MinimumVariance;
    /// Velocity by the frequency of sparks (\[L\]).
    7 spark_frequency::SparkFrequency;
    /// PI on the shares of open, short and arcing pulses.
    8 gap_ratio::GapRatio;
    /// Our own: the gap is estimated from ignitions and from the head's motion.
    9 observed_gap::ObservedGap;
}

/// The law that leads, with what it remembers.
#[derive(Clone, Copy, Debug)]
pub struct Leading(State);

impl Leading {
    /// This law, which has not led yet.
    pub fn new(law: &Law) -> Leading {
        Leading(law.state())
    }

    /// What the law wants. `law` is the one of the last [`resume`](Leading::resume) or [`retune`](Leading::retune).
    pub fn act(&mut self, law: &Law, view: &View<'_>) -> Answer {
        law.act(&mut self.0, view)
    }

    /// The law leads from here on.
    pub fn resume(&mut self, law: &Law, after: After) {
        law.resume(&mut self.0, after);
    }

    /// The law has other numbers from here on, with which it goes on; or it is another one, which begins.
    pub fn retune(&mut self, law: &Law) {
        let other = law.state();
        if core::mem::discriminant(&other) != core::mem::discriminant(&self.0) {
            self.0 = other;
            law.resume(&mut self.0, After::Change);
        }
    }
}

/// What a law sees in a test.
#[cfg(test)]
#[derive(Default)]
pub(crate) struct Pulsed {
    pub gap: GapReading,
    pub senses: Senses,
    pub error: f32,
    pub moved: f32,
}

#[cfg(test)]
impl Pulsed {
    /// So many pulses: open, spark, arc, short, none, uncertain.
    pub fn add(&mut self, classes: [u32; 6]) {
        self.gap.pulses.classes.iter_mut().zip(classes).for_each(|(count, new)| *count += new);
        // Uncertain ones were too brief, and never charged.
        self.gap.pulses.unclear += classes[crate::gap::pulses::Class::Uncertain as usize];
    }

    /// What a law does about it.
    pub fn act<L: FeedLaw>(&self, law: &L, state: &mut L::State, ticks: u32) -> Answer {
        let motion = Motion { moved: Micrometres(self.moved), ..Motion::default() };
        law.act(state, &View { error: Volts(self.error), gap: &self.gap, senses: &self.senses, motion, ticks })
    }
}

/// Velocity that a law answers to an error, and nothing else.
#[cfg(test)]
pub(crate) fn acts<L: FeedLaw>(law: &L, state: &mut L::State, error: f32, ticks: u32) -> f32 {
    Pulsed { error, ..Pulsed::default() }.act(law, state, ticks).velocity.0
}
