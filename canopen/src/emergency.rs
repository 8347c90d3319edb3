//! Emergency objects, the error register and the list of past errors (CiA 301 7.2.7, 1001h, 1003h, 1014h, 1015h).
//!
//! A *cause* is an error of communication that the node itself sees: it is reported once when it appears, and once more as
//! gone. What the device reports is kept separately, with bits of its own in the error register.

use super::device::{HISTORY, INVALID};
use super::outbox::Outbox;
use super::parameters::Parameters;
use super::{Frame, Time};
use heapless::Deque;

/// Emergencies that can wait to be sent.
const WAITING: usize = 8;
/// Error register: any error.
const GENERIC: u8 = 1 << 0;
/// Error register: an error of communication.
const COMMUNICATION: u8 = 1 << 4;

/// An error of communication.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Cause {
    /// An RPDO was shorter than its mapping.
    Short(u8),
    /// An RPDO was longer than its mapping.
    Long(u8),
    /// An RPDO did not come in time.
    Late(u8),
    /// An entry of 1016h lost its heartbeat.
    Heartbeat(u8),
    /// SYNC with or without a counter, contrary to 1019h.
    SyncLength,
    /// No SYNC for one and a half periods of 1006h.
    SyncLost,
    /// Frames came faster than they were taken.
    Overrun,
    /// The controller has become error passive.
    Passive,
    /// The controller had to leave the bus.
    BusOff,
    /// Events inside the device were lost.
    Events,
}

impl Cause {
    /// Emergency error code (CiA 301 7.2.7.1, table 26), bit among the causes, and the number that says which.
    const fn facts(self) -> (u16, u32, u8) {
        let (code, group, which) = match self {
            Self::Short(pdo) => (0x8210, 0, pdo),
            Self::Long(pdo) => (0x8220, 4, pdo),
            Self::Late(pdo) => (0x8250, 8, pdo),
            Self::Heartbeat(entry) => (0x8130, 12, entry),
            Self::SyncLength => (0x8240, 16, 0),
            Self::SyncLost => (0x8100, 17, 0),
            Self::Overrun => (0x8110, 18, 0),
            Self::Passive => (0x8120, 19, 0),
            Self::BusOff => (0x8140, 20, 0),
            Self::Events => (0x6100, 21, 0),
        };
        (code, 1 << (group + (which & 3)), which)
    }
}

/// Error codes of the node's own emergencies.
pub const ERRORS: &[u16] = &[
    Cause::Events.facts().0,
    Cause::SyncLost.facts().0,
    Cause::Overrun.facts().0,
    Cause::Passive.facts().0,
    Cause::Heartbeat(0).facts().0,
    Cause::BusOff.facts().0,
    Cause::Short(0).facts().0,
    Cause::Long(0).facts().0,
    Cause::SyncLength.facts().0,
    Cause::Late(0).facts().0,
];

/// Errors present, past, and not yet reported.
#[derive(Clone, Debug, Default)]
pub(super) struct Emergency {
    causes: u32,
    device: u8,
    history: Deque<u32, HISTORY>,
    waiting: Deque<[u8; 8], WAITING>,
    allowed: Time,
}

impl Emergency {
    /// 1001h.
    pub fn register(&self) -> u8 {
        let communication = if self.causes == 0 { 0 } else { COMMUNICATION };
        let register = self.device | communication;
        if register == 0 { 0 } else { register | GENERIC }
    }

    /// Errors in 1003h.
    pub fn remembered(&self) -> u8 {
        self.history.len() as u8
    }

    /// An entry of 1003h: 1 is the newest.
    pub fn past(&self, sub: u8) -> Option<u32> {
        self.history.get(usize::from(sub).checked_sub(1)?).copied()
    }

    /// Forgets the past: 0 written to 1003h.
    pub fn forget(&mut self) {
        self.history.clear();
    }

    /// A cause has appeared.
    #[inline(never)]
    pub fn raise(&mut self, cause: Cause) {
        let (code, bit, which) = cause.facts();
        if self.causes & bit == 0 {
            self.causes |= bit;
            self.report(code, [which.wrapping_add(1), 0, 0, 0, 0]);
        }
    }

    /// A cause is gone.
    #[inline(never)]
    pub fn clear(&mut self, cause: Cause) {
        let (_, bit, _) = cause.facts();
        if self.causes & bit != 0 {
            self.causes &= !bit;
            self.queue(0, [0; 5]);
        }
    }

    /// Whether a cause is there.
    pub fn set(&mut self, cause: Cause, present: bool) {
        if present { self.raise(cause) } else { self.clear(cause) }
    }

    /// The device reports an error and the bits of the error register that go with it.
    pub fn device(&mut self, code: u16, register: u8, detail: [u8; 5]) {
        self.device |= register | GENERIC;
        self.report(code, detail);
    }

    /// An error of the device is gone; what remains has these bits of the error register, 0 for nothing.
    pub fn device_well(&mut self, remaining: u8) {
        if self.device != 0 {
            self.device = if remaining == 0 { 0 } else { remaining | GENERIC };
            self.queue(0, [0; 5]);
        }
    }

    /// Reset communication: its errors are gone, those of the device remain.
    pub fn restart(&mut self) {
        self.causes = 0;
        self.waiting.clear();
    }

    #[inline(never)]
    fn report(&mut self, code: u16, detail: [u8; 5]) {
        // Additional information, the high half, is the first two bytes of the detail.
        let [low, high, ..] = detail;
        let entry = u32::from(code) | u32::from(low) << 16 | u32::from(high) << 24;
        while self.history.push_front(entry).is_err() {
            self.history.pop_back();
        }
        self.queue(code, detail);
    }

    #[inline(never)]
    fn queue(&mut self, code: u16, [a, b, c, d, e]: [u8; 5]) {
        let [low, high] = code.to_le_bytes();
        let emergency = [low, high, self.register(), a, b, c, d, e];
        while self.waiting.push_back(emergency).is_err() {
            // The newest state counts; 1003h remembers the rest.
            self.waiting.pop_front();
        }
    }

    /// Sends what waits, no faster than the inhibit time allows.
    pub fn poll(&mut self, parameters: &Parameters, now: Time, out: &mut Outbox) {
        if parameters.emergency_id & INVALID != 0 {
            self.waiting.clear();
        }
        while self.send(parameters, now, out) {}
    }

    fn send(&mut self, parameters: &Parameters, now: Time, out: &mut Outbox) -> bool {
        let Some(content) = self.waiting.front() else { return false };
        let frame = Frame::full(parameters.emergency_id as u16, *content);
        let sent = now >= self.allowed && out.put(frame);
        if sent {
            self.waiting.pop_front();
            self.allowed = now.after(u64::from(parameters.emergency_inhibit) * 100);
        }
        sent
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::DEVICE;

    fn sent(emergency: &mut Emergency, parameters: &Parameters, now: u64) -> std::vec::Vec<std::vec::Vec<u8>> {
        let mut out = Outbox::default();
        emergency.poll(parameters, Time(now), &mut out);
        std::iter::from_fn(|| out.take()).map(|frame| frame.data().to_vec()).collect()
    }

    #[test]
    fn a_cause_is_reported_once_and_its_end_once() {
        let mut emergency = Emergency::default();
        let parameters = Parameters::new(&DEVICE, 1);
        emergency.raise(Cause::Short(2));
        emergency.raise(Cause::Short(2));
        assert_eq!(emergency.register(), 0x11);
        emergency.clear(Cause::Short(2));
        emergency.clear(Cause::Short(2));
        assert_eq!(emergency.register(), 0);
        let frames = sent(&mut emergency, &parameters, 0);
        assert_eq!(frames, [[0x10, 0x82, 0x11, 3, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0, 0, 0]]);
        assert_eq!((emergency.remembered(), emergency.past(1)), (1, Some(0x0003_8210)));
    }

    #[test]
    fn the_error_register_shows_what_remains() {
        let mut emergency = Emergency::default();
        emergency.raise(Cause::SyncLength);
        emergency.device(0x3210, 1 << 2, [0; 5]);
        assert_eq!(emergency.register(), 0x15);
        emergency.clear(Cause::SyncLength);
        assert_eq!(emergency.register(), 0x05);
        emergency.device(0x6320, 1 << 5, [0; 5]);
        assert_eq!(emergency.register(), 0x25);
        emergency.device_well(1 << 5);
        assert_eq!(emergency.register(), 0x21);
        emergency.device_well(0);
        assert_eq!(emergency.register(), 0);
    }

    #[test]
    fn every_cause_has_a_bit_of_its_own() {
        let numbered = [Cause::Short, Cause::Long, Cause::Late, Cause::Heartbeat];
        let all = numbered.iter().flat_map(|cause| (0..4).map(cause)).chain([Cause::SyncLength, Cause::SyncLost]);
        let bits: std::vec::Vec<_> = all.map(|cause| cause.facts().1).collect();
        assert!(bits.iter().all(|bit| bit.count_ones() == 1));
        assert_eq!(bits.iter().fold(0, |sum, bit| sum | bit).count_ones(), bits.len() as u32);
    }

    #[test]
    fn the_inhibit_time_spaces_emergencies_and_loses_none() {
        let mut emergency = Emergency::default();
        let mut parameters = Parameters::new(&DEVICE, 1);
        parameters.emergency_inhibit = 50;
        for code in [0x1000, 0x2000, 0x3000] {
            emergency.device(code, 0, [0; 5]);
        }
        let counts = [0, 4_999, 5_000, 9_999, 10_000, 20_000].map(|now| sent(&mut emergency, &parameters, now).len());
        assert_eq!(counts, [1, 0, 1, 0, 1, 0]);
    }

    #[test]
    fn the_list_keeps_the_newest_eight_and_can_be_cleared() {
        let mut emergency = Emergency::default();
        for code in 1..=9 {
            emergency.device(code, 0, [0; 5]);
        }
        assert_eq!(emergency.remembered(), 8);
        assert_eq!([1, 8, 9, 0].map(|sub| emergency.past(sub)), [Some(9), Some(2), None, None]);
        emergency.forget();
        assert_eq!(emergency.remembered(), 0);
    }
}
