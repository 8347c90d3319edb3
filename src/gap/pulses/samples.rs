//! What a pulse was, by all that was converted of it.
//!
//! Of a pulse that ignites the conversions show a step: first the open circuit, then what it burns at. Noise of the
//! conversions is taken for independent and normal, its standard deviation known. Then the likeliest place of the step is
//! where the sum of (boundary - voltage) from there on is largest, the boundary being midway from burn to open circuit; it is
//! found as the conversions come by Page's cumulative sum (Biometrika 41, 1954), which begins anew
//! whenever it is not positive. What burned is told by the mean since then, against the midway points between the levels: with
//! equal priors no other rule is right more often.
//!
//! The mean of n conversions has the standard deviation noise / sqrt(n). Two levels are told apart only where that makes nineteen
//! of twenty right; what fewer show is *uncertain*. And never by fewer than [`SHORT_LEAST`], [`ARC_LEAST`]: of one or two
//! conversions it is the edges that are seen, which no figure of noise covers. Where a comparator shows the ignition, no edge is
//! among them, and [`SHOWN_LEAST`] are enough.
//!
//! A comparator that has seen the ignition takes the place of the step that is looked for. Then the wait is known as well: what waited longer
//! than any arc is a spark, whatever it burns at, unless so little is left that its discharge was over before.
//!
//! It is assumed that a discharge burns until its gate closes, that the voltage collapses more quickly than a conversion takes, and
//! that what rises at the start of a pulse is left out (`blanking`).

use super::class::{Class, Levels};
use crate::dsp::decimate::sum;
use crate::dsp::{OutOfRange, in_range};
use crate::units::{ADC_FULL_SCALE, CLOCK_HZ, Seconds, Volts};

/// Fewest conversions of what burns by which a short is named.
pub const SHORT_LEAST: u32 = 2;
/// Fewest conversions of what burns by which an arc or a spark is named.
pub const ARC_LEAST: u32 = 4;
/// Fewest conversions of what burns by which anything is named, where a comparator has shown the ignition: none of them is an
/// edge.
pub const SHOWN_LEAST: u32 = 2;
/// Conversions of what burns after which no further block is looked at: arcs and sparks are told apart by as many at 6 dB.
const ENOUGH: u32 = 32;
/// Distance of a level from the boundary, in standard deviations of the mean, beyond which nineteen of twenty are right.
const NINETEEN_OF_TWENTY: f32 = 1.645;

/// What pulses look like.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Config {
    /// Open-circuit voltage of the generator for which the others hold. Above `spark`, up to 400 V.
    pub open: Volts,
    /// What a spark burns at. Above `arc_below`.
    pub spark: Volts,
    /// What burns lower is an arc. `short_below` or more.
    pub arc_below: Volts,
    /// What is lower still is a short, 0 V or more.
    pub short_below: Volts,
    /// Standard deviation of a conversion, 0.01..=100 V.
    pub noise: Volts,
    /// Volts per code, 0.001..=1.
    pub volts_per_code: f32,
    /// Code of no voltage, 0..=4095.
    pub zero: u16,
    /// The gap leads are swapped: a voltage makes the code smaller.
    pub reversed: bool,
    /// Time after the opening of the gate in which conversions are left out, 0..=0.002 s: the gap charges.
    pub blanking: Seconds,
    /// Longest ignition delay of an arc, 0..=1 s.
    pub arc_delay: Seconds,
}

/// Levels of \[R\] section 4.4, the arc as in the process model (assumed there); short, noise and blanking are assumed.
impl Default for Config {
    fn default() -> Self {
        Config {
            open: Volts(100.0),
            spark: Volts(40.0),
            arc_below: Volts(34.0),
            short_below: Volts(20.0),
            noise: Volts(4.0),
            volts_per_code: 0.1,
            zero: 410,
            reversed: false,
            blanking: Seconds(1e-6),
            arc_delay: Seconds(4e-6),
        }
    }
}

impl Config {
    /// Computes what tells pulses apart, or names the level that is out of range.
    pub fn build(&self) -> Result<Boundaries, OutOfRange> {
        let open = in_range("open-circuit voltage (V)", self.open.0, 0.0, 400.0)?;
        let spark = in_range("voltage of a spark (V)", self.spark.0, 0.0, open)?;
        let arc_below = in_range("boundary of arcs (V)", self.arc_below.0, 0.0, spark)?;
        let short_below = in_range("boundary of shorts (V)", self.short_below.0, 0.0, arc_below)?;
        let noise = in_range("noise of a conversion (V)", self.noise.0, 0.01, 100.0)?;
        let volts_per_code = in_range("volts per code", self.volts_per_code, 0.001, 1.0)?;
        in_range("code at 0 V", self.zero.into(), 0.0, ADC_FULL_SCALE.into())?;
        let blanking = in_range("blanking (s)", self.blanking.0, 0.0, 0.002)? * CLOCK_HZ as f32;
        let arc_delay = in_range("delay of an arc (s)", self.arc_delay.0, 0.0, 1.0)? * CLOCK_HZ as f32;
        let codes = |volts: f32| libm::roundf(volts / volts_per_code) as i32;
        // Levels that coincide want infinitely many, which is none that there ever are.
        let least = |distance: f32| {
            let deviations = NINETEEN_OF_TWENTY * noise / distance;
            libm::ceilf(deviations * deviations) as u32
        };
        // An arc is taken to burn as far below its boundary as a spark burns above it.
        let arc = 2.0 * arc_below - spark;
        Ok(Boundaries::new(
            Levels { zero: self.zero, reversed: self.reversed, short: codes(short_below), arc: codes(arc_below) },
            codes(0.5 * (spark + open)),
            [open, spark].map(codes),
            [least((arc - short_below).max(0.0)), least(spark - arc_below)],
            [blanking, arc_delay].map(|cycles| cycles as u32),
        ))
    }
}

/// What tells pulses apart: [`Config::build`] makes it. Voltages are codes above that of no voltage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Boundaries {
    levels: Levels,
    /// What is not ignited lies above.
    open: i32,
    /// Open circuit, what a spark burns at, and the boundaries of shorts, of arcs and of what has ignited, as they are set.
    set: [i32; 5],
    /// Arcs burn like sparks: a pulse without a wait is neither.
    overlap: bool,
    /// How far a code lies below that: at code 0, and how it changes with the code.
    at_zero: i32,
    gain: i32,
    /// Conversions of what burns by which a short is named, an arc or a spark; anything at all. Where a comparator has shown the
    /// ignition, and where it was looked for.
    shown: [u32; 3],
    found: [u32; 3],
    /// Core cycles.
    blanking: u32,
    arc_delay: u32,
}

impl Boundaries {
    /// `least`: conversions that noise makes necessary to name a short, an arc or a spark.
    fn new(levels: Levels, open: i32, set: [i32; 2], least: [u32; 2], [blanking, arc_delay]: [u32; 2]) -> Boundaries {
        let with = |edges: [u32; 2]| {
            let [short, arc] = core::array::from_fn(|i| larger_of(&least, &edges, i));
            [short, arc, short.min(arc)]
        };
        Boundaries {
            levels,
            open,
            set: [set[0], set[1], levels.short, levels.arc, open],
            overlap: false,
            at_zero: open.wrapping_sub(levels.voltage(0)),
            gain: if levels.reversed { 1 } else { -1 },
            shown: with([SHOWN_LEAST; 2]),
            found: with([SHORT_LEAST, ARC_LEAST]),
            blanking,
            arc_delay,
        }
    }

    /// Conversions since ignition from which an arc or a spark is named, where no comparator shows the ignition.
    pub fn arc_least(&self) -> u32 {
        self.found[1]
    }

    /// All of it, for a comparison.
    #[inline(always)]
    pub fn words(&self) -> [u32; 14] {
        let Boundaries {
            levels, open, set: [set @ .., _, _, _], at_zero, gain, shown, found, blanking, arc_delay, ..
        } = *self;
        let [short, arc, _] = shown;
        let [found_short, found_arc, _] = found;
        let zero = u32::from(levels.zero) << 16 | u32::from(levels.reversed);
        let signed = [levels.short, levels.arc, open, at_zero, gain].map(i32::cast_unsigned);
        let [a, b, c, d, e] = signed;
        let [set_open, set_spark] = set.map(i32::cast_unsigned);
        [zero, a, b, c, d, e, short, arc, found_short, found_arc, blanking, set_open, set_spark, arc_delay]
    }

    /// Core cycles after the opening of the gate in which nothing is looked at.
    pub fn blanking(&self) -> u32 {
        self.blanking
    }

    /// Levels and boundaries between them.
    pub(super) fn levels(&self) -> &Levels {
        &self.levels
    }

    /// Longest ignition delay of an arc, core cycles.
    #[inline(always)]
    pub fn arc_delay(&self) -> u32 {
        self.arc_delay
    }

    /// Arcs burn like sparks.
    #[inline(always)]
    pub(super) fn overlap(&self) -> bool {
        self.overlap
    }

    /// Open circuit, and what a spark burns at, as they are set.
    pub(super) fn set(&self) -> [i32; 2] {
        let [open, spark, ..] = self.set;
        [open, spark]
    }

    /// Other boundaries: of shorts, no higher than they are set; of arcs; of what has ignited. `None`: those that are set. `overlap`: arcs burn
    /// like sparks.
    pub(super) fn learn(&mut self, learned: Option<[i32; 3]>, overlap: bool) {
        let [_, _, short, arc, open] = self.set;
        let [new_short, new_arc, new_open] = learned.unwrap_or([short, arc, open]);
        (self.levels.short, self.levels.arc, self.open, self.overlap) =
            (new_short.min(short), new_arc, new_open, overlap);
        self.at_zero = new_open.wrapping_sub(self.levels.voltage(0));
    }
}

fn larger_of(a: &[u32; 2], b: &[u32; 2], i: usize) -> u32 {
    a.get(i).max(b.get(i)).copied().unwrap_or(u32::MAX)
}

/// What was seen of one pulse.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Evidence {
    /// Something was converted.
    seen: bool,
    /// Conversions since ignition, and by how much their sum lies below as many boundaries to the open circuit.
    burning: u32,
    below: i32,
    /// Where that sum begins anew: 0, or out of reach once a comparator has seen the ignition.
    least: i32,
}

impl Evidence {
    /// Takes conversions of the on-time, oldest first, no more than a block at a time.
    #[inline]
    pub fn samples(&mut self, boundaries: &Boundaries, codes: &[u16]) {
        self.seen |= !codes.is_empty();
        if self.burning >= ENOUGH {
            return;
        }
        let Boundaries { at_zero, gain, .. } = *boundaries;
        if self.least < 0 {
            // All of them burn: the sum is enough.
            let count = codes.len() as u32;
            let sum = sum(codes).cast_signed();
            let below = at_zero.wrapping_mul(count.cast_signed()).wrapping_add(gain.wrapping_mul(sum));
            (self.burning, self.below) = (self.burning.wrapping_add(count), self.below.wrapping_add(below));
            return;
        }
        let (mut burning, mut below) = (self.burning, self.below);
        for code in codes {
            below = below.wrapping_add(at_zero).wrapping_add(gain.wrapping_mul(i32::from(*code)));
            burning = burning.wrapping_add(1);
            if below <= self.least {
                (burning, below) = (0, 0);
            }
        }
        (self.burning, self.below) = (burning, below);
    }

    /// A comparator has seen the ignition, after what was taken until now.
    pub fn ignite(&mut self) {
        *self = Evidence { seen: true, least: i32::MIN, ..Evidence::default() };
    }

    /// What is taken for burning is on average as high as what has not ignited.
    #[inline]
    pub fn is_high(&self) -> bool {
        self.below < 0
    }

    /// Mean of what burned, if that was so many conversions.
    pub(super) fn mean(&self, boundaries: &Boundaries, least: u32) -> Option<i32> {
        let count = i32::try_from(self.burning).ok().filter(|_| self.burning >= least)?;
        Some(boundaries.open.wrapping_sub(self.below.checked_div(count)?))
    }

    /// Conversions of what burns.
    pub(super) fn burning(&self) -> u32 {
        self.burning
    }

    /// A comparator has shown the ignition, or that there was no wait.
    pub(super) fn is_shown(&self) -> bool {
        self.least < 0
    }

    /// What burned is no short, though it may be an arc or a spark.
    #[inline]
    pub fn burns(&self, boundaries: &Boundaries) -> bool {
        let count = self.burning as i32;
        let sum = count.wrapping_mul(boundaries.open).wrapping_sub(self.below);
        self.burning >= SHOWN_LEAST && !self.is_high() && sum >= count.wrapping_mul(boundaries.levels.short)
    }

    /// What the pulse was, by what was seen until now. `waited`: longer than an arc does.
    #[inline]
    pub fn class(&self, boundaries: &Boundaries, waited: bool) -> Class {
        /// Share of the open circuit, an nth, below which nothing burns any more: as for a teach-in.
        const OVER: i32 = 16;
        let burns = self.burning > 0 || self.least < 0;
        if !self.seen {
            return Class::Uncertain;
        }
        if !burns {
            return Class::Open;
        }
        // As high as what has not ignited, and a comparator that does not show it.
        if self.is_high() {
            return Class::Uncertain;
        }
        let [short_least, arc_least, least] = if self.least < 0 { boundaries.shown } else { boundaries.found };
        if self.burning < least {
            return Class::Uncertain;
        }
        let count = self.burning as i32;
        let sum = count.wrapping_mul(boundaries.open).wrapping_sub(self.below);
        if waited {
            let [open, ..] = boundaries.set;
            return if sum.wrapping_mul(OVER) < count.wrapping_mul(open) { Class::Uncertain } else { Class::Spark };
        }
        let class = boundaries.levels.burning(sum, count);
        let least = match class {
            Class::Short => short_least,
            _ if boundaries.overlap => u32::MAX,
            _ => arc_least,
        };
        if self.burning >= least { class } else { Class::Uncertain }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn boundaries() -> Boundaries {
        Config::default().build().unwrap()
    }

    fn codes(volts: &[i32]) -> Vec<u16> {
        volts.iter().map(|volts| (410 + 10 * volts) as u16).collect()
    }

    fn class(volts: &[i32]) -> Class {
        let mut evidence = Evidence::default();
        evidence.samples(&boundaries(), &codes(volts));
        evidence.class(&boundaries(), false)
    }

    #[test]
    fn a_pulse_is_told_by_what_it_burns_at_however_long_it_waits() {
        for waits in [0, 1, 7, 500] {
            for (burn, expected) in
                [(40, Class::Spark), (35, Class::Spark), (33, Class::Arc), (28, Class::Arc), (21, Class::Arc)]
            {
                let volts: Vec<i32> = std::iter::repeat_n(100, waits).chain([burn; 4]).collect();
                assert_eq!(class(&volts), expected, "{burn} V after {waits}");
                assert_eq!(class(&volts[..waits + 3]), Class::Uncertain, "{burn} V after {waits}");
            }
            let volts: Vec<i32> = std::iter::repeat_n(100, waits).chain([19; 2]).collect();
            assert_eq!(class(&volts), Class::Short);
            assert_eq!(class(&volts[..waits + 1]), Class::Uncertain);
            if waits > 0 {
                assert_eq!(class(&volts[..waits]), Class::Open);
            }
        }
        assert_eq!(class(&[]), Class::Uncertain);
    }

    #[test]
    fn a_single_low_conversion_of_an_open_pulse_is_forgotten() {
        assert_eq!(class(&[100, 100, 55, 100, 100]), Class::Open);
        assert_eq!(class(&[100, 55, 100, 40, 40, 40, 40]), Class::Spark);
    }

    #[test]
    fn the_step_is_where_the_likelihood_is_largest() {
        // By trying every place.
        let volts = [90, 110, 66, 104, 71, 52, 20, 75, 31, 48, 39, 36];
        let sum = |from: usize| volts[from..].iter().map(|volts| 700 - 10 * volts).sum::<i32>();
        let best = (0..volts.len()).max_by_key(|from| sum(*from)).unwrap();
        let mut evidence = Evidence::default();
        evidence.samples(&boundaries(), &codes(&volts));
        assert_eq!((evidence.burning as usize, evidence.below), (volts.len() - best, sum(best)));
    }

    #[test]
    fn a_comparator_says_where_a_discharge_begins() {
        let boundaries = boundaries();
        let mut evidence = Evidence::default();
        evidence.samples(&boundaries, &codes(&[100, 60, 60]));
        evidence.ignite();
        assert_eq!(evidence.class(&boundaries, false), Class::Uncertain);
        // The first of what burns is disturbed.
        evidence.samples(&boundaries, &codes(&[75, 22, 22, 25, 22]));
        assert_eq!(evidence.class(&boundaries, false), Class::Arc);
    }

    #[test]
    fn more_noise_wants_more_conversions() {
        let least = |volts| Config { noise: Volts(volts), ..Config::default() }.build().unwrap().arc_least();
        assert_eq!([0.1, 4.0, 8.0, 12.649].map(least), [4, 4, 5, 13]);
        let never = Config { arc_below: Volts(40.0), ..Config::default() }.build().unwrap();
        let mut evidence = Evidence::default();
        evidence.samples(&never, &codes(&[40; 1000]));
        assert_eq!(evidence.class(&never, false), Class::Uncertain);
    }

    #[test]
    fn a_level_out_of_order_is_named() {
        let name = |config: Config| config.build().map_err(|error| error.name).err();
        let config = Config::default();
        assert_eq!(name(Config { open: Volts(39.0), ..config }), Some("voltage of a spark (V)"));
        assert_eq!(name(Config { arc_below: Volts(41.0), ..config }), Some("boundary of arcs (V)"));
        assert_eq!(name(Config { short_below: Volts(35.0), ..config }), Some("boundary of shorts (V)"));
        assert_eq!(name(Config { noise: Volts(0.0), ..config }), Some("noise of a conversion (V)"));
        assert_eq!(name(Config { noise: Volts(f32::NAN), ..config }), Some("noise of a conversion (V)"));
        assert_eq!(name(Config { zero: 4096, ..config }), Some("code at 0 V"));
        assert_eq!(name(Config { blanking: Seconds(0.01), ..config }), Some("blanking (s)"));
    }
}
