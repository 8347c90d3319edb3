//! Frames, node-IDs and time, as the node sees them.

/// A data frame with an 11-bit identifier. Remote frames and 29-bit identifiers mean nothing to this node: the
/// receiver drops them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(align(4))]
pub struct Frame {
    id: u16,
    length: u8,
    data: [u8; 8],
}

impl Frame {
    /// A frame; `None` when the identifier has more than 11 bits or the data more than 8 bytes.
    pub fn new(id: u16, data: &[u8]) -> Option<Self> {
        let mut frame = Self { id, length: data.len() as u8, data: [0; 8] };
        frame.data.get_mut(..data.len())?.copy_from_slice(data);
        (id <= 0x7FF).then_some(frame)
    }

    /// A frame of 8 bytes. Bits of the identifier beyond 11 are lost.
    pub(super) const fn full(id: u16, data: [u8; 8]) -> Self {
        Self { id: id & 0x7FF, length: 8, data }
    }

    /// Identifier.
    pub const fn id(&self) -> u16 {
        self.id
    }

    /// Content.
    pub fn data(&self) -> &[u8] {
        self.data.get(..usize::from(self.length)).unwrap_or(&[])
    }
}

/// A node-ID, 1 to 127.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct NodeId(u8);

impl NodeId {
    /// The lowest.
    pub const FIRST: Self = Self(1);

    /// A node-ID; `None` outside 1 to 127.
    pub const fn new(id: u8) -> Option<Self> {
        if id >= 1 && id <= 127 { Some(Self(id)) } else { None }
    }

    /// The number.
    pub const fn get(self) -> u8 {
        self.0
    }

    /// The identifier of a service in the pre-defined connection set (CiA 301 7.3.5).
    pub(super) const fn cob(self, service: u16) -> u16 {
        service | self.0 as u16
    }
}

/// Time since an arbitrary start, us. Never wraps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Time(pub u64);

impl Time {
    /// This much later, us.
    pub(super) const fn after(self, us: u64) -> Self {
        Self(self.0.saturating_add(us))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_holds_eleven_bits_and_eight_bytes() {
        assert_eq!(Frame::new(0x7FF, &[7; 8]).unwrap().data(), [7; 8]);
        assert_eq!(Frame::new(0, &[]).unwrap().data(), []);
        assert_eq!(Frame::new(0x800, &[]), None);
        assert_eq!(Frame::new(0, &[7; 9]), None);
    }

    #[test]
    fn a_node_is_1_to_127() {
        assert_eq!([0, 1, 127, 128].map(|id| NodeId::new(id).is_some()), [false, true, true, false]);
        assert_eq!(NodeId::new(0x7F).unwrap().cob(0x580), 0x5FF);
    }
}
