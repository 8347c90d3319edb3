//! The desk's connection to a bus: distribution of frames, and the heartbeat that a head monitors.
//!
//! One thread takes every frame as it comes: answers of SDO servers go to the requesting thread, all frames to the listeners.
//! The same thread sends this program's heartbeat, and only while it is kept alive
//! ([`Bus::keep_alive`]): a head that watches it (1016h) retreats by itself when that ends, whatever has ended it.

use crate::Failure;
use edm_bus::client::Report;
use edm_bus::connection::Joined;
use edm_bus::mailbox::Mailbox;
use edm_bus::{Connection, Frame, Hub, Port};
use embedded_can::{Frame as _, Id, StandardId};
use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::sync::mpsc::{Receiver, Sender, SyncSender, TrySendError, channel, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};
use std::thread;
use std::time::{Duration, Instant};

/// Period of this program's heartbeat.
pub const BEAT: Duration = Duration::from_millis(100);
/// The longest silence of either side.
pub const SILENCE: Duration = Duration::from_millis(1000);
/// Frames that may wait for a listener; one that does not take them loses the newest.
const WAITING: usize = 4096;
/// Nodes of a bus, 0 for none.
const NODES: usize = 128;
/// Operational, in a heartbeat (CiA 301 7.2.8.3.2).
const OPERATIONAL: u8 = 5;

/// A data frame with an 11-bit identifier.
#[derive(Clone, Copy, Debug)]
pub struct Heard {
    /// When it was taken.
    pub at: Instant,
    /// Identifier.
    pub id: u16,
    frame: Frame,
}

impl Heard {
    /// Content.
    pub fn data(&self) -> &[u8] {
        self.frame.data()
    }
}

/// The bus. Clones are the same place on it.
#[derive(Clone)]
pub struct Bus(Arc<Place>);

struct Place {
    connection: Connection,
    joined: Joined,
    hub: Hub,
    port: Port,
    mailbox: Arc<Mailbox>,
    /// Node-ID of the heartbeats.
    host: AtomicU8,
    /// By node: who waits for an answer of its SDO server.
    asked: Vec<Mutex<Option<Sender<[u8; 8]>>>>,
    /// By node: one conversation at a time.
    turns: Vec<Mutex<()>>,
    listeners: Mutex<Vec<SyncSender<Heard>>>,
    alive_until: Mutex<Option<Instant>>,
    stop: AtomicBool,
}

impl Bus {
    /// Joins a bus. `host`: node-ID of this program's heartbeats.
    ///
    /// # Errors
    /// When there is no such bus.
    pub fn join(connection: &Connection, bit_rate: u32, host: u8, report: &Report) -> Result<Bus, Failure> {
        let hub = Hub::default();
        let mailbox = Arc::new(Mailbox::default());
        let port = hub.attach(mailbox.clone());
        let joined =
            connection.join(&hub, bit_rate, report).map_err(|why| Failure::BadInput(format!("--bus {why}")))?;
        let place = Arc::new(Place {
            connection: connection.clone(),
            joined,
            hub,
            port,
            mailbox,
            host: AtomicU8::new(host),
            asked: (0..NODES).map(|_| Mutex::default()).collect(),
            turns: (0..NODES).map(|_| Mutex::default()).collect(),
            listeners: Mutex::default(),
            alive_until: Mutex::default(),
            stop: AtomicBool::default(),
        });
        let (at_work, mailbox) = (Arc::downgrade(&place), place.mailbox.clone());
        thread::spawn(move || {
            let (mut frames, mut beat) = (Vec::new(), Instant::now());
            loop {
                mailbox.wait(Instant::now() + BEAT / 4);
                let Some(place) = at_work.upgrade() else { return };
                if place.stop.load(Ordering::Relaxed) {
                    return;
                }
                mailbox.take(&mut frames);
                frames.drain(..).for_each(|frame| place.dispatch(frame));
                let now = Instant::now();
                if beat <= now && lock(&place.alive_until).is_some_and(|until| now < until) {
                    place.beat();
                    beat = now + BEAT;
                }
            }
        });
        Ok(Bus(place))
    }

    /// Sends a frame. More than 8 bytes or 11 bits are not sent.
    pub fn send(&self, id: u16, data: &[u8]) {
        self.0.send(id, data);
    }

    /// The heartbeat continues for this time from now; zero ends it at once.
    pub fn keep_alive(&self, time: Duration) {
        *lock(&self.0.alive_until) = Some(Instant::now() + time);
    }

    /// A heartbeat now: a head watches from the first one on that comes after it was told to.
    pub fn beat(&self) {
        self.0.beat();
    }

    /// Takes a node-ID for the heartbeat that nobody else on the bus uses, the one given or the next below: a head that watches the
    /// heartbeat of one program must not be content with another's. Listens for three periods, unless this program beats already.
    pub fn claim_host(&self) -> u8 {
        let mut host = self.0.host.load(Ordering::Relaxed);
        if lock(&self.0.alive_until).is_some_and(|until| Instant::now() < until) {
            return host;
        }
        let (heard, end, mut used) = (self.listen(), Instant::now() + 3 * BEAT, BTreeSet::new());
        while let Ok(frame) = heard.recv_timeout(end.saturating_duration_since(Instant::now())) {
            if let 0x701..=0x77F = frame.id {
                used.insert((frame.id & 0x7F) as u8);
            }
        }
        while host > 1 && used.contains(&host) {
            host -= 1;
        }
        self.0.host.store(host, Ordering::Relaxed);
        host
    }

    /// Everything that is heard from now on.
    pub fn listen(&self) -> Receiver<Heard> {
        let (sender, receiver) = sync_channel(WAITING);
        lock(&self.0.listeners).push(sender);
        receiver
    }

    /// Everything that passes from now on, also what this program sends, while the port is kept.
    pub fn tap(&self) -> (Port, Arc<Mailbox>) {
        let mailbox = Arc::new(Mailbox::default());
        (self.0.hub.attach(mailbox.clone()), mailbox)
    }

    /// Whether the connection to the bus is lost.
    pub fn lost(&self) -> bool {
        self.0.joined.lost()
    }

    /// The connection to the bus, in words.
    pub fn connection(&self) -> String {
        self.0.connection.to_string()
    }

    /// Takes the turn to talk to a node's SDO server.
    pub(crate) fn turn(&self, node: u8) -> Option<Turn<'_>> {
        self.with(node, lock(self.0.turns.get(usize::from(node))?))
    }

    /// Takes the turn if nobody has it.
    pub(crate) fn turn_now(&self, node: u8) -> Option<Turn<'_>> {
        match self.0.turns.get(usize::from(node))?.try_lock() {
            Ok(turn) => self.with(node, turn),
            Err(TryLockError::Poisoned(turn)) => self.with(node, turn.into_inner()),
            Err(TryLockError::WouldBlock) => None,
        }
    }

    fn with<'a>(&'a self, node: u8, turn: MutexGuard<'a, ()>) -> Option<Turn<'a>> {
        let (sender, answers) = channel();
        *lock(self.0.asked.get(usize::from(node))?) = Some(sender);
        Some(Turn { bus: self, node, answers, _turn: turn })
    }
}

/// A conversation with a node's SDO server.
pub(crate) struct Turn<'a> {
    bus: &'a Bus,
    node: u8,
    answers: Receiver<[u8; 8]>,
    _turn: MutexGuard<'a, ()>,
}

impl Turn<'_> {
    pub fn say(&self, request: [u8; 8]) {
        self.bus.send(0x600 + u16::from(self.node), &request);
    }

    pub fn hear(&self, patience: Duration) -> Option<[u8; 8]> {
        self.answers.recv_timeout(patience).ok()
    }
}

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        if let Some(asked) = self.bus.0.asked.get(usize::from(self.node)) {
            *lock(asked) = None;
        }
    }
}

impl Place {
    fn beat(&self) {
        self.send(0x700 + u16::from(self.host.load(Ordering::Relaxed)), &[OPERATIONAL]);
    }

    fn send(&self, id: u16, data: &[u8]) {
        if let Some(frame) = StandardId::new(id).and_then(|id| Frame::new(id, data)) {
            self.port.send(&frame);
        }
    }

    fn dispatch(&self, frame: Frame) {
        let Id::Standard(id) = frame.id() else { return };
        if frame.is_remote_frame() {
            return;
        }
        let id = id.as_raw();
        if let (0x581..=0x5FF, Ok(answer)) = (id, <[u8; 8]>::try_from(frame.data()))
            && let Some(asked) = self.asked.get(usize::from(id & 0x7F))
            && let Some(waits) = &*lock(asked)
        {
            // Who asked may have given up.
            let _ = waits.send(answer);
        }
        let heard = Heard { at: Instant::now(), id, frame };
        lock(&self.listeners).retain(|to| !matches!(to.try_send(heard), Err(TrySendError::Disconnected(_))));
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        self.mailbox.ring();
    }
}

/// What a thread that panicked has left behind is still good: every change is one assignment.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
