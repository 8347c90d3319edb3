//! What of the chip is used for what: the same on every board with an STM32F405 or 407.
//!
//! Rates follow from one clock tree: crystal -> 168 MHz core, 84 MHz APB2, 42 MHz APB1; a timer runs at twice its bus clock
//! (RM0090 7.2). Crystal and PLL are in the table of each board. Servo tick, gap conversions and edge stamps are divided from
//! the same clock and started by one event, so their phases never drift: 25 conversions are one tick, and the edge timer wraps
//! every seven ticks.

use crate::gap::BLOCK;
use crate::must;
use crate::timing::{Timebase, adc, can, timer};
use core::fmt;

/// Servo tick, Hz.
pub const TICK_HZ: u32 = 20_000;
/// Fixed-rate conversions of the gap voltage, Hz.
pub const ADC_HZ: u32 = TICK_HZ * BLOCK as u32;
/// Core clock, Hz.
pub const CORE_HZ: u32 = 168_000_000;
/// Bus of TIM2..7, TIM12..14, CAN and DAC, Hz.
pub const APB1_HZ: u32 = CORE_HZ / 4;
/// Bus of TIM1, TIM8..11 and the converters, Hz.
pub const APB2_HZ: u32 = CORE_HZ / 2;
/// Clock of the timers on APB1, Hz.
pub const TIMER1_HZ: u32 = timer::timer_clock(CORE_HZ, APB1_HZ);
/// Clock of the timers on APB2, Hz.
pub const TIMER2_HZ: u32 = timer::timer_clock(CORE_HZ, APB2_HZ);

/// Division of the main PLL (RM0090 7.3.2): core = crystal / m * n / 2.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pll {
    /// Divides the crystal to 2 MHz, which gives the least jitter.
    pub m: u8,
    /// Multiplies to the oscillator's 336 MHz.
    pub n: u16,
    /// Divides the oscillator to 48 MHz for peripherals that need it.
    pub q: u8,
}

/// PLL for a crystal of 4 to 26 MHz; `None` when it is not a whole multiple of 2 MHz. What a board's table has.
pub const fn pll(crystal_hz: u32) -> Option<Pll> {
    if crystal_hz < 4_000_000 || crystal_hz > 26_000_000 || !crystal_hz.is_multiple_of(2_000_000) {
        return None;
    }
    Some(Pll { m: (crystal_hz / 2_000_000) as u8, n: (2 * CORE_HZ / 2_000_000) as u16, q: 7 })
}

/// Wait states of the flash at 2.7 to 3.6 V: one for each 30 MHz begun after the first (RM0090 table 10).
pub const FLASH_WAITS: u32 = CORE_HZ.div_ceil(30_000_000) - 1;

/// Code of a bus's prescaler in RCC_CFGR (RM0090 7.3.3); `None` when the bus is no such division of the core clock.
pub const fn bus_prescaler(bus_hz: u32) -> Option<u32> {
    if bus_hz == 0 || !CORE_HZ.is_multiple_of(bus_hz) {
        return None;
    }
    match CORE_HZ / bus_hz {
        1 => Some(0b000),
        2 => Some(0b100),
        4 => Some(0b101),
        8 => Some(0b110),
        16 => Some(0b111),
        _ => None,
    }
}

/// Prescalers of both buses, in their places in RCC_CFGR.
pub const BUS_PRESCALERS: u32 = match (bus_prescaler(APB1_HZ), bus_prescaler(APB2_HZ)) {
    (Some(apb1), Some(apb2)) => apb1 << 10 | apb2 << 13,
    _ => panic!("a bus is the core clock divided by 1, 2, 4, 8 or 16"),
};
// Fastest clocks of core and buses (data sheet, operating conditions).
const _: () = assert!(CORE_HZ <= 168_000_000 && APB1_HZ <= 42_000_000 && APB2_HZ <= 84_000_000);

/// CAN_BTR of each of [`BIT_RATES`](can::BIT_RATES).
const BTRS: [u32; can::BIT_RATES.len()] = {
    let mut btrs = [0; can::BIT_RATES.len()];
    let mut i = 0;
    while i < btrs.len() {
        btrs[i] = match can::bit_timing(APB1_HZ, can::BIT_RATES[i]) {
            Ok(timing) => timing.btr(),
            Err(_) => panic!("a bit rate that the clock does not give"),
        };
        i += 1;
    }
    btrs
};

/// CAN_BTR for one of [`BIT_RATES`](can::BIT_RATES) on this chip.
pub const fn can_btr(bit_rate: u32) -> Option<u32> {
    let mut i = 0;
    while i < BTRS.len() {
        if can::BIT_RATES[i] == bit_rate {
            return Some(BTRS[i]);
        }
        i += 1;
    }
    None
}

/// Servo tick and PWM, TIM1: one period is one tick, so that a duty takes effect exactly one tick after it was decided.
/// 8000 steps at least keep the duty finer than the 12 bits of the measurement.
pub const SERVO: timer::Divider = must!(timer::pwm(TIMER2_HZ, TICK_HZ, 8000));
/// Trigger of the gap conversions, TIM3.
pub const SAMPLE: timer::Divider = must!(timer::divide(TIMER1_HZ, ADC_HZ, timer::MAX_RELOAD_16));
/// Supervision, TIM7.
pub const SUPERVISE: timer::Divider = must!(timer::divide(TIMER1_HZ, 1000, timer::MAX_RELOAD_16));
/// Clock of the converters.
pub const ADC: adc::AdcClock = must!(adc::clock(APB2_HZ));
/// Source resistance that the front end promises to every converter input, ohm.
const SOURCE_OHM: u32 = 1000;
/// Sampling of the fixed-rate gap voltage.
pub const GAP_SAMPLING: adc::Sampling = must!(ADC.sampling(SOURCE_OHM, 1, ADC_HZ));
/// Sampling of gap current and voltage after each blanking, up to 100 000 pulses a second.
pub const GATED_SAMPLING: adc::Sampling = must!(ADC.sampling(SOURCE_OHM, 2, 100_000));
/// Clock of the blanking timer, TIM4.
pub const BLANKING_CLOCK: Timebase = must!(Timebase::new(TIMER1_HZ));
/// Longest count of the blanking timer before its one pulse ends.
pub const BLANKING_MOST: u32 = timer::MAX_RELOAD_16 - 1;
/// Steps of the off-time output.
pub const DAC_STEPS: u32 = 4096;

/// Counts of the edge timer, TIM8, before it wraps: as many whole ticks as 16 bits hold, 350 us.
pub const EDGE_MODULUS: u32 = 0x1_0000 / SERVO.steps() as u32 * SERVO.steps() as u32;

// The edge timer stamps in the units of the servo timer.
const _: () = assert!(SERVO.prescaler == 0 && SAMPLE.prescaler == 0 && TIMER2_HZ == CORE_HZ);
const _: () = assert!(SERVO.steps() == BLOCK as u64 * SAMPLE.steps() * (TIMER2_HZ / TIMER1_HZ) as u64);

/// A timer and its work.
#[derive(Clone, Copy, Debug)]
pub struct Timer {
    /// Name in the reference manual.
    pub name: &'static str,
    /// What it does.
    pub does: &'static str,
}

/// Timers in use.
pub const TIMERS: &[Timer] = &[
    Timer { name: "TIM1", does: "PWM of the bridge and servo tick; its start starts TIM3 and TIM8" },
    Timer {
        name: "TIM2",
        does: "counts both edges of a host's steps, 32 bits; channel 3 stamps edges of their direction",
    },
    Timer { name: "TIM3", does: "its update triggers ADC1" },
    Timer { name: "TIM4", does: "blanking: one pulse from the gate on channel 2; channel 4 triggers ADC2" },
    Timer { name: "TIM5", does: "encoder mode, 32 bits" },
    Timer { name: "TIM6", does: "pause after a pulse, once" },
    Timer { name: "TIM7", does: "supervision" },
    Timer { name: "TIM8", does: "stamps edges of gate (channel 1) and comparators (3, 4)" },
    Timer { name: "TIM13", does: "reserved: frequency-coded gap voltage" },
];

/// A DMA stream, the request that feeds it and its work.
#[derive(Clone, Copy, Debug)]
pub struct Stream {
    /// Its controller, 1 or 2.
    pub dma: u8,
    /// Its number.
    pub stream: u8,
    /// Channel, which selects the request (RM0090 tables 42 and 43).
    pub channel: u8,
    /// The request.
    pub request: &'static str,
}

/// Streams in use.
pub const STREAMS: &[Stream] = &[
    Stream { dma: 1, stream: 1, channel: 3, request: "TIM2_CH3" },
    Stream { dma: 2, stream: 0, channel: 0, request: "ADC1" },
    Stream { dma: 2, stream: 2, channel: 7, request: "TIM8_CH1" },
    Stream { dma: 2, stream: 3, channel: 1, request: "ADC2" },
    Stream { dma: 2, stream: 4, channel: 7, request: "TIM8_CH3" },
    Stream { dma: 2, stream: 7, channel: 7, request: "TIM8_CH4" },
];

/// RM0090 tables 42 and 43, as far as the head could use them: request, stream, channel.
#[cfg(test)]
const REQUESTS: &[(&str, u8, u8)] = &[
    ("TIM2_CH1", 5, 3),
    ("TIM2_CH2", 6, 3),
    ("TIM2_CH3", 1, 3),
    ("TIM2_CH4", 6, 3),
    ("TIM2_CH4", 7, 3),
    ("ADC1", 0, 0),
    ("ADC1", 4, 0),
    ("ADC2", 2, 1),
    ("ADC2", 3, 1),
    ("ADC3", 0, 2),
    ("ADC3", 1, 2),
    ("TIM8_CH1", 2, 7),
    ("TIM8_CH2", 3, 7),
    ("TIM8_CH3", 4, 7),
    ("TIM8_CH4", 7, 7),
];

const _: () = {
    let mut i = 0;
    while i < STREAMS.len() {
        let mut j = i + 1;
        while j < STREAMS.len() {
            let same = STREAMS[i].dma == STREAMS[j].dma && STREAMS[i].stream == STREAMS[j].stream;
            assert!(!same, "a DMA stream is used twice");
            j += 1;
        }
        i += 1;
    }
};

/// End of the RAM but for [`SHARED`], where the stack begins and grows down.
pub const RAM_END: u32 = 0x2002_0000 - SHARED;
/// Bytes at the end of the RAM for what the tasks share whose code lies in RAM: SRAM2, which no code is fetched from.
pub const SHARED: u32 = 8 * 1024;
/// What everything at once may take of the stack, bytes; RAM leaves more than twice as much.
pub const STACK: u32 = 28 * 1024;
/// What lies below and nobody may touch as data, bytes: no frame may be larger. It holds the code that runs from RAM.
pub const STACK_GUARD: u32 = 36 * 1024;
/// Where that code is fetched: SRAM1 appears at address 0.
pub const FAST: u32 = RAM_END - STACK - STACK_GUARD - 0x2000_0000;

/// A task of the firmware.
#[derive(Clone, Copy, Debug)]
pub struct Task {
    /// Name in `main.rs`.
    pub name: &'static str,
    /// RTIC priority; a higher number preempts a lower one, 0 is idle.
    pub priority: u8,
    /// What starts it.
    pub source: &'static str,
    /// By when it must be done.
    pub deadline: &'static str,
}

/// The highest task that may log: a message keeps it and those below it waiting.
pub const LOGS: &str = "protocol";

/// The task table, highest priority first.
pub const TASKS: &[Task] = &[
    Task { name: "reflex", priority: 9, source: "ADC", deadline: "2.5 us from the sample to the pin" },
    Task { name: "stop", priority: 8, source: "EXTI15_10", deadline: "5 us" },
    Task { name: "bridge_fault", priority: 8, source: "TIM1_BRK_TIM9", deadline: "5 us; the break itself is hardware" },
    Task { name: "supply", priority: 8, source: "PVD", deadline: "5 us" },
    Task { name: "pulse_end", priority: 8, source: "EXTI9_5", deadline: "1 us from the end of a pulse to the pin" },
    Task { name: "pause_over", priority: 8, source: "TIM6_DAC", deadline: "1 us" },
    Task { name: "encoder_a", priority: 7, source: "EXTI0", deadline: "3.3 us, one edge at 300 kcount/s" },
    Task { name: "encoder_b", priority: 7, source: "EXTI1", deadline: "3.3 us, one edge at 300 kcount/s" },
    Task { name: "encoder_index", priority: 7, source: "EXTI2", deadline: "3.3 us, one edge at 300 kcount/s" },
    Task { name: "gap", priority: 6, source: "DMA2_STREAM0", deadline: "6 us, before the servo tick" },
    Task { name: "servo", priority: 5, source: "TIM1_UP_TIM10", deadline: "50 us, one period" },
    Task { name: "can_receive", priority: 4, source: "CAN1_RX0", deadline: "111 us, one frame" },
    Task { name: "can_sync", priority: 4, source: "CAN1_RX1", deadline: "47 us, the shortest frame" },
    Task { name: "can_transmit", priority: 4, source: "CAN1_TX", deadline: "111 us, one frame" },
    Task { name: "plan", priority: 3, source: "SPI2", deadline: "100 us, the second tick after its estimate" },
    Task { name: "supervise", priority: 2, source: "TIM7", deadline: "1 ms" },
    Task { name: "protocol", priority: 1, source: "SPI3", deadline: "1 ms" },
    Task { name: "idle", priority: 0, source: "-", deadline: "none" },
];

/// Priority of a task; a name that is not there does not compile in a constant.
pub const fn priority(name: &str) -> u8 {
    let mut i = 0;
    while i < TASKS.len() {
        if super::table::same(TASKS[i].name.as_bytes(), name.as_bytes()) {
            return TASKS[i].priority;
        }
        i += 1;
    }
    panic!("no such task")
}

/// Writes everything of this page: clocks, rates, timers, streams, CAN bit timing, tasks.
pub fn write_chip(f: &mut dyn fmt::Write) -> fmt::Result {
    writeln!(f, "Clocks")?;
    writeln!(f, "  core {} MHz, APB1 {} MHz, APB2 {} MHz", CORE_HZ / MHZ, APB1_HZ / MHZ, APB2_HZ / MHZ)?;
    writeln!(f, "  converters {} MHz", ADC.hz / MHZ)?;
    writeln!(f, "Rates")?;
    for (what, divider, clock) in [
        ("servo tick and PWM, TIM1", SERVO, TIMER2_HZ),
        ("gap conversion, TIM3", SAMPLE, TIMER1_HZ),
        ("supervision, TIM7", SUPERVISE, TIMER1_HZ),
    ] {
        let hz = divider.rate(clock);
        writeln!(f, "  {what:<26} {hz:>7} Hz  prescaler {}, reload {}", divider.prescaler, divider.reload)?;
    }
    writeln!(f, "  edge stamps, TIM8          {TIMER2_HZ} Hz  wraps after {EDGE_MODULUS}")?;
    for (what, sampling) in [("gap voltage, ADC1", GAP_SAMPLING), ("gated current and voltage, ADC2", GATED_SAMPLING)] {
        let ns = ADC.ns(sampling.sequence_cycles);
        writeln!(f, "  {what}: {} cycles of sampling, done {ns} ns after the trigger", sampling.sample_cycles)?;
    }
    writeln!(f, "CAN bit timing")?;
    for rate in can::BIT_RATES {
        if let Ok(t) = can::bit_timing(APB1_HZ, rate) {
            let point = t.sample_point();
            writeln!(
                f,
                "  {:>4} kbit/s  {} quanta, sample point {}.{} %, CAN_BTR {:#010X}",
                rate / 1000,
                t.quanta(),
                point / 10,
                point % 10,
                t.btr()
            )?;
        }
    }
    writeln!(f, "Timers")?;
    for timer in TIMERS {
        writeln!(f, "  {:<6} {}", timer.name, timer.does)?;
    }
    writeln!(f, "DMA")?;
    for Stream { dma, stream, channel, request } in STREAMS {
        writeln!(f, "  DMA{dma} stream {stream} channel {channel}  {request}")?;
    }
    writeln!(f, "Tasks, highest priority first")?;
    for task in TASKS {
        writeln!(f, "  {} {:<14} {:<14} {}", task.priority, task.name, task.source, task.deadline)?;
    }
    Ok(())
}

const MHZ: u32 = 1_000_000;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_clock_tree_by_hand() {
        assert_eq!(pll(8_000_000), Some(Pll { m: 4, n: 168, q: 7 }));
        assert_eq!(pll(25_000_000), None);
        assert_eq!(pll(26_000_000).map(|p| p.m), Some(13));
        assert_eq!(pll(28_000_000), None);
        assert_eq!(pll(2_000_000), None);
        assert_eq!((TIMER1_HZ, TIMER2_HZ, ADC.hz), (84_000_000, 168_000_000, 21_000_000));
        assert_eq!((FLASH_WAITS, BUS_PRESCALERS), (5, 0b100 << 13 | 0b101 << 10));
        assert_eq!([168, 84, 42, 21].map(|mhz| bus_prescaler(mhz * MHZ)), [Some(0), Some(4), Some(5), Some(6)]);
        assert_eq!([0, 7, 56, 336].map(|mhz| bus_prescaler(mhz * MHZ)), [None; 4]);
        assert_eq!((SERVO.reload, SAMPLE.reload, EDGE_MODULUS), (8399, 167, 58_800));
    }

    #[test]
    fn every_stream_has_a_request_that_reaches_it() {
        for s in STREAMS {
            assert!(REQUESTS.contains(&(s.request, s.stream, s.channel)), "{s:?}");
        }
    }

    #[test]
    fn the_printed_page_names_every_timer_stream_and_task() {
        let mut text = String::new();
        write_chip(&mut text).unwrap();
        for name in TIMERS.iter().map(|t| t.name).chain(TASKS.iter().map(|t| t.name)) {
            assert!(text.contains(name), "{name}");
        }
        assert!(text.contains("20000 Hz") && text.contains("500000 Hz"), "{text}");
    }

    #[test]
    fn priorities_fall_down_the_table() {
        assert!(TASKS.windows(2).all(|pair| pair[0].priority >= pair[1].priority));
        let falls = ["servo", "can_sync", "plan", "supervise", "protocol"].map(priority);
        assert!(falls.windows(2).all(|pair| pair[0] > pair[1]));
        assert_eq!(priority("can_sync"), priority("can_receive"));
    }
}
