//! The real firmware on the rig, led to where it is to be measured.

use crate::commission::commission;
use crate::image::Image;
use crate::machine::{Alter, Machine};
use crate::rtt::Rtt;
use crate::synthetic::{Behaviour, Rig};
use anyhow::{Context, Result, bail};
use edm_hal_shim::board::F405;
use edm_servo_head::settings::Settings;
use edm_soc::{Change, Frame, TICK_HZ};

/// Ticks of the chip in a millisecond.
pub const MS: u64 = TICK_HZ / 1000;

/// States in the order of the firmware's report.
const READY: u8 = 2;
const ERODING: u8 = 4;

/// A run.
pub struct Session {
    /// Chip and rig.
    pub machine: Machine<Rig>,
    rtt: Rtt,
    now: u64,
    /// What the firmware has logged.
    pub log: Vec<String>,
}

impl Session {
    /// Boots the firmware and closes the loop: state Ready.
    ///
    /// # Errors
    /// When the firmware does not get there.
    pub fn ready(image: &Image, behaviour: Behaviour) -> Result<Self> {
        Self::altered(image, behaviour, None)
    }

    /// As [`Session::ready`], with a fault put into the firmware.
    ///
    /// # Errors
    /// When the firmware does not get there.
    pub fn altered(image: &Image, behaviour: Behaviour, alter: Option<Alter>) -> Result<Self> {
        let mut machine = Machine::new(image, Rig::new(behaviour), F405::TABLE.crystal_hz.into())?;
        if let Some(alter) = alter {
            machine.alter_writes(alter);
        }
        // The guided check takes minutes of simulation; it is not what is measured here.
        let settings = Settings { commissioned: true, ..Settings::default() };
        commission(&machine.soc().memory.flash, &settings)?;
        let mut session = Self { machine, rtt: Rtt::new(image)?, now: 0, log: Vec::new() };
        session.run(30 * MS)?;
        session.command(&[1])?;
        session.expect(READY)?;
        Ok(session)
    }

    /// Goes on until the head erodes.
    ///
    /// # Errors
    /// When it does not.
    pub fn erode(&mut self) -> Result<()> {
        // By 1 mm, then start.
        self.command(&[5, 0, 0, 0, 0x40, 0x42, 0x0f, 0])?;
        self.command(&[6])?;
        for _ in 0..40 {
            self.idle(10 * MS)?;
            if self.state() == Some(ERODING) {
                return Ok(());
            }
        }
        let reports: Vec<_> =
            self.machine.soc().world.frames.iter().rev().filter(|f| f.1.id == 0x181).take(3).collect();
        bail!("the head does not erode: {:?}, newest reports {reports:?}", self.log)
    }

    fn expect(&mut self, state: u8) -> Result<()> {
        if self.state() != Some(state) {
            bail!("the head is in state {:?} instead of {state}: {:?}", self.state(), self.log);
        }
        Ok(())
    }

    /// State in the newest report.
    pub fn state(&mut self) -> Option<u8> {
        let frames = &self.machine.soc().world.frames;
        frames.iter().rev().find(|f| f.1.id == 0x181).map(|f| f.1.data[0])
    }

    fn command(&mut self, data: &[u8]) -> Result<()> {
        let at = self.now + 10;
        let frame = Frame::new(0x201, data);
        self.machine.soc().world.change(at, Change::Can(frame));
        self.idle(25 * MS)
    }

    /// Lets `time` pass, with the host's sign of life.
    ///
    /// # Errors
    /// What the machine refuses.
    pub fn idle(&mut self, time: u64) -> Result<()> {
        let end = self.now + time;
        while self.now < end {
            let frame = Frame::new(0x201, &[0]);
            let at = self.now + 5 * MS / 2;
            self.machine.soc().world.change(at, Change::Can(frame));
            self.run((end - self.now).min(50 * MS))?;
        }
        Ok(())
    }

    fn run(&mut self, time: u64) -> Result<()> {
        self.now += time;
        self.machine.run_until(self.now).with_context(|| format!("log: {:?}", self.log))?;
        self.log.extend(self.rtt.poll(&self.machine.soc().memory));
        Ok(())
    }

    /// Present time, ticks of the chip.
    pub fn now(&self) -> u64 {
        self.now
    }
}
