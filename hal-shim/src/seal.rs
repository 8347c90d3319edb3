//! The seal of an image: by which a head knows at its start that its flash holds what was built.
//!
//! The linker leaves it erased; what seals an image (`host/seal`) fills it in. The sum is that of the chip's CRC unit
//! ([`edm_boot::Flash::sum`]), over the words of the program up to the seal and then those behind it. What no programmer
//! writes is erased. The boot loader has a sum of its own: an update of the program leaves it as it is.

pub use edm_boot::{BOOT, BOOT_LENGTH, PROGRAM, STAGE};

/// Longest update, with its header, bytes.
pub const LONGEST_UPDATE: u32 = edm_boot::PREFIX + edm_boot::LONGEST;

/// What stands in the flash behind the vector table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C)]
pub struct Seal {
    /// Bytes of the program, whole words, from the vector table on.
    pub length: u32,
    /// Sum over the program without this seal.
    pub crc: u32,
}

impl Seal {
    /// As it is linked, and as an erased flash reads.
    pub const NONE: Seal = Seal { length: u32::MAX, crc: u32::MAX };

    /// Whether so much may be read.
    pub const fn fits(&self) -> bool {
        self.length.is_multiple_of(4) && self.length <= edm_boot::LONGEST
    }
}
