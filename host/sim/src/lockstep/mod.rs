//! The native tasks in lockstep with the firmware's: with the same inputs they must give the same results, bit for bit.
//!
//! They are those of the runtime (gap, servo, plan, supervision), over ports that show what the chip saw at its own, upstream
//! of everything that computes with floats: the converter's codes with the gate, the encoder's counts and times, contacts,
//! drive codes, the reflex. Commands go through the crossings, to the plan in which the chip's carried them out.
//!
//! A fault that a tick finds by itself must be found here, and so must one of the supervision, which runs here when it has run
//! there. A tick may interrupt it between its report and its end: then it runs here before that tick. A fault that the
//! protocol raises, a silent host, arrives as a request.

mod recording;

pub use recording::{Error, QUALITIES, Recorder, replay, replay_senses};

use crate::board::{PLAN, Ports};
use crate::machine::Core;
use edm_hal_shim::gap::GapBlock;
use edm_runtime::HostEnds;
use edm_runtime::crossings::Request;
use edm_servo_head::encoder::Snapshot;
use edm_servo_head::gap::{GapReading, Quality};
use edm_servo_head::head::{Command, Counters, Fault, Status, TickInput};
use edm_servo_head::settings::{SettingError, Settings};

/// Inputs and results of the chip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// A block of conversions was completed, or lost.
    Block(Option<GapBlock>),
    /// The host's command that the next plan carries out.
    Command(Command),
    /// The fault that the protocol raises with the next plan.
    Raised(Fault),
    /// A plan was made; what is known then.
    Plan(Status),
    /// The supervision has checked the newest measurement.
    Supervised,
    /// One servo tick: what it saw, both counters as read last, and what the follower knows then.
    Tick(TickInput, Counters, Status),
}

/// What the native tasks have to share with the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Same {
    /// Every bit: both were built from the same sources.
    Bits,
    /// What the head makes of a signal: counts, shorts, quality of the gap signal, and its filtered voltage within
    /// [`GAP_TOLERANCE`]. Not what it does then.
    Senses,
}

/// Filtered gap voltage of two versions of the core, volts: a tenth of the 10 V by which set points of a gap differ.
const GAP_TOLERANCE: f32 = 1.0;

/// The native tasks.
pub struct Twin {
    core: Core,
    same: Same,
    ends: HostEnds,
    /// The supervision has found a fault that no tick has received yet.
    found: bool,
    /// It has run before its time.
    early: bool,
    ticks: u64,
}

impl Twin {
    /// Tasks with the settings of the board.
    ///
    /// # Errors
    /// When the settings contradict each other.
    pub fn new(settings: &Settings) -> Result<Self, SettingError> {
        let (core, others) = Core::on(Ports::leak(), &settings.build()?);
        Ok(Self { core, same: Same::Bits, ends: others.host.ends, found: false, early: false, ticks: 0 })
    }

    /// Tasks of which only the senses have to be the chip's.
    ///
    /// # Errors
    /// When the settings contradict each other.
    fn of_senses(settings: &Settings) -> Result<Self, SettingError> {
        Ok(Self { same: Same::Senses, ..Self::new(settings)? })
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
            Event::Command(command) => self.ends.requests.send(Request::Command(*command)),
            Event::Raised(fault) => self.ends.requests.send(Request::Raise(*fault)),
            Event::Plan(status) => return self.plan(status),
            Event::Supervised if std::mem::take(&mut self.early) => {}
            Event::Supervised => self.run_supervision(),
            Event::Tick(input, counters, status) => return self.tick(input, counters, status),
        }
        Ok(())
    }

    /// The supervision's millisecond.
    fn run_supervision(&mut self) {
        let waited = self.core.signals.waiting.is_set();
        self.core.signals.waiting.clear();
        // Whether a host is silent is not recorded.
        self.core.host_is_alive();
        self.core.ports.period.set(true);
        self.core.supervise.tick();
        self.found |= self.core.signals.waiting.is_set();
        if waited {
            self.core.signals.waiting.set();
        }
    }

    /// Shows what the chip saw.
    fn show(&self, input: &TickInput, counters: &Counters) {
        let ports = self.core.ports;
        self.core.published.replay(&Snapshot { raw: input.encoder, ..counters.used });
        ports.now.set(input.encoder.now);
        if let Some(watch) = counters.watch {
            ports.timer.set(watch.count);
            ports.timer_read_at.set(Some(watch.now));
        }
        ports.pulse_counts.set(counters.pulses);
        ports.drive_stands.set(counters.drive_stands);
        ports.safety.set(input.safety.unwrap_or_default());
        ports.codes.set(input.drive);
        ports.retreats.set(ports.retreats.get().wrapping_add(input.reflex.into()));
    }

    fn tick(&mut self, input: &TickInput, counters: &Counters, there: &Status) -> Result<(), String> {
        self.ticks += 1;
        if input.reported.is_some() && !self.found {
            self.run_supervision();
            self.early = true;
        }
        self.found &= input.reported.is_none();
        self.show(input, counters);
        self.core.reports();
        if let Some(point) = input.set_point {
            // One that has come already releases it.
            self.ends.previews.write(|preview| *preview = (Some(point), u32::MAX));
        }
        let waiting = &self.core.signals.waiting;
        let waited = waiting.is_set();
        if input.asked {
            waiting.set();
        } else {
            waiting.clear();
        }
        self.core.servo.tick();
        if waited && !input.asked {
            self.core.signals.waiting.set();
        }
        let seen = self.core.servo.input();
        let reported = seen.reported;
        // The first tick comes late, and a block may come while it runs: its reading is of that, and this of the one before.
        if self.ticks > 1 {
            self.compare("short", &(seen.short_ticks, seen.touches), &(input.short_ticks, input.touches))?;
        }
        let mut here = Status::default();
        self.core.servo.follower().report(&mut here);
        self.compare("count", &here.position, &there.position)?;
        if self.same == Same::Senses {
            return Ok(());
        }
        self.compare("fault reported", &reported, &input.reported)?;
        self.compare("tick", &here.tick, &there.tick)?;
        let motion = |s: &Status| (s.position, s.velocity.0.to_bits(), s.following.to_bits(), s.saturated);
        self.compare("motion", &motion(&here), &motion(there))?;
        self.compare("setpoint", &(here.setpoint, here.path), &(there.setpoint, there.path))?;
        self.compare("duty", &here.duty.to_bits(), &there.duty.to_bits())
            .map_err(|e| format!("{e}; {input:?}; natively {here:?}; on the chip {there:?}"))
    }

    fn plan(&mut self, there: &Status) -> Result<(), String> {
        if !self.core.ports.wanted(PLAN) && self.same == Same::Bits {
            return Err(format!("tick {}: the chip has made a plan that nothing requested natively", self.ticks));
        }
        self.core.plan.run();
        while self.ends.answers.receive().is_some() {}
        while self.ends.changes.receive().is_some() {}
        while self.ends.commissioned.receive().is_some() {}
        let here = *self.core.plan.planner().status();
        if self.same == Same::Senses {
            let voltage = (here.gap.filtered.0 - there.gap.filtered.0).abs();
            self.compare("quality of the gap", &here.gap.quality, &there.gap.quality)?;
            return self.compare("gap within the tolerance", &(voltage <= GAP_TOLERANCE), &true);
        }
        self.compare("state", &(here.tick, here.state, here.fault), &(there.tick, there.state, there.fault))?;
        self.compare("gap", &bits(&here.gap), &bits(&there.gap))?;
        self.compare("pulses", &here.gap.pulses, &there.gap.pulses)?;
        self.compare(
            "planned",
            &(here.position, here.setpoint, here.path),
            &(there.position, there.setpoint, there.path),
        )?;
        let drive = |s: &Status| (s.current.0.to_bits(), s.bus.0.to_bits(), s.open_circuit.0.to_bits());
        self.compare("drive", &drive(&here), &drive(there))
    }

    /// What the native head knows after its newest plan.
    pub fn status(&self) -> &Status {
        self.core.plan.planner().status()
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

fn bits(reading: &GapReading) -> (u32, u32, Quality, bool, u32) {
    (reading.filtered.0.to_bits(), reading.block.0.to_bits(), reading.quality, reading.touches, reading.short_ticks)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::process::{Plant, Process};
    use edm_servo_head::head::State;

    /// What a head sees that is enabled, and whose bus voltage sags: the supervision finds that.
    fn day(seed: u64) -> Vec<Event> {
        let settings = Settings { commissioned: true, ..Settings::default() };
        let mut process = Process::new(Plant::default(), seed).unwrap();
        let (mut core, others) = Core::new(&settings.build().unwrap(), &process);
        let mut ends = others.host.ends;
        let (mut events, mut enabled) = (Vec::new(), None);
        for period in 0..10_000 {
            if period == 1000 {
                ends.requests.send(Request::Command(Command::Enable));
                core.signals.waiting.set();
                enabled = Some(Command::Enable);
            }
            process.fault_inputs.bus_v = (period > 5000).then_some(20.0);
            core.host_is_alive();
            core.reports();
            let planned = core.plan.planner().status().tick;
            let supervised = core.tick(&mut process);
            events.push(Event::Block(Some(process.sensors().block)));
            events.push(Event::Tick(*core.input(), *core.servo.counters(), *core.status()));
            let status = core.plan.planner().status();
            if status.tick != planned {
                if let Some(command) = enabled.take() {
                    events.push(Event::Command(command));
                }
                events.push(Event::Plan(*status));
            }
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

    fn reported(events: &mut [Event]) -> &mut TickInput {
        let mut ticks =
            events.iter_mut().filter_map(|event| if let Event::Tick(input, ..) = event { Some(input) } else { None });
        ticks.find(|input| input.reported.is_some()).unwrap()
    }

    #[test]
    fn a_fault_of_the_supervision_is_found_here_too() {
        for seed in 0..10 {
            let mut events = day(seed);
            assert_eq!(reported(&mut events).reported, Some(Fault::BusSag));
            assert_eq!(replay(&events), Ok(10_000), "seed {seed}");
        }
    }

    #[test]
    fn a_fault_that_the_supervision_finds_on_one_side_alone_is_a_difference() {
        let events = day(1);
        for spoilt in [None, Some(Fault::FollowingError)] {
            let mut another = events.clone();
            reported(&mut another).reported = spoilt;
            assert!(replay(&another).unwrap_err().contains("fault reported"), "{spoilt:?}");
        }
        // Long before its time.
        let mut early = events.clone();
        let tick = |event: &&mut Event| matches!(event, Event::Tick(..));
        let Some(Event::Tick(input, ..)) = early.iter_mut().filter(tick).nth(3000) else { unreachable!() };
        (input.reported, input.asked) = (Some(Fault::BusSag), true);
        assert!(replay(&early).unwrap_err().contains("fault reported"));
    }

    #[test]
    fn a_plan_that_the_chip_did_not_make_is_a_difference() {
        let mut events = day(2);
        let at = events.iter().rposition(|event| matches!(event, Event::Plan(_))).unwrap();
        let extra = events[at];
        events.insert(at + 1, extra);
        assert!(replay(&events).unwrap_err().contains("nothing requested natively"));
    }
}
