//! What the model refuses, and how it says so.

use core::fmt;

/// Direction and width of a bus access.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Read of so many bytes.
    Read(u8),
    /// Write of so many bytes, and the value.
    Write(u8, u32),
}

/// Why a peripheral refused an access.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The register is not modelled.
    Unmodelled,
    /// The register is modelled, what the value requests is not (or the manual forbids it).
    Unsupported(&'static str),
    /// The peripheral's clock is off or it is held in reset.
    ClockOff,
}

/// An access, or a course of events, that the model cannot follow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Error {
    /// Peripheral, as the manual names it.
    pub peripheral: &'static str,
    /// Offset of the register in its peripheral; for system registers the address.
    pub offset: u32,
    /// The access; `None` when an event, not an access, led here.
    pub access: Option<Access>,
    /// Why.
    pub fault: Fault,
    /// When, in ticks.
    pub at: u64,
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { peripheral, offset, access, fault, at } = self;
        match access {
            Some(Access::Read(n)) => write!(f, "{n}-byte read of {peripheral} + {offset:#05x}")?,
            Some(Access::Write(n, v)) => write!(f, "{n}-byte write of {v:#x} to {peripheral} + {offset:#05x}")?,
            None => write!(f, "event of {peripheral}")?,
        }
        match fault {
            Fault::Unmodelled => write!(f, ": register is not modelled")?,
            Fault::Unsupported(why) => write!(f, ": {why}")?,
            Fault::ClockOff => write!(f, ": its clock is off or it is held in reset (RCC)")?,
        }
        write!(f, " (tick {at})")
    }
}

impl core::error::Error for Error {}
