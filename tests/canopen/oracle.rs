//! The same conversations in another's reading of CiA 301: the crate canopen-rs, which is tested against python canopen.

use crate::bench::{Bench, ID};
use crate::machine::*;
use canopen_rs::object_dictionary::Entry;
use canopen_rs::sdo::{SdoClient, SdoEvent, SdoServer, block, decode_abort};
use canopen_rs::{Address, ByteString, DataType, NodeId, ObjectDictionary, Value};
use rand::{Rng, RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

fn at(index: u16) -> Address {
    Address::new(index, 0)
}

/// The device's objects, as the other crate keeps them.
fn dictionary() -> ObjectDictionary<8> {
    let mut dictionary = ObjectDictionary::new();
    for (index, value) in [
        (GUARDED, Value::Unsigned32(0)),
        (CONTROL, Value::Unsigned16(0)),
        (TARGET, Value::Integer32(0)),
        (LONG, Value::Integer64(0)),
        (NAME, Value::VisibleString(ByteString::new())),
        (BYTES, Value::OctetString(ByteString::new())),
    ] {
        dictionary.insert(at(index), Entry::rw(value)).unwrap();
    }
    dictionary
}

/// Runs the client's transaction against our node, and every request against the other server: the answers are the same.
fn run(
    bench: &mut Bench,
    client: &mut SdoClient,
    first: [u8; 8],
    other: &mut (SdoServer, ObjectDictionary<8>),
) -> SdoEvent {
    let mut frame = first;
    loop {
        let answer = bench.ask(frame);
        assert_eq!(Some(answer), other.0.handle(&mut other.1, &frame), "{frame:x?}");
        match client.on_response(&answer) {
            SdoEvent::Send(next) => frame = next,
            end => return end,
        }
    }
}

fn text(random: &mut impl Rng) -> ByteString {
    let length = random.random_range(1..=canopen_rs::MAX_STRING_LEN.min(100));
    let bytes: Vec<u8> = (0..length).map(|_| random.random_range(b' '..=b'~')).collect();
    ByteString::from_bytes(&bytes).unwrap()
}

#[test]
fn client_and_server_of_another_crate_agree_with_ours() {
    let node = NodeId::new(ID as u8).unwrap();
    let (mut bench, mut client) = (Bench::new(), SdoClient::new(node));
    let mut other = (SdoServer::new(node), dictionary());
    let mut random = Xoshiro256PlusPlus::seed_from_u64(5);
    for n in 0..5_000 {
        let (index, value) = match n % 6 {
            0 => (GUARDED, Value::Unsigned32(random.random())),
            1 => (CONTROL, Value::Unsigned16(random.random())),
            2 => (TARGET, Value::Integer32(random.random())),
            3 => (LONG, Value::Integer64(random.random())),
            4 => (NAME, Value::VisibleString(text(&mut random))),
            _ => (BYTES, Value::OctetString(text(&mut random))),
        };
        let request = client.write(at(index), value);
        assert_eq!(run(&mut bench, &mut client, request, &mut other), SdoEvent::Complete(None));
        let request = client.read(at(index), value.data_type());
        assert_eq!(run(&mut bench, &mut client, request, &mut other), SdoEvent::Complete(Some(value)));
    }
}

#[test]
fn the_other_client_understands_a_refusal() {
    let (mut bench, mut client) = (Bench::new(), SdoClient::new(NodeId::new(ID as u8).unwrap()));
    for (request, code) in [
        (client.read(at(0x2FFF), DataType::Unsigned8), 0x0602_0000),
        (client.read(at(WRITE_ONLY), DataType::Unsigned8), 0x0601_0001),
        (client.write(at(READ_ONLY), Value::Unsigned16(1)), 0x0601_0002),
        (client.write(at(RANGED), Value::Unsigned32(5000)), 0x0609_0031),
    ] {
        let answer = bench.ask(request);
        assert_eq!(client.on_response(&answer), SdoEvent::Aborted(code));
        assert_eq!(decode_abort(&answer).unwrap().1, code);
    }
}

#[test]
fn blocks_written_by_the_other_crate_arrive() {
    let mut bench = Bench::new();
    for length in 1..=252usize {
        let value: Vec<u8> = (0..length).map(|n| (n * 13) as u8).collect();
        let answer = bench.ask(block::encode_download_initiate(at(BYTES), Some(length as u32), true));
        let agreed = block::decode_download_initiate_response(&answer).unwrap();
        assert!(agreed.crc_support && agreed.address == at(BYTES));
        let mut writer = block::BlockWriter::new(&value, agreed.blksize);
        while !writer.is_done() {
            let mut answers = vec![];
            while let Some(segment) = writer.next_segment() {
                assert!(answers.is_empty());
                answers = bench.sdo(segment);
            }
            let (_, size) = block::decode_sub_response(&answers[0]).unwrap();
            writer.start_sub_block(size);
        }
        block::decode_end_response(&bench.ask(writer.end_frame(true))).unwrap();
        assert_eq!(bench.machine.value(BYTES, 0), value);
    }
}

#[test]
fn blocks_read_by_the_other_crate_are_whole() {
    let mut bench = Bench::new();
    for length in [1, 7, 8, 100, 889, 890, 3000] {
        bench.machine.scope_length = length;
        let answer = bench.ask(block::encode_upload_initiate(at(SCOPE), 100, true));
        let agreed = block::decode_upload_initiate_response(&answer).unwrap();
        assert_eq!((agreed.size, agreed.crc_support), (Some(length), true));
        let mut receiver = block::BlockReceiver::<4096>::new();
        let mut next = block::encode_upload_start();
        while !receiver.is_done() {
            let mut segments = bench.sdo(next);
            let later = bench.pass_for(50_000, 0x580 + ID);
            segments.extend(later.into_iter().map(|data| <[u8; 8]>::try_from(data).unwrap()));
            for segment in &segments {
                receiver.push(&block::decode_sub_segment(segment)).unwrap();
            }
            next = block::encode_sub_response(segments.len() as u8, 100);
        }
        let (unused, crc) = block::decode_end(&bench.ask(next)).unwrap();
        assert_eq!(receiver.finish(unused, crc, true).unwrap(), bench.machine.scope());
        assert!(bench.sdo(block::encode_end_response()).is_empty());
    }
}
