//! An update of the program on its way through the node: in pieces, each taken by the device before the client goes on.

use crate::bench::{Bench, ID, crc, request, segment, word};
use edm_servo_head::canopen::{Abort, Frame, Group, Request, Update};

const PROGRAM: u16 = 0x1F50;
const CONTROL: u16 = 0x1F51;
/// As the device of the bench has it.
const LONGEST: usize = 2000;

/// What the device has taken, and what it says to each piece.
struct Device {
    taken: Vec<u8>,
    pieces: usize,
    ends: usize,
    refuses: Option<(usize, Abort)>,
}

impl Device {
    fn new() -> Device {
        Device { taken: Vec::new(), pieces: 0, ends: 0, refuses: None }
    }

    /// Does what the node has asked for; what it then sends.
    fn work(&mut self, bench: &mut Bench) -> Vec<[u8; 8]> {
        let mut answers = Vec::new();
        for request in std::mem::take(&mut bench.machine.requests) {
            let Request::Update(update) = request else { panic!("{request:?}") };
            assert!(matches!(update, Update::Piece | Update::Last), "{update:?}");
            let (at, bytes) = bench.node.piece().expect("there is a piece");
            assert_eq!((at as usize, bytes.len() % 4), (self.taken.len(), 0));
            self.pieces += 1;
            self.ends += usize::from(update == Update::Last);
            let refused = self.refuses.filter(|(piece, _)| *piece == self.pieces).map(|(_, abort)| abort);
            if refused.is_none() {
                self.taken.extend_from_slice(bytes);
            }
            bench.node.answer(Group::All, refused.map_or(Ok(()), Err), &mut bench.machine);
            let frames = bench.frames();
            answers.extend(frames.iter().map(|frame| <[u8; 8]>::try_from(frame.data()).unwrap()));
        }
        answers
    }

    fn sdo(&mut self, bench: &mut Bench, request: [u8; 8]) -> Vec<[u8; 8]> {
        let mut answers = bench.sdo(request);
        answers.extend(self.work(bench));
        answers
    }

    fn ask(&mut self, bench: &mut Bench, request: [u8; 8]) -> Result<[u8; 8], u32> {
        let answers = self.sdo(bench, request);
        let [answer] = answers[..] else { panic!("{request:x?}: {answers:x?}") };
        if answer[0] == 0x80 { Err(word(answer)) } else { Ok(answer) }
    }
}

/// Writes an update by blocks; every `lost`th segment does not come the first time.
fn by_blocks(bench: &mut Bench, device: &mut Device, value: &[u8], lost: usize, checked: u16) -> Result<(), u32> {
    let length = (value.len() as u32).to_le_bytes();
    let [0xA4, _, _, _, block, ..] = device.ask(bench, request(0xC6, PROGRAM, 1, length))? else { panic!() };
    let parts: Vec<_> = value.chunks(7).collect();
    let (mut done, mut sent) = (0, 0);
    while done < parts.len() {
        let end = (done + usize::from(block)).min(parts.len());
        let mut answers = Vec::new();
        for place in done..end {
            sent += 1;
            let last = u8::from(place + 1 == parts.len()) << 7;
            // The last of a block is not lost: the client would wait for a time-out.
            if lost == 0 || ((sent * 0x9E37_79B9) >> 20) % lost != 0 || place + 1 == end {
                assert!(answers.is_empty());
                answers = device.sdo(bench, segment(last | (place - done + 1) as u8, parts[place]));
            }
        }
        let [answer] = answers[..] else { panic!("{answers:x?}") };
        if answer[0] == 0x80 {
            return Err(word(answer));
        }
        assert_eq!(answer[0], 0xA2);
        done += usize::from(answer[1]);
    }
    let unused = (7 * parts.len() - value.len()) as u8;
    assert_eq!(device.ask(bench, segment(0xC1 | unused << 2, &checked.to_le_bytes()))?, segment(0xA1, &[]));
    Ok(())
}

fn by_segments(bench: &mut Bench, device: &mut Device, value: &[u8], announced: bool) -> Result<(), u32> {
    let length = (value.len() as u32 * u32::from(announced)).to_le_bytes();
    device.ask(bench, request(0x20 | u8::from(announced), PROGRAM, 1, length))?;
    let count = value.len().div_ceil(7);
    for (place, part) in value.chunks(7).enumerate() {
        let toggle = (place as u8 & 1) << 4;
        let last = u8::from(place + 1 == count);
        let answer = device.ask(bench, segment(toggle | (7 - part.len() as u8) << 1 | last, part))?;
        assert_eq!(answer[0], 0x20 | toggle);
    }
    Ok(())
}

fn update(length: usize) -> Vec<u8> {
    (0..length).map(|n| (n * 7 + n / 256) as u8).collect()
}

#[test]
fn whatever_its_length_it_reaches_the_device_whole_and_in_order() {
    for length in (4..=LONGEST).step_by(4).filter(|length| length % 52 == 0 || *length < 460 || *length > 1980) {
        let value = update(length);
        for lost in [0, 5, 13] {
            let (mut bench, mut device) = (Bench::new(), Device::new());
            assert_eq!(by_blocks(&mut bench, &mut device, &value, lost, crc(&value)), Ok(()), "{length}, {lost}");
            assert!(device.taken == value && device.ends == 1, "{length}, {lost}");
        }
        for announced in [true, false] {
            let (mut bench, mut device) = (Bench::new(), Device::new());
            assert_eq!(by_segments(&mut bench, &mut device, &value, announced), Ok(()), "{length}");
            assert!(device.taken == value && device.ends == 1, "{length}");
        }
    }
}

#[test]
fn what_is_not_right_is_refused_before_the_device_hears_that_it_is_whole() {
    let value = update(900);
    let (mut bench, mut device) = (Bench::new(), Device::new());
    assert_eq!(by_blocks(&mut bench, &mut device, &value, 0, !crc(&value)), Err(Abort::Crc.code()));
    // Half a word.
    for length in [899, 901, 902] {
        let value = update(length);
        assert_eq!(by_blocks(&mut bench, &mut Device::new(), &value, 0, crc(&value)), Err(Abort::Length.code()));
        assert_eq!(by_segments(&mut bench, &mut Device::new(), &value, true), Err(Abort::Length.code()));
    }
    let long = update(LONGEST + 4);
    assert_eq!(by_blocks(&mut bench, &mut device, &long, 0, crc(&long)), Err(Abort::OutOfMemory.code()));
    assert_eq!(by_segments(&mut bench, &mut device, &long, true), Err(Abort::OutOfMemory.code()));
    // In one frame, and read back.
    assert_eq!(bench.refusal(request(0x23, PROGRAM, 1, [0; 4])), Abort::LengthTooLow.code());
    assert_eq!(bench.refusal(request(0x40, PROGRAM, 1, [0; 4])), Abort::WriteOnly.code());
    assert_eq!(device.ends, 0);
}

#[test]
fn what_the_device_refuses_ends_the_transfer() {
    let value = update(900);
    for piece in 1..=5 {
        let (mut bench, mut device) = (Bench::new(), Device::new());
        device.refuses = Some((piece, Abort::DeviceState));
        assert_eq!(by_blocks(&mut bench, &mut device, &value, 0, crc(&value)), Err(Abort::DeviceState.code()));
        assert!(value.starts_with(&device.taken) && device.taken.len() < 900);
        // The next begins at the front.
        let mut device = Device::new();
        assert_eq!(by_segments(&mut bench, &mut device, &value, true), Ok(()));
        assert_eq!(device.taken, value);
    }
    // At once, when it may not even be asked.
    let mut bench = Bench::new();
    bench.machine.enabled = true;
    assert_eq!(by_blocks(&mut bench, &mut Device::new(), &value, 0, 0), Err(Abort::DeviceState.code()));
}

#[test]
fn who_gives_up_leaves_no_piece_behind() {
    let value = update(900);
    let mut bench = Bench::new();
    bench.ask(request(0xC6, PROGRAM, 1, 900u32.to_le_bytes()));
    for (n, part) in (1..=31).zip(value.chunks(7)) {
        assert_eq!(bench.sdo(segment(n, part)), [[0; 8]; 0]);
    }
    assert_eq!(bench.node.piece().map(|(at, bytes)| (at, bytes.len())), Some((0, 216)));
    assert_eq!(bench.sdo(request(0x80, PROGRAM, 1, [0; 4])), [[0; 8]; 0]);
    assert!(bench.node.piece().is_none());
    // What the device says to it then is no answer to the next.
    bench.ask(request(0xC6, PROGRAM, 1, 900u32.to_le_bytes()));
    bench.node.answer(Group::All, Err(Abort::Hardware), &mut bench.machine);
    assert!(bench.frames().is_empty());
    // A device that takes its time is not a client that is silent.
    for (n, part) in (1..=31).zip(value.chunks(7)) {
        bench.sdo(segment(n, part));
    }
    assert_eq!(bench.pass_for(3_000_000, 0x580 + ID), Vec::<Vec<u8>>::new());
    bench.node.answer(Group::All, Ok(()), &mut bench.machine);
    assert_eq!(bench.frames().iter().map(Frame::data).collect::<Vec<_>>(), [segment(0xA2, &[31, 31])]);
    // And a client that is silent then is given up.
    let gone = bench.pass_for(3_000_000, 0x580 + ID);
    assert_eq!(gone, [request(0x80, PROGRAM, 1, Abort::TimedOut.code().to_le_bytes()).to_vec()]);
}

#[test]
fn the_control_asks_the_device_and_the_status_is_what_it_says() {
    let mut bench = Bench::new();
    for (value, update) in [(0, Update::Stop), (1, Update::Start), (3, Update::Clear)] {
        assert_eq!(bench.sdo(request(0x2F, CONTROL, 1, [value, 0, 0, 0])), [[0; 8]; 0]);
        assert_eq!(std::mem::take(&mut bench.machine.requests), [Request::Update(update)]);
        bench.node.answer(Group::All, Ok(()), &mut bench.machine);
        assert_eq!(bench.frames().len(), 1);
    }
    for value in [2, 4, 80] {
        let refused = bench.refusal(request(0x2F, CONTROL, 1, [value, 0, 0, 0]));
        assert_eq!(refused, Abort::InvalidValue.code());
    }
    assert_eq!((bench.number(CONTROL, 1), bench.number(0x1F56, 1), bench.number(0x1F57, 1)), (1, 0, 0));
    bench.node.set_program(0x1234_5678);
    bench.node.set_flash(1);
    assert_eq!((bench.number(0x1F56, 1), bench.number(0x1F57, 1)), (0x1234_5678, 1));
    assert_eq!((bench.number(PROGRAM, 0), bench.number(0x1F57, 0)), (1, 1));
}
