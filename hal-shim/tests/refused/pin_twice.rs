edm_hal_shim::board! {
    pub struct Clash {
        name: "a board that uses a pin twice",
        crystal_hz: 8_000_000,
        can_bit_rate: 1_000_000,
        defaults: {},
        a: gpioa.pa0 PA0, "TIM5_CH1", "";
        b: gpioa.pa0 PA0, "GPIO", "";
    }
}

fn main() {}
