//! Bring-up: checks the steps of docs/bring-up.md that a host can see while the user does them; runs the guided check; makes a
//! dated report.
//!
//! Checks, limits and advice are those of that page ([`crate::guide`]), of the head's settings and of its dictionary. Nothing
//! moves and no setting changes before the guided check is requested. The head keeps of that check its
//! result and the friction; stroke and open-circuit voltage are what this program has observed of them meanwhile.
//!
//! The head watches this program, and ends the check by itself when that is gone.

use crate::Failure;
use crate::bus::SILENCE;
use crate::guide;
use crate::head::{Head, Identity, at, state};
use crate::live::{Live, Sample};
use crate::sdo::Address;
use crate::words;
use edm_servo_head::head::Contradiction;
use serde::Serialize;
use serde_json::{Value, json};
use std::fmt::Write;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// The step of the guided check.
pub const CHECK: u8 = 10;
/// Period of all checks.
const PERIOD: Duration = Duration::from_millis(100);
/// Period of the checks during a manual motion.
const GLANCE: Duration = Duration::from_millis(10);
/// Manual travel that shows the direction of the encoder, mm.
const BY_HAND_MM: f64 = 0.2;
/// Counts by which the place after that may differ: one may flicker.
const SAME: i64 = 1;
/// Time of the guided check in addition to its travel down and up, each at twice the expected time.
const CHECK_TIME: Duration = Duration::from_secs(30);
/// Contacts that are opened one by one; their bits in 60FDh.
const CONTACTS: [u8; 4] = [0, 1, 16, 17];
/// Inputs that must not be active; their bits in 60FDh.
const ALARMS: [u8; 2] = [18, 19];

/// Result of a check.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Not seen yet.
    NotSeen,
    /// As it should be.
    Passed,
    /// Not as it should be.
    Failed,
}

/// One check.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Check {
    /// Step of docs/bring-up.md.
    pub step: u8,
    /// What is checked.
    pub what: String,
    /// Value now, or when it was observed; none where there is none.
    pub value: Value,
    /// Its unit; empty for none.
    pub unit: &'static str,
    /// Allowed value.
    pub allowed: String,
    /// Result.
    pub verdict: Verdict,
    /// Advice until it has passed.
    pub advice: String,
}

/// A request to a bring-up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Request {
    /// Continue checking.
    Look = 0,
    /// The guided check, when all before it has passed.
    Check = 1,
    /// The guided check, when nothing before it has failed: the manual steps were observed before.
    CheckAgain = 2,
    /// The report.
    End = 3,
}

/// The newest request. Nothing replaces [`Request::End`].
#[derive(Debug, Default)]
pub struct Requests(AtomicU8);

impl Requests {
    /// Sets a request.
    pub fn want(&self, request: Request) {
        self.0.fetch_max(request as u8, Ordering::AcqRel);
    }

    /// The newest request.
    pub fn now(&self) -> Request {
        match self.0.load(Ordering::Acquire) {
            0 => Request::Look,
            1 => Request::Check,
            2 => Request::CheckAgain,
            _ => Request::End,
        }
    }

    /// A requested check is over.
    fn done(&self) {
        let _ = self.0.fetch_update(Ordering::AcqRel, Ordering::Acquire, |now| (now < Request::End as u8).then_some(0));
    }
}

/// How far it is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Progress {
    /// Present activity, or why a request was not carried out.
    pub doing: String,
    /// All checks.
    pub checks: Vec<Check>,
    /// What the head does.
    pub sample: Sample,
}

impl Progress {
    /// Everything before the guided check has passed.
    pub fn ready(&self) -> bool {
        ready(&self.checks)
    }
}

fn ready(checks: &[Check]) -> bool {
    checks.iter().all(|check| check.step >= CHECK || check.verdict == Verdict::Passed)
}

/// What was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// When, UTC.
    pub date: String,
    /// By which program.
    pub program: String,
    /// Connection to the bus.
    pub bus: String,
    /// Which head.
    pub identity: Identity,
    /// The head's program (2009h:2).
    pub build: String,
    /// All checks.
    pub checks: Vec<Check>,
    /// Steps, by number and title, that no host can see.
    pub not_looked_at: Vec<(u8, &'static str)>,
    /// Everything has passed.
    pub passed: bool,
}

impl Report {
    /// So many of a verdict.
    pub fn count(&self, verdict: Verdict) -> usize {
        self.checks.iter().filter(|check| check.verdict == verdict).count()
    }

    /// Result in one line.
    pub fn verdict(&self) -> String {
        let [passed, failed, open] =
            [Verdict::Passed, Verdict::Failed, Verdict::NotSeen].map(|verdict| self.count(verdict));
        format!("{passed} passed, {failed} failed, {open} not seen")
    }

    /// All but the guided check have passed.
    pub fn but_the_check(&self) -> bool {
        ready(&self.checks)
    }

    /// Name of its files.
    pub fn name(&self) -> String {
        let date: String = self.date.chars().filter(char::is_ascii_digit).collect();
        format!("bring-up-{}-{date}", self.identity.serial)
    }

    /// As Markdown.
    pub fn markdown(&self) -> String {
        let Report { date, program, bus, identity, build, .. } = self;
        let mut text = format!(
            "# Bring-up of {}, serial number {}\n\n{date}, node {} at {bus}. Hardware {}, software {}, build {build}. Checked by {program}.\n\n\
             **{}.** The steps are those of docs/bring-up.md.\n",
            identity.name,
            identity.serial,
            identity.node,
            identity.hardware,
            identity.software,
            self.verdict()
        );
        for (step, title) in guide::steps() {
            // A string takes everything; so it does below.
            let _ = write!(text, "\n## {step}. {title}\n\n");
            let mut rows = self.checks.iter().filter(|check| check.step == step).peekable();
            if rows.peek().is_none() {
                text += "Not checked: a host cannot see it. Done by, on:\n";
                continue;
            }
            text += "| check | value | allowed | result |\n| --- | --- | --- | --- |\n";
            for check in rows {
                let (what, allowed) = (&check.what, &check.allowed);
                let advice = if check.verdict == Verdict::Passed { "" } else { check.advice.as_str() };
                let verdict = check.verdict.word();
                let _ = writeln!(text, "| {what} | {} | {allowed} | {verdict} {advice} |", check.said());
            }
        }
        text
    }
}

impl Verdict {
    /// In a word.
    pub const fn word(self) -> &'static str {
        match self {
            Verdict::NotSeen => "not seen",
            Verdict::Passed => "passed",
            Verdict::Failed => "FAILED",
        }
    }
}

impl Check {
    /// Its value, with its unit.
    pub fn said(&self) -> String {
        match &self.value {
            Value::Null => "-".into(),
            Value::String(text) => text.clone(),
            value => format!("{value} {}", self.unit).trim_end().into(),
        }
    }
}

/// What the head's settings allow.
struct Limits {
    per_mm: f64,
    bus_min_v: f64,
    amps_per_code: f64,
    open_min_v: f64,
    stroke_mm: f64,
    tolerance_mm: f64,
    check_time: Duration,
}

/// What was observed of the guided check.
#[derive(Default)]
struct Checked {
    /// 2001h:4; nothing when it was broken off.
    result: Option<u8>,
    /// Why it was broken off.
    why: String,
    /// Valid gap voltages, as they were observed.
    gap_v: Vec<f64>,
    stroke_counts: i64,
    breakaway_n: Option<f64>,
    counterbalance_n: Option<f64>,
    /// What contradicts a setting.
    contradiction: Contradiction,
}

/// From, to, V.
struct Range(f64, f64);

impl Range {
    fn has(&self, volts: f64) -> bool {
        (self.0..=self.1).contains(&volts)
    }

    fn said(&self) -> String {
        format!("{} V to {} V, at least once", self.0, self.1)
    }
}

/// Gap voltage with the sense supply alone.
struct Sense {
    open: Range,
    joined: Range,
}

impl Sense {
    /// As docs/bring-up.md has it; a test sees that it does.
    fn of_the_page() -> Sense {
        let [least, most, zero] =
            ["sense.least", "sense.most", "gap.zero_volts"].map(|name| guide::number(name).unwrap_or(f64::NAN));
        Sense { open: Range(least, most), joined: Range(-zero, zero) }
    }
}

/// What was observed since the beginning.
#[derive(Default)]
struct Observed {
    /// Where the head was.
    start: i64,
    /// Counts that show a direction.
    by_hand: i64,
    lowest: i64,
    highest: i64,
    /// It was moved toward the work manually, and has returned.
    returned: bool,
    /// Contacts that have been open, by bits.
    opened: i64,
    inputs: i64,
    position: i64,
    quality: i64,
    /// Gap voltage now, where it means something.
    sense_v: Option<f64>,
    sense_open_v: Option<f64>,
    sense_joined_v: Option<f64>,
    checked: Option<Checked>,
}

/// Inputs of a bring-up.
pub struct BringUp<'a> {
    /// The head.
    pub head: &'a Head,
    /// What it does.
    pub live: &'a mut Live,
    /// Requests of the user.
    pub requests: &'a Requests,
    /// Called at each check: keeps the heartbeat alive. An error ends the bring-up.
    pub alive: &'a dyn Fn() -> Result<(), Failure>,
    /// Called with the progress.
    pub on_progress: &'a mut dyn FnMut(&Progress),
}

impl BringUp<'_> {
    /// Checks until the report is requested.
    ///
    /// # Errors
    /// What went wrong. A guided check has been ended then, or the error says that it may go on.
    pub fn execute(mut self) -> Result<Report, Failure> {
        let limits = Limits::of(self.head)?;
        let start = self.head.whole(at::INTERNAL_POSITION)?;
        let by_hand = (BY_HAND_MM * limits.per_mm) as i64;
        let mut observed = Observed { start, by_hand, lowest: start, highest: start, ..Observed::default() };
        // Both ways, as step 7 wants it.
        let armed = self.head.arm()?;
        self.live.expect_heartbeat();
        let ended = self.observe(&limits, &mut observed);
        armed.disarm();
        let checks = ended?;
        let looked_at = |step: u8| checks.iter().any(|check| check.step == step);
        Ok(Report {
            date: date(SystemTime::now()),
            program: format!("edm-desk {}", env!("CARGO_PKG_VERSION")),
            bus: self.head.bus.connection(),
            identity: self.head.identity.clone(),
            build: String::from_utf8_lossy(&self.head.sdo.read(at::BUILD)?).into_owned(),
            not_looked_at: guide::steps().filter(|(step, _)| !looked_at(*step)).collect(),
            passed: checks.iter().all(|check| check.verdict == Verdict::Passed),
            checks,
        })
    }

    fn observe(&mut self, limits: &Limits, observed: &mut Observed) -> Result<Vec<Check>, Failure> {
        let mut doing = String::from("watching");
        loop {
            (self.alive)()?;
            let checks = self.checks(limits, observed)?;
            let sample = self.live.sample()?;
            (self.on_progress)(&Progress { doing: doing.clone(), checks: checks.clone(), sample });
            let request = self.requests.now();
            match request {
                Request::Look => {}
                Request::End => return Ok(checks),
                Request::Check | Request::CheckAgain => {
                    let stands = |check: &&Check| match check.verdict {
                        Verdict::Passed => false,
                        Verdict::Failed => true,
                        Verdict::NotSeen => request == Request::Check,
                    };
                    let before = checks.iter().filter(|check| check.step < CHECK).find(stands);
                    doing = match before {
                        Some(Check { step, what, verdict, .. }) => {
                            format!("the guided check waits for step {step}, {what}: {}", verdict.word())
                        }
                        None => self.check(limits, observed)?,
                    };
                    self.requests.done();
                }
            }
            let next = Instant::now() + PERIOD;
            while Instant::now() < next {
                self.glance(observed)?;
                std::thread::sleep(GLANCE);
            }
        }
    }

    /// Observes a manual motion.
    fn glance(&self, observed: &mut Observed) -> Result<(), Failure> {
        let head = self.head;
        let disabled = head.whole(at::STATE)? as u8 == state::DISABLED;
        observed.inputs = head.whole(at::INPUTS)?;
        observed.position = head.whole(at::INTERNAL_POSITION)?;
        observed.quality = head.whole(at::GAP_QUALITY)?;
        let volts = head.number(at::GAP)?;
        observed.sense_v = (observed.quality == quality::VALID && disabled).then_some(volts);
        // What the guided check moves is not moved by hand.
        if !disabled || observed.checked.is_some() {
            return Ok(());
        }
        observed.opened |= observed.inputs;
        (observed.lowest, observed.highest) =
            (observed.lowest.min(observed.position), observed.highest.max(observed.position));
        let moved = observed.highest - observed.start >= observed.by_hand;
        observed.returned |= moved && (observed.position - observed.start).abs() <= SAME;
        let sense = Sense::of_the_page();
        if let Some(volts) = observed.sense_v {
            if sense.open.has(volts) {
                observed.sense_open_v.get_or_insert(volts);
            }
            if sense.joined.has(volts) {
                observed.sense_joined_v.get_or_insert(volts);
            }
        }
        Ok(())
    }

    /// Runs the guided check; gives its result.
    fn check(&mut self, limits: &Limits, observed: &mut Observed) -> Result<String, Failure> {
        let (alive, requests) = (self.alive, self.requests);
        let mut tick = || {
            alive()?;
            if requests.now() == Request::End { Err(Failure::Failed("ended on request".into())) } else { Ok(()) }
        };
        let mut checked = Checked::default();
        let began = Instant::now();
        let ended = self.head.begin_check(&mut tick).and_then(|()| {
            let place = self.head.whole(at::INTERNAL_POSITION)?;
            let (mut lowest, mut highest, mut reported) = (place, place, Instant::now());
            // Not read anew meanwhile: pulses are on for 0.3 s, and the voltage in that time is what this program is to see.
            let checks = self.checks(limits, observed)?;
            loop {
                tick()?;
                self.head.healthy()?;
                let place = self.head.whole(at::INTERNAL_POSITION)?;
                (lowest, highest) = (lowest.min(place), highest.max(place));
                checked.stroke_counts = highest - lowest;
                if self.head.whole(at::GAP_QUALITY)? == quality::VALID {
                    checked.gap_v.push(self.head.number(at::GAP)?);
                }
                if !matches!(self.head.whole(at::STATE)? as u8, state::COMMISSIONING | state::PROVING) {
                    // By itself, or by a fault.
                    return self.head.healthy();
                }
                if began.elapsed() > limits.check_time {
                    let s = limits.check_time.as_secs();
                    return Err(Failure::Failed(format!("not finished within {s} s")));
                }
                if reported.elapsed() > PERIOD {
                    reported = Instant::now();
                    let sample = self.live.sample()?;
                    let mm = (place - lowest) as f64 / limits.per_mm;
                    let doing = format!("guided check: {mm:.3} mm below the upper stop");
                    (self.on_progress)(&Progress { doing, checks: checks.clone(), sample });
                }
            }
        });
        let mut gone = None;
        if let Err(why) = &ended {
            let now = self.head.stop()?;
            self.live.expect_no_heartbeat();
            checked.why = format!("{why}; {now}");
            // Whoever asked for it does not hear of it any more.
            gone = alive().err();
        } else if self.head.whole(at::REASON)? == reason::CHECK_ENDED {
            checked.result = Some(self.head.whole(at::CHECK_RESULT)? as u8);
            checked.breakaway_n = Some(self.head.setting("axis.breakaway_n")?);
            checked.counterbalance_n = Some(self.head.setting("axis.counterbalance_n")?);
            let [measured, least, most] = at::MEASURED.map(|address| self.head.whole(address));
            checked.contradiction =
                Contradiction { measured: measured? as i32, least: least? as i32, most: most? as i32 };
        } else {
            checked.why = format!("aborted: {}", words::reason(self.head.whole(at::REASON)? as u8));
        }
        let said = checked.said();
        observed.checked = Some(checked);
        gone.map_or(Ok(format!("guided check: {said}")), Err)
    }

    /// Makes all checks once.
    fn checks(&self, limits: &Limits, observed: &mut Observed) -> Result<Vec<Check>, Failure> {
        self.glance(observed)?;
        let head = self.head;
        let disabled = head.whole(at::STATE)? as u8 == state::DISABLED;
        let mut checks = Vec::new();
        let mut add = |step, what: &str, (value, unit), allowed: String, verdict, advice: String| {
            checks.push(Check { step, what: what.into(), value, unit, allowed, verdict, advice });
        };
        let text = |text: String| (Value::from(text), "");
        let is = |so| if so { Verdict::Passed } else { Verdict::Failed };
        let until = |so| if so { Verdict::Passed } else { Verdict::NotSeen };
        let named = |address: Address, number: i64| {
            let names = head.sheet.get(address).map(|object| object.names()).unwrap_or_default();
            names.get(&number).cloned().unwrap_or_else(|| number.to_string())
        };

        let bits = head.whole(at::SELF_TEST)?;
        let advice = guide::if_not(4, "`SelfTest(..)`");
        add(4, "self-test at the start", (json!(bits), ""), "0".into(), is(bits == 0), advice);
        let end = head.whole(at::LAST_END)?;
        let advice = guide::if_not(4, "starts again and again");
        add(4, "end of the previous run", text(named(at::LAST_END, end)), named(at::LAST_END, 0), is(end == 0), advice);
        let stored = head.whole(at::STORED)?;
        let advice = guide::if_not(4, "`settings: LoadReport");
        let allowed = format!("{}, or {}", named(at::STORED, 0), named(at::STORED, 1));
        add(4, "stored settings", text(named(at::STORED, stored)), allowed, is(stored <= 1), advice);
        let fault = head.whole(at::FAULT)? as u8;
        let advice = words::fault(fault).map_or("", words::remedy).into();
        add(4, "fault", text(words::fault_line(fault)), words::fault_line(0), is(fault == 0), advice);

        let inputs = observed.inputs;
        for bit in CONTACTS {
            let open = inputs >> bit & 1 == 1;
            let done = observed.opened >> bit & 1 == 1 && !open;
            let advice =
                if done { String::new() } else { "open the contact, or pull its cable, and close it again".into() };
            let said = if open {
                "open"
            } else if done {
                "closed again"
            } else {
                "closed, not opened yet"
            };
            let allowed = "open, and closed again".into();
            add(
                5,
                &format!("{} contact", named(at::INPUTS, bit.into())),
                text(said.into()),
                allowed,
                until(done),
                advice,
            );
        }
        for bit in ALARMS {
            let there = inputs >> bit & 1 == 1;
            let said = if there { "active" } else { "not active" };
            let advice = guide::if_not(9, "processor back: no bridge fault");
            let advice = if bit == 18 { advice } else { words::remedy(edm_servo_head::head::Fault::SupplyLow).into() };
            add(5, &named(at::INPUTS, bit.into()), text(said.into()), "not active".into(), is(!there), advice);
        }

        let position = observed.position;
        let (grew, fell) = (
            observed.highest - observed.start >= observed.by_hand,
            observed.start - observed.lowest >= observed.by_hand,
        );
        let verdict = if fell { Verdict::Failed } else { until(grew) };
        let travel = if fell { observed.lowest - observed.start } else { observed.highest - observed.start };
        let advice = if fell { guide::if_not(6, "the position in the log") } else { by_hand() };
        let value = (rounded(travel as f64 / limits.per_mm), "mm");
        add(6, "position, moved manually", value, format!("grows by {BY_HAND_MM} mm or more"), verdict, advice);
        let back = position - observed.start;
        let advice = if grew { guide::if_not(6, "`0 illegal`") } else { by_hand() };
        let allowed = format!("0 +- {SAME} counts after that");
        add(6, "and back at the upper stop", (json!(back), "counts"), allowed, until(observed.returned), advice);
        let illegal = head.whole(at::ILLEGAL)?;
        let advice = guide::if_not(6, "`0 illegal`");
        add(6, "illegal transitions", (json!(illegal), ""), "0".into(), is(illegal == 0), advice);

        let beat = self.live.heartbeat_age();
        let value = (beat.map_or(Value::Null, |age| json!(age.as_millis() as u64)), "ms ago");
        let (most, advice) = (SILENCE.as_millis(), guide::if_not(7, "nothing for a minute"));
        let heard = beat.is_some_and(|age| age < SILENCE);
        add(7, "heartbeat", value, format!("less than {most} ms ago"), until(heard), advice.clone());
        let lost = head.whole(at::FRAMES_LOST)?;
        add(7, "frames lost by the head", (json!(lost), ""), "0".into(), is(lost == 0), advice);

        let (quality, sense) = (observed.quality, Sense::of_the_page());
        let now = observed.sense_v.map_or(Value::Null, rounded);
        for (what, found, allowed, sees) in [
            ("gap, nothing near the electrode", observed.sense_open_v, sense.open.said(), "nothing near the electrode"),
            (
                "gap, a wire from the electrode to the work",
                observed.sense_joined_v,
                sense.joined.said(),
                "100 ohm from electrode",
            ),
        ] {
            let advice = match quality {
                quality::REVERSED => guide::if_not(8, "30 V reversed"),
                quality::VALID => guide::if_not(8, sees),
                _ => format!(
                    "{}: set gap.average = plain for this step; without pulses no other average shows the voltage",
                    named(at::GAP_QUALITY, quality)
                ),
            };
            let verdict =
                if quality == quality::REVERSED && disabled { Verdict::Failed } else { until(found.is_some()) };
            add(8, what, (found.map_or(now.clone(), rounded), "V"), allowed, verdict, advice);
        }

        let bus = head.number(at::BUS_VOLTAGE)? / 1000.0;
        let allowed = format!("{} V or more (motor.bus_min_v)", limits.bus_min_v);
        let advice = guide::if_not(9, "bus voltage reads");
        add(9, "bus voltage", (rounded(bus), "V"), allowed, is(bus >= limits.bus_min_v), advice.clone());
        if disabled {
            let current = head.number(at::MOTOR_CURRENT)?;
            let codes = guide::behind(9, "bus voltage reads", "+- ").unwrap_or_default();
            let most = 1000.0 * codes * limits.amps_per_code;
            let allowed = format!("0 +- {most:.0} mA ({codes} codes), while disabled");
            add(9, "motor current", (rounded(current), "mA"), allowed, is(current.abs() <= most), advice);
        }

        match &observed.checked {
            Some(checked) => checks.extend(checked.checks(limits)),
            None => checks.extend(Checked::default().checks(limits)),
        }
        Ok(checks)
    }
}

/// Quality of the gap voltage, 2005h:3.
mod quality {
    pub const VALID: i64 = 1;
    pub const REVERSED: i64 = 4;
}

/// How the guided check ended, 2001h:4.
mod result {
    pub const PASSED: u8 = 1;
    pub const STROKE: u8 = 9;
}

/// Why the state changed, 2000h:3.
mod reason {
    pub const CHECK_ENDED: i64 = 6;
}

impl Limits {
    fn of(head: &Head) -> Result<Limits, Failure> {
        let value = |key| head.setting(key);
        let stroke_mm = value("axis.stroke_um")? / 1000.0;
        let travel = Duration::from_secs_f64(4.0 * stroke_mm / value("commission.velocity_mm_s")?.max(0.1));
        Ok(Limits {
            per_mm: head.counts_per_mm()?,
            bus_min_v: value("motor.bus_min_v")?,
            amps_per_code: value("motor.amps_per_code")?,
            open_min_v: value("gap.open_min_v")?,
            stroke_mm,
            tolerance_mm: stroke_mm * value("commission.stroke_tolerance_percent")? / 100.0,
            check_time: CHECK_TIME + travel,
        })
    }
}

impl Checked {
    /// Open-circuit voltage: the median of what was observed while pulses came, which they do for a moment alone. Without them a
    /// plain average has the sense supply in it, far below; the first values of the filters may be above.
    fn open_v(&self) -> Option<f64> {
        let highest = self.gap_v.iter().copied().fold(0.0, f64::max);
        let mut values: Vec<f64> = self.gap_v.iter().copied().filter(|volts| *volts > highest / 2.0).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied()
    }

    fn said(&self) -> String {
        match self.result {
            Some(result::PASSED) => "passed".into(),
            Some(number) => words::finding(number).into(),
            None if self.why.is_empty() => "not run".into(),
            None => self.why.clone(),
        }
    }

    /// The result, and what was measured.
    fn checks(&self, limits: &Limits) -> [Check; 5] {
        let Limits { open_min_v, stroke_mm, tolerance_mm, .. } = limits;
        let verdict = match self.result {
            Some(result::PASSED) => Verdict::Passed,
            None if self.why.is_empty() => Verdict::NotSeen,
            _ => Verdict::Failed,
        };
        let within = |value: Option<f64>, so: fn(f64, &Limits) -> bool| match value {
            Some(value) if so(value, limits) => Verdict::Passed,
            Some(_) => Verdict::Failed,
            None => Verdict::NotSeen,
        };
        // The head has seen an open circuit where its check has passed: this program came too late for it.
        let late = |volts: &f64| self.result == Some(result::PASSED) && *volts < *open_min_v;
        let open_v = self.open_v().filter(|volts| !late(volts));
        // Measured to its end, or by a check that has found it wrong.
        let whole = matches!(self.result, Some(result::PASSED | result::STROKE));
        let stroke = whole.then(|| self.stroke_counts as f64 / limits.per_mm);
        let row = |what: &str, value: Option<f64>, unit, allowed, verdict, advice: &str| Check {
            step: CHECK,
            what: what.into(),
            value: value.map_or(Value::Null, rounded),
            unit,
            allowed,
            verdict,
            advice: advice.into(),
        };
        let advice = match self.result {
            Some(result::PASSED) => String::new(),
            Some(number) => words::finding_advice(number, self.stroke_counts, self.contradiction),
            None => "let the head rest at its upper stop with no workpiece below, then start the check".into(),
        };
        let result =
            Check { value: self.said().into(), ..row("guided check", None, "", "passed".into(), verdict, &advice) };
        let stroke_allowed = format!("{stroke_mm} mm +- {} mm (axis.stroke_um)", rounded(*tolerance_mm));
        let measured = if verdict == Verdict::Failed { Verdict::NotSeen } else { verdict };
        [
            result,
            row(
                "breakaway force",
                self.breakaway_n.filter(|_| verdict == Verdict::Passed),
                "N",
                "measured, stored in axis.breakaway_n".into(),
                measured,
                "",
            ),
            row(
                "counterbalance",
                self.counterbalance_n.filter(|_| verdict == Verdict::Passed),
                "N",
                "measured, stored in axis.counterbalance_n".into(),
                measured,
                "",
            ),
            row(
                "open-circuit voltage, read by this program",
                open_v,
                "V",
                format!("{open_min_v} V or more (gap.open_min_v)"),
                within(open_v, |value, limits| value >= limits.open_min_v),
                if verdict == Verdict::Passed && open_v.is_none() {
                    "this program was too slow to see it: repeat the check"
                } else {
                    ""
                },
            ),
            row(
                "stroke, read by this program",
                stroke,
                "mm",
                stroke_allowed,
                within(stroke, |value, limits| (value - limits.stroke_mm).abs() <= limits.tolerance_mm),
                "",
            ),
        ]
    }
}

fn by_hand() -> String {
    "move the head manually from its upper stop toward the work, and let it return".into()
}

/// To the thousandth.
fn rounded(value: f64) -> Value {
    json!((1000.0 * value).round() / 1000.0)
}

/// A time as UTC (proleptic Gregorian calendar; the algorithm is `civil_from_days` of Howard Hinnant, "chrono-Compatible
/// Low-Level Date Algorithms").
pub(crate) fn date(time: SystemTime) -> String {
    let seconds = time.duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
    let (days, second) = (seconds / 86_400 + 719_468, seconds % 86_400);
    let (era, day) = (days / 146_097, days % 146_097);
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day + 2) / 153;
    let day = day - (153 * month + 2) / 5 + 1;
    let month = if month < 10 { month + 3 } else { month - 9 };
    let year = 400 * era + year + u64::from(month <= 2);
    let (hour, minute, second) = (second / 3600, second / 60 % 60, second % 60);
    format!("{year:04}-{month:02}-{day:02} {hour:02}:{minute:02}:{second:02} UTC")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sheet::Sheet;

    #[test]
    fn dates_are_those_of_the_calendar() {
        for (seconds, text) in [
            (0, "1970-01-01 00:00:00 UTC"),
            (951_782_399, "2000-02-28 23:59:59 UTC"),
            (951_782_400, "2000-02-29 00:00:00 UTC"),
            (1_795_453_945, "2026-11-23 17:12:25 UTC"),
            (4_107_542_400, "2100-03-01 00:00:00 UTC"),
        ] {
            assert_eq!(date(UNIX_EPOCH + Duration::from_secs(seconds)), text);
        }
    }

    #[test]
    fn the_numbers_that_are_used_mean_what_the_head_means() {
        assert_eq!(words::reason(reason::CHECK_ENDED as u8), "commissioning ended");
        assert!(words::finding(result::STROKE).starts_with("stroke differs"));
        let names = Sheet::own().unwrap().get(at::GAP_QUALITY).unwrap().names();
        assert_eq!((names[&quality::VALID].as_str(), names[&quality::REVERSED].as_str()), ("valid", "reversed"));
    }

    #[test]
    fn every_advice_and_limit_that_is_taken_from_the_page_is_there() {
        for (step, begins) in [
            (4, "starts again and again"),
            (4, "`settings: LoadReport"),
            (4, "`SelfTest(..)`"),
            (6, "the position in the log"),
            (6, "`0 illegal`"),
            (7, "nothing for a minute"),
            (8, "30 V reversed"),
            (8, "nothing near the electrode"),
            (8, "100 ohm from electrode"),
            (9, "processor back: no bridge fault"),
            (9, "bus voltage reads"),
        ] {
            assert!(!guide::if_not(step, begins).is_empty(), "{step} {begins}");
        }
        assert!(["sense.least", "sense.most", "gap.zero_volts"].iter().all(|name| guide::number(name).is_some()));
        assert_eq!(guide::behind(9, "bus voltage reads", "+- "), Some(10.0));
    }
}
