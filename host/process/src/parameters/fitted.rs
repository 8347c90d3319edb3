//! Written by `cargo run -p edm-process --bin fit`. Do not edit.

/// What was fitted to calibration data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fitted {
    /// `charge_ohm`, to \[X\] table 2.
    pub charge_ohm: f64,
    /// `rounding_um`, to \[X\] table 2.
    pub rounding_um: f64,
    /// `ignition` of all machines, to \[X\] table 4.
    pub ignition: f64,
    /// `removal_um3_uj` of \[X\]'s machine, to \[X\] table 4.
    pub xin_removal: f64,
    /// `slow_log` of the sinker, to the 40 um of \[R\] section 4.3.
    pub slow_log: f64,
    /// Gain of the harness's servo of the thesis machine, um/s per V, to the 20 Hz of \[R\] section 4.3.
    pub thesis_gain: f64,
}

impl Fitted {
    /// The values of a version of the model.
    pub fn of(version: u32) -> Fitted {
        if version < 2 { Fitted::VALUES } else { Fitted::SECOND }
    }

    /// Those of version 1.
    pub const VALUES: Fitted = Fitted {
        charge_ohm: 30140.0,
        rounding_um: 25.86,
        ignition: 560.5,
        xin_removal: 10.25,
        slow_log: 0.761,
        thesis_gain: 147.2,
    };

    /// Those of version 2.
    pub const SECOND: Fitted = Fitted {
        charge_ohm: 30140.0,
        rounding_um: 25.86,
        ignition: 810.4,
        xin_removal: 10.64,
        slow_log: 0.6594,
        thesis_gain: 151.5,
    };
}
