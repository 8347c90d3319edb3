//! Mean gap voltage, plain or gated (Roberts section 6.5).
//!
//! Block of conversions -> mean above zero volts -> low-pass and notch -> volts. *Plain* averages every conversion, so
//! off-time drags it down: at 50 % on-time and 100 V it cannot exceed 50 V. *Gated* averages on-time only
//! (`gated.rs`). All of it runs in converter codes and is scaled to volts once, at the end.
//!
//! Shorts are judged block by block before the filters, which are 2 to 3 ms late: by the low comparator, at any on-time and off-time
//! (`gates.rs`), and by gated conversions, because off-time reads 0 V as a short does. A generator without a gate is judged by all
//! conversions while it has permission; its voltage may need [`Config::charging`] to rise.

use super::blend::Blend;
use super::gated::{Gated, PER_BLOCK};
use super::gates::Gates;
use super::pulses::{Boundaries, BoundaryConfig, PulseStream, Seen};
use super::senses::delays::{self, Delays};
use super::teach::Shown;
use super::{GapReading, GapSource, Quality};
use crate::dsp::decimate::{CodeRange, Tally};
use crate::dsp::{OutOfRange, chain, in_range};
use crate::kept::{Kept, parts};
use crate::units::{ADC_FULL_SCALE, Hertz, Seconds, TICK_S, TICKS_PER_MS, Volts, rare};
use edm_hal_shim::gap::{BLOCK, GapBlock};

/// Which conversions the average is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Average {
    /// All of them.
    Plain,
    /// Those taken in on-time.
    Gated,
}

/// Which way the code moves when the generator applies voltage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Polarity {
    /// Up.
    Positive,
    /// Down.
    Negative,
}

/// What the source is built from.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Config {
    /// Which conversions are averaged.
    pub average: Average,
    /// Code at 0 V, one of the `good` ones.
    pub zero_code: u16,
    /// Volts per code, 0.001..=1.
    pub volts_per_code: f32,
    /// Which way the code moves.
    pub polarity: Polarity,
    /// Low-pass and notch.
    pub filter: chain::Config,
    /// A gated block whose mean is closer to 0 V than this is a short, 1..=300 V; below the burn voltage.
    pub short: Volts,
    /// Fewest gated conversions by which a block is judged a short or not, 1..=25. Voltage needs a few microseconds to
    /// rise at the start of a pulse.
    pub min_gated: u32,
    /// Pulses in a row without a voltage that are a short, 1..=1000; more where a healthy gap has many.
    pub shorts: u32,
    /// Time of a short that this is worth, 0..=0.1 s.
    pub worth: Seconds,
    /// Time constant with which the voltage rises, 0..=0.0002 s.
    pub charging: Seconds,
    /// A block without a gate whose mean is closer to 0 V than this is a contact, 0..=300 V; 0: contact is not sensed.
    pub contact: Volts,
    /// Longest time without a gated conversion before the gate counts as missing, and without a judged block before a run of shorts is
    /// over, 0.001..=10 s.
    pub hold_limit: Seconds,
    /// A filtered voltage of the wrong sign and larger than this means swapped leads, 1..=300 V.
    pub reversed: Volts,
    /// Codes that are not clipped, within 0..=4095; from 0 on for a front end that reads 0 V as code 0.
    pub good: CodeRange,
    /// Share of the averaged conversions that have to be clipped for the block to count as saturated, 0.04..=1.
    pub clipped_share: f32,
    /// Time constant with which one average gives way to the other, 0.001..=10 s.
    pub transfer: Seconds,
    /// What tells pulses apart.
    pub pulses: BoundaryConfig,
}

/// Assumed: a divider that reads -41 to 368 V; half the burn voltage of Roberts, about 40 V, for the thresholds.
impl Default for Config {
    fn default() -> Self {
        Self {
            average: Average::Gated,
            zero_code: 410,
            volts_per_code: 0.1,
            polarity: Polarity::Positive,
            filter: chain::Config::default(),
            short: Volts(20.0),
            contact: Volts(0.0),
            min_gated: 3,
            shorts: 5,
            worth: Seconds(1e-3),
            charging: Seconds(0.5e-6),
            hold_limit: Seconds(0.02),
            reversed: Volts(20.0),
            good: CodeRange { lowest: 1, highest: ADC_FULL_SCALE - 1 },
            clipped_share: 0.2,
            transfer: Seconds(0.5),
            pulses: BoundaryConfig::default(),
        }
    }
}

impl Config {
    /// Computes what the ticks need, or names the parameter that is out of range.
    pub fn build(&self) -> Result<Active, OutOfRange> {
        let highest = in_range("highest good code", self.good.highest.into(), 1.0, ADC_FULL_SCALE.into())?;
        let lowest = in_range("lowest good code", self.good.lowest.into(), 0.0, highest)?;
        in_range("code at 0 V", self.zero_code.into(), lowest, highest)?;
        let volts_per_code = in_range("volts per code", self.volts_per_code, 0.001, 1.0)?;
        let short = in_range("short threshold (V)", self.short.0, 1.0, 300.0)?;
        Ok(Active {
            average: self.average,
            zero_code: self.zero_code,
            scale: match self.polarity {
                Polarity::Positive => volts_per_code,
                Polarity::Negative => -volts_per_code,
            },
            filter: self.filter.build()?,
            short: short / volts_per_code,
            contact: in_range("contact threshold (V)", self.contact.0, 0.0, 300.0)? / volts_per_code,
            min_gated: in_range("fewest gated conversions", self.min_gated as f32, 1.0, 25.0)? as u32,
            shorts: in_range("shorts in a row", self.shorts as f32, 1.0, 1000.0)? as u32,
            worth: Seconds(in_range("worth of shorts in a row (s)", self.worth.0, 0.0, 0.1)?).ticks(),
            slow: (in_range("charging time constant (s)", self.charging.0, 0.0, 2e-4)? * (3.0 / TICK_S)).max(SLOW_TICKS)
                as u32,
            hold_limit: Seconds(in_range("hold limit (s)", self.hold_limit.0, 0.001, 10.0)?).ticks(),
            reversed: Volts(-in_range("reversed threshold (V)", self.reversed.0, 1.0, 300.0)?),
            good: self.good,
            clipped_share: in_range("clipped share", self.clipped_share, 0.04, 1.0)?,
            fade: TICK_S / in_range("transfer (s)", self.transfer.0, 0.001, 10.0)?,
            pulses: self.pulses.build()?,
        })
    }
}

/// Ticks without a voltage, at least, after which a generator without a gate is short: 200 us.
const SLOW_TICKS: f32 = 4.0;
/// Ticks in which swapped leads show 0 V at least once: 2 ms, two periods of the slowest pulses of \[R\].
const OFF_TIME: u32 = 2 * TICKS_PER_MS;

/// What the source says in turns, a word a tick: pulses by ignition delay, then the notch.
pub const SLOW: usize = delays::BINS + 1;
/// Where the notch is among them: its frequency, 0.01 Hz, and in this bit whether it follows the mains.
const NOTCH: usize = delays::BINS;
const FOLLOWS: u32 = 1 << 31;

/// Frequency of the notch, 0.01 Hz, and whether it follows the mains, as the last of the words has it.
pub fn mains_of(word: u32) -> (u16, bool) {
    ((word & !FOLLOWS) as u16, word & FOLLOWS != 0)
}

/// What the ticks run on.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Active {
    average: Average,
    zero_code: u16,
    /// Volts per code, negative where voltage moves the code down.
    scale: f32,
    filter: chain::Coefficients,
    /// Codes.
    short: f32,
    /// Codes; 0 where contact is not sensed.
    contact: f32,
    min_gated: u32,
    shorts: u32,
    /// Ticks.
    worth: u32,
    slow: u32,
    hold_limit: u32,
    /// Negative.
    reversed: Volts,
    good: CodeRange,
    clipped_share: f32,
    /// Share of one average that gives way to the other in a tick.
    fade: f32,
    pulses: Boundaries,
}

// A part of a word or two: the servo tick may have to wait for the gap task.
parts!(it: Active {
    average, zero_code, scale, filter, short, contact, min_gated, shorts, worth, slow, hold_limit, reversed, good, clipped_share,
    fade, pulses,
} by
    [it.average, it.zero_code],
    [it.scale],
    [it.short],
    [it.contact],
    [it.min_gated, it.hold_limit],
    [it.shorts, it.worth, it.slow],
    [it.reversed.0],
    [it.good],
    [it.clipped_share, it.fade],
    [it.filter.each()[0]],
    [it.filter.each()[1]],
    [it.filter.each()[2]],
    [it.filter.each()[3]],
    [it.filter.each()[4]],
    [it.filter.each()[5]],
    [it.filter.each()[6]],
    [it.filter.each()[7]],
    [it.filter.each()[8]],
    [it.filter.each()[9]],
    [it.filter.each()[10]],
    [it.filter.each()[11]],
    [it.filter.further()],
    [it.filter.follows()],
    [it.pulses.words()[0], it.pulses.words()[1], it.pulses.words()[2], it.pulses.words()[3]],
    [it.pulses.words()[4], it.pulses.words()[5], it.pulses.words()[6], it.pulses.words()[7]],
    [it.pulses.words()[8], it.pulses.words()[9], it.pulses.words()[10]],
    [it.pulses.words()[11], it.pulses.words()[12], it.pulses.words()[13]],
);

/// The source: [`Config::build`] makes what it runs on.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Voltage {
    active: Active,
    kept: Kept<Active>,
    stream: PulseStream,
    delays: Delays,
    /// Which word is said next.
    turn: u8,
    filter: chain::State,
    /// The filters that move, where they are to follow the mains.
    tracked: chain::Tracked,
    gated: Gated,
    gates: Gates,
    /// Pulses are permitted.
    permitted: bool,
    blend: Blend,
    /// Newest average, codes above zero volts; 0 before the first.
    block: f32,
    /// There has been an average.
    begun: bool,
    /// Ticks since the newest gated conversion, and since the newest block with enough of them.
    gateless_ticks: u32,
    unjudged_ticks: u32,
    short_ticks: u32,
    /// Ticks without a voltage of a generator that has no gate.
    dark_ticks: u32,
    /// Ticks of a negative voltage in which every conversion was at the end of the range.
    clipped_ticks: u32,
    touches: bool,
    /// Sum of so many blocks of this millisecond, codes above zero volts, and the mean of the one before.
    sum: (f32, u32),
    mean: f32,
}

impl Voltage {
    /// A source that has seen nothing yet; the first block it averages is where its filters start.
    pub fn new(active: Active) -> Self {
        Self {
            active,
            kept: Kept::NEW,
            stream: PulseStream::new(active.pulses),
            delays: [0; delays::BINS],
            turn: 0,
            filter: chain::State::default(),
            tracked: chain::Tracked::new(active.filter),
            gated: Gated::default(),
            gates: Gates::new(active.shorts),
            permitted: true,
            blend: Blend::new(active.average == Average::Plain),
            block: 0.0,
            begun: false,
            gateless_ticks: u32::MAX,
            unjudged_ticks: u32::MAX,
            short_ticks: 0,
            dark_ticks: 0,
            clipped_ticks: 0,
            touches: false,
            sum: (0.0, 0),
            mean: 0.0,
        }
    }

    /// Goes on with other settings between two ticks. The reading stays where it is in volts and moves on from there; to another
    /// average slowly, while there are pulses.
    pub fn retune(&mut self, active: Active) {
        self.tracked.retune(&mut self.filter, &active.filter);
        let ratio = self.active.scale / active.scale;
        self.filter.scale(ratio);
        self.gated.scale(ratio);
        self.block *= ratio;
        self.sum.0 *= ratio;
        self.mean *= ratio;
        self.stream.retune(active.pulses);
        if self.active.average != active.average {
            self.blend.begin(active.average == Average::Plain, self.gateless_ticks <= OFF_TIME);
        }
        self.active = active;
        self.kept = Kept::NEW;
    }

    /// Looks at a word or two of what it runs on: false once they have changed by themselves.
    #[inline]
    pub fn is_intact(&mut self) -> bool {
        self.kept.agrees(&self.active) && (!self.active.filter.follows().2 || self.tracked.is_of(&self.active.filter))
    }

    /// One of the [`SLOW`] words, in turn, and which it is.
    #[inline]
    pub fn slow(&mut self) -> (usize, u32) {
        let turn = usize::from(self.turn);
        self.turn = if turn < NOTCH { self.turn.wrapping_add(1) } else { 0 };
        (turn, self.delays.get(turn).copied().unwrap_or_else(|| self.notch()))
    }

    #[cold]
    fn notch(&self) -> u32 {
        let (mains, follows) = self.mains();
        (mains.0 * 100.0 + 0.5) as u32 | if follows { FOLLOWS } else { 0 }
    }

    /// Where the notch is, and whether there is hum that it follows.
    pub fn mains(&self) -> (Hertz, bool) {
        (self.tracked.mains(), self.active.filter.follows().2 && self.tracked.is_locked())
    }

    /// Pulses are permitted, or not. Until the first word they are.
    #[inline(always)]
    pub fn permit(&mut self, permitted: bool) {
        self.permitted = permitted;
    }

    /// Each pulse that ends is to be shown to [`Voltage::look`], or no longer.
    pub fn collect(&mut self, collects: bool) {
        self.stream.collect(collects);
    }

    /// [`Voltage::look`] has something to show.
    #[inline(always)]
    pub fn has_news(&self) -> bool {
        self.stream.has_news()
    }

    /// What is known of the levels of pulses ([`PulseStream::levels`]), and what was seen of the newest pulse that ended, while collecting.
    pub fn look(&mut self) -> (u32, Option<Shown>) {
        let (_, seen) = self.stream.take();
        let per_code = Volts(if self.active.scale < 0.0 { -self.active.scale } else { self.active.scale });
        let volts = |codes: i32| Volts(codes as f32 * per_code.0);
        let shown = seen.map(|seen| match seen {
            Seen::Open(codes) => Shown::Open(volts(codes)),
            Seen::Burned(codes, step) => Shown::Burned(volts(codes), step.map(volts)),
        });
        (self.stream.levels(), shown)
    }

    /// What it runs on.
    pub fn active(&self) -> &Active {
        &self.active
    }

    /// Averages a block; gives whether it is a short (`None`: too few gated conversions to tell) and whether it clipped.
    #[inline]
    fn take(&mut self, block: &GapBlock) -> (Option<bool>, bool) {
        let active = &self.active;
        self.touches = false;
        let clips =
            |tally: &Tally| tally.clipped > 0 && tally.clipped as f32 >= active.clipped_share * tally.count as f32;
        if block.gate & GapBlock::ALL == 0 {
            let rest = Tally::of(&block.codes, GapBlock::ALL, active.good);
            let low = (rest.above(active.zero_code).unsigned_abs() as f32) < active.contact * rest.count as f32;
            // At the end of its range the converter would not show a contact.
            self.touches = low | (active.contact > 0.0) & clips(&rest);
        }
        let on = Tally::of(&block.codes, block.gate, active.good);
        let above = on.above(active.zero_code);
        if on.count > 0 {
            // Pulses too short for a judgement show the gate, and are averaged.
            self.gateless_ticks = 0;
        }
        let gated = self.gated.block(&on, block.gate, above);
        let (sample, used) = match active.average {
            Average::Gated if !self.blend.changes() => (gated, on),
            average => {
                let all = Tally::of(&block.codes, GapBlock::ALL, active.good);
                let mut sample = all.above(active.zero_code) as f32 * PER_BLOCK;
                if self.blend.changes() {
                    rare();
                    let plain = self.blend.block(on.count, active.fade);
                    sample = gated.map_or(sample, |gated| gated + plain * (sample - gated));
                }
                (Some(sample), if average == Average::Plain { all } else { on })
            }
        };
        if let Some(sample) = sample {
            if !self.begun {
                rare();
                self.begun = true;
                self.filter = chain::State::settled(sample);
            }
            self.block = sample;
        }
        let short = (above.unsigned_abs() as f32) < active.short * on.count as f32;
        let clipped = clips(&used);
        let short = match self.gates.block(block, (on.count > 0).then_some(!short)) {
            Some(true) => {
                rare();
                self.short_ticks = self.short_ticks.max(self.active.worth);
                Some(true)
            }
            Some(false) => Some(false),
            None => (on.count >= active.min_gated).then_some(short),
        };
        (short, clipped)
    }

    /// Whether a generator without a gate shorts: while it has permission, its voltage does not rise.
    #[cold]
    fn is_dark(&mut self, block: &GapBlock) -> Option<bool> {
        // Of all conversions: nothing else is averaged without a gate.
        let low = self.block < self.active.short && -self.block < self.active.short;
        let dark = self.permitted && low && block.low_rises == 0 && !block.above_low;
        self.dark_ticks = if dark { self.dark_ticks.saturating_add(1) } else { 0 };
        Some(self.dark_ticks >= self.active.slow)
    }

    /// Counts the run of shorts.
    #[inline]
    fn count(&mut self, short: Option<bool>) {
        self.unjudged_ticks = if short.is_some() { 0 } else { self.unjudged_ticks.saturating_add(1) };
        let lasts = short.unwrap_or(self.short_ticks > 0 && self.unjudged_ticks <= self.active.hold_limit);
        self.short_ticks = if lasts { self.short_ticks.saturating_add(1) } else { 0 };
    }
}

/// Whether a negative voltage is one of swapped leads: their off-time is 0 V. A dead input is at the end of its range all the
/// time.
#[cold]
fn reverses(block: Option<&GapBlock>, good: CodeRange, clipped_ticks: &mut u32) -> bool {
    let inside = |block: &GapBlock| block.codes.iter().any(|code| (good.lowest..=good.highest).contains(code));
    *clipped_ticks = if block.is_some_and(inside) { 0 } else { clipped_ticks.saturating_add(1) };
    *clipped_ticks < OFF_TIME
}

impl GapSource for Voltage {
    fn update(&mut self, block: Option<&GapBlock>) -> GapReading {
        // What is not converted may be a contact.
        self.touches = self.active.contact > 0.0;
        self.gateless_ticks = self.gateless_ticks.saturating_add(1);
        let (mut short, clipped) = block.map_or((None, false), |block| self.take(block));
        if self.active.average == Average::Plain
            && self.gateless_ticks > self.active.hold_limit
            && let Some(block) = block
        {
            short = self.is_dark(block);
        }
        self.count(short);
        let active = &self.active;
        // A gate that is not wired, or that stays on: what it shows is judged as a short.
        let touches = self.touches || active.contact > 0.0 && short == Some(true);
        let codes = self.block;
        self.sum = (self.sum.0 + codes, self.sum.1.wrapping_add(1));
        if self.sum.1 >= TICKS_PER_MS {
            self.mean = self.sum.0 * (1.0 / TICKS_PER_MS as f32);
            self.sum = (0.0, 0);
            self.stream.look();
            self.gates.judge(self.active.shorts);
        }
        let filtered = if active.filter.follows().2 {
            self.tracked.tick(&mut self.filter, codes)
        } else {
            self.filter.tick(&active.filter, codes)
        };
        let filtered = Volts(filtered * active.scale);
        let quality = if block.is_none() {
            Quality::Missing
        } else if active.average == Average::Gated && self.gateless_ticks > active.hold_limit {
            Quality::NoGate
        } else if filtered < active.reversed && reverses(block, active.good, &mut self.clipped_ticks) {
            Quality::Reversed
        } else if self.stream.is_unclear() {
            if !self.permitted {
                // Whoever permits pulses again may have changed the generator.
                self.stream.forget();
            }
            Quality::Unclear
        } else if clipped {
            Quality::Saturated
        } else {
            Quality::Valid
        };
        match block {
            Some(block) => {
                let delays = &mut self.delays;
                self.stream.block(block, |pulse| {
                    if pulse.ignited
                        && let Some(count) = delays.get_mut(delays::bin(pulse.waited))
                    {
                        *count = count.wrapping_add(1);
                    }
                });
            }
            None => self.stream.lost(),
        }
        let code = block.map_or(0, |block| block.codes[BLOCK - 1]);
        let (block, mean) = (Volts(codes * active.scale), Volts(self.mean * active.scale));
        let pulses = self.stream.counts().copied();
        let regauged = self.blend.regauged();
        GapReading { filtered, block, mean, quality, touches, short_ticks: self.short_ticks, code, regauged, pulses }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kept::Parts;

    #[test]
    fn settings_that_change_by_themselves_are_seen_and_those_that_are_given_are_not() {
        let active = Config::default().build().unwrap();
        let mut source = Voltage::new(active);
        let looks = |source: &mut Voltage| (0..=Active::PARTS).filter(|_| !source.is_intact()).count();
        assert_eq!(looks(&mut source), 0);
        let other = Config { min_gated: 9, ..Config::default() }.build().unwrap();
        source.retune(other);
        assert_eq!(looks(&mut source), 0);
        source.active.scale = -source.active.scale;
        assert!(looks(&mut source) > 0);
    }
}
