//! Non-volatile storage: the NOR flash traits of the embedded-storage project, as they stand.
pub use embedded_storage::nor_flash::{
    ErrorType, MultiwriteNorFlash, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
