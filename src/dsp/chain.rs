//! Low-pass and mains notch in series: what stands between a decimated signal and the servo.
//!
//! A 4th-order Butterworth low-pass takes out the pulses and their noise, a notch at the mains frequency the hum that
//! rides on the gap voltage, and an optional second notch its second harmonic (Roberts section 6.5.3; there the second one
//! made the signal slightly worse and was left out, so it is off by default).
//!
//! The notch is wide on purpose. Roberts found that corners of 40 and 60 Hz were needed to take out 50 Hz; Q = 2.5 puts them
//! at 41 and 61 Hz. Mains drifts: 0.2 Hz off centre it still takes out 34 dB, 0.5 Hz off 26 dB. A sharper one loses that
//! (Q = 5: 28 and 20 dB); a wider one costs phase where the gap loop needs it.

use super::svf;
use super::tracking::{Notches, Tracker};
use super::{OutOfRange, in_range};
use crate::units::{Hertz, rare};
use edm_hal_shim::gap_filter;

/// Damping of the two halves of a 4th-order Butterworth low-pass: its poles lie on a circle, 2 cos(pi/8) and
/// 2 cos(3 pi/8). The well damped half comes first, so that nothing inside exceeds the input by more than a few percent.
const BUTTERWORTH: [f32; 2] = [1.847_759_1, 0.765_366_86];

/// What the chain is built from.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Config {
    /// -3 dB corner of the low-pass, 20..=2000 Hz.
    pub corner: Hertz,
    /// Mains frequency, 45..=65 Hz: 50 or 60, or what the local supply really has.
    pub mains: Hertz,
    /// Centre of the notch over the distance of its -3 dB corners, 0.5..=30.
    pub notch_q: f32,
    /// Whether a second notch at twice the mains frequency follows.
    pub second_harmonic: bool,
    /// Whether the notches move with the hum, from `mains` on.
    pub follow: bool,
}

impl Default for Config {
    fn default() -> Self {
        Self { corner: Hertz(200.0), mains: Hertz(50.0), notch_q: 2.5, second_harmonic: false, follow: false }
    }
}

impl Config {
    /// Computes the coefficients, or names the parameter that is out of range.
    pub fn build(&self) -> Result<Coefficients, OutOfRange> {
        let corner = Hertz(in_range("low-pass corner (Hz)", self.corner.0, 20.0, 2000.0)?);
        let mains = Hertz(in_range("mains frequency (Hz)", self.mains.0, 45.0, 65.0)?);
        let q = in_range("notch Q", self.notch_q, 0.5, 30.0)?;
        let [first, second] = BUTTERWORTH.map(|damping| svf::low_pass(corner, damping));
        Ok(Coefficients {
            sections: [first, second, svf::notch(mains, q)],
            harmonic: svf::notch(Hertz(2.0 * mains.0), q),
            further: self.second_harmonic.into(),
            mains,
            width: svf::Width::new(q),
            follow: self.follow,
        })
    }
}

/// What the ticks multiply by.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Coefficients {
    /// Low-pass, low-pass, notch at the mains frequency.
    sections: [svf::Coefficients; 3],
    harmonic: svf::Coefficients,
    /// Notches behind that of the mains: 1 with that of its second harmonic, else 0. A number and no `bool`, which the compiler
    /// compares with 1 in a cycle of its own.
    further: u32,
    /// Where the notches begin, and how wide they are; whether they move.
    mains: Hertz,
    width: svf::Width,
    follow: bool,
}

impl Coefficients {
    /// One by one, to compare them.
    #[inline]
    pub(crate) fn each(&self) -> [f32; 12] {
        let [first, second, mains] = &self.sections;
        let last = &self.harmonic;
        [first.r, first.b, first.g, second.r, second.b, second.g, mains.r, mains.b, mains.g, last.r, last.b, last.g]
    }

    /// Notches behind that of the mains.
    #[inline]
    pub(crate) fn further(&self) -> u32 {
        self.further
    }

    /// Where the notches begin, how wide they are, and whether they move.
    #[inline]
    pub(crate) fn follows(&self) -> (f32, [f32; 2], bool) {
        (self.mains.0, self.width.each(), self.follow)
    }
}

/// What the chain remembers, in the unit of its input.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct State {
    sections: [svf::State; 3],
    harmonic: svf::State,
}

impl State {
    /// A chain that has settled at `x`.
    pub fn settled(x: f32) -> Self {
        let section = svf::settled(x);
        Self { sections: [section; 3], harmonic: section }
    }

    /// One tick: takes the newest sample, gives the filtered one.
    #[inline]
    pub fn tick(&mut self, c: &Coefficients, x: f32) -> f32 {
        let y = gap_filter::tick(&c.sections, &mut self.sections, x);
        if c.further != 0 {
            rare();
            return self.harmonic.notch(&c.harmonic, y);
        }
        y
    }

    /// The low-pass alone, to show what goes into the notch: a state is ticked by this or by [`State::tick`].
    pub fn low_pass(&mut self, c: &Coefficients, x: f32) -> f32 {
        let ([first, second, _], [first_c, second_c, _]) = (&mut self.sections, &c.sections);
        second.low_pass(second_c, first.low_pass(first_c, x))
    }

    /// Goes on with other coefficients: the output stays where it is and moves on from there.
    pub fn retune(&mut self, old: &Coefficients, new: &Coefficients) {
        for ((state, old), new) in self.sections.iter_mut().zip(&old.sections).zip(&new.sections) {
            svf::retune(state, old, new);
        }
        if old.further != 0 {
            svf::retune(&mut self.harmonic, &old.harmonic, &new.harmonic);
        } else {
            // Not ticked until now: it starts from what the mains notch gives, which its integrators do not where there is hum.
            let ([_, low_pass, mains], [_, _, of_mains]) = (&self.sections, &old.sections);
            self.harmonic = svf::settled(low_pass.low - (of_mains.r - of_mains.g) * mains.band);
        }
    }

    /// Multiplies everything remembered by `ratio`, for an input whose unit has changed.
    pub fn scale(&mut self, ratio: f32) {
        for section in self.sections.iter_mut().chain([&mut self.harmonic]) {
            svf::scale(section, ratio);
        }
    }
}

/// A chain whose notches follow the mains. It moves the coefficients of its own; the state is that of any chain.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Tracked {
    coefficients: Coefficients,
    tracker: Tracker,
}

impl Tracked {
    /// Begins at the mains frequency of the configuration.
    pub fn new(coefficients: Coefficients) -> Tracked {
        Tracked { coefficients, tracker: Tracker::new(coefficients.mains) }
    }

    /// As [`State::tick`], and follows the mains where the configuration says so.
    #[inline]
    pub fn tick(&mut self, state: &mut State, x: f32) -> f32 {
        let y = state.tick(&self.coefficients, x);
        if self.coefficients.follow {
            self.follow(state);
        }
        y
    }

    #[inline(always)]
    fn follow(&mut self, state: &State) {
        rare();
        let width = self.coefficients.width;
        let Coefficients { sections: [_, _, mains], harmonic, further, .. } = &mut self.coefficients;
        let harmonic = (*further != 0).then_some(harmonic);
        let [_, _, notch] = &state.sections;
        self.tracker.tick(notch.band, &mut Notches { mains, harmonic, width });
    }

    /// Goes on with another configuration: the output stays where it is and moves on from there. Notches that have followed the
    /// hum stay where they are while mains frequency and Q are the same.
    pub fn retune(&mut self, state: &mut State, new: &Coefficients) {
        let old = self.coefficients;
        self.coefficients = *new;
        if old.follow && new.follow && (old.mains, old.width) == (new.mains, new.width) {
            let [.., mains] = &mut self.coefficients.sections;
            let [.., moved] = old.sections;
            *mains = moved;
            if old.further != 0 {
                self.coefficients.harmonic = old.harmonic;
            }
        } else {
            self.tracker = Tracker::new(new.mains);
        }
        state.retune(&old, &self.coefficients);
    }

    /// What it runs on now.
    pub fn coefficients(&self) -> &Coefficients {
        &self.coefficients
    }

    /// Whether what does not follow the hum is still that of a configuration.
    #[inline]
    pub fn is_of(&self, configured: &Coefficients) -> bool {
        let ([first, second, _], [of_first, of_second, _]) = (&self.coefficients.sections, &configured.sections);
        (first, second, self.coefficients.follows()) == (of_first, of_second, configured.follows())
    }

    /// Where the notch is.
    pub fn mains(&self) -> Hertz {
        self.tracker.mains()
    }

    /// Whether there is hum that the notch follows.
    pub fn is_locked(&self) -> bool {
        self.tracker.is_locked()
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::units::TICK_HZ;
    use proptest::prelude::*;
    use std::vec::Vec;

    const CORNERS: [f32; 7] = [20.0, 67.0, 89.0, 100.0, 195.0, 200.0, 2000.0];

    fn config(corner: f32, mains: f32, second_harmonic: bool) -> Config {
        Config { corner: Hertz(corner), mains: Hertz(mains), second_harmonic, ..Config::default() }
    }

    /// All corners, with either mains and the second harmonic.
    fn configs() -> impl Iterator<Item = Config> + Clone {
        CORNERS.into_iter().flat_map(|corner| {
            [(50.0, false), (60.0, false), (50.0, true)].map(|(mains, harmonic)| config(corner, mains, harmonic))
        })
    }

    /// Gain for a tone of 1500 codes on 2048, dB: rms of what is left over, rounding included, after 4 s to settle.
    fn gain_db(config: Config, hz: f64) -> f64 {
        let c = config.build().unwrap();
        let mut state = State::settled(2048.0);
        let ticks = TICK_HZ as usize;
        let tone = |n: usize| (core::f64::consts::TAU * hz * n as f64 / f64::from(TICK_HZ)).sin();
        let y: Vec<f64> = (0..5 * ticks)
            .map(|n| f64::from(state.tick(&c, (2048.0 + 1500.0 * tone(n)) as f32)) - 2048.0)
            .skip(4 * ticks)
            .collect();
        let squares: f64 = y.iter().map(|y| y * y).sum();
        10.0 * (squares / ticks as f64 / (1500.0 * 1500.0 / 2.0)).log10()
    }

    #[test]
    fn the_low_pass_is_3_db_down_at_its_corner_and_24_db_an_octave_above() {
        for corner in [195.0, 2000.0] {
            // The notch is moved out of the way.
            let far = Config { notch_q: 30.0, ..config(corner, 45.0, false) };
            assert!((gain_db(far, f64::from(corner)) + 3.01).abs() < 0.05, "{corner} Hz");
        }
        assert!((gain_db(config(200.0, 50.0, false), 400.0) + 24.1).abs() < 0.4);
    }

    #[test]
    fn the_notch_takes_out_the_mains_by_more_than_90_db() {
        for corner in [20.0, 200.0, 2000.0] {
            for mains in [50.0, 60.0] {
                let db = gain_db(config(corner, mains, false), f64::from(mains));
                assert!(db < -90.0, "{mains} Hz behind {corner} Hz: {db} dB");
                let db = gain_db(config(corner, mains, true), 2.0 * f64::from(mains));
                assert!(db < -90.0, "second harmonic of {mains} Hz behind {corner} Hz: {db} dB");
            }
        }
    }

    #[test]
    fn the_notch_is_as_wide_as_its_page_says() {
        let wide = config(2000.0, 50.0, false);
        for hz in [40.99, 60.99] {
            assert!((gain_db(wide, hz) + 3.01).abs() < 0.05, "corner at {hz} Hz");
        }
        for (hz, db) in [(49.8, -33.96), (50.2, -34.0), (49.5, -25.97), (50.5, -26.06)] {
            assert!((gain_db(wide, hz) - db).abs() < 0.1, "{hz} Hz: {} dB", gain_db(wide, hz));
        }
        assert!((gain_db(Config { notch_q: 5.0, ..wide }, 49.5) + 20.0).abs() < 0.1);
    }

    #[test]
    fn a_constant_comes_out_within_a_hundredth_of_a_code_over_q() {
        let edges = [0.5, 2.5, 30.0].map(|notch_q| Config { notch_q, ..config(2000.0, 45.0, true) });
        for config in configs().chain(edges) {
            let c = config.build().unwrap();
            for x in [1.0, 777.0, 2049.0, 4095.0] {
                let mut state = State::default();
                let y = (0..60_000).fold(0.0, |_, _| state.tick(&c, x));
                assert!((y - x).abs() < 0.01 / config.notch_q, "{y} for {x} with {config:?}");
            }
        }
    }

    #[test]
    fn the_second_harmonic_comes_without_a_step_also_where_there_is_hum() {
        let [old, new] = [false, true].map(|harmonic| config(200.0, 50.0, harmonic).build().unwrap());
        let hum =
            |n: u32| 700.0 + 100.0 * (core::f32::consts::TAU * 50.0 * (n % TICK_HZ) as f32 / TICK_HZ as f32).sin();
        // Wherever in a period.
        for phase in [0, 50, 100, 170, 333] {
            let mut state = State::settled(700.0);
            (0..2 * TICK_HZ + phase).for_each(|n| {
                state.tick(&old, hum(n));
            });
            state.retune(&old, &new);
            let worst = (2 * TICK_HZ + phase..3 * TICK_HZ).map(|n| (state.tick(&new, hum(n)) - 700.0).abs());
            let worst = worst.fold(0.0, f32::max);
            assert!(worst < 2.0, "{phase}: {worst}");
        }
    }

    #[test]
    fn a_change_of_the_configuration_does_not_move_a_constant() {
        for (from, to) in configs().flat_map(|from| configs().map(move |to| (from, to))) {
            let (old, new) = (from.build().unwrap(), to.build().unwrap());
            let mut state = State::settled(1365.0);
            state.tick(&old, 1365.0);
            state.retune(&old, &new);
            for _ in 0..2000 {
                assert_eq!(state.tick(&new, 1365.0), 1365.0, "{from:?} to {to:?}");
            }
        }
    }

    /// A low-pass lags a ramp by a time that depends on its corner, so a change of corner has to move the output by the
    /// difference of two lags. It does so smoothly: by less than half the old lag in any tick, never past the ramp
    /// by more than a tenth of it, and never back behind where it stood.
    #[test]
    fn a_change_of_the_configuration_moves_a_ramp_only_by_its_lag() {
        const CODES_PER_TICK: f32 = 100.0 / TICK_HZ as f32;
        let ramp = |n: i32| 1000.0 + n as f32 * CODES_PER_TICK;
        for (from, to) in configs().flat_map(|from| configs().map(move |to| (from, to))) {
            let (old, new) = (from.build().unwrap(), to.build().unwrap());
            let mut state = State::settled(1000.0);
            let mut y = (0..6000).fold(0.0, |_, n| state.tick(&old, ramp(n)));
            let start = y;
            let lag = ramp(5999) - start;
            state.retune(&old, &new);
            for n in 6000..12_000 {
                let next = state.tick(&new, ramp(n));
                assert!(next > start - 2e-3, "{from:?} to {to:?}: back from {start} to {next}");
                assert!(next - y < lag / 2.0 + CODES_PER_TICK, "{from:?} to {to:?}: {y} to {next}, lag {lag}");
                assert!(next < ramp(n) + 0.1 * lag, "{from:?} to {to:?}: {next} ahead of {}", ramp(n));
                y = next;
            }
        }
    }

    #[test]
    fn a_parameter_out_of_range_is_named() {
        let name = |config: Config| config.build().map_err(|e| e.name).err();
        for bad in [19.9, 2000.1, f32::NAN, f32::INFINITY, 0.0, -200.0] {
            assert_eq!(name(config(bad, 50.0, false)), Some("low-pass corner (Hz)"));
        }
        for bad in [44.9, 65.1, f32::NAN] {
            assert_eq!(name(config(200.0, bad, false)), Some("mains frequency (Hz)"));
        }
        for bad in [0.49, 30.1, f32::NAN] {
            assert_eq!(name(Config { notch_q: bad, ..Config::default() }), Some("notch Q"));
        }
        for good in [config(20.0, 45.0, true), config(2000.0, 65.0, true)] {
            assert_eq!(name(good), None);
        }
    }

    proptest! {
        #[test]
        fn no_sequence_of_codes_and_changes_drives_the_output_away(
            runs in prop::collection::vec((0..21_usize, any::<bool>(), prop::collection::vec(any::<u16>(), 1..400)), 1..12),
        ) {
            let mut config = Config::default();
            let mut c = config.build().unwrap();
            let mut state = State::default();
            for (index, hold, codes) in runs {
                config = configs().nth(index).unwrap_or(config);
                let new = config.build().unwrap();
                state.retune(&c, &new);
                c = new;
                for code in codes {
                    // A code held for long lets every section ring out to its peak.
                    for _ in 0..if hold { 50 } else { 1 } {
                        let y = state.tick(&c, f32::from(code));
                        prop_assert!(y.abs() < 4.0 * f32::from(u16::MAX), "{y}");
                    }
                }
            }
        }
    }
}
