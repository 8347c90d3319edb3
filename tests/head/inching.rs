//! The inch-worm: a coarse axis carries the head on at the end of its stroke.

use crate::bench::Bench;
use edm_servo_head::head::{Carry, Command, Fault, Inch, Reason, Refused, SeenBy, State};
use edm_servo_head::settings::{SettingError, Settings};
use edm_servo_head::units::{MicrometresPerSecond2, Nanometres};

/// Gap that sparks leave, um: wide enough that the head feeds, narrow enough that it finds the work.
const GAP: f64 = 40.0;
const STEP: i64 = 8000;

fn um(um: i64) -> Nanometres {
    Nanometres(um * 1000)
}

/// A head with a coarse axis.
struct Carried {
    bench: Bench,
    /// Where the coarse axis is, um.
    coarse: f64,
    /// Deepest that the electrode has been with pulses off, less the surface of the work then, um.
    nearest: f64,
}

impl Carried {
    fn with(change: impl FnOnce(&mut Settings)) -> Carried {
        let mut bench = Bench::with(|settings| {
            settings.inch_step = STEP as f32;
            settings.feed_max = 2000.0;
            change(settings);
        });
        bench.make_ready();
        Carried { bench, coarse: 0.0, nearest: f64::INFINITY }
    }

    /// Eroding, the path so long.
    fn eroding(to: i64, change: impl FnOnce(&mut Settings)) -> Carried {
        let mut rig = Carried::with(change);
        rig.bench.command(Command::MoveTo(um(to)));
        rig.bench.command(Command::Start);
        rig
    }

    fn tick(&mut self) {
        self.bench.tick();
        let gap = self.bench.surface_um - self.bench.um();
        if self.bench.output.pulses && gap < GAP && gap > 0.0 {
            self.bench.surface_um = self.bench.um() + GAP;
        } else if !self.bench.output.pulses {
            self.nearest = self.nearest.min(gap);
        }
    }

    fn run(&mut self, seconds: f64) {
        (0..(seconds * 20_000.0) as u32).for_each(|_| self.tick());
    }

    fn until(&mut self, seconds: f64, done: impl Fn(&Carried) -> bool) {
        for _ in 0..(seconds * 20_000.0) as u32 {
            self.tick();
            if done(self) {
                return;
            }
        }
        panic!("not within {seconds} s: {:?}", self.bench.head.status());
    }

    fn inch(&self) -> Inch {
        self.bench.head.status().inch
    }

    /// Moves the coarse axis toward the work.
    fn carry(&mut self, by: f64) {
        self.coarse += by;
        self.bench.surface_um -= by;
    }

    fn asks(&mut self) {
        self.until(60.0, |rig| rig.inch() == Inch::Asks);
        self.run(0.01);
    }

    /// Where the electrode is, um, whatever carries it.
    fn place(&self) -> f64 {
        self.bench.um() + self.coarse
    }
}

#[test]
fn a_hole_deeper_than_the_stroke_is_bored_on_at_the_same_count() {
    for seen in [SeenBy::Word, SeenBy::Touch] {
        let mut rig = Carried::eroding(22_000, |settings| settings.inch_seen = seen);
        for (moves, error) in [(1, 9.0), (2, -7.0)] {
            rig.asks();
            let status = *rig.bench.head.status();
            assert_eq!((status.state, status.carry_to), (State::Inching, status.coarse + STEP), "{seen:?}");
            // By its own scale the axis goes where it is asked to in either case.
            let said = match seen {
                SeenBy::Word => rig.coarse + STEP as f64 + error,
                SeenBy::Touch => status.carry_to as f64,
            };
            assert!(!rig.bench.output.pulses);
            let up = rig.bench.surface_um - rig.bench.um();
            assert!(up > STEP as f64 + 480.0, "{up} um above the bottom");
            let (path, before) = (status.path, rig.place());
            rig.nearest = f64::INFINITY;
            rig.carry(STEP as f64 + error);
            rig.run(0.5);
            assert_eq!(rig.inch(), Inch::Asks, "nobody has said anything");
            // Only a touch sees an error that the host does not know of.
            rig.bench.command(Command::Carry(Carry::To(Nanometres((said * 1000.0) as i64))));
            rig.until(5.0, |rig| rig.bench.state() == State::Eroding);
            let status = *rig.bench.head.status();
            assert_eq!(status.inches, moves);
            assert!((status.carried as f64 - rig.coarse).abs() <= 1.0, "{} um, {seen:?}", status.carried);
            // 100 um above where it was, by the path and in the hole.
            assert!((status.path.minus(path).to_f32() + 100.0).abs() < 3.0, "{:?}", status.path.minus(path));
            let off = rig.place() - before - rig.coarse;
            assert!(off.abs() < 1e4, "{off}");
            assert!(rig.nearest > if seen == SeenBy::Word { 20.0 } else { -5.0 }, "as near as {} um", rig.nearest);
        }
        rig.until(60.0, |rig| rig.bench.state() == State::Done);
        rig.run(0.1);
        assert!((rig.place() - 22_000.0).abs() <= 2.0, "{} um, {seen:?}", rig.place());
        let status = rig.bench.head.status();
        assert_eq!((status.inches, status.inch, status.fault), (2, Inch::No, None));
        assert!((status.position - 22_000).abs() <= 1, "{}", status.position);
        let reasons: Vec<Reason> = rig.bench.changes().iter().map(|change| change.reason).collect();
        let inches = reasons.iter().filter(|reason| **reason == Reason::StrokeEnd).count();
        assert_eq!(inches, 2, "{reasons:?}");
    }
}

#[test]
fn a_path_leads_below_the_travel_only_where_a_coarse_axis_carries_the_head() {
    let mut bench = Bench::ready();
    assert!(matches!(bench.head.command(Command::MoveTo(um(13_000))), Err(Refused::OutOfTravel { .. })));
    let mut rig = Carried::with(|_| {});
    rig.bench.command(Command::MoveTo(um(40_000)));
    assert!(matches!(rig.bench.head.command(Command::MoveTo(um(-1))), Err(Refused::OutOfTravel { .. })));
}

#[test]
fn a_path_that_ends_within_the_travel_needs_no_coarse_axis() {
    let mut rig = Carried::eroding(11_830, |_| {});
    rig.until(60.0, |rig| matches!(rig.bench.state(), State::Done | State::Inching));
    assert_eq!(rig.bench.state(), State::Done);
}

#[test]
fn a_refused_move_leads_back_to_the_bottom_and_the_next_start_asks_again() {
    let mut rig = Carried::eroding(15_000, |_| {});
    rig.asks();
    rig.bench.changes();
    rig.bench.command(Command::Carry(Carry::Refused));
    rig.until(5.0, |rig| rig.bench.state() == State::HoldingPosition);
    assert_eq!(rig.bench.changes().last().unwrap().reason, Reason::CarryRefused);
    assert_eq!((rig.inch(), rig.bench.head.status().carried), (Inch::No, 0));
    let below = rig.bench.surface_um - rig.bench.um();
    assert!((100.0..180.0).contains(&below), "{below} um above the bottom");
    rig.bench.command(Command::Start);
    rig.asks();
    rig.carry(STEP as f64);
    rig.bench.command(Command::Carry(Carry::AsAsked));
    rig.until(60.0, |rig| rig.bench.state() == State::Done);
    assert!((rig.place() - 15_000.0).abs() <= 2.0, "{}", rig.place());
}

#[test]
fn a_host_that_is_late_is_no_longer_asked_and_may_still_answer_or_be_asked_again() {
    for again in [false, true] {
        let mut rig = Carried::eroding(15_000, |settings| settings.inch_patience = 0.5);
        rig.asks();
        let um = rig.bench.um();
        rig.until(1.0, |rig| rig.inch() == Inch::Late);
        rig.run(1.0);
        assert_eq!((rig.bench.state(), rig.inch()), (State::Inching, Inch::Late));
        assert!((rig.bench.um() - um).abs() < 3.0, "it waits above the bottom");
        if again {
            rig.bench.command(Command::Start);
            rig.run(0.01);
            assert_eq!(rig.inch(), Inch::Asks);
        }
        rig.carry(STEP as f64);
        rig.bench.command(Command::Carry(Carry::To(Nanometres(STEP * 1000))));
        rig.until(60.0, |rig| rig.bench.state() == State::Done);
        assert!((rig.place() - 15_000.0).abs() <= 2.0, "{}", rig.place());
    }
}

#[test]
fn what_is_far_from_what_was_asked_is_not_believed() {
    // The host says so.
    let mut rig = Carried::eroding(15_000, |_| {});
    rig.asks();
    rig.carry(7000.0);
    rig.bench.command(Command::Carry(Carry::To(um(7000))));
    rig.run(1.0);
    assert_eq!((rig.inch(), rig.bench.head.status().carried), (Inch::Contradicts, 0));
    rig.carry(1000.0);
    rig.bench.command(Command::Carry(Carry::AsAsked));
    rig.until(60.0, |rig| rig.bench.state() == State::Done);
    assert!((rig.place() - 15_000.0).abs() <= 2.0, "{}", rig.place());
    // The bottom shows it: too low, and too high.
    for moved in [7000.0, 8200.0] {
        let mut rig = Carried::eroding(15_000, |settings| settings.inch_seen = SeenBy::Touch);
        rig.asks();
        let waits = rig.bench.um();
        rig.carry(moved);
        rig.bench.command(Command::Carry(Carry::AsAsked));
        rig.until(10.0, |rig| rig.inch() == Inch::Contradicts);
        rig.until(5.0, |rig| (rig.bench.um() - waits).abs() < 3.0);
        rig.run(0.1);
        assert_eq!((rig.bench.state(), rig.bench.fault()), (State::Inching, None));
        rig.carry(8000.0 - moved);
        rig.bench.command(Command::Carry(Carry::AsAsked));
        rig.until(60.0, |rig| rig.bench.state() == State::Done);
        assert!((rig.place() - 15_000.0).abs() <= 2.0, "{}", rig.place());
    }
}

#[test]
fn a_hold_waits_for_the_answer_and_then_at_the_bottom() {
    for carry in [Carry::AsAsked, Carry::Refused] {
        let mut rig = Carried::eroding(15_000, |_| {});
        rig.asks();
        rig.bench.command(Command::Hold);
        rig.run(0.5);
        assert_eq!((rig.bench.state(), rig.inch()), (State::Inching, Inch::Late));
        if carry == Carry::AsAsked {
            rig.carry(STEP as f64);
        }
        rig.bench.changes();
        rig.bench.command(Command::Carry(carry));
        rig.until(5.0, |rig| rig.bench.state() == State::HoldingPosition);
        assert_eq!(rig.bench.changes().last().unwrap().reason, Reason::Held);
        let below = rig.bench.surface_um - rig.bench.um();
        assert!((100.0..180.0).contains(&below), "{below} um above the bottom, {carry:?}");
    }
    // Before it has asked, nobody has to answer.
    let mut rig = Carried::eroding(15_000, |_| {});
    rig.until(60.0, |rig| rig.bench.state() == State::Inching);
    rig.run(0.2);
    rig.bench.command(Command::Hold);
    rig.until(5.0, |rig| rig.bench.state() == State::HoldingPosition);
}

#[test]
fn a_halt_ends_the_path_where_the_head_waits() {
    let mut rig = Carried::eroding(15_000, |_| {});
    rig.asks();
    let waits = rig.bench.um();
    rig.bench.command(Command::Brake(MicrometresPerSecond2(1e6)));
    rig.until(1.0, |rig| rig.bench.state() == State::Ready);
    rig.run(0.1);
    assert!((rig.bench.um() - waits).abs() < 3.0);
    assert_eq!((rig.inch(), rig.bench.head.status().waiting), (Inch::No, 0));
    assert_eq!(rig.bench.head.command(Command::Start), Err(Refused::NoPath));
}

#[test]
fn a_coarse_axis_that_runs_the_electrode_into_the_work_is_a_contact() {
    let mut rig = Carried::eroding(15_000, |_| {});
    rig.asks();
    rig.carry(STEP as f64 + 600.0);
    rig.until(0.1, |rig| rig.bench.fault() == Some(Fault::Contact));
    let touched = rig.bench.um();
    rig.run(1.0);
    assert!(touched - rig.bench.um() > 450.0, "{touched} to {} um", rig.bench.um());
}

#[test]
fn at_rest_the_coarse_axis_may_go_anywhere_and_the_travel_goes_with_it() {
    let mut rig = Carried::with(|_| {});
    rig.bench.command(Command::Carry(Carry::To(um(-3000))));
    rig.run(0.01);
    assert_eq!((rig.bench.head.status().position, rig.bench.head.status().carried), (-3000, -3000));
    assert!(matches!(rig.bench.head.command(Command::MoveTo(um(-3001))), Err(Refused::OutOfTravel { .. })));
    assert_eq!(rig.bench.head.command(Command::Carry(Carry::AsAsked)), Err(Refused::State(State::Ready)));
    assert_eq!(rig.bench.head.command(Command::Carry(Carry::Refused)), Err(Refused::State(State::Ready)));
    rig.bench.command(Command::SetHome(um(0)));
    assert_eq!(rig.bench.head.status().carried, 0);
    let mut rig = Carried::eroding(15_000, |_| {});
    rig.until(10.0, |rig| rig.bench.state() == State::Eroding);
    assert_eq!(rig.bench.head.command(Command::Carry(Carry::To(um(1)))), Err(Refused::State(State::Eroding)));
    let mut bench = Bench::new();
    bench.run(0.01);
    assert_eq!(bench.head.command(Command::Carry(Carry::To(um(1)))), Err(Refused::NotHomed));
}

#[test]
fn a_retrace_ends_at_the_top_of_a_travel_that_has_been_carried_into_the_hole() {
    let mut rig = Carried::eroding(22_000, |_| {});
    for _ in 0..2 {
        rig.asks();
        rig.carry(STEP as f64);
        rig.bench.command(Command::Carry(Carry::AsAsked));
        rig.until(5.0, |rig| rig.bench.state() == State::Eroding);
    }
    // The safe height is far above what the head can reach.
    rig.run(0.5);
    rig.bench.head.raise(Fault::HostSilent);
    rig.until(10.0, |rig| !rig.bench.head.status().reacting);
    let um = rig.bench.um();
    assert!((400.0..=510.0).contains(&um), "{um} um below its upper stop");
    assert_eq!(rig.bench.fault(), Some(Fault::HostSilent));
}

#[test]
fn settings_that_leave_no_room_are_refused() {
    let refused = |key: &str, change: &[(&str, f32)]| {
        let settings = Settings::with(change).unwrap();
        match settings.build() {
            Err(SettingError::Conflict { field, .. }) => assert_eq!(field, key),
            other => panic!("{other:?}"),
        }
    };
    refused("inch.step_um", &[("inch.step_um", 10_800.0)]);
    refused("inch.tolerance_um", &[("inch.step_um", 8000.0), ("inch.tolerance_um", 500.0)]);
    Settings::with(&[("inch.step_um", 10_700.0)]).unwrap().build().unwrap();
    let blind = Settings { inch_seen: SeenBy::Touch, inch_step: 8000.0, contact_below: 0.0, ..Settings::default() };
    assert!(matches!(blind.build(), Err(SettingError::Conflict { field: "inch.seen", .. })));
}
