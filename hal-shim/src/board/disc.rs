//! The STM32F407G-DISC1 evaluation board.
//!
//! Its own parts share pins with the head (UM1472, tables of pins and solder bridges). Open SB20, or the user button's
//! pull-down loads encoder A. The audio codec is in reset while PD4 is low, which it is unless driven: its inputs on PA4,
//! PC7 and PC12 then load nothing. PC0 and PC3, which are gap voltage and motor current on the 64-pin board, belong to the
//! USB supply and the microphone here; hence other analogue pins. The board has no pulls for the head: they go on the
//! wiring. It runs on 3.0 V, of which a converter code is 1/4096: volts and amperes per code are 10/11 of those of
//! a board with 3.3 V (docs/wiring.md).

crate::board! {
    /// STM32F407G-DISC1 with its 8 MHz crystal.
    pub struct Disc {
        name: "STM32F407G-DISC1",
        crystal_hz: 8_000_000,
        can_bit_rate: 1_000_000,
        defaults: {
            "gap.volts_per_code" = 0.0911,
            "gap.amps_per_code" = 0.0146,
            "motor.amps_per_code" = 0.00244,
            "motor.bus_volts_per_code" = 0.0139,
        },
        encoder_a: gpioa.pa0 PA0, "TIM5_CH1, EXTI0", "encoder A from the line receiver; SB20 open";
        encoder_b: gpioa.pa1 PA1, "TIM5_CH2, EXTI1", "encoder B from the line receiver";
        encoder_index: gpioa.pa2 PA2, "GPIO, EXTI2", "encoder index from the line receiver";
        gap_voltage: gpioc.pc5 PC5, "ADC1_IN15", "gap voltage, divided, fixed rate";
        gap_voltage_gated: gpiob.pb1 PB1, "ADC2_IN9", "the same node as gap_voltage, sampled in the pulse";
        gap_current: gpioc.pc4 PC4, "ADC2_IN14", "gap current from the shunt amplifier";
        motor_current: gpioc.pc1 PC1, "ADC3_IN11", "motor current amplifier, mid-scale is zero";
        bus_voltage: gpioa.pa3 PA3, "ADC3_IN3", "drive supply through a divider";
        gate: gpioc.pc6 PC6, "TIM8_CH1, EXTI6", "generator gate, high in the on-time";
        gate_start: gpiob.pb7 PB7, "TIM4_CH2", "the same line as gate: starts the blanking";
        comparator_high: gpioc.pc8 PC8, "TIM8_CH3", "gap above about 70 % of open circuit";
        comparator_low: gpioc.pc9 PC9, "TIM8_CH4", "gap above about 20 % of open circuit";
        allow_pulses: gpioc.pc7 PC7, "GPIO out", "to the generator, high allows; 10 k to ground";
        live: gpiob.pb5 PB5, "GPIO out", "edges while the program runs, to the monostable; 10 k to ground";
        arm: gpiod.pd2 PD2, "GPIO out", "its rising edge arms the latch; 10 k to ground";
        armed: gpiob.pb4 PB4, "GPIO", "the latch, high lets pulses and bridge go on; 10 k to ground";
        off_time: gpioa.pa4 PA4, "DAC_OUT1", "off-time request to the generator, 0 V is its own";
        pwm: gpioa.pa8 PA8, "TIM1_CH1", "bridge enable; 10 k to ground";
        forward: gpiob.pb13 PB13, "GPIO out", "bridge direction toward the work; 10 k to ground";
        reverse: gpiob.pb0 PB0, "GPIO out", "bridge direction away from the work; 10 k to ground";
        bridge_fault: gpiob.pb12 PB12, "TIM1_BKIN", "bridge fault, low is a fault; 10 k to ground";
        upper_limit: gpioc.pc11 PC11, "GPIO, EXTI11", "normally closed to ground; 4.7 k to 3.3 V";
        lower_limit: gpioc.pc12 PC12, "GPIO, EXTI12", "normally closed to ground; 4.7 k to 3.3 V";
        emergency_stop: gpioc.pc13 PC13, "GPIO, EXTI13", "normally closed to ground; 4.7 k to 3.3 V";
        dielectric: gpiob.pb15 PB15, "GPIO, EXTI15", "closed to ground while OK; 4.7 k to 3.3 V";
        can_rx: gpiod.pd0 PD0, "CAN1_RX", "from the transceiver";
        can_tx: gpiod.pd1 PD1, "CAN1_TX", "to the transceiver";
        led: gpiod.pd13 PD13, "GPIO out", "LD3, orange, high is lit";
        step: gpioa.pa15 PA15, "TIM2_CH1", "steps of a host; isolated input, low while a current flows";
        step_direction: gpiob.pb11 PB11, "TIM2_CH4", "direction of a host; isolated input";
        spark_frequency: gpioa.pa6 PA6, "TIM13_CH1", "reserved: frequency-coded gap voltage";
        flush_valve: gpiob.pb14 PB14, "GPIO out", "reserved: flushing valve; 10 k to ground";
        step_ready: gpioc.pc10 PC10, "GPIO out", "high lets a host step; 10 k to ground";
        carry: gpiob.pb2 PB2, "GPIO out", "asks for a move of the coarse axis, high; 10 k to ground";
    }
}
