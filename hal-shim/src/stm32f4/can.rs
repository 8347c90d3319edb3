//! bxCAN: start without an endless wait, hardware filters, bit rate, transmission without a wait.
//!
//! SYNC has the second receive FIFO for itself: whether one has come shows before any interrupt has dealt with it.

use super::hal::can::Can1;
use super::hal::gpio::alt::can1::{Rx, Tx};
use super::start::{StartError, within};
use super::{pac, put};
use crate::board::can_btr;
use crate::can::{FifoWords, Inbox, Inboxes, Mailboxes, Overrun, Received, SyncInbox, Trouble};
use bxcan::filter::{BankConfig, ListEntry16};
use bxcan::{Fifo, Frame, Interrupts, StandardId};

/// What arrives. The FIFOs are read here and not by bxcan, which cuts the data by the length code as it came (0.8): one of 9 to
/// 15, which is legal, would end the program.
pub struct Receiver(());

/// RFxR: frames that wait, overrun, release of the oldest (RM0090 32.9.2).
const PENDING: u32 = 0b11;
const OVERRUN: u32 = 1 << 4;
const RELEASE: u32 = 1 << 5;

/// What leaves.
pub struct Sender(bxcan::Tx<Can1>);

/// Identifiers of a filter bank (RM0090 32.7.4: 16 bits, list).
const PER_BANK: usize = 4;
/// Filter banks in use at a time, the first of them for SYNC. There are twice as many, so that the next choice is complete
/// before the last one ends.
const BANKS: usize = 4;
/// Identifiers that can be listened to, the first of them that of SYNC.
pub const IDENTIFIERS: usize = 1 + PER_BANK * (BANKS - 1);

/// TSR: give up what waits in each mailbox (RM0090 32.9.2).
const GIVE_UP: u32 = 1 << 7 | 1 << 15 | 1 << 23;

/// What arrives: the hardware drops everything else.
pub struct Filters {
    /// CAN_BTR of the bus that the controller has joined, if any.
    joined: Option<u32>,
    /// The first of the banks in force, if any is.
    first: Option<usize>,
    identifiers: [u16; IDENTIFIERS],
}

/// Starts the controller, on no bus yet: a wrong bit rate would disturb the others on it. It listens to nobody until
/// [`Filters::listen`].
pub fn start(
    can: pac::CAN1,
    receive: impl Into<Rx>,
    transmit: impl Into<Tx>,
    rcc: &mut pac::RCC,
) -> Result<(Receiver, Sender, Filters), StartError> {
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

    let mut can = bxcan::Can::builder(can).leave_disabled();
    {
        // Mode, width and queue of a bank can be set only now; which identifiers, at any time while it is not active.
        let nobody = ListEntry16::data_frames_with_id(StandardId::ZERO);
        let mut filters = can.modify_filters();
        for bank in 0..2 * BANKS {
            let fifo = if bank.is_multiple_of(BANKS) { Fifo::Fifo1 } else { Fifo::Fifo0 };
            filters.enable_bank(bank as u8, fifo, BankConfig::List16([nobody; PER_BANK]));
        }
    }
    activate(0);
    can.enable_interrupts(
        Interrupts::FIFO0_MESSAGE_PENDING | Interrupts::FIFO1_MESSAGE_PENDING | Interrupts::TRANSMIT_MAILBOX_EMPTY,
    );
    let (sender, ..) = can.split();
    Ok((Receiver(()), Sender(sender), Filters { joined: None, first: None, identifiers: [0; IDENTIFIERS] }))
}

/// Beside the library, which owns the controller and shows none of this: mode, status and filters.
fn can1() -> &'static pac::can1::RegisterBlock {
    // SAFETY: the register block is always there. Used through this reference: the mode before the library has the
    // controller, afterwards transmit status, errors and second FIFO, which are only read, and the filters, which only
    // [`Filters`] writes then.
    unsafe { &*pac::CAN1::ptr() }
}

/// Lets these banks filter, a bit each.
fn activate(banks: u32) {
    put!(can1().fa1r(), banks);
}

impl crate::can::Filters for Filters {
    /// The banks that are idle take the new choice, then both sets are in force, then the new one alone.
    fn listen(&mut self, sync: u16, others: &[u16]) {
        // What is not in use is network management once more.
        let mut identifiers = [0; IDENTIFIERS];
        for (slot, identifier) in identifiers.iter_mut().zip(core::iter::once(&sync).chain(others)) {
            *slot = *identifier;
        }
        if identifiers == self.identifiers && self.first.is_some() {
            return;
        }
        self.identifiers = identifiers;
        let next = if self.first == Some(0) { BANKS } else { 0 };
        let [sync, others @ ..] = identifiers;
        let choice = core::iter::once([sync; PER_BANK]).chain(others.as_chunks().0.iter().copied());
        for (bank, [a, b, c, d]) in can1().fb_iter().skip(next).zip(choice) {
            put!(bank.fr1(), entry(a) | entry(b) << 16);
            put!(bank.fr2(), entry(c) | entry(d) << 16);
        }
        let banks = |first: usize| ((1 << BANKS) - 1) << first;
        if self.first.is_some() {
            activate(banks(0) | banks(BANKS));
        }
        activate(banks(next));
        self.first = Some(next);
    }

    /// A bus without power or with a stuck level stops nobody: the controller joins by itself when it sees eleven recessive bits.
    fn join(&mut self, bit_rate: u32) {
        let Some(btr) = can_btr(bit_rate).filter(|btr| self.joined != Some(*btr)) else { return };
        let can = can1();
        if can.msr().read().inak().bit() {
            put!(can.btr(), btr);
            // With automatic recovery from bus-off.
            can.mcr().modify(|_, w| w.abom().set_bit().sleep().clear_bit().inrq().clear_bit());
            self.joined = Some(btr);
        } else {
            put!(can.tsr(), GIVE_UP);
            can.mcr().modify(|_, w| w.sleep().clear_bit().inrq().set_bit());
        }
    }

    fn trouble(&self) -> Trouble {
        let errors = can1().esr().read();
        Trouble { passive: errors.epvf().bit(), bus_off: errors.boff().bit() }
    }
}

/// Half a filter register in 16-bit list mode: identifier, no remote frame, not extended (RM0090 figure 342).
fn entry(identifier: u16) -> u32 {
    u32::from(identifier & 0x7FF) << 5
}

impl Mailboxes for Sender {
    type Frame = Frame;

    fn send(&mut self, frame: &Frame) -> bool {
        // What is asked for while the controller is on no bus would be forgotten.
        let state = can1().msr().read();
        if state.inak().bit() || state.slak().bit() {
            return false;
        }
        let status = can1().tsr().read().bits();
        // With a free mailbox bxcan never has to abort one, which would wait for the bus.
        status >> 26 & 0b111 != 0 && self.0.transmit(frame).is_ok()
    }

    fn acknowledge(&mut self) {
        self.0.clear_interrupt_flags();
    }
}

impl Inboxes for Receiver {
    type Frame = Received;

    fn next(&mut self, from: Inbox) -> Option<Result<Received, Overrun>> {
        let fifo = match from {
            Inbox::Others => 0,
            Inbox::Sync => 1,
        };
        let status = can1().rfr(fifo).read().bits();
        if status & OVERRUN != 0 {
            put!(can1().rfr(fifo), OVERRUN);
            return Some(Err(Overrun));
        }
        if status & PENDING == 0 {
            return None;
        }
        let mailbox = can1().rx(fifo);
        let words = FifoWords {
            identifier: mailbox.rir().read().bits(),
            control: mailbox.rdtr().read().bits(),
            data: [mailbox.rdlr().read().bits(), mailbox.rdhr().read().bits()],
        };
        put!(can1().rfr(fifo), RELEASE);
        Some(Ok(words.frame()))
    }
}

/// The FIFO of SYNC, as the servo task sees it.
#[derive(Clone)]
pub struct SyncWaits(pub(super) ());

impl SyncInbox for SyncWaits {
    #[inline(always)]
    fn waits(&self) -> Option<u8> {
        let can = can1();
        (can.rf1r().read().fmp().bits() != 0).then(|| can.rx(1).rdtr().read().dlc().bits())
    }
}
