//! The closed loop: the control core on the process model, tick by tick.

use crate::process::{Parameters, Process};
use edm_hal_shim::encoder::RawCount;
use edm_servo_head::encoder::Quadrature;
use edm_servo_head::gap::{GapReading, GapSource, Surrogate, SurrogateConfig, Voltage};
use edm_servo_head::head::{Command, Fault, Head, Supervisor, TickInput, TickOutput};
use edm_servo_head::settings::{SettingError, Settings};
use edm_servo_head::units::{Fixed, MicrometresPerSecond, Volts};

/// Gap that counts as right in the dry loop, um.
const DRY_GAP_UM: f64 = 40.0;

/// Where the head's gap reading comes from.
enum Gap {
    /// The converter, as on the machine.
    Voltage(Voltage),
    /// The position, as in the dry loop of \[R\].
    Surrogate(Box<(Surrogate, SurrogateConfig)>),
}

/// Head, process and the wires between them.
pub struct Machine {
    /// The machine and the process.
    pub process: Process,
    /// The control core.
    pub head: Head,
    /// A host gives life signs.
    pub host_alive: bool,
    supervisor: Supervisor,
    decoder: Quadrature,
    gap: Gap,
    output: TickOutput,
    ticks: u64,
}

impl Machine {
    /// A head at rest at its upper stop, disabled.
    pub fn new(parameters: &Parameters, settings: &Settings, seed: u64) -> Result<Machine, SettingError> {
        let active = settings.build()?;
        let process = Process::new(parameters, seed)?;
        Ok(Machine {
            head: Head::new(active.head),
            host_alive: true,
            supervisor: Supervisor::default(),
            decoder: Quadrature::new(process.sensors().levels, process.sensors().now),
            gap: Gap::Voltage(Voltage::new(active.gap)),
            output: TickOutput::default(),
            ticks: 0,
            process,
        })
    }

    /// Replaces the gap signal by position, noise and imagined erosion (Roberts, section 6.8): the dry loop. The imagined
    /// surface begins at `surface_um`; no real one should be in the way. The generator is off.
    pub fn run_dry(&mut self, settings: &Settings, surface_um: f64, seed: u64) {
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
                let position = Fixed::whole(self.head.status().position);
                let (source, config) = dry.as_mut();
                if self.output.pulses { source.update(config, position) } else { GapReading::default() }
            }
        };
        let input = TickInput {
            gap,
            encoder,
            watch: Some(RawCount { count: sensors.timer_count, ..encoder.raw }),
            safety: sensors.safety,
            drive: sensors.drive,
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

    /// Count of the edge decoder since power-up.
    pub fn decoder_count(&self) -> i64 {
        i64::from(self.decoder.snapshot(0).raw.count.cast_signed())
    }
}
