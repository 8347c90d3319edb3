//! `edm-sim serve`: virtual heads on a CAN bus, in real time.
//!
//! One thread runs everything that ticks, paced by the clock: it sleeps until the next millisecond or the next frame, then
//! makes the ticks that are due. A frame is taken in the tick after its arrival; what a head sends leaves with the tick. The
//! clients have threads of their own ([`edm_bus`]).
//!
//! Lines on the standard input break wires: `limit.lower_open=true` at every head, `5 gap.short=true` at node 5. The signals
//! are those of the scenario's events.

mod command;
mod console;
mod fleet;
pub mod head;
mod links;
mod real_time;

pub use command::Serve;
pub use fleet::pull;
pub use links::{BIT_RATE, Links};

use crate::terminal::{Failure, say};
use console::Console;
use edm_bus::mailbox::Mailbox;
use edm_bus::{Frame, Hub};
use edm_servo_head::units::TICKS_PER_MS;
use real_time::RealTime;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What runs in real time.
pub trait Plant {
    /// One servo tick: takes the frames that have come since the last, appends those to be sent.
    ///
    /// # Errors
    /// When it cannot go on.
    fn tick(&mut self, came: &[Frame], sent: &mut Vec<Frame>) -> Result<(), String>;
    /// A line from the keyboard.
    ///
    /// # Errors
    /// What is wrong with it.
    fn line(&mut self, line: &str) -> Result<(), String>;
}

/// Silence after a complaint that the computer is too slow.
const COMPLAINT: Duration = Duration::from_secs(10);

/// Runs a plant at so many times the speed of real time, until it is stopped; `title` is printed first.
///
/// # Errors
/// When a connection to the bus cannot be opened, or the plant cannot continue.
pub fn run(title: &str, links: &Links, speed: f64, plant: &mut impl Plant) -> Result<(), Failure> {
    let hub = Hub::default();
    let open = links.open(&hub, &(Arc::new(|text: &str| eprintln!("{text}")) as _))?;
    let mailbox = Arc::new(Mailbox::default());
    let port = hub.attach(mailbox.clone());
    let console = Console::new(&mailbox).map_err(Failure::Failed)?;
    let (mut came, mut sent) = (Vec::new(), Vec::new());
    // Power-on: who connects when the title is there meets heads that have booted, and a boot-up it hears answers its reset.
    for _ in 0..TICKS_PER_MS {
        plant.tick(&[], &mut sent).map_err(Failure::Failed)?;
    }
    sent.drain(..).for_each(|frame| port.send(&frame));
    say(&format!("{title}\n\n  {}\n\nCtrl-C stops the program.\n", open.lines.join("\n  ")));

    let start = Instant::now();
    let (mut real_time, mut looked) = (RealTime::new(start, speed), start);
    let (mut ticks, mut lost_s, mut complained) = (0u64, 0.0, None::<Instant>);
    loop {
        // Asked before the lines are read: those typed before the end are still obeyed.
        let stopped = console.stopped();
        while let Some(line) = console.line() {
            plant.line(line.trim()).unwrap_or_else(|message| eprintln!("{message}"));
        }
        if stopped {
            break;
        }
        looked = Instant::now();
        let due = real_time.due(looked);
        for _ in 0..due.ticks {
            mailbox.take(&mut came);
            plant.tick(&came, &mut sent).map_err(Failure::Failed)?;
            came.clear();
            sent.drain(..).for_each(|frame| port.send(&frame));
        }
        ticks += due.ticks;
        lost_s += due.lost_s;
        if due.lost_s > 0.0 && complained.is_none_or(|last| last.elapsed() > COMPLAINT) {
            complained = Some(Instant::now());
            eprintln!("too slow: {lost_s:.1} s of simulated time lost so far; use fewer nodes or a lower --speed");
        }
        mailbox.wait(real_time.next(Instant::now()));
    }
    let real_s = looked.duration_since(start).as_secs_f64();
    let traffic = hub.traffic();
    let occupancy = 100.0 * traffic.occupancy(Default::default(), real_s, BIT_RATE);
    let simulated_s = ticks as f64 / f64::from(edm_servo_head::units::TICK_HZ);
    say(&format!(
        "Stopped after {simulated_s:.1} s simulated in {real_s:.1} s; {} frames, {occupancy:.1} % of 1 Mbit/s; {} received frames lost\n",
        traffic.frames,
        mailbox.lost(),
    ));
    Ok(())
}
