//! Settings survive power cuts: the newest image or the one before, never neither, never garbage.

use edm_hal_shim::double::flash::{FlashFault, SECTOR, TestFlash};
use edm_hal_shim::storage::{ErrorType, NorFlash, ReadNorFlash};
use edm_hal_shim::store::{BUFFER, Loaded, MAX_IMAGE, Permit, Store, StoreError};
use proptest::prelude::*;
use std::cell::Cell;
use std::rc::Rc;

type Flash = TestFlash<3>;
type Result<T> = std::result::Result<T, StoreError<FlashFault>>;

/// Where the two sectors begin: the first sector of the flash is somebody else's.
const START: u32 = SECTOR as u32;

/// WritePermit for a number of operations.
struct WritePermit(Cell<u32>);

impl WritePermit {
    fn for_operations(n: u32) -> Self {
        WritePermit(Cell::new(n))
    }
    fn always() -> Self {
        WritePermit::for_operations(u32::MAX)
    }
}

impl Permit for WritePermit {
    fn holds(&self) -> bool {
        let left = self.0.get();
        self.0.set(left.saturating_sub(1));
        left > 0
    }
}

fn store(flash: &mut Flash) -> Store<&mut Flash, WritePermit> {
    Store::new(flash, START).unwrap()
}

fn save(flash: &mut Flash, image: &[u8]) -> Result<()> {
    store(flash).save(image, &mut [0; BUFFER], &WritePermit::always())
}

fn load(flash: &mut Flash) -> Result<Option<Vec<u8>>> {
    Ok(store(flash).load(&mut [0; BUFFER])?.image().map(<[u8]>::to_vec))
}

/// Whether what is loaded is said to be the image that was saved last.
fn is_newest(flash: &mut Flash) -> bool {
    matches!(store(flash).load(&mut [0; BUFFER]), Ok(Loaded::Newest(_)))
}

/// Whether what is loaded is said to be an older image.
fn is_older(flash: &mut Flash) -> bool {
    matches!(store(flash).load(&mut [0; BUFFER]), Ok(Loaded::Older(_)))
}

/// The n-th image: of its own length and content.
fn image(n: u32) -> Vec<u8> {
    let mut x = u64::from(n) * 2 + 1;
    let mut next = || {
        x ^= x << 13;
        x ^= x >> 7;
        x ^= x << 17;
        x
    };
    let len = 600 + next() as usize % 1448;
    let mut image = n.to_le_bytes().to_vec();
    image.resize_with(len, || next() as u8);
    image
}

/// A flash after `n` saves.
fn after(n: u32) -> Flash {
    let mut flash = Flash::default();
    (1..=n).for_each(|i| save(&mut flash, &image(i)).unwrap());
    flash
}

fn reads(flash: &mut Flash, n: u32) -> bool {
    load(flash).unwrap() == (n > 0).then(|| image(n))
}

#[test]
fn a_new_flash_holds_nothing_and_then_what_was_saved_last() {
    let mut flash = Flash::default();
    assert_eq!(store(&mut flash).load(&mut [0; BUFFER]), Ok(Loaded::Nothing));
    for n in 1..=60 {
        save(&mut flash, &image(n)).unwrap();
        assert!(reads(&mut flash, n) && is_newest(&mut flash), "{n}");
    }
    for image in [&[][..], &[0], &[0xFF; 7], &[0; MAX_IMAGE], &[0xFF; MAX_IMAGE]] {
        save(&mut flash, image).unwrap();
        assert_eq!(load(&mut flash), Ok(Some(image.to_vec())));
        assert!(is_newest(&mut flash));
    }
}

#[test]
fn a_power_cut_at_every_operation_leaves_the_new_image_or_the_old() {
    let mut flash = Flash::default();
    let (mut old, mut new) = (0, 0);
    // Long enough for both sectors to be filled and erased twice.
    for n in 1..=40 {
        let mut whole = flash.clone();
        save(&mut whole, &image(n)).unwrap();
        let operations = whole.operations() - flash.operations();
        let erases = whole.erases() != flash.erases();
        for at in 0..operations {
            // The erase is among the first, if there is one: it can stop in more ways than a word.
            let seeds = if erases && at < 4 { 0..12 } else { 0..1 };
            for seed in seeds {
                let mut cut = flash.clone();
                cut.cut_after(at, u64::from(n * 1000 + at) * 100 + seed);
                let result = save(&mut cut, &image(n));
                assert_eq!(result, Err(StoreError::Flash(FlashFault::Off)), "image {n}, operation {at}");
                cut.power_up();
                let loaded = load(&mut cut).unwrap();
                if loaded == Some(image(n)) {
                    assert!(is_newest(&mut cut), "image {n}, operation {at}, seed {seed}");
                    new += 1;
                } else {
                    // A word of the header was written: the image that was not finished is noticed.
                    let begun = !erases && at > 0 && n > 1;
                    assert!(!begun || is_older(&mut cut), "image {n}, operation {at}, seed {seed}");
                    assert_eq!(loaded, (n > 1).then(|| image(n - 1)), "image {n}, operation {at}, seed {seed}");
                    old += 1;
                }
                // And the store goes on working.
                save(&mut cut, &image(1000)).unwrap();
                assert!(reads(&mut cut, 1000) && is_newest(&mut cut), "image {n}, operation {at}, seed {seed}");
            }
        }
        flash = whole;
    }
    assert!(flash.erases()[1] >= 2 && flash.erases()[2] >= 2, "{:?}", flash.erases());
    assert!(old > 10_000 && new > 0, "{old} old, {new} new");
}

#[test]
fn an_old_image_in_a_half_erased_sector_does_not_come_back() {
    // The save that erases a sector full of old images.
    let n = (2..60).find(|&n| after(n).erases()[1] == 2).unwrap();
    let before = after(n - 1);
    for seed in 0..300 {
        let mut cut = before.clone();
        // Everything before the erase is the attempt to append.
        cut.cut_after(before_erase(&before, n), seed);
        save(&mut cut, &image(n)).unwrap_err();
        assert_eq!(cut.erases()[1], 2);
        cut.power_up();
        let operations = cut.operations();
        assert!(reads(&mut cut, n - 1), "seed {seed}");
        assert_eq!(cut.operations(), operations, "loading does not repair");
        save(&mut cut, &image(n)).unwrap();
        assert!(reads(&mut cut, n));
    }
}

/// Operations of the save of image `n` before its erase.
fn before_erase(before: &Flash, n: u32) -> u32 {
    (0..10)
        .find(|&at| {
            let mut cut = before.clone();
            cut.cut_after(at, 0);
            save(&mut cut, &image(n)).unwrap_err();
            cut.erases() != before.erases()
        })
        .unwrap()
}

#[test]
fn nothing_is_written_without_a_permit() {
    let mut flash = after(3);
    let before = flash.clone().cells().to_vec();
    let result = store(&mut flash).save(&image(4), &mut [0; BUFFER], &WritePermit::for_operations(0));
    assert_eq!(result, Err(StoreError::Refused));
    assert_eq!(flash.cells(), before);
    assert!(reads(&mut flash, 3));
}

#[test]
fn leave_withdrawn_in_the_middle_ends_a_save_like_a_power_cut() {
    // One save that appends, one that goes to the other sector.
    let turn = (2..60).find(|&n| after(n).erases()[2] == 1).unwrap();
    for n in [turn - 1, turn] {
        let before = after(n - 1);
        let done = (0..20).find(|&permit| {
            let mut flash = before.clone();
            let result = store(&mut flash).save(&image(n), &mut [0; BUFFER], &WritePermit::for_operations(permit));
            assert!(reads(&mut flash, n - 1) || reads(&mut flash, n));
            save(&mut flash, &image(n)).unwrap();
            assert!(reads(&mut flash, n));
            assert!(matches!(result, Ok(()) | Err(StoreError::Refused)));
            result.is_ok()
        });
        assert!(done.is_some_and(|operations| operations >= 3), "{done:?}");
    }
}

#[test]
fn an_image_of_6144_bytes_is_the_longest_and_two_fit_a_sector() {
    let mut flash = after(1);
    assert_eq!(save(&mut flash, &[0; MAX_IMAGE + 1]), Err(StoreError::TooLong));
    assert!(reads(&mut flash, 1));
    assert_eq!(MAX_IMAGE, 6144);
    let mut flash = Flash::default();
    for (byte, erases) in [(0, [1, 0]), (1, [1, 0]), (2, [1, 1]), (3, [1, 1]), (4, [2, 1])] {
        assert_eq!(save(&mut flash, &[byte; MAX_IMAGE]), Ok(()));
        assert_eq!(flash.erases()[1..], erases, "{byte}");
    }
}

#[test]
fn saving_what_is_stored_already_writes_nothing() {
    let mut flash = after(5);
    let operations = flash.operations();
    save(&mut flash, &image(5)).unwrap();
    assert_eq!(flash.operations(), operations);
    save(&mut flash, &image(4)).unwrap();
    assert!(flash.operations() > operations);
    assert!(reads(&mut flash, 4));
}

#[test]
fn both_sectors_wear_alike_and_the_neighbour_not_at_all() {
    let mut flash = Flash::default();
    flash.write(0, &[0x55; 4]).unwrap();
    for n in 0..2000u32 {
        save(&mut flash, &[n.to_le_bytes(); 256].concat()).unwrap();
    }
    let [neighbour, a, b] = flash.erases();
    assert_eq!(neighbour, 0);
    assert_eq!(flash.cells()[..4], [0x55; 4]);
    // 15 records of 4 + 8 + 1029 bytes fill a sector.
    assert_eq!(a + b, 2000_u32.div_ceil(15));
    assert!(a.abs_diff(b) <= 1);
}

#[test]
fn a_damaged_image_is_passed_over_for_the_one_before_and_that_is_said() {
    let flash = after(4);
    let newest = image(4);
    for byte in [0, 1, newest.len() / 2, newest.len() - 1] {
        let mut flash = flash.clone();
        let at = find(flash.cells(), &newest);
        flash.cells()[at + byte] ^= 0x10;
        assert!(reads(&mut flash, 3) && is_older(&mut flash), "byte {byte}");
        // Also when it is what is stored already.
        save(&mut flash, &image(3)).unwrap();
        assert!(reads(&mut flash, 3) && is_newest(&mut flash), "byte {byte}");
        save(&mut flash, &image(5)).unwrap();
        assert!(reads(&mut flash, 5) && is_newest(&mut flash), "byte {byte}");
    }
}

#[test]
fn whichever_bit_of_the_newest_image_flips_the_one_before_is_given_and_called_older() {
    let mut whole = Flash::default();
    save(&mut whole, &image(1)).unwrap();
    let newest = [0x5A; 41];
    save(&mut whole, &newest).unwrap();
    // Checksum, length and its check, sequence, format, image. Zeros behind it, to the next word, mean nothing.
    let at = find(whole.cells(), &newest);
    let record = at - 13..at + newest.len();
    for bit in 8 * record.start..8 * record.end {
        let mut flash = whole.clone();
        flash.cells()[bit / 8] ^= 1 << (bit % 8);
        assert!(reads(&mut flash, 1) && is_older(&mut flash), "byte {} of the record", bit / 8 - record.start);
    }
    for bit in 8 * record.end..8 * record.end.next_multiple_of(4) {
        let mut flash = whole.clone();
        flash.cells()[bit / 8] ^= 1 << (bit % 8);
        assert_eq!(store(&mut flash).load(&mut [0; BUFFER]), Ok(Loaded::Newest(&newest)));
    }
}

#[test]
fn an_image_that_is_damaged_where_its_sector_begins_is_noticed_in_the_other_one() {
    // The save that goes to the second sector for the first time.
    let n = (2..60).find(|&n| after(n).erases()[2] == 1).unwrap();
    let mut flash = after(n);
    assert!(is_newest(&mut flash));
    let at = find(flash.cells(), &image(n));
    flash.cells()[at + 9] ^= 1;
    assert!(reads(&mut flash, n - 1) && is_older(&mut flash));
    save(&mut flash, &image(n + 1)).unwrap();
    assert!(reads(&mut flash, n + 1) && is_newest(&mut flash));
}

#[test]
fn a_single_image_that_is_damaged_is_not_nothing() {
    let mut flash = after(1);
    let at = find(flash.cells(), &image(1));
    flash.cells()[at + 9] ^= 1;
    assert_eq!(store(&mut flash).load(&mut [0; BUFFER]), Ok(Loaded::Damaged));
    save(&mut flash, &image(2)).unwrap();
    assert!(reads(&mut flash, 2) && is_newest(&mut flash));
}

#[test]
fn a_header_that_promises_too_much_hides_nothing_that_was_stored() {
    // Left by a cut between the words of a header: its length is wrong, and the check of the length happens to agree.
    for length in [1u16, 8, 2053, 2054, 3000, 9000, 0xFFFF] {
        let mut flash = after(3);
        let newest = image(3);
        let end = (find(flash.cells(), &newest) + newest.len()).next_multiple_of(4) as u32;
        let [l, h] = length.to_le_bytes();
        let [cl, ch] = length_check([l, h]).to_le_bytes();
        flash.write(end, &[0x12, 0x34, 0x56, 0x78, l, h, cl, ch]).unwrap();
        assert!(reads(&mut flash, 3) && is_older(&mut flash), "{length}");
        for n in 4..30 {
            save(&mut flash, &image(n)).unwrap();
            assert!(reads(&mut flash, n), "{length}");
        }
    }
}

/// The check of a length in a header of sequential-storage 8: CRC-16, polynomial 0x1a2e reflected, inverted both ways.
fn length_check(bytes: [u8; 2]) -> u16 {
    let mut crc = 0xFFFFu16;
    for byte in bytes {
        crc ^= u16::from(byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 { crc >> 1 ^ 0x1A2E } else { crc >> 1 };
        }
    }
    crc ^ 0xFFFF
}

#[test]
fn sectors_outside_the_flash_or_off_its_grid_are_refused() {
    let region = |start: usize| Store::<_, WritePermit>::new(Flash::default(), start as u32).map(|_| ());
    assert_eq!(region(0), Ok(()));
    assert_eq!(region(SECTOR), Ok(()));
    assert_eq!(region(2 * SECTOR), Err(StoreError::Region));
    assert_eq!(region(SECTOR + 4), Err(StoreError::Region));
}

/// A flash that is worn out from some offset on, where it takes words and keeps none of them, and that panics when it is
/// written or erased without permit having been asked just before.
struct Chip {
    flash: Flash,
    worn_from: u32,
    asked: Rc<Cell<bool>>,
}

struct Asked(Rc<Cell<bool>>);

impl Permit for Asked {
    fn holds(&self) -> bool {
        self.0.set(true);
        true
    }
}

fn chip(worn_from: u32) -> (Store<Chip, Asked>, Asked) {
    let asked = Rc::new(Cell::new(false));
    let chip = Chip { flash: Flash::default(), worn_from, asked: asked.clone() };
    (Store::new(chip, START).unwrap(), Asked(asked))
}

impl ErrorType for Chip {
    type Error = FlashFault;
}

impl ReadNorFlash for Chip {
    const READ_SIZE: usize = 1;
    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> std::result::Result<(), FlashFault> {
        self.flash.read(offset, bytes)
    }
    fn capacity(&self) -> usize {
        self.flash.capacity()
    }
}

impl NorFlash for Chip {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = SECTOR;
    fn erase(&mut self, from: u32, to: u32) -> std::result::Result<(), FlashFault> {
        assert!(self.asked.take(), "erase without permit");
        self.flash.erase(from, to)
    }
    fn write(&mut self, offset: u32, bytes: &[u8]) -> std::result::Result<(), FlashFault> {
        assert!(self.asked.take(), "write without permit");
        if offset >= self.worn_from { Ok(()) } else { self.flash.write(offset, bytes) }
    }
}

#[test]
fn leave_is_asked_before_every_operation() {
    let (mut store, permit) = chip(u32::MAX);
    (1..40).for_each(|n| store.save(&image(n), &mut [0; BUFFER], &permit).unwrap());
}

#[test]
fn a_worn_out_flash_is_reported_and_keeps_the_last_image() {
    let mut buffer = [0; BUFFER];
    // The second sector is worn, all of it or beyond its first word: images go to the first as long as there is room.
    for worn_from in [2 * START, 2 * START + 4] {
        let (mut store, permit) = chip(worn_from);
        let mut last = 0;
        let fault = (1..100).find_map(|n| {
            let result = store.save(&image(n), &mut buffer, &permit);
            last = if result.is_ok() { n } else { last };
            result.err()
        });
        assert_eq!(fault, Some(StoreError::NotVerified));
        assert!(last > 5);
        assert_eq!(store.load(&mut buffer).map(Loaded::image), Ok(Some(&image(last)[..])));
    }
    // Both sectors.
    let (mut store, permit) = chip(START);
    assert_eq!(store.save(&image(1), &mut buffer, &permit), Err(StoreError::NotVerified));
    assert_eq!(store.load(&mut buffer), Ok(Loaded::Nothing));
}

fn find(cells: &[u8], bytes: &[u8]) -> usize {
    cells.windows(bytes.len()).rposition(|w| w == bytes).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_storm_of_power_cuts_loses_no_image_that_was_acknowledged(
        cuts in prop::collection::vec((0u32..1200, any::<u64>()), 1..60),
    ) {
        let mut flash = Flash::default();
        let mut stored = 0;
        for (n, (at, seed)) in (1..).zip(cuts) {
            flash.cut_after(at, seed);
            let acknowledged = save(&mut flash, &image(n)).is_ok();
            flash.power_up();
            if acknowledged || reads(&mut flash, n) {
                stored = n;
            }
            prop_assert!(reads(&mut flash, stored), "image {n}, acknowledged {acknowledged}");
            prop_assert!(!acknowledged || is_newest(&mut flash), "image {n}");
        }
    }
}
