//! The release image on a busy bus of 1 Mbit/s. Times are those of the modelled chip; the model lets frames of both directions
//! pass each other, so what waits for a real bus comes on top.

use crate::common;
use anyhow::{Result, anyhow, bail, ensure};
use edm_fil::bench::WINDOW;
use edm_fil::host::{self, Bus as _};
use edm_fil::image::Image;
use edm_fil::latency::ticks_begin;
use edm_fil::rig::{Emulated, Witness};
use edm_servo_head::head::Command;
use edm_servo_head::settings::Settings;
use edm_servo_head::units::Nanometres;
use edm_sim::machine::Rig as _;
use edm_sim::process::Plant;
use edm_soc::{CanReply, Frame, TICK_HZ};

const US: u64 = TICK_HZ / 1_000_000;
const MS: u64 = 1000 * US;
/// Set points streamed.
const POINTS: usize = 500;
/// Foreign frames of eight bytes in a millisecond, with SYNC, one RPDO and two TPDOs 95 % of the bus.
const FOREIGN: u32 = 5;

/// A chip that has booted, and is operational.
fn started() -> Result<Emulated> {
    let image = Image::parse(common::firmware().to_vec())?;
    let settings = Settings { commissioned: true, ..Settings::default() };
    let mut rig = Emulated::start(&image, Plant::default(), &settings, 1, Witness::None)?;
    host::begin(&mut rig)?;
    Ok(rig)
}

/// Homed, enabled, in operation; TPDO 1 and 2 and RPDO 2 with every SYNC.
fn cyclic() -> Result<Emulated> {
    let mut rig = started()?;
    for (index, value) in [(0x1800, 1), (0x1801, 1), (0x1401, 1)] {
        host::write(&mut rig, index, 2, value, 1)?;
    }
    host::command(&mut rig, Command::SetHome(Nanometres(0)))?;
    host::write(&mut rig, 0x6060, 0, 8, 1)?;
    host::command(&mut rig, Command::Enable)?;
    Ok(rig)
}

/// One RPDO and two TPDOs a millisecond on a bus that foreign frames `foreign` fill: none of ours is lost, no tick is moved,
/// and every set point, although its RPDO ends where SYNC begins, is in force in the first tick that begins after its SYNC.
fn streams(rig: &mut Emulated, foreign: u16) -> Result<()> {
    while rig.take_timed().is_some() {}
    rig.record_spans();
    let (mut synced, mut carried, mut ticks, mut sent) = (Vec::new(), Vec::new(), Vec::new(), [0; 2]);
    // The last frames are under way when their millisecond has gone.
    for n in 0..POINTS as u64 + 2 {
        if n < POINTS as u64 {
            // The phase of the SYNC goes once through the millisecond.
            let phase = n * MS / POINTS as u64;
            let target = (n / 4) as i32;
            rig.send_at(phase, Frame::new(0x301, &target.to_le_bytes()));
            synced.push((rig.send_at(0, Frame::new(0x80, &[])), target));
            for i in 0..FOREIGN {
                rig.send_at(0, Frame::new(foreign + (i % 4) as u16, &[i as u8; 8]));
            }
        }
        for _ in 0..MS / WINDOW {
            rig.tick().map_err(|e| anyhow!(e))?;
            let (begin, commands) = (rig.executed().0, rig.executed().1.to_vec());
            ticks.push(begin);
            carried.extend(rig.released().map(|point| (begin, (point.to.0 / 1000) as i32)));
            for command in commands {
                if let Command::Follow(to, _) = command {
                    carried.push((begin, (to.0 / 1000) as i32));
                }
            }
        }
        while let Some((_, frame)) = rig.take_timed() {
            for (count, id) in sent.iter_mut().zip([0x181, 0x281]) {
                *count += usize::from(frame.id == id);
            }
        }
    }
    ensure!(sent == [POINTS, POINTS], "TPDOs sent: {sent:?} of {POINTS}");
    ensure!(carried.len() == POINTS, "{} of {POINTS} set points carried out", carried.len());
    let mut longest = 0;
    for ((end, wanted), (begin, target)) in synced.iter().zip(&carried) {
        ensure!(target == wanted, "{target} instead of {wanted}");
        let between = ticks.iter().filter(|tick| (*end..*begin).contains(tick)).count();
        ensure!(between == 0, "{between} ticks between a SYNC and the one that takes it");
        longest = longest.max(begin.saturating_sub(*end));
    }
    println!("from SYNC to the tick that takes it: {:.1} us at the most", longest as f64 / US as f64);
    let spread = ticks_begin(rig.machine().spans()).worst;
    println!("ticks begin within {spread:.1} us");
    ensure!(spread <= 5.0, "ticks are moved by {spread:.1} us");
    Ok(())
}

#[test]
fn a_cyclic_master_loses_nothing_on_a_bus_that_others_fill() {
    let mut rig = cyclic().unwrap();
    // Nobody's identifiers: the filters keep them out.
    streams(&mut rig, 0x310).unwrap();
}

#[test]
fn nor_when_every_foreign_frame_passes_the_filters() {
    let mut rig = cyclic().unwrap();
    // The node watches the heartbeats of four others, and the foreign frames have their identifiers.
    for n in 0..4 {
        host::write(&mut rig, 0x1016, 1 + n, (0x20 + u32::from(n)) << 16 | 1000, 4).unwrap();
    }
    rig.pass().unwrap();
    streams(&mut rig, 0x720).unwrap();
}

/// The first frame with this identifier that `wanted` takes, and when it ended; waits for 5 ms.
fn answer(rig: &mut Emulated, id: u32, wanted: impl Fn(&Frame) -> bool) -> Result<u64> {
    for _ in 0..5 * MS / WINDOW {
        rig.tick().map_err(|e| anyhow!(e))?;
        while let Some((end, frame)) = rig.take_timed() {
            if frame.id == id && wanted(&frame) {
                return Ok(end);
            }
        }
    }
    bail!("no {id:x}h within 5 ms")
}

#[test]
fn an_sdo_is_answered_within_a_millisecond_and_a_transition_shows_within_two() {
    let mut rig = started().unwrap();
    let mut longest = [0; 2];
    for n in 0..1000 {
        let asked = rig.send_at(n * 37 * US % MS, Frame::new(0x601, &[0x40, 0x41, 0x60, 0, 0, 0, 0, 0]));
        let answered = answer(&mut rig, 0x581, |_| true).unwrap();
        longest[0] = longest[0].max(answered - asked);
    }
    for n in 0..40 {
        for (word, state) in [(6u16, 0x21), (7, 0x23), (0xF, 0x27), (0, 0x40)] {
            let told = rig.send_at(n * 41 * US % MS, Frame::new(0x201, &word.to_le_bytes()));
            let mask = if state == 0x40 { 0x4F } else { 0x6F };
            let shown = answer(&mut rig, 0x181, |frame| frame.data[0] & mask == state).unwrap();
            longest[1] = longest[1].max(shown - told);
        }
    }
    let [sdo, transition] = longest.map(|cycles| cycles as f64 / US as f64);
    println!("SDO answered within {sdo:.0} us, transition shown within {transition:.0} us, both with their frames");
    assert!(sdo <= 1000.0 && transition <= 2000.0, "{sdo} us, {transition} us");
}

/// The emergencies that come within so many milliseconds: code and error register.
fn emergencies(rig: &mut Emulated, ms: u64) -> Vec<(u16, u8)> {
    let mut codes = Vec::new();
    for _ in 0..ms * MS / WINDOW {
        rig.tick().unwrap();
        while let Some((_, frame)) = rig.take_timed() {
            if frame.id == 0x81 {
                codes.push((u16::from_le_bytes([frame.data[0], frame.data[1]]), frame.data[2]));
            }
        }
    }
    codes
}

#[test]
fn a_bus_that_fails_is_an_emergency_when_it_is_back() {
    let mut rig = started().unwrap();
    assert_eq!(emergencies(&mut rig, 100), []);
    // Nobody acknowledges: error passive at the sixteenth attempt.
    rig.reply(CanReply::NoAcknowledge);
    assert_eq!(emergencies(&mut rig, 100), []);
    rig.reply(CanReply::Acknowledged);
    assert_eq!(emergencies(&mut rig, 100), [(0x8120, 0x11), (0, 0)]);
    // A wire to earth: off the bus, and back every 1.4 ms.
    rig.reply(CanReply::BitError);
    assert_eq!(emergencies(&mut rig, 100), []);
    rig.reply(CanReply::Acknowledged);
    // Each once, however often it went. Error passive ends with an error counter of 127, and each frame that is sent takes one of
    // at most 255 (ISO 11898-1): there have to be frames.
    let mut told = Vec::new();
    for _ in 0..150 {
        rig.send_at(0, Frame::new(0x601, &[0x40, 0x41, 0x60, 0, 0, 0, 0, 0]));
        told.extend(emergencies(&mut rig, 1));
    }
    told.extend(emergencies(&mut rig, 100));
    assert_eq!(told, [(0x8120, 0x11), (0x8140, 0x11), (0, 0x11), (0, 0)]);
    assert_eq!(host::read(&mut rig, 0x1001, 0).unwrap(), 0);
}
