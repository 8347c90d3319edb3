//! Faults put into the firmware. Each must turn a check red that the firmware as it is passes: a model that does not notice
//! proves nothing.
//!
//! A fault is a register write altered on its way, or an ELF file with some bytes changed; the firmware is not rebuilt.

use crate::common;
use edm_fil::image::Image;
use edm_fil::latency::{RATED_SCENE, lost};
use edm_fil::machine::Alter;
use edm_fil::session::{MS, Session};
use edm_hal_shim::seal::PROGRAM;
use edm_soc::TICK_HZ;

const TIM1_CCER: u32 = 0x4001_0020;
const TIM5_CCER: u32 = 0x4000_0c20;
const ADC1_CR2: u32 = 0x4001_2008;
const CAN_FILTERS: std::ops::Range<u32> = 0x4000_6640..0x4000_6720;
/// Exceptions of the gap task, DMA2_STREAM0, and of the servo task, TIM1_UP.
const GAP: usize = 16 + 56;
const SERVO: usize = 16 + 25;
const DMA2_S0NDTR: u32 = 0x4002_6414;
const CPACR: u32 = 0xe000_ed88;
const PRIORITIES: std::ops::Range<u32> = 0xe000_e400..0xe000_e4f0;

/// What is wrong with the firmware, `None` if nothing: it closes the loop, erodes, and serves rated edges and shorts.
fn check(file: &[u8], alter: Option<Alter>) -> Option<String> {
    run(file, alter, |_| ()).err().map(|e| format!("{e:#}"))
}

/// `prepare` is done once the loop is closed.
pub fn run(file: &[u8], alter: Option<Alter>, prepare: impl FnOnce(&mut Session)) -> anyhow::Result<()> {
    let image = Image::parse(file.to_vec())?;
    let mut session = Session::altered(&image, RATED_SCENE, alter)?;
    prepare(&mut session);
    session.erode()?;
    session.machine.soc().world.disturb();
    let entries = |session: &Session, exception: usize| session.machine.stats().entries[exception];
    let before = [GAP, SERVO].map(|exception| entries(&session, exception));
    session.idle(30 * MS)?;
    let [blocks, ticks] = [GAP, SERVO].map(|exception| entries(&session, exception));
    let (blocks, ticks) = (blocks - before[0], ticks - before[1]);
    anyhow::ensure!(blocks.abs_diff(ticks) <= 1, "{blocks} blocks of conversions in {ticks} ticks");
    session.machine.soc().world.calm();
    let (isr, timer) = lost(&mut session, &image)?;
    anyhow::ensure!((isr, timer) == (0, 0), "counts lost: {isr} by interrupt, {timer} by timer");
    anyhow::ensure!(session.state()? == 4, "no longer eroding: {:?}", session.log);
    let shorts = &session.machine.soc().world.shorts;
    anyhow::ensure!(shorts.len() > 200, "{} shorts met", shorts.len());
    for short in shorts.iter().filter(|s| s.sampled.is_some()) {
        // 2.5 us from the sample to the pin.
        let late = short.killed.zip(short.sampled).map(|(killed, sampled)| killed - sampled);
        anyhow::ensure!(late.is_some_and(|t| t * 1_000_000 <= TICK_HZ * 5 / 2), "short served after {late:?} cycles");
    }
    Ok(())
}

/// As [`check`], with writes to `register` changed.
fn write(register: u32, change: impl Fn(u32) -> u32 + 'static) -> String {
    let alter = move |address, _, value| if address == register { change(value) } else { value };
    check(common::firmware(), Some(Box::new(alter))).expect("the fault was not noticed")
}

fn assert_says(found: &str, expected: &str) {
    assert!(found.contains(expected), "noticed, but otherwise than expected: {found}");
}

#[test]
fn the_firmware_as_it_is_passes() {
    assert_eq!(check(common::firmware(), None), None);
    assert_eq!(check(common::firmware(), Some(Box::new(|_, _, value| value))), None);
}

#[test]
fn the_fpu_not_enabled() {
    let found = write(CPACR, |_| 0);
    // NOCP, escalated, before any clock is on: the fault handler has to switch on what it writes.
    assert_says(&found, "error hard fault at");
    assert_says(&found, "status 0x00080000");
}

#[test]
fn a_wrong_adc_trigger() {
    let found = write(ADC1_CR2, |v| if v >> 28 & 3 == 0 { v } else { v & !(15 << 24) | 0b0101 << 24 });
    assert_says(&found, "NoConversions");
}

#[test]
fn a_wrong_can_filter() {
    let alter = |address, _, value: u32| if CAN_FILTERS.contains(&address) { value ^ 0x20_0020 } else { value };
    let found = check(common::firmware(), Some(Box::new(alter))).expect("the fault was not noticed");
    // The head does not hear what it is told.
    assert_says(&found, "1016h:1: no answer");
}

#[test]
fn a_swapped_pwm_channel() {
    let found = write(TIM1_CCER, |v| v << 4);
    // The duty changes and the current of the motor does not, which shows before the following error does.
    assert_says(&found, "DriveSignalLost");
}

#[test]
fn the_encoder_timer_with_one_channel_inverted() {
    // The register is not what it was, which is noticed before the counts part.
    let invert = |session: &mut Session| session.machine.soc().write(TIM5_CCER, 4, 1 << 1).unwrap();
    let found = run(common::firmware(), None, invert).expect_err("the fault was not noticed");
    assert_says(&format!("{found:#}"), "SettingsDamaged");
}

#[test]
fn interrupt_priorities_inverted() {
    let alter = |address, size: u8, value: u32| match address {
        a if PRIORITIES.contains(&a) && size == 1 => 0xf0 - (value & 0xf0),
        _ => value,
    };
    let found = check(common::firmware(), Some(Box::new(alter))).expect("the fault was not noticed");
    // The servo task interrupts the gap task; where, says how long that takes. Either it finds no new reading and does not
    // move, or it moves, and the interrupts of the encoder wait for all others: counts are lost, or the head says so. Or what waits for
    // the protocol waits for ticks: they are missing, or blocks of conversions are.
    let expected = ["does not erode", "counts lost", "EncoderLost", "ClockLost", "blocks of conversions"];
    assert!(expected.iter().any(|text| found.contains(text)), "noticed, but otherwise than expected: {found}");
}

#[test]
fn the_encoder_below_all_others() {
    let encoder = PRIORITIES.start + 6..PRIORITIES.start + 9;
    let alter = move |address, _, value| if encoder.contains(&address) { 0xf0 } else { value };
    let found = check(common::firmware(), Some(Box::new(alter))).expect("the fault was not noticed");
    assert_says(&found, "counts lost");
}

#[test]
fn a_dma_length_off_by_one() {
    let found = write(DMA2_S0NDTR, |v| v - 1);
    // The blocks drift against the ticks.
    assert_says(&found, "blocks of conversions in ");
}

#[test]
fn an_interrupt_without_a_handler() {
    let mut file = common::firmware().to_vec();
    let default = Image::parse(file.clone()).unwrap().symbol("DefaultHandler").expect("there is a default handler");
    let vector = common::place(&file, PROGRAM + 4 * (16 + 6));
    file[vector..vector + 4].copy_from_slice(&(default | 1).to_le_bytes());
    let found = check(&edm_seal::seal(file).unwrap(), None).expect("the fault was not noticed");
    assert_says(&found, "death: Unexpected, detail: 6");
}

#[test]
fn a_linker_script_moved() {
    let mut file = common::firmware().to_vec();
    let word = |file: &[u8], at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap());
    let (table, count) = (word(&file, 28) as usize, word(&file, 44) & 0xffff);
    for header in (0..count as usize).map(|i| table + 32 * i) {
        let physical = word(&file, header + 12);
        if physical >> 20 == 0x080 {
            file[header + 12..header + 16].copy_from_slice(&(physical + 0x4000).to_le_bytes());
        }
    }
    let found = check(&file, None).expect("the fault was not noticed");
    assert_says(&found, "no segment at 0x0800_0000");
}
