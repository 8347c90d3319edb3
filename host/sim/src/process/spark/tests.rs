use super::*;

const TICK: f64 = 50.0;

/// What a constant gap gives.
struct Run {
    /// Mean gated voltage.
    volts: f64,
    /// Share of the pulses.
    open: f64,
    arc: f64,
    short: f64,
    /// mm/min.
    removal: f64,
    spark: Spark,
}

fn go(spark: &mut Spark, ticks: std::ops::Range<u64>, gap_um: f64, mut see: impl FnMut(&Spark, f64, f64)) {
    for tick in ticks {
        let from = tick as f64 * TICK;
        spark.advance(from, from + TICK, (gap_um, gap_um), true);
        see(spark, from, from + TICK);
    }
}

fn at(p: &Parameters, gap_um: f64, seconds: f64) -> Run {
    run(Spark::new(p, 1), gap_um, seconds)
}

fn run(mut spark: Spark, gap_um: f64, seconds: f64) -> Run {
    let (mut area, mut time) = (0.0, 0.0);
    go(&mut spark, 0..(seconds * 20_000.0) as u64, gap_um, |spark, from, to| {
        for (k, stretch) in spark.stretches.iter().enumerate() {
            let end = spark.stretches.get(k + 1).map_or(to, |next| next.from);
            if stretch.gate.1 > stretch.gate.0 {
                area += stretch.volts * (end - stretch.from.max(from));
                time += end - stretch.from.max(from);
            }
        }
    });
    let Pulses { open, arc, short, .. } = spark.pulses;
    let share = |pulses: u64| pulses as f64 / spark.pulses.total() as f64;
    Run {
        volts: area / time,
        open: share(open),
        arc: share(arc),
        short: share(short),
        removal: spark.removed_um * 0.06 / seconds,
        spark,
    }
}

/// Nothing but ignition.
fn clean() -> Parameters {
    Parameters { arc_chance: 0.0, bridge_chance: 0.0, ignition_debris: 0.0, burn_scatter: 0.0, ..Parameters::default() }
}

fn khz100() -> Parameters {
    Parameters {
        on: 8.02,
        off: 2.005,
        flush: 0.15,
        peaks: 1.5,
        bridge_chance: 2.5e-6,
        arc_recovery: 1.0,
        ..Parameters::default()
    }
}

fn khz1() -> Parameters {
    Parameters { on: 800.0, off: 200.0, arc_recovery: 100.0, ..Parameters::default() }
}

#[test]
fn the_ignition_delay_is_exponential_with_the_mean_of_its_formula() {
    // Median 0.1 (0.48 40^2 - 3.69 40 + 14.05) us; an on-time that every pulse outlasts.
    let mean = 0.1 * (768.0 - 147.6 + 14.05) / LN_2;
    let mut spark = Spark::new(&Parameters { on: 5000.0, ..clean() }, 1);
    let mut delays = Vec::new();
    go(&mut spark, 0..400_000, 40.0, |spark, from, _| {
        let burning = |s: &&Stretch| s.volts == 40.0 && s.from >= from;
        delays.extend(spark.stretches.iter().filter(burning).map(|s| s.from - s.gate.0));
    });
    let n = delays.len() as f64;
    let first: f64 = delays.iter().sum::<f64>() / n;
    let second: f64 = delays.iter().map(|delay| delay * delay).sum::<f64>() / n;
    assert!(n > 3900.0);
    assert!((first / mean - 1.0).abs() < 0.05, "{first} {mean}");
    // An exponential scatters as much as its mean.
    assert!(((second - first * first).sqrt() / mean - 1.0).abs() < 0.08, "{second}");
}

#[test]
fn pulses_stay_open_as_often_as_the_delay_outlasts_the_on_time() {
    for gap in [25.0, 40.0, 60.0] {
        let run = at(&clean(), gap, 4.0);
        let expected = (-160.0 / mean_delay_us(0.1, gap)).exp();
        assert!((run.open - expected).abs() < 0.01, "{gap}: {} {expected}", run.open);
        assert_eq!((run.arc, run.short), (0.0, 0.0));
    }
}

#[test]
fn the_delay_never_grows_as_the_gap_closes() {
    assert!((0..2000).map(|k| mean_delay_us(0.1, f64::from(k) * 0.1)).is_sorted());
    assert_eq!(mean_delay_us(0.1, 0.0), mean_delay_us(0.1, 3.84));
    assert!(mean_delay_us(0.1, 4.5) > mean_delay_us(0.1, 3.84));
}

#[test]
fn a_gap_that_closes_while_the_pulse_waits_counts_as_it_closes() {
    let mut spark = Spark::new(&Parameters { on: 5000.0, ..clean() }, 1);
    go(&mut spark, 0..50, 140.0, |_, _, _| ());
    assert_eq!(spark.pulses, Pulses::default(), "the first pulse ignited too early for this seed");
    go(&mut spark, 50..60, 10.0, |_, _, _| ());
    assert_eq!(spark.pulses.spark, 1);
}

#[test]
fn nothing_ignites_beyond_the_reach() {
    let p = Parameters::default();
    assert!(at(&p, 149.0, 1.0).spark.pulses.spark > 100);
    assert_eq!(at(&p, 151.0, 1.0).spark.pulses, Pulses { open: 5000, ..Pulses::default() });
}

#[test]
fn debris_shortens_the_delay() {
    let volts = |debris| {
        let mut spark = Spark::new(&Parameters::default(), 1);
        spark.hold(debris);
        run(spark, 35.0, 2.0).volts
    };
    assert!(
        volts(0.0) - volts(1.0) > 2.0 && volts(1.0) - volts(4.0) > 2.0,
        "{} {} {}",
        volts(0.0),
        volts(1.0),
        volts(4.0)
    );
}

#[test]
fn the_gated_voltage_falls_as_the_gap_closes_between_open_circuit_and_short() {
    for (p, gaps) in [
        (Parameters::default(), [90.0, 60.0, 40.0, 30.0, 20.0, 6.0, 3.0]),
        (khz100(), [30.0, 15.0, 11.0, 9.0, 7.0, 3.0, 2.0]),
        (khz1(), [140.0, 100.0, 80.0, 60.0, 40.0, 6.0, 3.0]),
    ] {
        let volts = gaps.map(|gap| at(&p, gap, 4.0).volts);
        assert!(volts.windows(2).all(|pair| pair[0] > pair[1] + 1.0), "{volts:?}");
        assert!(volts[0] > 80.0 && volts[0] < 100.0 && volts[6] < 30.0, "{volts:?}");
    }
}

#[test]
fn sixty_volts_are_a_gap_of_35_um_at_5_khz_10_um_at_100_khz_and_70_um_at_1_khz() {
    for (p, gap) in [(Parameters::default(), 35.0), (khz100(), 10.0), (khz1(), 70.0)] {
        let (closer, wider) = (at(&p, 0.92 * gap, 8.0).volts, at(&p, 1.08 * gap, 8.0).volts);
        assert!(closer < 60.0 && wider > 60.0, "{gap} um: {closer} {wider}");
    }
}

#[test]
fn at_60_v_the_work_recedes_by_0_2_mm_a_minute_under_mostly_sparks() {
    let run = at(&Parameters::default(), 35.0, 20.0);
    assert!((run.volts - 60.0).abs() < 1.5, "{}", run.volts);
    assert!((0.15..0.25).contains(&run.removal), "{}", run.removal);
    let sparks = 1.0 - run.open - run.arc - run.short;
    assert!((0.90..0.97).contains(&sparks), "{sparks}");
    assert!((0.7..1.3).contains(&run.spark.debris.concentration()));
    // The electrode wears by its share.
    assert!((run.spark.wear_um / run.spark.removed_um - 0.0005).abs() < 1e-6);
}

#[test]
fn removal_follows_the_time_of_burning() {
    // All pulses ignite at once: 80 % of the time at 6.25 um/s.
    let run = at(&Parameters { ignition_scale: 0.001, ..clean() }, 20.0, 4.0);
    assert!((run.removal / (0.8 * 6.25 * 0.06) - 1.0).abs() < 0.01, "{}", run.removal);
}

#[test]
fn a_closed_gap_shorts_every_pulse_and_removes_nothing() {
    let run = at(&Parameters::default(), 0.0, 0.1);
    assert_eq!(run.volts, SHORT_V);
    assert_eq!(run.spark.pulses, Pulses { short: 500, ..Pulses::default() });
    assert_eq!(run.spark.removed_um, 0.0);
}

#[test]
fn touch_ends_a_burning_pulse_at_once() {
    let mut spark = Spark::new(&Parameters { on: 5000.0, ..clean() }, 1);
    go(&mut spark, 0..20, 10.0, |_, _, _| ());
    assert!(matches!(spark.phase, Phase::Burning { .. }));
    assert_eq!(spark.removed_um, 0.0);
    go(&mut spark, 20..21, -1.0, |_, _, _| ());
    assert_eq!(spark.stretches.last().map(|s| (s.from, s.volts)), Some((1000.0, SHORT_V)));
    // What burned until then counts: 1 ms less the delay.
    assert!((0.9 * 6.25e-3..6.25e-3).contains(&spark.removed_um), "{}", spark.removed_um);
    // A spark that ends in a short stays a spark.
    assert_eq!(spark.pulses, Pulses { spark: 1, ..Pulses::default() });
}

#[test]
fn peaks_touch_in_narrow_gaps_only() {
    let p = Parameters { bridge_chance: 0.0, ..Parameters::default() };
    let shorts = [3.0, 6.0, 8.0, 15.0].map(|gap| at(&p, gap, 4.0).short);
    assert!(shorts[0] > 0.5 && shorts[1] > shorts[2] && shorts[2] > 0.0, "{shorts:?}");
    assert_eq!(shorts[3], 0.0);
}

#[test]
fn bridges_are_an_occasion_in_a_clean_gap_and_a_habit_in_a_dirty_one() {
    let bridges = |p: &Parameters| {
        let (mut count, mut was) = (0, false);
        let mut spark = Spark::new(p, 1);
        go(&mut spark, 0..40 * 20_000, 35.0, |spark, _, _| {
            let is = spark.stretches.last().is_some_and(|s| s.volts == SHORT_V);
            let off = spark.stretches.last().is_some_and(|s| s.gate.0 == s.gate.1);
            count += u32::from(is && !was);
            was = if off { was && spark.bridge.is_some() } else { is };
        });
        count
    };
    let (clean, dirty) =
        (bridges(&Parameters::default()), bridges(&Parameters { flush: 1.5, ..Parameters::default() }));
    assert!((4..20).contains(&clean), "{clean} in 40 s");
    assert!(dirty > 4 * clean, "{dirty} in 40 s");
}

#[test]
fn a_bridge_lasts_for_milliseconds_or_until_the_gap_has_opened() {
    // Peaks of 50 um bridge at once; it then lasts for ever, or breaks.
    let p = Parameters { peaks: 50.0, bridge_ms: 10_000.0, ..Parameters::default() };
    let shorts = |retreat: f64| {
        let mut spark = Spark::new(&p, 1);
        go(&mut spark, 0..200, 10.0, |_, _, _| ());
        let before = spark.pulses.short;
        assert!(before > 10);
        go(&mut spark, 200..400, 10.0 + retreat, |_, _, _| ());
        spark.pulses.short - before
    };
    assert_eq!(shorts(0.0), 50);
    assert_eq!(shorts(500.0), 0);
    let lasting =
        |bridge_ms| at(&Parameters { bridge_ms, bridge_um: 1000.0, ..Parameters::default() }, 35.0, 40.0).short;
    assert!(lasting(50.0) > 4.0 * lasting(5.0), "{} {}", lasting(50.0), lasting(5.0));
}

#[test]
fn arcs_follow_dirt_and_short_off_times_and_come_in_runs() {
    let p = Parameters { bridge_chance: 0.0, ..Parameters::default() };
    let arcs = |p: &Parameters| at(p, 35.0, 20.0).arc;
    let usual = arcs(&p);
    assert!((0.001..0.01).contains(&usual), "{usual}");
    assert!(arcs(&Parameters { flush: 2.0, ..p }) > 2.0 * usual);
    assert!(arcs(&Parameters { off: 80.0, ..p }) < 0.3 * usual);
    assert!(arcs(&Parameters { arc_repeats: 0.0, ..p }) < 0.8 * usual);
    assert_eq!(arcs(&Parameters { arc_chance: 0.0, ..p }), 0.0);
}

#[test]
fn an_arc_burns_lower_from_the_start_and_removes_a_tenth() {
    let p = Parameters { burn_scatter: 0.0, bridge_chance: 0.0, ..Parameters::default() };
    let mut spark = Spark::new(&p, 1);
    let mut arcs = 0;
    go(&mut spark, 0..400_000, 30.0, |spark, from, _| {
        for arc in spark.stretches.iter().filter(|s| s.volts == 30.0 && s.from >= from) {
            assert_eq!(arc.from, arc.gate.0);
            arcs += 1;
        }
    });
    assert!(arcs > 50 && arcs == spark.pulses.arc);
    let all =
        at(&Parameters { arc_chance: 1.0, arc_recovery: 1000.0, arc_repeats: 0.99, flush: 10.0, ..p }, 30.0, 20.0);
    assert!(all.arc > 0.8 && all.removal < 0.1, "{} {}", all.arc, all.removal);
}

#[test]
fn held_it_makes_nothing_but_open_pulses_and_sparks() {
    let mut spark = Spark::new(&Parameters { bridge_chance: 1e-2, ..Parameters::default() }, 1);
    spark.hold(1.0);
    let run = run(spark, 3.0, 2.0);
    assert_eq!((run.arc, run.short, run.removal), (0.0, 0.0, 0.0));
    assert_eq!(run.spark.debris.concentration(), 1.0);
}

#[test]
fn the_head_cuts_a_pulse_off_and_none_begins_until_it_allows_them() {
    let mut spark = Spark::new(&clean(), 1);
    go(&mut spark, 0..2, 151.0, |_, _, _| ());
    spark.advance(100.0, 150.0, (151.0, 151.0), false);
    // What is left is the sense supply.
    assert_eq!(
        spark.stretches.last().map(|s| (s.from, s.volts, s.gate)),
        Some((100.0, 11.1f32.into(), (100.0, 100.0)))
    );
    for tick in 3..100 {
        let from = f64::from(tick) * TICK;
        spark.advance(from, from + TICK, (151.0, 151.0), false);
        assert_eq!(spark.stretches.len(), 1);
    }
    assert_eq!(spark.pulses, Pulses::default());
    spark.advance(5000.0, 5050.0, (151.0, 151.0), true);
    assert_eq!(spark.stretches.last().map(|s| (s.from, s.gate)), Some((5000.0, (5000.0, 5160.0))));
}

#[test]
fn a_generator_that_suspends_itself_pulses_less_after_shorts() {
    let p = Parameters { suspend_after: 5, ..Parameters::default() };
    // Five pulses of 200 us and 5 ms of rest, less the last off-time.
    let shorts = at(&p, 0.0, 1.0).spark.pulses.short;
    assert!((835..=845).contains(&shorts), "{shorts}");
}

#[test]
fn the_voltage_has_no_steps() {
    let mut spark = Spark::new(&khz100(), 1);
    let mut before: Option<Stretch> = None;
    go(&mut spark, 0..2000, 9.0, |spark, _, _| {
        for now in &spark.stretches {
            if let Some(before) = before {
                assert!((before.at(now.from) - now.at(now.from)).abs() < 0.1, "{before:?} {now:?}");
            }
            before = Some(*now);
        }
    });
}

#[test]
fn swapped_leads_turn_every_voltage_round() {
    let p = Parameters { gap_reversed: true, ..Parameters::default() };
    let (usual, swapped) = (at(&Parameters::default(), 35.0, 1.0), at(&p, 35.0, 1.0));
    assert!((usual.volts + swapped.volts).abs() < 1e-9);
    assert_eq!(usual.spark.pulses, swapped.spark.pulses);
}

#[test]
fn an_edge_fades_as_the_exponential_function() {
    for k in 0..=800 {
        let x = f64::from(k) * 0.01;
        assert!((fade(x) - (-x).exp()).abs() < 1e-9, "{x}");
    }
}
