//! The electronic data sheet (CiA 306-1): every object of the node and the drive, for masters.

use crate::{Declaration, Shape, everything};
use edm_canopen::{Access, DataType, DefaultValue, Mapping};
use edm_servo_head::canopen::drive::DEVICE;
use std::fmt::{self, Display, Formatter, Write};

/// File name that the data sheet gives itself.
pub const FILE: &str = "edm-servo-head.eds";

/// Objects that every device has.
const MANDATORY: [u16; 3] = [0x1000, 0x1001, 0x1018];

#[derive(Clone, Copy, PartialEq)]
enum Section {
    Mandatory,
    Optional,
    Manufacturer,
}

impl Section {
    fn of(index: u16) -> Section {
        match index {
            index if MANDATORY.contains(&index) => Section::Mandatory,
            0x2000..=0x5FFF => Section::Manufacturer,
            _ => Section::Optional,
        }
    }
}

/// Writes the data sheet.
///
/// # Errors
/// Those of the writer.
pub fn write(out: &mut impl Write) -> fmt::Result {
    write!(
        out,
        "; Generated from the declarations in canopen/src, src/canopen and src/settings: cargo sim eds.\n\
         [FileInfo]\nFileName={FILE}\nFileVersion=1\nFileRevision=0\nEDSVersion=4.0\n\
         Description=Servo head for electrical discharge machining\n\
         CreationTime=12:00AM\nCreationDate=11-21-2026\nCreatedBy=cargo sim eds\n\
         ModificationTime=12:00AM\nModificationDate=11-21-2026\nModifiedBy=cargo sim eds\n\n\
         [DeviceInfo]\nVendorName=none\nVendorNumber={:#X}\nProductName={}\nProductNumber={:#X}\nRevisionNumber={:#X}\n\
         OrderCode=none\n",
        DEVICE.vendor, DEVICE.name, DEVICE.product, DEVICE.revision
    )?;
    for rate in [10, 20, 50, 125, 250, 500, 800, 1000] {
        writeln!(out, "BaudRate_{rate}={}", u8::from(matches!(rate, 125 | 250 | 500 | 1000)))?;
    }
    write!(
        out,
        "SimpleBootUpMaster=0\nSimpleBootUpSlave=1\nGranularity=8\nDynamicChannelsSupported=0\nGroupMessaging=0\n\
         NrOfRXPDO={}\nNrOfTXPDO={}\nLSS_Supported=1\nCompactPDO=0\n\n[DummyUsage]\n",
        DEVICE.receive.len(),
        DEVICE.transmit.len()
    )?;
    for dummy in 1..=7 {
        writeln!(out, "Dummy{dummy:04X}={}", u8::from(dummy > 1))?;
    }
    writeln!(out, "\n[Comments]\nLines=0")?;
    for (name, section) in [
        ("MandatoryObjects", Section::Mandatory),
        ("OptionalObjects", Section::Optional),
        ("ManufacturerObjects", Section::Manufacturer),
    ] {
        list(out, name, section)?;
    }
    everything().try_for_each(|declaration| object(out, &declaration))
}

fn indices() -> impl Iterator<Item = u16> {
    let mut last = None;
    everything().map(|declaration| declaration.index).filter(move |index| last.replace(*index) != Some(*index))
}

fn list(out: &mut impl Write, name: &str, section: Section) -> fmt::Result {
    let members = || indices().filter(|index| Section::of(*index) == section);
    writeln!(out, "\n[{name}]\nSupportedObjects={}", members().count())?;
    (1..).zip(members()).try_for_each(|(number, index)| writeln!(out, "{number}={index:#06X}"))
}

fn object(out: &mut impl Write, d: &Declaration) -> fmt::Result {
    let first = d.shape != Shape::Variable && d.sub == 0;
    if first {
        let count = everything().filter(|other| other.index == d.index).count();
        writeln!(
            out,
            "\n[{:04X}]\nParameterName={}\nObjectType={:#X}\nSubNumber={count}",
            d.index,
            object_name(d),
            d.shape as u8
        )?;
    }
    match d.shape {
        Shape::Variable => writeln!(out, "\n[{:04X}]", d.index)?,
        _ => writeln!(out, "\n[{:04X}sub{:X}]", d.index, d.sub)?,
    }
    let name = Name(d);
    writeln!(out, "ParameterName={name}\nObjectType=0x7\nDataType={:#06X}\nAccessType={}", d.kind.code(), access(d))?;
    match d.default {
        DefaultValue::Number(value) => writeln!(out, "DefaultValue={value}")?,
        DefaultValue::NodeId(base) => writeln!(out, "DefaultValue=$NODEID+{base:#X}")?,
        // lely wants the bits of a float in hexadecimal, python canopen its digits, and takes some bits for digits.
        DefaultValue::Real(value) => writeln!(out, "; default {value}")?,
        DefaultValue::Text(text) => writeln!(out, "DefaultValue={text}")?,
        DefaultValue::Unknown => {}
    }
    if let Some((low, high)) = d.range {
        match d.kind {
            DataType::Real32 => writeln!(out, "; from {} to {}", low as f32, high as f32)?,
            _ => writeln!(out, "LowLimit={low}\nHighLimit={high}")?,
        }
    }
    writeln!(out, "PDOMapping={}", u8::from(d.mapping != Mapping::No))?;
    // Comments: lely refuses every entry that the standard does not name, units among them.
    if !d.unit.is_empty() {
        writeln!(out, "; in {}", d.unit)?;
    }
    if !d.doc.is_empty() {
        writeln!(out, "; {}", d.doc.trim())?;
    }
    (0..).zip(d.choices).try_for_each(|(number, name): (u8, _)| writeln!(out, "; {number} {name}"))
}

fn access(d: &Declaration) -> &'static str {
    match (d.access, d.mapping) {
        (Access::Const, _) => "const",
        (Access::ReadOnly, _) => "ro",
        (Access::WriteOnly, _) => "wo",
        (Access::ReadWrite, Mapping::Receive) => "rww",
        (Access::ReadWrite, Mapping::Transmit) => "rwr",
        (Access::ReadWrite, _) => "rw",
    }
}

/// A unit with its factor, as in "0.01 V".
pub fn scaled(unit: &'static str) -> (&'static str, &'static str) {
    match unit.split_once(' ') {
        Some((factor, name)) if factor.parse::<f64>().is_ok() => (factor, name),
        _ => ("1", unit),
    }
}

/// Name of an object; PDOs are numbered.
pub fn object_name(d: &Declaration) -> impl Display + '_ {
    ObjectName(d)
}

struct ObjectName<'a>(&'a Declaration);

impl Display for ObjectName<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(self.0.object)?;
        match self.0.index {
            index @ 0x1400..=0x1BFF => write!(f, " {}", (index & 0x1FF).wrapping_add(1)),
            _ => Ok(()),
        }
    }
}

/// Name of a value; values that differ only in their sub-index are numbered.
struct Name<'a>(&'a Declaration);

impl Display for Name<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let d = self.0;
        if d.shape == Shape::Variable {
            return write!(f, "{}", object_name(d));
        }
        f.write_str(d.name)?;
        let twins = everything().filter(|other| other.index == d.index && other.name == d.name);
        if twins.count() > 1 { write!(f, " {}", d.sub) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_object_has_its_section_once() {
        let mut sheet = String::new();
        write(&mut sheet).unwrap();
        let sections: Vec<_> = sheet.lines().filter(|line| line.starts_with('[')).collect();
        assert_eq!(sections.iter().collect::<BTreeSet<_>>().len(), sections.len());
        for d in everything() {
            let section = match d.shape {
                Shape::Variable => format!("[{:04X}]", d.index),
                _ => format!("[{:04X}sub{:X}]", d.index, d.sub),
            };
            assert!(sections.contains(&section.as_str()), "{section}");
        }
    }

    #[test]
    fn a_factor_is_taken_off_its_unit() {
        assert_eq!(scaled("0.01 V"), ("0.01", "V"));
        assert_eq!(scaled("50 us"), ("50", "us"));
        assert_eq!(scaled("counts/s"), ("1", "counts/s"));
        assert_eq!(scaled("1/(V s)"), ("1", "1/(V s)"));
        assert_eq!(scaled(""), ("1", ""));
    }
}
