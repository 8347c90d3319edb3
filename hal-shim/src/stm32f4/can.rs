//! bxCAN: start without an endless wait, hardware filters, transmission without one.

use super::hal::can::Can1;
use super::hal::gpio::alt::can1::{Rx, Tx};
use super::pac;
use super::start::{StartError, within};
use crate::timing::can::BitTiming;
use bxcan::filter::{BankConfig, Mask16};
use bxcan::{Fifo, Frame, Interrupts, OverrunError, Rx0, StandardId};

/// What arrives.
pub type Receiver = Rx0<Can1>;

/// What leaves.
pub struct Sender(bxcan::Tx<Can1>);

/// The messages a CiA 301 node listens to, besides its own: network management, synchronisation and time stamp.
const BROADCASTS: [u16; 3] = [0x000, 0x080, 0x100];
/// Layer setting services, CiA 305.
const LSS: u16 = 0x7E5;

/// Starts the controller on a bus of this timing, as node `node` (1 to 127): it receives broadcasts, layer setting and
/// what is addressed to the node; everything else is dropped in hardware.
///
/// A bus without power or with a stuck level does not stop the start: the controller joins by itself when it sees eleven
/// recessive bits.
pub fn start(
    can: pac::CAN1,
    receive: impl Into<Rx>,
    transmit: impl Into<Tx>,
    timing: BitTiming,
    node: u8,
    rcc: &mut pac::RCC,
) -> Result<(Sender, Receiver), StartError> {
    let can = Can1::new(can, (transmit, receive), rcc);
    // bxcan waits without a bound until the controller is initialising, then until it sleeps. Here it goes through both
    // first: what it has just done it does again, and the watchdog, which runs by now, is the last bound.
    let registers = can1();
    for initialise in [true, false, true] {
        registers.mcr().modify(|_, w| w.sleep().bit(!initialise).inrq().bit(initialise));
        let done = || {
            let msr = registers.msr().read();
            msr.inak().bit() == initialise && msr.slak().bit() != initialise
        };
        within(100_000, done, StartError::CanInitialisation)?;
    }

    let mut can = bxcan::Can::builder(can).set_bit_timing(timing.btr()).leave_disabled();
    can.modify_filters().enable_bank(0, Fifo::Fifo0, listen(BROADCASTS[0], BROADCASTS[1]));
    can.modify_filters().enable_bank(1, Fifo::Fifo0, listen(BROADCASTS[2], LSS));
    can.modify_filters().enable_bank(2, Fifo::Fifo0, addressed(node));
    can.enable_interrupts(Interrupts::FIFO0_MESSAGE_PENDING | Interrupts::TRANSMIT_MAILBOX_EMPTY);
    // Wakes in the background, with automatic recovery from bus-off.
    let _ = can.enable_non_blocking();
    let (sender, receiver, _) = can.split();
    Ok((Sender(sender), receiver))
}

/// Beside the library, which owns the controller and shows none of this.
fn can1() -> &'static pac::can1::RegisterBlock {
    // SAFETY: the register block is there for ever. Used through this reference: the mode before the library has the
    // controller, and afterwards the transmit status, which is only read.
    unsafe { &*pac::CAN1::ptr() }
}

fn id(raw: u16) -> StandardId {
    StandardId::new(raw).unwrap_or(StandardId::ZERO)
}

fn listen(first: u16, second: u16) -> BankConfig {
    let exact = |raw| Mask16::frames_with_std_id(id(raw), StandardId::MAX);
    BankConfig::Mask16([exact(first), exact(second)])
}

/// Every function code, this node.
fn addressed(node: u8) -> BankConfig {
    let own = Mask16::frames_with_std_id(id(u16::from(node & 0x7F)), id(0x7F));
    BankConfig::Mask16([own, own])
}

impl Sender {
    /// Hands a frame to a free mailbox. `false` when none is free or a frame of the same identifier still waits; the
    /// interrupt of an empty mailbox says when to try again. Nothing that waits is ever displaced.
    pub fn send(&mut self, frame: &Frame) -> bool {
        let status = can1().tsr().read().bits();
        // With a free mailbox bxcan never has to abort one, which would wait for the bus.
        status >> 26 & 0b111 != 0 && self.0.transmit(frame).is_ok()
    }

    /// Acknowledges the interrupt of an empty mailbox.
    pub fn clear(&mut self) {
        self.0.clear_interrupt_flags();
    }
}

/// The next frame that arrived; `Err` once when the hardware had to drop some.
pub fn next(receiver: &mut Receiver) -> Option<Result<Frame, OverrunError>> {
    match receiver.receive() {
        Ok(frame) => Some(Ok(frame)),
        Err(nb::Error::Other(overrun)) => Some(Err(overrun)),
        Err(nb::Error::WouldBlock) => None,
    }
}
