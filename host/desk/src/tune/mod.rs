//! Tuning of a head (201Bh): the head measures the response of its loop; this calculates margins, proposes gains, writes those that a person
//! accepts, measures again, and shows a step before and after.
//!
//! The head needs a home and room above, as for an identification. Gains may change while the loop is closed. Nothing is saved.

pub mod response;

use crate::Failure;
use crate::fast::{self, Trigger};
use crate::head::{Head, MOVES, at};
use crate::live::{Live, Sample};
use crate::scope::Record;
use crate::sdo::Address;
use crate::settings;
use response::{Axis, Bode, Gains, Margins, Point, Response};
use serde::{Deserialize, Serialize};
use std::fmt::Write;
use std::time::{Duration, Instant};

/// Setting with the length that a tuning needs above the head.
pub const TRAVEL: &str = "tune.travel_um";

const TUNE: Address = Address(0x201B, 1);
const STEP: Address = Address(0x201B, 2);
const WHY: Address = Address(0x201B, 3);
const POINTS: Address = Address(0x201B, 4);
const DATA: Address = Address(0x201B, 5);
/// Steps 4 and 5 are the end, with every point and without.
const FINISHED: i64 = 4;
const ENDED: i64 = 5;
/// Longest measurement, and the time in which it begins.
const LONGEST: Duration = Duration::from_secs(300);
const BEGINS: Duration = Duration::from_secs(3);
/// Time between two looks.
const PERIOD: Duration = Duration::from_millis(50);

/// The step: height upward, um. The set point goes there by the profile of the head (6081h, 6083h, 6084h). A step of the set point itself, or a
/// faster profile, pushes a head that hardly moves with more than its friction holds, which means a dead encoder to its supervision.
const STEP_UM: f64 = 200.0;
/// Distance from its target within which a step has settled, um; counts at least.
const SETTLED_UM: f64 = 5.0;
const SETTLED_COUNTS: f64 = 2.0;
/// What else may show as a fault or as no response.
const UNHELD: &str = "a loop that its gains do not hold shows so too: begin with the defaults of servo.*";
/// Time between two samples of it, ms.
const SAMPLE_MS: f64 = 0.1;
/// What is recorded of it.
const SIGNALS: [&str; 4] = ["set_point", "position", "velocity", "duty"];

/// What is asked of a loop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Accept {
    /// Nothing is written.
    #[default]
    Nothing,
    /// The proposal.
    Proposal,
    /// The gains of Ziegler and Nichols.
    ZieglerNichols,
}

/// Gains with the margins that they have, or would have by the measured response.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Candidate {
    /// Gains.
    pub gains: Gains,
    /// Margins; nothing where the loop crosses over nowhere.
    pub margins: Option<Margins>,
    /// The loop that is to be expected.
    pub bode: Bode,
}

impl Candidate {
    fn of(response: &Response, gains: Gains) -> Candidate {
        Candidate { gains, margins: response.with(&gains), bode: response.bode(&gains) }
    }
}

/// A step of the set point.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Stepped {
    /// What the fast scope has recorded.
    pub record: Record,
    /// Largest distance of the head from its set point on the way, um.
    pub peak_um: f64,
    /// Overshoot over the target, um.
    pub overshoot_um: f64,
    /// Time from the set point's arrival until the head stays within 5 um, or two counts, ms; nothing where it does not.
    pub settled_ms: Option<f64>,
}

/// How it stands.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Progress {
    /// What is done, in words.
    pub doing: String,
    /// Points measured, if there are new ones.
    pub points: Option<Vec<Point>>,
    /// What the head does.
    pub sample: Sample,
}

/// What has come of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Outcome {
    /// Node-ID.
    pub node: u8,
    /// The loop as it was.
    pub before: Response,
    /// Highest bandwidth that was asked for, Hz.
    pub wanted_hz: Option<f64>,
    /// A proposal; nothing where no gains keep the margins.
    pub proposal: Option<Candidate>,
    /// Gains by the rules of Ziegler and Nichols, beside it.
    pub ziegler_nichols: Candidate,
    /// A step as it was.
    pub step_before: Stepped,
    /// The loop, measured again with gains that were accepted, and its step.
    pub after: Option<Response>,
    /// See [`after`](Outcome::after).
    pub step_after: Option<Stepped>,
}

impl Outcome {
    /// In words.
    pub fn text(&self) -> String {
        let mut text = String::from(
            "                 velocity_hz position_hz integral_ms  bandwidth  phase margin       gain margin         peak\n",
        );
        let mut line = |name: &str, gains: &Gains, margins: &Option<Margins>| {
            let Gains { velocity_hz, position_hz, integral_ms } = gains;
            // A string takes everything; so it does below.
            let _ = write!(text, "{name:16} {velocity_hz:11.0} {position_hz:11.0} {integral_ms:11.1}");
            let _ = match margins {
                Some(of) => writeln!(
                    text,
                    "  {:6.0} Hz  {:5.1} +- {:3.1} deg  {:5.1} +- {:3.1} dB  {:5.1}{}",
                    of.crossover_hz,
                    of.phase_deg,
                    of.phase_off_deg,
                    of.gain_db,
                    of.gain_off_db,
                    of.peak,
                    if of.holds() { "" } else { "  below 45 deg or 6 dB" }
                ),
                None => writeln!(text, "  crosses over nowhere"),
            };
        };
        line("as it was", &self.before.gains, &self.before.margins);
        if let Some(proposal) = &self.proposal {
            line("proposal", &proposal.gains, &proposal.margins);
        }
        line("Ziegler-Nichols", &self.ziegler_nichols.gains, &self.ziegler_nichols.margins);
        if let Some(after) = &self.after {
            line("measured again", &after.gains, &after.margins);
        }
        let plant = &self.before.plant;
        let _ = writeln!(
            text,
            "motor: {:.1} m/s2 at full duty, by the settings {:.1}; winding {:.2} ms, delays {:.2} ms",
            plant.acceleration,
            self.before.axis.acceleration,
            plant.lag_s * 1e3,
            plant.delay_s * 1e3
        );
        for (name, step) in [("before", Some(&self.step_before)), ("after", self.step_after.as_ref())] {
            let Some(step) = step else { continue };
            let settled = step.settled_ms.map_or("does not settle".into(), |ms| format!("settled after {ms:.1} ms"));
            let Stepped { peak_um, overshoot_um, .. } = step;
            let _ = writeln!(
                text,
                "step of {STEP_UM} um {name}: at most {peak_um:.1} um from the set point, overshoot {overshoot_um:.1} um, {settled}"
            );
        }
        if self.proposal.is_none() {
            let wanted = self.wanted_hz.map_or(String::new(), |hz| format!(" with at most {hz} Hz of bandwidth"));
            let _ = writeln!(
                text,
                "no proposal: no gains of the form of the defaults keep 45 degrees and 6 dB up to {:.0} Hz, the highest frequency measured{wanted}. \
                 Raise tune.highest_hz, identify the head, look at its mechanics",
                self.before.highest_hz()
            );
        }
        text
    }
}

/// Inputs of a run.
pub struct Tune<'a> {
    /// The head.
    pub head: &'a Head,
    /// What it does.
    pub live: &'a mut Live,
    /// Where it tunes, mm below home; where it is without.
    pub at_mm: Option<f64>,
    /// Highest bandwidth that is wanted, Hz.
    pub wanted_hz: Option<f64>,
    /// What is written then.
    pub accept: Accept,
    /// What an earlier run has measured: with the same gains it is not measured again.
    pub known: Option<(Response, Stepped)>,
    /// Called in every wait. An error ends the run.
    pub alive: &'a dyn Fn() -> Result<(), Failure>,
    /// Called with the progress.
    pub on_progress: &'a mut dyn FnMut(&Progress),
}

impl Tune<'_> {
    /// Measures, writes what is accepted, measures again, and disables the head.
    ///
    /// # Errors
    /// What went wrong; the head is disabled or in a fault then, or the error says that it may not be. Gains that were written are
    /// written back.
    pub fn execute(mut self) -> Result<Outcome, Failure> {
        self.head.free()?;
        let refused = |text: String| Err(Failure::BadInput(text));
        if let Some(hz) = self.wanted_hz.filter(|hz| !hz.is_finite() || *hz <= 0.0) {
            return refused(format!("bandwidth {hz} Hz: must be above 0 Hz"));
        }
        self.head.place(self.at_mm, TRAVEL)?;
        let armed = self.head.arm()?;
        self.live.expect_heartbeat();
        let found = self.run();
        let now = self.head.stop();
        armed.disarm();
        match (found, now) {
            (Ok(outcome), Ok(_)) => Ok(outcome),
            (Ok(_), Err(why)) => Err(why),
            (Err(why @ Failure::BadInput(_)), Ok(_)) => Err(why),
            (Err(why), Ok(now)) => Err(Failure::Failed(format!("{why}; {now}"))),
            (Err(why), Err(now)) => Err(Failure::Failed(format!("{why}; {now}; the head retreats by itself"))),
        }
    }

    fn run(&mut self) -> Result<Outcome, Failure> {
        let head = self.head;
        self.place()?;
        let now = gains(head)?;
        let known = self.known.take().filter(|(response, _)| response.gains == now);
        let (before, step_before) = match known {
            Some(known) => known,
            None => (self.measure("measures the loop")?, self.step()?),
        };
        let proposal = before.propose(self.wanted_hz).map(|(gains, _)| Candidate::of(&before, gains));
        let ziegler_nichols = Candidate::of(&before, before.ziegler_nichols());
        let mut outcome = Outcome {
            node: head.node,
            before,
            wanted_hz: self.wanted_hz,
            proposal,
            ziegler_nichols,
            step_before,
            after: None,
            step_after: None,
        };
        let accepted = match self.accept {
            Accept::Nothing => return Ok(outcome),
            Accept::ZieglerNichols => outcome.ziegler_nichols.gains,
            Accept::Proposal => match &outcome.proposal {
                Some(proposal) => proposal.gains,
                None => return Ok(outcome),
            },
        };
        write(head, &accepted)?;
        let again = self.measure("measures the loop with the new gains").and_then(|after| Ok((after, self.step()?)));
        match again {
            Ok((after, step)) => {
                (outcome.after, outcome.step_after) = (Some(after), Some(step));
                Ok(outcome)
            }
            Err(why) => match write(head, &outcome.before.gains) {
                Ok(()) => Err(Failure::Failed(format!("{why}; the gains are as they were"))),
                Err(left) => Err(Failure::Failed(format!("{why}; the new gains are in force: {left}"))),
            },
        }
    }

    /// Enabled, homed, where it is to tune.
    fn place(&mut self) -> Result<(), Failure> {
        let (live, on_progress, alive) = (&mut *self.live, &mut *self.on_progress, self.alive);
        self.head.place_to_measure(self.at_mm, TRAVEL, &mut || alive(), &mut || {
            on_progress(&Progress { doing: MOVES.into(), points: None, sample: live.sample()? });
            Ok(())
        })
    }

    fn measure(&mut self, doing: &str) -> Result<Response, Failure> {
        let head = self.head;
        let gains = gains(head)?;
        let axis = axis(head)?;
        let refusals = head.whole(at::REFUSALS)?;
        head.set(TUNE, 1)?;
        let (mut begun, mut count, start) = (false, 0, Instant::now());
        while start.elapsed() < LONGEST {
            (self.alive)()?;
            let sample = self.live.sample()?;
            if sample.fault_number != 0 {
                return Err(Failure::Failed(format!("{}; {UNHELD}", sample.fault)));
            }
            head.refused(refusals)?;
            let step = head.whole(STEP)?;
            // What is there before it begins is of the one before.
            begun |= step != FINISHED && step != ENDED && step != 0;
            if begun {
                let now = head.whole(POINTS)?;
                let points = if now > count { Some(Point::decode(&head.sdo.read(DATA)?)) } else { None };
                count = now;
                let whole = head.setting("tune.points")?;
                (self.on_progress)(&Progress {
                    doing: format!("{doing}: {now} of {whole} frequencies"),
                    points,
                    sample,
                });
            }
            match step {
                FINISHED if begun && self::gains(head)? != gains => {
                    return Err(Failure::Failed("another program has changed servo.*: measure again".into()));
                }
                FINISHED if begun => {
                    let points = Point::decode(&head.sdo.read(DATA)?);
                    let shows = "the loop does not show: raise tune.current_a, or identify the head first";
                    return Response::new(gains, axis, points).ok_or_else(|| Failure::Failed(shows.into()));
                }
                ENDED if begun => return Err(Failure::Failed(format!("no response: {}; {UNHELD}", word(head, WHY)?))),
                _ if !begun && start.elapsed() > BEGINS => {
                    return Err(Failure::Failed(format!("not begun within {} s", BEGINS.as_secs())));
                }
                _ => {}
            }
            std::thread::sleep(PERIOD);
        }
        Err(Failure::Failed(format!("it did not end within {} s", LONGEST.as_secs())))
    }

    /// A step upward by the profile of the head, and back.
    fn step(&mut self) -> Result<Stepped, Failure> {
        let head = self.head;
        let alive = self.alive;
        let per_mm = self.live.counts_per_mm();
        let here = head.whole(at::POSITION)?;
        let height = (STEP_UM * 1e-3 * per_mm).round().max(4.0);
        let target = here - height as i64;
        let plan = fast::Plan {
            signals: SIGNALS.map(Into::into).into(),
            every_ms: SAMPLE_MS,
            trigger: Trigger::State,
            of: None,
            level: 0.0,
            before: 5.0,
            wait_s: 5.0,
        };
        let mut begun = false;
        let record = plan.record(std::slice::from_ref(head), &mut || {
            alive()?;
            if !begun {
                begun = true;
                head.start(target, &mut || alive())?;
            }
            Ok(())
        })?;
        head.move_to(here, &mut || alive())?;
        Ok(Stepped::of(record, SETTLED_COUNTS / per_mm))
    }
}

impl Stepped {
    /// Of a record; two counts in mm.
    fn of(record: Record, counts: f64) -> Stepped {
        let signal = |key: &str| record.signals.iter().find(|signal| signal.key == key);
        let (mut peak_um, mut overshoot_um, mut settled_ms) = (0.0, 0.0, None);
        if let (Some(set), Some(position)) = (signal("set_point"), signal("position")) {
            let target = set.values.last().copied().unwrap_or_default();
            let within = counts.max(SETTLED_UM * 1e-3);
            let off = |(set, at): (&f64, &f64)| (set - at).abs() * 1e3;
            peak_um = set.values.iter().zip(&position.values).map(off).fold(0.0, f64::max);
            overshoot_um = position.values.iter().map(|at| (target - at) * 1e3).fold(0.0, f64::max);
            let there = set.values.iter().rposition(|at| *at != target).map_or(0, |last| last + 1);
            let last = position.values.iter().rposition(|at| (at - target).abs() > within).map_or(0, |last| last + 1);
            if last < position.values.len() {
                settled_ms = Some(last.saturating_sub(there) as f64 * record.every_ms);
            }
        }
        Stepped { record, peak_um, overshoot_um, settled_ms }
    }
}

/// The gains of a head.
///
/// # Errors
/// Those of the transfers.
pub fn gains(head: &Head) -> Result<Gains, Failure> {
    Ok(Gains {
        velocity_hz: head.setting("servo.velocity_hz")?,
        position_hz: head.setting("servo.position_hz")?,
        integral_ms: head.setting("servo.integral_ms")?,
    })
}

fn axis(head: &Head) -> Result<Axis, Failure> {
    let constant = head.setting("axis.force_constant_n_a")?;
    let bus = head.setting("axis.bus_v")?;
    let (ohm, kg) = (head.setting("axis.resistance_ohm")?, head.setting("axis.mass_kg")?);
    Ok(Axis { acceleration: constant * bus / (ohm * kg), back_emf: constant / bus })
}

/// As settings.
pub fn assignments(gains: &Gains) -> [String; 3] {
    [
        format!("servo.velocity_hz={}", gains.velocity_hz),
        format!("servo.position_hz={}", gains.position_hz),
        format!("servo.integral_ms={}", gains.integral_ms),
    ]
}

/// Writes gains: all, or none. They are in force at once, and not saved.
///
/// # Errors
/// Why the head refuses.
pub fn write(head: &Head, gains: &Gains) -> Result<(), Failure> {
    let wanted = settings::assignments(&head.sheet, &assignments(gains)).map_err(Failure::Failed)?;
    settings::write(head, &wanted).map(|_| ())
}

/// What an object's number means.
fn word(head: &Head, address: Address) -> Result<String, Failure> {
    let number = head.whole(address)?;
    let names = head.sheet.get(address).map(|object| object.names()).unwrap_or_default();
    Ok(names.get(&number).cloned().unwrap_or_else(|| number.to_string()))
}
