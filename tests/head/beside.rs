//! A path that leads other axes beside the head's: nothing moves them that was not asked to.

use crate::bench::Bench;
use edm_servo_head::head::{Command, Fault, Refused, State, Structure};
use edm_servo_head::path::{Piece, Shape};
use edm_servo_head::settings::Settings;

fn line(to: [i64; 3], mark: bool) -> Command {
    Command::AppendTo(Piece { shape: Shape::Line, to, centre: [0; 2], mark, stop: false })
}

fn beside(bench: &Bench) -> [f32; 2] {
    bench.head.status().beside.map(|x| x.to_f32())
}

/// Erodes along a second piece, to this end, for some seconds.
fn eroding(second: Command) -> Bench {
    let mut bench = Bench::ready();
    bench.command(line([2_050_000, 0, 0], false));
    bench.command(second);
    bench.command(Command::Start);
    bench.run_until(10.0, |bench| bench.state() == State::Eroding);
    for _ in 0..100 {
        bench.surface_um = bench.um() + 45.0;
        bench.run(0.1);
    }
    bench
}

#[test]
fn a_head_that_is_switched_off_or_stopped_leaves_the_other_axes_where_they_are() {
    for stop in [true, false] {
        let mut bench = eroding(line([3_050_000, 5_000_000, 0], false));
        let [x, _] = beside(&bench);
        assert!(x > 100.0, "{x}");
        if stop {
            bench.safety.emergency_stop = true;
        } else {
            bench.command(Command::Disable);
        }
        bench.run(0.01);
        let [x, _] = beside(&bench);
        bench.surface_um = 1e9;
        for _ in 0..50 {
            // A hand.
            (bench.x, bench.v) = (bench.x + 0.0001, 0.0);
            bench.run(0.005);
            assert_eq!(beside(&bench), [x, 0.0], "{stop}");
        }
    }
}

#[test]
fn another_structure_is_refused_while_other_axes_go_along() {
    let mut bench = eroding(line([2_050_000, 5_000_000, 0], false));
    let other = Settings { structure: Structure::SingleLoop, ..bench.settings };
    let head = other.build().unwrap().head;
    assert_eq!(bench.head.configure(head), Err(Refused::Alone));
    bench.command(Command::Disable);
    bench.run(0.1);
    bench.command(Command::Enable);
    bench.run_until(3.0, |bench| bench.state() == State::Ready);
    assert_eq!(bench.head.configure(head), Ok(()));
}

#[test]
fn a_guided_head_takes_no_segment() {
    let mut bench = Bench::ready();
    bench.command(Command::Guide);
    bench.run(0.1);
    assert_eq!(bench.state(), State::Guiding);
    assert_eq!(bench.head.command(line([6_000_000, 0, 0], false)), Err(Refused::State(State::Guiding)));
}

#[test]
fn a_short_in_front_of_a_mark_has_its_time() {
    let mut bench = Bench::ready();
    bench.command(line([2_050_000, 0, 0], false));
    bench.command(line([4_000_000, 0, 0], true));
    bench.command(Command::Start);
    bench.run_until(10.0, |bench| bench.state() == State::Eroding);
    while bench.um() < 2052.0 {
        bench.surface_um = bench.um() + 45.0;
        bench.tick();
    }
    let began = bench.head.status().tick;
    while bench.state() != State::Fault {
        bench.surface_um = bench.um() - 0.5;
        bench.tick();
        assert!(bench.head.status().tick - began < 40_000);
    }
    assert_eq!(bench.fault(), Some(Fault::PersistentShort));
    let ms = (bench.head.status().tick - began) / 20;
    assert!((1000..1100).contains(&ms), "{ms} ms");
}
