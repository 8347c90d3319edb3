//! A whole head in one thread: what the tasks of the firmware do, one after the other.

use super::command::{Command, Refused};
use super::commissioning::{Finding, Report};
use super::config::Config;
use super::estimate::Estimate;
use super::fault::Fault;
use super::follow::Follower;
use super::permit::WritePermit;
use super::plan::Plan;
use super::planner::Planner;
use super::probe::ProbeInputs;
use super::state::Change;
use super::supervise::Measured;
use super::supervise::{Counters, Supervisor};
use super::tick::{TickInput, TickOutput};
use super::{Status, SupervisionConfig};
use crate::encoder::Snapshot;
use crate::gap::{GapReading, Quality};
use crate::path::Path;
use crate::units::TICKS_PER_MS;
use core::ops::DerefMut;
use edm_hal_shim::encoder::RawCount;
use edm_hal_shim::reflex::PulseCounts;
use edm_hal_shim::safety::{DriveCodes, SafetyInputs};
use edm_hal_shim::self_test::SelfTest;

/// Everything that the tasks of a head see in a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Inputs {
    /// Newest gap reading.
    pub gap: GapReading,
    /// The count that the loops use, illegal transitions and marks.
    pub encoder: Snapshot,
    /// Second counter on the same lines, where both are wired.
    pub watch: Option<RawCount>,
    /// What the pulses have done.
    pub pulses: PulseCounts,
    /// Motor current and bus voltage are not converted.
    pub drive_stands: bool,
    /// Safety inputs, if any of them is unsafe.
    pub safety: Option<SafetyInputs>,
    /// Motor current and bus voltage.
    pub drive: DriveCodes,
    /// The reflex has begun a retreat since the tick before.
    pub reflex: bool,
    /// A host has given a life sign.
    pub host_alive: bool,
}

/// Estimate, plan, follow, and the supervision. A plan is made in the tick of its estimate, and comes into force when it does
/// in the firmware.
#[derive(Debug)]
pub struct Head<P> {
    follower: Follower,
    planner: Planner<P>,
    supervisor: Supervisor,
    estimate: Estimate,
    plan: Plan,
    measured: Measured,
    /// A fault for the next tick, and whether a plan is requested.
    reported: Option<Fault>,
    asked: bool,
    status: Status,
}

impl<P: DerefMut<Target = Path>> Head<P> {
    /// A disabled head on an empty path, on a board that has passed its self-test.
    pub fn new(config: Config, path: P) -> Head<P> {
        let planner = Planner::new(config, path, SelfTest::PASSED);
        Head {
            follower: Follower::new(planner.follow_config()),
            planner,
            supervisor: Supervisor::default(),
            estimate: Estimate::default(),
            plan: Plan::DISABLED,
            measured: Measured::default(),
            reported: None,
            asked: false,
            status: Status::default(),
        }
    }

    /// What is known after the last tick.
    pub fn status(&self) -> &Status {
        &self.status
    }

    /// The plan in force: its state is what the outputs belong to, [`LEAD`](super::LEAD) ticks behind that of the status.
    pub fn in_force(&self) -> &Plan {
        self.follower.plan()
    }

    /// What is run.
    pub fn config(&self) -> &Config {
        self.planner.config()
    }

    /// A host has stepped, positive toward the work.
    pub fn step(&mut self, steps: i32) {
        self.planner.step(steps);
    }

    /// One servo tick.
    pub fn tick(&mut self, inputs: &Inputs) -> TickOutput {
        let input = TickInput {
            encoder: inputs.encoder.raw,
            short_ticks: inputs.gap.short_ticks,
            touches: inputs.gap.touches,
            sight: ProbeInputs {
                mark: inputs.encoder.mark,
                block: (inputs.gap.quality == Quality::Valid).then_some(inputs.gap.block),
            },
            gap: (inputs.gap.quality == Quality::Valid).then_some(inputs.gap.filtered),
            drive: inputs.drive,
            safety: inputs.safety,
            reflex: inputs.reflex,
            reported: self.reported.take(),
            set_point: None,
            asked: core::mem::take(&mut self.asked) | self.reported.is_some(),
        };
        let plan = &self.plan;
        let output = self.follower.tick(&input, |generation| (plan.generation == generation).then_some(plan));
        if output.hands_over {
            self.follower.estimate(&mut self.estimate, &inputs.gap, inputs.gap.quality, &inputs.encoder.mark);
            self.planner.watch(self.supervisor.monitored());
            self.planner.begin(&self.estimate);
            self.planner.plan(&mut self.plan);
        }
        if self.follower.number().is_multiple_of(TICKS_PER_MS) {
            self.supervise(&input, inputs);
        }
        self.report();
        output
    }

    fn supervise(&mut self, input: &TickInput, inputs: &Inputs) {
        let Inputs { encoder: used, watch, pulses, drive_stands, .. } = *inputs;
        let counters = Counters { used, watch, pulses, drive_stands };
        self.follower.measured(&mut self.measured, input, &inputs.gap, inputs.gap.quality);
        let config = self.supervision();
        if let Some(fault) = self.supervisor.tick(&config, &self.measured, &counters, inputs.host_alive) {
            self.raise(fault);
        }
    }

    fn report(&mut self) {
        self.status = *self.planner.status();
        self.follower.report(&mut self.status);
    }

    /// Carries out a command, or refuses it and changes nothing. What it changes comes into force with the next plan.
    ///
    /// # Errors
    /// Why it was refused.
    pub fn command(&mut self, command: Command) -> Result<(), Refused> {
        let result = self.planner.command(command);
        self.asked = true;
        self.report();
        result
    }

    /// Swaps the configuration.
    ///
    /// # Errors
    /// As [`Planner::configure`].
    pub fn configure(&mut self, config: Config) -> Result<(), Refused> {
        self.planner.configure(config)?;
        self.follower.configure(&self.planner.follow_config());
        self.asked = true;
        Ok(())
    }

    /// A fault found elsewhere; the next tick acts on it.
    pub fn raise(&mut self, fault: Fault) {
        self.reported = Some(fault);
        self.asked = true;
    }

    /// What the supervision judges by.
    pub fn supervision(&self) -> SupervisionConfig {
        self.planner.supervision()
    }

    /// Oldest change of state not read yet.
    pub fn next_change(&mut self) -> Option<Change> {
        self.planner.next_change()
    }

    /// Result of the last commissioning.
    pub fn commissioning_result(&self) -> Option<Result<Report, Finding>> {
        self.planner.commissioning_result()
    }

    /// As [`Planner::permit_write`].
    ///
    /// # Errors
    /// As there.
    pub fn permit_write(&mut self) -> Result<WritePermit, Refused> {
        self.planner.permit_write()
    }

    /// As [`Planner::end_write`].
    pub fn end_write(&mut self, permit: WritePermit) {
        self.planner.end_write(permit);
    }
}
