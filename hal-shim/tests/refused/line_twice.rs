edm_hal_shim::board! {
    pub struct Clash {
        name: "a board that uses an interrupt line twice",
        crystal_hz: 8_000_000,
        can_bit_rate: 1_000_000,
        defaults: {},
        a: gpioa.pa1 PA1, "GPIO, EXTI1", "";
        b: gpiob.pb1 PB1, "GPIO, EXTI1", "";
    }
}

fn main() {}
