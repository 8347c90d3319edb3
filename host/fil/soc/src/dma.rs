//! DMA controllers: peripheral-to-memory transfers in direct mode, circular and double buffer (RM0090 §10).

use crate::error::Fault;

mod cr {
    pub const EN: u32 = 1;
    pub const CIRC: u32 = 1 << 8;
    pub const MINC: u32 = 1 << 10;
    pub const DBM: u32 = 1 << 18;
    pub const CT: u32 = 1 << 19;
}

/// Flags of one stream, at bit 0 (§10.5.1).
mod flag {
    pub const ERROR: u32 = 1 << 3;
    pub const HALF: u32 = 1 << 4;
    pub const COMPLETE: u32 = 1 << 5;
}

#[derive(Clone, Copy)]
struct Stream {
    cr: u32,
    ndtr: u32,
    par: u32,
    memory: [u32; 2],
    fcr: u32,
    flags: u32,
    /// Items of the transfer under way.
    total: u32,
}

/// One transfer to be done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Transfer {
    pub from: u32,
    pub to: u32,
    pub size: usize,
}

#[derive(Clone)]
pub struct Dma {
    streams: [Stream; 8],
}

/// ObjectHandle of a stream's flags in LISR or HISR.
const SHIFT: [u32; 4] = [0, 6, 16, 22];

impl Dma {
    pub fn new() -> Self {
        Self { streams: [Stream { cr: 0, ndtr: 0, par: 0, memory: [0; 2], fcr: 0x21, flags: 0, total: 0 }; 8] }
    }

    /// Interrupt request of a stream.
    pub fn request(&self, stream: usize) -> bool {
        let s = &self.streams[stream];
        // TEIE, HTIE, TCIE are one place below their flags.
        s.flags & (s.cr & 0x1c) << 1 != 0
    }

    pub fn read(&self, offset: u32) -> Result<u32, Fault> {
        Ok(match offset {
            0x00 | 0x04 => {
                let first = offset as usize;
                (0..4).fold(0, |v, i| v | self.streams[first + i].flags << SHIFT[i])
            }
            0x08 | 0x0c => 0,
            0x10..=0xcc => {
                let s = &self.streams[(offset as usize - 0x10) / 0x18];
                [s.cr, s.ndtr, s.par, s.memory[0], s.memory[1], s.fcr][(offset as usize - 0x10) % 0x18 / 4]
            }
            _ => return Err(Fault::Unmodelled),
        })
    }

    pub fn write(&mut self, offset: u32, value: u32) -> Result<(), Fault> {
        match offset {
            0x08 | 0x0c => {
                let first = offset as usize - 8;
                for (i, shift) in SHIFT.iter().enumerate() {
                    self.streams[first + i].flags &= !(value >> shift & 0x3d);
                }
                Ok(())
            }
            0x10..=0xcc => self.streams[(offset as usize - 0x10) / 0x18].write((offset - 0x10) % 0x18, value),
            _ => Err(Fault::Unmodelled),
        }
    }

    /// A peripheral on `channel` of `stream` requests one item.
    pub fn next(&self, stream: usize, channel: u32) -> Option<Transfer> {
        let s = &self.streams[stream];
        if s.cr & cr::EN == 0 || s.cr >> 25 & 7 != channel {
            return None;
        }
        // In direct mode the peripheral's width rules both sides (§10.3.12).
        let size = 1 << (s.cr >> 11 & 3);
        let index = if s.cr & cr::MINC != 0 { s.total - s.ndtr } else { 0 };
        let base = s.memory[usize::from(s.cr & cr::CT != 0)];
        Some(Transfer { from: s.par, to: base.wrapping_add(index * size as u32), size })
    }

    /// Items that a stream moves before it raises a flag.
    pub fn before_flag(&self, stream: usize) -> u32 {
        let s = &self.streams[stream];
        let (done, half) = (s.total - s.ndtr, s.total / 2);
        (if done < half { half - done } else { s.ndtr }).saturating_sub(1)
    }

    /// The item was moved (or met a bus error). Returns whether the stream has stopped.
    pub fn done(&mut self, stream: usize, moved: bool) -> bool {
        let s = &mut self.streams[stream];
        if !moved {
            s.flags |= flag::ERROR;
            s.cr &= !cr::EN;
            return true;
        }
        s.ndtr -= 1;
        if s.total - s.ndtr == s.total / 2 {
            s.flags |= flag::HALF;
        }
        if s.ndtr > 0 {
            return false;
        }
        s.flags |= flag::COMPLETE;
        if s.cr & cr::DBM != 0 {
            s.cr ^= cr::CT;
        }
        if s.cr & (cr::CIRC | cr::DBM) != 0 {
            s.ndtr = s.total;
            return false;
        }
        s.cr &= !cr::EN;
        true
    }
}

impl Stream {
    fn write(&mut self, offset: u32, value: u32) -> Result<(), Fault> {
        let on = self.cr & cr::EN != 0;
        match offset {
            0x00 => return self.control(value),
            0x04 | 0x08 if on => return Err(Fault::Unsupported("DMA stream changed while enabled")),
            0x04 => self.ndtr = value & 0xffff,
            0x08 => self.par = value,
            0x0c | 0x10 => {
                // Only the buffer not in use may be changed on the fly (§10.3.9).
                let which = (offset as usize - 0x0c) / 4;
                if on && usize::from(self.cr & cr::CT != 0) == which {
                    return Err(Fault::Unsupported("address of the DMA buffer in use changed while enabled"));
                }
                self.memory[which] = value;
            }
            _ if value & 4 != 0 => return Err(Fault::Unsupported("DMA FIFO mode is not modelled")),
            _ => self.fcr = value & 0x87 | 0x20,
        }
        Ok(())
    }

    fn control(&mut self, value: u32) -> Result<(), Fault> {
        let (was, is) = (self.cr & cr::EN != 0, value & cr::EN != 0);
        if was && is && (self.cr ^ value) & !0x1e != 0 {
            return Err(Fault::Unsupported("DMA stream reconfigured while enabled"));
        }
        if is && !was {
            if value & (3 << 6 | 1 << 5 | 1 << 9) != 0 {
                return Err(Fault::Unsupported("only peripheral-to-memory DMA under DMA flow control is modelled"));
            }
            // §10.3.17 asks for all flags of the last transfer to be cleared before a stream is enabled. A half-transfer
            // flag left over is common in working drivers and does not block the stream.
            if self.flags & (flag::COMPLETE | flag::ERROR) != 0 {
                return Err(Fault::Unsupported("DMA stream enabled with flags of its last transfer set"));
            }
            self.total = self.ndtr;
        }
        self.cr = value & 0x0fef_ffff;
        if was && !is {
            // Disabling a running stream raises its transfer-complete flag (§10.3.14).
            self.flags |= flag::COMPLETE;
        }
        if self.cr & cr::EN != 0 && self.total == 0 {
            self.cr &= !cr::EN;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S2: u32 = 0x10 + 2 * 0x18;

    fn stream(flags: u32, items: u32) -> Dma {
        let mut d = Dma::new();
        d.write(S2 + 4, items).unwrap();
        d.write(S2 + 8, 0x4001_204c).unwrap();
        d.write(S2 + 12, 0x2000_0100).unwrap();
        d.write(S2 + 16, 0x2000_0200).unwrap();
        // Channel 1, 16 bits both sides.
        d.write(S2, 1 << 25 | 1 << 13 | 1 << 11 | cr::MINC | cr::EN | flags).unwrap();
        d
    }

    fn step(d: &mut Dma) -> u32 {
        let t = d.next(2, 1).unwrap();
        d.done(2, true);
        t.to
    }

    #[test]
    fn only_the_selected_channel_is_served() {
        let d = stream(0, 4);
        assert_eq!(d.next(2, 0), None);
        assert_eq!(d.next(2, 1), Some(Transfer { from: 0x4001_204c, to: 0x2000_0100, size: 2 }));
    }

    #[test]
    fn half_and_complete_come_after_half_and_all_items_and_the_stream_stops() {
        let mut d = stream(0, 4);
        let lisr = |d: &Dma| d.read(0).unwrap() >> 16 & 0x3f;
        step(&mut d);
        assert_eq!(lisr(&d), 0);
        step(&mut d);
        assert_eq!(lisr(&d), flag::HALF);
        step(&mut d);
        assert_eq!(step(&mut d), 0x2000_0106);
        assert_eq!(lisr(&d), flag::HALF | flag::COMPLETE);
        assert_eq!(d.next(2, 1), None);
        assert!(d.write(S2, cr::EN).is_err());
        d.write(8, 0x3d << 16).unwrap();
        assert_eq!(lisr(&d), 0);
    }

    #[test]
    fn circular_mode_reloads_and_double_buffer_swaps() {
        let mut d = stream(cr::CIRC, 2);
        assert_eq!([step(&mut d), step(&mut d), step(&mut d)], [0x2000_0100, 0x2000_0102, 0x2000_0100]);
        let mut d = stream(cr::DBM, 2);
        assert_eq!([step(&mut d), step(&mut d), step(&mut d)], [0x2000_0100, 0x2000_0102, 0x2000_0200]);
        assert_eq!(d.read(S2).unwrap() >> 19 & 1, 1);
    }

    #[test]
    fn a_bus_error_stops_the_stream_with_its_error_flag() {
        let mut d = stream(cr::CIRC | 1 << 2, 2);
        assert!(d.done(2, false));
        assert!(d.request(2));
        assert_eq!(d.next(2, 1), None);
    }

    #[test]
    fn interrupts_follow_their_enables() {
        for (enable, fires) in [(1 << 4, true), (1 << 2, false)] {
            let mut d = stream(enable, 1);
            step(&mut d);
            assert_eq!(d.request(2), fires);
        }
    }
}
