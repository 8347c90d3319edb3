edm_hal_shim::board! {
    pub struct Sound {
        name: "a board without a clash",
        crystal_hz: 8_000_000,
        can_bit_rate: 1_000_000,
        defaults: {},
        a: gpioa.pa0 PA0, "TIM5_CH1, EXTI0", "";
        b: gpiob.pb1 PB1, "GPIO, EXTI1", "";
    }
}

fn main() {
    Sound::new(edm_hal_shim::board::gpio::Ports::default());
}
