//! `cargo fil`: the firmware on an emulated chip.

use anyhow::{Context, Result, bail};
use clap::{Args, Parser, Subcommand};
use edm_fil::image::Image;
use edm_fil::machine::Machine;
use edm_fil::rig::Witness;
use edm_fil::rtt::Rtt;
use edm_fil::still::Still;
use edm_sim::cli::{Bore, EXIT_BAD_INPUT, EXIT_FAILED, Failure};
use edm_sim::observe::Recorder;
use edm_sim::run::{Job, Progress};
use edm_soc::TICK_HZ;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

/// The firmware of the EDM servo head on an emulated STM32F405.
#[derive(Parser)]
#[command(name = "edm-fil", version, about)]
struct Arguments {
    /// The firmware; `cargo fil` builds it and says where it is.
    #[arg(long, value_name = "FILE")]
    elf: PathBuf,
    /// Print the firmware's log.
    #[arg(long)]
    log: bool,
    /// Feed what the chip sees to the native core and stop at the first tick in which they differ.
    #[arg(long)]
    lockstep: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Bore a blind hole, with the options of `cargo sim bore`.
    Bore(Bore),
    /// The head on a CAN bus of this computer, with the options of `cargo sim serve`.
    Serve(edm_sim::serve::Serve),
    /// Boot and print the log, in a world where nothing happens.
    Run(Run),
    /// Record what the chip sees while the head works, backs off and meets faults: for `cargo test` to replay natively.
    Record(Record),
    /// Instructions and estimated cycles of tasks and functions; writes their section of docs/performance.md.
    Cycles(Cycles),
    /// Times from pin to pin, loads and lost counts, with the event at many places of a servo tick.
    Latency(Latency),
}

#[derive(Args)]
struct Record {
    /// The recording.
    #[arg(default_value = RECORDING)]
    file: PathBuf,
    /// Simulated time, seconds; the fault that is going on then is recorded to its end.
    #[arg(long, default_value_t = 1.5)]
    seconds: f64,
}

#[derive(Args)]
struct Cycles {
    /// Write the rows here as JSON.
    #[arg(long)]
    json: Option<PathBuf>,
    /// Write no page; fail when a row has grown by more than 5 % over the committed one.
    #[arg(long)]
    check: bool,
    /// Print so many functions of each task, the most expensive first.
    #[arg(long, default_value_t = 0)]
    hot: usize,
}

#[derive(Args)]
struct Latency {
    /// Write the result here as JSON.
    #[arg(long)]
    json: Option<PathBuf>,
    /// Cycles from one offset to the next; 1 sweeps all 8400.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=8400))]
    step: u64,
    /// Fail when a bound is broken.
    #[arg(long)]
    check: bool,
}

/// The committed recording.
const RECORDING: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/recordings/day.edmr");
/// The page of measurements.
const PAGE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/performance.md");
/// What encloses the section that is generated there.
const BEGIN: &str = "<!-- cargo fil cycles writes this section -->\n";
const END: &str = "<!-- end of what cargo fil cycles writes -->\n";

#[derive(Args)]
struct Run {
    /// Simulated time, seconds.
    #[arg(long, default_value_t = 1.0)]
    seconds: f64,
    /// Crystal, Hz.
    #[arg(long, default_value_t = 8_000_000)]
    hse: u64,
    /// Charge thread mode so many times its cycles once the first interrupt has come: a polling idle loop then costs
    /// less host time, interrupts keep their times.
    #[arg(long, default_value_t = 1)]
    stretch_idle: u64,
    /// Let time pass by blocks of code once the first interrupt has come: faster, a few dozen cycles less exact.
    #[arg(long)]
    blocks: bool,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let done = image(&arguments.elf).and_then(|image| match &arguments.command {
        Command::Run(run) => run.execute(&image).map(|()| true),
        Command::Record(record) => record.execute(&image).map(|()| true),
        Command::Cycles(cycles) => cycles.execute(&image).map(|()| true),
        Command::Latency(latency) => latency.execute(&image).map(|()| true),
        Command::Serve(serve) => edm_fil::serve::serve(&image, arguments.log, serve).map(|()| true).map_err(failed),
        Command::Bore(bore) => {
            let run = |job: &Job, recorder: &mut Recorder, progress: &mut dyn FnMut(&Progress)| {
                edm_fil::rig::bore(&image, arguments.log, arguments.lockstep, job, recorder, progress)
            };
            bore.execute(run).map_err(failed)
        }
    });
    match done {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(EXIT_FAILED),
        Err(error) => {
            eprintln!("edm-fil: {error:#}");
            ExitCode::from(if error.is::<BadInput>() { EXIT_BAD_INPUT } else { EXIT_FAILED })
        }
    }
}

fn failed(failure: Failure) -> anyhow::Error {
    match failure {
        Failure::BadInput(message) => anyhow::Error::new(BadInput(message)),
        Failure::Failed(message) => anyhow::anyhow!(message),
    }
}

/// The person has to change something.
#[derive(Debug)]
struct BadInput(String);

impl std::fmt::Display for BadInput {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for BadInput {}

fn image(elf: &Path) -> Result<Image> {
    Image::parse(std::fs::read(elf).with_context(|| format!("cannot read {}", elf.display()))?)
}

impl Run {
    fn execute(&self, image: &Image) -> Result<()> {
        let Run { seconds, hse, stretch_idle, mut blocks } = *self;
        let mut rtt = Rtt::new(image)?;
        let mut machine = Machine::new(image, Still::default(), hse)?;
        let end = (seconds * TICK_HZ as f64) as u64;
        let start = Instant::now();
        let mut now = 0;
        let mut result = Ok(());
        while now < end && result.is_ok() {
            now = (now + TICK_HZ / 1000).min(end);
            result = machine.run_until(now);
            if machine.stats().entries.iter().any(|n| *n > 0) {
                machine.stretch_idle(stretch_idle);
                if std::mem::take(&mut blocks) {
                    machine.step_by_blocks()?;
                }
            }
            for line in rtt.poll(&machine.soc().memory) {
                println!("{:10.6} {line}", machine.soc().now() as f64 / TICK_HZ as f64);
            }
        }
        let (wall, simulated) = (start.elapsed().as_secs_f64(), machine.soc().now() as f64 / TICK_HZ as f64);
        let stats = machine.stats();
        let awake = 1.0 - stats.asleep as f64 / 2.0 / TICK_HZ as f64 / simulated;
        println!(
            "{simulated:.3} s simulated in {wall:.3} s ({:.2} x real time), {:.1} M instructions ({:.0} MIPS), awake {:.1} %",
            simulated / wall,
            stats.instructions as f64 / 1e6,
            stats.instructions as f64 / 1e6 / wall,
            100.0 * awake
        );
        let entries: Vec<_> =
            stats.entries.iter().enumerate().filter(|e| *e.1 > 0).map(|e| format!("{}:{}", e.0, e.1)).collect();
        println!(
            "exceptions {} (tail-chained {}, nesting {}), resets {}",
            entries.join(" "),
            stats.tail_chained,
            stats.nesting,
            stats.resets
        );
        result
    }
}

impl Record {
    fn execute(&self, image: &Image) -> Result<()> {
        let witness = Witness::Recorder(Box::new(edm_sim::lockstep::Recorder::new(Vec::new())?));
        let (witness, met) = edm_fil::exercise::run(image, self.seconds, witness)?;
        let Witness::Recorder(recorder) = witness else { bail!("the recording is lost") };
        let bytes = recorder.finish()?;
        println!("{} ticks, {} retreats, faults {:?}: {} kB", met.ticks, met.retreats, met.faults, bytes.len() / 1000);
        std::fs::write(&self.file, bytes).with_context(|| format!("cannot write {}", self.file.display()))
    }
}

impl Cycles {
    fn execute(&self, image: &Image) -> Result<()> {
        let measured = edm_fil::cycles::report::measure(image)?;
        let section = measured.markdown();
        println!("{section}");
        for (task, functions) in measured.hot.iter().filter(|_| self.hot > 0) {
            println!("{task}:");
            for (name, cycles) in functions.iter().take(self.hot) {
                println!("  {cycles:8.1}  {name}");
            }
        }
        for line in measured.over_budget() {
            println!("over budget: {line}");
        }
        if let Some(path) = &self.json {
            write(path, &serde_json::to_string_pretty(&measured.rows)?)?;
        }
        let path = Path::new(PAGE);
        let page = std::fs::read_to_string(path).with_context(|| format!("cannot read {PAGE}"))?;
        let sections = page.split_once(BEGIN).and_then(|(before, rest)| Some((before, rest.split_once(END)?)));
        let (before, (committed, after)) = sections.context("docs/performance.md has lost the marks of the section")?;
        if !self.check {
            return write(path, &format!("{before}{BEGIN}{section}{END}{after}"));
        }
        let regressions = measured.regressions(committed);
        if !regressions.is_empty() {
            bail!("slower than committed:\n  {}", regressions.join("\n  "));
        }
        Ok(())
    }
}

impl Latency {
    fn execute(&self, image: &Image) -> Result<()> {
        let latency = edm_fil::latency::measure(image, self.step)?;
        let text = serde_json::to_string_pretty(&latency)?;
        println!("{text}");
        if let Some(path) = &self.json {
            write(path, &text)?;
        }
        let over = latency.over_bounds();
        if self.check && !over.is_empty() {
            bail!("out of bounds:\n  {}", over.join("\n  "));
        }
        over.iter().for_each(|line| println!("out of bounds: {line}"));
        Ok(())
    }
}

fn write(path: &Path, text: &str) -> Result<()> {
    std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
}
