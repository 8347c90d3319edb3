//! A run of the chip in a file: every [`Event`] as whole numbers, each the difference to the same number of the event of its
//! kind before, in variable length (LEB128, zigzag), deflated.
//!
//! The file begins with [`MAGIC`]. Every bit of it belongs to the firmware that made it; the head's senses are compared with
//! those of later versions too ([`replay_senses`]).

use super::{Event, Twin};
use edm_hal_shim::encoder::RawCount;
use edm_hal_shim::gap::{BLOCK, Edges, GapBlock};
use edm_hal_shim::reflex::PulseCounts;
use edm_hal_shim::safety::{DriveCodes, SafetyInputs};
use edm_servo_head::encoder::{Mark, Snapshot};
use edm_servo_head::gap::pulses::{CLASSES, Counts};
use edm_servo_head::gap::{GapReading, Quality};
use edm_servo_head::head::{
    Carry, Command, Counters, Fault, Home, MotionLimits, Probe, ProbeInputs, SetPoint, Source, State, Status, TickInput,
};
use edm_servo_head::motion::Method;
use edm_servo_head::path::{Piece, Shape};
use edm_servo_head::settings::{SettingError, Settings};
use edm_servo_head::units::{
    Amps, CountsPerSecond, Fixed, MicrometresPerSecond, MicrometresPerSecond2, Nanometres, Newtons, Volts,
};
use flate2::Compression;
use flate2::read::DeflateDecoder;
use flate2::write::DeflateEncoder;
use std::io::{self, Read, Write};

/// First bytes of a recording, the last of them its version.
const MAGIC: [u8; 5] = *b"EDMR\x06";
/// Qualities of a reading by number.
pub const QUALITIES: [Quality; 6] =
    [Quality::Missing, Quality::Valid, Quality::NoGate, Quality::Saturated, Quality::Reversed, Quality::Unclear];

/// Why a recording cannot be replayed.
#[derive(Debug)]
pub enum Error {
    /// It cannot be read.
    Io(io::Error),
    /// It is not a recording, or of another version.
    Foreign,
    /// A number that its field cannot have.
    Damaged(&'static str),
    /// The native core gives another result than the chip.
    Differs(String),
}

impl std::fmt::Display for Error {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Error::Io(error) => write!(f, "the recording cannot be read: {error}"),
            Error::Foreign => f.write_str("not a recording of this version"),
            Error::Damaged(what) => write!(f, "the recording is damaged: no such {what}"),
            Error::Differs(what) => write!(f, "native core and recorded chip differ: {what}"),
        }
    }
}

impl std::error::Error for Error {}

impl From<io::Error> for Error {
    fn from(error: io::Error) -> Self {
        Error::Io(error)
    }
}

/// Numbers of the newest event of each kind.
struct Last {
    block: [u64; BLOCK + 1],
    command: [u64; COMMAND],
    tick: [u64; TICK],
    plan: [u64; PLAN],
    counts: [u64; COUNTS],
    edges: EdgesOf,
}

impl Last {
    const NONE: Last = Last {
        block: [0; BLOCK + 1],
        command: [0; COMMAND],
        tick: [0; TICK],
        plan: [0; PLAN],
        counts: [0; COUNTS],
        edges: EdgesOf::NONE,
    };
}

/// Numbers of [`Counts`].
const COUNTS: usize = CLASSES + 6;

/// Edges of a block, the levels when it began, and what the low comparator did.
#[derive(Clone, Copy, PartialEq)]
struct EdgesOf {
    lines: [Edges; 2],
    levels: [bool; 2],
    low: (u8, bool),
}

impl EdgesOf {
    const NONE: EdgesOf = EdgesOf { lines: [Edges::NONE; 2], levels: [false; 2], low: (0, false) };

    fn of(block: &GapBlock) -> EdgesOf {
        EdgesOf {
            lines: [block.gate_edges, block.high_edges],
            levels: [block.gate_was_open, block.was_high],
            low: (block.low_rises, block.above_low),
        }
    }

    fn write(&self, to: &mut impl Write) -> io::Result<()> {
        let [open, high] = self.levels;
        let (rises, above) = self.low;
        let mut bytes = vec![7, u8::from(open) | u8::from(high) << 1 | u8::from(above) << 2, rises];
        for line in &self.lines {
            bytes.push(line.count);
            bytes.extend(line.times().iter().flat_map(|at| at.to_le_bytes()));
        }
        to.write_all(&bytes)
    }

    fn read(from: &mut impl Read) -> Result<EdgesOf, Error> {
        let mut byte = || {
            let mut byte = [0];
            from.read_exact(&mut byte).map(|()| byte[0])
        };
        let levels = byte()?;
        let low = (byte()?, levels & 4 != 0);
        let mut edges = EdgesOf { levels: [levels & 1 != 0, levels & 2 != 0], low, ..EdgesOf::NONE };
        for line in &mut edges.lines {
            for _ in 0..byte()? {
                let at = u16::from_le_bytes([byte()?, byte()?]);
                if !line.push(at) {
                    return Err(Error::Damaged("number of edges"));
                }
            }
        }
        Ok(edges)
    }

    fn put_into(self, block: &mut GapBlock) {
        let EdgesOf { lines: [gate, high], levels: [open, above], low } = self;
        (block.gate_edges, block.high_edges) = (gate, high);
        (block.gate_was_open, block.was_high) = (open, above);
        (block.low_rises, block.above_low) = low;
    }
}

fn counts_numbers(counts: &Counts) -> [u64; COUNTS] {
    let Counts { classes, charged, charging, waited, ignited, waits, unclear } = *counts;
    let mut numbers = [0; COUNTS];
    let all = classes.into_iter().chain([charged, charging, waited, ignited, waits, unclear]);
    numbers.iter_mut().zip(all).for_each(|(number, count)| *number = count.into());
    numbers
}

fn counts_of(numbers: &[u64; COUNTS]) -> Counts {
    let [charged, charging, waited, ignited, waits, unclear] = core::array::from_fn(|i| numbers[CLASSES + i] as u32);
    Counts { classes: core::array::from_fn(|i| numbers[i] as u32), charged, charging, waited, ignited, waits, unclear }
}

/// Writes a recording.
pub struct Recorder<W: Write> {
    to: DeflateEncoder<W>,
    last: Last,
}

impl<W: Write> Recorder<W> {
    /// Begins a recording.
    ///
    /// # Errors
    /// What the writer refuses.
    pub fn new(mut to: W) -> io::Result<Self> {
        to.write_all(&MAGIC)?;
        Ok(Self { to: DeflateEncoder::new(to, Compression::best()), last: Last::NONE })
    }

    /// Adds what happened next.
    ///
    /// # Errors
    /// What the writer refuses.
    pub fn event(&mut self, event: &Event) -> io::Result<()> {
        let Self { to, last } = self;
        match event {
            Event::Block(None) => to.write_all(&[0]),
            Event::Block(Some(block)) => {
                let edges = EdgesOf::of(block);
                if edges != last.edges {
                    edges.write(to)?;
                    last.edges = edges;
                }
                put(to, 1, &mut last.block, block_numbers(block))
            }
            Event::Command(command) => put(to, 2, &mut last.command, command_numbers(*command)),
            Event::Raised(fault) => to.write_all(&[4, *fault as u8]),
            Event::Supervised => to.write_all(&[5]),
            Event::Tick(input, counters, status) => put(to, 3, &mut last.tick, tick_numbers(input, counters, status)),
            Event::Plan(status) => {
                let counts = counts_numbers(&status.gap.pulses);
                if counts != last.counts {
                    put(to, 8, &mut last.counts, counts)?;
                }
                put(to, 6, &mut last.plan, plan_numbers(status))
            }
        }
    }

    /// Ends the recording.
    ///
    /// # Errors
    /// What the writer refuses.
    pub fn finish(self) -> io::Result<W> {
        self.to.finish()
    }
}

/// Replays a recording of a commissioned head with default settings through the native core. Gives the ticks that agreed.
///
/// # Errors
/// When it cannot be read, or at the first difference.
pub fn replay(from: impl Read) -> Result<u64, Error> {
    through(Twin::new, from)
}

/// The same, but only what the head makes of its signals has to agree: counts exactly, shorts and quality of the gap signal,
/// its filtered voltage within 1 V. A recording of older firmware passes as long as the senses are the same.
///
/// # Errors
/// When it cannot be read, or at the first difference.
pub fn replay_senses(from: impl Read) -> Result<u64, Error> {
    through(Twin::of_senses, from)
}

fn through(twin: fn(&Settings) -> Result<Twin, SettingError>, mut from: impl Read) -> Result<u64, Error> {
    let mut magic = [0; MAGIC.len()];
    from.read_exact(&mut magic)?;
    if magic != MAGIC {
        return Err(Error::Foreign);
    }
    let settings = Settings { commissioned: true, ..Settings::default() };
    let mut twin = twin(&settings).map_err(|e| Error::Differs(e.to_string()))?;
    let mut from = io::BufReader::new(DeflateDecoder::new(from));
    let mut last = Last::NONE;
    loop {
        let mut kind = [0];
        if from.read(&mut kind)? == 0 {
            return Ok(twin.ticks());
        }
        let event = match kind {
            [0] => Event::Block(None),
            [7] => {
                last.edges = EdgesOf::read(&mut from)?;
                continue;
            }
            [8] => {
                get(&mut from, &mut last.counts)?;
                continue;
            }
            [1] => {
                let mut block = block_of(&get(&mut from, &mut last.block)?);
                last.edges.put_into(&mut block);
                Event::Block(Some(block))
            }
            [2] => Event::Command(command_of(&get(&mut from, &mut last.command)?)?),
            [3] => {
                let (input, counters, status) = tick_of(&get(&mut from, &mut last.tick)?)?;
                Event::Tick(input, counters, status)
            }
            [4] => {
                let mut fault = [0];
                from.read_exact(&mut fault)?;
                let [fault] = fault;
                Event::Raised(*Fault::ALL.get(usize::from(fault)).ok_or(Error::Damaged("fault"))?)
            }
            [5] => Event::Supervised,
            [6] => {
                let mut status = plan_of(&get(&mut from, &mut last.plan)?)?;
                status.gap.pulses = counts_of(&last.counts);
                Event::Plan(status)
            }
            _ => return Err(Error::Damaged("event")),
        };
        twin.event(&event).map_err(Error::Differs)?;
    }
}

fn put<const N: usize>(to: &mut impl Write, kind: u8, last: &mut [u64; N], numbers: [u64; N]) -> io::Result<()> {
    let mut bytes = vec![kind];
    for (last, number) in last.iter_mut().zip(numbers) {
        let difference = number.wrapping_sub(*last) as i64;
        let mut rest = (difference << 1 ^ difference >> 63) as u64;
        while rest >= 0x80 {
            bytes.push(rest as u8 | 0x80);
            rest >>= 7;
        }
        bytes.push(rest as u8);
        *last = number;
    }
    to.write_all(&bytes)
}

fn get<const N: usize>(from: &mut impl Read, last: &mut [u64; N]) -> Result<[u64; N], Error> {
    for last in last.iter_mut() {
        let (mut rest, mut shift) = (0u64, 0);
        loop {
            let mut byte = [0];
            from.read_exact(&mut byte)?;
            rest |= u64::from(byte[0] & 0x7f) << shift;
            shift += 7;
            if byte[0] < 0x80 {
                break;
            }
            if shift > 63 {
                return Err(Error::Damaged("number"));
            }
        }
        let difference = (rest >> 1) as i64 ^ -((rest & 1) as i64);
        *last = last.wrapping_add(difference as u64);
    }
    Ok(*last)
}

/// Neighbouring codes are alike: each as its distance to the one before.
fn block_numbers(block: &GapBlock) -> [u64; BLOCK + 1] {
    let mut numbers = [u64::from(block.gate); BLOCK + 1];
    let mut before = 0;
    for (number, code) in numbers.iter_mut().zip(block.codes) {
        *number = u64::from(code).wrapping_sub(before);
        before = code.into();
    }
    numbers
}

fn block_of(numbers: &[u64; BLOCK + 1]) -> GapBlock {
    let mut codes = [0; BLOCK];
    let mut before = 0u64;
    for (code, number) in codes.iter_mut().zip(numbers) {
        before = before.wrapping_add(*number);
        *code = before as u16;
    }
    GapBlock { codes, gate: numbers[BLOCK] as u32, ..GapBlock::EMPTY }
}

/// Numbers of a command.
const COMMAND: usize = 6;

fn command_numbers(command: Command) -> [u64; COMMAND] {
    let float = |x: f32| u64::from(x.to_bits());
    let (number, nm) = match command {
        Command::Enable => (1, 0),
        Command::Disable => (2, 0),
        Command::SetHome(at) => (3, at.0),
        Command::MoveTo(to) => (4, to.0),
        Command::MoveBy(by) => (5, by.0),
        Command::Start => (6, 0),
        Command::Hold => (7, 0),
        Command::Commission => (8, 0),
        Command::ResetFault => (9, 0),
        Command::ClearPath => (10, 0),
        Command::Guide => (11, 0),
        Command::Jump => (19, 0),
        Command::FindSurface(reach) => (20, reach.0),
        Command::Push(force) => return [25, 0, float(force.0), 0, 0, 0],
        Command::Carry(Carry::To(to)) => (22, to.0),
        Command::Carry(Carry::AsAsked) => (23, 0),
        Command::Carry(Carry::Refused) => (24, 0),
        Command::Identify => (28, 0),
        Command::Tune => (29, 0),
        Command::Position(to, limits) | Command::Touch(to, limits) => {
            let MotionLimits { velocity, acceleration, deceleration } = limits;
            let number = if matches!(command, Command::Touch(..)) { 16 } else { 12 };
            return [number, to.0 as u64, float(velocity.0), float(acceleration.0), float(deceleration.0), 0];
        }
        Command::Record => (27, 0),
        Command::Step(least, most) => return [26, least.0 as u64, most.0 as u64, 0, 0, 0],
        Command::Follow(to, ticks) => return [13, to.0 as u64, ticks.into(), 0, 0, 0],
        Command::Home(Home { method, fast, slow, acceleration, at }) => {
            return [14, at.0 as u64, float(fast.0), float(slow.0), float(acceleration.0), method as u64];
        }
        Command::AppendTo(piece) | Command::AppendBy(piece) => {
            let Piece { shape, to: [down, x, y], centre: [u, v], mark, stop } = piece;
            let number = if matches!(command, Command::AppendTo(_)) { 17 } else { 18 };
            let centre = u64::from(u.cast_unsigned()) | u64::from(v.cast_unsigned()) << 32;
            return [
                number,
                down as u64,
                x as u64,
                y as u64,
                centre,
                shape as u64 | u64::from(mark) << 8 | u64::from(stop) << 9,
            ];
        }
        Command::Probe(probes) => {
            let bits = |probe: Probe| {
                let [begins, ends] = probe.edges;
                let bytes = [probe.source as u8, probe.every.into(), begins.into(), ends.into(), probe.armed, 0, 0, 0];
                u64::from_le_bytes(bytes)
            };
            let [first, second] = probes.map(bits);
            return [21, 0, first, second, 0, 0];
        }
        Command::Brake(deceleration) => return [15, 0, float(deceleration.0), 0, 0, 0],
    };
    [number, nm as u64, 0, 0, 0, 0]
}

fn command_of(&[number, nm, a, b, c, d]: &[u64; COMMAND]) -> Result<Command, Error> {
    let nm = Nanometres(nm as i64);
    let float = |x: u64| f32::from_bits(x as u32);
    Ok(match number {
        1 => Command::Enable,
        2 => Command::Disable,
        3 => Command::SetHome(nm),
        4 => Command::MoveTo(nm),
        5 => Command::MoveBy(nm),
        6 => Command::Start,
        7 => Command::Hold,
        8 => Command::Commission,
        9 => Command::ResetFault,
        10 => Command::ClearPath,
        11 => Command::Guide,
        12 | 16 => {
            let [velocity, acceleration, deceleration] = [a, b, c].map(float);
            let velocity = MicrometresPerSecond(velocity);
            let acceleration = MicrometresPerSecond2(acceleration);
            let deceleration = MicrometresPerSecond2(deceleration);
            let limits = MotionLimits { velocity, acceleration, deceleration };
            if number == 12 { Command::Position(nm, limits) } else { Command::Touch(nm, limits) }
        }
        13 => Command::Follow(nm, a as u32),
        14 => Command::Home(Home {
            method: Method::from_number(d as i8).ok_or(Error::Damaged("homing method"))?,
            fast: MicrometresPerSecond(float(a)),
            slow: MicrometresPerSecond(float(b)),
            acceleration: MicrometresPerSecond2(float(c)),
            at: nm,
        }),
        17 | 18 => {
            let piece = Piece {
                shape: Shape::from_number(d as u8).ok_or(Error::Damaged("shape"))?,
                to: [nm.0, a as i64, b as i64],
                centre: [c as i32, (c >> 32) as i32],
                mark: d >> 8 & 1 != 0,
                stop: d >> 9 & 1 != 0,
            };
            if number == 17 { Command::AppendTo(piece) } else { Command::AppendBy(piece) }
        }
        19 => Command::Jump,
        20 => Command::FindSurface(nm),
        21 => {
            let probe = |bits: u64| -> Result<Probe, Error> {
                let [source, every, begins, ends, armed, ..] = bits.to_le_bytes();
                let source = Source::from_number(source).ok_or(Error::Damaged("source of a touch probe"))?;
                Ok(Probe { source, every: every != 0, edges: [begins != 0, ends != 0], armed })
            };
            Command::Probe([probe(a)?, probe(b)?])
        }
        27 => Command::Record,
        26 => Command::Step(nm, Nanometres(a as i64)),
        25 => Command::Push(Newtons(float(a))),
        22 => Command::Carry(Carry::To(nm)),
        23 => Command::Carry(Carry::AsAsked),
        24 => Command::Carry(Carry::Refused),
        28 => Command::Identify,
        29 => Command::Tune,
        15 => Command::Brake(MicrometresPerSecond2(float(a))),
        _ => return Err(Error::Damaged("command")),
    })
}

/// Numbers of a tick, and of a plan.
const TICK: usize = 34;
const PLAN: usize = 14;

fn float(x: f32) -> u64 {
    x.to_bits().into()
}

fn from_float(x: u64) -> f32 {
    f32::from_bits(x as u32)
}

/// No fault: a number that none will ever have.
fn fault_number(fault: Option<Fault>) -> u64 {
    fault.map_or(u64::from(u8::MAX), |fault| fault as u64)
}

/// What the replay needs of the input, and what [`Twin`] compares of the follower.
fn tick_numbers(input: &TickInput, counters: &Counters, status: &Status) -> [u64; TICK] {
    let TickInput {
        encoder: raw,
        short_ticks,
        touches,
        gap: _,
        sight: _,
        drive,
        safety,
        reflex,
        reported,
        set_point,
        asked,
    } = input;
    let Snapshot { illegal, mark, .. } = &counters.used;
    let contacts = safety.unwrap_or_default();
    let SafetyInputs { upper_limit, lower_limit, emergency_stop, dielectric, bridge_fault, supply_low } = contacts;
    let flags =
        [upper_limit, lower_limit, emergency_stop, dielectric, bridge_fault, *reflex, *asked, *touches, supply_low];
    let watched = counters.watch.unwrap_or_default();
    let PulseCounts { edges, conversions, shorts, comparators: [high, low], newest: [current, voltage] } =
        counters.pulses;
    let point = set_point.unwrap_or_default();
    [
        raw.count.into(),
        raw.last_edge.into(),
        raw.toward_work.into(),
        raw.now.into(),
        (*short_ticks).into(),
        drive.motor_current.into(),
        drive.bus_voltage.into(),
        flags.iter().rev().fold(0, |bits, flag| bits << 1 | u64::from(*flag)),
        fault_number(*reported),
        set_point.is_some().into(),
        point.to.0 as u64,
        point.counts.0 as u64,
        point.ticks.into(),
        counters.used.raw.count.into(),
        counters.used.raw.now.into(),
        (*illegal).into(),
        mark.count.into(),
        mark.toward_work.into(),
        mark.crossings.into(),
        counters.watch.is_some().into(),
        watched.count.into(),
        watched.last_edge.into(),
        watched.toward_work.into(),
        watched.now.into(),
        u64::from_le_bytes([edges, conversions, shorts, counters.drive_stands.into(), high, low, 0, 0]),
        u64::from(current) << 16 | u64::from(voltage),
        status.tick.into(),
        status.position as u64,
        float(status.velocity.0),
        status.setpoint.0 as u64,
        float(status.following),
        status.path.0 as u64,
        float(status.duty),
        status.saturated.into(),
    ]
}

fn tick_of(numbers: &[u64; TICK]) -> Result<(TickInput, Counters, Status), Error> {
    let [count, last_edge, toward_work, now, short_ticks, motor_current, bus_voltage, flags, reported, rest @ ..] =
        *numbers;
    let [pointed, to, counts, ticks, used, used_at, illegal, mark_at, mark_toward, crossings, rest @ ..] = rest;
    let [watched, w_count, w_edge, w_toward, w_now, pulses, newest, tick, position, velocity, setpoint, rest @ ..] =
        rest;
    let [following, path, duty, saturated] = rest;
    let raw = |count, edge, toward, now| RawCount {
        count: count as u32,
        last_edge: edge as u32,
        toward_work: toward != 0,
        now: now as u32,
    };
    let flag = |i: u32| flags >> i & 1 == 1;
    let input = TickInput {
        encoder: raw(count, last_edge, toward_work, now),
        short_ticks: short_ticks as u32,
        touches: flag(7),
        gap: None,
        sight: ProbeInputs::default(),
        drive: DriveCodes { motor_current: motor_current as u16, bus_voltage: bus_voltage as u16 },
        safety: SafetyInputs {
            upper_limit: flag(0),
            lower_limit: flag(1),
            emergency_stop: flag(2),
            dielectric: flag(3),
            bridge_fault: flag(4),
            supply_low: flag(8),
        }
        .unsafe_ones(),
        reflex: flag(5),
        reported: Fault::ALL.get(reported as usize).copied(),
        set_point: (pointed != 0).then_some(SetPoint {
            to: Nanometres(to as i64),
            counts: Fixed(counts as i64),
            ticks: ticks as u32,
        }),
        asked: flag(6),
    };
    let [edges, conversions, shorts, drive_stands, high, low, ..] = pulses.to_le_bytes();
    let newest = [(newest >> 16) as u16, newest as u16];
    let counters = Counters {
        used: Snapshot {
            raw: RawCount { count: used as u32, now: used_at as u32, ..RawCount::default() },
            illegal: illegal as u32,
            mark: Mark { count: mark_at as u32, toward_work: mark_toward != 0, crossings: crossings as u32 },
        },
        watch: (watched != 0).then(|| raw(w_count, w_edge, w_toward, w_now)),
        pulses: PulseCounts { edges, conversions, shorts, comparators: [high, low], newest },
        drive_stands: drive_stands != 0,
    };
    let status = Status {
        tick: tick as u32,
        position: position as i64,
        velocity: CountsPerSecond(from_float(velocity)),
        setpoint: Fixed(setpoint as i64),
        following: from_float(following),
        path: Fixed(path as i64),
        duty: from_float(duty),
        saturated: saturated != 0,
        ..Status::default()
    };
    Ok((input, counters, status))
}

/// What [`Twin`] compares of a plan.
fn plan_numbers(status: &Status) -> [u64; PLAN] {
    [
        status.tick.into(),
        status.state as u64,
        fault_number(status.fault),
        status.position as u64,
        status.setpoint.0 as u64,
        status.path.0 as u64,
        float(status.gap.filtered.0),
        float(status.gap.block.0),
        status.gap.quality as u64,
        u64::from(status.gap.short_ticks) | u64::from(status.gap.touches) << 32 | u64::from(status.gap.code) << 48,
        float(status.open_circuit.0),
        float(status.current.0),
        float(status.bus.0),
        float(status.gap.mean.0),
    ]
}

fn plan_of(numbers: &[u64; PLAN]) -> Result<Status, Error> {
    let [tick, state, fault, position, setpoint, path, filtered, block, quality, shorts, open, current, bus, mean] =
        *numbers;
    Ok(Status {
        tick: tick as u32,
        state: *State::ALL.get(state as usize).ok_or(Error::Damaged("state"))?,
        fault: Fault::ALL.get(fault as usize).copied(),
        position: position as i64,
        setpoint: Fixed(setpoint as i64),
        path: Fixed(path as i64),
        gap: GapReading {
            filtered: Volts(from_float(filtered)),
            block: Volts(from_float(block)),
            mean: Volts(from_float(mean)),
            quality: *QUALITIES.get(quality as usize).ok_or(Error::Damaged("quality of the gap reading"))?,
            touches: shorts >> 32 & 1 != 0,
            short_ticks: shorts as u32,
            code: (shorts >> 48) as u16,
            ..GapReading::default()
        },
        open_circuit: Volts(from_float(open)),
        current: Amps(from_float(current)),
        bus: Volts(from_float(bus)),
        ..Status::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use edm_servo_head::head::{Head, Inputs};
    use edm_servo_head::path::Path;

    fn status() -> Status {
        Status { tick: 7, fault: Some(Fault::BusSag), position: -3, duty: -0.25, ..Status::default() }
    }

    fn planned() -> Status {
        let gap = GapReading {
            mean: Volts(60.5),
            quality: Quality::Valid,
            touches: true,
            code: 4094,
            ..GapReading::default()
        };
        Status { tick: 9, state: State::Eroding, gap, path: Fixed(-5), ..Status::default() }
    }

    #[test]
    fn numbers_come_back() {
        let codes = core::array::from_fn(|i| (i * 160) as u16 ^ 0x0aa5);
        let block = GapBlock { codes, gate: 0x01ff_fffe, ..GapBlock::EMPTY };
        assert_eq!(block_of(&block_numbers(&block)), block);
        let mut edges = EdgesOf { levels: [false, true], ..EdgesOf::NONE };
        [7, 300, 8000].iter().for_each(|at| assert!(edges.lines[1].push(*at)));
        let mut bytes = vec![];
        edges.write(&mut bytes).unwrap();
        assert!(EdgesOf::read(&mut &bytes[1..]).is_ok_and(|read| read == edges));
        let counts = Counts {
            classes: [1, 2, 3, 4, 5, u32::MAX],
            charged: 7,
            charging: 8,
            waited: 9,
            ignited: 10,
            waits: 11,
            unclear: 12,
        };
        assert_eq!(counts_of(&counts_numbers(&counts)), counts);
        let piece = Piece { shape: Shape::YzBack, to: [-1, 2, i64::MIN], centre: [-3, 4], mark: true, stop: false };
        for command in [
            Command::MoveBy(Nanometres(-1_234_567)),
            Command::SetHome(Nanometres(5)),
            Command::Start,
            Command::AppendTo(piece),
            Command::AppendBy(Piece { mark: false, stop: true, ..piece }),
        ] {
            assert_eq!(command_of(&command_numbers(command)).unwrap(), command);
        }
        let counters = Counters {
            watch: Some(RawCount { count: u32::MAX, last_edge: 3, toward_work: true, now: 9 }),
            drive_stands: true,
            ..Counters::default()
        };
        let input = TickInput {
            reported: Some(Fault::BusSag),
            set_point: Some(SetPoint { to: Nanometres(-7), counts: Fixed(-9), ticks: 20 }),
            safety: Some(SafetyInputs { lower_limit: true, supply_low: true, ..SafetyInputs::default() }),
            reflex: true,
            ..TickInput::default()
        };
        let followed = Status { fault: None, ..status() };
        assert_eq!(tick_of(&tick_numbers(&input, &counters, &followed)).unwrap(), (input, counters, followed));
        assert_eq!(plan_of(&plan_numbers(&planned())).unwrap(), planned());
    }

    #[test]
    fn a_file_that_is_none_or_ends_early_is_refused() {
        assert!(matches!(replay(&b"EDMR\x05..."[..]), Err(Error::Foreign)));
        assert!(matches!(replay(&b"ED"[..]), Err(Error::Io(_))));
        let mut recorder = Recorder::new(Vec::new()).unwrap();
        recorder.event(&Event::Tick(TickInput::default(), Counters::default(), status())).unwrap();
        let mut whole = recorder.finish().unwrap();
        whole.truncate(whole.len() - 5);
        assert!(matches!(replay(&whole[..]), Err(Error::Io(_))));
    }

    /// Replays the first tick of a head at rest, with the recorded outcome spoilt.
    fn first_tick(spoil: impl Fn(&mut Status)) -> Result<u64, Error> {
        let settings = Settings { commissioned: true, ..Settings::default() };
        let mut head = Head::new(settings.build().unwrap().head, Box::new(Path::EMPTY));
        let drive = DriveCodes { motor_current: 2048, bus_voltage: 3137 };
        head.tick(&Inputs { drive, ..Inputs::default() });
        let input = TickInput { drive, ..TickInput::default() };
        let mut status = *head.status();
        spoil(&mut status);
        let mut recorder = Recorder::new(Vec::new()).unwrap();
        recorder.event(&Event::Tick(input, Counters::default(), status)).unwrap();
        replay(&recorder.finish().unwrap()[..])
    }

    #[test]
    fn a_difference_of_one_bit_is_found() {
        assert_eq!(first_tick(|_| ()).unwrap(), 1);
        let spoilt = first_tick(|status| status.duty = f32::from_bits(status.duty.to_bits() ^ 1));
        assert!(matches!(spoilt, Err(Error::Differs(what)) if what.contains("duty")));
    }
}
