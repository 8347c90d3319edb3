//! The page: what the commands do, for a browser.
//!
//! One WebSocket per session carries everything: requests of the session, answers, and messages to all sessions (samples,
//! events, progress). One session commands, the others watch; every session can STOP. The commanding session answers
//! each beat of the server. This program is the head's host in a hole: when it or the cable is lost, the head misses the heartbeat
//! and retreats by itself. When no session has commanded for a while, the hole is paused: pulses off, electrode up, until a session
//! takes command and goes on. With `--unwatched retreat`, and always in a guided check, the heartbeat continues only with the answers
//! of the session in command.
//!
//! By default it listens on this computer only; any other address needs a token. A page of another site is refused by
//! its origin, a name of another host by the host header.

use crate::Failure;
use crate::bore::{self, GONE, Hole, Request, Requests};
use crate::bring_up::{self, BringUp};
use crate::bus::{Bus, SILENCE, lock};
use crate::common::Common;
use crate::deed::Deed;
use crate::fast;
use crate::found::{Found, find};
use crate::gap::Watch;
use crate::head::{Head, WAITS, at};
use crate::identify::{self, Identify};
use crate::jog::{self, Jog};
use crate::live::{Event, Kind, Live, Sample};
use crate::lss;
use crate::record::{Point, Recorder, Taken};
use crate::scope::{self, Plan};
use crate::settings::{self, Line};
use crate::sheet::Sheet;
use crate::stop;
use crate::table;
use crate::trace::Recording;
use crate::tune::{self, Accept, Outcome as Tuned, Tune};
use axum::Router;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::extract::{Query, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use clap::{Args, ValueEnum};
use serde::{Deserialize, Serialize, Serializer};
use serde_json::{Map, Value, json};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};
use tokio::net::TcpListener;
use tokio::sync::{broadcast, mpsc};

/// Where it listens by default.
const DEFAULT: &str = "127.0.0.1:8402";
/// Time without a session in command until a hole is paused, s. A page takes command again by itself in this time.
const UNWATCHED_S: f64 = 30.0;
/// For how long a hole's thread may be busy, as with a transfer that is repeated, until this program does not count as alive.
const HUNG: Duration = Duration::from_secs(3);
/// Period at which a change of command is noticed.
const NOTICED: Duration = Duration::from_millis(250);
/// Period of the beats that a commanding session answers.
const BEAT: Duration = Duration::from_millis(150);
/// Period of samples of each head.
const SAMPLES: Duration = Duration::from_millis(200);
/// Events kept for sessions that connect later.
const LOG: usize = 500;
/// Messages that may wait for a session; one that does not take them misses some.
const WAITING: usize = 256;
/// The shortest token.
const TOKEN: usize = 16;
/// Of a bus that is not there.
const TRIED_AGAIN: &str = "tried again every second";
/// The longest message of a session: a file of settings.
const MESSAGE: usize = 1 << 18;

/// Where the page is served.
#[derive(Debug, Args)]
pub struct Listen {
    /// Address of the page; port 0 takes a free one. An address other than this computer needs --token-file
    #[arg(long, value_name = "HOST:PORT", default_value = DEFAULT)]
    listen: String,
    /// File whose first line, at least 16 letters and digits, every session must give
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,
    /// When no session has command in a hole: pause (pulses off, up, and wait), or have the head retreat within 1 s, in a fault
    #[arg(long, value_enum, default_value = "pause")]
    unwatched: Unwatched,
    /// Time without a session in command until a hole is paused
    #[arg(long, value_name = "S", default_value_t = UNWATCHED_S, value_parser = after, allow_hyphen_values = true)]
    unwatched_after: f64,
    /// File that the log is appended to, one JSON object a line. Its last events are shown again at the next start
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
    /// File that every frame on the bus is appended to, as `candump -L`; `edm-desk replay` reads it
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
}

/// What happens to a hole without a session in command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Unwatched {
    /// It is paused after a while, and a session goes on with it.
    Pause,
    /// It ends in the head's own retreat.
    Retreat,
}

fn busy() -> Failure {
    Failure::BadInput("a hole, a bring-up, an identification, a tuning or a jog is in progress: end it first".into())
}

/// An activity of one head takes no request that moves another.
fn same(node: u8, of: Option<u8>) -> Result<(), Failure> {
    match of.filter(|of| *of != node) {
        Some(of) => {
            Err(Failure::BadInput(format!("node {of}: in progress is what moves node {node}: choose that head")))
        }
        None => Ok(()),
    }
}

fn after(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|seconds| (1.0..=86_400.0).contains(seconds));
    seconds.ok_or_else(|| "must be a number from 1 to 86400 s".into())
}

impl Default for Listen {
    fn default() -> Listen {
        Listen {
            listen: DEFAULT.into(),
            token_file: None,
            unwatched: Unwatched::Pause,
            unwatched_after: UNWATCHED_S,
            log: None,
            record: None,
        }
    }
}

/// A request of a session.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Ask {
    /// The answer to a beat.
    Beat {},
    /// Take or release command.
    Command { take: bool },
    /// List the heads on the bus.
    Heads {},
    /// Give node-IDs to the heads that wait for one.
    Name {},
    /// All settings of a head.
    Settings { node: u8 },
    /// Change some: all, or none.
    Set { node: u8, assignments: Vec<String> },
    /// Differences of a head from a file.
    Compare { node: u8, text: String },
    /// Write a file to the head: all, or none.
    Import { node: u8, text: String },
    /// Save the settings in the head.
    Save { node: u8 },
    /// Bore; along a G-code program instead of to a depth where there is one.
    Bore {
        node: u8,
        hole: Hole,
        #[serde(default)]
        program: Option<String>,
        /// Name of its file.
        #[serde(default)]
        name: Option<String>,
        /// Technology table, whose rows the head runs.
        #[serde(default)]
        table: Option<String>,
    },
    /// A request to the hole in progress.
    Request { request: Request },
    /// The generator is set as the row of the hole in progress wants it.
    GeneratorSet {},
    /// Enable the head to move it by hand.
    Jog { node: u8 },
    /// Measure motor, mass and friction, at a place below home or where the head is.
    Identify { node: u8, at_mm: Option<f64> },
    /// What was found last.
    Identified { node: u8 },
    /// Make that settings.
    TakeOver { node: u8 },
    /// Measure the loop; write what is accepted, and measure again.
    Tune {
        node: u8,
        at_mm: Option<f64>,
        bandwidth_hz: Option<f64>,
        #[serde(default)]
        accept: Accept,
    },
    /// What came of that last; null without one.
    Tuned { node: u8 },
    /// A step of the jog in progress, positive toward the work; refused where that is another head's.
    Step { node: u8, by_mm: f64 },
    /// The end of that.
    EndJog {},
    /// Start a bring-up.
    BringUp { node: u8 },
    /// The guided check of the bring-up in progress, refused where that is another head's; `again`: the manual steps were observed before.
    Check { node: u8, again: bool },
    /// The report of the bring-up.
    Report {},
    /// The last bore of a head.
    Record { node: u8 },
    /// A hole that waits in a head since a power cut or a new home, in words; null without one.
    Waits { node: u8 },
    /// What the scope can record.
    Signals {},
    /// A record of any objects.
    Scope { node: u8, plan: Plan },
    /// A record of the servo ticks of one head or several.
    Fast { nodes: Vec<u8>, plan: fast::Plan },
    /// What a head has recorded around its last fault.
    Snapshot { node: u8 },
    /// Pulses off, disable: every head on the bus.
    Stop {},
    /// Reset a fault.
    Reset { node: u8 },
}

impl Ask {
    /// What a request does, and the head that it does it to; none where that is the activity's in progress, or no head's.
    fn deed(&self) -> (Deed, Option<u8>) {
        match self {
            Ask::Beat {} | Ask::Command { .. } | Ask::Heads {} | Ask::Signals {} => (Deed::Reads, None),
            Ask::Settings { node }
            | Ask::Compare { node, .. }
            | Ask::Identified { node }
            | Ask::Tuned { node }
            | Ask::Record { node }
            | Ask::Waits { node }
            | Ask::Snapshot { node } => (Deed::Reads, Some(*node)),
            Ask::Stop {}
            | Ask::Request { request: Request::Pause | Request::Back | Request::Leave | Request::Stop, .. }
            | Ask::EndJog {}
            | Ask::Report {} => (Deed::Stops, None),
            // A record ends another one, and moves nothing.
            Ask::Scope { .. } | Ask::Fast { .. } => (Deed::Sets, None),
            Ask::Set { node, .. } | Ask::Import { node, .. } | Ask::Save { node } | Ask::TakeOver { node } => {
                (Deed::Sets, Some(*node))
            }
            // Heads without a node-ID are nobody's.
            Ask::Name {} | Ask::GeneratorSet {} | Ask::Request { request: Request::Go, .. } => (Deed::Moves, None),
            Ask::Step { .. } | Ask::Check { .. } => (Deed::Moves, None),
            Ask::Bore { node, .. }
            | Ask::Jog { node }
            | Ask::Identify { node, .. }
            | Ask::Tune { node, .. }
            | Ask::BringUp { node }
            | Ask::Reset { node } => (Deed::Moves, Some(*node)),
        }
    }
}

/// A request, and its id as far as it has one: `{"id": 3, "do": "stop", "node": 1}`.
///
/// Not by a tag of serde's: a number that waits for its tag is none any more where another package of the same build has
/// serde_json keep all digits of numbers (`arbitrary_precision`).
fn request(text: &str) -> (Value, Result<Ask, String>) {
    let mut fields: Map<String, Value> = match serde_json::from_str(text) {
        Ok(fields) => fields,
        Err(error) => return (Value::Null, Err(error.to_string())),
    };
    let id = fields.remove("id").unwrap_or_default();
    let Some(Value::String(what)) = fields.remove("do") else { return (id, Err("\"do\" must name a request".into())) };
    (id, serde_json::from_value(json!({ what: fields })).map_err(|error| error.to_string()))
}

/// What all sessions share.
struct Desk {
    connection: String,
    /// The bus, or why there is none.
    bus: Mutex<Result<Bus, String>>,
    sheet: Arc<Sheet>,
    token: Option<String>,
    /// Messages to all sessions.
    messages: broadcast::Sender<Arc<str>>,
    log: Mutex<VecDeque<Event>>,
    /// Where frames are recorded.
    record: Option<PathBuf>,
    recording: Mutex<Option<Recording>>,
    /// Where events are kept.
    file: Option<Mutex<File>>,
    watched: Mutex<BTreeSet<u8>>,
    /// The last bore of each head.
    recorders: Mutex<BTreeMap<u8, Recorder>>,
    /// What the last tuning of each head has measured.
    tuned: Mutex<BTreeMap<u8, Tuned>>,
    sessions: AtomicU64,
    /// Who commands, and when that session was heard last.
    commander: Mutex<Option<(u64, Instant)>>,
    /// When a session in command was heard last.
    commanded: Mutex<Instant>,
    unwatched: Unwatched,
    unwatched_after: Duration,
    /// Since when there is no bus, ms since 1970.
    lost_since: Mutex<Option<u64>>,
    run: Mutex<Option<Run>>,
}

/// The activity in progress: one at a time.
struct Run {
    node: u8,
    /// The bus that it is on; one that is joined later is another.
    bus: Bus,
    what: What,
}

/// With its requests.
enum What {
    Hole(Arc<Requests>),
    BringUp(Arc<bring_up::Requests>),
    Jog(Arc<jog::Requests>),
    /// An identification, or a tuning.
    Identify(Arc<AtomicBool>),
}

/// Whose it is and what, for a page: "a hole".
impl Serialize for Run {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let what = match &self.what {
            What::Hole(_) => "a hole",
            What::BringUp(_) => "a bring-up",
            What::Jog(_) => "a jog",
            What::Identify(_) => "an identification or tuning",
        };
        json!({ "node": self.node, "what": what }).serialize(serializer)
    }
}

/// Serves the page until the program is stopped.
///
/// # Errors
/// When it cannot listen there.
pub(crate) fn serve(listen: &Listen, common: &Common, sheet: &Arc<Sheet>) -> Result<(), Failure> {
    let refused = |why: String| Failure::BadInput(format!("--listen {}: {why}", listen.listen));
    let token = listen.token()?;
    let addresses = std::net::ToSocketAddrs::to_socket_addrs(&listen.listen);
    let addresses: Vec<SocketAddr> =
        addresses.map_err(|error| refused(format!("must be a free HOST:PORT: {error}")))?.collect();
    if token.is_none() && !addresses.iter().all(|address| address.ip().is_loopback()) {
        return Err(refused("an address other than this computer needs --token-file FILE".into()));
    }
    let (log, log_file) = listen.log.as_deref().map_or(Ok((VecDeque::new(), None)), kept)?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|error| Failure::Failed(format!("no runtime: {error}")))?;
    runtime.block_on(async {
        let listener = TcpListener::bind(&*addresses)
            .await
            .map_err(|error| refused(format!("must be a free HOST:PORT: {error}")))?;
        let at = listener.local_addr().map_err(|error| Failure::Failed(error.to_string()))?;
        let known = token.as_ref().map_or("", |_| "?token=... (as in the file)");
        let joined = join(common);
        if let Err(why) = &joined {
            eprintln!("{why}; {TRIED_AGAIN}");
        }
        let lost_since = joined.is_err().then(unix_ms);
        let address = format!("http://{at}/{known}");
        common.say(&json!({ "page": address, "bus": common.bus.to_string() }), || {
            format!("The desk is at {address}\nbus {}\n\nCtrl-C stops the program.\n", common.bus)
        });
        let desk = Arc::new(Desk {
            connection: common.bus.to_string(),
            bus: Mutex::new(joined),
            sheet: sheet.clone(),
            token,
            messages: broadcast::channel(WAITING).0,
            log: Mutex::new(log),
            record: listen.record.clone(),
            recording: Mutex::default(),
            file: log_file.map(Mutex::new),
            watched: Mutex::default(),
            recorders: Mutex::default(),
            tuned: Mutex::default(),
            sessions: AtomicU64::new(1),
            commander: Mutex::default(),
            commanded: Mutex::new(Instant::now()),
            unwatched: listen.unwatched,
            unwatched_after: Duration::from_secs_f64(listen.unwatched_after),
            lost_since: Mutex::new(lost_since),
            run: Mutex::default(),
        });
        desk.record_bus()?;
        let bus = if lock(&desk.bus).is_ok() { "joined" } else { "not there yet" };
        desk.note(0, format!("the program has started; bus {}: {bus}", desk.connection));
        let (joins, common) = (desk.clone(), common.clone());
        thread::spawn(move || joins.stay_joined(&common));
        let notices = desk.clone();
        thread::spawn(move || notices.notice_commander());
        let app = Router::new()
            .route("/", get(|| file("text/html", include_str!("../page/index.html"))))
            .route("/desk.js", get(|| file("text/javascript", include_str!("../page/desk.js"))))
            .route("/plots.js", get(|| file("text/javascript", include_str!("../page/plots.js"))))
            .route("/uPlot.js", get(|| file("text/javascript", include_str!("../page/uplot/uPlot.iife.min.js"))))
            .route("/uPlot.css", get(|| file("text/css", include_str!("../page/uplot/uPlot.min.css"))))
            .route("/desk.css", get(|| file("text/css", include_str!("../page/desk.css"))))
            .route("/session", get(session))
            .route("/settings.toml", get(export))
            .with_state(desk);
        axum::serve(listener, app).await.map_err(|error| Failure::Failed(error.to_string()))
    })
}

/// The bus, or why there is none.
fn join(common: &Common) -> Result<Bus, String> {
    common.join().map_err(|why| why.to_string().trim_start_matches("--bus ").into())
}

impl Listen {
    fn token(&self) -> Result<Option<String>, Failure> {
        let Some(path) = &self.token_file else { return Ok(None) };
        let refused = |why: String| Failure::BadInput(format!("--token-file {}: {why}", path.display()));
        let text = std::fs::read_to_string(path).map_err(|error| refused(error.to_string()))?;
        let token = text.lines().next().unwrap_or_default().trim();
        if token.len() < TOKEN || !token.chars().all(|c| c.is_ascii_alphanumeric()) {
            return Err(refused(format!("its first line must be at least {TOKEN} letters and digits")));
        }
        Ok(Some(token.into()))
    }
}

/// The last events of a file, and the file to append to.
fn kept(path: &Path) -> Result<(VecDeque<Event>, Option<File>), Failure> {
    let refused = |why: String| Failure::BadInput(format!("--log {}: {why}", path.display()));
    let mut events = if path.exists() { events(path).map_err(refused)? } else { Vec::new() };
    let file = OpenOptions::new().create(true).append(true).open(path).map_err(|why| refused(why.to_string()))?;
    Ok((events.split_off(events.len().saturating_sub(LOG)).into(), Some(file)))
}

/// Events that [`Listen::log`] has kept.
///
/// # Errors
/// What is wrong, with the line.
pub(crate) fn events(path: &Path) -> Result<Vec<Event>, String> {
    let text = std::fs::read_to_string(path).map_err(|why| why.to_string())?;
    let lines = (1..).zip(text.lines()).filter(|(_, line)| !line.is_empty());
    lines.map(|(number, line)| serde_json::from_str(line).map_err(|why| format!("line {number}: {why}"))).collect()
}

/// Now, ms since 1970.
fn unix_ms() -> u64 {
    Event::now(0, Kind::Program, String::new()).unix_ms
}

async fn file(kind: &'static str, text: &'static str) -> impl IntoResponse {
    let policy = "default-src 'self'; img-src data:; frame-ancestors 'none'";
    (
        [(header::CONTENT_TYPE, kind), (header::CONTENT_SECURITY_POLICY, policy), (header::CACHE_CONTROL, "no-store")],
        text,
    )
}

#[derive(Deserialize)]
struct Known {
    #[serde(default)]
    token: String,
    #[serde(default)]
    node: u8,
}

impl Desk {
    /// Whether a request comes from this computer's own page, or knows the token.
    fn admits(&self, headers: &HeaderMap, known: &Known) -> Result<(), (StatusCode, &'static str)> {
        let text = |name| headers.get(name).and_then(|value| value.to_str().ok());
        let host = text(header::HOST).unwrap_or_default();
        if text(header::ORIGIN).is_some_and(|origin| origin.split_once("://").is_none_or(|(_, from)| from != host)) {
            return Err((StatusCode::FORBIDDEN, "page of another site"));
        }
        match &self.token {
            Some(token) if *token != known.token => Err((StatusCode::UNAUTHORIZED, "wrong token")),
            Some(_) => Ok(()),
            None => {
                let name = host.rsplit_once(':').map_or(host, |(name, _)| name);
                let local = matches!(name, "localhost" | "127.0.0.1" | "[::1]");
                if local { Ok(()) } else { Err((StatusCode::FORBIDDEN, "another host")) }
            }
        }
    }

    fn publish(&self, message: &Value) {
        // There may be no session.
        let _ = self.messages.send(message.to_string().into());
    }

    fn bus(&self) -> Result<Bus, Failure> {
        lock(&self.bus).clone().map_err(|why| Failure::Failed(format!("{why}; {TRIED_AGAIN}")))
    }

    /// Joins the bus when it is there later than this program, or again.
    fn stay_joined(&self, common: &Common) {
        loop {
            thread::sleep(SILENCE);
            let had = lock(&self.bus).as_ref().map(Bus::lost).map_err(drop);
            match had {
                Ok(false) => continue,
                Ok(true) => {
                    let since = unix_ms();
                    *lock(&self.lost_since) = Some(since);
                    self.note(0, format!("the bus is lost: {}; {TRIED_AGAIN}", self.connection));
                    self.publish(&json!({ "bus_lost": since }));
                }
                Err(()) => {}
            }
            let joined = join(common);
            let is_there = joined.is_ok();
            *lock(&self.bus) = joined;
            if is_there {
                if let Err(why) = self.record_bus() {
                    self.note(0, format!("the bus is not recorded: {why}"));
                }
                self.note(0, format!("bus joined: {}", self.connection));
                let since = lock(&self.lost_since).take();
                self.publish(&json!({ "bus": self.connection, "since": since }));
            }
        }
    }

    /// Records the bus that is there now.
    fn record_bus(&self) -> Result<(), Failure> {
        let bus = lock(&self.bus).clone();
        let (Some(path), Ok(bus)) = (&self.record, bus) else { return Ok(()) };
        *lock(&self.recording) = Some(Recording::begin(&bus, &self.sheet, path)?);
        Ok(())
    }

    fn head(&self, node: u8) -> Result<Head, Failure> {
        Head::open(&self.bus()?, node, &self.sheet)
    }

    /// Who commands: a session that has not been heard for too long does not.
    fn commander(&self) -> Option<u64> {
        lock(&self.commander).filter(|(_, heard)| heard.elapsed() < SILENCE).map(|(session, _)| session)
    }

    fn tell_commander(&self) {
        self.publish(&json!({ "commander": self.commander() }));
    }

    fn heard(&self, session: u64) {
        let mut commander = lock(&self.commander);
        if let Some((who, heard)) = commander.as_mut()
            && *who == session
            // One that slept for longer takes command, and does not just have it.
            && heard.elapsed() < self.unwatched_after
        {
            *heard = Instant::now();
            *lock(&self.commanded) = Instant::now();
            let alone = |what: &What| !matches!(what, What::Hole(_)) || self.unwatched == Unwatched::Retreat;
            if let Some(run) = &*lock(&self.run)
                && alone(&run.what)
            {
                run.bus.keep_alive(SILENCE);
            }
        }
    }

    /// Tells the sessions when the one in command falls silent, or is heard again.
    fn notice_commander(&self) {
        let mut told = None;
        loop {
            thread::sleep(NOTICED);
            let now = self.commander();
            if std::mem::replace(&mut told, now) != now {
                self.tell_commander();
            }
        }
    }

    /// Called all the time in a hole: whether it goes on.
    fn hosts(&self, session: u64, head: &Head, requests: &Requests) -> Result<(), Failure> {
        if self.unwatched == Unwatched::Retreat {
            return self.commands(session);
        }
        head.bus.keep_alive(HUNG);
        if lock(&self.commanded).elapsed() >= self.unwatched_after && requests.unwatched() {
            let seconds = self.unwatched_after.as_secs();
            self.note(head.node, format!("no session has had command for {seconds} s: the hole is paused, pulses off"));
        }
        Ok(())
    }

    fn left(&self, session: u64) {
        let mut commander = lock(&self.commander);
        if commander.is_some_and(|(who, _)| who == session) {
            *commander = None;
            drop(commander);
            self.tell_commander();
        }
    }

    /// Samples and events of a head, to all sessions.
    fn watch(self: &Arc<Desk>, node: u8) {
        if !lock(&self.watched).insert(node) {
            return;
        }
        let desk = self.clone();
        thread::spawn(move || {
            let mut reported = String::new();
            while let Err(why) = desk.samples(node, &mut reported) {
                let text = why.to_string();
                if text != reported {
                    desk.note(node, text.trim_start_matches(&format!("node {node}: ")).into());
                    desk.publish(&json!({ "gone": { "node": node, "why": text } }));
                    reported = text;
                }
                thread::sleep(SILENCE);
            }
        });
    }

    /// Samples until that fails; then why is not `reported` yet.
    fn samples(&self, node: u8, reported: &mut String) -> Result<(), Failure> {
        let head = self.head(node)?;
        let (mut live, mut watch) = (Live::new(&head)?, Watch::new(&head));
        let identity = &head.identity;
        self.note(
            node,
            format!("{}, software {}, serial number {}", identity.name, identity.software, identity.serial),
        );
        loop {
            let sample = live.sample()?;
            reported.clear();
            let point = self.take(&sample);
            self.publish(&json!({ "sample": sample, "point": point }));
            let gap = watch.look()?;
            self.publish(&json!({ "gap": gap }));
            let mut recorders = lock(&self.recorders);
            let kept = &mut recorders.entry(node).or_default().last.gap;
            if gap.replaces(kept.as_ref().map(|(_, gap)| gap)) {
                *kept = Some((unix_ms(), gap));
            }
            drop(recorders);
            live.events().into_iter().for_each(|event| self.event(event));
            thread::sleep(SAMPLES);
        }
    }

    /// Takes a sample to the record of its head; the point that it has become there.
    fn take(&self, sample: &Sample) -> Option<Point> {
        match lock(&self.recorders).entry(sample.node).or_default().take(sample, Instant::now()) {
            Taken::Nothing => return None,
            Taken::Point(point) => return Some(point),
            Taken::New => {}
        }
        self.publish(&json!({ "record": self.record(sample.node) }));
        None
    }

    /// The last bore of a head; null where there was none.
    fn record(&self, node: u8) -> Value {
        let recorders = lock(&self.recorders);
        recorders
            .get(&node)
            .filter(|recorder| recorder.last.run > 0)
            .map_or(Value::Null, |recorder| json!(recorder.last))
    }

    fn event(&self, event: Event) {
        self.publish(&json!({ "event": event }));
        if let Some(file) = &self.file {
            // A disk that is full is no reason to end a hole.
            let _ = writeln!(lock(file), "{}", json!(event));
        }
        let mut log = lock(&self.log);
        if log.len() == LOG {
            log.pop_front();
        }
        log.push_back(event);
    }

    /// Carries out a request of a session. Called where it may block.
    fn answer(self: &Arc<Desk>, session: u64, ask: Ask) -> Result<Value, Failure> {
        let (deed, node) = ask.deed();
        self.may(session, deed, node)?;
        match ask {
            Ask::Beat {} => Ok(Value::Null),
            Ask::Command { take } => self.command(session, take),
            Ask::Heads {} => {
                let found = find(&self.bus()?, &self.sheet);
                found.iter().filter(|found| found.identity.is_some()).for_each(|found| self.watch(found.node));
                Ok(json!(found.iter().collect::<Vec<&Found>>()))
            }
            Ask::Name {} => {
                self.idle()?;
                let mut all = Vec::new();
                let named = lss::name_all(&self.bus()?, 1, |named| {
                    self.note(
                        named.node,
                        format!("session {session} names serial number {} node {}", named.serial, named.node),
                    );
                    all.push(named);
                });
                named.map(|()| json!(all))
            }
            Ask::Settings { node } => {
                let head = self.head(node)?;
                let lines: Vec<Line> = settings::read_all(&head)?.iter().map(settings::Setting::line).collect();
                Ok(json!(lines))
            }
            Ask::Set { node, assignments } => {
                let wanted = settings::assignments(&self.sheet, &assignments).map_err(Failure::BadInput)?;
                self.write(session, node, &wanted)
            }
            Ask::Compare { node, text } => {
                let wanted = settings::parse(&self.sheet, &text).map_err(Failure::BadInput)?;
                Ok(json!(settings::compare(&self.head(node)?, &wanted)?))
            }
            Ask::Import { node, text } => {
                let wanted = settings::parse(&self.sheet, &text).map_err(Failure::BadInput)?;
                self.write(session, node, &wanted)
            }
            Ask::Save { node } => {
                self.head(node)?.store()?;
                self.note(node, format!("session {session} saves the settings in the head"));
                Ok(Value::Null)
            }
            Ask::Bore { node, hole, program, name, table } => {
                let name = name.as_deref().unwrap_or("the program");
                let hole = program.map_or(Ok(hole.clone()), |text| hole.along(name, &text))?;
                let hole = match table {
                    None => hole,
                    Some(_) if hole.program.is_some() => {
                        return Err(Failure::BadInput("table excludes a program: it makes a hole of a depth".into()));
                    }
                    Some(text) => {
                        let table = table::parse(&text).map_err(|why| Failure::BadInput(format!("table {why}")))?;
                        hole.by(table.waiting(table::PATIENCE_S))?
                    }
                };
                self.bore(session, node, hole)
            }
            Ask::Request { request } => match &*lock(&self.run) {
                Some(Run { what: What::Hole(requests), .. }) => {
                    requests.want(request);
                    Ok(Value::Null)
                }
                _ => Err(Failure::BadInput("no hole in progress".into())),
            },
            Ask::GeneratorSet {} => match &*lock(&self.run) {
                Some(Run { what: What::Hole(requests), .. }) => {
                    requests.generator_is_set();
                    Ok(Value::Null)
                }
                _ => Err(Failure::BadInput("no hole in progress".into())),
            },
            Ask::Record { node } => Ok(self.record(node)),
            Ask::Waits { node } => {
                let head = self.head(node)?;
                let waits = head.whole(at::KEPT_STATE)? == WAITS;
                Ok(if waits { json!(bore::waiting(&head)?) } else { Value::Null })
            }
            Ask::Signals {} => {
                let objects = self.sheet.objects().filter(|object| scope::records(object));
                let objects: Vec<_> =
                    objects.map(|object| json!([object.address.to_string(), object.key, object.unit])).collect();
                Ok(json!({ "ticks": fast::signals().collect::<Vec<_>>(), "objects": objects }))
            }
            Ask::Scope { node, plan } => {
                let record = plan.record(&self.head(node)?, &mut || self.commands(session))?;
                Ok(json!({ "record": record, "csv": record.csv() }))
            }
            Ask::Fast { nodes, plan } => {
                plan.check()?;
                let heads = nodes.iter().map(|node| self.head(*node)).collect::<Result<Vec<_>, _>>()?;
                let record = plan.record(&heads, &mut || self.commands(session))?;
                Ok(json!({ "record": record, "csv": record.csv() }))
            }
            Ask::Snapshot { node } => Ok(match fast::snapshot(&self.head(node)?)? {
                Some(record) => json!({ "record": record, "csv": record.csv() }),
                None => Value::Null,
            }),
            Ask::Jog { node } => self.jog(session, node),
            Ask::Identify { node, at_mm } => self.identify(session, node, at_mm),
            Ask::Identified { node } => Ok(json!(identify::values(&self.head(node)?)?)),
            Ask::TakeOver { node } => {
                self.idle()?;
                let head = self.head(node)?;
                identify::take_over(&head)?;
                self.note(node, format!("session {session} has taken the identified values over into the settings"));
                Ok(json!(identify::values(&head)?))
            }
            Ask::Tune { node, at_mm, bandwidth_hz, accept } => self.tune(session, node, (at_mm, bandwidth_hz), accept),
            Ask::Tuned { node } => Ok(json!(lock(&self.tuned).get(&node))),
            Ask::Step { node, by_mm } => self.jogs(Some(node), |requests| requests.step(by_mm)),
            Ask::EndJog {} => self.jogs(None, |requests| {
                requests.end();
                Ok(())
            }),
            Ask::BringUp { node } => self.bring_up(session, node),
            Ask::Check { node, again } => {
                self.want(Some(node), if again { bring_up::Request::CheckAgain } else { bring_up::Request::Check })
            }
            Ask::Report {} => self.want(None, bring_up::Request::End),
            Ask::Stop {} => {
                // Each head that this program knows is told at once.
                let mut known = lock(&self.watched).clone();
                if let Some(run) = &*lock(&self.run) {
                    known.insert(run.node);
                    match &run.what {
                        What::Hole(requests) => requests.want(Request::Stop),
                        What::BringUp(requests) => requests.want(bring_up::Request::End),
                        What::Jog(requests) => requests.end(),
                        What::Identify(ends) => ends.store(true, Ordering::Release),
                    }
                }
                let stopped = stop::stop(&self.bus()?, &self.sheet, &known, |one| {
                    self.note(one.node, format!("STOP by session {session}: {}", one.now));
                });
                Ok(json!({ "stopped": stopped }))
            }
            Ask::Reset { node } => {
                let reset = self.head(node)?.reset()?;
                if reset {
                    self.note(node, format!("session {session} has reset the fault"));
                }
                Ok(json!({ "reset": reset }))
            }
        }
    }

    fn command(&self, session: u64, take: bool) -> Result<Value, Failure> {
        let mut commander = lock(&self.commander);
        let other = commander.filter(|(who, heard)| *who != session && heard.elapsed() < SILENCE);
        if take && other.is_some() {
            return Err(Failure::BadInput("another session has command: it must release command first".into()));
        }
        if !take {
            self.idle()?;
        }
        if take {
            *commander = Some((session, Instant::now()));
            *lock(&self.commanded) = Instant::now();
        } else if other.is_none() {
            *commander = None;
        }
        drop(commander);
        self.note(0, format!("session {session} {} command", if take { "takes" } else { "releases" }));
        self.tell_commander();
        Ok(Value::Null)
    }

    fn write(&self, session: u64, node: u8, wanted: &[settings::Setting<'_>]) -> Result<Value, Failure> {
        let written = settings::write(&self.head(node)?, wanted)?;
        if !written.changed.is_empty() {
            self.note(node, format!("session {session} has changed {}", written.said.join(", ")));
        }
        Ok(json!(written))
    }

    /// Whether a session may do that to a head: that of the activity in progress is this program's to set, others go by
    /// [`Head::may`].
    fn may(&self, session: u64, deed: Deed, node: Option<u8>) -> Result<(), Failure> {
        if deed > Deed::Stops && self.commander() != Some(session) {
            return Err(Failure::BadInput("this session does not have command: take command first".into()));
        }
        let Some(node) = node.filter(|_| deed > Deed::Stops) else { return Ok(()) };
        match &*lock(&self.run) {
            Some(_) if deed == Deed::Moves => return Err(busy()),
            Some(run) if run.node == node => return Ok(()),
            _ => {}
        }
        self.head(node)?.may(deed)
    }

    fn note(&self, node: u8, what: String) {
        self.event(Event::now(node, Kind::Program, what));
    }

    /// Nothing is in progress.
    fn idle(&self) -> Result<(), Failure> {
        if lock(&self.run).is_some() { Err(busy()) } else { Ok(()) }
    }

    /// Sets the activity in progress.
    fn begin(&self, head: &Head, what: What) -> Result<(), Failure> {
        let mut run = lock(&self.run);
        if run.is_some() {
            return Err(busy());
        }
        let run = run.insert(Run { node: head.node, bus: head.bus.clone(), what });
        self.publish(&json!({ "run": run }));
        Ok(())
    }

    /// Ends the activity in progress.
    fn over(&self) {
        *lock(&self.run) = None;
        self.publish(&json!({ "run": Value::Null }));
    }

    /// Whether the session that began an activity still commands.
    fn commands(&self, session: u64) -> Result<(), Failure> {
        match self.commander() {
            Some(who) if who == session => Ok(()),
            _ => Err(Failure::Failed(GONE.into())),
        }
    }

    /// A request to the bring-up in progress; one that names a head is refused where that is another one's.
    fn want(&self, of: Option<u8>, request: bring_up::Request) -> Result<Value, Failure> {
        match &*lock(&self.run) {
            Some(Run { node, what: What::BringUp(requests), .. }) => {
                same(*node, of)?;
                requests.want(request);
                Ok(Value::Null)
            }
            _ => Err(Failure::BadInput("no bring-up is running: begin first".into())),
        }
    }

    /// Starts a bring-up; all sessions get its progress.
    fn bring_up(self: &Arc<Desk>, session: u64, node: u8) -> Result<Value, Failure> {
        let head = self.head(node)?;
        let requests = Arc::new(bring_up::Requests::default());
        self.begin(&head, What::BringUp(requests.clone()))?;
        let desk = self.clone();
        thread::spawn(move || {
            desk.note(node, format!("session {session} starts a bring-up"));
            let ended = Live::new(&head).and_then(|mut live| {
                let bring_up = BringUp {
                    head: &head,
                    live: &mut live,
                    requests: &requests,
                    alive: &|| desk.commands(session),
                    on_progress: &mut |progress| desk.publish(&json!({ "bring_up": progress })),
                };
                bring_up.execute()
            });
            desk.over();
            let (what, result) = match ended {
                Ok(report) => {
                    let text = format!("bring-up: {}", report.verdict());
                    let files = json!({ "name": report.name(), "markdown": report.markdown(), "report": report });
                    (text, files)
                }
                Err(why) => (format!("bring-up: {why}"), json!({ "failed": why.to_string() })),
            };
            desk.note(node, what);
            desk.publish(&json!({ "brought_up": result }));
        });
        Ok(Value::Null)
    }

    /// A request to the jog in progress; one that names a head is refused where that is another one's.
    fn jogs(
        &self,
        of: Option<u8>,
        request: impl FnOnce(&jog::Requests) -> Result<(), Failure>,
    ) -> Result<Value, Failure> {
        match &*lock(&self.run) {
            Some(Run { node, what: What::Jog(requests), .. }) => {
                same(*node, of)?;
                request(requests).map(|()| Value::Null)
            }
            _ => Err(Failure::BadInput("the head is not enabled to jog: begin first".into())),
        }
    }

    /// Enables a head that a session moves; it alone keeps it going.
    fn jog(self: &Arc<Desk>, session: u64, node: u8) -> Result<Value, Failure> {
        let head = self.head(node)?;
        let requests = Arc::new(jog::Requests::default());
        self.begin(&head, What::Jog(requests.clone()))?;
        let desk = self.clone();
        thread::spawn(move || {
            desk.note(node, format!("session {session} jogs"));
            let ended = Live::new(&head).and_then(|mut live| {
                let jog = Jog {
                    head: &head,
                    live: &mut live,
                    requests: &requests,
                    alive: &|| desk.commands(session),
                    on_progress: &mut |progress| desk.publish(&json!({ "jog": progress })),
                };
                jog.execute()
            });
            desk.over();
            let (said, failed) = ended.map_or_else(|why| (why.to_string(), true), |now| (now, false));
            desk.note(node, format!("jog ended: {said}"));
            desk.publish(&json!({ "jogged": { "said": said, "failed": failed }, "node": node }));
        });
        Ok(Value::Null)
    }

    /// Identifies a head; the session keeps it going.
    fn identify(self: &Arc<Desk>, session: u64, node: u8, at_mm: Option<f64>) -> Result<Value, Failure> {
        let head = self.head(node)?;
        head.place(at_mm, identify::TRAVEL)?;
        let ends = Arc::new(AtomicBool::new(false));
        self.begin(&head, What::Identify(ends.clone()))?;
        let desk = self.clone();
        thread::spawn(move || {
            desk.note(node, format!("session {session} identifies"));
            let ended = Live::new(&head).and_then(|mut live| {
                let run = Identify {
                    head: &head,
                    live: &mut live,
                    at_mm,
                    alive: &|| match ends.load(Ordering::Acquire) {
                        true => Err(Failure::Failed("ended on request".into())),
                        false => desk.commands(session),
                    },
                    on_progress: &mut |progress| desk.publish(&json!({ "identify": progress })),
                };
                run.execute()
            });
            desk.over();
            match ended {
                Ok(outcome) => {
                    desk.note(node, "identified".into());
                    desk.publish(&json!({ "identified": outcome, "node": node }));
                }
                Err(why) => {
                    desk.note(node, format!("identification ended: {why}"));
                    desk.publish(&json!({ "identified": { "failed": why.to_string() }, "node": node }));
                }
            }
        });
        Ok(Value::Null)
    }

    /// Measures the loop of a head; the session keeps it going.
    fn tune(
        self: &Arc<Desk>,
        session: u64,
        node: u8,
        (at_mm, wanted_hz): (Option<f64>, Option<f64>),
        accept: Accept,
    ) -> Result<Value, Failure> {
        let head = self.head(node)?;
        head.place(at_mm, tune::TRAVEL)?;
        let ends = Arc::new(AtomicBool::new(false));
        self.begin(&head, What::Identify(ends.clone()))?;
        let desk = self.clone();
        thread::spawn(move || {
            desk.note(node, format!("session {session} tunes"));
            // What is in force now was measured after the last new gains, or before none.
            let last = lock(&desk.tuned).get(&node).cloned();
            let known = last.map(|last| match (last.after, last.step_after) {
                (Some(after), Some(step)) => (after, step),
                _ => (last.before, last.step_before),
            });
            let ended = Live::new(&head).and_then(|mut live| {
                let run = Tune {
                    head: &head,
                    live: &mut live,
                    at_mm,
                    wanted_hz,
                    accept,
                    known: known.filter(|_| accept != Accept::Nothing),
                    alive: &|| match ends.load(Ordering::Acquire) {
                        true => Err(Failure::Failed("ended on request".into())),
                        false => desk.commands(session),
                    },
                    on_progress: &mut |progress| desk.publish(&json!({ "tune": progress })),
                };
                run.execute()
            });
            desk.over();
            match ended {
                Ok(outcome) => {
                    desk.note(node, "the loop is measured".into());
                    desk.publish(&json!({ "tuned": outcome, "node": node }));
                    lock(&desk.tuned).insert(node, outcome);
                }
                Err(why) => {
                    desk.note(node, format!("tuning ended: {why}"));
                    desk.publish(&json!({ "tuned": { "failed": why.to_string() }, "node": node }));
                }
            }
        });
        Ok(Value::Null)
    }

    /// Starts boring; all sessions get the progress.
    fn bore(self: &Arc<Desk>, session: u64, node: u8, hole: Hole) -> Result<Value, Failure> {
        let wanted = settings::assignments(&self.sheet, &hole.with.assignments()).map_err(Failure::BadInput)?;
        let head = self.head(node)?;
        hole.may_begin(&head)?;
        if lock(&self.run).is_none() && !wanted.is_empty() {
            self.write(session, node, &wanted)?;
        }
        let requests = Arc::new(Requests::default());
        self.begin(&head, What::Hole(requests.clone()))?;
        let desk = self.clone();
        thread::spawn(move || {
            desk.note(node, format!("session {session} {}", hole.what()));
            let before = {
                let mut recorders = lock(&desk.recorders);
                let recorder = recorders.entry(node).or_default();
                recorder.target_mm = Some(hole.depth_mm);
                recorder.last.run
            };
            let ended = desk.run(session, &head, hole, &requests);
            desk.over();
            let (what, result) = match ended {
                Ok(outcome) => (outcome.said.clone(), json!({ "outcome": outcome })),
                Err(why) => (why.to_string(), json!({ "failed": why.to_string() })),
            };
            desk.note(node, what);
            {
                let mut recorders = lock(&desk.recorders);
                let recorder = recorders.entry(node).or_default();
                recorder.target_mm = None;
                // One that has not had pulses is no bore.
                if recorder.last.run != before {
                    recorder.last.ended = result.clone();
                }
            }
            desk.publish(&json!({ "ended": result, "node": node }));
        });
        Ok(Value::Null)
    }

    fn run(&self, session: u64, head: &Head, hole: Hole, requests: &Requests) -> Result<bore::Outcome, Failure> {
        let mut live = Live::new(head)?;
        let run = bore::Run {
            head,
            live: &mut live,
            hole,
            requests,
            alive: &|| self.hosts(session, head, requests),
            on_progress: &mut |progress| {
                let point = self.take(&progress.sample);
                self.publish(&json!({ "progress": progress, "point": point }));
            },
        };
        run.execute()
    }
}

async fn session(
    State(desk): State<Arc<Desk>>,
    headers: HeaderMap,
    Query(known): Query<Known>,
    upgrade: WebSocketUpgrade,
) -> Response {
    match desk.admits(&headers, &known) {
        Ok(()) => upgrade.max_message_size(MESSAGE).on_upgrade(move |socket| talk(desk, socket)),
        Err(refused) => refused.into_response(),
    }
}

async fn export(State(desk): State<Arc<Desk>>, headers: HeaderMap, Query(known): Query<Known>) -> Response {
    if let Err(refused) = desk.admits(&headers, &known) {
        return refused.into_response();
    }
    let file = move || {
        let head = desk.head(known.node)?;
        let settings = settings::read_all(&head)?;
        Ok::<_, Failure>(settings::file(&head.identity, &settings))
    };
    match tokio::task::spawn_blocking(file).await {
        Ok(Ok(text)) => {
            ([(header::CONTENT_TYPE, "application/toml"), (header::CONTENT_DISPOSITION, "attachment")], text)
                .into_response()
        }
        Ok(Err(why)) => (StatusCode::BAD_GATEWAY, why.to_string()).into_response(),
        Err(_) => StatusCode::INTERNAL_SERVER_ERROR.into_response(),
    }
}

/// First message to a session.
#[derive(Serialize)]
struct Welcome<'a> {
    you: u64,
    commander: Option<u64>,
    product: &'a str,
    bus: &'a str,
    log: Vec<Event>,
    /// The activity in progress.
    run: Value,
    /// Since when there is no bus, ms since 1970.
    bus_lost: Option<u64>,
    /// For how long a page takes command again by itself, s.
    again_s: f64,
    /// Names of the states by number.
    states: BTreeMap<i64, String>,
}

async fn talk(desk: Arc<Desk>, mut socket: WebSocket) {
    let session = desk.sessions.fetch_add(1, Ordering::Relaxed);
    let mut messages = desk.messages.subscribe();
    let (answers, mut answered) = mpsc::channel::<String>(WAITING);
    let welcome = Welcome {
        you: session,
        commander: desk.commander(),
        product: &desk.sheet.product,
        bus: &desk.connection,
        log: lock(&desk.log).iter().cloned().collect(),
        run: json!(*lock(&desk.run)),
        bus_lost: *lock(&desk.lost_since),
        again_s: desk.unwatched_after.as_secs_f64(),
        states: desk.sheet.get(at::STATE).map(|object| object.names()).unwrap_or_default(),
    };
    let mut next = Some(json!({ "welcome": welcome }).to_string());
    let mut beat = tokio::time::interval(BEAT);
    loop {
        if let Some(text) = next.take()
            && socket.send(Message::Text(text.into())).await.is_err()
        {
            break;
        }
        tokio::select! {
            // What a session says comes first: its answer to a beat, its STOP.
            biased;
            came = socket.recv() => match came {
                Some(Ok(Message::Text(text))) => match request(&text) {
                    (_, Ok(Ask::Beat {})) => desk.heard(session),
                    (id, Ok(ask)) => {
                        let (desk, answers) = (desk.clone(), answers.clone());
                        tokio::task::spawn_blocking(move || {
                            let answer = match desk.answer(session, ask) {
                                Ok(value) => json!({ "id": id, "ok": value }),
                                Err(Failure::Undecided { why, begun }) => {
                                    json!({ "id": id, "error": why, "asks": { "begun": begun } })
                                }
                                Err(why) => json!({ "id": id, "error": why.to_string() }),
                            };
                            // The session may be over.
                            let _ = answers.blocking_send(answer.to_string());
                        });
                    }
                    (id, Err(why)) => next = Some(json!({ "id": id, "error": format!("no request: {why}") }).to_string()),
                },
                Some(Ok(Message::Binary(_))) => next = Some(json!({ "error": "no request: must be text" }).to_string()),
                Some(Ok(_)) => {}
                Some(Err(_)) | None => break,
            },
            Some(answer) = answered.recv() => next = Some(answer),
            message = messages.recv() => match message {
                Ok(message) => next = Some(message.to_string()),
                Err(broadcast::error::RecvError::Lagged(_)) => {}
                Err(broadcast::error::RecvError::Closed) => break,
            },
            _ = beat.tick() => next = Some(json!({ "beat": true }).to_string()),
        }
    }
    desk.left(session);
}
