//! What must hold of any machine.

use super::gate::{Gate, Kind, Wanted};
use super::statistics::{Mean, each, largest};
use edm_process::Pulses;
use edm_process::gap::Gap;
use edm_process::harness::{Law, Motion, Rig, Voltage, swing};
use edm_process::parameters::{GAO, MACHINES, Parameters, SINKER};
use edm_sim::plot::Figure;

/// Seeds of a mean.
const SEEDS: u64 = 8;
/// Seeds of a gain at the top, which must be known to 0.3 %; in a hole, times scatter less.
const MANY_SEEDS: u64 = 20;

/// Time to a depth and classes of pulses, by seed.
struct Bored {
    seconds: Mean,
    pulses: Pulses,
    imbalance: f64,
}

impl Bored {
    fn share(&self, of: u64) -> f64 {
        100.0 * of as f64 / self.pulses.total().max(1) as f64
    }
}

/// Bores to a depth under every one of these conditions.
fn bore(conditions: &[(Parameters, Law, Motion)], seeds: u64, depth_um: f64, at_most_s: f64) -> Vec<Bored> {
    let runs: Vec<(usize, u64)> = (0..conditions.len()).flat_map(|k| (1..=seeds).map(move |seed| (k, seed))).collect();
    let all = each(&runs, |&(k, seed)| {
        let (p, law, motion) = &conditions[k];
        let Ok(mut rig) = Rig::new(p, *law, *motion, seed) else { return (f64::NAN, Pulses::default(), f64::NAN) };
        let seconds = rig.bore(depth_um, at_most_s);
        (seconds, rig.process.pulses(), rig.process.truth().imbalance)
    });
    let by_condition = all.chunks(seeds as usize);
    by_condition
        .map(|runs| Bored {
            seconds: Mean::new(&runs.iter().map(|run| run.0).collect::<Vec<_>>()),
            pulses: runs.iter().fold(Pulses::default(), |sum, run| sum.plus(&run.1)),
            imbalance: largest(runs.iter().map(|run| run.2)),
        })
        .collect()
}

pub fn buzz() -> Vec<Gate> {
    const SETS: [f64; 4] = [45.0, 50.0, 55.0, 60.0];
    const HOLES: [f64; 2] = [0.0, 3000.0];
    let mut gates = Vec::new();
    let mut gains = Vec::new();
    for comes_back in [1.0, 0.0] {
        let mut found = Vec::new();
        for depth_um in HOLES {
            let mut conditions = Vec::new();
            for set in SETS {
                let p = Parameters { depth_um, comes_back, ..SINKER.of() };
                for buzz in [(0.0, 0.0), (5.0, 200.0)] {
                    let motion = Motion { buzz, ..Motion::default() };
                    conditions.push((p, Law::Voltage(Voltage::calm(set)), motion));
                }
            }
            let seeds = if depth_um == 0.0 && comes_back > 0.0 { MANY_SEEDS } else { SEEDS };
            let bored = bore(&conditions, seeds, 300.0, 3000.0);
            found.extend(bored.chunks(2).map(|pair| pair[0].seconds.gain(&pair[1].seconds)));
        }
        gains.push(found);
    }
    let said = |gains: &[Mean]| {
        let of = |hole: usize| {
            let all = gains.iter().skip(hole * SETS.len()).take(SETS.len());
            all.map(|gain| format!("{:.2} +- {:.2}", gain.of, gain.error)).collect::<Vec<_>>().join(", ")
        };
        format!("at 45, 50, 55, 60 V: {} at 0 mm; {} at 3 mm", of(0), of(1))
    };
    let figure = |name: &str, gains: &[Mean]| {
        let of = |hole: usize| SETS.into_iter().zip(gains.iter().skip(hole * SETS.len()).copied()).collect::<Vec<_>>();
        Figure::new(name, "set point, V", "gain in time, %").curve("0 mm", of(0)).curve("3 mm deep", of(1))
    };
    let worst = |of: fn(&Mean) -> f64| largest(gains[0].iter().map(of));
    gates.push(
        Gate::new(
            Kind::Physics,
            "buzz of 5 um peak to peak at 200 Hz: largest gain in time, %",
            worst(|gain| gain.of),
            Wanted::AtMost(2.0),
            said(&gains[0]),
        )
        .drawn([
            figure("Buzz of 5 um p-p at 200 Hz", &gains[0]).limit("gate", 2.0),
            figure("The same where nothing comes back (false model)", &gains[1]),
        ]),
    );
    gates.push(Gate::new(
        Kind::Physics,
        "buzz: largest standard error of a gain, %",
        worst(|gain| gain.error),
        Wanted::AtMost(0.3),
        format!("{MANY_SEEDS} seeds at 0 mm, {SEEDS} at 3 mm, 0.3 mm each"),
    ));
    for (hole, name) in ["at 0 mm", "at 3 mm"].into_iter().enumerate() {
        let all = gains[1].iter().skip(hole * SETS.len()).take(SETS.len()).map(|gain| gain.of);
        let mean = all.sum::<f64>() / SETS.len() as f64;
        gates.push(Gate::new(
            Kind::Physics,
            format!("buzz, negative control in which nothing comes back, {name}: mean gain, %"),
            mean,
            Wanted::AtLeast(5.0),
            format!("where it gains little the gate sees little; {}", said(&gains[1])),
        ));
    }
    gates
}

pub fn set_point() -> Vec<Gate> {
    const SETS: [f64; 8] = [65.0, 60.0, 55.0, 50.0, 45.0, 40.0, 35.0, 30.0];
    /// Index of the set point 10 V lower.
    const LOWER: usize = 2;
    let p = SINKER.of();
    let conditions = SETS.map(|set| (p, Law::Voltage(Voltage::calm(set)), Motion::default()));
    let bored = bore(&conditions, SEEDS, 200.0, 2000.0);
    let full_burn = p.burn_v * p.on_us / (p.on_us + p.off_us);
    let times = bored.iter().map(|bored| bored.seconds.of).enumerate();
    let best = times.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |best| best.0);
    let said = SETS.iter().zip(&bored).map(|(set, b)| {
        let (arcs, shorts) = (b.share(b.pulses.arc), b.share(b.pulses.short));
        format!("{set} V: {:.1} +- {:.1} s, arcs {arcs:.1} %, shorts {shorts:.2} %", b.seconds.of, b.seconds.error)
    });
    let mut gates = vec![
        Gate::new(
            Kind::Physics,
            "set point of the shortest time over the reading at full burn, V",
            SETS[best] - full_burn,
            Wanted::AtLeast(8.0),
            said.collect::<Vec<_>>().join("; "),
        )
        .drawn([
            Figure::new("Time to 0.2 mm", "set point, V", "time, s")
                .curve("simulated", SETS.into_iter().zip(bored.iter().map(|b| b.seconds))),
            Figure::new("Arcs", "set point, V", "arcs, % of pulses")
                .line("simulated", SETS.into_iter().zip(bored.iter().map(|b| b.share(b.pulses.arc))))
                .limit("gate, at the best set point", 15.0),
        ]),
    ];
    let Some(lower) = bored.get(best + LOWER) else { return gates };
    let arcs = |b: &Bored| b.share(b.pulses.arc);
    let slower = 100.0 * (lower.seconds.of / bored[best].seconds.of - 1.0);
    gates.push(Gate::new(Kind::Physics, "10 V below it: longer by, %", slower, Wanted::AtLeast(5.0), ""));
    let more = arcs(lower) / arcs(&bored[best]);
    gates.push(Gate::new(Kind::Physics, "10 V below it: times the arcs", more, Wanted::AtLeast(1.5), ""));
    gates.push(Gate::new(Kind::Physics, "arcs at it, % of pulses", arcs(&bored[best]), Wanted::AtMost(15.0), ""));
    gates
}

/// Rate of removal after 40 s for 160 s, um/s.
fn rate(depth_um: f64, jump: (f64, f64, f64)) -> Mean {
    let p = Parameters { depth_um, ..SINKER.of() };
    let seeds: Vec<u64> = (1..=4).collect();
    Mean::new(&each(&seeds, |&seed| {
        let motion = Motion { jump, ..Motion::default() };
        let Ok(mut rig) = Rig::new(&p, Law::Voltage(Voltage::calm(55.0)), motion, seed) else { return f64::NAN };
        rig.run(40.0);
        let before = rig.process.depth_um();
        rig.run(200.0);
        (rig.process.depth_um() - before) / 160.0
    }))
}

pub fn depth() -> Vec<Gate> {
    const JUMP: (f64, f64, f64) = (3000.0, 3.0, 100.0);
    const NONE: (f64, f64, f64) = (0.0, 0.0, 0.0);
    let ratio = |jump| {
        let (shallow, deep) = (rate(500.0, jump), rate(5000.0, jump));
        let said = format!("{:.2} over {:.2} um/s at 55 V", deep.of, shallow.of);
        (deep.of / shallow.of, said, [(0.5, shallow), (5.0, deep)])
    };
    let ((without, said, plain), (with, said_with, jumps)) = (ratio(NONE), ratio(JUMP));
    let figure = Figure::new("Rate at two depths, 55 V", "depth, mm", "rate, um/s")
        .curve("without jumps", plain)
        .curve("jumps of 3 mm every 3 s", jumps);
    vec![
        Gate::new(Kind::Physics, "rate at 5 mm over rate at 0.5 mm", without, Wanted::AtMost(1.0 / 3.0), said)
            .drawn([figure]),
        Gate::new(Kind::Physics, "the same with jumps of 3 mm every 3 s", with, Wanted::AtLeast(0.8), said_with),
    ]
}

pub fn monotony() -> Vec<Gate> {
    // Every pulse that waits draws once from a stream of its own, so two gaps meet the same draws and a wider one has to
    // wait longer in every single pulse.
    let (mut volts, mut hazards, mut looked) = (0, 0, 0);
    let mut figures = Vec::new();
    for machine in MACHINES {
        let mut figure = Figure::new(machine.name, "gap, um", "mean voltage, V");
        for dirt in [0.0, 1.0, 4.0] {
            let p = Parameters { burn_scatter_v: 0.0, runout_um: 0.0, ..machine.of() };
            let (mut last_volts, mut last_rate) = (0.0, f64::INFINITY);
            let mut curve = Vec::new();
            for k in 1..=48 {
                let um = p.peak_um + p.exchange_um * f64::from(k) / 16.0;
                let mut gap = Gap::new(&p, um, 1);
                gap.hold(dirt);
                let Ok(mut rig) = Rig::new(&p, Law::Held(um), Motion::default(), 1) else { continue };
                rig.process.hold(dirt);
                rig.run(2.0);
                let mean = rig.mean_volts();
                volts += u32::from(mean < last_volts);
                hazards += u32::from(gap.rate(1e9) > last_rate);
                (last_volts, last_rate) = (mean, gap.rate(1e9));
                looked += 1;
                curve.push((um, mean));
            }
            figure = figure.line(format!("debris {:.0} %", 5.0 * dirt), curve);
        }
        figures.push(figure);
    }
    let note = format!("{looked} pairs: four machines, dirt 0, 1, 4, gaps from peaks to three working gaps");
    vec![
        Gate::new(Kind::Physics, "wider gaps with a lower mean voltage", volts.into(), Wanted::AtMost(0.0), note)
            .drawn(figures),
        Gate::new(Kind::Physics, "wider gaps with a higher hazard", hazards.into(), Wanted::AtMost(0.0), ""),
    ]
}

pub fn mass() -> Vec<Gate> {
    let jumps = Motion { jump: (3000.0, 3.0, 100.0), buzz: (5.0, 200.0) };
    let deep = Parameters { depth_um: 3000.0, flush_kpa: 5.0, ..SINKER.of() };
    let through = Parameters { thickness_um: 200.0, ..GAO.of() };
    let bored = [
        bore(&[(SINKER.of(), Law::Voltage(Voltage::calm(50.0)), jumps)], 2, 300.0, 600.0),
        bore(&[(deep, Law::Voltage(Voltage::thesis(50.0)), jumps)], 2, 300.0, 600.0),
        bore(&[(through, Law::Fc(200, true), Motion::default())], 2, 300.0, 300.0),
    ];
    let worst = largest(bored.iter().flatten().map(|bored| bored.imbalance));
    let note = "jumps and buzz; flushing in a deep hole; through hole of [G]";
    vec![Gate::new(Kind::Physics, "debris lost or made, share of all", worst, Wanted::AtMost(1e-9), note)]
}

pub fn steps() -> Vec<Gate> {
    let halved = |p: Parameters| Parameters { step_us: 0.5 * p.step_us, ..p };
    let (sinker, gao) = (SINKER.of(), GAO.of());
    let mut found: Vec<(String, Mean, Mean)> = Vec::new();
    let seeds: Vec<u64> = (1..=2 * SEEDS).collect();
    for (name, law, p, depth_um) in [
        ("sinker at 50 V", Law::Voltage(Voltage::calm(50.0)), sinker, 200.0),
        ("[G] at DHT 150", Law::Fc(150, true), gao, 200.0),
    ] {
        let of = |p: Parameters| {
            let all = each(&seeds, |&seed| {
                let Ok(mut rig) = Rig::new(&p, law, Motion::default(), seed) else { return [f64::NAN; 3] };
                let seconds = rig.bore(depth_um, 2000.0);
                let n = rig.process.pulses();
                [seconds, n.arc as f64 / n.total() as f64, n.short as f64 / n.total() as f64]
            });
            [0, 1, 2].map(|k| Mean::new(&all.iter().map(|run| run[k]).collect::<Vec<_>>()))
        };
        let (whole, half) = (of(p), of(halved(p)));
        for (k, metric) in ["time", "arcs", "shorts"].into_iter().enumerate() {
            found.push((format!("{name}, {metric}"), whole[k], half[k]));
        }
    }
    let of = |p: Parameters| {
        let all = each(&seeds, |&seed| {
            Rig::new(&p, Law::Voltage(Voltage::thesis(50.0)), Motion::default(), seed)
                .map_or(f64::NAN, |mut rig| swing(&mut rig, 10.0, 20.0).um)
        });
        Mean::new(&all)
    };
    found.push(("thesis machine, swing".to_string(), of(sinker), of(halved(sinker))));
    // 1 is 2 %, or 3 standard errors, whichever is more.
    let beyond = |(_, whole, half): &(String, Mean, Mean)| {
        let error = (whole.error * whole.error + half.error * half.error).sqrt();
        (whole.of - half.of).abs() / (0.02 * whole.of).max(3.0 * error)
    };
    let said = found.iter().map(|(name, whole, half)| {
        format!("{name}: {:.4} +- {:.4}, halved {:.4} +- {:.4}", whole.of, whole.error, half.of, half.error)
    });
    vec![
        Gate::new(
            Kind::Physics,
            "step halved: largest change over what is allowed (2 % or 3 standard errors)",
            largest(found.iter().map(beyond)),
            Wanted::AtMost(1.0),
            said.collect::<Vec<_>>().join("; "),
        )
        .drawn([Figure::new("Step halved: change over what is allowed", "", "share")
            .places(["time", "arcs", "shorts", "[G] time", "[G] arcs", "[G] shorts", "swing"])
            .line("simulated", found.iter().enumerate().map(|(k, row)| (k as f64, beyond(row))))
            .limit("gate", 1.0)]),
    ]
}
