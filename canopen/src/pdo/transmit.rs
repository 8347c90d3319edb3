//! TPDO: actual values to the bus (CiA 301 7.2.2.2, 1800h, 1A00h).
//!
//! An *event* is a change of any mapped value, the end of the event timer, or the entry into operational.

use super::mapping::Map;
use crate::device::SYNCHRONOUS;
use crate::outbox::Outbox;
use crate::parameters::Pdo;
use crate::{Dictionary, Frame, Time};

/// One TPDO.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Transmit {
    pub map: Map,
    /// Content and time of the last one; none after a restart.
    sent: Option<([u8; 8], Time)>,
    /// SYNCs since the last one; none before counting has begun.
    counted: Option<u8>,
}

impl Transmit {
    /// Sends an event-driven PDO that is due.
    pub fn poll(&mut self, pdo: &Pdo, register: u8, now: Time, dictionary: &dyn Dictionary, out: &mut Outbox) {
        if !pdo.valid() || pdo.transmission <= SYNCHRONOUS {
            return;
        }
        let Some(content) = self.map.collect(register, dictionary) else { return };
        let due = self.sent.is_none_or(|(last, time)| {
            let elapsed = |us| now >= time.after(us);
            let timer = pdo.timer != 0 && elapsed(u64::from(pdo.timer) * 1000);
            elapsed(u64::from(pdo.inhibit) * 100) && (timer || last != content)
        });
        if due {
            self.send(pdo, content, now, out);
        }
    }

    /// SYNC: sends a synchronous PDO whose turn it is.
    pub fn synchronise(
        &mut self,
        pdo: &Pdo,
        counter: Option<u8>,
        register: u8,
        now: Time,
        dictionary: &dyn Dictionary,
        out: &mut Outbox,
    ) {
        if !pdo.valid() || pdo.transmission > SYNCHRONOUS || !self.turn(pdo, counter) {
            return;
        }
        let Some(content) = self.map.collect(register, dictionary) else { return };
        let event = self.sent.is_none_or(|(last, _)| last != content);
        if pdo.transmission != 0 || event {
            self.send(pdo, content, now, out);
        }
    }

    /// Whether this SYNC is one of ours: every one for type 0, every n-th for type n. The one whose counter is the start
    /// value counts as the first; without counter or start value the first one does (CiA 301 7.5.2.37).
    fn turn(&mut self, pdo: &Pdo, counter: Option<u8>) -> bool {
        let early = pdo.start != 0 && counter.is_some_and(|counter| counter != pdo.start);
        let counted = match self.counted {
            None if early => return false,
            counted => counted.unwrap_or(0).saturating_add(1),
        };
        let turn = counted >= pdo.transmission;
        self.counted = Some(if turn { 0 } else { counted });
        turn
    }

    fn send(&mut self, pdo: &Pdo, content: [u8; 8], now: Time, out: &mut Outbox) {
        let frame = content.get(..self.map.length()).and_then(|data| Frame::new(pdo.id as u16 & 0x7FF, data));
        if frame.is_some_and(|frame| out.refresh(frame)) {
            self.sent = Some((content, now));
        }
    }

    /// The next one is an event: the mapping, the identifier or the state has changed.
    pub fn restart(&mut self) {
        (self.sent, self.counted) = (None, None);
    }
}
