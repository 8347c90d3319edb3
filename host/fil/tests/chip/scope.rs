//! The scope of the servo tick on the release image: what it records is what the ticks did, 16 KiB of it leave within a second at
//! 1 Mbit/s, and it outlives a reset.

use crate::common;
use anyhow::{Result, anyhow, ensure};
use edm_fil::host::{self, Bus as _};
use edm_fil::image::Image;
use edm_fil::rig::{Emulated, Witness};
use edm_servo_head::head::{Command, State};
use edm_servo_head::scope::{Phase, STREAM_HEADER, Signal};
use edm_servo_head::settings::Settings;
use edm_servo_head::units::Nanometres;
use edm_sim::machine::Rig as _;
use edm_sim::process::Plant;
use edm_soc::{Reset, TICK_HZ};

const SIGNALS: [Signal; 8] = [
    Signal::Position,
    Signal::Velocity,
    Signal::Following,
    Signal::Duty,
    Signal::State,
    Signal::Flags,
    Signal::ShortTime,
    Signal::GapBlock,
];

fn state(rig: &mut Emulated) -> Result<u32> {
    host::read(rig, 0x2019, 15)
}

/// An eroding head whose scope waits for a short.
fn armed() -> Result<Emulated> {
    let image = Image::parse(common::firmware().to_vec())?;
    let settings = Settings { commissioned: true, ..Settings::default() };
    // Work close to the stop: the seek is short.
    let plant = Plant::with(&[("workpiece.surface_mm", 0.3)]).unwrap();
    let mut rig = Emulated::start(&image, plant, &settings, 1, Witness::None)?;
    host::begin(&mut rig)?;
    assert_eq!(state(&mut rig)?, Phase::Idle as u32, "what the memory holds at power-up is no record");
    for command in
        [Command::SetHome(Nanometres(0)), Command::Enable, Command::MoveTo(Nanometres(2_000_000)), Command::Start]
    {
        host::command(&mut rig, command)?;
    }
    let erodes = (0..40_000).any(|_| rig.tick().is_err() || rig.status().state == State::Eroding);
    ensure!(erodes && rig.status().state == State::Eroding, "{:?}", rig.status().state);
    for (signal, sub) in SIGNALS.into_iter().zip(1..) {
        host::write(&mut rig, 0x2019, sub, signal as u32, 1)?;
    }
    host::write(&mut rig, 0x2019, 10, 5, 1)?;
    host::write(&mut rig, 0x2019, 14, 1, 1)?;
    // Longer than the half of the record that is from before.
    (0..16).try_for_each(|_| rig.pass())?;
    assert_eq!(state(&mut rig)?, Phase::Waits as u32);
    Ok(rig)
}

fn words(bytes: &[u8]) -> Vec<i32> {
    bytes.chunks(4).map(|word| i32::from_le_bytes(word.try_into().unwrap())).collect()
}

#[test]
fn a_record_around_a_retreat_of_the_reflex_is_what_the_ticks_did_and_outlives_a_reset_but_not_the_power() -> Result<()>
{
    let mut rig = armed()?;
    let mut ticks = Vec::new();
    for tick in 0..700 {
        rig.process_mut().fault_inputs.short = tick >= 300;
        rig.tick().map_err(|e| anyhow!(e))?;
        let status = *rig.status();
        ticks.push((status, rig.true_count()));
    }
    rig.process_mut().fault_inputs.short = false;
    assert_eq!(state(&mut rig)?, Phase::Complete as u32);

    let began = rig.machine_mut().soc().now();
    let bytes = host::block_upload(&mut rig, 0x2019, 16)?;
    let seconds = (rig.machine_mut().soc().now() - began) as f64 / TICK_HZ as f64;
    println!("{} bytes by block upload in {seconds:.3} s at 1 Mbit/s", bytes.len());
    assert_eq!(bytes.len(), 16 * 1024 + 4 * STREAM_HEADER);
    assert!(seconds < 1.0, "{seconds} s");

    let (header, data) = bytes.split_at(4 * STREAM_HEADER);
    let header = words(header);
    assert_eq!(header[1], 8 | 6 << 8, "eight signals, begun by a short");
    assert_eq!(header[2..4], words(&SIGNALS.map(|signal| signal as u8))[..]);
    let (samples, trigger, tick) = (header[5] as usize, header[6] as usize, header[7] as u32);
    assert_eq!((header[4], samples, trigger), (1, 512, 256));
    let samples: Vec<Vec<i32>> = words(data).chunks(8).map(<[i32]>::to_vec).collect();
    let mut compared = 0;
    for (at, sample) in samples.iter().enumerate() {
        let number = tick.wrapping_add(at as u32).wrapping_sub(trigger as u32);
        let Some((status, count)) = ticks.iter().find(|(status, _)| status.tick == number) else { continue };
        compared += 1;
        let [position, velocity, following, duty, ..] = sample[..] else { unreachable!() };
        assert_eq!(i64::from(position), status.position, "tick {number}");
        // Home was made where the head was enabled: the axis of the model tells the same as the encoder, to an edge.
        assert!((status.position - count).abs() <= 2, "tick {number}: {} and {count}", status.position);
        assert_eq!(velocity, status.velocity.0 as i32, "tick {number}");
        assert_eq!(following, (status.following * 256.0) as i32, "tick {number}");
        assert_eq!(duty, (status.duty * 10_000.0) as i32, "tick {number}");
    }
    assert!(compared >= 500, "{compared} of 512 samples compared");
    let flags = |at: usize| samples[at][5];
    assert_eq!(flags(trigger) & 2, 2, "the reflex has begun its retreat in this tick");
    assert!((0..trigger).all(|at| flags(at) & 2 == 0), "and in none before");
    assert_eq!((samples[0][4], samples[511][4]), (State::Eroding as i32, State::Retreating as i32));
    assert!(samples[511][1] < 0, "it retreats");
    let volts = |range: std::ops::Range<usize>| range.map(|at| samples[at][7]).max().unwrap_or_default();
    assert!(volts(0..200) > 3000, "{} V/100", volts(0..200));
    assert!(volts(trigger + 20..512) < 1000, "{} V/100 across a short", volts(trigger + 20..512));

    rig.unwatched();
    rig.machine_mut().soc().ask_reset(Reset::Watchdog);
    host::await_boot_up(&mut rig)?;
    assert_eq!(state(&mut rig)?, Phase::Complete as u32);
    assert_eq!(host::block_upload(&mut rig, 0x2019, 16)?, bytes);
    rig.machine_mut().soc().ask_reset(Reset::Power);
    host::await_boot_up(&mut rig)?;
    assert_eq!(state(&mut rig)?, Phase::Idle as u32);
    Ok(())
}

#[test]
fn a_fault_leaves_a_snapshot_that_a_host_reads_after_a_reset() -> Result<()> {
    let image = Image::parse(common::firmware().to_vec())?;
    let settings = Settings { commissioned: true, ..Settings::default() };
    let mut rig = Emulated::start(&image, Plant::default(), &settings, 1, Witness::None)?;
    host::begin(&mut rig)?;
    host::command(&mut rig, Command::SetHome(Nanometres(0)))?;
    host::command(&mut rig, Command::Enable)?;
    (0..100).try_for_each(|_| rig.pass())?;
    assert_eq!(host::read(&mut rig, 0x2019, 17)?, 0);
    rig.process_mut().fault_inputs.safety.emergency_stop = true;
    (0..80).try_for_each(|_| rig.pass())?;
    assert_eq!(host::read(&mut rig, 0x2019, 17)?, 1);
    let fault = host::read(&mut rig, 0x2000, 2)?;
    let bytes = host::block_upload(&mut rig, 0x2019, 18)?;
    let header = words(&bytes[..4 * STREAM_HEADER]);
    assert_eq!((header[1] as u32, header[4]), (8 | 5 << 8 | fault << 16, 40), "of this fault, every 2 ms");
    let (samples, trigger) = (header[5], header[6]);
    assert!(samples - trigger == 32 && trigger > 50, "{trigger} of {samples}");
    let states: Vec<i32> = words(&bytes[4 * STREAM_HEADER..]).chunks(8).map(|sample| sample[7]).collect();
    let (before, after) = states.split_at(trigger as usize);
    assert!(before.iter().rev().take(40).all(|state| *state != State::Fault as i32), "{before:?}");
    assert!(after.contains(&(State::Fault as i32)), "{after:?}");

    rig.unwatched();
    rig.machine_mut().soc().ask_reset(Reset::Software);
    host::await_boot_up(&mut rig)?;
    assert_eq!(host::read(&mut rig, 0x2019, 17)?, 1);
    assert_eq!(host::block_upload(&mut rig, 0x2019, 18)?, bytes);
    Ok(())
}
