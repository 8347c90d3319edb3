//! What has no deadline: the watchdog's roll call, the log, what is kept in flash, the resets of a host.

use super::keeper::Keeper;
use super::protocol::{Protocol, log_boot, log_report};
use super::{Chore, MS, ROLL, Report, Reset, WAITING};
use core::sync::atomic::Ordering::Relaxed;
use edm_hal_shim::clock::Clock;
use edm_hal_shim::stm32f4::cycles::Cycles;
use edm_hal_shim::stm32f4::watchdog::Watchdog;
use edm_hal_shim::stm32f4::{dying, encoder};
use edm_servo_head::head::Leave;
use heapless::spsc::{Consumer, Producer};
use rtic::Mutex;

/// Cycles from a reset by the host to boot-up. Hosts begin to wait for it after they have sent the reset, and miss one that
/// comes at once.
const START_UP: u32 = 50 * MS;

/// What idle owns.
pub struct Idle {
    pub(super) watchdog: Watchdog,
    pub(super) keeper: Keeper,
    pub(super) clock: Cycles,
    /// The host has reset the node, at this count.
    pub(super) reset: Option<u32>,
    pub(super) reports: Consumer<'static, Report>,
    pub(super) granted: Consumer<'static, (Chore, Leave)>,
    pub(super) returned: Producer<'static, Leave>,
    pub(super) resets: Consumer<'static, Reset>,
}

impl Idle {
    /// One round.
    pub fn round(&mut self, protocol: &mut impl Mutex<T = Protocol>) {
        match ROLL.missing(self.clock.now()) {
            None => self.watchdog.feed(),
            Some(task) => dying::silent(task),
        }
        if let Some(report) = self.reports.dequeue() {
            log(&report);
        }
        if let Some((chore, leave)) = self.granted.dequeue() {
            self.change(chore, leave, protocol);
        }
        if let Some(reset) = self.resets.dequeue() {
            self.reset = Some(self.clock.now());
            if let Reset::Node = reset {
                let image = self.keeper.load();
                log_report(&protocol.lock(|protocol| protocol.restart(image)));
            }
        }
        let now = self.clock.now();
        if self.reset.take_if(|since| now.wrapping_sub(*since) >= START_UP).is_some() {
            let image = self.keeper.load();
            log_boot(protocol.lock(|protocol| protocol.boot(image)));
        }
    }

    fn change(&mut self, chore: Chore, leave: Leave, protocol: &mut impl Mutex<T = Protocol>) {
        let compose = |image: &mut _| protocol.lock(|protocol| protocol.keep(chore, image));
        let result = self.keeper.change(&leave, &mut self.watchdog, compose);
        // Nobody could report or decode an edge while the flash was erased.
        encoder::missed();
        ROLL.start(self.clock.now());
        protocol.lock(|protocol| protocol.done(result));
        // Never full: there is one leave.
        let _ = self.returned.enqueue(leave);
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
