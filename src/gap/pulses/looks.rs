//! Single pulses looked at closely: levels learned from what they burn at, and what burned, for a teach-in.
//!
//! A pulse that waited longer than any arc (`gap.arc_delay_us`) is a spark whatever it burns at. So one pulse a millisecond teaches what this
//! generator's sparks burn at, S with the standard deviation s, and what the others do, which ignited sooner and are sparks or arcs. Arcs burn lower by d, and are
//! a share q of the others. The others' mean is S - q d, and their mean square about S is s^2 + q d^2 (method of moments), so
//!
//! ```text
//! d = (mean square about S - s^2) / (S - mean)         known from 4 standard errors of S - mean on
//! ```
//!
//! and q = (S - mean) / d. Before that arcs are taken to burn at 0.7 S, as in \[R\] section 4.4 with the arcs of the process model. The boundary of arcs is S - d / 2, that of shorts
//! half of an arc at most. Where d is less than 4 s the levels overlap: a pulse that waited for less is *uncertain*.
//!
//! Until [`LEARNED`] sparks were looked at the levels are those of the settings, unless the open circuit is another one: then what ignites at once is
//! uncertain. The open circuit itself moves no level but the boundary to what has ignited, and only where the comparator does not show it.
//! Levels that are not those of the settings are told ([`Fit`]), and nothing follows from it.
//!
//! Where sparks burn above [`TOLD`] of the open circuit the comparator may take one for the other: no class, delay or mean of such a gap is to be
//! believed. So where few sparks are seen, but of the pulses that are shown as open a share of [`MANY`] ends below [`FALLEN`] of the open circuit.

use super::class::Class;
use super::samples::{ARC_LEAST, Boundaries, Evidence, SHOWN_LEAST};
use crate::units::{ADC_FULL_SCALE, within};

/// Share of a level by which it may differ from its setting.
const WITHIN: f32 = 0.15;
/// Share by which open circuit and sparks may differ from each other, both over their settings, where it is the divider that is wrong.
const TOGETHER: f32 = 0.07;
/// Share of the open circuit below which a pulse burns while no level is learned and the open circuit is another one: sparks burn at 0.31 to 0.4 of
/// it (80/25 V to 100/40 V), so that is midway.
const IGNITED: f32 = 0.67;
/// Looks at sparks from which their level is learned, and looks from which something is said of the levels.
const LEARNED: u16 = 16;
/// Looks at the others from which the level of arcs is learned.
const OTHERS: u16 = 64;
/// Looks at sparks, or at open pulses, that are remembered; and looks at the others, whose share of arcs changes.
const MEMORY: u16 = 512;
const MEMORY_OTHERS: u16 = 192;
/// Arc over spark where no arcs were seen.
const ASSUMED: f32 = 0.7;
/// Standard errors from which a difference is one, standard deviations from which two levels are two.
const APART: f32 = 4.0;

/// Share of the highest voltage of late that each look forgets which may have been at an open circuit, 2^-8: a tenth in 27 looks.
const FORGETS: u32 = 8;
/// Share of the open circuit up to which a comparator for 70 % of it, 20 % too low, tells it from what burns.
const TOLD: f32 = 0.55;
/// Share of the open circuit below which a pulse that a comparator shows as open has fallen: it burns, and the comparator does not see it.
const FALLEN: f32 = 0.8;
/// Share of fallen pulses of late among those that are shown as open, and among those and sparks, from which no class is to be believed. At 0.55 of
/// the open circuit, with a comparator 20 % too low and a scatter of 4 V, half of the sparks of 60 V are not seen.
const MANY: f32 = 0.25;
const MOST: f32 = 0.75;
/// One over the looks by which those shares are known.
const FEW: f32 = 1.0 / 64.0;
/// Times `gap.spark_v` from which the highest voltage is one of an open circuit that no comparator shows.
const ABOVE: f32 = 1.25;

/// A reason to look at pulses: the bits of `Looks::why`.
const LOOK: u8 = 1;
const COLLECT: u8 = 2;
/// One more pulse is looked at if this one shows nothing: looks and pulses may beat, and always meet one that ends as a block begins.
const AGAIN: u8 = 4;

/// Whether the levels of the settings fit the pulses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Fit {
    /// Too few pulses to say.
    #[default]
    Unknown,
    /// They do.
    Fits,
    /// They do not.
    DoesNotFit,
    /// Open circuit and sparks differ by the same share: the divider of the gap voltage is another one.
    Divider,
    /// The open circuit differs, and sparks do not: the supply of the generator is another one.
    Supply,
    /// What burns cannot be told from the open circuit.
    Unclear,
}

/// What a pulse showed, in codes above no voltage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Seen {
    /// It did not ignite, and was so high at its end: the higher one of the last two conversions.
    Open(i32),
    /// It burned at this mean; and the difference of its last two conversions, where they are at hand.
    Burned(i32, Option<i32>),
}

/// Mean and variance of late, codes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
struct Level {
    count: u16,
    mean: f32,
    variance: f32,
}

impl Level {
    fn add(&mut self, codes: i32, memory: u16) {
        self.count = self.count.saturating_add(1).min(memory);
        let share = 1.0 / f32::from(self.count);
        let from = codes as f32 - self.mean;
        self.mean += share * from;
        self.variance += share * ((1.0 - share) * from * from - self.variance);
    }
}

/// Looks so far. See the [module](self).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(super) struct Looks {
    why: u8,
    /// Something is there to be taken.
    news: bool,
    fit: Fit,
    /// Open circuit; what burned after a wait that no arc has; what burned sooner.
    open: Level,
    sparks: Level,
    others: Level,
    /// Share of fallen pulses of late among those that are shown as open, and among those and sparks.
    fallen: f32,
    missed: f32,
    /// Highest voltage at the end of a pulse of late, codes; looks so far.
    top: i32,
    looked: u16,
    /// Share of arcs among the others, and its standard error, percent.
    arcs: [u8; 2],
    seen: Option<Seen>,
}

/// A share that is not known.
const UNKNOWN: [u8; 2] = [u8::MAX; 2];

impl Looks {
    /// None yet.
    pub const NEW: Looks = {
        const NONE: Level = Level { count: 0, mean: 0.0, variance: 0.0 };
        Looks {
            why: 0,
            news: false,
            fit: Fit::Unknown,
            open: NONE,
            sparks: NONE,
            others: NONE,
            fallen: 0.0,
            missed: 0.0,
            top: 0,
            looked: 0,
            arcs: UNKNOWN,
            seen: None,
        }
    };

    /// Begins anew with other boundaries; collecting goes on.
    pub fn retune(&mut self) {
        *self = Looks { why: self.why & COLLECT, news: true, ..Looks::NEW };
    }

    /// A pulse of this class is to be looked at. What is uncertain tells nothing, the next one may; but where levels overlap it does.
    #[inline(always)]
    pub fn are_due(&self, class: Class, overlap: bool) -> bool {
        self.why != 0 && (class != Class::Uncertain || overlap || self.why & COLLECT != 0)
    }

    /// Looks at the next pulse that ends.
    #[inline(always)]
    pub fn look(&mut self) {
        self.why |= LOOK | AGAIN;
    }

    /// Every pulse that ends is to be seen, or no longer.
    pub fn collect(&mut self, collects: bool) {
        self.why = if collects { self.why | COLLECT } else { self.why & !COLLECT };
        self.seen = None;
    }

    /// What burns cannot be told from the open circuit.
    #[inline(always)]
    pub fn are_unclear(&self) -> bool {
        self.fit == Fit::Unclear
    }

    /// Something is there that [`Looks::take`] has not taken.
    #[inline(always)]
    pub fn news(&self) -> bool {
        self.news
    }

    /// Whether the levels fit, and the newest pulse that was collected.
    pub fn take(&mut self) -> (Fit, Option<Seen>) {
        self.news = false;
        (self.fit, self.seen.take())
    }

    /// Whether the levels fit, share of arcs among pulses that did not wait and its standard error, percent (255: not known): a byte each.
    pub fn word(&self) -> u32 {
        let [share, error] = self.arcs;
        u32::from_le_bytes([self.fit as u8, share, error, 0])
    }

    /// Looks at a pulse that has ended, with the conversions at hand that belong to its newest part, the oldest first. `waited`: as no arc does.
    pub fn at(&mut self, boundaries: &mut Boundaries, evidence: &Evidence, codes: &[u16], class: Class, waited: bool) {
        let levels = *boundaries.levels();
        // The very last may have been converted while the gate closed. What is clipped is none.
        let good = 1..ADC_FULL_SCALE;
        let last = match codes {
            [.., before, last] if good.contains(before) && good.contains(last) => {
                Some(levels.voltage(*before).max(levels.voltage(*last)))
            }
            _ => None,
        };
        self.top = self.top.max(last.unwrap_or(0));
        let seen = if class == Class::Open {
            last.map(Seen::Open)
        } else {
            let least = if evidence.is_shown() { SHOWN_LEAST } else { ARC_LEAST };
            let step = match codes {
                [.., before, last] if evidence.burning() >= 2 => Some(i32::from(*last) - i32::from(*before)),
                _ => None,
            };
            evidence.mean(boundaries, least).map(|mean| Seen::Burned(mean, step))
        };
        if self.why & COLLECT != 0 && seen.is_some() {
            (self.seen, self.news) = (seen, true);
        }
        // What is learned does not hang on whether pulses are collected as well.
        if self.why & LOOK == 0 || class == Class::Uncertain && !boundaries.overlap() {
            return;
        }
        match seen {
            Some(Seen::Open(codes)) => {
                let fallen = self.open.count >= LEARNED && (codes as f32) < FALLEN * self.open.mean;
                self.fallen += FEW * (if fallen { 1.0 } else { 0.0 } - self.fallen);
                if fallen {
                    self.missed += FEW * (1.0 - self.missed);
                } else {
                    self.open.add(codes, MEMORY);
                }
            }
            Some(Seen::Burned(mean, _)) if waited => {
                self.missed -= FEW * self.missed;
                self.sparks.add(mean, MEMORY);
            }
            Some(Seen::Burned(mean, _)) if class != Class::Short => self.others.add(mean, MEMORY_OTHERS),
            Some(_) => return,
            None => {
                // Pulses so brief come often: two looks a millisecond are what there is time for.
                let done = if self.why & AGAIN != 0 { AGAIN } else { LOOK };
                self.why &= !done;
                return;
            }
        }
        self.why &= !(LOOK | AGAIN);
        self.looked = self.looked.saturating_add(1);
        self.learn(boundaries);
        // What a comparator has shown to burn says nothing of the open circuit.
        if !evidence.is_shown() {
            self.top -= self.top >> FORGETS;
        }
    }

    /// One more look: the levels as they are known now.
    fn learn(&mut self, boundaries: &mut Boundaries) {
        let (open, sparks, others) = (self.open, self.sparks, self.others);
        let [set_open, set_spark] = boundaries.set().map(|level| level as f32);
        let differs = |is: f32, set: f32| (is - set).max(set - is) > WITHIN * set;
        let highest = self.top as f32;
        let top = if open.count >= LEARNED {
            open.mean
        } else if self.looked >= OTHERS && sparks.count < LEARNED && highest > ABOVE * set_spark {
            highest
        } else {
            set_open
        };
        let another = differs(top, set_open);
        let learned = sparks.count >= LEARNED && sparks.mean > 1.0;
        let Apart { lower, arcs } = Apart::of(&sparks, &others);
        self.news |= core::mem::replace(&mut self.arcs, if learned { arcs } else { UNKNOWN }) != self.arcs;
        let boundaries_of = |levels: [f32; 3]| Some(levels.map(|level| level as i32));
        if learned {
            let overlap = lower * lower < APART * APART * sparks.variance;
            let (short, arc) = (0.5 * (sparks.mean - lower), sparks.mean - 0.5 * lower);
            boundaries.learn(boundaries_of([short, arc, 0.5 * (sparks.mean + top)]), overlap);
        } else if another {
            // Whatever burns, it is not known at what.
            boundaries.learn(boundaries_of([top / 16.0, top, IGNITED * top]), true);
        } else {
            boundaries.learn(None, false);
        }
        let most = if open.count < LEARNED { highest } else { top };
        let high = learned && sparks.mean > TOLD * if another { most } else { most.max(set_open) };
        let told = !high && (self.fallen < MANY || self.missed < MOST);
        let known = another || learned || open.count >= LEARNED;
        let burns = learned && differs(sparks.mean, set_spark);
        let [one, other] = [top * set_spark, sparks.mean * set_open];
        let together = (one - other).max(other - one) <= TOGETHER * one;
        let fit = match (another, burns) {
            _ if !told => Fit::Unclear,
            _ if !known => Fit::Unknown,
            (false, false) => Fit::Fits,
            (true, _) if learned && together => Fit::Divider,
            (true, false) if learned => Fit::Supply,
            _ => Fit::DoesNotFit,
        };
        self.news |= core::mem::replace(&mut self.fit, fit) != fit;
    }
}

/// Arcs, by what is known of the others.
struct Apart {
    /// By how much they burn lower than sparks, codes.
    lower: f32,
    /// Their share of the others and its standard error, percent.
    arcs: [u8; 2],
}

impl Apart {
    fn of(sparks: &Level, others: &Level) -> Apart {
        let lower = sparks.mean - others.mean;
        let square = others.variance + lower * lower;
        // Of the mean of the others less that of the sparks, squared.
        let error = square / f32::from(others.count.max(1)) + sparks.variance / f32::from(sparks.count.max(1));
        if others.count < OTHERS || lower <= 0.0 || lower * lower < APART * APART * error {
            return Apart { lower: (1.0 - ASSUMED) * sparks.mean, arcs: UNKNOWN };
        }
        let apart = within((square - sparks.variance) / lower, lower, 0.9 * sparks.mean);
        let percent = |share: f32| (100.0 * share + 0.5) as u8;
        Apart { lower: apart, arcs: [percent(lower / apart), percent(2.0 * libm::sqrtf(error) / apart)] }
    }
}
