//! Layer setting services (CiA 305).

use crate::bench::{Bench, ID, SERIAL};
use crate::machine::DEVICE;
use edm_servo_head::canopen::{Abort, BitRate, BusSettings, Event, Group, NmtState, NodeId, Request};
use proptest::prelude::*;

const IDENTITY: [u32; 4] = [DEVICE.vendor, DEVICE.product, DEVICE.revision, SERIAL];

fn id(number: u8) -> Option<NodeId> {
    NodeId::new(number)
}

/// A request: command and what follows.
fn lss(bench: &mut Bench, command: u8, rest: &[u8]) -> Vec<Vec<u8>> {
    let mut data = [0; 8];
    data[0] = command;
    data[1..=rest.len()].copy_from_slice(rest);
    let answers = bench.send(0x7E5, &data);
    assert!(answers.iter().all(|frame| frame.id() == 0x7E4 && frame.data().len() == 8), "{answers:?}");
    answers.iter().map(|frame| frame.data().to_vec()).collect()
}

fn word(bench: &mut Bench, command: u8, value: u32) -> Vec<Vec<u8>> {
    lss(bench, command, &value.to_le_bytes())
}

/// The one answer's command and first two bytes.
fn code(answers: Vec<Vec<u8>>) -> [u8; 3] {
    let [answer] = &answers[..] else { panic!("{answers:?}") };
    [answer[0], answer[1], answer[2]]
}

fn configuring(bench: &mut Bench) {
    assert!(lss(bench, 0x04, &[1]).is_empty());
}

fn waiting(bench: &mut Bench) {
    assert!(lss(bench, 0x04, &[0]).is_empty());
}

/// Whether the node says that it is in the configuration state, which alone answers an inquiry.
fn answers(bench: &mut Bench) -> bool {
    !lss(bench, 0x5E, &[]).is_empty()
}

fn unconfigured() -> Bench {
    let mut bench = Bench::unbooted(None, SERIAL);
    bench.node.boot(None, &mut bench.machine).unwrap();
    bench
}

#[test]
fn an_unconfigured_node_says_nothing_and_hears_nothing_but_layer_setting() {
    let mut bench = unconfigured();
    assert_eq!(bench.pass(1_000_000), []);
    assert_eq!(bench.node.state(), NmtState::Initialising);
    for (id, data) in [(0, &[1u8, 0][..]), (0x601, &[0x40, 0x18, 0x10, 0, 0, 0, 0, 0]), (0x80, &[])] {
        assert_eq!(bench.send(id, data), []);
    }
    assert_eq!(bench.pass(1_000_000), []);
    assert!(bench.node.identifiers().contains(&0x7E5));
    assert_eq!(lss(&mut bench, 0x4C, &[]), [[0x50, 0, 0, 0, 0, 0, 0, 0]]);
    configuring(&mut bench);
    assert_eq!(code(lss(&mut bench, 0x5E, &[]))[..2], [0x5E, 255]);
}

#[test]
fn a_node_that_is_named_boots_as_it_is_switched_back() {
    let mut bench = unconfigured();
    configuring(&mut bench);
    assert_eq!(code(lss(&mut bench, 0x11, &[9])), [0x11, 0, 0]);
    assert_eq!(bench.node.bus().node, None);
    assert!(bench.machine.events.is_empty());
    waiting(&mut bench);
    assert_eq!(bench.machine.events, [Event::ResetCommunication]);
    assert_eq!(bench.node.bus().node, id(9));
    bench.node.boot(None, &mut bench.machine).unwrap();
    assert_eq!(bench.frames()[0].id(), 0x709);
    assert_eq!(lss(&mut bench, 0x4C, &[]), [] as [Vec<u8>; 0], "it is configured");
}

#[test]
fn another_node_id_is_in_force_after_the_next_reset() {
    let mut bench = Bench::operational();
    configuring(&mut bench);
    lss(&mut bench, 0x11, &[9]);
    waiting(&mut bench);
    assert_eq!((bench.node.bus().node, bench.node.configured().node), (id(ID as u8), id(9)));
    assert_eq!(bench.node.state(), NmtState::Operational, "nothing has happened yet");
    bench.send(0, &[130, ID as u8]);
    bench.node.boot(None, &mut bench.machine).unwrap();
    assert_eq!(bench.frames()[0].id(), 0x709);
    assert_eq!(bench.send(0x600 + ID, &[0x40, 0x18, 0x10, 0, 0, 0, 0, 0]), []);
    assert_eq!(bench.send(0x609, &[0x40, 0x18, 0x10, 0, 0, 0, 0, 0])[0].id(), 0x589);
    // And back to none.
    configuring(&mut bench);
    lss(&mut bench, 0x11, &[255]);
    bench.send(0, &[129, 9]);
    bench.node.boot(None, &mut bench.machine).unwrap();
    assert_eq!(bench.frames(), []);
    assert_eq!(lss(&mut bench, 0x4C, &[]).len(), 1);
}

#[test]
fn what_is_out_of_range_is_refused_and_changes_nothing() {
    let mut bench = Bench::new();
    configuring(&mut bench);
    let before = bench.node.configured();
    for wrong in [0, 128, 254] {
        assert_eq!(code(lss(&mut bench, 0x11, &[wrong])), [0x11, 1, 0], "node {wrong}");
    }
    for (table, index) in [(0, 1), (0, 5), (0, 6), (0, 7), (0, 8), (0, 9), (0, 255), (1, 0), (128, 0)] {
        assert_eq!(code(lss(&mut bench, 0x13, &[table, index])), [0x13, 1, 0], "table {table}, index {index}");
    }
    assert_eq!(bench.node.configured(), before);
}

#[test]
fn what_configures_is_heard_in_the_configuration_state_alone() {
    let mut bench = Bench::new();
    let before = bench.node.configured();
    for (command, rest) in [(0x11, &[9u8][..]), (0x13, &[0, 2]), (0x15, &[0, 0]), (0x17, &[]), (0x5A, &[]), (0x5E, &[])]
    {
        assert_eq!(lss(&mut bench, command, rest), [] as [Vec<u8>; 0]);
    }
    assert_eq!((bench.node.configured(), bench.machine.requests.len()), (before, 0));
    assert_eq!(bench.node.state(), NmtState::PreOperational);
}

#[test]
fn one_of_many_is_selected_by_all_four_parts_of_its_address_in_their_order() {
    let mut bench = Bench::new();
    let select = |bench: &mut Bench, parts: [(u8, u32); 4]| -> bool {
        let replies: Vec<_> = parts.iter().flat_map(|(command, value)| word(bench, *command, *value)).collect();
        let said = replies == [vec![0x44, 0, 0, 0, 0, 0, 0, 0]];
        assert_eq!(said, answers(bench));
        waiting(bench);
        said
    };
    let right = [(0x40, IDENTITY[0]), (0x41, IDENTITY[1]), (0x42, IDENTITY[2]), (0x43, IDENTITY[3])];
    assert!(select(&mut bench, right));
    for wrong in 0..4 {
        let mut parts = right;
        parts[wrong].1 ^= 1 << 31;
        assert!(!select(&mut bench, parts), "part {wrong}");
    }
    let [a, b, c, d] = right;
    assert!(!select(&mut bench, [b, a, c, d]));
    assert!(!select(&mut bench, [a, b, d, c]));
    assert!(!select(&mut bench, [a, a, a, d]));
    assert!(select(&mut bench, right));
}

#[test]
fn an_identification_is_answered_by_whoever_lies_in_its_ranges() {
    let mut bench = Bench::new();
    let mut ask = |low: [u32; 2], high: [u32; 2]| {
        let words = [IDENTITY[0], IDENTITY[1], low[0], high[0], low[1], high[1]];
        let replies: Vec<_> =
            (0x46..).zip(words).flat_map(|(command, value)| word(&mut bench, command, value)).collect();
        replies == [vec![0x4F, 0, 0, 0, 0, 0, 0, 0]]
    };
    let [_, _, revision, serial] = IDENTITY;
    assert!(ask([revision, serial], [revision, serial]));
    assert!(ask([0, 0], [u32::MAX, u32::MAX]));
    assert!(!ask([revision + 1, 0], [u32::MAX, u32::MAX]));
    assert!(!ask([0, 0], [revision - 1, u32::MAX]));
    assert!(!ask([0, serial + 1], [u32::MAX, u32::MAX]));
    assert!(!ask([0, 0], [u32::MAX, serial - 1]));
}

#[test]
fn inquiries_read_the_identity() {
    let mut bench = Bench::new();
    configuring(&mut bench);
    for (command, value) in (0x5A..).zip(IDENTITY) {
        let [answer] = &lss(&mut bench, command, &[])[..] else { panic!() };
        assert_eq!((answer[0], &answer[1..5]), (command, &value.to_le_bytes()[..]));
    }
    assert_eq!(code(lss(&mut bench, 0x5E, &[]))[..2], [0x5E, ID as u8]);
}

#[test]
fn what_was_configured_is_stored_on_request_and_answered_when_it_is() {
    let mut bench = Bench::new();
    configuring(&mut bench);
    lss(&mut bench, 0x11, &[9]);
    for (result, codes) in [(Ok(()), [0, 0]), (Err(Abort::Hardware), [2, 0]), (Err(Abort::DeviceState), [255, 1])] {
        assert!(lss(&mut bench, 0x17, &[]).is_empty());
        assert!(lss(&mut bench, 0x17, &[]).is_empty(), "one is under way");
        assert_eq!(std::mem::take(&mut bench.machine.requests), [Request::Store(Group::Bus)]);
        bench.node.answer(Group::Bus, result, &mut bench.machine);
        assert_eq!(bench.frames()[0].data()[..3], [0x17, codes[0], codes[1]]);
        bench.node.answer(Group::Bus, result, &mut bench.machine);
        assert_eq!(bench.frames(), []);
    }
    bench.machine.enabled = true;
    assert_eq!(code(lss(&mut bench, 0x17, &[])), [0x17, 255, 1]);
    // One that a reset has overtaken is not answered, and does not stand in the way of the next.
    bench.machine.enabled = false;
    assert!(lss(&mut bench, 0x17, &[]).is_empty());
    bench.send(0, &[130, ID as u8]);
    bench.node.answer(Group::Bus, Ok(()), &mut bench.machine);
    assert_eq!(bench.frames(), []);
    configuring(&mut bench);
    assert!(lss(&mut bench, 0x17, &[]).is_empty());
    bench.node.answer(Group::Bus, Ok(()), &mut bench.machine);
    assert_eq!(bench.frames().len(), 1);
}

#[test]
fn an_answer_to_a_host_that_stores_by_sdo_is_not_taken_for_one_by_layer_setting() {
    let mut bench = Bench::new();
    configuring(&mut bench);
    assert!(lss(&mut bench, 0x17, &[]).is_empty());
    bench.sdo([0x23, 0x10, 0x10, 1, b's', b'a', b'v', b'e']);
    bench.node.answer(Group::All, Ok(()), &mut bench.machine);
    assert_eq!(bench.frames()[0].id(), 0x580 + ID);
    bench.node.answer(Group::Bus, Ok(()), &mut bench.machine);
    assert_eq!(bench.frames()[0].id(), 0x7E4);
}

#[test]
fn a_bit_rate_changes_after_a_delay_of_silence_and_the_node_boots_after_another() {
    let mut bench = Bench::operational();
    configuring(&mut bench);
    for rate in BitRate::ALL {
        assert_eq!(code(lss(&mut bench, 0x13, &[0, rate as u8])), [0x13, 0, 0]);
    }
    lss(&mut bench, 0x13, &[0, 3]);
    assert_eq!(bench.node.bus().bit_rate, BitRate::Kbit1000);
    bench.machine.events.clear();
    assert!(lss(&mut bench, 0x15, &20u16.to_le_bytes()).is_empty());
    // The device knows that it is about to lose its host.
    assert_eq!(bench.machine.events, [Event::State(NmtState::Stopped)]);
    assert_eq!(bench.pass(19_000), []);
    assert_eq!(bench.node.bus().bit_rate, BitRate::Kbit1000);
    assert_eq!(bench.pass(1_000), []);
    assert_eq!(bench.node.bus(), BusSettings { node: id(ID as u8), bit_rate: BitRate::Kbit250 });
    // Frames of either rate mean nothing meanwhile.
    assert_eq!(bench.send(0x7E5, &[0x5E, 0, 0, 0, 0, 0, 0, 0]), []);
    assert_eq!(bench.send(0, &[1, 0]), []);
    assert_eq!(bench.pass(19_000), []);
    assert_eq!(bench.machine.events.len(), 1);
    bench.pass(1_000);
    assert_eq!(bench.machine.events[1], Event::ResetCommunication);
    bench.node.boot(None, &mut bench.machine).unwrap();
    assert_eq!(bench.pass(1_000)[0].1.id(), 0x700 + ID);
}

#[test]
fn a_store_that_ends_while_the_bit_rate_changes_does_not_break_the_silence() {
    let mut bench = Bench::operational();
    configuring(&mut bench);
    lss(&mut bench, 0x13, &[0, 3]);
    assert!(lss(&mut bench, 0x17, &[]).is_empty());
    assert!(lss(&mut bench, 0x15, &20u16.to_le_bytes()).is_empty());
    bench.pass(30_000);
    assert_eq!(bench.node.bus().bit_rate, BitRate::Kbit250);
    bench.node.answer(Group::Bus, Ok(()), &mut bench.machine);
    assert_eq!(bench.frames(), [], "the other nodes have not changed yet");
}

#[test]
fn what_was_wrong_before_a_node_is_named_is_told_when_it_is() {
    let mut bench = unconfigured();
    bench.node.emergency(0x5530, 0, [1, 2, 3, 4, 5]);
    assert_eq!(bench.pass(100_000), []);
    configuring(&mut bench);
    lss(&mut bench, 0x11, &[9]);
    waiting(&mut bench);
    bench.node.boot(None, &mut bench.machine).unwrap();
    let told = bench.pass(10_000);
    assert!(told.iter().any(|(_, frame)| frame.id() == 0x80 + 9), "no emergency: {told:?}");
}

/// A host's fast scan (CiA 305 annex): the address that it finds, bit by bit, on a bus with these nodes.
fn fast_scan(nodes: &mut [Bench]) -> Option<[u32; 4]> {
    let mut scan = |word: u32, bit: u8, part: u8, next: u8| {
        let [a, b, c, d] = word.to_le_bytes();
        nodes.iter_mut().any(|bench| !lss(bench, 0x51, &[a, b, c, d, bit, part, next]).is_empty())
    };
    if !scan(0, 128, 0, 0) {
        return None;
    }
    let mut found = [0; 4];
    for part in 0..4u8 {
        let word = &mut found[usize::from(part)];
        for bit in (0..32).rev() {
            if !scan(*word, bit, part, part) {
                *word |= 1 << bit;
            }
        }
        if !scan(*word, 0, part, (part + 1) % 4) {
            return None;
        }
    }
    Some(found)
}

proptest! {
    #[test]
    fn fast_scans_find_every_unconfigured_node_and_no_other(serials in proptest::collection::hash_set(any::<u32>(), 1..6)) {
        let mut nodes: Vec<Bench> = serials.iter().map(|serial| Bench::unbooted(None, *serial)).collect();
        nodes.push(Bench::new());
        let mut found = vec![];
        for number in 1.. {
            let Some(address) = fast_scan(&mut nodes) else { break };
            prop_assert_eq!(address[..3].to_vec(), IDENTITY[..3].to_vec());
            found.push(address[3]);
            // It alone is in the configuration state.
            let named: Vec<_> = nodes.iter_mut().filter(|bench| bench.node.bus().node.is_none())
                .map(|bench| lss(bench, 0x11, &[number]).len()).collect();
            prop_assert_eq!(named.iter().sum::<usize>(), 1);
            nodes.iter_mut().for_each(waiting);
        }
        found.sort_unstable();
        let mut wanted: Vec<u32> = serials.into_iter().collect();
        wanted.sort_unstable();
        prop_assert_eq!(found, wanted);
    }

    #[test]
    fn no_request_of_any_bytes_names_a_node_that_was_not_told_to_configure(data in proptest::collection::vec(any::<u8>(), 0..9)) {
        let mut bench = Bench::new();
        let before = bench.node.configured();
        bench.send(0x7E5, &data);
        prop_assert_eq!(bench.node.configured(), before);
        prop_assert_eq!(bench.node.state(), NmtState::PreOperational);
    }
}
