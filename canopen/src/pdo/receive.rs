//! RPDO: set points from the bus (CiA 301 7.2.2.3, 1400h, 1600h).

use super::mapping::Map;
use crate::device::SYNCHRONOUS;
use crate::parameters::Pdo;
use crate::{Dictionary, ObjectHandle, Time};

/// What became of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Taken {
    /// Another's identifier, or not in use.
    NotMine,
    /// Shorter than the mapping: not processed.
    Short,
    /// Longer than the mapping: its first bytes were processed.
    Long,
    /// As long as the mapping.
    Exact,
}

/// One RPDO.
///
/// A synchronous one waits twice: for the SYNC after it, and then for the tick that acts on that SYNC. What comes between
/// the two belongs to the next SYNC.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Receive {
    pub map: Map,
    waiting: Option<[u8; 8]>,
    synchronised: Option<[u8; 8]>,
    expected: Option<Time>,
}

impl Receive {
    /// Takes a frame that came at `now`. `open`: synchronous data are still in time (1007h).
    pub fn take(
        &mut self,
        pdo: &Pdo,
        id: u16,
        data: &[u8],
        now: Time,
        open: bool,
        dictionary: &mut dyn Dictionary,
    ) -> Taken {
        if !pdo.valid() || pdo.id & 0x7FF != u32::from(id) {
            return Taken::NotMine;
        }
        if data.len() < self.map.length() {
            return Taken::Short;
        }
        let mut content = [0; 8];
        for (to, from) in content.iter_mut().zip(data) {
            *to = *from;
        }
        self.expected = (pdo.timer != 0).then(|| now.after(u64::from(pdo.timer) * 1000));
        if pdo.transmission > SYNCHRONOUS {
            self.map.deliver(&content, dictionary);
        } else if open {
            self.waiting = Some(content);
        }
        if data.len() > self.map.length() { Taken::Long } else { Taken::Exact }
    }

    /// Sees what the next SYNC would deliver to `place`; `None` when it would change another object.
    pub fn ahead(&self, place: ObjectHandle, dictionary: &dyn Dictionary, value: &mut Option<[u8; 4]>) -> Option<()> {
        match &self.waiting {
            Some(data) => self.map.ahead(data, place, dictionary, value),
            None => Some(()),
        }
    }

    /// SYNC: what has come so far is valid from now on.
    pub fn synchronise(&mut self) {
        self.synchronised = self.waiting.take().or(self.synchronised);
    }

    /// Applies what a SYNC has made valid.
    pub fn apply(&mut self, dictionary: &mut dyn Dictionary) {
        if let Some(data) = self.synchronised.take() {
            self.map.deliver(&data, dictionary);
        }
    }

    /// True once when the PDO has not come within its event timer.
    pub fn late(&mut self, now: Time) -> bool {
        self.expected.take_if(|time| now > *time).is_some()
    }

    /// Forgets what has come: the mapping, the identifier or the state has changed.
    pub fn restart(&mut self) {
        (self.waiting, self.synchronised, self.expected) = (None, None, None);
    }
}
