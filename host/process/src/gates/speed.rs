//! Simulated seconds in a second of the processor, of model and harness alone.

use super::{Gate, Kind, Wanted};
use crate::axis::{Axis, Load, Winding};
use crate::harness::{Law, Motion, Rig, Voltage};
use crate::parameters::{GAO, Machine, SINKER};
use cpu_time::ProcessTime;

pub(super) fn speed(version: u32) -> Vec<Gate> {
    const SECONDS: f64 = 200.0;
    let of = |machine: &Machine, law, least: f64| {
        let Ok(mut rig) = Rig::new(&machine.of(version), law, Motion::default(), 1) else {
            return (f64::NAN, String::new());
        };
        let begin = ProcessTime::now();
        rig.run(SECONDS);
        let seconds = begin.elapsed().as_secs_f64();
        let ns = seconds * 1e9 / rig.process.pulses().total() as f64;
        let note = format!("{ns:.0} ns a pulse; a prototype of this model had {least:.0} on another, idle machine");
        (SECONDS / seconds, note)
    };
    let (slow, slow_note) = of(&SINKER, Law::Voltage(Voltage::calm(55.0)), 800.0);
    let (fast, fast_note) = of(&GAO, Law::Fc(150, true), 340.0);
    let axis = axis(version, 20.0);
    // Bounds leave the loop with head and converter its share of 250 and 80.
    vec![
        Gate::new(
            Kind::Speed,
            "5 kHz, model alone: simulated s a processor s",
            slow,
            Wanted::AtLeast(500.0),
            slow_note,
        ),
        Gate::new(
            Kind::Speed,
            "100 kHz, model alone: simulated s a processor s",
            fast,
            Wanted::AtLeast(160.0),
            fast_note,
        ),
        Gate::new(
            Kind::Speed,
            "axis in steps of 12.5 us: simulated s a processor s",
            axis,
            Wanted::AtLeast(500.0),
            "hangs on two divisions that wait for each other; steps of 25 us halve it",
        ),
    ]
}

/// An axis that swings, 0.2 mm up and down.
fn axis(version: u32, seconds: f64) -> f64 {
    const STEP_US: f64 = 12.5;
    let mut axis = Axis::new(&SINKER.of(version), STEP_US);
    let begin = ProcessTime::now();
    for step in 0..(seconds * 1e6 / STEP_US) as u64 {
        let load = Load { gap_um: 40.0, ..Load::NONE };
        axis.step(Winding::Volts(if step / 4000 % 2 == 0 { 2.0 } else { -2.0 }), &load);
    }
    // What has been reckoned must be wanted.
    std::hint::black_box(axis.x);
    seconds / begin.elapsed().as_secs_f64()
}
