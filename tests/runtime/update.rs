//! An update of the program over CAN, on a virtual head: what is refused, and that nothing is lost by it.

use crate::rig::{Host, MS, download};
use edm_boot::file::{sum, words};
use edm_boot::{HEADER, Header, LONGEST, PRODUCT, PROGRAM as FIRST};
use edm_seal::update::with;
use edm_servo_head::canopen::Abort;
use edm_sim::schedule::Habits;

const PROGRAM: [u8; 3] = [0x50, 0x1F, 1];
const CONTROL: (u16, u8) = (0x1F51, 1);
const ID: (u16, u8) = (0x1F56, 1);
const STATUS: (u16, u8) = (0x1F57, 1);
/// By which the program in the update is known.
const NEW: u32 = 0x0BAD_CAFE;

fn host() -> Host {
    let host = Host::new(|_| {}, 3);
    host.head.set_habits(Habits::PROMPT);
    host
}

fn program() -> Vec<u8> {
    let mut words = vec![0x2002_0000, FIRST + 0x201];
    words.extend((2..150u32).map(|n| n.wrapping_mul(0x9E37_79B9)));
    words.into_iter().flat_map(u32::to_le_bytes).collect()
}

fn header() -> Header {
    let sum = sum(words(&program()));
    Header { product: PRODUCT, board: 405, length: program().len() as u32, sum, id: NEW, version: 0, build: 0 }
}

fn control(host: &mut Host, value: u32) -> Result<(), Abort> {
    answer(host.exchange(download(CONTROL.0, CONTROL.1, 1, value)))
}

/// The abort by its name.
fn answer(answer: Result<u32, u32>) -> Result<(), Abort> {
    use Abort::*;
    let known = [
        Crc,
        OutOfMemory,
        Hardware,
        Length,
        InvalidValue,
        Incompatible,
        NotStored,
        LocalControl,
        DeviceState,
        NoData,
        General,
        Command,
    ];
    answer
        .map(|_| ())
        .map_err(|code| known.into_iter().find(|abort| abort.code() == code).unwrap_or_else(|| panic!("{code:#010x}")))
}

/// Makes room, and waits until there is.
fn clear(host: &mut Host) {
    assert_eq!(control(host, 3), Ok(()));
    assert_eq!(host.read(STATUS.0, STATUS.1), 1);
    host.run(300 * MS);
    assert_eq!(host.read(STATUS.0, STATUS.1), 0);
}

/// Sends an update in segments, up to its end or a number of them.
fn segments(host: &mut Host, update: &[u8], most: usize) -> Result<(), Abort> {
    let [low, high, sub] = PROGRAM;
    let [a, b, c, d] = (update.len() as u32).to_le_bytes();
    answer(host.exchange([0x21, low, high, sub, a, b, c, d]))?;
    let count = update.len().div_ceil(7);
    for (place, part) in update.chunks(7).enumerate().take(most) {
        let last = u8::from(place + 1 == count);
        let mut frame = [(place as u8 & 1) << 4 | (7 - part.len() as u8) << 1 | last, 0, 0, 0, 0, 0, 0, 0];
        frame[1..=part.len()].copy_from_slice(part);
        answer(host.exchange(frame))?;
    }
    Ok(())
}

/// Sends an update by blocks.
fn blocks(host: &mut Host, update: &[u8]) -> Result<(), Abort> {
    let [low, high, sub] = PROGRAM;
    let [a, b, c, d] = (update.len() as u32).to_le_bytes();
    answer(host.exchange([0xC2, low, high, sub, a, b, c, d]))?;
    let parts: Vec<_> = update.chunks(7).collect();
    for (first, block) in parts.chunks(31).enumerate() {
        for (n, part) in (1..).zip(block) {
            let last = 31 * first + usize::from(n) == parts.len();
            let mut frame = [n | u8::from(last) << 7, 0, 0, 0, 0, 0, 0, 0];
            frame[1..=part.len()].copy_from_slice(part);
            if last || n == 31 {
                answer(host.exchange(frame))?;
            } else {
                host.send(0x605, &frame);
                host.run(2);
            }
        }
    }
    let unused = (7 * parts.len() - update.len()) as u8;
    answer(host.exchange([0xC1 | unused << 2, 0, 0, 0, 0, 0, 0, 0]))
}

/// The program that ran before runs, and the head is as it was: it can be enabled.
#[track_caller]
fn nothing_is_lost(host: &mut Host) {
    host.reset(129);
    assert_eq!(host.read(ID.0, ID.1), 0);
    host.enable();
}

#[test]
fn an_update_is_staged_started_and_known() {
    for by_blocks in [true, false] {
        let mut host = host();
        let update = with(&header(), &program());
        assert_eq!(control(&mut host, 0), Ok(()));
        clear(&mut host);
        let done = if by_blocks { blocks(&mut host, &update) } else { segments(&mut host, &update, usize::MAX) };
        assert_eq!(done, Ok(()));
        assert_eq!((host.read(STATUS.0, STATUS.1), host.read(ID.0, ID.1)), (0, 0));
        let boots = host.boots;
        assert_eq!(control(&mut host, 1), Ok(()));
        // Nothing can be enabled from now on.
        for word in [0x06, 0x07, 0x0F] {
            host.write(0x6040, 0, 2, word);
        }
        assert_ne!(host.read(0x6041, 0) & 0x6F, 0x27);
        host.run(200 * MS);
        assert_eq!(host.boots, boots + 1);
        assert_eq!(host.read(ID.0, ID.1), NEW);
        // And as the other it does what it did.
        host.send(0, &[1, 5]);
        host.run(2 * MS);
        host.enable();
    }
}

#[test]
fn what_is_wrong_is_named_and_nothing_is_lost() {
    let right = header();
    let mut damaged = with(&right, &program());
    damaged[300] ^= 4;
    let mut headless = with(&right, &program());
    headless[4 * HEADER - 1] ^= 1;
    let mut marked = with(&right, &program());
    marked[4 * HEADER] = 0;
    for (update, expected, status) in [
        (with(&Header { product: 2, ..right }, &program()), Abort::Incompatible, 2 << 1),
        (with(&Header { board: 407, ..right }, &program()), Abort::Incompatible, 2 << 1),
        (with(&Header { length: LONGEST + 4, ..right }, &program()), Abort::Length, 2 << 1),
        (damaged, Abort::Crc, 3 << 1),
        (with(&right, &program()[..400]), Abort::Crc, 3 << 1),
        (headless, Abort::InvalidValue, 2 << 1),
        (marked, Abort::InvalidValue, 2 << 1),
    ] {
        let mut host = host();
        clear(&mut host);
        assert_eq!(segments(&mut host, &update, usize::MAX), Err(expected));
        assert_eq!(host.read(STATUS.0, STATUS.1), status, "{expected:?}");
        assert!(control(&mut host, 1).is_err());
        // What comes without another clearing is refused, however right.
        let right = with(&right, &program());
        assert_eq!(segments(&mut host, &right, usize::MAX), Err(Abort::NotStored));
        assert_eq!(host.read(STATUS.0, STATUS.1), 4 << 1);
        nothing_is_lost(&mut host);
    }
}

#[test]
fn half_an_update_is_none() {
    let update = with(&header(), &program());
    let mut host = host();
    assert_eq!(control(&mut host, 1), Err(Abort::NoData));
    assert_eq!(host.read(STATUS.0, STATUS.1), 1 << 1);
    for most in [0, 1, 40, update.len() / 7 - 1] {
        clear(&mut host);
        assert_eq!(segments(&mut host, &update, most), Ok(()));
        // The cable is out, and in again.
        host.run(1500 * MS);
        host.answers();
        host.asked = host.answered;
        assert!(matches!(control(&mut host, 1), Err(Abort::NoData | Abort::Crc)));
    }
    let [low, high, sub] = PROGRAM;
    let [a, b, c, d] = (128 + LONGEST + 4).to_le_bytes();
    assert_eq!(answer(host.exchange([0xC2, low, high, sub, a, b, c, d])), Err(Abort::OutOfMemory));
    nothing_is_lost(&mut host);
}

#[test]
fn nothing_is_done_while_the_head_may_move() {
    let update = with(&header(), &program());
    let mut host = host();
    clear(&mut host);
    host.enable();
    for value in [0, 1, 3] {
        assert_eq!(control(&mut host, value), Err(Abort::DeviceState));
    }
    assert_eq!(segments(&mut host, &update, usize::MAX), Err(Abort::DeviceState));
    host.write(0x6040, 0, 2, 0);
    host.run(300 * MS);
    clear(&mut host);
    assert_eq!(blocks(&mut host, &update), Ok(()));
    // Enabled between the last piece and the start.
    host.enable();
    assert_eq!(control(&mut host, 1), Err(Abort::DeviceState));
    host.write(0x6040, 0, 2, 0);
    host.run(300 * MS);
    assert_eq!(control(&mut host, 1), Ok(()));
}

#[test]
fn room_is_not_made_in_a_loop() {
    let mut host = host();
    let refused = (0..30).find_map(|_| {
        let answer = control(&mut host, 3);
        host.run(300 * MS);
        answer.err()
    });
    assert_eq!(refused, Some(Abort::LocalControl));
}
