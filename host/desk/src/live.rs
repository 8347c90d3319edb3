//! Present state of a head, and its events.
//!
//! Values come from process data, as the head maps them and its description file describes them; values that these lack, or
//! carry too rarely, are read by SDO.

use crate::bus::{Heard, SILENCE};
use crate::gap;
use crate::head::{Head, NO_SURFACE, at, state, unsigned};
use crate::sdo::{Address, SdoError};
use crate::{Failure, words};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, VecDeque};
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Age up to which a value of process data is taken for the present one.
const FRESH: Duration = Duration::from_millis(120);
/// Time after which the surface of the hole is read again.
const KEPT: Duration = Duration::from_secs(1);
/// Events kept until they are taken.
const EVENTS: usize = 256;

/// What happened.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub struct Event {
    /// When, ms since 1970.
    pub unix_ms: u64,
    /// Node-ID; 0 for this program.
    pub node: u8,
    /// Of what kind.
    pub kind: Kind,
    /// In words.
    pub what: String,
}

/// Kind of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// What this program or a session of its page did.
    Program,
    /// A change of state.
    State,
    /// A fault, or an emergency message.
    Fault,
    /// A command was refused.
    Refusal,
}

impl Event {
    /// What happens now.
    pub fn now(node: u8, kind: Kind, what: String) -> Event {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Event { unix_ms: since.as_millis() as u64, node, kind, what }
    }
}

/// What a head does.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sample {
    /// Time since the watch began, ms.
    pub at_ms: u64,
    /// Node-ID.
    pub node: u8,
    /// State, in words.
    pub state: String,
    /// Number of the state.
    pub state_number: u8,
    /// Why the state changed last.
    pub reason: &'static str,
    /// The fault, and what to do; `none`.
    pub fault: String,
    /// Number of the fault, 0 for none.
    pub fault_number: u8,
    /// Absolute positions are valid.
    pub homed: bool,
    /// Position, positive toward the work.
    pub position_mm: f64,
    /// Deepest position of the present or last erosion.
    pub deepest_mm: f64,
    /// Surface that the hole under the electrode is measured from, as the head keeps it (2011h:11).
    pub surface_mm: Option<f64>,
    /// Gap voltage after the filters; nothing while it is not measured, as without pulses.
    pub gap_v: Option<f64>,
    /// Gap voltage to keep.
    pub setpoint_v: f64,
    /// Open-circuit voltage.
    pub open_v: f64,
    /// Velocity along the path that the gap requests; none while it is not used.
    pub feed_um_s: Option<f64>,
    /// Retreats from a short since power-on.
    pub shorts: u32,
}

/// One process data object that the head sends.
struct Pdo {
    id: u16,
    /// What it carries, and how many bytes of each.
    carries: Vec<(Address, usize)>,
}

/// Observer of one head.
pub struct Live {
    head: Head,
    heard: Receiver<Heard>,
    began: Instant,
    pdos: Vec<Pdo>,
    values: BTreeMap<Address, (Instant, Vec<u8>)>,
    states: BTreeMap<i64, String>,
    counts_per_mm: f64,
    /// When the node was heard last.
    beat: Option<Instant>,
    /// Since when it is to send heartbeats.
    expected: Option<Instant>,
    events: VecDeque<Event>,
    last: Option<(u8, u8)>,
    refusals: Option<u32>,
    /// Surface of the hole, and when it was read.
    surface: Option<(Instant, Option<f64>)>,
    /// There were pulses at the last sample.
    pulses: bool,
}

impl Sample {
    /// The deepest position that it knows of, mm. While the head erodes that is of this erosion, by the head, which sees what lies
    /// between two samples; otherwise where the electrode is now.
    pub fn deepest(&self) -> f64 {
        if state::LED.contains(&self.state_number) { self.position_mm.max(self.deepest_mm) } else { self.position_mm }
    }
}

impl Live {
    /// Begins to watch.
    ///
    /// # Errors
    /// Those of the transfers.
    pub fn new(head: &Head) -> Result<Live, Failure> {
        let mut pdos = Vec::new();
        for number in 0..4 {
            let id = unsigned(&head.sdo.read(Address(0x1800 + number, 1))?);
            let count = unsigned(&head.sdo.read(Address(0x1A00 + number, 0))?);
            if id >> 31 == 1 {
                continue;
            }
            let mut carries = Vec::new();
            for sub in 1..=count.min(8) as u8 {
                let entry = unsigned(&head.sdo.read(Address(0x1A00 + number, sub))?);
                carries.push((Address((entry >> 16) as u16, (entry >> 8) as u8), (entry & 0xFF) as usize / 8));
            }
            pdos.push(Pdo { id: (id & 0x7FF) as u16, carries });
        }
        let states = head.sheet.get(at::STATE).map(|object| object.names()).unwrap_or_default();
        Ok(Live {
            heard: head.bus.listen(),
            began: Instant::now(),
            pdos,
            values: BTreeMap::new(),
            states,
            counts_per_mm: head.counts_per_mm()?,
            beat: None,
            expected: None,
            events: VecDeque::new(),
            last: None,
            refusals: None,
            surface: None,
            pulses: false,
            head: head.clone(),
        })
    }

    /// Names of the states, by number.
    pub fn states(&self) -> &BTreeMap<i64, String> {
        &self.states
    }

    /// The state of this number, in words.
    pub fn state(&self, number: u8) -> String {
        self.states.get(&number.into()).cloned().unwrap_or_else(|| format!("state {number}"))
    }

    /// From now on a head whose heartbeat ends is lost.
    pub fn expect_heartbeat(&mut self) {
        self.expected = Some(Instant::now());
    }

    /// A head that was reset sends none until it is requested.
    pub fn expect_no_heartbeat(&mut self) {
        self.expected = None;
    }

    /// How long ago the node was heard, if it was.
    pub fn heartbeat_age(&self) -> Option<Duration> {
        self.beat.map(|at| at.elapsed())
    }

    /// Encoder counts in a millimetre.
    pub fn counts_per_mm(&self) -> f64 {
        self.counts_per_mm
    }

    /// What has happened since the last call.
    pub fn events(&mut self) -> Vec<Event> {
        self.take();
        self.events.drain(..).collect()
    }

    /// What the head does now.
    ///
    /// # Errors
    /// When it has fallen silent.
    pub fn sample(&mut self) -> Result<Sample, Failure> {
        self.take();
        if self.expected.is_some_and(|since| self.beat.max(Some(since)).is_some_and(|at| at.elapsed() > SILENCE)) {
            let silence = SILENCE.as_millis();
            return Err(Failure::Failed(format!(
                "node {}: no heartbeat for {silence} ms: check its power and the cable; the head retreats by itself",
                self.head.node
            )));
        }
        let per_mm = self.counts_per_mm;
        let state_number = self.number(at::STATE)? as u8;
        let fault_number = self.number(at::FAULT)? as u8;
        let reason = words::reason(self.number(at::REASON)? as u8);
        if self.last.is_some_and(|last| last != (state_number, fault_number)) {
            let fault =
                if fault_number == 0 { String::new() } else { format!(": {}", words::fault_line(fault_number)) };
            let state = self.state(state_number);
            let why = if reason == state { String::new() } else { format!(" ({reason})") };
            let kind = if fault.is_empty() { Kind::State } else { Kind::Fault };
            self.report(kind, format!("{state}{why}{fault}"));
        }
        self.last = Some((state_number, fault_number));
        let measured = gap::MEASURED.contains(&(self.number(at::GAP_QUALITY)? as i64));
        let gap_v = if measured { Some(self.number(at::GAP)?) } else { None };
        let feed_um_s = if state::LED.contains(&state_number) { Some(self.number(at::FEED)?) } else { None };
        Ok(Sample {
            at_ms: self.began.elapsed().as_millis() as u64,
            node: self.head.node,
            state: self.state(state_number),
            state_number,
            reason,
            fault: words::fault_line(fault_number),
            fault_number,
            homed: self.number(at::HOMED)? != 0.0,
            position_mm: self.number(at::POSITION)? / per_mm,
            deepest_mm: self.number(at::DEEPEST)? / per_mm,
            surface_mm: self.surface(state_number)?,
            gap_v,
            setpoint_v: self.number(at::SETPOINT)?,
            open_v: self.number(at::OPEN)?,
            feed_um_s,
            shorts: self.number(at::SHORTS)? as u32,
        })
    }

    /// The surface that the head keeps, mm. It is read again when it is old, and when pulses have been switched on since.
    fn surface(&mut self, state_number: u8) -> Result<Option<f64>, Failure> {
        let pulses = state::LED.contains(&state_number);
        if let Some((read, surface)) = self.surface
            && read.elapsed() < KEPT
            && (self.pulses || !pulses)
        {
            self.pulses = pulses;
            return Ok(surface);
        }
        self.pulses = pulses;
        let kept = Some(self.head.whole(at::KEPT_SURFACE)?).filter(|kept| *kept != NO_SURFACE);
        let surface = kept.map(|counts| counts as f64 / self.counts_per_mm);
        self.surface = Some((Instant::now(), surface));
        Ok(surface)
    }

    /// A value in its unit.
    fn number(&mut self, address: Address) -> Result<f64, Failure> {
        let Some((_, bytes)) = self.values.get(&address).filter(|(at, _)| at.elapsed() < FRESH) else {
            return Ok(self.head.number(address)?);
        };
        let number = self.head.sheet.get(address).and_then(|object| object.number(bytes));
        Ok(number.ok_or(SdoError::Garbled(self.head.node, address))?)
    }

    fn report(&mut self, kind: Kind, what: String) {
        if self.events.len() == EVENTS {
            self.events.pop_front();
        }
        self.events.push_back(Event::now(self.head.node, kind, what));
    }

    /// Takes what was heard.
    fn take(&mut self) {
        let node = u16::from(self.head.node);
        while let Ok(heard) = self.heard.try_recv() {
            match (heard.id, heard.data()) {
                (id, [0]) if id == 0x700 + node => self.report(Kind::State, "has restarted".into()),
                (id, [_]) if id == 0x700 + node => self.beat = Some(heard.at),
                (id, [low, high, ..]) if id == 0x80 + node => {
                    let code = u16::from_le_bytes([*low, *high]);
                    let kind = if code == 0 { Kind::State } else { Kind::Fault };
                    self.report(kind, format!("emergency {code:04X}h: {}", words::emergency(code)));
                }
                (id, data) => self.mapped(id, data, heard.at),
            }
        }
    }

    fn mapped(&mut self, id: u16, data: &[u8], at: Instant) {
        let Some(pdo) = self.pdos.iter().find(|pdo| pdo.id == id) else { return };
        let mut rest = data;
        for (address, size) in &pdo.carries {
            let Some((value, after)) = rest.split_at_checked(*size) else { return };
            self.values.insert(*address, (at, value.to_vec()));
            rest = after;
        }
        let value = |address| self.values.get(&address).map(|(_, bytes)| unsigned(bytes));
        if let (Some(count), Some(refusal)) = (value(at::REFUSALS), value(at::REFUSAL))
            && self.refusals.replace(count).is_some_and(|last| last != count)
        {
            let words = words::refusal(refusal as u8);
            self.report(Kind::Refusal, format!("refused: {}; {}", words.name, words.advice));
        }
    }
}
