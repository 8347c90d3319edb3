//! Acceptance filters (RM0090 §32.7.4): 28 banks of one 32-bit or two 16-bit filters, as mask or as list.

use super::frame::Frame;

/// The filter registers.
#[derive(Clone)]
pub struct Filters {
    pub fmr: u32,
    pub list: u32,
    pub wide: u32,
    pub fifo: u32,
    pub active: u32,
    pub bank: [[u32; 2]; 28],
}

/// A frame's way into the node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Match {
    /// FIFO 0 or 1.
    pub fifo: usize,
    /// Filter match index, as RDTR shows it.
    pub index: u8,
}

/// Identifier as RIR and a 32-bit filter hold it (§32.9.3).
fn wide(f: &Frame) -> u32 {
    let id = if f.extended { f.id << 3 | 4 } else { f.id << 21 };
    id | u32::from(f.remote) << 1
}

/// Identifier as a 16-bit filter sees it: STID, RTR, IDE, EXID[17:15].
fn narrow(f: &Frame) -> u32 {
    let (standard, upper) = if f.extended { (f.id >> 18, f.id >> 15 & 7) } else { (f.id, 0) };
    standard << 5 | u32::from(f.remote) << 4 | u32::from(f.extended) << 3 | upper
}

impl Filters {
    pub fn new() -> Self {
        Self { fmr: 0x2a1c_0e01, list: 0, wide: 0, fifo: 0, active: 0, bank: [[0; 2]; 28] }
    }

    /// Filters of bank `b` in order: whether the frame passes each.
    fn passes(&self, b: usize, f: &Frame) -> ([bool; 4], usize) {
        let [r1, r2] = self.bank[b];
        let halves = |r: u32| (r & 0xffff, r >> 16);
        let mut hit = [false; 4];
        match (self.wide >> b & 1 == 1, self.list >> b & 1 == 1) {
            (true, false) => {
                hit[0] = (wide(f) ^ r1) & r2 == 0;
                (hit, 1)
            }
            (true, true) => {
                (hit[0], hit[1]) = (wide(f) == r1, wide(f) == r2);
                (hit, 2)
            }
            (false, false) => {
                for (h, r) in hit.iter_mut().zip([r1, r2]) {
                    let (id, mask) = halves(r);
                    *h = (narrow(f) ^ id) & mask == 0;
                }
                (hit, 2)
            }
            (false, true) => {
                let ((a, b), (c, d)) = (halves(r1), halves(r2));
                for (h, id) in hit.iter_mut().zip([a, b, c, d]) {
                    *h = narrow(f) == id;
                }
                (hit, 4)
            }
        }
    }

    /// Where `frame` goes; `None` when no filter of CAN1 lets it in. Wide before narrow, list before mask, then the lower
    /// number (§32.7.4, filter priority rules).
    pub fn accept(&self, frame: &Frame) -> Option<Match> {
        if self.fmr & 1 == 1 {
            return None; // filters are being set up: reception is off (§32.7.4)
        }
        let mut next_index = [0u8; 2];
        let mut best: Option<((u32, u32), Match)> = None;
        for b in 0..(self.fmr >> 8 & 0x3f).min(28) as usize {
            let fifo = (self.fifo >> b & 1) as usize;
            let (hit, count) = self.passes(b, frame);
            if self.active >> b & 1 == 1 {
                let rank = (1 - (self.wide >> b & 1), 1 - (self.list >> b & 1));
                if let Some(i) = hit[..count].iter().position(|h| *h)
                    && best.is_none_or(|(r, _)| rank < r)
                {
                    best = Some((rank, Match { fifo, index: next_index[fifo] + i as u8 }));
                }
            }
            // Filters are numbered through, whether active or not (§32.7.4, filter match index).
            next_index[fifo] += count as u8;
        }
        best.map(|(_, m)| m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn standard(id: u32) -> Frame {
        Frame { id, ..Frame::default() }
    }

    fn filters() -> Filters {
        Filters { fmr: 0x2a1c_0e00, ..Filters::new() }
    }

    #[test]
    fn a_mask_looks_at_its_set_bits_only() {
        let mut f = filters();
        (f.active, f.wide) = (1, 1);
        f.bank[0] = [0x600 << 21, 0x780 << 21];
        assert!(f.accept(&standard(0x67f)).is_some());
        assert!(f.accept(&standard(0x680)).is_none());
    }

    #[test]
    fn a_wide_list_takes_two_identifiers_and_minds_kind_and_remote() {
        let mut f = filters();
        (f.active, f.wide, f.list) = (1, 1, 1);
        f.bank[0] = [0x123 << 21, 0x1234_5678 << 3 | 4];
        assert_eq!(f.accept(&standard(0x123)).map(|m| m.index), Some(0));
        assert_eq!(f.accept(&Frame { id: 0x1234_5678, extended: true, ..Frame::default() }).map(|m| m.index), Some(1));
        assert!(f.accept(&Frame { remote: true, ..standard(0x123) }).is_none());
    }

    #[test]
    fn a_narrow_list_takes_four_identifiers() {
        let mut f = filters();
        (f.active, f.list) = (1, 1);
        f.bank[0] = [0x100 << 5 | 0x101 << 21, 0x102 << 5 | 0x103 << 21];
        for (i, id) in (0x100..0x104).enumerate() {
            assert_eq!(f.accept(&standard(id)).map(|m| m.index), Some(i as u8));
        }
        assert!(f.accept(&standard(0x104)).is_none());
    }

    #[test]
    fn nothing_passes_while_filters_are_set_up_or_inactive() {
        let mut f = Filters::new();
        (f.active, f.wide) = (1, 1);
        assert!(f.accept(&standard(1)).is_none());
        f.fmr &= !1;
        assert!(f.accept(&standard(1)).is_some());
        f.active = 0;
        assert!(f.accept(&standard(1)).is_none());
    }

    #[test]
    fn match_index_counts_the_filters_of_one_fifo_and_inactive_ones_too() {
        let mut f = filters();
        // Bank 0: two narrow masks to FIFO 0, inactive. Bank 1: FIFO 1. Bank 2: wide mask to FIFO 0.
        (f.active, f.wide, f.fifo) = (0b100, 0b100, 0b010);
        assert_eq!(f.accept(&standard(5)), Some(Match { fifo: 0, index: 2 }));
    }
}
