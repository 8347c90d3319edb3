//! Recordings of a gap: our own CSV, and what oscilloscopes export.
//!
//! | header | where |
//! | --- | --- |
//! | `t_s,gap_v[,gap_i][,gate]` | our own; the gate is 0 or 1 |
//! | `X,CH1[,..],Start,Increment` and `Sequence,Volt[,..],START,STEP` | Rigol DS1000Z |
//! | `Time(s),CH1(V)[,..]` | Rigol MSO5000 and DHO, what the screen shows |
//! | `CH1(V)[,..],t0 = START,tInc = STEP` | the same, the whole memory: no times |
//! | `Time,X(CH1)[,..]` and `Second,Volt[,..]` | Rigol DS1000E |
//! | `Record Length,..` to `Source,CH1[,..]` and `Second,Value[,..]` or `Second,Volt[,..]` | Siglent |
//! | `Model,..` to `TIME,CH1[,..]` | Tektronix MDO, MSO, DPO |
//! | `Record Length,..,,TIME,VALUE` in the first line: what describes the recording stands left of it | Tektronix TDS |

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

/// Rates that are taken, samples a second.
pub const RATES: std::ops::RangeInclusive<f64> = 1e4..=1e7;
/// Lines in which the header has to end.
const HEADER: u64 = 64;
/// A gate of an oscilloscope's is open from here on, V: between the levels of 3.3 V and of 5 V logic.
const LOGIC_V: f64 = 1.5;
/// Share of a step by which it may differ from the others: times are written with few digits.
const UNEVEN: f64 = 0.5;

/// Which channels of an oscilloscope are what.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Channels {
    /// Gap voltage; the first when nothing is said.
    pub gap_v: Option<String>,
    /// Gap current.
    pub gap_i: Option<String>,
    /// Gate of the generator.
    pub gate: Option<String>,
}

/// A recording, evenly sampled.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// Time of the first sample, s.
    pub start_s: f64,
    /// Samples a second.
    pub rate: f64,
    /// Gap voltage, V.
    pub gap_v: Vec<f32>,
    /// Gap current, A, where it was recorded.
    pub gap_i: Option<Vec<f32>>,
    /// Whether the gate was open, where it was recorded.
    pub gate: Option<Vec<bool>>,
}

/// Where the numbers stand.
struct Layout {
    /// Column of the time.
    time: Time,
    /// Cells that a line has to have.
    cells: usize,
    /// Cells that are not numbers of the samples, at the left.
    skip: usize,
    /// Names of the channels from there on, behind the time if there is one.
    names: Vec<String>,
    /// Our own: the gate is 0 or 1.
    own: bool,
}

enum Time {
    /// The first cell.
    Told,
    /// By the number of the sample: start and step, s.
    Counted(f64, f64),
}

type Cells = Vec<String>;

impl Recording {
    /// Reads a recording.
    ///
    /// # Errors
    /// What is wrong, with the number of the line.
    pub fn read(path: &Path, channels: &Channels) -> Result<Recording, String> {
        let file = File::open(path).map_err(|error| format!("cannot be read: {error}"))?;
        // A reader of CSV passes over empty lines without counting them, and nothing here is quoted but what is passed over.
        let lines = BufReader::new(file).split(b'\n').zip(1..).map(|(text, line)| {
            let text = text.map_err(|error| format!("cannot be read: {error}"))?;
            let text = String::from_utf8_lossy(&text);
            let cells = text.trim_start_matches('\u{feff}').split(',').map(|cell| cell.trim().to_owned());
            let mut cells: Cells = cells.collect();
            // Exports end their lines with a comma.
            while cells.last().is_some_and(String::is_empty) {
                cells.pop();
            }
            Ok((line, cells))
        });
        Self::of(lines.filter(|line| !matches!(line, Ok((_, cells)) if cells.is_empty())), channels)
    }

    fn of(
        mut lines: impl Iterator<Item = Result<(u64, Cells), String>>,
        channels: &Channels,
    ) -> Result<Recording, String> {
        let (layout, first) = layout(&mut lines)?;
        let (gap_v, gap_i, gate) = layout.chosen(channels)?;
        let mut recording =
            Recording { gap_i: gap_i.map(|_| Vec::new()), gate: gate.map(|_| Vec::new()), ..Recording::default() };
        let mut times = Vec::new();
        let mut at = Vec::new();
        for row in first.into_iter().map(Ok).chain(lines) {
            let (line, cells) = row?;
            if cells.len() != layout.cells {
                return Err(format!("line {line}: {} columns, where there are {}", cells.len(), layout.cells));
            }
            let number = |column: usize, name: &str| {
                let cell = cells.get(column).map_or("", String::as_str);
                let value = cell.parse().ok().filter(|value: &f64| value.is_finite());
                value.ok_or_else(|| format!("line {line}: {name} = {cell:?}: must be a finite number"))
            };
            if matches!(layout.time, Time::Told) {
                times.push(number(layout.skip, "time")?);
            }
            at.push(line);
            recording.gap_v.push(number(gap_v, "gap_v")? as f32);
            if let (Some(column), Some(values)) = (gap_i, &mut recording.gap_i) {
                values.push(number(column, "gap_i")? as f32);
            }
            if let (Some(column), Some(values)) = (gate, &mut recording.gate) {
                let value = number(column, "gate")?;
                if layout.own && value != 0.0 && value != 1.0 {
                    return Err(format!("line {line}: gate = {value}: must be 0 or 1"));
                }
                values.push(value >= if layout.own { 0.5 } else { LOGIC_V });
            }
        }
        let samples = at.len();
        if samples < 2 {
            return Err(format!("holds {samples} samples: two at least are needed"));
        }
        (recording.start_s, recording.rate) = match layout.time {
            Time::Counted(start, step) => (start, 1.0 / step),
            Time::Told => even(&times, &at)?,
        };
        let rate = recording.rate;
        if !RATES.contains(&rate) {
            return Err(format!("sampled at {rate:.4e} /s: must be from 1e4 to 1e7 /s"));
        }
        Ok(recording)
    }

    /// How long it lasts, s.
    pub fn seconds(&self) -> f64 {
        self.gap_v.len() as f64 / self.rate
    }
}

impl Layout {
    /// Columns of gap voltage, current and gate.
    fn chosen(&self, channels: &Channels) -> Result<(usize, Option<usize>, Option<usize>), String> {
        let first = self.skip + usize::from(matches!(self.time, Time::Told));
        let place = |wanted: &Option<String>, option: &str, own: &str| {
            let name = wanted.as_deref().or(self.own.then_some(own));
            let found = name.and_then(|name| self.names.iter().position(|other| other.eq_ignore_ascii_case(name)));
            match (found, wanted) {
                (None, Some(name)) => {
                    Err(format!("--{option} {name}: no such channel; there are {}", self.names.join(", ")))
                }
                _ => Ok(found.map(|found| first + found)),
            }
        };
        let gap_v = place(&channels.gap_v, "gap-v", "gap_v")?.unwrap_or(first);
        Ok((gap_v, place(&channels.gap_i, "gap-i", "gap_i")?, place(&channels.gate, "gate", "gate")?))
    }
}

/// Reads the header; gives what it says, and the line behind it where that had to be looked at.
fn layout(
    lines: &mut impl Iterator<Item = Result<(u64, Cells), String>>,
) -> Result<(Layout, Option<(u64, Cells)>), String> {
    let mut source = Vec::new();
    let told = |names, skip: usize, own| {
        let names: Vec<String> = names;
        Layout { time: Time::Told, cells: skip + 1 + names.len(), skip, names, own }
    };
    let mut newest = 0;
    while newest < HEADER
        && let Some(row) = lines.next()
    {
        let (line, cells) = row?;
        newest = line;
        let Some((first, others)) = cells.split_first() else { continue };
        match (first.to_ascii_lowercase().as_str(), others) {
            ("t_s", names) => {
                let known: [&[&str]; 4] =
                    [&["gap_v"], &["gap_v", "gap_i"], &["gap_v", "gate"], &["gap_v", "gap_i", "gate"]];
                if !known.iter().any(|known| known == &names) {
                    return Err(format!("line {line}: {}: must be t_s,gap_v[,gap_i][,gate]", cells.join(",")));
                }
                return Ok((told(names.to_vec(), 0, true), None));
            }
            ("x", [names @ .., start, increment])
                if start.eq_ignore_ascii_case("start") && increment.eq_ignore_ascii_case("increment") =>
            {
                let below = lines.next().transpose()?.unwrap_or_default();
                let [.., start, step] = below.1.as_slice() else {
                    return Err(format!("line {}: must have start and increment at its end", line + 1));
                };
                return Ok((counted(names, 1, [start, step], below.0)?, None));
            }
            ("record length", [_, _, time, value]) if time.parse::<f64>().is_ok() && value.parse::<f64>().is_ok() => {
                return Ok((told(vec!["CH1".into()], 3, false), Some((line, cells))));
            }
            ("source", names) => source = names.to_vec(),
            ("second", values) if !values.is_empty() => {
                let numbered = || (1..=values.len()).map(|n| format!("CH{n}")).collect();
                let names =
                    if source.len() == values.len() { source.iter().map(|s| channel(s)).collect() } else { numbered() };
                return Ok((told(names, 0, false), None));
            }
            ("time" | "time(s)", names) if !names.is_empty() => {
                let names = names.iter().map(|name| channel(name)).collect();
                let below = lines.next().transpose()?;
                let units =
                    |(_, cells): &(u64, Cells)| cells.first().is_some_and(|cell| cell.eq_ignore_ascii_case("second"));
                return Ok((told(names, 0, false), below.filter(|below| !units(below))));
            }
            (_, [.., start, step]) if start.starts_with("t0") && step.starts_with("tInc") => {
                let names = &cells[..cells.len() - 2];
                return Ok((counted(names, 0, [start, step], line)?, None));
            }
            _ => {}
        }
    }
    match newest {
        0 => Err("is empty".into()),
        _ => Err(format!(
            "line 1: no header that is known in {HEADER} lines: must be t_s,gap_v[,gap_i][,gate], or what an oscilloscope of Rigol, \
             Siglent or Tektronix exports"
        )),
    }
}

/// Samples that are counted: start and step stand in cells, alone or as `t0 = -25s`.
fn counted(names: &[String], skip: usize, cells: [&String; 2], line: u64) -> Result<Layout, String> {
    let [start, step] = cells.map(|cell| {
        let number = cell.rsplit('=').next().unwrap_or(cell).trim().trim_end_matches('s');
        number
            .parse()
            .ok()
            .filter(|x: &f64| x.is_finite())
            .ok_or_else(|| format!("line {line}: {cell:?}: must be a time in s"))
    });
    let names: Vec<String> = names.iter().map(|name| channel(name)).collect();
    if names.is_empty() {
        return Err(format!("line {line}: no channel"));
    }
    Ok(Layout { time: Time::Counted(start?, step?), cells: skip + names.len(), skip, names, own: false })
}

/// `CH1` of `CH1`, `CH1(V)`, `CH1V` or `X(CH1)`; else what is written.
fn channel(cell: &str) -> String {
    let Some((_, behind)) = cell.split_once("CH") else { return cell.into() };
    let number: String = behind.chars().take_while(char::is_ascii_digit).collect();
    if number.is_empty() { cell.into() } else { format!("CH{number}") }
}

/// Start and rate of times that are told, in s and 1/s; `at` are their lines.
fn even(times: &[f64], at: &[u64]) -> Result<(f64, f64), String> {
    let steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let lines = at.iter().skip(1);
    if let Some(((step, pair), line)) =
        steps.iter().zip(times.windows(2)).zip(lines.clone()).find(|((step, _), _)| **step <= 0.0)
    {
        let [before, time] = [pair[0], pair[0] + step];
        return Err(format!(
            "line {line}: time {time} s does not come after {before} s: unsorted, or written with too few digits"
        ));
    }
    let mut sorted = steps.clone();
    sorted.sort_by(f64::total_cmp);
    let usual = sorted[sorted.len() / 2];
    if let Some((step, line)) = steps.iter().zip(lines).find(|(step, _)| (**step - usual).abs() > UNEVEN * usual) {
        return Err(format!(
            "line {line}: {step:.4e} s after the sample before, where {usual:.4e} s are usual: must be evenly sampled, without a gap"
        ));
    }
    let start = times[0];
    let step = (times[times.len() - 1] - start) / steps.len() as f64;
    let off = |n: usize, time: f64| (time - start - n as f64 * step).abs() > UNEVEN * step;
    if let Some(n) = (0..times.len()).find(|n| off(*n, times[*n])) {
        return Err(format!(
            "line {}: time {} s is not where {step:.4e} s a sample lead: must be evenly sampled",
            at[n], times[n]
        ));
    }
    Ok((start, 1.0 / step))
}
