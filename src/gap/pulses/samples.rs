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
//! conversions it is the edges that are seen, which no figure of noise covers. At 100 kHz and half on-time there are two or
//! three, so there an arc is never told from a spark.
//!
//! A comparator that has seen the ignition takes the place of the step that is looked for, one that has seen the collapse ends
//! what is averaged. Current that flows, or does not, has to agree with the voltage.
//!
//! It is assumed that a discharge burns until its gate closes or a comparator tells of its end, that the voltage collapses more
//! quickly than a conversion takes, and that what rises at the start of a pulse is left out (`blanking`).

use super::class::{Class, Levels};
use crate::dsp::{OutOfRange, in_range};
use crate::units::{ADC_FULL_SCALE, Volts};
use edm_hal_shim::gap::{BLOCK, GapBlock};

/// Fewest conversions of what burns by which a short is named.
pub const SHORT_LEAST: u32 = 2;
/// Fewest conversions of what burns by which an arc or a spark is named.
pub const ARC_LEAST: u32 = 4;
/// Conversions of what burns after which no further block is looked at: arcs and sparks are told apart by as many at 6 dB.
const ENOUGH: u32 = 32;
/// Distance of a level from the boundary, in standard deviations of the mean, beyond which nineteen of twenty are right.
const NINETEEN_OF_TWENTY: f32 = 1.645;

/// What pulses look like.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Config {
    /// Before ignition. Above `spark`, up to 400 V.
    pub open: Volts,
    /// What a spark burns at. Above `arc`.
    pub spark: Volts,
    /// What an arc burns at. Above `short`.
    pub arc: Volts,
    /// What a short shows, 0 V or more.
    pub short: Volts,
    /// Standard deviation of a conversion, 0.01..=100 V.
    pub noise: Volts,
    /// Volts per code, 0.001..=1.
    pub volts_per_code: f32,
    /// Code of no voltage, 0..=4095.
    pub zero: u16,
    /// The gap leads are swapped: a voltage makes the code smaller.
    pub reversed: bool,
    /// First conversions of a pulse that are left out, 0..=1000: the gap charges.
    pub blanking: u32,
}

/// Levels of \[R\] section 4.4, the arc as in the process model (assumed there); short, noise and blanking are assumed.
impl Default for Config {
    fn default() -> Self {
        Config {
            open: Volts(100.0),
            spark: Volts(40.0),
            arc: Volts(28.0),
            short: Volts(5.0),
            noise: Volts(4.0),
            volts_per_code: 0.1,
            zero: 410,
            reversed: false,
            blanking: 1,
        }
    }
}

impl Config {
    /// Computes what tells pulses apart, or names the level that is out of range.
    pub fn build(&self) -> Result<Boundaries, OutOfRange> {
        let open = in_range("open-circuit voltage (V)", self.open.0, 0.0, 400.0)?;
        let spark = in_range("voltage of a spark (V)", self.spark.0, 0.0, open)?;
        let arc = in_range("voltage of an arc (V)", self.arc.0, 0.0, spark)?;
        let short = in_range("voltage of a short (V)", self.short.0, 0.0, arc)?;
        let noise = in_range("noise of a conversion (V)", self.noise.0, 0.01, 100.0)?;
        let volts_per_code = in_range("volts per code", self.volts_per_code, 0.001, 1.0)?;
        in_range("code at 0 V", self.zero.into(), 0.0, ADC_FULL_SCALE.into())?;
        let between = |low: f32, high: f32| libm::roundf(0.5 * (low + high) / volts_per_code) as i32;
        // Levels that coincide want infinitely many, which is none that there ever are.
        let least = |low: f32, high: f32, least: u32| {
            let deviations = NINETEEN_OF_TWENTY * noise / (0.5 * (high - low));
            least.max(libm::ceilf(deviations * deviations) as u32)
        };
        let short_least = least(short, arc, SHORT_LEAST);
        let arc_least = least(arc, spark, ARC_LEAST);
        let levels = Levels {
            zero: self.zero,
            reversed: self.reversed,
            // Current is evidence of its own here.
            current: 0,
            short: between(short, arc),
            arc: between(arc, spark),
        };
        let blanking = in_range("conversions left out", self.blanking as f32, 0.0, 1000.0)? as u32;
        Ok(Boundaries::new(levels, between(spark, open), short_least, arc_least, blanking))
    }
}

/// What tells pulses apart: [`Config::build`] makes it. Voltages are codes above that of no voltage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Boundaries {
    levels: Levels,
    /// What is not ignited lies above.
    open: i32,
    /// How far a code lies below that: at code 0, and how it changes with the code.
    at_zero: i32,
    gain: i32,
    /// Conversions of what burns by which a short is named, an arc or a spark; anything at all.
    short_least: u32,
    arc_least: u32,
    least: u32,
    blanking: u32,
}

impl Boundaries {
    fn new(levels: Levels, open: i32, short_least: u32, arc_least: u32, blanking: u32) -> Boundaries {
        Boundaries {
            levels,
            open,
            at_zero: open.wrapping_sub(levels.voltage(0)),
            gain: if levels.reversed { 1 } else { -1 },
            short_least,
            arc_least,
            least: short_least.min(arc_least),
            blanking,
        }
    }

    /// Conversions since ignition from which an arc or a spark is named.
    pub fn arc_least(&self) -> u32 {
        self.arc_least
    }
}

/// What was seen of one pulse.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Evidence {
    /// Something was converted.
    seen: bool,
    /// Conversions since ignition, and by how much their sum lies below as many boundaries to the open circuit.
    burning: u32,
    below: i32,
    /// Where that sum begins anew: 0, or out of reach once a comparator has seen the ignition.
    least: i32,
    /// A comparator has seen the voltage collapse: what follows is no part of it.
    over: bool,
    /// Whether current flows, where that is known.
    current: Option<bool>,
}

impl Evidence {
    /// Takes conversions of the on-time, oldest first, no more than a block at a time.
    #[inline]
    pub fn samples(&mut self, boundaries: &Boundaries, codes: &[u16]) {
        self.seen |= !codes.is_empty();
        if self.over || self.burning >= ENOUGH {
            return;
        }
        let Boundaries { at_zero, gain, .. } = *boundaries;
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
        *self = Evidence { seen: true, least: i32::MIN, over: self.over, current: self.current, ..Evidence::default() };
    }

    /// A comparator has seen the discharge end, after what was taken until now.
    pub fn collapse(&mut self) {
        self.over = true;
    }

    /// Current was looked at while the gate was open.
    pub fn current(&mut self, flows: bool) {
        self.current = Some(flows);
    }

    /// What the pulse was, by what was seen until now.
    #[inline]
    pub fn class(&self, boundaries: &Boundaries) -> Class {
        let burns = self.burning > 0 || self.least < 0;
        // Low without current: it has burned out, or does not come up. High with current: ignited at the very end.
        if !self.seen || self.current.is_some_and(|flows| flows != burns) {
            return Class::Uncertain;
        }
        if !burns {
            return Class::Open;
        }
        if self.burning < boundaries.least {
            return Class::Uncertain;
        }
        let count = self.burning as i32;
        let class = boundaries.levels.burning(count.wrapping_mul(boundaries.open).wrapping_sub(self.below), count);
        let least = if class == Class::Short { boundaries.short_least } else { boundaries.arc_least };
        if self.burning >= least { class } else { Class::Uncertain }
    }
}

/// Cuts blocks of conversions into pulses.
#[derive(Clone, Copy, Debug)]
pub struct Samples {
    boundaries: Boundaries,
    /// Of the pulse that the last block ended in.
    evidence: Evidence,
    on: bool,
    /// Conversions of it that are still to be left out.
    blank: u32,
}

impl Samples {
    /// Nothing seen yet.
    pub fn new(boundaries: Boundaries) -> Samples {
        Samples { boundaries, evidence: Evidence::default(), on: false, blank: 0 }
    }

    /// Takes a block; gives to `done` the class of each pulse whose gate it shows to have closed.
    #[inline]
    pub fn block(&mut self, block: &GapBlock, mut done: impl FnMut(Class)) {
        let mut left = block.gate & GapBlock::ALL;
        if self.on && left & 1 == 0 {
            self.on = false;
            done(self.evidence.class(&self.boundaries));
        }
        while left != 0 {
            let begin = left.trailing_zeros();
            let end = begin.wrapping_add((!(left.wrapping_shr(begin))).trailing_zeros());
            if !self.on {
                (self.on, self.evidence, self.blank) = (true, Evidence::default(), self.boundaries.blanking);
            }
            let first = end.min(begin.wrapping_add(self.blank));
            self.blank = self.blank.wrapping_sub(first.wrapping_sub(begin));
            self.evidence.samples(&self.boundaries, block.codes.get(first as usize..end as usize).unwrap_or(&[]));
            if end < BLOCK as u32 {
                self.on = false;
                done(self.evidence.class(&self.boundaries));
            }
            left &= u32::MAX.wrapping_shl(end);
        }
    }

    /// What was seen of the pulse whose gate is open; comparators and current add to it.
    pub fn open(&mut self) -> Option<&mut Evidence> {
        self.on.then_some(&mut self.evidence)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn boundaries() -> Boundaries {
        Config::default().build().unwrap()
    }

    fn codes(volts: &[i32]) -> Vec<u16> {
        volts.iter().map(|volts| (410 + 10 * volts) as u16).collect()
    }

    fn class(volts: &[i32]) -> Class {
        let mut evidence = Evidence::default();
        evidence.samples(&boundaries(), &codes(volts));
        evidence.class(&boundaries())
    }

    #[test]
    fn a_pulse_is_told_by_what_it_burns_at_however_long_it_waits() {
        for waits in [0, 1, 7, 500] {
            for (burn, expected) in
                [(40, Class::Spark), (35, Class::Spark), (33, Class::Arc), (28, Class::Arc), (17, Class::Arc)]
            {
                let volts: Vec<i32> = std::iter::repeat_n(100, waits).chain([burn; 4]).collect();
                assert_eq!(class(&volts), expected, "{burn} V after {waits}");
                assert_eq!(class(&volts[..waits + 3]), Class::Uncertain, "{burn} V after {waits}");
            }
            let volts: Vec<i32> = std::iter::repeat_n(100, waits).chain([16; 2]).collect();
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
    fn comparators_say_where_a_discharge_begins_and_ends() {
        let boundaries = boundaries();
        let mut evidence = Evidence::default();
        evidence.samples(&boundaries, &codes(&[100, 60, 60]));
        evidence.ignite();
        assert_eq!(evidence.class(&boundaries), Class::Uncertain);
        // The first of what burns is disturbed.
        evidence.samples(&boundaries, &codes(&[75, 20, 22, 25, 20]));
        evidence.collapse();
        evidence.samples(&boundaries, &codes(&[0; 20]));
        assert_eq!(evidence.class(&boundaries), Class::Arc);
    }

    #[test]
    fn current_has_to_agree_with_voltage() {
        let boundaries = boundaries();
        for (volts, flows, expected) in [
            ([100; 6], false, Class::Open),
            ([100; 6], true, Class::Uncertain),
            ([40; 6], true, Class::Spark),
            ([40; 6], false, Class::Uncertain),
            ([3; 6], true, Class::Short),
            ([3; 6], false, Class::Uncertain),
        ] {
            let mut evidence = Evidence::default();
            evidence.samples(&boundaries, &codes(&volts));
            evidence.current(flows);
            assert_eq!(evidence.class(&boundaries), expected, "{volts:?} {flows}");
        }
    }

    #[test]
    fn one_conversion_with_current_is_the_look_once_rule() {
        // Where one conversion is enough, the classes are those of a look.
        let levels = super::super::class::tests::LEVELS;
        let boundaries = Boundaries::new(levels, 700, 1, 1, 0);
        for voltage in 0..4096 {
            let mut evidence = Evidence::default();
            evidence.samples(&boundaries, &[voltage]);
            evidence.current(true);
            let look = super::super::PulseSample { current: levels.current, voltage };
            let reported = evidence.class(&boundaries);
            if levels.voltage(voltage) < boundaries.open {
                assert_eq!(reported, levels.class(look), "{voltage}");
            } else {
                assert_eq!(reported, Class::Uncertain, "{voltage}: current, and not ignited");
            }
        }
    }

    #[test]
    fn more_noise_wants_more_conversions() {
        let least = |volts| Config { noise: Volts(volts), ..Config::default() }.build().unwrap().arc_least();
        assert_eq!([0.1, 4.0, 8.0, 12.649].map(least), [4, 4, 5, 13]);
        let never = Config { arc: Volts(40.0), ..Config::default() }.build().unwrap();
        let mut evidence = Evidence::default();
        evidence.samples(&never, &codes(&[40; 1000]));
        assert_eq!(evidence.class(&never), Class::Uncertain);
    }

    #[test]
    fn a_level_out_of_order_is_named() {
        let name = |config: Config| config.build().map_err(|error| error.name).err();
        let config = Config::default();
        assert_eq!(name(Config { open: Volts(39.0), ..config }), Some("voltage of a spark (V)"));
        assert_eq!(name(Config { arc: Volts(41.0), ..config }), Some("voltage of an arc (V)"));
        assert_eq!(name(Config { short: Volts(29.0), ..config }), Some("voltage of a short (V)"));
        assert_eq!(name(Config { noise: Volts(0.0), ..config }), Some("noise of a conversion (V)"));
        assert_eq!(name(Config { noise: Volts(f32::NAN), ..config }), Some("noise of a conversion (V)"));
        assert_eq!(name(Config { zero: 4096, ..config }), Some("code at 0 V"));
        assert_eq!(name(Config { blanking: 1001, ..config }), Some("conversions left out"));
    }

    /// Blocks of a record, `None` for off-time, and what comes of them.
    fn cut(record: &[Option<i32>], boundaries: Boundaries) -> Vec<Class> {
        let mut samples = Samples::new(boundaries);
        let mut classes = vec![];
        for chunk in record.chunks_exact(BLOCK) {
            let mut block = GapBlock::EMPTY;
            for (i, volts) in chunk.iter().enumerate() {
                block.codes[i] = (410 + 10 * volts.unwrap_or(0)) as u16;
                block.gate |= u32::from(volts.is_some()) << i;
            }
            samples.block(&block, |class| classes.push(class));
        }
        classes
    }

    proptest! {
        #[test]
        fn pulses_are_cut_however_they_fall_on_blocks(
            pulses in prop::collection::vec((0..4usize, 0..30usize, 4..60usize, 1..40usize), 1..30), blanking in 0..4u32,
        ) {
            let boundaries = Config { blanking, ..Config::default() }.build().unwrap();
            let kinds = [(100, Class::Open), (40, Class::Spark), (28, Class::Arc), (5, Class::Short)];
            let (mut record, mut expected) = (vec![], vec![]);
            for (kind, waits, burns, off) in pulses {
                let (volts, class) = kinds[kind];
                record.extend(std::iter::repeat_n(Some(0), blanking as usize));
                record.extend(std::iter::repeat_n(Some(100), waits));
                record.extend(std::iter::repeat_n(Some(volts), burns));
                record.extend(std::iter::repeat_n(None, off));
                expected.push(class);
            }
            record.extend([None; 2 * BLOCK]);
            prop_assert_eq!(cut(&record, boundaries), expected);
        }

        #[test]
        fn no_codes_make_it_fail(blocks: Vec<([u16; BLOCK], u32)>, blanking in 0..=1000u32, reversed: bool) {
            let mut samples = Samples::new(Config { blanking, reversed, ..Config::default() }.build().unwrap());
            for (codes, gate) in blocks {
                samples.block(&GapBlock { codes, gate }, |class| assert!(class != Class::NoPulse));
            }
        }
    }
}
