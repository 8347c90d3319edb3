//! The commands. Each ends with one line with its result, or with one object with `--json`.

use crate::Failure;
use crate::bore::{self, Hole, Outcome, Request, Requests, Run, Site, Touched, With};
use crate::bring_up::{self, BringUp, Check, Verdict};
use crate::bus::SILENCE;
use crate::common::{Common, say};
use crate::deed::Deed;
use crate::fast;
use crate::found::{Found, find};
use crate::gap;
use crate::head::Head;
use crate::identify::{self, Identify, Outcome as Identified};
use crate::live::{Event, Kind as EventKind, Live, Sample};
use crate::lss;
use crate::page::{self, Listen};
use crate::scope::{self, Plan, Record};
use crate::sdo::SdoError;
use crate::settings::{self, Setting};
use crate::sheet::{Kind, Sheet};
use crate::stop::{self, Stopped};
use crate::table;
use crate::trace::{self, Recording};
use crate::tune::{Accept, Tune};
use crate::update::{self, Doing, Update};
use clap::error::ErrorKind;
use clap::{Args, CommandFactory, Parser, Subcommand, ValueEnum};
use clap_complete::Shell;
use edm_technology::{File, Row};
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Exit codes: failed; bad input, nothing was done.
const FAILED: u8 = 1;
const BAD_INPUT: u8 = 2;

/// Time to let go of a head that was moved manually, before the guided check.
const HANDS_OFF: Duration = Duration::from_secs(5);

/// Finds servo heads of EDM machines on a bus, shows and sets them, and bores with them.
#[derive(Debug, Parser)]
#[command(name = "edm-desk", version, disable_help_subcommand = true)]
struct Cli {
    #[command(flatten)]
    common: Common,
    /// Default: the page
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Serves the page for a browser, until Ctrl-C
    Page(Listen),
    /// Lists the heads on the bus: versions, serial number, state, fault
    Heads,
    /// Gives a node-ID to every head that waits for one (LSS): the free ones from --node on, 1 by default
    Name,
    /// Shows, changes, saves and compares settings
    #[command(subcommand)]
    Settings(Settings),
    /// Shows state, gap, feed and position of a head, until Ctrl-C
    Watch {
        /// Ends after this time
        #[arg(long, value_name = "S", value_parser = seconds)]
        seconds: Option<f64>,
    },
    /// Shows the gap: voltage levels, shares of all pulses, hazard, distance, sparks, what is controlled, feed; until Ctrl-C
    Gap {
        /// Ends after this time
        #[arg(long, value_name = "S", value_parser = seconds)]
        seconds: Option<f64>,
    },
    /// Records up to eight signals of the servo tick with the scope of the head, 16 KiB around a trigger; or four objects, 256 samples from the trigger on
    Scope(ScopeOptions),
    /// Records every frame on the bus to a file, as `candump -L`, until Ctrl-C; sends nothing
    Record {
        /// File that frames are appended to
        file: PathBuf,
        /// Ends after this time
        #[arg(long, value_name = "S", value_parser = seconds)]
        seconds: Option<f64>,
    },
    /// Shows what a recording says: states, emergencies, refusals, who writes what. Needs no bus
    Replay {
        /// File of `record` or of `candump -L`
        file: PathBuf,
        /// Sends what the hosts in the recording sent to the bus instead, at the recorded times, as to `cargo sim serve`
        #[arg(long)]
        play: bool,
    },
    /// Shows emergencies, faults, refusals and changes of state as they happen, until Ctrl-C
    Log {
        /// Shows what `page --log FILE` has kept, instead
        #[arg(long, value_name = "FILE")]
        file: Option<PathBuf>,
        /// Ends after this time
        #[arg(long, value_name = "S", value_parser = seconds)]
        seconds: Option<f64>,
    },
    /// Checks the steps of docs/bring-up.md that a host can see, while you do them, and writes a report
    BringUp(BringUpOptions),
    /// Measures resistance, inductance, force constant, mass, friction and counterbalance: the head moves up by identify.travel_um and back, pulses off
    Identify(IdentifyOptions),
    /// The head measures the frequency response of its loop: margins, a proposal of gains, a step before and after
    Tune(TuneOptions),
    /// Bores a hole: touches off, erodes to the depth, lifts, disables. Ctrl-C lifts and disables; a second Ctrl-C stops at once
    Bore(BoreOptions),
    /// Checks a technology table and lists its rows; needs no bus without --load
    Table {
        /// As examples/technology.toml
        file: PathBuf,
        /// Writes it to the head, which checks it with its own settings and takes it into use
        #[arg(long)]
        load: bool,
    },
    /// Pulses off, hold, disable: every head on the bus, whoever commands it. This is not an emergency stop: use the switch at the machine
    Stop,
    /// Resets a fault after its cause is gone
    Reset,
    /// Lists what the scope can record: signals of the servo tick, name and unit; objects, address, name and unit
    Signals {
        /// Word to look for
        word: Option<String>,
    },
    /// Prints a script that completes commands and options in a shell
    Completion {
        /// As in `source <(edm-desk completion bash)`
        shell: Shell,
    },
    /// Gives a disabled head another program, over the bus: the file of its board that `cargo firmware` writes
    Update {
        /// As target/firmware/edm-servo-head-board-f405.update
        file: PathBuf,
    },
    /// Reads or writes any object of the description file, in its unit as stored
    Object {
        /// As in docs/objects.md: 2005:1, or Gap.Voltage
        name: String,
        /// Value to write
        #[arg(allow_hyphen_values = true)]
        value: Option<String>,
    },
}

#[derive(Debug, Subcommand)]
enum Settings {
    /// Lists all settings, or those with a word in their key or description
    List {
        /// Word to look for
        word: Option<String>,
        /// Only settings that differ from their default
        #[arg(long)]
        changed: bool,
    },
    /// Shows the values of some settings
    Get {
        /// group.name
        #[arg(required = true)]
        keys: Vec<String>,
    },
    /// Changes settings: all of them, or none
    Set {
        /// group.name=value
        #[arg(required = true, value_name = "KEY=VALUE")]
        assignments: Vec<String>,
        #[command(flatten)]
        save: Save,
    },
    /// Writes all settings to a file
    Export {
        /// File to write
        file: PathBuf,
    },
    /// Lists the settings that differ from a file
    Compare {
        /// File to compare with
        file: PathBuf,
    },
    /// Writes the settings of a file to the head: all of them, or none
    Import {
        /// File to read
        file: PathBuf,
        #[command(flatten)]
        save: Save,
    },
}

#[derive(Debug, Args)]
struct Save {
    /// Save the settings in the head (1010h:3)
    #[arg(long)]
    save: bool,
}

#[derive(Debug, Args)]
struct ScopeOptions {
    /// Signals of the servo tick by name, as `signals` lists them: position gap_voltage; or objects, as in docs/objects.md: 2005:1, Gap.Voltage
    #[arg(required_unless_present_any = ["snapshot", "last", "show"])]
    signals: Vec<String>,
    /// Sample period; default: 0.05 for signals of the servo tick, 1 for objects
    #[arg(long, value_name = "MS", allow_hyphen_values = true)]
    every: Option<f64>,
    /// What begins the record
    #[arg(long, value_enum, default_value = "now")]
    trigger: Begin,
    /// Signal that is compared with the level; default: the first
    #[arg(long, value_name = "SIGNAL")]
    of: Option<String>,
    /// Level of the trigger, in the unit of that signal
    #[arg(long, value_name = "VALUE", default_value_t = 0.0, allow_hyphen_values = true)]
    level: f64,
    /// Share of the record from before the trigger; signals of the servo tick only. Default: 50
    #[arg(long, value_name = "PERCENT", allow_hyphen_values = true)]
    pre: Option<f64>,
    /// Records on these heads, side by side; signals of the servo tick only
    #[arg(long, value_name = "ID,ID", value_delimiter = ',', value_parser = clap::value_parser!(u8).range(1..=127), conflicts_with = "node")]
    nodes: Vec<u8>,
    /// Time-out of the trigger
    #[arg(long, value_name = "S", default_value = "60", value_parser = seconds, allow_hyphen_values = true)]
    wait: f64,
    /// File for the samples
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Reads what the head has recorded around its last fault instead
    #[arg(long, conflicts_with_all = ["signals", "every", "trigger", "of", "level", "pre", "nodes"])]
    snapshot: bool,
    /// Reads the record that the head has instead: of a trigger that came after the wait, or before a reset
    #[arg(long, conflicts_with_all = ["signals", "every", "trigger", "of", "level", "pre", "nodes", "snapshot"])]
    last: bool,
    /// Shows a CSV file of a record instead; needs no bus
    #[arg(long, value_name = "FILE", conflicts_with_all = ["signals", "every", "trigger", "of", "level", "pre", "nodes", "snapshot", "last", "csv"])]
    show: Option<PathBuf>,
}

/// What begins a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Begin {
    /// Nothing: at once
    Now,
    /// The signal rises to the level
    Rises,
    /// The signal falls to the level
    Falls,
    /// The first object changes; objects only
    Changes,
    /// The state changes; the rest is for signals of the servo tick only
    State,
    /// A fault
    Fault,
    /// A short retreats
    Short,
}

impl Begin {
    fn of_objects(self) -> Option<scope::Trigger> {
        Some(match self {
            Begin::Now => scope::Trigger::Now,
            Begin::Rises => scope::Trigger::Rises,
            Begin::Falls => scope::Trigger::Falls,
            Begin::Changes => scope::Trigger::Changes,
            Begin::State | Begin::Fault | Begin::Short => return None,
        })
    }

    fn of_ticks(self) -> Option<fast::Trigger> {
        Some(match self {
            Begin::Now => fast::Trigger::Now,
            Begin::Rises => fast::Trigger::Rises,
            Begin::Falls => fast::Trigger::Falls,
            Begin::State => fast::Trigger::State,
            Begin::Fault => fast::Trigger::Fault,
            Begin::Short => fast::Trigger::Short,
            Begin::Changes => return None,
        })
    }
}

#[derive(Debug, Args)]
struct BringUpOptions {
    /// Runs the guided check (2001h:3) when all steps before it have passed; the head moves to both ends of its stroke
    #[arg(long)]
    check: bool,
    /// With --check: skip the manual steps, as long as nothing has failed
    #[arg(long, requires = "check")]
    again: bool,
    /// Time for the manual steps; Ctrl-C ends it earlier
    #[arg(long, value_name = "S", default_value = "600", value_parser = seconds, allow_hyphen_values = true)]
    wait: f64,
    /// Folder for the report: a Markdown and a JSON file
    #[arg(long, value_name = "FOLDER")]
    report: Option<PathBuf>,
}

#[derive(Debug, Args)]
struct IdentifyOptions {
    /// Goes to this position below home first; without it the head identifies where it is
    #[arg(long, value_name = "MM", allow_hyphen_values = true)]
    at: Option<f64>,
    /// Makes the values settings: axis.resistance_ohm, axis.inductance_mh, axis.force_constant_n_a, axis.mass_kg, axis.breakaway_n, axis.counterbalance_n
    #[arg(long)]
    take_over: bool,
    #[command(flatten)]
    save: Save,
}

#[derive(Debug, Args)]
struct TuneOptions {
    /// Goes to this position below home first; without it the head tunes where it is
    #[arg(long, value_name = "MM", allow_hyphen_values = true)]
    at: Option<f64>,
    /// Highest bandwidth that is wanted; without it as high as 52 degrees and 8 dB allow
    #[arg(long, value_name = "HZ", allow_hyphen_values = true)]
    bandwidth: Option<f64>,
    /// Writes the proposed gains, and measures again
    #[arg(long)]
    accept: bool,
    /// The same with the gains of Ziegler and Nichols
    #[arg(long, conflicts_with = "accept")]
    accept_ziegler_nichols: bool,
    /// File with the gains of before: written before new ones are, read by --revert
    #[arg(long, value_name = "FILE", default_value = "gains-before.toml")]
    before: PathBuf,
    /// Writes the gains of that file back; nothing moves
    #[arg(long, conflicts_with_all = ["accept", "accept_ziegler_nichols", "at", "bandwidth"])]
    revert: bool,
    #[command(flatten)]
    save: Save,
}

#[derive(Debug, Args)]
struct BoreOptions {
    /// Depth of the electrode below the surface
    #[arg(long, value_name = "MM", allow_hyphen_values = true, required_unless_present = "path")]
    depth: Option<f64>,
    /// Erodes along a G-code program instead: what `cargo sim bore --path` and LinuxCNC take (docs/path.md); Z0 is the surface
    #[arg(long, value_name = "FILE", conflicts_with_all = ["depth", "table"])]
    path: Option<PathBuf>,
    /// Position of the surface below home; without it the surface is touched off
    #[arg(long, value_name = "MM", allow_hyphen_values = true)]
    surface: Option<f64>,
    /// Continues the hole that was begun, measured from its stored surface; after a power cut it is touched before
    #[arg(long = "continue", visible_alias = "resume", conflicts_with_all = ["new_surface", "surface"])]
    continues: bool,
    /// With --continue after a power cut or a new home: what is under the electrode to be touched
    #[arg(long, value_enum, default_value = "bottom", requires = "continues")]
    touched: Touched,
    /// Touches off a new surface although the head has bored before: there is no hole under the electrode
    #[arg(long, conflicts_with = "surface")]
    new_surface: bool,
    /// Height above the surface at which pulses begin
    #[arg(long, value_name = "MM", default_value_t = bore::height(), allow_hyphen_values = true)]
    height: f64,
    #[command(flatten)]
    with: WithOptions,
    /// Technology table, whose rows from rough to fine the head runs, as examples/technology.toml (docs/technology.md)
    #[arg(long, value_name = "FILE")]
    table: Option<PathBuf>,
    /// With --table: the head does not wait, and nobody is asked for Enter, where the generator is to be set differently
    #[arg(long, requires = "table")]
    no_wait: bool,
}

/// Settings that belong to a hole; they stay in the head.
#[derive(Debug, Args)]
struct WithOptions {
    /// Sets jump.every_ms first: time from one jump to the next, 0 for none
    #[arg(long, value_name = "MS", allow_hyphen_values = true)]
    jump_every: Option<f64>,
    /// Sets jump.height_um first
    #[arg(long, value_name = "UM", allow_hyphen_values = true)]
    jump_height: Option<f64>,
    /// Sets end.spark_out_ms first: longest spark-out at the end, 0 for none
    #[arg(long, value_name = "MS", allow_hyphen_values = true)]
    spark_out: Option<f64>,
}

/// Runs a command line.
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    let cli = match Cli::try_parse_from(&arguments) {
        Ok(cli) => cli,
        Err(error) if error.use_stderr() => {
            let why = refusal(&error, &arguments);
            eprintln!("{why}");
            if arguments.iter().any(|argument| argument == "--json") {
                say_failure(&why, BAD_INPUT);
            }
            return ExitCode::from(BAD_INPUT);
        }
        Err(help) => {
            say(&help.to_string());
            return ExitCode::SUCCESS;
        }
    };
    match cli.run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("{failure}");
            let code = if matches!(failure, Failure::BadInput(_)) { BAD_INPUT } else { FAILED };
            if cli.common.json {
                say_failure(&failure.to_string(), code);
            }
            ExitCode::from(code)
        }
    }
}

/// A failure for a program that reads JSON.
fn say_failure(why: &str, code: u8) {
    say(&format!("{}\n", serde_json::json!({ "error": why, "exit": code })));
}

/// What is wrong with a command line and what would be right, in one line as everywhere: what clap adds below is in --help.
fn refusal(error: &clap::Error, arguments: &[OsString]) -> String {
    let text = error.to_string();
    let lines: Vec<&str> = text.lines().take_while(|line| !line.is_empty()).map(str::trim).collect();
    let why = lines.join(" ").trim_start_matches("error: ").to_owned();
    let tips: Vec<&str> = text.lines().filter_map(|line| line.trim().strip_prefix("tip: ")).collect();
    let (path, command) = meant(arguments);
    let commands: Vec<&str> = command.get_subcommands().map(clap::Command::get_name).collect();
    match error.kind() {
        _ if !tips.is_empty() => format!("{why}: {}", tips.join("; ")),
        ErrorKind::InvalidSubcommand | ErrorKind::MissingSubcommand => {
            format!("{why}: the commands of `{path}` are {}", commands.join(", "))
        }
        ErrorKind::UnknownArgument | ErrorKind::MissingRequiredArgument => {
            format!("{why}; `{path} --help` lists what it takes")
        }
        _ => why,
    }
}

/// The command that was meant, as far as it was understood.
fn meant(arguments: &[OsString]) -> (String, clap::Command) {
    let (mut path, mut command) = (String::from("edm-desk"), Cli::command());
    for argument in arguments.iter().skip(1).filter_map(|argument| argument.to_str()) {
        if let Some(next) = command.find_subcommand(argument).cloned() {
            path = format!("{path} {argument}");
            command = next;
        }
    }
    (path, command)
}

impl Cli {
    fn run(&self) -> Result<(), Failure> {
        let common = &self.common;
        let sheet = common.sheet()?;
        let page = Command::Page(Listen::default());
        match self.command.as_ref().unwrap_or(&page) {
            Command::Page(listen) => page::serve(listen, common, &sheet),
            Command::Heads => common.heads(&sheet),
            Command::Name => {
                let mut count = 0;
                lss::name_all(&common.join()?, common.node.unwrap_or(1), |named| {
                    count += 1;
                    common.say(&named, || format!("serial number {} is node {}\n", named.serial, named.node));
                })?;
                if count == 0 && !common.json {
                    say("no head waits for a node-ID\n");
                }
                Ok(())
            }
            Command::Settings(command) => common.settings(&sheet, command),
            Command::Watch { seconds } => {
                let end = end(*seconds);
                let interrupted = interrupted(|| ())?;
                let mut live = Live::new(&common.head(&sheet, Deed::Reads)?)?;
                while Instant::now() < end && !interrupted() {
                    let sample = live.sample()?;
                    common.say(&sample, || watched(&sample));
                    std::thread::sleep(Duration::from_millis(200));
                }
                Ok(())
            }
            Command::Gap { seconds } => {
                let interrupted = interrupted(|| ())?;
                let mut watch = gap::Watch::new(&common.head(&sheet, Deed::Reads)?);
                let end = end(*seconds);
                while Instant::now() < end && !interrupted() {
                    let gap = watch.look()?;
                    common.say(&gap, || gap.text());
                    std::thread::sleep(Duration::from_millis(200));
                }
                Ok(())
            }
            Command::Scope(options) => common.scope(&sheet, options),
            Command::Record { file, seconds } => {
                let interrupted = interrupted(|| ())?;
                let end = end(*seconds);
                let bus = common.join()?;
                let recording = Recording::begin(&bus, &sheet, file)?;
                while Instant::now() < end && !interrupted() && !bus.lost() {
                    std::thread::sleep(Duration::from_millis(50));
                }
                let (frames, path) = (recording.frames(), file.display().to_string());
                common.say(&serde_json::json!({ "file": path, "frames": frames }), || {
                    format!("{frames} frames in {path}\n")
                });
                if bus.lost() {
                    Err(Failure::Failed("the bus was lost; what came before is in the file".into()))
                } else {
                    Ok(())
                }
            }
            Command::Replay { file, play } => common.replay(&sheet, file, *play),
            Command::Log { file: Some(file), .. } => {
                let events =
                    page::events(file).map_err(|why| Failure::BadInput(format!("--file {}: {why}", file.display())))?;
                for event in &events {
                    common.say(event, || {
                        let at = std::time::UNIX_EPOCH + Duration::from_millis(event.unix_ms);
                        let (date, node) = (bring_up::date(at), event.node);
                        let who = if node == 0 { "desk".into() } else { format!("node {node}") };
                        format!("{date}  {who}  {}\n", event.what)
                    });
                }
                Ok(())
            }
            Command::Log { seconds, .. } => {
                let end = end(*seconds);
                let interrupted = interrupted(|| ())?;
                let mut live = Live::new(&common.head(&sheet, Deed::Reads)?)?;
                let began = Event::now(0, EventKind::Program, String::new()).unix_ms;
                while Instant::now() < end && !interrupted() {
                    live.sample()?;
                    for event in live.events() {
                        common.say(&event, || {
                            let seconds = event.unix_ms.saturating_sub(began) as f64 / 1000.0;
                            format!("{seconds:9.3} s  node {}  {}\n", event.node, event.what)
                        });
                    }
                    std::thread::sleep(Duration::from_millis(20));
                }
                Ok(())
            }
            Command::BringUp(options) => common.bring_up(&sheet, options),
            Command::Identify(options) => common.identify(&sheet, options),
            Command::Tune(options) => common.tune(&sheet, options),
            Command::Bore(options) => common.bore(&sheet, options),
            Command::Table { file, load } => common.table(&sheet, file, *load),
            Command::Stop => {
                let bus = common.join()?;
                let all = stop::stop(&bus, &sheet, &BTreeSet::new(), |one| {
                    if !common.json {
                        say(&format!("{}\n", one.text()));
                    }
                });
                common.say(&serde_json::json!({ "stopped": all }), String::new);
                let mut missed: Vec<_> = all.iter().filter(|one| !one.stopped).map(Stopped::text).collect();
                let named = common.node.filter(|node| all.iter().all(|one| one.node != *node));
                missed.extend(named.map(|node| format!("node {node}: no head answers, it was not stopped")));
                if all.is_empty() && missed.is_empty() {
                    missed.push(format!("{}: no head answers, none was stopped", bus.connection()));
                }
                match missed.join("; ") {
                    missed if missed.is_empty() => Ok(()),
                    missed => Err(Failure::Failed(format!("{missed}: switch it off at the machine"))),
                }
            }
            Command::Signals { word } => {
                let word = word.as_deref().unwrap_or_default().to_lowercase();
                let signals: Vec<_> = sheet
                    .objects()
                    .filter(|object| scope::records(object))
                    .filter(|object| format!("{} {}", object.key, object.doc).to_lowercase().contains(&word))
                    .collect();
                let ticks: Vec<_> = fast::signals()
                    .filter(|(name, _, doc)| format!("{name} {doc}").to_lowercase().contains(&word))
                    .collect();
                if signals.is_empty() && ticks.is_empty() {
                    return Err(Failure::BadInput(format!(
                        "{word}: no signal has this word in its name or description"
                    )));
                }
                let of_ticks =
                    ticks.iter().map(|(key, unit, doc)| serde_json::json!({ "key": key, "unit": unit, "what": doc }));
                let json: Vec<_> = of_ticks
                    .chain(signals
                    .iter()
                    .map(|object| {
                        serde_json::json!({ "address": object.address.to_string(), "key": object.key, "unit": object.unit })
                    })
                    ).collect();
                common.say(&json, || {
                    let of_ticks = ticks.iter().map(|(key, unit, doc)| format!("{key:17} {unit:5} {doc}\n"));
                    let objects = signals.iter().map(|object| {
                        let line = format!("{:9} {:40} {}", object.address.to_string(), object.key, object.unit);
                        format!("{}\n", line.trim_end())
                    });
                    of_ticks.chain(objects).collect()
                });
                Ok(())
            }
            Command::Completion { shell } => {
                let mut script = Vec::new();
                clap_complete::generate(*shell, &mut Cli::command(), "edm-desk", &mut script);
                say(&String::from_utf8_lossy(&script));
                Ok(())
            }
            Command::Object { name, value } => common.object(&sheet, name, value.as_deref()),
            Command::Update { file } => {
                let update = Update::read(file)?;
                let mut said = None;
                let outcome = update::update(&common.join()?, common.node(), &update, |doing| {
                    // Not each of a thousand blocks.
                    let now = match doing {
                        Doing::Sending(percent) => Doing::Sending(percent / 10 * 10),
                        other => other,
                    };
                    if said.replace(now) != Some(now) {
                        match now {
                            Doing::Room => {
                                eprintln!("makes room in the flash: up to 8 s, in which the head may not answer")
                            }
                            Doing::Sending(percent) => eprintln!("sent {percent} %"),
                            Doing::Starting => {
                                eprintln!("copies and starts: up to 8 s. Should the power fail, it begins again")
                            }
                        }
                    }
                })?;
                common.say(&outcome, || outcome.text());
                Ok(())
            }
            Command::Reset => {
                let reset = common.head(&sheet, Deed::Moves)?.reset()?;
                common.say(&serde_json::json!({ "reset": reset }), || {
                    if reset { "the fault is reset\n".into() } else { "there was no fault to reset\n".into() }
                });
                Ok(())
            }
        }
    }
}

impl Common {
    fn object(&self, sheet: &Arc<Sheet>, name: &str, value: Option<&str>) -> Result<(), Failure> {
        let object = sheet.named(name).map_err(Failure::BadInput)?;
        let address = object.address;
        let new = value.map(|text| object.parse(text)).transpose().map_err(Failure::BadInput)?;
        let new = new.and_then(|value| object.encode(&value));
        let head = self.head(sheet, new.as_ref().map_or(Deed::Reads, |bytes| Deed::of_writing(address, bytes)))?;
        if let Some(bytes) = new {
            head.sdo.write(address, &bytes)?;
        }
        // A command cannot be read; a domain is long.
        let bytes = match (object.kind, value) {
            (Kind::Domain, _) => head.sdo.read_block(address)?,
            (_, None) => head.sdo.read(address)?,
            (_, Some(text)) => {
                self.say(&serde_json::json!({ "key": object.key, "written": text }), String::new);
                return Ok(());
            }
        };
        let value = object.decode(&bytes).ok_or(SdoError::Garbled(head.node, address))?;
        let json = serde_json::Value::from(&value);
        self.say(
            &serde_json::json!({ "key": object.key, "value": json, "unit": object.unit, "factor": object.factor }),
            || {
                let scale = if object.factor == 1.0 { String::new() } else { format!("x {} ", object.factor) };
                format!("{} = {value} {scale}{}\n", object.key, object.unit)
            },
        );
        Ok(())
    }

    fn replay(&self, sheet: &Arc<Sheet>, file: &Path, play: bool) -> Result<(), Failure> {
        let named = |why: String| Failure::BadInput(format!("{}: {why}", file.display()));
        let text = std::fs::read_to_string(file).map_err(|why| named(why.to_string()))?;
        let frames = trace::read(&text, sheet).map_err(named)?;
        if play {
            let interrupted = interrupted(|| ())?;
            let bus = self.join()?;
            let sent = trace::play(&frames, &bus, || !interrupted() && !bus.lost());
            self.say(&serde_json::json!({ "sent": sent }), || format!("{sent} frames of hosts sent\n"));
            return Ok(());
        }
        let mut reader = trace::Reader::new(sheet);
        for said in frames.iter().flat_map(|frame| reader.take(frame)) {
            self.say(&said, || format!("{:10.3} s  node {}  {}\n", said.at_s, said.node, said.what));
        }
        Ok(())
    }

    fn heads(&self, sheet: &Arc<Sheet>) -> Result<(), Failure> {
        let bus = self.join()?;
        let mut found = find(&bus, sheet);
        found.retain(|one| self.node.is_none_or(|node| node == one.node));
        if found.is_empty() {
            let connection = bus.connection();
            let who = self.node.map_or("no node".into(), |node| format!("no node {node}"));
            return Err(Failure::BadInput(format!(
                "{connection}: {who} answers: check power and bit rate; `edm-desk name` gives node-IDs to heads without one"
            )));
        }
        self.say(&found, || found.iter().map(Found::text).collect());
        Ok(())
    }

    fn settings(&self, sheet: &Arc<Sheet>, command: &Settings) -> Result<(), Failure> {
        // What can be wrong without a head is found before anybody looks for one.
        let (wanted, save) = match command {
            Settings::Set { assignments, save } => {
                (settings::assignments(sheet, assignments).map_err(Failure::BadInput)?, save.save)
            }
            Settings::Import { file, save } => (from_file(sheet, file)?, save.save),
            Settings::Compare { file } => (from_file(sheet, file)?, false),
            Settings::Get { keys } => {
                keys.iter().try_for_each(|key| sheet.readable(key).map(|_| ())).map_err(Failure::BadInput)?;
                (Vec::new(), false)
            }
            Settings::List { .. } | Settings::Export { .. } => (Vec::new(), false),
        };
        let deed = match command {
            Settings::Set { .. } | Settings::Import { .. } => Deed::Sets,
            Settings::List { .. } | Settings::Get { .. } | Settings::Export { .. } | Settings::Compare { .. } => {
                Deed::Reads
            }
        };
        let head = self.head(sheet, deed)?;
        match command {
            Settings::List { word, changed } => {
                let all = settings::read_all(&head)?;
                let word = word.as_deref().unwrap_or_default().to_lowercase();
                let some: Vec<_> = all
                    .iter()
                    .filter(|setting| !changed || setting.changed())
                    .filter(|Setting { object, .. }| {
                        format!("{} {}", object.key, object.doc).to_lowercase().contains(&word)
                    })
                    .collect();
                let lines: Vec<_> = some.iter().map(|setting| setting.line()).collect();
                self.say(&lines, || some.iter().map(|setting| listed(setting)).collect());
            }
            Settings::Get { keys } => {
                let mut lines = Vec::new();
                for key in keys {
                    let object = sheet.readable(key).map_err(Failure::BadInput)?;
                    lines.push(settings::read(&head, object)?);
                }
                let values: Vec<_> = lines.iter().map(Setting::line).collect();
                self.say(&values, || lines.iter().map(listed).collect());
            }
            Settings::Export { file } => {
                let all = settings::read_all(&head)?;
                std::fs::write(file, settings::file(&head.identity, &all))
                    .map_err(|error| Failure::BadInput(format!("{}: {error}", file.display())))?;
                let (count, file) = (all.len(), file.display().to_string());
                self.say(&serde_json::json!({ "file": file, "settings": count }), || {
                    format!("{count} settings of node {} in {file}\n", head.node)
                });
            }
            Settings::Compare { .. } => {
                let all = settings::compare(&head, &wanted)?;
                self.say(&all, || match all.len() {
                    0 => format!("no difference in {} settings\n", wanted.len()),
                    _ => all
                        .iter()
                        .map(|d| {
                            let has = d.head.as_ref().map_or("none".into(), ToString::to_string);
                            format!("{:32} head {has}, file {} {}\n", d.key, d.file, d.unit)
                        })
                        .collect(),
                });
            }
            Settings::Set { .. } | Settings::Import { .. } => {
                let written = settings::write(&head, &wanted)?;
                if save {
                    head.store()?;
                }
                self.say(&written, || {
                    let many = written.changed.len();
                    let kept = if save { " and saved" } else { "; add `--save` to keep them after a reset" };
                    let check = if written.check_again { "; the guided check must pass again" } else { "" };
                    format!("{many} of {} settings changed{kept}{check}\n", wanted.len())
                });
            }
        }
        Ok(())
    }

    fn scope(&self, sheet: &Arc<Sheet>, options: &ScopeOptions) -> Result<(), Failure> {
        let record = self.recorded(sheet, options)?;
        if let Some(file) = &options.csv {
            std::fs::write(file, record.csv()).map_err(|why| Failure::Failed(format!("{}: {why}", file.display())))?;
        }
        self.say(&record, || record.text());
        Ok(())
    }

    fn recorded(&self, sheet: &Arc<Sheet>, options: &ScopeOptions) -> Result<Record, Failure> {
        let ScopeOptions { signals, every, trigger, of, level, pre, nodes, wait, snapshot, last, show, .. } = options;
        let refused = |why: String| Err(Failure::BadInput(why));
        if let Some(file) = show {
            let named = |why: String| Failure::BadInput(format!("{}: {why}", file.display()));
            let bytes = std::fs::read(file).map_err(|error| named(error.to_string()))?;
            return Record::from_csv(&String::from_utf8_lossy(&bytes)).map_err(named);
        }
        if *snapshot {
            let none = || Failure::Failed("the head has no snapshot: no fault since its power came".into());
            return fast::snapshot(&self.head(sheet, Deed::Reads)?)?.ok_or_else(none);
        }
        if *last {
            let none = || Failure::Failed("the head has no record: none is complete since its power came".into());
            return fast::last(&self.head(sheet, Deed::Reads)?)?.ok_or_else(none);
        }
        let interrupted = interrupted(|| ())?;
        let mut tick = || {
            if interrupted() { Err(Failure::Failed("ended before the record was full".into())) } else { Ok(()) }
        };
        if signals.iter().any(|name| fast::has(name)) {
            let Some(trigger) = trigger.of_ticks() else {
                return refused(
                    "trigger changes: must be now, rises, falls, state, fault or short for signals of the servo tick"
                        .into(),
                );
            };
            let plan = fast::Plan {
                signals: signals.clone(),
                every_ms: every.unwrap_or(fast::every()),
                trigger,
                of: of.clone(),
                level: *level,
                before: pre.unwrap_or(fast::before()),
                wait_s: *wait,
            };
            plan.check()?;
            let heads: Vec<Head> = match nodes.as_slice() {
                [] => vec![self.head(sheet, Deed::Reads)?],
                nodes => {
                    let bus = self.join()?;
                    nodes.iter().map(|node| Head::open(&bus, *node, sheet)).collect::<Result<_, _>>()?
                }
            };
            return plan.record(&heads, &mut tick);
        }
        let Some(trigger) = trigger.of_objects() else {
            return refused(
                "this trigger is for signals of the servo tick: must be now, rises, falls or changes for objects"
                    .into(),
            );
        };
        if of.is_some() || pre.is_some() || !nodes.is_empty() {
            return refused(
                "--of, --pre and --nodes are for signals of the servo tick: `edm-desk signals` lists them".into(),
            );
        }
        let every = every.unwrap_or_else(|| scope::every().into());
        if every.fract() != 0.0 || !(0.0..=f64::from(u16::MAX)).contains(&every) {
            return refused(format!("sample period {every} ms: must be 1 to 60000 ms, whole, for objects"));
        }
        let plan = Plan { signals: signals.clone(), every_ms: every as u16, trigger, level: *level, wait_s: *wait };
        plan.check(sheet)?;
        plan.record(&self.head(sheet, Deed::Reads)?, &mut tick)
    }

    fn bring_up(&self, sheet: &Arc<Sheet>, options: &BringUpOptions) -> Result<(), Failure> {
        if let Some(folder) = options.report.as_ref().filter(|folder| !folder.is_dir()) {
            return Err(Failure::BadInput(format!("--report {}: must be a folder", folder.display())));
        }
        let requests = Arc::new(bring_up::Requests::default());
        let asked = requests.clone();
        let interrupted = interrupted(move || asked.want(bring_up::Request::End))?;
        let head = self.head(sheet, Deed::Moves)?;
        let mut live = Live::new(&head)?;
        let bus = head.bus.clone();
        let end = end(Some(options.wait));
        let (mut said, mut doing, mut asked, mut hands_off) = (Vec::new(), String::new(), false, None);
        let report = BringUp {
            head: &head,
            live: &mut live,
            requests: &requests,
            alive: &|| {
                bus.keep_alive(SILENCE);
                Ok(())
            },
            on_progress: &mut |progress| {
                // With --json stdout has the report alone.
                for check in &progress.checks {
                    let verdict = (check.step, check.what.clone(), check.verdict);
                    if !said.contains(&verdict) {
                        said.retain(|(step, what, _)| (*step, what) != (check.step, &check.what));
                        said.push(verdict);
                        eprint!("{}", looked_at(check));
                    }
                }
                // How far a check is comes 20 times a second.
                let now = progress.doing.split(':').next().unwrap_or_default();
                if now != doing {
                    doing = now.into();
                    eprintln!("{}", progress.doing);
                }
                if asked {
                    // One that was refused is not asked for again.
                    if requests.now() == bring_up::Request::Look {
                        requests.want(bring_up::Request::End);
                    }
                } else if (progress.ready() || options.again) && options.check && hands_off.is_none() {
                    hands_off = Some(Instant::now() + HANDS_OFF);
                    let s = HANDS_OFF.as_secs();
                    eprintln!(
                        "the guided check starts in {s} s and moves the head to both ends of its stroke: hands off. Ctrl-C ends it"
                    );
                } else if hands_off.map_or(progress.ready() || Instant::now() >= end, |at| Instant::now() >= at) {
                    asked = true;
                    requests.want(match (options.check, options.again) {
                        (false, _) => bring_up::Request::End,
                        (true, false) => bring_up::Request::Check,
                        (true, true) => bring_up::Request::CheckAgain,
                    });
                }
            },
        }
        .execute()?;
        drop(interrupted);
        if let Some(folder) = &options.report {
            let json = serde_json::to_string_pretty(&report).unwrap_or_default() + "\n";
            for (ending, text) in [("md", report.markdown()), ("json", json)] {
                let file = folder.join(format!("{}.{ending}", report.name()));
                std::fs::write(&file, text).map_err(|why| Failure::Failed(format!("{}: {why}", file.display())))?;
                eprintln!("{}", file.display());
            }
        }
        self.say(&report, || format!("{}\n", report.verdict()));
        let left = if options.check { report.passed } else { report.but_the_check() };
        if left { Ok(()) } else { Err(Failure::Failed(format!("the bring-up is not complete: {}", report.verdict()))) }
    }

    fn identify(&self, sheet: &Arc<Sheet>, options: &IdentifyOptions) -> Result<(), Failure> {
        let interrupted = interrupted(|| ())?;
        let head = self.head(sheet, Deed::Moves)?;
        let mut live = Live::new(&head)?;
        let bus = head.bus.clone();
        let mut doing = String::new();
        let mut outcome = Identify {
            head: &head,
            live: &mut live,
            at_mm: options.at,
            alive: &|| {
                bus.keep_alive(SILENCE);
                if interrupted() { Err(Failure::Failed("ended by Ctrl-C".into())) } else { Ok(()) }
            },
            on_progress: &mut |progress| {
                if progress.doing != doing {
                    doing.clone_from(&progress.doing);
                    eprintln!("{doing}");
                }
            },
        }
        .execute()?;
        if options.take_over {
            identify::take_over(&head)?;
            if options.save.save {
                head.store()?;
            }
            outcome = Identified { values: identify::values(&head)?, taken_over: true, ..outcome };
        }
        self.say(&outcome, || {
            let lines: String = outcome.values.iter().map(identify::Value::text).collect();
            let end = match (options.take_over, options.save.save) {
                (true, true) => "taken over into the settings and saved\n",
                (true, false) => "taken over into the settings; add `--save` to keep them after a reset\n",
                (false, _) => "",
            };
            lines + end
        });
        Ok(())
    }

    fn tune(&self, sheet: &Arc<Sheet>, options: &TuneOptions) -> Result<(), Failure> {
        let file = &options.before;
        let named = |why: String| Failure::BadInput(format!("{}: {why}", file.display()));
        if options.revert {
            let text = std::fs::read_to_string(file).map_err(|why| named(why.to_string()))?;
            let wanted = settings::parse(sheet, &text).map_err(named)?;
            if let Some(other) = wanted.iter().find(|setting| !setting.object.key.starts_with("servo.")) {
                return Err(named(format!("{} is no gain", other.object.key)));
            }
            let head = self.head(sheet, Deed::Moves)?;
            let written = settings::write(&head, &wanted)?;
            if options.save.save {
                head.store()?;
            }
            self.say(&written, || written.said.iter().map(|line| format!("{line}\n")).collect());
            return Ok(());
        }
        let interrupted = interrupted(|| ())?;
        let head = self.head(sheet, Deed::Moves)?;
        let mut live = Live::new(&head)?;
        let bus = head.bus.clone();
        let accepts = options.accept || options.accept_ziegler_nichols;
        if accepts {
            let before: Vec<_> = head
                .sheet
                .settings()
                .filter(|object| object.key.starts_with("servo."))
                .map(|object| settings::read(&head, object))
                .collect::<Result<_, _>>()?;
            std::fs::write(file, settings::file(&head.identity, &before)).map_err(|why| named(why.to_string()))?;
        }
        let mut doing = String::new();
        let run = Tune {
            head: &head,
            live: &mut live,
            at_mm: options.at,
            wanted_hz: options.bandwidth,
            accept: match (options.accept, options.accept_ziegler_nichols) {
                (true, _) => Accept::Proposal,
                (_, true) => Accept::ZieglerNichols,
                _ => Accept::Nothing,
            },
            known: None,
            alive: &|| {
                bus.keep_alive(SILENCE);
                if interrupted() { Err(Failure::Failed("ended by Ctrl-C".into())) } else { Ok(()) }
            },
            on_progress: &mut |progress| {
                if progress.doing != doing {
                    doing.clone_from(&progress.doing);
                    eprintln!("{doing}");
                }
            },
        };
        let outcome = run.execute()?;
        let settles = outcome.step_after.as_ref().is_none_or(|step| step.settled_ms.is_some());
        if outcome.after.is_some() && options.save.save && settles {
            head.store()?;
        }
        self.say(&outcome, || {
            let end = match (&outcome.after, options.save.save) {
                (Some(_), true) if settles => "the new gains are in force and saved",
                (Some(_), true) => "the new gains are in force and not saved",
                (Some(_), false) => "the new gains are in force; `--save` keeps them after a reset",
                (None, _) if accepts || outcome.proposal.is_none() => "nothing was written",
                (None, _) => "nothing was written; `--accept` writes the proposal",
            };
            let back = outcome
                .after
                .as_ref()
                .map(|_| format!("; `edm-desk tune --revert --before {}` writes the old ones back", file.display()));
            outcome.text() + end + &back.unwrap_or_default() + "\n"
        });
        if settles || !options.save.save {
            return Ok(());
        }
        Err(Failure::Failed("not saved: a step does not settle with the new gains".into()))
    }

    fn bore(&self, sheet: &Arc<Sheet>, options: &BoreOptions) -> Result<(), Failure> {
        let site = match (options.continues, options.new_surface) {
            (true, _) => Some(Site::Begun),
            (_, true) => Some(Site::New),
            _ => None,
        };
        let WithOptions { jump_every, jump_height, spark_out } = options.with;
        let with = With { jump_every_ms: jump_every, jump_height_um: jump_height, spark_out_ms: spark_out };
        let depth_mm = options.depth.unwrap_or_default();
        let hole = Hole {
            depth_mm,
            surface_mm: options.surface,
            site,
            touched: options.touched,
            height_mm: options.height,
            with,
            program: None,
            table: None,
        };
        let hole = match &options.path {
            None => hole,
            Some(file) => {
                let named = |why: String| Failure::BadInput(format!("--path {}: {why}", file.display()));
                let text = std::fs::read_to_string(file).map_err(|why| named(why.to_string()))?;
                let name = file.file_name().unwrap_or_default().to_string_lossy();
                hole.along(&name, &text).map_err(|why| named(why.to_string()))?
            }
        };
        hole.check()?;
        let wanted = settings::assignments(sheet, &with.assignments()).map_err(Failure::BadInput)?;
        let hole = match &options.table {
            None => hole,
            Some(file) => {
                let table = table_from(file)?;
                // Where the generator has to be set differently, the head waits.
                hole.by(if options.no_wait { table } else { table.waiting(table::PATIENCE_S) })?
            }
        };
        let requests = Arc::new(Requests::default());
        let asked = requests.clone();
        let _ = interrupted(move || {
            // A second one does not wait for the lift.
            asked.want(if asked.now() == Request::Leave { Request::Stop } else { Request::Leave });
        })?;
        let head = self.head(sheet, Deed::Moves)?;
        let undecided = |why| match why {
            Failure::Undecided { why, begun: true } => Failure::BadInput(format!("{why} --continue, or --new-surface")),
            Failure::Undecided { why, .. } => Failure::BadInput(format!("{why} --new-surface, or --surface MM")),
            why => why,
        };
        let mut live = Live::new(&head)?;
        let bus = head.bus.clone();
        let (mut doing, mut said) = (("", None), Instant::now());
        head.free()?;
        hole.may_begin(&head).map_err(undecided)?;
        settings::write(&head, &wanted)?;
        let table = hole.table.clone();
        let (mut row, mut asks) = (0, false);
        let outcome = Run {
            head: &head,
            live: &mut live,
            hole,
            requests: &requests,
            alive: &|| {
                bus.keep_alive(SILENCE);
                Ok(())
            },
            on_progress: &mut |progress| {
                if let (Some(table), Some(now)) = (&table, &progress.row)
                    && std::mem::replace(&mut row, now.number) != now.number
                    && let Some(row) = table.rows.get(now.number - 1)
                {
                    (asks, doing) = (false, ("", None));
                    eprintln!("{}", begins(row, progress.target_mm));
                }
                let waits = progress.row.as_ref().is_some_and(|now| now.waits);
                if waits && options.no_wait {
                    // A row may ask for it by its own technology.answer_s.
                    requests.generator_is_set();
                } else if waits && !std::mem::replace(&mut asks, true) {
                    eprintln!("set the generator, then press Enter");
                    let requests = requests.clone();
                    std::thread::spawn(move || {
                        let answered = std::io::stdin().read_line(&mut String::new()).is_ok_and(|count| count > 0);
                        if answered { requests.generator_is_set() } else { requests.want(Request::Leave) }
                    });
                }
                let now = (progress.doing, progress.line);
                if now != doing || said.elapsed() > Duration::from_secs(1) {
                    (doing, said) = (now, Instant::now());
                    if self.json {
                        self.say(progress, String::new);
                    } else {
                        eprintln!("{}", on_the_way(progress));
                    }
                }
            },
        }
        .execute()
        .map_err(undecided)?;
        self.say(&outcome, || bored(&outcome));
        if !outcome.reached {
            let what = if options.path.is_some() { "the end of the program" } else { "the depth" };
            return Err(Failure::Failed(format!("{what} was not reached")));
        }
        Ok(())
    }

    /// Checks a table, lists it, and has a head check it too.
    fn table(&self, sheet: &Arc<Sheet>, file: &Path, load: bool) -> Result<(), Failure> {
        let table = table_from(file)?;
        if load {
            let head = self.head(sheet, Deed::Sets)?;
            let named = |why: Failure| Failure::BadInput(format!("{}: {why}", file.display()));
            table::load(&head, &table).map_err(named)?;
        }
        let lines: Vec<table::Line> = table.rows.iter().map(Into::into).collect();
        let whole =
            serde_json::json!({ "electrode": table.electrode, "work": table.work, "loaded": load, "rows": lines });
        self.say(&whole, || {
            let mut text = format!("{} on {}\n", table.electrode, table.work);
            for (number, line) in (1..).zip(&lines) {
                let table::Line { name, leaves_um, undersize_um, generator, settings } = line;
                let undersize = undersize_um.map_or(String::new(), |um| format!(", undersize {um} um a side"));
                text += &format!("{number}  {name}: leaves {leaves_um} um{undersize}\n");
                for (what, values) in [("generator", generator.clone()), ("settings", settings.join(", "))] {
                    if !values.is_empty() {
                        text += &format!("   {what:10} {values}\n");
                    }
                }
            }
            if load {
                text += "the head has it in use: a set point of profile position with 2001h:1 = 1 is a depth\n";
            }
            text
        });
        Ok(())
    }
}

fn table_from(file: &Path) -> Result<File, Failure> {
    let named = |why: String| Failure::BadInput(format!("--table {}: {why}", file.display()));
    let text = std::fs::read_to_string(file).map_err(|why| named(why.to_string()))?;
    table::parse(&text).map_err(named)
}

/// What a row of a table wants, in words.
fn begins(row: &Row, depth_mm: f64) -> String {
    let undersize = row.undersize_um.map_or(String::new(), |um| format!(", undersize {um} um a side"));
    let generator = if row.generator.is_empty() { "as it is" } else { &row.generator };
    format!("row {}: to {:.3} mm; generator: {generator}{undersize}", row.name, depth_mm - row.leaves_um / 1000.0)
}

fn from_file<'a>(sheet: &'a Sheet, path: &Path) -> Result<Vec<Setting<'a>>, Failure> {
    let named = |why: String| Failure::BadInput(format!("{}: {why}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|error| named(error.to_string()))?;
    settings::parse(sheet, &text).map_err(named)
}

fn listed(Setting { object, value }: &Setting<'_>) -> String {
    let changed = match &object.default {
        Some(default) if default != value => format!("  (default {default})"),
        _ => String::new(),
    };
    format!("{:32} {value} {}{changed}\n    {} Allowed: {}.\n", object.key, object.unit, object.doc, object.allowed())
}

fn watched(now: &Sample) -> String {
    let fault = if now.fault_number == 0 { String::new() } else { format!("  {}", now.fault) };
    let number = |value: Option<f64>| value.map_or("-".into(), |value| format!("{value:.1}"));
    format!(
        "{:8.1} s  {:16} {:9.3} mm  gap {:>6} V (set point {:.1} V)  feed {:>7} um/s{fault}\n",
        now.at_ms as f64 / 1000.0,
        now.state,
        now.position_mm,
        number(now.gap_v),
        now.setpoint_v,
        number(now.feed_um_s)
    )
}

fn looked_at(check: &Check) -> String {
    let advice = if check.verdict == Verdict::Passed || check.advice.is_empty() {
        String::new()
    } else {
        format!("\n    {}", check.advice)
    };
    let (step, what, allowed) = (check.step, &check.what, &check.allowed);
    format!("{step:2}  {:8}  {what}: {}; allowed: {allowed}{advice}\n", check.verdict.word(), check.said())
}

fn on_the_way(progress: &bore::Progress) -> String {
    let time = if progress.seconds > 0.0 { format!("{:6.0} s", progress.seconds) } else { String::new() };
    let gap = progress.sample.gap_v.map_or(String::new(), |volts| format!(", gap {volts:.1} V"));
    let left = progress.left_s.map_or(String::new(), |left| format!(", {left:.0} s left at this rate"));
    format!("{time:8}  {}{gap}{left}", progress.said)
}

fn bored(outcome: &Outcome) -> String {
    format!("{}\n", outcome.said)
}

/// Calls this at each Ctrl-C or termination signal; the result says whether there was one.
fn interrupted(then: impl Fn() + Send + 'static) -> Result<impl Fn() -> bool, Failure> {
    let flag = Arc::new(std::sync::atomic::AtomicBool::default());
    let set = flag.clone();
    ctrlc::set_handler(move || {
        set.store(true, std::sync::atomic::Ordering::Relaxed);
        then();
    })
    .map_err(|error| Failure::Failed(format!("no handler for Ctrl-C: {error}")))?;
    Ok(move || flag.load(std::sync::atomic::Ordering::Relaxed))
}

fn end(seconds: Option<f64>) -> Instant {
    Instant::now() + Duration::from_secs_f64(seconds.unwrap_or(1e9))
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|seconds| (0.0..=1e9).contains(seconds));
    seconds.ok_or_else(|| "must be a number from 0 to 1000000000".into())
}
