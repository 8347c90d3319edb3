//! Which alternate function of which pin reaches which peripheral signal (data sheet DS8626, table 9).

/// A signal of a peripheral at a pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Signal {
    /// Channel 1..=4 of a timer.
    Channel(u8, u8),
    /// Channel 1 and external trigger of a timer, on one pin.
    ChannelAndTrigger(u8),
    /// External trigger of a timer.
    Trigger(u8),
    /// Break input of a timer.
    Break(u8),
    /// CAN1 receive.
    CanRx,
    /// CAN1 transmit.
    CanTx,
}

use Signal::{Break, CanRx, CanTx, Channel, ChannelAndTrigger, Trigger};

/// (port, pin, alternate function, signal). Complementary outputs and other peripherals are left out.
const TABLE: &[(u8, u8, u8, Signal)] = &[
    (0, 0, 1, ChannelAndTrigger(2)),
    (0, 0, 2, Channel(5, 1)),
    (0, 0, 3, Trigger(8)),
    (0, 1, 1, Channel(2, 2)),
    (0, 1, 2, Channel(5, 2)),
    (0, 2, 1, Channel(2, 3)),
    (0, 2, 2, Channel(5, 3)),
    (0, 2, 3, Channel(9, 1)),
    (0, 3, 1, Channel(2, 4)),
    (0, 3, 2, Channel(5, 4)),
    (0, 3, 3, Channel(9, 2)),
    (0, 5, 1, ChannelAndTrigger(2)),
    (0, 6, 1, Break(1)),
    (0, 6, 2, Channel(3, 1)),
    (0, 6, 3, Break(8)),
    (0, 6, 9, Channel(13, 1)),
    (0, 7, 2, Channel(3, 2)),
    (0, 7, 9, Channel(14, 1)),
    (0, 8, 1, Channel(1, 1)),
    (0, 9, 1, Channel(1, 2)),
    (0, 10, 1, Channel(1, 3)),
    (0, 11, 1, Channel(1, 4)),
    (0, 11, 9, CanRx),
    (0, 12, 1, Trigger(1)),
    (0, 12, 9, CanTx),
    (0, 15, 1, ChannelAndTrigger(2)),
    (1, 0, 2, Channel(3, 3)),
    (1, 1, 2, Channel(3, 4)),
    (1, 3, 1, Channel(2, 2)),
    (1, 4, 2, Channel(3, 1)),
    (1, 5, 2, Channel(3, 2)),
    (1, 6, 2, Channel(4, 1)),
    (1, 7, 2, Channel(4, 2)),
    (1, 8, 2, Channel(4, 3)),
    (1, 8, 3, Channel(10, 1)),
    (1, 8, 9, CanRx),
    (1, 9, 2, Channel(4, 4)),
    (1, 9, 3, Channel(11, 1)),
    (1, 9, 9, CanTx),
    (1, 10, 1, Channel(2, 3)),
    (1, 11, 1, Channel(2, 4)),
    (1, 12, 1, Break(1)),
    (1, 14, 9, Channel(12, 1)),
    (1, 15, 9, Channel(12, 2)),
    (2, 6, 2, Channel(3, 1)),
    (2, 6, 3, Channel(8, 1)),
    (2, 7, 2, Channel(3, 2)),
    (2, 7, 3, Channel(8, 2)),
    (2, 8, 2, Channel(3, 3)),
    (2, 8, 3, Channel(8, 3)),
    (2, 9, 2, Channel(3, 4)),
    (2, 9, 3, Channel(8, 4)),
    (3, 0, 9, CanRx),
    (3, 1, 9, CanTx),
    (3, 2, 2, Trigger(3)),
    (3, 12, 2, Channel(4, 1)),
    (3, 13, 2, Channel(4, 2)),
    (3, 14, 2, Channel(4, 3)),
    (3, 15, 2, Channel(4, 4)),
    (4, 0, 2, Trigger(4)),
    (4, 5, 3, Channel(9, 1)),
    (4, 6, 3, Channel(9, 2)),
    (4, 7, 1, Trigger(1)),
    (4, 9, 1, Channel(1, 1)),
    (4, 11, 1, Channel(1, 2)),
    (4, 13, 1, Channel(1, 3)),
    (4, 14, 1, Channel(1, 4)),
    (4, 15, 1, Break(1)),
];

/// The signal behind alternate function `af` of a pin.
pub fn signal(port: u8, number: u8, af: u8) -> Option<Signal> {
    TABLE.iter().find(|e| (e.0, e.1, e.2) == (port, number, af)).map(|e| e.3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pin_function_leads_to_one_signal() {
        for (i, a) in TABLE.iter().enumerate() {
            assert!(TABLE[i + 1..].iter().all(|b| (a.0, a.1, a.2) != (b.0, b.1, b.2)), "{a:?} twice");
        }
    }

    #[test]
    fn the_timers_sit_on_the_functions_of_the_data_sheet() {
        assert_eq!(signal(0, 8, 1), Some(Channel(1, 1)));
        assert_eq!(signal(2, 6, 3), Some(Channel(8, 1)));
        assert_eq!(signal(0, 0, 2), Some(Channel(5, 1)));
        assert_eq!(signal(0, 6, 9), Some(Channel(13, 1)));
        assert_eq!(signal(1, 12, 1), Some(Break(1)));
        assert_eq!(signal(0, 8, 2), None);
    }
}
