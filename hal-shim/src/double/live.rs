//! The circuit behind the live signal, on any clock.

use crate::live::Live;

/// What the outside does with the three lines, and what may be wrong with it.
#[derive(Clone, Debug, Default)]
pub struct Circuit {
    live: bool,
    arm: bool,
    /// The monostable runs until then.
    until: Option<u64>,
    latched: bool,
    /// What is wrong.
    pub broken: Broken,
}

/// A line or a part that is stuck, at a level or, where an edge is what counts, at either.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Broken {
    /// The line of the edges.
    pub live: bool,
    /// The line that arms.
    pub arm: bool,
    /// The line that is read back.
    pub read: Option<bool>,
    /// The monostable: at rest, or running without end.
    pub monostable: Option<bool>,
    /// The latch itself.
    pub latch: Option<bool>,
}

impl Circuit {
    /// The chip drives the line of the edges; the monostable then runs for `time` from `now` on. A time that has come is let
    /// pass by [`Circuit::pass`] before.
    pub fn live(&mut self, now: u64, time: u64, high: bool) {
        if high && !self.live && !self.broken.live {
            self.until = Some(now + time);
        }
        self.live = high;
    }

    /// The chip drives the line that arms.
    pub fn arm(&mut self, high: bool) {
        if high && !self.arm && !self.broken.arm {
            self.latched = self.runs();
        }
        self.arm = high;
    }

    /// It is `now`.
    pub fn pass(&mut self, now: u64) {
        if self.until.is_some_and(|until| until <= now) {
            self.until = None;
        }
        self.latched &= self.runs();
    }

    /// When the monostable expires.
    pub fn expires(&self) -> Option<u64> {
        self.until
    }

    fn runs(&self) -> bool {
        self.broken.monostable.unwrap_or(self.until.is_some())
    }

    /// Pulses and bridge may be switched on.
    pub fn enables(&self) -> bool {
        self.broken.latch.unwrap_or(self.latched)
    }

    /// What is read back.
    pub fn reads(&self) -> bool {
        self.broken.read.unwrap_or(self.enables())
    }
}

/// The circuit at a head whose clock is the servo tick itself; a monostable of eight ticks, 0.4 ms.
#[derive(Clone, Debug, Default)]
pub struct TestLive {
    /// Outside.
    pub circuit: Circuit,
    ticks: u64,
    runs: bool,
    level: bool,
}

/// Ticks for which the monostable of [`TestLive`] runs.
const TICKS: u64 = 8;

impl Live for TestLive {
    fn toggle(&mut self) {
        self.ticks += 1;
        self.circuit.pass(self.ticks);
        self.level ^= self.runs;
        self.circuit.live(self.ticks, TICKS, self.level);
    }

    fn run(&mut self, runs: bool) {
        self.runs = runs;
    }

    fn arm(&mut self, high: bool) {
        self.circuit.arm(high);
    }

    fn armed(&self) -> bool {
        self.circuit.reads()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn running() -> TestLive {
        let mut live = TestLive::default();
        live.run(true);
        (0..4).for_each(|_| live.toggle());
        live
    }

    #[test]
    fn it_arms_by_an_edge_and_only_while_the_edges_come() {
        let mut live = TestLive::default();
        live.arm(true);
        assert!(!live.armed());
        live.run(true);
        (0..20).for_each(|_| live.toggle());
        // A level is no edge.
        assert!(!live.armed());
        live.arm(false);
        live.arm(true);
        assert!(live.armed());
        (0..1000).for_each(|_| live.toggle());
        live.arm(false);
        assert!(live.armed());
    }

    #[test]
    fn without_edges_the_latch_lets_go_and_stays_off_when_they_come_again() {
        let mut live = running();
        live.arm(true);
        live.run(false);
        let off = (1..100).find(|_| {
            live.toggle();
            !live.armed()
        });
        // The newest rising edge was one or two ticks ago.
        assert!(off.is_some_and(|ticks| (TICKS - 1..=TICKS).contains(&ticks)), "{off:?}");
        live.run(true);
        (0..20).for_each(|_| live.toggle());
        assert!(!live.armed());
    }

    #[test]
    fn what_is_stuck_stays_so() {
        let broken = |broken: Broken| {
            let mut live = TestLive::default();
            live.circuit.broken = broken;
            live.run(true);
            (0..4).for_each(|_| live.toggle());
            live.arm(true);
            let armed = live.armed();
            live.run(false);
            (0..20).for_each(|_| live.toggle());
            (armed, live.armed())
        };
        assert_eq!(broken(Broken::default()), (true, false));
        assert_eq!(broken(Broken { live: true, ..Broken::default() }), (false, false));
        assert_eq!(broken(Broken { arm: true, ..Broken::default() }), (false, false));
        for level in [false, true] {
            assert_eq!(broken(Broken { read: Some(level), ..Broken::default() }), (level, level));
            assert_eq!(broken(Broken { monostable: Some(level), ..Broken::default() }), (level, level));
            assert_eq!(broken(Broken { latch: Some(level), ..Broken::default() }), (level, level));
        }
    }
}
