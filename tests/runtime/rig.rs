//! A host at a virtual head that is scheduled by a seed.

use edm_bus::Frame;
use edm_crossing::preempt::{self, Tally};
use edm_servo_head::canopen::NodeId;
use edm_servo_head::canopen::objects::{setting_address_at, setting_kind};
use edm_servo_head::settings::{Declared, Settings};
use edm_sim::process::{Parameters, Process};
use edm_sim::schedule::{Habits, Scheduler};
use edm_sim::serve::head::Head;
use edm_sim::store::Store;
use embedded_can::{Frame as _, Id, StandardId};

pub const ID: u8 = 5;
/// Periods of a millisecond.
pub const MS: u64 = 20;
/// Requests are answered within this.
const PATIENCE: u64 = 50 * MS;

/// An answer to an expedited request: what was read, or the abort code.
pub type Answer = Result<u32, u32>;

pub struct Host {
    pub head: Scheduler,
    /// Requests sent, and answers that came.
    pub asked: u64,
    pub answered: u64,
    /// Answers that were not looked at yet.
    answers: Vec<Answer>,
    /// Codes of the emergencies that came.
    pub emergencies: Vec<u16>,
    /// The node has booted so often.
    pub boots: u32,
    /// Longest time from a request that was put on a free bus to the end of its answer, periods.
    pub longest: u64,
    before: Tally,
}

pub fn frame(id: u16, data: &[u8]) -> Frame {
    Frame::new(StandardId::new(id).unwrap(), data).unwrap()
}

/// An expedited write of so many bytes.
pub fn download(index: u16, sub: u8, size: u8, value: u32) -> [u8; 8] {
    let [low, high] = index.to_le_bytes();
    let [a, b, c, d] = value.to_le_bytes();
    [0x23 | (4 - size) << 2, low, high, sub, a, b, c, d]
}

fn upload(index: u16, sub: u8) -> [u8; 8] {
    let [low, high] = index.to_le_bytes();
    [0x40, low, high, sub, 0, 0, 0, 0]
}

/// A write of the setting at a place, as the host makes it.
pub fn setting(place: usize, word: u32) -> [u8; 8] {
    let (index, sub) = setting_address_at(place).unwrap();
    let (kind, _) = setting_kind(place as u16).unwrap();
    download(index, sub, kind.size().unwrap() as u8, word)
}

/// The place of a setting.
pub fn place(key: &str) -> usize {
    Settings::FIELDS.iter().position(|field| field.key == key).unwrap_or_else(|| panic!("no setting {key}"))
}

impl Host {
    /// A head that has been switched on for 10 ms, operational.
    pub fn new(change: impl FnOnce(&mut Settings), seed: u64) -> Host {
        let mut settings = Settings { commissioned: true, ..Settings::default() };
        change(&mut settings);
        let process = Process::new(&Parameters::default(), seed).unwrap();
        let head = Head::of(process, settings, NodeId::new(ID).unwrap(), Store::Memory(None)).unwrap();
        let mut host = Host {
            head: Scheduler::of(head, seed),
            asked: 0,
            answered: 0,
            answers: Vec::new(),
            emergencies: Vec::new(),
            boots: 0,
            longest: 0,
            before: preempt::tally(),
        };
        host.run(10 * MS);
        host.send(0, &[1, ID]);
        host.run(2 * MS);
        host
    }

    /// Lets so many periods pass.
    pub fn run(&mut self, periods: u64) {
        self.head.run(periods);
        self.listen();
    }

    /// Takes what the head has sent; the period in which its newest answer ended.
    fn listen(&mut self) -> Option<u64> {
        let mut newest = None;
        for (period, frame) in self.head.take() {
            let Id::Standard(id) = frame.id() else { panic!("{frame:?}") };
            let bytes = frame.data();
            if std::env::var("EDM_TRACE").is_ok() {
                eprintln!("{period:>8} < {:03x} {bytes:02x?}", id.as_raw());
            }
            match id.as_raw() - u16::from(ID) {
                0x580 => {
                    let number = u32::from_le_bytes(bytes[4..8].try_into().unwrap());
                    self.answers.push(if bytes[0] == 0x80 { Err(number) } else { Ok(number) });
                    self.answered += 1;
                    newest = Some(period);
                }
                0x080 => self.emergencies.push(u16::from_le_bytes([bytes[0], bytes[1]])),
                0x700 if bytes == [0] => self.boots += 1,
                _ => {}
            }
        }
        newest
    }

    pub fn send(&mut self, id: u16, data: &[u8]) {
        if std::env::var("EDM_TRACE").is_ok() {
            eprintln!("{:>8} > {id:03x} {data:02x?}", self.head.periods());
        }
        self.head.send(&frame(id, data));
    }

    /// A request that is not waited for.
    pub fn ask(&mut self, request: [u8; 8]) {
        self.send(0x600 + u16::from(ID), &request);
        self.asked += 1;
    }

    /// Waits for everything that was asked; false if it did not all come.
    pub fn hear(&mut self) -> bool {
        let begin = self.head.periods();
        while self.answered < self.asked {
            if !self.head.until_sent(begin + PATIENCE) {
                return false;
            }
            self.listen();
        }
        assert_eq!(self.answered, self.asked, "more answers than requests");
        true
    }

    /// The answers since the last call.
    pub fn answers(&mut self) -> Vec<Answer> {
        std::mem::take(&mut self.answers)
    }

    /// A request, waited for.
    pub fn exchange(&mut self, request: [u8; 8]) -> Answer {
        assert!(self.hear(), "earlier requests were not answered");
        self.answers.clear();
        let free = self.head.coming() == 0;
        let begin = self.head.periods();
        self.ask(request);
        assert!(self.hear(), "no answer to {request:02x?} within {} ms", PATIENCE / MS);
        if free {
            self.longest = self.longest.max(self.head.periods() - begin);
        }
        self.answers.pop().unwrap()
    }

    pub fn read(&mut self, index: u16, sub: u8) -> u32 {
        self.exchange(upload(index, sub)).unwrap_or_else(|abort| panic!("{index:04x}:{sub:02x}: {abort:#010x}"))
    }

    pub fn write(&mut self, index: u16, sub: u8, size: u8, value: u32) {
        let answer = self.exchange(download(index, sub, size, value));
        answer.unwrap_or_else(|abort| panic!("{index:04x}:{sub:02x} = {value}: {abort:#010x}"));
    }

    /// Reads settings through the dictionary into `known`.
    pub fn learn(&mut self, known: &mut Settings, places: impl IntoIterator<Item = usize>) {
        for place in places {
            let (index, sub) = setting_address_at(place).unwrap();
            let size = setting_kind(place as u16).unwrap().0.size().unwrap();
            let word = self.read(index, sub) & (u64::MAX >> (64 - 8 * size)) as u32;
            known.put_word(place, word).unwrap();
        }
    }

    /// The generations: the newest, those of servo task, gap task, supervision.
    pub fn generations(&mut self) -> [u32; 4] {
        [1, 2, 3, 4].map(|sub| self.read(0x200C, sub))
    }

    /// Every task runs these settings.
    #[track_caller]
    pub fn expect_runs(&self, settings: &Settings) {
        let active = settings.build().unwrap();
        let running = self.head.running();
        assert_eq!(running.head, active.head, "servo task");
        assert_eq!(running.off_time_ns, active.off_time_ns, "generator");
        assert_eq!(running.gap, active.gap, "gap task");
        assert_eq!(running.limits, active.head.supervise, "supervision");
        assert_eq!(running.reflex, active.reflex, "reflex");
    }

    /// Whatever was sent through a ring was received, or lost and shown in 200Dh; frames and events lost.
    #[track_caller]
    pub fn expect_counted(&mut self) -> [u32; 2] {
        let shown = [1, 2].map(|sub| self.read(0x200D, sub));
        self.head.set_habits(Habits::PROMPT);
        self.run(2);
        let tally = preempt::tally();
        let [sent, received, lost] = [
            tally.sent - self.before.sent,
            tally.received - self.before.received,
            tally.lost - self.before.lost,
        ];
        assert_eq!(sent, received + lost, "sent, received and lost");
        assert_eq!(u64::from(shown[0]) + u64::from(shown[1]), lost + self.head.overruns(), "lost, and shown in 200Dh");
        shown
    }

    /// Controlwords up to operation enabled.
    pub fn enable(&mut self) {
        for word in [0x06, 0x07, 0x0F] {
            self.write(0x6040, 0, 2, word);
            self.run(2 * MS);
        }
        assert_eq!(self.read(0x6041, 0) & 0x6F, 0x27, "{:?}", self.head.status());
    }
}
