//! Controller area network bxCAN1 (RM0090 §32): modes, three mailboxes, two FIFOs, error counters, bus-off.
//!
//! The bus itself belongs to the world: it delivers other nodes' frames when they end and says what became of ours. A
//! frame of ours waits for the end of the frame before it; arbitration against other nodes is the world's business.

mod filter;
mod frame;
#[cfg(test)]
mod tests;

use crate::error::Fault;
use crate::{CanReply, NEVER, World};
use filter::Filters;
pub use frame::Frame;
use std::collections::VecDeque;

mod mcr {
    pub const INRQ: u32 = 1;
    pub const SLEEP: u32 = 2;
    pub const TXFP: u32 = 4;
    pub const RFLM: u32 = 8;
    pub const NART: u32 = 16;
    pub const ABOM: u32 = 64;
    pub const RESET: u32 = 1 << 15;
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mode {
    Sleep,
    Initialisation,
    Normal,
}

/// State of a transmit mailbox (§32.7.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mail {
    Empty,
    /// Requested as the n-th.
    Pending(u64),
}

#[derive(Clone)]
pub struct Can {
    mcr: u32,
    mode: Mode,
    /// Requested mode, and when it is acknowledged.
    target: Mode,
    change_at: u64,
    msr: u32,
    tsr: u32,
    ier: u32,
    btr: u32,
    lec: u32,
    tec: u32,
    rec: u32,
    bus_off: bool,
    recovered_at: u64,
    mail: [[u32; 4]; 3],
    state: [Mail; 3],
    requests: u64,
    /// Mailbox on the bus and the tick its frame ends.
    sending: Option<(usize, u64)>,
    fifo: [VecDeque<(Frame, u8)>; 2],
    full: [bool; 2],
    overrun: [bool; 2],
    filters: Filters,
    /// Ticks of one peripheral clock.
    pub clock: u64,
    /// Whether receive and transmit pins lead here.
    pub connected: bool,
}

/// Interrupt requests: transmit, FIFO 0, FIFO 1, status change.
pub type Requests = [bool; 4];

impl Can {
    pub fn new() -> Self {
        Self {
            mcr: 0x1_0002,
            mode: Mode::Sleep,
            target: Mode::Sleep,
            change_at: NEVER,
            msr: 0,
            tsr: 0,
            ier: 0,
            btr: 0x0123_0000,
            lec: 0,
            tec: 0,
            rec: 0,
            bus_off: false,
            recovered_at: NEVER,
            mail: [[0; 4]; 3],
            state: [Mail::Empty; 3],
            requests: 0,
            sending: None,
            fifo: [VecDeque::new(), VecDeque::new()],
            full: [false; 2],
            overrun: [false; 2],
            filters: Filters::new(),
            clock: 0,
            connected: false,
        }
    }

    /// Registers after reset; clock and pins stay.
    pub fn reset(&mut self) {
        *self = Self { clock: self.clock, connected: self.connected, ..Self::new() };
    }

    /// Ticks of one bit: 1 + TS1 + TS2 quanta of BRP + 1 clocks (§32.7.7).
    pub fn bit(&self) -> u64 {
        let field = |shift: u32, mask: u32| u64::from(self.btr >> shift & mask);
        (1 + field(16, 15) + 1 + field(20, 7) + 1) * (field(0, 0x3ff) + 1) * self.clock
    }

    /// Sample point, share of a bit in thousandths.
    pub fn sample_point(&self) -> u32 {
        let (ts1, ts2) = (self.btr >> 16 & 15, self.btr >> 20 & 7);
        1000 * (ts1 + 2) / (ts1 + ts2 + 3)
    }

    fn loopback(&self) -> bool {
        self.btr >> 30 & 1 == 1
    }

    fn silent(&self) -> bool {
        self.btr >> 31 == 1
    }

    fn esr(&self) -> u32 {
        u32::from(self.tec.max(self.rec) >= 96)
            | u32::from(self.tec.max(self.rec) > 127) << 1
            | u32::from(self.bus_off) << 2
            | self.lec << 4
            | self.tec.min(255) << 16
            | self.rec.min(255) << 24
    }

    pub fn requests(&self) -> Requests {
        let on = |bit: u32| self.ier >> bit & 1 == 1;
        let fifo = |n: usize, first: u32| {
            on(first) && !self.fifo[n].is_empty() || on(first + 1) && self.full[n] || on(first + 2) && self.overrun[n]
        };
        [
            on(0) && self.tsr & 0x0001_0101 != 0,
            fifo(0, 1),
            fifo(1, 4),
            on(15) && self.msr & 4 != 0 || on(17) && self.msr & 16 != 0,
        ]
    }

    pub fn due(&self) -> u64 {
        let sent = self.sending.map_or(NEVER, |s| s.1);
        sent.min(self.change_at).min(self.recovered_at)
    }

    pub fn read(&self, offset: u32, now: u64) -> Result<u32, Fault> {
        Ok(match offset {
            0x00 => self.mcr,
            0x04 => {
                let mode = match self.mode {
                    Mode::Initialisation => 1,
                    Mode::Sleep => 2,
                    Mode::Normal => 0,
                };
                let sending = u32::from(self.sending.is_some_and(|s| s.1 > now)) << 8;
                self.msr | mode | sending | 0xc00
            }
            0x08 => self.read_tsr(),
            0x0c | 0x10 => {
                let n = (offset as usize - 0x0c) / 4;
                self.fifo[n].len() as u32 | u32::from(self.full[n]) << 3 | u32::from(self.overrun[n]) << 4
            }
            0x14 => self.ier,
            0x18 => self.esr(),
            0x1c => self.btr,
            0x180..=0x1ac => self.mail[(offset as usize - 0x180) / 16][offset as usize / 4 % 4],
            0x1b0..=0x1cc => self.read_fifo((offset as usize - 0x1b0) / 16, offset as usize / 4 % 4),
            0x200 => self.filters.fmr,
            0x204 => self.filters.list,
            0x20c => self.filters.wide,
            0x214 => self.filters.fifo,
            0x21c => self.filters.active,
            0x240..=0x31c => self.filters.bank[(offset as usize - 0x240) / 8][offset as usize / 4 % 2],
            _ => return Err(Fault::Unmodelled),
        })
    }

    fn read_tsr(&self) -> u32 {
        let empty = |m: &usize| self.state[*m] == Mail::Empty;
        let tme: u32 = (0..3).filter(empty).map(|m| 1 << (26 + m)).sum();
        // Next free mailbox, or the one of lowest priority when none is free (§32.9.2, CODE).
        let code = (0..3).find(empty).or_else(|| (0..3).max_by_key(|m| self.mail[*m][0])).unwrap_or(0) as u32;
        self.tsr | tme | code << 24
    }

    fn read_fifo(&self, n: usize, word: usize) -> u32 {
        let Some((f, index)) = self.fifo[n].front() else { return 0 };
        let data = u64::from_le_bytes(f.data);
        match word {
            0 => (if f.extended { f.id << 3 | 4 } else { f.id << 21 }) | u32::from(f.remote) << 1,
            1 => u32::from(f.length) | u32::from(*index) << 8,
            2 => data as u32,
            _ => (data >> 32) as u32,
        }
    }

    pub fn write(&mut self, offset: u32, value: u32, now: u64) -> Result<(), Fault> {
        match offset {
            0x00 if self.clock == 0 => return Err(Fault::Unsupported("CAN from a clock that does not divide 168 MHz")),
            0x00 => self.write_mcr(value, now),
            0x04 => self.msr &= !(value & 0x1c),
            0x08 => self.write_tsr(value),
            0x0c | 0x10 => {
                let n = (offset as usize - 0x0c) / 4;
                if value & 32 != 0 {
                    self.fifo[n].pop_front();
                }
                self.full[n] &= value & 8 == 0 && self.fifo[n].len() == 3;
                self.overrun[n] &= value & 16 == 0;
            }
            0x14 => self.ier = value & 0x3_8f7f,
            // LEC can be set by software to tell a new event from an old one (§32.9.2).
            0x18 => self.lec = value >> 4 & 7,
            0x1c if self.mode != Mode::Initialisation => {
                return Err(Fault::Unsupported("BTR is writable in initialisation mode only"));
            }
            0x1c => self.btr = value & 0xc37f_03ff,
            0x180..=0x1ac => {
                let (m, word) = ((offset as usize - 0x180) / 16, offset as usize / 4 % 4);
                if self.state[m] != Mail::Empty {
                    return Err(Fault::Unsupported("transmit mailbox written while not empty"));
                }
                self.mail[m][word] = value;
                if word == 0 && value & 1 == 1 {
                    self.tsr &= !(15 << (8 * m));
                    self.requests += 1;
                    self.state[m] = Mail::Pending(self.requests);
                }
            }
            0x200 => self.filters.fmr = value,
            0x240..=0x31c => self.filters.bank[(offset as usize - 0x240) / 8][offset as usize / 4 % 2] = value,
            // Scale, mode and FIFO are writable while filters are being set up only (§32.9.4).
            0x204 | 0x20c | 0x214 if self.filters.fmr & 1 == 0 => {
                return Err(Fault::Unsupported("filter configuration written outside FINIT"));
            }
            0x204 => self.filters.list = value,
            0x20c => self.filters.wide = value,
            0x214 => self.filters.fifo = value,
            0x21c => self.filters.active = value,
            _ => return Err(Fault::Unmodelled),
        }
        self.transmit(now);
        Ok(())
    }

    fn write_tsr(&mut self, value: u32) {
        for m in 0..3 {
            // Writing RQCP clears it and the result beside it (§32.9.2).
            if value >> (8 * m) & 1 == 1 {
                self.tsr &= !(15 << (8 * m));
            }
            let on_bus = self.sending.is_some_and(|s| s.0 == m);
            if value >> (8 * m + 7) & 1 == 1 && self.state[m] != Mail::Empty && !on_bus {
                self.finish(m, 0);
            }
        }
    }

    fn write_mcr(&mut self, value: u32, now: u64) {
        if value & mcr::RESET != 0 {
            self.reset();
            return;
        }
        self.mcr = value & 0x1_00ff;
        let wanted = if value & mcr::INRQ != 0 && !(self.mode == Mode::Sleep && value & mcr::SLEEP != 0) {
            Mode::Initialisation
        } else if value & mcr::SLEEP != 0 {
            Mode::Sleep
        } else {
            Mode::Normal
        };
        if wanted == self.target {
            return; // asking again does not start the wait anew
        }
        self.target = wanted;
        self.change_at = if wanted == self.mode {
            NEVER
        } else if wanted == Mode::Normal {
            now + 11 * self.bit() // eleven recessive bits to join the bus (§32.4.2)
        } else {
            self.sending.map_or(now, |s| s.1) + self.clock
        };
    }

    /// Lets events until `now` happen.
    pub fn fire(&mut self, now: u64, world: &mut impl World) {
        if self.sending.is_some_and(|s| s.1 <= now) {
            self.sent(now, world);
        }
        if self.change_at <= now {
            self.change_at = NEVER;
            self.change_mode(now);
        }
        if self.recovered_at <= now {
            self.recovered_at = NEVER;
            (self.bus_off, self.tec, self.rec) = (false, 0, 0);
        }
        self.transmit(now);
    }

    fn change_mode(&mut self, now: u64) {
        let was = self.mode;
        self.mode = self.target;
        // Leaving initialisation starts the recovery from bus-off (§32.7.6, ABOM off).
        if was == Mode::Initialisation && self.mode == Mode::Normal && self.bus_off {
            self.recovered_at = now + 128 * 11 * self.bit();
        }
    }

    /// Puts the next mailbox on the bus if it is idle: lowest identifier first, or in order of request (§32.7.1).
    fn transmit(&mut self, now: u64) {
        if self.mode != Mode::Normal || self.sending.is_some() || self.bus_off {
            return;
        }
        let pending = (0..3).filter_map(|m| match self.state[m] {
            Mail::Empty => None,
            Mail::Pending(n) => Some((if self.mcr & mcr::TXFP != 0 { n } else { (self.mail[m][0] >> 1).into() }, m)),
        });
        if let Some((_, m)) = pending.min() {
            self.sending = Some((m, now + self.outgoing(m).bits() * self.bit()));
        }
    }

    fn outgoing(&self, m: usize) -> Frame {
        let [tir, tdtr, low, high] = self.mail[m];
        let extended = tir & 4 != 0;
        let length = (tdtr & 15) as u8;
        let mut data = (u64::from(high) << 32 | u64::from(low)).to_le_bytes();
        data[usize::from(length.min(8))..].fill(0);
        let id = if extended { tir >> 3 } else { tir >> 21 };
        Frame { id, extended, remote: tir & 2 != 0, length, data }
    }

    fn sent(&mut self, now: u64, world: &mut impl World) {
        let Some((m, at)) = self.sending.take() else { return };
        let frame = self.outgoing(m);
        let reply = match (self.loopback(), self.silent(), self.connected) {
            (true, true, _) | (true, _, false) => CanReply::Acknowledged,
            // In loop back mode the acknowledge slot is not looked at (§32.5.2).
            (true, false, true) => match world.can_sent(at, frame) {
                CanReply::NoAcknowledge => CanReply::Acknowledged,
                r => r,
            },
            (false, false, true) => world.can_sent(at, frame),
            _ => CanReply::NoAcknowledge,
        };
        match reply {
            CanReply::Acknowledged => {
                self.tec = self.tec.saturating_sub(1);
                self.lec = 0;
                self.finish(m, 2);
                if self.loopback() {
                    self.receive(frame);
                }
                return;
            }
            CanReply::NoAcknowledge => {
                // An error-passive node does not count missing acknowledges (ISO 11898-1, exception 1).
                let counts = self.tec <= 127;
                self.fail(3, if counts { 8 } else { 0 }, now);
            }
            CanReply::BitError => self.fail(4, 8, now),
        }
        if self.mcr & mcr::NART != 0 {
            self.finish(m, 8);
        }
    }

    fn fail(&mut self, lec: u32, weight: u32, now: u64) {
        let before = self.esr();
        self.lec = lec;
        self.tec += weight;
        if self.tec > 255 && !self.bus_off {
            self.bus_off = true;
            if self.mcr & mcr::ABOM != 0 {
                self.recovered_at = now + 128 * 11 * self.bit();
            }
        }
        // ERRI: a newly set state whose interrupt is enabled (§32.8, figure of the error interrupts).
        let rising = self.esr() & !before & 7;
        if rising & self.ier >> 8 & 7 != 0 || self.ier >> 11 & 1 == 1 {
            self.msr |= 4;
        }
    }

    /// Empties mailbox `m`: RQCP and `result` (TXOK, ALST, TERR).
    fn finish(&mut self, m: usize, result: u32) {
        self.state[m] = Mail::Empty;
        self.mail[m][0] &= !1;
        self.tsr |= (1 | result) << (8 * m);
    }

    /// A frame of another node has ended.
    pub fn bus_frame(&mut self, frame: Frame) {
        // In loop back mode the receive pin is ignored (§32.5.2).
        if self.mode == Mode::Normal && !self.bus_off && self.connected && !self.loopback() {
            self.lec = 0;
            self.rec = self.rec.saturating_sub(1);
            self.receive(frame);
        }
    }

    fn receive(&mut self, frame: Frame) {
        let Some(to) = self.filters.accept(&frame) else { return };
        let fifo = &mut self.fifo[to.fifo];
        if fifo.len() < 3 {
            fifo.push_back((frame, to.index));
            self.full[to.fifo] |= fifo.len() == 3;
        } else {
            self.overrun[to.fifo] = true;
            // Without lock the newest message replaces the one before it (§32.7.3).
            if self.mcr & mcr::RFLM == 0 {
                fifo[2] = (frame, to.index);
            }
        }
    }
}
