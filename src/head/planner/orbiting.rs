//! A depth that is reached in an orbit.

use super::Planner;
use crate::head::command::Refused;
use crate::head::orbit::{Config, Orbit};
use crate::path::{self, Path};
use crate::units::{Fixed, Nanometres};
use core::ops::DerefMut;

/// Pieces that wait ahead: none of them is so short that a plan could come past all of it.
const AHEAD: u16 = 3;

impl<P: DerefMut<Target = Path>> Planner<P> {
    /// Begins an orbit from the end of the path down to a depth.
    pub(super) fn orbit_to(&mut self, config: Config, to: Fixed) -> Result<(), Refused> {
        let from = self.route.end_nm();
        let [begin, ..] = from;
        let to = to.round().saturating_mul(self.config.axis.nm_per_count);
        let Some(orbit) = Orbit::new(config, from, to) else {
            let [target, min, max] = [to.saturating_sub(config.radius), begin, to].map(Nanometres);
            return Err(Refused::OutOfTravel { target, min, max });
        };
        self.orbit = Some((orbit, self.route.begun()));
        self.orbit_on();
        Ok(())
    }

    /// Appends the pieces that the head comes to next.
    pub(super) fn orbit_on(&mut self) {
        let Some((mut orbit, begun)) = self.orbit else { return };
        // One for each plan is enough; at the beginning it has to be a path at once.
        let mut pieces = if self.route.at_end() { AHEAD } else { 1 };
        let mut over = begun != self.route.begun();
        while !over && pieces > 0 && self.route.waiting() < AHEAD {
            pieces = pieces.saturating_sub(1);
            over = match orbit.next() {
                Some(piece) => !matches!(self.route.append(&piece), Ok(()) | Err(path::Refused::NoLength)),
                None => {
                    pieces = 0;
                    self.route.waiting() == 0
                }
            };
        }
        self.orbit = (!over).then_some((orbit, begun));
    }
}
