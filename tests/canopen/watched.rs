//! A node that is watched while it is told anything at all.

use crate::machine::{DEVICE, Machine, parameters};
use edm_servo_head::canopen::{Abort, BusSettings, Frame, Group, NmtState, Node, NodeId, Record, Time};

/// Node-ID.
pub const ID: u16 = 0x20;

/// What one frame or one call may do.
#[derive(Clone, Copy, PartialEq, Eq)]
enum May {
    /// Change nothing.
    Nothing,
    /// Change objects of the device: process data.
    Objects,
    /// Change anything: a write that was accepted, or a reset.
    Anything,
}

/// A node, its machine, and what both looked like before.
pub struct Watched {
    pub node: Node,
    pub machine: Machine,
    pub now: u64,
    image: Vec<Record>,
    may_change: bool,
    steps: u32,
    written: u32,
    /// Writes by SDO that were accepted, each way.
    pub expedited: u32,
    pub segmented: u32,
    pub block: u32,
    /// Transfers that were refused.
    pub refused: u32,
    /// The last answer to an SDO request.
    pub answer: [u8; 8],
}

/// Whether an answer confirms that a value was written.
fn confirms(request: &[u8], answer: &[u8; 8]) -> bool {
    let expedited = request[0] >> 5 == 1 && request[0] & 0x02 != 0;
    let last = request[0] >> 5 == 0 && request[0] & 0x01 != 0;
    (answer[0] == 0x60 && expedited)
        || (answer[0] & 0xEF == 0x20 && last)
        || (answer[0] == 0xA1 && request[0] & 0xE1 == 0xC1)
}

impl Watched {
    /// A node that has booted.
    pub fn new() -> Self {
        let (mut machine, now) = (Machine::new(), 0);
        let mut node = Node::new(&DEVICE, BusSettings::at_1_mbit(NodeId::new(ID as u8)), 7);
        node.boot(None, &mut machine).unwrap();
        let image = parameters(&node);
        Self {
            node,
            machine,
            now,
            image,
            may_change: false,
            steps: 0,
            written: 0,
            expedited: 0,
            segmented: 0,
            block: 0,
            refused: 0,
            answer: [0; 8],
        }
    }

    /// Gives the node a frame.
    pub fn send(&mut self, id: u16, data: &[u8]) {
        self.answer = self.drain().last().unwrap_or(self.answer);
        let operational = self.node.state() == NmtState::Operational;
        let frame = Frame::new(id, data).unwrap();
        self.node.receive(&frame, Time(self.now), &mut self.machine);
        let mut refused = false;
        let mut may = if operational { May::Objects } else { May::Nothing };
        if id == 0x600 + ID {
            may = May::Nothing;
            let mut answers = self.drain();
            if let Some(answer) = answers.next() {
                assert_eq!(data.len(), 8, "{data:x?}");
                may = if confirms(data, &answer) { May::Anything } else { May::Nothing };
                match answer[0] {
                    0x60 if may == May::Anything => {
                        let index = u16::from_le_bytes([data[1], data[2]]);
                        if index >= 0x2000 {
                            let value = self.machine.value(index, data[3]);
                            assert_eq!(value, &data[4..4 + value.len()], "{data:x?}");
                        }
                        self.expedited += 1;
                    }
                    0x20 | 0x30 if may == May::Anything => self.segmented += 1,
                    0xA1 if may == May::Anything => self.block += 1,
                    _ => {}
                }
                refused = answer[0] == 0x80;
                self.refused += u32::from(refused);
                self.answer = answer;
            }
            // The last segment of an upload and the first answer after it is all that may follow.
            self.answer = answers.last().unwrap_or(self.answer);
        }
        if self.node.state() == NmtState::Initialising {
            self.machine.events.clear();
            self.node.boot(None, &mut self.machine).unwrap();
            may = May::Anything;
        }
        self.check(may, refused, data);
    }

    /// Lets time pass.
    pub fn pass(&mut self, us: u64) {
        self.now += us;
        self.node.poll(Time(self.now), &mut self.machine);
        self.answer = self.drain().last().unwrap_or(self.answer);
        self.check(May::Nothing, false, &[]);
    }

    /// A tick of the servo.
    pub fn tick(&mut self) {
        self.node.synchronised(Time(self.now), &mut self.machine);
        self.check(May::Objects, false, &[]);
    }

    /// The device has done what it was asked.
    pub fn answer(&mut self, result: Result<(), Abort>) {
        self.node.answer(Group::All, result, &mut self.machine);
        self.check(May::Nothing, false, &[]);
    }

    /// Takes what the node sends; its SDO answers.
    fn drain(&mut self) -> impl Iterator<Item = [u8; 8]> + use<> {
        let sent: Vec<_> = std::iter::from_fn(|| self.node.take()).collect();
        sent.into_iter().filter(|frame| frame.id() == 0x580 + ID).map(|frame| frame.data().try_into().unwrap())
    }

    fn check(&mut self, may: May, refused: bool, data: &[u8]) {
        self.machine.events.clear();
        self.machine.requests.clear();
        assert!(may != May::Nothing || self.machine.written == self.written, "an object has changed: {data:x?}");
        self.written = self.machine.written;
        // All parameters are many to compare: at once after a refusal, else eight steps together.
        self.may_change |= may == May::Anything;
        self.steps = self.steps.wrapping_add(1);
        if refused || self.steps.is_multiple_of(8) {
            let image = parameters(&self.node);
            assert!(self.may_change || image == self.image, "a parameter has changed: {data:x?}");
            (self.image, self.may_change) = (image, false);
        }
    }
}
