//! Settings that a task runs, kept twice: a bit that flips in memory is found.
//!
//! Memory of these chips has neither parity nor correction. Whoever runs settings has a second copy, [`Kept`], and compares one
//! *part* of the two with it now and then, so that no run takes much longer for it; all parts have had their turn after as many
//! looks as there are parts. Which of the two copies is right nobody can say: the head coasts ([`Fault::SettingsDamaged`])
//! until another start, which builds everything anew from what is stored.
//!
//! [`Fault::SettingsDamaged`]: crate::head::Fault::SettingsDamaged

use crate::units::rare;

/// What can be compared part by part.
pub trait Parts {
    /// How many.
    const PARTS: u32;
    /// Whether this part is the same in the other; true where there is no such part.
    fn same(&self, other: &Self, part: u32) -> bool;
}

/// Values in groups, each a part; every field is named first, so that one that is forgotten does not compile.
macro_rules! parts {
    ($it:ident: $type:ident { $($field:ident),+ $(,)? } by $([$($value:expr),+]),+ $(,)?) => {
        impl $crate::kept::Parts for $type {
            const PARTS: u32 = [$([$(stringify!($value)),+].len()),+].len() as u32;

            #[inline]
            fn same(&self, other: &Self, part: u32) -> bool {
                let $type { $($field: _),+ } = self;
                let mut turn = 0..;
                $(if turn.next() == Some(part) {
                    return true $(&& {
                        let kept = { let $it = other; &$value };
                        let $it = self;
                        $value == *kept
                    })+;
                })+
                true
            }
        }
    };
}
pub(crate) use parts;

/// The second copy, taken at the first look: start-up needs no room on the stack for it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Kept<T> {
    copy: Option<T>,
    /// Part to compare next.
    part: u32,
}

impl<T> Kept<T> {
    /// Of settings that are to come.
    pub const NEW: Kept<T> = Kept { copy: None, part: 0 };
}

impl<T: Parts + Copy> Kept<T> {
    /// Compares the next part with what is run: false once it has changed by itself. The first look compares nothing.
    #[inline]
    pub fn agrees(&mut self, run: &T) -> bool {
        let Some(copy) = &self.copy else {
            rare();
            self.copy = Some(*run);
            return true;
        };
        let part = self.part;
        self.part = if part < T::PARTS { part.wrapping_add(1) } else { 0 };
        copy.same(run, part)
    }
}
