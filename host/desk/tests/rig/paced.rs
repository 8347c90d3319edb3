//! A bus of 1 Mbit/s with its frame times, in simulated time: a frame takes its bits, stuff bits included, before whoever is to
//! have it gets it. The head runs meanwhile, tick by tick, and answers in the tick after a frame has come. Time stands still while
//! nothing is on the bus and the head owes no answer: what the program and this computer take is not in it.

use super::{PATIENCE, TICKS, quiet};
use edm_bus::mailbox::Mailbox;
use edm_bus::slcan::Slcan;
use edm_bus::tcp::Listener;
use edm_bus::{Frame, Hub};
use edm_servo_head::canopen::NodeId;
use edm_sim::run::Setup;
use edm_sim::serve::head::Head;
use edm_sim::store::Store;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::Instant;

/// Time of a bit, ns.
const BIT_NS: u64 = 1000;
/// Time of a servo tick, ns.
const TICK_NS: u64 = 1_000_000 / TICKS as u64;

/// What has passed on the bus.
#[derive(Debug, Default)]
struct Passed {
    ns: AtomicU64,
    bits: AtomicU64,
    frames: AtomicU64,
    ends: AtomicBool,
}

/// A bus with a head, node 1.
pub struct Paced {
    _listener: Listener,
    pub connection: String,
    passed: Arc<Passed>,
}

impl Paced {
    pub fn new() -> Paced {
        let hub = Hub::default();
        let mailbox = Arc::new(Mailbox::default());
        let port = hub.attach(mailbox.clone());
        let passed = Arc::new(Passed::default());
        let clock = passed.clone();
        thread::spawn(move || {
            let store = Store::new(None, "node-1").unwrap();
            let mut head = Head::new(&Setup::load("default").unwrap(), (NodeId::new(1), 1), 1, store).unwrap();
            let (mut came, mut sent, mut ran_ns) = (Vec::new(), Vec::new(), 0);
            let put = |frame: &Frame| {
                clock.frames.fetch_add(1, Ordering::Relaxed);
                clock.bits.fetch_add(frame.bits().into(), Ordering::Relaxed);
                clock.ns.fetch_add(BIT_NS * u64::from(frame.bits()), Ordering::Relaxed);
            };
            while !clock.ends.load(Ordering::Relaxed) {
                mailbox.wait(Instant::now() + PATIENCE / 100);
                mailbox.take(&mut came);
                for frame in came.drain(..) {
                    put(&frame);
                    // What it has not run yet while that frame was on the bus.
                    while ran_ns + TICK_NS <= clock.ns.load(Ordering::Relaxed) {
                        head.tick([].iter(), &mut sent);
                        ran_ns += TICK_NS;
                    }
                    let mut due = Some(&frame);
                    // An answer, or 10 ms without one: not every frame is a question.
                    for _ in 0..10 * TICKS {
                        head.tick(due.take().into_iter(), &mut sent);
                        ran_ns += TICK_NS;
                        if !sent.is_empty() {
                            break;
                        }
                    }
                    clock.ns.fetch_max(ran_ns, Ordering::Relaxed);
                    for frame in sent.drain(..) {
                        put(&frame);
                        port.send(&frame);
                    }
                }
            }
        });
        let listener = Listener::new(&hub, "127.0.0.1:0", || Box::new(Slcan::default()), quiet()).unwrap();
        let connection = format!("socket://{}", listener.address());
        Paced { _listener: listener, connection, passed }
    }

    /// Simulated time, ns; bits and frames on the bus.
    pub fn passed(&self) -> [u64; 3] {
        [&self.passed.ns, &self.passed.bits, &self.passed.frames].map(|count| count.load(Ordering::Relaxed))
    }
}

impl Drop for Paced {
    fn drop(&mut self) {
        self.passed.ends.store(true, Ordering::Relaxed);
    }
}
