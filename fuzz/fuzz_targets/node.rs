//! Any sequence of frames, ticks and pauses: the CANopen node does not panic, and changes nothing without an accepted
//! write. The same watch as in `tests/canopen`, here guided by coverage.
#![no_main]

#[path = "../../tests/canopen/machine.rs"]
mod machine;
#[path = "../../tests/canopen/watched.rs"]
mod watched;

use edm_servo_head::canopen::Abort;
use libfuzzer_sys::fuzz_target;
use watched::{ID, Watched};

/// Takes bytes off the input; what is missing is 0.
fn take<const N: usize>(input: &mut &[u8]) -> [u8; N] {
    let (head, tail) = input.split_at(N.min(input.len()));
    *input = tail;
    let mut bytes = [0; N];
    bytes[..head.len()].copy_from_slice(head);
    bytes
}

fuzz_target!(|input: &[u8]| {
    let mut input = input;
    let mut node = Watched::new();
    while !input.is_empty() {
        let [kind] = take(&mut input);
        match kind % 16 {
            0..8 => node.send(0x600 + ID, &take::<8>(&mut input)),
            8 => {
                let [low, high, length] = take(&mut input);
                let data: [u8; 8] = take(&mut input);
                node.send(u16::from_le_bytes([low, high]) & 0x7FF, &data[..usize::from(length % 9)]);
            }
            9 => node.send(0, &[take::<1>(&mut input)[0], ID as u8]),
            10 => node.send(0x80, &take::<1>(&mut input)[..usize::from(kind >> 7)]),
            11 => node.send(0x200 + ID + 0x100 * u16::from(kind >> 6), &take::<8>(&mut input)),
            12 => node.pass(u64::from(u16::from_le_bytes(take(&mut input)))),
            13 => node.pass(2_000_000),
            14 => node.tick(),
            _ => {
                node.machine.enabled = kind & 0x10 != 0;
                node.answer(if kind & 0x20 == 0 { Ok(()) } else { Err(Abort::Hardware) });
            }
        }
    }
});
