//! One node with its machine on a bus, and a host that speaks SDO.

use crate::machine::{DEVICE, Machine, place, scope};
use edm_servo_head::canopen::{BusSettings, Frame, Node, NodeId, Restored, Time};

/// Node-ID of the bench.
pub const ID: u16 = 0x20;
/// Its serial number.
pub const SERIAL: u32 = 7;

pub struct Bench {
    pub node: Node,
    pub machine: Machine,
    pub now: u64,
}

/// Little-endian word at the end of an answer.
pub fn word(answer: [u8; 8]) -> u32 {
    u32::from_le_bytes(answer[4..].try_into().unwrap())
}

/// A request with an address.
pub fn request(command: u8, index: u16, sub: u8, rest: [u8; 4]) -> [u8; 8] {
    let [low, high] = index.to_le_bytes();
    [command, low, high, sub, rest[0], rest[1], rest[2], rest[3]]
}

/// A request with seven bytes at the most.
pub fn segment(command: u8, data: &[u8]) -> [u8; 8] {
    let mut segment = [command, 0, 0, 0, 0, 0, 0, 0];
    segment[1..=data.len()].copy_from_slice(data);
    segment
}

/// Checksum of block transfers, bit by bit from the polynomial.
pub fn crc(data: &[u8]) -> u16 {
    let mut crc = 0u32;
    for byte in data {
        crc ^= u32::from(*byte) << 8;
        for _ in 0..8 {
            crc <<= 1;
            if crc > 0xFFFF {
                crc ^= 0x1_1021;
            }
        }
    }
    crc as u16
}

impl Bench {
    /// Switched on, boot-up taken off the bus.
    pub fn new() -> Self {
        let mut bench = Self::silent();
        assert_eq!(bench.node.boot(None, &mut bench.machine), Ok(Restored::default()));
        assert_eq!(bench.frames(), [Frame::new(0x700 + ID, &[0]).unwrap()]);
        bench
    }

    /// The same, operational, first TPDOs taken off the bus.
    pub fn operational() -> Self {
        let mut bench = Self::new();
        bench.send(0, &[1, ID as u8]);
        bench.pass(1_000);
        bench
    }

    /// Not booted.
    pub fn silent() -> Self {
        Self::unbooted(NodeId::new(ID as u8), SERIAL)
    }

    /// Not booted, with this node-ID or none, and this serial number.
    pub fn unbooted(id: Option<NodeId>, serial: u32) -> Self {
        Self { node: Node::new(&DEVICE, BusSettings::at_1_mbit(id), serial), machine: Machine::new(), now: 1_000_000 }
    }

    /// What waits to be sent.
    pub fn frames(&mut self) -> Vec<Frame> {
        std::iter::from_fn(|| self.node.take()).collect()
    }

    /// Gives the node a frame; what it sends at once.
    pub fn send(&mut self, id: u16, data: &[u8]) -> Vec<Frame> {
        self.node.receive(&Frame::new(id, data).unwrap(), Time(self.now), &mut self.machine);
        self.frames()
    }

    /// Lets time pass, polled once a millisecond; what the node sends meanwhile, with its time.
    pub fn pass(&mut self, us: u64) -> Vec<(u64, Frame)> {
        let mut sent = vec![];
        let end = self.now + us;
        while self.now < end {
            self.now = end.min(self.now + 1_000);
            self.node.poll(Time(self.now), &mut self.machine);
            sent.extend(self.frames().into_iter().map(|frame| (self.now, frame)));
        }
        sent
    }

    /// The same, without the times, and of one identifier.
    pub fn pass_for(&mut self, us: u64, id: u16) -> Vec<Vec<u8>> {
        let sent = self.pass(us).into_iter();
        sent.filter(|(_, frame)| frame.id() == id).map(|(_, frame)| frame.data().to_vec()).collect()
    }

    /// The tick that acts on a SYNC.
    pub fn tick(&mut self) -> Option<Time> {
        self.node.synchronised(Time(self.now), &mut self.machine)
    }

    /// An SDO request; the answers.
    pub fn sdo(&mut self, request: [u8; 8]) -> Vec<[u8; 8]> {
        let answers = self.send(0x600 + ID, &request).into_iter();
        answers.filter(|frame| frame.id() == 0x580 + ID).map(|frame| frame.data().try_into().unwrap()).collect()
    }

    /// An SDO request with exactly one answer.
    pub fn ask(&mut self, request: [u8; 8]) -> [u8; 8] {
        let answers = self.sdo(request);
        assert_eq!(answers.len(), 1, "{request:x?} -> {answers:x?}");
        answers[0]
    }

    /// The abort code that answers a request.
    pub fn refusal(&mut self, request: [u8; 8]) -> u32 {
        let answer = self.ask(request);
        assert_eq!(answer[0], 0x80, "{answer:x?}");
        word(answer)
    }

    /// Reads a value, expedited or segmented; the abort code if it is refused.
    pub fn read(&mut self, index: u16, sub: u8) -> Result<Vec<u8>, u32> {
        let answer = self.ask(request(0x40, index, sub, [0; 4]));
        assert_eq!(answer[1..4], request(0, index, sub, [0; 4])[1..4]);
        match answer[0] {
            0x80 => return Err(word(answer)),
            0x41 => {}
            command => return Ok(answer[4..8 - usize::from(command >> 2 & 3)].to_vec()),
        }
        let mut value = vec![];
        for toggle in [0x00, 0x10].into_iter().cycle() {
            let part = self.ask(segment(0x60 | toggle, &[]));
            if part[0] == 0x80 {
                return Err(word(part));
            }
            assert_eq!(part[0] & 0xF0, toggle);
            value.extend(&part[1..8 - usize::from(part[0] >> 1 & 7)]);
            if part[0] & 1 != 0 {
                break;
            }
        }
        assert_eq!(value.len(), word(answer) as usize);
        Ok(value)
    }

    /// The same as a number.
    pub fn number(&mut self, index: u16, sub: u8) -> u32 {
        let mut value = self.read(index, sub).unwrap();
        value.resize(4, 0);
        u32::from_le_bytes(value.try_into().unwrap())
    }

    /// Writes a value, expedited up to four bytes, else segmented; the abort code if it is refused.
    pub fn write(&mut self, index: u16, sub: u8, value: &[u8]) -> Result<(), u32> {
        if matches!(value.len(), 1..=4) {
            let mut rest = [0; 4];
            rest[..value.len()].copy_from_slice(value);
            let answer = self.ask(request(0x23 | (4 - value.len() as u8) << 2, index, sub, rest));
            return if answer[0] == 0x60 { Ok(()) } else { Err(word(answer)) };
        }
        let answer = self.ask(request(0x21, index, sub, (value.len() as u32).to_le_bytes()));
        if answer[0] != 0x60 {
            return Err(word(answer));
        }
        let mut parts = value.chunks(7).peekable();
        for toggle in [0x00, 0x10].into_iter().cycle() {
            let part = parts.next().unwrap_or(&[]);
            let last = u8::from(parts.peek().is_none());
            let answer = self.ask(segment(toggle | (7 - part.len() as u8) << 1 | last, part));
            if answer[0] == 0x80 {
                return Err(word(answer));
            }
            assert_eq!(answer, segment(0x20 | toggle, &[]));
            if last == 1 {
                break;
            }
        }
        Ok(())
    }

    /// Writes a number of the length that the object has.
    pub fn set(&mut self, index: u16, sub: u8, bytes: usize, value: u32) -> Result<(), u32> {
        self.write(index, sub, &value.to_le_bytes()[..bytes])
    }
}

/// What a test, and nobody else, does to the device.
impl Machine {
    /// Changes a value from inside.
    pub fn set(&mut self, index: u16, value: &[u8]) {
        self.values[place(index, 0)] = value.to_vec();
    }

    /// The content of the domain.
    pub fn scope(&self) -> Vec<u8> {
        (0..self.scope_length).map(scope).collect()
    }
}
