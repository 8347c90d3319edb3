//! External interrupt controller and its pin selection in SYSCFG (RM0090 §12.2, §9.2).

use crate::error::Fault;

/// Lines 0..=22.
const LINES: u32 = 0x7f_ffff;

#[derive(Clone, Default)]
pub struct Exti {
    imr: u32,
    emr: u32,
    rising: u32,
    falling: u32,
    swier: u32,
    pending: u32,
    /// SYSCFG_EXTICR1..4: port of each line.
    select: [u32; 4],
    compensation: bool,
    /// SRAM1 appears at address 0, and not flash (MEMRMP).
    pub remapped: bool,
}

/// MEM_MODE of SRAM1.
const SRAM1: u32 = 3;

impl Exti {
    /// Port whose pin `n` feeds line `n`.
    pub fn port(&self, n: u8) -> u32 {
        self.select[usize::from(n / 4)] >> (4 * (n % 4)) & 15
    }

    /// The level of line `n` has changed to `level`. Returns whether the edge was selected.
    pub fn edge(&mut self, n: u8, level: bool) -> bool {
        let hit = (if level { self.rising } else { self.falling }) >> n & 1;
        if hit == 1 && self.imr >> n & 1 == 1 {
            self.pending |= 1 << n;
        }
        hit == 1
    }

    /// Lines that request an interrupt.
    pub fn requests(&self) -> u32 {
        self.pending & self.imr
    }

    pub fn read(&self, offset: u32) -> Result<u32, Fault> {
        Ok(match offset {
            0x00 => self.imr,
            0x04 => self.emr,
            0x08 => self.rising,
            0x0c => self.falling,
            0x10 => self.swier,
            0x14 => self.pending,
            _ => return Err(Fault::Unmodelled),
        })
    }

    pub fn write(&mut self, offset: u32, value: u32) -> Result<(), Fault> {
        let v = value & LINES;
        match offset {
            0x00 => self.imr = v,
            0x04 if v != 0 => return Err(Fault::Unsupported("wake-up events are not modelled")),
            0x04 => self.emr = v,
            0x08 => self.rising = v,
            0x0c => self.falling = v,
            // A 0 -> 1 change pends the line when it is unmasked (§12.3.5).
            0x10 => {
                self.pending |= v & !self.swier & self.imr;
                self.swier |= v;
            }
            // Writing 1 clears the line here and in SWIER (§12.3.6).
            0x14 => {
                self.pending &= !v;
                self.swier &= !v;
            }
            _ => return Err(Fault::Unmodelled),
        }
        Ok(())
    }

    /// SYSCFG back to its reset state.
    pub fn reset_syscfg(&mut self) {
        (self.select, self.compensation, self.remapped) = ([0; 4], false, false);
    }

    pub fn read_syscfg(&self, offset: u32) -> Result<u32, Fault> {
        match offset {
            // MEMRMP: MEM_MODE.
            0x00 => Ok(if self.remapped { SRAM1 } else { 0 }),
            0x04 => Ok(0),
            0x08..=0x14 => Ok(self.select[(offset as usize - 8) / 4]),
            // CMPCR: the compensation cell is ready as soon as it is on.
            0x20 => Ok(if self.compensation { 0x101 } else { 0 }),
            _ => Err(Fault::Unmodelled),
        }
    }

    pub fn write_syscfg(&mut self, offset: u32, value: u32) -> Result<(), Fault> {
        match offset {
            0x08..=0x14 => self.select[(offset as usize - 8) / 4] = value & 0xffff,
            0x20 => self.compensation = value & 1 == 1,
            0x00 if matches!(value, 0 | SRAM1) => self.remapped = value == SRAM1,
            0x00 => return Err(Fault::Unsupported("a memory other than flash or SRAM1 at address 0")),
            _ => return Err(Fault::Unmodelled),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line_2(rising: bool, falling: bool) -> Exti {
        let mut e = Exti::default();
        e.write(0x00, 4).unwrap();
        e.write(0x08, u32::from(rising) << 2).unwrap();
        e.write(0x0c, u32::from(falling) << 2).unwrap();
        e
    }

    #[test]
    fn only_the_selected_edge_pends() {
        for (rising, falling) in [(true, false), (false, true), (true, true), (false, false)] {
            let mut e = line_2(rising, falling);
            e.edge(2, true);
            assert_eq!(e.requests() != 0, rising);
            e.write(0x14, 4).unwrap();
            e.edge(2, false);
            assert_eq!(e.requests() != 0, falling);
        }
    }

    #[test]
    fn pending_is_cleared_by_writing_one_and_not_by_writing_zero() {
        let mut e = line_2(true, false);
        e.edge(2, true);
        e.write(0x14, !4).unwrap();
        assert_eq!(e.requests(), 4);
        e.write(0x14, 4).unwrap();
        assert_eq!(e.requests(), 0);
    }

    #[test]
    fn a_software_trigger_needs_an_unmasked_line() {
        let mut e = line_2(false, false);
        e.write(0x10, 4 | 8).unwrap();
        assert_eq!(e.read(0x14), Ok(4));
    }

    #[test]
    fn port_selection_holds_four_lines_a_register() {
        let mut e = Exti::default();
        e.write_syscfg(0x10, 2 << 12).unwrap(); // EXTICR3, line 11, port C
        assert_eq!((e.port(11), e.port(10), e.port(7)), (2, 0, 0));
    }
}
