//! The firmware on the rig, brought to the state in which it is measured.

use crate::commission::commission;
use crate::host::{self, Bus};
use crate::image::Image;
use crate::machine::{Alter, Machine};
use crate::rtt::Rtt;
use crate::synthetic::{Behaviour, Rig};
use crate::wires::CRYSTAL_HZ;
use anyhow::{Context, Result, bail, ensure};
use edm_servo_head::head::{Command, Fault, State};
use edm_servo_head::settings::Settings;
use edm_servo_head::units::Nanometres;
use edm_soc::{Change, Frame, Soc, TICK_HZ};

/// Ticks of the chip in a millisecond.
pub const MS: u64 = TICK_HZ / 1000;

/// A run.
pub struct Session {
    /// Chip and rig.
    pub machine: Machine<Rig>,
    rtt: Rtt,
    now: u64,
    /// Frames of the head taken so far.
    taken: usize,
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
        let mut session = Self::booted(image, Rig::new(behaviour), alter)?;
        if let Err(error) = host::begin(&mut session) {
            bail!("{error:#}; log: {:?}", session.log);
        }
        session.command(Command::SetHome(Nanometres(0)))?;
        session.enable()?;
        Ok(session)
    }

    /// Boots the firmware in the midst of `rig`, and leaves the head disabled.
    ///
    /// # Errors
    /// What the machine refuses.
    pub fn booted(image: &Image, rig: Rig, alter: Option<Alter>) -> Result<Self> {
        Self::prepared(image, rig, alter, |_| ())
    }

    /// The same on a chip that `prepare` has changed.
    ///
    /// # Errors
    /// What the machine refuses.
    pub fn prepared(
        image: &Image,
        rig: Rig,
        alter: Option<Alter>,
        prepare: impl FnOnce(&mut Soc<Rig>),
    ) -> Result<Self> {
        let mut machine = Machine::new(image, rig, CRYSTAL_HZ)?;
        if let Some(alter) = alter {
            machine.alter_writes(alter);
        }
        // Commissioning takes minutes of simulation; it is not what is measured here.
        // An axis that moves as a script has it, whatever the motor does, is not to be taken for one without an encoder.
        let settings = Settings {
            commissioned: true,
            axis_breakaway: 20.0,
            servo_friction: 0.0,
            emf_velocity: 5000.0,
            ..Settings::default()
        };
        commission(&machine.soc().memory.flash, &settings)?;
        prepare(machine.soc());
        let mut session = Self { machine, rtt: Rtt::new(image)?, now: 0, taken: 0, log: Vec::new() };
        session.run(50 * MS)?;
        Ok(session)
    }

    /// Closes the loop: state Ready.
    ///
    /// # Errors
    /// When the firmware does not get there.
    pub fn enable(&mut self) -> Result<()> {
        self.command(Command::Enable)?;
        let state = self.state()?;
        ensure!(state == State::Ready as u32, "the head is in state {state} instead of ready: {:?}", self.log);
        Ok(())
    }

    /// Runs until the head erodes.
    ///
    /// # Errors
    /// When it does not.
    pub fn erode(&mut self) -> Result<()> {
        self.command(Command::MoveBy(Nanometres(1_000_000)))?;
        self.command(Command::Start)?;
        for _ in 0..40 {
            self.idle(10 * MS)?;
            if self.state()? == State::Eroding as u32 {
                return Ok(());
            }
        }
        bail!("the head does not erode: state {}, {:?}", self.state()?, self.log)
    }

    /// State of the head, 2000h:1.
    ///
    /// # Errors
    /// When the head does not answer.
    pub fn state(&mut self) -> Result<u32> {
        host::read(self, 0x2000, 1)
    }

    /// The fault of the head, 2000h:2, by its name.
    ///
    /// # Errors
    /// When the head does not answer.
    pub fn fault(&mut self) -> Result<Option<Fault>> {
        let number = host::read(self, 0x2000, 2)?;
        Ok(Fault::ALL.iter().copied().find(|fault| *fault as u32 + 1 == number))
    }

    /// A command of the host.
    ///
    /// # Errors
    /// When the head does not take it.
    pub fn command(&mut self, command: Command) -> Result<()> {
        host::command(self, command).with_context(|| format!("log: {:?}", self.log))
    }

    /// Lets `time` pass, with the host's sign of life.
    ///
    /// # Errors
    /// What the machine refuses.
    pub fn idle(&mut self, time: u64) -> Result<()> {
        let end = self.now + time;
        while self.now < end {
            let at = self.now + 5 * MS / 2;
            self.machine.soc().world.change(at, Change::Can(host::heartbeat()));
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

    /// The machine was put back to this time.
    pub fn go_back(&mut self, now: u64) {
        (self.now, self.taken) = (now, self.machine.soc().world.frames.len());
        self.log.clear();
        self.rtt.forget();
    }

    /// Present time, ticks of the chip.
    pub fn now(&self) -> u64 {
        self.now
    }
}

impl Bus for Session {
    fn send(&mut self, frame: Frame) {
        let at = self.now + 10;
        self.machine.soc().world.change(at, Change::Can(frame));
    }

    fn pass(&mut self) -> Result<()> {
        self.run(MS)
    }

    fn take(&mut self) -> Option<Frame> {
        let frames = &self.machine.soc().world.frames;
        let frame = frames.get(self.taken).map(|(_, frame)| *frame);
        self.taken += usize::from(frame.is_some());
        frame
    }
}
