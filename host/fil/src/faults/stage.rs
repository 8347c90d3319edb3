//! A head at the moments at which faults are injected, and its observed behaviour: pins and process from outside, and its
//! frames on the bus. Nothing is read from the chip's memory but its log, as a probe does.

use crate::commission::{BASE, LENGTH};
use crate::host::{self, Bus};
use crate::image::Image;
use crate::rig::{Emulated, Snapshot, Witness};
use crate::wires::CRYSTAL_HZ;
use anyhow::{Context, Error, Result, anyhow, bail, ensure};
use edm_hal_shim::double::live::Broken;
use edm_servo_head::canopen::drive::error_code;
use edm_servo_head::head::{Command, Fault, State};
use edm_servo_head::settings::Settings;
use edm_servo_head::units::Nanometres;
use edm_sim::machine::Rig as _;
use edm_sim::process::{FaultInputs, Truth};
use edm_sim::run::Setup;
use edm_soc::{CanReply, Frame, Reset, TICK_HZ};

/// Ticks of the chip in a microsecond and in a millisecond.
pub const US: u64 = TICK_HZ / 1_000_000;
pub const MS: u64 = 1000 * US;
/// Process of the campaign.
const SEED: u64 = 1;
/// Work below the upper stop, mm: room for every retreat, and little to seek.
const SURFACE_MM: f32 = 1.0;
/// A path that does not end.
pub const PATH: Nanometres = Nanometres(2_000_000);
/// While it positions, the work is so much lower; target and speed, counts of 1 um.
const LOWERED_MM: f64 = 3.2;
pub const TARGET: u32 = 4000;
const SPEED: u32 = 5000;
/// Motor current per code about mid-scale, A: docs/wiring.md.
const AMPS_PER_CODE: f64 = 0.00269;
/// Supply of the chip, mV.
const SUPPLY_MV: u32 = 3300;

/// Where the head is when something breaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scene {
    /// In the work, pulses on.
    Eroding,
    /// On its way to the work at 5 mm/s, pulses off.
    Positioning,
    /// Disabled, and homed.
    Disabled,
}

impl Scene {
    /// What is added to the name of a row.
    pub fn suffix(self) -> &'static str {
        match self {
            Scene::Eroding => "",
            Scene::Positioning => ", positioning",
            Scene::Disabled => ", disabled",
        }
    }
}

/// What was seen since the fault.
#[derive(Clone, Debug, Default)]
pub struct Observed {
    /// Greatest force between electrode and work, N.
    pub contact_n: f64,
    /// Greatest motor current from a second after the fault on, A.
    pub current_a: f64,
    /// Smallest and largest gap, um.
    pub gap_um: (f64, f64),
    /// Resets of the chip.
    pub resets: u64,
}

/// Places in the program.
#[derive(Clone, Copy, Debug)]
pub struct Program {
    /// Where a panic begins: message, its length, where it was.
    pub panic: u32,
    /// End of the variables: above are the stack and unused RAM.
    pub free: u32,
}

impl Program {
    fn find(image: &Image) -> Result<Self> {
        Ok(Self {
            panic: image.find("panicking", "panic").context("the program has no panic")? & !1,
            free: image.symbol("__euninit").context("the program has no end of its stack")?,
        })
    }
}

/// The head, and who listens to it.
pub struct Stage {
    /// The program.
    pub program: Program,
    /// What is stored in flash.
    stored: Vec<u8>,
    /// Byte of the flash that was spoilt, and what it was.
    spoilt: Option<(u32, u32)>,
    /// Chip, bench and bus.
    pub rig: Emulated,
    scenes: Vec<(Scene, Snapshot)>,
    scene: Scene,
    /// When the fault came, ticks of the chip.
    at: u64,
    /// Names in the order in which the head said them.
    said: Vec<String>,
    seen: Observed,
    resets: u64,
    /// Whether to print the firmware's log.
    pub log: bool,
    /// Boot-ups heard since then.
    pub boots: u32,
}

impl Stage {
    /// Powers a head up, homes it and brings it to where faults are injected.
    ///
    /// # Errors
    /// When it does not get there.
    pub fn new(image: &Image) -> Result<Self> {
        let mut setup = Setup::load("default").map_err(Error::msg)?;
        setup.process.installation.surface = SURFACE_MM;
        setup.process.installation.couple();
        let settings = Settings { commissioned: true, ..setup.head };
        let mut rig = Emulated::start(image, setup.process, &settings, SEED, Witness::None)?;
        rig.unwatched();
        let scenes = Vec::new();
        let (said, seen) = (Vec::new(), Observed::default());
        let program = Program::find(image)?;
        let mut stage = Self {
            program,
            stored: Vec::new(),
            spoilt: None,
            rig,
            scenes,
            scene: Scene::Disabled,
            at: 0,
            said,
            seen,
            resets: 0,
            log: false,
            boots: 0,
        };
        stage.stored = stage.flash();
        host::begin(&mut stage)?;
        stage.command(Command::SetHome(Nanometres(0)))?;
        stage.rest(20)?;
        stage.keep(Scene::Disabled)?;
        stage.erode()?;
        stage.keep(Scene::Eroding)?;
        stage.go(Scene::Disabled)?;
        stage.position()?;
        stage.keep(Scene::Positioning)?;
        Ok(stage)
    }

    /// From disabled into the work.
    ///
    /// # Errors
    /// When the head does not go there.
    pub fn erode(&mut self) -> Result<()> {
        self.command(Command::Enable)?;
        self.command(Command::MoveTo(PATH))?;
        self.command(Command::Start)?;
        self.reach(State::Eroding, 4000)?;
        self.rest(300)?;
        ensure!(self.state()? == State::Eroding, "the head does not erode");
        Ok(())
    }

    /// From disabled, on the way to the work with pulses off.
    ///
    /// # Errors
    /// When the head does not go there.
    pub fn position(&mut self) -> Result<()> {
        self.wires().raised_mm = -LOWERED_MM;
        self.command(Command::Enable)?;
        for (index, value, size) in [(0x6060, 1, 1), (0x6081, SPEED, 4), (0x607A, TARGET, 4)] {
            host::write(self, index, 0, value, size)?;
        }
        host::write(self, 0x6040, 0, 0x1F, 2)?;
        self.rest(200)?;
        let state = self.state()?;
        ensure!(state == State::Positioning, "the head is {} instead of positioning", state.name());
        Ok(())
    }

    fn keep(&mut self, scene: Scene) -> Result<()> {
        self.scenes.push((scene, self.rig.snapshot()?));
        Ok(())
    }

    /// Goes to where faults are injected, with nothing broken.
    ///
    /// # Errors
    /// When the engine refuses.
    pub fn go(&mut self, scene: Scene) -> Result<()> {
        let kept = self.scenes.iter().find(|kept| kept.0 == scene).context("no such scene")?;
        self.rig.restore(&kept.1)?;
        self.scene = scene;
        self.mark();
        Ok(())
    }

    /// The fault comes now.
    pub fn mark(&mut self) {
        self.at = self.now();
        self.said.clear();
        self.boots = 0;
        self.resets = self.rig.machine().stats().resets;
        let gap = self.truth().gap_um;
        self.seen = Observed { gap_um: (gap, gap), ..Observed::default() };
    }

    /// Pulses that something has switched off since `begun`, on its way to the fault, were off at once.
    pub fn count_from(&mut self, begun: u64) {
        if let Some(off) = self.rig.machine().world().off {
            self.at = if (begun..self.at).contains(&off) { off } else { self.at };
        }
    }

    /// Present time, ticks of the chip.
    pub fn now(&mut self) -> u64 {
        self.rig.machine_mut().soc().now()
    }

    /// Time since the fault, ms.
    pub fn since_ms(&mut self) -> u64 {
        (self.now() - self.at) / MS
    }

    /// What really is.
    pub fn truth(&self) -> Truth {
        self.rig.process().truth()
    }

    /// Another burning voltage of sparks, V.
    pub fn set_burn(&mut self, volts: f64) {
        self.rig.process_mut().set_burn(volts);
    }

    /// Wires of the machine.
    pub fn wires(&mut self) -> &mut FaultInputs {
        &mut self.rig.process_mut().fault_inputs
    }

    /// What is in the flash of the settings.
    pub fn flash(&mut self) -> Vec<u8> {
        let flash = self.rig.flash();
        (BASE..).map_while(|at| flash.load(at, 1)).take(LENGTH).map(|byte| byte as u8).collect()
    }

    /// Flips a bit of a byte in flash.
    ///
    /// # Errors
    /// When there is no flash.
    pub fn spoil(&mut self, at: u32) -> Result<()> {
        let flash = &self.rig.machine_mut().soc().memory.flash;
        let byte = flash.load(at, 1).context("no flash")?;
        flash.store(at, 1, byte ^ 1).context("no flash")?;
        self.spoilt = Some((at, byte));
        Ok(())
    }

    /// Writes words into RAM that the stack does not reach; where they are.
    ///
    /// # Errors
    /// When there is no memory.
    pub fn place(&mut self, words: &[u32]) -> Result<u32> {
        let place = self.program.free + 0x1000;
        let sram = &self.rig.machine_mut().soc().memory.sram;
        for (at, word) in (place..).step_by(4).zip(words) {
            sram.store(at, 4, *word).context("no memory")?;
        }
        Ok(place)
    }

    /// Lets the processor go on in a panic: with a message without text, at line 1.
    ///
    /// # Errors
    /// What the engine refuses.
    pub fn panic(&mut self) -> Result<()> {
        let panic = self.program.panic;
        let place = self.place(&[panic, 0, 1, 1])?;
        self.rig.machine_mut().call(panic, &[panic, 0, place])
    }

    /// Lets the processor go on with an instruction that is not in the program.
    ///
    /// # Errors
    /// What the engine refuses.
    pub fn instruction(&mut self, code: u16) -> Result<()> {
        let place = self.place(&[code.into()])?;
        self.rig.machine_mut().call(place, &[])
    }

    /// A window of 50 us, and what is to be seen in it.
    fn window(&mut self) -> Result<()> {
        self.rig.tick().map_err(|e| anyhow!(e))?;
        let truth = self.truth();
        let seen = &mut self.seen;
        seen.contact_n = seen.contact_n.max(truth.contact_n);
        seen.gap_um = (seen.gap_um.0.min(truth.gap_um), seen.gap_um.1.max(truth.gap_um));
        seen.resets = self.rig.machine().stats().resets - self.resets;
        if self.rig.machine().world().window() >= self.at + TICK_HZ {
            let code = f64::from(self.rig.process().sensors().drive.motor_current);
            seen.current_a = seen.current_a.max((code - 2048.5).abs() * AMPS_PER_CODE);
        }
        Ok(())
    }

    /// Lets milliseconds pass and listens.
    ///
    /// # Errors
    /// What the machine refuses.
    pub fn rest(&mut self, ms: u32) -> Result<()> {
        for _ in 0..ms {
            self.pass()?;
            while self.take().is_some() {}
        }
        Ok(())
    }

    /// What was seen since the fault.
    pub fn seen(&self) -> &Observed {
        &self.seen
    }

    /// From the fault until the pulses were off for good, us; `None` when they were off before, or are on.
    pub fn off_us(&self) -> Option<f64> {
        let off = self.rig.machine().world().off?;
        (off >= self.at).then(|| (off - self.at) as f64 / US as f64)
    }

    /// What the head has said since the fault, each once.
    pub fn said(&self) -> &[String] {
        &self.said
    }

    /// Forgets what was said after the first `count` names.
    pub fn said_until(&mut self, count: usize) {
        self.said.truncate(count);
    }

    /// Notes what something says.
    pub fn say(&mut self, name: &str) {
        if !self.said.iter().any(|said| said == name) {
            self.said.push(name.to_owned());
        }
    }

    /// A command of the host.
    ///
    /// # Errors
    /// When the head does not take it.
    pub fn command(&mut self, command: Command) -> Result<()> {
        host::command(self, command)
    }

    /// State of the head, 2000h:1.
    ///
    /// # Errors
    /// When it does not answer.
    pub fn state(&mut self) -> Result<State> {
        let number = host::read(self, 0x2000, 1)?;
        State::ALL.iter().copied().find(|state| *state as u32 == number).with_context(|| format!("state {number}"))
    }

    /// Waits for a state.
    ///
    /// # Errors
    /// When it does not come.
    pub fn reach(&mut self, state: State, ms: u32) -> Result<()> {
        for _ in 0..ms / 10 {
            if self.state()? == state {
                return Ok(());
            }
            self.rest(8)?;
        }
        bail!("{} instead of {} after {ms} ms", self.state()?.name(), state.name())
    }

    /// Repairs what was broken outside the chip.
    pub fn repair(&mut self) {
        // Where the work was put for the row it stays, or the head might be in its way.
        let raised_mm = if self.scene == Scene::Positioning { -LOWERED_MM } else { self.wires().raised_mm };
        self.rig.process_mut().fault_inputs = FaultInputs { raised_mm, ..FaultInputs::default() };
        self.rig.host_alive = true;
        if let Some((at, byte)) = self.spoilt.take() {
            // The image is flashed anew.
            let _ = self.rig.flash().store(at, 1, byte);
        }
        if self.flash() != self.stored {
            // Both are as long as the sectors.
            let _ = self.rig.flash().fill(BASE, &self.stored);
        }
        let soc = self.rig.machine_mut().soc();
        soc.set_supply(SUPPLY_MV);
        soc.set_crystal(CRYSTAL_HZ);
        soc.world.repair_lines();
        soc.world.reply = CanReply::Acknowledged;
        soc.world.latch.circuit.broken = Broken::default();
        soc.world_changed();
    }

    /// A power cycle.
    pub fn power(&mut self) {
        self.rig.machine_mut().soc().ask_reset(Reset::Power);
    }

    /// Whether the head works again: after a restart it is put into operation; its fault is reset, and it is enabled. An
    /// encoder in doubt may need two attempts: at its upper stop it cannot prove itself by a move up.
    ///
    /// # Errors
    /// What the machine refuses.
    pub fn recovers(&mut self, restarted: bool) -> Result<bool> {
        if restarted && host::write(self, 0x1016, 1, u32::from(host::HOST) << 16 | 400, 4).is_err() {
            return Ok(false);
        }
        self.send(Frame::new(0, &[1, host::NODE as u8]));
        self.rest(5)?;
        for _ in 0..3 {
            for word in [0, 0x80, 6, 7, 0xF] {
                if host::write(self, 0x6040, 0, word, 2).is_err() {
                    return Ok(false);
                }
                self.rest(4)?;
            }
            for _ in 0..60 {
                match self.state() {
                    Ok(State::Ready) => return Ok(true),
                    Ok(State::Fault) => break,
                    Ok(_) => self.rest(8)?,
                    Err(_) => return Ok(false),
                }
            }
            self.rest(400)?;
        }
        Ok(false)
    }

    /// What an emergency says, and a boot-up.
    fn listen(&mut self, frame: &Frame) {
        if frame.id == 0x700 + u32::from(host::NODE) && frame.data[0] == 0 {
            self.boots += 1;
        }
        if frame.id != 0x80 + u32::from(host::NODE) {
            return;
        }
        let code = u16::from_le_bytes([frame.data[0], frame.data[1]]);
        let fault = Fault::ALL.iter().find(|fault| **fault as u8 + 1 == frame.data[3]);
        let name = match (code, fault) {
            (0, _) => return,
            (_, Some(fault)) if error_code(*fault).0 == code => fault.name().to_owned(),
            (0x6100, _) => "events lost".into(),
            (0x6310, _) => "stored settings lost".into(),
            (0x6320, _) => "stored values defaulted".into(),
            (0x8100, _) => "SYNC missing".into(),
            (0x8110, _) => "frames lost".into(),
            (0x8120, _) => "bus: error passive".into(),
            (0x8130, _) => "heartbeat of the host lost".into(),
            (0x8140, _) => "bus-off".into(),
            (0x8210, _) => "PDO too short".into(),
            (0x8220, _) => "PDO too long".into(),
            (0x8240, _) => "SYNC of a wrong length".into(),
            (0x8250, _) => "RPDO missing".into(),
            _ => format!("emergency {code:04X}h"),
        };
        self.say(&name);
    }
}

impl Bus for Stage {
    fn send(&mut self, frame: Frame) {
        self.rig.send(frame);
    }

    fn pass(&mut self) -> Result<()> {
        (0..20).try_for_each(|_| self.window())
    }

    fn take(&mut self) -> Option<Frame> {
        let frame = self.rig.take()?;
        self.listen(&frame);
        Some(frame)
    }
}
