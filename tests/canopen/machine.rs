//! A device with one object of each kind.

use edm_servo_head::canopen::{
    Abort, Access, DataType, Device, Dictionary, Entry, Event, LONGEST, Mapping, Node, ObjectHandle, PdoDefault,
    Record, Request, Written, mapped,
};

/// U32, read-write, 10 to 1000.
pub const RANGED: u16 = 0x2000;
/// U16, read-only, by its mapping also RPDO.
pub const READ_ONLY: u16 = 0x2001;
/// U8, write-only, by its mapping also TPDO.
pub const WRITE_ONLY: u16 = 0x2002;
/// VISIBLE_STRING, read-write, at most 100 bytes.
pub const NAME: u16 = 0x2003;
/// DOMAIN, read-only: byte n is n modulo 251.
pub const SCOPE: u16 = 0x2004;
/// I64, read-write.
pub const LONG: u16 = 0x2005;
/// BOOLEAN, read-write.
pub const FLAG: u16 = 0x2006;
/// OCTET_STRING, read-write.
pub const BYTES: u16 = 0x2007;
/// I16 at sub-indices 1 to 8, read-write.
pub const ARRAY: u16 = 0x2008;
/// U32, read-write unless enabled.
pub const GUARDED: u16 = 0x2009;
/// U16, read-write, RPDO.
pub const CONTROL: u16 = 0x6040;
/// U16, read-only, TPDO.
pub const STATUS: u16 = 0x6041;
/// I32, read-only, TPDO.
pub const POSITION: u16 = 0x6064;
/// I32, read-write, RPDO and TPDO.
pub const TARGET: u16 = 0x607A;

/// RPDO1 control word; RPDO2 target, synchronous. TPDO1 status word; TPDO2 position, synchronous.
pub const DEVICE: Device = Device {
    device_type: 0x0002_0192,
    name: "bench machine",
    hardware: "A",
    software: "1.0",
    vendor: 0x1234,
    product: 0x5678,
    update: 2000,
    revision: 0x0001_0002,
    heartbeat: 0,
    receive: [
        PdoDefault { valid: true, entries: &[mapped(CONTROL, 0, 16)], ..PdoDefault::UNUSED },
        PdoDefault { valid: true, transmission: 1, entries: &[mapped(TARGET, 0, 32)], ..PdoDefault::UNUSED },
        PdoDefault::UNUSED,
        PdoDefault::UNUSED,
    ],
    transmit: [
        PdoDefault { valid: true, timer: 50, entries: &[mapped(STATUS, 0, 16)], ..PdoDefault::UNUSED },
        PdoDefault { valid: true, transmission: 1, entries: &[mapped(POSITION, 0, 32)], ..PdoDefault::UNUSED },
        PdoDefault::UNUSED,
        PdoDefault::UNUSED,
    ],
};

/// The values, and what the node has told.
#[derive(Clone, Debug)]
pub struct Machine {
    pub values: Vec<Vec<u8>>,
    pub scope_length: u32,
    pub scope_broken_from: u32,
    pub enabled: bool,
    pub events: Vec<Event>,
    pub requests: Vec<Request>,
    /// Writes that changed a value.
    pub written: u32,
    /// Entries that were looked up.
    pub searches: std::cell::Cell<u32>,
}

const OBJECTS: [(u16, u8, DataType, Access, Mapping); 22] = {
    use Access::{Const, ReadOnly, ReadWrite, WriteOnly};
    use DataType::{
        Boolean, Domain, Integer16, Integer32, Integer64, OctetString, Unsigned8, Unsigned16, Unsigned32, VisibleString,
    };
    use Mapping::{Both, No, Receive, Transmit};
    [
        (RANGED, 0, Unsigned32, ReadWrite, Both),
        (READ_ONLY, 0, Unsigned16, ReadOnly, Both),
        (WRITE_ONLY, 0, Unsigned8, WriteOnly, Both),
        (NAME, 0, VisibleString, ReadWrite, No),
        (SCOPE, 0, Domain, ReadOnly, No),
        (LONG, 0, Integer64, ReadWrite, Both),
        (FLAG, 0, Boolean, ReadWrite, Both),
        (BYTES, 0, OctetString, ReadWrite, No),
        (ARRAY, 0, Unsigned8, Const, No),
        (ARRAY, 1, Integer16, ReadWrite, Both),
        (ARRAY, 2, Integer16, ReadWrite, Both),
        (ARRAY, 3, Integer16, ReadWrite, Both),
        (ARRAY, 4, Integer16, ReadWrite, Both),
        (ARRAY, 5, Integer16, ReadWrite, Both),
        (ARRAY, 6, Integer16, ReadWrite, Both),
        (ARRAY, 7, Integer16, ReadWrite, Both),
        (ARRAY, 8, Integer16, ReadWrite, Both),
        (GUARDED, 0, Unsigned32, ReadWrite, No),
        (CONTROL, 0, Unsigned16, ReadWrite, Receive),
        (STATUS, 0, Unsigned16, ReadOnly, Transmit),
        (POSITION, 0, Integer32, ReadOnly, Transmit),
        (TARGET, 0, Integer32, ReadWrite, Both),
    ]
};

/// Where [`Machine::values`] has an object.
pub fn place(index: u16, sub: u8) -> usize {
    OBJECTS.iter().position(|object| (object.0, object.1) == (index, sub)).unwrap()
}

impl Machine {
    pub fn new() -> Self {
        let mut values: Vec<_> = OBJECTS.map(|(_, _, kind, ..)| vec![0; kind.size().unwrap_or(0)]).to_vec();
        values[place(RANGED, 0)] = 500u32.to_le_bytes().to_vec();
        values[place(ARRAY, 0)] = vec![8];
        Self {
            values,
            scope_length: 5000,
            scope_broken_from: u32::MAX,
            enabled: false,
            events: vec![],
            requests: vec![],
            written: 0,
            searches: 0.into(),
        }
    }

    /// The bytes of a value.
    pub fn value(&self, index: u16, sub: u8) -> &[u8] {
        &self.values[place(index, sub)]
    }
}

/// The communication parameters of a node, as they are stored.
pub fn parameters(node: &Node) -> Vec<Record> {
    let mut all = vec![];
    node.parameters(&mut |record| all.push(record));
    all
}

/// A byte of the domain.
pub fn scope(n: u32) -> u8 {
    (n % 251) as u8
}

impl Dictionary for Machine {
    fn entry(&self, index: u16, sub: u8) -> Result<Entry, Abort> {
        self.searches.set(self.searches.get() + 1);
        let at = OBJECTS.iter().position(|object| (object.0, object.1) == (index, sub));
        let Some(at) = at else {
            let any = OBJECTS.iter().any(|object| object.0 == index);
            return Err(if any { Abort::NoSubIndex } else { Abort::NoObject });
        };
        let (.., kind, access, mapping) = OBJECTS[at];
        Ok(Entry { kind, access, mapping, place: ObjectHandle(at as u16) })
    }

    fn read(&self, place: ObjectHandle, out: &mut [u8]) -> Result<usize, Abort> {
        let value = &self.values[usize::from(place.0)];
        assert!(out.len() >= value.len());
        out[..value.len()].copy_from_slice(value);
        Ok(value.len())
    }

    fn write(&mut self, place: ObjectHandle, data: &[u8]) -> Result<Written, Abort> {
        let (index, _, kind, access, _) = OBJECTS[usize::from(place.0)];
        assert!(access.writable() && kind.size().is_none_or(|size| size == data.len()), "{index:x} {data:?}");
        assert!(data.len() <= LONGEST);
        match index {
            RANGED => match u32::from_le_bytes(data.try_into().unwrap()) {
                0..10 => return Err(Abort::ValueTooLow),
                1001.. => return Err(Abort::ValueTooHigh),
                _ => {}
            },
            NAME if data.len() > 100 => return Err(Abort::LengthTooHigh),
            FLAG if data[0] > 1 => return Err(Abort::InvalidValue),
            GUARDED if self.enabled => return Err(Abort::DeviceState),
            _ => {}
        }
        let value = &mut self.values[usize::from(place.0)];
        value.clear();
        value.extend_from_slice(data);
        self.written += 1;
        Ok(Written::Now)
    }

    fn stream_length(&self, _place: ObjectHandle) -> Result<u32, Abort> {
        if self.enabled { Err(Abort::DeviceState) } else { Ok(self.scope_length) }
    }

    fn stream(&self, _place: ObjectHandle, offset: u32, out: &mut [u8]) -> Result<(), Abort> {
        let end = offset + out.len() as u32;
        assert!(!out.is_empty() && end <= self.scope_length);
        if end > self.scope_broken_from {
            return Err(Abort::DeviceState);
        }
        out.iter_mut().zip(offset..).for_each(|(out, n)| *out = scope(n));
        Ok(())
    }

    fn request(&mut self, request: Request) -> Result<(), Abort> {
        if self.enabled {
            return Err(Abort::DeviceState);
        }
        self.requests.push(request);
        Ok(())
    }

    fn event(&mut self, event: Event) {
        self.events.push(event);
    }
}
