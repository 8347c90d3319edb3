//! The process model around the chip: the signals of docs/wiring.md, at their own instants.
//!
//! The process advances in *windows* of one servo tick that begin with the periods of the PWM, so that the duty of a window
//! is exactly the one in force. A window is computed just after it has begun (16 cycles), under what the chip drives its
//! pins with at that moment; a direction pin, or the line that allows pulses, that changes inside a window acts on the
//! next one, up to 50 us late; so does the latch of the live signal. With [`Bench::exact`] what allows pulses acts at once: the rest of the
//! window is computed again. Voltages, edges of gate, comparators and encoder come at
//! their own times inside the window.
//!
//! Noise and hum of a conversion are those of the nearest conversion of the process model's own block.

use crate::live::Latch;
use crate::wires::*;
use edm_hal_shim::bridge::Drive as Bridge;
use edm_hal_shim::gap::BLOCK;
use edm_hal_shim::safety::{DriveCodes, SafetyInputs};
use edm_sim::process::steps::StepEdge;
use edm_sim::process::{Installation, Piece, Plant, Process, crossing, current_code, discharges};
use edm_soc::{CanReply, Change, Drive, Frame, NEVER, Pin, TICK_HZ, World};
use std::collections::VecDeque;

/// Ticks of a window.
pub const WINDOW: u64 = TICK_HZ / 20_000;
/// From the beginning of a window to the moment at which it is computed: outputs that change with the period have changed.
const SETTLE: u64 = 16;
/// Length of a pulse that a discharge couples into a line that is cut (assumed).
const COUPLED: u64 = TICK_HZ / 10_000_000;
/// Rise times after which a transient is over: e^-40 is 4e-18.
const SETTLED: f64 = 40.0;

/// Process, wires and the host's end of the bus.
#[derive(Clone)]
pub struct Bench {
    /// The machine and the process.
    pub process: Process,
    /// Frames the chip has sent, and when they ended.
    pub sent: VecDeque<(u64, Frame)>,
    /// What becomes of the frames that it sends.
    pub reply: CanReply,
    installation: Installation,
    window: u64,
    changes: VecDeque<(u64, Change)>,
    frames: VecDeque<(u64, Frame)>,
    pieces: Vec<Piece>,
    /// What the drive's sensors showed when the window began.
    sensed: DriveCodes,
    /// What the bridge did when its PWM was forced on, which the reflex alone does.
    pub forced: Vec<Bridge>,
    pwm: Drive,
    forward: bool,
    reverse: bool,
    allowed: bool,
    /// Without it neither pulses nor bridge.
    pub latch: Latch,
    levels: [[Option<bool>; 16]; 3],
    /// What of them has reached the chip.
    shown: [[Option<bool>; 16]; 3],
    /// Lines that are cut or shorted, and the level at the chip's pin.
    stuck: Vec<(Pin, Option<bool>)>,
    /// Lines of the encoder that are cut and pick up what discharges couple into them.
    floating: Vec<Pin>,
    /// Codes of converter and channel, whatever is at their pins.
    pub codes: Vec<((u8, u8), u16)>,
    /// The receiver's line is cut: no frame comes, and none of the chip's is read back.
    pub deaf: bool,
    /// The leads of the motor are swapped.
    pub swapped: bool,
    /// Since when there may be no pulses.
    pub off: Option<u64>,
    /// What allows pulses acts at its own instant. It costs a copy of the process in each window.
    pub exact: bool,
    began: Option<Box<Began>>,
    /// Edges of the gate, and of the line that allows pulses, with [`Bench::exact`].
    pub train: Vec<(u64, Line, bool)>,
    /// When the gate has fallen, as the chip saw it, where somebody wants to know.
    pub falls: Option<Vec<u64>>,
}

/// What [`Bench::train`] shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Line {
    /// The generator's gate.
    Gate,
    /// Pulses allowed.
    Allowed,
}

/// How the present window began, and what has allowed pulses in it since.
#[derive(Clone)]
struct Began {
    process: Process,
    levels: [[Option<bool>; 16]; 3],
    bridge: Bridge,
    pulses: bool,
    /// Times, us, and whether there may be pulses from then on.
    permission: Vec<(f64, bool)>,
}

impl Bench {
    /// A head at rest at its upper stop, wired to a chip without power.
    ///
    /// # Errors
    /// When a parameter is refused.
    pub fn new(plant: &Plant, seed: u64) -> Result<Self, String> {
        let process = Process::new(*plant, seed).map_err(|e| e.to_string())?;
        let mut bench = Self {
            sensed: process.sensors().drive,
            process,
            sent: VecDeque::new(),
            reply: CanReply::Acknowledged,
            installation: plant.installation,
            window: 0,
            changes: VecDeque::new(),
            frames: VecDeque::new(),
            pieces: Vec::new(),
            forced: Vec::new(),
            pwm: Drive::Released,
            forward: false,
            reverse: false,
            allowed: false,
            latch: Latch::default(),
            levels: [[None; 16]; 3],
            shown: [[None; 16]; 3],
            stuck: Vec::new(),
            floating: Vec::new(),
            codes: Vec::new(),
            deaf: false,
            swapped: false,
            off: Some(0),
            exact: false,
            began: None,
            train: Vec::new(),
            falls: None,
        };
        bench.wire(0, 0);
        Ok(bench)
    }

    /// Replaces the machine by one at rest at its upper stop, with the workpiece of `plant`: the chip stays on.
    ///
    /// # Errors
    /// When a parameter is refused.
    pub fn mount(&mut self, plant: &Plant, seed: u64) -> Result<(), String> {
        self.process = Process::new(*plant, seed).map_err(|e| e.to_string())?;
        (self.installation, self.began) = (plant.installation, None);
        self.wire(self.window, self.window);
        Ok(())
    }

    /// Lets windows begin at `tick` and every [`WINDOW`] after it; the present one ends then.
    pub fn align(&mut self, tick: u64) {
        self.window = tick;
    }

    /// Beginning of the next window.
    pub fn window(&self) -> u64 {
        self.window
    }

    /// The host sends `frame`; it ends at `at`, or as soon as it can follow those sent earlier on a bus of 1 Mbit/s.
    /// Gives the time at which it ends.
    pub fn send(&mut self, at: u64, frame: Frame) -> u64 {
        let after = self.frames.back().map_or(0, |f| f.0 + frame.bits() * (TICK_HZ / 1_000_000));
        let end = at.max(after);
        self.frames.push_back((end, frame));
        end
    }

    /// What the bridge does to the coil under the pins as they are.
    fn bridge(&self) -> Bridge {
        if !self.latch.enables() {
            return Bridge::Coast;
        }
        if self.forward == self.reverse {
            return if self.forward { Bridge::Brake } else { Bridge::Coast };
        }
        let (high, period) = match self.pwm {
            Drive::Pwm { high, period } => (high, period.max(1)),
            Drive::Level(true) => (1, 1),
            Drive::Level(false) | Drive::Released => (0, 1),
        };
        let full = f64::from(Bridge::FULL);
        let duty = (full * f64::from(high) / f64::from(period)).round() as i16;
        Bridge::Duty(if self.forward == self.swapped { -duty } else { duty })
    }

    /// Computes the window that begins now, and what its wires do.
    fn advance(&mut self) {
        let from = self.window;
        self.window += WINDOW;
        self.sensed = self.process.sensors().drive;
        let before = self.process.sensors().now;
        let (bridge, pulses) = (self.bridge(), self.allowed && self.latch.enables());
        self.began = self.exact.then(|| {
            let (process, levels) = (self.process.clone(), self.levels);
            Box::new(Began { process, levels, bridge, pulses, permission: Vec::new() })
        });
        self.process.advance(bridge, pulses);
        let edges = std::mem::take(&mut self.changes).into_iter().collect();
        self.changes = self.edges(edges, from, before).into();
    }

    /// What allows pulses has changed, perhaps: what has not happened yet of the present window is computed again.
    fn permit(&mut self, at: u64) {
        let (from, pulses) = (self.window.saturating_sub(WINDOW), self.allowed && self.latch.enables());
        let Some(began) = self.began.as_mut().filter(|_| (from..self.window).contains(&at)) else { return };
        if began.permission.last().map_or(began.pulses, |last| last.1) == pulses {
            return;
        }
        began.permission.push((us((at - from) as i64), pulses));
        let before = began.process.sensors().now;
        self.process.repeat(&began.process, began.bridge, began.pulses, &began.permission);
        self.levels = began.levels;
        let mut edges = self.edges(Vec::new(), from, before);
        // What is past is past, but for its outcome: an edge that lay ahead may now lie behind. Of what happens now the chip has seen a part,
        // perhaps.
        let ahead = edges.partition_point(|(time, _)| *time < at);
        for k in 0..ahead {
            let of = |change: Change| if let Change::Level(pin, _) = change { Some(pin) } else { None };
            let last = edges[k + 1..ahead].iter().all(|(_, later)| of(*later) != of(edges[k].1));
            edges[k].0 = if last { at } else { 0 };
        }
        let mut shown = self.shown;
        edges.retain_mut(|(time, change)| {
            let Change::Level(pin, level) = *change else { return *time >= at };
            let last = &mut shown[usize::from(pin.port)][usize::from(pin.number)];
            let new = *time >= at && *last != level;
            if new {
                (*last, *time) = (level, (*time).max(at + 1));
            }
            new
        });
        self.changes = edges.into();
    }

    /// `edges`, and those of the window that began at `from` and at the count `before` of the clock.
    fn edges(&mut self, mut edges: Vec<(u64, Change)>, from: u64, before: u32) -> Vec<(u64, Change)> {
        self.pieces.clear();
        self.pieces.extend(self.process.pieces());
        let encoder = self.process.sensors().edges.clone();
        for (time, levels) in encoder {
            let at = from + u64::from(time.wrapping_sub(before));
            for (pin, level) in ENCODER.into_iter().zip([levels.a, levels.b, levels.index]) {
                let edges = if self.floating.contains(&pin) { &mut Vec::new() } else { &mut edges };
                self.set(edges, at, pin, level);
            }
        }
        for StepEdge { us, line, high } in self.process.steps.edges().to_vec() {
            self.set(&mut edges, from.saturating_add_signed(ticks(us)), STEPS[line as usize], high);
        }
        for i in 0..self.pieces.len() {
            let piece = self.pieces[i];
            let begins = from.saturating_add_signed(ticks(piece.from_us)).max(from);
            for pin in GATE {
                self.set(&mut edges, begins, pin, piece.gate);
            }
            if i > 0 && piece.from_us >= 0.0 && discharges(&self.pieces[i - 1].amps, &piece.amps) {
                let pulse = |pin| {
                    [(begins, Some(true)), (begins + COUPLED, None)].map(|(at, level)| (at, Change::Level(pin, level)))
                };
                edges.extend(self.floating.iter().copied().flat_map(pulse));
            }
            let ends = self.pieces.get(i + 1).map_or(f64::INFINITY, |next| next.from_us);
            for (pin, threshold) in COMPARATORS.into_iter().zip(self.process.comparators_v()) {
                let (constants, level) = crossing(piece.initial, piece.volts, threshold);
                let us = piece.from_us + piece.rise_us * constants;
                if us < ends {
                    let at = from.saturating_add_signed(ticks(us)).max(from);
                    self.set(&mut edges, at, pin, level);
                }
            }
        }
        self.wire_into(&mut edges, self.window - 1);
        for edge in &mut edges {
            edge.0 = edge.0.max(from + SETTLE + 1);
        }
        edges.sort_by_key(|e| e.0);
        edges
    }

    /// All levels that last until something moves.
    fn wire(&mut self, at: u64, earliest: u64) {
        let mut edges = Vec::new();
        let levels = self.process.sensors().levels;
        for (pin, level) in ENCODER.into_iter().zip([levels.a, levels.b, levels.index]) {
            self.set(&mut edges, at, pin, level);
        }
        for pin in GATE.into_iter().chain(COMPARATORS) {
            self.set(&mut edges, at, pin, false);
        }
        let (steps, _) = self.process.steps.counted();
        for (pin, level) in STEPS.into_iter().zip([steps.half & 1 == 1, steps.high]) {
            self.set(&mut edges, at, pin, level);
        }
        self.wire_into(&mut edges, at.max(earliest));
        self.changes.extend(edges);
        self.changes.make_contiguous().sort_by_key(|c| c.0);
    }

    /// Contacts: closed to ground while all is well. The bridge's fault output is low in a fault.
    fn wire_into(&mut self, edges: &mut Vec<(u64, Change)>, at: u64) {
        let SafetyInputs { upper_limit, lower_limit, emergency_stop, dielectric, bridge_fault, .. } =
            self.process.sensors().safety;
        for (pin, open) in CONTACTS.into_iter().zip([upper_limit, lower_limit, emergency_stop, dielectric]) {
            self.set(edges, at, pin, open);
        }
        self.set(edges, at, BRIDGE_FAULT, !bridge_fault);
    }

    /// Cuts or shorts the line of a pin: the chip sees this level, or its own pull. Where discharges couple into the encoder's lines,
    /// one that is cut has a pulse at each.
    pub fn stick(&mut self, pin: Pin, level: Option<bool>) {
        if level.is_none() && self.installation.spark_edges > 0.0 && ENCODER.contains(&pin) {
            self.floating.push(pin);
            self.changes.retain(|(_, change)| !matches!(change, Change::Level(of, _) if *of == pin));
        } else {
            self.stuck.push((pin, level));
        }
        self.changes.push_front((0, Change::Level(pin, level)));
    }

    /// Repairs every line.
    pub fn repair_lines(&mut self) {
        self.codes.clear();
        (self.deaf, self.swapped) = (false, false);
        let stuck = std::mem::take(&mut self.stuck).into_iter().map(|(pin, _)| pin);
        for pin in stuck.chain(std::mem::take(&mut self.floating)) {
            let level = match pin {
                ARMED => Some(self.latch.circuit.reads()),
                _ => self.levels[usize::from(pin.port)][usize::from(pin.number)],
            };
            self.changes.push_front((0, Change::Level(pin, level)));
        }
    }

    /// What of a change arrives at the chip.
    fn arrives(&self, change: Change) -> Change {
        match change {
            Change::Level(pin, _) => {
                self.stuck.iter().find(|stuck| stuck.0 == pin).map_or(change, |(_, level)| Change::Level(pin, *level))
            }
            Change::Can(_) => change,
        }
    }

    /// There may be pulses, or not.
    fn note(&mut self, at: u64) {
        let on = self.allowed && self.latch.enables();
        self.off = if on { None } else { self.off.or(Some(at)) };
        self.permit(at);
    }

    /// The code that a conversion gives now.
    pub fn code(&mut self, adc: u8, channel: u8, at: u64) -> u16 {
        World::sample(self, adc, channel, at)
    }

    fn set(&mut self, edges: &mut Vec<(u64, Change)>, at: u64, pin: Pin, level: bool) {
        let last = &mut self.levels[usize::from(pin.port)][usize::from(pin.number)];
        if *last != Some(level) {
            *last = Some(level);
            edges.push((at, Change::Level(pin, Some(level))));
        }
    }

    /// The piece of the gap at `at`, and `at` in us since the window began.
    fn piece(&self, at: u64) -> Option<(&Piece, f64)> {
        let us = us(at as i64 - (self.window - WINDOW.min(self.window)) as i64);
        let later = self.pieces.partition_point(|p| p.from_us <= us);
        Some((self.pieces.get(later.saturating_sub(1))?, us))
    }

    fn gap_voltage(&self, at: u64) -> u16 {
        let Some((piece, us)) = self.piece(at) else { return self.installation.zero_code as u16 };
        // Noise and hum: what the nearest conversion of the model's block has beside its voltage.
        let nearest = ((us / 2.0).max(0.0) as usize).min(BLOCK - 1);
        let then = 2.0 * nearest as f64 + 1.0;
        let at_then = self.pieces.partition_point(|p| p.from_us <= then).saturating_sub(1);
        let code = self.process.sensors().block.codes[nearest];
        let moved = volts(piece, us) - volts(&self.pieces[at_then], then);
        if moved == 0.0 || self.process.fault_inputs.stuck_code.is_some() {
            return code;
        }
        let p = &self.installation;
        let per_volt = (1.0 + f64::from(p.gain_error) * 0.01) / f64::from(p.volts_per_code);
        (f64::from(code) + moved * per_volt).round().clamp(0.0, 4095.0) as u16
    }

    /// What an oscilloscope sees at a moment of this window: gap voltage with the noise of the nearest conversion, and gate.
    pub fn scope(&self, at: u64) -> (f32, bool) {
        let p = &self.installation;
        let volts = (f32::from(self.gap_voltage(at)) - p.zero_code as f32) * p.volts_per_code;
        (volts, self.piece(at).is_some_and(|(piece, _)| piece.gate))
    }

    fn gap_current(&self, at: u64) -> u16 {
        let amps = self.piece(at).map_or(0.0, |(piece, us)| piece.amps_at(us));
        // Noise of two codes: what the voltage has at that moment decides.
        let noise = f64::from(self.gap_voltage(at) % 5) - 2.0;
        (current_code(amps) + noise) as u16
    }
}

/// Voltage of a piece. Once what is left of its transient is below a bit of the sum, most of the time, it is spared.
fn volts(piece: &Piece, us: f64) -> f64 {
    if us - piece.from_us > SETTLED * piece.rise_us { piece.volts } else { piece.at(us) }
}

fn ticks(us: f64) -> i64 {
    (us * (TICK_HZ / 1_000_000) as f64).round() as i64
}

fn us(ticks: i64) -> f64 {
    ticks as f64 / (TICK_HZ / 1_000_000) as f64
}

impl World for Bench {
    fn sample(&mut self, adc: u8, channel: u8, at: u64) -> u16 {
        if let Some((_, code)) = self.codes.iter().find(|stuck| stuck.0 == (adc, channel)) {
            return *code;
        }
        match (adc, channel) {
            (1, GAP) | (2, GATED) => self.gap_voltage(at),
            (2, GAP_CURRENT) => self.gap_current(at),
            (3, MOTOR_CURRENT) => self.sensed.motor_current,
            (3, BUS_VOLTAGE) => self.sensed.bus_voltage,
            _ => 0,
        }
    }

    fn next_change(&self) -> u64 {
        let first = self.changes.front().map_or(NEVER, |c| c.0);
        let frame = self.frames.front().map_or(NEVER, |f| f.0);
        first.min(frame).min(self.window + SETTLE).min(self.latch.next_change())
    }

    fn take_change(&mut self, at: u64) -> Option<Change> {
        if let Some(change) = self.latch.take_change(at) {
            self.note(at);
            return Some(self.arrives(change));
        }
        if let Some((_, change)) = self.changes.pop_front_if(|c| c.0 <= at) {
            if let Change::Level(pin, level) = change {
                self.shown[usize::from(pin.port)][usize::from(pin.number)] = level;
                if pin == GATE[0] && self.exact {
                    self.train.push((at, Line::Gate, level == Some(true)));
                }
                if let Some(falls) = self.falls.as_mut().filter(|_| pin == GATE[0] && level == Some(false)) {
                    falls.push(at);
                }
            }
            return Some(self.arrives(change));
        }
        while let Some((_, frame)) = self.frames.pop_front_if(|f| f.0 <= at) {
            if !self.deaf {
                return Some(Change::Can(frame));
            }
        }
        if self.window + SETTLE <= at {
            self.advance();
            return self.take_change(at);
        }
        None
    }

    fn drive(&mut self, at: u64, pin: Pin, drive: Drive) {
        self.latch.drive(at, pin, drive);
        let high = drive == Drive::Level(true);
        match pin {
            PWM => {
                self.pwm = drive;
                if high {
                    self.forced.push(self.bridge());
                }
            }
            STEP_READY => self.process.steps.ready = high,
            FORWARD => self.forward = high,
            REVERSE => self.reverse = high,
            ALLOW => {
                if self.exact && self.allowed != high {
                    self.train.push((at, Line::Allowed, high));
                }
                self.allowed = high;
            }
            _ => (),
        }
        self.note(at);
    }

    fn can_sent(&mut self, at: u64, frame: Frame) -> CanReply {
        let reply = if self.deaf { CanReply::BitError } else { self.reply };
        if reply == CanReply::Acknowledged {
            self.sent.push_back((at, frame));
        }
        reply
    }

    fn dac(&mut self, _: u64, _: u8, _: u16) {}
}
