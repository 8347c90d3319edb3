//! The options of `edm-sim serve`.

use super::Links;
use super::fleet::{Fleet, UNCONFIGURED};
use crate::bore;
use crate::inputs::{seed, setup};
use crate::run::Setup;
use crate::terminal::Failure;
use clap::Args;
use edm_servo_head::canopen::NodeId;
use std::path::PathBuf;

/// Arguments of `edm-sim serve`.
#[derive(Debug, Args)]
pub struct Serve {
    /// Connections to the bus.
    #[command(flatten)]
    pub links: Links,
    /// Number of heads on the bus; 0 for a bus without heads
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(0..=127))]
    pub nodes: u8,
    /// Node-ID of the first head, 1 to 127; the others follow. 255: heads wait until a host assigns a node-ID by LSS
    #[arg(long, value_name = "ID", default_value_t = 1, value_parser = node_id)]
    pub node_id: u8,
    /// One node more, behind the heads: a coarse axis that carries them
    #[arg(long)]
    pub coarse_axis: bool,
    /// Scenario by name (`edm-sim scenarios` lists them), or a scenario file
    #[arg(long, value_name = "FILE|NAME", default_value = "default")]
    pub scenario: String,
    /// Change a value after the scenario; may be repeated, the last one counts (`edm-sim settings` lists the keys)
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Random seed; each further head has the next seed
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = seed, allow_hyphen_values = true)]
    pub seed: u64,
    /// Folder for the settings that hosts store; without it they are lost at the end of the program
    #[arg(long, value_name = "FOLDER")]
    pub store: Option<PathBuf>,
    /// Speed: simulated seconds per second
    #[arg(long, value_name = "X", default_value = "1", value_parser = speed, allow_hyphen_values = true)]
    pub speed: f64,
}

impl Serve {
    /// Serves until it is stopped.
    ///
    /// # Errors
    /// When an option is refused, a connection to the bus cannot be opened, or the simulation cannot go on.
    pub fn execute(&self) -> Result<(), Failure> {
        let fleet = self.fleet().map_err(Failure::BadInput)?;
        let heads = match (self.nodes, self.node_id) {
            (0, _) => "A bus without heads".into(),
            (n, UNCONFIGURED) => format!(
                "{n} virtual head{}, without node-ID until a host assigns one by LSS",
                if n == 1 { "" } else { "s" }
            ),
            (1, id) => format!("Virtual head, node {id}"),
            (n, id) => format!("{n} virtual heads, nodes {id} to {}", u16::from(id) + u16::from(n) - 1),
        };
        let heads = match self.coarse_axis {
            true => format!("{heads}, and a coarse axis, node {}", u16::from(self.node_id) + u16::from(self.nodes)),
            false => heads,
        };
        let title =
            format!("{heads} (scenario {}, {} x real time; everything is simulated)", self.scenario, self.speed);
        super::run(&title, &self.links, self.speed, &mut { fleet })
    }

    /// Scenario and assignments, checked.
    ///
    /// # Errors
    /// What is wrong with them.
    pub fn setup(&self) -> Result<Setup, String> {
        let setup = setup(&self.scenario, &self.set)?;
        bore::check(&setup).map_err(|error| setup.refusal(error))?;
        Ok(setup)
    }

    fn fleet(&self) -> Result<Fleet, String> {
        let setup = self.setup()?;
        let last = u16::from(self.node_id) + u16::from(self.nodes) + u16::from(self.coarse_axis);
        if last > 128 && self.node_id != UNCONFIGURED {
            return Err(format!(
                "--nodes {}: must be at most {} from --node-id {} on, because node-IDs end at 127",
                self.nodes,
                128 - u16::from(self.node_id),
                self.node_id
            ));
        }
        let fleet = Fleet::new(&setup, self.node_id, self.nodes, self.seed, self.store.as_deref())?;
        if !self.coarse_axis {
            return Ok(fleet);
        }
        let id = self.node_id.checked_add(self.nodes).and_then(NodeId::new);
        let id = id.ok_or("--coarse-axis: needs --node-id 1 to 127, and room behind the heads")?;
        fleet.carried(id, self.seed.wrapping_add(self.nodes.into()), self.store.as_deref())
    }
}

fn node_id(text: &str) -> Result<u8, String> {
    let id = text.parse().ok().filter(|id| matches!(id, 1..=127 | &UNCONFIGURED));
    id.ok_or_else(|| format!("must be a whole number from 1 to 127, or {UNCONFIGURED}"))
}

fn speed(text: &str) -> Result<f64, String> {
    let speed = text.parse().ok().filter(|speed| (0.01..=100.0).contains(speed));
    speed.ok_or_else(|| "must be a number from 0.01 to 100".into())
}
