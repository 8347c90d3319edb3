//! `edm-sim serve` as a program: it starts, talks, and stops.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

/// Time after which a test hangs.
const HANGS: Duration = Duration::from_secs(300);

struct Server {
    process: Child,
    stdin: Option<ChildStdin>,
    stdout: BufReader<ChildStdout>,
    address: String,
}

impl Server {
    fn new(options: &[&str]) -> Server {
        let mut process = command(&["--slcan-tcp", "127.0.0.1:0"])
            .args(options)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut stdout = BufReader::new(process.stdout.take().unwrap());
        let mut address = String::new();
        while !address.contains("socket://") {
            address.clear();
            assert!(stdout.read_line(&mut address).unwrap() > 0, "it did not start");
        }
        let address = address.split("socket://").nth(1).unwrap().trim().to_owned();
        Server { stdin: process.stdin.take(), process, stdout, address }
    }

    fn client(&self) -> Client {
        let stream = TcpStream::connect(&self.address).unwrap();
        stream.set_read_timeout(Some(HANGS)).unwrap();
        let mut client = Client(BufReader::new(stream));
        client.send("O");
        assert_eq!(client.line(), "");
        client
    }

    fn tell(&mut self, line: &str) {
        self.stdin.as_mut().unwrap().write_all(format!("{line}\n").as_bytes()).unwrap();
    }

    /// Closes its input; what it said on stdout and stderr.
    fn stop(mut self) -> (String, String) {
        drop(self.stdin.take());
        let (mut said, mut complained) = (String::new(), String::new());
        self.stdout.read_to_string(&mut said).unwrap();
        self.process.stderr.take().unwrap().read_to_string(&mut complained).unwrap();
        assert!(self.process.wait().unwrap().success(), "{complained}");
        (said, complained)
    }
}

struct Client(BufReader<TcpStream>);

impl Client {
    fn send(&mut self, line: &str) {
        self.0.get_mut().write_all(format!("{line}\r").as_bytes()).unwrap();
    }

    fn line(&mut self) -> String {
        let mut line = Vec::new();
        self.0.read_until(b'\r', &mut line).unwrap();
        assert_eq!(line.pop(), Some(b'\r'), "the connection has ended");
        String::from_utf8(line).unwrap()
    }

    /// The next line that begins so.
    fn expect(&mut self, beginning: &str) -> String {
        let end = Instant::now() + HANGS;
        while Instant::now() < end {
            let line = self.line();
            if line.starts_with(beginning) {
                return line;
            }
        }
        panic!("no {beginning}");
    }
}

fn command(options: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_edm-sim"));
    command.arg("serve").args(options);
    command
}

#[test]
fn a_head_answers_boots_again_and_stops_when_its_input_is_closed() {
    let server = Server::new(&["--node-id", "5"]);
    let mut client = server.client();
    client.send("t60584018100000000000");
    assert_eq!(client.expect("t585"), "t58584F18100004000000");
    client.send("t00028105");
    assert_eq!(client.expect("t7051"), "t705100", "boot-up after the reset");
    let (said, complained) = server.stop();
    assert!(said.contains("Stopped after ") && said.contains(" frames, "), "{said}");
    assert!(complained.lines().all(|line| line.starts_with("too slow: ")), "{complained}");
    client.0.read_to_end(&mut Vec::new()).expect("the connection has ended");
}

#[test]
fn a_line_that_is_wrong_is_answered_and_nothing_stops() {
    let mut server = Server::new(&[]);
    server.tell("limit.lower=true");
    server.tell("gap.short=true");
    server.tell("9 gap.short=true");
    let mut client = server.client();
    client.send("t60184018100000000000");
    client.expect("t581");
    let (_, complained) = server.stop();
    let lines: Vec<&str> = complained.lines().filter(|line| !line.starts_with("too slow: ")).collect();
    let unknown = "limit.lower: no such signal, did you mean limit.lower_open?; `edm-sim settings` lists all";
    assert_eq!(lines, [unknown, "9: no such node on this bus"]);
}

#[test]
fn lines_typed_before_the_end_are_all_answered() {
    let mut server = Server::new(&[]);
    (2..102).for_each(|node| server.tell(&format!("{node} gap.short=true")));
    let (_, complained) = server.stop();
    let answers: Vec<String> = (2..102).map(|node| format!("{node}: no such node on this bus")).collect();
    let lines: Vec<&str> = complained.lines().filter(|line| !line.starts_with("too slow: ")).collect();
    assert_eq!(lines, answers);
}

#[test]
fn three_heads_share_the_bus_with_a_load_and_five_times_the_speed() {
    let server = Server::new(&["--nodes", "3", "--speed", "5", "--load", "50"]);
    let mut client = server.client();
    for node in 1..=3 {
        client.send(&format!("t60{node}84018100000000000"));
        client.expect(&format!("t58{node}84F181000"));
    }
    // A heartbeat each 10 ms of simulated time, and a hundred of them.
    client.send("t60182B1710000A000000");
    client.expect("t5818601710");
    for _ in 0..=100 {
        client.expect("t7011");
    }
    let (said, complained) = server.stop();
    let words: Vec<&str> = said.split_whitespace().collect();
    let after = |word: &str, nth: usize| -> f64 {
        let at = words.iter().position(|w| *w == word).unwrap() + nth;
        words[at].trim_end_matches(',').parse().unwrap()
    };
    let (simulated, real, load) = (after("after", 1), after("in", 1), after("frames,", 1));
    assert!(simulated > 0.9 && load > 0.0, "{said}");
    // Both are those of its last look at the clock, to a tenth of a second: half of one, and five times that.
    let ahead = simulated - 5.0 * real;
    assert!(ahead <= 0.31, "{said}");
    // A computer that cannot keep up says so.
    assert!(ahead >= -0.31 || complained.contains("too slow: "), "{said}{complained}");
}

#[test]
fn what_cannot_be_is_refused_in_one_line() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    for (options, part) in [
        (&["--nodes", "2", "--node-id", "127"][..], "--nodes 2: must be at most 1 from --node-id 127 on"),
        (&["--nodes", "128"], "128"),
        (&["--node-id", "0"], "0"),
        (&["--speed", "0"], "must be a number from 0.01 to 100"),
        (&["--speed", "nan"], "must be a number from 0.01 to 100"),
        (&["--load", "101"], "must be a number from 0 to 100"),
        (&["--scenario", "defualt"], "did you mean default?"),
        (&["--set", "gap.setpoint_v=0"], "must be a number from 1 to 300 V"),
        (&["--slcan-tcp", &address], "must be a free HOST:PORT"),
        (&["--slcan-tcp", "nonsense"], "must be a free HOST:PORT"),
        (&["--socketcand", &address], "must be a free HOST:PORT"),
        (&["--slcan-pty", "/"], "--slcan-pty /: cannot be made"),
        (&["--socketcan", "nocan7"], "--socketcan nocan7: "),
        (&["--store", "/dev/null/x"], "--store /dev/null/x: cannot be made"),
    ] {
        let output = command(options).stdin(Stdio::null()).output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{options:?}: {stderr}");
        assert_eq!(stderr.trim_end().lines().count(), 1, "{stderr}");
        assert!(stderr.contains(part), "{options:?}: {part:?} is not in {stderr}");
        assert!(output.stdout.is_empty());
    }
}
