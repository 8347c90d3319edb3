//! A hole, from a disabled head to a disabled head.
//!
//! The head is watched and watches (heartbeats both ways) before it is enabled. It takes where it rests for home if it has none,
//! touches the work off with pulses off, goes back a little, and erodes to the depth; then it goes up and is disabled. A request
//! is accepted at any time. At the end pulses are off, or the error says that they may be on. A G-code program takes the place of the
//! depth: the head erodes along its path.
//!
//! A touch in a hole that was begun finds its bottom. The head keeps the surface of a hole from its first pulse on (2011h:11), and
//! where there may be one under the electrode the user must say whether to continue it, or to start at a new surface. After a power
//! cut or a new home a hole waits in the head (201Ah): to continue it the head touches what it knows, and checks that.

use crate::bus::SILENCE;
use crate::head::{DISABLED, Head, NO_SURFACE, WAITS, at, state, status};
use crate::live::{Live, Sample};
use crate::track::{self, Track};
use crate::{Failure, table, words};
use edm_gcode::Program;
use edm_technology::File;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::time::{Duration, Instant};

/// Time between two samples.
pub const PERIOD: Duration = Duration::from_millis(50);
/// Velocity of moves with pulses off, where the head allows it, mm/s.
const TRAVEL_MM_S: f64 = 20.0;
/// Activity while the gap leads.
const ERODING: &str = "eroding";
/// Activity while the head waits for the generator.
const WAITS_FOR_GENERATOR: &str = "waiting until the generator is set, pulses off";
/// The erosion ended at its depth, 2003h:3.
const BY_DEPTH: i64 = 1;
const BY_NOTHING: i64 = 0;
/// Why a wait ended when nothing went wrong.
const ON_REQUEST: &str = "ended on request";
/// Why [`Run::alive`] ends a run without a commanding session: the head retreats by itself.
pub const GONE: &str = "the session in command is lost";
/// Activity while it waits since nobody has command.
const UNWATCHED: &str = "paused, pulses off: no session has command";
/// Time over which a pace is taken, s, and the shortest.
const PACE_S: f64 = 30.0;
const LEAST_PACE_S: f64 = 5.0;
/// How long a head may take to notice that, beyond the silence that it allows.
const NOTICES: Duration = Duration::from_secs(2);

/// A hole to bore.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Hole {
    /// Depth below the surface, by the electrode, mm; with a program, its greatest.
    #[serde(default)]
    pub depth_mm: f64,
    /// Where the surface is below home, mm, when neither touched off nor kept by the head.
    #[serde(default)]
    pub surface_mm: Option<f64>,
    /// What is under the electrode; needed where a hole may have been begun.
    #[serde(default)]
    pub site: Option<Site>,
    /// What is touched to go on with a hole that waits.
    #[serde(default)]
    pub touched: Touched,
    /// Height above the surface at which pulses begin, mm.
    #[serde(default = "height")]
    pub height_mm: f64,
    /// What is to be set before; the settings of the head otherwise.
    #[serde(default)]
    pub with: With,
    /// Path to erode along, instead of straight down.
    #[serde(skip)]
    pub program: Option<Arc<Program>>,
    /// Technology table whose rows the head runs.
    #[serde(skip)]
    pub table: Option<Arc<File>>,
}

/// Settings that belong to a hole. They stay in the head after it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(default)]
pub struct With {
    /// `jump.every_ms`.
    pub jump_every_ms: Option<f64>,
    /// `jump.height_um`.
    pub jump_height_um: Option<f64>,
    /// `end.spark_out_ms`.
    pub spark_out_ms: Option<f64>,
}

impl With {
    /// Their keys and values.
    pub fn assignments(&self) -> Vec<String> {
        let all = [
            ("jump.every_ms", self.jump_every_ms),
            ("jump.height_um", self.jump_height_um),
            ("end.spark_out_ms", self.spark_out_ms),
        ];
        all.iter().filter_map(|(key, value)| value.map(|value| format!("{key}={value}"))).collect()
    }
}

/// What is under the electrode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Site {
    /// Work that was not eroded there: its surface is touched off.
    New,
    /// The hole that was begun: it is continued, and measured from the surface that the head keeps.
    Begun,
}

/// What the electrode touches to go on with a hole; the number is the one in 201Ah:2.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Touched {
    /// The bottom of the hole.
    #[default]
    Bottom = 1,
    /// The surface of the work beside it.
    Beside = 2,
    /// The reference.
    Reference = 3,
}

/// Default of [`Hole::height_mm`].
pub const fn height() -> f64 {
    0.2
}

impl Hole {
    /// The same along a program.
    ///
    /// # Errors
    /// What of the program cannot be carried out, with its line.
    pub fn along(self, name: &str, text: &str) -> Result<Hole, Failure> {
        let program = Program::parse(name, text).map_err(|why| Failure::BadInput(format!("program {why}")))?;
        Ok(Hole { depth_mm: program.deepest_mm(), program: Some(Arc::new(program)), ..self })
    }

    /// The same by a technology table.
    ///
    /// # Errors
    /// What is wrong with the table, or its first row with this depth.
    pub fn by(self, table: File) -> Result<Hole, Failure> {
        if let Some(first) = table.rows.first().filter(|first| self.depth_mm * 1000.0 - first.leaves_um < 1.0) {
            let (depth, name, leaves) = (self.depth_mm, &first.name, first.leaves_um);
            let why = format!("depth {depth} mm: row {name:?} leaves {leaves} um: must be deeper");
            return Err(Failure::BadInput(why));
        }
        Ok(Hole { table: Some(Arc::new(table)), ..self })
    }

    /// What is done, for a log.
    pub fn what(&self) -> String {
        match &self.program {
            Some(program) => format!("erodes along {}, {:.3} mm", program.name, program.length_mm),
            None => {
                let by = |table: &Arc<File>| format!(" by a table of {} rows", table.rows.len());
                format!("bores to {} mm{}", self.depth_mm, self.table.as_ref().map_or(String::new(), by))
            }
        }
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// What is allowed.
    pub fn check(&self) -> Result<(), Failure> {
        for (name, value, low, high) in [
            ("depth", self.program.is_none().then_some(self.depth_mm), 0.001, 1000.0),
            ("surface", self.surface_mm, -1000.0, 1000.0),
            ("height", Some(self.height_mm), 0.05, 10.0),
        ] {
            if value.is_some_and(|value| !(low..=high).contains(&value)) {
                let value = value.unwrap_or_default();
                return Err(Failure::BadInput(format!("{name} {value} mm: must be a number from {low} to {high} mm")));
            }
        }
        if self.surface_mm.is_some() && self.site.is_some() {
            return Err(Failure::BadInput("a given surface excludes both a new surface and a hole to continue".into()));
        }
        Ok(())
    }

    /// Checks whether it can be begun at the present position.
    ///
    /// # Errors
    /// What is allowed, what the user must decide, or those of the transfers.
    pub fn may_begin(&self, head: &Head) -> Result<Known, Failure> {
        self.check()?;
        let per_mm = head.counts_per_mm()?;
        let mm = |counts: i64| counts as f64 / per_mm;
        let (here, end) = head.room()?;
        let waits = head.whole(at::KEPT_STATE)? == WAITS;
        self.row(head)?;
        let goes_on = waits && self.surface_mm.is_none() && self.site == Some(Site::Begun);
        let surface = match (self.surface_mm, self.site) {
            (Some(given), _) => Some((given * per_mm).round() as i64),
            (None, Some(Site::New)) => None,
            (None, Some(Site::Begun)) if waits => None,
            (None, None) if waits => return Err(Failure::Undecided { why: waiting(head)?, begun: true }),
            (None, site) => self.kept_surface(head, site.is_some())?,
        };
        match surface {
            Some(surface) => self.fits(mm(surface), mm(end), "below the surface")?,
            // Where it is shows when it has been touched.
            None if goes_on => {}
            None => self.fits(mm(here), mm(end), "from here")?,
        }
        Ok(Known { surface, end, goes_on })
    }

    /// Row of the table to begin with: a hole that is continued goes on in its row.
    fn row(&self, head: &Head) -> Result<usize, Failure> {
        let Some(table) = self.table.as_ref().filter(|_| self.site == Some(Site::Begun)) else { return Ok(1) };
        let (row, rows) = (head.whole(at::KEPT_ROW)?.max(1) as usize, table.rows.len());
        if row > rows {
            let why = format!("the hole was in row {row} of its table: this one has {rows}");
            return Err(Failure::BadInput(why));
        }
        Ok(row)
    }

    /// The surface that the head keeps, if the hole is continued from it; none where there was no erosion.
    fn kept_surface(&self, head: &Head, continues: bool) -> Result<Option<i64>, Failure> {
        let per_mm = head.counts_per_mm()?;
        let kept = Some(head.whole(at::KEPT_SURFACE)?).filter(|kept| *kept != NO_SURFACE);
        let eroded = head.whole(at::ERODING_TIME)? > 0;
        let why = match kept {
            Some(_) if continues => return Ok(kept),
            None if continues => {
                return Err(Failure::BadInput(
                    "no hole to continue: the head has no surface of a hole (2011h:11)".into(),
                ));
            }
            None if !eroded => return Ok(None),
            None => {
                "the head has eroded since power-on and has no surface of that hole: a touch in it would find its bottom; is the \
                     electrode above a new surface, or where is the surface?"
                    .into()
            }
            Some(surface) => {
                let deep = (head.whole(at::DEEPEST)? - surface).max(0) as f64 / per_mm;
                format!(
                    "a hole was begun: its surface is at {:.3} mm, its last depth {deep:.3} mm; \
                     continue it, or is the electrode above a new surface?",
                    surface as f64 / per_mm
                )
            }
        };
        Err(Failure::Undecided { why, begun: kept.is_some() })
    }

    /// Whether the stroke is long enough for it.
    fn fits(&self, from_mm: f64, end_mm: f64, from: &str) -> Result<(), Failure> {
        let left = end_mm - from_mm;
        if let Some(program) = &self.program {
            // How far up it may lead, the head says.
            return program.within(f64::INFINITY, left).map_err(|why| Failure::BadInput(format!("program {why}")));
        }
        if self.depth_mm <= left {
            return Ok(());
        }
        let depth = self.depth_mm;
        Err(Failure::BadInput(format!(
            "depth {depth} mm: must be at most {left:.3} mm, the rest of the stroke {from} (axis.stroke_um, 607Dh:2)"
        )))
    }
}

/// The hole that waits, in words.
///
/// # Errors
/// Those of the transfers.
pub fn waiting(head: &Head) -> Result<String, Failure> {
    let per_mm = head.counts_per_mm()?;
    let mm = |counts: i64| counts as f64 / per_mm;
    let (deep, target) = (mm(head.whole(at::KEPT_DEPTH)?), mm(head.whole(at::KEPT_TARGET)?));
    let of = if target > 0.0 { format!("of {target:.3} mm ") } else { String::new() };
    let row = match head.whole(at::KEPT_ROW)? {
        0 => String::new(),
        row => format!(", in row {row} of its table"),
    };
    Ok(format!(
        "a hole {of}waits since the head has lost its power or its home: {deep:.3} mm deep{row}; go on with it, or is the electrode above \
         a new surface?"
    ))
}

/// What is known before anything moves, counts.
#[derive(Clone, Copy, Debug, Default)]
pub struct Known {
    /// The surface, unless it is to be touched off.
    surface: Option<i64>,
    /// The end of the stroke.
    end: i64,
    /// It waits: its place shows when the electrode has touched.
    goes_on: bool,
}

/// A request to a hole in progress.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u8)]
pub enum Request {
    /// Continue boring.
    Go = 0,
    /// Pulses off, hold.
    Pause = 1,
    /// Pulses off, up to the height at which pulses began.
    Back = 2,
    /// Pulses off, up to where it started, disable.
    Leave = 3,
    /// Pulses off, disable where it is.
    Stop = 4,
}

/// The newest request. Only [`Request::Stop`] replaces [`Request::Leave`], and nothing replaces that.
#[derive(Debug, Default)]
pub struct Requests {
    newest: AtomicU8,
    /// It is that of nobody: nobody has command.
    unwatched: AtomicBool,
    /// The generator is set as the row wants it.
    generator: AtomicBool,
}

impl Requests {
    /// Sets a request.
    pub fn want(&self, request: Request) {
        self.unwatched.store(false, Ordering::Release);
        let _ = self.newest.fetch_update(Ordering::AcqRel, Ordering::Acquire, |now| {
            (now < Request::Leave as u8 || request as u8 > now).then_some(request as u8)
        });
    }

    /// Nobody has command: a hole that goes on is lifted, and waits. True when that is new.
    pub fn unwatched(&self) -> bool {
        let (go, back) = (Request::Go as u8, Request::Back as u8);
        let new = self.newest.compare_exchange(go, back, Ordering::AcqRel, Ordering::Acquire).is_ok();
        if new {
            self.unwatched.store(true, Ordering::Release);
        }
        new
    }

    /// The generator is set as the row under way wants it.
    pub fn generator_is_set(&self) {
        self.generator.store(true, Ordering::Release);
    }

    /// Whether it waits since nobody has command.
    pub fn is_unwatched(&self) -> bool {
        self.unwatched.load(Ordering::Acquire)
    }

    /// The newest request.
    pub fn now(&self) -> Request {
        match self.newest.load(Ordering::Acquire) {
            0 => Request::Go,
            1 => Request::Pause,
            2 => Request::Back,
            3 => Request::Leave,
            _ => Request::Stop,
        }
    }
}

/// How far it is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Progress {
    /// Present activity.
    pub doing: &'static str,
    /// The same, with the depth.
    pub said: String,
    /// The newest request.
    pub request: Request,
    /// It waits because no session has command.
    pub unwatched: bool,
    /// Depth of the electrode below the surface, mm, once that is known.
    pub depth_mm: Option<f64>,
    /// Depth of the hole by the electrode: its greatest depth, mm, once it was in the work.
    pub deepest_mm: Option<f64>,
    /// Depth requested, mm.
    pub target_mm: f64,
    /// Share of the depth, or of the length of the program.
    pub share: Option<f64>,
    /// Line of the program.
    pub line: Option<usize>,
    /// Row of the technology table.
    pub row: Option<table::Now>,
    /// Set points of X and Y, mm, of a program that leads them.
    pub beside_mm: Option<[f64; 2]>,
    /// Time since pulses began, s.
    pub seconds: f64,
    /// Time that the rest takes at the pace of the last half minute, s; none without a pace, as in a seek.
    pub left_s: Option<f64>,
    /// What the head does.
    pub sample: Sample,
}

/// How it ended.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Outcome {
    /// Whether the depth was reached.
    pub reached: bool,
    /// Deepest position of the electrode below the surface, mm.
    pub depth_mm: f64,
    /// Depth requested, mm.
    pub target_mm: f64,
    /// Where the surface is below home, mm.
    pub surface_mm: f64,
    /// Time from the first pulse, s.
    pub seconds: f64,
    /// Why it ended.
    pub why: String,
    /// All of that in words, and what the head is now.
    pub said: String,
}

/// Why a run ends early: a request, or a failure.
enum End {
    Wanted(Request),
    /// Not possible, without a failure.
    Refused(Failure),
    Failed(Failure),
}

impl<E: Into<Failure>> From<E> for End {
    fn from(error: E) -> End {
        End::Failed(error.into())
    }
}

/// Inputs of a run.
pub struct Run<'a> {
    /// The head.
    pub head: &'a Head,
    /// What it does.
    pub live: &'a mut Live,
    /// The hole.
    pub hole: Hole,
    /// Requests of the user.
    pub requests: &'a Requests,
    /// Called 20 times a second and in every wait: keeps the heartbeat alive. An error ends the run.
    pub alive: &'a dyn Fn() -> Result<(), Failure>,
    /// Called with the progress.
    pub on_progress: &'a mut dyn FnMut(&Progress),
}

/// What the run has found out.
#[derive(Default)]
struct Place {
    top: i64,
    known: Known,
    surface: Option<i64>,
    began: Option<Instant>,
    deepest: Option<f64>,
    pace: Pace,
    /// On the program.
    track: Option<track::Place>,
    /// In the table.
    row: Option<table::Now>,
}

impl Place {
    /// The electrode was at this position, mm.
    fn deeper(&mut self, position_mm: f64) {
        self.deepest = Some(self.deepest.unwrap_or(f64::MIN).max(position_mm));
    }
}

/// How fast a hole becomes deeper.
#[derive(Debug, Default)]
struct Pace(VecDeque<(f64, f64)>);

impl Pace {
    /// Takes time in the erosion, s, and greatest depth or length of path, mm; the time that is left to a target.
    fn left(&mut self, seconds: f64, deepest: f64, target: f64) -> Option<f64> {
        self.0.push_back((seconds, deepest));
        while self.0.get(1).is_some_and(|(then, _)| seconds - then >= PACE_S) {
            self.0.pop_front();
        }
        let (then, before) = *self.0.front()?;
        let (time, progress) = (seconds - then, deepest - before);
        (time >= LEAST_PACE_S && progress > 0.0).then(|| (target - deepest).max(0.0) * time / progress)
    }
}

impl Run<'_> {
    /// Bores.
    ///
    /// # Errors
    /// What went wrong; the head is disabled or in a fault then, or the error says that it may not be.
    pub fn execute(mut self) -> Result<Outcome, Failure> {
        self.head.free()?;
        let known = self.hole.may_begin(self.head)?;
        table::clear(self.head)?;
        if let Some(table) = &self.hole.table {
            table::load(self.head, table)?;
        }
        let velocity = self.head.whole(at::PROFILE_VELOCITY)?;
        let armed = self.head.arm()?;
        self.live.expect_heartbeat();
        let mut place = Place { known, ..Place::default() };
        let ended = match self.bore(&mut place) {
            // A wait was ended by a request.
            Err(End::Failed(Failure::Failed(why))) if why == ON_REQUEST => Err(End::Wanted(self.requests.now())),
            ended => ended,
        };
        // Up only where that is wanted and nothing has gone wrong: a head in doubt is left to its own reaction.
        let up = match &ended {
            Ok(_) | Err(End::Wanted(Request::Leave) | End::Refused(_)) => self.up(place.top),
            _ => Ok(()),
        };
        let now = match &ended {
            Err(End::Failed(Failure::Failed(why))) if why == GONE => self.abandon(),
            _ => self.head.stop(),
        };
        // Not enabled any more; what the profile was is of no consequence to a head that does not answer.
        let _ = self.head.set(at::PROFILE_VELOCITY, velocity);
        let _ = table::clear(self.head);
        armed.disarm();
        let now = now
            .map_err(|why| Failure::Failed(format!("{why}; the head monitors this program and retreats by itself")))?;
        let per_mm = self.live.counts_per_mm();
        let surface_mm = place.surface.map_or(0.0, |counts| counts as f64 / per_mm);
        let depth_mm = place.deepest.map_or(0.0, |deepest| deepest - surface_mm);
        let (reached, why) = match ended {
            Ok(why) => (true, why),
            Err(End::Wanted(Request::Stop)) => (false, "stopped".into()),
            Err(End::Wanted(_)) => (false, ON_REQUEST.into()),
            Err(End::Failed(failure) | End::Refused(failure)) => {
                let depth =
                    if place.began.is_some() { format!(" at a depth of {depth_mm:.3} mm") } else { String::new() };
                return Err(Failure::Failed(format!("not bored{depth}: {failure}; {now}")));
            }
        };
        let seconds = place.began.map_or(0.0, |began| began.elapsed().as_secs_f64());
        let (depth_mm, surface_mm, target_mm) = (micrometres(depth_mm), micrometres(surface_mm), self.hole.depth_mm);
        let lifted = if up.is_ok() { "" } else { "It did not lift. " };
        let said = format!(
            "{}: {:.3} of {target_mm:.3} mm in {seconds:.0} s, by the electrode; the hole is deeper by the gap. {}. {lifted}{}.",
            if reached { "Bored" } else { "Ended" },
            depth_mm.max(0.0),
            capital(&why),
            capital(&now),
        );
        Ok(Outcome { reached, depth_mm, target_mm, surface_mm, seconds, why, said })
    }

    /// Lets the heartbeat end: the head retreats along its path, and says what it is then. One that does not is stopped.
    fn abandon(&self) -> Result<String, Failure> {
        self.head.bus.keep_alive(Duration::ZERO);
        let end = Instant::now() + SILENCE + NOTICES;
        while Instant::now() < end {
            let fault = self.head.whole(at::FAULT)? as u8;
            if fault != 0 {
                return Ok(words::fault_line(fault));
            }
            std::thread::sleep(PERIOD);
        }
        self.head.stop()
    }

    fn up(&self, top: i64) -> Result<(), Failure> {
        self.head.set(at::HOLD, 1)?;
        self.head.set(at::ERODE, 0)?;
        self.head.move_to(top, &mut || {
            (self.alive)()?;
            if self.requests.now() == Request::Stop { Err(Failure::Failed(ON_REQUEST.into())) } else { Ok(()) }
        })
    }

    fn bore(&mut self, place: &mut Place) -> Result<String, End> {
        let (head, hole) = (self.head, self.hole.clone());
        let per_mm = self.live.counts_per_mm();
        let counts = |mm: f64| (mm * per_mm).round() as i64;
        self.report("enabling", place)?;
        head.enable(&mut self.tick())?;
        if head.whole(at::HOMED)? == 0 {
            self.report("homing", place)?;
            head.home(&mut self.tick())?;
        }
        place.top = head.whole(at::POSITION)?;
        head.set(at::PROFILE_VELOCITY, counts(TRAVEL_MM_S))?;
        let surface = match place.known.surface {
            Some(surface) => surface,
            None if place.known.goes_on => {
                self.report("touching, to go on with the hole", place)?;
                head.find_surface(&mut self.tick())?;
                head.go_on(hole.touched as u8, &mut self.tick()).map_err(End::Refused)?
            }
            None => {
                self.report("touching off", place)?;
                head.find_surface(&mut self.tick())?
            }
        };
        place.surface = Some(surface);
        let fits = hole.fits(surface as f64 / per_mm, place.known.end as f64 / per_mm, "below the surface");
        fits.map_err(End::Refused)?;
        self.report("moving to the start height", place)?;
        let height = surface - counts(hole.height_mm);
        head.move_to(height, &mut self.tick())?;

        let target = surface + counts(hole.depth_mm);
        head.set(at::KEPT_SURFACE, surface)?;
        if hole.table.is_some() {
            head.set(at::TABLE_ROW, hole.row(head).map_err(End::Refused)? as i64)?;
        }
        let track = hole.program.clone().map(|program| Track::new(head, program, surface));
        let mut track = track.transpose()?;
        if let Some(track) = &mut track {
            // Where the head refuses any of it there have been no pulses yet.
            while !track.is_appended() && head.whole(at::SPACE)? > 1 {
                track.append().map_err(End::Refused)?;
                self.report("sending the program", place)?;
            }
        }
        place.began = Some(Instant::now());
        let ended = self.erode(place, height, target, track.as_mut());
        // The setting is that of the head again, however it has ended.
        let restored = track.as_mut().map_or(Ok(()), Track::end);
        let ended = ended?;
        restored?;
        if hole.table.is_some() {
            // What makes the hole deeper begins with the first row again.
            head.set(at::KEPT_ROW, 0)?;
        }
        Ok(ended)
    }

    /// Erodes to a depth or along a program, and waits when that is requested.
    fn erode(
        &mut self,
        place: &mut Place,
        height: i64,
        target: i64,
        mut track: Option<&mut Track<'_>>,
    ) -> Result<String, End> {
        let head = self.head;
        let mut up = true;
        loop {
            let mut request = self.requests.now();
            if request == Request::Go {
                head.set(at::ERODE, 1)?;
                // Paused where it was, a head goes on along the path that it has: the same target again leads nowhere.
                if track.is_none() && up {
                    head.start(target, &mut self.tick())?;
                }
                let mut leads = false;
                request = loop {
                    if let Some(track) = &mut track {
                        track.append()?;
                        place.track = Some(track.place()?);
                    }
                    if let Some(table) = &self.hole.table {
                        place.row = self.row(table)?.or(place.row.take());
                    }
                    let request = self.report(ERODING, place)?;
                    // Not of the sample: that may still be of the move before.
                    let holds = head.whole(at::STATE)? as u8 == state::HOLDING;
                    let reached = match &track {
                        None => {
                            head.whole(at::STOPPED_BY)? != BY_NOTHING
                                && (holds || head.status()? & status::REACHED != 0)
                        }
                        Some(track) => self.is_over(track)?,
                    };
                    // Not before the head has gone on, nor where it waits for its generator.
                    leads = !place.row.as_ref().is_some_and(|row| row.waits) && (leads || !holds);
                    if holds && leads && request == Request::Go && !reached {
                        let why = words::reason(head.whole(at::REASON)? as u8);
                        return Err(End::Failed(Failure::Failed(format!(
                            "another program has stopped the head: {why}"
                        ))));
                    }
                    if reached {
                        // The electrode was there between two samples, mostly.
                        place.deeper(head.whole(at::DEEPEST)? as f64 / self.live.counts_per_mm());
                        return Ok(self.ended()?);
                    }
                    if request != Request::Go {
                        break request;
                    }
                    std::thread::sleep(PERIOD);
                };
                // Pulses go off, the head holds.
                head.set(at::ERODE, 0)?;
                up = false;
            }
            let requests = self.requests;
            let doing = |up| match up {
                true if requests.is_unwatched() => UNWATCHED,
                true => "waiting, pulses off",
                false => "paused, pulses off",
            };
            while request != Request::Go {
                // Off its path a head would have to begin it anew: there it waits with pulses off.
                if request == Request::Back && !up && track.is_none() {
                    head.move_to(height, &mut self.tick())?;
                    up = true;
                }
                request = self.report(doing(up), place)?;
                std::thread::sleep(PERIOD);
            }
        }
    }

    /// The row under way; the head goes on with it when somebody has set the generator.
    fn row(&self, table: &File) -> Result<Option<table::Now>, Failure> {
        let Some(now) = table::now(self.head, table)? else { return Ok(None) };
        let asked = &self.requests.generator;
        if !now.waits {
            // What was said before the head asked is of another row.
            asked.store(false, Ordering::Release);
        } else if asked.swap(false, Ordering::AcqRel) {
            self.head.set(at::GENERATOR_SET, now.number as i64)?;
        }
        Ok(Some(now))
    }

    /// Whether the head has come to the end of a program.
    fn is_over(&self, track: &Track<'_>) -> Result<bool, Failure> {
        match self.head.whole(at::STATE)? as u8 {
            state::DONE if track.is_appended() => Ok(true),
            // It was faster than the segments came.
            state::DONE => self.head.set(at::ERODE, 1).map(|()| false).map_err(Failure::from),
            state::HOLDING => {
                let why = words::reason(self.head.whole(at::REASON)? as u8);
                Err(Failure::Failed(format!("the head holds: {why}")))
            }
            _ => Ok(false),
        }
    }

    /// What ended the erosion, as the head says it.
    fn ended(&self) -> Result<String, Failure> {
        let by = self.head.whole(at::STOPPED_BY)?;
        if by == BY_DEPTH {
            return Ok(if self.hole.program.is_some() { "end of the program" } else { "depth reached" }.into());
        }
        let names = self.head.sheet.get(at::STOPPED_BY).map(|object| object.names()).unwrap_or_default();
        Ok(names.get(&by).map_or_else(|| "target reached".into(), |name| format!("ended by {name}")))
    }

    /// In waits: continues, unless the end is requested.
    fn tick(&self) -> impl FnMut() -> Result<(), Failure> + use<'_> {
        || {
            (self.alive)()?;
            match self.requests.now() {
                Request::Leave | Request::Stop => Err(Failure::Failed(ON_REQUEST.into())),
                _ => Ok(()),
            }
        }
    }

    /// Takes a sample and reports it; gives the newest request.
    fn report(&mut self, doing: &'static str, place: &mut Place) -> Result<Request, End> {
        (self.alive)()?;
        let request = self.requests.now();
        let sample = self.live.sample()?;
        let per_mm = self.live.counts_per_mm();
        let surface = place.surface.map(|counts| counts as f64 / per_mm);
        if place.began.is_some() {
            place.deeper(sample.deepest());
        }
        let seconds = place.began.map_or(0.0, |began| began.elapsed().as_secs_f64());
        // The erosion begins with a seek, also after a pause.
        let doing = match sample.state_number {
            state::SEEKING if doing == ERODING => "seeking",
            _ if doing == ERODING && place.row.as_ref().is_some_and(|row| row.waits) => WAITS_FOR_GENERATOR,
            _ => doing,
        };
        // In the work alone: the way to it says nothing.
        let deep = surface.zip(place.deepest).map(|(surface, deepest)| deepest - surface).filter(|deep| *deep > 0.0);
        let (done, whole) = match (&self.hole.program, place.track) {
            (None, _) => (deep, self.hole.depth_mm),
            (Some(program), track) => (track.map(|track| track.done_mm), program.length_mm),
        };
        let left_s = done.and_then(|done| place.pace.left(seconds, done, whole));
        let line = place.track.map(|track| track.line);
        let leads = self.hole.program.as_ref().is_some_and(|program| program.leads_beside());
        let depth_mm = surface.map(|surface| sample.position_mm - surface);
        let progress = Progress {
            doing,
            said: said(doing, line, place.row.as_ref(), depth_mm.filter(|_| place.began.is_some()), self.hole.depth_mm),
            request,
            unwatched: self.requests.is_unwatched(),
            depth_mm,
            deepest_mm: deep,
            target_mm: self.hole.depth_mm,
            share: done.map(|done| (done / whole).min(1.0)),
            line,
            row: place.row.clone(),
            beside_mm: place.track.filter(|_| leads).map(|track| track.beside_mm),
            seconds,
            left_s: left_s.filter(|_| doing == ERODING),
            sample,
        };
        (self.on_progress)(&progress);
        if progress.sample.fault_number != 0 {
            return Err(End::Failed(Failure::Failed(progress.sample.fault)));
        }
        // Of now: who stops a head requests so before it is disabled.
        let request = self.requests.now();
        if let Request::Leave | Request::Stop = request {
            return Err(End::Wanted(request));
        }
        if place.began.is_some() && progress.sample.state_number == state::DISABLED {
            let restarted = self.head.whole(at::HOMED).is_ok_and(|homed| homed == 0);
            let why = if restarted { "the head has restarted" } else { DISABLED };
            return Err(End::Failed(Failure::Failed(why.into())));
        }
        Ok(request)
    }
}

/// A sentence begins with it.
fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

fn micrometres(mm: f64) -> f64 {
    (1000.0 * mm).round() / 1000.0
}

/// What is being done, and how far it is.
fn said(doing: &str, line: Option<usize>, row: Option<&table::Now>, depth_mm: Option<f64>, target_mm: f64) -> String {
    let doing = line.map_or(doing.into(), |line| format!("{doing}, line {line}"));
    let doing = row.map_or(doing.clone(), |row| format!("{doing}, row {} of {} ({})", row.number, row.of, row.name));
    match depth_mm.map(micrometres) {
        None => doing,
        Some(depth) if depth < 0.0 => format!("{doing}: {:.3} mm above the work", -depth),
        Some(depth) => format!("{doing}: {:.3} of {target_mm:.3} mm", depth.abs()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_above_the_work_is_not_a_negative_depth() {
        for (depth, text) in [
            (None, "eroding"),
            (Some(-0.2), "eroding: 0.200 mm above the work"),
            (Some(-0.0004), "eroding: 0.000 of 0.030 mm"),
            (Some(0.0301), "eroding: 0.030 of 0.030 mm"),
        ] {
            assert_eq!(said("eroding", None, None, depth, 0.03), text);
        }
        assert_eq!(said("eroding", Some(7), None, Some(0.01), 0.03), "eroding, line 7: 0.010 of 0.030 mm");
    }

    #[test]
    fn the_time_left_is_that_of_the_last_half_minute_and_none_without_a_pace() {
        let mut pace = Pace::default();
        assert_eq!((pace.left(0.0, 0.1, 1.0), pace.left(4.9, 0.2, 1.0)), (None, None), "too early");
        // 0.2 mm in 10 s: 0.7 mm take 35 s.
        let left = pace.left(10.0, 0.3, 1.0).unwrap();
        assert!((left - 35.0).abs() < 1e-9, "{left}");
        // What was before the last half minute counts no more: it stands still.
        assert!((11..=40).all(|second| pace.left(f64::from(second), 0.3, 1.0).is_none() == (second >= 40)));
        assert_eq!(pace.left(41.0, 1.2, 1.0), Some(0.0), "deeper than requested");
    }
}
