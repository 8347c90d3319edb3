//! General-purpose I/O port (RM0090 §8).

use crate::error::Fault;
use crate::world::Drive;

/// What a pin is configured as (§8.4.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    Input,
    Output,
    Alternate(u8),
    Analog,
}

#[derive(Clone)]
pub struct Gpio {
    moder: u32,
    otyper: u32,
    ospeedr: u32,
    pupdr: u32,
    odr: u32,
    afr: [u32; 2],
    /// Pins whose configuration is locked, or will be by the next steps of the sequence; how many of those have been; whether
    /// it is done.
    lock: u16,
    steps: u8,
    locked: bool,
    /// Pins driven from outside, and their levels.
    driven: u16,
    outside: u16,
}

impl Gpio {
    /// Port `index` (0 = A) after reset: A and B have the debug pins set up (§8.4.1..4).
    pub fn new(index: usize) -> Self {
        let (moder, ospeedr, pupdr) = match index {
            0 => (0xa800_0000, 0x0c00_0000, 0x6400_0000),
            1 => (0x0000_0280, 0x0000_00c0, 0x0000_0100),
            _ => (0, 0, 0),
        };
        Self {
            moder,
            otyper: 0,
            ospeedr,
            pupdr,
            odr: 0,
            afr: [0; 2],
            lock: 0,
            steps: 0,
            locked: false,
            driven: 0,
            outside: 0,
        }
    }

    /// Registers back to their reset state; what the outside drives stays.
    pub fn reset(&mut self, index: usize) {
        *self = Self { driven: self.driven, outside: self.outside, ..Self::new(index) };
    }

    pub fn mode(&self, n: u8) -> Mode {
        match self.moder >> (2 * n) & 3 {
            0 => Mode::Input,
            1 => Mode::Output,
            2 => Mode::Alternate((self.afr[usize::from(n / 8)] >> (4 * (n % 8)) & 15) as u8),
            _ => Mode::Analog,
        }
    }

    /// What an output pin drives with; `None` when it is not a general-purpose output.
    pub fn output(&self, n: u8) -> Option<Drive> {
        (self.mode(n) == Mode::Output).then(|| {
            let high = self.odr >> n & 1 == 1;
            if high && self.otyper >> n & 1 == 1 { Drive::Released } else { Drive::Level(high) }
        })
    }

    /// Level at the pin: what drives it, else its pull, else low. An analogue pin reads low (§8.3.12).
    pub fn level(&self, n: u8) -> bool {
        if let Some(Drive::Level(level)) = self.output(n) {
            return level;
        }
        if self.mode(n) == Mode::Analog {
            return false;
        }
        if self.driven >> n & 1 == 1 { self.outside >> n & 1 == 1 } else { self.pupdr >> (2 * n) & 3 == 1 }
    }

    /// All sixteen levels, as IDR reads.
    pub fn levels(&self) -> u16 {
        (0..16).fold(0, |v, n| v | u16::from(self.level(n)) << n)
    }

    /// The outside drives pin `n`, or lets go of it.
    pub fn set_outside(&mut self, n: u8, level: Option<bool>) {
        let bit = 1 << n;
        self.driven = if level.is_some() { self.driven | bit } else { self.driven & !bit };
        self.outside = if level == Some(true) { self.outside | bit } else { self.outside & !bit };
    }

    pub fn read(&self, offset: u32) -> Result<u32, Fault> {
        Ok(match offset {
            0x00 => self.moder,
            0x04 => self.otyper,
            0x08 => self.ospeedr,
            0x0c => self.pupdr,
            0x10 => self.levels().into(),
            0x14 => self.odr,
            0x18 => 0, // BSRR reads as zero (§8.4.7)
            0x1c => u32::from(self.lock) | u32::from(self.locked) << 16,
            0x20 => self.afr[0],
            0x24 => self.afr[1],
            _ => return Err(Fault::Unmodelled),
        })
    }

    /// Returns the pins that may be something else now.
    pub fn write(&mut self, offset: u32, value: u32) -> Result<u16, Fault> {
        let before = self.odr;
        match offset {
            0x00 => self.moder = self.unlocked(self.moder, value, 2, 0),
            0x04 => self.otyper = self.unlocked(self.otyper, value, 1, 0) & 0xffff,
            0x08 => self.ospeedr = self.unlocked(self.ospeedr, value, 2, 0),
            0x0c => self.pupdr = self.unlocked(self.pupdr, value, 2, 0),
            0x14 => self.odr = value & 0xffff,
            // Set wins over reset (§8.4.7).
            0x18 => self.odr = self.odr & !(value >> 16) | value & 0xffff,
            0x1c => self.write_lock(value),
            0x20 => self.afr[0] = self.unlocked(self.afr[0], value, 4, 0),
            0x24 => self.afr[1] = self.unlocked(self.afr[1], value, 4, 8),
            _ => return Err(Fault::Unmodelled),
        }
        Ok(if let 0x14 | 0x18 = offset { (before ^ self.odr) as u16 } else { u16::MAX })
    }

    /// The lock key: 1, 0, 1 with the same pins each time, and then a read, for which the model does not wait (§8.4.8). Once it
    /// is done nothing changes it but a reset.
    fn write_lock(&mut self, value: u32) {
        if self.locked {
            return;
        }
        let (key, pins) = (value >> 16 & 1, value as u16);
        let goes_on = match self.steps {
            1 => key == 0 && pins == self.lock,
            2 => key == 1 && pins == self.lock,
            _ => false,
        };
        self.lock = pins;
        self.steps = if goes_on { self.steps + 1 } else { key as u8 };
        self.locked = self.steps == 3;
    }

    /// A register of `width` bits a pin, the first of which is pin `first`, after a write: what is locked stays.
    fn unlocked(&self, old: u32, new: u32, width: u32, first: u32) -> u32 {
        let pins = (first..16).take(32 / width as usize);
        let locked = pins.filter(|n| self.locked && self.lock >> n & 1 == 1);
        let kept = locked.fold(0, |mask, n| mask | ((1 << width) - 1) << (width * (n - first)));
        old & kept | new & !kept
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn debug_pins_come_up_as_alternate_functions_with_their_pulls() {
        let a = Gpio::new(0);
        assert_eq!(
            (a.mode(13), a.mode(14), a.mode(15), a.mode(0)),
            (Mode::Alternate(0), Mode::Alternate(0), Mode::Alternate(0), Mode::Input)
        );
        assert_eq!((a.level(13), a.level(14), a.level(15)), (true, false, true));
    }

    #[test]
    fn what_a_pin_is_can_be_locked_but_not_its_level() {
        let mut g = Gpio::new(2);
        g.write(0x00, 1 << 10 | 2 << 18).unwrap();
        g.write(0x24, 3 << 4).unwrap();
        let pins = 1 << 5 | 1 << 9;
        for value in [pins | 1 << 16, pins, pins | 1 << 16] {
            assert_eq!(g.read(0x1c).unwrap() >> 16, 0);
            g.write(0x1c, value).unwrap();
        }
        assert_eq!(g.read(0x1c), Ok(pins | 1 << 16));
        for offset in [0x00, 0x04, 0x08, 0x0c, 0x1c, 0x20, 0x24] {
            g.write(offset, 0xffff_ffff).unwrap();
        }
        assert_eq!((g.mode(5), g.mode(9), g.mode(6)), (Mode::Output, Mode::Alternate(3), Mode::Analog));
        assert_eq!((g.read(0x04), g.read(0x20)), (Ok(0xffff & !pins), Ok(0xff0f_ffff)));
        g.write(0x18, 1 << 5).unwrap();
        assert_eq!(g.output(5), Some(Drive::Level(true)));
        g.reset(2);
        assert_eq!((g.mode(5), g.read(0x1c)), (Mode::Input, Ok(0)));
    }

    #[test]
    fn the_lock_takes_its_whole_sequence_and_nothing_else() {
        const ON: u32 = 1 << 16 | 1;
        const OFF: u32 = 1;
        for wrong in
            [&[ON, OFF][..], &[ON, ON, ON], &[OFF, ON, OFF], &[ON, 0, ON], &[ON, OFF, 1 << 16 | 2], &[ON, OFF, OFF, ON]]
        {
            let mut g = Gpio::new(2);
            for value in wrong {
                g.write(0x1c, *value).unwrap();
            }
            assert_eq!(g.read(0x1c).unwrap() >> 16, 0, "{wrong:x?}");
        }
    }

    #[test]
    fn set_wins_over_reset_in_bsrr() {
        let mut g = Gpio::new(2);
        g.write(0x18, 1 << 5 | 1 << 21).unwrap();
        assert_eq!(g.read(0x14), Ok(1 << 5));
        g.write(0x18, 1 << 21).unwrap();
        assert_eq!(g.read(0x14), Ok(0));
    }

    #[test]
    fn an_output_register_says_which_pins_it_has_changed_and_the_others_may_change_all() {
        let mut g = Gpio::new(2);
        let writes = [(0x18, 0b101), (0x18, 1 << 16 | 0b110), (0x14, 0b111), (0x00, 0)];
        assert_eq!(writes.map(|(offset, value)| g.write(offset, value).unwrap()), [0b101, 0b011, 0b001, u16::MAX]);
    }

    #[test]
    fn an_open_drain_pulls_low_and_lets_go() {
        let mut g = Gpio::new(2);
        g.write(0x04, 1 << 3).unwrap();
        g.write(0x00, 1 << 6).unwrap();
        assert_eq!(g.output(3), Some(Drive::Level(false)));
        g.write(0x14, 1 << 3).unwrap();
        assert_eq!(g.output(3), Some(Drive::Released));
        g.set_outside(3, Some(true));
        assert!(g.level(3));
    }

    #[test]
    fn a_pin_let_go_follows_its_pull() {
        let mut g = Gpio::new(2);
        g.write(0x0c, 1 << 4 | 2 << 6).unwrap();
        assert_eq!(g.levels(), 1 << 2);
        g.set_outside(2, Some(false));
        g.set_outside(3, Some(true));
        assert_eq!(g.levels(), 1 << 3);
        g.set_outside(2, None);
        g.set_outside(3, None);
        assert_eq!(g.levels(), 1 << 2);
    }
}
