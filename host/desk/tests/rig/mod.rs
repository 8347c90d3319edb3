//! A bus with a virtual head in this process, at twice real time, and the program beside it. What a head is in truth is looked
//! at in the model, not asked over the bus.

pub mod paced;

use edm_bus::client::Report;
use edm_bus::hub::{Detached, Sink};
use edm_bus::mailbox::Mailbox;
use edm_bus::slcan::Slcan;
use edm_bus::tcp::Listener;
use edm_bus::{Frame, Hub, Port};
use edm_desk::bus::Bus;
use edm_servo_head::canopen::NodeId;
use edm_servo_head::head::{Fault, State};
use edm_servo_head::settings::Value as Setting;
use edm_sim::process::Pulses;
use edm_sim::run::Setup;
use edm_sim::serve::head::Head;
use edm_sim::store::Store;
use embedded_can::{Frame as _, Id, StandardId};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Condvar, Mutex, OnceLock};
use std::thread;
use std::time::{Duration, Instant};
use tungstenite::{Message, WebSocket};

/// Simulated seconds a second.
const SPEED: u32 = 2;
/// Servo ticks a millisecond.
const TICKS: u32 = 20;
/// What takes longer hangs.
const PATIENCE: Duration = Duration::from_secs(240);

/// What the head is.
#[derive(Clone, Copy, Debug)]
pub struct Truth {
    pub state: State,
    pub fault: Option<Fault>,
    pub reacting: bool,
    pub pulses: bool,
    /// There were pulses once.
    pub pulsed: bool,
    pub position: i64,
    pub deepest: i64,
    /// Pulses that the process made, as the summary of a bore counts them.
    pub made: Pulses,
}

type Seen = (Mutex<Option<Truth>>, Condvar);

/// A bus with a head on it, node 1.
pub struct Rig {
    listener: Option<Listener>,
    connection: String,
    /// By place: the head that tests look into first, a second one beside it.
    seen: Vec<Arc<Seen>>,
    stop: Arc<AtomicBool>,
    wires: Sender<(&'static str, f64)>,
    _stranger: Option<Port>,
}

/// A head that goes on until it is stopped: what it is, and its wires.
fn turn(
    hub: &Hub,
    node: Option<NodeId>,
    stop: &Arc<AtomicBool>,
    machine: &'static [&'static str],
) -> (Arc<Seen>, Sender<(&'static str, f64)>) {
    let (seen, ends) = (Arc::new(Seen::default()), stop.clone());
    let mailbox = Arc::new(Mailbox::default());
    let port = hub.attach(mailbox.clone());
    let told = seen.clone();
    let (wires, pulled) = channel::<(&str, f64)>();
    thread::spawn(move || {
        let mut setup = Setup::load("default").unwrap();
        machine.iter().for_each(|assignment| setup.set(assignment).unwrap());
        let store = Store::new(None, "node-1").unwrap();
        let mut head = Head::new(&setup, (node, 1), 1, store).unwrap();
        let (mut came, mut sent, mut deepest, mut pulsed) = (Vec::new(), Vec::new(), 0, false);
        let (mut due, mut cut) = (Instant::now(), false);
        while !ends.load(Ordering::Relaxed) {
            // A computer that is too slow makes simulated time slower.
            due = due.max(Instant::now() - Duration::from_millis(20)) + Duration::from_millis(1) / SPEED;
            mailbox.take(&mut came);
            for (signal, value) in pulled.try_iter() {
                if signal == "cable.cut" {
                    cut = value != 0.0;
                    continue;
                }
                if signal == "power.cut" {
                    head = head.cut_power(value).unwrap();
                    continue;
                }
                let number = head.process.happen(signal, Setting::Number(value));
                // A flag, where it is no number.
                number.or_else(|_| head.process.happen(signal, Setting::Flag(value != 0.0))).unwrap();
            }
            for tick in 0..TICKS {
                let frames: &[Frame] = if tick == 0 && !cut { &came } else { &[] };
                head.tick(frames.iter(), &mut sent);
                sent.drain(..).filter(|_| !cut).for_each(|frame| port.send(&frame));
            }
            came.clear();
            let status = head.status();
            deepest = deepest.max(status.position);
            pulsed |= head.pulses();
            *told.0.lock().unwrap() = Some(Truth {
                state: status.state,
                fault: status.fault,
                reacting: status.reacting,
                pulses: head.pulses(),
                pulsed,
                position: status.position,
                deepest,
                made: head.process.truth().pulses,
            });
            told.1.notify_all();
            while Instant::now() < due {
                mailbox.wait(due);
            }
        }
    });
    (seen, wires)
}

impl Rig {
    pub fn new() -> Rig {
        Rig::at("127.0.0.1:0")
    }

    /// Where others find its bus.
    pub fn at(address: &str) -> Rig {
        Rig::of(address, &[NodeId::new(1)], &[])
    }

    /// On a machine with an upper limit switch and an index mark below it, which is home.
    pub fn with_a_mark() -> Rig {
        const MACHINE: &[&str] = &["limit.upper_mm=0.1", "scale.mark_mm=0.5", "encoder.mark_distance_um=500"];
        Rig::of("127.0.0.1:0", &[NodeId::new(1)], MACHINE)
    }

    /// With a head that waits for a node-ID.
    pub fn unnamed() -> Rig {
        Rig::of("127.0.0.1:0", &[None], &[])
    }

    /// With a second head beside it, of this node-ID.
    pub fn with_second(node: u8) -> Rig {
        Rig::of("127.0.0.1:0", &[NodeId::new(1), NodeId::new(node)], &[])
    }

    fn of(address: &str, nodes: &[Option<NodeId>], machine: &'static [&'static str]) -> Rig {
        let hub = Hub::default();
        let stop = Arc::new(AtomicBool::default());
        let heads: Vec<_> = nodes.iter().map(|node| turn(&hub, *node, &stop, machine)).collect();
        let (seen, wires): (Vec<_>, Vec<_>) = heads.into_iter().unzip();
        let wires = wires.into_iter().next().unwrap();
        let listener = Listener::new(&hub, address, || Box::new(Slcan::default()), quiet()).unwrap();
        let connection = format!("socket://{}", listener.address());
        let rig = Rig { listener: Some(listener), connection, seen, stop, wires, _stranger: None };
        rig.until(|_| true);
        rig
    }

    /// With a node that is an input and output device (CiA 401).
    pub fn with_stranger(node: u8) -> Rig {
        let mut rig = Rig::new();
        let hub = Hub::default();
        let connection: edm_bus::Connection = rig.connection.parse().unwrap();
        let joined = connection.join(&hub, 1_000_000, &quiet()).unwrap();
        let stranger = Arc::new(Stranger { node, answers: OnceLock::new(), _joined: joined });
        let (sender, answers) = std::sync::mpsc::channel();
        stranger.answers.set(Mutex::new(sender)).unwrap();
        rig._stranger = Some(hub.attach(stranger));
        let says = hub.attach(Arc::new(Mailbox::default()));
        thread::spawn(move || answers.iter().for_each(|frame| says.send(&frame)));
        rig
    }

    /// Pulls a wire of the machine (`cargo sim settings` lists them); of a flag 1 is true.
    pub fn happen(&self, signal: &'static str, value: f64) {
        self.wires.send((signal, value)).unwrap();
    }

    pub fn connection(&self) -> String {
        self.connection.clone()
    }

    /// This process on the bus.
    pub fn bus(&self) -> Bus {
        Bus::join(&self.connection.parse().unwrap(), 1_000_000, 126, &quiet()).unwrap()
    }

    /// Cuts everybody off.
    pub fn pull(&mut self) {
        self.listener = None;
    }

    pub fn truth(&self) -> Truth {
        self.until(|_| true)
    }

    /// What the head is as soon as it is so.
    pub fn until(&self, so: impl Fn(&Truth) -> bool) -> Truth {
        self.until_of(0, so)
    }

    /// What the head at this place is as soon as it is so.
    pub fn until_of(&self, place: usize, so: impl Fn(&Truth) -> bool) -> Truth {
        let end = Instant::now() + PATIENCE;
        let of = &self.seen[place];
        let mut seen = of.0.lock().unwrap();
        loop {
            if let Some(truth) = *seen
                && so(&truth)
            {
                return truth;
            }
            assert!(Instant::now() < end, "in vain: {seen:?}");
            seen = of.1.wait_timeout(seen, PATIENCE).unwrap().0;
        }
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

/// What is done by hand in a bring-up: to pull, what is looked at, what that becomes.
pub const BY_HAND: [(&str, f64, &str, &str); 13] = [
    ("limit.upper_open", 1.0, "upper limit contact", "open"),
    ("limit.upper_open", 0.0, "upper limit contact", "passed"),
    ("limit.lower_open", 1.0, "lower limit contact", "open"),
    ("limit.lower_open", 0.0, "lower limit contact", "passed"),
    ("stop.open", 1.0, "emergency stop contact", "open"),
    ("stop.open", 0.0, "emergency stop contact", "passed"),
    ("dielectric.lost", 1.0, "dielectric contact", "open"),
    ("dielectric.lost", 0.0, "dielectric contact", "passed"),
    ("gap.short", 1.0, "gap, a wire from the electrode to the work", "passed"),
    ("gap.short", 0.0, "gap, nothing near the electrode", "passed"),
    ("hand.force_n", 2.0, "position, moved manually", "passed"),
    ("hand.force_n", -2.0, "and back at the upper stop", "passed"),
    ("hand.force_n", 0.0, "heartbeat", "passed"),
];

/// Says its device type, and nothing else.
struct Stranger {
    node: u8,
    answers: OnceLock<Mutex<std::sync::mpsc::Sender<Frame>>>,
    _joined: edm_bus::connection::Joined,
}

impl Sink for Stranger {
    fn deliver(&self, frame: &Frame) -> Result<(), Detached> {
        let asked = Id::from(StandardId::new(0x600 + u16::from(self.node)).unwrap());
        if frame.id() == asked && frame.data().starts_with(&[0x40, 0x00, 0x10, 0x00]) {
            let id = StandardId::new(0x580 + u16::from(self.node)).unwrap();
            let answer = Frame::new(id, &[0x43, 0x00, 0x10, 0x00, 0x91, 0x01, 0x00, 0x00]).unwrap();
            let _ = self.answers.get().unwrap().lock().unwrap().send(answer);
        }
        Ok(())
    }
}

fn quiet() -> Report {
    Arc::new(|_| ())
}

/// Starts the program.
pub fn start(connection: &str, arguments: &[&str], stdout: Stdio) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_edm-desk"));
    command.args(["--bus", connection]).args(arguments);
    command.stdin(Stdio::null()).stdout(stdout).stderr(Stdio::piped()).spawn().unwrap()
}

/// Runs the program to its end: exit code, stdout, stderr.
pub fn run(connection: &str, arguments: &[&str]) -> (Option<i32>, String, String) {
    let output = start(connection, arguments, Stdio::piped()).wait_with_output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.code(), text(output.stdout), text(output.stderr))
}

/// The program with its page.
pub struct Desk {
    process: Child,
    pub address: String,
}

impl Desk {
    pub fn new(connection: &str) -> Desk {
        Desk::with(connection, &[])
    }

    pub fn with(connection: &str, options: &[&str]) -> Desk {
        let mut process = start(connection, &[&["page", "--listen", "127.0.0.1:0"], options].concat(), Stdio::piped());
        let mut line = String::new();
        BufReader::new(process.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let address = line.split("http://").nth(1).expect(&line).split('/').next().unwrap().to_owned();
        Desk { process, address }
    }

    pub fn session(&self) -> Session {
        let stream = TcpStream::connect(&self.address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let url = format!("ws://{}/session", self.address);
        let (socket, _) = tungstenite::client(url, stream).unwrap();
        let mut session = Session { socket, next: 1, welcome: Value::Null };
        session.welcome = session.until(|message| !message["welcome"].is_null())["welcome"].clone();
        session
    }

    /// A session that commands a head that erodes.
    pub fn eroding(&self) -> Session {
        let mut session = self.session();
        session.ask(json!({ "do": "heads" })).unwrap();
        session.ask(json!({ "do": "command", "take": true })).unwrap();
        session.ask(json!({ "do": "bore", "node": 1, "hole": { "depth_mm": 0.5 } })).unwrap();
        session.until(|message| message["progress"]["sample"]["state"] == "eroding");
        session
    }

    /// A session that commands and brings up a head without work below.
    pub fn bringing_up(&self, rig: &Rig) -> Session {
        rig.happen("workpiece.raised_mm", -100.0);
        let mut session = self.session();
        session.ask(json!({ "do": "heads" })).unwrap();
        session.ask(json!({ "do": "command", "take": true })).unwrap();
        session.ask(json!({ "do": "bring_up", "node": 1 })).unwrap();
        session
    }

    /// The status that is answered to a WebSocket's request.
    pub fn upgrade(&self, path: &str, headers: &[(&str, &str)]) -> u16 {
        let mut stream = TcpStream::connect(&self.address).unwrap();
        let mut text = format!(
            "GET {path} HTTP/1.1\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
        );
        if !headers.iter().any(|(name, _)| *name == "Host") {
            text += &format!("Host: {}\r\n", self.address);
        }
        headers.iter().for_each(|(name, value)| text += &format!("{name}: {value}\r\n"));
        stream.write_all((text + "\r\n").as_bytes()).unwrap();
        let mut status = [0; 12];
        stream.read_exact(&mut status).unwrap();
        std::str::from_utf8(&status[9..]).unwrap().parse().unwrap()
    }

    pub fn kill(&mut self) {
        self.process.kill().unwrap();
        self.process.wait().unwrap();
    }
}

impl Drop for Desk {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// A browser.
pub struct Session {
    socket: WebSocket<TcpStream>,
    next: u64,
    pub welcome: Value,
}

impl Session {
    pub fn send(&mut self, text: &str) {
        self.socket.send(Message::text(text)).unwrap();
    }

    /// What is answered to a request; what else is told meanwhile is passed over.
    pub fn ask(&mut self, mut what: Value) -> Result<Value, String> {
        let id = self.next;
        self.next += 1;
        what["id"] = id.into();
        self.send(&what.to_string());
        let answer = self.until(|message| message["id"] == id);
        match answer["error"].as_str() {
            Some(why) => Err(why.into()),
            None => Ok(answer["ok"].clone()),
        }
    }

    /// The next message that is so. Beats are answered, as the page does.
    pub fn until(&mut self, so: impl Fn(&Value) -> bool) -> Value {
        let end = Instant::now() + PATIENCE;
        while Instant::now() < end {
            let Message::Text(text) = self.socket.read().unwrap() else { continue };
            let message: Value = serde_json::from_str(&text).unwrap();
            if message["beat"] == true {
                self.send(&json!({ "id": 0, "do": "beat" }).to_string());
            }
            if so(&message) {
                return message;
            }
        }
        panic!("in vain");
    }
}
