//! RM0090 §17 and §18. The clock of the timers here is one tick unless a test says otherwise.

use super::*;
use crate::NEVER;
use crate::world::Drive;

const CR1: u32 = 0x00;
const CR2: u32 = 0x04;
const SMCR: u32 = 0x08;
const DIER: u32 = 0x0c;
const SR: u32 = 0x10;
const EGR: u32 = 0x14;
const CCMR1: u32 = 0x18;
const CCMR2: u32 = 0x1c;
const CCER: u32 = 0x20;
const CNT: u32 = 0x24;
const PSC: u32 = 0x28;
const ARR: u32 = 0x2c;
const RCR: u32 = 0x30;
const CCR1: u32 = 0x34;
const CCR4: u32 = 0x40;
const BDTR: u32 = 0x44;

/// A timer with its events.
struct Rig {
    t: Timer,
    out: Vec<Event>,
}

impl Rig {
    fn new(number: usize) -> Self {
        let mut rig = Self { t: Timer::new(KINDS[number - 1]), out: vec![] };
        rig.t.set_clock(Some(1), 0, &mut rig.out);
        rig
    }
    fn set(&mut self, at: u64, registers: &[(u32, u32)]) {
        for (offset, value) in registers {
            self.t.write(*offset, *value, at, &mut self.out).unwrap();
        }
    }
    fn get(&mut self, at: u64, offset: u32) -> u32 {
        self.t.read(offset, at, &mut self.out).unwrap()
    }
    /// Runs from event to event until `to`; the ticks of events of kind `wanted`.
    fn run(&mut self, to: u64, wanted: Event) -> Vec<u64> {
        let mut seen = vec![];
        self.out.clear();
        while self.t.due() <= to {
            let at = self.t.due();
            self.t.fire(at, &mut self.out);
            seen.extend(self.out.drain(..).filter(|e| *e == wanted).map(|_| at));
        }
        seen
    }
    fn edge(&mut self, at: u64, ti: usize, level: bool) {
        self.t.set_input(ti, level, at, &mut self.out);
    }
}

#[test]
fn an_update_comes_every_prescaler_plus_one_times_reload_plus_one_clocks() {
    let mut r = Rig::new(3);
    r.set(0, &[(PSC, 3), (ARR, 9), (CR2, 2 << 4), (EGR, 1), (CR1, 1)]);
    assert_eq!(r.run(130, Event::Trgo), [40, 80, 120]);
    assert_eq!(r.get(130, CNT), 2);
}

#[test]
fn prescaler_and_preloaded_reload_wait_for_the_update_event() {
    let mut r = Rig::new(3);
    r.set(0, &[(ARR, 9), (EGR, 1), (CR1, 1 | 1 << 7), (CR2, 2 << 4)]);
    r.set(5, &[(PSC, 1), (ARR, 4)]);
    assert_eq!(r.run(31, Event::Trgo), [10, 20, 30]);
}

#[test]
fn a_reload_without_preload_works_at_once() {
    let mut r = Rig::new(3);
    r.set(0, &[(ARR, 99), (EGR, 1), (CR1, 1), (CR2, 2 << 4)]);
    r.set(5, &[(ARR, 9)]);
    assert_eq!(r.run(20, Event::Trgo), [10, 20]);
}

#[test]
fn update_disable_holds_values_and_flag_back() {
    let mut r = Rig::new(3);
    r.set(0, &[(ARR, 9), (EGR, 1), (SR, 0), (CR1, 1 | 2 | 1 << 7), (ARR, 4)]);
    assert_eq!((r.get(25, SR) & 1, r.get(25, CNT)), (0, 5));
}

#[test]
fn ug_sets_the_flag_unless_urs_says_overflow_only() {
    for (urs, flag) in [(0, 1), (4, 0)] {
        let mut r = Rig::new(3);
        r.set(0, &[(CR1, urs), (EGR, 1)]);
        assert_eq!(r.get(0, SR) & 1, flag);
    }
}

#[test]
fn flags_are_cleared_by_writing_zero_and_gate_the_interrupt() {
    let mut r = Rig::new(3);
    r.set(0, &[(EGR, 1)]);
    assert_eq!(r.t.requests(), 0);
    r.set(0, &[(DIER, 1)]);
    assert_eq!(r.t.requests(), 1);
    r.set(0, &[(SR, !1)]);
    assert_eq!(r.t.requests(), 0);
}

#[test]
fn one_pulse_mode_stops_at_the_update() {
    let mut r = Rig::new(4);
    r.set(0, &[(ARR, 9), (EGR, 1), (CR1, 1 | 8)]);
    assert_eq!((r.get(100, CR1) & 1, r.get(100, CNT)), (0, 0));
    assert_eq!(r.t.due(), NEVER);
}

#[test]
fn repetition_counter_skips_updates_of_advanced_timers() {
    let mut r = Rig::new(1);
    r.set(0, &[(ARR, 9), (RCR, 2), (CR2, 2 << 4), (EGR, 1), (CR1, 1)]);
    assert_eq!(r.run(90, Event::Trgo), [30, 60, 90]);
}

#[test]
fn pwm_mode_1_is_high_below_the_compare_value() {
    let mut r = Rig::new(2);
    r.set(0, &[(ARR, 9), (CCR1, 3), (CCMR1, 6 << 4), (CCER, 1), (EGR, 1), (CR1, 1)]);
    assert_eq!(r.run(30, Event::Output(0, false)), [3, 13, 23]);
    assert_eq!(r.t.drive(0), Drive::Pwm { high: 3, period: 10 });
    for (ccr, drive) in [(0, Drive::Level(false)), (9, Drive::Pwm { high: 9, period: 10 }), (10, Drive::Level(true))] {
        r.set(30, &[(CCR1, ccr)]);
        assert_eq!(r.t.drive(0), drive);
    }
}

#[test]
fn polarity_inverts_and_mode_2_is_the_opposite_of_mode_1() {
    for (mode, ccer, high) in [(6, 1, 3), (6, 3, 7), (7, 1, 7), (7, 3, 3)] {
        let mut r = Rig::new(2);
        r.set(0, &[(ARR, 9), (CCR1, 3), (CCMR1, mode << 4), (CCER, ccer), (EGR, 1), (CR1, 1)]);
        assert_eq!(r.t.drive(0), Drive::Pwm { high, period: 10 });
    }
}

#[test]
fn a_preloaded_compare_value_is_latched_at_the_update_and_another_at_once() {
    for (preload, high) in [(8, 3), (0, 7)] {
        let mut r = Rig::new(1);
        r.set(0, &[(ARR, 9), (CCR1, 3), (CCMR1, 6 << 4 | preload), (CCER, 1), (BDTR, 1 << 15), (EGR, 1), (CR1, 1)]);
        r.set(5, &[(CCR1, 7)]);
        assert_eq!(r.t.drive(0), Drive::Pwm { high, period: 10 });
        r.run(10, Event::Waveform);
        assert_eq!(r.t.drive(0), Drive::Pwm { high: 7, period: 10 });
    }
}

#[test]
fn forced_modes_act_now_whatever_the_counter() {
    let mut r = Rig::new(2);
    r.set(0, &[(ARR, 9), (CCR1, 3), (CCMR1, 6 << 4), (CCER, 1), (EGR, 1), (CR1, 1)]);
    r.set(1, &[(CCMR1, 4 << 4)]);
    assert_eq!(r.t.drive(0), Drive::Level(false));
    r.set(8, &[(CCMR1, 5 << 4)]);
    assert_eq!(r.t.drive(0), Drive::Level(true));
}

#[test]
fn an_advanced_timer_drives_nothing_without_main_output_enable() {
    let mut r = Rig::new(1);
    r.set(0, &[(ARR, 9), (CCR1, 3), (CCMR1, 6 << 4), (CCER, 1), (EGR, 1), (CR1, 1)]);
    assert_eq!(r.t.drive(0), Drive::Released);
    r.set(0, &[(BDTR, 1 << 10)]);
    assert_eq!(r.t.drive(0), Drive::Level(false));
    r.set(0, &[(BDTR, 1 << 15)]);
    assert_eq!(r.t.drive(0), Drive::Pwm { high: 3, period: 10 });
}

#[test]
fn a_break_switches_the_outputs_off_by_hardware_and_holds_them_off() {
    let mut r = Rig::new(1);
    // Break enabled, active low.
    r.set(0, &[(CCER, 1), (DIER, 1 << 7), (BDTR, 1 << 15 | 1 << 12)]);
    r.t.set_break(Some(true), &mut r.out);
    assert_eq!(r.get(0, BDTR) >> 15, 1);
    r.t.set_break(Some(false), &mut r.out);
    assert_eq!((r.get(0, BDTR) >> 15, r.t.requests()), (0, 1 << 7));
    r.set(0, &[(BDTR, 1 << 15 | 1 << 12)]);
    assert_eq!(r.get(0, BDTR) >> 15, 0);
    r.t.set_break(Some(true), &mut r.out);
    r.set(0, &[(BDTR, 1 << 15 | 1 << 12)]);
    assert_eq!(r.get(0, BDTR) >> 15, 1);
}

#[test]
fn a_compare_beyond_the_reload_flags_at_the_overflow() {
    let mut r = Rig::new(3);
    r.set(0, &[(ARR, 9), (CCR1, 50), (EGR, 1), (SR, 0), (CR1, 1)]);
    assert_eq!(r.get(9, SR) & 2, 0);
    assert_eq!(r.get(10, SR) & 2, 2);
}

#[test]
fn capture_takes_the_count_at_the_selected_edge_and_reading_it_clears_the_flag() {
    for (ccer, rising, falling) in [(1, true, false), (3, false, true), (0xb, true, true)] {
        let mut r = Rig::new(5);
        r.set(0, &[(CCMR1, 1), (CCER, ccer), (CR1, 1)]);
        r.edge(1000, 0, true);
        assert_eq!(r.get(1000, SR) & 2 != 0, rising);
        r.set(1000, &[(SR, 0)]);
        r.edge(1500, 0, false);
        assert_eq!(r.get(1500, SR) & 2 != 0, falling);
        let expected = if falling { 1500 } else { 1000 };
        assert_eq!((r.get(1600, CCR1), r.get(1600, SR) & 2), (expected, 0));
    }
}

#[test]
fn a_second_capture_before_the_first_is_read_is_an_overcapture() {
    let mut r = Rig::new(5);
    r.set(0, &[(CCMR1, 1), (CCER, 1), (CR1, 1)]);
    for at in [10, 30] {
        r.edge(at, 0, true);
        r.edge(at + 10, 0, false);
    }
    assert_eq!((r.get(50, SR) >> 9 & 1, r.get(50, CCR1)), (1, 30));
}

#[test]
fn a_channel_can_capture_the_other_input_of_its_pair() {
    let mut r = Rig::new(5);
    r.set(0, &[(CCMR1, 2 << 8), (CCER, 1 << 4), (CR1, 1)]);
    r.edge(77, 0, true);
    assert_eq!((r.get(77, SR) & 6, r.get(77, CCR1 + 4)), (4, 77));
}

#[test]
fn an_input_filter_delays_an_edge_and_drops_a_shorter_pulse() {
    let mut r = Rig::new(5);
    r.set(0, &[(CCMR1, 1 | 3 << 4), (CCER, 1), (CR1, 1)]); // eight samples
    r.edge(100, 0, true);
    r.edge(107, 0, false);
    r.run(200, Event::Waveform);
    assert_eq!(r.get(200, SR) & 2, 0);
    r.edge(300, 0, true);
    r.run(400, Event::Waveform);
    assert_eq!((r.get(400, SR) & 2, r.get(400, CCR1)), (2, 308));
}

/// Levels of A and B after `n` quarter steps with A leading.
fn quadrature(n: i32) -> (bool, bool) {
    (matches!(n.rem_euclid(4), 1 | 2), matches!(n.rem_euclid(4), 2 | 3))
}

fn encoder(mode: u32, ccer: u32) -> Rig {
    let mut r = Rig::new(5);
    r.set(0, &[(CCMR1, 0x101), (CCER, ccer), (SMCR, mode), (CR1, 1)]);
    r
}

fn walk(r: &mut Rig, from: i32, to: i32) {
    let step = (to - from).signum();
    let mut n = from;
    while n != to {
        n += step;
        let (a, b) = quadrature(n);
        r.edge(0, 0, a);
        r.edge(0, 1, b);
    }
}

#[test]
fn encoder_mode_3_counts_every_edge_both_ways() {
    let mut r = encoder(3, 0);
    walk(&mut r, 0, 1000);
    assert_eq!((r.get(0, CNT), r.get(0, CR1) & 16), (1000, 0));
    walk(&mut r, 1000, -7);
    assert_eq!((r.get(0, CNT) as i32, r.get(0, CR1) & 16), (-7, 16));
}

#[test]
fn encoder_modes_1_and_2_count_edges_of_one_input() {
    for mode in [1, 2] {
        let mut r = encoder(mode, 0);
        walk(&mut r, 0, 1000);
        assert_eq!(r.get(0, CNT), 500);
    }
}

#[test]
fn inverting_one_encoder_input_reverses_the_count() {
    let mut r = encoder(3, 2);
    walk(&mut r, 0, 100);
    assert_eq!(r.get(0, CNT) as i32, -100);
    let mut r = encoder(3, 0x22);
    walk(&mut r, 0, 100);
    assert_eq!(r.get(0, CNT), 100);
}

#[test]
fn a_stopped_encoder_counts_nothing() {
    let mut r = encoder(3, 0);
    r.set(0, &[(CR1, 0)]);
    walk(&mut r, 0, 10);
    assert_eq!(r.get(0, CNT), 0);
}

#[test]
fn slave_reset_restarts_the_count_and_passes_the_trigger_on() {
    let mut r = Rig::new(8);
    // Reset by TI1FP1 rising; channel 2 captures.
    r.set(0, &[(CCMR1, 0x101), (CCER, 0x11), (SMCR, 5 << 4 | 4), (CR1, 1)]);
    r.out.clear();
    r.edge(500, 0, true);
    assert!(r.out.contains(&Event::Trgo));
    assert_eq!(r.get(600, CNT), 100);
    r.edge(700, 1, true);
    assert_eq!(r.get(900, CCR1 + 4), 200);
    assert_eq!(r.get(900, SR) & (1 << 6), 1 << 6);
    r.edge(800, 0, false);
    assert_eq!(r.get(900, CNT), 400);
}

#[test]
fn a_triggered_one_pulse_marks_the_end_of_blanking() {
    let mut r = Rig::new(4);
    // ITR3 starts the counter; PWM mode 2 raises OC4 at the compare value.
    r.set(0, &[(ARR, 499), (CCR4, 336), (CCMR2, 7 << 12), (CCER, 1 << 12), (EGR, 1)]);
    r.set(0, &[(SMCR, 3 << 4 | 6), (CR1, 8)]);
    r.run(10_000, Event::Trgo);
    assert_eq!(r.get(10_000, CNT), 0);
    assert!(r.t.listens(3) && !r.t.listens(2));
    r.t.trigger(10_000, &mut r.out);
    assert_eq!(r.run(20_000, Event::Output(3, true)), [10_336]);
    assert_eq!(r.get(20_000, CR1) & 1, 0);
}

#[test]
fn external_clock_mode_2_counts_rising_edges_of_etr() {
    let mut r = Rig::new(2);
    r.set(0, &[(SMCR, 1 << 14), (CR1, 1)]);
    for i in 0..10 {
        r.t.set_etr(true, 2 * i, &mut r.out);
        r.t.set_etr(false, 2 * i + 1, &mut r.out);
    }
    assert_eq!(r.get(100, CNT), 10);
}

#[test]
fn trigger_output_follows_its_selection() {
    let trgo = |cr2: u32, act: &[(u32, u32)]| {
        let mut r = Rig::new(3);
        r.set(0, &[(ARR, 9), (CCR1, 4), (EGR, 1), (CR2, cr2 << 4)]);
        r.out.clear();
        r.set(0, act);
        r.out.contains(&Event::Trgo)
    };
    assert!(trgo(0, &[(EGR, 1)]) && !trgo(0, &[(CR1, 1)]));
    assert!(trgo(1, &[(CR1, 1)]) && !trgo(1, &[(EGR, 1)]));
    assert!(trgo(2, &[(EGR, 1)]));
    let mut r = Rig::new(3);
    r.set(0, &[(ARR, 9), (CCR1, 4), (EGR, 1), (CR2, 3 << 4), (CR1, 1)]);
    assert_eq!(r.run(25, Event::Trgo), [4, 14, 24]);
}

#[test]
fn timers_have_the_registers_of_their_kind_and_no_others() {
    for (number, offset, exists) in [
        (6, CCR1, false),
        (6, ARR, true),
        (13, CCR1, true),
        (13, SMCR, false),
        (3, BDTR, false),
        (8, BDTR, true),
        (9, CCMR2, false),
    ] {
        assert_eq!(Rig::new(number).t.read(offset, 0, &mut vec![]).is_ok(), exists, "TIM{number} {offset:#x}");
    }
}

#[test]
fn counters_have_16_bits_but_for_timers_2_and_5() {
    for (number, top) in [(2, u32::MAX), (3, 0xffff), (5, u32::MAX), (1, 0xffff)] {
        let mut r = Rig::new(number);
        r.set(0, &[(CNT, u32::MAX)]);
        assert_eq!((r.get(0, CNT), r.get(0, ARR)), (top, top));
    }
}

#[test]
fn what_is_not_modelled_is_refused() {
    assert!(Rig::new(3).t.write(DIER, 1 << 8, 0, &mut vec![]).is_err());
    let mut r = Rig::new(1);
    for (offset, value) in [(CR1, 1 << 5), (CR1, 16), (DIER, 1 << 13), (CCER, 4), (SMCR, 5), (CCMR1, 1 | 4)] {
        assert!(matches!(r.t.write(offset, value, 0, &mut r.out), Err(Fault::Unsupported(_))), "{offset:#x}");
    }
}

#[test]
fn a_timer_without_a_whole_number_of_ticks_to_its_clock_does_not_start() {
    let mut r = Rig::new(3);
    r.t.set_clock(None, 0, &mut r.out);
    assert!(r.t.write(CR1, 1, 0, &mut r.out).is_err());
}

#[test]
fn enabled_captures_and_updates_ask_for_dma() {
    let mut r = Rig::new(8);
    r.set(0, &[(CCMR1, 1), (CCER, 0xb), (DIER, 1 << 9), (CR1, 1)]);
    r.out.clear();
    r.edge(10, 0, true);
    r.edge(20, 0, false);
    assert_eq!(r.out, [Event::Dma(1), Event::Dma(1)]);
    r.out.clear();
    r.set(30, &[(DIER, 1 << 8), (EGR, 1)]);
    assert!(r.out.contains(&Event::Dma(0)) && !r.out.contains(&Event::Dma(1)));
}

#[test]
fn each_level_of_the_lock_keeps_what_the_manual_says() {
    // Channel 1 an output in PWM mode, channel 2 an input.
    let locked = |level: u32| {
        let mut rig = Rig::new(1);
        rig.set(0, &[(CCMR1, 0x0168), (CCER, 0x11), (BDTR, level << 8 | 1 << 12)]);
        // A second write does not change the level; everything else by its level.
        rig.set(1, &[(BDTR, 0xffff & !(3 << 8) & !(1 << 12)), (CR2, 0x7f00), (CCER, 0x33), (CCMR1, 0x0140)]);
        let mut read = |offset| rig.t.read(offset, 2, &mut rig.out).unwrap();
        (read(BDTR) >> 8 & 3, read(BDTR) & !(3 << 8), read(CR2), read(CCER), read(CCMR1))
    };
    assert_eq!(locked(0), (0, 0xecff, 0x7f00, 0x33, 0x0140));
    assert_eq!(locked(1), (1, 0x9c00, 0, 0x33, 0x0140));
    // OSSR and OSSI, and the polarity of the output, not of the input.
    assert_eq!(locked(2), (2, 0x9000, 0, 0x31, 0x0140));
    assert_eq!(locked(3), (3, 0x9000, 0, 0x31, 0x0168));
}
