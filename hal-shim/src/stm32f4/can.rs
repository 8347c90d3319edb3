//! bxCAN: start without an endless wait, hardware filters, transmission without one.

use super::pins;
use super::start::{StartError, within};
use super::{pac, power};
use crate::board::gpio::{Can1Rx, Can1Tx, Carries, Pin};
use crate::timing::can::BitTiming;
use bxcan::filter::{BankConfig, Mask16};
use bxcan::{Fifo, Frame, Interrupts, OverrunError, Rx0, StandardId};

/// The controller of CAN1.
pub struct Controller(());

// SAFETY: the address is that of CAN1's registers, and the one value of this type is made from the only CAN1.
unsafe impl bxcan::Instance for Controller {
    const REGISTERS: *mut bxcan::RegisterBlock = pac::CAN1::ptr() as *mut _;
}

// SAFETY: CAN1 owns the filter banks, of which CAN2, never used here, could be given some.
unsafe impl bxcan::FilterOwner for Controller {
    const NUM_FILTER_BANKS: u8 = 28;
}

/// What arrives.
pub type Receiver = Rx0<Controller>;

/// What leaves.
pub struct Sender(bxcan::Tx<Controller>);

/// The messages a CiA 301 node listens to, besides its own: network management, synchronisation and time stamp.
const BROADCASTS: [u16; 3] = [0x000, 0x080, 0x100];
/// Layer setting services, CiA 305.
const LSS: u16 = 0x7E5;

/// Starts the controller on a bus of this timing, as node `node` (1 to 127): it receives broadcasts, layer setting and
/// what is addressed to the node; everything else is dropped in hardware.
///
/// A bus without power or with a stuck level does not stop the start: the controller joins by itself when it sees eleven
/// recessive bits.
pub fn start<const P: char, const N: u8, const Q: char, const M: u8>(
    can: pac::CAN1,
    receive: Pin<P, N>,
    transmit: Pin<Q, M>,
    timing: BitTiming,
    node: u8,
    rcc: &pac::RCC,
) -> Result<(Sender, Receiver), StartError>
where
    Pin<P, N>: Carries<Can1Rx>,
    Pin<Q, M>: Carries<Can1Tx>,
{
    power::CAN1.reset(rcc);
    pins::alternate::<Can1Rx, P, N>(receive);
    pins::alternate::<Can1Tx, Q, M>(transmit);
    let registers = can;
    // bxcan waits for these answers without a bound; here they are had before it asks.
    registers.mcr().modify(|_, w| w.sleep().clear_bit().inrq().set_bit());
    let initialised = || {
        let msr = registers.msr().read();
        msr.inak().bit_is_set() && msr.slak().bit_is_clear()
    };
    within(100_000, initialised, StartError::CanInitialisation)?;

    let mut can = bxcan::Can::builder(Controller(())).set_bit_timing(timing.btr()).leave_disabled();
    can.modify_filters().enable_bank(0, Fifo::Fifo0, listen(BROADCASTS[0], BROADCASTS[1]));
    can.modify_filters().enable_bank(1, Fifo::Fifo0, listen(BROADCASTS[2], LSS));
    can.modify_filters().enable_bank(2, Fifo::Fifo0, addressed(node));
    can.enable_interrupts(Interrupts::FIFO0_MESSAGE_PENDING | Interrupts::TRANSMIT_MAILBOX_EMPTY);
    // Wakes in the background, with automatic recovery from bus-off.
    let _ = can.enable_non_blocking();
    let (sender, receiver, _) = can.split();
    Ok((Sender(sender), receiver))
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
        // SAFETY: the register block is there for ever; reading the status changes nothing.
        let status = unsafe { &*pac::CAN1::ptr() }.tsr().read().bits();
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
