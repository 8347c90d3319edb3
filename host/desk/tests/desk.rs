//! The program against virtual heads: a hole through the page's API, whoever is lost meanwhile, and bad input.

mod browser;
mod rig;

use edm_desk::bus::Bus;
use edm_desk::head::Head;
use edm_desk::sdo::{Address, Sdo, SdoError};
use edm_desk::sheet::Sheet;
use edm_servo_head::head::{Fault, State};
use edm_servo_head::settings::Settings;
use rig::paced::Paced;
use rig::{BY_HAND, Desk, Rig, Session, run, start};
use serde_json::{Value, json};
use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::process::Stdio;
use std::sync::Arc;
use std::time::{Duration, Instant};

#[test]
fn a_hole_is_bored_through_the_api_while_another_session_watches() {
    let rig = Rig::new();
    let desk = Desk::new(&rig.connection());
    let (mut commands, mut watches) = (desk.session(), desk.session());
    let found = commands.ask(json!({ "do": "heads" })).unwrap();
    assert_eq!((&found[0]["node"], &found[0]["now"]["state"]), (&json!(1), &json!("disabled")));
    commands.ask(json!({ "do": "command", "take": true })).unwrap();
    let hole = json!({ "do": "bore", "node": 1, "hole": { "depth_mm": 0.002 } });
    let refused = watches.ask(hole.clone()).unwrap_err();
    assert!(refused.contains("take command first"), "{refused}");
    let refused = watches.ask(json!({ "do": "command", "take": true })).unwrap_err();
    assert!(refused.contains("another session has command"), "{refused}");

    commands.ask(hole).unwrap();
    let eroding = commands.until(|message| message["progress"]["sample"]["state"] == "eroding");
    assert_eq!(eroding["progress"]["target_mm"], 0.002);
    assert!(rig.truth().pulses);
    let ended = commands.until(|message| !message["ended"].is_null());
    let outcome = &ended["ended"]["outcome"];
    assert_eq!(outcome["reached"], true, "{ended}");
    let depth = outcome["depth_mm"].as_f64().unwrap();
    assert!((0.002..0.01).contains(&depth), "{ended}");
    let surface = outcome["surface_mm"].as_f64().unwrap();
    assert!((surface - 2.0).abs() < 0.005, "the work is 2 mm below home: {ended}");
    let truth = rig.truth();
    assert_eq!((truth.state, truth.pulses, truth.fault), (State::Disabled, false, None));
    assert!(truth.deepest - (surface * 1e3).round() as i64 >= 2, "{truth:?}");
    assert!(
        outcome["said"].as_str().unwrap().ends_with("Depth reached. The head is disabled, pulses are off."),
        "{ended}"
    );
    // Whoever comes later finds the hole as it was, and what was done.
    let mut later = desk.session();
    let record = later.ask(json!({ "do": "record", "node": 1 })).unwrap();
    assert_eq!((&record["target_mm"], &record["ended"]["outcome"]), (&json!(0.002), outcome));
    let deep = record["deepest_mm"].as_f64().unwrap() - record["surface_mm"].as_f64().unwrap();
    assert!(deep <= depth + 1e-6 && record["points"].as_array().unwrap().len() > 5, "{record}");
    assert!(record["gap"][1]["pulses"] == true, "{record}");
    let log = later.welcome["log"].to_string();
    for part in ["the program has started", "EDM servo head, software", "takes command", "bores to 0.002 mm"] {
        assert!(log.contains(part), "{part}: {log}");
    }
    // The watch is taken off with the end.
    let bus = rig.bus();
    assert_eq!(Sdo::new(&bus, 1).read(Address(0x1016, 1)).unwrap(), [0; 4]);
}

#[test]
fn a_run_is_paused_goes_back_and_on_and_is_stopped_by_whoever_watches() {
    let rig = Rig::new();
    let desk = Desk::new(&rig.connection());
    let (mut commands, mut watches) = (desk.eroding(), desk.session());
    for _ in 0..3 {
        commands.ask(json!({ "do": "request", "request": "pause" })).unwrap();
        rig.until(|truth| !truth.pulses && truth.state == State::HoldingPosition);
        // At once, whether or not the program has seen the head hold.
        commands.ask(json!({ "do": "request", "request": "go" })).unwrap();
        rig.until(|truth| truth.pulses && truth.state == State::Eroding);
    }
    commands.ask(json!({ "do": "request", "request": "pause" })).unwrap();
    rig.until(|truth| !truth.pulses && truth.state == State::HoldingPosition);
    commands.ask(json!({ "do": "request", "request": "back" })).unwrap();
    commands.until(|message| message["progress"]["doing"] == "waiting, pulses off");
    // 0.2 mm above the surface.
    assert!((1795..1805).contains(&rig.truth().position), "{:?}", rig.truth());
    commands.ask(json!({ "do": "request", "request": "go" })).unwrap();
    commands.until(|message| message["progress"]["sample"]["state"] == "eroding");
    let stopped = watches.ask(json!({ "do": "stop", "node": 1 })).unwrap();
    assert_eq!(
        stopped["stopped"],
        json!([{ "node": 1, "now": "the head is disabled, pulses are off", "stopped": true }])
    );
    let truth = rig.truth();
    assert_eq!((truth.state, truth.pulses), (State::Disabled, false));
    let ended = commands.until(|message| !message["ended"].is_null());
    assert_eq!(ended["ended"]["outcome"]["why"], "stopped", "{ended}");
    let said = ended["ended"]["outcome"]["said"].as_str().unwrap();
    assert!(said.ends_with("by the gap. Stopped. The head is disabled, pulses are off."), "{said}");
}

#[test]
fn a_browser_that_is_lost_ends_in_the_heads_own_retreat_where_that_is_set_and_the_log_says_why() {
    let rig = Rig::new();
    let desk = Desk::with(&rig.connection(), &["--unwatched", "retreat"]);
    drop(desk.eroding());
    retreated(&rig);
    let mut later = desk.session();
    let said = |events: &Value| events.to_string().contains("host silent: pulses off, retrace");
    if !said(&later.welcome["log"]) {
        later.until(|message| said(&message["event"]));
    }
}

#[test]
fn a_browser_that_hangs_is_lost_as_well() {
    let rig = Rig::new();
    let desk = Desk::with(&rig.connection(), &["--unwatched", "retreat"]);
    let hangs = desk.eroding();
    retreated(&rig);
    drop(hangs);
}

#[test]
fn a_hole_that_nobody_commands_is_paused_keeps_its_place_and_is_gone_on_with() {
    for lost in ["closed", "asleep"] {
        let rig = Rig::new();
        let desk = Desk::with(&rig.connection(), &["--unwatched-after", "2"]);
        let session = desk.eroding();
        let mut watches = desk.session();
        let asleep = if lost == "closed" {
            drop(session);
            None
        } else {
            Some(session)
        };
        // It goes on for that time, and nobody is in the way of another session.
        watches.until(|message| message["commander"].is_null() && message.get("commander").is_some());
        assert!(rig.truth().pulses, "{lost}");
        let paused = watches.until(|message| message["progress"]["unwatched"] == true);
        let began = paused["progress"]["sample"]["position_mm"].as_f64().unwrap()
            - paused["progress"]["depth_mm"].as_f64().unwrap();
        let waits =
            watches.until(|message| message["progress"]["doing"] == "paused, pulses off: no session has command");
        assert!(waits["progress"]["sample"]["position_mm"].as_f64().unwrap() < 2.0, "{waits}");
        let truth = rig.truth();
        assert_eq!((truth.fault, truth.pulses), (None, false), "{lost}: {truth:?}");
        assert!((1795..1805).contains(&truth.position), "above the work by 0.2 mm: {truth:?}");
        // For longer than the head waits for its host, and longer than the program waits for a session.
        std::thread::sleep(Duration::from_secs(3));
        assert_eq!(rig.truth().fault, None, "the program is its host");
        watches.ask(json!({ "do": "command", "take": true })).unwrap();
        watches.ask(json!({ "do": "request", "request": "go" })).unwrap();
        let goes = watches.until(|message| message["progress"]["sample"]["state"] == "eroding");
        let surface = goes["progress"]["sample"]["position_mm"].as_f64().unwrap()
            - goes["progress"]["depth_mm"].as_f64().unwrap();
        assert_eq!((goes["progress"]["unwatched"] == false, (surface - began).abs() < 1e-9), (true, true), "{goes}");
        let log = desk.session().welcome["log"].to_string();
        assert!(log.contains("no session has had command for 2 s: the hole is paused"), "{log}");
        watches.ask(json!({ "do": "stop", "node": 1 })).unwrap();
        drop(asleep);
    }
}

#[test]
fn a_hole_that_loses_program_link_or_browser_at_any_of_ten_moments_is_safe_and_says_why() {
    // From the request on: enabling, homing, touching off, on the way, seeking, eroding. Simulated time passes twice as fast.
    for (moment, ms) in [0, 60, 150, 300, 500, 800, 1200, 1800, 2500, 4000].into_iter().enumerate() {
        let mut rig = Rig::new();
        let mut desk = Desk::with(&rig.connection(), &["--unwatched-after", "1"]);
        let mut session = desk.session();
        session.ask(json!({ "do": "heads" })).unwrap();
        session.ask(json!({ "do": "command", "take": true })).unwrap();
        session.ask(json!({ "do": "bore", "node": 1, "hole": { "depth_mm": 0.5 } })).unwrap();
        let end = Instant::now() + Duration::from_millis(ms);
        session.until(|_| Instant::now() >= end);
        let before = rig.truth();
        let said = format!("moment {moment}, {ms} ms, {before:?}");
        match moment % 3 {
            // The head is on its own: it is disabled, or goes back by itself.
            kind @ (0 | 1) => {
                if kind == 0 {
                    desk.kill()
                } else {
                    rig.pull()
                }
                let truth = rig.until(|truth| {
                    !truth.pulses && !truth.reacting && matches!(truth.state, State::Disabled | State::Fault)
                });
                assert!(matches!(truth.fault, None | Some(Fault::HostSilent)), "{said}: {truth:?}");
                // The program that has no link says why the hole ended.
                if kind == 1 {
                    let ended = session.until(|message| !message["ended"].is_null());
                    let why = ended["ended"]["failed"].as_str().unwrap_or_default();
                    assert!(why.contains("connection to the bus lost") || why.contains("no answer"), "{said}: {ended}");
                }
            }
            // The program is its host: it waits above the work, without a fault.
            _ => {
                drop(session);
                let mut watches = desk.session();
                let waits = watches
                    .until(|message| message["progress"]["doing"] == "paused, pulses off: no session has command");
                assert_eq!(waits["progress"]["sample"]["fault_number"], 0, "{said}");
                let truth = rig.truth();
                assert_eq!((truth.pulses, truth.fault), (false, None), "{said}: {truth:?}");
                assert!(truth.position < 1850, "{said}: {truth:?}");
            }
        }
        // And stays so.
        let pulsed = rig.truth().made;
        std::thread::sleep(Duration::from_millis(300));
        let truth = rig.truth();
        assert!(!truth.pulses && truth.made.spark == pulsed.spark, "{said}: {truth:?}");
    }
}

/// A head watches from the first heartbeat on that comes after 1016h was written (CiA 301 7.5.2.17).
#[test]
fn a_head_that_is_told_to_watch_this_program_hears_it_before_anything_else() {
    let rig = Rig::new();
    let (bus, beside) = (rig.bus(), rig.bus());
    let head = Head::open(&bus, 1, &Arc::new(Sheet::own().unwrap())).unwrap();
    for _ in 0..5 {
        let heard = beside.listen();
        let armed = head.arm().unwrap();
        let came: Vec<(u16, Vec<u8>)> = std::iter::from_fn(|| heard.recv_timeout(Duration::from_secs(5)).ok())
            .map(|frame| (frame.id, frame.data().to_vec()))
            .take_while(|frame| *frame != (0, vec![1, 1]))
            .collect();
        let told = came.iter().rposition(|(id, data)| *id == 0x601 && data[..3] == [0x23, 0x16, 0x10]).unwrap();
        assert!(came[told..].iter().any(|(id, _)| *id == 0x77E), "{came:x?}");
        armed.disarm();
    }
}

#[test]
fn a_hole_whose_session_comes_back_in_time_is_not_paused() {
    let rig = Rig::new();
    let desk = Desk::with(&rig.connection(), &["--unwatched-after", "2"]);
    drop(desk.eroding());
    let mut back = desk.session();
    back.ask(json!({ "do": "command", "take": true })).unwrap();
    let end = Instant::now() + Duration::from_secs(4);
    back.until(|message| {
        assert_ne!(message["progress"]["unwatched"], true, "{message}");
        Instant::now() > end
    });
    let truth = rig.truth();
    assert_eq!((truth.fault, truth.pulses), (None, true), "{truth:?}");
}

#[test]
fn a_program_that_is_killed_ends_in_the_heads_own_retreat() {
    let rig = Rig::new();
    let mut desk = Desk::new(&rig.connection());
    let session = desk.eroding();
    desk.kill();
    retreated(&rig);
    drop(session);
    let (code, heads, _) = run(&rig.connection(), &["heads"]);
    assert_eq!(code, Some(0));
    assert!(heads.contains("host silent: pulses off, retrace; the program or the cable"), "{heads}");
    assert_eq!(run(&rig.connection(), &["reset"]).1, "the fault is reset\n");
    assert_eq!(rig.truth().fault, None);
}

#[test]
fn a_cable_that_is_pulled_ends_in_the_heads_own_retreat_and_the_program_says_so() {
    let mut rig = Rig::new();
    let boring = rig::start(&rig.connection(), &["bore", "--depth", "0.5"], Stdio::piped());
    rig.until(|truth| truth.state == State::Eroding);
    rig.pull();
    retreated(&rig);
    let output = boring.wait_with_output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    let last = said.lines().last().unwrap();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(last.contains("connection to the bus lost") && last.contains("retreats by itself"), "{last}");
}

#[test]
fn a_hole_that_is_deeper_than_what_is_left_of_the_stroke_is_refused_before_pulses_or_motion() {
    let rig = Rig::new();
    // Of 12 mm; the work is 2 mm below. Not before the touch is its surface known.
    for (arguments, exit, part) in [
        (
            &["bore", "--depth", "500"][..],
            2,
            "depth 500 mm: must be at most 12.000 mm, the rest of the stroke from here",
        ),
        (
            &["bore", "--depth", "3", "--surface", "9.5"],
            2,
            "at most 2.500 mm, the rest of the stroke below the surface",
        ),
        (&["bore", "--depth", "11"], 1, "at most 10.0"),
    ] {
        let (code, said, why) = run(&rig.connection(), arguments);
        let last = why.lines().last().unwrap();
        assert_eq!((code, said.as_str()), (Some(exit), ""), "{arguments:?}: {why}");
        assert!(last.contains(part), "{arguments:?}: {part:?} is not in {why}");
        let truth = rig.truth();
        assert_eq!((truth.state, truth.fault, truth.pulsed), (State::Disabled, None, false), "{arguments:?}");
        assert!(if exit == 2 { truth.deepest < 5 } else { truth.position < 50 }, "{arguments:?}: {truth:?}");
    }
    let desk = Desk::new(&rig.connection());
    let mut session = desk.session();
    session.ask(json!({ "do": "command", "take": true })).unwrap();
    let deep = json!({ "do": "bore", "node": 1, "hole": { "depth_mm": 500.0 } });
    let refused = session.ask(deep).unwrap_err();
    assert!(refused.contains("the rest of the stroke from here"), "{refused}");
}

#[test]
fn a_hole_that_is_bored_again_is_measured_from_its_first_surface_or_else_somebody_says_that_the_place_is_new() {
    let rig = Rig::new();
    let bore = |more: &[&str]| {
        let (code, said, why) = run(&rig.connection(), &[&["--json", "bore"], more].concat());
        (code, said.lines().last().map_or(Value::Null, |line| serde_json::from_str(line).unwrap()), why)
    };
    let (code, _, why) = bore(&["--depth", "0.03", "--continue"]);
    assert!(code == Some(2) && why.contains("no hole to continue"), "{why}");
    let (code, first, why) = bore(&["--depth", "0.03"]);
    assert_eq!(code, Some(0), "{why}");
    let surface = first["surface_mm"].as_f64().unwrap();
    assert!((surface - 2.0).abs() < 0.005, "{first}");
    let (before, why) = (rig.truth(), bore(&["--depth", "0.03"]).2);
    assert!(why.contains("a hole was begun: its surface is at 1.99") && why.contains(" last depth 0.03"), "{why}");
    assert!(why.trim_end().ends_with("--continue, or --new-surface"), "{why}");
    assert_eq!(rig.truth().deepest, before.deepest, "nothing has moved");
    for depth in ["0.03", "0.04"] {
        let (code, again, why) = bore(&["--depth", depth, "--continue"]);
        assert_eq!((code, again["surface_mm"].as_f64()), (Some(0), Some(surface)), "{why}");
        let deep = rig.truth().deepest - (surface * 1000.0).round() as i64;
        let wanted = (depth.parse::<f64>().unwrap() * 1000.0).round() as i64;
        assert!((wanted..wanted + 5).contains(&deep), "{deep} of {wanted} um: {again}");
    }
    // A reset of the node takes the home away, and what was measured from it.
    let bus = rig.bus();
    bus.send(0, &[0x81, 1]);
    std::thread::sleep(Duration::from_millis(500));
    assert_eq!(Sdo::new(&bus, 1).read(Address(0x2011, 11)).unwrap(), i32::MIN.to_le_bytes());
    let (code, _, why) = bore(&["--depth", "0.03"]);
    assert!(code == Some(2) && why.contains("a hole of 0.040 mm waits"), "{why}");
    assert!([": 0.039", ": 0.04"].iter().any(|depth| why.contains(depth)), "to a count: {why}");
    assert!(why.trim_end().ends_with("--continue, or --new-surface"), "{why}");
    rig.happen("workpiece.raised_mm", 0.2);
    let (code, beside, why) = bore(&["--depth", "0.002", "--new-surface"]);
    assert_eq!(code, Some(0), "{why}");
    assert!(beside["surface_mm"].as_f64().unwrap() < surface - 0.1, "{beside}");
}

#[test]
fn a_hole_whose_head_was_without_power_is_gone_on_with() {
    let rig = Rig::with_a_mark();
    let desk = |arguments: &[&str]| run(&rig.connection(), arguments);
    for arguments in [["object", "6098:0", "1"], ["object", "607C:0", "-500"], ["settings", "set", "end.lift_um=0"]] {
        let more: &[&str] = if arguments[0] == "settings" { &["--save"] } else { &[] };
        let (code, _, why) = desk(&[&arguments, more].concat());
        assert_eq!(code, Some(0), "{arguments:?}: {why}");
    }
    let lost = start(&rig.connection(), &["bore", "--depth", "0.03"], Stdio::piped());
    let surface = rig.until(|truth| truth.state == State::Eroding && truth.deepest > 2000).deepest / 1000 * 1000;
    rig.happen("power.cut", 1.0);
    let lost = lost.wait_with_output().unwrap();
    assert_eq!(lost.status.code(), Some(1), "{}", String::from_utf8_lossy(&lost.stderr));
    let (code, _, why) = desk(&["bore", "--depth", "0.03"]);
    assert!(code == Some(2) && why.contains("a hole of 0.030 mm waits"), "{why}");
    let (code, _, why) = desk(&["bore", "--depth", "0.03", "--continue", "--touched", "reference"]);
    assert!(code == Some(1) && why.contains("not gone on with") && why.contains("no reference"), "{why}");
    let (code, said, why) = desk(&["--json", "bore", "--depth", "0.03", "--resume"]);
    assert_eq!(code, Some(0), "{why}");
    let last: Value = serde_json::from_str(said.lines().last().unwrap()).unwrap();
    let deep = last["surface_mm"].as_f64().unwrap() * 1000.0 - surface as f64;
    assert!(last["reached"] == true && deep.abs() < 8.0, "{last}, {deep}");
}

#[test]
fn a_hole_whose_browser_or_program_was_lost_is_asked_about_and_continued() {
    let rig = Rig::new();
    let mut desk = Desk::with(&rig.connection(), &["--unwatched", "retreat"]);
    drop(desk.eroding());
    retreated(&rig);
    desk.kill();
    let desk = Desk::new(&rig.connection());
    let mut session = desk.session();
    session.ask(json!({ "do": "command", "take": true })).unwrap();
    session.ask(json!({ "do": "reset", "node": 1 })).unwrap();
    let mut hole = json!({ "do": "bore", "node": 1, "hole": { "depth_mm": 0.5 } });
    session.send(&json!({ "id": 99, "do": "bore", "node": 1, "hole": { "depth_mm": 0.5 } }).to_string());
    let asks = session.until(|message| message["id"] == 99);
    assert_eq!(asks["asks"]["begun"], true, "{asks}");
    hole["hole"]["site"] = "begun".into();
    session.ask(hole).unwrap();
    let going = session.until(|message| message["progress"]["sample"]["state"] == "eroding");
    let place = |what: &str| going["progress"][what].as_f64().unwrap();
    let surface = going["progress"]["sample"]["position_mm"].as_f64().unwrap() - place("depth_mm");
    assert!((surface - 2.0).abs() < 0.005, "{going}");
    session.ask(json!({ "do": "stop", "node": 1 })).unwrap();
}

#[test]
fn a_head_that_seeks_says_how_far_it_is_above_the_work_and_no_time_is_left_yet() {
    let rig = Rig::new();
    let desk = Desk::new(&rig.connection());
    let mut session = desk.session();
    session.ask(json!({ "do": "command", "take": true })).unwrap();
    session.ask(json!({ "do": "bore", "node": 1, "hole": { "depth_mm": 0.5 } })).unwrap();
    let seeks = session.until(|message| message["progress"]["sample"]["state"] == "seeking");
    let progress = &seeks["progress"];
    let said = progress["said"].as_str().unwrap();
    assert!(said.starts_with("seeking: 0.") && said.ends_with(" mm above the work"), "{said}");
    assert_eq!((&progress["doing"], &progress["left_s"]), (&json!("seeking"), &Value::Null));
    let goes = session.until(|message| message["progress"]["left_s"].is_number());
    assert!(goes["progress"]["said"].as_str().unwrap().ends_with(" of 0.500 mm"), "{goes}");
    // In the hole a seek has a depth, and no pace of its own.
    session.ask(json!({ "do": "request", "request": "back" })).unwrap();
    session.until(|message| message["progress"]["doing"] == "waiting, pulses off");
    session.ask(json!({ "do": "request", "request": "go" })).unwrap();
    let again = session.until(|message| message["progress"]["doing"] == "seeking");
    assert!(again["progress"]["left_s"].is_null(), "{again}");
    session.ask(json!({ "do": "stop", "node": 1 })).unwrap();
}

#[test]
fn a_program_that_saves_in_a_loop_is_refused_in_words() {
    let rig = Rig::new();
    let desk = Desk::new(&rig.connection());
    let mut session = desk.session();
    session.ask(json!({ "do": "command", "take": true })).unwrap();
    let refused = (0..100).find_map(|_| session.ask(json!({ "do": "save", "node": 1 })).err()).unwrap();
    assert!(refused.contains("too many saves") && refused.contains("nothing was saved"), "{refused}");
}

#[test]
fn a_head_is_moved_by_hand_in_steps_within_its_travel_and_is_disabled_at_the_end() {
    let rig = Rig::new();
    let desk = Desk::new(&rig.connection());
    let mut session = desk.session();
    session.ask(json!({ "do": "heads" })).unwrap();
    session.ask(json!({ "do": "command", "take": true })).unwrap();
    let step = |session: &mut Session, by_mm: f64| session.ask(json!({ "do": "step", "node": 1, "by_mm": by_mm }));
    assert!(step(&mut session, 0.1).unwrap_err().contains("begin first"));
    session.ask(json!({ "do": "jog", "node": 1 })).unwrap();
    session.until(|message| message["jog"]["doing"] == "holding, pulses off");
    // Several at once are one way.
    for by_mm in [0.5, 0.1, 0.01, -0.1] {
        step(&mut session, by_mm).unwrap();
    }
    let there = |session: &mut Session, mm: f64| {
        session.until(|message| {
            let position = message["jog"]["sample"]["position_mm"].as_f64();
            message["jog"]["doing"] == "holding, pulses off" && position.is_some_and(|at| (at - mm).abs() < 0.002)
        });
    };
    there(&mut session, 0.51);
    step(&mut session, -0.5).unwrap();
    there(&mut session, 0.01);
    let refused = step(&mut session, -0.5).unwrap_err();
    assert!(refused.starts_with("to -0.4") && refused.ends_with(" to 12.000 mm, the travel"), "{refused}");
    let bore = json!({ "do": "bore", "node": 1, "hole": { "depth_mm": 0.1 } });
    assert!(session.ask(bore).unwrap_err().contains("or a jog is in progress"));
    // Down to the work: the head finds the contact itself, goes back, and says so.
    step(&mut session, 2.5).unwrap();
    let ended = session.until(|message| !message["jogged"].is_null());
    assert!(ended["jogged"]["said"].as_str().unwrap().starts_with("contact: "), "{ended}");
    let truth = rig.until(|truth| !truth.reacting);
    assert_eq!((truth.fault, truth.pulsed), (Some(Fault::Contact), false), "{truth:?}");
    session.ask(json!({ "do": "reset", "node": 1 })).unwrap();
    session.ask(json!({ "do": "jog", "node": 1 })).unwrap();
    session.until(|message| message["jog"]["doing"] == "holding, pulses off");
    session.ask(json!({ "do": "end_jog" })).unwrap();
    session.until(|message| message["jogged"]["said"] == "the head is disabled, pulses are off");
    assert_eq!(rig.truth().state, State::Disabled);
    // Whoever jogs is there: without him the head goes home by itself.
    session.ask(json!({ "do": "jog", "node": 1 })).unwrap();
    session.until(|message| message["jog"]["doing"] == "holding, pulses off");
    drop(session);
    rig.until(|truth| matches!(truth.state, State::Disabled | State::Fault) && !truth.pulses);
}

#[test]
fn a_head_is_identified_by_command_and_the_values_become_settings() {
    let rig = Rig::new();
    let desk = |arguments: &[&str]| run(&rig.connection(), arguments);
    // The work is 2 mm below home: too near for the default.
    let (code, _, error) = desk(&["identify"]);
    assert_eq!(code, Some(2), "{error}");
    let line = error.lines().last().unwrap_or_default();
    assert!(line.contains("mm: must be from 2.000 mm, the room that identify.travel_um needs"), "{error}");
    assert!(line.contains("--at MM"), "{error}");
    let (_, _, error) = desk(&["settings", "set", "identify.travel_um=1500"]);
    assert_eq!(error, "");
    let (code, said, error) = desk(&["identify", "--at", "1.8", "--take-over", "--json"]);
    assert_eq!(code, Some(0), "{error}");
    let outcome: Value = serde_json::from_str(&said).unwrap();
    assert_eq!(outcome["taken_over"], true);
    for (value, (name, truth, most)) in outcome["values"].as_array().unwrap().iter().zip([
        ("resistance", 12.4, 0.03),
        ("inductance", 3.0, 0.1),
        ("force constant", 7.5, 0.03),
        ("mass", 0.2, 0.1),
        ("breakaway", 0.36, 0.15),
        ("sliding friction", 0.3, 0.15),
        ("counterbalance", 2.2, 0.1),
    ]) {
        assert_eq!(value["name"], name);
        let found = value["value"].as_f64().unwrap();
        assert!((found - truth).abs() < most * truth, "{value}");
        assert!(
            value["key"].is_null() || (value["set"].as_f64().unwrap() - found).abs() < 0.001 * truth.max(1.0),
            "{value}"
        );
    }
    let strike = &outcome["values"][7];
    let force = strike["value"].as_f64().unwrap_or(f64::INFINITY);
    assert!(strike["name"] == "dead encoder" && (1.0..5.0).contains(&force), "{strike}");
    let truth = rig.truth();
    assert_eq!((truth.state, truth.fault, truth.pulsed), (State::Disabled, None, false));
    assert!(truth.deepest < 1850, "{truth:?}");
}

#[test]
fn an_identification_in_the_page_is_stopped_and_its_head_keeps_its_settings() {
    let rig = Rig::new();
    let desk = Desk::new(&rig.connection());
    let mut session = desk.session();
    session.ask(json!({ "do": "heads" })).unwrap();
    session.ask(json!({ "do": "command", "take": true })).unwrap();
    session.ask(json!({ "do": "set", "node": 1, "assignments": ["identify.travel_um=1500"] })).unwrap();
    let over = session.ask(json!({ "do": "take_over", "node": 1 })).unwrap_err();
    assert!(over.contains("identify it first"), "{over}");
    session.ask(json!({ "do": "identify", "node": 1, "at_mm": 1.8 })).unwrap();
    session.until(|message| message["identify"]["doing"].as_str().is_some_and(|doing| doing.contains("strokes")));
    let jog = session.ask(json!({ "do": "jog", "node": 1 })).unwrap_err();
    assert!(jog.contains("an identification, a tuning or a jog is in progress"), "{jog}");
    session.send(r#"{"do":"stop"}"#);
    let ended = session.until(|message| !message["identified"].is_null());
    assert!(ended["identified"]["failed"].is_string(), "{ended}");
    let truth = rig.until(|truth| truth.state == State::Disabled);
    assert_eq!((truth.fault, truth.pulsed), (None, false));
    let over = session.ask(json!({ "do": "take_over", "node": 1 })).unwrap_err();
    assert!(over.contains("identify it first"), "{over}");
    // Whoever began it is there, or the head goes home by itself.
    session.ask(json!({ "do": "identify", "node": 1, "at_mm": 1.8 })).unwrap();
    session.until(|message| message["identify"]["doing"].as_str().is_some_and(|doing| doing.contains("strokes")));
    drop(session);
    rig.until(|truth| matches!(truth.state, State::Disabled | State::Fault) && !truth.pulses);
}

/// A short response about the cross-over, in the room that the rig has.
const SHORT: [&str; 4] = ["tune.travel_um=1500", "tune.points=8", "tune.lowest_hz=60", "tune.highest_hz=900"];

#[test]
fn a_loop_is_measured_gets_the_proposed_gains_and_goes_back() {
    let rig = Rig::new();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("gains.toml");
    let desk = |arguments: &[&str]| run(&rig.connection(), arguments);
    let (code, _, error) = desk(&["tune"]);
    assert_eq!(code, Some(2), "{error}");
    let line = error.lines().last().unwrap_or_default();
    assert!(line.contains("mm: must be from 3.000 mm, the room that tune.travel_um needs above"), "{error}");
    let start = ["servo.velocity_hz=90", "servo.position_hz=45", "servo.integral_ms=6"];
    let (_, _, error) = desk(&[&["settings", "set"][..], &SHORT, &start].concat());
    assert_eq!(error, "");
    let gains = || {
        ["servo.velocity_hz", "servo.position_hz", "servo.integral_ms"].map(|key| {
            let (_, said, error) = desk(&["settings", "get", key, "--json"]);
            let lines: Value = serde_json::from_str(&said).unwrap_or_else(|_| panic!("{said} {error}"));
            lines[0]["value"].as_f64().unwrap()
        })
    };
    let before = file.to_str().unwrap();
    let (code, said, error) = desk(&["tune", "--at", "1.8", "--accept", "--before", before, "--json"]);
    assert_eq!(code, Some(0), "{error}");
    let outcome: Value = serde_json::from_str(&said).unwrap();
    let number = |value: &Value| value.as_f64().unwrap_or_else(|| panic!("{value} in {outcome}"));
    let margins = |of: &str| {
        let margins = &outcome[of]["margins"];
        (number(&margins["phase_deg"]), number(&margins["gain_db"]))
    };
    assert_eq!(outcome["before"]["points"].as_array().unwrap().len(), 8);
    let (was, hoped, is) = (margins("before"), margins("proposal"), margins("after"));
    assert!(was.0 < 45.0, "a poor start: {was:?}");
    assert!(is.0 >= 45.0 && is.1 >= 6.0 && (is.0 - hoped.0).abs() < 3.0, "{hoped:?} was expected, {is:?} measured");
    // Both are seen: a head lags a little, and not by the height.
    for of in ["step_before", "step_after"] {
        assert!(outcome[of]["record"]["signals"][1]["values"].as_array().unwrap().len() > 500);
        let (peak, overshoot) = (number(&outcome[of]["peak_um"]), number(&outcome[of]["overshoot_um"]));
        assert!((1.0..60.0).contains(&peak) && overshoot < 60.0, "{of}: {peak} {overshoot}");
    }
    let proposed = ["velocity_hz", "position_hz", "integral_ms"].map(|of| number(&outcome["proposal"]["gains"][of]));
    assert!(gains().iter().zip(proposed).all(|(is, wanted)| (is - wanted).abs() < 1e-3), "{:?}", gains());
    let (code, said, error) = desk(&["tune", "--revert", "--before", before]);
    assert_eq!(code, Some(0), "{error}");
    assert!(said.contains("servo.velocity_hz"), "{said}");
    assert_eq!(gains(), [90.0, 45.0, 6.0]);
    let truth = rig.truth();
    assert_eq!((truth.state, truth.fault, truth.pulsed), (State::Disabled, None, false));
    assert!(truth.deepest < 1850, "{truth:?}");
}

#[test]
fn a_tuning_in_the_page_is_stopped_and_one_that_ends_is_kept_for_who_comes_later() {
    let rig = Rig::new();
    let desk = Desk::new(&rig.connection());
    let mut session = desk.session();
    session.ask(json!({ "do": "heads" })).unwrap();
    session.ask(json!({ "do": "command", "take": true })).unwrap();
    session.ask(json!({ "do": "set", "node": 1, "assignments": SHORT })).unwrap();
    assert_eq!(session.ask(json!({ "do": "tuned", "node": 1 })).unwrap(), Value::Null);
    let tune = json!({ "do": "tune", "node": 1, "at_mm": 1.8, "bandwidth_hz": null });
    session.ask(tune.clone()).unwrap();
    session.until(|message| message["tune"]["points"].as_array().is_some_and(|points| points.len() == 1));
    let jog = session.ask(json!({ "do": "jog", "node": 1 })).unwrap_err();
    assert!(jog.contains("a tuning or a jog is in progress"), "{jog}");
    session.send(r#"{"do":"stop"}"#);
    let ended = session.until(|message| !message["tuned"].is_null());
    assert!(ended["tuned"]["failed"].is_string(), "{ended}");
    rig.until(|truth| truth.state == State::Disabled && truth.fault.is_none());
    session.ask(tune).unwrap();
    let ended = session.until(|message| !message["tuned"].is_null());
    assert!(ended["tuned"]["proposal"]["margins"]["phase_deg"].as_f64().unwrap() > 45.0, "{ended}");
    assert_eq!(desk.session().ask(json!({ "do": "tuned", "node": 1 })).unwrap(), ended["tuned"]);
    assert_eq!(rig.truth().state, State::Disabled);
}

#[test]
fn a_head_that_bores_is_left_to_the_program_that_commands_it() {
    let rig = Rig::new();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("settings.toml");
    let file = file.to_str().unwrap();
    assert_eq!(run(&rig.connection(), &["settings", "export", file]).0, Some(0));
    let mut boring = rig::start(&rig.connection(), &["bore", "--depth", "0.5"], Stdio::null());
    rig.until(|truth| truth.state == State::Eroding);
    for other in [
        &["identify", "--at", "1.8"][..],
        &["tune"],
        &["bore", "--depth", "0.1", "--new-surface"],
        &["bring-up", "--check", "--again"],
        &["reset"],
        &["settings", "set", "gap.setpoint_v=50"],
        &["settings", "import", file],
        &["table", "../../examples/technology.toml", "--load"],
        &["object", "2001:1", "1"],
        &["object", "6040", "15"],
    ] {
        let (code, said, error) = run(&rig.connection(), &[&["--json"][..], other].concat());
        assert_eq!(code, Some(2), "{other:?}: {error}");
        assert!(error.contains("for another program: let that end, or stop the head first"), "{other:?}: {error}");
        assert!(serde_json::from_str::<Value>(said.lines().last().unwrap()).unwrap()["error"].is_string(), "{said}");
        let truth = rig.truth();
        assert!(truth.pulses && truth.fault.is_none(), "{other:?}: {truth:?}");
    }
    for reads in
        [&["heads"][..], &["settings", "get", "gap.setpoint_v"], &["object", "2000:1"], &["watch", "--seconds", "0.3"]]
    {
        assert_eq!(run(&rig.connection(), reads).0, Some(0), "{reads:?}");
        assert!(rig.truth().pulses, "{reads:?}");
    }
    boring.kill().unwrap();
    boring.wait().unwrap();
}

#[test]
fn a_hole_that_another_program_stops_ends_in_a_failure_and_goes_nowhere() {
    for (object, value) in [("6040", "271"), ("6040", "2"), ("6040", "7"), ("2001:2", "1"), ("2001:1", "0")] {
        let rig = Rig::new();
        let boring = rig::start(&rig.connection(), &["bore", "--depth", "0.5"], Stdio::null());
        rig.until(|truth| truth.state == State::Eroding);
        // What makes a head safer is never refused.
        assert_eq!(run(&rig.connection(), &["object", object, value]).0, Some(0), "{object}={value}");
        let ended = boring.wait_with_output().unwrap();
        let said = String::from_utf8(ended.stderr).unwrap();
        assert!(ended.status.code() == Some(1) && said.contains("another program has"), "{object}={value}: {said}");
        let truth = rig.until(|truth| truth.state == State::Disabled);
        assert!(
            !truth.pulses && truth.fault.is_none() && truth.position <= truth.deepest,
            "{object}={value}: {truth:?}"
        );
    }
}

#[test]
fn a_jog_that_another_program_stops_is_over_and_takes_no_step_into_what_comes_after() {
    let rig = Rig::new();
    let desk = Desk::new(&rig.connection());
    let mut session = desk.session();
    session.ask(json!({ "do": "command", "take": true })).unwrap();
    session.ask(json!({ "do": "jog", "node": 1 })).unwrap();
    session.until(|message| message["jog"]["doing"] == "holding, pulses off");
    // The session goes on answering beats meanwhile.
    let mut stop = rig::start(&rig.connection(), &["stop"], Stdio::null());
    let jogged = session.until(|message| !message["jogged"].is_null());
    assert!(stop.wait().unwrap().success());
    assert!(jogged["jogged"]["said"].as_str().unwrap().contains("another program has disabled the head"), "{jogged}");
    let step = session.ask(json!({ "do": "step", "node": 1, "by_mm": 1.0 })).unwrap_err();
    assert!(step.contains("not enabled to jog"), "{step}");
}

#[test]
fn a_head_watches_its_own_program_and_not_another_one_on_the_same_bus() {
    let rig = Rig::with_second(2);
    let bore = |node| {
        let arguments = ["--node", node, "bore", "--depth", "0.5", "--new-surface"];
        rig::start(&rig.connection(), &arguments, Stdio::null())
    };
    let mut first = bore("1");
    rig.until(|truth| truth.state == State::Eroding);
    let mut second = bore("2");
    rig.until_of(1, |truth| truth.state == State::Eroding);
    first.kill().unwrap();
    first.wait().unwrap();
    assert_eq!(rig.until(|truth| truth.fault.is_some()).fault, Some(Fault::HostSilent));
    assert!(rig.until_of(1, |_| true).pulses);
    second.kill().unwrap();
    second.wait().unwrap();
}

#[test]
fn stop_takes_every_head_out_whoever_commands_it_and_names_each() {
    let rig = Rig::with_second(2);
    let connection = rig.connection();
    let off = |truth: &rig::Truth| truth.state == State::Disabled && !truth.pulses;
    let both = "node 1: the head is disabled, pulses are off\nnode 2: the head is disabled, pulses are off\n";
    let desk = Desk::new(&connection);
    let mut session = desk.session();
    session.ask(json!({ "do": "heads" })).unwrap();
    session.ask(json!({ "do": "command", "take": true })).unwrap();
    for (place, node) in [(1, 2), (0, 1)] {
        let hole = json!({ "do": "bore", "node": node, "hole": { "depth_mm": 0.5, "site": "new" } });
        let surface = json!({ "do": "bore", "node": node, "hole": { "depth_mm": 0.5 } });
        session.ask(surface).or_else(|_| session.ask(hole)).unwrap();
        assert_eq!(desk.session().welcome["run"], json!({ "node": node, "what": "a hole" }));
        session.until(|message| message["progress"]["sample"]["state"] == "eroding");
        // Of the other head, as a page that has chosen that one.
        let other = 3 - node;
        let wrong = session.ask(json!({ "do": "step", "node": other, "by_mm": 0.1 })).unwrap_err();
        assert!(wrong.contains("not enabled to jog"), "{wrong}");
        let stopped = desk.session().ask(json!({ "do": "stop", "node": other })).unwrap();
        let said: Vec<_> = stopped["stopped"].as_array().unwrap().iter().map(|one| one["node"].clone()).collect();
        assert_eq!(said, [json!(1), json!(2)], "{stopped}");
        assert!(off(&rig.until_of(place, |truth| truth.state != State::Eroding)), "node {node}");
        let ended = session.until(|message| !message["ended"].is_null());
        assert_eq!((&ended["node"], &ended["ended"]["outcome"]["why"]), (&json!(node), &json!("stopped")), "{ended}");
        assert_eq!(desk.session().welcome["run"], Value::Null);
    }
    // A program at the command line stops what another one bores, whichever node is its default.
    for (place, node) in [(0, "1"), (1, "2")] {
        let mut boring =
            rig::start(&connection, &["--node", node, "bore", "--depth", "0.5", "--new-surface"], Stdio::null());
        rig.until_of(place, |truth| truth.state == State::Eroding);
        let (code, said, error) = run(&connection, &["stop"]);
        assert_eq!((code, error.as_str()), (Some(0), ""), "{said}");
        let mut lines: Vec<_> = said.lines().map(|line| format!("{line}\n")).collect();
        lines.sort();
        assert_eq!(lines.concat(), both);
        assert!(off(&rig.until_of(place, |_| true)), "node {node}");
        assert_ne!(boring.wait().unwrap().code(), Some(0));
    }
    // One that is named and not there.
    let (code, _, error) = run(&connection, &["--node", "7", "stop"]);
    assert_eq!(code, Some(1));
    assert!(error.contains("node 7: no head answers, it was not stopped: switch it off at the machine"), "{error}");
}

#[test]
fn a_head_that_was_there_and_does_not_answer_a_stop_is_named() {
    let rig = Rig::with_second(2);
    let desk = Desk::new(&rig.connection());
    let mut session = desk.session();
    session.ask(json!({ "do": "heads" })).unwrap();
    rig.happen("cable.cut", 1.0);
    session.until(|message| message["gone"]["node"] == 1);
    let stopped = session.ask(json!({ "do": "stop" })).unwrap();
    let heads = stopped["stopped"].as_array().unwrap();
    let said: Vec<_> = heads.iter().map(|one| (one["node"].as_u64().unwrap(), one["stopped"] == true)).collect();
    assert_eq!(said, [(1, false), (2, true)], "{stopped}");
    assert!(heads[0]["now"].as_str().unwrap().contains("switch it off at the machine"), "{stopped}");
}

#[test]
fn a_place_out_of_the_travel_is_refused_before_anything_begins() {
    let rig = Rig::new();
    let desk = Desk::new(&rig.connection());
    let mut session = desk.session();
    session.ask(json!({ "do": "command", "take": true })).unwrap();
    for at_mm in [1e30, -1e30, -0.1, 1e-9] {
        for what in ["identify", "tune"] {
            let ask = json!({ "do": what, "node": 1, "at_mm": at_mm, "bandwidth_hz": null });
            let why = session.ask(ask).unwrap_err();
            assert!(why.contains("mm: must be from "), "{what} {at_mm}: {why}");
        }
    }
    assert_eq!(rig.truth().state, State::Disabled);
}

#[test]
fn a_tuning_whose_gains_another_program_changes_says_so() {
    let rig = Rig::new();
    let (_, _, error) = run(&rig.connection(), &[&["settings", "set"][..], &SHORT].concat());
    assert_eq!(error, "");
    let mut tuning = rig::start(&rig.connection(), &["tune", "--at", "1.8"], Stdio::piped());
    rig.until(|truth| truth.state == State::Identifying);
    // Not by the desk, which leaves a head that moves to the program that moves it: as any other host.
    let (sheet, bus) = (Sheet::own().unwrap(), rig.bus());
    let integral = sheet.setting("servo.integral_ms").unwrap();
    let bytes = integral.encode(&integral.parse("20").unwrap()).unwrap();
    Sdo::new(&bus, 1).write(integral.address, &bytes).unwrap();
    let mut said = String::new();
    tuning.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    assert_eq!(tuning.wait().unwrap().code(), Some(1), "{said}");
    assert!(said.contains("another program has changed servo.*: measure again"), "{said}");
}

#[test]
fn what_is_wrong_in_a_command_line_is_said_in_json_as_well_and_names_what_was_meant() {
    let rig = Rig::new();
    let desk = |arguments: &[&str]| run(&rig.connection(), arguments);
    let (code, said, _) = desk(&["--json", "bore", "--depth", "abc"]);
    assert_eq!(code, Some(2));
    let refusal: Value = serde_json::from_str(&said).unwrap();
    assert!(refusal["error"].as_str().unwrap().contains("'abc'") && refusal["exit"] == 2, "{said}");
    let error = desk(&["scope", "posiion"]).2;
    assert!(error.contains("no such signal, did you mean position?"), "{error}");
    let error = desk(&["tune", "--bandwidth", "0"]).2;
    assert!(error.contains("bandwidth 0 Hz: must be above 0 Hz"), "{error}");
    let (code, said, error) = desk(&["settings", "get", "commission.passed"]);
    assert!(code == Some(0) && said.starts_with("commission.passed"), "{said} {error}");
    let error = desk(&["settings", "set", "commission.passed=true"]).2;
    assert!(error.contains("only the head sets it"), "{error}");
}

#[test]
fn jumps_and_a_spark_out_are_set_with_a_hole() {
    let rig = Rig::new();
    let bore = ["bore", "--depth", "0.5", "--jump-every", "300", "--jump-height", "200", "--spark-out", "1500"];
    let mut boring = rig::start(&rig.connection(), &bore, Stdio::piped());
    rig.until(|truth| truth.state == State::Jumping);
    boring.kill().unwrap();
    boring.wait().unwrap();
    let keys = ["--json", "settings", "get", "jump.every_ms", "jump.height_um", "end.spark_out_ms"];
    let set: Value = serde_json::from_str(&run(&rig.connection(), &keys).1).unwrap();
    assert_eq!(
        [&set[0]["value"], &set[1]["value"], &set[2]["value"]],
        [&json!(300.0), &json!(200.0), &json!(1500.0)],
        "{set}"
    );
}

#[test]
fn a_recorded_hole_is_read_without_a_bus_and_bored_again_by_a_virtual_head() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("hole.log");
    let path = file.to_str().unwrap();
    let truth = {
        let rig = Rig::new();
        let recording = rig::start(&rig.connection(), &["--json", "record", path], Stdio::piped());
        let end = Instant::now() + Duration::from_secs(20);
        while !fs::read_to_string(&file).is_ok_and(|text| text.ends_with('\n')) {
            assert!(Instant::now() < end);
            std::thread::sleep(Duration::from_millis(50));
        }
        let (code, _, why) = run(&rig.connection(), &["bore", "--depth", "0.002", "--spark-out", "100"]);
        assert_eq!(code, Some(0), "{why}");
        std::thread::sleep(Duration::from_millis(500));
        let pid = recording.id().to_string();
        assert!(std::process::Command::new("kill").args(["-INT", &pid]).status().unwrap().success());
        let output = recording.wait_with_output().unwrap();
        let said: Value = serde_json::from_slice(&output.stdout).unwrap();
        let lines = fs::read_to_string(&file).unwrap().lines().count() as u64;
        assert_eq!(said["frames"].as_u64(), Some(lines - 1), "and the line of the description file");
        rig.truth()
    };
    // No bus there any more.
    let (code, said, why) = run("socket://127.0.0.1:1", &["replay", path]);
    assert_eq!((code, why.as_str()), (Some(0), ""));
    for part in [
        "a host writes end.spark_out_ms = 100 ms",
        "a host writes EDM control.Erode = 1",
        "  eroding",
        "network command: start",
    ] {
        assert!(said.contains(part), "{part}: {said}");
    }
    // Another head gets the same commands at the same times. The recording is of twice real time, as this head is.
    // Commands in real time reach a head that a busy machine holds up before it is ready for them: three attempts.
    let mut attempts = (0..3).map(|_| {
        let rig = Rig::new();
        let (code, said, why) = run(&rig.connection(), &["--json", "replay", path, "--play"]);
        assert_eq!((code, why.as_str()), (Some(0), ""));
        assert!(serde_json::from_str::<Value>(&said).unwrap()["sent"].as_u64().unwrap() > 100, "{said}");
        rig.truth()
    });
    let bored = |again: &rig::Truth| again.pulsed && (again.deepest - truth.deepest).abs() < 20;
    assert!(attempts.any(|again| bored(&again)), "as deep as {truth:?}");
    let text = fs::read_to_string(&file).unwrap().replacen("description file ", "description file 0", 1);
    fs::write(&file, text).unwrap();
    let (code, _, why) = run("socket://127.0.0.1:1", &["replay", path]);
    assert!(code == Some(2) && why.contains("line 1: recorded with description file 0"), "{why}");
}

#[test]
fn a_head_without_a_node_id_is_named_and_keeps_its_name() {
    let rig = Rig::unnamed();
    let (code, _, why) = run(&rig.connection(), &["heads"]);
    assert!(code == Some(2) && why.contains("`edm-desk name` gives node-IDs"), "{why}");
    let (code, said, why) = run(&rig.connection(), &["--node", "7", "name"]);
    assert_eq!((code, said.as_str(), why.as_str()), (Some(0), "serial number 1 is node 7\n", ""));
    assert_eq!(run(&rig.connection(), &["name"]).1, "no head waits for a node-ID\n");
    // It has stored that: a reset of the node does not take it away.
    rig.bus().send(0, &[0x81, 7]);
    std::thread::sleep(Duration::from_millis(500));
    assert!(run(&rig.connection(), &["heads"]).1.starts_with("node 7: EDM servo head"));
}

#[test]
fn a_hole_is_bored_by_a_table_from_rough_to_fine_from_one_surface() {
    let rig = Rig::new();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("table.toml");
    let text = "electrode = \"copper\"\nwork = \"steel\"\n[[row]]\nname = \"rough\"\nleaves_um = 4\n[row.generator]\non_us = 160\n\
                [row.settings.gap]\nsetpoint_v = 65\n[[row]]\nname = \"fine\"\n[row.generator]\non_us = 50\n\
                [row.settings.gap]\nsetpoint_v = 68\n[row.settings.end]\nspark_out_ms = 300\n\
                [row.settings.technology]\nanswer_s = 60\n";
    fs::write(&file, text).unwrap();
    let path = file.to_str().unwrap();
    let (code, said, why) =
        run(&rig.connection(), &["--json", "bore", "--depth", "0.01", "--table", path, "--no-wait"]);
    assert_eq!(code, Some(0), "{why}");
    let outcomes: Vec<Value> = said
        .lines()
        .map(|line| serde_json::from_str::<Value>(line).unwrap())
        .filter(|line| line["reached"] == true)
        .collect();
    assert_eq!((outcomes.len(), &outcomes[0]["target_mm"]), (1, &json!(0.01)), "{said}");
    assert!(
        why.contains("row rough: to 0.006 mm; generator: on_us 160")
            && why.contains("row fine: to 0.010 mm; generator: on_us 50"),
        "{why}"
    );
    assert_eq!(why.matches("row rough: ").count(), 1, "after the last row there is none: {why}");
    let rows = said.lines().filter(|line| line.contains("\"row\":{\"number\":2,\"of\":2,\"name\":\"fine\""));
    assert!(rows.count() > 0, "{said}");
    // The settings of the rows were theirs alone.
    let set: Value =
        serde_json::from_str(&run(&rig.connection(), &["--json", "settings", "get", "gap.setpoint_v"]).1).unwrap();
    assert_eq!(set[0]["value"], 65.0);
    // Nobody is there to set the generator.
    let (code, _, why) = run(&rig.connection(), &["bore", "--depth", "0.02", "--table", path, "--continue"]);
    assert!(
        code == Some(1)
            && why.contains("set the generator, then press Enter")
            && why.contains("the depth was not reached"),
        "{why}"
    );
    let (code, _, why) = run(&rig.connection(), &["bore", "--depth", "0.004", "--table", path, "--continue"]);
    assert!(code == Some(2) && why.contains("row \"rough\" leaves 4 um: must be deeper"), "{why}");
}

#[test]
fn a_table_is_listed_without_a_bus_and_checked_by_a_head_with_its_own_settings() {
    let rig = Rig::new();
    let example = concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/technology.toml");
    let (code, said, why) = run("socket://127.0.0.1:1", &["table", example]);
    assert_eq!((code, why.as_str()), (Some(0), ""));
    assert!(
        said.starts_with("copper on steel\n1  rough: leaves 60 um, undersize 80 um a side\n   generator  "),
        "{said}"
    );
    assert!(said.contains("   settings   gap.setpoint_v 65 V, jump.every_ms 0 ms\n"), "{said}");
    let (code, said, why) = run(&rig.connection(), &["table", example, "--load"]);
    assert_eq!((code, why.as_str()), (Some(0), ""));
    assert!(said.ends_with("is a depth\n"), "{said}");
    assert_eq!(run(&rig.connection(), &["object", "201C:1"]).1.trim(), "Technology.Rows = 3");
    // One that does not go with what this head is set to.
    assert_eq!(run(&rig.connection(), &["object", "201C:2", "0"]).0, Some(0));
    let set = ["settings", "set", "gap.setpoint_v=50", "gap.open_min_v=60"];
    assert_eq!(run(&rig.connection(), &set).0, Some(0));
    let (code, _, why) = run(&rig.connection(), &["table", example, "--load"]);
    assert!(code == Some(2) && why.contains("row \"rough\": gap.setpoint_v must be below gap.open_min_v"), "{why}");
    let folder = tempfile::tempdir().unwrap();
    let bad = folder.path().join("bad.toml");
    fs::write(&bad, "electrode = 'a'\nwork = 'b'\n[[row]]\nname = 'r'\nsettings.gap.setpoint_v = 500\n").unwrap();
    let (code, _, why) = run("socket://127.0.0.1:1", &["table", bad.to_str().unwrap()]);
    let part = "bad.toml: line 5: row \"r\": gap.setpoint_v = 500: must be a number from 1 to 300 V";
    assert!(code == Some(2) && why.contains(part), "{why}");
}

#[test]
fn a_hole_by_a_table_through_the_page_waits_in_each_row_until_the_generator_is_set() {
    let rig = Rig::new();
    let desk = Desk::new(&rig.connection());
    let mut session = desk.session();
    session.ask(json!({ "do": "command", "take": true })).unwrap();
    let bore = |rows: &str| {
        let table = format!("electrode = 'copper'\nwork = 'steel'\n[[row]]\nname = 'rough'\nleaves_um = 2\n{rows}");
        json!({ "do": "bore", "node": 1, "hole": { "depth_mm": 0.004 }, "table": table })
    };
    let refused = session.ask(bore("settings.axis.mass_kg = 1")).unwrap_err();
    assert!(refused.starts_with("table line 6: row \"rough\": axis.mass_kg = 1: cannot be part of a row"), "{refused}");
    assert!(session.ask(json!({ "do": "generator_set" })).unwrap_err().contains("no hole in progress"));
    session.ask(bore("generator.on_us = 160\n[[row]]\nname = 'fine'\ngenerator.on_us = 60")).unwrap();
    for (number, generator) in [(1, "on_us 160"), (2, "on_us 60")] {
        let waits = session.until(|message| {
            let row = &message["progress"]["row"];
            row["waits"] == true && row["number"] == number
        });
        let progress = &waits["progress"];
        assert_eq!(progress["row"]["generator"], generator);
        assert_eq!(progress["doing"], "waiting until the generator is set, pulses off");
        assert!(!rig.truth().pulses);
        session.ask(json!({ "do": "generator_set" })).unwrap();
    }
    let ended = session.until(|message| !message["ended"].is_null());
    assert_eq!(ended["ended"]["outcome"]["reached"], true, "{ended}");
}

#[test]
fn the_log_of_the_page_is_kept_in_a_file_and_shown_again() {
    let rig = Rig::new();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("desk.log");
    let path = file.to_str().unwrap();
    for round in 1..=2 {
        let desk = Desk::with(&rig.connection(), &["--log", path]);
        let mut session = desk.session();
        let before = session.welcome["log"].to_string();
        assert_eq!(before.contains("has changed gap.setpoint_v 65 -> 60 V"), round == 2, "{before}");
        session.ask(json!({ "do": "command", "take": true })).unwrap();
        let set = json!({ "do": "set", "node": 1, "assignments": ["gap.setpoint_v=60"] });
        session.ask(set).unwrap();
    }
    let (code, said, why) = run(&rig.connection(), &["log", "--file", path]);
    assert_eq!((code, why.as_str()), (Some(0), ""));
    let changes =
        said.lines().filter(|line| line.ends_with(" UTC  node 1  session 1 has changed gap.setpoint_v 65 -> 60 V"));
    assert_eq!(changes.count(), 1, "{said}");
    assert_eq!(said.matches("the program has started").count(), 2, "{said}");
    fs::write(&file, "{\n").unwrap();
    let (code, _, why) = run(&rig.connection(), &["page", "--listen", "127.0.0.1:0", "--log", path]);
    assert!(code == Some(2) && why.contains("desk.log: line 1: "), "{why}");
}

#[test]
fn a_program_that_linuxcnc_takes_is_eroded_along_its_path_and_its_feed_bounds_that_of_the_head() {
    let rig = Rig::new();
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, text: &str| {
        let path = folder.path().join(name);
        fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let feed_max = || -> Value {
        let said = run(&rig.connection(), &["--json", "settings", "get", "feed.max_um_s"]).1;
        serde_json::from_str::<Value>(&said).unwrap()[0]["value"].clone()
    };
    let before = feed_max();
    // What is wrong is known before anything moves.
    for (text, part) in [
        ("G1 Z-0.01\nG5 X1\n", "line 2: G5: must be one of"),
        ("G1 Z-30\n", "line 1: Z-30: leads to Z-30.000; the stroke ends at Z-"),
    ] {
        let (code, _, why) = run(&rig.connection(), &["bore", "--path", &put("wrong.ngc", text)]);
        assert!(code == Some(2) && why.contains(part), "{why}");
    }
    assert!(!rig.truth().pulsed && rig.truth().deepest < 100);
    let slot = "G10 L20 P1 Z0\nM3 S1\nM52 P1\nG1 Z-0.003 F30\nX0.008 F0.3\nG3 X0.028 I0.01\nM5\nM52 P0\nG0 Z5\nM2\n";
    let mut boring =
        rig::start(&rig.connection(), &["--json", "bore", "--path", &put("slot.ngc", slot)], Stdio::piped());
    let mut lines = BufReader::new(boring.stdout.take().unwrap()).lines().map(|line| line.unwrap());
    if !lines.any(|line| line.contains("\"line\":5")) {
        panic!("not along line 5: {:?}", boring.wait_with_output().unwrap())
    }
    // F0.3, in um/s, once the program has noticed where the head is.
    while feed_max() != 5.0 {
        assert!(boring.try_wait().unwrap().is_none(), "the feed of line 5 was never set");
    }
    let rest: Vec<Value> = lines.map(|line| serde_json::from_str(&line).unwrap()).collect();
    assert!(boring.wait().unwrap().success(), "{rest:?}");
    let [ways @ .., outcome] = rest.as_slice() else { panic!("{rest:?}") };
    let last = ways.last().unwrap();
    assert!(last["share"].as_f64().unwrap() > 0.3 && last["beside_mm"][0].as_f64().unwrap() > 0.005, "{last}");
    assert!(outcome["reached"] == true && outcome["why"] == "end of the program", "{outcome}");
    let deep = rig.truth().deepest - (outcome["surface_mm"].as_f64().unwrap() * 1000.0).round() as i64;
    assert!((3..6).contains(&deep), "{deep} of 3 um");
    assert_eq!(feed_max(), before);
    assert_eq!((rig.truth().state, rig.truth().pulses), (State::Disabled, false));
}

#[test]
fn ctrl_c_goes_up_and_disables() {
    let rig = Rig::new();
    let boring = rig::start(&rig.connection(), &["--json", "bore", "--depth", "0.5"], Stdio::piped());
    rig.until(|truth| truth.state == State::Eroding);
    // The program looks twenty times a second.
    std::thread::sleep(Duration::from_millis(500));
    let pid = boring.id().to_string();
    assert!(std::process::Command::new("kill").args(["-INT", &pid]).status().unwrap().success());
    let output = boring.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(1), "the depth was not reached");
    // A line a second, and the outcome, and that it is none that was wanted.
    let text = String::from_utf8(output.stdout).unwrap();
    let lines: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let [ways @ .., outcome, error] = lines.as_slice() else { panic!("{text}") };
    assert!(ways.iter().any(|way| way["doing"] == "eroding" && way["sample"]["setpoint_v"] == 65.0), "{text}");
    assert_eq!((&outcome["reached"], &outcome["target_mm"]), (&json!(false), &json!(0.5)));
    assert_eq!((&error["error"], &error["exit"]), (&json!("the depth was not reached"), &json!(1)));
    let truth = rig.truth();
    assert_eq!((truth.state, truth.fault, truth.pulses), (State::Disabled, None, false));
    assert!(truth.position < 100, "it went up: {truth:?}");
}

#[test]
fn a_gap_without_pulses_has_no_voltage_and_says_why() {
    let rig = Rig::new();
    let (code, said, why) = run(&rig.connection(), &["--json", "gap", "--seconds", "0.3"]);
    assert_eq!((code, why.as_str()), (Some(0), ""));
    let gap: Value = serde_json::from_str(said.lines().next().unwrap()).unwrap();
    assert_eq!((&gap["volts"], &gap["quality"], &gap["state"]), (&Value::Null, &json!("no gate"), &json!("disabled")));
    assert_eq!((&gap["ladder"][0]["volts"], &gap["ladder"][3]["volts"]), (&Value::Null, &json!(20.0)));
    assert_eq!(gap["shares"].as_array().unwrap().len(), 5);
    assert!(gap["shares"].as_array().unwrap().iter().all(|share| share["percent"].is_null()), "{gap}");
    assert_eq!((&gap["verdict"], &gap["good"], &gap["delays"]), (&json!("No pulses"), &Value::Null, &Value::Null));
    let senses = &gap["senses"];
    for unknown in ["hazard_per_s", "hazard_deviation_per_s", "distance_um", "sparks_per_s", "pulse_age_ms"] {
        assert_eq!(senses[unknown], Value::Null, "{unknown}");
    }
    assert_eq!((&senses["notch_hz"], &senses["notch_follows"]), (&json!(50.0), &json!(false)));
    let controlled = &gap["controlled"];
    assert_eq!(
        (&controlled["what"], &controlled["setpoint"], &controlled["now"]),
        (&json!("voltage"), &json!(65.0), &Value::Null)
    );
    assert_eq!(gap["levels"], Value::Null);
}

#[test]
fn levels_that_do_not_fit_are_shown_in_the_gap_with_what_to_do() {
    let rig = Rig::new();
    let gap = || {
        let (code, said, why) = run(&rig.connection(), &["gap", "--seconds", "0.3"]);
        assert_eq!((code, why.as_str()), (Some(0), ""));
        said
    };
    let (code, _, why) = run(&rig.connection(), &["settings", "set", "gap.open_v=130"]);
    assert_eq!(code, Some(0), "{why}");
    // Before sparks were looked at it is not known what differs.
    let tells = |said: &str| said.contains("The levels do not fit this generator") || said.contains("another supply");
    assert!(!tells(&gap()), "no pulse was seen");
    let mut boring = rig::start(&rig.connection(), &["bore", "--depth", "0.5"], Stdio::piped());
    rig.until(|truth| truth.state == State::Eroding);
    let said = gap();
    boring.kill().unwrap();
    boring.wait().unwrap();
    assert!(tells(&said) && said.contains("gap.open_v"), "{said}");
}

/// Shares of open pulses, sparks, arcs and shorts, and uncertain pulses, %, of all of them.
fn percents(counts: [f64; 5]) -> [f64; 5] {
    let all: f64 = counts.iter().sum();
    counts.map(|count| 100.0 * count / all)
}

#[test]
fn shares_of_pulses_mean_the_same_in_the_desk_in_the_head_and_in_the_summary_of_a_bore() {
    let rig = Rig::new();
    let mut boring = rig::start(&rig.connection(), &["bore", "--depth", "0.5"], Stdio::piped());
    rig.until(|truth| truth.state == State::Eroding);
    // Past the start-up.
    let begin = rig.truth().made;
    rig.until(|truth| truth.made.spark > begin.spark + 4000);
    let bus = rig.bus();
    let sdo = Sdo::new(&bus, 1);
    let counted = || -> [f64; 5] {
        let count = |sub| u32::from_le_bytes(sdo.read(Address(0x2012, sub)).unwrap().try_into().unwrap()).into();
        [11, 12, 13, 14, 15].map(count)
    };
    let made = || {
        let made = rig.truth().made;
        [made.open, made.spark, made.arc, made.short, 0].map(|count| count as f64)
    };
    let (made_before, counted_before) = (made(), counted());
    let (code, said, why) = run(&rig.connection(), &["--json", "gap", "--seconds", "4"]);
    let (made_after, counted_after) = (made(), counted());
    boring.kill().unwrap();
    boring.wait().unwrap();
    assert_eq!((code, why.as_str()), (Some(0), ""));
    let new = |after: [f64; 5], before: [f64; 5]| std::array::from_fn(|class| after[class] - before[class]);
    let (summary, head) = (percents(new(made_after, made_before)), percents(new(counted_after, counted_before)));
    let looks: Vec<Value> = said.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert!(looks.len() >= 5, "{}", looks.len());
    let share = |look: &Value, what: &str| {
        let shares = look["shares"].as_array().unwrap();
        shares.iter().find(|share| share["what"] == what).unwrap()["percent"].as_f64().unwrap()
    };
    let names = ["open", "spark", "arc", "short", "uncertain"];
    for look in &looks {
        let all: f64 = names.iter().map(|what| share(look, what)).sum();
        assert!((all - 100.0).abs() < 1e-6, "{all}: {look}");
    }
    let count = |look: &Value| look["pulse_count"].as_f64().unwrap_or(0.0);
    let all: f64 = looks.iter().map(count).sum();
    let desk = names.map(|what| looks.iter().map(|look| share(look, what) * count(look)).sum::<f64>() / all);
    let counted: f64 = new(counted_after, counted_before).iter().sum();
    let seen = [made_before, made_after, counted_before, counted_after];
    assert!(all > 0.5 * counted && all < counted, "{all} of {counted} pulses: {seen:?}");
    println!("summary {summary:.1?}, head {head:.1?}, desk {desk:.1?}");
    // A gap that sparks; and a share that is of anything but all pulses is elsewhere.
    assert!(summary[1] > 60.0, "{summary:?}");
    for class in 0..5 {
        // Sparks that ignite with the end of their gate are open or uncertain to the head: 1.1 % of the pulses here.
        let away = (head[class] - summary[class]).abs();
        assert!(away < 2.0, "the head: {head:.1?}, the summary: {summary:.1?}");
        // It is not there for the whole of this time.
        let away = (desk[class] - head[class]).abs();
        assert!(away < 2.0, "the desk: {desk:.1?}, the head: {head:.1?}");
    }

    // What else is known of such a gap.
    let last = looks.last().unwrap();
    assert_eq!(last["levels"], Value::Null);
    let number = |value: &Value| value.as_f64().unwrap_or_else(|| panic!("{value}: {last}"));
    let senses = &last["senses"];
    let hazard = number(&senses["hazard_per_s"]);
    let spread = number(&senses["hazard_deviation_per_s"]) / hazard;
    assert!((2000.0..60_000.0).contains(&hazard) && (0.02..0.5).contains(&spread), "{hazard} {spread}");
    assert!((500.0..5100.0).contains(&number(&senses["sparks_per_s"])), "{senses}");
    assert_eq!((&senses["distance_beyond"], &senses["pulse_age_ms"]), (&json!(true), &json!(0.0)), "{senses}");
    let error = number(&last["controlled"]["error_v"]);
    assert!(error.abs() < 60.0 && last["controlled"]["unit"] == "V", "{last}");
    // Ignition delays of a second, which is two simulated: those that have ignited, where the model has them.
    let delays = &last["delays"];
    let counts: Vec<f64> = delays["counts"].as_array().unwrap().iter().map(number).collect();
    let ends: Vec<f64> =
        delays["ends_us"].as_array().unwrap().iter().map(|end| end.as_f64().unwrap_or(f64::MAX)).collect();
    let seconds = number(&delays["seconds"]);
    let total: f64 = counts.iter().sum();
    assert!((0.9..2.0).contains(&seconds) && counts.len() == 32 && ends.len() == 32, "{delays}");
    assert!((1000.0..5000.0).contains(&(total / seconds / 2.0)), "{total} in {seconds} s");
    // No pulse is longer than its gate, 160 us of 200.
    let late: f64 =
        counts.iter().zip(&ends[1..]).skip(1).filter(|(_, end)| **end > 512.0).map(|(count, _)| count).sum();
    assert_eq!(late, 0.0, "{counts:?} {ends:?}");
}

#[test]
fn pauses_are_seen_to_begin_where_they_are_set() {
    let rig = Rig::new();
    let (code, _, why) = run(&rig.connection(), &["settings", "set", "generator.pause_spark_us=20"]);
    assert_eq!((code, why.as_str()), (Some(0), ""));
    let mut boring = rig::start(&rig.connection(), &["bore", "--depth", "0.5"], Stdio::piped());
    rig.until(|truth| truth.made.spark > 1000);
    let bus = rig.bus();
    let sdo = Sdo::new(&bus, 1);
    let begun = u32::from_le_bytes(sdo.read(Address(0x2012, 18)).unwrap().try_into().unwrap());
    let made = rig.truth().made;
    boring.kill().unwrap();
    boring.wait().unwrap();
    // After sparks, and after no other pulse.
    assert!((1000..=made.spark).contains(&u64::from(begun)), "{begun} of {made:?}");
}

#[test]
fn what_the_head_senses_is_recorded_by_name() {
    let rig = Rig::new();
    let desk = Desk::new(&rig.connection());
    let mut session = desk.eroding();
    let names = ["Gap senses.Hazard", "Gap senses.Distance", "Gap senses.Sparks", "Gap senses.Notch frequency"];
    let plan = json!({ "do": "scope", "node": 1, "plan": { "signals": names, "wait_s": 10 } });
    let record = session.ask(plan).unwrap()["record"].clone();
    let values = |place: usize| -> Vec<f64> {
        record["signals"][place]["values"].as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect()
    };
    assert!(values(0).iter().all(|hazard| (100.0..1e6).contains(hazard)), "{:?}", values(0));
    assert!(values(1).iter().all(|um| (10.0..81.0).contains(um)), "in its unit: {:?}", values(1));
    let sparks = values(2);
    assert!(sparks.windows(2).all(|pair| (0.0..7.0).contains(&(pair[1] - pair[0]))), "{sparks:?}");
    assert!(sparks[255] - sparks[0] > 256.0, "{sparks:?}");
    assert!(values(3).iter().all(|hz| *hz == 50.0), "in its unit: {:?}", values(3));
}

/// What is looked at under this name.
fn looked_at<'a>(checks: &'a Value, what: &str) -> &'a Value {
    checks.as_array().unwrap().iter().find(|check| check["what"] == what).unwrap()
}

#[test]
fn a_head_is_brought_up_by_hand_and_by_the_guided_check_and_the_report_tells_what_was_measured() {
    let rig = Rig::new();
    let desk = Desk::new(&rig.connection());
    let mut session = desk.bringing_up(&rig);
    let plain = json!({ "do": "set", "node": 1, "assignments": ["gap.average=plain"] });
    session.ask(plain).unwrap();
    // Not before the steps before it.
    session.ask(json!({ "do": "check", "node": 1, "again": false })).unwrap();
    let waits = session.until(|message| message["bring_up"]["doing"].as_str().is_some_and(|doing| doing != "watching"));
    assert_eq!(waits["bring_up"]["doing"], "the guided check waits for step 5, upper limit contact: not seen");
    for (wire, value, what, becomes) in BY_HAND {
        rig.happen(wire, value);
        session.until(|message| {
            let checks = &message["bring_up"]["checks"];
            checks.is_array() && {
                let check = looked_at(checks, what);
                check["value"] == becomes || check["verdict"] == becomes
            }
        });
    }
    session.ask(json!({ "do": "check", "node": 1, "again": false })).unwrap();
    session.until(|message| message["bring_up"]["sample"]["state"] == "commissioning");
    assert_eq!(
        session.ask(json!({ "do": "bore", "node": 1, "hole": { "depth_mm": 0.1 } })).unwrap_err(),
        "a hole, a bring-up, an identification, a tuning or a jog is in progress: end it first"
    );
    session.until(|message| message["bring_up"]["doing"] == "guided check: passed");
    session.ask(json!({ "do": "report" })).unwrap();
    let ended = session.until(|message| !message["brought_up"].is_null())["brought_up"].clone();
    let report = &ended["report"];
    assert_eq!(report["passed"], true, "{}", ended["markdown"]);
    let measured = |what| looked_at(&report["checks"], what)["value"].as_f64().unwrap();
    // Of the model: 0.36 N at rest; 100 V for 160 of 200 us beside the sense supply; 12 mm, between the outermost of the positions that
    // this program happened to read.
    for (what, low, high) in [
        ("breakaway force", 0.34, 0.41),
        ("open-circuit voltage, read by this program", 78.0, 86.0),
        ("stroke, read by this program", 10.8, 12.03),
    ] {
        assert!((low..high).contains(&measured(what)), "{what}: {}", measured(what));
    }
    let text = ended["markdown"].as_str().unwrap();
    for part in [
        "build virtual",
        "## 12. Generator",
        "Not checked: a host cannot see it",
        "| 12 mm +- 1.2 mm (axis.stroke_um) | passed",
        " N | measured, stored",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let truth = rig.truth();
    assert_eq!((truth.state, truth.fault, truth.pulses), (State::Disabled, None, false));
    // The watch is taken off with the end.
    assert_eq!(Sdo::new(&rig.bus(), 1).read(Address(0x1016, 1)).unwrap(), [0; 4]);
}

#[test]
fn the_page_about_the_desk_lists_what_a_rehearsed_bring_up_wants() {
    let text = include_str!("../../../docs/desk.md");
    let (before, list) = text.split_once("\nworkpiece.raised_mm=-100\n").unwrap();
    assert!(before.ends_with("\n```") && before.contains("\ncargo desk settings set gap.average=plain\n"));
    let said =
        |value: f64, wire: &str| if wire.ends_with("_n") { value.to_string() } else { (value != 0.0).to_string() };
    let wanted: Vec<String> =
        BY_HAND.iter().map(|(wire, value, ..)| format!("{wire}={}", said(*value, wire))).collect();
    assert!(list.lines().take(wanted.len()).eq(wanted.iter()), "{list}");
}

#[test]
fn a_guided_check_that_fails_says_why_in_two_files() {
    let rig = Rig::new();
    rig.happen("workpiece.raised_mm", -100.0);
    assert_eq!(run(&rig.connection(), &["settings", "set", "motor.reversed=true"]).0, Some(0));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().to_str().unwrap();
    let (code, said, why) = run(&rig.connection(), &["--json", "bring-up", "--check", "--again", "--report", path]);
    assert_eq!(code, Some(1), "{why}");
    let (report, error) = said.split_once('\n').unwrap();
    let report: Value = serde_json::from_str(report).unwrap();
    assert!(error.starts_with("{\"error\":\"the bring-up is not complete"), "{error}");
    let check = looked_at(&report["checks"], "guided check");
    assert_eq!((&check["value"], &check["verdict"]), (&json!("motor reversed"), &json!("failed")));
    assert_eq!(check["advice"], "the motor pushes the wrong way: change motor.reversed");
    assert_eq!(looked_at(&report["checks"], "upper limit contact")["verdict"], "not_seen");
    let files: Vec<_> =
        fs::read_dir(path).unwrap().map(|file| fs::read_to_string(file.unwrap().path()).unwrap()).collect();
    assert_eq!(files.len(), 2);
    assert!(files.iter().any(|text| text.contains("| FAILED the motor pushes the wrong way")), "{files:?}");
    assert!(files.iter().any(|text| serde_json::from_str::<Value>(text).is_ok_and(|json| json == report)));
}

/// Waits until the guided check is on its way to the lower stop. The session answers beats meanwhile.
fn deep_in_the_check(session: &mut Session) {
    session.until(|message| {
        let now = &message["bring_up"]["sample"];
        now["state"] == "commissioning" && now["position_mm"].as_f64().is_some_and(|mm| mm > 3.0)
    });
}

#[test]
fn a_guided_check_ends_when_whoever_asked_for_it_is_gone_or_says_stop() {
    for how in ["stop", "browser", "program"] {
        let rig = Rig::new();
        let mut desk = Desk::new(&rig.connection());
        let mut session = desk.bringing_up(&rig);
        session.ask(json!({ "do": "check", "node": 1, "again": true })).unwrap();
        deep_in_the_check(&mut session);
        match how {
            "stop" => drop(session.ask(json!({ "do": "stop", "node": 1 })).unwrap()),
            "browser" => drop(session),
            _ => desk.kill(),
        }
        let truth = rig.until(|truth| truth.state == State::Disabled);
        let midway = truth.position > 3000 && truth.deepest < 12_100;
        assert!(!truth.pulses && truth.fault.is_none() && midway, "{how}: not at its end: {truth:?}");
    }
}

#[test]
fn an_emergency_stop_ends_a_guided_check_and_the_report_says_so() {
    let rig = Rig::new();
    let desk = Desk::new(&rig.connection());
    let mut session = desk.bringing_up(&rig);
    session.ask(json!({ "do": "check", "node": 1, "again": true })).unwrap();
    deep_in_the_check(&mut session);
    rig.happen("stop.open", 1.0);
    session.until(|message| {
        message["bring_up"]["doing"].as_str().is_some_and(|doing| doing.starts_with("guided check: emergency"))
    });
    let truth = rig.truth();
    assert_eq!((truth.fault, truth.pulses), (Some(Fault::EmergencyStop), false));
    session.ask(json!({ "do": "report" })).unwrap();
    let ended = session.until(|message| !message["brought_up"].is_null());
    let check = looked_at(&ended["brought_up"]["report"]["checks"], "guided check");
    assert!(check["value"].as_str().unwrap().starts_with("emergency stop: pulses off"), "{ended}");
}

/// The head is in the fault that a silent host makes, pulses off, and has gone back from the work.
fn retreated(rig: &Rig) {
    let truth = rig.until(|truth| truth.state == State::Fault && !truth.reacting);
    assert_eq!((truth.fault, truth.pulses), (Some(Fault::HostSilent), false));
    assert!(truth.position < 1100, "to the safe height, 1 mm above the work: {truth:?}");
}

#[test]
fn settings_go_to_a_file_are_compared_and_put_back_all_or_none() {
    let rig = Rig::new();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("head.toml");
    let file = file.to_str().unwrap();
    let ok = |arguments: &[&str]| {
        let (code, said, complained) = run(&rig.connection(), arguments);
        assert_eq!((code, complained.as_str()), (Some(0), ""), "{arguments:?}: {said}");
        said
    };
    // All but commission.passed, which the head alone sets.
    let all = format!("{} settings of node 1", Settings::COUNT - 1);
    assert!(ok(&["settings", "export", file]).contains(&all));
    assert!(ok(&["settings", "compare", file]).contains("no difference"));
    ok(&["settings", "set", "gap.setpoint_v=55", "feed.law=fixed_rate", "--save"]);
    let different: Value = serde_json::from_str(&ok(&["--json", "settings", "compare", file])).unwrap();
    let keys: Vec<_> = different.as_array().unwrap().iter().map(|one| one["key"].as_str().unwrap()).collect();
    assert_eq!(keys, ["gap.setpoint_v", "feed.law"]);
    assert!(ok(&["settings", "list", "--changed"]).contains("(default increment_by_error)"));

    // Each alone would not fit what the head has: they are written in the order that does.
    ok(&["settings", "set", "gap.setpoint_v=90", "gap.open_min_v=95"]);
    ok(&["settings", "set", "gap.open_min_v=70", "gap.setpoint_v=60"]);
    // The second does not fit: the first is put back.
    let (code, said, why) = run(&rig.connection(), &["settings", "set", "gap.corner_hz=150", "gap.setpoint_v=80"]);
    assert_eq!((code, said.as_str()), (Some(1), ""));
    assert!(
        why.contains("gap.setpoint_v: it conflicts with another value") && why.contains("nothing was changed"),
        "{why}"
    );
    let corner: Value = serde_json::from_str(&ok(&["--json", "settings", "get", "gap.corner_hz"])).unwrap();
    assert_eq!((&corner[0]["value"], &corner[0]["unit"]), (&json!(200.0), &json!("Hz")));

    ok(&["settings", "import", file]);
    assert!(ok(&["settings", "compare", file]).contains("no difference"));
}

#[test]
fn a_head_is_given_another_program_and_what_is_not_right_is_refused_in_words() {
    let rig = Rig::new();
    let connection = rig.connection();
    let folder = tempfile::tempdir().unwrap();
    let program: Vec<u8> = (0..3000u32).flat_map(|n| n.wrapping_mul(0x9E37_79B9).to_le_bytes()).collect();
    let right = edm_boot::Header {
        product: 1,
        board: 405,
        length: program.len() as u32,
        sum: edm_boot::file::sum(edm_boot::file::words(&program)),
        id: 0xCAFE_0001,
        version: 2,
        build: 0x1234_5678,
    };
    let put = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let file = edm_seal::update::with(&right, &program);
    let whole = put("whole.update", &file);
    let mut bits = file.clone();
    bits[5000] ^= 1;
    for (file, part) in [
        (put("half.update", &file[..5000]), "half.update: not whole"),
        (put("bits.update", &bits), "bits.update: damaged"),
        (put("text.update", b"nonsense"), "text.update: not an update of a head"),
        (folder.path().join("absent").to_str().unwrap().to_owned(), "absent: "),
    ] {
        let (code, said, why) = run(&connection, &["update", &file]);
        assert_eq!((code, said.as_str(), why.trim_end().lines().count()), (Some(2), "", 1), "{why}");
        assert!(why.contains(part), "{why}");
    }
    let other = put("other.update", &edm_seal::update::with(&edm_boot::Header { board: 407, ..right }, &program));
    let (code, _, why) = run(&connection, &["update", &other]);
    assert!(code == Some(1) && why.contains("for a board with STM32F407, and the head has another"), "{why}");
    // While it is enabled: by a host that does not watch it.
    let sdo = Sdo::new(&rig.bus(), 1);
    for word in [6u8, 7, 15] {
        sdo.write(Address(0x6040, 0), &[word, 0]).unwrap();
        std::thread::sleep(Duration::from_millis(50));
    }
    rig.until(|truth| truth.state != State::Disabled);
    let (code, _, why) = run(&connection, &["update", &whole]);
    assert!(code == Some(1) && why.contains("only a disabled head takes an update: `edm-desk stop`"), "{why}");
    assert_eq!(run(&connection, &["stop"]).0, Some(0));

    let (code, said, why) = run(&connection, &["update", &whole]);
    assert_eq!(code, Some(0), "{why}");
    assert!(said.starts_with("node 1 runs the new program: version 0.2, build 12345678, sum CAFE0001h"), "{said}");
    assert!(why.contains("sent 50 %"), "{why}");
    let (code, said, _) = run(&connection, &["--json", "update", &whole]);
    let said: Value = serde_json::from_str(&said).unwrap();
    assert_eq!((code, &said["already"], &said["id"]), (Some(0), &json!(true), &json!("CAFE0001h")));
}

#[test]
fn every_way_of_a_transfer_carries_the_same_value() {
    let rig = Rig::new();
    let bus = rig.bus();
    let sdo = Sdo::new(&bus, 1);
    let target = Address(0x607A, 0);
    for value in [[1u8, 2, 3, 4], [0xFF, 0xFE, 0, 0]] {
        sdo.write_block(target, &value).unwrap();
        assert_eq!(sdo.read(target).unwrap(), value);
        let other = value.map(|byte| byte ^ 0x55);
        sdo.write_segments(target, &other).unwrap();
        assert_eq!(sdo.read_block(target).unwrap(), other);
    }
    let name = Address(0x1008, 0);
    assert_eq!(sdo.read(name).unwrap(), b"EDM servo head");
    assert_eq!(sdo.read_block(name).unwrap(), b"EDM servo head");
    let too_long = [0; 300];
    assert_eq!(sdo.write(target, &too_long), Err(SdoError::Refused(target, 0x0607_0012)));
    assert!(matches!(sdo.write(Address(0x1008, 0), b"x"), Err(SdoError::Refused(_, 0x0601_0002))));
    // The scope's record: a domain of many segments.
    for (sub, value) in [(1, &[0, 0x64, 0x60, 0][..]), (5, &[1, 0]), (6, &[0]), (8, &[1])] {
        sdo.write(Address(0x2010, sub), value).unwrap();
    }
    let full = (0..100_000).any(|_| sdo.read(Address(0x2010, 9)).unwrap() == [3]);
    assert!(full, "the scope did not fill");
    let count = u16::from_le_bytes(sdo.read(Address(0x2010, 10)).unwrap().try_into().unwrap());
    let data = sdo.read_block(Address(0x2010, 11)).unwrap();
    assert!(count >= 256 && data.len() >= 4 * usize::from(count), "{count} {}", data.len());
    assert_eq!(data, sdo.read(Address(0x2010, 11)).unwrap());
}

#[test]
fn the_whole_dictionary_is_read_in_half_a_second_of_a_bus_of_1_mbit() {
    let paced = Paced::new();
    let bus = Bus::join(&paced.connection.parse().unwrap(), 1_000_000, 126, &(Arc::new(|_: &str| ()) as _)).unwrap();
    let head = Head::open(&bus, 1, &Arc::new(Sheet::own().unwrap())).unwrap();
    let (before, began) = (paced.passed(), Instant::now());
    let (mut values, mut refused) = (0, 0);
    for object in head.sheet.objects() {
        match head.sdo.read(object.address) {
            Ok(_) => values += 1,
            // One that can only be written, and the scope's data before a record.
            Err(SdoError::Refused(_, 0x0601_0001 | 0x0800_0024)) => refused += 1,
            Err(why) => panic!("{}: {why}", object.key),
        }
    }
    let real = began.elapsed();
    let [ns, bits, frames] = std::array::from_fn(|place| paced.passed()[place] - before[place]);
    let said = format!(
        "{values} values, {refused} refused: {frames} frames, {bits} bits, {:.3} s of the bus and the head; {:.3} s of this computer",
        ns as f64 * 1e-9,
        real.as_secs_f64()
    );
    eprintln!("{said}");
    assert!(values > 400 && frames >= 2 * (values + refused), "{said}");
    // Not faster than the bus can, and not slower than asked for.
    assert!(ns >= 1000 * bits && ns < 500_000_000, "{said}");
}

#[test]
fn a_record_of_the_scope_has_a_sample_each_millisecond_in_a_file() {
    let rig = Rig::new();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("record.csv");
    // The clock of the head, and what does not change.
    let comma = folder.path().join("comma.csv");
    let named = ["scope", "Gap senses.Hazard, standard deviation", "--csv", comma.to_str().unwrap()];
    assert_eq!(run(&rig.connection(), &named).0, Some(0));
    let first = fs::read_to_string(comma).unwrap().lines().next().unwrap().to_owned();
    assert_eq!(first, "time [ms],\"Gap senses.Hazard, standard deviation [%]\"");
    let arguments = ["--json", "scope", "2000:10", "6079", "2005:5", "--every", "3", "--csv", file.to_str().unwrap()];
    let (code, said, why) = run(&rig.connection(), &arguments);
    assert_eq!((code, why.as_str()), (Some(0), ""));
    let record: Value = serde_json::from_str(&said).unwrap();
    let values = |place: usize| -> Vec<f64> {
        record["signals"][place]["values"].as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect()
    };
    let clock = values(0);
    assert_eq!(clock.len(), 256);
    assert!(clock.windows(2).all(|pair| pair[1] - pair[0] == 3e6), "3 ms of ns from one to the next: {clock:?}");
    assert!(values(1).iter().all(|mv| (47_900.0..48_100.0).contains(mv)), "{:?}", values(1));
    assert_eq!((&record["signals"][2]["unit"], values(2)[0]), (&json!("V"), 65.0), "in its unit");
    let text = fs::read_to_string(file).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!((lines.len(), lines[0].split(',').count()), (257, 4), "{}", lines[0]);
    assert!(lines[0].starts_with("time [ms],") && lines[0].ends_with("[V]"), "{}", lines[0]);
    assert!(lines[256].starts_with("765,") && lines[256].ends_with(",65"), "{}", lines[256]);

    // A hand makes it begin; nothing else does.
    let (code, _, why) =
        run(&rig.connection(), &["scope", "6064", "--trigger", "rises", "--level", "1000", "--wait", "0.5"]);
    assert!(code == Some(1) && why.contains("no trigger within 0.5 s"), "{why}");
    let waits = rig::start(
        &rig.connection(),
        &["--json", "scope", "6064", "--trigger", "rises", "--level", "1000", "--wait", "30"],
        Stdio::piped(),
    );
    let bus = rig.bus();
    let sdo = Sdo::new(&bus, 1);
    // Now and then: who asks all the time ends the other's transfers in segments.
    let waiting = (0..100).any(|_| {
        std::thread::sleep(Duration::from_millis(100));
        sdo.read(Address(0x2010, 9)).unwrap() == [1]
    });
    assert!(waiting, "not armed");
    rig.happen("hand.force_n", 2.0);
    let record: Value = serde_json::from_slice(&waits.wait_with_output().unwrap().stdout).unwrap();
    let first = record["signals"][0]["values"][0].as_f64().unwrap();
    assert!((1000.0..1300.0).contains(&first), "{first}");
}

#[test]
fn servo_ticks_are_recorded_around_a_trigger_on_two_heads_and_a_fault_leaves_a_snapshot() {
    let rig = Rig::with_second(2);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("two.csv");
    let ok = |arguments: &[&str]| {
        let (code, said, why) = run(&rig.connection(), arguments);
        assert_eq!((code, why.as_str()), (Some(0), ""), "{arguments:?}");
        said
    };
    let path = file.to_str().unwrap();
    let text = ok(&["scope", "position", "bus_voltage", "state", "--nodes", "1,2", "--csv", path]);
    assert!(text.contains("node 2 bus_voltage") && text.ends_with("0 samples before it\n"), "{text}");
    let lines = fs::read_to_string(&file).unwrap();
    let rows: Vec<&str> = lines.lines().collect();
    assert_eq!(rows.len(), 1 + 4096 / 3);
    assert_eq!(
        rows[0],
        "time [ms],node 1 position [mm],node 1 bus_voltage [V],node 1 state,node 2 position [mm],node 2 bus_voltage [V],node 2 state"
    );
    assert!(rows[1].starts_with("0,") && rows[2].starts_with("0.05,") && rows[4].starts_with("0.15,"), "{}", rows[4]);
    let volts = |row: &str| row.split(',').nth(5).unwrap().parse::<f64>().unwrap();
    assert!(rows[1..].iter().all(|row| (47.9..48.1).contains(&volts(row))), "{}", rows[1]);
    // What was written is read again.
    let again = ok(&["scope", "--show", path]);
    assert_eq!(again.lines().next(), text.lines().next());

    let (code, _, why) = run(&rig.connection(), &["scope", "--snapshot"]);
    assert!(code == Some(1) && why.contains("no snapshot: no fault since its power came"), "{why}");
    // Disabled it has no fault.
    let bus = rig.bus();
    let head = Head::open(&bus, 1, &Arc::new(Sheet::own().unwrap())).unwrap();
    head.enable(&mut || Ok(())).unwrap();
    let waits = rig::start(
        &rig.connection(),
        &[
            "--json",
            "scope",
            "position",
            "fault",
            "--trigger",
            "fault",
            "--pre",
            "25",
            "--every",
            "0.1",
            "--wait",
            "120",
        ],
        Stdio::piped(),
    );
    // Seldom: a head has one SDO server, and what that program reads in segments is not to be disturbed.
    let waiting = (0..60).any(|_| {
        std::thread::sleep(Duration::from_millis(1500));
        head.sdo.read(Address(0x2019, 15)).is_ok_and(|state| state == [1])
    });
    assert!(waiting, "not armed");
    rig.happen("stop.open", 1.0);
    let record: Value = serde_json::from_slice(&waits.wait_with_output().unwrap().stdout).unwrap();
    assert_eq!((&record["before"], &record["begun"]), (&json!(512), &json!("fault: emergency stop")));
    let faults = record["signals"][1]["values"].as_array().unwrap();
    assert_eq!(faults.len(), 2048);
    assert!(
        faults[..512].iter().all(|value| value.as_f64() == Some(0.0)) && faults[512].as_f64() > Some(0.0),
        "{faults:?}"
    );
    let last = ok(&["scope", "--last"]);
    assert!(last.starts_with("position ") && last.contains("trigger: fault: emergency stop, 512 samples"), "{last}");
    // The head's own of the same fault, which is there 64 ms later.
    let snapshot = ok(&["scope", "--snapshot"]);
    assert!(snapshot.contains("gap_voltage") && snapshot.contains("trigger: fault: emergency stop, "), "{snapshot}");
}

#[test]
fn what_a_command_prints_or_is_asked_for_another_command_takes() {
    let rig = Rig::with_stranger(9);
    let ok = |arguments: &[&str]| {
        let (code, said, why) = run(&rig.connection(), arguments);
        assert_eq!((code, why.as_str()), (Some(0), ""), "{arguments:?}");
        said
    };
    assert_eq!(ok(&["reset"]), "there was no fault to reset\n");
    assert_eq!(ok(&["--json", "reset"]), "{\"reset\":false}\n");
    let all = ok(&["heads"]);
    assert!(all.contains("node 1: ") && all.contains("node 9: "), "{all}");
    let one = ok(&["--node", "1", "heads"]);
    assert!(one.contains("node 1: ") && !one.contains("node 9"), "{one}");
    let printed = ok(&["object", "2005:5"]);
    let name = printed.split(" = ").next().unwrap();
    assert_eq!(name, "Gap.Setpoint");
    assert_eq!(ok(&["object", name]), printed);
    assert!(ok(&["scope", name, "gap.voltage"]).starts_with("Gap.Setpoint "));
    let signals = ok(&["signals", "gap.set"]);
    assert!(signals.lines().any(|line| line.split_whitespace().eq(["2005h:5", "Gap.Setpoint", "V"])), "{signals}");
    let json: Value = serde_json::from_str(&ok(&["--json", "signals", "gap.setpoint"])).unwrap();
    assert_eq!(json[0], json!({ "address": "2005h:5", "key": "Gap.Setpoint", "unit": "V" }));
    assert_eq!(ok(&["--json", "object", "2001:2", "1"]), "{\"key\":\"EDM control.Hold\",\"written\":\"1\"}\n");
    let (code, said, why) = run(&rig.connection(), &["--json", "settings", "get", "friction"]);
    let error: Value = serde_json::from_str(&said).unwrap();
    assert_eq!((code, error["exit"].as_i64(), error["error"].as_str()), (Some(2), Some(2), Some(why.trim_end())));
    // A script that the shell itself takes, and that knows the commands.
    let script = ok(&["completion", "bash"]);
    let words = format!(
        "{script}\nCOMP_WORDS=(edm-desk bo); COMP_CWORD=1; _edm__desk edm-desk bo edm-desk; echo \"${{COMPREPLY[@]}}\""
    );
    let completed = std::process::Command::new("bash").args(["-c", &words]).output().unwrap();
    assert_eq!(
        String::from_utf8(completed.stdout).unwrap().trim(),
        "bore",
        "{completed:?}",
        completed = completed.stderr
    );
}

#[test]
fn a_desk_that_is_started_before_its_bus_waits_for_it_and_joins_it_again() {
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let connection = format!("socket://{port}");
    let desk = Desk::new(&connection);
    let mut session = desk.session();
    let none = session.ask(json!({ "do": "heads" })).unwrap_err();
    assert!(none.contains("no bus there") && none.contains("tried again every second"), "{none}");
    for _ in 0..2 {
        let mut rig = Rig::at(&port.to_string());
        session.until(|message| message["bus"] == connection);
        let found = session.ask(json!({ "do": "heads" })).unwrap();
        assert_eq!(found[0]["now"]["state"], "disabled");
        session.until(|message| message["sample"]["node"] == 1);
        rig.pull();
        session.until(|message| message["gone"]["node"] == 1);
    }
}

#[test]
fn two_programs_that_talk_to_one_head_do_not_disturb_each_other() {
    let rig = Rig::new();
    let programs: Vec<Bus> = (0..3).map(|_| rig.bus()).collect();
    std::thread::scope(|scope| {
        for bus in &programs {
            scope.spawn(|| {
                let sdo = Sdo::new(bus, 1);
                for _ in 0..50 {
                    assert_eq!(sdo.read(Address(0x1018, 4)).unwrap(), [1, 0, 0, 0]);
                    assert_eq!(sdo.read(Address(0x2000, 1)).unwrap(), [0]);
                    assert!(matches!(sdo.read(Address(0x2FFF, 0)), Err(SdoError::Refused(_, 0x0602_0000))));
                }
            });
        }
    });
}

#[test]
fn what_cannot_be_is_refused_in_one_line_and_nothing_is_written() {
    let rig = Rig::with_stranger(9);
    let connection = rig.connection();
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, text: &str| {
        let path = folder.path().join(name);
        fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let eds = include_str!("../../../docs/edm-servo-head.eds");
    let cut = put("cut.eds", "[DeviceInfo]\nVendorNumber=0x0\n");
    let other = put("other.eds", &eds.replace("ProductNumber=0x1", "ProductNumber=0x7"));
    let newer = put("newer.eds", &eds.replace("RevisionNumber=0x3", "RevisionNumber=0x4"));
    let whole = folder.path().join("whole.toml");
    let whole = whole.to_str().unwrap();
    assert_eq!(run(&connection, &["settings", "export", whole]).0, Some(0));
    let text = fs::read_to_string(whole).unwrap().replace("setpoint_v = 60", "setpoint_v = 50");
    let half = put("half.toml", &text[..text.len() / 2]);
    let broken = put("broken.toml", "[gap]\nsetpoint_v = ");
    let absent = folder.path().join("absent").to_str().unwrap().to_owned();
    let short = put("short.token", "abc\n");
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let taken = taken.local_addr().unwrap().to_string();
    for (arguments, part) in [
        (&["--eds", &absent, "heads"][..], "absent: "),
        (&["--eds", &cut, "heads"], "cut.eds: no ProductNumber in [DeviceInfo]"),
        (&["--eds", whole, "heads"], "whole.toml: "),
        (&["--eds", &other, "reset"], "node 1: another device (vendor 0h, product 1h)"),
        (
            &["--eds", &newer, "bore", "--depth", "0.1"],
            "its objects are revision 3, the description file is of revision 4",
        ),
        (&["--node", "9", "reset"], "node 9: not a servo drive (device profile 401)"),
        (&["--node", "5", "watch"], "node 5: no answer at socket://"),
        (&["settings", "import", &half], "half.toml: "),
        (&["settings", "import", &broken], "broken.toml: line 2: "),
        (&["settings", "compare", &absent], "absent: "),
        (&["settings", "set", "gap.setpoint_v=0"], "must be a number from 1 to 300 V"),
        (&["--node", "5", "heads"], "no node 5 answers"),
        (&["settings", "get", "friction"], "did you mean servo.friction_percent"),
        (&["settings", "get", "gap.setpoint"], "did you mean gap.setpoint_v?"),
        (&["bore"], "--depth <MM>"),
        (&["bore", "--path", &absent], "absent: "),
        (&["bore", "--path", &half, "--depth", "1"], "'--path <FILE>' cannot be used with '--depth <MM>'"),
        (&["bore", "--depth", "nan"], "depth NaN mm: must be a number from 0.001 to 1000 mm"),
        (&["bore", "--depth", "0.1", "--height", "-1"], "height -1 mm: must be a number from 0.05 to 10 mm"),
        (&["bring-up", "--report", &absent], "absent: must be a folder"),
        (&["bring-up", "--again"], "--check"),
        (&["bring-up", "--wait", "-1"], "must be a number from 0"),
        (&["scope"], "<SIGNALS>"),
        (&["scope", "3000:1"], "3000h:1: not in the description file"),
        (&["scope", "1008"], "1008: must be an object with a number"),
        (&["scope", "Gap.Voltag"], "Gap.Voltag: no such object, did you mean Gap.Voltage?"),
        (&["scope", "hazard"], "hazard: no such object, did you mean Gap senses.Hazard"),
        (&["signals", "friccion"], "friccion: no signal has this word"),
        (&["scope", "6064", "6064", "6064", "6064", "6064"], "5 signals: must be 1 to 4"),
        (&["scope", "6064", "--every", "0"], "sample period 0 ms: must be 1 to 60000 ms"),
        (&["scope", "6064", "--every", "0.05"], "sample period 0.05 ms: must be 1 to 60000 ms, whole, for objects"),
        (&["scope", "6064", "--trigger", "short"], "this trigger is for signals of the servo tick"),
        (&["scope", "6064", "--pre", "50"], "--of, --pre and --nodes are for signals of the servo tick"),
        (&["scope", "position", "posision"], "posision: must be one of position, set_point,"),
        (&["scope", "position", "--trigger", "changes"], "trigger changes: must be now, rises,"),
        (&["scope", "position", "--every", "0.07"], "sample period 0.07 ms: must be a multiple of 0.05 ms"),
        (&["scope", "--show", "/nowhere.csv"], "/nowhere.csv: "),
        (&["scope", "6064", "--trigger", "rises", "--level", "1e12"], "level 1000000000000: must be a value"),
        (&["object", "2001:1", "3"], "must be a whole number from 0 to 2"),
        (&["object", "3000:1"], "3000h:1: not in the description file"),
        (&["page", "--listen", &taken], "must be a free HOST:PORT"),
        (&["page", "--listen", "nonsense"], "must be a free HOST:PORT"),
        (&["page", "--listen", "0.0.0.0:0"], "an address other than this computer needs --token-file"),
        (&["page", "--unwatched-after", "0"], "must be a number from 1 to 86400 s"),
        (&["page", "--unwatched", "dance"], "[possible values: pause, retreat]"),
        (&["page", "--token-file", &short], "must be at least 16 letters and digits"),
        (&["xyz"], "unrecognized subcommand 'xyz': the commands of `edm-desk` are page, heads, name, settings"),
        (&["bor"], "unrecognized subcommand 'bor': a similar subcommand exists: 'bore'"),
        (&["settings", "dance"], "the commands of `edm-desk settings` are list, get, set, export, compare, import"),
        (&["bore", "--depht", "3"], "a similar argument exists: '--depth'"),
        (&["bore", "--xyz"], "`edm-desk bore --help` lists what it takes"),
        (&["completion", "tcsh"], "[possible values: bash"),
    ] {
        let (code, said, why) = run(&connection, arguments);
        assert_eq!((code, said.as_str(), why.trim_end().lines().count()), (Some(2), "", 1), "{arguments:?}: {why}");
        assert!(why.contains(part), "{arguments:?}: {part:?} is not in {why}");
    }
    assert!(run(&connection, &["settings", "compare", whole]).1.contains("no difference"), "nothing was written");
    drop(rig);
    for (connection, part) in [
        (connection.as_str(), "no bus there"),
        ("/dev/no/adapter", "no adapter there"),
        ("socketcand://127.0.0.1:1/can0", "no bus there"),
        ("nocan7", "nocan7: "),
        ("slcan://x", "must be socket://HOST:PORT"),
    ] {
        let (code, said, why) = run(connection, &["heads"]);
        assert_eq!((code, said.as_str(), why.trim_end().lines().count()), (Some(2), "", 1), "{connection}: {why}");
        assert!(why.contains(part), "{connection}: {why}");
    }
    // Somebody listens there, and says nothing.
    let silent = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let (code, _, why) = run(&format!("socket://{}", silent.local_addr().unwrap()), &["heads"]);
    assert!(code == Some(2) && why.contains("no node answers"), "{why}");
}

#[test]
fn the_page_of_another_site_another_host_and_who_does_not_know_the_token_are_refused() {
    let rig = Rig::new();
    let desk = Desk::new(&rig.connection());
    assert_eq!(desk.upgrade("/session", &[("Origin", &format!("http://{}", desk.address))]), 101);
    assert_eq!(desk.upgrade("/session", &[("Origin", "http://evil.example")]), 403);
    assert_eq!(desk.upgrade("/session", &[("Host", "evil.example")]), 403);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("token");
    fs::write(&path, "0123456789abcdef\n").unwrap();
    let desk = Desk::with(&rig.connection(), &["--token-file", path.to_str().unwrap()]);
    assert_eq!(desk.upgrade("/session", &[]), 401);
    assert_eq!(desk.upgrade("/session?token=0123456789abcdeX", &[]), 401);
    assert_eq!(desk.upgrade("/session?token=0123456789abcdef", &[]), 101);
}

#[test]
fn nonsense_of_a_session_is_answered_and_nothing_ends() {
    let rig = Rig::new();
    let desk = Desk::new(&rig.connection());
    let mut session = desk.session();
    for text in ["", "{}", "[]", r#"{"id":1,"do":"fly"}"#, r#"{"id":1,"do":"reset","node":700}"#] {
        session.send(text);
        session.until(|message| message["error"].as_str().is_some_and(|why| why.starts_with("no request: ")));
    }
    // Whoever asked is answered, whatever the id is and whatever is wrong with the rest.
    for (id, text) in [
        (json!(1), r#"{"id":1}"#),
        (json!(2), r#"{"do":"fly","id":2}"#),
        (json!(3), r#"{"id":3,"do":"bore","node":1,"hole":{"depth_mm":"deep"}}"#),
        (json!(4), r#"{"id":4,"do":"reset","node":0.5}"#),
        (json!(5), r#"{"id":5,"do":"settings","node":[]}"#),
        (json!("six"), r#"{"id":"six","do":["heads"]}"#),
    ] {
        session.send(text);
        let answer = session.until(|message| message["id"] == id);
        assert!(answer["error"].as_str().is_some_and(|why| why.starts_with("no request: ")), "{text}: {answer}");
    }
    let hole = json!({ "do": "bore", "node": 1, "hole": { "depth_mm": -1.0 } });
    session.ask(json!({ "do": "command", "take": true })).unwrap();
    let refused = session.ask(json!({ "do": "reset", "node": 44 })).unwrap_err();
    assert!(refused.contains("node 44: no answer at"), "{refused}");
    assert!(session.ask(hole).unwrap_err().contains("must be a number from 0.001"));
}
