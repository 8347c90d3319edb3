use super::*;
use crate::process::Pulses;
use crate::run::Setup;
use crate::statistics;

fn job() -> Job {
    Job { setup: Setup::load("default").unwrap(), depth_mm: 0.5, seed: 7, surrogate: false }
}

fn outcome() -> Outcome {
    Outcome {
        completed: true,
        stop_reason: "depth reached".into(),
        depth_mm: 0.500_000_4,
        sim_time_s: 151.0,
        shot_floor_rms_v: Some(3.7),
        pulses: Pulses { open: 350, spark: 620, arc: 10, short: 20 },
        lost_counts: 0,
        illegal_transitions: 0,
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
    }
}

#[test]
fn the_json_has_exactly_these_keys_in_this_order() {
    let json = serde_json::to_string(&Report::new(&job(), &outcome(), &figures(), 2.0)).unwrap();
    assert_eq!(
        json,
        "{\"schema\":\"edm-sim.bore/1\",\"scenario\":\"default\",\"seed\":7,\"completed\":true,\
         \"stop_reason\":\"depth reached\",\"depth_mm\":0.5,\"target_depth_mm\":0.5,\"sim_time_s\":151.0,\
         \"wall_time_s\":2.0,\"gap_voltage_v\":{\"mean\":55.1,\"rms_error_100ms\":0.8,\"filtered_rms\":4.0,\
         \"shot_floor_rms\":3.7},\"gap_um\":{\"mean\":38.2,\"rms_error\":3.1},\"position_pp_um_median\":4.2,\
         \"position_line_um\":{\"amplitude\":0.6,\"hz\":7.2},\"open_ratio\":0.35,\"spark_ratio\":0.62,\
         \"arc_ratio\":0.01,\"short_ratio\":0.02,\"discharges\":630,\"long_retreats\":2,\"lost_counts\":0,\
         \"illegal_transitions\":0,\"faults\":[]}"
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
    let text = Summary { report: &report, setpoint_v: Some(55.0) }.to_string();
    assert!(text.contains("0.500 mm deep (simulated) of 0.500 mm, stopped: following error"), "{text}");
    assert!(text.contains("following error at 12.5 s"), "{text}");
}

#[test]
fn the_summary_tells_a_machinist_how_it_went() {
    let report = Report::new(&job(), &outcome(), &figures(), 2.0);
    assert_eq!(
        Summary { report: &report, setpoint_v: Some(55.0) }.to_string(),
        "  Hole         0.500 mm deep (simulated), 0.500 mm asked for\n\
        \x20 Time         2 min 31 s on the machine, 0.20 mm/min; computed in 2.0 s, 76 times as fast\n\
        \x20 Gap voltage  55.1 V on average, 55.0 V wanted; tenths of a second stray by 0.8 V\n\
        \x20 Gap          38 um on average, varies by 3.1 um\n\
        \x20 Stability    steady: electrode swings 4.2 um within half a second, at most 0.6 um of it at one pitch (7 Hz); \
         backed off more than 5 um 2 times\n\
        \x20 Sparks       630 discharges; of all pulses 62 % sparked, 35 % stayed open, 2.0 % shorted, 1.0 % arced\n\
        \x20 Encoder      no count lost, no illegal transition\n\
        \x20 Faults       none\n"
    );
}

#[test]
fn a_run_is_restless_beyond_either_bound_of_motion() {
    let verdict = |swing: f64, amplitude: f64| {
        let line = Some(statistics::Line { amplitude_um: amplitude, hz: 17.6 });
        let figures = Figures { position_pp_um: Some(swing), line, ..figures() };
        let report = Report::new(&job(), &outcome(), &figures, 2.0);
        Summary { report: &report, setpoint_v: None }.to_string().contains("restless")
    };
    assert!(!verdict(15.0, 3.0));
    assert!(verdict(15.1, 3.0));
    assert!(verdict(15.0, 3.1));
}
