//! The native core beside the firmware: it is fed what the chip saw, and must come to the same, bit for bit.
//!
//! What the chip saw is taken upstream of everything that computes with floats: the converter's codes with the gate, the
//! encoder's counts and times, contacts, drive codes, the reflex, and the host's commands in the tick in which the servo
//! task carries them out. A fault of the supervision, which runs beside the ticks, is told the native core in the tick that
//! the chip was told in; a fault that a tick finds by itself must be found here, too.

mod recording;

pub use recording::{Error, QUALITIES, Recorder, STATES, replay};

use edm_hal_shim::gap::GapBlock;
use edm_servo_head::gap::{GapReading, GapSource, Quality, Voltage};
use edm_servo_head::head::{Command, Fault, Head, Status, TickInput};
use edm_servo_head::path::Path;
use edm_servo_head::settings::{SettingError, Settings};

/// What the chip saw, and what it came to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// A block of conversions was completed, or lost.
    Block(Option<GapBlock>),
    /// The host's command that the next tick carries out.
    Command(Command),
    /// A fault that another task tells the next tick of.
    Told(Fault),
    /// One servo tick.
    Tick(TickInput, Status),
}

/// The native core.
pub struct Twin {
    source: Voltage,
    head: Head<Box<Path>>,
    reading: GapReading,
    faults: Vec<Fault>,
    commands: Vec<Command>,
    ticks: u64,
}

impl Twin {
    /// A core with the settings of the board.
    ///
    /// # Errors
    /// When the settings contradict each other.
    pub fn new(settings: &Settings) -> Result<Self, SettingError> {
        let active = settings.build()?;
        let reading = GapReading::default();
        Ok(Self {
            source: Voltage::new(active.gap),
            head: Head::new(active.head, Box::new(Path::EMPTY)),
            reading,
            faults: Vec::new(),
            commands: Vec::new(),
            ticks: 0,
        })
    }

    /// What happened next on the chip.
    ///
    /// # Errors
    /// The first difference.
    pub fn event(&mut self, event: &Event) -> Result<(), String> {
        match event {
            Event::Block(block) => self.reading = self.source.update(block.as_ref()),
            // In the tick that follows, faults first.
            Event::Told(fault) => self.faults.push(*fault),
            Event::Command(command) => self.commands.push(*command),
            Event::Tick(input, status) => return self.tick(input, status),
        }
        Ok(())
    }

    fn tick(&mut self, input: &TickInput, there: &Status) -> Result<(), String> {
        self.ticks += 1;
        let missing = GapReading { quality: Quality::Missing, ..input.gap };
        if input.gap != missing {
            self.compare("gap reading", &bits(&self.reading), &bits(&input.gap))?;
        }
        for fault in self.faults.drain(..) {
            self.head.raise(fault);
        }
        for command in self.commands.drain(..) {
            // A refusal shows in the status.
            let _ = self.head.command(command);
        }
        self.head.tick(input);
        let here = *self.head.status();
        self.compare("state", &(here.tick, here.state, here.fault), &(there.tick, there.state, there.fault))?;
        self.compare("setpoint", &(here.setpoint, here.path), &(there.setpoint, there.path))?;
        self.compare("gap", &bits(&here.gap), &bits(&there.gap))?;
        let motion = |s: &Status| (s.position, s.velocity.0.to_bits(), s.following.to_bits(), s.saturated);
        self.compare("motion", &motion(&here), &motion(there))?;
        let drive = |s: &Status| (s.current.0.to_bits(), s.bus.0.to_bits(), s.open_circuit.0.to_bits());
        self.compare("drive", &drive(&here), &drive(there))?;
        self.compare("duty", &here.duty.to_bits(), &there.duty.to_bits())
            .map_err(|e| format!("{e}; {input:?}; natively {here:?}; on the chip {there:?}"))
    }

    /// Ticks compared.
    pub fn ticks(&self) -> u64 {
        self.ticks
    }

    fn compare<T: PartialEq + std::fmt::Debug>(&self, what: &str, here: &T, there: &T) -> Result<(), String> {
        if here == there {
            return Ok(());
        }
        Err(format!("tick {}: {what} is {here:?} natively and {there:?} on the chip", self.ticks))
    }
}

fn bits(reading: &GapReading) -> (u32, u32, Quality, u32) {
    (reading.filtered.0.to_bits(), reading.block.0.to_bits(), reading.quality, reading.short_ticks)
}
