//! The hole under the electrode, kept over a reset and a power cut, and gone on with: 201Ah.
//!
//! A hole begins when a host says where its surface is (2011h:11). From then on its deepest place and what its counts are from are
//! part of the [`Backup`], which a task of low priority writes ([`crate::backup`]). Where the counts lose their meaning, by a reset, a
//! power cut, a new or a lost home, the hole *waits*: nobody knows any more where it is until the head was homed and has
//! touched what it knows, and a host has said what that was.
//!
//! | home | touched | position of the hole |
//! | --- | --- | --- |
//! | the same index mark | bottom, surface beside the hole or reference | as before; the touch must agree with it |
//! | anything else that is the same | surface beside the hole or reference | moved by what the touch says; the face is taken for the one before |
//!
//! A touch agrees if it is not above the place that is expected by more than `resume.agree_um`, and not deeper than a gap or the wear
//! explains.

use super::{Drive, Item, clamp32};
use crate::backup::{Backup, Found, Hole, HomeFound, Work};
use crate::canopen::Time;
use crate::gap::pulses::Class;
use crate::head::{Fault, State};
use crate::motion::Method;
use crate::settings::{Declared, Settings};
use crc::{CRC_32_ISO_HDLC, Crc};

const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// Why a hole is not gone on with; the number is the one in 201Ah:3.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Refusal {
    #[default]
    No = 0,
    NoHole = 1,
    Damaged = 2,
    NotHomed = 3,
    HomedOtherwise = 4,
    OtherScale = 5,
    EncoderLost = 6,
    NotTouched = 7,
    NotByMark = 8,
    TooHigh = 9,
    TooDeep = 10,
    NoReference = 11,
    NotAtRest = 12,
    CarriedOtherwise = 13,
}

/// See the [module](self).
#[derive(Debug, Default)]
pub(super) struct Resume {
    /// The hole under way.
    begun: Option<Hole>,
    /// One whose counts mean nothing until it is gone on with.
    waits: Option<Hole>,
    damaged: bool,
    refused: Refusal,
    /// The homing under way, and the one that the counts are from.
    homes: HomeFound,
    home: HomeFound,
    work: Work,
    /// Pulses, arcs and shorts counted before, and the time before, us.
    seen: Option<[u32; 3]>,
    /// Milliseconds, wrapping.
    rounds: u8,
    before: Option<u64>,
}

impl Resume {
    fn hole(&self) -> Option<Hole> {
        self.begun.or(self.waits)
    }

    /// A homing is ordered.
    pub fn homes(&mut self, method: Method, offset: i32) {
        self.homes = HomeFound { method: method as i8, offset };
    }

    /// It has found its place.
    pub fn homed(&mut self) {
        self.home = self.homes;
    }

    /// An erosion has come to its end.
    pub fn ended(&mut self) {
        self.work.holes = self.work.holes.saturating_add(1);
    }

    /// A host has said where the surface of the hole is that it begins, or that there is none.
    pub fn surface(&mut self, surface: Option<i64>, scale: u32) {
        self.begun = surface.map(|surface| Hole {
            surface,
            deepest: surface,
            target: surface,
            home: self.home,
            scale,
            ..Hole::default()
        });
        if surface.is_some() {
            (self.waits, self.damaged, self.refused) = (None, false, Refusal::No);
        }
    }

    /// The host's number of a row, if there is a hole under way.
    pub fn row(&mut self, row: u16) -> bool {
        self.begun.as_mut().map(|hole| hole.row = row).is_some()
    }
}

/// Whether a homing method finds an index mark: the same count each time.
fn is_mark(home: HomeFound) -> bool {
    use Method::{LowerLimitAndMark, MarkAbove, MarkBelow, UpperLimitAndMark};
    let method = Method::from_number(home.method);
    matches!(method, Some(UpperLimitAndMark | LowerLimitAndMark | MarkAbove | MarkBelow))
}

impl Drive {
    /// Takes what was kept when the head was switched on. After [`Drive::restart`].
    pub fn recall(&mut self, found: Found) {
        match found {
            Found::Nothing => {}
            Found::Damaged => self.resume.damaged = true,
            Found::Kept(Backup { hole, work }) => (self.resume.waits, self.resume.work) = (hole, work),
        }
    }

    /// What is to be kept now.
    pub fn backup(&self) -> Backup {
        Backup { hole: self.resume.hole(), work: self.resume.work }
    }

    /// Checksum of the settings that say what a count is.
    pub(super) fn scale(&self) -> u32 {
        let mut digest = CRC.digest();
        for (place, (index, _)) in Settings::ADDRESSES.iter().enumerate() {
            if *index == super::stored::ENCODER {
                digest.update(&self.settings.word(place).unwrap_or(0).to_le_bytes());
            }
        }
        digest.finalize()
    }

    /// Counts work and follows the hole, once a millisecond.
    pub(super) fn watch_hole(&mut self) {
        self.count_pulses();
        let status = &self.status;
        let work = &mut self.resume.work;
        if status.state.works() {
            work.eroding_ms = work.eroding_ms.saturating_add(1);
        }
        self.follow_hole();
    }

    /// Counts the pulses of the last 16 ms: their counters wrap much later.
    fn count_pulses(&mut self) {
        self.resume.rounds = self.resume.rounds.wrapping_add(1);
        if !self.resume.rounds.is_multiple_of(16) {
            return;
        }
        let status = &self.status;
        let count = |class| status.gap.pulses.class(class);
        let (arcs, shorts) = (count(Class::Arc), count(Class::Short));
        let others = [Class::Open, Class::Spark, Class::Uncertain].map(count);
        let pulses = others.into_iter().fold(arcs.wrapping_add(shorts), u32::wrapping_add);
        let now = [pulses, arcs, shorts];
        let [pulses, arcs, shorts] = self.resume.seen.replace(now).map_or([0; 3], |before| {
            let mut new = now;
            new.iter_mut().zip(before).for_each(|(now, before)| *now = now.wrapping_sub(before));
            new
        });
        let work = &mut self.resume.work;
        work.pulses = work.pulses.saturating_add(pulses.into());
        work.arcs = work.arcs.saturating_add(arcs.into());
        work.shorts = work.shorts.saturating_add(shorts.into());
    }

    fn follow_hole(&mut self) {
        let status = &self.status;
        let Some(mut hole) = self.resume.begun else { return };
        hole.encoder_lost |= matches!(status.fault, Some(Fault::EncoderLost | Fault::PolarityWrong));
        let Some(surface) = self.datum.kept() else {
            (self.resume.begun, self.resume.waits) = (None, Some(hole));
            return;
        };
        hole.surface = surface;
        (hole.reference, hole.wear) = self.datum.reference();
        hole.state = status.state as u8;
        if status.state.works() {
            (hole.path, hole.carried) = (status.path.round(), status.carried);
            hole.target = i64::from(self.value(Item::TargetPosition)).saturating_add(self.datum.offset());
            if status.state != State::Seeking {
                hole.deepest = hole.deepest.max(status.position);
            }
        }
        self.resume.begun = Some(hole);
    }

    /// Time goes on.
    pub(super) fn count_time(&mut self, now: Time) {
        let before = self.resume.before.get_or_insert(now.0);
        let passed = now.0.saturating_sub(*before);
        if passed < 1000 {
            return;
        }
        let ms = passed / 1000;
        *before = before.saturating_add(ms.saturating_mul(1000));
        self.resume.work.on_ms = self.resume.work.on_ms.saturating_add(ms);
    }

    /// Goes on with the hole that waits: 1 what was touched last is its bottom, 2 the surface of the work beside it, 3 the
    /// reference; 0 gives it up. False, with a reason, where its place is not known.
    pub(super) fn go_on(&mut self, touched: i64) -> bool {
        if touched == 0 {
            (self.resume.waits, self.resume.damaged, self.resume.refused) = (None, false, Refusal::No);
            return true;
        }
        match self.place_hole(touched) {
            Ok(hole) => {
                self.datum.recall(&hole);
                (self.resume.begun, self.resume.waits, self.resume.refused) = (Some(hole), None, Refusal::No);
                true
            }
            Err(refusal) => {
                self.resume.refused = refusal;
                false
            }
        }
    }

    /// The hole that waits, in the counts of now.
    fn place_hole(&self, touched: i64) -> Result<Hole, Refusal> {
        let Resume { waits, damaged, home, .. } = &self.resume;
        let hole = waits.ok_or(if *damaged { Refusal::Damaged } else { Refusal::NoHole })?;
        if hole.encoder_lost {
            return Err(Refusal::EncoderLost);
        }
        if hole.scale != self.scale() {
            return Err(Refusal::OtherScale);
        }
        if !self.may_shift() {
            return Err(Refusal::NotAtRest);
        }
        if !self.status.homed {
            return Err(Refusal::NotHomed);
        }
        let marked = is_mark(hole.home);
        if hole.home.method != home.method || marked && hole.home.offset != home.offset {
            return Err(Refusal::HomedOtherwise);
        }
        if hole.carried != self.status.carried {
            return Err(Refusal::CarriedOtherwise);
        }
        let at = self.datum.surface().ok_or(Refusal::NotTouched)?;
        let counts = |um: f32| (um * self.active.head.axis.counts_per_um) as i64;
        let settings = &self.settings;
        let (expected, deeper) = match touched {
            1 if !marked => return Err(Refusal::NotByMark),
            1 => (hole.deepest, settings.resume_gap),
            2 => (hole.surface, settings.resume_wear),
            _ => (hole.reference.ok_or(Refusal::NoReference)?.saturating_add(hole.wear), settings.resume_wear),
        };
        let beyond = at.saturating_sub(expected);
        if !marked {
            let moved = |place: i64| place.saturating_add(beyond);
            return Ok(Hole {
                surface: moved(hole.surface),
                deepest: moved(hole.deepest),
                target: moved(hole.target),
                reference: hole.reference.map(moved),
                ..hole
            });
        }
        if beyond < counts(settings.resume_agree).saturating_neg() {
            return Err(Refusal::TooHigh);
        }
        if beyond > counts(deeper) {
            return Err(Refusal::TooDeep);
        }
        let worn = if touched == 3 { beyond } else { 0 };
        Ok(Hole { wear: hole.wear.saturating_add(worn), ..hole })
    }

    /// What an object of 201Ah reads.
    pub(super) fn resume_number(&self, item: Item) -> i64 {
        let Resume { begun, waits, damaged, refused, work, .. } = &self.resume;
        let hole = self.resume.hole().unwrap_or_default();
        let thousands = |number: u64| i64::from(u32::try_from(number / 1000).unwrap_or(u32::MAX));
        match item {
            Item::KeptState => match (begun, waits, damaged) {
                (Some(_), ..) => 2,
                (_, Some(_), _) => 1,
                (.., true) => 3,
                _ => 0,
            },
            Item::GoOnRefused => *refused as i64,
            Item::KeptDepth => clamp32(hole.deepest.saturating_sub(hole.surface)).into(),
            Item::KeptTarget => clamp32(hole.target.saturating_sub(hole.surface)).into(),
            Item::KeptPath => clamp32(hole.path).into(),
            Item::KeptRow => hole.row.into(),
            Item::KeptHome => hole.home.method.into(),
            Item::KeptHeadState => hole.state.into(),
            Item::WorkOn => thousands(work.on_ms),
            Item::WorkEroding => thousands(work.eroding_ms),
            Item::WorkPulses => thousands(work.pulses),
            Item::WorkArcs => thousands(work.arcs),
            Item::WorkShorts => thousands(work.shorts),
            _ => work.holes.into(),
        }
    }
}
