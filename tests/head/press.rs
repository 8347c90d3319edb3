//! How hard the electrode presses where nothing tells of what is in its way.

use crate::bench::Bench;
use edm_servo_head::head::{Command, Fault};
use edm_servo_head::settings::Settings;
use edm_servo_head::units::Nanometres;

/// Seeks onto a stop, 0.5 mm above the work; the largest force toward the work, N, and what was named.
fn pressed(change: impl FnOnce(&mut Settings)) -> (f64, Option<Fault>) {
    let mut bench = Bench::with(change);
    bench.make_ready();
    bench.stroke_m = 0.0015;
    bench.command(Command::MoveTo(Nanometres(3_000_000)));
    bench.command(Command::Start);
    let mut most = 0.0f64;
    for _ in 0..8 * 20_000 {
        bench.tick();
        most = most.max(bench.force());
    }
    (most, bench.fault())
}

#[test]
fn a_seek_presses_no_harder_than_it_may_onto_what_is_in_its_way_and_says_so() {
    // The supervision waits for the film that faces so large would have between themselves and the stop.
    for (face, most) in [(1.5e3, 5.0f32), (25e3, 5.0), (25e3, 2.0), (30e3, 5.0), (30e3, 1.0)] {
        let (n, named) = pressed(|settings| {
            (settings.contact_press, settings.face, settings.axis_breakaway) = (most, face, 0.3);
        });
        assert!(n <= f64::from(most) + 0.31, "{n} N of {most}, {face} um");
        assert!(matches!(named, Some(Fault::EncoderLost | Fault::FollowingError)), "{most} N, {face} um: {named:?}");
    }
    let (n, _) =
        pressed(|settings| (settings.contact_press, settings.face, settings.axis_breakaway) = (1e3, 25e3, 0.3));
    assert!(n > 15.0, "what it would press: {n} N");
}
