//! Where a task may be preempted, on a PC.
//!
//! What a task does between two crossings nobody else can see, so preemption anywhere has the effect of preemption at the
//! nearest crossing. A *point* is one side of a step of a crossing; a scheduler that runs other tasks there as nested calls
//! therefore shows everything that interrupts can do.

#[cfg(feature = "preempt")]
pub use hooked::{point, with};

/// A place where a task of higher priority may come in. Nothing without the feature `preempt`.
#[cfg(not(feature = "preempt"))]
#[inline(always)]
pub fn point() {}

#[cfg(feature = "preempt")]
mod hooked {
    use std::cell::RefCell;
    use std::rc::Rc;
    use std::thread_local;

    type Hook = Rc<dyn Fn()>;

    thread_local! {
        static HOOK: RefCell<Option<Hook>> = const { RefCell::new(None) };
    }

    /// A place where a task of higher priority may come in: calls the hook of this thread, if there is one.
    ///
    /// Points in what the hook runs call it again. It decides what may interrupt what.
    #[inline]
    pub fn point() {
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
                // Dropped outside of the borrow: a hook may own what has points in its drop.
                let ours = HOOK.replace(self.0.take());
                drop(ours);
            }
        }

        let _restore = Restore(HOOK.replace(Some(hook)));
        tasks()
    }
}
