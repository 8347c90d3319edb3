//! What is stored: one list of objects and values, checked as a whole and one by one.

use edm_hal_shim::double::flash::TestFlash;
use edm_hal_shim::store::{BUFFER, Loaded, MAX_IMAGE, Permit, Store, StoreError};
use edm_servo_head::canopen::drive::{BLANK, DEVICE, Drive, Identity};
use edm_servo_head::canopen::objects::setting_address;
use edm_servo_head::canopen::{
    BitRate, BusSettings, DataType, Dictionary, Frame, Group, Listed, Node, NodeId, Record, Time,
};
use edm_servo_head::feed::LawName;
use edm_servo_head::settings::{Declared, Settings, Value};
use edm_servo_head::stored::{LoadReport, Outcome, ROOM, StoredImage};

const ID: u8 = 5;

fn node() -> NodeId {
    NodeId::new(ID).unwrap()
}

/// A drive and a node that have just been switched on.
struct Head {
    drive: Drive,
    node: Node,
    id: u16,
}

impl Head {
    fn new(id: u8, image: &StoredImage) -> (Head, LoadReport) {
        let record = Box::leak(Box::new(BLANK));
        let mut drive = Drive::new(Settings::default(), Identity::default(), record).unwrap();
        let mut node = Node::new(&DEVICE, BusSettings::at_1_mbit(NodeId::new(id)), 0);
        let passed = Settings { commissioned: true, ..Settings::default() };
        drive.restart(passed, image);
        drive.boot(&mut node, image).unwrap();
        let report = drive.loaded();
        (Head { drive, node, id: id.into() }, report)
    }

    /// The value of an object of up to 32 bits, by SDO.
    fn read(&mut self, index: u16, sub: u8) -> u32 {
        let [low, high] = index.to_le_bytes();
        let request = Frame::new(0x600 + self.id, &[0x40, low, high, sub, 0, 0, 0, 0]).unwrap();
        self.node.poll(Time(1_000), &mut self.drive);
        while self.node.take().is_some() {}
        self.node.receive(&request, Time(1_000), &mut self.drive);
        let answers: Vec<_> = std::iter::from_fn(|| self.node.take()).collect();
        let answer = answers.iter().find(|frame| frame.id() == 0x580 + self.id).unwrap().data();
        assert_eq!(answer[0] & 0xE3, 0x43, "{index:x}:{sub}");
        u32::from_le_bytes(answer[4..].try_into().unwrap())
    }

    fn commissioned(&self) -> bool {
        self.drive.settings().commissioned
    }

    /// What is stored when all is.
    fn stored(&self) -> StoredImage {
        let mut image = StoredImage::NOTHING;
        image.keep(Group::All, &self.drive, &self.node).unwrap();
        image
    }
}

/// A head that has passed its commissioning, with another value here and there.
fn configured() -> Head {
    let settings = Settings { commissioned: true, gap_setpoint: 47.5, axis_mass: 0.31, ..Settings::default() };
    let mut drive = Drive::new(settings, Identity::default(), Box::leak(Box::new(BLANK))).unwrap();
    let place = drive.entry(0x6081, 0).unwrap().place;
    drive.write(place, &4321u32.to_le_bytes()).unwrap();
    let place = drive.entry(0x607C, 0).unwrap().place;
    drive.write(place, &(-77i32).to_le_bytes()).unwrap();
    let mut node = Node::new(&DEVICE, BusSettings::at_1_mbit(Some(node())), 0);
    node.boot(None, &mut drive).unwrap();
    let heartbeat = Frame::new(0x600 + u16::from(ID), &[0x2B, 0x17, 0x10, 0, 0xF4, 1, 0, 0]).unwrap();
    node.receive(&heartbeat, Time(0), &mut drive);
    Head { drive, node, id: ID.into() }
}

/// CRC-32 of Ethernet, bit by bit.
fn crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xEDB8_8320 } else { crc >> 1 })
    })
}

/// The bytes of an image, as the table of src/stored has them.
fn bytes(version: u8, node: u8, records: &[Record]) -> Vec<u8> {
    let mut bytes = vec![version, node, 0, 0, 0];
    bytes.extend((records.len() as u16).to_le_bytes());
    for record in records {
        bytes.extend(record.index.to_le_bytes());
        bytes.extend([record.sub, record.kind]);
        bytes.extend(record.value.to_le_bytes());
    }
    let check = crc(&bytes);
    bytes.extend(check.to_le_bytes());
    bytes
}

fn image_of(records: &[Record]) -> StoredImage {
    let mut image = StoredImage::NOTHING;
    assert_eq!(image.load(Loaded::Newest(&bytes(0x15, ID, records))), Outcome::Newest);
    image
}

fn records(image: &StoredImage) -> Vec<Record> {
    image.records().collect()
}

fn listed(addresses: &[(u16, u8)]) -> Listed {
    let mut listed = Listed::default();
    addresses.iter().for_each(|(index, sub)| listed.add(*index, *sub));
    listed
}

/// The configured head's image after a change to its records, loaded.
fn loaded_with(change: impl FnOnce(&mut Vec<Record>)) -> (Head, LoadReport) {
    let mut all = records(&configured().stored());
    change(&mut all);
    Head::new(ID, &image_of(&all))
}

fn set(records: &mut [Record], key: &str, value: Value<'_>) {
    let mut settings = Settings::default();
    let at = Settings::FIELDS.iter().position(|field| field.key == key).unwrap();
    // Beyond the range as well.
    let word = match value {
        Value::Number(x) => (x as f32).to_bits(),
        _ => {
            settings.put(at, value).unwrap();
            settings.word(at).unwrap()
        }
    };
    find(records, setting_address(key).unwrap()).value = word;
}

fn find(records: &mut [Record], (index, sub): (u16, u8)) -> &mut Record {
    records.iter_mut().find(|record| (record.index, record.sub) == (index, sub)).unwrap()
}

fn take(records: &mut Vec<Record>, address: (u16, u8)) {
    records.retain(|record| (record.index, record.sub) != address);
}

#[test]
fn what_was_stored_is_in_force_again_and_nothing_is_to_be_said() {
    let mut before = configured();
    let image = before.stored();
    assert_eq!(image.bytes(), bytes(0x15, ID, &records(&image)));
    let (mut head, report) = Head::new(ID, &image_of(&records(&image)));
    assert_eq!(report, LoadReport { outcome: Outcome::Newest, ..LoadReport::default() });
    assert!(report.is_whole() && head.commissioned());
    assert_eq!(head.drive.settings(), before.drive.settings());
    for record in image.records() {
        let expected = before.read(record.index, record.sub);
        assert_eq!(head.read(record.index, record.sub), expected, "{:x}:{}", record.index, record.sub);
    }
    assert_eq!((head.read(0x6081, 0), head.read(0x607C, 0) as i32, head.read(0x1017, 0)), (4321, -77, 500));
    assert_eq!(head.stored(), image);
}

#[test]
fn the_order_of_the_records_means_nothing() {
    let (head, report) = loaded_with(|all| all.reverse());
    assert!(report.is_whole());
    assert_eq!(head.stored(), configured().stored());
}

#[test]
fn nothing_stored_is_nothing_lost() {
    let (head, report) = Head::new(ID, &StoredImage::NOTHING);
    assert_eq!(report, LoadReport::default());
    assert!(report.is_whole() && head.commissioned(), "the settings that it was given");
    let mut image = configured().stored();
    image.forget(Group::All);
    assert_eq!(image.bytes().len(), 11);
    let (_, report) = Head::new(ID, &image_of(&records(&image)));
    assert!(report.is_whole());
}

#[test]
fn a_group_is_kept_or_forgotten_without_the_other() {
    let head = configured();
    let (fresh, _) = Head::new(ID, &StoredImage::NOTHING);
    let all = head.stored();
    let mut image = all.clone();
    image.forget(Group::Communication);
    assert_eq!((image.communication().count(), image.node()), (0, None));
    assert_eq!(image.application().collect::<Vec<_>>(), all.application().collect::<Vec<_>>());
    image.keep(Group::Communication, &head.drive, &head.node).unwrap();
    assert_eq!(image, all);
    image.keep(Group::Application, &fresh.drive, &fresh.node).unwrap();
    image.keep(Group::Application, &head.drive, &head.node).unwrap();
    assert_eq!((image.node(), records(&image).len()), (Some(node()), records(&all).len()));
    image.forget(Group::Application);
    assert_eq!(image.communication().collect::<Vec<_>>(), all.communication().collect::<Vec<_>>());
    assert_eq!(image.application().count(), 0);
}

#[test]
fn how_the_head_is_reached_is_stored_by_itself_and_outlives_all_else() {
    let mut head = configured();
    let ask = |head: &mut Head, data: &[u8]| {
        head.node.receive(&Frame::new(0x7E5, data).unwrap(), Time(0), &mut head.drive);
    };
    ask(&mut head, &[0x04, 1, 0, 0, 0, 0, 0, 0]);
    ask(&mut head, &[0x11, 99, 0, 0, 0, 0, 0, 0]);
    ask(&mut head, &[0x13, 0, 4, 0, 0, 0, 0, 0]);
    let wanted = BusSettings { node: NodeId::new(99), bit_rate: BitRate::Kbit125 };
    let mut image = StoredImage::NOTHING;
    image.keep(Group::Bus, &head.drive, &head.node).unwrap();
    assert_eq!((image.bus(), image.records().count()), (Some(wanted), 0));
    image.keep(Group::All, &head.drive, &head.node).unwrap();
    // The parameters are those of the node that it is until it is reset.
    assert_eq!((image.bus(), image.node()), (Some(wanted), Some(node())));
    image.forget(Group::All);
    let mut again = StoredImage::NOTHING;
    assert_eq!(again.load(Loaded::Newest(image.bytes())), Outcome::Newest);
    assert_eq!((again.bus(), again.records().count()), (Some(wanted), 0));
    let (_, report) = Head::new(ID, &again);
    assert!(report.is_whole());
    ask(&mut head, &[0x11, 255, 0, 0, 0, 0, 0, 0]);
    image.keep(Group::Bus, &head.drive, &head.node).unwrap();
    assert_eq!(image.bus(), Some(BusSettings { node: None, ..wanted }));
    assert_eq!(configured().stored().bus(), None, "nobody has stored it");
}

#[test]
fn whichever_bit_flips_the_image_is_damaged_and_so_is_one_that_is_cut_or_has_more() {
    let good = configured().stored().bytes().to_vec();
    let mut image = StoredImage::NOTHING;
    let mut outcome = |bytes: &[u8]| image.load(Loaded::Newest(bytes));
    for bit in 0..8 * good.len() {
        let mut bad = good.clone();
        bad[bit / 8] ^= 1 << (bit % 8);
        assert_eq!(outcome(&bad), Outcome::Damaged, "bit {bit}");
    }
    for length in 0..good.len() {
        assert_eq!(outcome(&good[..length]), Outcome::Damaged, "{length}");
    }
    assert_eq!(outcome(&[&good[..], &[0]].concat()), Outcome::Damaged);
    // A count that does not fit, with the right checksum.
    let (mut content, records) = (good[..good.len() - 4].to_vec(), u16::from_le_bytes([good[5], good[6]]));
    content[5..7].copy_from_slice(&(records - 1).to_le_bytes());
    let check = crc(&content);
    assert_eq!(outcome(&[&content[..], &check.to_le_bytes()].concat()), Outcome::Damaged);
    assert_eq!(outcome(&good), Outcome::Newest);
}

#[test]
fn of_a_damaged_or_unknown_image_nothing_is_in_force_and_no_commissioning_counts() {
    let all = records(&configured().stored());
    let good = bytes(0x15, ID, &all);
    for (found, outcome) in [
        (Loaded::Newest(&good[..99]), Outcome::Damaged),
        (Loaded::Older(&good[..99]), Outcome::Damaged),
        (Loaded::Damaged, Outcome::Damaged),
        (Loaded::Newest(&bytes(0x18, ID, &all)), Outcome::Unknown),
        (Loaded::Newest(&bytes(0x18, ID, &[all[0]; 2000])), Outcome::Unknown),
    ] {
        let mut image = StoredImage::NOTHING;
        assert_eq!(image.load(found), outcome);
        let (mut head, report) = Head::new(ID, &image);
        assert_eq!((report.outcome, image.records().count()), (outcome, 0));
        assert_eq!(*head.drive.settings(), Settings::default());
        assert_eq!(head.read(0x1017, 0), 0);
    }
}

#[test]
fn an_older_image_is_in_force_but_not_its_commissioning() {
    let mut image = StoredImage::NOTHING;
    let stored = configured().stored();
    assert_eq!(image.load(Loaded::Older(stored.bytes())), Outcome::Older);
    let (head, report) = Head::new(ID, &image);
    assert_eq!(report, LoadReport { outcome: Outcome::Older, ..LoadReport::default() });
    assert_eq!(*head.drive.settings(), Settings { commissioned: false, ..*configured().drive.settings() });
}

#[test]
fn an_older_image_of_which_a_part_is_stored_anew_has_not_passed_its_commissioning_either() {
    let (stored, head) = (configured().stored(), configured());
    let changes: [fn(&mut StoredImage, &Head); 2] = [
        |image, head| image.keep(Group::Communication, &head.drive, &head.node).unwrap(),
        |image, _| image.forget(Group::Communication),
    ];
    for change in changes {
        for (found, passed) in [(Loaded::Newest(stored.bytes()), true), (Loaded::Older(stored.bytes()), false)] {
            let mut image = StoredImage::NOTHING;
            image.load(found);
            change(&mut image, &head);
            let (head, _) = Head::new(ID, &image_of(&records(&image)));
            assert_eq!(head.commissioned(), passed);
            assert_eq!(head.drive.settings().gap_setpoint, 47.5);
        }
    }
}

#[test]
fn a_loss_is_told_at_every_start_until_the_settings_are_stored_anew() {
    let (stored, head) = (configured().stored(), configured());
    type Change = fn(&mut StoredImage, &Head, Group);
    let changes: [Change; 2] = [
        |image, head, group| image.keep(group, &head.drive, &head.node).unwrap(),
        |image, _, group| image.forget(group),
    ];
    let unknown = bytes(0x16, ID, &[]);
    for (found, lost) in [
        (Loaded::Older(stored.bytes()), Outcome::Older),
        (Loaded::Damaged, Outcome::Damaged),
        (Loaded::Newest(&unknown), Outcome::Unknown),
    ] {
        for (change, group, outcome) in [
            (changes[0], Group::Bus, lost),
            (changes[0], Group::Communication, lost),
            (changes[1], Group::Communication, lost),
            (changes[0], Group::Application, Outcome::Newest),
            (changes[0], Group::All, Outcome::Newest),
            (changes[1], Group::Application, Outcome::Newest),
        ] {
            let mut image = StoredImage::NOTHING;
            assert_eq!(image.load(found), lost);
            change(&mut image, &head, group);
            let mut again = StoredImage::NOTHING;
            assert_eq!(again.load(Loaded::Newest(image.bytes())), outcome, "{found:?}, {group:?}");
            assert_eq!(again, image);
            // And a second start, after another name.
            if outcome == lost {
                again.keep(Group::Bus, &head.drive, &head.node).unwrap();
                let mut third = StoredImage::NOTHING;
                assert_eq!(third.load(Loaded::Newest(again.bytes())), lost);
            }
        }
    }
}

#[test]
fn an_unknown_address_is_skipped_and_named_and_all_else_is_in_force() {
    // Not there; there but not stored; there, of the communication area.
    let strange = [(0x2102, 99), (0x5FFF, 1), (0x2001, 1), (0x1018, 3)];
    let (head, report) = loaded_with(|all| {
        let records = strange.map(|(index, sub)| Record::new(index, sub, DataType::Unsigned32, 7));
        all.splice(3..3, records);
    });
    assert_eq!(report.skipped, listed(&strange));
    assert!(report.defaulted.is_empty() && head.commissioned());
    assert_eq!(head.stored(), configured().stored());
}

#[test]
fn a_missing_value_is_the_default_and_named() {
    let gain = setting_address("feed.gain_um_s_v").unwrap();
    for (address, value) in [(gain, 23f32.to_bits()), ((0x6081, 0), 10_000), ((0x1017, 0), 0)] {
        let (mut head, report) = loaded_with(|all| take(all, address));
        assert_eq!((report.skipped, report.defaulted), (Listed::default(), listed(&[address])));
        assert_eq!(head.read(address.0, address.1), value);
        assert!(head.commissioned());
        assert_eq!(head.drive.settings().gap_setpoint, 47.5);
    }
}

#[test]
fn a_value_out_of_range_or_of_another_type_is_the_default_and_named() {
    let corner = setting_address("gap.corner_hz").unwrap();
    let law = setting_address("feed.law").unwrap();
    for (address, value, default) in [
        (corner, f32::NAN.to_bits(), 200f32.to_bits()),
        (corner, 2000.1f32.to_bits(), 200f32.to_bits()),
        (law, LawName::ALL.len() as u32, 2),
        (law, 0x100, 2),
        ((0x60C2, 1), 0, 1),
        ((0x605A, 0), 3, 6),
        ((0x605A, 0), 0xFFFF, 6),
        ((0x6098, 0), 36, 35),
    ] {
        let (mut head, report) = loaded_with(|all| find(all, address).value = value);
        assert_eq!(report.defaulted, listed(&[address]), "{value:x}");
        assert_eq!(head.read(address.0, address.1), default);
    }
    let (mut head, report) = loaded_with(|all| find(all, corner).kind = DataType::Unsigned32.code() as u8);
    assert_eq!(report.defaulted, listed(&[corner]));
    assert_eq!(head.read(corner.0, corner.1), 200f32.to_bits());
    // On the bound.
    let (mut head, report) = loaded_with(|all| set(all, "gap.corner_hz", Value::Number(2000.0)));
    assert!(report.is_whole());
    assert_eq!(head.read(corner.0, corner.1), 2000f32.to_bits());
}

#[test]
fn of_two_limits_at_odds_the_later_is_the_default() {
    let (mut head, report) = loaded_with(|all| {
        find(all, (0x607D, 1)).value = 100;
        find(all, (0x607D, 2)).value = 50;
    });
    assert_eq!(report.defaulted, listed(&[(0x607D, 2)]));
    assert_eq!((head.read(0x607D, 1), head.read(0x607D, 2)), (100, i32::MAX as u32));
}

#[test]
fn a_value_at_odds_with_others_is_the_default_and_named() {
    let (head, report) = loaded_with(|all| set(all, "servo.position_hz", Value::Number(150.0)));
    assert_eq!(report.defaulted, listed(&[setting_address("servo.position_hz").unwrap()]));
    assert_eq!(head.drive.settings().servo_position_hz, 60.0);
    assert_eq!((head.drive.settings().gap_setpoint, head.commissioned()), (47.5, true));
}

#[test]
fn settings_that_their_defaults_cannot_reconcile_are_all_defaults() {
    // The set point is at its default of 60 V, and the lowest open-circuit voltage below it.
    let (head, report) = loaded_with(|all| {
        set(all, "gap.setpoint_v", Value::Number(60.0));
        set(all, "gap.open_min_v", Value::Number(50.0));
    });
    let mut expected = listed(&[setting_address("gap.open_min_v").unwrap()]);
    expected.count = 2;
    assert_eq!(report.defaulted, expected, "and the mass");
    assert_eq!(*head.drive.settings(), Settings::default());
}

#[test]
fn commissioning_does_not_outlive_the_settings_that_it_has_passed() {
    for (key, counts) in [
        ("axis.mass_kg", false),
        ("motor.reversed", false),
        ("motor.peak_a", false),
        ("encoder.reversed", false),
        ("encoder.count_um", false),
        ("gap.reversed", false),
        ("commission.passed", false),
        ("feed.gain_um_s_v", true),
        ("gap.setpoint_v", true),
    ] {
        let (head, report) = loaded_with(|all| take(all, setting_address(key).unwrap()));
        assert_eq!((report.defaulted.count, head.commissioned()), (1, counts), "{key} missing");
        let (head, report) = loaded_with(|all| find(all, setting_address(key).unwrap()).value = f32::NAN.to_bits());
        assert_eq!((report.defaulted.count, head.commissioned()), (1, counts), "{key} out of range");
    }
}

#[test]
fn communication_parameters_of_another_node_are_defaults_and_named() {
    let stored = configured().stored();
    let (mut head, report) = Head::new(ID + 1, &stored);
    let first = stored.communication().next().unwrap();
    assert_eq!(usize::from(report.defaulted.count), stored.communication().count());
    assert_eq!(report.defaulted.first, Some((first.index, first.sub)));
    assert_eq!((head.read(0x1017, 0), head.read(0x1400, 1)), (0, 0x200 + u32::from(ID) + 1));
    assert_eq!((head.drive.settings().gap_setpoint, head.commissioned()), (47.5, true));
}

#[test]
fn there_is_room_for_500_settings() {
    let stored = configured().stored();
    let others = stored.records().count() - Settings::COUNT;
    assert!(500 + others <= ROOM, "{others} others, room for {ROOM}");
    let record = Record::new(0x2200, 1, DataType::Real32, 0);
    let longest = bytes(0x15, ID, &[record; ROOM]);
    assert!(longest.len() <= MAX_IMAGE && longest.len() + 8 > MAX_IMAGE);
    let mut image = StoredImage::NOTHING;
    assert_eq!(image.load(Loaded::Newest(&longest)), Outcome::Newest);
    assert_eq!((image.records().count(), image.bytes() == longest), (ROOM, true));
    // Of another program, and they belong to the group that is not kept.
    let head = configured();
    assert!(image.keep(Group::Communication, &head.drive, &head.node).is_err());
    assert!(image.keep(Group::Application, &head.drive, &head.node).is_ok());
}

struct Off;

impl Permit for Off {
    fn holds(&self) -> bool {
        true
    }
}

type Flash = TestFlash<2>;

fn save(flash: &mut Flash, image: &[u8]) -> Result<(), StoreError<edm_hal_shim::double::flash::FlashFault>> {
    Store::<_, Off>::new(flash, 0).unwrap().save(image, &mut [0; BUFFER], &Off)
}

fn load(flash: &mut Flash, image: &mut StoredImage) -> Outcome {
    image.load(Store::<_, Off>::new(flash, 0).unwrap().load(&mut [0; BUFFER]).unwrap())
}

#[test]
fn whichever_bit_of_it_flips_in_the_flash_the_image_before_is_in_force_and_called_older() {
    let (mut older, mut image) = (configured().stored(), StoredImage::NOTHING);
    older.forget(Group::Communication);
    let newest = configured().stored().bytes().to_vec();
    let mut flash = Flash::default();
    save(&mut flash, older.bytes()).unwrap();
    save(&mut flash, &newest).unwrap();
    assert_eq!(load(&mut flash, &mut image), Outcome::Newest);
    assert_eq!(image.bytes(), newest);
    let at = flash.cells().windows(newest.len()).rposition(|window| window == newest).unwrap();
    for bit in 8 * at..8 * (at + newest.len()) {
        flash.cells()[bit / 8] ^= 1 << (bit % 8);
        assert_eq!(load(&mut flash, &mut image), Outcome::Older, "bit {}", bit - 8 * at);
        assert_eq!(image.bytes(), older.bytes());
        flash.cells()[bit / 8] ^= 1 << (bit % 8);
    }
}

/// What a virtual head of node-ID 5 has stored with the program of commit e04a51ff, two of three values others than their defaults.
const STORED: &[u8] = include_bytes!("fixtures/node-5.stored");

#[test]
fn what_an_earlier_program_has_stored_in_this_format_is_in_force_with_every_value() {
    let mut image = StoredImage::NOTHING;
    assert_eq!(image.load(Loaded::Newest(STORED)), Outcome::Newest);
    assert_eq!((image.bytes(), image.node()), (STORED, Some(node())));
    let (mut head, report) = Head::new(ID, &image);
    assert_eq!((report.outcome, report.skipped), (Outcome::Newest, Listed::default()), "{report}");
    let stored = records(&image);
    for &Record { index, sub, value, .. } in &stored {
        // So settings that are newer than the image are all that can be replaced by their defaults.
        assert_eq!(head.read(index, sub), value, "{index:x}:{sub}");
    }
    assert!(stored.len() > 300);
}

#[test]
fn the_format_of_0_1_0_is_refused_as_damage_is() {
    // Both parts, version 1 and fingerprint of its settings; no checksum.
    let mut old = vec![0; 944];
    old[..6].copy_from_slice(&[3, 1, 0xB8, 0x9D, 0x4A, 0x0D]);
    let mut image = StoredImage::NOTHING;
    assert_eq!(image.load(Loaded::Newest(&old)), Outcome::Damaged);
    let (head, report) = Head::new(ID, &image);
    assert_eq!((report.outcome, image.bus(), image.records().count()), (Outcome::Damaged, None, 0));
    assert_eq!(*head.drive.settings(), Settings::default());
}
