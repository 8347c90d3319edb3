//! Escape: a retreat from a short leads along a vector instead of back along the path, and back to the same place.

use crate::bench::Bench;
use edm_servo_head::head::{Command, Fault, State};
use edm_servo_head::path::{Piece, Shape};
use edm_servo_head::settings::Settings;

fn line(to: [i64; 3]) -> Command {
    Command::AppendTo(Piece { shape: Shape::Line, to, centre: [0; 2], mark: false, stop: false })
}

/// Down, X and Y of the set point, um.
fn place(bench: &Bench) -> [f64; 3] {
    let status = bench.head.status();
    let [x, y] = status.beside.map(|um| f64::from(um.to_f32()));
    [f64::from(status.setpoint.to_f32()), x, y]
}

fn s(bench: &Bench) -> f64 {
    bench.head.status().path.to_f32().into()
}

/// Erodes along a line that leads X by as much as down, 100 um into it, with this escape: up, X, Y, um.
fn eroding(escape: [f32; 3]) -> Bench {
    let mut bench = Bench::with(|settings| {
        [settings.escape_up, settings.escape_x, settings.escape_y] = escape;
    });
    bench.make_ready();
    bench.command(line([1_900_000, 0, 0]));
    bench.command(line([2_900_000, 1_000_000, 0]));
    bench.command(Command::Start);
    bench.run_until(10.0, |bench| bench.state() == State::Eroding);
    bench.surface_um = 2100.0;
    bench.run(2.0);
    let [down, x, _] = place(&bench);
    assert!(x > 50.0 && (down - x - 1900.0).abs() < 1e-3, "on the line: {down} {x}");
    bench.changes();
    bench
}

#[test]
fn a_short_takes_the_head_along_the_vector_in_the_same_tick_and_it_goes_on_at_the_same_place() {
    for escape in [[300.0, 0.0, 0.0], [0.0, -300.0, 0.0], [200.0, 0.0, 150.0], [0.0; 3]] {
        let mut bench = eroding(escape);
        let [down, x, _] = place(&bench);
        bench.reflex = true;
        bench.tick();
        assert!(bench.head.in_force().trajectory.along.0 < 0.0, "{escape:?}");
        let length = escape.iter().map(|um| f64::from(um * um)).sum::<f64>().sqrt();
        let [up, beside, aside] = escape.map(|um| if length > 0.0 { f64::from(um) / length } else { 0.0 });
        let (mut out, mut most) = (s(&bench), 0f64);
        bench.run_until(1.0, |bench| {
            // The head still feeds for a tick or two, then s falls by as much as it is off. X and Y are those of the newest plan: 1.25 um in
            // 250 us, at 5 mm/s.
            out = out.max(s(bench));
            let off = out - s(bench);
            let [now_down, now_x, now_y] = place(bench);
            if length > 0.0 && off > 1.0 {
                let aslant = (out - 1900.0) / 2f64.sqrt();
                let expected = [1900.0 + aslant - off * up, aslant + off * beside, off * aside];
                for (now, expected) in [now_down, now_x, now_y].iter().zip(expected) {
                    assert!((now - expected).abs() < 1.3, "{escape:?}: {now} of {expected}, {off} um off");
                }
            }
            most = most.max(off);
            bench.state() == State::Eroding
        });
        assert!((9.0..40.0).contains(&most), "{escape:?}: off by {most} um");
        // What has shorted is gone, and a little of the work: sideways alone the gap of this bench does not open.
        bench.surface_um += 5.0;
        bench.run(2.0);
        assert_eq!((bench.fault(), bench.state()), (None, State::Eroding));
        let [now_down, now_x, now_y] = place(&bench);
        assert!((now_down - now_x - 1900.0).abs() < 1e-3 && now_y == 0.0, "on its line again: {now_down} {now_x}");
        assert!(
            (2.0..9.0).contains(&(now_x - x)) && (2.0..9.0).contains(&(now_down - down)),
            "{escape:?}: {now_down} of {down}"
        );
    }
}

#[test]
fn an_escape_that_does_not_help_ends_at_its_length_and_the_head_holds_there() {
    for escape in [[50.0, 120.0, 0.0], [0.0, 0.0, -130.0]] {
        let mut bench = eroding(escape);
        let [down, x, y] = place(&bench);
        // The short comes along.
        bench.follows = Some(-1.0);
        bench.run_until(3.0, |bench| bench.fault() == Some(Fault::PersistentShort));
        bench.follows = None;
        bench.surface_um = 1e6;
        let [up, beside, aside] = escape.map(f64::from);
        for _ in 0..20 {
            bench.run(0.05);
            let [now_down, now_x, now_y] = place(&bench);
            for (now, expected) in [(now_down, down - up), (now_x, x + beside), (now_y, y + aside)] {
                assert!((now - expected).abs() < 3.0, "{escape:?}: {now} of {expected}");
            }
        }
        assert!((bench.um() - (down - up)).abs() < 5.0, "{} um", bench.um());
    }
}

#[test]
fn a_second_short_on_the_way_back_takes_the_same_line_once_more() {
    let mut bench = eroding([200.0, 100.0, 0.0]);
    let [down, x, _] = place(&bench);
    for _ in 0..50 {
        bench.reflex = true;
        bench.run(0.02);
        let [now_down, now_x, _] = place(&bench);
        // Up by two, beside by one.
        let (up, beside) = (down - now_down, now_x - x);
        assert!((up - 2.0 * beside).abs() < 4.0, "{up} up, {beside} beside");
        assert!(up < 202.0);
    }
    bench.run(3.0);
    let [now_down, now_x, _] = place(&bench);
    assert_eq!(bench.fault(), None);
    assert!((now_down - now_x - 1900.0).abs() < 1e-3 && (now_x - x).abs() < 3.0, "{now_down} {now_x}");
}

#[test]
fn an_escape_does_not_lead_above_the_travel() {
    let mut bench = eroding([100_000.0, 0.0, 0.0]);
    bench.follows = Some(-1.0);
    bench.run_until(3.0, |bench| bench.fault() == Some(Fault::PersistentShort));
    bench.run(1.0);
    let [down, ..] = place(&bench);
    assert!((0.0..1.0).contains(&down), "{down} um");
}

#[test]
fn only_a_head_that_moves_along_a_path_has_an_escape() {
    let settings =
        Settings { escape_x: 10.0, structure: edm_servo_head::head::Structure::SingleLoop, ..Settings::default() };
    let refused = settings.build().unwrap_err().to_string();
    assert!(refused.contains("escape.up_um") && refused.contains("feed.structure = path"), "{refused}");
}
