//! One conversation with a client: output of a protocol waits here until the client reads it.
//!
//! Two threads serve a client: the reader hands bytes to [`Client::receive`], the writer takes them from
//! [`Client::write_to`]. What waits is bounded by [`WAITING`]: a client that does not read is disconnected.

use crate::Frame;
use crate::hub::{Detached, Port, Sink};
use std::io;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Bytes that may wait for a client: about a second of a bus of 1 Mbit/s in slcan.
pub const WAITING: usize = 1 << 18;

/// Reports to the user.
pub type Report = Arc<dyn Fn(&str) + Send + Sync>;

/// Output of a protocol to its client.
#[derive(Debug, Default)]
pub struct Outgoing {
    bytes: Vec<u8>,
    /// After so many bytes, and so long, the rest.
    pause: Option<(usize, Duration)>,
    /// Unread output is obsolete.
    stale: bool,
}

impl Outgoing {
    /// Appends bytes.
    pub fn put(&mut self, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
    }

    /// Makes what follows wait.
    pub fn pause(&mut self, time: Duration) {
        self.pause = Some((self.bytes.len(), time));
    }

    /// Drops unread output, also that in transit where possible.
    pub fn drop_waiting(&mut self) {
        *self = Outgoing { stale: true, ..Outgoing::default() };
    }

    /// Bytes that wait.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The next bytes to write, and how long to wait after them.
    fn take(&mut self) -> (Vec<u8>, Duration) {
        match self.pause.take() {
            Some((length, time)) => {
                let rest = self.bytes.split_off(length);
                (std::mem::replace(&mut self.bytes, rest), time)
            }
            None => (std::mem::take(&mut self.bytes), Duration::ZERO),
        }
    }
}

/// A text protocol, without input or output of its own. Its memory is bounded, whatever the client says.
pub trait Protocol: Send {
    /// Greeting.
    fn greeting(&self) -> &'static str {
        ""
    }
    /// Takes input of the client: appends answers to `out` and frames for the bus to `frames`.
    fn receive(&mut self, bytes: &[u8], out: &mut Outgoing, frames: &mut Vec<Frame>);
    /// Appends a frame of the bus, if the client wants it. `now`: time since 1970.
    fn frame(&mut self, frame: &Frame, now: Duration, out: &mut Outgoing);
    /// The client is gone: it gets no more frames.
    fn hang_up(&mut self);
}

/// What happens to a client that does not read.
pub enum TooSlow {
    /// The connection is cut, by this.
    Cut(Box<dyn Fn() + Send + Sync>),
    /// There is no connection to cut: the protocol ends, and another client may follow.
    HangUp,
}

struct Talk {
    protocol: Box<dyn Protocol>,
    out: Outgoing,
    ended: bool,
    /// Time of the last input.
    heard: Instant,
}

/// Bytes for a client.
pub struct Chunk<'a> {
    /// The bytes.
    pub bytes: &'a [u8],
    /// Earlier unread output is obsolete.
    pub fresh: bool,
    /// Whether these bytes are still valid, for writes that may never end.
    pub wanted: &'a dyn Fn() -> bool,
}

/// A client of the bus.
pub struct Client {
    name: String,
    talk: Mutex<Talk>,
    wake: Condvar,
    too_slow: TooSlow,
    report: Report,
}

impl Client {
    /// A client that has just been greeted.
    pub fn new(name: String, protocol: Box<dyn Protocol>, too_slow: TooSlow, report: Report) -> Client {
        let mut out = Outgoing::default();
        out.put(protocol.greeting().as_bytes());
        let talk = Mutex::new(Talk { protocol, out, ended: false, heard: Instant::now() });
        Client { name, talk, wake: Condvar::new(), too_slow, report }
    }

    /// Takes input of the client; its frames go to the bus.
    pub fn receive(&self, bytes: &[u8], port: &Port) {
        let mut frames = Vec::new();
        let mut talk = self.talk();
        talk.heard = Instant::now();
        let Talk { protocol, out, .. } = &mut *talk;
        protocol.receive(bytes, out, &mut frames);
        let _ = self.bound(&mut talk);
        drop(talk);
        self.wake.notify_one();
        // Not under the lock: the hub, which is locked now, delivers to clients.
        frames.iter().for_each(|frame| port.send(frame));
    }

    /// Writes with `put` until the conversation has ended or a write fails.
    pub fn write_to(&self, mut put: impl FnMut(&Chunk<'_>) -> io::Result<()>) {
        loop {
            let mut talk = self.talk();
            while talk.out.bytes.is_empty() && !talk.ended {
                talk = self.wake.wait(talk).unwrap_or_else(PoisonError::into_inner);
            }
            if talk.ended {
                return;
            }
            let fresh = std::mem::take(&mut talk.out.stale);
            let (bytes, pause) = talk.out.take();
            drop(talk);
            let wanted = || {
                let talk = self.talk();
                !talk.ended && !talk.out.stale
            };
            if put(&Chunk { bytes: &bytes, fresh, wanted: &wanted }).is_err() {
                return self.end();
            }
            std::thread::sleep(pause);
        }
    }

    /// Ends the conversation: the writer returns, and the connection is cut where there is one.
    pub fn end(&self) {
        self.talk().ended = true;
        self.wake.notify_one();
        if let TooSlow::Cut(cut) = &self.too_slow {
            cut();
        }
    }

    /// Time of the last input, or of the connection.
    pub fn heard(&self) -> Instant {
        self.talk().heard
    }

    /// What it is called in reports.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Whether the conversation has ended.
    pub fn ended(&self) -> bool {
        self.talk().ended
    }

    /// Ensures that no more than [`WAITING`] bytes wait.
    fn bound(&self, talk: &mut Talk) -> Result<(), Detached> {
        if talk.out.bytes.len() <= WAITING {
            return Ok(());
        }
        talk.out.drop_waiting();
        match &self.too_slow {
            TooSlow::Cut(cut) => {
                (self.report)(&format!("{}: disconnected, it does not read fast enough", self.name));
                talk.ended = true;
                cut();
                Err(Detached)
            }
            TooSlow::HangUp => {
                (self.report)(&format!("{}: closed, the client does not read", self.name));
                talk.protocol.hang_up();
                Ok(())
            }
        }
    }

    fn talk(&self) -> MutexGuard<'_, Talk> {
        self.talk.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Sink for Client {
    fn deliver(&self, frame: &Frame) -> Result<(), Detached> {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let mut talk = self.talk();
        let Talk { protocol, out, .. } = &mut *talk;
        protocol.frame(frame, now, out);
        let bounded = self.bound(&mut talk);
        drop(talk);
        self.wake.notify_one();
        bounded
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Hub;
    use crate::hub::tests::{Memory, frame};
    use crate::slcan::Slcan;
    use std::sync::atomic::{AtomicUsize, Ordering};

    fn client(too_slow: TooSlow) -> (Arc<Client>, Arc<Mutex<Vec<String>>>) {
        let said = Arc::new(Mutex::new(Vec::new()));
        let to = said.clone();
        let report: Report = Arc::new(move |text| to.lock().unwrap().push(text.into()));
        (Arc::new(Client::new("test".into(), Box::new(Slcan::default()), too_slow, report)), said)
    }

    #[test]
    fn a_client_that_does_not_read_is_cut_off_and_the_bus_goes_on() {
        let cuts = Arc::new(AtomicUsize::new(0));
        let count = cuts.clone();
        let (slow, said) = client(TooSlow::Cut(Box::new(move || _ = count.fetch_add(1, Ordering::Relaxed))));
        let hub = Hub::default();
        let memory = Arc::new(Memory::default());
        let _others = hub.attach(memory.clone());
        let port = hub.attach(slow.clone());
        slow.receive(b"O\r", &port);
        let sender = hub.attach(Arc::new(Memory::default()));
        (0..100_000).for_each(|_| sender.send(&frame(1)));
        assert_eq!((cuts.load(Ordering::Relaxed), hub.ports(), slow.ended()), (1, 2, true));
        assert_eq!(memory.frames.lock().unwrap().len(), 100_000);
        assert_eq!(*said.lock().unwrap(), ["test: disconnected, it does not read fast enough"]);
    }

    #[test]
    fn a_serial_port_that_nobody_reads_is_closed_until_it_is_opened_again() {
        let (serial, said) = client(TooSlow::HangUp);
        let hub = Hub::default();
        let port = hub.attach(serial.clone());
        let sender = hub.attach(Arc::new(Memory::default()));
        serial.receive(b"O\r", &port);
        (0..100_000).for_each(|_| sender.send(&frame(1)));
        assert_eq!(serial.talk().out.bytes, []);
        assert_eq!(*said.lock().unwrap(), ["test: closed, the client does not read"]);
        serial.receive(b"O\r", &port);
        sender.send(&frame(1));
        assert_eq!(serial.talk().out.bytes, b"\rt001101\r");
    }

    #[test]
    fn a_client_that_asks_and_never_reads_is_bounded_as_well() {
        let (slow, _) = client(TooSlow::Cut(Box::new(|| ())));
        let hub = Hub::default();
        let port = hub.attach(slow.clone());
        (0..100_000).for_each(|_| slow.receive(b"V\rV\r", &port));
        assert!(slow.ended() && slow.talk().out.bytes.len() <= WAITING + 12);
    }

    #[test]
    fn what_follows_a_pause_is_written_after_it() {
        let mut out = Outgoing::default();
        out.put(b"ok");
        out.pause(Duration::from_millis(20));
        out.put(b"frame");
        assert_eq!(out.take(), (b"ok".to_vec(), Duration::from_millis(20)));
        assert_eq!(out.take(), (b"frame".to_vec(), Duration::ZERO));
    }
}
