//! The drive: a head as a CiA 402 device (IEC 61800-7-201) with EDM objects, behind a [`Node`].
//!
//! The drive keeps what the profile needs (state machine, modes, the values that a host writes) and nothing that the head
//! knows already: actual values come from the newest [`Status`], settings are a [`Settings`], and whatever is to happen is
//! an [`Order`]. It waits for nobody, so the same code runs in the protocol task of the chip, where orders and status go
//! through queues, and beside the head on a PC. Every millisecond, in this sequence:
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
//! Where ticks do not wait for the drive, as on the chip, the head holds ready what [`Drive::preview_sync`] tells it, acts on a
//! SYNC by itself, and [`Drive::synchronised`] follows [`Node::synchronised`].
//!
//! [`DEVICE`] is what the node is made with. The head's supervision is told that the host is alive: a silent host shows in
//! 1016h, SYNC or the event timer of an RPDO, and the drive raises the fault.

mod codes;
mod datum;
mod machine;
mod modes;
mod pace;
mod probe;
mod saves;
mod scope;
mod segment;
mod state;
mod stored;
mod values;

pub use scope::{BLANK, Record};
pub use state::State;

#[cfg(not(target_os = "none"))]
pub use codes::{FINDINGS, LOSSES, REASONS, REFUSALS, WAIT, error_code};

use super::objects::{COUNT, Item, rows, setting_address_at};
use super::{Device, Event, Group, NmtState, Node, PDOS, PdoDefault, Time, mapped};
use crate::gap::pulses::CLASSES;
use crate::head::{
    self, Change, Command, Contradiction, Fault, Finding, HomingState, PROBES, Probe, Reason, Refused, Report, Status,
};
use crate::path::AHEAD;
use crate::settings::{Active, Declared, SettingError, Settings, place};
use crate::stored::{LoadReport, StoredImage};
use crate::units::{Fixed, Nanometres};
use datum::Datum;
use edm_hal_shim::self_test::SelfTest;
use heapless::Deque;
use modes::{Mode, SetPoints};
use pace::Pace;
use saves::Saves;
use scope::{Scope, Trigger};
use segment::Segment;
use state::control;
use stored::{Loading, Loss};

/// The head as a CANopen device: servo drive (402), with what it maps at first.
///
/// TPDO1 repeats every 50 ms and tells of a change at once, also of what is refused. TPDO3 is for a CNC that keeps the path itself: signed feed and
/// gap voltage.
pub const DEVICE: Device = Device {
    // Profile 402, servo drive.
    device_type: 0x0002_0192,
    name: "EDM servo head",
    hardware: "STM32F405",
    software: env!("CARGO_PKG_VERSION"),
    // Nobody's: no vendor-ID has been given to this project.
    vendor: 0,
    product: 1,
    revision: 0x0000_0002,
    heartbeat: 0,
    receive: [
        PdoDefault { valid: true, entries: &[mapped(0x6040, 0, 16)], ..PdoDefault::UNUSED },
        PdoDefault { valid: true, entries: &[mapped(0x607A, 0, 32)], ..PdoDefault::UNUSED },
        PdoDefault { valid: true, entries: &[mapped(0x60FF, 0, 32)], ..PdoDefault::UNUSED },
        PdoDefault { entries: &[mapped(0x60C1, 1, 32)], ..PdoDefault::UNUSED },
    ],
    transmit: [
        PdoDefault {
            valid: true,
            timer: 50,
            entries: &[mapped(0x6041, 0, 16), mapped(0x6061, 0, 8), mapped(0x2000, 4, 8), mapped(0x2000, 7, 8)],
            ..PdoDefault::UNUSED
        },
        PdoDefault {
            valid: true,
            transmission: 1,
            entries: &[mapped(0x6064, 0, 32), mapped(0x606C, 0, 32)],
            ..PdoDefault::UNUSED
        },
        PdoDefault {
            valid: true,
            inhibit: 20,
            timer: 100,
            entries: &[mapped(0x2004, 7, 32), mapped(0x2005, 1, 16), mapped(0x2000, 1, 8), mapped(0x2000, 3, 8)],
            ..PdoDefault::UNUSED
        },
        PdoDefault {
            inhibit: 20,
            timer: 100,
            entries: &[mapped(0x2004, 6, 32), mapped(0x2006, 1, 32)],
            ..PdoDefault::UNUSED
        },
    ],
};
const _: () = assert!(DEVICE.transmit.len() == PDOS);

/// What the drive wants done, in the order of [`Drive::take`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Order {
    /// A command to the head; its result goes to [`Drive::answered`].
    Command(Command),
    /// Give head, gap source, supervision, reflex and generator what [`Drive::active`] says now, then call
    /// [`Drive::runs_configuration`], or [`Drive::refused_configuration`] if the head refuses; in either case
    /// [`Node::written`]: a host may wait for it.
    Configure,
    /// Raise this fault.
    Raise(Fault),
    /// Store: [`StoredImage::keep`], under a [`WritePermit`](crate::head::WritePermit). Then [`Drive::stored`].
    Store(Group),
    /// Forget what is stored, from the next reset on: [`StoredImage::forget`]. Then [`Drive::stored`].
    Restore(Group),
    /// The host has reset the node: [`Drive::restart`] with what is stored, then [`Drive::boot`].
    ResetNode,
    /// The host has reset communication: [`Drive::boot`].
    ResetCommunication,
}

/// A set point of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SetPoint {
    /// Where.
    pub to: Nanometres,
    /// Servo ticks to reach it in.
    pub ticks: u32,
}

impl SetPoint {
    /// What the head is told.
    pub const fn command(self) -> Command {
        Command::Follow(self.to, self.ticks)
    }
}

/// What the drive cannot know by itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Identity {
    /// Cause of the last reset, as the chip names it: 2009h:1.
    pub reset_cause: u32,
    /// Build: 2009h:2.
    pub build: &'static str,
    /// What the board has found of itself: 2009h:3.
    pub self_test: SelfTest,
    /// How the run before ended, when it knew: 2009h:4.
    pub last_end: u8,
}

/// Times of a task, for 200Ah.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TaskTimer {
    /// Newest run, ns.
    pub last: u32,
    /// Longest run, ns.
    pub most: u32,
    /// Load, 0.01 %.
    pub load: u16,
}

/// Which configuration each task runs; they count up from 0, that of the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Generations {
    /// The newest.
    pub newest: u32,
    /// That of the servo task, which was accepted or refused last.
    pub servo: u32,
    /// That of the gap task.
    pub gap: u32,
    /// That of the supervision.
    pub supervision: u32,
}

/// What was lost since power-up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Lost {
    /// Frames that came faster than they were taken.
    pub frames: u32,
    /// Events between tasks that did.
    pub events: u32,
    /// Servo ticks that did not come while the head was enabled.
    pub ticks: u32,
    /// Blocks of conversions that did not come, or were not taken in time.
    pub blocks: u32,
    /// Pulses that the high comparator has not shown, and the low one, thousands.
    pub unseen: [u32; 2],
}

/// Tasks of [`Drive::set_timers`]: gap, servo, supervision, protocol, plan.
pub const TASKS: usize = 5;

/// Orders that can wait.
const ORDERS: usize = 16;
/// A retreat from a short of more than this is a long one: [G], long-distance retreats.
const LONG_RETREAT: Fixed = Fixed(5 << crate::units::FRACTION_BITS);
/// Velocity below which an axis counts as standing, counts/s.
const STANDING: f32 = 1000.0;

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
    /// What was lost of what is stored, until somebody has taken note.
    loss: Option<Loss>,
    /// What the node has told of both.
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
}

impl Drive {
    /// A drive for a disabled head that runs `settings`; its scope writes to `record`.
    ///
    /// # Errors
    /// The setting that stands in the way.
    // A drive on the stack, in a frame of its own: the caller's holds another.
    #[inline(never)]
    pub fn new(settings: Settings, identity: Identity, record: &'static mut Record) -> Result<Drive, SettingError> {
        let active = settings.build()?;
        let mut drive = Drive {
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
        };
        drive.load_defaults();
        Ok(drive)
    }

    /// Values of power-on, from what is stored and, where nothing is, the defaults and `settings`. The head is disabled. What
    /// of it could not be taken over is told: by what is returned, by 200Bh, and if defaults are in force or an older image,
    /// by an emergency and the warning bit, until the host stores anew or resets faults.
    pub fn restart(&mut self, settings: Settings, stored: &StoredImage) -> LoadReport {
        self.orders.clear();
        self.follow = None;
        self.set_points = SetPoints::default();
        (self.segment, self.datum) = (Segment::default(), Datum::default());
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

    /// Takes the next order.
    pub fn take(&mut self) -> Option<Order> {
        let order = self.orders.pop_front();
        if let Some(Order::Command(_)) = order {
            self.in_flight = self.in_flight.saturating_add(1);
        }
        order.or_else(|| self.follow.take().map(|point| Order::Command(point.command())))
    }

    /// For a head that hears of a SYNC before this drive does: whether the set point that it is to follow from then on,
    /// [`sync_preview`](Self::sync_preview), is another one now. Asked when orders have been taken; then each SYNC is told to
    /// [`synchronised`](Self::synchronised).
    pub fn preview_sync(&mut self, node: &Node) -> bool {
        let next = self.set_point_at_sync(node);
        core::mem::replace(&mut self.sync_preview, next) != next
    }

    /// The set point that the next SYNC is to release, in the cyclic mode and if the SYNC changes nothing else.
    pub fn sync_preview(&self) -> Option<SetPoint> {
        self.sync_preview
    }

    /// Synchronous RPDOs were applied, after the SYNC has released what was sync_preview: it is not ordered once more.
    pub fn synchronised(&mut self) {
        let done = self.sync_preview.take();
        self.follow.take_if(|point| done == Some(*point));
    }

    /// Every task runs what [`Drive::active`] said at [`Order::Configure`].
    pub fn runs_configuration(&mut self) {
        self.running = self.settings;
        (self.restarting, self.configuring) = (false, false);
    }

    /// The head has refused [`Order::Configure`], in a state that does not allow it. The settings are again those that run; if
    /// they were not a host's but come from a reset, they are ordered again when the head is disabled.
    pub fn refused_configuration(&mut self) {
        self.configuring = false;
        if self.restarting {
            self.stale = true;
        } else if let Ok(active) = self.running.build() {
            (self.settings, self.active) = (self.running, active);
        }
    }

    /// The settings wait until the head is disabled; no task runs them.
    pub fn is_stale(&self) -> bool {
        self.stale
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

    /// Result of a command.
    pub fn answered(&mut self, command: Command, result: Result<(), Refused>) {
        if !matches!(command, Command::Follow(..)) {
            self.in_flight = self.in_flight.saturating_sub(1);
        }
        if matches!(command, Command::AppendTo(_) | Command::AppendBy(_)) {
            self.segment.answered(result);
        }
        match (command, result) {
            (Command::MoveTo(_) | Command::MoveBy(_) | Command::AppendTo(_) | Command::AppendBy(_), Ok(())) => {
                self.appended = self.appended.wrapping_add(1)
            }
            // The head erodes already, or nothing is queued yet: the drive asks whenever it may be so.
            (Command::Start, Err(Refused::State(_) | Refused::NoPath)) | (_, Ok(())) => {}
            (command, Err(refused)) => {
                self.refuses(codes::refused(refused));
                self.enabling &= command != Command::Enable;
                if matches!(command, Command::Home(_)) {
                    self.set_points.refused_homing();
                }
            }
        }
    }

    /// A change of the head's state.
    pub fn changed(&mut self, change: Change) {
        self.reason = codes::reason(change.reason);
        match change.reason {
            Reason::Short => {
                let count = self.value(Item::Shorts).wrapping_add(1);
                self.set(Item::Shorts, count);
            }
            Reason::Jumped | Reason::JumpedLow => {
                let count = self.value(Item::Jumps).wrapping_add(1);
                self.set(Item::Jumps, count);
            }
            Reason::PathEnd => self.stopped_by = 1,
            Reason::BrokenThrough => self.stopped_by = 4,
            Reason::SparkedOut => self.stopped_by = 5,
            Reason::SparkOutTime => self.stopped_by = 6,
            Reason::PathStop => self.stopped_by = 7,
            Reason::Touched | Reason::NotTouched | Reason::Lifted => self.set_points.clear_target(),
            Reason::Homed => self.datum.forget(),
            _ => {}
        }
    }

    /// Result of commissioning.
    pub fn checked(&mut self, result: Result<Report, Finding>) {
        self.settings.commissioned = result.is_ok();
        self.running.commissioned = result.is_ok();
        self.active.head.commissioned = result.is_ok();
        // One that is on its way says what was known when it was ordered, and overtakes what the check has found.
        self.stale |= self.configuring;
        if let Ok(report) = result {
            self.learn(&report);
        }
        self.finding = match result {
            Ok(_) => 1,
            Err(finding) => codes::finding(finding),
        };
        let contradicted = match result {
            Err(Finding::Mass(found)) => Some((const { place(Settings::KEYS, "axis.mass_kg") }, found)),
            Err(Finding::Counterbalance(found)) => {
                Some((const { place(Settings::KEYS, "axis.counterbalance_n") }, found))
            }
            _ => None,
        };
        if let Some((field, found)) = contradicted {
            let (index, sub) = setting_address_at(field).unwrap_or_default();
            self.wrong = Some((index, sub, "must be what the guided check has measured"));
            self.contradiction = found;
        }
    }

    /// What commissioning has measured is what lift and supervision are reckoned from, as soon as the head is disabled.
    fn learn(&mut self, report: &Report) {
        let learnt = self.settings.learnt(report);
        if let Ok(active) = learnt.build() {
            (self.settings, self.active) = (learnt, active);
            self.stale = true;
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
        self.watch_fault();
        self.commissioning &= !self.fresh;
        if self.fresh {
            self.follow_head();
        }
        self.watch_mode();
        self.watch_guiding();
        self.record();
    }

    /// Emergencies and interpolation, once a millisecond.
    pub fn poll(&mut self, now: Time, node: &mut Node) {
        self.interpolate(now);
        self.saves.poll(now);
        self.tell(node);
    }

    /// Emergencies for what has come, and for what is gone; of a node that waits to be booted when it has been.
    fn tell(&mut self, node: &mut Node) {
        if node.state() == NmtState::Initialising {
            return;
        }
        let now = (self.alarm, self.loss);
        let before = core::mem::replace(&mut self.reported, now);
        let (mut register, mut gone) = (0, false);
        if let Some(fault) = self.alarm {
            let (code, bits) = codes::error_code(fault);
            if before.0 != self.alarm {
                // A second fault that escalates the first is told of as well, and which one it began with.
                let first = self.status.first.map_or(0, codes::fault);
                node.emergency(code, bits, [codes::fault(fault), self.reason, first, 0, 0]);
            }
            register |= bits;
        } else {
            gone |= before.0.is_some();
        }
        if let Some(Loss { code: (code, bits), detail }) = self.loss {
            if before.1 != self.loss {
                node.emergency(code, bits, detail);
            }
            register |= bits;
        } else {
            gone |= before.1.is_some();
        }
        if gone {
            node.emergency_over(register);
        }
    }

    fn watch_erosion(&mut self) {
        let (state, path) = (self.status.state, self.status.path);
        match (state == head::State::Retreating, self.retreating, self.retreat) {
            (true, false, _) => self.retreat = Some(path),
            (true, true, Some(from)) if from.minus(path) > LONG_RETREAT => {
                let count = self.value(Item::LongRetreats).wrapping_add(1);
                self.set(Item::LongRetreats, count);
                self.retreat = None;
            }
            _ => {}
        }
        self.retreating = state == head::State::Retreating;
        let eroding = state.works();
        if eroding && !self.eroding {
            self.set(Item::ErodingTime, 0);
            self.set(Item::Deepest, i32::MIN);
            (self.stopped_by, self.retreats_before) = (0, self.value(Item::LongRetreats) as u32);
        }
        self.eroding = eroding;
        if !eroding {
            return;
        }
        let time = self.value(Item::ErodingTime).wrapping_add(1);
        self.set(Item::ErodingTime, time);
        self.set(Item::Deepest, self.value(Item::Deepest).max(clamp32(self.status.position)));
        let retreats = (self.value(Item::LongRetreats) as u32).wrapping_sub(self.retreats_before);
        let (longest, most) = (self.value(Item::StopTime) as u32, self.value(Item::StopRetreats) as u32);
        let ends = if longest > 0 && time as u32 >= longest {
            2
        } else if most > 0 && retreats > most {
            3
        } else {
            0
        };
        if ends > 0 && self.stopped_by == 0 {
            self.stopped_by = ends;
            self.hold();
        }
    }

    fn record(&mut self) {
        // Whoever looks up four objects for nothing does it a thousand times a second.
        if !self.scope.runs() {
            return;
        }
        let signals = [Item::ScopeSignal1, Item::ScopeSignal2, Item::ScopeSignal3, Item::ScopeSignal4];
        let signals = signals.map(|item| self.signal(self.value(item) as u32));
        let trigger = Trigger { kind: self.value(Item::ScopeTrigger), level: self.value(Item::ScopeLevel) };
        self.scope.sample(signals, trigger, self.value(Item::ScopeDecimation) as u16);
    }

    fn order(&mut self, order: Order) -> bool {
        self.fresh = false;
        let stops = match order {
            Order::Command(command) => {
                matches!(command, Command::Disable | Command::Hold | Command::Brake(_))
            }
            _ => true,
        };
        if stops && self.orders.is_full() {
            // What was to be done before is not to be done any more.
            for _ in 0..ORDERS {
                match self.orders.pop_front() {
                    Some(Order::Command(_)) => self.refuses(codes::WAIT),
                    Some(other) => self.orders.push_back(other).unwrap_or_default(),
                    None => break,
                }
            }
        }
        let taken = self.orders.push_back(order).is_ok();
        if !taken {
            self.refuses(codes::WAIT);
        }
        taken
    }

    /// Something is not done: 2000h:4, and an event.
    fn refuses(&mut self, why: u8) {
        self.refusal = why;
        self.refusals = self.refusals.wrapping_add(1);
    }

    /// Lets all tasks run the newest settings.
    fn configure(&mut self) -> bool {
        let ordered = self.order(Order::Configure);
        self.configuring |= ordered;
        ordered
    }

    fn command(&mut self, command: Command) -> bool {
        self.order(Order::Command(command))
    }

    /// Pulses off, position held; set points are no longer eroded.
    fn hold(&mut self) {
        self.set(Item::ErodeEnable, 0);
        if self.status.state.works() || !self.fresh {
            self.command(Command::Hold);
        }
    }

    /// The same, and no set point is gone on with either.
    fn hold_all(&mut self) {
        self.set(Item::ErodeEnable, 0);
        self.end_commissioning();
        if self.status.state.follows() || !self.fresh {
            self.set_points.forget();
            self.follow = None;
            self.command(Command::Hold);
        }
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

    fn is_homing(&self) -> bool {
        self.status.homing == HomingState::Runs
    }

    fn happened(&mut self, event: Event) {
        let operational = self.operational;
        match event {
            Event::State(state) => {
                self.operational = state == NmtState::Operational;
                // Whoever does all by SDO never was operational.
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

/// Whether a bit has risen.
fn rises(before: u16, now: u16, bit: u16) -> bool {
    now & !before & bit != 0
}

/// Whether the controlword halts.
fn halts(word: u16) -> bool {
    word & control::HALT != 0
}
