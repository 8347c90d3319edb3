//! A server of virtual heads, killed in the end.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

/// `edm-sim serve` or `edm-fil serve`, as EDM_SIM says, with slcan by network.
pub struct Server {
    process: Child,
    /// Where it listens.
    pub address: String,
}

impl Server {
    /// Starts it with these options besides.
    pub fn new(options: &[&str]) -> Server {
        let program = std::env::var("EDM_SIM").expect("EDM_SIM names the program; tests/hosts/run sets it");
        let mut words = program.split_whitespace();
        let mut process = Command::new(words.next().expect("EDM_SIM names a program"))
            .args(words)
            .args(["serve", "--slcan-tcp", "127.0.0.1:0"])
            .args(options)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let lines = BufReader::new(process.stdout.take().unwrap()).lines();
        let address = lines
            .map_while(Result::ok)
            .find_map(|line| line.split("socket://").nth(1).map(str::to_owned))
            .expect("it did not start");
        Server { process, address }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
