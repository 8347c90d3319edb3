//! The border between the node and the device behind it: objects by index and sub-index.
//!
//! The node owns the communication objects, 1000h to 1FFFh, and the dummy entries of static data types; every other address
//! it asks of the [`Dictionary`]. An address is looked up once, as an [`Entry`]; what the entry calls its [`ObjectHandle`] then
//! reads and writes without a search. PDOs keep the places of what they map.
//!
//! Values cross this border as bytes in transfer order: little-endian (CiA 301 7.1.3).

use super::Abort;

/// Longest value that is read or written whole, bytes. Longer ones are [`DataType::Domain`], read or written piece by piece.
pub const LONGEST: usize = 252;

/// Static data types (CiA 301 7.4.7.1, table 44). The number is the type's own index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum DataType {
    /// One byte, 0 or 1. Never mapped: in a PDO it would be a single bit.
    Boolean = 0x01,
    /// Signed, 1 byte.
    Integer8 = 0x02,
    /// Signed, 2 bytes.
    Integer16 = 0x03,
    /// Signed, 4 bytes.
    Integer32 = 0x04,
    /// Unsigned, 1 byte.
    Unsigned8 = 0x05,
    /// Unsigned, 2 bytes.
    Unsigned16 = 0x06,
    /// Unsigned, 4 bytes.
    Unsigned32 = 0x07,
    /// Float, 4 bytes.
    Real32 = 0x08,
    /// Printable ASCII, up to [`LONGEST`].
    VisibleString = 0x09,
    /// Bytes, up to [`LONGEST`].
    OctetString = 0x0A,
    /// Bytes of any number, read piece by piece through [`Dictionary::stream`].
    Domain = 0x0F,
    /// Signed, 8 bytes.
    Integer64 = 0x15,
    /// Unsigned, 8 bytes.
    Unsigned64 = 0x1B,
}

impl DataType {
    /// Index of the type, as in `DataType=` of an EDS.
    pub const fn code(self) -> u16 {
        self as u16
    }

    /// Bytes of a value; `None` where values differ in length.
    pub const fn size(self) -> Option<usize> {
        match self {
            Self::Boolean | Self::Integer8 | Self::Unsigned8 => Some(1),
            Self::Integer16 | Self::Unsigned16 => Some(2),
            Self::Integer32 | Self::Unsigned32 | Self::Real32 => Some(4),
            Self::Integer64 | Self::Unsigned64 => Some(8),
            Self::VisibleString | Self::OctetString | Self::Domain => None,
        }
    }
}

/// What a host may do with an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Read; never changes.
    Const,
    /// Read.
    ReadOnly,
    /// Write.
    WriteOnly,
    /// Both.
    ReadWrite,
}

impl Access {
    /// Whether a host may read.
    pub const fn readable(self) -> bool {
        !matches!(self, Self::WriteOnly)
    }

    /// Whether a host may write.
    pub const fn writable(self) -> bool {
        matches!(self, Self::WriteOnly | Self::ReadWrite)
    }
}

/// Which PDOs may carry an object. A host needs the matching access as well.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mapping {
    /// None.
    No,
    /// To the device: RPDO.
    Receive,
    /// From the device: TPDO.
    Transmit,
    /// Either.
    Both,
}

/// Where a dictionary keeps an object: a number that means something to it alone, and stays the same while it lives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ObjectHandle(pub u16);

/// What is known of an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Type of its value.
    pub kind: DataType,
    /// What a host may do with it.
    pub access: Access,
    /// Which PDOs may carry it.
    pub mapping: Mapping,
    /// Where it is.
    pub place: ObjectHandle,
}

/// What is stored together: parameters by origin (sub-indices of 1010h and 1011h, CiA 301 7.5.2.13), and how the node is reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Group {
    /// Every parameter: sub-index 1.
    All,
    /// The communication objects: sub-index 2.
    Communication,
    /// Profile and manufacturer: sub-index 3.
    Application,
    /// Node-ID and bit rate: by layer setting alone (CiA 305).
    Bus,
}

/// What a host asks that takes longer than an SDO answer. [`Node::answer`](super::Node::answer) ends it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Request {
    /// Store the parameters: 1010h, signature "save", or what layer setting has configured.
    Store(Group),
    /// From the next reset on, use the defaults: 1011h, signature "load".
    Restore(Group),
    /// Part of an update of the program: 1F50h and 1F51h.
    Update(Update),
}

/// Parts of an update (CiA 302-3).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Update {
    /// 1F51h:1 = 0: nothing may move from now on.
    Stop,
    /// 1F51h:1 = 3: forget what was staged, and make room for another program. The answer says that it has begun; when it has
    /// ended, 1F57h:1 does.
    Clear,
    /// Take what [`Node::piece`](super::Node::piece) has.
    Piece,
    /// The same, and it is the last: look whether all of it is right.
    Last,
    /// 1F51h:1 = 1: start the program that was staged.
    Start,
}

/// States of network management (CiA 301 7.3.2.2). The number is the one in the heartbeat.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u8)]
pub enum NmtState {
    /// Waits for [`Node::boot`](super::Node::boot); deaf and mute but for layer setting.
    Initialising = 0,
    /// Network management and heartbeat only.
    Stopped = 4,
    /// Everything.
    Operational = 5,
    /// Everything but PDOs.
    PreOperational = 127,
}

/// Events from the node to the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Event {
    /// The state of network management has changed.
    State(NmtState),
    /// Reset node: back to the values of power-on, then [`Node::boot`](super::Node::boot).
    ResetNode,
    /// Reset communication: the node's values are back to their defaults; [`Node::boot`](super::Node::boot) loads what is
    /// stored.
    ResetCommunication,
    /// A node watched by 1016h has fallen silent or has restarted.
    HeartbeatLost {
        /// Its node-ID.
        node: u8,
    },
    /// SYNC has failed to come for one and a half periods of 1006h.
    SyncLost,
    /// An RPDO with an event timer did not come in time.
    ReceiveTimeout {
        /// Which, from 0.
        pdo: u8,
    },
}

/// A write that was not refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Written {
    /// In force.
    Now,
    /// On its way; [`Node::written`](super::Node::written) says whether it has come into force. Requests that come until then
    /// wait.
    Later,
    /// The device is on it, which may take long; [`Node::answer`](super::Node::answer) says how it ends. Of the node's own
    /// objects: a dictionary does not give it.
    Requested,
}

/// The device's objects.
///
/// The node checks access and, where the type has one, the length. All else is the dictionary's to refuse; a refused
/// write has changed nothing.
pub trait Dictionary {
    /// Looks an object up.
    ///
    /// # Errors
    /// [`Abort::NoObject`], [`Abort::NoSubIndex`].
    fn entry(&self, index: u16, sub: u8) -> Result<Entry, Abort>;

    /// Copies a value to the front of `out` and returns its length, bytes. `out` holds a value of the entry's type:
    /// 8 bytes at least, [`LONGEST`] for strings. Not called for a domain.
    ///
    /// # Errors
    /// Any; the host receives it.
    fn read(&self, place: ObjectHandle, out: &mut [u8]) -> Result<usize, Abort>;

    /// Takes a value over, whole or not at all. [`Written::Later`] when it is not in force yet: the host's SDO is answered by
    /// [`Node::written`](super::Node::written).
    ///
    /// # Errors
    /// Any; the host receives it, unless the value came by PDO.
    fn write(&mut self, place: ObjectHandle, data: &[u8]) -> Result<Written, Abort>;

    /// Length of a domain, bytes, at the start of a transfer.
    ///
    /// # Errors
    /// Any; a device without domains has no other answer.
    fn stream_length(&self, _place: ObjectHandle) -> Result<u32, Abort> {
        Err(Abort::Unsupported)
    }

    /// Fills `out` with the bytes of a domain from `offset` on; the node asks for none beyond its length, but may ask for
    /// some again.
    ///
    /// # Errors
    /// Any, also in the middle of a transfer: [`Abort::DeviceState`] when the content is no longer what it was at the start.
    fn stream(&self, _place: ObjectHandle, _offset: u32, _out: &mut [u8]) -> Result<(), Abort> {
        Err(Abort::Unsupported)
    }

    /// A request that is either refused at once or taken, and then answered through [`Node::answer`](super::Node::answer).
    ///
    /// # Errors
    /// [`Abort::DeviceState`] while enabled, [`Abort::LocalControl`] when it comes too often, or any other.
    fn request(&mut self, request: Request) -> Result<(), Abort>;

    /// Something has happened.
    fn event(&mut self, event: Event);
}
