//! The native tasks beside the firmware's: they are fed what the chip saw, and must come to the same, bit for bit.
//!
//! They are those of the runtime (gap, servo, supervision), over ports that show what the chip saw at its own, upstream of
//! everything that computes with floats: the converter's codes with the gate, the encoder's counts and times, contacts,
//! drive codes, the reflex. Commands go through the crossings, in the tick in which the chip's servo task carried them out.
//!
//! A fault that a tick finds by itself must be found here, and so must one of the supervision, which judges here when it did
//! there. A tick may interrupt it between judging and telling, and then the tick behind is told. What the protocol raises, a
//! host that is silent, is told as a request.

mod recording;

pub use recording::{Error, QUALITIES, Recorder, STATES, replay};

use crate::board::Ports;
use crate::machine::Core;
use edm_hal_shim::gap::GapBlock;
use edm_runtime::HostEnds;
use edm_runtime::crossings::Request;
use edm_servo_head::gap::{GapReading, Quality};
use edm_servo_head::head::{Command, Fault, Status, TickInput};
use edm_servo_head::settings::{SettingError, Settings};

/// What the chip saw, and what it came to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// A block of conversions was completed, or lost.
    Block(Option<GapBlock>),
    /// The host's command that the next tick carries out.
    Command(Command),
    /// The supervision has judged the newest status.
    Supervised,
    /// A fault that another task tells the next tick of.
    Told(Fault),
    /// One servo tick.
    Tick(TickInput, Status),
}

/// The native tasks.
pub struct Twin {
    core: Core,
    ends: HostEnds,
    /// The supervision has found a fault, and nothing else waits for the servo task.
    found: bool,
    /// The newest fault that the next tick is told of.
    told: Option<Fault>,
    ticks: u64,
}

impl Twin {
    /// Tasks with the settings of the board.
    ///
    /// # Errors
    /// When the settings contradict each other.
    pub fn new(settings: &Settings) -> Result<Self, SettingError> {
        let (core, others) = Core::on(Ports::leak(), &settings.build()?);
        Ok(Self { core, ends: others.host.ends, found: false, told: None, ticks: 0 })
    }

    /// What happened next on the chip.
    ///
    /// # Errors
    /// The first difference.
    pub fn event(&mut self, event: &Event) -> Result<(), String> {
        match event {
            Event::Block(block) => {
                self.core.ports.block.set(*block);
                self.core.gap.block();
            }
            Event::Told(fault) => {
                self.told = Some(*fault);
                if *fault == Fault::HostSilent {
                    self.request(Request::Raise(*fault));
                }
            }
            Event::Supervised => self.judge(),
            Event::Command(command) => self.request(Request::Command(*command)),
            Event::Tick(input, status) => return self.tick(input, status),
        }
        Ok(())
    }

    fn request(&mut self, request: Request) {
        self.ends.requests.send(request);
        self.core.signals.waiting.set();
        self.found = false;
    }

    /// The supervision's millisecond.
    fn judge(&mut self) {
        let others = self.core.signals.waiting.is_set();
        // Whether a host is silent is not recorded.
        self.core.host_is_alive();
        self.core.ports.period.set(true);
        self.core.supervise.tick();
        self.found = self.core.signals.waiting.is_set() && !others;
    }

    /// Shows what the chip saw.
    fn show(&self, input: &TickInput) {
        let ports = self.core.ports;
        self.core.published.replay(&input.encoder);
        ports.now.set(input.encoder.raw.now);
        if let Some(watch) = input.watch {
            ports.timer.set(watch.count);
            ports.timer_read_at.set(Some(watch.now));
        }
        ports.safety.set(input.safety.unwrap_or_default());
        ports.codes.set(input.drive);
        ports.retreats.set(ports.retreats.get().wrapping_add(input.reflex.into()));
    }

    fn tick(&mut self, input: &TickInput, there: &Status) -> Result<(), String> {
        self.ticks += 1;
        let waiting = &self.core.signals.waiting;
        let interrupted = std::mem::take(&mut self.found) && self.told.is_none();
        if interrupted {
            waiting.clear();
        }
        self.show(input);
        let wants_gap = self.core.servo.head().wants_gap();
        self.core.servo.tick();
        if interrupted {
            waiting.set();
        }
        while self.ends.answers.receive().is_some() {}
        while self.ends.changes.receive().is_some() {}
        while self.ends.checked.receive().is_some() {}

        let (fault, tick) = self.core.servo.told();
        self.compare("fault told", &(tick == there.tick).then_some(fault), &self.told)?;
        self.told = None;
        // Between plans the firmware leaves the reading as it was.
        let missing = GapReading { quality: Quality::Missing, ..input.gap };
        if wants_gap && input.gap != missing {
            self.compare("gap reading", &bits(&self.core.input().gap), &bits(&input.gap))?;
        }
        let here = *self.core.status();
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::process::{Parameters, Process};
    use edm_servo_head::head::State;

    /// What a head sees that is enabled, and whose bus voltage sags: the supervision finds that.
    fn day(seed: u64) -> Vec<Event> {
        let settings = Settings { commissioned: true, ..Settings::default() };
        let mut process = Process::new(&Parameters::default(), seed).unwrap();
        let (mut core, others) = Core::new(&settings.build().unwrap(), &process);
        let mut ends = others.host.ends;
        let mut events = Vec::new();
        for period in 0..10_000 {
            if period == 1000 {
                ends.requests.send(Request::Command(Command::Enable));
                core.signals.waiting.set();
                events.push(Event::Command(Command::Enable));
            }
            process.fault_inputs.bus_v = (period > 5000).then_some(20.0);
            core.host_is_alive();
            let supervised = core.tick(&mut process);
            let (fault, tick) = core.servo.told();
            events.push(Event::Block(Some(process.sensors().block)));
            if tick == core.status().tick {
                events.push(Event::Told(fault));
            }
            events.push(Event::Tick(*core.input(), *core.status()));
            if supervised {
                events.push(Event::Supervised);
            }
            while ends.answers.receive().is_some() {}
        }
        assert_eq!((core.status().state, core.status().fault), (State::Fault, Some(Fault::BusSag)));
        events
    }

    fn replay(events: &[Event]) -> Result<u64, String> {
        let mut twin = Twin::new(&Settings { commissioned: true, ..Settings::default() }).unwrap();
        events.iter().try_for_each(|event| twin.event(event))?;
        Ok(twin.ticks())
    }

    fn told(events: &[Event]) -> usize {
        events.iter().position(|event| matches!(event, Event::Told(_))).unwrap()
    }

    #[test]
    fn a_fault_of_the_supervision_is_found_here_too() {
        for seed in 0..10 {
            let events = day(seed);
            assert_eq!(events[told(&events)], Event::Told(Fault::BusSag));
            assert_eq!(replay(&events), Ok(10_000), "seed {seed}");
        }
    }

    #[test]
    fn a_fault_that_the_supervision_finds_on_one_side_alone_is_a_difference() {
        let events = day(1);
        let at = told(&events);
        let without: Vec<_> = events.iter().filter(|event| !matches!(event, Event::Told(_))).copied().collect();
        assert!(replay(&without).is_err());
        let mut another = events.clone();
        another[at] = Event::Told(Fault::FollowingError);
        assert!(replay(&another).unwrap_err().contains("fault told"));
        // A millisecond before its time: two events a period, and one a millisecond.
        let mut early = without;
        early.insert(at - 41, Event::Told(Fault::BusSag));
        assert!(replay(&early).unwrap_err().contains("fault told"));
    }
}
