//! `edm-fil serve`: the firmware on the modelled chip on a CAN bus of this computer, in real time; the counterpart of
//! [`edm_sim::serve`], with its options.
//!
//! With `--store` the two sectors of flash in which the firmware keeps what hosts store are a file: for a power cycle, end
//! the program and start it again. Erasing and programming take their time on the chip; the file is replaced whole.

use crate::commission::{self, commission_as};
use crate::host::Bus as _;
use crate::image::Image;
use crate::rig::{Emulated, Witness};
use anyhow::{Context, Result, ensure};
use edm_bus::Frame;
use edm_servo_head::canopen::NodeId;
use edm_servo_head::settings::Settings;
use edm_sim::cli::Failure;
use edm_sim::machine::Rig as _;
use edm_sim::serve::{Plant, Serve, pull};
use edm_soc::Region;
use embedded_can::{ExtendedId, Frame as _, Id, StandardId};
use std::path::{Path, PathBuf};

/// From power-up until the head listens to its bus, and has said so, ms.
const START_MS: u32 = 20;

/// The chip on the bus.
struct Chip {
    rig: Emulated,
    store: Option<PathBuf>,
}

/// Serves until it is stopped.
///
/// # Errors
/// When an option is refused, or the firmware cannot go on.
pub fn serve(image: &Image, log: bool, options: &Serve) -> Result<(), Failure> {
    if options.nodes != 1 {
        let message = format!("--nodes {}: must be 1 here; `cargo sim serve` serves more heads", options.nodes);
        return Err(Failure::BadInput(message));
    }
    let id = NodeId::new(options.node_id);
    let setup = options.setup().map_err(Failure::BadInput)?;
    // Commissioning counts as passed: it needs an axis without a workpiece.
    let settings = Settings { commissioned: true, ..setup.head };
    let failed = |error: anyhow::Error| Failure::Failed(format!("{error:#}"));
    let store = options.store.as_deref().map(file).transpose().map_err(failed)?;
    let prepare = |flash: &Region| match store.as_deref().filter(|store| store.exists()) {
        Some(store) => {
            let bytes = std::fs::read(store).with_context(|| format!("{}: cannot be read", store.display()))?;
            ensure!(bytes.len() == commission::LENGTH, "{}: must have {} bytes", store.display(), commission::LENGTH);
            flash.fill(commission::BASE, &bytes).context("there is no such flash")
        }
        None => commission_as(flash, &settings, id),
    };
    let mut rig = Emulated::power_up(image, setup.process, options.seed, Witness::None, prepare).map_err(failed)?;
    rig.log = log;
    rig.host_alive = false;
    for _ in 0..START_MS {
        rig.pass().map_err(failed)?;
    }
    // Nobody has been there to hear it.
    while rig.take().is_some() {}
    rig.process_mut().schedule(&setup.events);
    let mut chip = Chip { rig, store };
    chip.keep().map_err(failed)?;
    let title = format!(
        "Modelled chip with the firmware, {} (scenario {}, {} x real time; everything is simulated)",
        id.map_or("no node-ID until a host assigns one by LSS".into(), |id| format!("node {}", id.get())),
        options.scenario,
        options.speed
    );
    edm_sim::serve::run(&title, &options.links, options.speed, &mut chip)
}

/// The file of the flash in a folder, which is made.
fn file(folder: &Path) -> Result<PathBuf> {
    std::fs::create_dir_all(folder).with_context(|| format!("--store {}: cannot be made", folder.display()))?;
    Ok(folder.join("node-1.flash"))
}

impl Chip {
    /// Writes what the firmware has stored to the file.
    fn keep(&mut self) -> Result<()> {
        let Some(store) = &self.store else { return Ok(()) };
        let flash = self.rig.flash();
        let byte = |address| flash.load(address, 1).map(|byte| byte as u8);
        let now: Option<Vec<u8>> = (commission::BASE..).take(commission::LENGTH).map(byte).collect();
        let now = now.context("there is no such flash")?;
        let new = store.with_extension("new");
        std::fs::write(&new, &now)
            .and_then(|()| std::fs::rename(&new, store))
            .with_context(|| format!("{}: cannot be written", store.display()))
    }
}

impl Plant for Chip {
    fn tick(&mut self, came: &[Frame], sent: &mut Vec<Frame>) -> Result<(), String> {
        for frame in came {
            self.rig.send(to_chip(frame));
        }
        self.rig.tick()?;
        while let Some(frame) = self.rig.take() {
            sent.extend(from_chip(&frame));
        }
        if self.rig.has_stored() {
            self.keep().map_err(|error| format!("{error:#}"))?;
        }
        Ok(())
    }

    fn line(&mut self, line: &str) -> Result<(), String> {
        if line.is_empty() { Ok(()) } else { pull(line, std::iter::once(self.rig.process_mut())) }
    }
}

fn to_chip(frame: &Frame) -> edm_soc::Frame {
    let (id, extended) = match frame.id() {
        Id::Standard(id) => (id.as_raw().into(), false),
        Id::Extended(id) => (id.as_raw(), true),
    };
    let mut data = [0; 8];
    let length = frame.dlc().min(8);
    if let Some(bytes) = frame.data().get(..length) {
        data[..length].copy_from_slice(bytes);
    }
    edm_soc::Frame { id, extended, remote: frame.is_remote_frame(), length: length as u8, data }
}

fn from_chip(frame: &edm_soc::Frame) -> Option<Frame> {
    let id: Id = match frame.extended {
        false => StandardId::new(frame.id as u16)?.into(),
        true => ExtendedId::new(frame.id)?.into(),
    };
    let length = usize::from(frame.length).min(8);
    if frame.remote { Frame::new_remote(id, length) } else { Frame::new(id, frame.data.get(..length)?) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_the_same_on_both_sides() {
        let standard = StandardId::new(0x601).unwrap();
        let extended = ExtendedId::new(0x1234_5678).unwrap();
        for frame in [
            Frame::new(standard, &[1, 2, 3]).unwrap(),
            Frame::new(extended, &[]).unwrap(),
            Frame::new_remote(standard, 5).unwrap(),
        ] {
            assert_eq!(from_chip(&to_chip(&frame)), Some(frame));
        }
    }
}
