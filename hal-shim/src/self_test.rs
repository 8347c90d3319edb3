//! What a board finds of itself at its start, before anything of it could drive. A head on a board that has found something is
//! not enabled (`Fault::SelfTestFailed` of the core).

/// The part of it that continues while the head runs.
pub trait Registers {
    /// Looks at one of the registers that are written once: false when all of them have been looked at and one is not what it
    /// was in the first round.
    fn is_intact(&mut self) -> bool;
}

/// What has failed, a bit each: object 2009h:3.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SelfTest(u8);

impl SelfTest {
    /// Nothing has failed.
    pub const PASSED: SelfTest = SelfTest(0);
    /// The image was never sealed ([`crate::seal`]): it was flashed as the linker left it.
    pub const UNSEALED: SelfTest = SelfTest(1);
    /// The flash does not hold what was sealed.
    pub const DAMAGED: SelfTest = SelfTest(1 << 1);

    /// Pins could not be locked as what they are.
    pub const UNLOCKED: SelfTest = SelfTest(1 << 2);

    /// The brown-out reset is not at level 3: the chip would run on below the voltage that its flash needs at this clock.
    pub const BROWN_OUT: SelfTest = SelfTest(1 << 3);

    /// Whether anything has failed.
    pub const fn failed(self) -> bool {
        self.0 != 0
    }

    /// The bits.
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// What has failed in either.
    pub const fn and(self, other: SelfTest) -> SelfTest {
        SelfTest(self.0 | other.0)
    }
}
