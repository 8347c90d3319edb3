//! `edm-fil run ELF`: boots a firmware on the emulated chip in a world where nothing happens, and prints its log.

use anyhow::{Context, Result, bail};
use clap::{Parser, Subcommand};
use edm_fil::image::Image;
use edm_fil::machine::Machine;
use edm_fil::rtt::Rtt;
use edm_fil::still::Still;
use edm_soc::TICK_HZ;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

#[derive(Parser)]
#[command(version, about)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Boot a firmware and print its log.
    Run {
        /// The ELF file.
        elf: PathBuf,
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
    },
    /// Instructions and cycles of tasks and functions; writes docs/performance-cycles.md.
    Cycles {
        /// The ELF file.
        elf: PathBuf,
        /// Write the rows here as JSON.
        #[arg(long)]
        json: Option<PathBuf>,
        /// Write no page; fail when a row has grown by more than 5 % over the committed one.
        #[arg(long)]
        check: bool,
        /// Print so many functions of each task, the most expensive first.
        #[arg(long, default_value_t = 0)]
        hot: usize,
    },
    /// Times from pin to pin, loads and lost counts, with the event at many places of a servo tick.
    Latency {
        /// The ELF file.
        elf: PathBuf,
        /// Write the result here as JSON.
        #[arg(long)]
        json: Option<PathBuf>,
        /// Cycles from one offset to the next; 1 sweeps all 8400.
        #[arg(long, default_value_t = 42, value_parser = clap::value_parser!(u64).range(1..=8400))]
        step: u64,
    },
}

/// The committed page.
const PAGE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/performance-cycles.md");

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("error: {e:#}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<()> {
    match Arguments::parse().command {
        Command::Run { elf, seconds, hse, stretch_idle } => boot(&load(&elf)?, seconds, hse, stretch_idle),
        Command::Cycles { elf, json, check, hot } => cycles(&load(&elf)?, json.as_deref(), check, hot),
        Command::Latency { elf, json, step } => latency(&load(&elf)?, json.as_deref(), step),
    }
}

fn load(elf: &Path) -> Result<Image> {
    Image::parse(std::fs::read(elf).with_context(|| format!("cannot read {}", elf.display()))?)
}

fn cycles(image: &Image, json: Option<&Path>, check: bool, hot: usize) -> Result<()> {
    let measured = edm_fil::cycles::report::measure(image)?;
    let page = measured.markdown();
    println!("{page}");
    for (task, functions) in measured.hot.iter().filter(|_| hot > 0) {
        println!("{task}:");
        for (name, cycles) in functions.iter().take(hot) {
            println!("  {cycles:8.1}  {name}");
        }
    }
    for line in measured.over_budget() {
        println!("over budget: {line}");
    }
    if let Some(path) = json {
        let text = serde_json::to_string_pretty(&measured.rows)?;
        std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    if !check {
        return std::fs::write(PAGE, page).context("cannot write docs/performance-cycles.md");
    }
    let committed =
        std::fs::read_to_string(PAGE).context("docs/performance-cycles.md is missing: run cargo fil cycles")?;
    let regressions = measured.regressions(&committed);
    if !regressions.is_empty() {
        bail!("slower than committed:\n  {}", regressions.join("\n  "));
    }
    Ok(())
}

fn latency(image: &Image, json: Option<&Path>, step: u64) -> Result<()> {
    let text = serde_json::to_string_pretty(&edm_fil::latency::measure(image, step)?)?;
    match json {
        Some(path) => std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display())),
        None => {
            println!("{text}");
            Ok(())
        }
    }
}

fn boot(image: &Image, seconds: f64, hse: u64, stretch_idle: u64) -> Result<()> {
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
