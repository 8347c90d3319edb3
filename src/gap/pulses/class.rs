//! What a pulse was, by what was seen of it.

/// What a pulse was. See the [module](super).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Class {
    /// Not ignited when its gate closed.
    Open,
    /// A discharge.
    Spark,
    /// A discharge that stays where the one before was.
    Arc,
    /// Current without voltage.
    Short,
    /// A millisecond without one.
    #[default]
    NoPulse,
    /// There was one, and nothing shows what.
    Uncertain,
}

/// How many classes there are.
pub const CLASSES: usize = 6;

/// What tells pulses apart. Voltages are codes above that of no voltage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Levels {
    /// Code of no voltage.
    pub zero: u16,
    /// The gap leads are swapped: a voltage makes the code smaller.
    pub reversed: bool,
    /// What burns is short below this,
    pub short: i32,
    /// an arc below this, and a spark from here on.
    pub arc: i32,
}

impl Levels {
    /// Voltage of a code.
    #[inline(always)]
    pub fn voltage(&self, code: u16) -> i32 {
        let above = i32::from(code) - i32::from(self.zero);
        if self.reversed { -above } else { above }
    }

    /// What burns at the mean of so many voltages.
    #[inline(always)]
    pub fn burning(&self, sum: i32, count: i32) -> Class {
        if sum < count.wrapping_mul(self.short) {
            Class::Short
        } else if sum < count.wrapping_mul(self.arc) {
            Class::Arc
        } else {
            Class::Spark
        }
    }
}
