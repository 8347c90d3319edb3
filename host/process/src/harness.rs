//! An ideal servo for the gates: no converter, no axis, no head, so that what a gate shows is the process.
//!
//! The laws are written from the sources' formulas; each moves the electrode by itself. They replace the head's laws
//! only here.

use crate::math::gone;
use crate::parameters::{Machine, Parameters, Refused};
use crate::random::{Cause, Stream};
use crate::{Edge, Orders, Process, Pulses, Stretch, Wires};
use std::f64::consts::TAU;

/// Servo cycle of the laws of \[X\] and \[G\], us.
const CYCLE_US: f64 = 100e3;
/// Move of a cycle in \[G\], um.
const MOVE_UM: f64 = 1.0;
/// Share of short pulses at which a cycle is short, \[G\] section 2.3.
const SHORT_SHARE: f64 = 0.9;
/// Share of open pulses at which FC feeds (assumed; \[G\] does not publish it).
const OPEN_SHARE: f64 = 0.5;
/// Time for which FC closes the pulses of an abnormal cycle, us (assumed; \[G\] does not publish it).
const CLOSED_US: f64 = 20e3;
/// Longest uninterrupted retreat that is not yet long, um: \[G\] eq. 9.
const LONG_UM: u32 = 5;
/// Longest delay of a servo, steps.
const LONGEST: usize = 512;

/// A servo on the mean voltage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Voltage {
    /// Set point, V.
    pub set: f64,
    /// Velocity over error, um/s per V.
    pub gain: f64,
    /// Time constant of the meter, us.
    pub meter_us: f64,
    /// Time constant of the axis, us.
    pub axis_us: f64,
    /// Delay between the two, us.
    pub delay_us: f64,
    /// Velocity below which it does not move, um/s.
    pub dead_um_s: f64,
}

impl Voltage {
    /// A loop of 3 Hz (assumed): no swing of its own.
    pub fn calm(set: f64) -> Voltage {
        Voltage { set, gain: 12.0, meter_us: 1e3, axis_us: 5e3, delay_us: 0.0, dead_um_s: 2.0 }
    }

    /// The thesis machine: lags and delay assumed, gain fitted to the frequency of its swing.
    pub fn thesis(set: f64) -> Voltage {
        Voltage { set, gain: 151.5, meter_us: 3e3, axis_us: 4e3, delay_us: 3e3, dead_um_s: 2.0 }
    }

    /// The slow CNC axis of \[R\] section 4.5, on the same signal (assumed).
    pub fn cnc(set: f64) -> Voltage {
        Voltage { set, gain: 45.0, meter_us: 20e3, axis_us: 30e3, delay_us: 4e3, dead_um_s: 2.0 }
    }
}

/// How the electrode is moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Law {
    /// Velocity with the error of the mean voltage.
    Voltage(Voltage),
    /// The gap, measured to a micrometre rms, is set to this every 100 ms: \[X\].
    Gap(f64),
    /// \[G\], feed control at a discharge holding threshold; whether it closes the pulses of an abnormal cycle.
    Fc(u32, bool),
    /// \[G\], one or two thresholds of the mean voltage, V: feed above the first, retreat below the second.
    Tav(f64, f64),
    /// The mean gap is held at this.
    Held(f64),
}

/// What else moves the electrode.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// A sine on top: peak to peak in um, and Hz.
    pub buzz: (f64, f64),
    /// Jumps: height in um, time between them in s, speed in mm/s.
    pub jump: (f64, f64, f64),
}

/// Mean of the gap voltage while the gate is on; between pulses there is the sense supply, which it is kept from.
#[derive(Clone, Copy, Debug, Default)]
struct Meter {
    volts: Edge,
    began: f64,
    /// Volt-microseconds at a time that is integrated.
    sum: f64,
    until: f64,
}

impl Meter {
    /// Volt-microseconds of an edge until so long after it began.
    #[inline]
    fn area(&self, us: f64) -> f64 {
        let Edge { from, to, us: constant } = self.volts;
        to * us + (from - to) * constant * if us > 40.0 * constant { 1.0 } else { gone(us / constant) }
    }

    #[inline]
    fn reckon(&mut self, now: f64) {
        let before = if self.until > self.began { self.area(self.until - self.began) } else { 0.0 };
        self.sum += self.area(now - self.began) - before;
        self.until = now;
    }

    /// Volt-microseconds since the last call.
    fn take(&mut self, now: f64) -> f64 {
        self.reckon(now);
        std::mem::take(&mut self.sum)
    }
}

impl Wires for Meter {
    #[inline]
    fn stretch(&mut self, stretch: &Stretch) {
        if self.volts != Edge::default() {
            self.reckon(stretch.from);
        }
        let on = stretch.gate.0 < stretch.gate.1;
        self.volts = if on { stretch.volts } else { Edge::default() };
        (self.began, self.until) = (stretch.from, stretch.from);
    }
}

/// Result of a run.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally {
    /// Servo cycles of 100 ms.
    pub cycles: u64,
    /// Those with nine tenths of short pulses.
    pub short_cycles: u64,
    /// Uninterrupted retreats of more than 5 um.
    pub long_retreats: u64,
}

/// A process under a servo.
#[derive(Clone, Debug)]
pub struct Rig {
    /// The process.
    pub process: Process,
    /// Result of the run.
    pub tally: Tally,
    /// Filtered mean voltage, V.
    pub volts: f64,
    /// Electrode without buzz and jump, um.
    pub x: f64,
    p: Parameters,
    law: Law,
    motion: Motion,
    orders: Orders,
    meter: Meter,
    velocity: f64,
    queue: Box<[f64; LONGEST]>,
    queued: usize,
    delay: usize,
    keeps: (f64, f64),
    lifting: f64,
    lift: f64,
    next_jump_us: f64,
    cycle: (f64, f64, Pulses),
    back: u32,
    closed_us: f64,
    instrument: Stream,
    /// Volt-microseconds of a held gap.
    read: f64,
}

impl Rig {
    /// A process under a law, from a gap twice that of the machine's work, or from the gap that the law keeps.
    ///
    /// # Errors
    /// When the parameters do not fit.
    pub fn new(p: &Parameters, law: Law, motion: Motion, seed: u64) -> Result<Rig, Refused> {
        let gap = match law {
            Law::Gap(um) | Law::Held(um) => um,
            _ => 2.0 * p.exchange_um,
        };
        let (mut keeps, mut delay) = ((0.0, 0.0), 0);
        if let Law::Voltage(v) = law {
            keeps = (libm::exp(-p.step_us / v.meter_us), libm::exp(-p.step_us / v.axis_us));
            delay = ((v.delay_us / p.step_us).round() as usize).min(LONGEST - 1);
        }
        Ok(Rig {
            process: Process::new(p, gap, seed)?,
            tally: Tally::default(),
            volts: 60.0,
            x: -gap,
            p: *p,
            law,
            motion,
            orders: Orders::default(),
            meter: Meter::default(),
            velocity: 0.0,
            queue: Box::new([0.0; LONGEST]),
            queued: 0,
            delay,
            keeps,
            lifting: 0.0,
            lift: 0.0,
            next_jump_us: motion.jump.1 * 1e6,
            cycle: (0.0, 0.0, Pulses::default()),
            back: 0,
            closed_us: 0.0,
            instrument: Stream::new(Cause::Instrument, seed),
            read: 0.0,
        })
    }

    /// The same of a machine.
    ///
    /// # Errors
    /// When its parameters do not fit.
    pub fn of(machine: &Machine, law: Law, seed: u64) -> Result<Rig, Refused> {
        Rig::new(&machine.of(), law, Motion::default(), seed)
    }

    /// Another off-time from now on.
    pub fn off_time(&mut self, us: Option<f64>) {
        self.orders.off_us = us;
    }

    /// Time, s.
    pub fn t_s(&self) -> f64 {
        self.process.now_us() * 1e-6
    }

    /// How far a jump has lifted the electrode, um.
    pub fn lift_um(&self) -> f64 {
        self.lift
    }

    /// Mean voltage of a held gap so far, V.
    pub fn mean_volts(&self) -> f64 {
        self.read / self.process.now_us()
    }

    /// One step.
    pub fn step(&mut self) {
        let dt = self.p.step_us;
        let now = self.process.now_us() + dt;
        if let Law::Held(um) = self.law {
            self.x += self.process.gap_um() - um;
        }
        let jumping = self.jump(now, dt);
        self.closed_us -= dt;
        self.orders.pulses = !jumping && self.closed_us <= 0.0;
        let (peak, hz) = self.motion.buzz;
        let buzz = if peak > 0.0 { 0.5 * peak * libm::sin(TAU * hz * now * 1e-6) } else { 0.0 };
        self.process.advance(dt, self.x + buzz - self.lift, &self.orders, &mut self.meter);
        let volt_us = self.meter.take(now);
        if !jumping {
            self.servo(dt, volt_us);
        }
    }

    fn jump(&mut self, now: f64, dt: f64) -> bool {
        let (height, every_s, mm_s) = self.motion.jump;
        if height > 0.0 && self.lifting == 0.0 && now >= self.next_jump_us {
            self.lifting = 1.0;
        }
        if self.lifting == 0.0 {
            return false;
        }
        self.lift += self.lifting * mm_s * 1e-3 * dt;
        if self.lift >= height {
            self.lifting = -1.0;
        }
        if self.lift <= 0.0 {
            (self.lift, self.lifting) = (0.0, 0.0);
            self.next_jump_us = now + every_s * 1e6;
        }
        true
    }

    fn servo(&mut self, dt: f64, volt_us: f64) {
        match self.law {
            Law::Held(_) => self.read += volt_us,
            Law::Voltage(v) => {
                let read = volt_us / dt;
                self.volts = read + (self.volts - read) * self.keeps.0;
                let wanted = (v.gain * (self.volts - v.set)).clamp(-8000.0, 4000.0);
                let wanted = wanted.signum() * (wanted.abs() - v.dead_um_s).max(0.0);
                self.queue[(self.queued + self.delay) % LONGEST] = wanted;
                let comes = self.queue[self.queued];
                self.queued = (self.queued + 1) % LONGEST;
                self.velocity = comes + (self.velocity - comes) * self.keeps.1;
                self.x += self.velocity * dt * 1e-6;
            }
            Law::Gap(_) | Law::Fc(..) | Law::Tav(..) => self.cycle(dt, volt_us),
        }
    }

    fn cycle(&mut self, dt: f64, volt_us: f64) {
        self.cycle.0 += dt;
        self.cycle.1 += volt_us;
        if self.cycle.0 < CYCLE_US - 0.5 * dt {
            return;
        }
        let mean = self.cycle.1 / self.cycle.0;
        let n = self.process.pulses().since(&self.cycle.2);
        self.cycle = (0.0, 0.0, self.process.pulses());
        let total = n.total().max(1) as f64;
        let short = n.short as f64 >= SHORT_SHARE * total;
        let feed = match self.law {
            Law::Gap(um) => {
                let seen = self.process.gap_um() + self.instrument.step();
                self.x += (seen - um).clamp(-40.0, 40.0);
                0.0
            }
            Law::Fc(..) if short => -1.0,
            Law::Fc(dht, _) if n.discharges() >= u64::from(dht) => 0.0,
            Law::Fc(..) if n.open as f64 >= OPEN_SHARE * total => 1.0,
            Law::Fc(_, closes) => {
                if closes {
                    self.closed_us = CLOSED_US;
                }
                0.0
            }
            Law::Tav(above, _) if mean >= above => 1.0,
            Law::Tav(_, below) if mean < below => -1.0,
            _ => 0.0,
        };
        self.x += feed * MOVE_UM;
        self.tally.cycles += 1;
        self.tally.short_cycles += u64::from(short);
        if feed < 0.0 {
            self.back += 1;
        } else {
            self.tally.long_retreats += u64::from(self.back > LONG_UM);
            self.back = 0;
        }
    }

    /// Runs until a depth, or for this number of seconds at most. The time it is then, s.
    pub fn bore(&mut self, depth_um: f64, at_most_s: f64) -> f64 {
        while self.process.depth_um() < depth_um && self.t_s() < at_most_s {
            self.step();
        }
        self.t_s()
    }

    /// Runs until a time, s.
    pub fn run(&mut self, until_s: f64) {
        while self.t_s() < until_s {
            self.step();
        }
    }
}

/// How the electrode swings.
#[derive(Clone, Copy, Debug)]
pub struct Swing {
    /// Peak to peak of a sine of the same rms, um.
    pub um: f64,
    /// Half the zero crossings in a second, Hz.
    pub hz: f64,
    /// Mean of the meter, V.
    pub volts: f64,
}

/// Swing of the electrode about its mean of 0.2 s, from a time on for so many seconds.
pub fn swing(rig: &mut Rig, from_s: f64, seconds: f64) -> Swing {
    const SLOW_US: f64 = 200e3;
    rig.run(from_s);
    let (mut sum, mut squares, mut volts, mut n, mut crossings, mut up) = (0.0, 0.0, 0.0, 0.0, 0.0, false);
    let mut base = rig.x;
    while rig.t_s() < from_s + seconds {
        rig.step();
        base += (rig.x - base) * (rig.p.step_us / SLOW_US);
        let off = rig.x - base;
        (sum, squares, volts, n) = (sum + off, squares + off * off, volts + rig.volts, n + 1.0);
        if (off > 0.0) != up {
            up = off > 0.0;
            crossings += 1.0;
        }
    }
    let rms = (squares / n - sum / n * (sum / n)).sqrt();
    Swing { um: 2.0 * std::f64::consts::SQRT_2 * rms, hz: crossings / (2.0 * seconds), volts: volts / n }
}
