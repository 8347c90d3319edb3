//! How hard the electrode presses where nothing tells of what is in its way.

use crate::bench::Bench;
use edm_servo_head::head::{Command, Fault, State, Structure};
use edm_servo_head::settings::Settings;
use edm_servo_head::units::Nanometres;

/// Seeks onto a stop under a gap that reads 70 of 100 V: neither open nor the work that is looked for; the largest force toward the work, N, and what was named.
fn pressed(change: impl FnOnce(&mut Settings)) -> (f64, Option<Fault>) {
    let mut bench = Bench::with(|settings| {
        settings.seek_threshold = 60.0;
        change(settings);
    });
    bench.make_ready();
    bench.stroke_m = 0.0015;
    bench.command(Command::MoveTo(Nanometres(3_000_000)));
    bench.command(Command::Start);
    // It has measured the open circuit.
    bench.run(0.3);
    bench.follows = Some(35.0);
    let mut most = 0.0f64;
    for _ in 0..12 * 20_000 {
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
        pressed(|settings| (settings.contact_press, settings.face, settings.axis_breakaway) = (20.0, 25e3, 0.3));
    assert!(n > 15.0, "what it would press: {n} N");
}

#[test]
fn a_gap_that_leads_without_a_velocity_in_between_leads_no_faster_than_a_contact_may_come() {
    for (volts, approach) in [(0.001, 5.0), (0.01, 5.0), (0.01, 1.0)] {
        let mut bench = Bench::with(|settings| {
            settings.structure = Structure::SingleLoop;
            (settings.single_p, settings.contact_approach) = (volts, approach);
        });
        bench.make_ready();
        bench.command(Command::MoveTo(Nanometres(6_000_000)));
        bench.command(Command::Start);
        bench.run_until(10.0, |bench| bench.state() == State::Eroding);
        // The work gives way by 3 mm.
        bench.surface_um += 3000.0;
        let (before, mut fastest) = (bench.um(), 0.0f64);
        for _ in 0..20_000 {
            bench.tick();
            fastest = fastest.max(bench.v * 1e3);
        }
        let way = bench.um() - before;
        let bound = f64::from(approach) * 1.3;
        assert!(fastest < bound && way > 500.0, "{volts} 1/V: {fastest} mm/s of {approach}, {way} um");
    }
}

/// Seeks at some velocity, um/s, with a face of this radius in the settings, until the encoder dies 1.5 mm above the work; the
/// velocity of the first touch, mm/s, and what was named before it.
fn touched(seek: f32, face: f32, at_um: f64) -> (f64, Option<Fault>) {
    let mut bench = Bench::with(|settings| (settings.seek_velocity, settings.face) = (seek, face));
    bench.make_ready();
    bench.command(Command::MoveTo(Nanometres(3_000_000)));
    bench.command(Command::Start);
    bench.run_until(20.0, |bench| bench.um() > at_um);
    bench.encoder_dead = true;
    for _ in 0..4 * 20_000 {
        bench.tick();
        if bench.um() >= bench.surface_um {
            return (bench.v * 1e3, bench.fault());
        }
    }
    (0.0, bench.fault())
}

#[test]
fn an_encoder_that_dies_in_an_open_gap_is_lost_before_the_head_is_fast_whatever_the_face_is_said_to_be() {
    for (seek, face) in [(50.0, 1.5e3), (50.0, 0.0), (1e3, 1.5e3), (1e3, 30e3), (5e3, 8.7e3), (5e3, 18e3), (5e3, 30e3)]
    {
        for at_um in [300.0, 1500.0, 1900.0] {
            let at_um = if seek < 100.0 { at_um * 0.1 } else { at_um };
            let (mm_s, named) = touched(seek, face, at_um);
            assert!(mm_s < 8.0, "{seek} um/s, {face} um, dead at {at_um} um: {mm_s} mm/s in the work, {named:?}");
            assert_eq!(named, Some(Fault::EncoderLost), "{seek} um/s, {face} um, dead at {at_um} um");
        }
    }
}
