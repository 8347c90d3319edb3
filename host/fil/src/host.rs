//! The host at the other end of the bus: an ordinary CANopen master, as far as a head needs one.

use anyhow::{Result, bail, ensure};
use edm_servo_head::head::{Carry, Command};
use edm_servo_head::path::Piece;
use edm_servo_head::units::Nanometres;
use edm_soc::Frame;

/// Node-ID of the firmware, as stored in its flash.
pub const NODE: u16 = 1;
/// Identifiers of the pre-defined connection set (CiA 301 7.3.5).
const REQUEST: u16 = 0x600 + NODE;
const ANSWER: u32 = 0x580 + NODE as u32;
/// The number that the host's heartbeats carry.
pub const HOST: u16 = 100;
/// Milliseconds that an answer, or a change of state, may take; boot-up comes 50 after a reset.
const PATIENCE: u32 = 80;

/// A bus with a head on it.
pub trait Bus {
    /// Sends a frame.
    fn send(&mut self, frame: Frame);
    /// Lets a millisecond pass.
    ///
    /// # Errors
    /// When the head cannot go on.
    fn pass(&mut self) -> Result<()>;
    /// The oldest frame of the head that has not been taken.
    fn take(&mut self) -> Option<Frame>;
}

/// The answer to an SDO request: its eight bytes.
fn ask(bus: &mut impl Bus, request: [u8; 8]) -> Result<[u8; 8]> {
    let [_, low, high, sub, ..] = request;
    let index = u16::from_le_bytes([low, high]);
    answer(bus, request, (index, sub), |data| data[1..4] == request[1..4])
}

/// The first answer that is wanted, to a request about an object.
fn answer(
    bus: &mut impl Bus,
    request: [u8; 8],
    (index, sub): (u16, u8),
    wanted: impl Fn(&[u8; 8]) -> bool,
) -> Result<[u8; 8]> {
    while bus.take().is_some() {}
    bus.send(Frame::new(REQUEST, &request));
    for _ in 0..PATIENCE {
        bus.pass()?;
        while let Some(frame) = bus.take() {
            if frame.id == ANSWER && (wanted(&frame.data) || frame.data[0] == 0x80) {
                let code = u32::from_le_bytes([frame.data[4], frame.data[5], frame.data[6], frame.data[7]]);
                ensure!(frame.data[0] != 0x80, "{index:04X}h:{sub} is refused with {code:08X}h");
                return Ok(frame.data);
            }
        }
    }
    bail!("{index:04X}h:{sub}: no answer within {PATIENCE} ms")
}

/// Reads an object of more than four bytes, segment by segment.
///
/// # Errors
/// When the head refuses or does not answer.
pub fn upload(bus: &mut impl Bus, index: u16, sub: u8) -> Result<Vec<u8>> {
    let [low, high] = index.to_le_bytes();
    let [command, _, _, _, a, b, c, d] = ask(bus, [0x40, low, high, sub, 0, 0, 0, 0])?;
    ensure!(command == 0x41, "{index:04X}h:{sub} is no object of more than four bytes");
    let length = u32::from_le_bytes([a, b, c, d]) as usize;
    let (mut bytes, mut toggle) = (Vec::new(), 0);
    while bytes.len() < length {
        let data = answer(bus, [0x60 | toggle, 0, 0, 0, 0, 0, 0, 0], (index, sub), |data| data[0] & 0xF0 == toggle)?;
        let unused = usize::from(data[0] >> 1 & 7);
        bytes.extend_from_slice(&data[1..8 - unused]);
        toggle ^= 0x10;
    }
    Ok(bytes)
}

/// Reads an object by blocks of 127 segments (CiA 301 7.2.4.3.12); checks their sum.
///
/// # Errors
/// When the head refuses, does not answer, or a segment is missing.
pub fn block_upload(bus: &mut impl Bus, index: u16, sub: u8) -> Result<Vec<u8>> {
    const BLOCK: u8 = 127;
    let [low, high] = index.to_le_bytes();
    let [command, _, _, _, a, b, c, d] = ask(bus, [0xA4, low, high, sub, BLOCK, 0, 0, 0])?;
    ensure!(command == 0xC6, "{index:04X}h:{sub}: {command:02X}h is no answer to a block upload");
    let length = u32::from_le_bytes([a, b, c, d]) as usize;
    let (mut bytes, mut expected, mut patience) = (Vec::new(), 1, PATIENCE);
    bus.send(Frame::new(REQUEST, &[0xA3, 0, 0, 0, 0, 0, 0, 0]));
    let [_, crc_low, crc_high, ..] = loop {
        ensure!(patience > 0, "{index:04X}h:{sub}: nothing for {PATIENCE} ms, {} of {length} bytes", bytes.len());
        patience -= 1;
        bus.pass()?;
        let mut end = None;
        while let Some(frame) = bus.take() {
            let [command, data @ ..] = frame.data;
            if frame.id != ANSWER {
                continue;
            }
            patience = PATIENCE;
            if expected == 0 {
                ensure!(command & 0xE3 == 0xC1, "{index:04X}h:{sub}: {command:02X}h instead of the end");
                bytes.truncate(length);
                end = Some(frame.data);
                continue;
            }
            ensure!(command & 0x7F == expected, "{index:04X}h:{sub}: segment {command:02X}h instead of {expected}");
            bytes.extend_from_slice(&data);
            let last = command & 0x80 != 0;
            if last || expected == BLOCK {
                bus.send(Frame::new(REQUEST, &[0xA2, expected, BLOCK, 0, 0, 0, 0, 0]));
                expected = 0;
            }
            expected = if last { 0 } else { expected + 1 };
        }
        if let Some(end) = end {
            break end;
        }
    };
    bus.send(Frame::new(REQUEST, &[0xA1, 0, 0, 0, 0, 0, 0, 0]));
    bus.pass()?;
    // CRC-16 of the polynomial 1021h from 0 (CiA 301 7.2.4.3.16).
    let sum = bytes.iter().fold(0u16, |sum, byte| {
        let sum = sum ^ u16::from(*byte) << 8;
        (0..8).fold(sum, |sum, _| if sum & 0x8000 == 0 { sum << 1 } else { sum << 1 ^ 0x1021 })
    });
    ensure!(sum == u16::from_le_bytes([crc_low, crc_high]), "{index:04X}h:{sub}: wrong sum of the blocks");
    Ok(bytes)
}

/// Writes an object of `size` bytes.
///
/// # Errors
/// When the head refuses or does not answer.
pub fn write(bus: &mut impl Bus, index: u16, sub: u8, value: u32, size: u8) -> Result<()> {
    let [low, high] = index.to_le_bytes();
    let [a, b, c, d] = value.to_le_bytes();
    ask(bus, [0x23 | (4 - size) << 2, low, high, sub, a, b, c, d]).map(|_| ())
}

/// Reads an object of up to four bytes.
///
/// # Errors
/// When the head refuses or does not answer.
pub fn read(bus: &mut impl Bus, index: u16, sub: u8) -> Result<u32> {
    let [low, high] = index.to_le_bytes();
    let [_, _, _, _, a, b, c, d] = ask(bus, [0x40, low, high, sub, 0, 0, 0, 0])?;
    Ok(u32::from_le_bytes([a, b, c, d]))
}

/// What heads answer to a layer setting service (CiA 305) within some milliseconds.
///
/// # Errors
/// When the head cannot go on.
pub fn lss(bus: &mut impl Bus, request: [u8; 8]) -> Result<Option<[u8; 8]>> {
    while bus.take().is_some() {}
    bus.send(Frame::new(0x7E5, &request));
    for _ in 0..PATIENCE {
        bus.pass()?;
        if let Some(answer) = std::iter::from_fn(|| bus.take()).find(|frame| frame.id == 0x7E4) {
            return Ok(Some(answer.data));
        }
    }
    Ok(None)
}

/// Assigns a node-ID to a head that is alone on its bus and waits for one; whether it took it.
///
/// # Errors
/// When the head cannot go on.
pub fn name(bus: &mut impl Bus) -> Result<bool> {
    if lss(bus, [0x4C, 0, 0, 0, 0, 0, 0, 0])?.is_none() {
        return Ok(false);
    }
    lss(bus, [0x04, 1, 0, 0, 0, 0, 0, 0])?;
    let named = lss(bus, [0x11, NODE as u8, 0, 0, 0, 0, 0, 0])?;
    bus.send(Frame::new(0x7E5, &[0x04, 0, 0, 0, 0, 0, 0, 0]));
    Ok(named.is_some_and(|answer| answer[1] == 0))
}

/// Waits for the node's boot-up, puts it into operation and lets it watch the host's heartbeats.
///
/// # Errors
/// When the head refuses or does not answer.
pub fn begin(bus: &mut impl Bus) -> Result<()> {
    await_boot_up(bus)?;
    write(bus, 0x1016, 1, u32::from(HOST) << 16 | 400, 4)?;
    bus.send(Frame::new(0, &[1, NODE as u8]));
    bus.pass()
}

/// Waits for the node's boot-up: it ignores frames before.
///
/// # Errors
/// When it does not come.
pub fn await_boot_up(bus: &mut impl Bus) -> Result<()> {
    let boot_up = |frame: Frame| frame.id == 0x700 + u32::from(NODE) && frame.data[0] == 0;
    let mut left = PATIENCE;
    while !std::iter::from_fn(|| bus.take()).any(boot_up) {
        ensure!(left > 0, "no boot-up within {PATIENCE} ms");
        left -= 1;
        bus.pass()?;
    }
    Ok(())
}

/// A heartbeat of the host.
pub fn heartbeat() -> Frame {
    Frame::new(0x700 + HOST, &[5])
}

/// Has the head do what a command says, by way of its objects.
///
/// # Errors
/// When it is refused.
pub fn command(bus: &mut impl Bus, command: Command) -> Result<()> {
    let refused = |code: u32| format!("{command:?} was refused with code {code}");
    let before = read(bus, 0x2000, 4)?;
    match command {
        Command::Enable => enable(bus)?,
        Command::Disable => control(bus, 0, 0x4F, 0x40)?,
        Command::SetHome(at) => home_here(bus, at)?,
        Command::MoveTo(to) => {
            let to = counts(bus, to)?;
            write(bus, 0x2004, 1, to, 4)?;
        }
        Command::MoveBy(by) => {
            let by = counts(bus, by)?;
            write(bus, 0x2004, 2, by, 4)?;
        }
        Command::AppendTo(piece) => append(bus, &piece)?,
        Command::FindSurface(reach) => {
            let reach = counts(bus, reach)?;
            write(bus, 0x2011, 2, reach, 4)?;
            write(bus, 0x2011, 1, 1, 1)?;
        }
        Command::Carry(Carry::To(to)) => {
            let to = counts(bus, to)?;
            write(bus, 0x2014, 4, to, 4)?;
        }
        Command::Carry(answer) => {
            write(bus, 0x2014, 5, 0, 1)?;
            write(bus, 0x2014, 5, if answer == Carry::AsAsked { 1 } else { 2 }, 1)?;
        }
        Command::Start => write(bus, 0x2001, 1, 1, 1)?,
        Command::Jump => write(bus, 0x2001, 7, 1, 1)?,
        Command::Hold => write(bus, 0x2001, 2, 1, 1)?,
        Command::Commission => write(bus, 0x2001, 3, 1, 1)?,
        Command::Identify => write(bus, 0x2018, 1, 1, 1)?,
        Command::Tune => write(bus, 0x201B, 1, 1, 1)?,
        Command::ResetFault => {
            write(bus, 0x6040, 0, 0, 2)?;
            control(bus, 0x80, 0x4F, 0x40)?;
        }
        other => bail!("{other:?} is not a command of this host"),
    }
    // The servo task has carried it out by now, and has reported it.
    for _ in 0..3 {
        bus.pass()?;
    }
    let after = read(bus, 0x2000, 4)?;
    ensure!(after == before || after == 0, refused(after));
    Ok(())
}

/// Has a piece of path appended.
fn append(bus: &mut impl Bus, piece: &Piece) -> Result<()> {
    let ends = piece.to.map(|nm| nm as i32 as u32).into_iter().zip(1u8..);
    let centre = piece.centre.map(|nm| nm as u32).into_iter().zip(4u8..);
    for (value, sub) in ends.chain(centre) {
        write(bus, 0x200E, sub, value, 4)?;
    }
    write(bus, 0x200E, 6, piece.shape as u32, 1)?;
    write(bus, 0x200E, 7, u32::from(piece.mark) << 1, 1)?;
    write(bus, 0x200E, 8, 1, 1)?;
    let refused = read(bus, 0x200E, 9)?;
    ensure!(refused == 0, "a piece was refused with code {refused} of 200Eh:9");
    Ok(())
}

/// A position or a length, counts.
///
/// # Errors
/// When the head refuses or does not answer.
pub fn counts(bus: &mut impl Bus, length: Nanometres) -> Result<u32> {
    let per_count = i64::from(read(bus, 0x608F, 2)?.max(1)) * 1_000_000 / i64::from(read(bus, 0x608F, 1)?.max(1));
    Ok((length.0 / per_count.max(1)) as i32 as u32)
}

/// Writes a controlword and waits for a state of the drive.
fn control(bus: &mut impl Bus, word: u32, mask: u32, state: u32) -> Result<()> {
    write(bus, 0x6040, 0, word, 2)?;
    let mut status = 0;
    for _ in 0..PATIENCE {
        status = read(bus, 0x6041, 0)?;
        if status & mask == state {
            return Ok(());
        }
    }
    bail!("statusword {status:04X}h after controlword {word:04X}h: {state:04X}h was expected under {mask:04X}h")
}

fn enable(bus: &mut impl Bus) -> Result<()> {
    control(bus, 6, 0x6F, 0x21)?;
    control(bus, 7, 0x6F, 0x23)?;
    control(bus, 0xF, 0x6F, 0x27)
}

/// Homing method 35; the drive is left as it was.
fn home_here(bus: &mut impl Bus, at: Nanometres) -> Result<()> {
    let enabled = read(bus, 0x6041, 0)? & 0x6F == 0x27;
    let offset = counts(bus, Nanometres(-at.0))?;
    write(bus, 0x607C, 0, offset, 4)?;
    write(bus, 0x6098, 0, 35, 1)?;
    if !enabled {
        enable(bus)?;
    }
    write(bus, 0x6060, 0, 6, 1)?;
    control(bus, 0x1F, 0x3400, 0x1400)?;
    write(bus, 0x6060, 0, 0, 1)?;
    control(bus, 0xF, 0x6F, 0x27)?;
    if enabled { Ok(()) } else { control(bus, 0, 0x4F, 0x40) }
}
