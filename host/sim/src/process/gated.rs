//! The converter that samples each pulse once, as the reflex's does: gap current and gap voltage after the blanking.
//!
//! Divider and amplifier are those of [`FrontEnd`](super::front_end::FrontEnd): it sees the same zero, gain error and noise,
//! but no hum, which is slow compared with a pulse. What the reflex would take for a short is counted; of a capacitor that is drained by
//! then it sees no more than the chip's.

use super::Installation;
use super::model::Stretch;
use super::normal;
use super::random::{Cause, Random};
use edm_hal_shim::reflex;
use edm_hal_shim::timing::BLANKING_NS;
use edm_servo_head::units::ADC_FULL_SCALE;

/// Noise of the current sensor and its conversion, codes rms (assumed).
const CURRENT_NOISE: f64 = 1.5;

/// Code of a gap current, A: sensor of docs/wiring.md, 16.1 A for 1000 codes about mid-scale.
pub fn current_code(amperes: f64) -> f64 {
    2048.0 + amperes * 1000.0 / 16.1
}

/// State of the converter.
#[derive(Clone, Debug)]
pub struct Gated {
    per_volt: f64,
    zero: f64,
    noise: f64,
    random: Random,
    /// Thresholds of the head's reflex, converter codes.
    pub reflex: reflex::Config,
    /// Pulses that these thresholds make short.
    pub shorts: u64,
    /// When the gate opened last, us.
    opened: f64,
    /// When that pulse will be sampled, us.
    due: Option<f64>,
    /// Gap current and gap voltage of the newest pulse, codes.
    pub newest: [u16; 2],
}

impl Gated {
    /// Nothing converted yet.
    pub fn new(p: &Installation, seed: u64) -> Gated {
        let per_volt = (1.0 + f64::from(p.gain_error) * 0.01) / f64::from(p.volts_per_code);
        Gated {
            per_volt,
            zero: p.zero_code.into(),
            noise: f64::from(p.noise) * per_volt,
            random: Cause::Gated.stream(seed),
            reflex: reflex::Config {
                run: 0,
                ticks: 0,
                current: u16::MAX,
                voltage: (0, ADC_FULL_SCALE),
                tau_ns: 0,
                motor_reversed: false,
            },
            shorts: 0,
            opened: 0.0,
            due: None,
            newest: [0; 2],
        }
    }

    /// Samples a tick until `to` (us): its stretches, the oldest first. An edge of the gate while the blanking runs starts no other.
    pub fn look(&mut self, to: f64, stretches: &[Stretch]) {
        let blanking = f64::from((3 * self.reflex.tau_ns).max(BLANKING_NS)) * 1e-3;
        // The newest sample is all that is read after a tick; of the others there is only the noise they draw.
        let mut newest = None;
        for (k, now) in stretches.iter().enumerate() {
            let end = stretches.get(k + 1).map_or(to, |next| next.from);
            self.sample(end, now, &mut newest);
            if now.gate.0 < now.gate.1 && now.gate.0 > self.opened {
                self.opened = now.gate.0;
                self.due = self.due.or(Some(now.gate.0 + blanking));
                self.sample(end, now, &mut newest);
            }
        }
        if let Some((due, now)) = newest {
            self.convert(due, now);
        }
    }

    /// Samples if it is due before `end` of a stretch.
    fn sample<'a>(&mut self, end: f64, now: &'a Stretch, newest: &mut Option<(f64, &'a Stretch)>) {
        let Some(due) = self.due.filter(|due| *due < end) else { return };
        self.due = None;
        let open = due < now.gate.1;
        self.shorts += u64::from(open && self.is_short(due, now));
        if newest.replace((due, now)).is_some() {
            normal::skip_pair(&mut self.random);
        }
    }

    /// Whether current flows without a voltage then.
    fn is_short(&self, due: f64, now: &Stretch) -> bool {
        let (lowest, highest) = self.reflex.voltage;
        let voltage = self.zero + now.at(due) * self.per_volt;
        (voltage < lowest.into() || voltage > highest.into())
            && current_code(now.amps.at(due - now.from)) >= self.reflex.current.into()
    }

    /// Converts what is due within a stretch.
    fn convert(&mut self, due: f64, now: &Stretch) {
        let flowing = now.amps.at(due - now.from);
        let [of_current, of_voltage] = normal::pair(&mut self.random).map(f64::from);
        // Cheaper than `round`, which is a call on processors without an instruction for it.
        let code = |exact: f64| (exact.clamp(0.0, ADC_FULL_SCALE.into()) + 0.5) as i32 as u16;
        self.newest = [
            code(current_code(flowing) + CURRENT_NOISE * of_current),
            code(self.zero + now.at(due) * self.per_volt + self.noise * of_voltage),
        ];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use edm_process::Edge;

    const OPEN_V: f64 = 100.0;
    const RISE: f64 = 0.2;

    fn quiet() -> Gated {
        Gated::new(&Installation { noise: 0.0, ..Installation::default() }, 1)
    }

    /// A stretch in which 10 A flow, unless the gap is open.
    fn stretch(from: f64, volts: f64, initial: f64, gate: (f64, f64)) -> Stretch {
        let to = if gate.0 < gate.1 && volts < OPEN_V { 10.0 } else { 0.0 };
        Stretch { from, volts, initial, rise: RISE, amps: Edge { from: to, to, us: 0.0 }, gate }
    }

    /// What is found of a pulse from 10 to 40 us that ignites after a delay and then has this voltage.
    fn found(gated: &mut Gated, delay: f64, volts: f64) -> [i32; 2] {
        let gate = (10.0, 40.0);
        let stretches = [
            stretch(0.0, 0.0, 0.0, (0.0, 0.0)),
            stretch(10.0, OPEN_V, 0.0, gate),
            stretch(10.0 + delay, volts, OPEN_V, gate),
            stretch(40.0, 0.0, volts, (40.0, 40.0)),
        ];
        gated.look(50.0, &stretches);
        let [current, voltage] = gated.newest.map(i32::from);
        // Whole volts, and amperes.
        [(current - 2048) * 161 / 10_000, (voltage - 410 + 5) / 10]
    }

    #[test]
    fn a_pulse_is_seen_as_it_is_two_microseconds_after_its_gate() {
        for (delay, volts, seen) in
            [(0.0, 28.0, [10, 28]), (0.0, 1.0, [10, 1]), (0.5, 40.0, [10, 40]), (2.1, 40.0, [0, 100])]
        {
            let [current, voltage] = found(&mut quiet(), delay, volts);
            assert!(
                (current - seen[0]).abs() <= 1 && (voltage - seen[1]).abs() <= 1,
                "{delay} us: {current} A {voltage} V"
            );
        }
    }

    #[test]
    fn a_longer_charging_time_is_waited_for() {
        let mut gated = quiet();
        gated.reflex.tau_ns = 3000;
        assert_eq!(found(&mut gated, 8.0, 40.0), [9, 40]);
    }

    #[test]
    fn a_look_that_is_due_after_the_tick_is_taken_in_the_next() {
        let mut gated = quiet();
        let pulse = stretch(49.0, 28.0, 0.0, (49.0, 80.0));
        gated.look(50.0, &[pulse]);
        assert_eq!(gated.newest, [0; 2]);
        gated.look(100.0, &[pulse, stretch(80.0, 0.0, 28.0, (80.0, 80.0))]);
        assert_eq!(gated.newest[1], 410 + 280);
    }

    #[test]
    fn the_current_is_that_of_the_moment() {
        let mut gated = quiet();
        let pulse = Stretch { amps: Edge { from: 5.0, to: 0.0, us: 2.0 }, ..stretch(10.0, 40.0, 0.0, (10.0, 40.0)) };
        gated.look(50.0, &[pulse]);
        let amps = (f64::from(gated.newest[0]) - 2048.0) * 0.0161;
        assert!((amps - 5.0 * (-1.0f64).exp()).abs() < 0.1, "{amps}");
    }

    #[test]
    fn both_codes_have_noise() {
        let mut gated = Gated::new(&Installation::default(), 1);
        let mut seen = std::collections::BTreeSet::new();
        for n in 0..100 {
            let from = 100.0 * f64::from(n) + 10.0;
            gated.look(from + 50.0, &[stretch(from, 40.0, 0.0, (from, from + 30.0))]);
            seen.insert(gated.newest);
        }
        assert!(seen.len() > 30, "{seen:?}");
    }
}
