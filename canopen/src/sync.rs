//! SYNC, consumed (CiA 301 7.2.5, 1005h, 1006h, 1007h, 1019h).

use super::Time;
use super::parameters::Parameters;

/// What a SYNC carried.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pulse {
    /// As configured, with the counter if there is one.
    Good(Option<u8>),
    /// With a counter where none is expected, or without.
    Length,
}

/// When the last one came.
#[derive(Clone, Debug, Default)]
pub(super) struct Sync {
    last: Option<Time>,
    /// Not yet acted on by the device.
    unused: Option<Time>,
}

impl Sync {
    /// Whether frames of this identifier are SYNC.
    pub fn is_mine(parameters: &Parameters, id: u16) -> bool {
        parameters.sync_id & 0x7FF == u32::from(id)
    }

    /// Bytes of a SYNC.
    pub fn length(parameters: &Parameters) -> u8 {
        u8::from(parameters.overflow != 0)
    }

    /// Judges a SYNC.
    pub fn judge(parameters: &Parameters, data: &[u8]) -> Pulse {
        if data.len() == usize::from(Self::length(parameters)) {
            Pulse::Good(data.first().copied())
        } else {
            Pulse::Length
        }
    }

    /// A good one has come.
    pub fn came(&mut self, now: Time) {
        (self.last, self.unused) = (Some(now), Some(now));
    }

    /// Whether synchronous PDOs still belong to the last SYNC.
    pub fn window_open(&self, parameters: &Parameters, now: Time) -> bool {
        let close = |last: Time| last.after(parameters.window.into());
        parameters.window == 0 || self.last.is_none_or(|last| now <= close(last))
    }

    /// The SYNC that the device has not acted on yet, if it came no later than `tick`.
    pub fn due(&mut self, tick: Time) -> Option<Time> {
        self.unused.take_if(|time| *time <= tick)
    }

    /// True once when SYNC has failed to come for one and a half periods.
    #[inline(never)]
    pub fn lost(&mut self, parameters: &Parameters, now: Time) -> bool {
        let period = u64::from(parameters.period);
        let lost = self.last.is_some_and(|last| now > last.after(period + period / 2));
        let lost = lost && period != 0;
        if lost {
            self.last = None;
        }
        lost
    }

    /// Nothing has come yet.
    pub fn restart(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::DEVICE;

    #[test]
    fn the_counter_is_there_if_and_only_if_1019h_says_so() {
        let mut parameters = Parameters::new(&DEVICE, 1);
        assert_eq!(Sync::judge(&parameters, &[]), Pulse::Good(None));
        assert_eq!(Sync::judge(&parameters, &[1]), Pulse::Length);
        parameters.overflow = 10;
        assert_eq!(Sync::judge(&parameters, &[7]), Pulse::Good(Some(7)));
        assert_eq!(Sync::judge(&parameters, &[]), Pulse::Length);
        assert_eq!(Sync::judge(&parameters, &[1, 2]), Pulse::Length);
    }

    #[test]
    fn one_and_a_half_periods_of_silence_are_a_loss_that_is_told_once() {
        let mut parameters = Parameters::new(&DEVICE, 1);
        parameters.period = 2_000;
        let mut sync = Sync::default();
        assert!(!sync.lost(&parameters, Time(1_000_000)));
        sync.came(Time(1_000_000));
        assert!(!sync.lost(&parameters, Time(1_003_000)));
        assert!(sync.lost(&parameters, Time(1_003_001)));
        assert!(!sync.lost(&parameters, Time(2_000_000)));
    }

    #[test]
    fn a_tick_acts_on_a_sync_that_is_not_younger_and_once() {
        let mut sync = Sync::default();
        sync.came(Time(100));
        assert_eq!(sync.due(Time(99)), None);
        assert_eq!(sync.due(Time(100)), Some(Time(100)));
        assert_eq!(sync.due(Time(200)), None);
    }

    #[test]
    fn the_window_closes_after_1007h() {
        let mut parameters = Parameters::new(&DEVICE, 1);
        let mut sync = Sync::default();
        sync.came(Time(100));
        assert!(sync.window_open(&parameters, Time(1_000_000)));
        parameters.window = 50;
        assert_eq!([150, 151].map(|now| sync.window_open(&parameters, Time(now))), [true, false]);
    }
}
