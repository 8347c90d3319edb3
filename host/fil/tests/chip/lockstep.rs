//! The chip and the native core, tick by tick.

use crate::common;
use edm_fil::exercise;
use edm_fil::host;
use edm_fil::image::Image;
use edm_fil::rig::Emulated;
use edm_fil::rig::Witness;
use edm_servo_head::feed::LawName;
use edm_servo_head::head::{Command, Fault, Search, State};
use edm_servo_head::settings::Settings;
use edm_servo_head::units::Nanometres;
use edm_sim::machine::Rig as _;
use edm_sim::process::Plant;
use edm_sim::run::Setup;
use std::collections::BTreeSet;

/// Each kind of break comes once in 20 seconds. `EDM_SEEDS=2` runs a minute of each of two processes instead.
#[test]
fn the_native_core_comes_to_the_same_bit_for_bit_through_retreats_and_faults() {
    let image = Image::parse(common::firmware().to_vec()).unwrap();
    let settings = Settings { commissioned: true, ..Settings::default() };
    let long = std::env::var("EDM_SEEDS").ok().and_then(|seeds| seeds.parse().ok());
    let (seeds, seconds) = long.map_or((1, 20_u32), |seeds| (seeds, 60));
    for seed in 1..=seeds {
        let witness = Witness::twin(&settings).unwrap();
        let (witness, met) =
            exercise::run(&image, f64::from(seconds), seed, witness).unwrap_or_else(|e| panic!("seed {seed}: {e:#}"));
        let Witness::Twin(twin) = witness else { unreachable!() };
        // One tick more: the first, before the day begins.
        assert!(
            twin.ticks() > met.ticks && met.ticks >= u64::from(seconds) * 20_000,
            "{} of {}",
            twin.ticks(),
            met.ticks
        );
        assert!(met.retreats >= 10, "seed {seed}: {met:?}");
        let kinds: BTreeSet<_> = met.faults.iter().map(|f| Fault::name(*f)).collect();
        assert!(kinds.len() >= 10, "seed {seed}: {kinds:?}");
    }
}

#[test]
fn an_end_with_spark_out_and_lift_of_the_chip_is_that_of_the_native_core_bit_for_bit() {
    let image = Image::parse(common::firmware().to_vec()).unwrap();
    let settings = Settings {
        commissioned: true,
        end_spark_out_ms: 500.0,
        end_window_ms: 50.0,
        end_lift: 400.0,
        ..Settings::default()
    };
    let plant = Plant::with(&[("workpiece.surface_mm", 0.5)]).unwrap();
    let witness = Witness::twin(&settings).unwrap();
    let mut rig = Emulated::start(&image, plant, &settings, 1, witness).unwrap();
    host::begin(&mut rig).unwrap();
    common::bore(&mut rig, Nanometres(510_000));
    let mut states = Vec::new();
    for _ in 0..400_000 {
        rig.tick().unwrap();
        let state = rig.status().state;
        if states.last() != Some(&state) {
            states.push(state);
        }
        if state == State::Done {
            break;
        }
    }
    assert!(states.ends_with(&[State::Eroding, State::Lifting, State::Done]), "{states:?}");
    assert!((rig.status().position - 110).abs() <= 5, "{:?}", rig.status());
    assert_eq!(rig.status().fault, None);
}

/// Counts between which a head that holds its place trembles.
fn trembles(rig: &mut Emulated) -> std::ops::RangeInclusive<i64> {
    let mut counts = rig.status().position..=rig.status().position;
    for _ in 0..400 {
        rig.tick().unwrap();
        let position = rig.status().position;
        counts = position.min(*counts.start())..=position.max(*counts.end());
    }
    counts
}

#[test]
fn a_search_for_the_surface_on_the_chip_is_that_of_the_native_core_bit_for_bit() {
    let image = Image::parse(common::firmware().to_vec()).unwrap();
    let settings = Settings { commissioned: true, ..Settings::default() };
    let plant = Plant::with(&[("workpiece.surface_mm", 0.5037)]).unwrap();
    let witness = Witness::twin(&settings).unwrap();
    let mut rig = Emulated::start(&image, plant, &settings, 1, witness).unwrap();
    host::begin(&mut rig).unwrap();
    rig.command(Command::SetHome(Nanometres(0))).unwrap();
    (0..60).for_each(|_| rig.tick().unwrap());
    // Of the counts: a head that is enabled trembles by one, and its status is older than the truth.
    let home = rig.status().position - rig.process().truth().count;
    rig.command(Command::Enable).unwrap();
    let mut surface = 0;
    for (reach_um, found) in [(200, Search::Missed), (0, Search::Found)] {
        rig.command(Command::FindSurface(Nanometres(reach_um * 1000))).unwrap();
        assert_eq!(rig.status().state, State::Touching);
        let mut force = 0.0f64;
        let mut ticks = 0;
        while rig.status().state == State::Touching {
            rig.tick().unwrap();
            force = force.max(rig.process().truth().contact_n);
            ticks += 1;
            assert!(ticks < 40_000, "{:?}", rig.status());
        }
        assert_eq!((rig.status().state, rig.status().fault), (State::Ready, None));
        // Until the drive has heard of it.
        (0..60).for_each(|_| rig.tick().unwrap());
        assert_eq!(host::read(&mut rig, 0x2011, 3).unwrap(), found as u32);
        if found == Search::Found {
            surface = i64::from(host::read(&mut rig, 0x2001, 6).unwrap().cast_signed());
            let truth = rig.process().truth();
            let peak = truth.position_um + truth.least_um;
            let off = surface as f64 - peak - home as f64;
            assert!(off.abs() <= 1.0, "{surface}: off by {off} counts");
            assert!(force <= 5.0, "{force} N");
        }
    }
    // It becomes the datum, and the head goes where that is meant: 150 um above the surface.
    let before = trembles(&mut rig);
    host::write(&mut rig, 0x2011, 6, 1000, 4).unwrap();
    host::write(&mut rig, 0x2011, 5, 1, 1).unwrap();
    assert_eq!(host::read(&mut rig, 0x2001, 6).unwrap(), 1000);
    let told = i64::from(host::read(&mut rig, 0x6064, 0).unwrap().cast_signed());
    let after = trembles(&mut rig);
    assert!(
        (before.start().min(after.start()) - 1..=before.end().max(after.end()) + 1).contains(&(told - 1000 + surface)),
        "{told}"
    );
    assert!(before.start() <= after.end() && after.start() <= before.end(), "nothing has moved");
    host::write(&mut rig, 0x6060, 0, 1, 1).unwrap();
    host::write(&mut rig, 0x607A, 0, 850, 4).unwrap();
    host::write(&mut rig, 0x6040, 0, 0x1F, 2).unwrap();
    for _ in 0..4000 {
        rig.tick().unwrap();
    }
    assert!((rig.status().position - surface + 150).abs() <= 2, "{:?}", rig.status());
}

#[test]
fn a_jump_of_the_chip_is_that_of_the_native_core_bit_for_bit() {
    let image = Image::parse(common::firmware().to_vec()).unwrap();
    let settings = Settings {
        commissioned: true,
        jump_height: 800.0,
        jump_velocity: 200.0,
        jump_acceleration: 60.0,
        jump_jerk: 12_000.0,
        ..Settings::default()
    };
    let plant = Plant::with(&[("workpiece.surface_mm", 1.2)]).unwrap();
    let witness = Witness::twin(&settings).unwrap();
    let mut rig = Emulated::start(&image, plant, &settings, 1, witness).unwrap();
    host::begin(&mut rig).unwrap();
    common::bore(&mut rig, Nanometres(2_000_000));
    let until = |rig: &mut Emulated, state| {
        for _ in 0..100_000 {
            rig.tick().unwrap();
            if rig.status().state == state {
                return rig.process().truth().position_um;
            }
        }
        panic!("{:?}", rig.status());
    };
    until(&mut rig, State::Eroding);
    (0..4000).for_each(|_| rig.tick().unwrap());
    let before = rig.process().truth().position_um;
    let (mut top, mut contact) = (before, 0.0f64);
    rig.command(Command::Jump).unwrap();
    let mut ticks = 0;
    while rig.status().state != State::Eroding || ticks < 200 {
        rig.tick().unwrap();
        let truth = rig.process().truth();
        (top, contact) = (top.min(truth.position_um), contact.max(truth.contact_n));
        ticks += 1;
        assert!(ticks < 4000, "{:?}", rig.status());
    }
    assert!((before - top - 800.0).abs() < 30.0, "from {before} up to {top}");
    assert_eq!((contact, rig.status().fault), (0.0, None));
    (0..4000).for_each(|_| rig.tick().unwrap());
    assert_eq!(rig.status().state, State::Eroding);
}

/// A host leads the chip, a set point with each SYNC, 1 ms apart and now and then half of that late; a short in between. In a tick
/// of its own each is in force, and the set point never changes its velocity by more than `feed.acceleration_m_s2` allows, but
/// in going away from a short.
#[test]
fn a_guided_chip_is_the_native_core_bit_for_bit() {
    const PERIOD: u32 = 20;
    let image = Image::parse(common::firmware().to_vec()).unwrap();
    let settings = Settings { commissioned: true, ..Settings::default() };
    let witness = Witness::twin(&settings).unwrap();
    let mut rig = Emulated::start(&image, Plant::default(), &settings, 1, witness).unwrap();
    host::begin(&mut rig).unwrap();
    host::write(&mut rig, 0x1401, 2, 1, 1).unwrap();
    rig.command(Command::SetHome(Nanometres(0))).unwrap();
    host::write(&mut rig, 0x6060, 0, 8, 1).unwrap();
    rig.command(Command::Enable).unwrap();
    host::write(&mut rig, 0x2001, 1, 2, 1).unwrap();
    assert_eq!(rig.status().state, State::Guiding);
    // Counts per second, and by how much they may change in a plan and the tick in which a SYNC comes.
    let (feed, step) = (2000.0, f64::from(settings.acceleration) * 1e6 * 7.0 / 20_000.0);
    let (mut at, mut velocity, mut hardest, mut ripple) = (rig.status().setpoint, [0.0; 6], 0.0f64, 0.0f64);
    let (mut released, mut retreats) = (0, 0);
    for n in 0..700u32 {
        let target = (feed * f64::from(n) * 1e-3) as i32;
        let late = if n % 50 == 49 { PERIOD / 2 } else { 0 };
        rig.process_mut().fault_inputs.short = (300..320).contains(&n);
        for tick in 0..PERIOD {
            if tick == late {
                rig.send_at(0, edm_soc::Frame::new(0x301, &target.to_le_bytes()));
                rig.send_at(0, edm_soc::Frame::new(0x80, &[]));
            }
            rig.tick().unwrap();
            released += u32::from(rig.released().is_some());
            let status = *rig.status();
            velocity.rotate_left(1);
            velocity[5] = (status.setpoint.0 - at.0) as f64 / 2f64.powi(24) * 20_000.0;
            at = status.setpoint;
            retreats += u32::from(status.state == State::Retreating);
            // A retreat begins with a step, in whatever motion the head is.
            let change: f64 = velocity[5] - velocity[0];
            if !(300..=330).contains(&n) {
                hardest = hardest.max(change.abs());
            }
            if (20..300).contains(&n) {
                ripple = ripple.max(change.abs());
            }
        }
    }
    assert_eq!((released, rig.status().state, rig.status().fault), (700, State::Guiding, None));
    assert!(retreats > 100, "{retreats} ticks of retreat");
    assert!(hardest < step, "{hardest} counts/s in a plan, {step} allowed");
    // A late set point is due a tick of 25 later: the clock of the host is followed.
    assert!(ripple < 0.05 * feed, "{ripple} of {feed} counts/s");
    assert!((at.to_f32() - 2.0 * 698.0).abs() < 4.0, "{} counts", at.to_f32());
    assert_eq!(host::read(&mut rig, 0x2006, 6).unwrap(), 0, "late");
    let Witness::Twin(twin) = rig.into_witness() else { unreachable!() };
    assert!(twin.ticks() > 700 * u64::from(PERIOD));
}

/// Offsets of a host in cyclic synchronous position: the place that 60B0h adds is where the axis of the model goes, and the force of
/// 60B2h pushes it the way of its sign, until the loops have made up for it.
#[test]
fn offsets_of_position_and_force_move_the_axis_of_the_chip_as_that_of_the_native_core() {
    let image = Image::parse(common::firmware().to_vec()).unwrap();
    let settings = Settings { commissioned: true, ..Settings::default() };
    let witness = Witness::twin(&settings).unwrap();
    let mut rig = Emulated::start(&image, Plant::default(), &settings, 1, witness).unwrap();
    host::begin(&mut rig).unwrap();
    rig.command(Command::SetHome(Nanometres(0))).unwrap();
    host::write(&mut rig, 0x60C2, 1, 10, 1).unwrap();
    host::write(&mut rig, 0x6060, 0, 8, 1).unwrap();
    rig.command(Command::Enable).unwrap();
    let rest = |rig: &mut Emulated| {
        (0..4000).for_each(|_| rig.tick().unwrap());
        rig.process().truth().position_um
    };
    host::write(&mut rig, 0x607A, 0, 400, 4).unwrap();
    let before = rest(&mut rig);
    host::write(&mut rig, 0x60B0, 0, 60, 4).unwrap();
    host::write(&mut rig, 0x607A, 0, 400, 4).unwrap();
    let after = rest(&mut rig);
    assert!((after - before - 60.0).abs() <= 2.0, "from {before} to {after} um");
    for per_mille in [150i16, -150, 0] {
        let at = rest(&mut rig);
        host::write(&mut rig, 0x60B2, 0, u32::from(per_mille.cast_unsigned()), 2).unwrap();
        let (mut least, mut most) = (0.0f64, 0.0f64);
        for _ in 0..1000 {
            rig.tick().unwrap();
            let off = rig.process().truth().position_um - at;
            (least, most) = (least.min(off), most.max(off));
        }
        // It is taken back in the last round: then the other way.
        let down = if per_mille == 0 { 150.0 } else { f64::from(per_mille) };
        let (with, against) = if down > 0.0 { (most, -least) } else { (-least, most) };
        assert!(with >= 3.0 && with > against, "{per_mille}: {least} to {most} um");
        let left = rest(&mut rig) - at;
        assert!(left.abs() <= 2.0, "{per_mille}: {left} um from where it was");
    }
    let Witness::Twin(twin) = rig.into_witness() else { unreachable!() };
    assert!(twin.ticks() > 10_000);
}

/// The chip homes on contact under both touch probes, past an index mark: what its objects say is what the native core has kept,
/// and where the model has work and mark.
#[test]
fn the_probes_of_the_chip_keep_what_those_of_the_native_core_do() {
    let image = Image::parse(common::firmware().to_vec()).unwrap();
    let settings = Settings { commissioned: true, encoder_marks: 1000.0, ..Settings::default() };
    let plant = Plant::with(&[("workpiece.surface_mm", 1.2), ("scale.mark_mm", 1.0)]).unwrap();
    let witness = Witness::twin(&settings).unwrap();
    let mut rig = Emulated::start(&image, plant, &settings, 1, witness).unwrap();
    host::begin(&mut rig).unwrap();
    for command in [Command::SetHome(Nanometres(0)), Command::Enable] {
        rig.command(command).unwrap();
    }
    // Probe 1 the contact, both edges; probe 2 the index mark, where it begins.
    host::write(&mut rig, 0x60B8, 0, 0x1531, 2).unwrap();
    host::write(&mut rig, 0x6098, 0, 0xFF, 1).unwrap();
    host::write(&mut rig, 0x6099, 2, 5000, 4).unwrap();
    host::write(&mut rig, 0x607C, 0, (-3000i32).cast_unsigned(), 4).unwrap();
    host::write(&mut rig, 0x6060, 0, 6, 1).unwrap();
    host::write(&mut rig, 0x6040, 0, 0x1F, 2).unwrap();
    let mut touched = None;
    for _ in 0..8000 {
        rig.tick().unwrap();
        let truth = rig.process().truth();
        if touched.is_none() && truth.least_um <= 0.0 {
            touched = Some((truth.count, rig.status().tick));
        }
    }
    let (count, tick) = touched.unwrap();
    assert_eq!(host::read(&mut rig, 0x6041, 0).unwrap() & 0x3400, 0x1400, "{:?}", rig.status());
    assert_eq!(host::read(&mut rig, 0x60B9, 0).unwrap(), 0x0307);
    let mut read = |index| host::read(&mut rig, index, 0).unwrap();
    let positions = [0x60BA, 0x60BB, 0x60BC].map(&mut read).map(u32::cast_signed);
    let times = [0x60D1, 0x60D2, 0x60D3].map(&mut read);
    let shift = rig.status().position - rig.process().truth().count;
    let off = i64::from(positions[0]) - shift - count;
    let late = times[0].wrapping_sub(tick.wrapping_mul(50_000)).cast_signed();
    assert!(off.abs() <= 1 && (0..=100_000).contains(&late), "{off} counts, {late} ns");
    assert_eq!(i64::from(positions[2]), 1000 + shift);
    assert_eq!(rig.status().fault, None);
    let Witness::Twin(twin) = rig.into_witness() else { unreachable!() };
    let [contact, index] = twin.status().probes;
    let edges = [contact.edges[0], contact.edges[1], index.edges[0]];
    assert_eq!(edges.map(|edge| edge.position), positions.map(i64::from));
    assert_eq!(edges.map(|edge| edge.tick.wrapping_mul(50_000)), times);
}

/// Three tenths of a second of erosion with each. Minimum variance needs the charging of its own machine.
#[test]
fn every_feed_law_on_the_chip_is_that_of_the_native_core_bit_for_bit() {
    let image = Image::parse(common::firmware().to_vec()).unwrap();
    for (law, name) in LawName::ALL.iter().zip(LawName::NAMES) {
        let scenario = if *law == LawName::MinimumVariance { "silicon" } else { "default" };
        let mut setup = Setup::load(scenario).unwrap();
        for assignment in ["workpiece.surface_mm=0.3", &format!("feed.law={name}")] {
            setup.set(assignment).unwrap();
        }
        setup.head.commissioned = true;
        let witness = Witness::twin(&setup.head).unwrap();
        let mut rig = Emulated::start(&image, setup.process, &setup.head, 1, witness).unwrap();
        host::begin(&mut rig).unwrap();
        common::bore(&mut rig, Nanometres(400_000));
        let mut eroded = 0;
        for _ in 0..60_000 {
            rig.tick().unwrap_or_else(|e| panic!("{name}: {e}"));
            eroded += u32::from(rig.status().state.pulses());
            if eroded > 6000 {
                break;
            }
        }
        assert!(eroded > 6000 && rig.status().fault.is_none(), "{name}: {:?}", rig.status());
    }
}
