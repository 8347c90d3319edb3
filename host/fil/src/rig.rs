//! The emulated head as a rig to bore with: the firmware on the model of the chip, the model of the chip on the bench, the
//! host on the bus.

use crate::bench::{Bench, WINDOW};
use crate::commission::commission;
use crate::image::Image;
use crate::layout::Layout;
use crate::machine::Machine;
use crate::rtt::Rtt;
use anyhow::{Context, Result, anyhow, bail};
use edm_servo_head::gap::{GapReading, Quality};
use edm_servo_head::head::{Change, Command, Fault, Reason, State, Status};
use edm_servo_head::remote;
use edm_servo_head::settings::Settings;
use edm_servo_head::units::{Amps, CountsPerSecond, Fixed, Volts};
use edm_sim::machine::Rig;
use edm_sim::process::{Parameters, Process};
use edm_sim::run::{Job, Observer, Outcome, Progress};
use edm_soc::{Frame, Region, TICK_HZ};
use std::collections::VecDeque;
use std::mem::{offset_of, size_of};

/// Crystal of the board, Hz.
const CRYSTAL_HZ: u64 = 8_000_000;
/// The firmware's number on the bus.
const NODE: u16 = 1;
/// Longest start of the firmware, ticks: the first period of the PWM comes within.
const START: u64 = TICK_HZ / 10;
/// Windows that an answer may take: 50 ms.
const PATIENCE: u32 = 1000;
/// Windows between two life signs of the host, and their frame (SYNC of CiA 301).
const LIFE: u64 = 100;
const SYNC: u16 = 0x080;
/// Factor on the time of thread mode: a round of the idle loop costs host time and finds nothing.
const STRETCH: u64 = 100;
/// Counter of TIM1.
const TIM1_CNT: u32 = 0x4001_0024;

const STATES: [State; 9] = [
    State::Disabled,
    State::Commissioning,
    State::Ready,
    State::Seeking,
    State::Eroding,
    State::Retreating,
    State::Done,
    State::HoldingPosition,
    State::Fault,
];
const QUALITIES: [Quality; 5] =
    [Quality::Missing, Quality::Valid, Quality::NoGate, Quality::Saturated, Quality::Reversed];

/// The firmware on the chip on the bench.
pub struct Emulated {
    machine: Machine<Bench>,
    rtt: Rtt,
    /// Whether to print the firmware's log.
    pub log: bool,
    head: u32,
    status: Status,
    /// True count at the beginning of the window, where the servo task reads the encoder.
    count: i64,
    changes: VecDeque<Change>,
    answers: VecDeque<[u8; 2]>,
    windows: u64,
}

impl Emulated {
    /// Powers up a board that was commissioned with `settings`, and waits until its servo ticks.
    ///
    /// # Errors
    /// When the firmware does not start, or is not built from the sources of this program.
    pub fn start(image: &Image, parameters: &Parameters, settings: &Settings, seed: u64) -> Result<Self> {
        let head = layout(image)?;
        let bench = Bench::new(parameters, seed).map_err(|e| anyhow!(e))?;
        let mut machine = Machine::new(image, bench, CRYSTAL_HZ)?;
        commission(&machine.soc().memory.flash, settings)?;
        let mut rig = Self {
            machine,
            rtt: Rtt::new(image)?,
            log: false,
            head,
            status: Status::default(),
            count: 0,
            changes: VecDeque::new(),
            answers: VecDeque::new(),
            windows: 0,
        };
        rig.boot(parameters, seed)?;
        Ok(rig)
    }

    /// Runs until the servo interrupt has come, then lets the bench's windows begin with the periods of TIM1.
    fn boot(&mut self, parameters: &Parameters, seed: u64) -> Result<()> {
        const SERVO: usize = 16 + 25;
        while self.machine.stats().entries[SERVO] == 0 {
            let next = self.machine.soc().now() + WINDOW;
            if next > START {
                for line in self.rtt.poll(&self.machine.soc().memory) {
                    eprintln!("{line}");
                }
                bail!("the firmware does not reach its first servo tick");
            }
            self.machine.run_until(next)?;
        }
        let soc = self.machine.soc();
        let count = soc.read(TIM1_CNT, 4)?;
        let period = soc.now() - u64::from(count);
        // The process starts anew, so that its time is that of a native run.
        soc.world.mount(parameters, seed).map_err(|e| anyhow!(e))?;
        soc.world.align(period + WINDOW);
        soc.world_changed();
        self.machine.step_by_blocks()?;
        self.machine.stretch_idle(STRETCH);
        self.machine.run_until(period + WINDOW - 1)
    }

    /// One window; the head's status is then that of its tick.
    fn window(&mut self) -> Result<()> {
        self.windows += 1;
        let soc = self.machine.soc();
        if self.windows.is_multiple_of(LIFE) {
            let at = soc.now() + WINDOW / 2;
            soc.world.send(at, Frame::new(SYNC, &[]));
            soc.world_changed();
        }
        self.count = soc.world.process.truth().count;
        let end = soc.world.window() + WINDOW - 1;
        self.machine.run_until(end)?;
        let soc = self.machine.soc();
        while let Some((_, frame)) = soc.world.sent.pop_front() {
            if frame.id == u32::from(remote::ANSWER | NODE) {
                self.answers.push_back([frame.data[0], frame.data[1]]);
            }
        }
        if self.windows.is_multiple_of(LIFE) {
            self.print_log();
        }
        self.read_status()
    }

    fn read_status(&mut self) -> Result<()> {
        let before = self.status;
        let memory = &self.machine.soc().memory.ccm;
        let status = status(memory, self.head)?;
        if status.tick == before.tick {
            bail!("the servo task has missed its tick, {:.6} s after power-up", self.seconds());
        }
        if let (None, Some(fault)) = (before.fault, status.fault) {
            let reason = Reason::Fault(fault);
            self.changes.push_back(Change { tick: status.tick, from: before.state, to: status.state, reason });
        }
        self.status = status;
        Ok(())
    }

    /// Time since power-up.
    fn seconds(&mut self) -> f64 {
        self.machine.soc().now() as f64 / TICK_HZ as f64
    }

    /// Prints what the firmware has logged since the last time, if that was asked for.
    fn print_log(&mut self) {
        let lines = self.rtt.poll(&self.machine.soc().memory);
        if self.log {
            let s = self.seconds();
            lines.iter().for_each(|line| println!("{s:10.6} {line}"));
        }
    }

    /// What the emulator has counted.
    pub fn machine(&self) -> &Machine<Bench> {
        &self.machine
    }
}

impl Rig for Emulated {
    fn process(&self) -> &Process {
        &self.machine.world().process
    }

    fn status(&self) -> &Status {
        &self.status
    }

    fn true_count(&self) -> i64 {
        self.count
    }

    fn next_change(&mut self) -> Option<Change> {
        self.changes.pop_front()
    }

    fn tick(&mut self) -> Result<(), String> {
        self.window().map_err(|e| {
            self.print_log();
            format!("{e:#}")
        })
    }

    fn command(&mut self, command: Command) -> Result<(), String> {
        let data = request(command);
        let soc = self.machine.soc();
        let now = soc.now();
        soc.world.send(now + WINDOW / 4, Frame::new(remote::COMMAND | NODE, &data));
        soc.world_changed();
        for _ in 0..PATIENCE {
            self.tick()?;
            while let Some([number, result]) = self.answers.pop_front() {
                match result {
                    0 if number == data[0] => return Ok(()),
                    code => return Err(format!("{command:?} was refused with code {code}")),
                }
            }
        }
        Err(format!("{command:?}: no answer"))
    }
}

/// A command as the frame that [`remote::request`] understands.
fn request(command: Command) -> [u8; 8] {
    let (number, nm) = match command {
        Command::Enable => (1, 0),
        Command::Disable => (2, 0),
        Command::SetHome(at) => (3, at.0),
        Command::MoveTo(to) => (4, to.0),
        Command::MoveBy(by) => (5, by.0),
        Command::Start => (6, 0),
        Command::Hold => (7, 0),
        Command::Commission => (8, 0),
        Command::ResetFault => (9, 0),
    };
    let [a, b, c, d] = (nm as i32).to_le_bytes();
    [number, 0, 0, 0, a, b, c, d]
}

/// Bores a hole with the firmware in `image`: the counterpart of [`edm_sim::bore::bore`].
///
/// # Errors
/// When the run cannot be made.
pub fn bore(
    image: &Image,
    log: bool,
    job: &Job,
    observer: &mut impl Observer,
    progress: &mut dyn FnMut(&Progress),
) -> Result<Outcome, String> {
    if job.surrogate {
        return Err("--surrogate: the dry loop has no gap signal for a converter; it runs with `cargo sim bore`".into());
    }
    // The guided check counts as passed, as in the native run: it needs an axis without a workpiece.
    let settings = Settings { commissioned: true, ..job.setup.head };
    let mut rig = Emulated::start(image, &job.setup.process, &settings, job.seed).map_err(|e| format!("{e:#}"))?;
    rig.log = log;
    edm_sim::bore::run(job, &mut rig, observer, progress)
}

const HEAD: &str = "edm_servo_head::head::machine::Head";

/// Address of the head's status in the chip, after checking that it looks as it does here.
fn layout(image: &Image) -> Result<u32> {
    let memory = image.find("ccm", "MEMORY").context("the ELF has no symbol of the head's memory")?;
    let names = [HEAD, "edm_servo_head::head::Status", "edm_servo_head::gap::GapReading"];
    let layout = Layout::read(image.file(), &names)?;
    let [_, of_status, of_gap] = names;
    macro_rules! here {
        ($type:ty: $($field:ident),+) => { &[$((stringify!($field), offset_of!($type, $field))),+] };
    }
    let fields = here!(Status: tick, state, fault, position, setpoint, following, velocity, path, gap, gap_setpoint,
        open_circuit, duty, saturated, current, bus, illegal_transitions, homed, current_reduced);
    layout.same(of_status, size_of::<Status>(), fields)?;
    let fields = here!(GapReading: filtered, block, quality, short_ticks);
    layout.same(of_gap, size_of::<GapReading>(), fields)?;
    Ok(memory + layout.offset(HEAD, "status")?)
}

/// The status at `at`, field by field.
fn status(memory: &Region, at: u32) -> Result<Status> {
    let load = |offset: usize, size| memory.load(at + offset as u32, size).context("the status is not in memory");
    let byte = |offset| load(offset, 1).map(|b| b as usize);
    let float = |offset| load(offset, 4).map(f32::from_bits);
    let long = |offset: usize| {
        let (low, high) = (load(offset, 4)?, load(offset + 4, 4)?);
        anyhow::Ok((u64::from(high) << 32 | u64::from(low)).cast_signed())
    };
    macro_rules! of {
        ($field:ident) => {
            offset_of!(Status, $field)
        };
    }
    let gap = of!(gap);
    // A fault's number; none is the first number that no fault has.
    let fault = match byte(of!(fault))? {
        n if n == Fault::ALL.len() => None,
        n => Some(*Fault::ALL.get(n).context("the status holds no fault")?),
    };
    Ok(Status {
        tick: load(of!(tick), 4)?,
        state: *STATES.get(byte(of!(state))?).context("the status holds no state")?,
        fault,
        position: long(of!(position))?,
        setpoint: Fixed(long(of!(setpoint))?),
        following: float(of!(following))?,
        velocity: CountsPerSecond(float(of!(velocity))?),
        path: Fixed(long(of!(path))?),
        gap: GapReading {
            filtered: Volts(float(gap + offset_of!(GapReading, filtered))?),
            block: Volts(float(gap + offset_of!(GapReading, block))?),
            quality: *QUALITIES
                .get(byte(gap + offset_of!(GapReading, quality))?)
                .context("the status holds no quality")?,
            short_ticks: load(gap + offset_of!(GapReading, short_ticks), 4)?,
        },
        gap_setpoint: Volts(float(of!(gap_setpoint))?),
        open_circuit: Volts(float(of!(open_circuit))?),
        duty: float(of!(duty))?,
        saturated: byte(of!(saturated))? != 0,
        current: Amps(float(of!(current))?),
        bus: Volts(float(of!(bus))?),
        // Not read: nothing here looks at it.
        back_emf: Default::default(),
        illegal_transitions: load(of!(illegal_transitions), 4)?,
        homed: byte(of!(homed))? != 0,
        current_reduced: byte(of!(current_reduced))? != 0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use edm_servo_head::units::Nanometres;

    #[test]
    fn the_firmware_understands_every_command_of_the_host() {
        let at = Nanometres(-1_234_567);
        for command in [
            Command::Enable,
            Command::Disable,
            Command::SetHome(at),
            Command::MoveTo(at),
            Command::MoveBy(at),
            Command::Start,
            Command::Hold,
            Command::Commission,
            Command::ResetFault,
        ] {
            assert_eq!(remote::request(&request(command)), Some(remote::Request::Command(command)));
        }
    }
}
