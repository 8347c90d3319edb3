//! The period of a law.

use crate::gap::pulses::Counts;

/// Time to the end of a period.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Period {
    left: u32,
}

impl Period {
    /// Goes on by so many servo ticks: true where a period of `period` ticks begins. The first one begins at once.
    pub fn begins(&mut self, period: u32, ticks: u32) -> bool {
        self.left = self.left.saturating_sub(ticks);
        let begins = self.left == 0;
        if begins {
            self.left = period;
        }
        begins
    }
}

/// Pulses of a period.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pulses {
    period: Period,
    /// Counts when it began; none before the first one.
    from: Option<Counts>,
}

impl Pulses {
    /// Goes on by so many servo ticks, with the counts of now. At the end of a period of `period` ticks: its pulses.
    pub fn ended(&mut self, period: u32, ticks: u32, counts: &Counts) -> Option<Counts> {
        if !self.period.begins(period, ticks) {
            return None;
        }
        self.from.replace(*counts).map(|from| counts.since(&from))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gap::pulses::Class;

    #[test]
    fn pulses_of_a_period_are_those_since_it_began() {
        let mut pulses = Pulses::default();
        let mut counts = Counts::default();
        let mut ended = Vec::new();
        for call in 0..9 {
            counts.classes[Class::Spark as usize] += call;
            ended.extend(pulses.ended(20, 5, &counts).map(|new| new.class(Class::Spark)));
        }
        assert_eq!(ended, [1 + 2 + 3 + 4, 5 + 6 + 7 + 8]);
    }
}
