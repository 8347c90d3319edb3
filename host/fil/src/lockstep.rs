//! The native core beside the firmware: it is fed what the chip saw, and must come to the same, bit for bit.
//!
//! What the chip saw is taken upstream of everything that computes with floats: the converter's codes with the gate, the
//! encoder's counts and times, contacts, drive codes, the reflex, and the host's commands in the tick in which the servo
//! task carries them out. A fault of the supervision is taken over when the chip has it, because supervision runs beside
//! the ticks; a fault that a tick finds by itself must be found here, too.

use edm_hal_shim::gap::GapBlock;
use edm_servo_head::gap::{GapReading, GapSource, Quality, Voltage};
use edm_servo_head::head::{Command, Fault, Head, Status, TickInput};
use edm_servo_head::path::Path;
use edm_servo_head::settings::{SettingError, Settings};

/// Faults that only the supervision raises.
const SUPERVISED: [Fault; 7] = [
    Fault::OverCurrent,
    Fault::BusSag,
    Fault::PolarityWrong,
    Fault::FollowingError,
    Fault::GapSignalInvalid,
    Fault::GateMissing,
    Fault::HostSilent,
];

/// The native core.
pub struct Twin {
    source: Voltage,
    head: Head<Box<Path>>,
    reading: GapReading,
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
            ticks: 0,
        })
    }

    /// A block was completed.
    pub fn block(&mut self, block: Option<&GapBlock>) {
        self.reading = self.source.update(block);
    }

    /// One servo tick of the chip: what it saw, what it was told before, what it came to.
    ///
    /// # Errors
    /// The first difference.
    pub fn tick(&mut self, commands: &[Command], input: &TickInput, there: &Status) -> Result<(), String> {
        self.ticks += 1;
        if let (Some(fault), None) = (there.fault, self.head.status().fault)
            && SUPERVISED.contains(&fault)
        {
            self.head.raise(fault);
        }
        for command in commands {
            // A refusal shows in the status.
            let _ = self.head.command(*command);
        }
        // Between plans the firmware leaves the reading as it was.
        let missing = GapReading { quality: Quality::Missing, ..input.gap };
        if self.head.wants_gap() && input.gap != missing {
            self.compare("gap reading", &bits(&self.reading), &bits(&input.gap))?;
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
