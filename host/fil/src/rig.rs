//! The modelled head as a rig to bore with: the firmware on the model of the chip, the model of the chip on the bench, the
//! host on the bus, and the witness that compares or records the inputs of the chip ([`edm_sim::lockstep`]).

use crate::bench::{Bench, WINDOW};
use crate::commission::commission;
use crate::host::{self, Bus};
use crate::image::Image;
use crate::machine::Machine;
use crate::rtt::Rtt;
use crate::seen::{Places, Pulses, Runs};
use crate::wires::CRYSTAL_HZ;
use anyhow::{Result, anyhow, bail};
use edm_hal_shim::bridge::Drive;
use edm_hal_shim::gap::GapBlock;
use edm_servo_head::head::{Change, Command, Reason, SetPoint, State, Status};
use edm_servo_head::settings::Settings;
use edm_servo_head::technology::Pulse;
use edm_servo_head::units::Nanometres;
use edm_sim::commanded::Sdo;
use edm_sim::lockstep::{Event, Recorder, Twin};
use edm_sim::machine::Rig;
use edm_sim::process::{Plant, Process};
use edm_sim::run::{Job, Observer, Outcome, Progress};
use edm_soc::{CanReply, Frame, Region, TICK_HZ};
use edm_technology::File;
use std::collections::VecDeque;

/// Longest start of the firmware, ticks: the first period of the PWM comes within.
const START: u64 = TICK_HZ / 10;
/// Windows between two heartbeats of the host, and windows of a millisecond.
const LIFE: u64 = 2000;
const MS: u64 = 20;
/// Windows between two reads of the firmware's log.
const LOG: u64 = 100;
/// Factor on the time of thread mode: a round of the idle loop costs host time and finds nothing.
const STRETCH: u64 = 100;
/// Exceptions of the servo task, TIM1_UP, and of the gap task, DMA2_STREAM0.
const SERVO: usize = 16 + 25;
const GAP: usize = 16 + 56;
/// Where in a window its tick is read, ticks: when the longest has ended, and well before the next block is complete
/// (44 us, 7392 ticks). Time that passes by blocks of code may overshoot this: by 691 ticks in the settings, in a block with 36 divisions.
const LOOK: u64 = 6200;
/// Ticks between two looks at a plan under way: 1 us, and no plan takes less than ten.
const PLAN: u64 = 168;
/// Time that the first, late tick is given, ticks: 15 us.
const FIRST: u64 = 2600;
/// Counter of TIM1.
const TIM1_CNT: u32 = 0x4001_0024;

/// Receiver of the chip's inputs and results.
pub enum Witness {
    /// None.
    None,
    /// The native core, which must give the same results at every tick.
    Twin(Box<Twin>),
    /// A recording.
    Recorder(Box<Recorder<Vec<u8>>>),
}

impl Witness {
    /// A native core with the settings of the board.
    ///
    /// # Errors
    /// When the settings contradict each other.
    pub fn twin(settings: &Settings) -> Result<Self> {
        Ok(Witness::Twin(Box::new(Twin::new(settings).map_err(|e| anyhow!("{e}"))?)))
    }

    fn event(&mut self, event: &Event) -> Result<()> {
        match self {
            Witness::None => Ok(()),
            Witness::Twin(twin) => twin.event(event).map_err(|e| anyhow!("chip and native core differ: {e}")),
            Witness::Recorder(recorder) => Ok(recorder.event(event)?),
        }
    }
}

/// A rig at a moment.
pub struct Snapshot {
    machine: crate::machine::Snapshot<Bench>,
    end: u64,
    windows: u64,
}

/// The firmware on the chip on the bench.
pub struct Emulated {
    machine: Machine<Bench>,
    rtt: Rtt,
    /// Whether to print the firmware's log.
    pub log: bool,
    /// Whether the host gives signs of life.
    pub host_alive: bool,
    places: Places,
    /// Each tick is read, and must come.
    watched: bool,
    /// Servo ticks so far.
    ticked: u64,
    /// What an unwatched head has logged.
    logged: Vec<String>,
    /// Idle changes the flash; it has done so since the last query.
    stores: bool,
    stored: bool,
    witness: Witness,
    /// Where the present window is read.
    end: u64,
    /// Runs of the gap task so far.
    blocks: u64,
    status: Status,
    /// Tick that the supervision has monitored last, and that of the estimate of the newest plan.
    monitored: u32,
    made: u32,
    /// Ticks that have to wait for a plan which was begun before them, and what came after them.
    held: Vec<Event>,
    /// Plans that were late, and whether the one under way is: it is over for the ticks that wait for it, and comes behind them.
    late: u32,
    missed: bool,
    /// True count at the beginning of the window, where the servo task reads the encoder.
    count: i64,
    changes: VecDeque<Change>,
    /// Frames of the head, and when they ended.
    came: VecDeque<(u64, Frame)>,
    /// Commands that the newest plan carried out, and the set point that a SYNC released in the newest tick.
    executed: Vec<Command>,
    released: Option<SetPoint>,
    windows: u64,
}

impl Emulated {
    /// Powers up a board that was commissioned with `settings`, and waits until its servo ticks.
    ///
    /// # Errors
    /// When the firmware does not start, or is not built from the sources of this program.
    pub fn start(image: &Image, plant: Plant, settings: &Settings, seed: u64, witness: Witness) -> Result<Self> {
        let mut rig = Self::power_up(image, plant, seed, witness, |flash| commission(flash, settings))?;
        // A pause begins and ends within a window.
        rig.machine.soc().world.exact = settings.build().is_ok_and(|active| active.pause.pauses());
        Ok(rig)
    }

    /// Powers up a board whose flash `prepare` has written, and waits until its servo ticks.
    ///
    /// # Errors
    /// As [`Emulated::start`].
    pub fn power_up(
        image: &Image,
        plant: Plant,
        seed: u64,
        witness: Witness,
        prepare: impl FnOnce(&Region) -> Result<()>,
    ) -> Result<Self> {
        let places = Places::find(image)?;
        let bench = Bench::new(&plant, seed).map_err(|e| anyhow!(e))?;
        let mut machine = Machine::new(image, bench, CRYSTAL_HZ)?;
        prepare(&machine.soc().memory.flash)?;
        let mut rig = Self {
            machine,
            rtt: Rtt::new(image)?,
            log: false,
            host_alive: true,
            places,
            watched: true,
            ticked: 0,
            logged: Vec::new(),
            stores: false,
            stored: false,
            witness,
            end: 0,
            blocks: 0,
            status: Status::default(),
            monitored: 0,
            made: 0,
            held: Vec::new(),
            late: 0,
            missed: false,
            count: 0,
            changes: VecDeque::new(),
            came: VecDeque::new(),
            executed: Vec::new(),
            released: None,
            windows: 0,
        };
        rig.boot(&plant, seed)?;
        Ok(rig)
    }

    /// Runs until the servo interrupt has come, then lets the bench's windows begin with the periods of TIM1.
    fn boot(&mut self, plant: &Plant, seed: u64) -> Result<()> {
        // Finely: the first tick comes late, as soon as interrupts are let in, and the second at the next period.
        while self.machine.stats().entries[SERVO] == 0 {
            let next = self.machine.soc().now() + WINDOW / 256;
            if next > START {
                self.log = true;
                self.print_log();
                bail!("the firmware does not reach its first servo tick");
            }
            self.machine.run_until(next)?;
            while self.machine.stats().entries[GAP] != self.blocks {
                // Each block, once the task that has begun on it has ended: the next run may follow at once.
                let run = self.blocks + 1;
                while self.machine.soc().nvic().active() >> GAP & 1 == 1 && self.machine.stats().entries[GAP] == run {
                    let next = self.machine.soc().now() + 8;
                    self.machine.run_until(next)?;
                }
                self.tell_block(run)?;
            }
        }
        let soc = self.machine.soc();
        let count = soc.read(TIM1_CNT, 4)?;
        let period = soc.now() - u64::from(count);
        // The process starts anew, so that its time is that of a native run.
        soc.world.mount(plant, seed).map_err(|e| anyhow!(e))?;
        soc.world.align(period + WINDOW);
        soc.world_changed();
        // The first tick comes late: the next block may be there before it hands its estimate over.
        let end = self.machine.soc().now() + FIRST;
        let had = self.places.reading(&self.machine.soc().memory)?;
        let mut before = None;
        // It may come so late that the second follows at once.
        while self.machine.soc().now() < end && self.machine.stats().entries[SERVO] == 1 {
            let next = self.machine.soc().now() + 8;
            self.machine.run_until(next)?;
            let came = self.machine.stats().entries[GAP] != self.blocks;
            let taken = self.places.reading(&self.machine.soc().memory)? != had;
            before = before.or((came || taken).then_some(!taken));
        }
        self.machine.step_by_blocks()?;
        self.machine.stretch_idle(STRETCH);
        if before == Some(true) {
            self.look_at_block()?;
        }
        self.look()?;
        self.look_at_block()?;
        self.end = period + LOOK;
        Ok(())
    }

    /// One window; the head's status is then that of its tick.
    fn window(&mut self) -> Result<()> {
        self.windows += 1;
        let soc = self.machine.soc();
        if self.host_alive && self.windows.is_multiple_of(LIFE) {
            let at = soc.now() + WINDOW / 2;
            soc.world.send(at, host::heartbeat());
            soc.world_changed();
        }
        self.count = soc.world.process.truth().count;
        self.end += WINDOW;
        self.executed.clear();
        if self.watched {
            self.end_plan()?;
        }
        self.machine.run_until(self.end)?;
        let soc = self.machine.soc();
        self.came.extend(soc.world.sent.drain(..));
        if self.windows.is_multiple_of(LOG) {
            self.print_log();
        }
        if !self.watched {
            return self.pace();
        }
        // A round of idle that changes the flash takes its time.
        let busy = self.places.write_permitted(&self.machine.soc().memory)?;
        self.machine.stretch_idle(if busy { 1 } else { STRETCH });
        self.stored |= self.stores && !busy;
        self.stores = busy;
        self.look_at_block()?;
        self.look()
    }

    /// Idle of a head that ticks may pass quickly; whatever else runs in thread mode takes its time.
    fn pace(&mut self) -> Result<()> {
        let ticked = self.machine.stats().entries[SERVO];
        let ticks = std::mem::replace(&mut self.ticked, ticked) != ticked;
        let stores = self.places.write_permitted(&self.machine.soc().memory).unwrap_or(true);
        self.machine.stretch_idle(if ticks && !stores { STRETCH } else { 1 });
        Ok(())
    }

    /// From now on ticks are not read: tasks may stop, and the chip may be reset.
    pub fn unwatched(&mut self) {
        self.watched = false;
        self.witness = Witness::None;
    }

    /// A rig that is not watched, as it is now.
    ///
    /// # Errors
    /// When the engine refuses.
    pub fn snapshot(&self) -> Result<Snapshot> {
        Ok(Snapshot { machine: self.machine.snapshot()?, end: self.end, windows: self.windows })
    }

    /// Goes back to a moment of this rig.
    ///
    /// # Errors
    /// When the engine refuses.
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<()> {
        self.machine.restore(&snapshot.machine)?;
        (self.end, self.windows, self.ticked) = (snapshot.end, snapshot.windows, 0);
        self.host_alive = true;
        self.came.clear();
        self.rtt.forget();
        self.logged.clear();
        Ok(())
    }

    /// Log of an unwatched head since the last call.
    pub fn logged(&mut self) -> Vec<String> {
        std::mem::take(&mut self.logged)
    }

    /// Reports a plan that was under way when the last tick was read, as soon as it has ended: an urgent one may follow it, and
    /// end, before the next is read.
    fn end_plan(&mut self) -> Result<()> {
        let [begun, mut made, _] = self.places.plans(&self.machine.soc().memory)?;
        if begun == made {
            return Ok(());
        }
        while begun != made {
            let next = self.machine.soc().now() + PLAN;
            if next >= self.end {
                return Ok(());
            }
            self.machine.run_until(next)?;
            made = self.places.plans(&self.machine.soc().memory)?[1];
        }
        if self.places.late(&self.machine.soc().memory)? != self.late {
            // The tick that it has missed comes before it, and is read next.
            return Ok(());
        }
        let planned = self.places.planned(&self.machine.soc().memory)?;
        let plan = self.take_plan(made, planned)?;
        let held = std::mem::take(&mut self.held);
        if std::mem::take(&mut self.missed) {
            return self.report(held.into_iter().chain(plan));
        }
        self.report(plan.into_iter().chain(held))
    }

    /// What a plan that has ended has carried out, and what it has found.
    fn take_plan(&mut self, made: u32, planned: Status) -> Result<Vec<Event>> {
        let memory = &self.machine.soc().memory;
        let raised = self.places.raised(memory, made)?;
        self.executed = self.places.commands(memory, made)?;
        self.made = made;
        let commands = self.executed.iter().map(|command| Event::Command(*command));
        Ok(commands.chain(raised.map(Event::Raised)).chain([Event::Plan(planned)]).collect())
    }

    /// Reads inputs and results of the tick of this window.
    fn look(&mut self) -> Result<()> {
        let before = self.status;
        let memory = &self.machine.soc().memory;
        let planned = self.places.planned(memory)?;
        let mut status = planned;
        self.places.followed(memory, &mut status)?;
        let (input, counters) = (self.places.input(memory)?, self.places.counters(memory)?);
        let [begun, made, known] = self.places.plans(memory)?;
        let monitored = self.places.monitored(memory)?;
        let stores = before.state == State::Disabled && status.state == State::Disabled;
        if status.tick != before.tick.wrapping_add(1) && matches!(self.witness, Witness::None) && stores {
            // The processor stalls while the flash is erased, and only a disabled head is allowed to.
            self.status = status;
            return Ok(());
        }
        if status.tick != before.tick.wrapping_add(1) {
            let (now, was) = (status.tick, before.tick);
            bail!("tick {now} follows {was}, {:.6} s after power-up: the servo task has missed one", self.seconds());
        }
        if let (None, Some(fault)) = (before.fault, status.fault) {
            let reason = Reason::Fault(fault);
            self.changes.push_back(Change { tick: status.tick, from: before.state, to: status.state, reason });
        }
        self.released = input.set_point;
        let late = self.places.late(memory)?;
        self.missed |= std::mem::replace(&mut self.late, late) != late;
        let ended = made != self.made;
        let plan = if ended { self.take_plan(made, planned)? } else { Vec::new() };
        // What a task does is reported at its end: before this tick, if it was about one before it.
        let mut before = std::mem::take(&mut self.held);
        let mut after = Vec::new();
        if made == status.tick || ended && std::mem::take(&mut self.missed) {
            after = plan;
        } else {
            before.splice(..0, plan);
        }
        if monitored != self.monitored {
            // The plan may have come in between.
            let planned = ended && known != monitored;
            match (monitored == status.tick, made == status.tick && planned) {
                (_, true) => after.push(Event::Supervised),
                (true, false) => after.insert(0, Event::Supervised),
                (false, false) if planned || !ended => before.push(Event::Supervised),
                (false, false) => before.insert(0, Event::Supervised),
            }
        }
        let waits = begun != made && begun != status.tick;
        if ended {
            // What is held from here on waits for the next plan.
            self.report(before.drain(..))?;
        }
        before.push(Event::Tick(input, counters, status));
        before.extend(after);
        if waits {
            self.held = before;
        } else {
            self.report(before.into_iter())?;
        }
        self.monitored = monitored;
        self.status = status;
        Ok(())
    }

    fn report(&mut self, mut events: impl Iterator<Item = Event>) -> Result<()> {
        events.try_for_each(|event| self.witness.event(&event))
    }

    /// Reports the newest block to the witness, if the gap task has run since the last one.
    fn look_at_block(&mut self) -> Result<()> {
        let runs = self.machine.stats().entries[GAP];
        if runs > self.blocks + 1 {
            bail!("the gap task has run {} times in a tick", runs - self.blocks);
        }
        if runs == self.blocks { Ok(()) } else { self.tell_block(runs) }
    }

    /// Reports to the witness the block that run `run` of the gap task has left.
    fn tell_block(&mut self, run: u64) -> Result<()> {
        self.blocks = run;
        if let Witness::None = self.witness {
            return Ok(());
        }
        let block = self.places.block(&self.machine.soc().memory)?;
        let block = Event::Block(block);
        if self.held.is_empty() {
            return self.witness.event(&block);
        }
        // The tick before it has not been reported yet.
        self.held.push(block);
        Ok(())
    }

    /// Time since power-up.
    fn seconds(&mut self) -> f64 {
        self.machine.soc().now() as f64 / TICK_HZ as f64
    }

    /// Prints what the firmware has logged since the last time, if requested.
    fn print_log(&mut self) {
        let lines = self.rtt.poll(&self.machine.soc().memory);
        if !self.watched {
            self.logged.extend(lines);
        } else if self.log {
            let s = self.seconds();
            lines.iter().for_each(|line| println!("{s:10.6} {line}"));
        }
    }

    /// Gives the witness back.
    pub fn into_witness(self) -> Witness {
        self.witness
    }

    /// Machine and process, to pull wires between two ticks.
    pub fn process_mut(&mut self) -> &mut Process {
        &mut self.machine.soc().world.process
    }

    /// Sends a frame that ends so long from now, or as soon as the bus is free; gives the time of its end.
    pub fn send_at(&mut self, after: u64, frame: Frame) -> u64 {
        let soc = self.machine.soc();
        let at = soc.now() + after;
        let end = soc.world.send(at, frame);
        soc.world_changed();
        end
    }

    /// What becomes of the head's frames from now on.
    pub fn reply(&mut self, reply: CanReply) {
        self.machine.soc().world.reply = reply;
    }

    /// The oldest frame of the head that has not been taken, and when it ended.
    pub fn take_timed(&mut self) -> Option<(u64, Frame)> {
        self.came.pop_front()
    }

    /// Commands that the newest tick carried out, and when that tick began.
    pub fn executed(&self) -> (u64, &[Command]) {
        (self.end - LOOK, &self.executed)
    }

    /// The set point that a SYNC released in the newest tick.
    pub fn released(&self) -> Option<SetPoint> {
        self.released
    }

    /// What the tasks run, read from their memory.
    ///
    /// # Errors
    /// When there is no memory.
    pub fn runs(&mut self) -> Result<Runs> {
        self.places.runs(&self.machine.soc().memory)
    }

    /// Pulses that the tasks have counted.
    ///
    /// # Errors
    /// When there is no memory.
    pub fn pulses(&mut self) -> Result<Pulses> {
        self.places.pulses(&self.machine.soc().memory)
    }

    /// The newest block that the gap task has taken.
    ///
    /// # Errors
    /// When there is no memory.
    pub fn block(&mut self) -> Result<Option<GapBlock>> {
        self.places.block(&self.machine.soc().memory)
    }

    /// When the present window began.
    pub fn window_began(&self) -> u64 {
        self.end - LOOK
    }

    /// Whether the firmware has changed its flash since the last call.
    pub fn has_stored(&mut self) -> bool {
        std::mem::take(&mut self.stored)
    }

    /// The chip's flash.
    pub fn flash(&mut self) -> &Region {
        &self.machine.soc().memory.flash
    }

    /// What the reflex has forced the bridge to.
    pub fn forced(&mut self) -> &mut Vec<Drive> {
        &mut self.machine.soc().world.forced
    }

    /// Records from now on when each interrupt is served.
    pub fn record_spans(&mut self) {
        self.machine.record_spans();
    }

    /// Chip and bench, to break something.
    pub fn machine_mut(&mut self) -> &mut Machine<Bench> {
        &mut self.machine
    }

    /// Runs until `reached`, for `patience` ticks of the chip at most; whether it was. The windows go on behind.
    ///
    /// # Errors
    /// What the machine refuses.
    pub fn until(&mut self, mut reached: impl FnMut(&mut Machine<Bench>) -> bool, patience: u64) -> Result<bool> {
        let limit = self.machine.soc().now() + patience;
        while !reached(&mut self.machine) {
            let next = self.machine.soc().now() + 40;
            if next > limit {
                return Ok(false);
            }
            self.machine.run_until(next)?;
        }
        Ok(true)
    }

    /// Where the tasks keep the numbers that they run: whose, and the address of each setting of four bytes.
    ///
    /// # Errors
    /// When there is no memory.
    pub fn settings_in_use(&mut self) -> Result<[(&'static str, Vec<u32>); 4]> {
        self.places.settings_in_use(&self.machine.soc().memory)
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

    fn carry(&mut self, mm: f64) {
        self.process_mut().fault_inputs.carried_mm = mm;
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
        host::command(self, command).map_err(|e| format!("{e:#}"))
    }

    fn erode_by(&mut self, table: &File, to: Nanometres) -> Result<(), String> {
        let to = host::counts(self, to).map_err(|e| format!("{e:#}"))?;
        edm_sim::commanded::erode_by(self, table, i64::from(to.cast_signed()))
    }

    fn row(&mut self) -> Result<Option<u8>, String> {
        let mut read = |sub| Sdo::read(self, 0x201C, sub);
        let (phase, row) = (read(6)?, read(5)?);
        let pulse = Pulse { on_ns: read(15)?, off_ns: read(16)?, current_ma: read(17)?, polarity: read(18)? as u8 };
        self.process_mut().set_generator(&pulse);
        Ok(edm_sim::commanded::row_of(phase, row))
    }

    fn limit_feed(&mut self, settings: &Settings) -> Result<(), String> {
        host::write(self, 0x2102, 9, settings.feed_max.to_bits(), 4).map_err(|e| format!("{e:#}"))
    }
}

impl Sdo for Emulated {
    fn write(&mut self, index: u16, sub: u8, value: u32, size: u8) -> Result<(), String> {
        host::write(self, index, sub, value, size).map_err(|e| format!("{e:#}"))
    }

    fn read(&mut self, index: u16, sub: u8) -> Result<u32, String> {
        host::read(self, index, sub).map_err(|e| format!("{e:#}"))
    }
}

impl Bus for Emulated {
    fn send(&mut self, frame: Frame) {
        self.send_at(WINDOW / 2, frame);
    }

    fn pass(&mut self) -> Result<()> {
        (0..MS).try_for_each(|_| self.window())
    }

    fn take(&mut self) -> Option<Frame> {
        self.came.pop_front().map(|(_, frame)| frame)
    }
}

/// Bores a hole with the firmware in `image`: the counterpart of [`edm_sim::bore::bore`].
///
/// # Errors
/// When the run cannot be made.
pub fn bore(
    image: &Image,
    log: bool,
    lockstep: bool,
    job: &Job,
    observer: &mut impl Observer,
    progress: &mut dyn FnMut(&Progress),
) -> Result<Outcome, String> {
    if job.surrogate {
        return Err("--surrogate: the dry loop has no gap signal for a converter; it runs with `cargo sim bore`".into());
    }
    // Commissioning counts as passed, as in the native run: it needs an axis without a workpiece.
    let settings = Settings { commissioned: true, ..job.setup.head };
    let witness = if lockstep { Witness::twin(&settings) } else { Ok(Witness::None) };
    let mut rig = witness
        .and_then(|witness| Emulated::start(image, job.setup.process, &settings, job.seed, witness))
        .map_err(|e| format!("{e:#}"))?;
    rig.log = log;
    rig.process_mut().schedule(&job.setup.events);
    host::begin(&mut rig).map_err(|e| format!("{e:#}"))?;
    edm_sim::bore::run(job, &mut rig, observer, progress)
}
