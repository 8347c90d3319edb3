//! A synthetic machine for measuring the firmware: an axis, a gap that conducts near the work, a generator, and edges on
//! demand. Not the process model: its behaviour is simple and known, and each of its events can be placed to the tick.

use crate::live::Latch;
use crate::wires::*;
use edm_sim::process::current_code;
use edm_soc::{CanReply, Change, Drive, Frame, NEVER, Pin, TICK_HZ, World};
use std::collections::BTreeMap;

/// Servo tick and step of the axis, ticks of the chip.
pub const TICK: u64 = TICK_HZ / 20_000;
const STEP: u64 = TICK / 4;
/// The axis of the default settings: mass, force constant, resistance, bus, weight less counterbalance (SI units).
const MASS: f64 = 0.2;
const FORCE: f64 = 7.5;
const OHM: f64 = 12.4;
const BUS: f64 = 48.0;
/// Converter codes: docs/wiring.md.
const AMPS_PER_CODE: f64 = 0.00269;
const VOLTS_PER_CODE: f64 = 0.0153;
const WEIGHT: f64 = 0.2 * 9.806_65 - 2.2;
/// Friction, N s/m (assumed).
const DAMPING: f64 = 2.0;
/// Counts of vibration about the position of the axis.
const SWING: i64 = 4;
/// A pulse is charged to this, and burns at that, V.
const OPEN: f64 = 100.0;
const BURN: f64 = 40.0;
/// Current of a discharge or a short, A (assumed).
const DISCHARGE_A: f64 = 10.0;
/// Shorter waits are none, ticks of the chip.
const CHARGES: u64 = 100;
/// Share of the on-time by which ignitions are spread about their mean (assumed).
const SPREAD: f64 = 0.4;
/// Between edges of an axis that does not vibrate, ticks of the chip.
const REST: u64 = 300;
/// The generator closes the gate so long after it is no longer allowed (assumed).
const GATE_OFF: u64 = 17;

/// How the rig behaves.
#[derive(Clone, Copy, Debug)]
pub struct Behaviour {
    /// Edges of a vibrating axis, per second; it swings by a few counts about its place.
    pub edges_per_s: u64,
    /// From one pulse to the next, and how long each is, ticks of the chip.
    pub pulse: (u64, u64),
    /// So many pulses meet a short, of so many.
    pub shorts: (u64, u64),
}

/// What a busy host sends: its set points and SYNC, and a request as soon as the last is answered.
#[derive(Clone, Debug, Default)]
pub struct Traffic {
    /// Sent together, so long before SYNC, ticks of the chip.
    pub before_sync: u64,
    /// From one SYNC to the next, ticks of the chip.
    pub period: u64,
    /// Frames before SYNC.
    pub objects: Vec<Frame>,
    /// SYNC.
    pub sync: Option<Frame>,
    /// Requests, in turn, without end.
    pub requests: Vec<Frame>,
    /// Identifier of the answers, and how long a request takes on the bus.
    pub answer: (u32, u64),
}

/// A short pulse: gate open, voltage sampled, pulses off.
#[derive(Clone, Copy, Debug, Default)]
pub struct Short {
    /// The gate opened into the short.
    pub opened: u64,
    /// Its voltage was sampled.
    pub sampled: Option<u64>,
    /// The generator was inhibited.
    pub killed: Option<u64>,
}

/// The end of a pulse, and what became of the line that allows pulses.
#[derive(Clone, Copy, Debug)]
pub struct End {
    /// The gate closed while pulses were allowed.
    pub closed: u64,
    /// They were inhibited.
    pub inhibited: Option<u64>,
    /// They were allowed again.
    pub allowed: Option<u64>,
}

/// The machine around the chip.
#[derive(Clone)]
pub struct Rig {
    behaviour: Behaviour,
    disturbed: bool,
    changes: BTreeMap<(u64, u64), Change>,
    serial: u64,
    next_step: u64,
    /// Position, m below the start, and velocity.
    x: f64,
    v: f64,
    traffic: Traffic,
    next_sync: u64,
    requested: usize,
    /// The index line is high at this count.
    pub mark: Option<i64>,
    /// Surface of the work, m below the start.
    pub work: f64,
    count: i64,
    direction: i64,
    next_edge: u64,
    pwm: Drive,
    forward: bool,
    reverse: bool,
    allowed: bool,
    /// Without it neither pulses nor bridge.
    pub latch: Latch,
    gate: bool,
    next_pulse: u64,
    pulses: u64,
    gate_until: u64,
    /// When the pulse under way ignites.
    ignites: u64,
    /// Shorts met.
    pub shorts: Vec<Short>,
    /// Ends of pulses, but for those that the head has cut off.
    pub ends: Vec<End>,
    /// Edges of the encoder so far, and the count that they amount to.
    pub edges: Vec<u64>,
    /// Frames of the chip.
    pub frames: Vec<(u64, Frame)>,
    /// Changes of the PWM output, and whether it was on.
    pub outputs: Vec<(u64, Drive)>,
}

impl Rig {
    /// A head well above the work, at rest.
    pub fn new(behaviour: Behaviour) -> Self {
        let mut rig = Self {
            behaviour,
            disturbed: false,
            changes: BTreeMap::new(),
            serial: 0,
            next_step: 1,
            x: 0.0,
            v: 0.0,
            traffic: Traffic::default(),
            next_sync: NEVER,
            requested: 0,
            mark: None,
            work: 80e-6,
            count: 0,
            direction: 1,
            next_edge: NEVER,
            pwm: Drive::Released,
            forward: false,
            reverse: false,
            allowed: false,
            latch: Latch::default(),
            gate: false,
            next_pulse: 0,
            pulses: 0,
            gate_until: NEVER,
            ignites: NEVER,
            shorts: Vec::new(),
            ends: Vec::new(),
            edges: Vec::new(),
            frames: Vec::new(),
            outputs: Vec::new(),
        };
        let [a, b, index] = ENCODER;
        let low = CONTACTS.into_iter().chain([a, b, index]).chain(GATE).chain(COMPARATORS);
        low.for_each(|pin| rig.level(0, pin, false));
        for pin in STEPS.into_iter().chain([BRIDGE_FAULT]) {
            rig.level(0, pin, true);
        }
        rig
    }

    /// A change at a time that has not passed yet.
    pub fn change(&mut self, at: u64, change: Change) {
        self.serial += 1;
        self.changes.insert((at, self.serial), change);
    }

    /// A pin is driven from `at` on.
    pub fn level(&mut self, at: u64, pin: Pin, level: bool) {
        self.change(at, Change::Level(pin, Some(level)));
    }

    /// Edges come at another rate from now on.
    pub fn vibrate(&mut self, edges_per_s: u64) {
        self.behaviour.edges_per_s = edges_per_s;
        self.disturb();
    }

    /// A busy host, from `at` on.
    pub fn busy(&mut self, at: u64, traffic: Traffic) {
        self.traffic = traffic;
        self.next_sync = at;
        self.request(at);
    }

    fn request(&mut self, at: u64) {
        if let Some(frame) = self.traffic.requests.get(self.requested % self.traffic.requests.len().max(1)) {
            let frame = *frame;
            self.requested += 1;
            self.change(at + self.traffic.answer.1, Change::Can(frame));
        }
    }

    fn synchronise(&mut self) {
        let at = self.next_sync;
        self.next_sync += self.traffic.period;
        for frame in self.traffic.objects.clone() {
            self.change(at, Change::Can(frame));
        }
        if let Some(sync) = self.traffic.sync {
            self.change(at + self.traffic.before_sync, Change::Can(sync));
        }
    }

    /// Starts vibrating, and meeting shorts.
    pub fn disturb(&mut self) {
        self.disturbed = true;
        if self.behaviour.edges_per_s > 0 {
            self.next_edge = self.next_step;
        }
    }

    /// Stops vibrating, and meeting shorts.
    pub fn calm(&mut self) {
        self.disturbed = false;
        self.next_edge = NEVER;
    }

    /// The pulse under way meets a short.
    fn shorted(&self) -> bool {
        let (shorts, of) = self.behaviour.shorts;
        self.disturbed && self.pulses % of >= of - shorts
    }

    /// Count of the encoder, positive toward the work.
    pub fn count(&self) -> i64 {
        self.count
    }

    /// Mean of the pulse under way, V.
    fn mean_volts(&self) -> f64 {
        if !self.gate || self.shorted() { 0.0 } else { ((self.work - self.x) * 2e6).clamp(0.0, OPEN) }
    }

    /// The pulse under way waits at [`OPEN`] and burns at [`BURN`], so long that the mean comes to that of its place; nearer to the work than
    /// that it burns lower from its beginning.
    fn gap_volts(&self, at: u64) -> f64 {
        let mean = self.mean_volts();
        if mean > BURN && at < self.ignites { OPEN } else { mean.min(BURN) }
    }

    /// Share of the on-time after which the pulse that begins ignites; 1: not at all.
    fn waits(&self) -> f64 {
        let share = (self.mean_volts() - BURN) / (OPEN - BURN);
        // Of the number of the pulse, multiplied by the golden section of 2^64.
        let chance = (self.pulses.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 32) as f64 / f64::from(u32::MAX);
        let spread = SPREAD * share.min(1.0 - share).max(0.0);
        share + spread * (2.0 * chance - 1.0)
    }

    fn duty(&self) -> f64 {
        let share = match self.pwm {
            _ if !self.latch.enables() => return 0.0,
            Drive::Pwm { high, period } => f64::from(high) / f64::from(period.max(1)),
            Drive::Level(true) => 1.0,
            _ => return 0.0,
        };
        share * (f64::from(u8::from(self.forward)) - f64::from(u8::from(self.reverse)))
    }

    fn edge(&mut self, at: u64, by: i64) {
        self.count += by;
        let phase = self.count.rem_euclid(4);
        // A leads B toward the work.
        let (a, b) = (phase == 1 || phase == 2, phase >= 2);
        let (old_a, old_b) = ((phase - by).rem_euclid(4), (phase - by).rem_euclid(4) >= 2);
        let old_a = old_a == 1 || old_a == 2;
        if a != old_a {
            self.level(at, ENCODER[0], a);
        }
        if b != old_b {
            self.level(at, ENCODER[1], b);
        }
        if let Some(mark) = self.mark
            && (self.count == mark || self.count - by == mark)
        {
            self.level(at, ENCODER[2], self.count == mark);
        }
        self.edges.push(at);
    }

    fn set_gate(&mut self, at: u64, open: bool) {
        self.gate = open;
        self.ignites = NEVER;
        for pin in GATE {
            self.level(at, pin, open);
        }
        if open && self.mean_volts() < OPEN {
            let waits = (self.waits().clamp(0.0, 1.0) * (self.gate_until - at) as f64) as u64;
            // What would not wait for the comparator burns from its beginning.
            self.ignites = at + if waits < CHARGES { 0 } else { waits };
        }
        let volts = self.gap_volts(at);
        for (pin, threshold) in COMPARATORS.into_iter().zip([0.7 * OPEN, 20.0]) {
            self.level(at, pin, volts > threshold);
        }
        if open && self.ignites > at && self.ignites < self.gate_until {
            self.level(self.ignites, COMPARATORS[0], false);
        }
    }

    /// A quarter of a servo tick from `at` on.
    fn step(&mut self, at: u64) {
        let dt = STEP as f64 / TICK_HZ as f64;
        let driven = self.latch.enables() && !matches!(self.pwm, Drive::Released);
        let current = if driven { (self.duty() * BUS - FORCE * self.v) / OHM } else { 0.0 };
        self.v += (FORCE * current + WEIGHT - DAMPING * self.v) / MASS * dt;
        self.x += self.v * dt;
        // The upper stop.
        if self.x < 0.0 {
            (self.x, self.v) = (0.0, 0.0);
        }
        let place = (self.x * 1e6).round() as i64;
        // At rest the axis makes its own edges; a vibrating one makes them all, at its rate, about its place.
        let mut next = at + REST;
        while self.next_edge == NEVER && self.count != place && next < at + STEP {
            self.edge(next, (place - self.count).signum());
            next += REST;
        }
        while self.next_edge < at + STEP {
            let off = self.count - place;
            if off.abs() >= SWING {
                self.direction = -off.signum();
            }
            self.edge(self.next_edge, self.direction);
            self.next_edge += TICK_HZ / self.behaviour.edges_per_s.max(1);
        }
    }

    fn pulse(&mut self, at: u64) {
        if self.gate {
            self.gate_until = NEVER;
            self.set_gate(at, false);
            if self.allowed {
                self.ends.push(End { closed: at, inhibited: None, allowed: None });
            }
        } else {
            self.next_pulse = at + self.behaviour.pulse.0;
            if self.permits() {
                self.pulses += 1;
                self.gate_until = at + self.behaviour.pulse.1;
                self.set_gate(at, true);
                if self.shorted() {
                    self.shorts.push(Short { opened: at, ..Short::default() });
                }
            }
        }
    }

    /// The generator is allowed pulses.
    pub fn permits(&self) -> bool {
        self.allowed && self.latch.enables()
    }

    /// The bridge drives the coil.
    pub fn drives(&self) -> bool {
        self.duty() != 0.0
    }

    /// The generator's gate is open.
    pub fn gate(&self) -> bool {
        self.gate
    }

    /// Pulses so far.
    pub fn pulses(&self) -> u64 {
        self.pulses
    }

    fn next_gate(&self) -> u64 {
        if self.gate { self.gate_until } else { self.next_pulse }
    }
}

impl World for Rig {
    fn sample(&mut self, adc: u8, channel: u8, at: u64) -> u16 {
        let volts = self.gap_volts(at);
        let code = match (adc, channel) {
            (1, GAP) => 410.0 + volts * 10.0,
            (2, GATED) => {
                if let Some(short) = self.shorts.last_mut().filter(|s| volts == 0.0 && s.sampled.is_none()) {
                    short.sampled = Some(at);
                }
                410.0 + volts * 10.0
            }
            (2, GAP_CURRENT) => current_code(if self.gate && volts < 85.0 { DISCHARGE_A } else { 0.0 }),
            (3, MOTOR_CURRENT) => 2048.0 + (self.duty() * BUS - FORCE * self.v) / OHM / AMPS_PER_CODE,
            (3, BUS_VOLTAGE) => BUS / VOLTS_PER_CODE,
            (_, 16) => 930.0,
            (_, 17) => 1502.0,
            _ => 0.0,
        };
        // The gap is sampled with a noise of two codes, of the time multiplied by the golden section of 2^64.
        let noise = (at.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 32) % 5;
        let noise = if adc < 3 { noise as f64 - 2.0 } else { 0.0 };
        (code + noise).clamp(0.0, 4095.0) as u16
    }

    fn next_change(&self) -> u64 {
        let queued = self.changes.first_key_value().map_or(NEVER, |c| c.0.0);
        queued.min(self.next_step).min(self.next_gate()).min(self.next_sync).min(self.latch.next_change())
    }

    fn take_change(&mut self, at: u64) -> Option<Change> {
        while self.next_step <= at {
            let step = self.next_step;
            self.next_step += STEP;
            self.step(step);
        }
        while self.next_gate() <= at {
            let due = self.next_gate();
            self.pulse(due);
        }
        while self.next_sync <= at {
            self.synchronise();
        }
        if let Some(change) = self.latch.take_change(at) {
            if self.gate && !self.permits() {
                self.gate_until = self.gate_until.min(at + GATE_OFF);
            }
            return Some(change);
        }
        let first = self.changes.first_entry()?;
        (first.key().0 <= at).then(|| first.remove())
    }

    fn drive(&mut self, at: u64, pin: Pin, drive: Drive) {
        self.latch.drive(at, pin, drive);
        let on = drive == Drive::Level(true);
        if pin == PWM {
            self.pwm = drive;
            self.outputs.push((at, drive));
        } else if pin == FORWARD {
            self.forward = on;
        } else if pin == REVERSE {
            self.reverse = on;
        } else if pin == ALLOW {
            if self.allowed && !on {
                if let Some(short) = self.shorts.last_mut().filter(|s| s.sampled.is_some() && s.killed.is_none()) {
                    short.killed = Some(at);
                }
                if self.gate {
                    self.gate_until = self.gate_until.min(at + GATE_OFF);
                }
            }
            if let Some(end) = self.ends.last_mut().filter(|_| self.allowed != on) {
                let place = if on { &mut end.allowed } else { &mut end.inhibited };
                place.get_or_insert(at);
            }
            self.allowed = on;
        }
    }

    fn can_sent(&mut self, at: u64, frame: Frame) -> CanReply {
        self.frames.push((at, frame));
        if frame.id == self.traffic.answer.0 {
            self.request(at);
        }
        CanReply::Acknowledged
    }

    fn dac(&mut self, _: u64, _: u8, _: u16) {}
}
