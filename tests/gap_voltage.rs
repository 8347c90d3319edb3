//! The gap-voltage source from converter codes to readings, through its public face.

use edm_hal_shim::gap::{BLOCK, GapBlock};
use edm_servo_head::dsp::chain;
use edm_servo_head::dsp::decimate::CodeRange;
use edm_servo_head::gap::voltage::{Average, Config, Polarity};
use edm_servo_head::gap::{GapReading, GapSource, Quality, Voltage};
use edm_servo_head::units::{Hertz, Seconds, Volts};
use proptest::prelude::*;

/// Ticks after which every filter has come to rest.
const SETTLED: usize = 40_000;

fn source(config: Config) -> Voltage {
    Voltage::new(config.build().unwrap())
}

/// A block whose gated conversions read `volts` and whose others read 0 V, on the default front end.
fn block(volts: f32, gate: u32) -> GapBlock {
    let zero = Config::default().zero_code;
    let on = (f32::from(zero) + volts / Config::default().volts_per_code).round() as u16;
    GapBlock { codes: std::array::from_fn(|i| if gate >> i & 1 == 1 { on } else { zero }), gate, ..GapBlock::EMPTY }
}

fn run(source: &mut Voltage, block: Option<GapBlock>, ticks: usize) -> GapReading {
    (0..ticks).fold(GapReading::default(), |_, _| source.update(block.as_ref()))
}

#[track_caller]
fn assert_near(got: Volts, volts: f32, within: f32) {
    assert!((got.0 - volts).abs() <= within, "{} V instead of {volts} V", got.0);
}

#[test]
fn a_constant_voltage_reads_as_itself_with_either_polarity() {
    for (polarity, code) in [(Polarity::Positive, 2600), (Polarity::Negative, 1400)] {
        let mut source = source(Config { polarity, zero_code: 2000, ..Config::default() });
        let reading =
            run(&mut source, Some(GapBlock { codes: [code; BLOCK], gate: GapBlock::ALL, ..GapBlock::EMPTY }), SETTLED);
        assert_near(reading.filtered, 60.0, 0.001);
        assert_near(reading.block, 60.0, 0.001);
        assert_eq!(reading.quality, Quality::Valid);
    }
}

#[test]
fn at_half_on_time_the_plain_average_reads_half_and_the_gated_one_all() {
    let (on, off) = (block(100.0, GapBlock::ALL), block(100.0, 0));
    for (average, volts) in [(Average::Plain, 50.0), (Average::Gated, 100.0)] {
        let mut source = source(Config { average, ..Config::default() });
        let readings = [on, off].into_iter().cycle().take(SETTLED).map(|block| source.update(Some(&block)));
        assert_near(readings.last().unwrap().filtered, volts, 0.05);
    }
}

#[test]
fn a_conversion_that_straddles_an_edge_is_not_part_of_the_gated_average() {
    let mut straddled = block(100.0, 0xFFFF);
    straddled.codes[15] = 500;
    straddled.gate &= !(1 << 15);
    let reading = run(&mut source(Config::default()), Some(straddled), SETTLED);
    assert_near(reading.filtered, 100.0, 0.1);
}

#[test]
fn the_reading_starts_from_the_first_block_and_not_from_zero() {
    let mut source = source(Config::default());
    let first = source.update(Some(&block(100.0, GapBlock::ALL)));
    assert_near(first.filtered, 100.0, 0.1);
    assert_eq!(first.quality, Quality::Valid);
}

#[test]
fn off_time_holds_until_the_limit_and_then_the_gate_is_missing() {
    let mut source = source(Config { hold_limit: Seconds(0.005), ..Config::default() });
    assert_eq!(run(&mut source, Some(block(0.0, 0)), 1).quality, Quality::NoGate, "no gate since power-up");
    run(&mut source, Some(block(60.0, GapBlock::ALL)), 1000);
    let held = run(&mut source, Some(block(0.0, 0)), 100);
    assert_eq!(held.quality, Quality::Valid);
    assert_near(held.block, 60.0, 0.001);
    let late = run(&mut source, Some(block(0.0, 0)), 1);
    assert_eq!(late.quality, Quality::NoGate);
    assert_near(late.filtered, 60.0, 0.01);
    assert_eq!(run(&mut source, Some(block(60.0, GapBlock::ALL)), 1).quality, Quality::Valid);
}

#[test]
fn pulses_with_too_few_conversions_to_judge_show_the_gate_and_are_averaged() {
    let mut source = source(Config { hold_limit: Seconds(0.005), ..Config::default() });
    // 4 us of 55: a pulse or none in a block, with one or two conversions.
    for n in 0..2000 {
        let gate = [0b1, 0b11 << 9, 0, 0b1 << 24][n % 4];
        let reading = source.update(Some(&block(60.0, gate)));
        assert_eq!((reading.quality, reading.short_ticks), (Quality::Valid, 0), "tick {n}");
        assert_near(reading.block, 60.0, 0.01);
    }
    // A run of shorts that nothing judges any more is over at the hold limit all the same.
    run(&mut source, Some(block(0.0, 0b111)), 10);
    assert_eq!(run(&mut source, Some(block(60.0, 0b11)), 100).short_ticks, 110);
    assert_eq!(run(&mut source, Some(block(60.0, 0b11)), 1).short_ticks, 0);
    assert_eq!(run(&mut source, Some(block(0.0, 0)), 100).quality, Quality::Valid);
    assert_eq!(run(&mut source, Some(block(0.0, 0)), 1).quality, Quality::NoGate);
}

#[test]
fn a_plain_average_needs_no_gate() {
    let mut source = source(Config { average: Average::Plain, ..Config::default() });
    assert_eq!(run(&mut source, Some(block(0.0, 0)), SETTLED).quality, Quality::Valid);
}

#[test]
fn a_tick_without_a_block_is_missing_and_holds() {
    let mut source = source(Config::default());
    run(&mut source, Some(block(60.0, GapBlock::ALL)), 1000);
    let reading = source.update(None);
    assert_eq!(reading.quality, Quality::Missing);
    assert_near(reading.filtered, 60.0, 0.01);
    assert_near(reading.block, 60.0, 0.001);
}

#[test]
fn a_run_of_shorts_counts_every_tick_since_its_first_block() {
    let mut source = source(Config::default());
    let short_ticks = |source: &mut Voltage, volts, gate| source.update(Some(&block(volts, gate))).short_ticks;
    assert_eq!(short_ticks(&mut source, 100.0, GapBlock::ALL), 0);
    assert_eq!(short_ticks(&mut source, 0.0, 0), 0, "off-time does not begin a run");
    assert_eq!(short_ticks(&mut source, 5.0, GapBlock::ALL), 1);
    assert_eq!(short_ticks(&mut source, 0.0, 0), 2, "off-time is time");
    assert_eq!(source.update(None).short_ticks, 3, "so is a tick without a block");
    assert_eq!(short_ticks(&mut source, 100.0, 0b11), 4, "two conversions do not end a run");
    assert_eq!(short_ticks(&mut source, -5.0, 0b111), 5);
    assert_eq!(short_ticks(&mut source, 100.0, 0b111), 0, "three do");
    assert_eq!(short_ticks(&mut source, 5.0, 0b11), 0, "two conversions do not begin a run");
    assert_eq!(short_ticks(&mut source, 5.0, 0b111), 1);
}

#[test]
fn a_short_lies_below_its_threshold_and_what_lies_on_it_is_none() {
    let config = Config { short: Volts(15.0), zero_code: 2000, volts_per_code: 0.125, ..Config::default() };
    for (code, ticks) in [(2000 + 119, 1), (2000 + 120, 0), (2000 - 119, 1), (2000 - 120, 0)] {
        let reading =
            source(config).update(Some(&GapBlock { codes: [code; BLOCK], gate: GapBlock::ALL, ..GapBlock::EMPTY }));
        assert_eq!(reading.short_ticks, ticks, "code {code}");
    }
}

#[test]
fn a_generator_that_suspends_its_pulses_ends_a_run_at_the_hold_limit() {
    let mut source = source(Config { hold_limit: Seconds(0.005), ..Config::default() });
    run(&mut source, Some(block(0.0, GapBlock::ALL)), 10);
    assert_eq!(run(&mut source, Some(block(0.0, 0)), 100).short_ticks, 110);
    assert_eq!(run(&mut source, Some(block(0.0, 0)), 1).short_ticks, 0);
    assert_eq!(run(&mut source, Some(block(0.0, GapBlock::ALL)), 1).short_ticks, 1);
}

#[test]
fn the_short_path_does_not_wait_for_the_filters() {
    let mut source = source(Config::default());
    run(&mut source, Some(block(60.0, GapBlock::ALL)), 1000);
    let reading = run(&mut source, Some(block(0.0, GapBlock::ALL)), 20);
    assert_eq!(reading.short_ticks, 20);
    assert!(reading.filtered.0 > 40.0, "after 1 ms the filters still say {} V", reading.filtered.0);
}

#[test]
fn a_block_is_saturated_from_the_set_share_of_clipped_conversions_on() {
    for rail in [0, 4095] {
        for (clipped, quality) in [(4, Quality::Valid), (5, Quality::Saturated)] {
            let mut block = block(60.0, GapBlock::ALL);
            block.codes[..clipped].fill(rail);
            let reading = source(Config { clipped_share: 0.2, ..Config::default() }).update(Some(&block));
            assert_eq!(reading.quality, quality, "{clipped} of 25 at {rail}");
        }
    }
}

#[test]
fn clipping_in_off_time_spoils_only_the_plain_average() {
    let mut block = block(60.0, 0xFFF);
    block.codes[12..].fill(4095);
    for (average, quality) in [(Average::Gated, Quality::Valid), (Average::Plain, Quality::Saturated)] {
        assert_eq!(source(Config { average, ..Config::default() }).update(Some(&block)).quality, quality);
    }
}

#[test]
fn swapped_leads_are_told_from_noise_around_zero() {
    for (volts, quality) in [(-19.9, Quality::Valid), (-20.1, Quality::Reversed), (-100.0, Quality::Reversed)] {
        let reading = run(&mut source(Config::default()), Some(block(volts, GapBlock::ALL >> 3)), 100);
        assert_eq!(reading.quality, quality, "{volts} V");
    }
}

#[test]
fn an_input_that_is_at_the_end_of_its_range_in_off_time_too_is_dead_and_not_swapped() {
    let dead = GapBlock { codes: [0; BLOCK], gate: GapBlock::ALL >> 3, ..GapBlock::EMPTY };
    assert_eq!(run(&mut source(Config::default()), Some(dead), 100).quality, Quality::Saturated);
}

#[test]
fn other_settings_move_the_reading_smoothly_from_where_it_is() {
    let before = Config::default();
    let filter = |corner| chain::Config { corner: Hertz(corner), ..chain::Config::default() };
    let cases = [
        (Config { volts_per_code: 0.05, ..before }, 30.0),
        (Config { zero_code: 510, ..before }, 50.0),
        (Config { polarity: Polarity::Negative, ..before }, -60.0),
        (Config { filter: filter(20.0), ..before }, 60.0),
        (Config { filter: filter(2000.0), ..before }, 60.0),
    ];
    for (after, end) in cases {
        let mut source = source(before);
        let on = block(60.0, 0xFFFF);
        run(&mut source, Some(on), SETTLED);
        source.retune(after.build().unwrap());
        assert_near(run(&mut source, Some(on), 1).filtered, 60.0, 0.01);
        assert_near(run(&mut source, Some(on), SETTLED).filtered, end, 0.01);
    }
}

#[test]
fn another_average_takes_over_without_a_step_and_takes_the_open_circuit_along() {
    // 5 kHz: 160 us at 70 V, 40 us of pause.
    let pulses = [GapBlock::ALL, GapBlock::ALL, GapBlock::ALL, 0b11111].map(|gate| block(70.0, gate));
    let (gated, plain) = (Config::default(), Config { average: Average::Plain, ..Config::default() });
    for (from, to, begin, end) in [(gated, plain, 70.0, 56.0), (plain, gated, 56.0, 70.0)] {
        let mut source = source(from);
        let mut train = pulses.iter().cycle();
        let mut next = |source: &mut Voltage| source.update(train.next());
        (0..SETTLED).for_each(|_| {
            next(&mut source);
        });
        assert_near(next(&mut source).mean, begin, 0.5);
        source.retune(to.build().unwrap());
        let mut last = next(&mut source);
        for _ in 0..2 * SETTLED {
            let reading = next(&mut source);
            // 14 V in half a second: 0.03 V a millisecond at the steepest, and what is left of the pulses in the plain average.
            assert!(
                (reading.filtered.0 - last.filtered.0).abs() < 0.01,
                "{} V, {} V",
                last.filtered.0,
                reading.filtered.0
            );
            last = reading;
        }
        assert_near(last.filtered, end, 0.05);
        assert!((1.0 + last.regauged - end / begin).abs() < 2e-3, "{last:?}");
    }
}

#[test]
fn without_pulses_another_average_is_read_at_once() {
    let mut source = source(Config::default());
    run(&mut source, Some(block(60.0, GapBlock::ALL)), SETTLED);
    let mut idle = block(0.0, 0);
    idle.codes = block(30.0, GapBlock::ALL).codes;
    run(&mut source, Some(idle), 100);
    source.retune(Config { average: Average::Plain, ..Config::default() }.build().unwrap());
    let reading = source.update(Some(&idle));
    assert_near(reading.block, 30.0, 0.01);
    assert_eq!((reading.quality, reading.regauged), (Quality::Valid, 0.0));
}

#[test]
fn a_setting_out_of_range_is_named() {
    let ok = Config::default();
    let bad = [
        (Config { volts_per_code: 0.0, ..ok }, "volts per code"),
        (Config { volts_per_code: f32::NAN, ..ok }, "volts per code"),
        (Config { zero_code: 4095, ..ok }, "code at 0 V"),
        (Config { good: CodeRange { lowest: 411, highest: 4094 }, ..ok }, "code at 0 V"),
        (Config { good: CodeRange { lowest: 1, highest: 4096 }, ..ok }, "highest good code"),
        (Config { good: CodeRange { lowest: 3000, highest: 2500 }, ..ok }, "lowest good code"),
        (Config { short: Volts(0.5), ..ok }, "short threshold (V)"),
        (Config { reversed: Volts(f32::INFINITY), ..ok }, "reversed threshold (V)"),
        (Config { hold_limit: Seconds(0.0), ..ok }, "hold limit (s)"),
        (Config { min_gated: 0, ..ok }, "fewest gated conversions"),
        (Config { min_gated: 26, ..ok }, "fewest gated conversions"),
        (Config { clipped_share: 0.0, ..ok }, "clipped share"),
        (Config { transfer: Seconds(0.0), ..ok }, "transfer (s)"),
        (Config { filter: chain::Config { corner: Hertz(10.0), ..ok.filter }, ..ok }, "low-pass corner (Hz)"),
    ];
    for (config, name) in bad {
        assert_eq!(config.build().unwrap_err().name, name);
    }
    let reads_0_v_as_0 = Config { zero_code: 0, good: CodeRange { lowest: 0, highest: 4094 }, ..ok };
    assert!(reads_0_v_as_0.build().is_ok());
}

#[derive(Clone, Debug)]
enum Event {
    Block([u16; BLOCK], u32),
    Nothing,
    Retune(bool, bool, u16, f32, f32),
}

fn event() -> impl Strategy<Value = Event> {
    prop_oneof![
        8 => (any::<[u16; BLOCK]>(), any::<u32>()).prop_map(|(codes, gate)| Event::Block(codes, gate)),
        1 => Just(Event::Nothing),
        1 => (any::<bool>(), any::<bool>(), 1..4095_u16, 0.001_f32..=1.0, 20.0_f32..=2000.0)
            .prop_map(|(plain, negative, zero, scale, corner)| Event::Retune(plain, negative, zero, scale, corner)),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_sequence_of_codes_gates_and_settings_makes_a_reading_that_is_no_number(
        events in prop::collection::vec(event(), 1..300),
    ) {
        let mut source = source(Config::default());
        for event in events {
            let reading = match event {
                Event::Block(codes, gate) => source.update(Some(&GapBlock { codes, gate, ..GapBlock::EMPTY })),
                Event::Nothing => source.update(None),
                Event::Retune(plain, negative, zero_code, volts_per_code, corner) => {
                    let config = Config {
                        average: if plain { Average::Plain } else { Average::Gated },
                        polarity: if negative { Polarity::Negative } else { Polarity::Positive },
                        zero_code,
                        volts_per_code,
                        filter: chain::Config { corner: Hertz(corner), ..chain::Config::default() },
                        ..Config::default()
                    };
                    source.retune(config.build().unwrap());
                    source.update(None)
                }
            };
            prop_assert!(reading.filtered.0.abs() < 1e6 && reading.block.0.abs() < 1e6, "{reading:?}");
        }
    }
}
