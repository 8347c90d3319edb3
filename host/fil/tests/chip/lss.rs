//! Node-ID and bit rate over the bus (CiA 305), with the release image.

use crate::common;
use anyhow::{Context as _, Result, anyhow, bail};
use edm_fil::commission::commission_as;
use edm_fil::host::{self, Bus as _};
use edm_fil::image::Image;
use edm_fil::rig::{Emulated, Witness};
use edm_servo_head::canopen::BitRate;
use edm_servo_head::settings::Settings;
use edm_sim::process::Plant;
use edm_soc::{Frame, Reset, TICK_HZ};

/// A chip whose flash has settings, but no node-ID.
fn unconfigured() -> Result<Emulated> {
    let image = Image::parse(common::firmware().to_vec())?;
    let settings = Settings { commissioned: true, ..Settings::default() };
    let mut rig =
        Emulated::power_up(&image, Plant::default(), 1, Witness::None, |flash| commission_as(flash, &settings, None))?;
    rig.unwatched();
    rest(&mut rig, 100)?;
    Ok(rig)
}

fn rest(rig: &mut Emulated, ms: u32) -> Result<()> {
    (0..ms).try_for_each(|_| rig.pass())
}

/// Node-ID in the next boot-up. What runs in idle takes its time: the model slows it down.
fn booted(rig: &mut Emulated) -> Result<u32> {
    let boot_up = |frame: &Frame| frame.id & !0x7F == 0x700 && frame.data[0] == 0;
    for _ in 0..1000 {
        rig.pass()?;
        if let Some(frame) = std::iter::from_fn(|| rig.take()).find(boot_up) {
            return Ok(frame.id & 0x7F);
        }
    }
    bail!("no boot-up within a second")
}

fn confirmed(rig: &mut Emulated, request: [u8; 8]) -> Result<()> {
    let answer = host::lss(rig, request)?.context("no answer")?;
    assert_eq!(answer[..3], [request[0], 0, 0]);
    Ok(())
}

/// Bit rate that the controller's registers give, bit/s, and its sample point, thousandths.
fn timing(rig: &mut Emulated) -> (u64, u32) {
    let (bit, sample) = rig.machine_mut().soc().can_timing();
    (TICK_HZ / bit, sample)
}

#[test]
fn a_chip_without_a_node_id_waits_is_named_and_stays_so() -> Result<()> {
    let mut rig = unconfigured()?;
    assert!(std::iter::from_fn(|| rig.take()).next().is_none(), "it says nothing of itself");
    assert_eq!(host::lss(&mut rig, [0x4C, 0, 0, 0, 0, 0, 0, 0])?.context("silent")?[0], 0x50);
    host::lss(&mut rig, [0x04, 1, 0, 0, 0, 0, 0, 0])?;
    confirmed(&mut rig, [0x11, 42, 0, 0, 0, 0, 0, 0])?;
    confirmed(&mut rig, [0x17, 0, 0, 0, 0, 0, 0, 0])?;
    rig.send(Frame::new(0x7E5, &[0x04, 0, 0, 0, 0, 0, 0, 0]));
    assert_eq!(booted(&mut rig)?, 42);
    rig.machine_mut().soc().ask_reset(Reset::Power);
    assert_eq!(booted(&mut rig)?, 42);
    Ok(())
}

#[test]
fn every_bit_rate_is_in_the_registers_once_it_is_activated_and_after_a_power_cycle() -> Result<()> {
    let mut rig = unconfigured()?;
    assert_eq!(timing(&mut rig), (1_000_000, 857));
    assert!(host::name(&mut rig)?);
    assert_eq!(booted(&mut rig)?, 1);
    // The highest last: what the modelled bus carries has no bit rate, only frames of a length in time.
    for rate in [BitRate::Kbit500, BitRate::Kbit250, BitRate::Kbit125, BitRate::Kbit1000] {
        let before = timing(&mut rig).0;
        host::lss(&mut rig, [0x04, 1, 0, 0, 0, 0, 0, 0])?;
        confirmed(&mut rig, [0x13, 0, rate as u8, 0, 0, 0, 0, 0])?;
        confirmed(&mut rig, [0x17, 0, 0, 0, 0, 0, 0, 0])?;
        rig.send(Frame::new(0x7E5, &[0x15, 10, 0, 0, 0, 0, 0, 0]));
        rest(&mut rig, 9)?;
        assert_eq!(timing(&mut rig).0, before, "until the delay is over");
        rest(&mut rig, 4)?;
        assert_eq!(timing(&mut rig).0, u64::from(rate.hz()));
        assert!((850..=900).contains(&timing(&mut rig).1));
        while rig.take().is_some() {}
        assert_eq!(booted(&mut rig)?, 1);
        rig.machine_mut().soc().ask_reset(Reset::Power);
        assert_eq!((booted(&mut rig)?, timing(&mut rig).0), (1, u64::from(rate.hz())));
        host::read(&mut rig, 0x1000, 0).map_err(|e| anyhow!("at {rate:?}: {e}"))?;
    }
    Ok(())
}
