//! The drive: a head as a CiA 402 device (IEC 61800-7-201) with EDM objects, behind a [`Node`].
//!
//! The drive keeps what the profile needs (state machine, modes, the values that a host writes) and nothing that the head
//! knows already: actual values come from the newest [`Status`], settings are a [`Settings`], and whatever is to happen is
//! an [`Order`]. It waits for nobody, so the same code runs in the protocol task of the chip, where orders and status go
//! through queues, and next to the head on a PC. Every millisecond, in this sequence:
//!
//! ```text
//! drive.observe(status)                    newest status of the head; changed(change) for each change of state,
//!                                          checked(result) when commissioning has ended
//! drive.answered(command, result)          for each command carried out since, if that was not done at once
//! node.receive(frame, at, &mut drive)      for each frame that came
//! node.synchronised(tick, &mut drive)      before orders are taken: set points of the last SYNC
//! node.poll(now, &mut drive)
//! drive.poll(now, &mut node)               emergencies, interpolation
//! while let Some(order) = drive.take()     see [`Order`]
//! while let Some(frame) = node.take()      to the bus
//! ```
//!
//! Where ticks do not wait for the drive, as on the chip, the head holds ready what [`Drive::preview_sync`] gives it, acts on a
//! SYNC by itself, and [`Drive::synchronised`] follows [`Node::synchronised`].
//!
//! [`DEVICE`] is what the node is made with. A silent host shows in 1016h, SYNC or the event timer of an RPDO, and the drive raises
//! the fault; to the head's supervision the host is always alive.

mod codes;
mod configuration;
mod datum;
mod device;
mod emergencies;
mod erosion;
mod exchange;
mod fast;
mod identify;
mod machine;
mod modes;
mod orders;
mod pace;
mod probe;
mod resume;
mod saves;
mod scope;
mod segment;
mod state;
mod steps;
mod stored;
mod teach;
mod technology;
mod tune;
mod values;

pub use device::DEVICE;
pub use exchange::{Generations, Identity, Lost, Order, SetPoint, TASKS, TaskTimer};
pub use scope::{BLANK, Record};
pub use state::State;
pub use technology::Phase as TechnologyPhase;

#[cfg(not(target_os = "none"))]
pub use codes::{FINDINGS, LOSSES, REASONS, REFUSALS, WAIT, error_code};

use super::objects::{COUNT, Item, rows};
use super::{Event, NmtState, Node, Time};
use crate::gap::pulses::CLASSES;
use crate::gap::senses::delays::Delays;
use crate::gap::voltage;
use crate::head::{self, Command, Contradiction, Fault, PROBES, Probe, Status};
use crate::path::AHEAD;
use crate::settings::{Active, SettingError, Settings};
use crate::stored::{LoadReport, StoredImage};
use crate::units::Fixed;
use core::mem::MaybeUninit;
use datum::Datum;
use fast::Fast;
use heapless::Deque;
use identify::Found;
use modes::{Mode, SetPoints};
use orders::ORDERS;
use pace::Pace;
use resume::Resume;
use saves::Saves;
use scope::Scope;
use segment::Segment;
use steps::Steps;
use stored::{Loading, Loss};
use teach::Teach;
use technology::Technology;
use tune::Tuned;

/// Velocity below which an axis counts as standing, counts/s.
const STANDING: f32 = 1000.0;

/// Ignition delays: of now, at the last take, and between the last two takes.
#[derive(Clone, Copy, Debug, Default)]
struct Histogram {
    now: Delays,
    then: Delays,
    taken: Delays,
}

impl Histogram {
    fn take(&mut self) {
        for ((taken, then), now) in self.taken.iter_mut().zip(&self.then).zip(&self.now) {
            *taken = now.wrapping_sub(*then);
        }
        self.then = self.now;
    }
}

/// A head as a CiA 402 drive. See the [module](self).
#[derive(Debug)]
pub struct Drive {
    settings: Settings,
    active: Active,
    identity: Identity,
    timers: [TaskTimer; TASKS],
    status: Status,
    values: [i32; COUNT],
    orders: Deque<Order, ORDERS>,
    /// Newest set point of a stream: only the newest counts, and nothing waits for its answer.
    follow: Option<SetPoint>,
    /// What the head follows by itself from the next SYNC on.
    sync_preview: Option<SetPoint>,
    /// Settings that the head runs; those of [`Drive::settings`] are on their way to it.
    running: Settings,
    generations: Generations,
    /// What was lost.
    lost: Lost,
    /// Looks at pulses of each class, of the last 200 ms.
    looks: [u32; CLASSES],
    delays: Histogram,
    /// Pauses begun.
    pauses: u32,
    steps: Steps,
    /// Frequency of the notch, 0.01 Hz, and whether it follows the mains.
    mains: (u16, bool),
    /// The settings come from a reset and are not a host's write, which could be taken back.
    restarting: bool,
    /// A configuration was ordered and has not come back: there is no other until then.
    configuring: bool,
    /// The head does not run the newest settings: they are ordered when it is disabled.
    stale: bool,
    /// Changes of guarded settings times 2^24, and the address of the last.
    guarded: u32,
    /// Commands taken and not answered, set points of a stream apart.
    in_flight: u8,
    /// The status is newer than every command.
    fresh: bool,

    state: State,
    /// The loop has been ordered closed.
    enabling: bool,
    /// Commissioning has been ordered, and the status is not newer.
    commissioning: bool,
    /// State to go to once the axis stands.
    leaving: Option<State>,
    control: u16,
    /// Milliseconds in a fault's reaction, or of braking.
    elapsed: u16,
    alarm: Option<Fault>,
    /// What was lost of what is stored, until a host has acknowledged it.
    loss: Option<Loss>,
    /// What the node has reported of both.
    reported: (Option<Fault>, Option<Loss>),
    loading: Loading,

    mode: Mode,
    /// What the touch probes are to do.
    probes: [Probe; PROBES],
    /// State of network management.
    operational: bool,
    set_points: SetPoints,

    /// Path coordinate at which the retreat under way began; none once it was counted as long.
    retreat: Option<Fixed>,
    retreating: bool,
    eroding: bool,
    /// Long retreats before this erosion.
    retreats_before: u32,
    appended: u32,
    /// The segment that a host writes.
    segment: Segment,
    datum: Datum,
    /// Not begun anew with the drive either: a reset is what it is for.
    resume: Resume,
    teach: Teach,
    technology: Technology,
    found: Found,
    tuned: Tuned,
    /// Not begun anew with the drive: the flash remembers.
    saves: Saves,
    pace: Pace,
    reason: u8,
    refusal: u8,
    refusals: u8,
    finding: u8,
    stopped_by: u8,
    wrong: Option<(u16, u8, &'static str)>,
    /// What the guided check has measured instead.
    contradiction: Contradiction,
    scope: Scope,
    fast: Fast,
}

impl Drive {
    /// A drive for a disabled head that runs `settings`; its scope writes to `record`.
    ///
    /// # Errors
    /// The setting that stands in the way.
    pub fn new(settings: Settings, identity: Identity, record: &'static mut Record) -> Result<Drive, SettingError> {
        let mut drive = Self::of(settings.build()?, settings, identity, record);
        drive.load_defaults();
        Ok(drive)
    }

    /// The same in its place: on the way from [`Drive::new`] it would be on the stack twice, 5 KiB each.
    ///
    /// # Errors
    /// As [`Drive::new`].
    // In a frame of its own, that is off the stack again before anything else runs.
    #[inline(never)]
    pub fn new_in<'a>(
        slot: &'a mut MaybeUninit<Drive>,
        settings: Settings,
        identity: Identity,
        record: &'static mut Record,
    ) -> Result<&'a mut Drive, SettingError> {
        let drive = slot.write(Self::of(settings.build()?, settings, identity, record));
        drive.load_defaults();
        Ok(drive)
    }

    #[inline(always)]
    fn of(active: Active, settings: Settings, identity: Identity, record: &'static mut Record) -> Drive {
        Drive {
            settings,
            active,
            identity,
            timers: [TaskTimer::default(); TASKS],
            status: Status::default(),
            values: [0; COUNT],
            orders: Deque::new(),
            follow: None,
            sync_preview: None,
            running: settings,
            generations: Generations::default(),
            lost: Lost::default(),
            looks: [0; CLASSES],
            delays: Histogram::default(),
            pauses: 0,
            steps: Steps::default(),
            mains: (0, false),
            restarting: false,
            configuring: false,
            stale: false,
            guarded: 0,
            in_flight: 0,
            fresh: false,
            state: State::SwitchOnDisabled,
            enabling: false,
            commissioning: false,
            leaving: None,
            control: 0,
            elapsed: 0,
            alarm: None,
            loss: None,
            reported: (None, None),
            loading: Loading::default(),
            mode: Mode::None,
            probes: [Probe::default(); PROBES],
            operational: false,
            set_points: SetPoints::default(),
            retreat: None,
            retreating: false,
            eroding: false,
            retreats_before: 0,
            appended: 0,
            segment: Segment::default(),
            datum: Datum::default(),
            resume: Resume::default(),
            teach: Teach::default(),
            technology: Technology::default(),
            found: Found::default(),
            tuned: Tuned::NONE,
            saves: Saves::new(),
            pace: Pace::default(),
            reason: 0,
            refusal: 0,
            refusals: 0,
            finding: 0,
            stopped_by: 0,
            wrong: None,
            contradiction: Contradiction::default(),
            scope: Scope::new(record),
            fast: Fast::default(),
        }
    }

    /// Values of power-on, from what is stored and, where nothing is, the defaults and `settings`. The head is disabled. What
    /// of it could not be taken over is in what is returned and in 200Bh. If defaults or an older image are in force, there are
    /// an emergency and the warning bit as well, until the host stores anew or resets faults.
    pub fn restart(&mut self, settings: Settings, stored: &StoredImage) -> LoadReport {
        self.orders.clear();
        self.follow = None;
        self.set_points = SetPoints::default();
        (self.segment, self.datum) = (Segment::default(), Datum::default());
        self.forget_teaching();
        self.technology.forget();
        (self.control, self.leaving, self.enabling, self.mode) = (0, None, false, Mode::None);
        self.load_defaults();
        (self.restarting, self.stale) = (true, false);
        // Before the settings, which a head that is not disabled may refuse.
        self.order(Order::Command(Command::Disable));
        self.probes_off();
        let report = self.load(settings, stored);
        if self.state != State::Fault {
            self.state = State::SwitchOnDisabled;
        }
        report
    }

    /// The head begins with what [`Drive::active`] says, disabled: what [`Drive::restart`] has ordered is done.
    pub fn started(&mut self) {
        self.orders.clear();
        self.runs_configuration();
    }

    /// The settings.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// What the ticks are to run.
    pub fn active(&self) -> &Active {
        &self.active
    }

    /// State of the drive.
    pub fn state(&self) -> State {
        self.state
    }

    /// The statusword, 6041h.
    pub fn statusword(&self) -> u16 {
        self.status_bits()
    }

    /// Takes the times of the tasks, for 200Ah.
    pub fn set_timers(&mut self, timers: [TaskTimer; TASKS]) {
        self.timers = timers;
    }

    /// Which configuration each task runs, for 200Ch.
    pub fn set_generations(&mut self, generations: Generations) {
        self.generations = generations;
    }

    /// What was lost since power-up, for 200Dh.
    pub fn set_lost(&mut self, lost: Lost) {
        self.lost = lost;
    }

    /// Looks at pulses of each class, of the last 200 ms, for 200Fh.
    pub fn set_looks(&mut self, looks: [u32; CLASSES]) {
        self.looks = looks;
    }

    /// Pauses begun so far, modulo 2^31, for 2012h.
    pub fn set_pauses(&mut self, begun: u32) {
        self.pauses = begun;
    }

    /// Steps of a host so far, changes of their direction within one, and times that it changed too fast, for 2016h. Once a
    /// millisecond.
    pub fn set_steps(&mut self, [counted, turns, lost]: [u32; 3]) {
        self.steps.observe(counted, turns, lost);
    }

    /// One of the words that the gap source says in turns, for 2012h.
    pub fn set_slow(&mut self, turn: usize, word: u32) {
        match self.delays.now.get_mut(turn) {
            Some(count) => *count = word,
            None => self.mains = voltage::mains_of(word),
        }
    }

    /// Takes the newest status, once a millisecond.
    pub fn observe(&mut self, status: &Status) {
        if status.paths != self.status.paths {
            self.segment.begun_anew();
        }
        self.status = *status;
        self.pace.observe(status.position, status.tick, status.velocity);
        self.datum.observe(status, self.active.head.axis.nm_per_count);
        self.fresh = self.in_flight == 0 && self.orders.is_empty() && self.follow.is_none();
        if self.stale && !self.configuring && status.state == head::State::Disabled {
            self.stale = !self.configure();
        }
        self.watch_erosion();
        self.watch_hole();
        self.watch_fault();
        self.commissioning &= !self.fresh;
        if self.fresh {
            self.follow_head();
        }
        self.watch_technology();
        self.watch_mode();
        self.watch_guiding();
        self.watch_teaching();
        self.record();
    }

    /// Emergencies and interpolation, once a millisecond.
    pub fn poll(&mut self, now: Time, node: &mut Node) {
        self.interpolate(now);
        self.saves.poll(now);
        self.count_time(now);
        self.report_errors(node);
    }

    /// Set points become path.
    fn erodes(&self) -> bool {
        self.value(Item::ErodeEnable) == 1
    }

    /// A written value.
    fn value(&self, item: Item) -> i32 {
        self.values.get(item as usize).copied().unwrap_or(0)
    }

    fn set(&mut self, item: Item, value: i32) {
        if let Some(slot) = self.values.get_mut(item as usize) {
            *slot = value;
        }
    }

    fn load_defaults(&mut self) {
        let counters = [Item::Shorts, Item::LongRetreats, Item::ErodingTime, Item::Deepest, Item::Jumps];
        for (slot, row) in self.values.iter_mut().zip(rows()) {
            if !counters.contains(&row.item()) {
                *slot = row.default();
            }
        }
    }

    /// Position to a host, counts; saturates.
    fn position(&self) -> i32 {
        self.host_position(self.status.position)
    }

    fn standing(&self) -> bool {
        !self.status.state.positions() && self.status.velocity.0.abs() < STANDING
    }

    fn queue_space(&self) -> u16 {
        (AHEAD as u16).saturating_sub(self.status.waiting)
    }

    fn happened(&mut self, event: Event) {
        let operational = self.operational;
        match event {
            Event::State(state) => {
                self.operational = state == NmtState::Operational;
                // A host that works by SDO alone never made the node operational.
                if state == NmtState::Stopped || operational && !self.operational {
                    self.host_lost();
                }
            }
            Event::HeartbeatLost { .. } | Event::SyncLost | Event::ReceiveTimeout { .. } => self.host_lost(),
            Event::ResetNode => {
                self.operational = false;
                self.order(Order::ResetNode);
            }
            Event::ResetCommunication => {
                self.operational = false;
                self.host_lost();
                self.order(Order::ResetCommunication);
            }
        }
    }
}

fn clamp32(x: i64) -> i32 {
    x.clamp(i32::MIN.into(), i32::MAX.into()) as i32
}
