//! Clocks and resets of the peripherals in use (RM0090 7.3).

use super::{change, pac};

/// A peripheral: its bus and its bit in that bus's registers.
#[derive(Clone, Copy)]
pub enum Peripheral {
    /// On AHB1.
    Ahb1(u32),
    /// On APB1.
    Apb1(u32),
    /// On APB2.
    Apb2(u32),
}

use Peripheral::{Ahb1, Apb1, Apb2};

/// DMA2.
pub const DMA2: Peripheral = Ahb1(22);
/// TIM3.
pub const TIM3: Peripheral = Apb1(1);
/// TIM4.
pub const TIM4: Peripheral = Apb1(2);
/// TIM5.
pub const TIM5: Peripheral = Apb1(3);
/// TIM7.
pub const TIM7: Peripheral = Apb1(5);
/// CAN1.
pub const CAN1: Peripheral = Apb1(25);
/// DAC.
pub const DAC: Peripheral = Apb1(29);
/// TIM1.
pub const TIM1: Peripheral = Apb2(0);
/// TIM8.
pub const TIM8: Peripheral = Apb2(1);
/// The three converters: one reset, and the clock of ADC1.
pub const ADC: Peripheral = Apb2(8);
/// ADC2, clock only.
pub const ADC2: Peripheral = Apb2(9);
/// ADC3, clock only.
pub const ADC3: Peripheral = Apb2(10);
/// System configuration: selects the pins of interrupt lines.
pub const SYSCFG: Peripheral = Apb2(14);

impl Peripheral {
    /// Clocks it.
    pub fn clock(self, rcc: &pac::RCC) {
        match self {
            Ahb1(bit) => change!(rcc.ahb1enr(), clear 0, set 1 << bit),
            Apb1(bit) => change!(rcc.apb1enr(), clear 0, set 1 << bit),
            Apb2(bit) => change!(rcc.apb2enr(), clear 0, set 1 << bit),
        }
        // The clock is there two cycles of the bus after it was switched on (RM0090 7.2).
        cortex_m::asm::dsb();
        cortex_m::asm::delay(16);
    }

    /// Clocks it and puts its registers back to their reset values.
    pub fn reset(self, rcc: &pac::RCC) {
        self.clock(rcc);
        match self {
            Ahb1(bit) => {
                change!(rcc.ahb1rstr(), clear 0, set 1 << bit);
                change!(rcc.ahb1rstr(), clear 1 << bit, set 0);
            }
            Apb1(bit) => {
                change!(rcc.apb1rstr(), clear 0, set 1 << bit);
                change!(rcc.apb1rstr(), clear 1 << bit, set 0);
            }
            Apb2(bit) => {
                change!(rcc.apb2rstr(), clear 0, set 1 << bit);
                change!(rcc.apb2rstr(), clear 1 << bit, set 0);
            }
        }
    }
}
