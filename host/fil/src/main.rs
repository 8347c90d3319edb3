//! `cargo fil`: the firmware on a modelled chip.

use anyhow::{Result, bail};
use clap::{Args, Parser, Subcommand};
use edm_fil::command::{self, BadInput, in_project};
use edm_fil::image::Image;
use edm_fil::machine::Machine;
use edm_fil::rig::Witness;
use edm_fil::rtt::Rtt;
use edm_fil::still::Still;
use edm_fil::wires::CRYSTAL_HZ;
use edm_sim::cli::{Bore, EXIT_BAD_INPUT, EXIT_FAILED, Failure};
use edm_sim::observe::Recorder;
use edm_sim::output::Output;
use edm_sim::run::{Job, Progress};
use edm_sim::terminal::one_line;
use edm_soc::TICK_HZ;
use rustix::time::{ClockId, clock_gettime};
use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// The firmware of the EDM servo head on a modelled STM32F405.
#[derive(Parser)]
#[command(name = "edm-fil", version, about)]
struct Arguments {
    /// ELF file of the firmware; `cargo fil` builds it and gives its path.
    #[arg(long, value_name = "FILE")]
    elf: PathBuf,
    /// Print the firmware's log.
    #[arg(long)]
    log: bool,
    /// Run the native core in lockstep with the chip, and stop at the first difference.
    #[arg(long)]
    lockstep: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Bore a blind hole, with the options of `cargo sim bore`.
    Bore(Bore),
    /// Serve the head on a CAN bus of this computer, with the options of `cargo sim serve`.
    Serve(edm_sim::serve::Serve),
    /// Boot and print the log, with constant inputs.
    Run(Run),
    /// Record the inputs of the chip while the head erodes, retreats and has faults; `cargo test` replays the recording natively.
    Record(Record),
    /// Measure instructions and estimated cycles of tasks and functions; writes their section of docs/performance.md.
    Cycles(command::Cycles),
    /// Inject faults into wires, chip, bus, memories and settings one by one (docs/robustness.md).
    Faults(edm_fil::faults::Faults),
    /// Measure times from pin to pin, loads and lost counts, with events at many offsets in a servo tick.
    Latency(Latency),
}

#[derive(Args)]
struct Record {
    /// File of the recording [default: that of the project]
    file: Option<PathBuf>,
    /// Simulated time, seconds; a fault in progress at the end is recorded to its end.
    #[arg(long, default_value_t = 1.5, value_parser = seconds)]
    seconds: f64,
}

#[derive(Args)]
struct Latency {
    /// Write the result as JSON.
    #[arg(long)]
    json: Option<PathBuf>,
    /// Cycles from one offset to the next; 1 sweeps all 8400.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=8400))]
    step: u64,
    /// Fail when a bound is exceeded.
    #[arg(long)]
    check: bool,
}

/// The committed recording.
const RECORDING: &str = "tests/recordings/day.edmr";
/// Seed of the process that is recorded.
const SEED: u64 = 1;

#[derive(Args)]
struct Run {
    /// Simulated time, seconds.
    #[arg(long, default_value_t = 1.0, value_parser = seconds)]
    seconds: f64,
}

fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) if !error.use_stderr() => {
            print!("{error}");
            return ExitCode::SUCCESS;
        }
        Err(error) => {
            eprintln!("edm-fil: {}", one_line("edm-fil", &error.to_string()));
            return ExitCode::from(EXIT_BAD_INPUT);
        }
    };
    let done = image(&arguments.elf).and_then(|image| match &arguments.command {
        Command::Run(run) => run.execute(&image).map(|()| true),
        Command::Record(record) => record.execute(&image).map(|()| true),
        Command::Cycles(cycles) => cycles.execute(&image).map(|()| true),
        Command::Latency(latency) => latency.execute(&image).map(|()| true),
        Command::Faults(faults) => faults.execute(&image, arguments.log),
        Command::Serve(serve) => edm_fil::serve::serve(&image, arguments.log, serve).map(|()| true).map_err(failed),
        Command::Bore(bore) => {
            let spent = Cell::new(None);
            let run = |job: &Job, recorder: &mut Recorder, progress: &mut dyn FnMut(&Progress)| {
                let start = cpu_time();
                let outcome = edm_fil::rig::bore(&image, arguments.log, arguments.lockstep, job, recorder, progress)?;
                spent.set(Some((outcome.sim_time_s, (cpu_time() - start).as_secs_f64())));
                Ok(outcome)
            };
            let done = bore.execute(run).map_err(failed);
            if let (Some((simulated, cpu)), false) = (spent.get(), bore.quiet) {
                let ratio = simulated / cpu;
                println!("  {:<12} {ratio:.2} simulated seconds per second of processor time ({cpu:.1} s)", "Speed");
            }
            done
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

/// Processor time of this program, without other programs.
fn cpu_time() -> Duration {
    let spent = clock_gettime(ClockId::ProcessCPUTime);
    Duration::new(spent.tv_sec.unsigned_abs(), spent.tv_nsec.unsigned_abs() as u32)
}

/// A time that a run may last.
fn seconds(text: &str) -> Result<f64, String> {
    let allowed = |s: &f64| (0.0..=1e6).contains(s);
    text.parse().ok().filter(allowed).ok_or_else(|| "must be a number of seconds from 0 to 1000000".to_owned())
}

fn failed(failure: Failure) -> anyhow::Error {
    match failure {
        Failure::BadInput(message) => anyhow::Error::new(BadInput(message)),
        Failure::Failed(message) => anyhow::anyhow!(message),
    }
}

fn image(elf: &Path) -> Result<Image> {
    let file = std::fs::read(elf).map_err(|e| BadInput(format!("--elf: cannot read {}: {e}", elf.display())))?;
    Image::parse(file).map_err(|e| BadInput(format!("--elf: {}: {e:#}", elf.display())).into())
}

impl Run {
    fn execute(&self, image: &Image) -> Result<()> {
        let mut rtt = Rtt::new(image)?;
        let mut machine = Machine::new(image, Still::default(), CRYSTAL_HZ)?;
        let end = (self.seconds * TICK_HZ as f64) as u64;
        let start = Instant::now();
        let mut now = 0;
        let mut result = Ok(());
        while now < end && result.is_ok() {
            now = (now + TICK_HZ / 1000).min(end);
            result = machine.run_until(now);
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
        let file = self.file.clone().map_or_else(|| in_project(Path::new(RECORDING)), Ok)?;
        let output = Output::claim("the recording", &file).map_err(BadInput)?;
        let witness = Witness::Recorder(Box::new(edm_sim::lockstep::Recorder::new(Vec::new())?));
        let (witness, met) = edm_fil::exercise::run(image, self.seconds, SEED, witness)?;
        let Witness::Recorder(recorder) = witness else { bail!("the recording is lost") };
        let bytes = recorder.finish()?;
        println!("{} ticks, {} retreats, faults {:?}: {} kB", met.ticks, met.retreats, met.faults, bytes.len() / 1000);
        output.write(|to| to.write_all(&bytes)).map_err(|e| anyhow::anyhow!(e))
    }
}

impl Latency {
    fn execute(&self, image: &Image) -> Result<()> {
        let output = Output::claim_any("--json", self.json.as_deref()).map_err(BadInput)?;
        let latency = edm_fil::latency::measure(image, self.step)?;
        println!("{}", serde_json::to_string_pretty(&latency)?);
        if let Some(output) = output {
            output.write_json(&latency).map_err(|e| anyhow::anyhow!(e))?;
        }
        let over = latency.over_bounds();
        if self.check && !over.is_empty() {
            bail!("bounds exceeded:\n  {}", over.join("\n  "));
        }
        over.iter().for_each(|line| println!("bound exceeded: {line}"));
        Ok(())
    }
}
