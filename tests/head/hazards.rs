//! Which safety inputs are a hazard: of all combinations.

use edm_hal_shim::safety::SafetyInputs;
use edm_servo_head::head::{Fault, Hazards};

/// Inputs by their bits: bridge, emergency stop, upper limit, lower limit, dielectric, supply.
fn inputs(bits: u32) -> SafetyInputs {
    let bit = |n: u32| bits >> n & 1 == 1;
    SafetyInputs {
        bridge_fault: bit(0),
        emergency_stop: bit(1),
        upper_limit: bit(2),
        lower_limit: bit(3),
        dielectric: bit(4),
        supply_low: bit(5),
    }
}

#[test]
fn of_any_inputs_the_most_urgent_that_concerns_the_state_is_told() {
    for concerned in 0..16u32 {
        let bit = |n: u32| concerned >> n & 1 == 1;
        let hazards = Hazards { any: bit(0), limits: bit(1), upper: bit(2), dielectric: bit(3) };
        for bits in 0..64 {
            let safety = inputs(bits);
            let upper = safety.upper_limit && hazards.upper;
            // Both limits are a broken wire even where a single one is looked for.
            let rows = [
                (safety.supply_low, Fault::SupplyLow),
                (safety.bridge_fault, Fault::BridgeFault),
                (safety.emergency_stop, Fault::EmergencyStop),
                (upper && safety.lower_limit, Fault::BothLimits),
                (upper && hazards.limits, Fault::UpperLimit),
                (safety.lower_limit && hazards.limits, Fault::LowerLimit),
                (safety.dielectric && hazards.dielectric, Fault::DielectricNotOk),
            ];
            let first = rows.iter().find(|row| row.0).map(|row| row.1);
            let expected = if hazards.any { first } else { None };
            assert_eq!(hazards.hazard(&safety), expected, "{hazards:?} {safety:?}");
        }
    }
}
