//! A host at a virtual head that is scheduled by a seed.

use edm_bus::Frame;
use edm_crossing::preempt::{self, Tally};
use edm_hal_shim::double::live::Broken;
use edm_hal_shim::self_test::SelfTest;
use edm_servo_head::canopen::NodeId;
use edm_servo_head::canopen::objects::{setting_address_at, setting_kind};
use edm_servo_head::settings::{Declared, Settings};
use edm_servo_head::units::{PLAN_TICKS, TICKS_PER_MS};
use edm_sim::process::{Plant, Process};
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
    /// When the newest request was sent, if nothing was in its way.
    begin: Option<u64>,
    /// Longest time from such a request to the end of its answer, periods.
    pub longest: u64,
    before: Tally,
    /// Lost when requests were given up last.
    lost: u64,
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
        Host::with(change, Broken::default(), SelfTest::PASSED, seed)
    }

    /// The same with something wrong behind the live signal.
    pub fn broken(broken: Broken, seed: u64) -> Host {
        Host::with(|_| {}, broken, SelfTest::PASSED, seed)
    }

    /// The same on a board that has found something of itself.
    pub fn found(self_test: SelfTest, seed: u64) -> Host {
        Host::with(|_| {}, Broken::default(), self_test, seed)
    }

    fn with(change: impl FnOnce(&mut Settings), broken: Broken, self_test: SelfTest, seed: u64) -> Host {
        let mut settings = Settings { commissioned: true, ..Settings::default() };
        change(&mut settings);
        let process = Process::new(Plant::default(), seed).unwrap();
        let head = Head::of(process, settings, (NodeId::new(ID), ID.into()), Store::memory(None), self_test).unwrap();
        let mut host = Host {
            head: Scheduler::of(head, seed),
            asked: 0,
            answered: 0,
            answers: Vec::new(),
            emergencies: Vec::new(),
            boots: 0,
            begin: None,
            longest: 0,
            before: preempt::tally(),
            lost: 0,
        };
        host.head.live().circuit.broken = broken;
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

    /// Takes what the head has sent.
    fn listen(&mut self) {
        for (period, frame) in self.head.take() {
            let Id::Standard(id) = frame.id() else { panic!("{frame:?}") };
            let bytes = frame.data();
            match id.as_raw() - u16::from(ID) {
                0x580 => {
                    let number = u32::from_le_bytes(bytes[4..8].try_into().unwrap());
                    self.answers.push(if bytes[0] == 0x80 { Err(number) } else { Ok(number) });
                    self.answered += 1;
                    if let Some(begin) = self.begin.take() {
                        self.longest = self.longest.max(period - begin);
                    }
                }
                0x080 => self.emergencies.push(u16::from_le_bytes([bytes[0], bytes[1]])),
                0x700 if bytes == [0] => self.boots += 1,
                _ => {}
            }
        }
    }

    pub fn send(&mut self, id: u16, data: &[u8]) {
        self.head.send(&frame(id, data));
    }

    /// A request that is not waited for.
    pub fn ask(&mut self, request: [u8; 8]) {
        let alone = self.head.coming() == 0 && self.asked == self.answered;
        self.begin = alone.then(|| self.head.periods());
        self.send(0x600 + u16::from(ID), &request);
        self.asked += 1;
    }

    /// Waits until everything that was asked is answered, but for as many requests as frames were lost meanwhile.
    #[track_caller]
    pub fn hear(&mut self) {
        let begin = self.head.periods();
        while self.answered < self.asked {
            if !self.head.until_sent(begin + PATIENCE) {
                let lost = self.lost();
                let missing = self.asked - self.answered;
                assert!(missing <= lost - self.lost, "{missing} not answered: {:?}", self.head.status());
                (self.asked, self.lost) = (self.answered, lost);
            }
            self.listen();
        }
        assert_eq!(self.answered, self.asked, "more answers than requests");
    }

    /// Frames and events that were lost, by a count that is not the head's.
    fn lost(&self) -> u64 {
        preempt::tally().lost - self.before.lost + self.head.overruns().1
    }

    /// The answers since the last call.
    pub fn answers(&mut self) -> Vec<Answer> {
        std::mem::take(&mut self.answers)
    }

    /// A request, waited for, and once more if its frame was lost.
    #[track_caller]
    pub fn exchange(&mut self, request: [u8; 8]) -> Answer {
        self.hear();
        loop {
            self.answers.clear();
            self.ask(request);
            self.hear();
            if let Some(answer) = self.answers.pop() {
                return answer;
            }
        }
    }

    /// Reads objects, eight requests at a time.
    #[track_caller]
    pub fn read_all(&mut self, addresses: &[(u16, u8)]) -> Vec<u32> {
        let mut values = Vec::new();
        for addresses in addresses.chunks(8) {
            self.hear();
            self.answers.clear();
            addresses.iter().for_each(|&(index, sub)| self.ask(upload(index, sub)));
            self.hear();
            let answers = self.answers();
            if answers.len() == addresses.len() {
                values.extend(answers.into_iter().map(|answer| answer.unwrap()));
            } else {
                // A frame was lost, whichever.
                values.extend(addresses.iter().map(|&(index, sub)| self.read(index, sub)));
            }
        }
        values
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
        let places: Vec<usize> = places.into_iter().collect();
        let addresses: Vec<_> = places.iter().map(|place| setting_address_at(*place).unwrap()).collect();
        for (place, word) in places.iter().zip(self.read_all(&addresses)) {
            let size = setting_kind(*place as u16).unwrap().0.size().unwrap();
            known.put_word(*place, word & (u64::MAX >> (64 - 8 * size)) as u32).unwrap();
        }
    }

    /// The generations: the newest, those of servo task, gap task, supervision.
    pub fn generations(&mut self) -> [u32; 4] {
        let values = self.read_all(&[1, 2, 3, 4].map(|sub| (0x200C, sub)));
        values.try_into().unwrap()
    }

    /// Every task runs these settings.
    #[track_caller]
    pub fn expect_runs(&self, settings: &Settings) {
        let active = settings.build().unwrap();
        let running = self.head.running();
        assert_eq!(running.head, active.head, "servo task");
        assert_eq!(running.off_time_ns, active.off_time_ns, "generator");
        assert_eq!(running.gap, active.gap, "gap task");
        assert_eq!(running.supervision, active.head.supervision(), "supervision");
        assert_eq!(running.reflex, active.reflex, "reflex");
    }

    /// Whatever was sent through a ring was received, or lost and shown in 200Dh; frames and events lost.
    #[track_caller]
    pub fn expect_counted(&mut self) -> [u32; 2] {
        let shown: [u32; 2] = self.read_all(&[1, 2].map(|sub| (0x200D, sub))).try_into().unwrap();
        self.head.set_habits(Habits::PROMPT);
        self.run(2);
        // The supervision tells of what lasts once a millisecond: what it has just sent is taken in the next tick. What is
        // asked of the planner waits for its next estimate, and changes of state wait for the protocol's millisecond.
        let counted = |rig: &Self| {
            let (tally, before) = (preempt::tally(), &rig.before);
            (tally.sent - before.sent, tally.received - before.received, tally.lost - before.lost)
        };
        for _ in 0..TICKS_PER_MS + PLAN_TICKS {
            let (sent, received, lost) = counted(self);
            if sent == received + lost {
                break;
            }
            self.run(1);
        }
        let (sent, received, lost) = counted(self);
        assert_eq!(sent, received + lost, "sent, received and lost");
        assert_eq!(
            u64::from(shown[0]) + u64::from(shown[1]),
            lost + self.head.overruns().0,
            "lost, and shown in 200Dh"
        );
        shown
    }

    /// Resets node or communication (129, 130), waits for boot-up and goes operational.
    #[track_caller]
    pub fn reset(&mut self, command: u8) {
        let boots = self.boots;
        self.send(0, &[command, ID]);
        for _ in 0..200 {
            self.run(MS);
            if self.boots > boots {
                break;
            }
        }
        assert_eq!(self.boots, boots + 1, "boot-up");
        // What was asked before is not answered any more.
        self.asked = self.answered;
        self.send(0, &[1, 0]);
        self.run(2 * MS);
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
