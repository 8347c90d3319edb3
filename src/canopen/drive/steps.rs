//! Step and direction: what a host reads of the steps (2016h).

/// Steps of a host.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Steps {
    /// Since power-on, as in 2016h:1; changes of direction within a step; times that the direction changed too fast.
    pub counted: u32,
    /// See `counted`.
    pub turns: u32,
    /// See `counted`.
    pub lost: u32,
    /// Steps a second of the last whole window.
    pub rate: i32,
    /// Milliseconds since the newest.
    quiet: u8,
    then: u32,
    ms: u8,
}

/// Time over which the rate is counted, ms.
const WINDOW: u8 = 10;

impl Steps {
    /// Takes the newest counts, once a millisecond.
    pub fn observe(&mut self, counted: u32, turns: u32, lost: u32) {
        self.quiet = if counted == self.counted { self.quiet.saturating_add(1) } else { 0 };
        (self.counted, self.turns, self.lost) = (counted, turns, lost);
        self.ms = self.ms.saturating_add(1);
        if self.ms >= WINDOW {
            let stepped = counted.wrapping_sub(self.then).cast_signed();
            self.rate = stepped.saturating_mul(1000 / i32::from(WINDOW));
            (self.ms, self.then) = (0, counted);
        }
    }

    /// Whether steps have come within the window.
    pub fn come(&self) -> bool {
        self.quiet < WINDOW
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_is_that_of_the_last_ten_milliseconds_both_ways_and_across_the_wrap() {
        let mut steps = Steps { then: u32::MAX - 2, ..Steps::default() };
        for ms in 1..=10 {
            assert_eq!(steps.rate, 0);
            steps.observe((u32::MAX - 2).wrapping_add(500 * ms), 0, 0);
        }
        assert_eq!(steps.rate, 500_000);
        for _ in 0..10 {
            steps.observe(4997u32.wrapping_sub(7), 0, 0);
        }
        assert_eq!(steps.rate, -700);
    }
}
