//! What the firmware keeps of each tick, read from the chip's RAM as a debugger would: the newest block of conversions,
//! the input of the servo tick, the head's status. Nothing is read before [`Places::find`] has compared every field's
//! place with the one it has here.

use crate::image::Image;
use crate::layout::Layout;
use anyhow::{Context, Result};
use edm_hal_shim::encoder::RawCount;
use edm_hal_shim::gap::{BLOCK, EDGES, Edges, GapBlock};
use edm_hal_shim::reflex::PulseCounts;
use edm_hal_shim::safety::{DriveCodes, SafetyInputs};
use edm_servo_head::encoder::{Mark, Snapshot};
use edm_servo_head::gap::GapReading;
use edm_servo_head::gap::Sight;
use edm_servo_head::gap::charging::Material;
use edm_servo_head::gap::pulses::{CLASSES, Config as ArcConfig, Counts};
use edm_servo_head::gap::senses::Config as SensesConfig;
use edm_servo_head::head::{
    Breakaway, Carry, Command, Counters, Fault, Home, Inch, MotionLimits, Probe, ProbeInputs, SetPoint, Source, State,
    Status, SupervisionLimits, TickInput,
};
use edm_servo_head::motion::Method;
use edm_servo_head::path::{Piece, Shape};
use edm_servo_head::units::{
    Amps, CountsPerSecond, Fixed, MicrometresPerSecond, MicrometresPerSecond2, Nanometres, Newtons, Volts,
};
use edm_sim::lockstep::QUALITIES;
use edm_soc::{Memory, Region};
use std::mem::{offset_of, size_of};

const PLANNER: &str = "edm_servo_head::head::planner::Planner";
const FOLLOWER: &str = "edm_servo_head::head::follow::Follower";
const FOLLOW: &str = "edm_servo_head::head::follow::FollowConfig";
const PLAN: &str = "edm_servo_head::head::plan::Plan";
const ESTIMATOR: &str = "edm_servo_head::head::estimate::Estimator";
const POSITION: &str = "edm_servo_head::encoder::position::Position";
const PLANS: &str = "edm_runtime::plan::Plans";
const SERVO: &str = "edm_runtime::servo::Servo";
const GAP: &str = "edm_runtime::gap::Gap";
const RAISED: &str = "(edm_servo_head::head::fault::Fault, u32)";
const BLOCKS: &str = "core::option::Option<edm_hal_shim::gap::GapBlock>";

const EXECUTED: &str = "edm_runtime::plan::Executed";
const SUPERVISE: &str = "edm_runtime::supervise::Supervise";
const CONFIG: &str = "edm_servo_head::head::config::Config";
const LIMITS: &str = "edm_servo_head::head::supervise::Limits";
const SOURCE: &str = "edm_servo_head::gap::voltage::Voltage";
const ACTIVE: &str = "edm_servo_head::gap::voltage::Active";
const STREAM: &str = "edm_servo_head::gap::pulses::stream::PulseStream";
const SUPERVISOR: &str = "edm_servo_head::head::supervise::Supervisor";
const PULSES: &str = "edm_servo_head::gap::pulses::Pulses";
const SHARES: &str = "edm_servo_head::gap::pulses::shares::Shares";
const READER: &str = "edm_crossing::latest::Reader";
const SLOT: &str = "edm_crossing::latest::Slot<edm_servo_head::head::supervise::Config>";
const HELD: &str = "edm_crossing::latest::Held<edm_servo_head::head::supervise::Config>";
const SUPERVISION: &str = "edm_servo_head::head::supervise::Config";
const COMMAND: &str = "edm_servo_head::head::command::Command";
/// Variants of [`Command`], and the number of fields that each has.
const VARIANTS: [(&str, usize); 27] = [
    ("Enable", 0),
    ("Disable", 0),
    ("SetHome", 1),
    ("MoveTo", 1),
    ("MoveBy", 1),
    ("AppendTo", 1),
    ("AppendBy", 1),
    ("ClearPath", 0),
    ("Position", 2),
    ("Touch", 2),
    ("FindSurface", 1),
    ("Follow", 2),
    ("Home", 1),
    ("Probe", 1),
    ("Carry", 1),
    ("Push", 1),
    ("Step", 2),
    ("Record", 0),
    ("Brake", 1),
    ("Start", 0),
    ("Guide", 0),
    ("Jump", 0),
    ("Hold", 0),
    ("Commission", 0),
    ("Identify", 0),
    ("Tune", 0),
    ("ResetFault", 0),
];

/// A variant of [`Command`] as the firmware's compiler lays it out.
#[derive(Clone, Debug)]
struct Variant {
    name: &'static str,
    number: u32,
    /// Places of its fields.
    fields: [usize; 2],
}

macro_rules! at {
    ($type:ty, $field:ident) => {
        offset_of!($type, $field)
    };
}

/// Settings that the tasks run, as far as they are read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Runs {
    /// Limits in the planner's configuration.
    pub head: SupervisionLimits,
    /// Limits of the supervision.
    pub supervision: SupervisionLimits,
    /// Codes below which the gap task takes a block for a short.
    pub short: f32,
}

/// Addresses in a chip that runs a certain image.
#[derive(Clone, Debug)]
pub struct Places {
    variants: Vec<Variant>,
    /// Commands, how many, and their tick.
    executed: (u32, u32, u32),
    status: u32,
    write_permitted: u32,
    input: u32,
    counters: u32,
    followed: Followed,
    raised: (u32, u32),
    /// Ticks of the plans begun and made, and of the supervision's newest values when it was begun.
    plans: [u32; 3],
    late: u32,
    block: u32,
    /// Limits in the planner's configuration.
    head_limits: u32,
    /// Where the slot is whose limits the supervision uses, and how far behind its beginning they are.
    limits: (u32, u32),
    short: u32,
    /// Settings of the follower, and of the gap task.
    follower: u32,
    gap: u32,
    /// Places of the numbers among the settings of the follower, the supervision and the gap task, from their first byte.
    settings: [Vec<u32>; 3],
    /// Which slot the servo task has its gap reading from.
    reading: u32,
    /// Tick that the supervision has monitored last.
    monitored: u32,
    /// Pulses that the gap task has counted, those that the supervision has looked at, and the shares that it has of them.
    counted: u32,
    looked: u32,
    shares: u32,
}

/// Pulses that the tasks know of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pulses {
    /// All, up to the newest block.
    pub counted: Counts,
    /// All, up to the newest millisecond.
    pub looked: Counts,
    /// Those of the last 176 to 200 ms, by class.
    pub shares: [u16; CLASSES],
}

/// Of the follower.
#[derive(Clone, Debug)]
struct Followed {
    tick: u32,
    path: u32,
    setpoint: u32,
    following: u32,
    duty: u32,
    saturated: u32,
    position: u32,
    velocity: u32,
}

impl Places {
    /// Looks the places up.
    ///
    /// # Errors
    /// When the image was not built from these sources, or a type is laid out otherwise than here.
    pub fn find(image: &Image) -> Result<Self> {
        macro_rules! checked {
            ($layout:ident, $($path:literal $type:ty: $($field:ident),*;)+) => {
                $($layout.same($path, size_of::<$type>(), &[$((stringify!($field), offset_of!($type, $field))),*])?;)+
            };
        }
        let payloads = VARIANTS.map(|(name, _)| format!("{COMMAND}::{name}"));
        let mut wanted = vec![
            PLANNER,
            FOLLOWER,
            FOLLOW,
            PLAN,
            ESTIMATOR,
            POSITION,
            PLANS,
            EXECUTED,
            "edm_servo_head::head::positioning::MotionLimits",
            "edm_servo_head::head::positioning::Home",
            "edm_servo_head::path::piece::Piece",
            "edm_servo_head::head::probe::Probe",
            SERVO,
            GAP,
            BLOCKS,
            RAISED,
            SUPERVISE,
            CONFIG,
            LIMITS,
            SOURCE,
            STREAM,
            SUPERVISOR,
            PULSES,
            SHARES,
            ACTIVE,
            READER,
            SLOT,
            HELD,
            SUPERVISION,
            "edm_servo_head::head::Status",
            "edm_servo_head::head::tick::TickInput",
            "edm_servo_head::head::tick::SetPoint",
            "edm_servo_head::head::supervise::Counters",
            "edm_servo_head::gap::GapReading",
            "edm_servo_head::gap::pulses::Config",
            "edm_servo_head::gap::senses::Config",
            "edm_servo_head::gap::pulse_watch::Sight",
            "edm_servo_head::gap::charging::Material",
            "edm_servo_head::gap::pulses::stream::Counts",
            "edm_servo_head::encoder::shared::Snapshot",
            "edm_servo_head::encoder::index::Mark",
            "edm_hal_shim::encoder::RawCount",
            "edm_hal_shim::gap::GapBlock",
            "edm_hal_shim::gap::Edges",
            "edm_hal_shim::safety::SafetyInputs",
            "edm_hal_shim::safety::DriveCodes",
        ];
        wanted.extend(payloads.iter().map(String::as_str));
        let layout = Layout::read(image.file(), &wanted)?;
        checked!(layout,
            "edm_servo_head::head::Status" Status: tick, state, fault, position, setpoint, following, velocity, path, gap,
                gap_setpoint, open_circuit, duty, saturated, current, bus, illegal_transitions, homed, current_reduced, inch, carried,
                coarse, carry_to;
            "edm_servo_head::head::tick::TickInput" TickInput: encoder, short_ticks, touches, drive, safety, reflex, reported, set_point,
                asked;
            "edm_servo_head::head::tick::SetPoint" SetPoint: to, counts, ticks;
            "edm_servo_head::head::supervise::Counters" Counters: used, watch;
            "edm_servo_head::gap::GapReading" GapReading: filtered, block, mean, quality, touches,
                short_ticks, regauged, pulses;
            "edm_servo_head::encoder::shared::Snapshot" Snapshot: raw, illegal, mark;
            "edm_servo_head::encoder::index::Mark" Mark: count, toward_work, crossings;
            "edm_hal_shim::encoder::RawCount" RawCount: count, last_edge, toward_work, now;
            "edm_hal_shim::gap::GapBlock" GapBlock: codes, gate, gate_edges, high_edges, gate_was_open, was_high, low_rises, above_low;
            "edm_hal_shim::safety::SafetyInputs" SafetyInputs: upper_limit, lower_limit, emergency_stop, dielectric,
                bridge_fault, supply_low;
            "edm_hal_shim::safety::DriveCodes" DriveCodes: motor_current, bus_voltage;
            "edm_servo_head::head::supervise::Limits" SupervisionLimits: following, following_ms, runaway, velocity, resistance,
                encoder_ms, gated, gap_ms, host_ms, bus_min, current_max, current_ms, arcs, senses, sight;
            "edm_servo_head::gap::pulse_watch::Sight" Sight: current, voltage, open;
            "edm_servo_head::gap::pulses::Config" ArcConfig: share, ms, jump, undelayed;
            "edm_servo_head::gap::senses::Config" SensesConfig: memory, material;
            "edm_servo_head::gap::charging::Material" Material: coefficients, shortest, longest;
            "edm_servo_head::gap::pulses::stream::Counts" Counts: classes, charged, charging, waited, ignited, waits, unclear;
            "edm_hal_shim::gap::Edges" Edges: at, count;
            "edm_servo_head::head::positioning::MotionLimits" MotionLimits: velocity, acceleration, deceleration;
            "edm_servo_head::head::positioning::Home" Home: method, fast, slow, acceleration, at;
            "edm_servo_head::head::probe::Probe" Probe: source, every, edges, armed;
            "edm_servo_head::path::piece::Piece" Piece: shape, to, centre, mark, stop;
        );
        layout.same(BLOCKS, size_of::<Option<GapBlock>>(), &[])?;
        let symbol = |module, name| image.find(module, name).with_context(|| format!("the ELF has no symbol {name}"));
        let servo = symbol("app", "__rtic_internal_local_resource_servo")?;
        let plan = symbol("app", "__rtic_internal_local_init_plan_room")?;
        let supervise = symbol("app", "__rtic_internal_local_init_supervise_room")?;
        let planner = plan + layout.offset(PLANS, "planner")?;
        let raised = plan + layout.offset(PLANS, "raised")?;
        let executed = plan + layout.offset(PLANS, "executed")?;
        let follower = servo + layout.offset(SERVO, "follower")?;
        let supervised = supervise + layout.offset(SUPERVISE, "supervisor")? + layout.offset(SUPERVISOR, "classes")?;
        let estimator = follower + layout.offset(FOLLOWER, "estimator")?;
        let followed = |field| layout.offset(FOLLOWER, field).map(|at| follower + at);
        let mut variants = Vec::new();
        for (payload, (name, count)) in payloads.iter().zip(VARIANTS) {
            layout.same(payload, size_of::<Command>(), &[])?;
            let mut fields = [0; 2];
            for (i, place) in fields.iter_mut().enumerate().take(count) {
                *place = layout.offset(payload, &format!("__{i}"))? as usize;
            }
            variants.push(Variant { name, number: layout.variant(payload)?, fields });
        }
        Ok(Self {
            variants,
            executed: (
                executed + layout.offset(EXECUTED, "commands")?,
                executed + layout.offset(EXECUTED, "count")?,
                executed + layout.offset(EXECUTED, "tick")?,
            ),
            status: planner + layout.offset(PLANNER, "status")?,
            write_permitted: planner + layout.offset(PLANNER, "write_permitted")?,
            input: servo + layout.offset(SERVO, "input")?,
            counters: servo + layout.offset(SERVO, "counters")?,
            followed: Followed {
                tick: followed("tick")?,
                path: followed("plan")? + layout.offset(PLAN, "path")?,
                setpoint: followed("plan")? + layout.offset(PLAN, "setpoint")?,
                following: followed("following")?,
                duty: followed("duty")?,
                saturated: followed("saturated")?,
                position: estimator + layout.offset(ESTIMATOR, "position")? + layout.offset(POSITION, "counts")?,
                velocity: estimator + layout.offset(ESTIMATOR, "now")?,
            },
            raised: (raised + layout.offset(RAISED, "__0")?, raised + layout.offset(RAISED, "__1")?),
            late: followed("late")?,
            plans: [
                plan + layout.offset(PLANS, "begun")?,
                plan + layout.offset(PLANS, "made")?,
                plan + layout.offset(PLANS, "monitored_tick")?,
            ],
            block: symbol("app", "__rtic_internal_local_resource_gap")? + layout.offset(GAP, "block")?,
            head_limits: planner + layout.offset(PLANNER, "config")? + layout.offset(CONFIG, "supervise")?,
            limits: (
                supervise + layout.offset(SUPERVISE, "config")? + layout.offset(READER, "taken")?,
                layout.offset(SLOT, "held")? + layout.offset(HELD, "value")? + layout.offset(SUPERVISION, "limits")?,
            ),
            short: symbol("app", "__rtic_internal_local_resource_gap")?
                + layout.offset(GAP, "source")?
                + layout.offset(SOURCE, "active")?
                + layout.offset(ACTIVE, "short")?,
            settings: [FOLLOW, LIMITS, ACTIVE].map(|of| layout.words(of).to_vec()),
            follower: follower + layout.offset(FOLLOWER, "config")?,
            gap: symbol("app", "__rtic_internal_local_resource_gap")?
                + layout.offset(GAP, "source")?
                + layout.offset(SOURCE, "active")?,
            reading: servo + layout.offset(SERVO, "reading")? + layout.offset(READER, "taken")?,
            monitored: supervise + layout.offset(SUPERVISE, "monitored_tick")?,
            counted: symbol("app", "__rtic_internal_local_resource_gap")?
                + layout.offset(GAP, "source")?
                + layout.offset(SOURCE, "stream")?
                + layout.offset(STREAM, "counts")?,
            looked: supervised + layout.offset(PULSES, "last")?,
            shares: supervised + layout.offset(PULSES, "shares")? + layout.offset(SHARES, "sums")?,
        })
    }

    /// Which slot the servo task has taken its gap reading from: another one once it has taken a newer reading.
    ///
    /// # Errors
    /// When it lies outside the memory.
    pub fn reading(&self, memory: &Memory) -> Result<u32> {
        View::new(memory, self.reading).word(0)
    }

    /// What the planner knew after its newest plan, but for the back-EMF estimate.
    ///
    /// # Errors
    /// When what is there cannot be a status.
    pub fn planned(&self, memory: &Memory) -> Result<Status> {
        status(&View::new(memory, self.status))
    }

    /// Writes over it what the follower knows after its newest tick.
    ///
    /// # Errors
    /// When there is no memory.
    pub fn followed(&self, memory: &Memory, status: &mut Status) -> Result<()> {
        let at = |at| View::new(memory, at);
        let places = &self.followed;
        status.tick = at(places.tick).word(0)?;
        status.path = Fixed(at(places.path).long(0)?);
        status.setpoint = Fixed(at(places.setpoint).long(0)?);
        status.following = at(places.following).float(0)?;
        status.duty = at(places.duty).float(0)?;
        status.saturated = at(places.saturated).flag(0)?;
        status.position = at(places.position).long(0)?;
        status.velocity = CountsPerSecond(at(places.velocity).float(0)?);
        Ok(())
    }

    /// Ticks of the estimates that the newest plan was begun and that it was made on, and of the supervision's newest values
    /// when it was begun.
    ///
    /// # Errors
    /// When there is no memory.
    pub fn plans(&self, memory: &Memory) -> Result<[u32; 3]> {
        let [begun, made, monitored] = self.plans.map(|at| View::new(memory, at).word(0));
        Ok([begun?, made?, monitored?])
    }

    /// Plans that were not there when they were due, since power-up.
    ///
    /// # Errors
    /// When there is no memory.
    pub fn late(&self, memory: &Memory) -> Result<u32> {
        View::new(memory, self.late).word(0)
    }

    /// Both counters, as the servo task has read them last.
    ///
    /// # Errors
    /// When there is no memory.
    pub fn counters(&self, memory: &Memory) -> Result<Counters> {
        counters(&View::new(memory, self.counters))
    }

    /// What the tasks run.
    ///
    /// # Errors
    /// When there is no memory.
    pub fn runs(&self, memory: &Memory) -> Result<Runs> {
        let at = |at| View::new(memory, at);
        let (slot, behind) = self.limits;
        let slot = at(slot).word(0)?;
        Ok(Runs {
            head: limits(&at(self.head_limits))?,
            supervision: limits(&at(slot + behind))?,
            short: at(self.short).float(0)?,
        })
    }

    /// Where the tasks keep the numbers that they run: whose, and the address of each setting of four bytes.
    ///
    /// # Errors
    /// When there is no memory.
    pub fn settings_in_use(&self, memory: &Memory) -> Result<[(&'static str, Vec<u32>); 4]> {
        let (slot, behind) = self.limits;
        let slot = View::new(memory, slot).word(0)?;
        let [follower, limits, gap] = &self.settings;
        let at = |base: u32, words: &[u32]| words.iter().map(|word| base + word).collect();
        Ok([
            ("servo tick", at(self.follower, follower)),
            ("planner", at(self.head_limits, limits)),
            ("supervision", at(slot + behind, limits)),
            ("gap task", at(self.gap, gap)),
        ])
    }

    /// Pulses that the tasks have counted.
    ///
    /// # Errors
    /// When there is no memory.
    pub fn pulses(&self, memory: &Memory) -> Result<Pulses> {
        let at = |at| View::new(memory, at);
        let mut shares = [0; CLASSES];
        for (i, share) in shares.iter_mut().enumerate() {
            *share = at(self.shares).half(2 * i)?;
        }
        Ok(Pulses { counted: counts(&at(self.counted))?, looked: counts(&at(self.looked))?, shares })
    }

    /// Tick that the supervision has monitored last.
    ///
    /// # Errors
    /// When there is no memory.
    pub fn monitored(&self, memory: &Memory) -> Result<u32> {
        View::new(memory, self.monitored).word(0)
    }

    /// Whether idle changes the flash.
    ///
    /// # Errors
    /// When there is no memory.
    pub fn write_permitted(&self, memory: &Memory) -> Result<bool> {
        View::new(memory, self.write_permitted).flag(0)
    }

    /// What the newest tick saw.
    ///
    /// # Errors
    /// When what is there cannot be an input.
    pub fn input(&self, memory: &Memory) -> Result<TickInput> {
        input(&View::new(memory, self.input))
    }

    /// The fault that the protocol raised with the plan on the estimate of tick `tick`.
    ///
    /// # Errors
    /// When what is there cannot be a fault.
    pub fn raised(&self, memory: &Memory, tick: u32) -> Result<Option<Fault>> {
        let at = |at| View::new(memory, at);
        let (fault, raised) = self.raised;
        let fault = at(fault).byte(0)?;
        let fault = *Fault::ALL.get(fault).context("a fault that is none")?;
        Ok((at(raised).word(0)? == tick).then_some(fault))
    }

    /// The commands that the plan on the estimate of tick `tick` carried out.
    ///
    /// # Errors
    /// When what is there cannot be commands.
    pub fn commands(&self, memory: &Memory, tick: u32) -> Result<Vec<Command>> {
        let at = |at| View::new(memory, at);
        let (commands, count, executed) = self.executed;
        if at(executed).word(0)? != tick {
            return Ok(Vec::new());
        }
        let count = at(count).word(0)? as usize;
        (0..count).map(|i| self.command(&at(commands).inner(i * size_of::<Command>()))).collect()
    }

    fn command(&self, view: &View) -> Result<Command> {
        let number = view.byte(0)? as u32;
        let variant =
            self.variants.iter().find(|variant| variant.number == number).context("a command that is none")?;
        let [first, second] = variant.fields;
        let nm = || view.long(first).map(Nanometres);
        Ok(match variant.name {
            "Enable" => Command::Enable,
            "Disable" => Command::Disable,
            "SetHome" => Command::SetHome(nm()?),
            "MoveTo" => Command::MoveTo(nm()?),
            "MoveBy" => Command::MoveBy(nm()?),
            "AppendTo" => Command::AppendTo(piece(&view.inner(first))?),
            "AppendBy" => Command::AppendBy(piece(&view.inner(first))?),
            "ClearPath" => Command::ClearPath,
            "Jump" => Command::Jump,
            "Position" | "Touch" => {
                let limits = view.inner(second);
                let limits = MotionLimits {
                    velocity: MicrometresPerSecond(limits.float(at!(MotionLimits, velocity))?),
                    acceleration: MicrometresPerSecond2(limits.float(at!(MotionLimits, acceleration))?),
                    deceleration: MicrometresPerSecond2(limits.float(at!(MotionLimits, deceleration))?),
                };
                let touches = variant.name == "Touch";
                if touches { Command::Touch(nm()?, limits) } else { Command::Position(nm()?, limits) }
            }
            "FindSurface" => Command::FindSurface(nm()?),
            "Push" => Command::Push(Newtons(view.float(first)?)),
            // Its number, and behind it the place.
            "Carry" => Command::Carry(match view.byte(first)? {
                0 => Carry::To(Nanometres(view.long(first + size_of::<i64>())?)),
                1 => Carry::AsAsked,
                _ => Carry::Refused,
            }),
            "Record" => Command::Record,
            "Step" => Command::Step(nm()?, Nanometres(view.long(second)?)),
            "Follow" => Command::Follow(nm()?, view.word(second)?),
            "Home" => {
                let home = view.inner(first);
                Command::Home(Home {
                    method: Method::from_number(home.byte(at!(Home, method))? as i8)
                        .context("a method that is none")?,
                    fast: MicrometresPerSecond(home.float(at!(Home, fast))?),
                    slow: MicrometresPerSecond(home.float(at!(Home, slow))?),
                    acceleration: MicrometresPerSecond2(home.float(at!(Home, acceleration))?),
                    at: Nanometres(home.long(at!(Home, at))?),
                })
            }
            "Probe" => {
                let probe = |i: usize| -> Result<Probe> {
                    let probe = view.inner(first + i * size_of::<Probe>());
                    let edges = at!(Probe, edges);
                    Ok(Probe {
                        source: Source::from_number(probe.byte(at!(Probe, source))? as u8)
                            .context("a source that is none")?,
                        every: probe.flag(at!(Probe, every))?,
                        edges: [probe.flag(edges)?, probe.flag(edges + 1)?],
                        armed: probe.byte(at!(Probe, armed))? as u8,
                    })
                };
                Command::Probe([probe(0)?, probe(1)?])
            }
            "Brake" => Command::Brake(MicrometresPerSecond2(view.float(first)?)),
            "Start" => Command::Start,
            "Guide" => Command::Guide,
            "Hold" => Command::Hold,
            "Commission" => Command::Commission,
            "Identify" => Command::Identify,
            "Tune" => Command::Tune,
            _ => Command::ResetFault,
        })
    }

    /// The newest block of conversions; `None` when it was lost.
    ///
    /// # Errors
    /// When there is no memory.
    pub fn block(&self, memory: &Memory) -> Result<Option<GapBlock>> {
        let block = View::new(memory, self.block);
        // That there is none is said by a flag that is neither.
        const { assert!(size_of::<Option<GapBlock>>() == size_of::<GapBlock>()) };
        let flags = [at!(GapBlock, gate_was_open), at!(GapBlock, was_high)];
        if flags.into_iter().map(|at| block.byte(at)).collect::<Result<Vec<_>>>()?.into_iter().any(|flag| flag > 1) {
            return Ok(None);
        }
        let mut codes = [0; BLOCK];
        for (i, code) in codes.iter_mut().enumerate() {
            *code = block.half(offset_of!(GapBlock, codes) + 2 * i)?;
        }
        Ok(Some(GapBlock {
            codes,
            gate: block.word(at!(GapBlock, gate))?,
            gate_edges: edges(&block.inner(at!(GapBlock, gate_edges)))?,
            high_edges: edges(&block.inner(at!(GapBlock, high_edges)))?,
            gate_was_open: block.flag(at!(GapBlock, gate_was_open))?,
            was_high: block.flag(at!(GapBlock, was_high))?,
            low_rises: block.byte(at!(GapBlock, low_rises))? as u8,
            above_low: block.flag(at!(GapBlock, above_low))?,
        }))
    }
}

/// A value in memory.
struct View<'a> {
    region: &'a Region,
    at: u32,
}

impl<'a> View<'a> {
    fn new(memory: &'a Memory, at: u32) -> View<'a> {
        View { region: memory.ram(at), at }
    }
    fn load(&self, offset: usize, size: usize) -> Result<u32> {
        self.region.load(self.at + offset as u32, size).context("the firmware's data lie outside of memory")
    }
    fn inner(&self, offset: usize) -> View<'a> {
        View { region: self.region, at: self.at + offset as u32 }
    }
    fn word(&self, offset: usize) -> Result<u32> {
        self.load(offset, 4)
    }
    fn half(&self, offset: usize) -> Result<u16> {
        self.load(offset, 2).map(|h| h as u16)
    }
    fn byte(&self, offset: usize) -> Result<usize> {
        self.load(offset, 1).map(|b| b as usize)
    }
    fn flag(&self, offset: usize) -> Result<bool> {
        self.byte(offset).map(|b| b != 0)
    }
    fn float(&self, offset: usize) -> Result<f32> {
        self.word(offset).map(f32::from_bits)
    }
    fn long(&self, offset: usize) -> Result<i64> {
        let (low, high) = (self.word(offset)?, self.word(offset + 4)?);
        Ok((u64::from(high) << 32 | u64::from(low)).cast_signed())
    }
}

fn piece(view: &View) -> Result<Piece> {
    let (to, centre) = (at!(Piece, to), at!(Piece, centre));
    Ok(Piece {
        shape: Shape::from_number(view.byte(at!(Piece, shape))? as u8).context("a shape that is none")?,
        to: [view.long(to)?, view.long(to + 8)?, view.long(to + 16)?],
        centre: [view.word(centre)?, view.word(centre + 4)?].map(u32::cast_signed),
        mark: view.flag(at!(Piece, mark))?,
        stop: view.flag(at!(Piece, stop))?,
    })
}

fn limits(view: &View) -> Result<SupervisionLimits> {
    Ok(SupervisionLimits {
        following: view.float(at!(SupervisionLimits, following))?,
        following_ms: view.word(at!(SupervisionLimits, following_ms))?,
        breakaway: breakaway(&View { at: view.at + at!(SupervisionLimits, breakaway) as u32, ..*view })?,
        runaway: CountsPerSecond(view.float(at!(SupervisionLimits, runaway))?),
        velocity: CountsPerSecond(view.float(at!(SupervisionLimits, velocity))?),
        resistance: view.float(at!(SupervisionLimits, resistance))?,
        encoder_ms: view.word(at!(SupervisionLimits, encoder_ms))?,
        gated: view.flag(at!(SupervisionLimits, gated))?,
        gap_ms: view.word(at!(SupervisionLimits, gap_ms))?,
        host_ms: view.word(at!(SupervisionLimits, host_ms))?,
        bus_min: Volts(view.float(at!(SupervisionLimits, bus_min))?),
        current_max: Amps(view.float(at!(SupervisionLimits, current_max))?),
        current_ms: view.word(at!(SupervisionLimits, current_ms))?,
        arcs: arcs(&View { at: view.at + at!(SupervisionLimits, arcs) as u32, ..*view })?,
        senses: senses(&view.inner(at!(SupervisionLimits, senses)))?,
        sight: sight(&view.inner(at!(SupervisionLimits, sight)))?,
    })
}

fn sight(view: &View) -> Result<Sight> {
    let pair = |at: usize| anyhow::Ok([view.half(at)?, view.half(at + 2)?]);
    Ok(Sight {
        current: view.half(at!(Sight, current))?,
        voltage: pair(at!(Sight, voltage))?,
        open: pair(at!(Sight, open))?,
    })
}

fn senses(view: &View) -> Result<SensesConfig> {
    let material = view.inner(at!(SensesConfig, material));
    let coefficients = at!(Material, coefficients);
    let coefficient = |n: usize| material.float(coefficients + 4 * n);
    Ok(SensesConfig {
        memory: view.float(at!(SensesConfig, memory))?,
        material: Material {
            coefficients: [coefficient(0)?, coefficient(1)?, coefficient(2)?, coefficient(3)?],
            shortest: material.float(at!(Material, shortest))?,
            longest: material.float(at!(Material, longest))?,
        },
    })
}

fn arcs(view: &View) -> Result<ArcConfig> {
    Ok(ArcConfig {
        share: view.word(at!(ArcConfig, share))?,
        ms: view.word(at!(ArcConfig, ms))?,
        jump: view.word(at!(ArcConfig, jump))?,
        undelayed: view.word(at!(ArcConfig, undelayed))?,
    })
}

fn breakaway(view: &View) -> Result<Breakaway> {
    Ok(Breakaway {
        following: view.float(at!(Breakaway, following))?,
        tremble: view.float(at!(Breakaway, tremble))?,
        friction: view.float(at!(Breakaway, friction))?,
        push: view.float(at!(Breakaway, push))?,
        holding: view.float(at!(Breakaway, holding))?,
        acceleration: view.float(at!(Breakaway, acceleration))?,
        film: view.float(at!(Breakaway, film))?,
    })
}

fn reading(view: &View) -> Result<GapReading> {
    Ok(GapReading {
        filtered: Volts(view.float(at!(GapReading, filtered))?),
        block: Volts(view.float(at!(GapReading, block))?),
        mean: Volts(view.float(at!(GapReading, mean))?),
        quality: *QUALITIES.get(view.byte(at!(GapReading, quality))?).context("a quality that is none")?,
        touches: view.flag(at!(GapReading, touches))?,
        short_ticks: view.word(at!(GapReading, short_ticks))?,
        code: view.half(at!(GapReading, code))?,
        regauged: view.float(at!(GapReading, regauged))?,
        pulses: counts(&view.inner(at!(GapReading, pulses)))?,
    })
}

fn counts(view: &View) -> Result<Counts> {
    let mut classes = [0; CLASSES];
    for (i, count) in classes.iter_mut().enumerate() {
        *count = view.word(at!(Counts, classes) + 4 * i)?;
    }
    Ok(Counts {
        classes,
        charged: view.word(at!(Counts, charged))?,
        charging: view.word(at!(Counts, charging))?,
        waited: view.word(at!(Counts, waited))?,
        ignited: view.word(at!(Counts, ignited))?,
        waits: view.word(at!(Counts, waits))?,
        unclear: view.word(at!(Counts, unclear))?,
    })
}

fn edges(view: &View) -> Result<Edges> {
    let mut at = [0; EDGES];
    for (i, time) in at.iter_mut().enumerate() {
        *time = view.half(at!(Edges, at) + 2 * i)?;
    }
    Ok(Edges { at, count: view.byte(at!(Edges, count))? as u8 })
}

fn raw(view: &View) -> Result<RawCount> {
    Ok(RawCount {
        count: view.word(at!(RawCount, count))?,
        last_edge: view.word(at!(RawCount, last_edge))?,
        toward_work: view.flag(at!(RawCount, toward_work))?,
        now: view.word(at!(RawCount, now))?,
    })
}

/// A fault's number; none is the first number that no fault has.
fn fault(view: &View) -> Result<Option<Fault>> {
    match view.byte(0)? {
        n if n == Fault::ALL.len() => Ok(None),
        n => Ok(Some(*Fault::ALL.get(n).context("a fault that is none")?)),
    }
}

fn input(view: &View) -> Result<TickInput> {
    let safety = view.inner(at!(TickInput, safety));
    // None: one of the flags is neither true nor false.
    let flags = 0..size_of::<SafetyInputs>();
    let there = flags.map(|i| safety.byte(i)).collect::<Result<Vec<_>>>()?.iter().all(|flag| *flag < 2);
    let drive = view.inner(at!(TickInput, drive));
    // The word before the set point says whether there is one.
    let point = view.inner(at!(TickInput, set_point));
    let pointed = point.word(0)? != 0;
    let point = point.inner(size_of::<Option<SetPoint>>() - size_of::<SetPoint>());
    Ok(TickInput {
        encoder: raw(&view.inner(at!(TickInput, encoder)))?,
        short_ticks: view.word(at!(TickInput, short_ticks))?,
        touches: view.flag(at!(TickInput, touches))?,
        gap: None,
        sight: ProbeInputs::default(),
        safety: if there { Some(contacts(&safety)?) } else { None },
        drive: DriveCodes {
            motor_current: drive.half(at!(DriveCodes, motor_current))?,
            bus_voltage: drive.half(at!(DriveCodes, bus_voltage))?,
        },
        reflex: view.flag(at!(TickInput, reflex))?,
        reported: fault(&view.inner(at!(TickInput, reported)))?,
        set_point: if pointed { Some(set_point(&point)?) } else { None },
        asked: view.flag(at!(TickInput, asked))?,
    })
}

fn set_point(view: &View) -> Result<SetPoint> {
    Ok(SetPoint {
        to: Nanometres(view.long(at!(SetPoint, to))?),
        counts: Fixed(view.long(at!(SetPoint, counts))?),
        ticks: view.word(at!(SetPoint, ticks))?,
    })
}

fn counters(view: &View) -> Result<Counters> {
    let used = view.inner(at!(Counters, used));
    let mark = used.inner(at!(Snapshot, mark));
    let watch = view.inner(at!(Counters, watch));
    // No count: a direction that is neither.
    let watched = watch.byte(at!(RawCount, toward_work))? < 2;
    let pulses = view.inner(at!(Counters, pulses));
    Ok(Counters {
        used: Snapshot {
            raw: raw(&used.inner(at!(Snapshot, raw)))?,
            illegal: used.word(at!(Snapshot, illegal))?,
            mark: Mark {
                count: mark.word(at!(Mark, count))?,
                toward_work: mark.flag(at!(Mark, toward_work))?,
                crossings: mark.word(at!(Mark, crossings))?,
            },
        },
        watch: if watched { Some(raw(&watch)?) } else { None },
        pulses: PulseCounts {
            edges: pulses.byte(at!(PulseCounts, edges))? as u8,
            conversions: pulses.byte(at!(PulseCounts, conversions))? as u8,
            shorts: pulses.byte(at!(PulseCounts, shorts))? as u8,
            comparators: [
                pulses.byte(at!(PulseCounts, comparators))? as u8,
                pulses.byte(at!(PulseCounts, comparators) + 1)? as u8,
            ],
            newest: [pulses.half(at!(PulseCounts, newest))?, pulses.half(at!(PulseCounts, newest) + 2)?],
        },
        drive_stands: view.flag(at!(Counters, drive_stands))?,
    })
}

fn contacts(view: &View) -> Result<SafetyInputs> {
    Ok(SafetyInputs {
        upper_limit: view.flag(at!(SafetyInputs, upper_limit))?,
        lower_limit: view.flag(at!(SafetyInputs, lower_limit))?,
        emergency_stop: view.flag(at!(SafetyInputs, emergency_stop))?,
        dielectric: view.flag(at!(SafetyInputs, dielectric))?,
        bridge_fault: view.flag(at!(SafetyInputs, bridge_fault))?,
        supply_low: view.flag(at!(SafetyInputs, supply_low))?,
    })
}

fn status(view: &View) -> Result<Status> {
    let fault = fault(&view.inner(at!(Status, fault)))?;
    Ok(Status {
        tick: view.word(at!(Status, tick))?,
        state: *State::ALL.get(view.byte(at!(Status, state))?).context("a state that is none")?,
        fault,
        position: view.long(at!(Status, position))?,
        setpoint: Fixed(view.long(at!(Status, setpoint))?),
        following: view.float(at!(Status, following))?,
        velocity: CountsPerSecond(view.float(at!(Status, velocity))?),
        path: Fixed(view.long(at!(Status, path))?),
        gap: reading(&view.inner(at!(Status, gap)))?,
        gap_setpoint: Volts(view.float(at!(Status, gap_setpoint))?),
        open_circuit: Volts(view.float(at!(Status, open_circuit))?),
        duty: view.float(at!(Status, duty))?,
        saturated: view.flag(at!(Status, saturated))?,
        current: Amps(view.float(at!(Status, current))?),
        bus: Volts(view.float(at!(Status, bus))?),
        back_emf: Default::default(),
        illegal_transitions: view.word(at!(Status, illegal_transitions))?,
        safety: contacts(&view.inner(at!(Status, safety)))?,
        homed: view.flag(at!(Status, homed))?,
        current_reduced: view.flag(at!(Status, current_reduced))?,
        inch: *Inch::ALL.get(view.byte(at!(Status, inch))?).context("an answer to no question")?,
        carried: view.long(at!(Status, carried))?,
        coarse: view.long(at!(Status, coarse))?,
        carry_to: view.long(at!(Status, carry_to))?,
        ..Status::default()
    })
}
