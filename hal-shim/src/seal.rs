//! The seal of an image: by which a head knows at its start that its flash holds what was built.
//!
//! The linker leaves it erased; what seals an image (`host/seal`) fills it in. The sum is that of the chip's CRC unit (RM0090
//! section 4: polynomial 04C11DB7h from FFFFFFFFh, words most significant bit first), over the words from the vector table up
//! to the seal and then those of the program. Between them lie the settings, which change. What no programmer writes is erased.

/// First address of the flash: the vector table, and behind it the seal.
pub const VECTORS: u32 = 0x0800_0000;
/// First address of the program; memory.x says the same.
pub const PROGRAM: u32 = 0x0800_C000;
/// End of the flash.
pub const FLASH_END: u32 = VECTORS + 1024 * 1024;

/// What stands in the flash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C)]
pub struct Seal {
    /// Bytes of the program, whole words.
    pub length: u32,
    /// Sum over vector table and program.
    pub crc: u32,
}

impl Seal {
    /// As it is linked, and as an erased flash reads.
    pub const NONE: Seal = Seal { length: u32::MAX, crc: u32::MAX };

    /// Whether so much may be read.
    pub const fn fits(&self) -> bool {
        self.length.is_multiple_of(4) && self.length <= FLASH_END - PROGRAM
    }
}
