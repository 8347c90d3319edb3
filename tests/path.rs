//! The path as a host sees it: lines, arcs and helices, followed forward and back.

#[path = "gates/mixed.rs"]
mod mixed;

use edm_servo_head::path::{
    AHEAD, AXES, Bound, INCONSISTENCY, Path, Piece, Plane, Point, RADII, REACH, Refused, Shape, Turn,
};
use edm_servo_head::units::{Fixed, MicrometresPerSecond2};
use mixed::{Exact, arc, empty, go, mixed};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

const ACCELERATION: MicrometresPerSecond2 = MicrometresPerSecond2(5e6);

fn line(to: [i64; AXES]) -> Piece {
    Piece { shape: Shape::Line, to, centre: [0; 2], mark: false, stop: false }
}

fn whole(seed: u64) -> Box<Path> {
    let mut path = empty();
    for (piece, _) in mixed(seed) {
        path.append(&piece).unwrap();
    }
    path
}

#[test]
fn a_piece_without_length_is_refused() {
    let mut path = empty();
    assert_eq!(path.append(&line([0; AXES])), Err(Refused::NoLength));
    assert_eq!(path.append(&line([0, 1, 0])), Ok(()));
    assert_eq!(path.append(&line([0, 1, 0])), Err(Refused::NoLength));
}

#[test]
fn a_piece_that_leads_too_far_is_refused_and_changes_nothing() {
    let mut path = empty();
    assert_eq!(path.append(&line([0, 0, REACH + 1])), Err(Refused::TooFar { axis: 2 }));
    assert_eq!(path.append(&line([-REACH - 1, 0, 0])), Err(Refused::TooFar { axis: 0 }));
    assert!(path.at_end());
    assert_eq!(path.append(&line([-REACH, REACH, REACH])), Ok(()));
}

#[test]
fn an_arc_whose_radius_is_no_radius_is_refused() {
    let around = |centre: [i32; 2]| Piece {
        shape: Shape::of(Plane::Xy, Turn::Forward),
        to: [0; 3],
        centre,
        mark: false,
        stop: false,
    };
    let (least, most) = RADII;
    for (nm, ok) in [(0, false), (least - 1, false), (least, true), (most, true), (most + 1, false)] {
        let answer = empty().append(&around([nm as i32, 0]));
        let expected = if ok { Ok(()) } else { Err(Refused::Radius { nm: nm as u32 }) };
        assert_eq!(answer, expected);
    }
}

#[test]
fn an_arc_that_does_not_end_where_it_has_its_radius_is_refused() {
    let to = |off: i64| Piece {
        shape: Shape::of(Plane::Zx, Turn::Backward),
        to: [1_000_000 + off, 1_000_000, 0],
        centre: [1_000_000, 0],
        mark: false,
        stop: false,
    };
    // Beside the centre, by which the distance hardly grows; then along the radius.
    assert_eq!(empty().append(&to(0)), Ok(()));
    let mut along = to(0);
    along.to[1] += INCONSISTENCY;
    assert_eq!(empty().append(&along), Ok(()));
    along.to[1] += 1;
    let refused = empty().append(&along).unwrap_err();
    assert_eq!(refused, Refused::Inconsistent { start: 1_000_000, end: 1_000_000 + INCONSISTENCY as u32 + 1 });
    assert!(refused.to_string().contains("2000 nm"), "{refused}");
}

#[test]
fn the_piece_after_the_last_that_fits_is_refused() {
    let mut path = empty();
    for number in 0..=AHEAD as i64 {
        assert_eq!(path.append(&line([number + 1, 0, 0])), Ok(()));
    }
    assert_eq!(path.append(&line([-1, 0, 0])), Err(Refused::QueueFull));
}

#[test]
fn a_path_holds_at_a_stop_until_it_is_over_and_comes_past_it_both_ways_then() {
    let mut path = empty();
    path.append(&Piece { stop: true, ..line([1_000_000, 0, 0]) }).unwrap();
    path.append(&line([2_000_000, 0, 0])).unwrap();
    // Straight on: no corner slows it, and the stop does.
    assert_eq!(path.ahead(MicrometresPerSecond2(5e6)).0, 1000.0);
    assert_eq!(path.step(Fixed::whole(999)), None);
    assert!(!path.at_stop());
    assert_eq!(path.step(Fixed::whole(5)), Some(Bound::Stop));
    assert_eq!((path.s(), path.at_stop(), path.at_end()), (Fixed::whole(1000), true, false));
    assert_eq!(path.step(Fixed::whole(-300)), None);
    assert_eq!(path.step(Fixed::whole(301)), Some(Bound::Stop), "from above again");
    path.pass_stop();
    assert!(!path.at_stop());
    assert_eq!(path.ahead(MicrometresPerSecond2(5e6)).0, 1000.0);
    assert_eq!(path.step(Fixed::whole(500)), None);
    assert_eq!(path.step(Fixed::whole(-600)), None);
    assert_eq!(path.step(Fixed::whole(1100)), None);
    assert_eq!(path.step(Fixed::whole(1)), Some(Bound::End));
    assert!(path.at_end());
}

#[test]
fn the_end_of_the_path_is_no_stop_before_more_is_appended() {
    let mut path = empty();
    path.append(&Piece { stop: true, ..line([1_000_000, 0, 0]) }).unwrap();
    while path.step(Fixed::whole(1000)).is_none() {}
    assert_eq!((path.at_end(), path.at_stop()), (true, false));
    path.append(&line([2_000_000, 0, 0])).unwrap();
    assert_eq!((path.at_end(), path.at_stop()), (false, true));
}

#[test]
fn a_retreat_ends_at_a_mark_unless_it_is_free() {
    let mut path = empty();
    path.append(&line([1_000_000, 0, 0])).unwrap();
    path.append(&Piece { mark: true, ..line([1_000_000, 500_000, 0]) }).unwrap();
    assert_eq!(path.step(Fixed::whole(999)), None);
    assert_eq!(path.step(Fixed::whole(-1)), None, "a mark ahead is none");
    assert_eq!(path.step(Fixed::whole(200)), None);
    assert_eq!(path.step(Fixed::whole(-300)), Some(Bound::Mark));
    assert_eq!(path.s(), Fixed::whole(1000));
    assert_eq!((path.left_behind().0, path.bound()), (0.0, Bound::Mark));
    path.free_retreat();
    assert_eq!(path.step(Fixed::whole(-300)), None);
    assert_eq!(path.step(Fixed::whole(-800)), Some(Bound::Memory));
}

#[test]
fn before_a_corner_the_path_counts_as_ended_and_before_a_smooth_joint_it_does_not() {
    let radius = 1_000_000;
    let quarter = Piece {
        shape: Shape::of(Plane::Zx, Turn::Forward),
        to: [1_000_000 + radius, radius, 0],
        centre: [0, radius as i32],
        mark: false,
        stop: false,
    };
    let mut smooth = empty();
    smooth.append(&line([1_000_000, 0, 0])).unwrap();
    smooth.append(&quarter).unwrap();
    assert!(smooth.ahead(ACCELERATION).0 > 2000.0, "{:?}", smooth.ahead(ACCELERATION));
    let mut corner = empty();
    corner.append(&line([1_000_000, 0, 0])).unwrap();
    corner.append(&line([1_000_000, 1_000_000, 0])).unwrap();
    // 5 m/s^2 for 250 us are 1250 um/s, of which a jump of the direction by 1.41 leaves 884: v^2 / a = 0.156 um.
    let ahead = corner.ahead(ACCELERATION).0;
    assert!((1000.15..=1000.157).contains(&ahead), "{ahead}");
    go(&mut corner, Fixed::whole(1500));
    let behind = corner.behind(ACCELERATION).0;
    assert!((500.15..=500.157).contains(&behind), "{behind}");
    assert_eq!(corner.left_behind().0, 1500.0);
}

#[test]
fn a_feed_of_a_thousandth_of_a_millimetre_a_minute_goes_on() {
    use edm_servo_head::units::MicrometresPerSecond;
    let step = MicrometresPerSecond(1.0 / 60.0).per_tick();
    let mut path = empty();
    path.append(&arc([0; AXES], Plane::Xy, 1e8, 0.1, 0.3, 0)).unwrap();
    let at: Vec<Point> = (0..3)
        .map(|_| {
            (0..20_000).for_each(|_| assert_eq!(path.step(step), None));
            path.setpoint()
        })
        .collect();
    for pair in at.windows(2) {
        let gone =
            pair[0].iter().zip(&pair[1]).map(|(a, b)| f64::from(b.minus(*a).to_f32()).powi(2)).sum::<f64>().sqrt();
        assert!((gone * 60.0 - 1.0).abs() < 0.1, "{gone} um in a second");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// However it got there, and whatever was forgotten or not of how.
    #[test]
    fn the_set_point_depends_on_the_coordinate_alone(
        seed in 0u64..1000,
        steps in prop::collection::vec(-(1i64 << 36)..1i64 << 36, 1..200),
    ) {
        let (mut wandering, mut straight) = (whole(seed), whole(seed));
        for by in steps {
            wandering.step(Fixed(by));
        }
        go(&mut straight, wandering.s());
        prop_assert_eq!(wandering.setpoint(), straight.setpoint());
        prop_assert_eq!(wandering.direction(), straight.direction());
    }

    #[test]
    fn a_joint_is_the_same_point_from_either_side(seed in 0u64..1000) {
        let mut path = empty();
        let mut joint = Fixed(0);
        let (mut before, mut place) = (path.setpoint(), [0; AXES]);
        for (piece, _) in mixed(seed) {
            path.append(&piece).unwrap();
            go(&mut path, joint);
            prop_assert_eq!(path.setpoint(), before);
            // Across, and back.
            go(&mut path, joint.plus(Fixed(1)));
            for (after, before) in path.setpoint().iter().zip(&before) {
                let step = after.minus(*before);
                prop_assert!(step.0.abs() < 200, "a step of {step:?} at the joint after {place:?}");
            }
            go(&mut path, joint);
            joint = joint.plus(path.ahead_of(joint));
            go(&mut path, joint);
            before = path.setpoint();
            prop_assert_eq!(before, piece.to.map(|nm| Fixed(((nm << 24) + if nm < 0 { -500 } else { 500 }) / 1000)));
            place = piece.to;
        }
    }

    /// What a set point goes on by between two steps is what the next one shows.
    #[test]
    fn the_direction_is_that_in_which_the_set_point_goes(seed in 0u64..1000, part in 0.0f64..1.0) {
        let mut path = whole(seed);
        let to = Fixed((path.ahead_of(Fixed(0)).0 as f64 * part) as i64);
        go(&mut path, to);
        let (at, by) = (path.setpoint(), Fixed(1 << 22));
        let travel = path.travel(by);
        let direction = path.direction();
        let square: f32 = direction.iter().map(|x| x * x).sum();
        prop_assert!((square - 1.0).abs() < 2e-3, "{direction:?}");
        prop_assume!(path.ahead(ACCELERATION).0 > 1.0);
        go(&mut path, to.plus(by));
        for ((at, travel), now) in at.iter().zip(&travel).zip(&path.setpoint()) {
            // A quarter of a micrometre on the smallest circle bends by 0.3 nm.
            prop_assert!((at.plus(*travel).minus(*now)).to_f32().abs() < 1e-3);
        }
    }

    /// Of all radii that are allowed, from any place.
    #[test]
    fn an_arc_never_leaves_its_circle_by_a_tenth_of_a_micrometre(
        exponent in 2.0f64..5.0, begin in 0.0f64..1.0, swept in -1.0f64..=1.0, plane in 0usize..3, part in 0.0f64..=1.0,
        x in -100_000_000i64..100_000_000, y in -100_000_000i64..100_000_000,
    ) {
        prop_assume!(swept.abs() > 1e-3);
        let mut path = empty();
        prop_assume!(x != 0 || y != 0);
        path.append(&line([y, x, y])).unwrap();
        let start = path.ahead_of(Fixed(0));
        let plane = [Plane::Xy, Plane::Zx, Plane::Yz][plane];
        let piece = arc([y, x, y], plane, 1000.0 * 10f64.powf(exponent), begin, swept, 0);
        path.append(&piece).unwrap();
        let exact = Exact::new([y, x, y], &piece);
        let length = path.ahead_of(start);
        // A radius is kept in whole nm: seven of them around.
        prop_assert!((length.to_f32() as f64 - exact.length()).abs() < 1e-6 * exact.length() + 0.008);
        go(&mut path, start.plus(Fixed((length.0 as f64 * part) as i64)));
        let at = path.setpoint().map(|axis| axis.0 as f64 / (1u64 << 24) as f64);
        prop_assert!(exact.off_circle(at) <= 0.1, "{} um", exact.off_circle(at));
    }

    /// Nothing of what a host may give makes it panic, and what it takes can be followed forward and back.
    #[test]
    fn any_piece_is_taken_or_refused(
        pieces in prop::collection::vec((any::<[i32; 3]>(), any::<[i32; 2]>(), 0u8..7, any::<[bool; 2]>()), 1..20),
    ) {
        let mut path = empty();
        for (to, centre, shape, [mark, stop]) in pieces {
            let shape = Shape::from_number(shape).unwrap();
            let piece = Piece { shape, to: to.map(|nm| i64::from(nm / 2)), centre, mark, stop };
            prop_assert_eq!(path.extent(&piece).map(|_| ()), path.append(&piece));
        }
        path.free_retreat();
        while !path.at_end() {
            path.pass_stop();
            go(&mut path, Fixed::whole(1 << 37));
        }
        go(&mut path, Fixed::whole(-(1 << 37)));
        prop_assert_eq!(path.setpoint(), [Fixed(0); AXES]);
    }

    #[test]
    fn nothing_of_a_piece_is_outside_what_it_was_said_to_reach(seed in 0u64..1000) {
        let mut path = empty();
        let mut start = Fixed(0);
        for (piece, exact) in mixed(seed).into_iter().take(20) {
            let (up, down) = path.extent(&piece).unwrap();
            path.append(&piece).unwrap();
            for number in 0..100 {
                let [at, ..] = exact.at(f64::from(number) / 100.0);
                prop_assert!(at * 1000.0 >= up as f64 - 3.0 && at * 1000.0 <= down as f64 + 3.0, "{at} um: {up} to {down} nm");
            }
            start = start.plus(path.ahead_of(start));
        }
    }
}

#[test]
fn an_escape_from_anywhere_on_a_path_leads_along_its_line_and_back_to_the_same_set_points() {
    let mut path = whole(7);
    let mut random = Xoshiro256PlusPlus::seed_from_u64(3);
    let mut before = None;
    for _ in 0..2000 {
        let s = path.s().0 + ((random.random_range(-0.3..1.0) * 3e5) * f64::from(1 << 24)) as i64;
        go(&mut path, Fixed(s.max(1 << 24)));
        if path.at_end() {
            break;
        }
        let (s, here, direction) = (path.s(), path.setpoint(), path.direction());
        let by: [i32; AXES] = std::array::from_fn(|_| random.random_range(-1_000_000..1_000_000));
        path.escape(by);
        assert_eq!((path.s(), path.setpoint()), (s, here), "it begins where the path is left");
        let length = by.iter().map(|nm| f64::from(*nm).powi(2)).sum::<f64>().sqrt();
        for _ in 0..4 {
            let off = random.random_range(0.0..length * 1.2e-3);
            let bound = path.step(Fixed(s.0 - (off * f64::from(1 << 24)) as i64 - path.s().0));
            let (reached, over) = (off.min(length * 1e-3), off > length * 1e-3 + 0.01);
            assert_eq!(bound == Some(Bound::Distance), over, "{off} of {length} nm");
            // Another escape is none: it is one line.
            path.escape([1000; AXES]);
            for ((now, here), by) in path.setpoint().iter().zip(&here).zip(by) {
                let (um, expected) = (f64::from(now.minus(*here).to_f32()), reached * f64::from(by) / length);
                assert!((um - expected).abs() < 0.002, "{um} of {expected} um");
            }
        }
        // Where an escape is left it does not matter how: the path goes on in the same step.
        let on = Fixed(random.random_range(0..1 << 24));
        go(&mut path, s.plus(on));
        let beyond = path.setpoint();
        go(&mut path, s);
        assert_eq!((path.setpoint(), path.direction()), (here, direction));
        go(&mut path, s.plus(on));
        assert_eq!(path.setpoint(), beyond);
        assert_eq!(path.off(), None);
        if let Some((s, here)) = before {
            go(&mut path, s);
            assert_eq!(path.setpoint(), here, "and so does the retrace");
        }
        before = Some((s, here));
        go(&mut path, s.plus(on));
    }
    assert!(before.is_some());
}
