//! A table of technology, run row after row: 201Ch.
//!
//! A host writes rows, has them checked, and gives the depth of the hole as a set point of profile position, as without a table. The
//! drive has the head erode to the depth of each row, the last leaves nothing; only then is the target reached. Between two
//! rows the head rests at the end of its path with pulses off: the next row's settings come into force as a host's write does, in all
//! tasks, and where `technology.answer_s` asks for it the generator's answer is waited for. Each row begins as any erosion, with a
//! seek: the open-circuit voltage of its pulses is measured.
//!
//! Whatever ends an erosion ends the row: a hold, a halt, a stop, a fault. Then the settings of before are back. What starts
//! the erosion again, to the same depth, starts the row again that was not finished.

use super::{Drive, Mode, clamp32, codes};
use crate::canopen::objects::{Item, setting_address_at, setting_at};
use crate::canopen::{Abort, Written};
use crate::head::{Command, Contradiction, Refused, State};
use crate::settings::Settings;
use crate::technology::{Pulse, Table, Why, Words, Wrong, leave};
use crate::units::Nanometres;

/// Time at rest at the end of a row, ms: by then the change of state that ended it, with its reason, has arrived.
const RESTS_MS: u32 = 5;

/// 201Ch:6.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Phase {
    /// No table is in use.
    #[default]
    Unused = 0,
    /// Its rows are checked, one a millisecond.
    Checks = 1,
    /// The next set point begins with the row of 201Ch:5.
    Ready = 2,
    /// Pulses are off; the settings of the row are on their way to the tasks.
    Changes = 3,
    /// Pulses are off until the generator has the row.
    Waits = 4,
    /// The head erodes to the depth of the row.
    Runs = 5,
    /// Every row has come to its end.
    Done = 6,
    /// Ended before the end of a row.
    Interrupted = 7,
    /// The generator has not answered in time.
    Unanswered = 8,
    /// The settings of the row do not go with those that have changed since the table was checked.
    Refused = 9,
}

/// See the [module](self).
#[derive(Debug, Default)]
pub(super) struct Technology {
    table: Table,
    /// Setting whose value comes next, by its place.
    field: Option<u16>,
    phase: Phase,
    /// The row under way, or the one to begin with, from 1; 0 without a table.
    row: u8,
    wrong: Option<Wrong>,
    /// Depth of the hole as the host has given it.
    target: i32,
    /// Depth that was appended to a path last, and which path that was.
    appended: Option<(i32, u32)>,
    /// Segments that had been appended when the row was interrupted.
    segments: u32,
    /// The settings of the row are in force, or on their way.
    entered: bool,
    /// What they have replaced; to be put back.
    replaced: Words,
    leaves: bool,
    /// Milliseconds in this phase, or at rest at the end of the row.
    waited: u32,
}

impl Technology {
    /// Set points are depths of holes that are made row after row.
    pub fn in_use(&self) -> bool {
        self.phase as u8 >= Phase::Ready as u8
    }

    /// Rows are under way.
    pub fn is_busy(&self) -> bool {
        matches!(self.phase, Phase::Changes | Phase::Waits | Phase::Runs)
    }

    /// Rows under way lead there.
    pub fn leads_to(&self, target: i32) -> bool {
        self.target == target
    }

    /// A row was begun, and there is something to go on with.
    pub fn is_interrupted(&self) -> bool {
        matches!(self.phase, Phase::Interrupted | Phase::Unanswered | Phase::Refused)
    }

    /// Rows follow the one under way.
    pub fn has_more(&self) -> bool {
        self.is_busy() && self.row < self.table.len()
    }

    /// Nothing is known any more.
    pub fn forget(&mut self) {
        self.table.clear();
        self.replaced.clear();
        (self.field, self.phase, self.row, self.wrong, self.appended) = (None, Phase::Unused, 0, None, None);
        (self.entered, self.leaves, self.waited) = (false, false, 0);
    }

    /// A host has written these settings: they stay when the row ends.
    pub fn keep(&mut self, written: &[(u16, u32)]) {
        self.replaced.retain(|(field, _)| !written.iter().any(|(kept, _)| kept == field));
    }

    /// Settings without those of the row.
    pub fn without_row(&self, settings: &Settings) -> Settings {
        let mut without = *settings;
        leave(&mut without, &self.replaced);
        without
    }

    fn enter(&mut self, phase: Phase) {
        (self.phase, self.waited) = (phase, 0);
    }

    /// What the generator is to be set to.
    fn pulse(&self) -> Pulse {
        self.table.row(self.row).filter(|_| self.in_use()).map_or_else(Pulse::default, |row| row.pulse)
    }
}

impl Drive {
    /// What the generator is to be set to for the row under way, or to begin with; all 0 without a table.
    pub fn pulse(&self) -> Pulse {
        self.technology.pulse()
    }

    /// How far the table is, and its row.
    pub fn technology(&self) -> (Phase, u8) {
        (self.technology.phase, self.technology.row)
    }

    /// A write to 201Ch.
    fn write_technology(&mut self, item: Item, value: i64) -> Result<(), Abort> {
        let number = value as u8;
        if item == Item::TechnologyUse {
            return self.use_technology(value == 1);
        }
        let technology = &mut self.technology;
        if item == Item::TechnologyRow {
            let free = technology.in_use() && !technology.is_busy();
            let known = technology.table.row(number).is_some();
            return match (free, known) {
                (true, true) => {
                    (technology.row, technology.appended) = (number, None);
                    technology.enter(Phase::Ready);
                    Ok(())
                }
                (true, false) => Err(Abort::InvalidValue),
                _ => Err(Abort::DeviceState),
            };
        }
        if technology.phase != Phase::Unused {
            return Err(Abort::DeviceState);
        }
        if item == Item::RowBegin {
            (technology.field, technology.wrong) = (None, None);
            return if technology.table.begin(number) { Ok(()) } else { Err(Abort::InvalidValue) };
        }
        let row = technology.table.last_mut().ok_or(Abort::DeviceState)?;
        let word = value as u32;
        match item {
            Item::RowLeaves => row.leaves_nm = word,
            Item::RowOnTime => row.pulse.on_ns = word,
            Item::RowOffTime => row.pulse.off_ns = word,
            Item::RowCurrent => row.pulse.current_ma = word,
            Item::RowPolarity => row.pulse.polarity = number,
            Item::RowSetting => {
                technology.field = setting_at((word >> 8) as u16, number);
                return technology.field.map(|_| ()).ok_or(Abort::InvalidValue);
            }
            _ => {
                let field = technology.field.take().ok_or(Abort::DeviceState)?;
                return row.words.push((field, word)).map_err(|_| Abort::OutOfMemory);
            }
        }
        Ok(())
    }

    /// Has the table checked and takes it into use, or out of it.
    fn use_technology(&mut self, uses: bool) -> Result<(), Abort> {
        let technology = &mut self.technology;
        if technology.is_busy() || technology.leaves {
            return Err(Abort::DeviceState);
        }
        (technology.wrong, technology.appended) = (None, None);
        technology.row = u8::from(uses);
        technology.enter(if uses { Phase::Checks } else { Phase::Unused });
        Ok(())
    }

    /// Goes on with the table, once a millisecond.
    pub(super) fn watch_technology(&mut self) {
        let technology = &mut self.technology;
        technology.waited = technology.waited.saturating_add(1);
        if technology.is_busy() && !(self.erodes() && self.moves() && self.mode == Mode::ProfilePosition) {
            self.stop_row(Phase::Interrupted);
        }
        if self.technology.leaves {
            self.leave_row();
        }
        match self.technology.phase {
            Phase::Checks => self.check_row(),
            Phase::Changes => self.change_row(),
            Phase::Waits => self.await_generator(),
            Phase::Runs if self.fresh => self.watch_row(),
            _ => {}
        }
    }

    fn check_row(&mut self) {
        let technology = &mut self.technology;
        let row = technology.row;
        match technology.table.check(row, &self.settings) {
            Ok(()) if row < technology.table.len() => technology.row = row.saturating_add(1),
            Ok(()) => {
                technology.row = 1;
                technology.enter(Phase::Ready);
            }
            Err(wrong) => {
                if let Some((index, sub)) = wrong.field.and_then(|field| setting_address_at(field.into())) {
                    (self.wrong, self.contradiction) = (Some((index, sub, wrong.rule)), Contradiction::default());
                }
                (technology.wrong, technology.row) = (Some(wrong), 0);
                technology.enter(Phase::Unused);
            }
        }
    }

    /// Erodes to a depth row after row, from the row on that a host has written or that was not finished.
    pub(super) fn begin_rows(&mut self, target: i32) -> bool {
        let technology = &mut self.technology;
        if technology.is_busy() {
            self.refuses(codes::refused(Refused::PathActive));
            return false;
        }
        if technology.is_interrupted() && technology.target != target {
            // Another hole.
            technology.row = 1;
        }
        technology.target = target;
        self.begin_row();
        true
    }

    /// The same to the depth of before, if rows were interrupted.
    pub(super) fn resume_rows(&mut self) -> bool {
        let resumes = self.technology.is_interrupted();
        if resumes {
            self.set_points.lead_to(self.technology.target);
            self.begin_row();
        }
        resumes
    }

    fn begin_row(&mut self) {
        self.set(Item::GeneratorAnswer, 0);
        // What was replaced before is put back with that.
        (self.technology.entered, self.technology.leaves) = (false, false);
        self.technology.enter(Phase::Changes);
        self.resume.row(self.technology.row.into());
    }

    /// The row's settings go to the tasks, as soon as nothing else is on its way there.
    // In a frame of its own: settings, and what is built of them.
    #[inline(never)]
    fn change_row(&mut self) {
        if self.configuring || self.stale {
            return;
        }
        let technology = &mut self.technology;
        if technology.entered {
            let row = technology.table.row(technology.row);
            // The last word counts, of a setting that is there twice.
            let runs = |&(field, _): &(u16, u32)| {
                let last = row.and_then(|row| row.words.iter().rfind(|word| word.0 == field));
                last.is_some_and(|word| crate::settings::Declared::word(&self.settings, field.into()) == Some(word.1))
            };
            let all = row.is_some_and(|row| row.words.iter().all(runs));
            if all {
                technology.enter(Phase::Waits);
            } else {
                self.stop_row(Phase::Refused);
            }
            return;
        }
        let mut pending = technology.without_row(&self.settings);
        let replaced = technology.table.row(technology.row).map(|row| row.enter(&mut pending));
        let Some(replaced) = replaced else { return };
        if pending == self.settings {
            (self.technology.replaced, self.technology.entered) = (replaced, true);
            return;
        }
        let Ok(active) = pending.build() else {
            self.stop_row(Phase::Refused);
            return;
        };
        if self.configure() {
            (self.settings, self.active) = (pending, active);
            (self.technology.replaced, self.technology.entered) = (replaced, true);
        }
    }

    /// The settings of before the table go to the tasks again.
    #[inline(never)]
    fn leave_row(&mut self) {
        if self.configuring || self.stale {
            return;
        }
        let pending = self.technology.without_row(&self.settings);
        let Ok(active) = pending.build() else {
            // A host has changed what goes with the row alone: it stays.
            self.technology.leaves = false;
            self.technology.replaced.clear();
            return;
        };
        if pending == self.settings || self.configure() {
            (self.settings, self.active) = (pending, active);
            self.technology.leaves = false;
            self.technology.replaced.clear();
        }
    }

    fn await_generator(&mut self) {
        let longest_ms = (self.settings.technology_answer * 1000.0) as u32;
        let answered = self.value(Item::GeneratorAnswer) == i32::from(self.technology.row);
        if longest_ms == 0 || answered {
            self.erode_row();
        } else if self.technology.waited > longest_ms {
            self.stop_row(Phase::Unanswered);
        }
    }

    /// Depth at which the row ends.
    fn row_depth(&self) -> i32 {
        let leaves_nm = self.technology.table.row(self.technology.row).map_or(0, |row| row.leaves_nm);
        let counts = self.active.head.axis.counts(Nanometres(leaves_nm.into())).round();
        self.technology.target.saturating_sub(clamp32(counts))
    }

    fn erode_row(&mut self) {
        let (depth, path) = (self.row_depth(), self.status.paths);
        // Held before, it is on its way there.
        let before = &self.technology;
        let appended = before.appended == Some((depth, path)) && before.segments == self.appended;
        let sent = (appended || self.command(Command::MoveTo(self.place(depth)))) && self.command(Command::Start);
        self.technology.appended = sent.then_some((depth, path));
        self.stopped_by = 0;
        if sent {
            self.technology.enter(Phase::Runs);
        } else {
            self.stop_row(Phase::Interrupted);
        }
    }

    fn watch_row(&mut self) {
        let state = self.status.state;
        if state.works() {
            self.technology.waited = 0;
        } else if state != State::Done {
            self.stop_row(Phase::Interrupted);
        } else if self.technology.waited >= RESTS_MS {
            self.technology.appended = None;
            // A hole that has come out on the other side has no bottom to finish.
            if self.technology.has_more() && self.stopped_by != 4 {
                self.technology.row = self.technology.row.saturating_add(1);
                self.begin_row();
            } else {
                self.set_points.led_to(self.row_depth());
                self.stop_row(Phase::Done);
                self.technology.row = 1;
            }
        }
    }

    /// No row is under way any more: the settings of before are brought back.
    fn stop_row(&mut self, phase: Phase) {
        self.technology.enter(phase);
        self.technology.leaves = true;
        self.technology.segments = self.appended;
    }

    /// What an object of 201Ch reads.
    pub(super) fn technology_number(&self, item: Item) -> i64 {
        let technology = &self.technology;
        let Pulse { on_ns, off_ns, current_ma, polarity } = technology.pulse();
        match item {
            Item::TechnologyRows => technology.table.len().into(),
            Item::TechnologyUse => (technology.phase != Phase::Unused).into(),
            Item::TechnologyWhy => technology.wrong.map_or(Why::No, |wrong| wrong.why) as i64,
            Item::TechnologyWrongRow => technology.wrong.map_or(0, |wrong| wrong.row).into(),
            Item::TechnologyRow => technology.row.into(),
            Item::TechnologyState => technology.phase as i64,
            Item::PulseOnTime => on_ns.into(),
            Item::PulseOffTime => off_ns.into(),
            Item::PulseCurrent => current_ma.into(),
            _ => polarity.into(),
        }
    }

    /// A write to 201Ch, for the dictionary.
    pub(super) fn technology_written(&mut self, item: Item, value: i64) -> Result<Written, Abort> {
        self.write_technology(item, value)?;
        self.set(item, value as i32);
        Ok(Written::Now)
    }
}
