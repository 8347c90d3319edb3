//! The run as a table: CSV, one row a millisecond.
//!
//! A row is the sample at that instant, not a mean: what happens between rows is in the figures, not here. Numbers carry
//! the digits that mean something (0.01 um, 0.01 V, 0.0001 of duty), so that a minute is about 8 MB.

use crate::output::Output;
use crate::run::Sample;
use edm_servo_head::gap::pulses::Class;
use edm_servo_head::units::TICKS_PER_MS;
use std::fs::File;
use std::io::{self, BufWriter, Seek, Write};

/// Columns, in order; units are in the names, V and um from the model's truth but for what the head itself measures
/// (gap_v, filtered_v, the pulses since the start by class from `open` on, and the last four: empty where they are not known) or
/// decides (setpoint_um, duty, state). Debris is in 5 % by volume.
pub const COLUMNS: [&str; 24] = [
    "t_s",
    "position_um",
    "setpoint_um",
    "velocity_um_s",
    "surface_um",
    "gap_um",
    "gap_v",
    "filtered_v",
    "duty",
    "state",
    "wear_um",
    "debris",
    "damage",
    "contact_n",
    "film_n",
    "open",
    "spark",
    "arc",
    "short",
    "uncertain",
    "hazard_per_s",
    "hazard_deviation_per_s",
    "distance_um",
    "spark_per_s",
];

/// Classes whose pulses since the start are columns.
const CLASSES: [Class; 5] = [Class::Open, Class::Spark, Class::Arc, Class::Short, Class::Uncertain];

/// A table in the making, kept in a nameless file until the run has ended.
#[derive(Debug)]
pub struct Trace {
    rows: csv::Writer<BufWriter<File>>,
    tick: u32,
    cell: String,
    failed: Option<io::Error>,
}

impl Trace {
    /// Starts a table for `output`.
    pub fn new(output: &Output) -> Result<Trace, String> {
        let mut rows = csv::Writer::from_writer(BufWriter::new(output.scratch()?));
        let failed = rows.write_record(COLUMNS).err().map(io::Error::from);
        Ok(Trace { rows, tick: 0, cell: String::new(), failed })
    }

    /// Takes every sample and keeps the first of each millisecond. [`Trace::finish`] reports a failure to write.
    pub fn sample(&mut self, sample: &Sample) {
        if self.tick == 0 && self.failed.is_none() {
            self.failed = self.row(sample).err();
        }
        self.tick = (self.tick + 1) % TICKS_PER_MS;
    }

    fn row(&mut self, sample: &Sample) -> io::Result<()> {
        use std::fmt::Write;
        let numbers = [
            (sample.t_s, 3),
            (sample.position_um, 2),
            (sample.setpoint_um, 2),
            (sample.velocity_um_s, 1),
            (sample.surface_um, 2),
            (sample.gap_um, 2),
            (f64::from(sample.gap_v), 2),
            (f64::from(sample.filtered_v), 2),
            (f64::from(sample.duty), 4),
        ];
        let hidden =
            [(sample.wear_um, 2), (sample.debris, 3), (sample.damage, 3), (sample.contact_n, 2), (sample.film_n, 2)];
        for (k, (x, digits)) in numbers.into_iter().chain(hidden).enumerate() {
            if k == numbers.len() {
                self.rows.write_field(sample.state)?;
            }
            self.cell.clear();
            // Writing to a string does not fail.
            let _ = write!(self.cell, "{x:.digits$}");
            self.rows.write_field(&self.cell)?;
        }
        for class in CLASSES {
            self.cell.clear();
            let _ = write!(self.cell, "{}", sample.counts.class(class));
            self.rows.write_field(&self.cell)?;
        }
        let (senses, hazard) = (&sample.senses, sample.senses.hazard);
        let known = [
            (hazard.map(|hazard| hazard.rate), 0),
            (hazard.map(|hazard| hazard.rate * hazard.variance.sqrt()), 0),
            (senses.distance.map(|charged| charged.gap.0), 2),
            (senses.frequency, 0),
        ];
        for (x, digits) in known {
            self.cell.clear();
            if let Some(x) = x {
                let _ = write!(self.cell, "{x:.digits$}");
            }
            self.rows.write_field(&self.cell)?;
        }
        self.rows.write_record(None::<&[u8]>)?;
        Ok(())
    }

    /// Puts the table in its place.
    pub fn finish(mut self, output: Output) -> Result<(), String> {
        output.write(|file| self.copy(file))
    }

    fn copy(&mut self, to: &mut dyn Write) -> io::Result<()> {
        if let Some(error) = self.failed.take() {
            return Err(error);
        }
        self.rows.flush()?;
        let mut file = self.rows.get_ref().get_ref();
        file.rewind()?;
        io::copy(&mut file, to)?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use edm_servo_head::gap::charging::Charged;
    use edm_servo_head::gap::likelihood::Hazard;
    use edm_servo_head::gap::pulses::Counts;
    use edm_servo_head::gap::senses::Senses;
    use edm_servo_head::units::Micrometres;

    #[test]
    fn a_table_has_its_columns_and_a_row_for_every_millisecond() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        let output = Output::claim("--trace", &path).unwrap();
        let mut trace = Trace::new(&output).unwrap();
        for tick in 0..41 {
            trace.sample(&Sample {
                t_s: f64::from(tick) / 20_000.0,
                position_um: f64::from(tick) * 0.5,
                beside_um: [0.0; 2],
                setpoint_um: 1.234,
                velocity_um_s: -2000.0,
                surface_um: 40.0,
                gap_um: 39.996,
                gap_v: 55.25,
                filtered_v: 54.999,
                setpoint_v: 55.0,
                duty: -0.123_45,
                state: "eroding",
                wear_um: 1.25,
                debris: 0.5,
                damage: 0.0625,
                contact_n: 0.0,
                film_n: -3.0,
                counts: Counts { classes: [1, 20, 3, 4, 99, 5], ..Counts::default() },
                senses: match tick {
                    0..20 => Senses::NONE,
                    _ => Senses {
                        hazard: Some(Hazard { rate: 12_600.4, variance: 0.01 }),
                        distance: Some(Charged { gap: Micrometres(34.567), inside: true }),
                        frequency: Some(3000.4),
                        ..Senses::NONE
                    },
                },
                ..Sample::default()
            });
        }
        trace.finish(output).unwrap();
        let text = std::fs::read_to_string(path).unwrap();
        assert_eq!(
            text,
            "t_s,position_um,setpoint_um,velocity_um_s,surface_um,gap_um,gap_v,filtered_v,duty,state,wear_um,debris,damage,contact_n,film_n,open,spark,arc,short,uncertain,hazard_per_s,hazard_deviation_per_s,distance_um,spark_per_s\n\
             0.000,0.00,1.23,-2000.0,40.00,40.00,55.25,55.00,-0.1235,eroding,1.25,0.500,0.062,0.00,-3.00,1,20,3,4,5,,,,\n\
             0.001,10.00,1.23,-2000.0,40.00,40.00,55.25,55.00,-0.1235,eroding,1.25,0.500,0.062,0.00,-3.00,1,20,3,4,5,12600,1260,34.57,3000\n\
             0.002,20.00,1.23,-2000.0,40.00,40.00,55.25,55.00,-0.1235,eroding,1.25,0.500,0.062,0.00,-3.00,1,20,3,4,5,12600,1260,34.57,3000\n"
        );
    }
}
