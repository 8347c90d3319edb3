//! What the processor waits for a register of a peripheral.
//!
//! | what | here | source |
//! | --- | --- | --- |
//! | GPIO, DMA, RCC, FLASH are on AHB1 | no wait | RM0090 section 2.3, table 1; 2.1.9, bus matrix |
//! | the others are on APB1 or APB2, whose clocks are 42 and 84 MHz | [`Buses::new`] | table 1; clock tree of the image |
//! | a transfer on an APB takes two of its clocks | [`APB_CLOCKS`] | AMBA APB (IHI 0024) 3.1: setup and access |
//! | a load waits for its transfer | [`Buses::read`] | DDI 0439 3.3.2 |
//! | a store does not, but what comes behind it and wants the bus does | [`Buses::write`], [`Buses::want`] | DDI 0439 3.3.3, write buffer |
//! | system registers are the processor's own | no wait | DDI 0439 2.3, private peripheral bus |
//! | a bit-band alias reads and writes the register | both | RM0090 2.3.3 |
//!
//! Assumed: a transfer begins with a clock of its bus, so that up to a clock less a cycle is waited for it; the bridge needs
//! nothing more; no DMA transfer stands in the way; every load and store behind a store to a register wants the same bus,
//! which is not so for those to the core-coupled memory.

/// Clocks of an APB that a transfer takes.
const APB_CLOCKS: u64 = 2;

/// The buses behind the bus matrix.
#[derive(Clone, Copy, Debug)]
pub struct Buses {
    /// Cycles of the processor in a clock of APB1 and APB2.
    cycles: [u64; 2],
    /// When the write buffer is empty.
    free: u64,
}

impl Buses {
    /// Buses whose clocks are so many cycles of the processor long.
    pub fn new(apb1: u64, apb2: u64) -> Self {
        Self { cycles: [apb1.max(1), apb2.max(1)], free: 0 }
    }

    /// Cycles from `now` to the end of a transfer to `address`, beyond those of one to memory.
    fn transfer(&self, address: u32, now: u64) -> u64 {
        let clock = match address {
            0x4000_0000..0x4001_0000 => self.cycles[0],
            0x4001_0000..0x4002_0000 => self.cycles[1],
            0x4200_0000..0x4220_0000 => return self.transfer(0x4000_0000, now),
            0x4220_0000..0x4240_0000 => return self.transfer(0x4001_0000, now),
            _ => return 0,
        };
        (clock - now % clock) % clock + APB_CLOCKS * clock
    }

    /// Cycles that a load from a register at `address` waits.
    pub fn read(&mut self, address: u32, now: u64) -> u64 {
        self.transfer(address, now)
    }

    /// A store to a register at `address` begins at `now`.
    pub fn write(&mut self, address: u32, now: u64) {
        let mut end = now + self.transfer(address, now);
        if (0x4200_0000..0x4400_0000).contains(&address) {
            end += self.transfer(address, end);
        }
        self.free = self.free.max(end);
    }

    /// Cycles that a load or store at `now` waits until the bus is free.
    pub fn want(&self, now: u64) -> u64 {
        self.free.saturating_sub(now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TIM2: u32 = 0x4000_0024;
    const EXTI: u32 = 0x4001_3c14;
    const GPIO: u32 = 0x4002_0010;
    const DWT: u32 = 0xe000_1004;

    #[test]
    fn a_load_waits_for_two_clocks_of_its_bus_and_for_the_first_of_them_to_begin() {
        let mut buses = Buses::new(4, 2);
        assert_eq!([100, 101, 102, 103].map(|now| buses.read(TIM2, now)), [8, 11, 10, 9]);
        assert_eq!([100, 101].map(|now| buses.read(EXTI, now)), [4, 5]);
        assert_eq!((buses.read(GPIO, 101), buses.read(DWT, 101)), (0, 0));
    }

    #[test]
    fn a_store_holds_up_what_comes_behind_it() {
        let mut buses = Buses::new(4, 2);
        buses.write(EXTI, 100);
        assert_eq!([100, 102, 104, 110].map(|now| buses.want(now)), [4, 2, 0, 0]);
        buses.write(GPIO, 200);
        assert_eq!(buses.want(201), 0);
    }

    #[test]
    fn a_bit_band_store_is_two_transfers() {
        let mut buses = Buses::new(4, 2);
        // Bit 0 of a register of APB2.
        buses.write(0x4200_0000 + 32 * 0x0001_3c14, 100);
        assert_eq!(buses.want(100), 8);
    }
}
