//! Debris in the gap.
//!
//! Discharges make it: what they remove stays in the gap as a *layer*, its volume over the electrode's face. Flushing
//! carries it off with a time constant that grows with the depth of the hole. A gap that narrows squeezes dirty
//! dielectric out, part of which clean dielectric replaces when the gap opens again: that is why a jump cleans. What
//! pulses see is the *concentration*, layer over gap, in units of [`REFERENCE`]. All of this is assumed; [R] section 6.5.1
//! only says that debris affects the gap, and section 8 that a jump helps to remove it.

use super::Parameters;

/// Share of the gap's volume that counts as concentration 1, about that of the default working point.
const REFERENCE: f64 = 0.05;
/// Densest packing; what is more does not fit into the gap.
const DENSEST: f64 = 0.5;
/// Narrowest gap to divide by, um.
const NARROWEST_UM: f64 = 1.0;

/// State of the debris.
#[derive(Clone, Debug)]
pub struct Debris {
    layer_um: f64,
    gap_um: f64,
    concentration: f64,
    flush_us: f64,
    per_um: f64,
    /// Share that leaves in a microsecond, and the depth for which it holds, um.
    rate: (f64, f64),
    exchange: f64,
    held: bool,
}

impl Debris {
    /// A clean gap.
    pub fn new(p: &Parameters) -> Debris {
        Debris {
            layer_um: 0.0,
            gap_um: f64::INFINITY,
            concentration: 0.0,
            flush_us: f64::from(p.flush) * 1e6,
            per_um: 1.0 / (f64::from(p.flush_depth) * 1e3),
            rate: (1.0 / (f64::from(p.flush) * 1e6), 0.0),
            exchange: p.flush_exchange.into(),
            held: false,
        }
    }

    /// Concentration; 1 is about the default working point.
    pub fn concentration(&self) -> f64 {
        self.concentration
    }

    /// Keeps the concentration from now on.
    pub fn hold(&mut self, concentration: f64) {
        self.concentration = concentration;
        self.held = true;
    }

    /// Adds what a discharge removed.
    pub fn add(&mut self, depth_um: f64) {
        self.layer_um += depth_um;
    }

    /// Flushes for `us` in a hole of `depth_um`, at whose end the gap is `gap_um` wide.
    pub fn flush(&mut self, us: f64, depth_um: f64, gap_um: f64) {
        if self.held {
            return;
        }
        let gap_um = gap_um.max(NARROWEST_UM);
        if depth_um != self.rate.1 {
            self.rate = (1.0 / (self.flush_us * (1.0 + depth_um * self.per_um)), depth_um);
        }
        self.layer_um -= self.layer_um * us * self.rate.0;
        if gap_um < self.gap_um && self.gap_um.is_finite() {
            self.layer_um *= 1.0 - self.exchange * (1.0 - gap_um / self.gap_um);
        }
        self.gap_um = gap_um;
        self.layer_um = self.layer_um.min(DENSEST * gap_um);
        self.concentration = self.layer_um / (gap_um * REFERENCE);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dirty(p: &Parameters, gap_um: f64) -> Debris {
        let mut debris = Debris::new(p);
        debris.add(0.05 * gap_um);
        debris.flush(0.0, 0.0, gap_um);
        debris
    }

    #[test]
    fn flushing_takes_its_time_constant_and_longer_at_depth() {
        let p = Parameters::default();
        let after = |depth_um| {
            let mut debris = dirty(&p, 35.0);
            for _ in 0..(f64::from(p.flush) * 20_000.0) as u32 {
                debris.flush(50.0, depth_um, 35.0);
            }
            debris.concentration()
        };
        assert!((after(0.0) - (-1.0f64).exp()).abs() < 1e-3, "{}", after(0.0));
        // At the depth where flushing takes twice as long.
        assert!((after(f64::from(p.flush_depth) * 1e3) - (-0.5f64).exp()).abs() < 1e-3);
    }

    #[test]
    fn an_opening_gap_thins_the_debris_and_a_narrowing_one_squeezes_part_of_it_out() {
        let p = Parameters { flush_exchange: 0.25, ..Parameters::default() };
        let mut debris = dirty(&p, 30.0);
        assert!((debris.concentration() - 1.0).abs() < 1e-9);
        debris.flush(0.0, 0.0, 60.0);
        assert!((debris.concentration() - 0.5).abs() < 1e-9);
        // Half the volume leaves, a quarter of that for good.
        debris.flush(0.0, 0.0, 30.0);
        assert!((debris.concentration() - 0.875).abs() < 1e-9);
    }

    #[test]
    fn a_jump_of_a_millimetre_cleans_more_than_one_of_ten_micrometres() {
        let left = |jump_um: f64| {
            let mut debris = dirty(&Parameters::default(), 35.0);
            for k in 0..=1000 {
                debris.flush(0.0, 0.0, 35.0 + jump_um * (1.0 - f64::from(k) / 1000.0));
            }
            debris.concentration()
        };
        assert!(left(1000.0) < 0.5, "{}", left(1000.0));
        assert!(left(10.0) > 0.9, "{}", left(10.0));
    }

    #[test]
    fn no_more_fits_into_the_gap_than_the_densest_packing() {
        let mut debris = dirty(&Parameters::default(), 35.0);
        debris.add(1000.0);
        debris.flush(50.0, 0.0, 35.0);
        assert!((debris.concentration() - DENSEST / REFERENCE).abs() < 1e-9);
    }
}
