//! The closed loop: the control core on the process model, tick by tick.

use crate::process::{Parameters, Process};
use edm_hal_shim::encoder::RawCount;
use edm_servo_head::encoder::Quadrature;
use edm_servo_head::gap::{GapReading, GapSource, Surrogate, SurrogateConfig, Voltage};
use edm_servo_head::head::{Change, Command, Fault, Head, Refused, Status, Supervisor, TickInput, TickOutput};
use edm_servo_head::path::Path;
use edm_servo_head::settings::{Active, SettingError, Settings};
use edm_servo_head::units::{FRACTION_BITS, Fixed, MicrometresPerSecond, Volts};

/// Gap that counts as right in the dry loop, um.
const DRY_GAP_UM: f64 = 40.0;

/// Where the head's gap reading comes from.
enum Gap {
    /// The converter, as on the machine.
    Voltage(Voltage),
    /// The position, as in the dry loop of \[R\].
    Surrogate(Box<(Surrogate, SurrogateConfig)>),
}

/// A head with its process, wherever the head runs.
pub trait Rig {
    /// The machine and the process.
    fn process(&self) -> &Process;
    /// What the head knows after the last tick.
    fn status(&self) -> &Status;
    /// Oldest change of the head's state not read yet; those that end in a fault at least.
    fn next_change(&mut self) -> Option<Change>;
    /// One servo tick.
    ///
    /// # Errors
    /// When the head cannot go on.
    fn tick(&mut self) -> Result<(), String>;
    /// Gives the head a command that must be accepted where the run stands.
    ///
    /// # Errors
    /// When it is refused.
    fn command(&mut self, command: Command) -> Result<(), String>;
    /// The true count at the moment that the position of the status is of.
    fn true_count(&self) -> i64 {
        self.process().truth().count
    }
    /// Where the imagined surface of the dry loop has got to, um; `None` with a real gap.
    fn imagined_surface_um(&self) -> Option<f64> {
        None
    }
}

impl Rig for Machine {
    fn process(&self) -> &Process {
        &self.process
    }
    fn status(&self) -> &Status {
        self.head.status()
    }
    fn next_change(&mut self) -> Option<Change> {
        self.head.next_change()
    }
    fn tick(&mut self) -> Result<(), String> {
        Machine::tick(self);
        Ok(())
    }
    fn command(&mut self, command: Command) -> Result<(), String> {
        Machine::command(self, command)
    }
    fn imagined_surface_um(&self) -> Option<f64> {
        Machine::imagined_surface_um(self)
    }
}

/// Head, process and the wires between them.
pub struct Machine {
    /// The machine and the process.
    pub process: Process,
    /// The control core.
    pub head: Head<Box<Path>>,
    /// A host gives life signs.
    pub host_alive: bool,
    supervisor: Supervisor,
    decoder: Quadrature,
    gap: Gap,
    output: TickOutput,
    ticks: u64,
    count_um: f64,
}

impl Machine {
    /// A head at rest at its upper stop, disabled.
    pub fn new(parameters: &Parameters, settings: &Settings, seed: u64) -> Result<Machine, SettingError> {
        let active = settings.build()?;
        let process = Process::new(parameters, seed)?;
        Ok(Machine {
            head: Head::new(active.head, Box::new(Path::EMPTY)),
            host_alive: true,
            supervisor: Supervisor::default(),
            decoder: Quadrature::new(process.sensors().levels, process.sensors().now),
            gap: Gap::Voltage(Voltage::new(active.gap)),
            output: TickOutput::default(),
            ticks: 0,
            count_um: settings.encoder_count.into(),
            process,
        })
    }

    /// Replaces the gap signal by position, noise and imagined erosion (Roberts, section 6.8): the dry loop. The imagined
    /// surface begins at `surface_um`; no real one should be in the way. The generator is off.
    pub fn run_dry(&mut self, settings: &Settings, surface_um: f64, seed: u64) {
        // C of [R] section 6.8 as 0.2 mm/min, worse by half of that for 3 um of error; noise of 0.5, as in section 7.1.
        let config = SurrogateConfig {
            setpoint: Volts(settings.gap_setpoint),
            open: Volts(100.0),
            slope: 1.0,
            erosion: MicrometresPerSecond(3.3),
            worsening: 0.5,
            noise: Volts(0.5),
        };
        // The gap is right some way above the surface, so that the seek comes from an open gap.
        let right = Fixed::whole((surface_um - DRY_GAP_UM) as i64);
        self.gap = Gap::Surrogate(Box::new((Surrogate::new(right, seed as u32), config)));
        self.process.mishaps.generator_dead = true;
    }

    /// Where the imagined surface of the dry loop has got to, um; `None` with a real gap.
    pub fn imagined_surface_um(&self) -> Option<f64> {
        match &self.gap {
            Gap::Voltage(_) => None,
            Gap::Surrogate(dry) => Some(f64::from(dry.0.surface().0) + DRY_GAP_UM),
        }
    }

    /// One servo tick: the process goes on for 50 us, then the head looks and decides. Gives a fault that supervision
    /// found.
    pub fn tick(&mut self) -> Option<Fault> {
        self.ticks += 1;
        let sensors = self.process.advance(self.output.drive, self.output.pulses);
        for &(time, levels) in &sensors.edges {
            self.decoder.edge(levels, time);
        }
        let encoder = self.decoder.snapshot(sensors.now);
        let gap = match &mut self.gap {
            Gap::Voltage(source) => source.update(Some(&sensors.block)),
            Gap::Surrogate(dry) => {
                let um = self.head.status().position as f64 * self.count_um;
                let position = Fixed((um * f64::from(1u32 << FRACTION_BITS)) as i64);
                let (source, config) = dry.as_mut();
                if self.output.pulses { source.update(config, position) } else { GapReading::default() }
            }
        };
        let input = TickInput {
            gap,
            encoder,
            watch: Some(RawCount { count: sensors.timer_count, ..encoder.raw }),
            safety: sensors.safety.unsafe_ones(),
            drive: sensors.drive,
            reflex: false,
        };
        self.output = self.head.tick(&input);
        if !self.ticks.is_multiple_of(u64::from(Supervisor::PERIOD)) {
            return None;
        }
        let fault = self.supervisor.tick(&self.head.supervision(), self.head.status(), self.host_alive)?;
        self.head.raise(fault);
        Some(fault)
    }

    /// Gives the head a command that must be accepted where the run stands.
    pub fn command(&mut self, command: Command) -> Result<(), String> {
        self.head.command(command).map_err(|refused| format!("{command:?} was refused: {refused}"))
    }

    /// Runs other settings from the next tick on.
    ///
    /// # Errors
    /// When they change the axis as wired while a loop is closed.
    pub fn configure(&mut self, active: &Active) -> Result<(), Refused> {
        self.head.configure(active.head)?;
        if let Gap::Voltage(source) = &mut self.gap {
            source.retune(active.gap);
        }
        Ok(())
    }

    /// Count of the edge decoder since power-up.
    pub fn decoder_count(&self) -> i64 {
        i64::from(self.decoder.snapshot(0).raw.count.cast_signed())
    }
}
