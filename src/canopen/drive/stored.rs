//! What 1010h stores of drive and node, and how they begin with what was stored.
//!
//! The list of records is a [`StoredImage`]. Settings and the values of the profile that the table marks as stored are the
//! drive's; the communication parameters are the node's. On loading:
//!
//! | a record | then |
//! | --- | --- |
//! | of an object that is not there or not stored | is passed over, and named |
//! | with another type than its object, or out of its range | gives way to the default, and is named |
//! | at odds with others ([`Settings::build`]) | gives way to the default, and is named |
//! | that is missing | the default is in force, and is named |
//! | of a PDO, and the value gave way, or the mapping is not to be had | the PDO is put out of use ([`Node::boot`]) |
//! | of the communication area, stored as another node-ID | gives way to the default, and is named |
//!
//! commissioning counts no longer when a setting of axis, motor, encoder or polarity is not the stored one, and when an
//! older image or none at all could be read: nobody knows what the newest said of the wiring.

use super::{Drive, codes};
use crate::canopen::objects::{COUNT, Decoded, Item, Row, STORABLE, entry, rows, setting_address_at, setting_kind};
use crate::canopen::{Abort, BootError, Group, Listed, Node, Record, Restored, STORED};
use crate::settings::{Declared, SettingError, Settings, place};
use crate::stored::{Full, LoadReport, Outcome, Putting, ROOM, StoredImage};

/// Settings whose groups, and settings which themselves, commissioning is about.
const CHECKED_GROUPS: [u16; 3] = [group("axis.mass_kg"), group("motor.reversed"), ENCODER];
const CHECKED: [usize; 2] = [place(Settings::KEYS, "gap.reversed"), PASSED];
const PASSED: usize = place(Settings::KEYS, "commission.passed");
/// Group of those that say what a count is.
pub(super) const ENCODER: u16 = group("encoder.count_um");
const LEARNT: usize = place(Settings::KEYS, "axis.breakaway_n");

/// Index of the group of a setting.
const fn group(key: &str) -> u16 {
    Settings::ADDRESSES[place(Settings::KEYS, key)].0
}

// Whatever can be stored at all has room, and in 500 settings more.
const _: () = assert!(Settings::COUNT + STORABLE + STORED <= ROOM);
const _: () = assert!(500 + STORABLE + STORED <= ROOM);

/// What the drive reports of what was stored, until a host acknowledges it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Loss {
    /// Error code of the emergency, and bits of the error register.
    pub code: (u16, u8),
    /// Outcome; sub-index and index of the first value that gave way to its default; how many, up to 255.
    pub detail: [u8; 5],
}

/// What became of what was stored.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Loading {
    outcome: Outcome,
    application: Restored,
    communication: Restored,
}

impl Loading {
    /// 200Bh.
    pub fn report(&self) -> LoadReport {
        let Loading { outcome, application, communication } = *self;
        LoadReport {
            outcome,
            skipped: application.skipped.and(communication.skipped),
            defaulted: application.defaulted.and(communication.defaulted),
        }
    }

    /// Whether nothing is lost any more once a group has been stored as it is now.
    fn is_made_good(&self, group: Group) -> bool {
        let (application, communication) = parts(group);
        let whole = !self.outcome.is_loss() && self.application.defaulted.is_empty();
        (application || whole) && (communication || self.communication.defaulted.is_empty())
    }

    /// What is to be reported of it.
    fn loss(&self) -> Option<Loss> {
        let LoadReport { outcome, defaulted, .. } = self.report();
        let code = codes::loss(outcome, !defaulted.is_empty())?;
        let (index, sub) = defaulted.first.unwrap_or_default();
        let [low, high] = index.to_le_bytes();
        Some(Loss { code, detail: [outcome as u8, sub, low, high, defaulted.count.min(255) as u8] })
    }
}

impl StoredImage {
    /// Keeps what a group of objects is now, instead of what was kept of it.
    ///
    /// # Errors
    /// Records of another program leave no room; this is then not to be stored.
    pub fn keep(&mut self, group: Group, drive: &Drive, node: &Node) -> Result<(), Full> {
        let (application, communication) = parts(group);
        self.distrust(application);
        if group == Group::Bus {
            self.set_bus(node.configured());
        }
        self.remove(application, communication);
        let mut putting = Putting::into(self);
        if application {
            drive.store(&mut putting);
        }
        if communication {
            node.parameters(&mut |record| putting.put(record));
        }
        putting.end()?;
        if let Some(id) = node.bus().node.filter(|_| communication) {
            self.belongs_to(id);
        }
        self.seal();
        Ok(())
    }

    /// Forgets a group of objects.
    pub fn forget(&mut self, group: Group) {
        let (application, communication) = parts(group);
        self.distrust(application);
        self.remove(application, communication);
        self.seal();
    }

    /// What is about to become the newest image continues to say what was lost, until the `application` is stored anew. The
    /// commissioning of an older image does not count from then on either.
    fn distrust(&mut self, application: bool) {
        if self.outcome() == Outcome::Older {
            self.change(Settings::ADDRESSES[PASSED], 0);
        }
        let lost = self.outcome();
        self.set_lost((!application && lost.is_loss()).then_some(lost));
    }
}

/// Whether application and communication records belong to a group.
fn parts(group: Group) -> (bool, bool) {
    match group {
        Group::All => (true, true),
        Group::Application => (true, false),
        Group::Communication => (false, true),
        Group::Bus => (false, false),
    }
}

impl Drive {
    /// What became of what was stored.
    pub fn loaded(&self) -> LoadReport {
        self.loading.report()
    }

    /// Boots a node that waits for it, with the communication parameters that are stored. After [`Drive::restart`], if that
    /// is due.
    ///
    /// # Errors
    /// As [`Node::boot`]; otherwise what became of the stored parameters.
    pub fn boot(&mut self, node: &mut Node, image: &StoredImage) -> Result<LoadReport, BootError> {
        let mut foreign = Listed::default();
        let any = image.communication().next().is_some();
        let restored = if any && image.node() == node.bus().node {
            node.boot(Some(&mut image.communication()), self)?
        } else {
            image.communication().for_each(|record| foreign.add(record.index, record.sub));
            node.boot(None, self)?
        };
        let communication = Restored { defaulted: foreign.and(restored.defaulted), ..restored };
        self.loading = Loading { outcome: image.outcome(), communication, ..self.loading };
        self.note();
        Ok(LoadReport { outcome: image.outcome(), skipped: communication.skipped, defaulted: communication.defaulted })
    }

    /// Ends a store or restore that the drive has ordered; the host is answered. What was lost on loading is so no longer, if
    /// that is what was stored.
    pub fn stored(&mut self, node: &mut Node, group: Group, result: Result<(), Abort>) {
        if result.is_ok() && self.loading.is_made_good(group) {
            self.loss = None;
        }
        node.answer(group, result, self);
    }

    /// Takes over what was stored; `settings` are the defaults.
    pub(super) fn load(&mut self, settings: Settings, image: &StoredImage) -> LoadReport {
        let mut restored = Restored::default();
        let mut doubtful = image.outcome().is_loss();
        let mut settings = match image.application().next() {
            Some(_) => self.restored(settings, image, &mut restored, &mut doubtful),
            None => settings,
        };
        settings.commissioned &= !doubtful;
        // They were built before; the defaults of the declaration are, by a test.
        if self.adopt(settings).is_err() && self.adopt(Settings::default()).is_err() {
            self.settings.commissioned = false;
        }
        self.loading = Loading { outcome: image.outcome(), application: restored, communication: Restored::default() };
        self.note();
        LoadReport { outcome: image.outcome(), skipped: restored.skipped, defaulted: restored.defaulted }
    }

    /// What is to be reported now.
    fn note(&mut self) {
        self.loss = self.loading.loss();
        if self.loss.is_some() {
            // Once more, though it be the same.
            self.reported.1 = None;
        }
    }

    /// Replaces defaults by stored values. `doubtful`: commissioning has to look again.
    fn restored(
        &mut self,
        base: Settings,
        image: &StoredImage,
        restored: &mut Restored,
        doubtful: &mut bool,
    ) -> Settings {
        let defaults = base.words();
        let mut words = defaults;
        let (mut seen, mut seen_rows) = ([false; Settings::COUNT], [false; COUNT]);
        for record in image.application() {
            let Record { index, sub, .. } = record;
            let good = match entry(index, sub).map(|entry| Decoded::at(entry.place)) {
                Ok(Decoded::Setting(field)) => {
                    mark(&mut seen, field.into());
                    let word = stored_word(field, record);
                    if let (Some(word), Some(slot)) = (word, words.get_mut(usize::from(field))) {
                        *slot = word;
                    }
                    *doubtful |= word.is_none() && is_checked(field.into());
                    word.is_some()
                }
                Ok(Decoded::Row(number)) if rows().get(usize::from(number)).is_some_and(Row::is_stored) => {
                    mark(&mut seen_rows, number.into());
                    self.load_row(number, record).is_some()
                }
                _ => {
                    restored.skipped.add(index, sub);
                    continue;
                }
            };
            if !good {
                restored.defaulted.add(index, sub);
            }
        }
        for (place, _) in seen.iter().enumerate().filter(|(_, seen)| !**seen) {
            give_way(place, restored, doubtful);
        }
        for (row, _) in rows().iter().zip(seen_rows).filter(|(row, seen)| row.is_stored() && !seen) {
            let (index, sub) = row.address();
            restored.defaulted.add(index, sub);
        }
        fitting(base, words, &defaults, restored, doubtful)
    }

    /// Takes a stored value of the profile.
    fn load_row(&mut self, number: u16, record: Record) -> Option<()> {
        let row = rows().get(usize::from(number))?;
        let value = row.narrowed(record.value(row.kind())?);
        row.check(value).ok()?;
        self.permits(row.item(), value).ok()?;
        self.set(row.item(), value as i32);
        Some(())
    }

    /// Puts what is to be stored.
    fn store(&self, putting: &mut Putting<'_>) {
        // A row that has just ended may not have left yet.
        let settings = self.technology.without_row(&self.settings);
        for (place, word) in settings.words().into_iter().enumerate() {
            if let (Some((index, sub)), Some((kind, _))) = (setting_address_at(place), setting_kind(place as u16)) {
                putting.put(Record::new(index, sub, kind, word));
            }
        }
        for row in rows().iter().filter(|row| row.is_stored()) {
            let (index, sub) = row.address();
            putting.put(Record::new(index, sub, row.kind(), self.value(row.item()).cast_unsigned()));
        }
    }

    /// Runs other settings, if they fit together.
    pub(super) fn adopt(&mut self, settings: Settings) -> Result<(), SettingError> {
        self.active = settings.build()?;
        self.settings = settings;
        self.configure();
        Ok(())
    }

    /// Whether a value within the range of its object is one that it can have with the others.
    pub(super) fn permits(&self, item: Item, value: i64) -> Result<(), Abort> {
        let number = value as i32;
        match item {
            // Nobody would watch any more.
            Item::AbortOption if value == 0 && self.is_enabled() => Err(Abort::DeviceState),
            Item::QuickStopOption if matches!(value, 3 | 4) => Err(Abort::InvalidValue),
            Item::HomingMethod if crate::motion::Method::from_number(value as i8).is_none() => Err(Abort::InvalidValue),
            Item::ProbeSource1 | Item::ProbeSource2 if !super::probe::is_source(number) => Err(Abort::InvalidValue),
            Item::LimitMin if number > self.value(Item::LimitMax) => Err(Abort::Incompatible),
            Item::LimitMax if number < self.value(Item::LimitMin) => Err(Abort::Incompatible),
            _ => Ok(()),
        }
    }
}

/// The settings of words that fit together: what does not gives way to its default.
fn fitting(
    base: Settings,
    mut words: [u32; Settings::COUNT],
    defaults: &[u32; Settings::COUNT],
    restored: &mut Restored,
    doubtful: &mut bool,
) -> Settings {
    let mut settings = base;
    for _ in 0..Settings::COUNT {
        settings.take_words(&words);
        let at = match settings.build() {
            Ok(_) => return settings,
            Err(SettingError::Conflict { field, .. }) => place_of(field),
            Err(_) => None,
        };
        let slot = at.and_then(|at| Some((at, words.get_mut(at)?, *defaults.get(at)?)));
        let Some((at, word, default)) = slot.filter(|(_, word, default)| **word != *default) else { break };
        *word = default;
        give_way(at, restored, doubtful);
    }
    // Its default is at odds with what others are.
    for (place, _) in words.iter().zip(defaults).enumerate().filter(|(_, (word, default))| word != default) {
        give_way(place, restored, doubtful);
    }
    *doubtful = true;
    base
}

/// A setting takes its default.
fn give_way(place: usize, restored: &mut Restored, doubtful: &mut bool) {
    let (index, sub) = setting_address_at(place).unwrap_or_default();
    restored.defaulted.add(index, sub);
    *doubtful |= is_checked(place);
}

/// The stored word of a setting, if it can have it.
fn stored_word(field: u16, record: Record) -> Option<u32> {
    let (kind, _) = setting_kind(field)?;
    let word = record.value(kind)?;
    Settings::FIELDS.get(usize::from(field))?.kind.admits(word).then_some(word)
}

/// Whether commissioning is about a setting. What it finds of itself is no reason to begin anew: an image of before it was
/// found has the default.
fn is_checked(place: usize) -> bool {
    let in_group = || setting_address_at(place).is_some_and(|(index, _)| CHECKED_GROUPS.contains(&index));
    place != LEARNT && (CHECKED.contains(&place) || in_group())
}

fn mark(seen: &mut [bool], place: usize) {
    seen.get_mut(place).into_iter().for_each(|seen| *seen = true);
}

/// ObjectHandle of a setting that an error names.
fn place_of(key: &str) -> Option<usize> {
    Settings::KEYS.iter().position(|other| *other == key)
}
