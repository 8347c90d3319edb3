//! Gates on every scenario: what a feed law that searches for holes in the model must not find.

use super::gate::{Gate, Kind, Wanted};
use super::statistics::{Mean, each, largest};
use edm_process::Pulses;
use edm_process::harness::{Law, Motion, Rig, Voltage};
use edm_process::parameters::{GAO, GAO_CLEAR, Parameters, SINKER};
use edm_sim::plot::Figure;
use edm_sim::run::Setup;

/// Scenarios whose process is another than the others', and two holes in which an earlier model was found to reward arcs.
fn situations() -> Vec<(&'static str, Parameters)> {
    const SCENARIOS: [&str; 11] = [
        "sinker",
        "sinker-100khz",
        "sinker-1khz",
        "sinker-0.1mm",
        "sinker-25mm",
        "sinker-dirty",
        "sinker-deep",
        "cavity",
        "silicon",
        "micro-blind",
        "micro-blind-clear",
    ];
    let model = |name| Setup::load(name).expect("a scenario").process.model();
    let mut all: Vec<(&str, Parameters)> = SCENARIOS.map(|name| (name, model(name))).into();
    all.push(("a hole of 2 mm", Parameters { depth_um: 2000.0, ..SINKER.of() }));
    all.push(("a radius of 0.5 mm", Parameters { radius_um: 500.0, ..SINKER.of() }));
    all
}

/// A machine, the law that moves its electrode, and what else does.
type Condition = (Parameters, Law, Motion);

/// What a machine does in a while, by seed.
struct Done {
    /// Depth over time, um/s.
    rate: Mean,
    pulses: Pulses,
    pit_um: f64,
    gap_um: Mean,
    /// Debris of the front, in 5 %.
    dirt: Mean,
}

impl Done {
    fn arcs(&self) -> f64 {
        100.0 * self.pulses.arc as f64 / self.pulses.total().max(1) as f64
    }

    fn shorts(&self) -> f64 {
        100.0 * self.pulses.short as f64 / self.pulses.total().max(1) as f64
    }
}

/// Runs each condition for some seconds after some others.
fn work(conditions: &[Condition], seeds: u64, settles_s: f64, lasts_s: f64) -> Vec<Done> {
    let runs: Vec<(usize, u64)> = (0..conditions.len()).flat_map(|k| (1..=seeds).map(move |seed| (k, seed))).collect();
    let all = each(&runs, |&(k, seed)| {
        let (p, law, motion) = &conditions[k];
        let nothing = ([f64::NAN; 4], Pulses::default());
        let Ok(mut rig) = Rig::new(p, *law, *motion, seed) else { return nothing };
        rig.run(settles_s);
        let (before, pulses) = (rig.process.depth_um(), rig.process.pulses());
        let (mut gap, mut dirt, mut n) = (0.0, 0.0, 0.0);
        while rig.t_s() < settles_s + lasts_s {
            rig.step();
            if rig.lift_um() == 0.0 {
                (gap, dirt, n) = (gap + rig.process.gap_um(), dirt + rig.process.dirt(), n + 1.0);
            }
        }
        let rate = (rig.process.depth_um() - before) / lasts_s;
        ([rate, rig.process.truth().pit_um, gap / n, dirt / n], rig.process.pulses().since(&pulses))
    });
    all.chunks(seeds as usize)
        .map(|runs| {
            let mean = |k: usize| Mean::new(&runs.iter().map(|run| run.0[k]).collect::<Vec<_>>());
            Done {
                rate: mean(0),
                pulses: runs.iter().fold(Pulses::default(), |sum, run| sum.plus(&run.1)),
                pit_um: largest(runs.iter().map(|run| run.0[1])),
                gap_um: mean(2),
                dirt: mean(3),
            }
        })
        .collect()
}

/// Mean voltage at a share of the way from full burn to no discharge.
fn volts(p: &Parameters, share: f64) -> f64 {
    (p.burn_v + share * (p.open_v - p.burn_v)) * p.on_us / (p.on_us + p.off_us)
}

fn best(done: &[Done]) -> usize {
    let rates = done.iter().map(|done| done.rate.of).enumerate();
    rates.max_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |best| best.0)
}

pub fn arcing() -> Vec<Gate> {
    /// 35 to 72 V of the sinker.
    const SHARES: [f64; 8] = [0.06, 0.16, 0.27, 0.37, 0.48, 0.58, 0.69, 0.83];
    const THRESHOLDS: [u32; 8] = [1000, 700, 500, 300, 200, 150, 100, 50];
    let mut gates = Vec::new();
    for (name, p) in situations() {
        let micro = p.kind == edm_process::Kind::ControlledRc;
        let conditions: Vec<Condition> = (0..SHARES.len())
            .map(|k| {
                let law = if micro {
                    Law::Fc(THRESHOLDS[k], true)
                } else {
                    Law::Voltage(Voltage::calm(volts(&p, SHARES[k])))
                };
                (p, law, Motion::default())
            })
            .collect();
        let done = work(&conditions, 2, 15.0, 40.0);
        let best = best(&done);
        let said = done.iter().enumerate().map(|(k, done)| {
            let set = if micro { format!("{}", THRESHOLDS[k]) } else { format!("{:.0} V", volts(&p, SHARES[k])) };
            format!(
                "{set}: {:.3} um/s, arcs {:.1} %, shorts {:.1} %, gap {:.0} um, dirt {:.2}, pit {:.0} um",
                done.rate.of,
                done.arcs(),
                done.shorts(),
                done.gap_um.of,
                done.dirt.of,
                done.pit_um
            )
        });
        let sets = |k: usize| if micro { f64::from(THRESHOLDS[k]) } else { volts(&p, SHARES[k]) };
        let of = |value: fn(&Done) -> f64, over: f64| {
            done.iter().enumerate().map(|(k, done)| (sets(k), value(done) * over)).collect::<Vec<_>>()
        };
        let figure = Figure::new(name, if micro { "threshold" } else { "set point, V" }, "%")
            .line("rate, % of the best", of(|done| done.rate.of, 100.0 / done[best].rate.of))
            .line("arcs, % of pulses", of(Done::arcs, 1.0))
            .limit("", 15.0);
        let figure = if micro { figure.log() } else { figure };
        gates.push(
            Gate::new(
                Kind::Physics,
                format!("{name}: arcs at the best set point, % of pulses"),
                done[best].arcs(),
                Wanted::AtMost(15.0),
                said.collect::<Vec<_>>().join("; "),
            )
            .drawn([figure]),
        );
    }
    gates
}

/// Index of the best, and by how many percent both ends are worse.
fn inside(done: &[Done]) -> (usize, f64) {
    let best = best(done);
    let of = |k: usize| 100.0 * (1.0 - done[k].rate.of / done[best].rate.of);
    (best, of(0).min(of(done.len() - 1)))
}

pub fn flushing() -> Vec<Gate> {
    const DEPTHS: [f64; 2] = [2000.0, 5000.0];
    const HEIGHTS: [f64; 6] = [50.0, 200.0, 500.0, 1000.0, 3000.0, 10_000.0];
    const EVERY: [f64; 6] = [0.1, 0.3, 1.0, 3.0, 10.0, 30.0];
    const SPEEDS: [f64; 7] = [1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0];
    const PRESSURES: [f64; 10] = [0.0, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0, 1000.0];
    /// Half of the pressure whose flow carries what the discharges remove as 5 % of debris; docs/process-model.md has the
    /// calculation, 0.05 kPa at 2 mm and 0.08 at 5 mm, in front and side gap together.
    const TOO_LITTLE: usize = 2;
    let mut gates: Vec<Gate> = Vec::new();
    let figure = |name: &str, x| Figure::new(name, x, "rate, um/s").log();
    let mut figures = [
        figure("Height of jumps, 1 s apart at 100 mm/s", "height, um"),
        figure("Interval of jumps of 1 mm at 100 mm/s", "interval, s"),
        figure("Speed of jumps of 1 mm, 1 s apart", "speed, mm/s"),
        figure("Flushing without jumps (0 drawn at 0.001 kPa)", "pressure in the gap, kPa"),
        figure("Depth, jumps of 0, 1 and 3 mm every 3 s", "depth, mm"),
    ];
    let [heights, intervals, speeds, pressures, holes] = &mut figures;
    let deep = |depth_um: f64| format!("{} mm deep", depth_um * 1e-3);
    for depth_um in DEPTHS {
        let p = Parameters { depth_um, ..SINKER.of() };
        let law = Law::Voltage(Voltage::calm(55.0));
        let jump = |height: f64, every: f64, speed: f64| {
            (p, law, Motion { jump: (height, every, speed), ..Motion::default() })
        };
        let series: [(&str, &[f64], Vec<Condition>, &mut Figure); 3] = [
            ("height of jumps, um", &HEIGHTS, HEIGHTS.map(|um| jump(um, 1.0, 100.0)).to_vec(), heights),
            ("interval of jumps, s", &EVERY, EVERY.map(|s| jump(1000.0, s, 100.0)).to_vec(), intervals),
            ("speed of jumps, mm/s", &SPEEDS, SPEEDS.map(|mm_s| jump(1000.0, 1.0, mm_s)).to_vec(), speeds),
        ];
        for (name, values, conditions, figure) in series {
            let done = work(&conditions, 3, 30.0, 90.0);
            *figure =
                figure.clone().curve(deep(depth_um), values.iter().copied().zip(done.iter().map(|done| done.rate)));
            let (best, by) = inside(&done);
            let said = values.iter().zip(&done).map(|(value, done)| {
                format!(
                    "{value}: {:.2} um/s, arcs {:.1} %, gap {:.0} um, dirt {:.2}",
                    done.rate.of,
                    done.arcs(),
                    done.gap_um.of,
                    done.dirt.of
                )
            });
            gates.push(Gate::new(
                Kind::Physics,
                format!("{} mm deep: {name}: both ends worse than the best, {}, by, %", depth_um * 1e-3, values[best]),
                by,
                Wanted::AtLeast(1.0),
                said.collect::<Vec<_>>().join("; "),
            ));
        }
    }
    for depth_um in DEPTHS {
        let p = Parameters { depth_um, ..SINKER.of() };
        let law = Law::Voltage(Voltage::calm(55.0));
        let conditions = PRESSURES.map(|flush_kpa| (Parameters { flush_kpa, ..p }, law, Motion::default()));
        let done = work(&conditions, 3, 30.0, 90.0);
        let most = done[best(&done)].rate.of;
        let said = PRESSURES.iter().zip(&done).map(|(kpa, done)| {
            format!("{kpa} kPa: {:.2} um/s, arcs {:.1} %, dirt {:.2}", done.rate.of, done.arcs(), done.dirt.of)
        });
        let said = said.collect::<Vec<_>>().join("; ");
        let flows = PRESSURES.map(|kpa| kpa.max(1e-3)).into_iter().zip(done.iter().map(|done| done.rate));
        *pressures = pressures.clone().curve(deep(depth_um), flows);
        for (name, k) in [("too little at 0.03 kPa", TOO_LITTLE), ("too much at 1 MPa", PRESSURES.len() - 1)] {
            gates.push(Gate::new(
                Kind::Physics,
                format!("{} mm deep, flushing: {name}: slower than the best by, %", depth_um * 1e-3),
                100.0 * (1.0 - done[k].rate.of / most),
                Wanted::AtLeast(1.0),
                said.clone(),
            ));
        }
    }
    const HOLES: [f64; 5] = [500.0, 1000.0, 2000.0, 4000.0, 8000.0];
    for (name, jump) in [
        ("without jumps", (0.0, 0.0, 0.0)),
        ("jumps of 1 mm every 3 s", (1000.0, 3.0, 100.0)),
        ("jumps of 3 mm every 3 s", (3000.0, 3.0, 100.0)),
    ] {
        let conditions = HOLES.map(|depth_um| {
            let p = Parameters { depth_um, ..SINKER.of() };
            (p, Law::Voltage(Voltage::calm(55.0)), Motion { jump, ..Motion::default() })
        });
        let done = work(&conditions, 4, 30.0, 90.0);
        *holes =
            holes.clone().curve(name, HOLES.map(|um| um * 1e-3).into_iter().zip(done.iter().map(|done| done.rate)));
        let rises = done.windows(2).map(|pair| 100.0 * (pair[1].rate.of / pair[0].rate.of - 1.0));
        let said = HOLES.iter().zip(&done).map(|(um, done)| {
            format!("{} mm: {:.2} um/s, arcs {:.1} %, dirt {:.2}", um * 1e-3, done.rate.of, done.arcs(), done.dirt.of)
        });
        gates.push(Gate::new(
            Kind::Physics,
            format!("{name}: largest gain in rate from a hole to the next deeper, %"),
            largest(rises),
            Wanted::AtMost(1.0),
            said.collect::<Vec<_>>().join("; "),
        ));
    }
    if let Some(gate) = gates.first_mut() {
        gate.figures.extend(figures);
    }
    gates
}

pub fn reach() -> Vec<Gate> {
    const RADII: [f64; 5] = [500.0, 1500.0, 5000.0, 10_000.0, 25_000.0];
    let conditions = RADII.map(|radius_um| {
        let p = Parameters { radius_um, ..SINKER.of() };
        (p, Law::Voltage(Voltage::calm(60.0)), Motion::default())
    });
    let done = work(&conditions, 2, 10.0, 20.0);
    let gaps = done.iter().map(|done| done.gap_um.of);
    let said = RADII.iter().zip(&done).map(|(um, done)| format!("{} mm: {:.1} um", um * 1e-3, done.gap_um.of));
    let said = said.collect::<Vec<_>>().join("; ");
    vec![
        Gate::new(
            Kind::Calibration,
            "[R], radii from 0.5 to 25 mm at 60 V: largest gap, um",
            largest(gaps.clone()),
            Wanted::AtMost(100.0),
            said,
        )
        .drawn([Figure::new("Working gap at 60 V against radius", "radius of the face, mm", "gap, um")
            .log()
            .curve("simulated", RADII.map(|um| um * 1e-3).into_iter().zip(done.iter().map(|done| done.gap_um)))
            .limit("[R]: 100 um", 100.0)
            .limit("[R]: 20 um", 20.0)]),
        Gate::new(
            Kind::Validation,
            "[R], radii from 0.5 to 25 mm at 60 V: smallest gap, um",
            -largest(gaps.map(|gap| -gap)),
            Wanted::AtLeast(20.0),
            "",
        ),
    ]
}

/// By how many percent a rate is more than one before.
fn faster(before: &Mean, rate: &Mean) -> Mean {
    let less = before.gain(rate);
    Mean { of: -less.of, ..less }
}

pub fn micro_buzz() -> Vec<Gate> {
    let mut gates: Vec<Gate> = Vec::new();
    let mut gains = Vec::new();
    for machine in [GAO, GAO_CLEAR] {
        let p = machine.of();
        let conditions =
            [(0.0, 0.0), (2.0, 200.0)].map(|buzz| (p, Law::Fc(200, true), Motion { buzz, ..Motion::default() }));
        let done = work(&conditions, 36, 10.0, 60.0);
        let gain = faster(&done[0].rate, &done[1].rate);
        gates.push(Gate::new(
            Kind::Physics,
            format!("{}: buzz of 2 um at 200 Hz: gain in rate less two standard errors, %", machine.name),
            gain.of - 2.0 * gain.error,
            Wanted::AtMost(1.0),
            format!("{:.2} +- {:.2} %", gain.of, gain.error),
        ));
        gains.push((gains.len() as f64, Mean { of: gain.of, error: 2.0 * gain.error }));
    }
    if let Some(gate) = gates.first_mut() {
        gate.figures.push(
            Figure::new("Buzz of 2 um at 200 Hz, two standard errors", "setting of [G]'s machine", "gain in rate, %")
                .places([GAO.name, GAO_CLEAR.name])
                .curve("simulated", gains)
                .limit("gate", 1.0),
        );
    }
    gates
}

/// A condition of a plain RC generator: capacitor, pF, and resistance over the least of textbooks.
fn rc_at(capacitor_pf: f64, over_least: f64) -> Condition {
    let p = Parameters { kind: edm_process::Kind::Rc, capacitor_pf, ..SINKER.of() };
    let p = Parameters { capacitor_ohm: over_least * p.least_ohm(), ..p };
    (p, Law::Voltage(Voltage::calm(0.65 * p.open_v)), Motion::default())
}

/// Arcs against the resistance of a plain RC generator. Textbooks have a least one, 30 sqrt(L/C), below which sparks become arcs: the
/// recovery time was chosen by it with 10 nF, the other capacitors are held out.
fn rc_least() -> Vec<Gate> {
    const RATIOS: [f64; 6] = [0.25, 0.5, 1.0, 1.5, 2.25, 4.5];
    const HALF: usize = 1;
    const MORE: usize = 3;
    const CAPACITORS: [(f64, &str, Kind); 3] =
        [(10e3, "10 nF", Kind::Calibration), (1e3, "1 nF", Kind::Validation), (100e3, "100 nF", Kind::Validation)];
    let mut gates = Vec::new();
    let mut figure = Figure::new("Arcs at 65 V", "resistance over 30 sqrt(L/C)", "arcs, % of pulses").log();
    for (pf, name, kind) in CAPACITORS {
        let done = work(&RATIOS.map(|ratio| rc_at(pf, ratio)), 2, 3.0, 7.0);
        let said = RATIOS.iter().zip(&done).map(|(ratio, done)| {
            format!("{ratio}: {:.3} um/s, arcs {:.2} %, shorts {:.1} %", done.rate.of, done.arcs(), done.shorts())
        });
        let said = said.collect::<Vec<_>>().join("; ");
        figure = figure.line(name, RATIOS.into_iter().zip(done.iter().map(Done::arcs)));
        for (k, wanted) in [(HALF, Wanted::AtLeast(50.0)), (MORE, Wanted::AtMost(15.0))] {
            gates.push(Gate::new(
                kind,
                format!("plain RC, {name}, {} of the least resistance: arcs, % of pulses", RATIOS[k]),
                done[k].arcs(),
                wanted,
                said.clone(),
            ));
        }
    }
    if let Some(gate) = gates.first_mut() {
        gate.figures.push(figure.limit("most at 1.5", 15.0).limit("least at 0.5", 50.0));
    }
    gates
}

pub fn rc() -> Vec<Gate> {
    const SHARES: [f64; 5] = [0.2, 0.35, 0.5, 0.65, 0.8];
    let p = Parameters { kind: edm_process::Kind::Rc, capacitor_pf: 10_000.0, ..SINKER.of() };
    let conditions = SHARES.map(|share| {
        let set = share * p.open_v;
        (p, Law::Voltage(Voltage::calm(set)), Motion::default())
    });
    let done = work(&conditions, 2, 10.0, 20.0);
    let best = best(&done);
    let over = |of: fn(&Done) -> Mean| {
        SHARES.map(|share| share * p.open_v).into_iter().zip(done.iter().map(of)).collect::<Vec<_>>()
    };
    let said = SHARES.iter().zip(&done).map(|(share, done)| {
        format!(
            "{:.0} V: {:.2} um/s, arcs {:.1} %, shorts {:.1} %, gap {:.1} um",
            share * p.open_v,
            done.rate.of,
            done.arcs(),
            done.shorts(),
            done.gap_um.of
        )
    });
    let mut gates = vec![
        Gate::new(
            Kind::Physics,
            "plain RC, 10 nF: arcs at the best set point, % of pulses",
            done[best].arcs(),
            Wanted::AtMost(15.0),
            said.collect::<Vec<_>>().join("; "),
        )
        .drawn([
            Figure::new("Rate", "set point, V", "rate, um/s").curve("simulated", over(|done| done.rate)),
            Figure::new("Arcs", "set point, V", "arcs, % of pulses")
                .curve("simulated", over(|done| Mean { of: done.arcs(), error: 0.0 }))
                .limit("gate, at the best set point", 15.0),
        ]),
    ];
    gates.extend(rc_least());
    gates
}
