//! The teach-in, 2013h: levels of pulses learnt from what this generator does, step by step.
//!
//! 1. *Touch*: electrode and work touch with pulses off, as a search for the surface makes them. What the converter shows then is
//!    no voltage; its zero is checked. Without a sense supply, or when pulses begin before, this step is left out, and 2013h:8 says so.
//! 2. *Open circuit*: pulses across an open gap, as in the seek of an erosion.
//! 3. *Sparking*: the head erodes until [`LEAST`] pulses have burned and 2013h:2 is over.
//!
//! Then levels are fitted ([`Gathered::levels`]) and shown; 2013h:1 = 2 makes them settings, all five or none. The head moves
//! by no order of this: what it does is the host's to say, and a host that only watches may teach during any erosion.

use super::Drive;
use crate::canopen::objects::Item;
use crate::canopen::{Abort, Written};
use crate::gap::pulses::Fit;
use crate::gap::teach::{Gathered, LEAST, Taught, TeachError};
use crate::settings::{Declared, Settings, place};
use crate::units::Volts;

/// Milliseconds of permission without a pulse that show that none can be seen: ten of the slowest pulses of \[R\] and more.
const NO_PULSE: u32 = 2000;
/// Conversions of a contact whose mean is its voltage, one a millisecond: whole periods of 50 and of 60 Hz.
const CONTACT: u32 = 100;
/// Voltage of a contact from which the zero of the converter is wrong (assumed: a tenth of what the lowest arcs burn at).
const ZERO_V: f32 = 1.5;
/// Pulses that burn between two fits, where shorts were among the first.
const MORE: u32 = LEAST / 20;
/// Burning pulses from which the step is sparking: fewer may be noise of the seek.
const BEGUN: u32 = 100;

/// The settings that a teach-in proposes, in the order of [`Teach::proposal`].
const PROPOSED: [u16; 5] = [
    place(Settings::KEYS, "gap.open_v") as u16,
    place(Settings::KEYS, "gap.spark_v") as u16,
    place(Settings::KEYS, "gap.arc_below_v") as u16,
    place(Settings::KEYS, "gap.short_v") as u16,
    place(Settings::KEYS, "gap.noise_v") as u16,
];

/// 2013h:3.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Step {
    #[default]
    None,
    Touch,
    OpenCircuit,
    Sparking,
    Proposed,
    Applied,
    Ended,
}

/// 2013h:4.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Why {
    #[default]
    None,
    Stopped,
    NoPulses,
    TooFew,
    NoOpenCircuit,
    Refused,
}

/// 2013h:8.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Contact {
    #[default]
    NotYet,
    NotSensed,
    LeftOut,
    Good,
    ZeroWrong,
}

/// See the [module](self).
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Teach {
    step: Step,
    why: Why,
    contact: Contact,
    /// Sum of conversions in contact, codes, and how many.
    touched: (i32, u32),
    /// What the contact showed.
    volts: Volts,
    /// Number of this run, from 1 on.
    run: u32,
    /// Milliseconds with pulses in the third step, and in a row without one in spite of permission.
    sparked: u32,
    pulseless: u32,
    total: u32,
    /// Enough has burned: the levels are to be fitted.
    due: bool,
    /// Pulses to burn in addition to [`LEAST`]: some of those were shorts, which show no level.
    more: u32,
    /// The host wants no more pulses.
    last: bool,
    taught: Option<Taught>,
    /// As the gap task says.
    levels: u32,
    burned: u32,
}

impl Teach {
    /// Hundredths of a volt.
    fn proposal(&self) -> [u16; 5] {
        let Some(taught) = &self.taught else { return [0; 5] };
        let Taught { open, spark, arc_below, short_below, noise, .. } = *taught;
        [open, spark, arc_below, short_below, noise].map(|volts| (volts.0 * 100.0 + 0.5) as u16)
    }

    fn end(&mut self, why: Why) {
        (self.step, self.why, self.due) = (Step::Ended, why, false);
    }

    /// What burns is to be collected.
    fn collects(&self) -> bool {
        matches!(self.step, Step::OpenCircuit | Step::Sparking) && !self.due
    }

    /// Whether the levels fit the pulses.
    pub fn does_not_fit(&self) -> bool {
        let [fit, ..] = self.levels.to_le_bytes();
        fit > Fit::Fits as u8
    }

    /// What an object reads.
    pub fn number(&self, item: Item) -> i64 {
        let [open, spark, arc_below, short, noise] = self.proposal();
        match item {
            Item::TeachStep => self.step as i64,
            Item::TeachWhy => self.why as i64,
            Item::TeachPulses => self.burned.into(),
            Item::TeachNeeded => LEAST.into(),
            Item::TeachTime => (self.sparked / 1000).min(u16::MAX.into()).into(),
            Item::TeachContact => self.contact as i64,
            Item::TeachContactVoltage => i64::from((self.volts.0 * 100.0) as i16),
            Item::TaughtOpen => open.into(),
            Item::TaughtSpark => spark.into(),
            Item::TaughtArc => arc_below.into(),
            Item::TaughtShort => short.into(),
            Item::TaughtNoise => noise.into(),
            Item::TaughtApart => {
                let apart = self.taught.and_then(|taught| taught.apart).unwrap_or(0.0);
                i64::from((apart * 10.0) as u16)
            }
            _ => {
                let [fit, share, error, _] = self.levels.to_le_bytes();
                i64::from(match item {
                    Item::ArcsUndelayed | Item::ArcsUndelayedError if fit == Fit::Unknown as u8 => u8::MAX,
                    Item::ArcsUndelayed => share,
                    Item::ArcsUndelayedError => error,
                    _ => fit,
                })
            }
        }
    }
}

impl Drive {
    /// Takes what is known of the levels of pulses, and how many burning pulses were collected in a run, once a millisecond.
    pub fn set_looks_at_levels(&mut self, levels: u32, burned: (u32, u32)) {
        self.teach.levels = levels;
        if burned.0 == self.teach.run && self.teach.collects() {
            self.teach.burned = burned.1;
        }
    }

    /// Number of the run for which pulses are to be collected; 0: none are.
    pub fn teaching(&self) -> u32 {
        if self.teach.collects() { self.teach.run } else { 0 }
    }

    /// [`Drive::taught`] waits for what was collected.
    pub fn learns(&self) -> bool {
        self.teach.due
    }

    /// Fits the levels to what was collected.
    pub fn taught(&mut self, gathered: &Gathered) {
        let teach = &mut self.teach;
        teach.due = false;
        match gathered.levels() {
            Ok(taught) => (teach.step, teach.taught) = (Step::Proposed, Some(taught)),
            Err(TeachError::TooFew) if !teach.last => teach.more = teach.more.saturating_add(MORE),
            Err(TeachError::TooFew) => teach.end(Why::TooFew),
            Err(TeachError::NoOpenCircuit) => teach.end(Why::NoOpenCircuit),
        }
    }

    /// 2013h:1.
    pub(super) fn teach(&mut self, value: i64) -> Result<Written, Abort> {
        match value {
            0 => self.end_teaching(),
            1 => {
                let contact = match self.active.head.contact.sensed {
                    true => Contact::NotYet,
                    false => Contact::NotSensed,
                };
                let step = if contact == Contact::NotYet { Step::Touch } else { Step::OpenCircuit };
                let Teach { run, levels, .. } = self.teach;
                let run = run.wrapping_add(1).max(1);
                self.teach = Teach { step, contact, run, levels, ..Teach::default() };
            }
            _ => return self.apply_taught(),
        }
        Ok(Written::Now)
    }

    /// Makes settings of what is proposed: all or none.
    fn apply_taught(&mut self) -> Result<Written, Abort> {
        if !matches!(self.teach.step, Step::Proposed | Step::Applied) {
            return Err(Abort::DeviceState);
        }
        let values = self.teach.proposal().map(|centivolts| (f32::from(centivolts) * 0.01).to_bits());
        let mut words = [(0, 0); 5];
        for (word, new) in words.iter_mut().zip(PROPOSED.into_iter().zip(values)) {
            *word = new;
        }
        let written = self.write_words(&words);
        (self.teach.step, self.teach.why) = match written {
            Ok(_) => (Step::Applied, Why::None),
            Err(_) => (Step::Proposed, Why::Refused),
        };
        written
    }

    /// The host wants no more of it. What has burned is enough, or is not.
    fn end_teaching(&mut self) {
        match self.teach.step {
            Step::Sparking if self.teach.burned >= LEAST => (self.teach.due, self.teach.last) = (true, true),
            Step::Touch | Step::OpenCircuit => self.teach.end(Why::Stopped),
            Step::Sparking => self.teach.end(Why::TooFew),
            _ => {}
        }
    }

    /// The node begins anew.
    pub(super) fn forget_teaching(&mut self) {
        let Teach { run, levels, .. } = self.teach;
        self.teach = Teach { run, levels, ..Teach::default() };
    }

    /// Goes on, once a millisecond.
    pub(super) fn watch_teaching(&mut self) {
        if !matches!(self.teach.step, Step::Touch | Step::OpenCircuit | Step::Sparking) {
            return;
        }
        let pulses = self.status.state.pulses();
        let least = self.value(Item::TeachLeast).unsigned_abs().saturating_mul(1000);
        let touches = self.touches();
        let per_code = self.settings.gap_volts_per_code;
        let code = i32::from(self.status.gap.code) - self.settings.gap_zero_code.cast_signed();
        let total = self.status.gap.pulses.total();
        let teach = &mut self.teach;
        match teach.step {
            Step::Touch if pulses => (teach.step, teach.contact) = (Step::OpenCircuit, Contact::LeftOut),
            Step::Touch => {
                let (sum, count) = if touches { teach.touched } else { (0, 0) };
                teach.touched = if touches { (sum + code, count + 1) } else { (0, 0) };
                if count + 1 >= CONTACT {
                    let volts = (sum + code) as f32 * per_code * (1.0 / CONTACT as f32);
                    teach.volts = Volts(volts);
                    teach.contact = if volts.abs() <= ZERO_V { Contact::Good } else { Contact::ZeroWrong };
                    teach.step = Step::OpenCircuit;
                }
            }
            Step::OpenCircuit | Step::Sparking if !teach.due => {
                let none = pulses && total == teach.total;
                teach.pulseless = if none { teach.pulseless.saturating_add(1) } else { 0 };
                teach.total = total;
                if teach.pulseless >= NO_PULSE {
                    teach.end(Why::NoPulses);
                } else if teach.step == Step::OpenCircuit {
                    if teach.burned >= BEGUN {
                        teach.step = Step::Sparking;
                    }
                } else {
                    teach.sparked = teach.sparked.saturating_add(pulses.into());
                    teach.due = teach.sparked >= least && teach.burned >= LEAST.saturating_add(teach.more);
                }
            }
            _ => {}
        }
    }
}
