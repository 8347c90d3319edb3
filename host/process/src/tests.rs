//! The process as its wires show it.

use crate::harness::{Law, Motion, Rig, Voltage};
use crate::parameters::{GAO, SINKER, XIN};
use crate::{Class, Kind, Orders, Parameters, Process, Stretch, Wires};

/// Everything that the gap showed.
#[derive(Default)]
struct Seen {
    stretches: Vec<Stretch>,
    classes: Vec<(Class, f64)>,
}

impl Wires for Seen {
    fn stretch(&mut self, stretch: &Stretch) {
        self.stretches.push(*stretch);
    }
    fn pulse(&mut self, class: Class, us: f64) {
        self.classes.push((class, us));
    }
}

impl Seen {
    /// When gates opened and were to close, seen when the next stretch began.
    fn gates(&self) -> Vec<(f64, f64)> {
        let mut gates: Vec<(f64, f64)> = Vec::new();
        for gate in self.stretches.iter().map(|s| s.gate).filter(|gate| gate.0 < gate.1) {
            match gates.last_mut() {
                Some(last) if last.0 == gate.0 => *last = gate,
                _ => gates.push(gate),
            }
        }
        gates
    }
}

/// Ten thousand steps of 50 us at a gap held at `um`.
fn held(p: &Parameters, um: f64, dirt: f64, orders: Orders) -> (Process, Seen) {
    let mut process = Process::new(p, um, 1).unwrap();
    process.hold(dirt);
    let mut seen = Seen::default();
    for _ in 0..10_000 {
        process.advance(50.0, -um, &orders, &mut seen);
    }
    (process, seen)
}

#[test]
fn the_same_seed_gives_the_same_bits_and_another_does_not() {
    let of = |seed| {
        let mut rig = Rig::of(&SINKER, Law::Voltage(Voltage::calm(50.0)), seed).unwrap();
        rig.run(2.0);
        rig.process.truth()
    };
    assert_eq!(of(3), of(3));
    assert_ne!(of(3), of(4));
}

#[test]
fn a_pulse_ignites_when_it_does_however_it_is_cut_into_steps() {
    // A voltage that rises for much of the pulse.
    let p = Parameters { cable_us: 8.0, ..SINKER.of() };
    let sparks = |us: f64| {
        let mut process = Process::new(&p, 25.0, 1).unwrap();
        process.hold(1.0);
        let mut seen = Seen::default();
        while process.now_us() < 1e5 {
            process.advance(us, -25.0, &Orders::default(), &mut seen);
        }
        seen.classes.into_iter().filter(|c| c.0 == Class::Spark).map(|c| c.1).take(400).collect::<Vec<_>>()
    };
    let (whole, cut) = (sparks(1000.0), sparks(3.0));
    assert!(whole.len() == 400 && cut.len() == 400);
    assert!(whole.iter().zip(&cut).all(|(a, b)| (a - b).abs() < 1e-6));
}

#[test]
fn pulses_of_a_fixed_frequency_follow_each_other_as_set() {
    let (process, seen) = held(&SINKER.of(), 40.0, 1.0, Orders::default());
    let gates = seen.gates();
    assert!(gates.windows(2).all(|pair| (pair[1].0 - pair[0].0 - 200.0).abs() < 1e-6));
    assert!(gates.iter().all(|gate| (gate.1 - gate.0 - 160.0).abs() < 1e-6));
    assert_eq!(process.pulses().total(), 2500);
    assert!(seen.stretches.is_sorted_by(|a, b| a.from <= b.from));
}

#[test]
fn pulses_of_a_fixed_energy_burn_alike_whenever_they_ignite() {
    let p = Parameters { kind: Kind::IsoEnergy, on_us: 50.0, burn_scatter_v: 0.0, ..SINKER.of() };
    let (process, seen) = held(&p, 40.0, 0.0, Orders::default());
    let sparks: Vec<f64> = seen.classes.iter().filter(|c| c.0 == Class::Spark).map(|c| c.1).collect();
    let gates = seen.gates();
    for spark in &sparks {
        let gate = gates.iter().rfind(|gate| gate.0 <= *spark).unwrap();
        assert!((gate.1 - spark - 50.0).abs() < 1e-6, "{gate:?} {spark}");
    }
    let each = process.truth().energy_j * 1e6 / sparks.len() as f64;
    assert!(sparks.len() > 1000 && (each / (50.0 * p.burn_power()) - 1.0).abs() < 0.01, "{each}");
}

#[test]
fn a_pulse_waits_burns_and_carries_its_current() {
    let p = Parameters { burn_scatter_v: 0.0, prompt_sparks: 0.0, ..SINKER.of() };
    let (_, seen) = held(&p, 40.0, 0.0, Orders::default());
    let spark = seen.classes.iter().position(|c| c.0 == Class::Spark).unwrap();
    let at = seen.classes[spark].1;
    let burning = seen.stretches.iter().find(|s| s.from == at).unwrap();
    let before = seen.stretches.iter().rfind(|s| s.from < at).unwrap();
    assert_eq!((before.volts.to, before.amps.to), (100.0, 0.0));
    assert_eq!((burning.volts.to, burning.amps.to), (40.0, 4.0));
    assert!((burning.volts_at(at + 10.0) - 40.0).abs() < 0.1 && (burning.amps_at(at + 10.0) - 4.0).abs() < 0.01);
    let after = seen.stretches.iter().find(|s| s.from > at).unwrap();
    assert_eq!((after.volts.to, after.amps.to, after.gate.0 < after.gate.1), (p.sense_v, 0.0, false));
}

#[test]
fn a_delay_alone_tells_no_spark_from_an_arc() {
    let p = SINKER.of();
    let (_, seen) = held(&p, 40.0, 0.0, Orders { arcs: 0.3, ..Orders::default() });
    let delays = |arc: bool| -> Vec<f64> {
        let classes: &[Class] = if arc { &[Class::Arc, Class::StableArc] } else { &[Class::Spark] };
        let of = |at: f64| seen.stretches.iter().find(|s| s.from == at).map(|s| at - s.gate.0);
        seen.classes.iter().filter(|(class, _)| classes.contains(class)).filter_map(|&(_, at)| of(at)).collect()
    };
    let share = |of: &[f64], most: f64| of.iter().filter(|&&us| us <= most).count() as f64 / of.len() as f64;
    let (sparks, arcs) = (delays(false), delays(true));
    assert!(sparks.len() > 1000 && arcs.len() > 500, "{} {}", sparks.len(), arcs.len());
    let (prompt, at_once) = (share(&sparks, p.cable_us), share(&arcs, 0.0));
    assert!((prompt - p.prompt_sparks).abs() < 0.03, "{prompt} of the sparks");
    assert!((at_once - 1.0 + p.late_arcs).abs() < 0.03, "{at_once} of the arcs");
    assert!(arcs.iter().all(|&us| us == 0.0 || (0.2..=p.late_arc_us + 1e-9).contains(&us)));
    // And some sparks are as early as late arcs.
    assert!(share(&sparks, p.late_arc_us) > prompt);
}

#[test]
fn ignition_delays_are_exponential_with_the_hazard_of_the_gap() {
    // A clean gap of 50 um between even surfaces, without the rise of the voltage.
    let p = Parameters { peak_um: 0.0, cable_us: 0.01, charge_ohm: 0.0, reach_um_v: 0.0, ..SINKER.of() };
    let (_, seen) = held(&p, 50.0, 0.0, Orders::default());
    let mean_us = 1.0 / (p.ignition * 1e-12 * p.area_um2());
    let open = seen.classes.iter().filter(|c| c.0 == Class::Open).count() as f64 / seen.classes.len() as f64;
    let expected = libm::exp(-160.0 / mean_us);
    assert!((open - expected).abs() < 0.03, "{open} {expected}");
}

#[test]
fn a_capacitor_gives_its_energy_once_a_pulse_and_shorts_waste_it() {
    let p = Parameters { burn_scatter_v: 0.0, ..GAO.of() };
    let each = |off_us| {
        let p = Parameters { veil_us: 0.0, ..p };
        let (process, _) = held(&p, 3.0, 1.0, Orders { off_us: Some(off_us), ..Orders::default() });
        let truth = process.truth();
        truth.energy_j * 1e6 / truth.pulses.discharges() as f64
    };
    // 1/2 C (U^2 - ub^2), when it has been charged.
    let full = 0.5 * 4700e-12 * (80.0 * 80.0 - 25.0 * 25.0) * 1e6;
    assert!((each(60.0) / full - 1.0).abs() < 1e-9);
    assert!((0.5 * full..0.9 * full).contains(&each(2.0)), "{} {full}", each(2.0));
    let (_, seen) = held(&p, 5.0, 1.0, Orders::default());
    let peak = seen.stretches.iter().map(|s| s.amps.from).fold(0.0, f64::max);
    // (U - ub) sqrt(C/L).
    assert!((peak - 55.0 * f64::sqrt(4700e-12 / 200e-9)).abs() < 0.5, "{peak}");

    let (process, seen) = held(&p, 5.0, 1.0, Orders { shorted: true, ..Orders::default() });
    assert_eq!(process.truth().energy_j, 0.0);
    assert!(process.pulses().short == process.pulses().total() && process.pulses().short > 10_000);
    let short = seen.stretches.iter().find(|s| s.amps.from > 1.0).unwrap();
    // It decays: 10 ohm and 4700 pF are 47 ns.
    assert_eq!(short.amps.to, 0.0);
    assert!((short.amps_at(short.from + 0.047) / short.amps.from - libm::exp(-1.0)).abs() < 1e-3);
}

#[test]
fn an_rc_generator_discharges_whenever_the_gap_lets_it() {
    let p = Parameters {
        kind: Kind::Rc,
        capacitor_pf: 10_000.0,
        capacitor_ohm: 1000.0,
        burn_scatter_v: 0.0,
        ..SINKER.of()
    };
    let mean = |um| {
        let (process, _) = held(&p, um, 0.0, Orders::default());
        let n = process.pulses();
        assert!(n.spark > 100 && n.short == 0, "{n:?}");
        (n.spark as f64, process.truth().energy_j * 1e6 / n.spark as f64)
    };
    let ((many, little), (few, much)) = (mean(10.0), mean(40.0));
    // Narrower: sooner, and with less in it.
    assert!(many > 2.0 * few && little < 0.8 * much, "{many} {few} {little} {much}");
    assert!(much < 0.5 * 10_000e-12 * 100.0 * 100.0 * 1e6);
}

#[test]
fn the_head_inhibits_pulses_and_sets_the_off_time() {
    let p = SINKER.of();
    let (process, seen) = held(&p, 40.0, 1.0, Orders { pulses: false, ..Orders::default() });
    assert_eq!(process.pulses().total(), 0);
    assert_eq!(seen.stretches.last().unwrap().volts.to, p.sense_v);
    let (_, seen) = held(&p, 40.0, 1.0, Orders { pulses: false, shorted: true, ..Orders::default() });
    assert!(seen.stretches.iter().all(|s| s.volts.to == 0.0));
    let (_, seen) = held(&p, 40.0, 1.0, Orders { off_us: Some(340.0), ..Orders::default() });
    let gates = seen.gates();
    assert!(gates.windows(2).all(|pair| (pair[1].0 - pair[0].0 - 500.0).abs() < 1e-6));
    // Cut off in the middle of a pulse: the gate closes there, and it is none of the classes.
    let mut process = Process::new(&p, 500.0, 1).unwrap();
    let mut seen = Seen::default();
    process.advance(50.0, -500.0, &Orders::default(), &mut seen);
    process.advance(50.0, -500.0, &Orders { pulses: false, ..Orders::default() }, &mut seen);
    assert_eq!(process.pulses().total(), 0);
    assert_eq!(seen.stretches.last().map(|s| (s.from, s.gate)), Some((50.0, (50.0, 50.0))));
}

#[test]
fn a_pause_follows_the_pulses_of_its_class_alone() {
    let p = Parameters { reach_um_v: 0.0, ignition: 400.0, ..SINKER.of() };
    let orders = Orders { arcs: 0.3, pauses_us: [50.0, 60.0, 30.0, 80.0], ..Orders::default() };
    let (process, seen) = held(&p, 40.0, 1.0, orders);
    let pulses = process.pulses();
    assert!(pulses.open > 100 && pulses.spark > 100 && pulses.arc > 100, "{pulses:?}");
    let mut classes = seen.classes.iter().peekable();
    for pair in seen.gates().windows(2) {
        let class = classes.next_if(|(_, at)| (pair[0].0..=pair[0].1).contains(at)).unwrap().0;
        let off = match class {
            Class::Open => 50.0,
            Class::Spark => 60.0,
            // Its own off-time is longer.
            Class::Arc | Class::StableArc => 40.0,
            Class::Short => unreachable!("nothing lies across the gap"),
        };
        assert!((pair[1].0 - pair[0].1 - off).abs() < 1e-6, "{class:?} {pair:?}");
    }
    let (_, seen) = held(&p, 40.0, 1.0, Orders { shorted: true, ..orders });
    assert!(seen.gates().windows(2).all(|pair| (pair[1].0 - pair[0].1 - 80.0).abs() < 1e-6));
    // With an off-time that is requested.
    let (_, seen) = held(&p, 40.0, 1.0, Orders { off_us: Some(90.0), ..orders });
    assert!(seen.gates().windows(2).all(|pair| (pair[1].0 - pair[0].1 - 90.0).abs() < 1e-6));
}

#[test]
fn a_channel_recovers_while_the_generator_is_inhibited() {
    // The head holds the generator back between two pulses: what burned before has so much more time.
    let arcs = |pause_us: f64| {
        let p = Parameters { off_us: 5.0, ..SINKER.of() };
        let mut process = Process::new(&p, 30.0, 1).unwrap();
        let x = |process: &Process| process.depth_um() + process.worn_um() - 30.0;
        for _ in 0..20_000 {
            let at = x(&process);
            process.advance(p.on_us + 1.0, at, &Orders::default(), &mut ());
            process.advance(pause_us, at, &Orders { pulses: false, ..Orders::default() }, &mut ());
        }
        let pulses = process.pulses();
        (pulses.arc as f64 / pulses.discharges() as f64, pulses)
    };
    let (short, long) = (arcs(6.0), arcs(60.0));
    assert!(short.0 > 0.02 && long.0 < 0.5 * short.0, "{short:?} {long:?}");
}

#[test]
fn the_generator_suspends_itself_after_shorts() {
    let p = Parameters { suspend_after: 10.0, suspend_ms: 5.0, ..SINKER.of() };
    let (_, seen) = held(&p, 40.0, 1.0, Orders { shorted: true, ..Orders::default() });
    let pauses: Vec<f64> = seen.gates().windows(2).map(|pair| pair[1].0 - pair[0].1).collect();
    let long = pauses.iter().filter(|pause| (**pause - 5000.0).abs() < 1e-6).count();
    let short = pauses.iter().filter(|pause| (**pause - 40.0).abs() < 1e-6).count();
    assert_eq!(long + short, pauses.len());
    assert!((8..=10).contains(&(short / long)), "{short} {long}");
}

#[test]
fn arcs_follow_short_off_times_and_dirt_and_leave_damage() {
    let run = |off_us, depth_um| {
        let p = Parameters { off_us, depth_um, ..SINKER.of() };
        let mut rig = Rig::new(&p, Law::Voltage(Voltage::calm(55.0)), Motion::default(), 1).unwrap();
        rig.run(40.0);
        let t = rig.process.truth();
        (t.pulses.arc as f64 / t.pulses.total() as f64, t.damage)
    };
    let (usual, short, dirty) = (run(40.0, 0.0), run(10.0, 0.0), run(40.0, 4000.0));
    assert!(short.0 > 3.0 * usual.0 && short.1 > 2.0 * usual.1, "{usual:?} {short:?}");
    assert!(dirty.0 > 3.0 * usual.0 && dirty.1 > 2.0 * usual.1, "{usual:?} {dirty:?}");
}

#[test]
fn a_bridge_shorts_until_the_gap_has_opened() {
    let p = Parameters { bridge_hz: 1000.0, bridge_ms: 1e4, tear_um: 5.0, ..SINKER.of() };
    let mut process = Process::new(&p, 30.0, 1).unwrap();
    let mut x = -30.0;
    let shorts = |process: &mut Process, x: f64| {
        let before = process.pulses();
        (0..40).for_each(|_| process.advance(50.0, x, &Orders::default(), &mut ()));
        process.pulses().since(&before)
    };
    while shorts(&mut process, x).short == 0 {
        assert!(process.now_us() < 1e7);
    }
    assert!(shorts(&mut process, x).short >= 9);
    let tears = (1..100).find(|_| {
        x -= 1.0;
        let n = shorts(&mut process, x);
        n.total() > 0 && n.short == 0
    });
    assert!(tears.is_some_and(|um| um < 60), "{tears:?}");
}

#[test]
fn touching_shorts_within_a_tick() {
    let mut process = Process::new(&SINKER.of(), 40.0, 1).unwrap();
    let mut seen = Seen::default();
    process.advance(100.0, -40.0, &Orders::default(), &mut seen);
    process.advance(50.0, 1.0, &Orders::default(), &mut seen);
    process.advance(50.0, 1.0, &Orders::default(), &mut seen);
    assert!(
        seen.stretches.iter().any(|s| s.volts.to == SINKER.of().short_v && s.from <= 150.0),
        "{:?}",
        seen.stretches
    );
}

#[test]
fn whatever_is_asked_the_gap_shows_one_voltage_without_jumps_and_gates_in_order() {
    use crate::random::{Cause, Stream};
    let rc = Parameters { kind: Kind::Rc, capacitor_pf: 10_000.0, ..SINKER.of() };
    let energy = Parameters { kind: Kind::IsoEnergy, suspend_after: 5.0, ..SINKER.of() };
    for p in [SINKER.of(), energy, XIN.of(), GAO.of(), rc] {
        let mut draw = Stream::new(Cause::Instrument, 5);
        let mut process = Process::new(&p, p.exchange_um, 1).unwrap();
        let mut seen = Seen::default();
        let (mut x, mut orders) = (-p.exchange_um, Orders::default());
        for _ in 0..20_000 {
            if draw.unit() < 0.05 {
                orders = Orders {
                    pulses: draw.unit() < 0.8,
                    off_us: (draw.unit() < 0.3).then_some(300.0 * draw.unit() + 1.0),
                    pauses_us: [0.0; 4],
                    shorted: draw.unit() < 0.1,
                    dead: draw.unit() < 0.05,
                    senseless: draw.unit() < 0.1,
                    arcs: if draw.unit() < 0.1 { draw.unit() } else { 0.0 },
                };
            }
            // Into the work and out again.
            x = process.depth_um() - p.exchange_um * (1.2 * draw.unit() - 0.1);
            process.advance(100.0 * draw.unit(), x, &orders, &mut seen);
        }
        let truth = process.truth();
        assert!(truth.imbalance < 1e-9 && truth.gap_um.is_finite() && x.is_finite(), "{truth:?}");
        assert!(seen.classes.is_sorted_by(|a, b| a.1 <= b.1));
        assert_eq!(seen.classes.len() as u64, truth.pulses.total());
        assert!(seen.stretches.len() > 1000);
        for pair in seen.stretches.windows(2) {
            let [a, b] = pair else { continue };
            assert!(a.from <= b.from, "{a:?} {b:?}");
            assert!((a.volts_at(b.from) - b.volts.from).abs() < 1e-9, "{a:?} {b:?}");
            assert!(b.gate.0 <= b.gate.1 && b.gate.0 <= b.from && b.amps.from >= 0.0 && b.amps.to >= 0.0, "{b:?}");
            assert!((0.0..=p.open_v + 1e-9).contains(&b.volts.to) && b.volts.us > 0.0, "{b:?}");
        }
    }
}

#[test]
fn electrodes_from_a_tenth_to_25_mm_erode_and_keep_their_debris() {
    let mut last = 0.0;
    for radius_um in [100.0_f64, 500.0, 1500.0, 5000.0, 25_000.0] {
        // A small face gets a small current.
        let burn_ohm = (15.0 * 1500.0 * 1500.0 / (radius_um * radius_um)).clamp(15.0, 1000.0);
        let p = Parameters { radius_um, burn_ohm, ..SINKER.of() };
        let mut rig = Rig::new(&p, Law::Voltage(Voltage::calm(50.0)), Motion::default(), 1).unwrap();
        rig.run(20.0);
        let (t, removed) = (rig.process.truth(), rig.process.depth_um() * p.area_um2());
        assert!(t.pulses.spark > 10_000 && t.imbalance < 1e-9, "{radius_um}: {t:?}");
        // A larger face sparks at a wider gap, and what a spark removes stays the same.
        assert!(t.gap_um > last, "{radius_um}: {t:?}");
        assert!((0.2..1.2).contains(&(removed / (t.energy_j * 1e6 * p.removal_um3_uj))), "{radius_um}: {t:?}");
        last = t.gap_um;
    }
}

#[test]
fn depth_is_of_the_work_and_wear_of_the_electrode() {
    let run = |negative| {
        let p = Parameters { negative, ..SINKER.of() };
        let mut rig = Rig::new(&p, Law::Held(35.0), Motion::default(), 1).unwrap();
        rig.bore(50.0, 100.0);
        let t = rig.process.truth();
        // The carrier has gone depth and wear, but for the gap.
        assert!((rig.x - (t.depth_um + t.worn_um - t.gap_um)).abs() < 1e-6, "{} {t:?}", rig.x);
        t.worn_um / t.depth_um
    };
    assert!((run(0.0) - 0.01).abs() < 1e-6);
    assert!((run(1.0) - 0.2).abs() < 1e-6);
}

#[test]
fn a_hole_breaks_through_and_is_clean_then() {
    let p = Parameters { thickness_um: 60.0, ..GAO.of() };
    let mut rig = Rig::new(&p, Law::Fc(200, true), Motion::default(), 1).unwrap();
    rig.bore(30.0, 300.0);
    assert_eq!(rig.process.truth().through, 0.0);
    let dirty = rig.process.truth().dirt;
    while rig.process.truth().through < 1.0 {
        rig.step();
        assert!(rig.t_s() < 300.0, "{:?}", rig.process.truth());
    }
    let depth = rig.process.depth_um();
    assert!((60.0..62.0).contains(&depth), "{depth}");
    let until = rig.t_s() + 20.0;
    rig.run(until);
    let t = rig.process.truth();
    assert!(rig.process.depth_um() - depth < 0.1 && t.dirt < 0.5 * dirty, "{t:?} {dirty}");
}

#[test]
fn charging_goes_with_the_gap_and_the_comparator_sees_it() {
    let p = Parameters { sense_v: 0.0, ..XIN.of() };
    let rise = |um: f64| {
        let (_, seen) = held(&p, um, 0.0, Orders::default());
        let first = seen.stretches.iter().find(|s| s.volts.to == 100.0).unwrap();
        // 63 % of it has come after one time constant.
        assert!((first.volts_at(first.from + first.volts.us) - 63.2).abs() < 0.1);
        first.volts.us
    };
    let (narrow, wide) = (rise(40.0), rise(80.0));
    assert!((0.98..1.1).contains(&narrow) && (0.5..0.57).contains(&wide), "{narrow} {wide}");
}

#[test]
fn craters_grow_with_the_energy_of_a_pulse() {
    let run = |gap| {
        let mut rig = Rig::of(&XIN, Law::Gap(gap), 1).unwrap();
        rig.run(20.0);
        rig.process.truth().crater_um
    };
    // [X] table 4: rougher at the smaller gap. Only the direction is claimed.
    assert!(run(40.0) > run(60.0));
}

#[test]
fn what_does_not_fit_is_refused_before_anything_runs() {
    let p = Parameters { burn_v: 90.0, open_v: 80.0, ..SINKER.of() };
    assert_eq!(Process::new(&p, 40.0, 1).unwrap_err().to_string(), "burn_v must be below open_v");
}

/// A process that arcs for so long at a gap that it keeps, by order, and then as it does by itself for 50 ms; with a retreat between.
fn after_arcs(arcs_us: f64, retreat_um: f64) -> (f64, f64) {
    let mut process = Process::new(&SINKER.of(), 30.0, 1).unwrap();
    let keeps = |process: &mut Process, us: f64, gap_um: f64, arcs: f64| {
        let end = process.now_us() + us;
        while process.now_us() < end {
            let x = process.depth_um() + process.worn_um() - gap_um;
            process.advance(50.0, x, &Orders { arcs, ..Orders::default() }, &mut ());
        }
    };
    keeps(&mut process, arcs_us, 30.0, 1.0);
    if retreat_um > 0.0 {
        keeps(&mut process, 100e3, 30.0 + retreat_um, 0.0);
    }
    let before = process.pulses();
    keeps(&mut process, 50e3, 30.0, 0.0);
    let n = process.pulses().since(&before);
    (n.arc as f64 / n.total() as f64, process.truth().pit_um)
}

#[test]
fn arcs_stay_until_a_retreat_and_dig_a_pit_that_grows() {
    let (few, shallow) = after_arcs(1e3, 0.0);
    let (stays, deep) = after_arcs(50e3, 0.0);
    let (goes, _) = after_arcs(50e3, 60.0);
    assert!(few < 0.3 && stays > 0.9 && goes < 0.3, "{few} {stays} {goes}");
    assert!(deep > 1.5 * shallow && shallow > 0.0, "{deep} {shallow}");
}

#[test]
fn ignition_has_a_reach_that_goes_with_the_voltage() {
    for open_v in [80.0, 100.0] {
        let p = Parameters { open_v, ..SINKER.of() };
        let sparks = |um: f64| held(&p, um, 1.0, Orders::default()).0.pulses().spark;
        // Peaks of 3 um reach that much farther.
        assert!(sparks(open_v) > 0 && sparks(open_v + 4.0) == 0, "{open_v}");
    }
}

#[test]
fn a_discharge_removes_less_where_the_power_is_dense() {
    let of = |radius_um: f64| {
        let p = Parameters { radius_um, ..SINKER.of() };
        let mut rig = Rig::new(&p, Law::Voltage(Voltage::calm(60.0)), Motion::default(), 1).unwrap();
        rig.run(10.0);
        let t = rig.process.truth();
        t.depth_um * p.area_um2() / (t.energy_j * 1e6 * p.removal_um3_uj)
    };
    let (small, large) = (of(500.0), of(5000.0));
    assert!(small < 0.6 * large && large > 0.8, "{small} {large}");
}

#[test]
fn no_channel_ignites_below_its_burn_voltage() {
    let least = |ignites_above: f64| {
        let p = Parameters { burn_scatter_v: 0.0, runout_um: 0.0, ignites_above, ..XIN.of() };
        // A dirty narrow gap ignites while the voltage rises.
        let (_, seen) = held(&p, 9.0, 4.0, Orders::default());
        let burning = seen.stretches.iter().filter(|s| s.volts.to == p.burn_v);
        burning.map(|s| s.volts.from / p.burn_v).fold(f64::INFINITY, f64::min)
    };
    assert!((1.0 - 1e-6..1.3).contains(&least(1.0)) && least(0.0) < 0.9, "{} {}", least(1.0), least(0.0));
}

#[test]
fn a_plain_rc_generator_arcs_when_its_resistance_is_too_small() {
    let arcs = |over_least: f64| {
        let p = Parameters { kind: Kind::Rc, capacitor_pf: 10_000.0, ..SINKER.of() };
        let p = Parameters { capacitor_ohm: over_least * p.least_ohm(), ..p };
        let mut rig = Rig::new(&p, Law::Voltage(Voltage::calm(65.0)), Motion::default(), 1).unwrap();
        rig.run(2.0);
        let n = rig.process.pulses();
        n.arc as f64 / n.total() as f64
    };
    let (half, twice) = (arcs(0.5), arcs(2.0));
    assert!(half > 0.5 && (1e-4..0.05).contains(&twice), "{half} {twice}");
}
