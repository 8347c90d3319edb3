//! The touch probe (CiA 402-2, 60B8h to 60BDh, 60D0h to 60D8h): what a host writes and reads of [`Probe`].
//!
//! The input of both probes is the contact sense. Time stamps are ns of the servo's clock, whose newest tick is in 2000h:10; they
//! wrap after 4.29 s.

use super::Drive;
use crate::canopen::Abort;
use crate::canopen::objects::Item;
use crate::head::{Command, Edge, PROBES, Probe, Source};
use crate::units::TICK_HZ;

/// Bits of a probe in 60B8h, the second's eight higher.
mod function {
    pub const ON: u8 = 1 << 0;
    pub const EVERY: u8 = 1 << 1;
    pub const SOURCE: u8 = 3 << 2;
    pub const INDEX: u8 = 1 << 2;
    /// By 60D0h.
    pub const CHOSEN: u8 = 2 << 2;
    pub const BEGINS: u8 = 1 << 4;
    pub const ENDS: u8 = 1 << 5;
    pub const RESERVED: u8 = 3 << 6;
}

/// Values of 60D0h: the input of the first probe, the zero pulse of the encoder; the manufacturer's.
const INPUT: i32 = 1;
const ZERO_PULSE: i32 = 5;
const DISCHARGE: i32 = -1;

/// Ns of a servo tick.
const TICK_NS: u32 = 1_000_000_000 / TICK_HZ;

/// The tick as ns, wrapping.
pub(super) const fn time(tick: u32) -> u32 {
    tick.wrapping_mul(TICK_NS)
}

/// The source of a value of 60D0h.
fn chosen(value: i32) -> Option<Source> {
    match value {
        INPUT => Some(Source::Contact),
        ZERO_PULSE => Some(Source::Index),
        DISCHARGE => Some(Source::Discharge),
        _ => None,
    }
}

/// Whether 60D0h may have this value.
pub(super) fn is_source(value: i32) -> bool {
    chosen(value).is_some()
}

impl Drive {
    /// 60B8h: each probe whose bits change is armed anew, or switched off.
    pub(super) fn probe_function(&mut self, word: u16) -> Result<(), Abort> {
        let before = (self.value(Item::ProbeFunction) as u16).to_le_bytes();
        let mut probes = self.probes;
        let sources = [Item::ProbeSource1, Item::ProbeSource2].map(|item| self.value(item));
        for (((probe, bits), before), chosen) in probes.iter_mut().zip(word.to_le_bytes()).zip(before).zip(sources) {
            if bits == before {
                continue;
            }
            let source = source(bits, chosen)?;
            if source == Source::Contact && !self.active.head.contact.sensed {
                return Err(Abort::DeviceState);
            }
            let set = |bit: u8| bits & bit != 0;
            *probe = Probe {
                source,
                every: set(function::EVERY),
                edges: [set(function::BEGINS), set(function::ENDS)],
                armed: probe.armed.wrapping_add(1),
            };
        }
        if probes != self.probes && !self.command(Command::Probe(probes)) {
            return Err(Abort::DeviceState);
        }
        self.probes = probes;
        Ok(())
    }

    /// Whether 60D0h may be written: not while its probe goes by it.
    pub(super) fn may_choose(&self, probe: usize) -> Result<(), Abort> {
        let [first, second] = (self.value(Item::ProbeFunction) as u16).to_le_bytes();
        let bits = if probe == 0 { first } else { second };
        let goes = bits & function::ON != 0 && bits & function::SOURCE == function::CHOSEN;
        if goes { Err(Abort::DeviceState) } else { Ok(()) }
    }

    /// Both probes are off, as 60B8h says after a reset.
    pub(super) fn probes_off(&mut self) {
        if self.probes.iter().any(|probe| probe.source != Source::Off) {
            self.probes = self.probes.map(|probe| Probe { armed: probe.armed.wrapping_add(1), ..Probe::default() });
            self.command(Command::Probe(self.probes));
        }
    }

    /// 60B9h. Bits 6 and 7 of a probe that keeps every edge turn over with each.
    pub(super) fn probe_status(&self) -> u16 {
        let mut bytes = [0u8; PROBES];
        for ((byte, latched), probe) in bytes.iter_mut().zip(&self.status.probes).zip(&self.probes) {
            if latched.probe != *probe || probe.source == Source::Off {
                continue;
            }
            let [begun, ended] = latched.edges.map(|edge| edge.count);
            let turns = |count: u16| u8::from(probe.every && count & 1 == 1);
            *byte = 1 | u8::from(begun > 0) << 1 | u8::from(ended > 0) << 2 | turns(begun) << 6 | turns(ended) << 7;
        }
        u16::from_le_bytes(bytes)
    }

    /// An edge of a probe, both counted from 0.
    pub(super) fn probe_edge(&self, probe: usize, edge: usize) -> Edge {
        let edges = self.status.probes.get(probe).map(|latched| &latched.edges);
        edges.and_then(|edges| edges.get(edge)).copied().unwrap_or_default()
    }
}

/// What the bits of a probe name.
fn source(bits: u8, value: i32) -> Result<Source, Abort> {
    if bits & function::RESERVED != 0 {
        return Err(Abort::InvalidValue);
    }
    let source = match bits & function::SOURCE {
        0 => Source::Contact,
        function::INDEX => Source::Index,
        function::CHOSEN => chosen(value).ok_or(Abort::InvalidValue)?,
        _ => return Err(Abort::InvalidValue),
    };
    Ok(if bits & function::ON != 0 { source } else { Source::Off })
}
