use super::*;
use crate::millisecond::Span;
use std::f64::consts::TAU;

fn span(x: f64) -> Span {
    Span { mean: x, min: x, max: x }
}

/// Quiet eroding at the setpoint of 55 V, feeding at 3 um/s behind a gap of 40 um.
fn quiet(ms: u32) -> Millisecond {
    let t_s = f64::from(ms) / 1000.0;
    Millisecond {
        position_um: span(3.0 * t_s),
        surface_um: 3.0 * t_s + 40.0,
        gap_um: span(40.0),
        gap_v: span(55.0),
        filtered_v: span(55.0),
        filtered_square: 55.0 * 55.0,
        setpoint_v: 55.0,
        duty: span(-0.1),
        debris: 0.5,
        damage: 0.25,
        ..Millisecond::new(t_s)
    }
}

fn figures(seconds: u32, change: impl Fn(u32, &mut Millisecond)) -> Figures {
    let mut statistics = Statistics::new();
    for i in 0..seconds * 1000 {
        let mut ms = quiet(i);
        change(i, &mut ms);
        statistics.add(&ms);
    }
    statistics.figures()
}

fn near(value: Option<f64>, expected: f64, tolerance: f64) {
    assert!(value.is_some_and(|value| (value - expected).abs() <= tolerance), "{value:?}, not {expected}");
}

#[test]
fn a_quiet_run_has_no_error_and_no_motion_but_its_feed() {
    let f = figures(10, |_, _| {});
    near(f.gap_v_mean, 55.0, 1e-9);
    near(f.setpoint_v, 55.0, 1e-9);
    near(f.gap_v_rms_error, 0.0, 1e-9);
    near(f.filtered_v_rms, 0.0, 1e-4);
    near(f.gap_um_mean, 40.0, 1e-9);
    near(f.gap_um_rms, 0.0, 1e-4);
    near(f.position_pp_um, 0.0, 1e-9);
    near(f.line.map(|line| line.amplitude_um), 0.0, 1e-9);
    assert_eq!(f.long_retreats, 0);
}

#[test]
fn the_means_see_slow_error_and_not_what_averages_out_within_100_ms() {
    let swing = |hz: f64| {
        figures(12, move |i, ms| {
            ms.gap_v = span(55.0 + 4.0 * (TAU * hz * f64::from(i) / 1000.0).sin());
            let filtered = 55.0 + 2.0 * (TAU * hz * f64::from(i) / 1000.0).sin();
            (ms.filtered_v, ms.filtered_square) = (span(filtered), filtered * filtered);
        })
    };
    near(swing(50.0).gap_v_rms_error, 0.0, 1e-9);
    near(swing(1.0).gap_v_rms_error, 4.0 / 2f64.sqrt(), 0.1);
    near(swing(50.0).filtered_v_rms, 2.0 / 2f64.sqrt(), 0.01);
    near(figures(5, |_, ms| ms.gap_v = span(57.0)).gap_v_rms_error, 2.0, 1e-9);
}

#[test]
fn the_first_two_seconds_of_eroding_are_not_judged() {
    let disturbed = |until: u32| figures(6, move |i, ms| ms.gap_v = span(if i < until { 90.0 } else { 55.0 }));
    near(disturbed(2000).gap_v_rms_error, 0.0, 1e-9);
    assert!(disturbed(2001).gap_v_rms_error.unwrap() > 0.0);
    assert_eq!(
        figures(2, |_, _| {}),
        Figures {
            eroding_s: 2.0,
            machining_s: 2.0,
            debris: Some(0.5),
            damage: Some(0.25),
            short_cycle_ratio: Some(0.0),
            ..Figures::default()
        }
    );
}

#[test]
fn a_retreat_and_the_settling_after_it_are_not_judged() {
    let disturbed = |until: u32| {
        figures(8, move |i, ms| {
            if i == 4990 {
                ms.phase = Phase::Retreating;
            }
            if (4980..until).contains(&i) {
                ms.gap_v = span(10.0);
                ms.gap_um = span(0.0);
                ms.position_um = span(-100.0);
            }
        })
    };
    let settled = 4991 + SETTLE_MS;
    let clean = disturbed(settled);
    near(clean.gap_um_mean, 40.0, 1e-9);
    near(clean.position_pp_um, 0.0, 1e-9);
    assert!(clean.gap_v_rms_error.is_some_and(|error| error < 1e-9), "{clean:?}");
    assert!(disturbed(settled + 1).gap_v_rms_error.unwrap() > 0.0);
}

#[test]
fn without_eroding_nothing_is_judged() {
    for phase in [Phase::Idle, Phase::Seeking, Phase::Retreating, Phase::Fault] {
        // A retreat belongs to the servo cycles of [G], and to the machining.
        let short_cycle_ratio = (phase == Phase::Retreating).then_some(0.0);
        let machining_s = if phase == Phase::Retreating { 5.0 } else { 0.0 };
        let expected = Figures { short_cycle_ratio, machining_s, ..Figures::default() };
        assert_eq!(figures(5, |_, ms| ms.phase = phase), expected);
    }
}

#[test]
fn the_swing_of_the_electrode_is_taken_between_extremes_and_without_the_feed() {
    let f = figures(10, |i, ms| {
        // A cosine over whole periods is symmetric and has no trend of its own.
        let swing = 5.0 * (TAU * 20.0 * f64::from(i) / 1000.0).cos();
        let centre = ms.position_um.mean + swing;
        ms.position_um = Span { mean: centre, min: centre - 0.5, max: centre + 0.5 };
    });
    near(f.position_pp_um, 11.0, 0.1);
    near(f.line.map(|line| line.amplitude_um), 5.0, 0.06);
    near(f.line.map(|line| line.hz), 20.0, 0.1);
}

#[test]
fn the_median_lies_in_the_middle() {
    assert_eq!(median(vec![]), None);
    assert_eq!(median(vec![3.0, 1.0, 2.0]), Some(2.0));
    assert_eq!(median(vec![4.0, 1.0, 2.0, 3.0]), Some(2.5));
}

/// Long retreats along positions that are joined by straight motion: (time in ms, um).
fn long_retreats(points: &[(u32, f64)], phase: Phase) -> u64 {
    let mut retreats = Retreats::default();
    for pair in points.windows(2) {
        let ((from, a), (to, b)) = (pair[0], pair[1]);
        for i in from..to {
            let x = a + (b - a) * f64::from(i - from) / f64::from(to - from);
            retreats.add(&Millisecond { phase, position_um: span(x), ..quiet(i) });
        }
    }
    retreats.count()
}

#[test]
fn a_retreat_is_long_beyond_five_micrometres() {
    for (length, count) in [(4.9, 0), (5.2, 1), (300.0, 1)] {
        let points = [(0, 0.0), (100, 10.0), (150, 10.0 - length), (200, 20.0)];
        assert_eq!(long_retreats(&points, Phase::Eroding), count, "{length} um");
        assert_eq!(long_retreats(&points, Phase::Retreating), count, "{length} um");
        assert_eq!(long_retreats(&points, Phase::Idle), 0, "{length} um");
    }
}

#[test]
fn forward_motion_below_one_micrometre_does_not_break_a_retreat_and_more_does() {
    let broken_by = |back: f64| [(0, 10.0), (20, 6.0), (40, 6.0 + back), (60, 2.0 + back), (80, 20.0)];
    assert_eq!(long_retreats(&broken_by(0.8), Phase::Eroding), 1);
    assert_eq!(long_retreats(&broken_by(1.5), Phase::Eroding), 0);
}

#[test]
fn a_pause_of_a_servo_cycle_ends_a_retreat() {
    let pausing = |ms: u32| [(0, 10.0), (20, 6.0), (20 + ms, 6.0), (40 + ms, 3.0), (100 + ms, 20.0)];
    assert_eq!(long_retreats(&pausing(60), Phase::Eroding), 1);
    assert_eq!(long_retreats(&pausing(120), Phase::Eroding), 0);
}

#[test]
fn creeping_back_slower_than_a_step_a_cycle_is_no_retreat() {
    assert_eq!(long_retreats(&[(0, 10.0), (500, 0.0), (600, 20.0)], Phase::Eroding), 1);
    assert_eq!(long_retreats(&[(0, 10.0), (2000, 0.0), (2100, 20.0)], Phase::Eroding), 0);
}

#[test]
fn each_long_retreat_counts_once() {
    let points = [(0, 0.0), (50, 10.0), (80, 0.0), (150, 20.0), (180, 5.0), (300, 30.0), (310, 27.0), (400, 40.0)];
    assert_eq!(long_retreats(&points, Phase::Eroding), 2);
}

#[test]
fn vibration_and_a_duty_at_its_limit_are_judged_with_the_voltage() {
    let f = figures(10, |i, ms| {
        ms.vibration_square = if i < 1999 { 9e9 } else { 500.0 * 500.0 };
        ms.duty = Span { mean: 0.1, min: if i % 4 == 0 { -0.9 } else { -0.2 }, max: 0.3 };
    });
    near(f.vibration_mm_s, 0.5, 1e-9);
    near(f.duty.at_limit(0.9), 0.25, 1e-9);
    near(f.duty.at_limit(0.91), 0.0, 1e-9);
    near(f.duty.at_limit(0.2), 1.0, 1e-9);
    assert_eq!(figures(1, |_, _| {}).duty.at_limit(0.9), None);
}

#[test]
fn the_time_of_eroding_is_neither_seek_nor_retreat() {
    let f = figures(10, |i, ms| {
        ms.phase = match i {
            0..3000 => Phase::Seeking,
            8000..9000 => Phase::Retreating,
            _ => Phase::Eroding,
        }
    });
    assert!((f.eroding_s - 6.0).abs() < 1e-9);
}

#[test]
fn machining_lasts_from_the_first_pulse_to_the_last_retreats_and_jumps_included_and_seeks_not() {
    let phase = |i: u32| match i / 1000 {
        0 | 5 => Phase::Seeking,
        1 | 4 => Phase::Retreating,
        2 | 6 | 8 => Phase::Eroding,
        // A hold, a jump, and at the end the lift.
        _ => Phase::Idle,
    };
    let f = figures(10, |i, ms| ms.phase = phase(i));
    assert_eq!((f.eroding_s, f.machining_s), (3.0, 7.0));
}
