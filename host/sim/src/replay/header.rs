//! The header of a recording: columns, units and number of rows.

/// Lines in which the header has to end.
const LINES: u64 = 64;

/// Which channels of an oscilloscope are what.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Channels {
    /// Gap voltage; the first by default.
    pub gap_v: Option<String>,
    /// Gap current.
    pub gap_i: Option<String>,
    /// Gate of the generator.
    pub gate: Option<String>,
}

/// The cells of a line, and its number.
pub type Row = (u64, Vec<String>);

/// Where the numbers are.
pub struct Layout {
    /// Where the time comes from.
    pub time: Time,
    /// Cells that a line has to have.
    pub cells: usize,
    /// Cells that are not numbers of the samples, at the left.
    pub skip: usize,
    /// Our own: the gate is 0 or 1.
    pub own: bool,
    /// Rows that the header promises, and the line that does.
    pub promised: Option<(u64, u64)>,
    /// The channels from there on, behind the time if there is one.
    channels: Vec<Channel>,
}

/// Where the time of a sample comes from.
pub enum Time {
    /// The first cell, in this unit, s.
    Given(f64),
    /// By the number of the sample: start and step, s.
    Counted(f64, f64),
}

/// A requested column.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Column {
    /// Its cell.
    pub cell: usize,
    /// What a number of it is, V or A.
    pub scale: f64,
    /// It is a level, 0 or 1.
    pub logic: bool,
}

/// A column of the recording.
struct Channel {
    name: String,
    /// As it is written; empty: V or A.
    unit: String,
}

/// What a unit is one of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Quantity {
    Time,
    Voltage,
    Current,
    Level,
}

/// Units without a prefix, as exports write them in whatever case.
const UNITS: [(&str, Quantity); 12] = [
    ("seconds", Quantity::Time),
    ("second", Quantity::Time),
    ("sec", Quantity::Time),
    ("s", Quantity::Time),
    ("volts", Quantity::Voltage),
    ("volt", Quantity::Voltage),
    ("v", Quantity::Voltage),
    ("amperes", Quantity::Current),
    ("ampere", Quantity::Current),
    ("amps", Quantity::Current),
    ("amp", Quantity::Current),
    ("a", Quantity::Current),
];

/// What they mean, and what stands for the micro sign in files that are not UTF-8.
const PREFIXES: [(&[&str], f64); 6] = [
    (&[""], 1.0),
    (&["k", "kilo"], 1e3),
    (&["m", "milli"], 1e-3),
    (&["u", "\u{b5}", "\u{3bc}", "\u{fffd}", "micro"], 1e-6),
    (&["n", "nano"], 1e-9),
    (&["p", "pico"], 1e-12),
];

/// What a unit is one of, and how much: `mV`, `(us)`, `[s]`, `Volt`, `V DC`, `milliseconds`.
fn unit(text: &str) -> Option<(Quantity, f64)> {
    let bare = text.trim().trim_matches(['(', ')', '[', ']']).split_whitespace().next()?;
    if bare.eq_ignore_ascii_case("logic") {
        return Some((Quantity::Level, 1.0));
    }
    UNITS.iter().find_map(|(name, quantity)| {
        let at = bare.len().checked_sub(name.len()).filter(|at| bare.is_char_boundary(*at))?;
        let (prefix, base) = bare.split_at(at);
        // The case of a prefix says which it is, that of a unit does not.
        let known = PREFIXES.iter().find(|(prefixes, _)| prefixes.contains(&prefix));
        base.eq_ignore_ascii_case(name).then_some(known).flatten().map(|(_, scale)| (*quantity, *scale))
    })
}

/// A unit of time, s.
fn time_unit(text: &str) -> Option<f64> {
    unit(text).filter(|(quantity, _)| *quantity == Quantity::Time).map(|(_, scale)| scale)
}

/// Name and unit of `CH1(mV)`, `Time [s]`, `C1 in V`, `in s`, `CH1V`, `X(CH1)`, `Channel A`.
fn label(cell: &str) -> (String, String) {
    let parts = |name: &str, unit: &str| (name.trim().to_owned(), unit.trim().to_owned());
    if let Some(unit) = cell.strip_prefix("in ") {
        return parts("", unit);
    }
    if let Some((name, unit)) = cell.rsplit_once(" in ") {
        return parts(name, unit);
    }
    if let Some(open) = cell.rfind(['(', '[']).filter(|_| cell.ends_with([')', ']'])) {
        let (name, unit) = (&cell[..open], &cell[open + 1..cell.len() - 1]);
        return if unit.starts_with("CH") { parts(unit, "") } else { parts(name, unit) };
    }
    if let Some(behind) = cell.strip_prefix("CH") {
        let digits = behind.bytes().take_while(u8::is_ascii_digit).count();
        if digits > 0 {
            return parts(&cell[..2 + digits], &behind[digits..]);
        }
    }
    parts(cell, "")
}

impl Channel {
    fn of(cell: &str) -> Channel {
        let (name, unit) = label(cell);
        // sigrok names the lines of a logic analyser so.
        let digits = name.strip_prefix('D').filter(|number| !number.is_empty());
        let level = unit.is_empty() && digits.is_some_and(|number| number.bytes().all(|c| c.is_ascii_digit()));
        Channel { name, unit: if level { "logic".into() } else { unit } }
    }
}

/// Channels by their names, with units from elsewhere where the name has none: `V`, `CH1:V`, `(mV)`.
fn channels(names: &[String], units: &[String]) -> Vec<Channel> {
    let mut channels: Vec<Channel> = names.iter().map(|name| Channel::of(name)).collect();
    for (channel, text) in channels.iter_mut().zip(units).filter(|(channel, _)| channel.unit.is_empty()) {
        channel.unit = text.rsplit(':').next().unwrap_or(text).trim().into();
    }
    channels
}

impl Layout {
    fn new(time: Time, skip: usize, channels: Vec<Channel>) -> Layout {
        let cells = skip + usize::from(matches!(time, Time::Given(_))) + channels.len();
        Layout { time, cells, skip, own: false, promised: None, channels }
    }

    /// Columns of gap voltage, current and gate.
    ///
    /// # Errors
    /// When there is no such channel, or its unit is none that it may have.
    pub fn chosen(&self, channels: &Channels) -> Result<(Column, Option<Column>, Option<Column>), String> {
        use Quantity::{Current, Level, Voltage};
        let gap_v = self.column(&channels.gap_v, "gap_v", &[Voltage])?;
        let gap_i = self.column(&channels.gap_i, "gap_i", &[Current, Voltage])?;
        let gate = self.column(&channels.gate, "gate", &[Voltage, Level])?;
        Ok((gap_v.map_or_else(|| self.at(0, "gap_v", &[Voltage]), Ok)?, gap_i, gate))
    }

    fn column(&self, wanted: &Option<String>, own: &str, of: &[Quantity]) -> Result<Option<Column>, String> {
        let name = wanted.as_deref().or(self.own.then_some(own));
        let found = name.and_then(|name| self.channels.iter().position(|other| other.name.eq_ignore_ascii_case(name)));
        match (found, wanted) {
            (None, Some(name)) => {
                let names: Vec<&str> = self.channels.iter().map(|channel| channel.name.as_str()).collect();
                let option = own.replace('_', "-");
                Err(format!("--{option} {name}: no such channel; there are {}", names.join(", ")))
            }
            (found, _) => found.map(|place| self.at(place, own, of)).transpose(),
        }
    }

    fn at(&self, place: usize, own: &str, of: &[Quantity]) -> Result<Column, String> {
        let first = self.skip + usize::from(matches!(self.time, Time::Given(_)));
        let Channel { name, unit: text } = &self.channels[place];
        let known = if text.is_empty() { Some((of[0], 1.0)) } else { unit(text) };
        match known.filter(|(quantity, _)| of.contains(quantity)) {
            Some((quantity, scale)) => {
                Ok(Column { cell: first + place, scale, logic: self.own || quantity == Quantity::Level })
            }
            None => {
                let allowed = match own {
                    "gap_i" => "A, or V of a shunt, with or without a prefix such as m",
                    "gate" => "V, with or without a prefix such as m, or levels",
                    _ => "V, with or without a prefix such as m",
                };
                Err(format!("{own}: {name} is in {text:?}: must be in {allowed}"))
            }
        }
    }
}

/// What the lines above the header have said.
#[derive(Default)]
struct Above {
    source: Vec<String>,
    units: Vec<String>,
    time: Option<f64>,
    promised: Option<(u64, u64)>,
    /// Samples a second, of sigrok.
    rate: Option<f64>,
    /// Time of a sample, s, and the channel, where a Hantek says them.
    clock: Option<f64>,
    channel: Option<String>,
    /// What follows are times and voltages, without any header.
    bare: bool,
}

impl Above {
    /// Takes what a line says; whether it was one of these.
    fn take(&mut self, line: u64, first: &str, others: &[String]) -> Result<bool, String> {
        let lower = first.to_ascii_lowercase();
        let reported = |what: &str| lower.strip_prefix(what).map(|_| first[what.len()..].trim().to_owned());
        let number = |text: &str| text.parse().ok().filter(|x: &f64| x.is_finite() && *x > 0.0);
        let promise = |text: &str| {
            let count: Option<f64> = text.rsplit(':').next().and_then(|text| text.trim().parse().ok());
            count.filter(|count| (1.0..1e12).contains(count)).map(|count| (line, count as u64))
        };
        if lower == "source" {
            self.source = others.to_vec();
        } else if lower == "vertical units" {
            self.units = others.to_vec();
        } else if lower == "horizontal units" {
            self.time = others.first().and_then(|text| time_unit(text));
        } else if lower == "record length" {
            self.promised = others.first().and_then(|text| promise(text));
        } else if let Some(text) = reported("#size=") {
            self.promised = promise(&text);
        } else if let Some(text) = reported("#clock=") {
            let seconds = number(text.trim_end_matches(['s', 'S']));
            self.clock = Some(seconds.ok_or_else(|| format!("line {line}: {first:.40}: must be a time in s"))?);
        } else if let Some(text) = reported("#channel:") {
            self.channel = Some(text);
        } else if let Some(text) = reported("#units:") {
            self.units = vec![text];
        } else if lower.starts_with("#timebase=") {
            self.bare = true;
        } else if lower.starts_with("; channels (") {
            let begin = first.split_once(": ").map(|(_, name)| name.to_owned());
            self.source = begin.into_iter().chain(others.iter().cloned()).collect();
        } else if let Some(text) = reported("; samplerate:") {
            let (digits, hertz) = text.split_once(' ').unwrap_or((&text, ""));
            let scale = [("Hz", 1.0), ("kHz", 1e3), ("MHz", 1e6), ("GHz", 1e9)].iter().find(|(unit, _)| *unit == hertz);
            self.rate = number(digits).zip(scale).map(|(digits, (_, scale))| digits * scale);
        } else {
            // Others say nothing that is needed.
            let comma = first.is_empty() && others.iter().any(|other| other.starts_with('#'));
            return Ok(comma || first.starts_with([';', '#']));
        }
        Ok(true)
    }

    /// Names of channels: as given, or by their numbers.
    fn names(&self, count: usize) -> Vec<String> {
        if self.source.len() == count { self.source.clone() } else { (1..=count).map(|n| format!("CH{n}")).collect() }
    }

    /// sigrok counts in the power of 1000 that its rate is no more than.
    fn sigrok_step(&self) -> Option<f64> {
        let rate = self.rate?;
        (0..5).map(|power| 1e3f64.powi(power)).find(|counts| *counts >= rate).map(f64::recip)
    }
}

/// Reads the header; gives what it says, and the line after it where that had to be read.
///
/// # Errors
/// When there is none that is known.
pub fn layout(lines: &mut impl Iterator<Item = Result<Row, String>>) -> Result<(Layout, Option<Row>), String> {
    let mut above = Above::default();
    let mut newest = 0;
    while newest < LINES
        && let Some(row) = lines.next()
    {
        let (line, cells) = row?;
        newest = line;
        if let Some((layout, below)) = header(line, &cells, &mut above, lines)? {
            return Ok((Layout { promised: above.promised, ..layout }, below));
        }
    }
    match newest {
        0 => Err("is empty".into()),
        _ => Err(format!(
            "line 1: no known header in the first {LINES} lines: must be t_s,gap_v[,gap_i][,gate], or what an oscilloscope of Rigol, \
             Siglent, Tektronix, Rohde & Schwarz (RTB), Hantek or Pico, or sigrok or Saleae, exports"
        )),
    }
}

/// What a line says as the end of a header, if it is one; the others go into `above`.
fn header(
    line: u64,
    cells: &[String],
    above: &mut Above,
    lines: &mut impl Iterator<Item = Result<Row, String>>,
) -> Result<Option<(Layout, Option<Row>)>, String> {
    let Some((first, others)) = cells.split_first() else { return Ok(None) };
    let numbers = || cells.iter().all(|cell| cell.parse::<f64>().is_ok());
    let this = || Some((line, cells.to_vec()));
    let lower = first.to_ascii_lowercase();
    match (lower.as_str(), others) {
        ("t_s", names) => {
            let known: [&[&str]; 4] =
                [&["gap_v"], &["gap_v", "gap_i"], &["gap_v", "gate"], &["gap_v", "gap_i", "gate"]];
            if !known.iter().any(|known| known == &names) {
                return Err(format!("line {line}: {:.200}: must be t_s,gap_v[,gap_i][,gate]", cells.join(",")));
            }
            let columns = names.iter().map(|name| Channel { name: name.clone(), unit: String::new() }).collect();
            return Ok(Some((Layout { own: true, ..Layout::new(Time::Given(1.0), 0, columns) }, None)));
        }
        ("x", [names @ .., start, increment])
            if start.eq_ignore_ascii_case("start") && increment.eq_ignore_ascii_case("increment") =>
        {
            let below = lines.next().transpose()?.unwrap_or_default();
            let [_, units @ .., start, step] = below.1.as_slice() else {
                return Err(format!("line {}: must have start and increment at its end", line + 1));
            };
            return Ok(Some((counted(channels(names, units), 1, [start, step], below.0)?, None)));
        }
        ("record length", [count, _, time, value]) if time.parse::<f64>().is_ok() && value.parse::<f64>().is_ok() => {
            above.take(line, first, std::slice::from_ref(count))?;
            return Ok(Some((Layout::new(Time::Given(1.0), 3, channels(&["CH1".into()], &[])), this())));
        }
        (_, [.., start, step]) if start.starts_with("t0") && step.starts_with("tInc") => {
            return Ok(Some((counted(channels(&cells[..cells.len() - 2], &[]), 0, [start, step], line)?, None)));
        }
        _ => {}
    }
    // Those of a Hantek are followed by numbers at once.
    if let Some(step) = above.clock.filter(|_| numbers()) {
        let name = above.channel.clone().unwrap_or_else(|| "CH1".into());
        return Ok(Some((Layout::new(Time::Counted(0.0, step), 0, channels(&[name], &above.units)), this())));
    }
    if above.bare && numbers() && !others.is_empty() {
        return Ok(Some((Layout::new(Time::Given(1.0), 0, channels(&above.names(others.len()), &[])), this())));
    }
    if above.take(line, first, others)? {
        return Ok(None);
    }
    let (name, text) = label(first);
    let named = name.eq_ignore_ascii_case("time");
    let written =
        if text.is_empty() { time_unit(first) } else { time_unit(&text).filter(|_| named || name.is_empty()) };
    if others.is_empty() || !(named || written.is_some()) {
        // sigrok, told to leave the time out.
        let Some(rate) = above.rate else { return Ok(None) };
        let only_units = cells.iter().all(|cell| unit(cell).is_some());
        let columns = if only_units { channels(&above.names(cells.len()), cells) } else { channels(cells, &[]) };
        return Ok(Some((Layout::new(Time::Counted(0.0, rate.recip()), 0, columns), None)));
    }
    if named && !text.is_empty() && written.is_none() {
        return Err(format!("line {line}: {first:.40}: must be in s, with or without a prefix such as m"));
    }
    // A row of units may replace the names, or follow them.
    let only_units = !named
        && text.is_empty()
        && others.iter().all(|cell| unit(cell).is_some() || cell.eq_ignore_ascii_case("value"));
    if only_units {
        let names = above.names(others.len());
        let own: Vec<String> = others.iter().filter(|cell| !cell.eq_ignore_ascii_case("value")).cloned().collect();
        let units = if above.units.is_empty() || own.len() == others.len() { own } else { above.units.clone() };
        return Ok(Some((Layout::new(Time::Given(written.unwrap_or(1.0)), 0, channels(&names, &units)), None)));
    }
    let below = lines.next().transpose()?;
    let units = below.as_ref().filter(|(_, cells)| cells.first().is_some_and(|cell| time_unit(cell).is_some()));
    let (scale, columns) = match units.and_then(|(_, cells)| cells.split_first()) {
        Some((time, units)) => (time_unit(time), channels(others, units)),
        None => (written.or(above.sigrok_step()).or(above.time), channels(others, &above.units)),
    };
    let below = if units.is_some() { None } else { below };
    Ok(Some((Layout::new(Time::Given(scale.unwrap_or(1.0)), 0, columns), below)))
}

/// Samples that are counted: start and step are in cells, alone or as `t0 = -25s`.
fn counted(channels: Vec<Channel>, skip: usize, cells: [&String; 2], line: u64) -> Result<Layout, String> {
    let [start, step] = cells.map(|cell| {
        let number = cell.rsplit('=').next().unwrap_or(cell).trim().trim_end_matches('s');
        number
            .parse()
            .ok()
            .filter(|x: &f64| x.is_finite())
            .ok_or_else(|| format!("line {line}: {cell:?}: must be a time in s"))
    });
    if channels.is_empty() {
        return Err(format!("line {line}: no channel"));
    }
    Ok(Layout::new(Time::Counted(start?, step?), skip, channels))
}
