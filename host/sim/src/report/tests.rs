use super::*;
use crate::process::Pulses;
use crate::run::Setup;
use crate::statistics;

fn job() -> Job {
    Job {
        setup: Setup::load("default").unwrap(),
        depth_mm: 0.5,
        path: None,
        table: None,
        seed: 7,
        surrogate: false,
        coarse_error_um: 0.0,
    }
}

fn outcome() -> Outcome {
    Outcome {
        completed: true,
        stop_reason: "depth reached".into(),
        depth_mm: 0.500_000_4,
        hole_depth_mm: 0.538_2,
        wear_mm: 0.002,
        through: 0.0,
        sim_time_s: 151.0,
        shot_floor_rms_v: Some(3.7),
        pulses: Pulses { open: 350, spark: 620, arc: 10, short: 20, stable_arc: 0 },
        crater_um: 12.5,
        pit_um: 1.25,
        removed_mm3: 3.8,
        lost_counts: 0,
        illegal_transitions: 0,
        inches: 0,
        carried_mm: 0.0,
        jumps: 0,
        cramped: false,
        rows: vec![],
        faults: vec![],
    }
}

fn figures() -> Figures {
    Figures {
        gap_v_mean: Some(55.1),
        setpoint_v: Some(55.0),
        gap_v_rms_error: Some(0.8),
        filtered_v_rms: Some(4.0),
        gap_um_mean: Some(38.2),
        gap_um_rms: Some(3.1),
        position_pp_um: Some(4.2),
        line: Some(statistics::Line { amplitude_um: 0.6, hz: 7.2 }),
        long_retreats: 2,
        short_cycle_ratio: Some(0.02),
        shorts: 4,
        long_retreats_shorted: 1,
        velocity_mm_s: Some(0.25),
        vibration_mm_s: Some(0.21),
        duty: statistics::Duty::default(),
        eroding_s: 145.0,
        machining_s: 147.5,
        debris: Some(0.9),
        damage: Some(0.04),
        contact_n: 0.25,
        film_n: 3.5,
    }
}

#[test]
fn the_json_has_exactly_these_keys_in_this_order() {
    let json = serde_json::to_string(&Report::new(&job(), &outcome(), &figures(), 2.0)).unwrap();
    assert_eq!(
        json,
        "{\"schema\":\"edm-sim.bore/1\",\"scenario\":\"default\",\"seed\":7,\"completed\":true,\
         \"stop_reason\":\"depth reached\",\"depth_mm\":0.5,\"hole_depth_mm\":0.5382,\"wear_mm\":0.002,\"through_ratio\":0.0,\"target_depth_mm\":0.5,\"sim_time_s\":151.0,\
         \"eroding_time_s\":145.0,\"machining_time_s\":147.5,\"rate_mm_min\":0.222703,\
         \"wall_time_s\":2.0,\"gap_voltage_v\":{\"mean\":55.1,\"setpoint\":55.0,\"rms_error_100ms\":0.8,\"filtered_rms\":4.0,\
         \"shot_floor_rms\":3.7},\"gap_um\":{\"mean\":38.2,\"rms_error\":3.1},\"position_pp_um_median\":4.2,\
         \"position_line_um\":{\"amplitude\":0.6,\"hz\":7.2},\"vibration_mm_s\":0.21,\"velocity_mm_s\":0.25,\"duty_at_limit_ratio\":null,\"open_ratio\":0.35,\"spark_ratio\":0.62,\
         \"arc_ratio\":0.01,\"short_ratio\":0.02,\"discharges\":630,\"long_retreats\":2,\"short_cycle_ratio\":0.02,\"shorts\":4,\"long_retreats_shorted\":1,\"removal_mm3_min\":1.572414,\"crater_um\":12.5,\"debris_mean\":0.9,\"damage_mean\":0.04,\"pit_um\":1.25,\"contact_n_max\":0.25,\"film_n_max\":3.5,\"lost_counts\":0,\
         \"illegal_transitions\":0,\"jumps\":0,\"jumps_cramped\":false,\"inches\":0,\"carried_mm\":0.0,\"faults\":[],\"findings\":[]}"
    );
}

#[test]
fn what_was_not_judged_is_null_and_what_is_no_number_does_not_reach_the_json() {
    let outcome = Outcome { pulses: Pulses::default(), shot_floor_rms_v: Some(f64::NAN), ..outcome() };
    let report = Report::new(&job(), &outcome, &Figures::default(), 2.0);
    let json = serde_json::to_value(&report).unwrap();
    assert_eq!(json["gap_voltage_v"]["mean"], serde_json::Value::Null);
    assert_eq!(json["gap_voltage_v"]["shot_floor_rms"], serde_json::Value::Null);
    assert_eq!(json["position_line_um"]["hz"], serde_json::Value::Null);
    assert_eq!(json["spark_ratio"], serde_json::Value::Null);
    assert_eq!(json["long_retreats"], 0);
}

#[test]
fn a_fault_is_reported_with_its_time() {
    let faults = vec![FaultEvent { t_s: 12.5, fault: "following error".into() }];
    let outcome = Outcome { completed: false, stop_reason: "following error".into(), faults, ..outcome() };
    let report = Report::new(&job(), &outcome, &figures(), 2.0);
    let json = serde_json::to_value(&report).unwrap();
    assert_eq!(json["faults"], serde_json::json!([{ "t_s": 12.5, "fault": "following error" }]));
    let text = Summary { report: &report }.to_string();
    assert!(
        text.contains("Electrode    0.500 mm deep, 0.002 mm worn, 0.500 mm requested, stopped: following error"),
        "{text}"
    );
    assert!(text.contains("following error at 12.5 s"), "{text}");
    assert!(text.contains("Verdict      stopped: following error") && !text.contains("steady"), "{text}");
}

#[test]
fn the_summary_has_the_figures_of_the_run() {
    let report = Report::new(&job(), &outcome(), &figures(), 2.0);
    assert_eq!(
        Summary { report: &report }.to_string(),
        "  Hole         0.538 mm deep (simulated)\n\
        \x20 Electrode    0.500 mm deep, 0.002 mm worn, 0.500 mm requested\n\
        \x20 Verdict      steady: all figures within their limits\n\
        \x20 Time         2 min 31 s on the machine, 0.22 mm/min while eroding; simulated in 2.0 s, 76 times real time\n\
        \x20 Gap voltage  mean 55.1 V, set point 55.0 V; 100 ms mean: 0.8 V rms about the set point\n\
        \x20 Gap          mean 38 um, 3.1 um rms about it\n\
        \x20 Position     ripple 4.2 um p-p (0.5 s window); largest tone 0.6 um at 7 Hz; \
         0.21 mm/s rms above 50 Hz; 2 backward moves of more than 5 um\n\
        \x20 Pulses       630 discharges; 62 % sparks, 35 % open, 1.0 % arcs, 2.0 % shorts\n\
        \x20 Fluid        debris 4.5 % by volume, arc damage 0.04, deepest pit of arcs 1.2 um; largest force 3.5 N of the film, 0.2 N of contact\n\
        \x20 Encoder      no lost count, no illegal transition\n\
        \x20 Faults       none\n"
    );
}

#[test]
fn the_summary_names_jumps_and_those_for_which_there_was_no_room() {
    let jumps = |jumps, cramped| {
        let report = Report::new(&job(), &Outcome { jumps, cramped, ..outcome() }, &figures(), 2.0);
        let text = Summary { report: &report }.to_string();
        text.lines().find(|line| line.starts_with("  Jumps")).map(str::to_owned)
    };
    assert_eq!(jumps(0, false), None);
    assert_eq!(jumps(12, false).unwrap(), "  Jumps        12");
    assert!(jumps(12, true).unwrap().starts_with("  Jumps        12, lower than jump.height_um"));
    assert!(jumps(0, true).unwrap().starts_with("  Jumps        none: no room above"));
}

#[test]
fn a_figure_at_its_limit_is_no_finding_and_one_beyond_it_is() {
    let found = |figures: Figures, pulses: Pulses| {
        let report = Report::new(&job(), &Outcome { pulses, ..outcome() }, &figures, 2.0);
        report.findings.iter().map(|finding| finding.figure).collect::<Vec<_>>()
    };
    let line = |amplitude_um| Some(statistics::Line { amplitude_um, hz: 17.6 });
    let pulses = |arc, short| Pulses { open: 100, spark: 900 - arc - short, arc, short, stable_arc: 0 };
    let usual = figures();
    let good = pulses(10, 10);
    for (at, beyond, figure) in [
        (
            Figures { gap_v_mean: Some(59.125), ..usual },
            Figures { gap_v_mean: Some(59.2), ..usual },
            "gap_voltage_v.mean",
        ),
        (
            Figures { gap_v_mean: Some(50.875), ..usual },
            Figures { gap_v_mean: Some(50.8), ..usual },
            "gap_voltage_v.mean",
        ),
        (
            Figures { gap_v_rms_error: Some(5.5), ..usual },
            Figures { gap_v_rms_error: Some(5.6), ..usual },
            "gap_voltage_v.rms_error_100ms",
        ),
        (
            Figures { position_pp_um: Some(15.0), ..usual },
            Figures { position_pp_um: Some(15.1), ..usual },
            "position_pp_um_median",
        ),
        (Figures { line: line(3.0), ..usual }, Figures { line: line(3.1), ..usual }, "position_line_um"),
        (
            Figures { vibration_mm_s: Some(1.0), ..usual },
            Figures { vibration_mm_s: Some(1.1), ..usual },
            "vibration_mm_s",
        ),
    ] {
        assert_eq!(found(at, good), [""; 0], "{figure}");
        assert_eq!(found(beyond, good), [figure]);
    }
    // A law that does not go by the voltage has no set point of it to miss.
    for assignment in ["feed.law=observed_gap", "feed.law=pulse_counts", "gap.controlled=hazard"] {
        let mut job = job();
        job.setup.set(assignment).unwrap();
        let far = Figures { gap_v_mean: Some(78.6), gap_v_rms_error: Some(18.6), ..usual };
        let report = Report::new(&job, &Outcome { pulses: good, ..outcome() }, &far, 2.0);
        assert_eq!(report.findings, [], "{assignment}");
        let volts = report.gap_voltage_v;
        assert_eq!((volts.mean, volts.setpoint, volts.rms_error_100ms), (Some(78.6), None, None), "{assignment}");
        let text = Summary { report: &report }.to_string();
        assert!(text.contains("Gap voltage  mean 78.6 V; no set point: the feed law goes by something else"), "{text}");
    }
    for (hole_depth_mm, through, figures) in
        [(0.499_1, 0.0, &[][..]), (0.498, 0.0, &["hole_depth_mm"][..]), (0.2, 1.0, &[][..])]
    {
        let report = Report::new(&job(), &Outcome { hole_depth_mm, through, pulses: good, ..outcome() }, &usual, 2.0);
        assert_eq!(report.findings.iter().map(|finding| finding.figure).collect::<Vec<_>>(), figures);
    }
    assert_eq!(found(usual, pulses(50, 50)), [""; 0]);
    assert_eq!(found(usual, pulses(51, 50)), ["arc_ratio"]);
    assert_eq!(found(usual, pulses(51, 51)), ["arc_ratio", "short_ratio"]);
}
