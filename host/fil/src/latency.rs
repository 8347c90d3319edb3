//! Latency of the firmware: from an event at a pin to the reaction, with the event at every offset in a servo tick.
//!
//! Scene 1, eroding: the axis vibrates at the rated speed, every second pulse meets a short, logs are on. The pulses come a
//! step later in each tick, so that after a sweep there was one at every offset. Scene 2, holding position: the dielectric
//! contact opens for a moment, again a step later each time; the head does not mind while no pulses are allowed, but the
//! stop task acts at once. Scene 3: the axis runs faster than interrupts can follow; the timer counts alone.
//!
//! Time is that of the engine: nominal cycles, no hazards between instructions, flash warm.

use crate::cycles::names;
use crate::image::Image;
use crate::machine::Span;
use crate::session::{MS, Session};
use crate::synthetic::{Behaviour, TICK};
use crate::wires::DIELECTRIC;
use anyhow::{Context, Result};
use edm_soc::{Drive, Exception, TICK_HZ};
use serde::Serialize;
use std::collections::BTreeMap;

/// Counts per second that the interrupts are rated for, and the timer.
const RATED: u64 = 300_000;
const TIMER: u64 = 5_000_000;
/// Exceptions of encoder A and B, and of the servo tick (RM0090 table 62: 6, 7 and 25, behind 16 of the processor).
const EDGES: [Exception; 2] = [22, 23];
const SERVO: Exception = 41;
/// Count register of TIM5.
const TIM5_CNT: u32 = 0x4000_0c24;
/// An open contact, and the rest before the next: in ticks prime to the twenty of a millisecond, or every look at the winding
/// could fall into the same moment.
const OPEN: u64 = 20 * TICK_HZ / 1_000_000;
const REST: u64 = 7 * TICK;
/// Openings in a row. Longer, the head finds that the encoder moves and the winding does not, and rightly stops.
const STRETCH: usize = 150;

/// A spread of times, us.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Spread {
    /// Longest.
    pub worst: f64,
    /// One of a thousand is longer.
    pub p999: f64,
    /// Half of them are longer.
    pub median: f64,
}

impl Spread {
    fn of(mut ticks: Vec<u64>) -> Self {
        ticks.sort_unstable();
        let at = |share: f64| {
            let index = (ticks.len() as f64 * share) as usize;
            ticks.get(index.min(ticks.len().saturating_sub(1))).map_or(0.0, |t| *t as f64 * 1e6 / TICK_HZ as f64)
        };
        Self { worst: at(1.0), p999: at(0.999), median: at(0.5) }
    }
}

/// Share of the processor.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Load {
    /// All tasks, 0..=1.
    pub total: f64,
    /// By task.
    pub tasks: BTreeMap<String, f64>,
}

/// What the encoder lost.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Encoder {
    /// Rate at which the interrupts counted.
    pub edges_per_s_isr: u64,
    /// Counts they lost.
    pub lost_isr: u64,
    /// Rate at which the timer counted.
    pub edges_per_s_timer: u64,
    /// Counts it lost.
    pub lost_timer: u64,
}

/// The result.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Latency {
    /// From the sampled voltage of a short to the inhibited generator.
    pub short_to_pin_us: Spread,
    /// Gate opened into the short, blanking and conversion included.
    pub physical_short_to_pin_us: Spread,
    /// Contact opened, to the bridge off.
    pub stop_to_pin_us: Spread,
    /// Edge at the pin, to its interrupt done.
    pub encoder_isr_us: Spread,
    /// Latest less earliest begin of a tick.
    pub tick_start_jitter_us: Spread,
    /// Latest less earliest change of the PWM.
    pub output_jitter_us: Spread,
    /// Ticks that were still running when the next was due.
    pub overruns: u64,
    /// Shorts that were met and not killed before their pulse ended.
    pub missed_shorts: u64,
    /// Load in scene 1.
    pub cpu_load: Load,
    /// Counts.
    pub encoder: Encoder,
    /// Offsets swept.
    pub samples: u64,
}

impl Latency {
    /// What is beyond its bound.
    pub fn over_bounds(&self) -> Vec<String> {
        let us = [
            ("short sampled to pin", self.short_to_pin_us.worst, 2.5),
            ("stop to pin", self.stop_to_pin_us.worst, 5.0),
            ("tick start jitter", self.tick_start_jitter_us.worst, 5.0),
            ("output jitter", self.output_jitter_us.worst, 0.0),
        ];
        let mut list: Vec<_> = us
            .iter()
            .filter(|(_, worst, bound)| worst > bound)
            .map(|(what, worst, bound)| format!("{what}: {worst:.2} us, at most {bound}"))
            .collect();
        let Encoder { edges_per_s_isr, lost_isr, edges_per_s_timer, lost_timer } = self.encoder;
        let none = [
            ("overruns", self.overruns),
            ("shorts missed", self.missed_shorts),
            ("counts lost by interrupt", lost_isr),
            ("counts lost by timer", lost_timer),
        ];
        list.extend(none.iter().filter(|n| n.1 > 0).map(|(what, n)| format!("{what}: {n}, at most 0")));
        // The rig's rate is its own: a thousandth less is still the rate that was asked for.
        let rates = [("interrupt", edges_per_s_isr, RATED), ("timer", edges_per_s_timer, TIMER)];
        list.extend(
            rates
                .iter()
                .filter(|r| r.1 * 1000 < r.2 * 999)
                .map(|(by, n, at)| format!("by {by}: {n} counts/s, at least {at}")),
        );
        list
    }
}

/// Microseconds as ticks of the chip.
const fn us(us: u64) -> u64 {
    us * TICK_HZ / 1_000_000
}

/// Eroding at the rated speed with shorts; shared with the tests that put faults in.
pub const RATED_SCENE: Behaviour = Behaviour { edges_per_s: RATED, pulse: (TICK / 2 + 3, us(20)), shorts: (1, 2) };

/// Measures with an offset at every `step` ticks of the chip.
///
/// # Errors
/// When the firmware does not get where it is to be measured.
pub fn measure(image: &Image, step: u64) -> Result<Latency> {
    let mut result = Latency { samples: TICK.div_ceil(step), ..Latency::default() };
    // Two pulses a tick and one step, every second of them a short.
    let pulse = (TICK / 2 + step.div_ceil(2), us(20));
    let mut session = Session::ready(image, Behaviour { pulse, ..RATED_SCENE })?;
    stops(&mut session, step, &mut result)?;
    session.erode()?;
    shorts(&mut session, image, step, &mut result)?;
    fast(image, &mut result)?;
    Ok(result)
}

/// Scene 2.
fn stops(session: &mut Session, step: u64, result: &mut Latency) -> Result<()> {
    let mut opened = Vec::new();
    session.machine.soc().world.outputs.clear();
    for first in (0..result.samples).step_by(STRETCH) {
        let mut at = (session.now() / TICK + 2) * TICK + first * step;
        for _ in first..result.samples.min(first + STRETCH as u64) {
            let world = &mut session.machine.soc().world;
            world.level(at, DIELECTRIC, true);
            world.level(at + OPEN, DIELECTRIC, false);
            opened.push(at);
            at += REST + step;
        }
        session.machine.soc().world.disturb();
        session.machine.soc().world_changed();
        let time = at - session.now();
        session.idle(time)?;
        session.machine.soc().world.calm();
        session.idle(20 * MS)?;
    }
    let outputs = &session.machine.soc().world.outputs;
    // A duty of zero is off already.
    let off = |from: u64| {
        let next = outputs.partition_point(|o| o.0 < from);
        let was_on = next.checked_sub(1).and_then(|i| outputs.get(i)).is_some_and(|o| o.1 != Drive::Level(false));
        let off = outputs.get(next..)?.iter().find(|o| o.1 == Drive::Level(false))?;
        was_on.then(|| off.0 - from)
    };
    result.stop_to_pin_us = Spread::of(opened.into_iter().filter_map(off).collect());
    Ok(())
}

/// Scene 1.
fn shorts(session: &mut Session, image: &Image, step: u64, result: &mut Latency) -> Result<()> {
    let world = &mut session.machine.soc().world;
    world.edges.clear();
    world.shorts.clear();
    world.outputs.clear();
    world.disturb();
    session.machine.record_spans();
    let start = session.now();
    // All offsets, and at least one of the messages that are logged every second.
    session.idle((result.samples * (TICK + step)).max(TICK_HZ * 21 / 20))?;
    let end = session.now();
    session.machine.soc().world.calm();
    let spans = session.machine.spans().to_vec();
    result.cpu_load = load(image, &spans, end - start);
    let world = &session.machine.soc().world;
    let done: Vec<_> = world.shorts.iter().filter(|s| s.killed.is_some()).collect();
    result.missed_shorts = world.shorts.iter().filter(|s| s.opened + us(30) < end && s.killed.is_none()).count() as u64;
    let from = |begin: fn(&crate::synthetic::Short) -> Option<u64>| {
        Spread::of(done.iter().filter_map(|s| Some(s.killed? - begin(s)?)).collect())
    };
    result.short_to_pin_us = from(|s| s.sampled);
    result.physical_short_to_pin_us = from(|s| Some(s.opened));
    result.encoder_isr_us = Spread::of(served(&world.edges, &spans));
    let ticks: Vec<_> = spans.iter().filter(|s| s.exception == SERVO).collect();
    result.tick_start_jitter_us = ticks_begin(&spans);
    result.overruns =
        ticks.iter().filter(|s| s.left.is_some_and(|left| left / 2 - s.entered / 2 > TICK)).count() as u64;
    // Changes of duty, not those forced by a task.
    let changes = world.outputs.iter().filter(|o| matches!(o.1, Drive::Pwm { .. })).map(|o| o.0);
    result.output_jitter_us = jitter(changes);
    result.encoder.edges_per_s_isr = world.edges.len() as u64 * TICK_HZ / (end - start);
    let (isr, _) = lost(session, image)?;
    result.encoder.lost_isr = isr;
    Ok(())
}

/// Scene 3.
fn fast(image: &Image, result: &mut Latency) -> Result<()> {
    let behaviour = Behaviour { edges_per_s: TIMER, shorts: (0, 1), ..RATED_SCENE };
    let mut session = Session::ready(image, behaviour)?;
    session.machine.soc().world.edges.clear();
    session.machine.soc().world.disturb();
    let start = session.now();
    session.idle(5 * MS)?;
    let edges = session.machine.soc().world.edges.len() as u64;
    result.encoder.edges_per_s_timer = edges * TICK_HZ / (session.now() - start);
    session.machine.soc().world.calm();
    result.encoder.lost_timer = lost(&mut session, image)?.1;
    Ok(())
}

/// Counts that the interrupts and the timer lack, once the axis has come to rest.
///
/// # Errors
/// When the counts are not where the debug information says.
pub fn lost(session: &mut Session, image: &Image) -> Result<(u64, u64)> {
    let shared = image.find("chip", "ENCODER").context("no symbol of the decoder's state")?;
    let place = shared + names::offset(image, "Shared", "count")?;
    let mut least = (u64::MAX, u64::MAX);
    // An edge may be on its way: the smallest of several looks.
    for _ in 0..40 {
        session.idle(us(77))?;
        let soc = session.machine.soc();
        let truth = soc.world.count();
        let away = |count: u32| i64::from(count.wrapping_sub(truth as u32) as i32).unsigned_abs();
        let isr = away(soc.memory.ram(place).load(place, 4).context("the decoder's state is not in RAM")?);
        let timer = away(soc.read(TIM5_CNT, 4)?);
        least = (least.0.min(isr), least.1.min(timer));
    }
    Ok(least)
}

/// By how much servo ticks begin later than the earliest, within their period.
pub fn ticks_begin(spans: &[Span]) -> Spread {
    jitter(spans.iter().filter(|s| s.exception == SERVO).map(|s| s.entered / 2))
}

fn jitter(times: impl Iterator<Item = u64>) -> Spread {
    let phases: Vec<_> = times.map(|t| t % TICK).collect();
    // Phases may straddle the border: counted from the first one, half a tick either way.
    let first = phases.first().copied().unwrap_or(0);
    let centred: Vec<_> = phases.iter().map(|p| (p + TICK + TICK / 2 - first) % TICK).collect();
    let least = centred.iter().copied().min().unwrap_or(0);
    Spread::of(centred.into_iter().map(|p| p - least).collect())
}

/// From each edge to the end of the first encoder interrupt that begins after it.
fn served(edges: &[u64], spans: &[Span]) -> Vec<u64> {
    let mut interrupts = spans.iter().filter(|s| EDGES.contains(&s.exception)).peekable();
    let mut times = Vec::new();
    for edge in edges {
        while interrupts.peek().is_some_and(|s| s.entered / 2 < *edge) {
            interrupts.next();
        }
        if let Some(left) = interrupts.peek().and_then(|s| s.left) {
            times.push(left / 2 - edge);
        }
    }
    times
}

/// Own time of each task: what interrupted it does not count.
fn load(image: &Image, spans: &[Span], time: u64) -> Load {
    let mut own: BTreeMap<Exception, u64> = BTreeMap::new();
    let mut open: Vec<(Exception, u64)> = Vec::new();
    for span in spans {
        let Some(left) = span.left else { continue };
        while open.last().is_some_and(|o| o.1 <= span.entered) {
            open.pop();
        }
        *own.entry(span.exception).or_default() += left - span.entered;
        if let Some((outer, _)) = open.last() {
            let outer = own.entry(*outer).or_default();
            *outer = outer.saturating_sub(left - span.entered);
        }
        open.push((span.exception, left));
    }
    let share = |half: u64| half as f64 / 2.0 / time as f64;
    let tasks: BTreeMap<_, _> = own.into_iter().map(|(e, half)| (names::task(image, e), share(half))).collect();
    Load { total: tasks.values().sum(), tasks }
}
