//! Recordings of a gap through the head's chain: converter, average, low-pass, notch, classes of pulses.
//!
//! What runs is the source that the head runs, fed block by block. A recording of fewer samples than the converter takes is
//! interpolated by straight lines; its pulses are not classified then, because the classifier would count one sample as
//! many conversions.

pub mod converter;
mod header;
mod picture;
pub mod recording;

pub use picture::draw;

use crate::output::Output;
use crate::process::THRESHOLDS;
use converter::{Gate, Scale, blocks};
use edm_servo_head::dsp::chain::{State, Tracked};

use edm_servo_head::gap::pulses::{CLASSES, Class, Fit, PulseStream, Shares};
use edm_servo_head::gap::{GapSource, Quality, Voltage};
use edm_servo_head::settings::Settings;
use edm_servo_head::units::{ADC_HZ, TICK_HZ, TICKS_PER_MS};
use recording::Recording;

/// Columns of the table, one row a servo tick. `classes` are those of the pulses that ended in it, the shares those of the last
/// 200 ms in percent of the pulses; `notch_hz` is where a notch that follows the mains would be, and `followed_v` what it gives.
pub const COLUMNS: [&str; 13] = [
    "t_s",
    "decimated_v",
    "lowpass_v",
    "filtered_v",
    "quality",
    "classes",
    "open_percent",
    "spark_percent",
    "arc_percent",
    "short_percent",
    "uncertain_percent",
    "notch_hz",
    "followed_v",
];

/// What the chain makes of a block.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// End of the block, in the recording's time, s.
    pub t_s: f64,
    /// Mean of the block, V: gated, or of all conversions.
    pub decimated_v: f32,
    /// Behind the low-pass, V.
    pub lowpass_v: f32,
    /// Behind low-pass and notch, V: what the feed law sees.
    pub filtered_v: f32,
    /// Quality by the head.
    pub quality: Quality,
    /// Pulses that ended.
    pub classes: Vec<Class>,
    /// Pulses of each class, of the last 200 ms.
    pub counts: [u16; CLASSES],
    /// Where a notch that follows the mains would be, Hz.
    pub notch_hz: f32,
    /// What that would give, V.
    pub followed_v: f32,
}

/// Classes that a pulse may have, in the order of their columns.
const NAMED: [Class; 5] = [Class::Open, Class::Spark, Class::Arc, Class::Short, Class::Uncertain];

impl Row {
    /// Share of the pulses that are of a class, %; `None` without pulses.
    pub fn percent(&self, class: Class) -> Option<f64> {
        let all: u32 = NAMED.iter().map(|class| u32::from(self.counts[*class as usize])).sum();
        (all > 0).then(|| 100.0 * f64::from(self.counts[class as usize]) / f64::from(all))
    }
}

/// A recording, run through the chain.
#[derive(Clone, Debug, PartialEq)]
pub struct Replay {
    /// One a servo tick.
    pub rows: Vec<Row>,
    /// Pulses of each class, of the whole recording.
    pub pulses: [u64; CLASSES],
    /// Whether pulses were classified: sampled often enough, and with a gate.
    pub classified: bool,
    /// Whether the levels fitted them at the end.
    pub fit: Fit,
    /// The same pulses as the head has counted them.
    pub counted: [u32; CLASSES],
}

/// Runs a recording through the chain.
///
/// # Errors
/// When settings do not fit together, or nothing fills a block of conversions.
pub fn run(recording: &Recording, settings: &Settings, gate: Gate) -> Result<Replay, String> {
    let active = settings.build().map_err(|error| error.to_string())?;
    let wrong = |error: edm_servo_head::dsp::OutOfRange| error.to_string();
    let mut source = Voltage::new(active.gap);
    let filter = settings.gap_filter().build().map_err(wrong)?;
    let following = edm_servo_head::dsp::chain::Config { follow: true, ..settings.gap_filter() };
    let mut tracked = Tracked::new(following.build().map_err(wrong)?);
    let boundaries = settings.boundaries();
    let mut stream = PulseStream::new(boundaries.build().map_err(wrong)?);
    let thresholds = THRESHOLDS.map(|share| share * f64::from(boundaries.open.0));
    let known = recording.gate.is_some() || matches!(gate, Gate::Above(..));
    let classified = known && recording.rate >= 0.999 * f64::from(ADC_HZ);
    let scale = Scale { zero: settings.gap_zero_code as f32, volts_per_code: settings.gap_volts_per_code };
    let sign = if settings.gap_reversed { -1.0 } else { 1.0 };
    let per_code = sign * settings.gap_volts_per_code;

    let mut beside: Option<[State; 2]> = None;
    let (mut ms, mut shares, mut pulses) = ([0u16; CLASSES], Shares::default(), [0u64; CLASSES]);
    let (mut rows, mut counted) = (Vec::new(), [0; CLASSES]);
    for (tick, block) in blocks(recording, scale, gate, thresholds).enumerate() {
        let reading = source.update(Some(&block));
        let codes = reading.block.0 / per_code;
        counted = reading.pulses.classes;
        let [low_pass, follower] = beside.get_or_insert([State::settled(codes); 2]);
        let (lowpass, followed) = (low_pass.low_pass(&filter, codes), tracked.tick(follower, codes));
        let mut classes = Vec::new();
        if classified {
            // As the head does.
            if (tick + 1).is_multiple_of(TICKS_PER_MS as usize) {
                stream.look();
            }
            stream.block(&block, |pulse| classes.push(pulse.class));
        }
        for class in &classes {
            ms[*class as usize] += 1;
            pulses[*class as usize] += 1;
        }
        if (tick + 1).is_multiple_of(TICKS_PER_MS as usize) {
            shares.add(&std::mem::take(&mut ms));
        }
        rows.push(Row {
            t_s: recording.start_s + (tick + 1) as f64 / f64::from(TICK_HZ),
            decimated_v: reading.block.0,
            lowpass_v: lowpass * per_code,
            filtered_v: reading.filtered.0,
            quality: reading.quality,
            classes,
            counts: shares.counts(),
            notch_hz: tracked.mains().0,
            followed_v: followed * per_code,
        });
    }
    if rows.is_empty() {
        return Err(format!("lasts {:.1} us: must last at least a servo tick, 50 us", recording.seconds() * 1e6));
    }
    let fit = stream.take().0;
    Ok(Replay { rows, pulses, classified, fit, counted })
}

/// Name of a class in tables.
pub fn name(class: Class) -> &'static str {
    match class {
        Class::Open => "open",
        Class::Spark => "spark",
        Class::Arc => "arc",
        Class::Short => "short",
        Class::NoPulse => "no pulse",
        Class::Uncertain => "uncertain",
    }
}

fn quality(quality: Quality) -> &'static str {
    match quality {
        Quality::Missing => "missing",
        Quality::Valid => "valid",
        Quality::NoGate => "no gate",
        Quality::Saturated => "saturated",
        Quality::Reversed => "reversed",
        Quality::Unclear => "unclear",
    }
}

impl Replay {
    /// Writes the table.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&self, output: Output) -> Result<(), String> {
        output.write(|file| {
            let mut table = csv::Writer::from_writer(file);
            table.write_record(COLUMNS)?;
            for row in &self.rows {
                let volts = |volts: f32| format!("{volts:.3}");
                let classes: Vec<&str> = row.classes.iter().map(|class| name(*class)).collect();
                let mut cells = vec![
                    format!("{:.5}", row.t_s),
                    volts(row.decimated_v),
                    volts(row.lowpass_v),
                    volts(row.filtered_v),
                    quality(row.quality).into(),
                    classes.join(" "),
                ];
                cells
                    .extend(NAMED.map(|class| row.percent(class).map_or(String::new(), |share| format!("{share:.2}"))));
                cells.extend([format!("{:.3}", row.notch_hz), volts(row.followed_v)]);
                table.write_record(cells)?;
            }
            table.flush()
        })
    }

    /// Result in words.
    pub fn summary(&self, recording: &Recording) -> String {
        let rate = recording.rate / 1e3;
        let mut text =
            format!("Replayed {:.3} s of {rate:.0} kS/s through the head's filters\n\n", recording.seconds());
        let mean = self.rows.iter().map(|row| f64::from(row.filtered_v)).sum::<f64>() / self.rows.len() as f64;
        text += &format!("  {:<12} {mean:.2} V mean\n", "Filtered");
        let pulses = if self.classified {
            NAMED.map(|class| format!("{} {}", self.pulses[class as usize], name(class))).join(", ")
        } else if rate < 499.0 {
            "not classified: the recording has less than the 500 kS/s of the converter, and is interpolated".into()
        } else {
            "not classified: no gate was recorded (use --gate or --gate-above)".into()
        };
        text += &format!("  {:<12} {pulses}\n", "Pulses");
        let say = match self.fit {
            Fit::Unknown | Fit::Fits => None,
            Fit::DoesNotFit => {
                Some("do not fit: set gap.open_v, gap.spark_v and gap.arc_below_v to those of the generator")
            }
            Fit::Divider => {
                Some("differ from the settings by one share: the divider of the gap voltage is another one")
            }
            Fit::Supply => {
                Some("of open pulses differ from gap.open_v, those of sparks do not: the generator has another supply")
            }
            Fit::Unclear => Some("of sparks are above 0.55 of the open circuit: a comparator cannot tell them from it"),
        };
        if let Some(say) = say {
            text += &format!("  {:<12} {say}\n", "Levels");
        }
        text
    }
}
