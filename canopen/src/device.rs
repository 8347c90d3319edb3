//! What a device says of itself, and how its node is configured before anybody changes it; the numbers that everything else
//! of the node rests on.

/// Entries a PDO can map.
pub const ENTRIES: usize = 8;
/// PDOs in each direction.
pub const PDOS: usize = 4;
/// Errors remembered in 1003h.
pub(super) const HISTORY: usize = 8;
/// Heartbeats that can be watched: entries of 1016h.
pub(super) const CONSUMERS: usize = 4;
/// Bit 31 of a COB-ID: not in use.
pub(super) const INVALID: u32 = 1 << 31;
/// Bit 30 of a TPDO's COB-ID: not to be asked for by a remote frame. Bit 30 of 1005h: produces SYNC.
pub(super) const BIT_30: u32 = 1 << 30;
/// Highest transmission type that waits for SYNC.
pub(super) const SYNCHRONOUS: u8 = 240;

/// Direction of a PDO, seen from the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Direction {
    /// RPDO.
    Receive,
    /// TPDO.
    Transmit,
}

/// Every PDO.
pub(super) const ALL: [(Direction, u16); 2 * PDOS] = {
    use Direction::{Receive, Transmit};
    [(Receive, 0), (Receive, 1), (Receive, 2), (Receive, 3), (Transmit, 0), (Transmit, 1), (Transmit, 2), (Transmit, 3)]
};

/// A PDO as it is after "restore defaults". Its identifier is that of the pre-defined connection set.
#[derive(Clone, Copy, Debug)]
pub struct PdoDefault {
    /// Whether it is in use.
    pub valid: bool,
    /// Transmission type: 0 to 240, 254 or 255.
    pub transmission: u8,
    /// Inhibit time, 0.1 ms; none for an RPDO.
    pub inhibit: u16,
    /// Event timer, ms; 0: none. Of an RPDO: the longest silence.
    pub timer: u16,
    /// Mapped objects: index, sub-index, length in bits, as in 1600h. The first [`ENTRIES`] count.
    pub entries: &'static [u32],
}

impl PdoDefault {
    /// Not in use, nothing mapped.
    pub const UNUSED: Self = Self { valid: false, transmission: 255, inhibit: 0, timer: 0, entries: &[] };
}

/// An entry of a mapping: 8 bits of length below 8 of sub-index below 16 of index (CiA 301 7.5.2.36).
pub const fn mapped(index: u16, sub: u8, bits: u8) -> u32 {
    (index as u32) << 16 | (sub as u32) << 8 | bits as u32
}

/// A kind of device.
#[derive(Clone, Copy, Debug)]
pub struct Device {
    /// 1000h: profile in the low half, its additional information in the high half.
    pub device_type: u32,
    /// 1008h.
    pub name: &'static str,
    /// 1009h.
    pub hardware: &'static str,
    /// 100Ah.
    pub software: &'static str,
    /// 1018h:1; 0 belongs to nobody.
    pub vendor: u32,
    /// 1018h:2.
    pub product: u32,
    /// 1018h:3: major version in the high half, minor in the low half.
    pub revision: u32,
    /// 1017h, ms.
    pub heartbeat: u16,
    /// Longest update that 1F50h:1 takes, bytes.
    pub update: u32,
    /// 1400h to 1403h and 1600h to 1603h.
    pub receive: [PdoDefault; PDOS],
    /// 1800h to 1803h and 1A00h to 1A03h.
    pub transmit: [PdoDefault; PDOS],
}
