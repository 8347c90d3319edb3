//! Published numbers that nothing was fitted to. The laws of \[G\] are the ideal ones of the harness, in both settings of its
//! machine.

use super::calibration;
use super::gate::{Gate, Kind, Wanted};
use super::statistics::{Mean, each, largest};
use edm_process::harness::{Law, Motion, Rig, Voltage};
use edm_process::parameters::{GAO, GAO_CLEAR, Machine, Parameters, SINKER};
use edm_sim::plot::Figure;

const SETTINGS: [Machine; 2] = [GAO, GAO_CLEAR];
/// Depth to which thresholds and off-times are compared, um; \[G\] went to 1000, which takes the minutes of three hundred.
const THRESHOLD_UM: f64 = 300.0;

/// Result of a run of \[G\].
struct Run {
    seconds: Mean,
    /// Short cycles, %.
    short: Mean,
    discharges: Mean,
    /// Long retreats.
    long: Mean,
}

/// Runs of a law until a depth (um), or until the electrode has gone so far where the work is thinner.
fn runs(of: &[(Parameters, Law)], depth_um: f64, seeds: u64, at_most_s: f64) -> Vec<Run> {
    let each_seed: Vec<(usize, u64)> = (0..of.len()).flat_map(|k| (1..=seeds).map(move |seed| (k, seed))).collect();
    let all = each(&each_seed, |&(k, seed)| {
        let (p, law) = &of[k];
        let Ok(mut rig) = Rig::new(p, *law, Motion::default(), seed) else { return [f64::NAN; 4] };
        let through = p.thickness_um < depth_um;
        while rig.t_s() < at_most_s && (if through { rig.x } else { rig.process.depth_um() }) < depth_um {
            rig.step();
        }
        let cycles = rig.tally.cycles.max(1) as f64;
        let short = 100.0 * rig.tally.short_cycles as f64 / cycles;
        [rig.t_s(), short, rig.process.pulses().discharges() as f64 / cycles, rig.tally.long_retreats as f64]
    });
    let by_condition = all.chunks(seeds as usize);
    by_condition
        .map(|runs| {
            let mean = |k: usize| Mean::new(&runs.iter().map(|run| run[k]).collect::<Vec<_>>());
            Run { seconds: mean(0), short: mean(1), discharges: mean(2), long: mean(3) }
        })
        .collect()
}

pub fn threshold() -> Vec<Gate> {
    const DHT: [u32; 9] = [10, 25, 50, 100, 150, 200, 300, 500, 1000];
    let mut gates = Vec::new();
    for machine in SETTINGS {
        let name = machine.name;
        let all = runs(&DHT.map(|dht| (machine.of(), Law::Fc(dht, true))), THRESHOLD_UM, 3, 20_000.0);
        let times = all.iter().map(|run| run.seconds.of).enumerate();
        let best = times.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |best| best.0);
        let said = DHT.iter().zip(&all).map(|(dht, run)| {
            let (s, short, n) = (run.seconds, run.short, run.discharges.of);
            format!("{dht}: {:.0} +- {:.0} s, short {:.2} +- {:.2} %, {n:.0}", s.of, s.error, short.of, short.error)
        });
        let over_dht =
            |of: fn(&Run) -> Mean| DHT.iter().map(|&dht| f64::from(dht)).zip(all.iter().map(of)).collect::<Vec<_>>();
        let figure = |what: &str, y| {
            Figure::new(format!("{name}: {what}"), "discharge holding threshold", y).log().mark("[G]: 200", 200.0)
        };
        let figures = [
            figure("time to 0.3 mm", "time, s").curve("simulated", over_dht(|run| run.seconds)),
            figure("short cycles", "short cycles, %").curve("simulated", over_dht(|run| run.short)),
            figure("discharges in a cycle over the threshold", "ratio")
                .limit("", 1.0)
                .line("simulated", over_dht(|run| run.discharges).into_iter().map(|(x, n)| (x, n.of / x))),
        ];
        gates.push(
            Gate::new(
                Kind::Validation,
                format!("{name}, [G] fig. 6: threshold of the shortest time"),
                DHT[best].into(),
                Wanted::Between(100.0, 300.0),
                format!(
                    "threshold: time to 0.3 mm, short cycles, discharges a cycle: {}",
                    said.collect::<Vec<_>>().join("; ")
                ),
            )
            .drawn(figures),
        );
        let falls = largest(all.windows(2).map(|pair| pair[0].short.of - pair[1].short.of));
        gates.push(Gate::new(
            Kind::Validation,
            format!("{name}, [G] fig. 6: largest fall of the short rate to the next threshold, % of cycles"),
            falls,
            Wanted::AtMost(0.0),
            "published: it rises throughout",
        ));
        // Where the mean of discharges in a cycle crosses the threshold, between two of them.
        let over = |k: usize| all[k].discharges.of / f64::from(DHT[k]);
        let crossing = (1..DHT.len()).find(|&k| over(k) < 1.0).map_or(f64::from(DHT[DHT.len() - 1]), |k| {
            let (a, b) = (libm::log(over(k - 1)), libm::log(over(k)));
            let (from, to) = (libm::log(DHT[k - 1].into()), libm::log(DHT[k].into()));
            libm::exp(from + (to - from) * a / (a - b))
        });
        gates.push(Gate::new(
            Kind::Validation,
            format!("{name}, [G] fig. 7: threshold that the mean of discharges crosses"),
            crossing,
            Wanted::Between(100.0, 300.0),
            "the rate of bridges was chosen with this in view",
        ));
    }
    gates
}

pub fn retreats() -> Vec<Gate> {
    const FC: Law = Law::Fc(200, false);
    const LAWS: [(&str, Law); 6] = [
        ("FC 200", FC),
        ("FC 250", Law::Fc(250, false)),
        ("1TAV 20", Law::Tav(20.0, 20.0)),
        ("1TAV 25", Law::Tav(25.0, 25.0)),
        ("2TAV 30/10", Law::Tav(30.0, 10.0)),
        ("2TAV 30/20", Law::Tav(30.0, 20.0)),
    ];
    let mut gates = Vec::new();
    for machine in SETTINGS {
        let name = machine.name;
        let p = machine.of();
        let blind = runs(&LAWS.map(|(_, law)| (p, law)), 2200.0, 1, 20_000.0);
        let figure = |what: &str, y, of: &[Run], value: fn(&Run) -> Mean| {
            Figure::new(format!("{name}: {what}"), "law of [G]", y)
                .places(LAWS.map(|(law, _)| law))
                .curve("simulated", of.iter().enumerate().map(|(k, run)| (k as f64, value(run))))
        };
        let said = |all: &[Run]| {
            let each = LAWS.iter().zip(all).map(|((law, _), run)| {
                format!("{law}: {:.0} long, {:.0} s, short {:.1} %", run.long.of, run.seconds.of, run.short.of)
            });
            each.collect::<Vec<_>>().join("; ")
        };
        gates.push(
            Gate::new(
                Kind::Validation,
                format!("{name}, [G] fig. 14, 2.2 mm: long retreats of FC over 1TAV"),
                blind[0].long.of / blind[2].long.of.max(1.0),
                Wanted::AtMost(1.0 / 3.0),
                format!("published 22/223; hangs on the tear distance of bridges; {}", said(&blind)),
            )
            .drawn([figure("2.2 mm blind", "long retreats", &blind, |run| run.long)
                .published("[G] fig. 14", [(0.0, 22.0), (2.0, 223.0)])]),
        );
        let sheet = Parameters { thickness_um: 1000.0, ..p };
        let through = runs(&LAWS.map(|(_, law)| (sheet, law)), 1500.0, 1, 20_000.0);
        // [G] has FC at 200 shorter than 1TAV by 21 %, than 2TAV by 12 %.
        let fc_s = through[0].seconds.of;
        let published = [(0.0, fc_s), (2.0, fc_s / (1.0 - 0.21)), (4.0, fc_s / (1.0 - 0.12))];
        let times = figure("through hole of 1 mm", "time, s", &through, |run| run.seconds)
            .published("[G] fig. 11: ratios, on FC 200", published);
        for (other, law, published) in [(2, "1TAV", 21.0), (4, "2TAV", 12.0)] {
            let (fc, tav) = (through[0].seconds.of, through[other].seconds.of);
            gates.push(Gate::new(
                Kind::Validation,
                format!("{name}, [G] fig. 11, through hole: FC shorter than {law} by, %"),
                100.0 * (1.0 - fc / tav),
                Wanted::Between(0.5 * published, 1.5 * published),
                format!("published {published}; hangs on the bubble veil; {}", said(&through)),
            ));
        }
        if let Some(gate) = gates.last_mut() {
            gate.figures.push(times);
        }
        gates.push(stages(&machine));
    }
    gates
}

/// \[G\] fig. 8: a touch stage, a stable one, a deep one.
fn stages(machine: &Machine) -> Gate {
    const ENDS_UM: [f64; 3] = [50.0, 700.0, 1000.0];
    let seeds: Vec<u64> = (1..=4).collect();
    let all = each(&seeds, |&seed| {
        let Ok(mut rig) = Rig::new(&machine.of(), Law::Fc(200, true), Motion::default(), seed) else {
            return [f64::NAN; 3];
        };
        ENDS_UM.map(|um| {
            let before = rig.tally;
            rig.bore(um, 20_000.0);
            let cycles = (rig.tally.cycles - before.cycles).max(1) as f64;
            100.0 * (rig.tally.short_cycles - before.short_cycles) as f64 / cycles
        })
    });
    let [touch, stable, deep] = [0, 1, 2].map(|k| Mean::new(&all.iter().map(|run| run[k]).collect::<Vec<_>>()));
    Gate::new(
        Kind::Validation,
        format!(
            "{}, [G] fig. 8: short cycles of the touch or of the deep stage, whichever are fewer, over the stable's",
            machine.name
        ),
        touch.of.min(deep.of) / stable.of,
        Wanted::AtLeast(1.5),
        format!(
            "{:.1} +- {:.1} % to 0.05 mm, {:.1} +- {:.1} % to 0.7 mm, {:.1} +- {:.1} % to 1 mm; no numbers are published",
            touch.of, touch.error, stable.of, stable.error, deep.of, deep.error
        ),
    )
    .drawn([Figure::new(
        format!("{}: stages, blind; [G] fig. 8: the middle is least", machine.name),
        "stage",
        "short cycles, %",
    )
    .places(["to 0.05 mm", "to 0.7 mm", "to 1 mm"])
    .curve("simulated", [(0.0, touch), (1.0, stable), (2.0, deep)])])
}

pub fn off_time() -> Vec<Gate> {
    const OFF_US: [f64; 4] = [6.0, 12.0, 18.0, 24.0];
    let mut gates = Vec::new();
    for machine in SETTINGS {
        let p = machine.of();
        // The threshold stays the share of pulses that 200 is at 6 us.
        let of = OFF_US.map(|off_us| {
            let dht = (200.0 * (p.on_us + 6.0) / (p.on_us + off_us)).round() as u32;
            (Parameters { off_us, ..p }, Law::Fc(dht, true))
        });
        let all = runs(&of, THRESHOLD_UM, 8, 20_000.0);
        let said = OFF_US
            .iter()
            .zip(&all)
            .map(|(off, run)| format!("{off} us: {:.1} +- {:.1} %", run.short.of, run.short.error));
        let note = format!("all the time, not by FPCC; short cycles {}", said.collect::<Vec<_>>().join(", "));
        let name = machine.name;
        gates.push(
            Gate::new(
                Kind::Validation,
                format!("{name}, [G] fig. 9: short rate at off-time 12 us over that at 6 us"),
                all[1].short.of / all[0].short.of,
                Wanted::AtMost(0.9),
                note,
            )
            .drawn([Figure::new(
                format!("{name}; [G] fig. 9 falls to 12 us, then stays"),
                "off-time, us",
                "short cycles, %",
            )
            .curve("simulated", OFF_US.into_iter().zip(all.iter().map(|run| run.short)))
            .mark("[G]: falls until here", 12.0)]),
        );
        gates.push(Gate::new(
            Kind::Validation,
            format!("{name}, [G] fig. 9: short rate at 24 us over that at 12 us"),
            all[3].short.of / all[1].short.of,
            Wanted::AtLeast(0.9),
            "published: it falls no further",
        ));
    }
    gates
}

pub fn hunting() -> Vec<Gate> {
    let (um, hz, volts) = calibration::thesis_swing(&SINKER.of(), Voltage::cnc(50.0), 6);
    let (calm, ..) = calibration::thesis_swing(&SINKER.of(), Voltage::calm(50.0), 6);
    vec![
        Gate::new(
            Kind::Validation,
            "[R] section 4.5, slow CNC axis: frequency of the hunting, Hz",
            hz.of,
            Wanted::Between(4.0, 6.0),
            format!(
                "+- {:.1}; published 5; {:.0} um, mean {:.1} V; hangs on the axis' assumed lags",
                hz.error, um.of, volts.of
            ),
        )
        .drawn([Figure::new(
            "Slow CNC axis at 50 V, one seed; [R]: it hunts at 5 Hz",
            "time, s",
            "about its mean, um",
        )
        .line("CNC axis", calibration::motion(&SINKER.of(), Voltage::cnc(50.0)))
        .line("loop of 3 Hz", calibration::motion(&SINKER.of(), Voltage::calm(50.0)))]),
        Gate::new(
            Kind::Validation,
            "slow CNC axis over a loop of 3 Hz: swing",
            um.of / calm.of,
            Wanted::AtLeast(3.0),
            format!("{:.1} um with the loop of 3 Hz", calm.of),
        ),
    ]
}
