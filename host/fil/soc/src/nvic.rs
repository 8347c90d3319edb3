//! Exceptions: pending, active, priorities, and which one runs next (ARMv7-M B1.5, B3.4).
//!
//! Sixteen system exceptions and 82 interrupts; four priority bits are implemented (RM0090 §12.1.1).

/// An exception number: 2 NMI, 3 HardFault, ... 15 SysTick, 16 + n interrupt n.
pub type Exception = u8;

/// Highest interrupt number plus one.
pub const INTERRUPTS: usize = 82;
const EXCEPTIONS: usize = 16 + INTERRUPTS;

/// System exceptions.
pub mod exception {
    /// Non-maskable interrupt.
    pub const NMI: u8 = 2;
    /// HardFault.
    pub const HARD_FAULT: u8 = 3;
    /// Memory management fault.
    pub const MEM_MANAGE: u8 = 4;
    /// Bus fault.
    pub const BUS_FAULT: u8 = 5;
    /// Usage fault.
    pub const USAGE_FAULT: u8 = 6;
    /// Supervisor call.
    pub const SV_CALL: u8 = 11;
    /// Pendable service call.
    pub const PEND_SV: u8 = 14;
    /// System timer.
    pub const SYS_TICK: u8 = 15;
}

/// Mask registers of the processor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Masks {
    /// PRIMASK is set.
    pub primask: bool,
    /// FAULTMASK is set.
    pub faultmask: bool,
    /// BASEPRI, zero is off.
    pub basepri: u8,
}

/// Interrupt controller and exception model.
#[derive(Clone)]
pub struct Nvic {
    pub(crate) enabled: u128,
    pending: u128,
    active: u128,
    /// Active exceptions, outermost first.
    stack: Vec<Exception>,
    /// Levels of the interrupt lines, from bit 16.
    lines: u128,
    priority: [u8; EXCEPTIONS],
    /// PRIGROUP of AIRCR.
    pub(crate) group: u32,
    /// Most urgent pending and enabled exception with its priority.
    best: Option<(Exception, i16)>,
}

/// Execution priority with nothing active.
const THREAD: i16 = 256;

impl Nvic {
    /// After reset: the system exceptions that cannot be disabled are on.
    pub(crate) fn new() -> Self {
        let enabled = 1 << exception::NMI
            | 1 << exception::HARD_FAULT
            | 1 << exception::SV_CALL
            | 1 << exception::PEND_SV
            | 1 << exception::SYS_TICK;
        Self {
            enabled,
            pending: 0,
            active: 0,
            stack: Vec::new(),
            lines: 0,
            priority: [0; EXCEPTIONS],
            group: 0,
            best: None,
        }
    }

    fn full_priority(&self, e: Exception) -> i16 {
        match e {
            exception::NMI => -2,
            exception::HARD_FAULT => -1,
            _ => self.priority[usize::from(e)].into(),
        }
    }

    /// Part of a priority that decides about preemption (B1.5.4, PRIGROUP).
    fn group_priority(&self, priority: i16) -> i16 {
        if priority < 0 { priority } else { priority & !((2 << self.group) - 1) }
    }

    /// Priority byte of `e` (4..16: SHPR, from 16: IPR).
    pub fn priority(&self, e: Exception) -> u8 {
        self.priority.get(usize::from(e)).copied().unwrap_or(0)
    }

    /// Sets the priority byte of `e`; the lower four bits are not implemented.
    pub fn set_priority(&mut self, e: Exception, priority: u8) {
        if let Some(p) = self.priority.get_mut(usize::from(e)) {
            *p = priority & 0xf0;
        }
        self.choose();
    }

    /// Level of interrupt line `n`. A rising line pends; a line that stays high pends again when its handler returns.
    pub fn set_line(&mut self, n: u8, level: bool) {
        let bit = 1u128 << (16 + n);
        if level && self.lines & bit == 0 {
            self.lines |= bit;
            self.pending |= bit;
            self.choose();
        } else if !level {
            self.lines &= !bit;
        }
    }

    /// Pends exception `e`.
    pub fn pend(&mut self, e: Exception) {
        self.pending |= 1 << e;
        self.choose();
    }

    /// Removes the pending state of the exceptions in `mask`; a line that is still high pends again (B3.4.1).
    pub fn unpend(&mut self, mask: u128) {
        self.pending = self.pending & !mask | self.lines & mask & !self.active;
        self.choose();
    }

    /// Enables or disables exceptions.
    pub fn enable(&mut self, mask: u128, on: bool) {
        self.enabled = if on { self.enabled | mask } else { self.enabled & !mask };
        self.choose();
    }

    /// Pending exceptions, a bit each.
    pub fn pending(&self) -> u128 {
        self.pending
    }

    /// Active exceptions, a bit each.
    pub fn active(&self) -> u128 {
        self.active
    }

    /// Active exceptions in the order they were entered; the last one is running.
    pub fn nesting(&self) -> &[Exception] {
        &self.stack
    }

    /// Whether `e` has a handler of its own.
    pub fn enables(&self, e: Exception) -> bool {
        self.enabled >> e & 1 == 1
    }

    fn choose(&mut self) {
        let mut left = self.pending & self.enabled;
        self.best = None;
        while left != 0 {
            let e = left.trailing_zeros() as u8;
            left &= left - 1;
            let p = self.full_priority(e);
            // Equal priorities: the lower number first (B1.5.4).
            if self.best.is_none_or(|(_, q)| p < q) {
                self.best = Some((e, p));
            }
        }
    }

    /// The exception that would run next if priorities allowed; what wakes a sleeping processor.
    pub fn candidate(&self) -> Option<Exception> {
        self.best.map(|b| b.0)
    }

    /// Priority at which the processor executes (B1.5.4).
    pub fn execution_priority(&self, masks: Masks) -> i16 {
        let mut priority = THREAD;
        let mut left = self.active;
        while left != 0 {
            let e = left.trailing_zeros() as u8;
            left &= left - 1;
            priority = priority.min(self.group_priority(self.full_priority(e)));
        }
        if masks.basepri & 0xf0 != 0 {
            priority = priority.min(self.group_priority(i16::from(masks.basepri & 0xf0)));
        }
        if masks.primask {
            priority = priority.min(0);
        }
        if masks.faultmask {
            priority = priority.min(-1);
        }
        priority
    }

    /// The exception that preempts now, if any. Taking it is [`Nvic::enter`].
    pub fn preempting(&self, masks: Masks) -> Option<Exception> {
        let (e, p) = self.best?;
        (self.group_priority(p) < self.execution_priority(masks)).then_some(e)
    }

    /// A sleeping processor wakes for whatever would preempt with PRIMASK clear (B1.5.19).
    pub fn wakes(&self, masks: Masks) -> bool {
        self.preempting(Masks { primask: false, ..masks }).is_some()
    }

    /// Exception entry: pending becomes active.
    pub fn enter(&mut self, e: Exception) {
        self.pending &= !(1 << e);
        self.active |= 1 << e;
        self.stack.push(e);
        self.choose();
    }

    /// Exception return: `e` is no longer active.
    pub fn exit(&mut self, e: Exception) {
        self.active &= !(1 << e);
        self.stack.retain(|a| *a != e);
        self.pending |= self.lines & 1 << e;
        self.choose();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FREE: Masks = Masks { primask: false, faultmask: false, basepri: 0 };

    fn with(priorities: &[(u8, u8)]) -> Nvic {
        let mut n = Nvic::new();
        for (irq, p) in priorities {
            n.enable(1 << (16 + irq), true);
            n.set_priority(16 + irq, *p);
        }
        n
    }

    #[test]
    fn the_most_urgent_runs_first_and_the_lower_number_among_equals() {
        let mut n = with(&[(5, 0x40), (6, 0x20), (7, 0x20)]);
        for e in [21, 23, 22] {
            n.pend(e);
        }
        for expected in [22, 23, 21] {
            assert_eq!(n.preempting(FREE), Some(expected));
            n.enter(expected);
            n.exit(expected);
        }
        assert_eq!(n.preempting(FREE), None);
    }

    #[test]
    fn only_a_strictly_more_urgent_exception_preempts() {
        let mut n = with(&[(5, 0x40), (6, 0x40), (7, 0x30)]);
        n.pend(21);
        n.enter(21);
        n.pend(22);
        assert_eq!(n.preempting(FREE), None);
        n.pend(23);
        assert_eq!(n.preempting(FREE), Some(23));
    }

    #[test]
    fn subpriority_orders_but_does_not_preempt() {
        let mut n = with(&[(5, 0x50), (6, 0x40)]);
        n.group = 4; // three group bits: 0x40 and 0x50 are one group
        n.pend(21);
        n.enter(21);
        n.pend(22);
        assert_eq!(n.preempting(FREE), None);
        n.exit(21);
        n.pend(21);
        assert_eq!(n.preempting(FREE), Some(22));
    }

    #[test]
    fn basepri_masks_its_own_priority_and_below_primask_masks_all_but_faults() {
        let mut n = with(&[(5, 0x40)]);
        n.pend(21);
        let base = |b| Masks { basepri: b, ..FREE };
        assert_eq!(n.preempting(base(0x40)), None);
        assert_eq!(n.preempting(base(0x50)), Some(21));
        assert_eq!(n.preempting(Masks { primask: true, ..FREE }), None);
        assert!(n.wakes(Masks { primask: true, ..FREE }));
        n.pend(exception::HARD_FAULT);
        assert_eq!(n.preempting(Masks { primask: true, ..FREE }), Some(3));
        assert_eq!(n.preempting(Masks { faultmask: true, ..FREE }), None);
    }

    #[test]
    fn four_priority_bits_are_implemented() {
        let mut n = with(&[(5, 0xff)]);
        assert_eq!(n.priority(21), 0xf0);
        n.set_priority(exception::SYS_TICK, 0x1f);
        assert_eq!(n.priority(15), 0x10);
    }

    #[test]
    fn a_line_held_high_pends_again_after_its_handler_and_a_released_one_does_not() {
        let mut n = with(&[(5, 0)]);
        n.set_line(5, true);
        n.enter(21);
        assert_eq!(n.candidate(), None);
        n.exit(21);
        assert_eq!(n.candidate(), Some(21));
        n.enter(21);
        n.set_line(5, false);
        n.exit(21);
        assert_eq!(n.candidate(), None);
    }

    #[test]
    fn a_pulse_on_a_line_is_remembered() {
        let mut n = with(&[(5, 0)]);
        n.set_line(5, true);
        n.set_line(5, false);
        assert_eq!(n.candidate(), Some(21));
        n.unpend(1 << 21);
        assert_eq!(n.candidate(), None);
    }

    #[test]
    fn a_disabled_interrupt_stays_pending_until_enabled() {
        let mut n = Nvic::new();
        n.set_line(3, true);
        assert_eq!(n.candidate(), None);
        n.enable(1 << 19, true);
        assert_eq!(n.candidate(), Some(19));
    }
}
