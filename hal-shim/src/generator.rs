//! The pulse generator, seen from the head.

/// What the head can ask of the pulse generator.
pub trait Generator {
    /// Lets pulses through (`true`) or inhibits them. Released hardware inhibits: a dead controller makes no pulses.
    fn set_pulses(&mut self, enabled: bool);
    /// Requests an off-time, ns. `None` leaves the generator's own setting.
    fn request_off_time(&mut self, off_ns: Option<u32>);
}
