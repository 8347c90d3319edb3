//! Where a task may be preempted, on a PC.
//!
//! What a task does between two crossings nobody else can see, so preemption anywhere has the effect of preemption at the
//! nearest crossing. A *point* is one side of a step of a crossing; a scheduler that runs other tasks there as nested calls
//! therefore shows everything that interrupts can do.

#[cfg(feature = "preempt")]
pub use hooked::{Tally, point, tally, with};
#[cfg(feature = "preempt")]
pub(crate) use hooked::{lost, received, sent};

/// A place where a task of higher priority may come in. Nothing without the feature `preempt`.
#[cfg(not(feature = "preempt"))]
#[inline(always)]
pub fn point() {}

/// An event goes into a ring. Nothing without the feature `preempt`, like the two below.
#[cfg(not(feature = "preempt"))]
#[inline(always)]
pub(crate) fn sent() {}

/// An event did not fit.
#[cfg(not(feature = "preempt"))]
#[inline(always)]
pub(crate) fn lost() {}

/// An event was taken.
#[cfg(not(feature = "preempt"))]
#[inline(always)]
pub(crate) fn received() {}

#[cfg(feature = "preempt")]
mod hooked {
    use std::cell::{Cell, RefCell};
    use std::rc::Rc;
    use std::thread_local;

    type Hook = Rc<dyn Fn()>;

    thread_local! {
        static HOOK: RefCell<Option<Hook>> = const { RefCell::new(None) };
        // Whether there is one: all that a simulator without a schedule looks at.
        static HOOKED: Cell<bool> = const { Cell::new(false) };
        static TALLY: Cell<Tally> = const { Cell::new(Tally { sent: 0, received: 0, lost: 0 }) };
    }

    /// What has gone through all rings of a thread, by a count of its own: for tests of what the rings' owners count.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    pub struct Tally {
        /// Events that were to be sent.
        pub sent: u64,
        /// Events that were received.
        pub received: u64,
        /// Events that did not fit.
        pub lost: u64,
    }

    /// What has gone through the rings of this thread since it began.
    pub fn tally() -> Tally {
        TALLY.get()
    }

    pub(crate) fn sent() {
        let tally = TALLY.get();
        TALLY.set(Tally { sent: tally.sent + 1, ..tally });
    }

    pub(crate) fn received() {
        let tally = TALLY.get();
        TALLY.set(Tally { received: tally.received + 1, ..tally });
    }

    pub(crate) fn lost() {
        let tally = TALLY.get();
        TALLY.set(Tally { lost: tally.lost + 1, ..tally });
    }

    /// A place where a task of higher priority may come in: calls the hook of this thread, if there is one.
    ///
    /// Points in what the hook runs call it again. It decides what may interrupt what.
    #[inline]
    pub fn point() {
        if HOOKED.get() {
            call();
        }
    }

    fn call() {
        // Not borrowed while it runs: it may install another, or come here again. A thread that is ending has none.
        let hook = HOOK.try_with(|hook| hook.borrow().clone());
        if let Ok(Some(hook)) = hook {
            hook();
        }
    }

    /// Runs `tasks` with `hook` at every point of this thread. The hook before it is back afterwards, also after a panic.
    pub fn with<R>(hook: Hook, tasks: impl FnOnce() -> R) -> R {
        struct Restore(Option<Hook>);

        impl Drop for Restore {
            fn drop(&mut self) {
                drop(replace(self.0.take()));
            }
        }

        let _restore = Restore(replace(Some(hook)));
        tasks()
    }

    /// The hook before. It is dropped outside of the borrow: a hook may own what has points in its drop.
    fn replace(hook: Option<Hook>) -> Option<Hook> {
        HOOKED.set(hook.is_some());
        HOOK.replace(hook)
    }
}
