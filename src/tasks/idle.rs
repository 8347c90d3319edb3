//! What has no deadline: the watchdog's roll call, the log, the settings in flash.

use super::keeper::Keeper;
use super::{Checked, Granted, ROLL, Report, Returned, WAITING};
use core::sync::atomic::Ordering::Relaxed;
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
    pub(super) checked: Consumer<'static, Checked>,
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
        match self.checked.dequeue() {
            Some(Ok(report)) => defmt::info!("guided check passed: {}", report),
            Some(Err(finding)) => defmt::warn!("guided check: {}", finding),
            None => {}
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
        WAITING.store(true, Relaxed);
    }
}

fn log(report: &Report) {
    let Report { status, shorts, pulse: [current, voltage], captures } = report;
    defmt::info!(
        "{} at {=i64} counts ({=u32} illegal), motor {=f32} A, bus {=f32} V, {}",
        status.state,
        status.position,
        status.illegal_transitions,
        status.current.0,
        status.bus.0,
        status.safety
    );
    defmt::info!(
        "gap {=f32} V ({}), {=u32} shorts, newest pulse: current code {=u16}, voltage code {=u16}; {}",
        status.gap.filtered.0,
        status.gap.quality,
        *shorts,
        *current,
        *voltage,
        captures
    );
}
