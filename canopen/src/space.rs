//! One address space: the node's own objects and those of the device.

use super::communication::CommunicationObjects;
use super::objects::{CommunicationObject, find};
use super::{Abort, Access, DataType, Dictionary, LONGEST, ObjectHandle, Written};

/// Index and sub-index.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Address {
    pub index: u16,
    pub sub: u8,
}

/// An object that was looked up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Object {
    pub kind: DataType,
    access: Access,
    at: At,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum At {
    Own(CommunicationObject),
    Device(ObjectHandle),
}

/// Everything that an SDO can reach.
pub(super) struct Space<'a> {
    pub objects: &'a mut CommunicationObjects,
    pub dictionary: &'a mut dyn Dictionary,
}

impl Space<'_> {
    fn find(&self, address: Address) -> Result<Object, Abort> {
        match address.index {
            0..=0x0FFF => Err(Abort::NoObject),
            0x1000..=0x1FFF => {
                let object = find(address.index, address.sub)?;
                Ok(Object { kind: object.kind, access: object.access, at: At::Own(object) })
            }
            _ => {
                let entry = self.dictionary.entry(address.index, address.sub)?;
                Ok(Object { kind: entry.kind, access: entry.access, at: At::Device(entry.place) })
            }
        }
    }

    /// Looks up what is to be read.
    pub fn readable(&self, address: Address) -> Result<Object, Abort> {
        let object = self.find(address)?;
        if object.access.readable() { Ok(object) } else { Err(Abort::WriteOnly) }
    }

    /// Looks up what is to be written with `length` bytes, if that is known.
    pub fn writable(&self, address: Address, length: Option<u32>) -> Result<Object, Abort> {
        let object = self.find(address)?;
        if !object.access.writable() {
            return Err(Abort::ReadOnly);
        }
        match (object.kind.size(), length) {
            (Some(size), Some(length)) if length as usize > size => Err(Abort::LengthTooHigh),
            (Some(size), Some(length)) if (length as usize) < size => Err(Abort::LengthTooLow),
            _ => Ok(object),
        }
    }

    pub fn read(&mut self, object: Object, out: &mut [u8]) -> Result<usize, Abort> {
        match object.at {
            At::Own(object) => self.objects.read(object, out),
            At::Device(place) => self.dictionary.read(place, out),
        }
    }

    /// Writes a value whose length was checked.
    pub fn write(&mut self, object: Object, data: &[u8]) -> Result<Written, Abort> {
        match object.at {
            At::Own(object) => self.objects.write(object, data, self.dictionary),
            At::Device(place) => self.dictionary.write(place, data),
        }
    }

    /// Looks up what is to be written by a transfer in parts: whether in pieces, and how long it may be.
    pub fn target(&self, address: Address, announced: Option<u32>) -> Result<bool, Abort> {
        let streams = self.writable(address, announced)?.kind == DataType::Domain;
        let most = if streams { self.objects.device.update } else { LONGEST as u32 };
        if announced.is_some_and(|announced| announced > most) { Err(Abort::OutOfMemory) } else { Ok(streams) }
    }

    pub fn stream_length(&self, object: Object) -> Result<u32, Abort> {
        match object.at {
            At::Own(_) => Err(Abort::Unsupported),
            At::Device(place) => self.dictionary.stream_length(place),
        }
    }

    pub fn stream(&self, object: Object, offset: u32, out: &mut [u8]) -> Result<(), Abort> {
        match object.at {
            At::Own(_) => Err(Abort::Unsupported),
            At::Device(place) => self.dictionary.stream(place, offset, out),
        }
    }
}
