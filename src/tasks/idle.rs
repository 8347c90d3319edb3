//! What has no deadline: the watchdog's roll call, the log, the settings in flash.

use super::keeper::Keeper;
use super::{Granted, ROLL, Report, Returned};
use edm_hal_shim::clock::Clock;
use edm_hal_shim::stm32f4::cycles::Cycles;
use edm_hal_shim::stm32f4::watchdog::Watchdog;
use edm_hal_shim::stm32f4::{dying, encoder};
use edm_servo_head::head::{Change, Refused};
use heapless::spsc::{Consumer, Producer};

/// What idle owns.
pub struct Idle {
    pub(super) watchdog: Watchdog,
    pub(super) keeper: Keeper,
    pub(super) clock: Cycles,
    pub(super) changes: Consumer<'static, Change>,
    pub(super) reports: Consumer<'static, Report>,
    pub(super) granted: Consumer<'static, Granted>,
    pub(super) returned: Producer<'static, Returned>,
}

impl Idle {
    /// One round.
    pub fn round(&mut self) {
        match ROLL.missing(self.clock.now()) {
            None => self.watchdog.feed(),
            Some(task) => dying::silent(task),
        }
        while let Some(change) = self.changes.dequeue() {
            defmt::info!("{}", change);
        }
        if let Some(report) = self.reports.dequeue() {
            log(&report);
        }
        if let Some(granted) = self.granted.dequeue() {
            self.store(granted);
        }
    }

    fn store(&mut self, (number, leave): Granted) {
        let result = self.keeper.save(&leave, &mut self.watchdog);
        match &result {
            Ok(()) => defmt::info!("settings: stored"),
            Err(error) => defmt::error!("settings: not stored, {}", error),
        }
        // Nobody could report or decode an edge while the flash was erased.
        encoder::missed();
        ROLL.start(self.clock.now());
        // Never full: there is one leave.
        let _ = self.returned.enqueue((leave, (number, result.map_err(|_| Refused::NotStored))));
    }
}

fn log(report: &Report) {
    let Report { status, shorts, pulse: [current, voltage], captures } = report;
    defmt::info!(
        "{} at {=i64} counts, gap {=f32} V ({}), {=u32} shorts, newest pulse {=u16} {=u16}, {}",
        status.state,
        status.position,
        status.gap.filtered.0,
        status.gap.quality,
        *shorts,
        *current,
        *voltage,
        captures
    );
}
