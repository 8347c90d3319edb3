//! Any frames at all to the real drive with its head and process: nothing panics or overflows, and what can be written stays
//! within its declared range.

use crate::rig::Rig;
use edm_describe::{Declaration, everything};
use edm_servo_head::canopen::{Access, DataType, Dictionary, Mapping};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

const ID: u16 = 5;
/// Heads that begin anew, and frames to each: few survive many.
const HEADS: u32 = 300;
const FRAMES: u32 = 1000;

struct Host {
    random: Xoshiro256PlusPlus,
    writable: Vec<Declaration>,
    mappable: Vec<Declaration>,
}

impl Host {
    fn new(seed: u64) -> Self {
        let writable = |d: &Declaration| matches!(d.access, Access::ReadWrite | Access::WriteOnly);
        Self {
            random: Xoshiro256PlusPlus::seed_from_u64(seed),
            writable: drive().filter(writable).collect(),
            mappable: drive().filter(|d| d.mapping != Mapping::No).collect(),
        }
    }

    fn below(&mut self, bound: u32) -> u32 {
        self.random.random_range(0..bound)
    }

    /// A value near or within the range of an object, or any.
    fn value(&mut self, object: &Declaration) -> u32 {
        let (low, high) = object.range.unwrap_or((0.0, 1.0));
        match self.below(6) {
            0 => self.random.random(),
            1 => low as i64 as u32,
            2 => high as i64 as u32,
            3 => ((low + (high - low) * self.random.random::<f64>()) as f32).to_bits(),
            4 => self.below(40).wrapping_sub(10),
            _ => (low + (high - low) * self.random.random::<f64>()) as i64 as u32,
        }
    }

    fn frame(&mut self) -> (u16, Vec<u8>) {
        match self.below(40) {
            0..14 => {
                let at = self.below(self.writable.len() as u32) as usize;
                let object = self.writable[at];
                let size = object.kind.size().unwrap_or(4).clamp(1, 4) as u8;
                let [low, high] = object.index.to_le_bytes();
                let head = [0x23 | (4 - size) << 2, low, high, object.sub];
                (0x600 + ID, [head, self.value(&object).to_le_bytes()].concat())
            }
            14 => (0x600 + ID, self.random.random::<[u8; 8]>().to_vec()),
            15..25 => {
                let words =
                    [0x06u16, 0x07, 0x0F, 0x1F, 0x3F, 0x010F, 0x5F, 0x0B, 0x02, 0x80, 0x00, self.below(65536) as u16];
                (0x200 + ID, words[self.below(12) as usize].to_le_bytes().to_vec())
            }
            25..30 => {
                let pdo = 0x200 + 0x100 * self.below(4) as u16;
                let length = self.below(9) as usize;
                (pdo + ID, self.random.random::<[u8; 8]>()[..length].to_vec())
            }
            30..33 => (0x80, if self.below(8) == 0 { vec![self.below(256) as u8] } else { vec![] }),
            33 => (0x700 + self.below(128) as u16, vec![5]),
            34 if self.below(20) == 0 => (0, vec![[2, 128, 129, 130][self.below(4) as usize], ID as u8]),
            34..36 => (0, vec![1, ID as u8]),
            _ => {
                // Into a mapping that is not in use, if it is not.
                let at = self.below(self.mappable.len() as u32) as usize;
                let d = self.mappable[at];
                let entry = u32::from(d.index) << 16 | u32::from(d.sub) << 8 | (8 * d.kind.size().unwrap_or(0) as u32);
                let index = [0x1600u16, 0x1A00][self.below(2) as usize] + self.below(4) as u16;
                let [low, high] = index.to_le_bytes();
                (0x600 + ID, [[0x23, low, high, 1 + self.below(8) as u8], entry.to_le_bytes()].concat())
            }
        }
    }
}

/// The objects behind the node's own.
fn drive() -> impl Iterator<Item = Declaration> {
    everything().filter(|d| d.index >= 0x2000)
}

/// What an object of the drive reads as a number.
fn number(rig: &Rig, d: &Declaration) -> Option<f64> {
    let entry = rig.drive.entry(d.index, d.sub).unwrap();
    let mut bytes = [0; 252];
    let length = rig.drive.read(entry.place, &mut bytes).unwrap();
    let raw = u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
    Some(match d.kind {
        DataType::Integer8 => f64::from(raw as i8),
        DataType::Integer16 => f64::from(raw as i16),
        DataType::Integer32 => f64::from(raw as i32),
        DataType::Unsigned8 | DataType::Unsigned16 | DataType::Unsigned32 | DataType::Boolean if length <= 4 => {
            raw.into()
        }
        DataType::Real32 => f32::from_bits(raw).into(),
        _ => return None,
    })
}

#[test]
fn any_frames_leave_every_value_in_its_range() {
    let mut host = Host::new(1);
    let mut operated = 0;
    for head in 0..HEADS {
        let mut rig = Rig::ready();
        for _ in 0..FRAMES {
            let (id, data) = host.frame();
            rig.send(id, &data);
            rig.drive.preview_sync(&rig.node);
            if host.below(3) == 0 {
                rig.step();
                operated += u32::from(rig.status() & 0x6F == 0x27);
            }
        }
        for d in host.writable.iter().filter(|d| d.range.is_some()) {
            let (low, high) = d.range.unwrap();
            if let Some(value) = number(&rig, d) {
                let slack = 1e-6 * high.abs();
                assert!(value >= low - slack && value <= high + slack, "head {head}: {value} in {d:?}");
            }
        }
    }
    assert!(operated > 1000, "in operation for {operated} ms only");
}
