//! Why an SDO transfer was refused (CiA 301 7.2.4.3.17, table 22).

/// An abort code: what the other side receives when a transfer ends and has changed nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u32)]
pub enum Abort {
    /// Toggle bit not alternated.
    Toggle = 0x0503_0000,
    /// The client fell silent in the middle of a transfer.
    TimedOut = 0x0504_0000,
    /// A command that is unknown or has no place in this state of the transfer.
    Command = 0x0504_0001,
    /// Block size not 1 to 127.
    BlockSize = 0x0504_0002,
    /// A segment number that cannot be.
    SequenceNumber = 0x0504_0003,
    /// Checksum of a block transfer wrong.
    Crc = 0x0504_0004,
    /// Longer than the node can hold.
    OutOfMemory = 0x0504_0005,
    /// The object does not allow this access, now or ever.
    Unsupported = 0x0601_0000,
    /// Write-only.
    WriteOnly = 0x0601_0001,
    /// Read-only.
    ReadOnly = 0x0601_0002,
    /// No such object.
    NoObject = 0x0602_0000,
    /// Not to be mapped into a PDO of this direction, or not with this length.
    NotMappable = 0x0604_0041,
    /// The mapped objects would be longer than a PDO.
    PdoLength = 0x0604_0042,
    /// Cannot be together with another parameter.
    Incompatible = 0x0604_0043,
    /// Hardware failed, for instance the memory for stored parameters.
    Hardware = 0x0606_0000,
    /// Length does not fit the object.
    Length = 0x0607_0010,
    /// Too long for the object.
    LengthTooHigh = 0x0607_0012,
    /// Too short for the object.
    LengthTooLow = 0x0607_0013,
    /// The object has no such sub-index.
    NoSubIndex = 0x0609_0011,
    /// Not a value this object can have.
    InvalidValue = 0x0609_0030,
    /// Above the object's range.
    ValueTooHigh = 0x0609_0031,
    /// Below the object's range.
    ValueTooLow = 0x0609_0032,
    /// Refused for a reason that has no code of its own.
    General = 0x0800_0000,
    /// Cannot be stored: not the signature, for instance.
    NotStored = 0x0800_0020,
    /// Cannot be stored because the device itself does not let it, for instance so as not to wear out its memory.
    LocalControl = 0x0800_0021,
    /// Not in the present state of the device, for instance while it is enabled.
    DeviceState = 0x0800_0022,
    /// There is nothing to read.
    NoData = 0x0800_0024,
}

impl Abort {
    /// The code as it is sent.
    pub const fn code(self) -> u32 {
        self as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_those_of_table_22() {
        assert_eq!(Abort::Toggle.code(), 0x0503_0000);
        assert_eq!(Abort::ReadOnly.code(), 0x0601_0002);
        assert_eq!(Abort::PdoLength.code(), 0x0604_0042);
        assert_eq!(Abort::NoSubIndex.code(), 0x0609_0011);
        assert_eq!(Abort::DeviceState.code(), 0x0800_0022);
    }
}
