//! The objects of the node in words. Which there are, the node itself says; names are those of CiA 301 7.5.2.

use crate::Shape::{self, Array, Record, Variable};
use crate::{Declaration, HIGHEST};
use edm_canopen::ERRORS;
use edm_servo_head::canopen::drive::DEVICE;

/// Every object of the node by rising index and sub-index.
pub(crate) fn declarations() -> impl Iterator<Item = Declaration> {
    edm_canopen::own_objects(&DEVICE).map(|own| {
        let (shape, object) = object(own.index);
        let Text(name, unit, doc) = value(own.index, own.sub);
        Declaration {
            index: own.index,
            sub: own.sub,
            shape,
            object,
            name: if shape == Variable { object } else { name },
            kind: own.kind,
            access: own.access,
            mapping: own.mapping,
            default: own.default,
            unit,
            range: None,
            doc,
            choices: &[],
            stored: own.stored,
        }
    })
}

/// Shape and name of an object.
const fn object(index: u16) -> (Shape, &'static str) {
    match index {
        0x1000 => (Variable, "Device type"),
        0x1001 => (Variable, "Error register"),
        0x1003 => (Array, "Pre-defined error field"),
        0x1005 => (Variable, "COB-ID SYNC message"),
        0x1006 => (Variable, "Communication cycle period"),
        0x1007 => (Variable, "Synchronous window length"),
        0x1008 => (Variable, "Manufacturer device name"),
        0x1009 => (Variable, "Manufacturer hardware version"),
        0x100A => (Variable, "Manufacturer software version"),
        0x1010 => (Array, "Store parameters"),
        0x1011 => (Array, "Restore default parameters"),
        0x1014 => (Variable, "COB-ID EMCY"),
        0x1015 => (Variable, "Inhibit time EMCY"),
        0x1016 => (Array, "Consumer heartbeat time"),
        0x1017 => (Variable, "Producer heartbeat time"),
        0x1018 => (Record, "Identity object"),
        0x1019 => (Variable, "Synchronous counter overflow value"),
        0x1029 => (Array, "Error behaviour object"),
        0x1200 => (Record, "SDO server parameter"),
        0x1400..=0x15FF => (Record, "RPDO communication parameter"),
        0x1600..=0x17FF => (Record, "RPDO mapping parameter"),
        0x1800..=0x19FF => (Record, "TPDO communication parameter"),
        0x1A00..=0x1BFF => (Record, "TPDO mapping parameter"),
        0x1F50 => (Array, "Program data"),
        0x1F51 => (Array, "Program control"),
        0x1F56 => (Array, "Program software identification"),
        0x1F57 => (Array, "Flash status identification"),
        _ => (Variable, ""),
    }
}

/// Name of a value, unless it is a variable, its unit, and what it does where the name does not say it.
struct Text(&'static str, &'static str, &'static str);

const fn value(index: u16, sub: u8) -> Text {
    match (index, sub) {
        (0x1000, _) => Text("", "", "CiA 402 servo drive"),
        (0x1001, _) => {
            Text("", "", "bits: 0 any error, 1 current, 2 voltage, 4 communication, 5 profile, 7 the process")
        }
        (0x1003, 0) => Text("Number of errors", "", "write 0 to clear them"),
        (0x1003, _) => Text(
            "Standard error field",
            "",
            "error code as in an emergency, the latest first; 603Fh for drive and process",
        ),
        (0x1005, _) => Text("", "", "the head never sends SYNC"),
        (0x1006, _) => Text("", "us", "no SYNC for one and a half of these is an error; 0: not monitored"),
        (0x1007, _) => Text("", "us", "synchronous PDOs later than this after SYNC are dropped; 0 unlimited"),
        (0x1010, 1) => Text("Save all parameters", "", SAVE),
        (0x1010, 2) => Text("Save communication parameters", "", SAVE),
        (0x1010, 3) => Text("Save application parameters", "", SAVE),
        (0x1011, 1) => Text("Restore all default parameters", "", LOAD),
        (0x1011, 2) => Text("Restore communication defaults", "", LOAD),
        (0x1011, 3) => Text("Restore application defaults", "", LOAD),
        (0x1014, _) => Text("", "", "bit 31 set: none are sent"),
        (0x1015, _) => Text("", "100 us", "shortest time between two"),
        (0x1016, 1..) => {
            Text("Consumer heartbeat time", "ms", "node-ID times 65536 plus the longest silence; 0: not monitored")
        }
        (0x1017, _) => Text("", "ms", "0 sends none"),
        (0x1018, 1) => Text("Vendor-ID", "", "0: none"),
        (0x1018, 2) => Text("Product code", "", ""),
        (0x1018, 3) => Text("Revision number", "", ""),
        (0x1018, 4) => Text("Serial number", "", "from the chip"),
        (0x1019, _) => Text("", "", "0 SYNC without a counter, else 2 to 240"),
        (0x1029, 1) => Text(
            "Communication error",
            "",
            "when a monitored heartbeat is lost: 0 to pre-operational, 1 no change, 2 to stopped",
        ),
        (0x1200, 1) => Text("COB-ID client to server", "", ""),
        (0x1200, 2) => Text("COB-ID server to client", "", ""),
        (0x1400..=0x15FF | 0x1800..=0x19FF, 1) => Text(
            "COB-ID used by",
            "",
            "bit 31 set: not in use; only then can mapping, inhibit time and SYNC start value change",
        ),
        (0x1400..=0x15FF, 2) => Text("Transmission type", "", "0 to 240 at the next SYNC, 254 and 255 at once"),
        (0x1400..=0x15FF, 5) => Text("Event timer", "ms", "longest silence; 0: not monitored"),
        (0x1800..=0x19FF, 2) => Text(
            "Transmission type",
            "",
            "0 at SYNC after a change, 1 to 240 at every such SYNC, 254 and 255 on change and by timer",
        ),
        (0x1800..=0x19FF, 3) => Text("Inhibit time", "100 us", "shortest time between two"),
        (0x1800..=0x19FF, 5) => Text("Event timer", "ms", "longest time between two; 0 no timer"),
        (0x1800..=0x19FF, 6) => Text("SYNC start value", "", "SYNC counter to begin with; 0 any"),
        (0x1600..=0x17FF | 0x1A00..=0x1BFF, 0) => {
            Text("Number of mapped application objects in PDO", "", "write 0 before the entries change")
        }
        (0x1600..=0x17FF | 0x1A00..=0x1BFF, _) => {
            Text("Application object", "", "index times 65536, sub-index times 256, length in bits")
        }
        (0x1F50, 1) => Text("Update", "", "the file of an update, by blocks or segments, after 1F51h:1 = 3"),
        (0x1F51, 1) => Text(
            "Program 1",
            "",
            "while disabled: 0 refused unless nothing can move, 3 makes room for an update, 1 starts the one that was staged. Reads 1",
        ),
        (0x1F56, 1) => Text("Program 1", "", "sum of the program that runs, as in the file of an update"),
        (0x1F57, 1) => Text(
            "Program 1",
            "",
            "bit 0 in progress; bits 1 to 7: 1 nothing staged, 2 unknown format, 3 wrong sum, 4 not cleared, 5 flash failed, 63 other",
        ),
        (_, 0) => Text(HIGHEST, "", ""),
        _ => Text("", "", ""),
    }
}

const SAVE: &str = "write 65766173h, \"save\", while disabled";
const LOAD: &str = "write 64616F6Ch, \"load\"; the defaults are in force from the next reset on";

/// Error codes of the node's own emergencies, and what they mean.
pub fn errors() -> impl Iterator<Item = (u16, &'static str)> {
    ERRORS.iter().map(|code| (*code, error(*code)))
}

const fn error(code: u16) -> &'static str {
    match code {
        0x8100 => "no SYNC for one and a half periods of 1006h",
        0x8110 => "frames lost: received faster than they were processed",
        0x8120 => "error passive: no node acknowledges, or the wiring is bad",
        0x8130 => "a node of 1016h is silent or has restarted",
        0x8140 => "bus-off: the controller has left the bus",
        0x8210 => "an RPDO was shorter than its mapping and not applied",
        0x8220 => "an RPDO was longer than its mapping; its first bytes were applied",
        0x8240 => "SYNC with or without a counter, contrary to 1019h",
        0x6100 => "events inside the device lost: faster than they were processed",
        0x8250 => "an RPDO did not come within its event timer",
        _ => "",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_error_code_is_explained() {
        assert!(errors().all(|(_, text)| !text.is_empty()));
    }
}
