//! Adaptive jumps: when to jump, and how high, by what the jump before has done for the gap.
//!
//! Debris gathers in a hole until a jump takes it out; in a dirty gap pulses arc and short. A jump costs its own time, so there is a best
//! interval, which depends on depth, area and flushing and is known to nobody beforehand. Here the share of arcs and shorts among
//! the pulses that burned says how dirty the gap is: at the end of an interval it is brought to a set share. Dirtier, and the next
//! interval is shorter; cleaner, and it is longer. A gap that turns dirty at once gets its jump at once. A jump after which the gap is
//! still half as dirty as before was too low; one that has cleaned it may be a little lower.
//!
//! Interval and height stay within the bounds that the host sets.

use crate::gap::pulses::{Class, Counts};
use crate::units::{TICKS_PER_MS, larger, within};

/// When and how high.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Share of arcs and shorts at the end of an interval, 0..1; 0: jumps are periodic.
    pub share: f32,
    /// Shortest and longest interval of erosion, servo ticks.
    pub interval: (u32, u32),
    /// Least and largest height, counts.
    pub height: (u32, u32),
}

/// Servo ticks in which a gap that has turned dirty is seen, the multiple of the share that it takes, and the burned pulses.
const LOOK: u32 = 25 * TICKS_PER_MS;
const DIRTY: f32 = 4.0;
const ENOUGH: u32 = 20;
/// Most by which the interval changes from jump to jump.
const SLOWER: f32 = 1.25;
const SOONER: f32 = 0.7;
/// Share of an interval in which what the jump did is seen.
const EARLY: f32 = 0.25;
/// Share of the dirt before that is left after a jump that was too low, and by how much the next is higher; and of one that may be lower.
const LEFT: f32 = 0.5;
const HIGHER: f32 = 1.25;
const GONE: f32 = 0.2;
const LOWER: f32 = 0.97;

/// The rhythm of the jumps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rhythm {
    /// Interval, servo ticks, and height, counts; 0: not begun.
    interval: f32,
    height: f32,
    /// Counts when the erosion began, when what the jump did was seen, and at the newest look.
    began: Option<Counts>,
    settled: Option<Counts>,
    looked: Option<(Counts, u32)>,
    /// Dirt at the end of the interval before.
    before: f32,
}

/// Arcs and shorts among the pulses that burned, and how many these are.
fn dirt(new: &Counts) -> (f32, u32) {
    let bad = new.class(Class::Arc).wrapping_add(new.shorted());
    let burned = bad.wrapping_add(new.discharged());
    (bad as f32 / larger(burned as f32, 1.0), burned)
}

impl Rhythm {
    /// The erosion begins, or goes on after a jump.
    pub fn begin(&mut self, config: &Config, counts: &Counts) {
        let (least, most) = config.interval;
        if self.interval == 0.0 {
            self.interval = libm::sqrtf(least as f32 * most as f32);
            self.height = config.height.0 as f32;
        }
        self.interval = within(self.interval, least as f32, most as f32);
        self.height = within(self.height, config.height.0 as f32, config.height.1 as f32);
        (self.began, self.settled, self.looked) = (Some(*counts), None, Some((*counts, 0)));
    }

    /// Height of the next jump, counts.
    pub fn height(&self, config: &Config) -> u32 {
        if self.height > 0.0 { self.height as u32 } else { config.height.0 }
    }

    /// Whether a jump is due, `eroded` servo ticks after the erosion began. One that is due has to be made, or is left out.
    pub fn is_due(&mut self, config: &Config, counts: &Counts, eroded: u32) -> bool {
        let Some(began) = self.began else {
            self.begin(config, counts);
            return false;
        };
        if self.settled.is_none() && eroded as f32 >= EARLY * self.interval {
            self.settled = Some(*counts);
            self.judge_height(config, dirt(&counts.since(&began)));
        }
        let turned = self.has_turned(config, counts, eroded);
        // A head that has not come back to the work has nothing to take away: it would jump off again, and never come there.
        let back = eroded as f32 >= self.interval && dirt(&counts.since(&began)).1 >= ENOUGH;
        let due = back || turned || eroded >= config.interval.1;
        if due {
            let (share, burned) = dirt(&counts.since(&self.settled.unwrap_or(began)));
            let change = libm::sqrtf(config.share / larger(share, 0.01 * config.share));
            if turned {
                self.interval = eroded as f32;
            } else if burned >= ENOUGH {
                self.interval *= within(change, SOONER, SLOWER);
            }
            self.before = share;
            (self.began, self.settled) = (None, None);
        }
        due
    }

    /// The gap has turned dirty at once.
    fn has_turned(&mut self, config: &Config, counts: &Counts, eroded: u32) -> bool {
        let (least, _) = config.interval;
        let Some((from, at)) = self.looked else { return false };
        if eroded.wrapping_sub(at) < LOOK {
            return false;
        }
        self.looked = Some((*counts, eroded));
        let (share, burned) = dirt(&counts.since(&from));
        eroded >= least && burned >= ENOUGH && share > DIRTY * config.share
    }

    fn judge_height(&mut self, config: &Config, (share, burned): (f32, u32)) {
        if burned < ENOUGH {
            return;
        }
        if share > LEFT * self.before && self.before > config.share {
            self.height *= HIGHER;
        } else if share < GONE * self.before {
            self.height *= LOWER;
        }
        self.height = within(self.height, config.height.0 as f32, config.height.1 as f32);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONFIG: Config = Config { share: 0.05, interval: (4_000, 40_000), height: (500, 2000) };

    /// Jumps over a hole that turns as dirty as this with the time since a jump, s; seconds of erosion between the last ones, and the height.
    fn jumps(dirt: impl Fn(f32, f32) -> f32, count: usize) -> (f32, f32) {
        let (mut rhythm, mut counts) = (Rhythm::default(), Counts::default());
        let mut seconds = 0.0;
        for _ in 0..count {
            let height = rhythm.height(&CONFIG) as f32;
            rhythm.begin(&CONFIG, &counts);
            let mut eroded = 0;
            let mut bad = 0.0;
            while !rhythm.is_due(&CONFIG, &counts, eroded) {
                eroded += 20;
                // 4 discharges a millisecond.
                bad += 4.0 * dirt(eroded as f32 / 20_000.0, height);
                let arcs = bad as u32;
                bad -= arcs as f32;
                counts.classes[Class::Arc as usize] += arcs;
                counts.classes[Class::Spark as usize] += 4 - arcs.min(4);
                counts.ignited += 4;
            }
            seconds = eroded as f32 / 20_000.0;
        }
        (seconds, rhythm.height(&CONFIG) as f32)
    }

    #[test]
    fn the_interval_is_the_one_that_ends_at_the_set_share() {
        // 5 % on the mean of the last three quarters: at 1 s where it turns dirty by 8 % a second, and at 0.5 s by 16 %.
        let (slow, _) = jumps(|seconds, _| 0.08 * seconds, 60);
        assert!((0.7..1.2).contains(&slow), "{slow} s");
        let (fast, _) = jumps(|seconds, _| 0.16 * seconds, 60);
        assert!((0.35..0.6).contains(&fast), "{fast} s");
    }

    #[test]
    fn a_clean_hole_jumps_as_rarely_and_a_filthy_one_as_often_as_the_host_allows() {
        assert!((jumps(|_, _| 0.0, 60).0 - 2.0).abs() < 0.01);
        assert!(jumps(|_, _| 0.9, 60).0 < 0.23);
    }

    #[test]
    fn a_gap_that_turns_dirty_gets_its_jump_at_once() {
        let (seconds, _) = jumps(|seconds, _| if seconds > 0.6 { 0.5 } else { 0.0 }, 20);
        assert!((0.55..0.7).contains(&seconds), "{seconds} s");
    }

    #[test]
    fn a_head_that_needs_longer_for_the_way_back_than_its_interval_comes_there() {
        let (mut rhythm, mut counts) =
            (Rhythm { interval: 4_000.0, height: 500.0, ..Rhythm::default() }, Counts::default());
        rhythm.begin(&CONFIG, &counts);
        let mut eroded = 0;
        while !rhythm.is_due(&CONFIG, &counts, eroded) {
            eroded += 20;
            let arrived = u32::from(eroded > 10_000);
            counts.classes[Class::Spark as usize] += arrived;
            counts.ignited += arrived;
        }
        assert!((10_400..10_500).contains(&eroded), "{eroded} ticks");
        assert!(rhythm.interval > 4_000.0);
        // Where nothing burns, the longest interval counts.
        rhythm.begin(&CONFIG, &counts);
        assert!(!rhythm.is_due(&CONFIG, &counts, 39_980) && rhythm.is_due(&CONFIG, &counts, 40_000));
    }

    #[test]
    fn a_jump_that_does_not_clean_gets_higher_and_one_that_does_lower_within_the_bounds() {
        // Below 1 mm nothing goes out.
        let (_, height) = jumps(|seconds, height| if height < 1000.0 { 0.1 } else { 0.08 * seconds }, 60);
        assert!((900.0..1500.0).contains(&height), "{height}");
        assert_eq!(jumps(|_, _| 0.1, 60).1, 2000.0);
        assert_eq!(jumps(|seconds, _| if seconds > 0.9 { 0.1 } else { 0.0 }, 200).1, 500.0);
    }
}
