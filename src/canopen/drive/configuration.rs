//! Settings on their way to the tasks, and what the guided check changes of them.

use super::{Drive, Order, codes};
use crate::canopen::objects::setting_address_at;
use crate::head::{Finding, Report};
use crate::settings::{Declared, Settings, place};

impl Drive {
    /// Every task runs what [`Drive::active`] said at [`Order::Configure`].
    pub fn runs_configuration(&mut self) {
        self.running = self.settings;
        (self.restarting, self.configuring) = (false, false);
    }

    /// The head has refused [`Order::Configure`], in a state that does not allow it. The settings are again those that run; if
    /// they were not a host's but come from a reset, they are ordered again when the head is disabled.
    pub fn refused_configuration(&mut self) {
        self.configuring = false;
        if self.restarting {
            self.stale = true;
        } else if let Ok(active) = self.running.build() {
            (self.settings, self.active) = (self.running, active);
        }
    }

    /// The settings wait until the head is disabled; no task runs them.
    pub fn is_stale(&self) -> bool {
        self.stale
    }

    /// Lets all tasks run the newest settings.
    pub(super) fn configure(&mut self) -> bool {
        let ordered = self.order(Order::Configure);
        self.configuring |= ordered;
        ordered
    }

    /// Result of commissioning.
    pub fn checked(&mut self, result: Result<Report, Finding>) {
        self.settings.commissioned = result.is_ok();
        self.running.commissioned = result.is_ok();
        self.active.head.commissioned = result.is_ok();
        // One that is on its way says what was known when it was ordered, and overtakes what the check has found.
        self.stale |= self.configuring;
        if let Ok(report) = result {
            self.learn(&report);
        }
        self.finding = match result {
            Ok(_) => 1,
            Err(finding) => codes::finding(finding),
        };
        let contradicted = match result {
            Err(Finding::Mass(found)) => Some((const { place(Settings::KEYS, "axis.mass_kg") }, found)),
            Err(Finding::Counterbalance(found)) => {
                Some((const { place(Settings::KEYS, "axis.counterbalance_n") }, found))
            }
            Err(Finding::OpenCircuit(found)) => Some((const { place(Settings::KEYS, "gap.open_v") }, found)),
            _ => None,
        };
        if let Some((field, found)) = contradicted {
            let (index, sub) = setting_address_at(field).unwrap_or_default();
            self.wrong = Some((index, sub, "must be what the guided check has measured"));
            self.contradiction = found;
        }
    }

    /// Lift and supervision are calculated from what commissioning has measured, as soon as the head is disabled.
    fn learn(&mut self, report: &Report) {
        let learnt = self.settings.learnt(report);
        if let Ok(active) = learnt.build() {
            (self.settings, self.active) = (learnt, active);
            self.stale = true;
        }
    }
}
