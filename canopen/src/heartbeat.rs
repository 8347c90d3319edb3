//! Heartbeats: our own (1017h), and those of the nodes that we watch (1016h) (CiA 301 7.2.8.3.2).

use super::device::CONSUMERS;
use super::parameters::{Parameters, entry};
use super::{Frame, NmtState, NodeId, Time};

/// Base of the identifiers of heartbeats and boot-up.
pub(super) const HEARTBEAT: u16 = 0x700;

/// When the next heartbeat of ours is due.
#[derive(Clone, Debug, Default)]
pub(super) struct Producer {
    next: Time,
}

impl Producer {
    /// The heartbeat in front of the next one is due at once: the state has changed, or the time.
    pub fn now(&mut self) {
        self.next = Time(0);
    }

    /// The heartbeat that is due.
    pub fn poll(&self, period_ms: u16, id: NodeId, state: NmtState, now: Time) -> Option<Frame> {
        (period_ms != 0 && now >= self.next).then(|| Frame::new(id.cob(HEARTBEAT), &[state as u8])).flatten()
    }

    /// It was sent.
    pub fn sent(&mut self, period_ms: u16, now: Time) {
        let period = u64::from(period_ms) * 1000;
        // In step with the last one, unless a whole period was missed.
        let next = self.next.after(period);
        self.next = if next > now { next } else { now.after(period) };
    }
}

/// What is known of a watched node.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Watched {
    /// Not heard since it was entered.
    #[default]
    Unheard,
    /// Has to be heard again by then.
    Until(Time),
    /// Was heard, and then no more.
    Lost,
}

/// What a heartbeat, or the lack of one, says of an entry of 1016h.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Change {
    /// Entry and node: silent for too long, or restarted.
    Lost(u8, u8),
    /// Entry: heard again.
    Back(u8),
}

/// The nodes of 1016h.
#[derive(Clone, Debug, Default)]
pub(super) struct Consumer([Watched; CONSUMERS]);

impl Consumer {
    /// An entry was written: watching begins with the next heartbeat.
    pub fn restart(&mut self, at: usize) {
        if let Some(watched) = self.0.get_mut(at) {
            *watched = Watched::Unheard;
        }
    }

    /// A node was heard.
    pub fn heard(&mut self, parameters: &Parameters, node: u8, state: u8, now: Time) -> Option<Change> {
        let mut entries = (0..).zip(&mut self.0).zip(&parameters.consumers);
        let ((at, watched), time) = entries.find_map(|(watched, value)| match entry(*value) {
            Some((watching, time)) if watching == node => Some((watched, time)),
            _ => None,
        })?;
        let before = *watched;
        // Boot-up: whatever that node had agreed with us it has forgotten.
        if state == NmtState::Initialising as u8 && before != Watched::Unheard {
            *watched = Watched::Lost;
            return matches!(before, Watched::Until(_)).then_some(Change::Lost(at, node));
        }
        *watched = Watched::Until(now.after(u64::from(time) * 1000));
        (before == Watched::Lost).then_some(Change::Back(at))
    }

    /// The next node that has been silent for too long.
    pub fn poll(&mut self, parameters: &Parameters, now: Time) -> Option<Change> {
        for ((at, watched), value) in (0..).zip(&mut self.0).zip(&parameters.consumers) {
            if let (Watched::Until(time), Some((node, _))) = (*watched, entry(*value))
                && now > time
            {
                *watched = Watched::Lost;
                return Some(Change::Lost(at, node));
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::DEVICE;

    const OPERATIONAL: u8 = NmtState::Operational as u8;

    fn watching(entries: [u32; CONSUMERS]) -> (Consumer, Parameters) {
        let mut parameters = Parameters::new(&DEVICE, 1);
        parameters.consumers = entries;
        (Consumer::default(), parameters)
    }

    #[test]
    fn a_node_is_watched_from_its_first_heartbeat() {
        let (mut consumer, parameters) = watching([0, 5 << 16 | 100, 0, 0]);
        assert_eq!(consumer.poll(&parameters, Time(10_000_000)), None);
        assert_eq!(consumer.heard(&parameters, 5, OPERATIONAL, Time(10_000_000)), None);
        assert_eq!(consumer.poll(&parameters, Time(10_100_000)), None);
        assert_eq!(consumer.poll(&parameters, Time(10_100_001)), Some(Change::Lost(1, 5)));
        assert_eq!(consumer.poll(&parameters, Time(20_000_000)), None);
        assert_eq!(consumer.heard(&parameters, 5, OPERATIONAL, Time(20_000_000)), Some(Change::Back(1)));
    }

    #[test]
    fn several_nodes_are_watched_and_others_are_not() {
        let (mut consumer, parameters) = watching([5 << 16 | 100, 6 << 16 | 200, 7 << 16, 300]);
        for node in 0..=127 {
            assert_eq!(consumer.heard(&parameters, node, OPERATIONAL, Time(0)), None);
        }
        assert_eq!(consumer.poll(&parameters, Time(150_000)), Some(Change::Lost(0, 5)));
        assert_eq!(consumer.poll(&parameters, Time(150_000)), None);
        assert_eq!(consumer.poll(&parameters, Time(250_000)), Some(Change::Lost(1, 6)));
        assert_eq!(consumer.poll(&parameters, Time(1_000_000)), None);
    }

    #[test]
    fn a_watched_node_that_restarts_counts_as_lost() {
        let (mut consumer, parameters) = watching([5 << 16 | 100, 0, 0, 0]);
        assert_eq!(consumer.heard(&parameters, 5, 0, Time(0)), None);
        assert_eq!(consumer.heard(&parameters, 5, OPERATIONAL, Time(1)), None);
        assert_eq!(consumer.heard(&parameters, 5, 0, Time(2)), Some(Change::Lost(0, 5)));
        assert_eq!(consumer.heard(&parameters, 5, 0, Time(3)), None);
        assert_eq!(consumer.heard(&parameters, 5, OPERATIONAL, Time(4)), Some(Change::Back(0)));
    }

    #[test]
    fn heartbeats_keep_their_period_however_late_they_are_asked_for() {
        let mut producer = Producer::default();
        let mut times = std::vec::Vec::new();
        for now in (1_000..1_000_000).step_by(700) {
            if producer.poll(100, NodeId::new(3).unwrap(), NmtState::Operational, Time(now)).is_some() {
                producer.sent(100, Time(now));
                times.push(now);
            }
        }
        assert_eq!(times.len(), 10);
        assert!(times.windows(2).all(|pair| (pair[1] - pair[0]).abs_diff(100_000) <= 700), "{times:?}");
    }
}
