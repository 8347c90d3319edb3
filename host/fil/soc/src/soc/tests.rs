//! The chip as a whole, driven through its bus as software would.

use crate::can::Frame;
use crate::world::{CanReply, Change, Drive, Pin, World};
use std::collections::VecDeque;

/// A world made of lists.
#[derive(Default)]
pub struct Bench {
    pub codes: [u16; 19],
    pub sampled: Vec<u64>,
    pub changes: VecDeque<(u64, Change)>,
    pub drives: Vec<(u64, Pin, Drive)>,
    pub frames: Vec<Frame>,
    pub reply: Option<CanReply>,
    pub dac: Vec<(u8, u16)>,
}

impl World for Bench {
    fn sample(&mut self, _: u8, channel: u8, at: u64) -> u16 {
        self.sampled.push(at);
        self.codes[usize::from(channel)]
    }
    fn next_change(&self) -> u64 {
        self.changes.front().map_or(crate::NEVER, |c| c.0)
    }
    fn take_change(&mut self, at: u64) -> Option<Change> {
        self.changes.pop_front_if(|c| c.0 <= at).map(|c| c.1)
    }
    fn drive(&mut self, at: u64, pin: Pin, drive: Drive) {
        self.drives.push((at, pin, drive));
    }
    fn can_sent(&mut self, _: u64, frame: Frame) -> CanReply {
        self.frames.push(frame);
        self.reply.unwrap_or(CanReply::Acknowledged)
    }
    fn dac(&mut self, _: u64, channel: u8, code: u16) {
        self.dac.push((channel, code));
    }
}

use super::Soc;
use crate::{Access, Error, Fault, Masks, Reset};

const GPIOA: u32 = 0x4002_0000;
const GPIOB: u32 = 0x4002_0400;
const GPIOC: u32 = 0x4002_0800;
const RCC: u32 = 0x4002_3800;
const TIM1: u32 = 0x4001_0000;
const TIM3: u32 = 0x4000_0400;
const TIM4: u32 = 0x4000_0800;
const TIM8: u32 = 0x4001_0400;
const ADC1: u32 = 0x4001_2000;
const ADC2: u32 = 0x4001_2100;
const ADC3: u32 = 0x4001_2200;
const DMA2: u32 = 0x4002_6400;
const EXTI: u32 = 0x4001_3c00;
const SYSCFG: u32 = 0x4001_3800;

const FREE: Masks = Masks { primask: false, faultmask: false, basepri: 0 };

fn set(soc: &mut Soc<Bench>, writes: &[(u32, u32)]) {
    for (address, value) in writes {
        soc.write(*address, 4, *value).unwrap_or_else(|e| panic!("{e}"));
    }
}

fn get(soc: &mut Soc<Bench>, address: u32) -> u32 {
    soc.read(address, 4).unwrap_or_else(|e| panic!("{e}"))
}

fn wait(soc: &mut Soc<Bench>, ticks: u64) {
    soc.advance(soc.now() + ticks);
}

/// A chip at 168 MHz from an 8 MHz crystal with all modelled peripherals clocked.
fn running() -> Soc<Bench> {
    let mut soc = Soc::new(Bench::default(), 8_000_000);
    set(&mut soc, &[(RCC, 1 | 1 << 16), (RCC + 4, 8 | 336 << 6 | 1 << 22 | 7 << 24)]);
    wait(&mut soc, 500_000);
    set(&mut soc, &[(RCC, 1 | 1 << 16 | 1 << 24), (0x4002_3c00, 0x705)]);
    wait(&mut soc, 50_000);
    set(&mut soc, &[(RCC + 8, 2 | 5 << 10 | 4 << 13)]);
    set(&mut soc, &[(RCC + 0x30, 0x0060_01ff), (RCC + 0x40, 0x3200_01ff), (RCC + 0x44, 0x0007_4703)]);
    assert_eq!(soc.half_ticks_per_cycle(), 2);
    soc
}

fn level(soc: &mut Soc<Bench>, after: u64, pin: Pin, level: bool) {
    let at = soc.now() + after;
    soc.world.changes.push_back((at, Change::Level(pin, Some(level))));
    soc.world_changed();
    soc.advance(at);
}

#[test]
fn a_register_that_is_not_modelled_is_named() {
    let mut soc = running();
    let error = soc.read(0x4001_1004, 4).unwrap_err();
    assert_eq!(
        error,
        Error {
            peripheral: "USART1",
            offset: 4,
            access: Some(Access::Read(4)),
            fault: Fault::Unmodelled,
            at: soc.now()
        }
    );
    assert_eq!(soc.error(), Some(error));
    assert!(error.to_string().contains("USART1 + 0x004"), "{error}");
    let error = soc.write(GPIOA + 0x2c, 4, 1).unwrap_err();
    assert!(error.to_string().starts_with("4-byte write of 0x1 to GPIOA + 0x02c"), "{error}");
}

#[test]
fn a_peripheral_without_clock_does_not_answer() {
    let mut soc = Soc::new(Bench::default(), 8_000_000);
    assert_eq!(soc.read(GPIOA, 4).unwrap_err().fault, Fault::ClockOff);
    set(&mut soc, &[(RCC + 0x30, 1)]);
    assert_eq!(get(&mut soc, GPIOA), 0xa800_0000);
    set(&mut soc, &[(RCC + 0x10, 1)]);
    assert_eq!(soc.read(GPIOA, 4).unwrap_err().fault, Fault::ClockOff);
}

#[test]
fn full_speed_without_wait_states_is_refused() {
    let mut soc = Soc::new(Bench::default(), 8_000_000);
    set(&mut soc, &[(RCC, 1 | 1 << 16), (RCC + 4, 8 | 336 << 6 | 1 << 22 | 7 << 24)]);
    wait(&mut soc, 500_000);
    set(&mut soc, &[(RCC, 1 | 1 << 16 | 1 << 24)]);
    wait(&mut soc, 50_000);
    assert!(soc.write(RCC + 8, 4, 2 | 5 << 10 | 4 << 13).is_err());
}

#[test]
fn a_bit_band_alias_is_one_bit_of_a_register_or_of_ram() {
    let mut soc = running();
    let alias = |address: u32, bit: u32| 0x4200_0000 + (address - 0x4000_0000) * 32 + bit * 4;
    set(&mut soc, &[(alias(GPIOC + 0x14, 9), 1)]);
    assert_eq!(get(&mut soc, GPIOC + 0x14), 1 << 9);
    assert_eq!(get(&mut soc, alias(GPIOC + 0x14, 9)), 1);
    set(&mut soc, &[(0x2200_0000 + 0x100 * 32 + 31 * 4, 0)]);
    assert_eq!(soc.memory.sram.load(0x2000_0100, 4), Some(0x25a5_a5a5));
}

#[test]
fn pwm_reaches_the_pin_whose_alternate_function_is_selected_and_no_other() {
    let mut soc = running();
    let pwm = [
        (TIM1 + 0x2c, 8399),
        (TIM1 + 0x34, 2100),
        (TIM1 + 0x18, 6 << 4 | 8),
        (TIM1 + 0x20, 1),
        (TIM1 + 0x44, 1 << 15),
        (TIM1 + 0x14, 1),
        (TIM1, 1),
    ];
    set(&mut soc, &pwm);
    assert_eq!(soc.drive(Pin::new('A', 8)), Drive::Released);
    set(&mut soc, &[(GPIOA + 0x24, 1), (GPIOA, 0xa800_0000 | 2 << 16 | 2 << 18)]);
    assert_eq!(soc.drive(Pin::new('A', 8)), Drive::Pwm { high: 2100, period: 8400 });
    assert_eq!(soc.drive(Pin::new('A', 9)), Drive::Released);
}

#[test]
fn a_new_duty_is_latched_at_the_start_of_a_period() {
    let mut soc = running();
    set(&mut soc, &[(GPIOA + 0x24, 1), (GPIOA, 0xa800_0000 | 2 << 16)]);
    set(&mut soc, &[(TIM1 + 0x2c, 8399), (TIM1 + 0x34, 10), (TIM1 + 0x18, 6 << 4 | 8), (TIM1 + 0x20, 1)]);
    set(&mut soc, &[(TIM1 + 0x44, 1 << 15), (TIM1 + 0x14, 1), (TIM1, 1)]);
    let start = soc.now();
    wait(&mut soc, 12_345);
    set(&mut soc, &[(TIM1 + 0x34, 99)]);
    wait(&mut soc, 20_000);
    let (at, pin, drive) = *soc.world.drives.last().unwrap();
    assert_eq!((at - start, pin, drive), (16_800, Pin::new('A', 8), Drive::Pwm { high: 99, period: 8400 }));
}

#[test]
fn a_bridge_fault_lets_the_pwm_pin_go_in_hardware() {
    let mut soc = running();
    level(&mut soc, 1, Pin::new('B', 12), true);
    set(&mut soc, &[(GPIOA + 0x24, 1), (GPIOA, 0xa800_0000 | 2 << 16)]);
    set(&mut soc, &[(GPIOB + 0x24, 1 << 16), (GPIOB, 0x280 | 2 << 24)]);
    set(&mut soc, &[(TIM1 + 0x2c, 8399), (TIM1 + 0x34, 10), (TIM1 + 0x18, 6 << 4), (TIM1 + 0x20, 1)]);
    set(&mut soc, &[(TIM1 + 0x44, 1 << 15 | 1 << 12), (TIM1 + 0x0c, 1 << 7), (TIM1 + 0x14, 1), (TIM1, 1)]);
    set(&mut soc, &[(0xe000_e100, 1 << 24)]);
    assert_ne!(soc.drive(Pin::new('A', 8)), Drive::Released);
    level(&mut soc, 777, Pin::new('B', 12), false);
    assert_eq!(soc.drive(Pin::new('A', 8)), Drive::Released);
    assert_eq!(soc.preempting(FREE), Some(16 + 24));
}

#[test]
fn an_edge_on_the_selected_port_interrupts_and_one_on_another_port_does_not() {
    let mut soc = running();
    set(&mut soc, &[(SYSCFG + 0x10, 2 << 4), (EXTI, 1 << 13), (EXTI + 0x0c, 1 << 13), (0xe000_e104, 1 << 8)]);
    // Line 13: EXTICR4, port C.
    set(&mut soc, &[(SYSCFG + 0x14, 2 << 4)]);
    for port in ['B', 'C'] {
        level(&mut soc, 5, Pin::new(port, 13), true);
        level(&mut soc, 5, Pin::new(port, 13), false);
        assert_eq!(soc.preempting(FREE).is_some(), port == 'C');
    }
    assert_eq!(soc.preempting(FREE), Some(16 + 40));
    set(&mut soc, &[(EXTI + 0x14, 1 << 13)]);
    soc.nvic().enter(56);
    soc.nvic().exit(56);
    assert_eq!(soc.preempting(FREE), None);
}

/// ADC1 channel 10 at 500 kS/s by TIM3 into a circular buffer of 50.
fn sampling(soc: &mut Soc<Bench>) {
    set(soc, &[(TIM3 + 0x2c, 167), (TIM3 + 0x04, 2 << 4), (TIM3 + 0x14, 1)]);
    let s0 = DMA2 + 0x10;
    set(soc, &[(s0 + 4, 50), (s0 + 8, ADC1 + 0x4c), (s0 + 12, 0x2000_1000)]);
    set(soc, &[(s0, 1 << 13 | 1 << 11 | 1 << 10 | 1 << 8 | 1 << 4 | 1 << 3 | 1)]);
    set(soc, &[(ADC1 + 0x304, 1 << 16), (ADC1 + 0x34, 10), (ADC1 + 0x0c, 1)]);
    set(soc, &[(ADC1 + 0x08, 1 | 1 << 8 | 1 << 9 | 8 << 24 | 1 << 28), (TIM3, 1), (0xe000_e104, 1 << 24)]);
}

#[test]
fn a_timer_triggers_conversions_and_dma_fills_the_buffer_half_by_half() {
    let mut soc = running();
    soc.world.codes[10] = 0x456;
    sampling(&mut soc);
    let start = soc.now();
    // The 25th trigger comes at 25 * 336; its conversion takes 27 clocks of 8 ticks.
    soc.advance(start + 25 * 336 + 27 * 8 - 1);
    assert_eq!((soc.preempting(FREE), soc.world.sampled.len()), (None, 24));
    wait(&mut soc, 1);
    assert_eq!(soc.preempting(FREE), Some(16 + 56));
    assert_eq!(soc.memory.sram.load(0x2000_1030, 4), Some(0xa5a5_0456));
    assert_eq!(soc.world.sampled[24], start + 25 * 336 + 15 * 8);
    soc.advance(start + 50 * 336 + 27 * 8);
    assert_eq!(get(&mut soc, DMA2) & 0x3f, 0x30);
    assert_eq!(soc.error(), None);
}

/// The same, but a converter that is off listens to the trigger as well: each conversion is an event then.
fn sampling_by_events(soc: &mut Soc<Bench>) {
    set(soc, &[(ADC3 + 0x08, 8 << 24 | 1 << 28)]);
    sampling(soc);
}

#[test]
fn conversions_that_nothing_takes_note_of_need_no_events() {
    for (begin, few) in [(sampling as fn(&mut Soc<Bench>), true), (sampling_by_events, false)] {
        let mut soc = running();
        begin(&mut soc);
        let (end, mut events) = (soc.now() + 100 * 336, 0);
        while soc.next_event() <= end {
            soc.advance(soc.next_event());
            events += 1;
        }
        assert_eq!(events < 30, few, "{events}");
    }
}

#[test]
fn conversions_without_events_are_those_with_events() {
    let accesses: [(u32, Option<u32>); 16] = [
        (TIM3, None),
        (TIM3 + 0x10, None),
        (TIM3 + 0x10, Some(0)),
        (TIM3 + 0x24, None),
        (TIM3 + 0x24, Some(5)),
        (TIM3 + 0x2c, Some(200)),
        (TIM3 + 0x2c, Some(167)),
        (ADC1, None),
        (ADC1 + 0x4c, None),
        (ADC1 + 0x0c, Some(0)),
        (ADC1 + 0x300, None),
        (DMA2, None),
        (DMA2 + 0x08, Some(0x3f)),
        (DMA2 + 0x14, None),
        (GPIOA + 0x10, None),
        (RCC + 0x44, Some(0x0007_4703)),
    ];
    for seed in 0..200u64 {
        let (mut quiet, mut loud) = (running(), running());
        sampling(&mut quiet);
        sampling_by_events(&mut loud);
        loud.advance(quiet.now());
        quiet.advance(loud.now());
        // Any numbers (MMIX).
        let mut random = seed;
        let mut any = |below: u64| {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (random >> 33) % below
        };
        for _ in 0..30 {
            let (ticks, (address, value)) = (any(3000), accesses[any(16) as usize]);
            let code = any(4096) as u16;
            let seen = [&mut quiet, &mut loud].map(|soc| {
                wait(soc, ticks);
                soc.world.codes[10] = code;
                let read = match value {
                    None => get(soc, address),
                    Some(value) => {
                        set(soc, &[(address, value)]);
                        0
                    }
                };
                let codes: Vec<_> = (0..50).map(|i| soc.memory.sram.load(0x2000_1000 + 2 * i, 2)).collect();
                (soc.now(), read, codes, soc.world.sampled.clone(), soc.nvic().pending())
            });
            assert!(seen[0] == seen[1], "seed {seed}: {address:#x} {value:x?}: {:?} {:?}", seen[0], seen[1]);
        }
    }
}

#[test]
fn half_a_million_conversions_a_second_for_ten_seconds_lose_none() {
    let mut soc = running();
    sampling(&mut soc);
    soc.world.sampled.reserve(5_000_000);
    let start = soc.now();
    soc.advance(start + 10 * crate::TICK_HZ + 300);
    assert_eq!(soc.world.sampled.len(), 5_000_000);
    assert_eq!(get(&mut soc, ADC1) & 0x20, 0);
}

#[test]
fn the_gate_resets_tim8_which_starts_blanking_whose_end_triggers_adc2() {
    let mut soc = running();
    // PC6 TIM8_CH1, PC7 TIM8_CH2.
    set(&mut soc, &[(GPIOC + 0x20, 3 << 24 | 3 << 28), (GPIOC, 2 << 12 | 2 << 14)]);
    set(&mut soc, &[(TIM8 + 0x18, 0x101), (TIM8 + 0x20, 0x11), (TIM8 + 8, 5 << 4 | 4), (TIM8, 1)]);
    // TIM4 at 84 MHz: blanking 2 us = 168 counts.
    set(&mut soc, &[(TIM4 + 0x2c, 200), (TIM4 + 0x40, 168), (TIM4 + 0x1c, 7 << 12), (TIM4 + 0x20, 1 << 12)]);
    set(&mut soc, &[(TIM4 + 0x14, 1), (TIM4 + 8, 3 << 4 | 6), (TIM4, 8)]);
    set(&mut soc, &[(ADC1 + 0x304, 1 << 16), (ADC2 + 0x34, 11), (ADC2 + 8, 1 | 9 << 24 | 1 << 28)]);
    wait(&mut soc, 10_000);
    assert_eq!(soc.world.sampled, []);
    level(&mut soc, 1, Pin::new('C', 6), true);
    let gate = soc.now();
    level(&mut soc, 500, Pin::new('C', 7), true);
    wait(&mut soc, 10_000);
    assert_eq!(soc.world.sampled, [gate + 336 + 3 * 8]);
    assert_eq!(get(&mut soc, TIM8 + 0x38), 500);
    assert_eq!(soc.error(), None);
}

#[test]
fn dma_stores_the_stamp_of_each_edge() {
    let mut soc = running();
    set(&mut soc, &[(GPIOC + 0x20, 3 << 24), (GPIOC, 2 << 12)]);
    let s2 = DMA2 + 0x10 + 2 * 0x18;
    set(&mut soc, &[(s2 + 4, 4), (s2 + 8, TIM8 + 0x34), (s2 + 12, 0x2000_2000)]);
    set(&mut soc, &[(s2, 7 << 25 | 1 << 13 | 1 << 11 | 1 << 10 | 1 << 8 | 1)]);
    set(&mut soc, &[(TIM8 + 0x18, 1), (TIM8 + 0x20, 0xb), (TIM8 + 0x0c, 1 << 9), (TIM8, 1)]);
    for (after, up) in [(100, true), (50, false), (200, true)] {
        level(&mut soc, after, Pin::new('C', 6), up);
    }
    let stamp = |i: u32| soc.memory.sram.load(0x2000_2000 + 2 * i, 2).unwrap();
    assert_eq!([stamp(0), stamp(1), stamp(2)], [100, 150, 350]);
    assert_eq!((get(&mut soc, s2 + 4), get(&mut soc, TIM8 + 0x10) & 2), (1, 0));
}

#[test]
fn steps_are_counted_by_both_edges_and_each_change_of_direction_is_stamped() {
    let mut soc = running();
    let (tim2, s1) = (0x4000_0000, 0x4002_6000 + 0x10 + 0x18);
    let (step, direction) = (Pin::new('A', 15), Pin::new('B', 10));
    // PA15 and PB10 are TIM2_CH1 and TIM2_CH3.
    set(&mut soc, &[(GPIOA + 0x24, 1 << 28), (GPIOA, 0xa800_0000), (GPIOB + 0x24, 1 << 8), (GPIOB, 0x280 | 2 << 20)]);
    set(&mut soc, &[(s1 + 4, 4), (s1 + 8, tim2 + 0x3c), (s1 + 12, 0x2000_2000)]);
    set(&mut soc, &[(s1, 3 << 25 | 2 << 13 | 2 << 11 | 1 << 10 | 1 << 8 | 1)]);
    set(
        &mut soc,
        &[(tim2 + 0x18, 4 << 4 | 1), (tim2 + 0x1c, 4 << 4 | 1), (tim2 + 0x20, 0xb00), (tim2 + 0x0c, 1 << 11)],
    );
    set(&mut soc, &[(tim2 + 0x08, 4 << 4 | 7), (tim2, 1)]);
    level(&mut soc, 10, step, true);
    level(&mut soc, 10, direction, true);
    wait(&mut soc, 1000);
    set(&mut soc, &[(tim2 + 0x24, 1)]);
    let half = |soc: &mut Soc<Bench>| get(soc, tim2 + 0x24);
    for _ in 0..3 {
        level(&mut soc, 168, step, false);
        level(&mut soc, 168, step, true);
    }
    wait(&mut soc, 100);
    assert_eq!(half(&mut soc), 7);
    // 143 ns of filter: what is shorter is no step.
    level(&mut soc, 168, step, false);
    level(&mut soc, 23, step, true);
    level(&mut soc, 168, step, false);
    level(&mut soc, 25, step, true);
    level(&mut soc, 168, direction, false);
    wait(&mut soc, 100);
    level(&mut soc, 168, step, false);
    level(&mut soc, 80, direction, true);
    wait(&mut soc, 100);
    let stamp = |i: u32| soc.memory.sram.load(0x2000_2000 + 4 * i, 4).unwrap();
    assert_eq!([stamp(1), stamp(2)], [9, 10]);
    assert_eq!((half(&mut soc), get(&mut soc, s1 + 4)), (10, 1));
    assert_eq!(soc.error(), None);
}

#[test]
fn dma_into_core_coupled_memory_is_a_transfer_error() {
    let mut soc = running();
    let s0 = DMA2 + 0x10;
    set(&mut soc, &[(s0 + 4, 50), (s0 + 8, ADC1 + 0x4c), (s0 + 12, 0x1000_0000), (s0, 1 << 13 | 1 << 11 | 1)]);
    set(&mut soc, &[(ADC1 + 0x304, 1 << 16), (ADC1 + 8, 1 | 1 << 8 | 1 << 30)]);
    wait(&mut soc, 1000);
    assert_eq!(get(&mut soc, DMA2) & 0x3f, 1 << 3);
    assert_eq!(get(&mut soc, s0) & 1, 0);
}

#[test]
fn can_needs_its_pins() {
    for connected in [true, false] {
        let mut soc = running();
        let can = 0x4000_6400;
        if connected {
            set(&mut soc, &[(GPIOB + 0x24, 0x99), (GPIOB, 0x280 | 0xa << 16)]);
        }
        set(&mut soc, &[(can, 1)]);
        wait(&mut soc, 100);
        set(&mut soc, &[(can + 0x1c, 10 << 16 | 1 << 20 | 2), (can + 0x20c, 1), (can + 0x21c, 1)]);
        set(&mut soc, &[(can + 0x200, 0x2a1c_0e00), (can, 0)]);
        wait(&mut soc, 5000);
        soc.world.changes.push_back((soc.now() + 10, Change::Can(Frame::new(0x77, &[1]))));
        soc.world_changed();
        wait(&mut soc, 10);
        assert_eq!(get(&mut soc, can + 0x0c) & 3, u32::from(connected));
        set(&mut soc, &[(can + 0x180, 5 << 21 | 1)]);
        wait(&mut soc, 20_000);
        assert_eq!(soc.world.frames.len(), usize::from(connected));
    }
}

#[test]
fn the_watchdog_resets_the_chip_and_says_so_afterwards() {
    let mut soc = running();
    let iwdg = 0x4000_3000;
    set(&mut soc, &[(GPIOC, 1), (GPIOC + 0x18, 1), (iwdg, 0x5555), (iwdg + 8, 9), (iwdg, 0xcccc)]);
    wait(&mut soc, 10 * 4 * 5250 - 1);
    assert_eq!((soc.reset_request(), soc.watchdog_running()), (None, true));
    wait(&mut soc, 1);
    assert_eq!(soc.reset_request(), Some(Reset::Watchdog));
    soc.reset(Reset::Watchdog);
    assert_eq!((soc.reset_request(), soc.watchdog_running()), (None, false));
    assert_eq!(soc.drive(Pin::new('C', 0)), Drive::Released);
    assert_eq!(get(&mut soc, RCC + 0x74) & 1 << 29, 1 << 29);
    assert_eq!(soc.read(GPIOC, 4).unwrap_err().fault, Fault::ClockOff);
}

#[test]
fn a_reset_bit_puts_one_peripheral_back_and_leaves_the_others() {
    let mut soc = running();
    set(&mut soc, &[(TIM3 + 0x28, 5), (TIM4 + 0x28, 6), (RCC + 0x20, 1 << 1), (RCC + 0x20, 0)]);
    assert_eq!((get(&mut soc, TIM3 + 0x28), get(&mut soc, TIM4 + 0x28)), (0, 6));
}

#[test]
fn the_converter_puts_out_what_is_written() {
    let mut soc = running();
    set(&mut soc, &[(0x4000_7400, 1), (0x4000_7408, 1234)]);
    assert_eq!(soc.world.dac, [(1, 1234)]);
}

#[test]
fn identical_runs_are_identical() {
    let run = || {
        let mut soc = running();
        sampling(&mut soc);
        for i in 0..200 {
            level(&mut soc, 1000 + i * 7, Pin::new('C', 6), i % 2 == 0);
        }
        (soc.world.sampled, soc.world.drives, soc.now)
    };
    assert_eq!(run(), run());
}
