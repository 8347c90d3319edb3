//! Long retreats: backward moves of more than 5 um, whether the feed law or the reflex made them.
//!
//! \[G\] (eq. 9) counts a retreat as long when more than five consecutive retreat steps of 1 um follow each other in servo
//! cycles of 100 ms; a step forward or a hold ends the run. Here the electrode moves freely, so the same is read from its
//! true position: a retreat begins at the deepest point, continues as long as every [`STEP_UM`] more is reached within
//! [`CYCLE_MS`] of the last, and ends with an advance of [`STEP_UM`] or with the pause. Smaller forward motion within it
//! (noise, counts) does not break it. Counted while eroding and retreating only: the lift when the hole is done and the
//! reactions to faults are not retreats from the gap's state.

use crate::millisecond::{Millisecond, Phase};

/// Length beyond which a retreat is long, um.
pub const LONG_UM: f64 = 5.0;
/// One step of \[G\]: smaller motion is neither advance nor retreat, um.
const STEP_UM: f64 = 1.0;
/// One servo cycle of \[G\], ms.
pub const CYCLE_MS: u32 = 100;

/// Counts long retreats.
#[derive(Debug, Default)]
pub struct Retreats {
    run: Option<Run>,
    count: u64,
}

#[derive(Debug)]
struct Run {
    /// Deepest point, where the retreat began, um.
    from_um: f64,
    /// Highest point since, um.
    to_um: f64,
    /// Height at which the retreat last continued by a step, um, and the time since.
    step_um: f64,
    pause_ms: u32,
    counted: bool,
}

impl Run {
    fn new(from_um: f64) -> Run {
        Run { from_um, to_um: from_um, step_um: from_um, pause_ms: 0, counted: false }
    }
}

impl Retreats {
    /// Takes the newest millisecond.
    pub fn add(&mut self, ms: &Millisecond) {
        if !matches!(ms.phase, Phase::Eroding | Phase::Retreating) {
            self.run = None;
            return;
        }
        let (high, low) = (ms.position_um.min, ms.position_um.max);
        let run = self.run.get_or_insert_with(|| Run::new(low));
        // Against what was reached before: within one millisecond a fast retreat spans more than a step.
        let going_on = run.to_um < run.from_um - STEP_UM;
        let advanced = low > if going_on { run.to_um + STEP_UM } else { run.from_um };
        if advanced || run.pause_ms >= CYCLE_MS {
            *run = Run::new(low);
            return;
        }
        run.pause_ms += 1;
        if high <= run.step_um - STEP_UM {
            run.step_um = high;
            run.pause_ms = 0;
        }
        run.to_um = run.to_um.min(high);
        if !run.counted && run.from_um - run.to_um > LONG_UM {
            run.counted = true;
            self.count += 1;
        }
    }

    /// Long retreats so far.
    pub fn count(&self) -> u64 {
        self.count
    }
}
