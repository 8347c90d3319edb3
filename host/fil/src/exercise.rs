//! An exercise for a head: it seeks, erodes, has a short, retreats, returns, and then something breaks. After the repair the
//! next thing breaks. The inputs of the chip go to a [`Witness`].

use crate::host;
use crate::image::Image;
use crate::rig::{Emulated, Witness};
use anyhow::{Error, Result, anyhow, bail, ensure};
use edm_hal_shim::safety::SafetyInputs;
use edm_servo_head::head::{Command, Fault, State};
use edm_servo_head::settings::Settings;
use edm_servo_head::units::{Nanometres, TICK_HZ};
use edm_sim::machine::Rig as _;
use edm_sim::process::{Cable, FaultInputs};
use edm_sim::run::Setup;

/// What breaks, and the fault that the head must report.
const BREAKS: [(&str, Fault); 10] = [
    ("a wire across the gap", Fault::PersistentShort),
    ("no pulses", Fault::GateMissing),
    ("converter at its end", Fault::GapSignalInvalid),
    ("bus sags", Fault::BusSag),
    ("dielectric contact", Fault::DielectricNotOk),
    ("host silent", Fault::HostSilent),
    ("lower limit contact", Fault::LowerLimit),
    ("encoder dead", Fault::EncoderLost),
    ("bridge fault", Fault::BridgeFault),
    ("emergency stop", Fault::EmergencyStop),
];
/// Depth of the work below the upper stop, mm: near, so that little time goes into seeking.
const SURFACE_MM: f32 = 0.3;
/// Where the path leads.
const TARGET: Nanometres = Nanometres(2_000_000);

/// What was met.
#[derive(Clone, Debug, Default)]
pub struct Met {
    /// Servo ticks.
    pub ticks: u64,
    /// Retreats from a short.
    pub retreats: u32,
    /// Faults, in turn.
    pub faults: Vec<Fault>,
}

/// The head at work.
struct Day {
    rig: Emulated,
    met: Met,
}

/// Lets the firmware work for `seconds` at least, to the end of the present fault; `seed` is that of the process.
///
/// # Errors
/// When the head does something else than it should, or the witness objects.
pub fn run(image: &Image, seconds: f64, seed: u64, witness: Witness) -> Result<(Witness, Met)> {
    let mut setup = Setup::load("default").map_err(Error::msg)?;
    setup.process.installation.surface = SURFACE_MM;
    let settings = Settings { commissioned: true, ..Settings::default() };
    let rig = Emulated::start(image, setup.process, &settings, seed, witness)?;
    let mut day = Day { rig, met: Met::default() };
    day.rest(0.01)?;
    host::begin(&mut day.rig)?;
    day.command(Command::SetHome(Nanometres(0)))?;
    let end = (seconds * f64::from(TICK_HZ)) as u64;
    let mut clear = true;
    for (what, fault) in BREAKS.into_iter().cycle() {
        if day.met.ticks >= end {
            break;
        }
        if clear {
            day.work()?;
            day.short()?;
        } else {
            day.first(Command::Enable)?;
        }
        day.break_down(what, fault)?;
        // Without a bridge it stays at the work, and a seek begins with the voltage of an open gap: what breaks next finds it at
        // rest, and lifts it.
        clear = fault != Fault::BridgeFault;
    }
    let Day { rig, met } = day;
    Ok((rig.into_witness(), met))
}

impl Day {
    fn tick(&mut self) -> Result<State> {
        self.met.ticks += 1;
        self.rig.tick().map_err(|e| anyhow!(e))?;
        Ok(self.rig.status().state)
    }

    fn rest(&mut self, seconds: f64) -> Result<()> {
        for _ in 0..(seconds * f64::from(TICK_HZ)) as u64 {
            self.tick()?;
        }
        Ok(())
    }

    fn until(&mut self, state: State, seconds: f64) -> Result<()> {
        for _ in 0..(seconds * f64::from(TICK_HZ)) as u64 {
            if self.tick()? == state {
                return Ok(());
            }
        }
        let status = self.rig.status();
        bail!("{} instead of {} after {seconds} s: {status:?}", status.state.name(), state.name())
    }

    fn command(&mut self, command: Command) -> Result<()> {
        self.rig.command(command).map_err(|e| anyhow!(e))
    }

    fn fault_inputs(&mut self) -> &mut FaultInputs {
        &mut self.rig.process_mut().fault_inputs
    }

    fn work(&mut self) -> Result<()> {
        self.seek()?;
        if self.rig.status().state == State::Fault {
            // The lines of an encoder that comes back jump, and the two counters take that differently: the home is lost.
            let fault = self.rig.status().fault;
            ensure!(fault == Some(Fault::EncoderLost), "{fault:?} while seeking");
            self.met.faults.push(Fault::EncoderLost);
            self.rest(0.5)?;
            self.command(Command::ResetFault)?;
            self.rest(0.05)?;
            self.first(Command::SetHome(Nanometres(0)))?;
            self.seek()?;
        }
        self.until(State::Eroding, 10.0)?;
        self.rest(0.2)
    }

    /// The first command that enables the head behind a fault. An encoder in doubt proves itself by a move up, which a head at
    /// its upper stop cannot make: that is a fault, and the next proof goes down.
    fn first(&mut self, command: Command) -> Result<()> {
        let Err(error) = self.command(command) else { return Ok(()) };
        ensure!(self.rig.status().fault == Some(Fault::EncoderLost), "{error:#}: {:?}", self.rig.status());
        self.met.faults.push(Fault::EncoderLost);
        self.rest(0.5)?;
        self.command(Command::ResetFault)?;
        self.rest(0.05)?;
        self.command(command)
    }

    /// From rest to the work, or to a fault.
    fn seek(&mut self) -> Result<()> {
        self.first(Command::Enable)?;
        for command in [Command::MoveTo(TARGET), Command::Start] {
            self.command(command)?;
        }
        while self.tick()? == State::Seeking {}
        Ok(())
    }

    /// A short that backing off clears.
    fn short(&mut self) -> Result<()> {
        self.fault_inputs().short = true;
        self.until(State::Retreating, 0.1)?;
        self.met.retreats += 1;
        self.fault_inputs().short = false;
        self.until(State::Eroding, 3.0)
    }

    fn break_down(&mut self, what: &str, fault: Fault) -> Result<()> {
        let open = SafetyInputs::default();
        *self.fault_inputs() = match fault {
            Fault::PersistentShort => FaultInputs { short: true, ..FaultInputs::default() },
            Fault::GateMissing => FaultInputs { generator_dead: true, ..FaultInputs::default() },
            Fault::GapSignalInvalid => FaultInputs { stuck_code: Some(4095), ..FaultInputs::default() },
            Fault::BusSag => FaultInputs { bus_v: Some(30.0), ..FaultInputs::default() },
            Fault::EncoderLost => FaultInputs { encoder: Cable::CUT, ..FaultInputs::default() },
            Fault::DielectricNotOk => contact(SafetyInputs { dielectric: true, ..open }),
            Fault::LowerLimit => contact(SafetyInputs { lower_limit: true, ..open }),
            Fault::BridgeFault => contact(SafetyInputs { bridge_fault: true, ..open }),
            Fault::EmergencyStop => contact(SafetyInputs { emergency_stop: true, ..open }),
            _ => FaultInputs::default(),
        };
        self.rig.host_alive = fault != Fault::HostSilent;
        self.until(State::Fault, 3.0)?;
        let met = self.rig.status().fault.unwrap_or(fault);
        // An encoder that stands still may show as a following error first: the same lift follows.
        let alike = (fault, met) == (Fault::EncoderLost, Fault::FollowingError);
        ensure!(met == fault || alike, "{what}: {met:?} instead of {fault:?}");
        self.met.faults.push(met);
        self.rest(0.3)?;
        *self.fault_inputs() = FaultInputs::default();
        self.rig.host_alive = true;
        self.rest(0.2)?;
        self.command(Command::ResetFault)?;
        self.rest(0.05)?;
        if fault == Fault::EncoderLost {
            // It was lifted meanwhile without being counted.
            self.first(Command::SetHome(Nanometres(0)))?;
        }
        Ok(())
    }
}

fn contact(safety: SafetyInputs) -> FaultInputs {
    FaultInputs { safety, ..FaultInputs::default() }
}
