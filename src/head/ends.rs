//! How an erosion ends: *spark-out* at the end of the path or a stop on it, or *break-through* before that, and then the lift out of the work.
//!
//! Both are judged by the share of discharges: how far the gap voltage lies below the open-circuit voltage that was measured
//! when the seek began, as a share of that. It is 0 while no pulse ignites and about 1 - [`Setpoint`](super::Setpoint) in a
//! gap that is kept. Single pulses do not show it: at the end of the blanking a good one has not ignited yet
//! ([`pulses`](crate::gap::pulses)).
//!
//! - *Spark-out* holds the head at the end under the feed law, which may take it back, until discharges have become rare or
//!   its time is over: what the gap still lets through is removed, and the depth is that of the path.
//! - *Break-through* has happened where discharges are rare although the head feeds where it has never been, deeper than
//!   where it may be expected. Going again over path that it knows says nothing.

use super::state::Reason;
use crate::units::Volts;

/// How to end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// Servo ticks of spark-out at the most; 0: none.
    pub spark_out: u32,
    /// Share of discharges, 0 to 1, below which they are rare.
    pub rare: f32,
    /// Servo ticks over which that share is taken, 1 at least.
    pub look: u32,
    /// Length of path behind the point where the work was found from which on break-through is looked for, um; 0: nowhere.
    pub through: u32,
    /// Length of path to go back afterwards, um; 0: the head stays.
    pub lift: u32,
}

/// Where an erosion is, as far as its end is concerned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Place {
    /// On the way, or back.
    Known,
    /// Farther than ever, so deep that it may be through.
    Deep,
    /// At the end of the path, or a stop on it, where the axis has been; which it is.
    End(Reason),
}

/// What of an erosion's end has come so far.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Ends {
    /// Ticks since the head was first at the end.
    waited: Option<u32>,
    /// Gap voltage times ticks, and ticks, of the look under way.
    sum: f32,
    looked: u32,
}

impl Ends {
    /// Goes on by so many ticks, at least one, with a gap voltage that can be trusted or none. Says why the erosion has ended.
    pub fn plan(
        &mut self,
        config: &Config,
        place: Place,
        gap: Option<Volts>,
        open: Volts,
        ticks: u32,
    ) -> Option<Reason> {
        let ends = match place {
            Place::End(reason) if config.spark_out == 0 => return Some(reason),
            place => matches!(place, Place::End(_)),
        };
        if ends || self.waited.is_some() {
            self.waited = Some(self.waited.map_or(0, |waited| waited.saturating_add(ticks)));
        }
        if ends && self.waited.is_some_and(|waited| waited >= config.spark_out) {
            return Some(Reason::SparkOutTime);
        }
        let rare = self.look(config, place, gap, open, ticks);
        match place {
            Place::End(_) if rare => Some(Reason::SparkedOut),
            Place::Deep if rare => Some(Reason::BrokenThrough),
            _ => None,
        }
    }

    /// Whether a spark-out has begun.
    pub fn spark_out(&self) -> bool {
        self.waited.is_some()
    }

    /// Whether a whole look has found discharges to be rare.
    fn look(&mut self, config: &Config, place: Place, gap: Option<Volts>, open: Volts, ticks: u32) -> bool {
        let (Some(Volts(gap)), true) = (gap, place != Place::Known && open.0 > 0.0) else {
            (self.sum, self.looked) = (0.0, 0);
            return false;
        };
        self.sum += gap * ticks as f32;
        self.looked = self.looked.saturating_add(ticks);
        if self.looked < config.look {
            return false;
        }
        let rare = self.sum >= (1.0 - config.rare) * open.0 * self.looked as f32;
        (self.sum, self.looked) = (0.0, 0);
        rare
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const END: Place = Place::End(Reason::PathEnd);
    const CONFIG: Config = Config { spark_out: 20_000, rare: 0.1, look: 2000, through: 1, lift: 0 };

    /// The tick, of 40 000, in which it ends, and why.
    fn end(config: &Config, place: impl Fn(u32) -> Place, gap: impl Fn(u32) -> Option<f32>) -> Option<(u32, Reason)> {
        let mut ends = Ends::default();
        (0..40_000).step_by(5).find_map(|tick| {
            ends.plan(config, place(tick), gap(tick).map(Volts), Volts(100.0), 5).map(|reason| (tick, reason))
        })
    }

    #[test]
    fn without_a_spark_out_the_end_of_the_path_is_the_end() {
        let config = Config { spark_out: 0, ..CONFIG };
        let place = |tick| if tick < 500 { Place::Known } else { END };
        assert_eq!(end(&config, place, |_| Some(50.0)), Some((500, Reason::PathEnd)));
        let stop = Place::End(Reason::PathStop);
        assert_eq!(end(&config, |_| stop, |_| Some(50.0)), Some((0, Reason::PathStop)));
    }

    #[test]
    fn a_spark_out_lasts_until_discharges_are_rare_or_its_time_is_over() {
        for (volts, found) in [
            (89.0, (20_000, Reason::SparkOutTime)),
            (91.0, (1995, Reason::SparkedOut)),
            (100.0, (1995, Reason::SparkedOut)),
            (0.0, (20_000, Reason::SparkOutTime)),
        ] {
            assert_eq!(end(&CONFIG, |_| END, |_| Some(volts)), Some(found), "{volts} V");
        }
        // From some moment on.
        let dies = |tick| Some(if tick < 8000 { 60.0 } else { 99.0 });
        assert_eq!(end(&CONFIG, |_| END, dies), Some((9995, Reason::SparkedOut)));
    }

    #[test]
    fn its_time_goes_on_where_the_law_goes_back_and_it_ends_at_the_end_only() {
        let place = |tick| if (1000..30_000).contains(&tick) { Place::Known } else { END };
        assert_eq!(end(&CONFIG, place, |_| Some(50.0)), Some((30_000, Reason::SparkOutTime)));
    }

    #[test]
    fn open_pulses_are_a_break_through_only_where_the_head_has_never_been() {
        assert_eq!(end(&CONFIG, |_| Place::Deep, |_| Some(95.0)), Some((1995, Reason::BrokenThrough)));
        assert_eq!(end(&CONFIG, |_| Place::Deep, |_| Some(85.0)), None);
        assert_eq!(end(&CONFIG, |_| Place::Known, |_| Some(95.0)), None);
        // Every time that it is back for a moment begins a look anew.
        let place = |tick| if tick % 1500 == 0 { Place::Known } else { Place::Deep };
        assert_eq!(end(&CONFIG, place, |_| Some(95.0)), None);
    }

    #[test]
    fn a_voltage_that_nobody_knows_says_nothing() {
        assert_eq!(end(&CONFIG, |_| Place::Deep, |_| None), None);
        let mut ends = Ends::default();
        assert!((0..10_000).all(|_| ends.plan(&CONFIG, Place::Deep, Some(Volts(1.0)), Volts(0.0), 5).is_none()));
    }
}
