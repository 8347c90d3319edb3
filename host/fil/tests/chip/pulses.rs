//! Every pulse of the generator is classified by the chip, and counted once.

use crate::common;
use edm_fil::host::{self, Bus};
use edm_fil::image::Image;
use edm_fil::rig::{Emulated, Witness};
use edm_servo_head::gap::pulses::Class;
use edm_servo_head::gap::senses::delays::BINS;
use edm_servo_head::gap::senses::{Config, Senses, Sensing};
use edm_servo_head::head::{Command, State};
use edm_servo_head::settings::{Declared as _, Settings, Value};
use edm_servo_head::units::Nanometres;
use edm_sim::machine::Rig as _;
use edm_sim::run::Setup;
use edm_soc::Frame;

#[test]
fn the_classes_add_up_to_the_pulses_of_the_generator_at_1_to_100_khz() {
    let image = Image::parse(common::firmware().to_vec()).unwrap();
    for (name, ticks) in [("sinker-1khz", 20_000), ("sinker", 10_000), ("sinker-100khz", 10_000)] {
        let Setup { process: mut plant, head, .. } = Setup::load(name).unwrap();
        let settings = Settings { commissioned: true, ..head };
        // A short way to the work.
        plant.installation.surface = 0.5;
        let mut rig = Emulated::start(&image, plant, &settings, 1, Witness::twin(&settings).unwrap()).unwrap();
        host::begin(&mut rig).unwrap();
        common::bore(&mut rig, Nanometres(3_000_000));
        let (mut eroded, mut most) = (0, 0u64);
        for _ in 0..400_000 {
            rig.tick().unwrap();
            eroded += u32::from(rig.status().state == State::Eroding);
            // A status is of the newest plan, nine ticks old at the most: the pulses of half a millisecond may be on their way.
            let made = rig.process_mut().truth().pulses.total();
            let counted = u64::from(rig.status().gap.pulses.total());
            assert!(counted <= made, "{name}: {counted} counted of {made}");
            most = most.max(made - counted);
            if eroded == ticks {
                break;
            }
        }
        assert_eq!(rig.status().state, State::Eroding, "{name}: {:?}", rig.status().fault);
        senses(&mut rig, name);
        rig.command(Command::Hold).unwrap();
        for _ in 0..100 {
            rig.tick().unwrap();
        }
        let truth = rig.process_mut().truth().pulses;
        let counts = rig.status().gap.pulses;
        // The pulse that the hold has cut off is none of the generator's counts.
        let more = i64::from(counts.total()) - truth.total() as i64;
        assert!(
            (0..=1).contains(&more) && most <= 65,
            "{name}: {more} more, {most} on their way; {counts:?}, {truth:?}"
        );
        let of = |class: Class| u64::from(counts.classes[class as usize]);
        println!("{name}: {counts:?} of {truth:?}");
        // What is told is right; a spark that ignites at the very end of its gate is taken for an open pulse.
        assert!(of(Class::Arc) <= truth.arc && of(Class::Short) <= truth.short, "{name}: {counts:?}, {truth:?}");
        assert!(of(Class::Spark) <= truth.spark, "{name}: {counts:?}, {truth:?}");
        assert!(of(Class::Open).abs_diff(truth.open) * 100 <= truth.total(), "{name}: {counts:?}, {truth:?}");
        assert!(of(Class::Uncertain) * 8 <= truth.total(), "{name}: {counts:?}, {truth:?}");
    }
}

/// A head whose pulses the same estimators look at on a PC every millisecond: as many of them as the head may look at in another tick.
struct Watched<'a> {
    rig: &'a mut Emulated,
    config: Config,
    sensing: [Sensing; TICKS],
    /// What each has found since the newest request was sent.
    seen: [Vec<Senses>; TICKS],
    /// Whether the head may be this one, by all that was read.
    fits: [bool; TICKS],
}

/// Ticks of a millisecond.
const TICKS: usize = 20;

impl Bus for Watched<'_> {
    fn send(&mut self, frame: Frame) {
        for seen in &mut self.seen {
            // What is told may be a status older.
            seen.drain(..seen.len() - 3);
        }
        self.rig.send(frame);
    }

    fn pass(&mut self) -> anyhow::Result<()> {
        for (sensing, seen) in self.sensing.iter_mut().zip(&mut self.seen) {
            self.rig.tick().map_err(anyhow::Error::msg)?;
            seen.push(*sensing.look(&self.config, &self.rig.status().gap.pulses, true));
        }
        Ok(())
    }

    fn take(&mut self) -> Option<Frame> {
        self.rig.take()
    }
}

impl Watched<'_> {
    /// Reads 2012h:`sub`, which was found between request and answer.
    fn read(&mut self, sub: u8, found: impl Fn(&Senses) -> Option<f32>) {
        let said = host::read(self, 0x2012, sub).unwrap() as f32;
        for (fits, seen) in self.fits.iter_mut().zip(&self.seen) {
            *fits &= seen.iter().filter_map(&found).any(|found| (found - said).abs() <= 1.0 + 1e-3 * said);
        }
        assert!(self.fits.contains(&true), "2012h:{sub}: {said}, {:?}", self.seen);
    }
}

/// What the head says of its pulses over the bus is what the same estimators make of the counts on a PC.
fn senses(rig: &mut Emulated, name: &str) {
    let config = Settings::default().build().unwrap().head.supervise.senses;
    let (sensing, seen) = (core::array::from_fn(|_| Sensing::default()), core::array::from_fn(|_| Vec::new()));
    let mut watched = Watched { rig, config, sensing, seen, fits: [true; TICKS] };
    for _ in 0..200 {
        watched.pass().unwrap();
    }
    let before = watched.rig.status().gap.pulses;
    watched.read(2, |senses| senses.hazard.map(|hazard| hazard.rate));
    watched.read(3, |senses| senses.hazard.map(|hazard| 1000.0 * hazard.variance.sqrt()));
    watched.read(4, |senses| senses.distance.map(|distance| 100.0 * distance.gap.0));
    watched.read(6, |senses| senses.frequency);
    println!("{name}: {:?}", watched.fits);
    let mut read = |sub| host::read(rig, 0x2012, sub).unwrap();
    let [missing, age, notch] = [7, 8, 9].map(&mut read);
    let classes = [11, 12, 13, 14, 15].map(&mut read);
    assert!(missing == 0 && age <= 2 && notch == 5000, "{name}: {missing}, {age}, {notch}");
    let counted = classes.iter().fold(0u32, |sum, count| sum.wrapping_add(*count));
    let after = rig.status().gap.pulses.total();
    assert!((before.total()..=after).contains(&counted), "{name}: {counted}");

    // The histogram of the delays has every ignition since the start, and is empty when it is taken again at once.
    host::write(rig, 0x2012, 16, 1, 1).unwrap();
    let [delays, ignited] = [histogram(rig), rig.status().gap.pulses.ignited];
    assert!(delays.abs_diff(ignited) <= ignited / 20 + 40, "{name}: {delays} of {ignited}");
    host::write(rig, 0x2012, 16, 1, 1).unwrap();
    assert!(histogram(rig) <= ignited / 10 + 40, "{name}");
}

/// All counts of the histogram, by a segmented upload.
fn histogram(rig: &mut Emulated) -> u32 {
    let bytes = host::upload(rig, 0x2012, 17).unwrap();
    assert_eq!(bytes.len(), 4 * BINS);
    bytes.chunks_exact(4).map(|count| u32::from_le_bytes(count.try_into().unwrap())).sum()
}

#[test]
fn a_teach_in_over_the_bus_finds_the_levels_of_another_generator_and_the_chip_runs_them() {
    let image = Image::parse(common::firmware().to_vec()).unwrap();
    let Setup { process: mut plant, head, .. } = Setup::load("sinker").unwrap();
    // 50 kHz: enough burns in half a second.
    for (key, value) in
        [("open_v", 80.0), ("burn_v", 25.0), ("arc_v", 18.0), ("on_us", 16.0), ("off_us", 4.0), ("recovery_us", 0.6)]
    {
        plant.set(&format!("model.{key}"), Value::Number(value)).unwrap();
    }
    plant.installation.surface = 0.2;
    plant.installation.comparators_for = 80.0;
    let settings = Settings { commissioned: true, gap_setpoint: 45.0, gap_open_min: 60.0, ..head };
    let mut rig = Emulated::start(&image, plant, &settings, 1, Witness::twin(&settings).unwrap()).unwrap();
    host::begin(&mut rig).unwrap();
    host::write(&mut rig, 0x2013, 2, 0, 2).unwrap();
    host::write(&mut rig, 0x2013, 1, 1, 1).unwrap();
    assert_eq!(host::read(&mut rig, 0x2013, 16).unwrap() & 0xFF, 0);
    common::bore(&mut rig, Nanometres(3_000_000));
    let step = |rig: &mut Emulated| host::read(rig, 0x2013, 3).unwrap() & 0xFF;
    let mut before = None;
    for _ in 0..100 {
        (0..20).for_each(|_| rig.pass().unwrap());
        if rig.status().state == State::Eroding && before.is_none() {
            before = Some((rig.status().gap.pulses, rig.process_mut().truth().pulses));
            assert_eq!(host::read(&mut rig, 0x2013, 16).unwrap() & 0xFF, 2, "levels do not fit");
        }
        if step(&mut rig) > 3 {
            break;
        }
    }
    let before = before.unwrap_or_else(|| panic!("{:?}", rig.status()));
    assert_eq!((step(&mut rig), host::read(&mut rig, 0x2013, 4).unwrap() & 0xFF), (4, 0), "{:?}", rig.status());
    // Sparks were learned without it.
    let since = rig.status().gap.pulses.since(&before.0);
    let truth = rig.process_mut().truth().pulses.since(&before.1);
    let [spark, arc, short] = [Class::Spark, Class::Arc, Class::Short].map(|class| u64::from(since.class(class)));
    let near = |counted: u64, is: u64| counted.abs_diff(is) * 1000 <= spark;
    assert!(spark > 10_000 && near(arc, truth.arc) && near(short, truth.short), "{since:?}, {truth:?}");
    let proposed = [10, 11, 12, 13, 14].map(|sub| host::read(&mut rig, 0x2013, sub).unwrap() & 0xFFFF);
    println!("{proposed:?} of {} pulses", host::read(&mut rig, 0x2013, 5).unwrap());
    let [open, spark, ..] = proposed;
    assert!(open.abs_diff(8000) < 100 && spark.abs_diff(2500) < 100, "{proposed:?}");
    rig.command(Command::Hold).unwrap();
    rig.command(Command::Disable).unwrap();
    host::write(&mut rig, 0x2013, 1, 2, 1).unwrap();
    let set = [20, 21, 19, 8, 22]
        .map(|sub| (f32::from_bits(host::read(&mut rig, 0x2100, sub).unwrap()) * 100.0).round() as u32);
    assert_eq!(set, proposed);
    assert_eq!(host::read(&mut rig, 0x2013, 16).unwrap() & 0xFF, 0, "not known yet");
    let generations = [1, 3].map(|sub| host::read(&mut rig, 0x200C, sub).unwrap());
    assert_eq!(generations[0], generations[1], "the gap task runs the newest settings");
}
