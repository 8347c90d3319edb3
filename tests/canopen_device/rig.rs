//! A node on a bus of its own: node, drive, head and process model, a millisecond at a time, and a master that speaks
//! expedited SDO.

use edm_servo_head::canopen::drive::{BLANK, DEVICE, Drive, Identity, Order};
use edm_servo_head::canopen::{Abort, BusSettings, Frame, Node, NodeId, Time};
use edm_servo_head::head::State;
use edm_servo_head::settings::Settings;
use edm_servo_head::stored::StoredImage;
use edm_servo_head::units::TICKS_PER_MS;
use edm_sim::machine::Machine;
use edm_sim::process::Plant;

pub const ID: u8 = 5;

pub struct Rig {
    /// Its node-ID.
    pub id: u8,
    pub node: Node,
    pub drive: Drive,
    pub machine: Machine,
    /// What has been stored.
    pub image: StoredImage,
    /// Frames that the node has sent, with the millisecond.
    pub sent: Vec<(u64, Frame)>,
    pub ms: u64,
    pub states: Vec<State>,
}

impl Rig {
    pub fn new(change: impl FnOnce(&mut Settings, &mut Plant)) -> Rig {
        Rig::with_id(ID, change)
    }

    /// One of several on a bus.
    pub fn with_id(id: u8, change: impl FnOnce(&mut Settings, &mut Plant)) -> Rig {
        let mut settings = Settings { commissioned: true, ..Settings::default() };
        let mut plant = Plant::default();
        change(&mut settings, &mut plant);
        let record = Box::leak(Box::new(BLANK));
        let mut drive =
            Drive::new(settings, Identity { reset_cause: 7, build: "test", ..Identity::default() }, record).unwrap();
        let mut node = Node::new(&DEVICE, BusSettings::at_1_mbit(NodeId::new(id)), 1234);
        node.boot(None, &mut drive).unwrap();
        let machine = Machine::new(plant, &settings, 1).unwrap();
        let mut rig =
            Rig { id, node, drive, machine, image: StoredImage::NOTHING, sent: Vec::new(), ms: 0, states: Vec::new() };
        rig.run(20);
        rig
    }

    /// Operational, homed at the upper limit, enabled in no mode.
    pub fn ready() -> Rig {
        let mut rig = Rig::new(|_, _| {});
        rig.make_ready();
        rig
    }

    /// The same, of one that was made otherwise.
    pub fn make_ready(&mut self) {
        let rig = self;
        rig.send(0, &[1, rig.id]);
        rig.enable();
        rig.write(0x6098, 0, &[35]);
        rig.write(0x6060, 0, &[6]);
        rig.control(0x0F);
        rig.control(0x1F);
        rig.until(100, |rig| rig.status() & 0x3400 == 0x1400);
        rig.control(0x0F);
    }

    /// The true count at which the electrode meets the highest peak of the work.
    pub fn highest_peak(&self) -> i64 {
        let truth = self.machine.process.truth();
        (truth.position_um + truth.least_um).round() as i64
    }

    /// One millisecond.
    pub fn step(&mut self) {
        let now = Time(self.ms * 1000);
        self.drive.set_steps(self.machine.steps());
        self.drive.observe(self.machine.status());
        while let Some(change) = self.machine.next_change() {
            self.states.push(change.to);
            self.drive.changed(change);
        }
        while let Some(result) = self.machine.next_check() {
            self.drive.checked(result);
        }
        self.node.synchronised(now, &mut self.drive);
        self.node.poll(now, &mut self.drive);
        self.drive.poll(now, &mut self.node);
        self.orders();
        while let Some(frame) = self.node.take() {
            self.sent.push((self.ms, frame));
        }
        for _ in 0..TICKS_PER_MS {
            self.machine.tick();
        }
        self.ms += 1;
    }

    fn orders(&mut self) {
        while let Some(order) = self.drive.take() {
            self.carry_out(order);
        }
    }

    /// Does what the drive wants done.
    pub fn carry_out(&mut self, order: Order) {
        match order {
            Order::Command(command) => {
                let result = self.machine.command(command);
                self.drive.answered(command, result);
            }
            Order::Configure => {
                let result = self.machine.configure(self.drive.active());
                match result {
                    Ok(()) => self.drive.runs_configuration(),
                    Err(_) => self.drive.refused_configuration(),
                }
                self.node.written(result.map_err(|_| Abort::DeviceState), &mut self.drive);
            }
            Order::Raise(fault) => self.machine.raise(fault),
            Order::Store(group) => {
                assert_eq!(self.machine.status().state, State::Disabled);
                self.image.keep(group, &self.drive, &self.node).unwrap();
                self.drive.stored(&mut self.node, group, Ok(()));
            }
            Order::Restore(group) => {
                self.image.forget(group);
                self.drive.stored(&mut self.node, group, Ok(()));
            }
            // Answered by idle, which this rig has not: tests/runtime.
            Order::Update(_) => {}
            Order::ResetNode => {
                let defaults = Settings { commissioned: true, ..Settings::default() };
                self.drive.restart(defaults, &self.image);
                self.drive.boot(&mut self.node, &self.image).unwrap();
            }
            Order::ResetCommunication => {
                self.drive.boot(&mut self.node, &self.image).unwrap();
            }
        }
    }

    pub fn run(&mut self, ms: u64) {
        for _ in 0..ms {
            self.step();
        }
    }

    pub fn until(&mut self, ms: u64, mut done: impl FnMut(&mut Rig) -> bool) {
        for _ in 0..ms {
            self.step();
            if done(self) {
                return;
            }
        }
        panic!("not within {ms} ms: statusword {:#06x}, {:?}", self.drive.statusword(), self.machine.status());
    }

    pub fn send(&mut self, id: u16, data: &[u8]) {
        self.node.receive(&Frame::new(id, data).unwrap(), Time(self.ms * 1000), &mut self.drive);
    }

    fn exchange(&mut self, request: [u8; 8]) -> [u8; 8] {
        self.send(0x600 + u16::from(self.id), &request);
        for _ in 0..10 {
            let seen = self.sent.len();
            self.step();
            let answer = self.sent[seen..].iter().find(|(_, frame)| frame.id() == 0x580 + u16::from(self.id));
            if let Some((_, frame)) = answer {
                return frame.data().try_into().unwrap();
            }
        }
        panic!("no answer to {request:x?}");
    }

    pub fn try_write(&mut self, index: u16, sub: u8, value: &[u8]) -> Result<(), u32> {
        let [low, high] = index.to_le_bytes();
        let mut request = [0x23 | ((4 - value.len() as u8) << 2), low, high, sub, 0, 0, 0, 0];
        request[4..4 + value.len()].copy_from_slice(value);
        let answer = self.exchange(request);
        if answer[0] == 0x60 { Ok(()) } else { Err(u32::from_le_bytes(answer[4..].try_into().unwrap())) }
    }

    pub fn write(&mut self, index: u16, sub: u8, value: &[u8]) {
        if let Err(abort) = self.try_write(index, sub, value) {
            panic!("{index:04x}:{sub:02x} refused: {abort:#010x}");
        }
    }

    pub fn write32(&mut self, index: u16, sub: u8, value: i32) {
        self.write(index, sub, &value.to_le_bytes());
    }

    pub fn try_read(&mut self, index: u16, sub: u8) -> Result<u32, u32> {
        let [low, high] = index.to_le_bytes();
        let answer = self.exchange([0x40, low, high, sub, 0, 0, 0, 0]);
        let number = u32::from_le_bytes(answer[4..].try_into().unwrap());
        if answer[0] & 0xE3 == 0x43 { Ok(number) } else { Err(number) }
    }

    pub fn read(&mut self, index: u16, sub: u8) -> u32 {
        self.try_read(index, sub).unwrap_or_else(|abort| panic!("{index:04x}:{sub:02x}: {abort:#010x}"))
    }

    /// A value of any length, in segments.
    pub fn upload(&mut self, index: u16, sub: u8) -> Vec<u8> {
        let [low, high] = index.to_le_bytes();
        let answer = self.exchange([0x40, low, high, sub, 0, 0, 0, 0]);
        assert_eq!(answer[0], 0x41, "announced: {answer:x?}");
        let length = u32::from_le_bytes(answer[4..].try_into().unwrap()) as usize;
        let (mut value, mut toggle) = (Vec::new(), 0);
        loop {
            let [command, data @ ..] = self.exchange([0x60 | toggle, 0, 0, 0, 0, 0, 0, 0]);
            assert_eq!(command & 0xF0, toggle, "{command:x}");
            value.extend(&data[..7 - usize::from(command >> 1 & 7)]);
            if command & 1 != 0 {
                assert_eq!(value.len(), length);
                return value;
            }
            toggle ^= 0x10;
        }
    }

    /// The same by blocks of so many segments, with the checksum.
    pub fn block_upload(&mut self, index: u16, sub: u8, block: u8) -> Vec<u8> {
        let [low, high] = index.to_le_bytes();
        let answer = self.exchange([0xA4, low, high, sub, block, 0, 0, 0]);
        assert_eq!(answer[0], 0xC6, "{answer:x?}");
        let length = u32::from_le_bytes(answer[4..].try_into().unwrap()) as usize;
        let (mut value, mut next) = (Vec::new(), [0xA3, 0, 0, 0, 0, 0, 0, 0]);
        loop {
            let seen = self.sent.len();
            self.send(0x600 + u16::from(self.id), &next);
            self.run(40);
            let answers = self.sent[seen..].iter().filter(|(_, frame)| frame.id() == 0x580 + u16::from(self.id));
            let (mut segment, mut complete) = (0, false);
            for (_, frame) in answers {
                assert_eq!(frame.data()[0] & 0x7F, segment + 1);
                segment += 1;
                value.extend(&frame.data()[1..]);
                complete = frame.data()[0] & 0x80 != 0;
            }
            next = [0xA2, segment, block, 0, 0, 0, 0, 0];
            if complete {
                break;
            }
            assert_eq!(segment, block, "a block that is not full, and not the last");
        }
        let [command, crc_low, crc_high, ..] = self.exchange(next);
        assert_eq!(command & 0xE3, 0xC1);
        value.truncate(value.len() - usize::from(command >> 2 & 7));
        assert_eq!((value.len(), crc(&value)), (length, u16::from_le_bytes([crc_low, crc_high])));
        self.send(0x600 + u16::from(self.id), &[0xA1, 0, 0, 0, 0, 0, 0, 0]);
        value
    }

    pub fn read_real(&mut self, (index, sub): (u16, u8)) -> f32 {
        f32::from_bits(self.read(index, sub))
    }

    pub fn control(&mut self, word: u16) {
        self.write(0x6040, 0, &word.to_le_bytes());
        self.run(2);
    }

    pub fn enable(&mut self) {
        for word in [0x06, 0x07, 0x0F] {
            self.control(word);
        }
        self.until(5, |rig| rig.status() & 0x6F == 0x27);
    }

    /// The statusword.
    pub fn status(&self) -> u16 {
        self.drive.statusword()
    }

    pub fn mode(&mut self, mode: u8) {
        self.write(0x6060, 0, &[mode]);
        assert_eq!(self.read(0x6061, 0), u32::from(mode));
    }

    pub fn position(&self) -> i64 {
        self.machine.status().position
    }

    /// A profile position move, waited for.
    pub fn move_to(&mut self, target: i32, ms: u64) {
        self.write32(0x607A, 0, target);
        self.control(0x0F);
        self.control(0x1F);
        assert_ne!(self.status() & 0x1000, 0, "acknowledged");
        self.until(ms, |rig| rig.status() & 0x0400 != 0);
        self.control(0x0F);
    }
}

/// Checksum of block transfers, bit by bit from the polynomial.
fn crc(data: &[u8]) -> u16 {
    data.iter().fold(0, |crc: u16, byte| {
        (0..8).fold(crc ^ u16::from(*byte) << 8, |crc, _| crc << 1 ^ if crc & 0x8000 != 0 { 0x1021 } else { 0 })
    })
}
