//! Identification, 2018h: what the stages have gathered becomes values, and those settings.

use super::Drive;
use crate::canopen::objects::Item;
use crate::canopen::{Abort, Written};
use crate::head::{Change, Command, Evidence, Identified, Reason, Scale, Stage, State, Summed, Weighed};
use crate::settings::{Declared, Settings, place};

/// The settings that it proposes, in the order of [`Found::proposal`].
const PROPOSED: [u16; 6] = [
    place(Settings::KEYS, "axis.resistance_ohm") as u16,
    place(Settings::KEYS, "axis.inductance_mh") as u16,
    place(Settings::KEYS, "axis.force_constant_n_a") as u16,
    place(Settings::KEYS, "axis.mass_kg") as u16,
    place(Settings::KEYS, "axis.breakaway_n") as u16,
    place(Settings::KEYS, "axis.counterbalance_n") as u16,
];

/// 2018h:2 behind the stages of the head.
const FINISHED: i64 = 7;
const ENDED: i64 = 8;

/// 2018h:3.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Why {
    #[default]
    None,
    Held,
    Fault,
    Nothing,
    Refused,
}

/// See the [module](self).
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Found {
    /// One has begun since the start.
    begun: bool,
    /// It has not ended.
    runs: bool,
    /// The newest has come to its end, with a value of everything.
    whole: bool,
    why: Why,
    /// Stages that have shown what they are to show, and what codes and counts stood for.
    stages: u8,
    scale: Option<Scale>,
    values: Identified,
}

impl Found {
    /// Values of [`PROPOSED`], as an object says them.
    fn proposal(&self) -> [f32; 6] {
        let Identified { resistance, inductance, constant, mass, breakaway, counterbalance, .. } = &self.values;
        [
            resistance.value,
            inductance.value * 1e3,
            constant.value,
            mass.value,
            breakaway.value,
            counterbalance.value.max(0.0),
        ]
    }

    /// What an object reads; `stage` is that of the head.
    pub fn number(&self, item: Item, stage: Stage) -> i64 {
        let Identified { resistance, inductance, constant, mass, breakaway, sliding, counterbalance } = &self.values;
        let value = |of: &Weighed, per_unit: f32| (of.value * per_unit) as i64;
        // Never less than it is.
        let off = |of: &Weighed, per_unit: f32| i64::from((of.uncertainty * per_unit) as u32).saturating_add(1);
        let off =
            |of: &Weighed, per_unit: f32| if of.value == 0.0 && of.uncertainty == 0.0 { 0 } else { off(of, per_unit) };
        match item {
            Item::IdentifyStep => match stage {
                Stage::None if self.whole => FINISHED,
                Stage::None if self.begun => ENDED,
                stage => stage as i64,
            },
            Item::IdentifyWhy => self.why as i64,
            Item::FoundResistance => value(resistance, 1e3),
            Item::FoundResistanceOff => off(resistance, 1e3),
            Item::FoundInductance => value(inductance, 1e6),
            Item::FoundInductanceOff => off(inductance, 1e6),
            Item::FoundConstant => value(constant, 1e3),
            Item::FoundConstantOff => off(constant, 1e3),
            Item::FoundMass => value(mass, 1e6),
            Item::FoundMassOff => off(mass, 1e6),
            Item::FoundBreakaway => value(breakaway, 1e3),
            Item::FoundBreakawayOff => off(breakaway, 1e3),
            Item::FoundSliding => value(sliding, 1e3),
            Item::FoundSlidingOff => off(sliding, 1e3),
            Item::FoundCounterbalance => value(counterbalance, 1e3),
            _ => off(counterbalance, 1e3),
        }
    }
}

fn done(ordered: bool) -> Result<Written, Abort> {
    if ordered { Ok(Written::Now) } else { Err(Abort::DeviceState) }
}

/// Stages that gather.
const STAGES: u8 = 3;

impl Drive {
    /// Takes what a head shows that measures itself.
    pub fn evidence(&mut self, evidence: &Evidence) {
        match evidence {
            Evidence::Stage(gathered) => self.gathered(gathered),
            Evidence::Point(point) => self.tuned_at(point),
        }
    }

    fn gathered(&mut self, gathered: &Summed) {
        let scale = Scale::of(&self.active.head.axis);
        self.found.scale = Some(scale);
        if self.found.values.take(gathered, &scale) {
            self.found.stages = self.found.stages.saturating_add(1);
        } else {
            // The rest would be calculated from it.
            self.found.why = Why::Nothing;
            self.command(Command::Hold);
        }
    }

    /// What a change of state means for it.
    pub(super) fn watch_identification(&mut self, change: &Change) {
        if change.reason == Reason::IdentificationStarted {
            self.found = Found { begun: true, runs: true, ..Found::default() };
        } else if self.found.runs && change.from == State::Identifying {
            self.found.runs = false;
            let whole = change.reason == Reason::Identified && self.found.stages == STAGES;
            self.found.whole = whole;
            self.found.why = match (self.found.why, change.reason) {
                (Why::None, _) if whole => Why::None,
                (Why::None, Reason::Held) => Why::Held,
                (Why::None, Reason::Identified) => Why::Nothing,
                (Why::None, _) => Why::Fault,
                (why, _) => why,
            };
        }
    }

    /// 2018h:1.
    pub(super) fn identify(&mut self, value: i64) -> Result<Written, Abort> {
        match value {
            0 if self.found.runs => done(self.command(Command::Hold)),
            0 => Ok(Written::Now),
            1 => done(self.acts() && !self.is_positioned() && self.command(Command::Identify)),
            _ => self.apply_found(),
        }
    }

    /// Makes settings of what was found: all or none.
    fn apply_found(&mut self) -> Result<Written, Abort> {
        // Calibrated anew since, it means something else.
        let still = self.found.scale == Some(Scale::of(&self.active.head.axis));
        if !self.found.whole || !still {
            return Err(Abort::DeviceState);
        }
        let mut words = [(0, 0); PROPOSED.len()];
        for (word, (field, value)) in words.iter_mut().zip(PROPOSED.into_iter().zip(self.found.proposal())) {
            *word = (field, value.to_bits());
        }
        let passed = self.settings.commissioned;
        let written = self.write_words(&words);
        self.found.why = if written.is_ok() { Why::None } else { Why::Refused };
        if written.is_ok() && passed {
            // What the guided check would look at again is what was measured: direction and stroke are as it has found them.
            self.settings.commissioned = true;
            self.active.head.commissioned = true;
        }
        written
    }
}
