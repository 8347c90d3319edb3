//! What description files and documents add to the names in the communication area: units and hints.

/// Unit, and what the value does where its name does not say it.
pub(super) const fn of(index: u16, sub: u8) -> (&'static str, &'static str) {
    match (index, sub) {
        (0x1000, _) => ("", "CiA 402 servo drive"),
        (0x1001, _) => ("", "bits: 0 any error, 1 current, 2 voltage, 4 communication, 5 profile, 7 the process"),
        (0x1003, 0) => ("", "write 0 to forget them"),
        (0x1003, _) => ("", "error code as in an emergency, the latest first; 603Fh for drive and process"),
        (0x1005, _) => ("", "the head never sends SYNC"),
        (0x1006, _) => ("us", "no SYNC for one and a half of these is an error; 0 does not watch"),
        (0x1007, _) => ("us", "synchronous PDOs later than this after SYNC are dropped; 0 unlimited"),
        (0x1010, 1..) => ("", "write 65766173h, \"save\", while disabled"),
        (0x1011, 1..) => ("", "write 64616F6Ch, \"load\"; the defaults hold from the next reset on"),
        (0x1014, _) => ("", "bit 31 set: none are sent"),
        (0x1015, _) => ("100 us", "shortest time between two"),
        (0x1016, 1..) => ("ms", "node-ID times 65536 and the longest silence; 0 does not watch"),
        (0x1017, _) => ("ms", "0 sends none"),
        (0x1018, 1) => ("", "0: nobody's"),
        (0x1018, 4) => ("", "from the chip"),
        (0x1019, _) => ("", "0 SYNC without a counter, else 2 to 240"),
        (0x1029, 1..) => ("", "when a watched heartbeat is lost: 0 to pre-operational, 1 no change, 2 to stopped"),
        (0x1400..=0x15FF | 0x1800..=0x19FF, 1) => {
            ("", "bit 31 set: not in use; only then can mapping, inhibit time and SYNC start value change")
        }
        (0x1400..=0x15FF, 2) => ("", "0 to 240 at the next SYNC, 254 and 255 at once"),
        (0x1400..=0x15FF, 5) => ("ms", "longest silence; 0 does not watch"),
        (0x1800..=0x19FF, 2) => {
            ("", "0 at SYNC after a change, 1 to 240 at every such SYNC, 254 and 255 on change and by timer")
        }
        (0x1800..=0x19FF, 3) => ("100 us", "shortest time between two"),
        (0x1800..=0x19FF, 5) => ("ms", "longest time between two; 0 no timer"),
        (0x1800..=0x19FF, 6) => ("", "SYNC counter to begin with; 0 any"),
        (0x1600..=0x17FF | 0x1A00..=0x1BFF, 0) => ("", "write 0 before the entries change"),
        (0x1600..=0x17FF | 0x1A00..=0x1BFF, _) => ("", "index times 65536, sub-index times 256, length in bits"),
        _ => ("", ""),
    }
}
