//! What holds for every path.

use super::*;
use crate::path::Refused;
use proptest::prelude::*;

type Small = Register<1281>;

/// 1 and 2 counts per um, and um.
const GRID: [i64; AXES] = [1000, 500, 1000];

fn um(x: i64) -> Fixed {
    Fixed::whole(x)
}

fn small() -> Small {
    let mut path = Small::EMPTY;
    path.scale(GRID);
    path.restart([Fixed(0); AXES], [Fixed(0); AXES]);
    path.set_retreat(um(100_000));
    path
}

fn at([x, y]: [i64; 2]) -> Point {
    [um(x), um(y), um(0)]
}

fn path(points: &[[i64; 2]]) -> Small {
    let mut path = small();
    for point in points {
        path.push_line(at(*point)).unwrap();
    }
    path
}

#[test]
fn enabling_makes_no_jump() {
    let mut path = path(&[[10, 0]]);
    path.step(um(3));
    path.restart(at([-7, 5]), at([-7, -95]));
    assert_eq!(path.setpoint(), at([-7, 5]));
    assert_eq!(path.s(), um(0));
    assert_eq!(path.step(um(-20)), None);
    assert_eq!(path.setpoint(), at([-7, -35]));
    assert_eq!(path.step(um(-31)), Some(Bound::Memory));
    assert_eq!(path.setpoint(), at([-7, -95]));
}

#[test]
fn at_the_escape_point_there_is_nothing_to_retrace() {
    let mut path = path(&[]);
    path.restart(at([1, 1]), at([1, 1]));
    assert!(path.at_end());
    assert_eq!(path.step(um(-1)), Some(Bound::Memory));
    assert_eq!(path.step(um(1)), Some(Bound::End));
    assert_eq!(path.setpoint(), at([1, 1]));
}

#[test]
fn a_retreat_says_what_bounds_it() {
    let mut path = path(&[[50, 0], [50, 50]]);
    assert_eq!(path.step(um(60)), None);
    path.set_retreat(um(40));
    assert_eq!(path.step(um(-39)), None);
    assert_eq!(path.step(um(-2)), Some(Bound::Distance));
    assert_eq!(path.s(), um(20));
    path.set_retreat(um(30));
    assert_eq!(path.step(um(-1)), Some(Bound::Distance));
    assert_eq!(path.s(), um(20), "a bound set too late holds, it does not push");
    path.set_retreat(um(1000));
    assert_eq!(path.step(um(-30)), Some(Bound::Memory));
    assert_eq!(path.s(), um(0));
}

#[test]
fn the_end_is_reported_and_more_path_goes_on_from_there() {
    let mut path = path(&[[10, 0]]);
    assert_eq!(path.step(um(11)), Some(Bound::End));
    assert!(path.at_end());
    path.push_line(at([10, 8])).unwrap();
    assert!(!path.at_end());
    assert_eq!(path.step(um(1)), None);
    assert_eq!(path.setpoint(), at([10, 2]));
}

#[test]
fn the_queue_refuses_the_257th_waiting_segment_and_the_history_keeps_1024() {
    let mut path = path(&[]);
    let mut x = 0;
    let mut refused = 0;
    for _ in 0..5000 {
        match path.push_line(at([x + 1, 0])) {
            Ok(()) => x += 1,
            Err(Refused::QueueFull) => {
                assert_eq!(path.waiting(), AHEAD);
                refused += 1;
                path.step(um(1));
            }
            Err(other) => panic!("{other:?}"),
        }
    }
    assert!(refused > 2000);
    let top = path.s();
    while path.step(um(-1)).is_none() {}
    assert_eq!(top.minus(path.s()), um(BEHIND as i64 + 1));
    assert_eq!(path.push_line(at([x, 0])), Err(Refused::QueueFull), "retracing does not make room");
}

#[test]
fn a_step_across_many_short_segments_is_bounded_and_loses_nothing() {
    let mut path = path(&[]);
    for x in 1..=20 {
        path.push_line(at([x, 0])).unwrap();
    }
    assert_eq!(path.step(um(20)), Some(Bound::Joints));
    let reached = path.s();
    assert!(reached >= um(7) && reached < um(20));
    while path.step(um(-20)) == Some(Bound::Joints) {}
    assert_eq!(path.s(), um(0));
}

#[test]
fn a_retrace_returns_to_the_same_counts_after_a_million_reversals() {
    let mut path = path(&[[300, 70], [310, -500], [-40, -500], [-41, 0]]);
    let mut seed = 1u64;
    for _ in 0..1_000_000 {
        seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        path.step(Fixed(((seed >> 40) as i64 - (1 << 23)) * 64));
    }
    path.set_retreat(um(1_000_000));
    while path.step(um(-50)) != Some(Bound::Memory) {}
    assert_eq!(path.setpoint(), at([0, 0]));
    while path.step(um(50)) != Some(Bound::End) {}
    assert_eq!(path.setpoint(), at([-41, 0]));
}

proptest! {
    /// The setpoint depends on the coordinate alone, not on how it was reached.
    #[test]
    fn the_setpoint_is_a_pure_function_of_the_coordinate(
        points in prop::collection::vec([-500i64..500, -500i64..500], 1..12),
        steps in prop::collection::vec(-(1i64 << 31)..(1i64 << 31), 1..200),
    ) {
        let mut wandering = small();
        let mut straight = small();
        for point in &points {
            prop_assert_eq!(wandering.push_line(at(*point)), straight.push_line(at(*point)));
        }
        for by in steps {
            wandering.step(Fixed(by));
        }
        while straight.s() < wandering.s() {
            straight.step(wandering.s().minus(straight.s()));
        }
        prop_assert_eq!(wandering.s(), straight.s());
        prop_assert_eq!(wandering.setpoint(), straight.setpoint());
    }
}
