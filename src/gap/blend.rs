//! From one average of the gap voltage to the other without a step.
//!
//! The plain average of a voltage that is the same in all on-time is the gated one times the share of on-time. After a change the
//! reading goes from the one to the other with a time constant: p of it is plain, and p goes to 1 or 0. Meanwhile the share of
//! on-time s is counted, and with it by how much the same gap reads higher now, 1 + p (s - 1) over what it was: what was measured
//! with the average before, the open circuit, is worth so much now.

use edm_hal_shim::gap::BLOCK;

/// Difference of p from its end at which the change is over: 0.1 V of 100.
const GONE: f32 = 0.001;
/// Conversions without a gate that may be off-time of a generator at work, 3 ms; longer than that there are no pulses.
const OFF: u32 = 60 * BLOCK as u32;

/// How much of which average is read.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(super) struct Blend {
    /// One average gives way to the other.
    changes: bool,
    /// Share of the plain average, where that goes, and what it was when the change began.
    plain: f32,
    to: f32,
    from: f32,
    /// What a voltage reads now over what it read with the first average; and when the change began.
    gauge: f32,
    before: f32,
    /// Conversions since then, those of on-time, and those since the newest of on-time.
    all: u32,
    on: u32,
    off: u32,
}

impl Blend {
    /// The first average.
    pub fn new(plain: bool) -> Blend {
        let plain = share(plain);
        Blend { changes: false, plain, to: plain, from: plain, gauge: 1.0, before: 1.0, all: 0, on: 0, off: 0 }
    }

    /// An average gives way to the other.
    #[inline(always)]
    pub fn changes(&self) -> bool {
        self.changes
    }

    /// By how much the same gap reads higher now than with the first average, as a share of that.
    #[inline(always)]
    pub fn regauged(&self) -> f32 {
        self.gauge - 1.0
    }

    /// Another average from here on: at once where there are no pulses.
    pub fn begin(&mut self, plain: bool, pulses: bool) {
        self.to = share(plain);
        if !pulses {
            self.settle();
        } else if !self.changes {
            (self.from, self.before, self.all, self.on, self.off) = (self.plain, self.gauge, 0, 0, 0);
            self.changes = true;
        }
    }

    /// Goes on by a block with so many conversions of on-time; `fade` of the difference fades. The share of the plain average.
    pub fn block(&mut self, on: u32, fade: f32) -> f32 {
        self.off = self.off.saturating_add(BLOCK as u32);
        if on > 0 {
            // A minute of it leaves room.
            if self.off <= OFF && self.all < u32::MAX / 2 {
                self.all = self.all.wrapping_add(self.off);
                self.on = self.on.wrapping_add(on);
            }
            self.off = 0;
        }
        self.plain += fade * (self.to - self.plain);
        let of = |plain: f32| match self.all {
            0 => 1.0,
            all => 1.0 + plain * (self.on as f32 / all as f32 - 1.0),
        };
        if (self.plain - self.to).abs() < GONE {
            self.plain = self.to;
        }
        // On-time of one conversion in a thousand is a tenth of the least that a generator has.
        let from = of(self.from);
        if from > GONE {
            self.gauge = self.before * of(self.plain) / from;
        }
        if self.plain == self.to {
            self.settle();
        }
        self.plain
    }

    fn settle(&mut self) {
        (self.plain, self.changes) = (self.to, false);
    }
}

fn share(plain: bool) -> f32 {
    if plain { 1.0 } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// So many ticks of pulses of 160 us, then 40 us of pause; the share of the plain average after each, and the gauge.
    fn run(blend: &mut Blend, ticks: usize) -> Vec<(f32, f32)> {
        let ons = [25, 25, 25, 5];
        (0..ticks).map(|n| (blend.block(ons[n % 4], 0.01), 1.0 + blend.regauged())).collect()
    }

    #[test]
    fn a_change_has_no_step_and_ends_with_what_the_other_average_reads() {
        let mut blend = Blend::new(false);
        blend.begin(true, true);
        let there = run(&mut blend, 1000);
        assert!(there.windows(2).all(|pair| (0.0..0.011).contains(&(pair[1].0 - pair[0].0))));
        assert!(there.iter().all(|(plain, gauge)| (gauge - (1.0 - 0.2 * plain)).abs() < 0.01), "{there:?}");
        assert!(!blend.changes() && (blend.regauged() + 0.2).abs() < 1e-3, "{blend:?}");
        blend.begin(false, true);
        let back = run(&mut blend, 1000);
        assert!(back.windows(2).all(|pair| (0.0..0.011).contains(&(pair[0].0 - pair[1].0))));
        assert!(!blend.changes() && blend.regauged().abs() < 2e-3, "{blend:?}");
    }

    #[test]
    fn a_change_of_mind_goes_back_from_where_it_is() {
        let mut blend = Blend::new(false);
        blend.begin(true, true);
        let there = run(&mut blend, 60);
        blend.begin(false, true);
        let back = run(&mut blend, 1000);
        assert!((back[0].0 - there[59].0).abs() < 0.011 && !blend.changes() && blend.regauged().abs() < 1e-6);
    }

    #[test]
    fn without_pulses_it_is_the_other_average_at_once_and_nothing_is_known_of_its_gauge() {
        let mut blend = Blend::new(false);
        blend.begin(true, false);
        assert!(!blend.changes() && blend.plain == 1.0 && blend.regauged() == 0.0);
    }

    #[test]
    fn a_stretch_without_pulses_is_no_off_time() {
        let mut blend = Blend::new(false);
        blend.begin(true, true);
        run(&mut blend, 100);
        (0..100).for_each(|_| {
            blend.block(0, 0.0);
        });
        run(&mut blend, 1000);
        assert!((blend.regauged() + 0.2).abs() < 2e-3, "{blend:?}");
    }
}
