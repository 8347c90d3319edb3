//! Single pulses looked at closely: whether the levels fit them, and what burned, for a teach-in.
//!
//! Levels that do not fit call sparks arcs, or open pulses sparks. One pulse a millisecond is compared with them:
//!
//! - a pulse that did not ignite, with `gap.open_v`: it has to be within [`OPEN_WITHIN`] of it;
//! - one that burned and was named, with all levels: its mean has to lie nearer to a level than to a boundary. Of levels that fit
//!   59 % do at the noise that leaves a class right in 95 %, and more with less (normal, a boundary half-way between levels).
//!
//! Of each kind a counter goes up where it does not and down where it does. The levels *do not fit* from a lead of [`MANY`] on until both
//! counters are back at 0. A pulse that burned is *uncertain* then, whatever the levels make of it: nothing follows from arcs
//! that are none. Open pulses stay what they are. The comparator needs no level for them; where it is not believed, the
//! boundary to what has ignited is taken at [`IGNITED`] of the highest voltage seen of late instead of midway between levels.

use super::class::{Class, Levels};
use super::samples::{ARC_LEAST, Boundaries, Evidence, SHOWN_LEAST};

/// Share of `gap.open_v` by which an open pulse may differ, in a hundredth. Generators of 100, 80 and 65 V are told apart, a supply
/// that gives 10 % more or less is not another one.
const OPEN_WITHIN: i32 = 15;
/// Share of the open circuit, in a hundredth, below which a pulse burns where the levels do not fit: sparks burn at 0.31 to 0.4 of
/// it (80/25 V to 100/40 V), so that is midway.
const IGNITED: i32 = 67;
/// Lead of looks that do not fit over those that do, from which the levels do not.
const MANY: u8 = 16;
/// Largest lead that is counted: what fits again shows within so many looks.
const MOST: u8 = 2 * MANY;
/// Share of the highest voltage of late that each look forgets, 2^-8: a tenth in 27 looks.
const FORGETS: u32 = 8;

/// A reason to look at pulses: the bits of `Looks::why`.
const LOOK: u8 = 1;
const DOUBT: u8 = 2;
const COLLECT: u8 = 4;

/// Whether levels fit the pulses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum Fit {
    /// Too few pulses to say.
    #[default]
    Unknown,
    /// They do.
    Fits,
    /// They do not: pulses that burned are uncertain.
    DoesNotFit,
}

/// What a pulse showed, in codes above no voltage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Seen {
    /// It did not ignite, and was so high at its end.
    Open(i32),
    /// It burned at this mean; and the difference of its last two conversions, where they are at hand.
    Burned(i32, Option<i32>),
}

/// Looks so far. See the [module](self).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(super) struct Looks {
    why: u8,
    /// Something is there to be taken.
    news: bool,
    fit: Fit,
    /// Leads of looks that do not fit: at open pulses, at those that burned.
    leads: [u8; 2],
    looked: u8,
    /// Highest voltage of late, codes.
    top: i32,
    /// Boundary to the open circuit by the levels.
    set: i32,
    seen: Option<Seen>,
}

impl Looks {
    /// None yet.
    pub fn new(boundaries: &Boundaries) -> Looks {
        let set = boundaries.ignited_below();
        Looks { why: 0, news: false, fit: Fit::Unknown, leads: [0; 2], looked: 0, top: 0, set, seen: None }
    }

    /// Begins anew with other boundaries; collecting goes on.
    pub fn retune(&mut self, boundaries: &Boundaries) {
        *self = Looks { why: self.why & COLLECT, news: true, ..Looks::new(boundaries) };
    }

    /// A pulse of this class is to be looked at. What is uncertain tells nothing of the levels: the next one may.
    #[inline(always)]
    pub fn are_due(&self, class: Class) -> bool {
        self.why != 0 && (class != Class::Uncertain || self.why & COLLECT != 0)
    }

    /// Nothing is to be learned of pulses, but the levels do not fit them.
    #[inline(always)]
    pub fn only_doubt(&self) -> bool {
        self.why == DOUBT
    }

    /// Looks at the next pulse that ends.
    #[inline(always)]
    pub fn look(&mut self) {
        self.why |= LOOK;
    }

    /// Every pulse that ends is to be seen, or no longer.
    pub fn collect(&mut self, collects: bool) {
        self.why = if collects { self.why | COLLECT } else { self.why & !COLLECT };
        self.seen = None;
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

    /// Looks at a pulse that has ended, with the conversions at hand that belong to its newest part, the oldest first; gives the class
    /// that it has then.
    pub fn at(
        &mut self,
        boundaries: &mut Boundaries,
        evidence: &Evidence,
        codes: &[u16],
        class: Class,
        charged: bool,
    ) -> Class {
        let levels = *boundaries.levels();
        let last = codes.last().map(|code| levels.voltage(*code));
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
        let set = boundaries.set();
        let fits = match seen {
            Some(Seen::Open(volts)) => Some((0, is_open(volts, set))),
            // Where noise leaves the class open it leaves this open, too. What has been charged is no short: its discharge is over.
            Some(Seen::Burned(mean, _)) => match evidence.class(boundaries) {
                Class::Short if charged => None,
                Class::Spark | Class::Arc | Class::Short => Some((1, is_near(mean, &levels, self.set, set))),
                _ => None,
            },
            None => None,
        };
        if let Some((kind, fits)) = fits.filter(|_| self.why & LOOK != 0) {
            self.judge(boundaries, kind, fits);
        }
        if self.why & DOUBT != 0 { doubted(class) } else { class }
    }

    /// One more look.
    fn judge(&mut self, boundaries: &mut Boundaries, kind: usize, fits: bool) {
        self.why &= !LOOK;
        self.top -= self.top >> FORGETS;
        if let Some(lead) = self.leads.get_mut(kind) {
            *lead = if fits { lead.saturating_sub(1) } else { lead.saturating_add(1).min(MOST) };
        }
        self.looked = self.looked.saturating_add(1);
        let [open, burning] = self.leads;
        // It ends where it began: at no lead at all.
        let least = if self.why & DOUBT != 0 { 1 } else { MANY };
        let doubts = open.max(burning) >= least;
        self.why = if doubts { self.why | DOUBT } else { self.why & !DOUBT };
        boundaries.set_ignited_below(if doubts { self.top / 100 * IGNITED } else { self.set });
        let fit = match doubts {
            true => Fit::DoesNotFit,
            false if self.looked < MANY => Fit::Unknown,
            false => Fit::Fits,
        };
        self.news |= core::mem::replace(&mut self.fit, fit) != fit;
    }
}

/// What a pulse is where the levels do not fit.
pub(super) fn doubted(class: Class) -> Class {
    match class {
        Class::Spark | Class::Arc | Class::Short => Class::Uncertain,
        class => class,
    }
}

/// Whether an open pulse is as high as the levels say.
fn is_open(volts: i32, [open, _]: [i32; 2]) -> bool {
    volts.saturating_sub(open).saturating_abs().saturating_mul(100) <= open.saturating_mul(OPEN_WITHIN)
}

/// Whether what burned lies nearer to a level than to a boundary.
fn is_near(volts: i32, levels: &Levels, ignited: i32, [_, spark]: [i32; 2]) -> bool {
    let from = |level: i32| volts.saturating_sub(level).saturating_abs();
    // An arc is taken to burn as far below its boundary as a spark burns above it; a short shows anything down to nothing.
    let arc = levels.arc.saturating_mul(2).saturating_sub(spark);
    let level = from(spark).min(from(arc)).min(volts.saturating_abs());
    let boundary = from(levels.short).min(from(levels.arc)).min(from(ignited));
    level <= boundary
}
