//! A hole that is gone on with after its head has lost its power, on a virtual head. Everything is simulated; a count is 1 um.

use edm_bus::Frame;
use edm_servo_head::canopen::NodeId;
use edm_servo_head::head::State;
use edm_servo_head::settings::Value;
use edm_sim::run::Setup;
use edm_sim::serve::head::Head;
use edm_sim::store::Store;
use embedded_can::{Frame as _, Id, StandardId};

const ID: u8 = 5;
/// Depth of the hole, counts.
const DEPTH: i32 = 30;
/// Distance of the first mark below the upper stop, and of one mark from the next, counts.
const MARK: i32 = 500;
/// Index mark below the upper limit switch; the present position.
const BY_MARK: u8 = 1;
const HERE: u8 = 35;
/// What was touched: 201Ah:2.
const BOTTOM: u8 = 1;
const BESIDE: u8 = 2;
const REFERENCE: u8 = 3;

struct Host {
    head: Option<Head>,
    sent: Vec<Frame>,
    /// True place at which the surface was touched, and the farthest of the electrode in the work, um. The model's surfaces are rough: a
    /// touch finds their peaks.
    surface: f64,
    deepest: f64,
}

impl Host {
    fn new(more: &[&str]) -> Host {
        let mut setup = Setup::load("default").unwrap();
        let own =
            ["workpiece.surface_mm=0.8", "scale.mark_mm=0.5", "encoder.mark_distance_um=500", "limit.upper_mm=0.1"];
        for assignment in own.iter().chain(more) {
            setup.set(assignment).unwrap();
        }
        let head = Head::new(&setup, (NodeId::new(ID), 5), 3, Store::memory(None)).unwrap();
        let mut host = Host { head: Some(head), sent: Vec::new(), surface: 0.0, deepest: f64::MIN };
        host.boot();
        host
    }

    fn boot(&mut self) {
        self.run(100);
        self.send(0, &[1, ID]);
        self.run(2);
    }

    /// The power is cut for half a second.
    fn cut(&mut self) {
        let head = self.head.take().unwrap();
        self.head = Some(head.cut_power(0.5).unwrap());
        self.boot();
    }

    fn head(&mut self) -> &mut Head {
        self.head.as_mut().unwrap()
    }

    fn state(&self) -> State {
        self.head.as_ref().unwrap().status().state
    }

    fn run(&mut self, ms: u32) {
        for _ in 0..20 * ms {
            let head = self.head.as_mut().unwrap();
            head.tick(std::iter::empty(), &mut self.sent);
            if head.status().state.works() && head.status().state != State::Seeking {
                self.deepest = self.deepest.max(head.process.truth().position_um);
            }
        }
    }

    #[track_caller]
    fn until(&mut self, ms: u32, mut done: impl FnMut(&mut Host) -> bool) {
        for _ in 0..ms {
            if done(self) {
                return;
            }
            self.run(1);
        }
        panic!("not within {ms} ms: {:?}", self.head().status());
    }

    fn send(&mut self, id: u16, data: &[u8]) {
        let frame = Frame::new(StandardId::new(id).unwrap(), data).unwrap();
        self.head.as_mut().unwrap().tick(std::iter::once(&frame), &mut self.sent);
    }

    fn ask(&mut self, request: [u8; 8]) -> Result<u32, u32> {
        self.sent.clear();
        self.send(0x600 + u16::from(ID), &request);
        for _ in 0..20 {
            self.run(1);
            let answer = Id::Standard(StandardId::new(0x580 + u16::from(ID)).unwrap());
            if let Some(frame) = self.sent.iter().find(|frame| frame.id() == answer) {
                let number = u32::from_le_bytes(frame.data()[4..8].try_into().unwrap());
                return if frame.data()[0] == 0x80 { Err(number) } else { Ok(number) };
            }
        }
        panic!("no answer to {request:02x?}");
    }

    fn read(&mut self, index: u16, sub: u8) -> i32 {
        let [low, high] = index.to_le_bytes();
        self.ask([0x40, low, high, sub, 0, 0, 0, 0]).unwrap().cast_signed()
    }

    fn try_set(&mut self, index: u16, sub: u8, value: &[u8]) -> Result<(), u32> {
        let [low, high] = index.to_le_bytes();
        let mut request = [0x23 | (4 - value.len() as u8) << 2, low, high, sub, 0, 0, 0, 0];
        request[4..4 + value.len()].copy_from_slice(value);
        self.ask(request).map(|_| ())
    }

    #[track_caller]
    fn set(&mut self, index: u16, sub: u8, value: &[u8]) {
        self.try_set(index, sub, value).unwrap_or_else(|abort| panic!("{index:04x}:{sub}: {abort:08x}"));
    }

    fn happen(&mut self, signal: &str, value: Value<'_>) {
        self.head().process.happen(signal, value).unwrap();
    }

    #[track_caller]
    fn enable(&mut self) {
        for word in [0x06u16, 0x07, 0x0F] {
            self.set(0x6040, 0, &word.to_le_bytes());
            self.run(5);
        }
        assert_eq!(self.read(0x6041, 0) & 0x6F, 0x27);
    }

    /// Homed; the mark is where it is below the upper stop, so that the travel is that of the axis.
    #[track_caller]
    fn home(&mut self, method: u8) {
        self.home_at(method, if method == BY_MARK { MARK } else { 0 });
    }

    #[track_caller]
    fn home_at(&mut self, method: u8, at: i32) {
        self.set(0x607C, 0, &(-at).to_le_bytes());
        self.set(0x6098, 0, &[method]);
        self.set(0x6060, 0, &[6]);
        self.set(0x6040, 0, &0x1Fu16.to_le_bytes());
        self.until(5000, |host| host.read(0x6041, 0) & 0x3400 == 0x1400);
        self.set(0x6040, 0, &0x0Fu16.to_le_bytes());
        self.set(0x6060, 0, &[1]);
    }

    /// Touches what is under the electrode.
    #[track_caller]
    fn touch(&mut self) -> i32 {
        self.set(0x2011, 1, &[1]);
        self.run(3);
        self.until(10_000, |host| host.state() != State::Touching);
        // It comes to rest.
        self.run(50);
        let outcome = self.read(0x2011, 3);
        assert_eq!(outcome, 2, "{:?}", self.head().status());
        self.read(0x2001, 6)
    }

    /// Erodes to this depth.
    fn erode(&mut self) {
        let target = self.read(0x2011, 11) + DEPTH;
        self.set(0x2001, 1, &[1]);
        self.start_to(target);
    }

    /// A hole is begun above new work.
    fn begin(&mut self, method: u8) {
        self.enable();
        self.home(method);
        let surface = self.touch();
        self.surface = self.true_place(surface);
        self.set(0x2011, 11, &surface.to_le_bytes());
        self.erode();
    }

    /// Where a position of the head at rest is, um.
    fn true_place(&mut self, position: i32) -> f64 {
        let here = self.read(0x6063, 0);
        self.head().process.truth().count as f64 + f64::from(position - here)
    }

    /// Gives a set point.
    fn start_to(&mut self, position: i32) {
        self.set(0x607A, 0, &position.to_le_bytes());
        self.set(0x6040, 0, &0x0Fu16.to_le_bytes());
        self.set(0x6040, 0, &0x1Fu16.to_le_bytes());
    }

    /// Goes there with pulses off.
    fn move_to(&mut self, position: i32) {
        self.start_to(position);
        self.until(5000, |host| host.read(0x6041, 0) & 0x400 != 0);
        self.run(20);
        self.set(0x6040, 0, &0x0Fu16.to_le_bytes());
    }

    fn deep(&mut self) -> i32 {
        self.read(0x201A, 4)
    }

    /// Goes on, or says why it does not.
    fn go_on(&mut self, touched: u8) -> Result<(), i32> {
        let refused = self.try_set(0x201A, 2, &[touched]);
        assert!(matches!(refused, Ok(()) | Err(0x0800_0022)), "{refused:x?}");
        let why = self.read(0x201A, 3);
        assert_eq!(refused.is_err(), why != 0);
        if why == 0 { Ok(()) } else { Err(why) }
    }

    /// Homes as before, touches, goes on, to the end. By how many um surface, kept depth and final depth differ from the truth.
    #[track_caller]
    fn finish(&mut self, method: u8) -> [f64; 3] {
        assert_eq!(self.read(0x201A, 1), 1, "a hole waits");
        assert_eq!(self.read(0x2011, 11), i32::MIN, "and nothing is known of it");
        self.enable();
        self.home(method);
        self.touch();
        assert_eq!(self.go_on(BOTTOM), Ok(()));
        assert_eq!(self.read(0x201A, 1), 2);
        let (surface, deep) = (self.read(0x2011, 11), self.deep());
        let surface_off = self.true_place(surface) - self.surface;
        // Before it was in the work it has no depth.
        let deep_off = f64::from(deep) - (self.deepest - self.surface).max(0.0);
        self.erode();
        self.until(120_000, |host| host.state() == State::Done);
        [surface_off, deep_off, self.deepest - self.surface - f64::from(DEPTH)]
    }
}

/// Three rows, from rough to fine.
const ROWS: &str = "electrode = 'copper'\nwork = 'steel'\n\
    [[row]]\nname = 'rough'\nleaves_um = 18\ngenerator.on_us = 160\nsettings.gap.setpoint_v = 65\n\
    [[row]]\nname = 'medium'\nleaves_um = 6\ngenerator.on_us = 80\nsettings.gap.setpoint_v = 62\n\
    [[row]]\nname = 'fine'\ngenerator.on_us = 40\nsettings.gap.setpoint_v = 58";

impl Host {
    /// Has the head take the rows, and begin with one.
    fn take_rows(&mut self, row: u8) {
        for write in edm_technology::File::parse(ROWS).unwrap().writes() {
            self.set(0x201C, write.sub, &write.value.to_le_bytes()[..usize::from(write.size)]);
        }
        self.set(0x201C, 2, &[1]);
        self.run(10);
        assert_eq!(self.read(0x201C, 6), 2);
        self.set(0x201C, 5, &[row]);
    }

    fn row(&self) -> u8 {
        self.head.as_ref().unwrap().protocol().drive().technology().1
    }

    fn setpoint(&self) -> f32 {
        self.head.as_ref().unwrap().status().gap_setpoint.0
    }
}

#[test]
fn a_hole_of_three_rows_is_gone_on_with_in_the_row_in_which_the_power_was_cut() {
    let mut host = Host::new(&[]);
    host.take_rows(1);
    host.begin(BY_MARK);
    host.until(120_000, |host| host.row() == 2 && host.state() == State::Eroding && host.deep() > DEPTH - 14);
    assert_eq!(host.setpoint(), 62.0);
    host.cut();
    assert_eq!((host.read(0x201A, 1), host.read(0x201A, 7)), (1, 2), "a hole waits, in row 2");
    assert_eq!((host.read(0x201C, 1), host.read(0x201C, 6)), (0, 0), "of a table that is the host's to give again");
    host.enable();
    host.home(BY_MARK);
    host.touch();
    assert_eq!(host.go_on(BOTTOM), Ok(()));
    host.take_rows(2);
    host.erode();
    let mut seen = Vec::new();
    host.until(120_000, |host| {
        let now = (host.row(), host.setpoint());
        if host.state() == State::Eroding && seen.last() != Some(&now) {
            seen.push(now);
        }
        host.read(0x6041, 0) & 0x400 != 0
    });
    assert_eq!(seen, [(2, 62.0), (3, 58.0)]);
    let off = host.deepest - host.surface - f64::from(DEPTH);
    assert!(off.abs() <= 2.0, "{off} um");
}

/// Jumps, a spark-out and a lift.
const PROGRAM: [&str; 4] = ["jump.every_ms=700", "jump.height_um=200", "end.spark_out_ms=800", "end.lift_um=300"];

#[test]
fn a_hole_is_gone_on_with_to_two_counts_after_a_power_cut_at_ten_moments() {
    let in_state = |state: State| move |host: &mut Host| host.state() == state;
    let half = |host: &mut Host| host.state() == State::Eroding && host.deep() >= DEPTH / 2;
    let mut short = false;
    let retreat = move |host: &mut Host| {
        if host.state() == State::Eroding && host.deep() > 8 && !short {
            host.happen("gap.short", Value::Flag(true));
            short = true;
        }
        host.state() == State::Retreating
    };
    let falling = |host: &mut Host| host.state() == State::Jumping && host.head().status().velocity.0 > 0.0;
    // At the end of its path it erodes until discharges are rare.
    let at_the_end = |host: &mut Host| host.state() == State::Eroding && host.deep() >= DEPTH;
    type Moment<'a> = (&'a str, Box<dyn FnMut(&mut Host) -> bool>);
    let moments: [Moment<'_>; 10] = [
        ("ready", Box::new(|_| true)),
        ("seek", Box::new(in_state(State::Seeking))),
        ("first sparks", Box::new(in_state(State::Eroding))),
        ("erode", Box::new(half)),
        ("retreat", Box::new(retreat)),
        ("jump up", Box::new(in_state(State::Jumping))),
        ("jump down", Box::new(falling)),
        ("spark-out", Box::new(at_the_end)),
        ("lift", Box::new(in_state(State::Lifting))),
        ("done", Box::new(in_state(State::Done))),
    ];
    for (name, mut moment) in moments {
        let mut host = Host::new(&PROGRAM);
        host.begin(BY_MARK);
        host.until(120_000, |host| moment(host));
        // What is kept is 10 ms old at the most.
        host.cut();
        host.happen("gap.short", Value::Flag(false));
        let off = host.finish(BY_MARK);
        assert!(off.iter().all(|off| off.abs() <= 2.0), "{name}: {off:?} um");
    }
}

#[test]
fn after_two_cuts_the_hole_and_the_work_done_go_on_counting() {
    let mut host = Host::new(&[]);
    host.begin(BY_MARK);
    host.until(60_000, |host| host.state() == State::Eroding && host.deep() >= 8);
    host.set(0x201A, 7, &7u16.to_le_bytes());
    host.run(1500);
    let before = [10, 11, 12].map(|sub| host.read(0x201A, sub));
    assert!(before.iter().all(|number| *number > 0), "{before:?}");
    assert_eq!(host.read(0x201A, 15), 0);
    let deep = host.deep();
    host.cut();
    host.cut();
    assert_eq!((host.read(0x201A, 7), host.read(0x201A, 9)), (7, State::Eroding as i32));
    // What is kept is 10 ms old at the most.
    assert!((deep - 1..=deep + 2).contains(&host.deep()) && host.read(0x201A, 5) == DEPTH);
    let after = [10, 11, 12].map(|sub| host.read(0x201A, sub));
    assert!(
        before.iter().zip(after).all(|(before, after)| (-1..=1).contains(&(after - before))),
        "{before:?}, {after:?}"
    );
    host.finish(BY_MARK);
    host.run(20);
    assert_eq!(host.read(0x201A, 15), 1, "a hole");
    assert!(host.read(0x201A, 12) > after[2]);
    // A reset of the node is no other thing.
    host.send(0, &[0x81, ID]);
    host.boot();
    assert_eq!((host.read(0x201A, 1), host.read(0x201A, 15)), (1, 1));
    assert!((DEPTH..=DEPTH + 2).contains(&host.deep()));
    // It can be given up.
    assert_eq!((host.go_on(0), host.read(0x201A, 1), host.go_on(BOTTOM)), (Ok(()), 0, Err(1)));
}

/// A hole of half its depth, whose head has been without power.
fn begun(method: u8) -> Host {
    let mut host = Host::new(&[]);
    host.begin(method);
    host.until(60_000, |host| host.state() == State::Eroding && host.deep() >= DEPTH / 2);
    host.cut();
    host
}

#[test]
fn it_is_not_gone_on_with_where_its_place_is_not_known() {
    let mut host = begun(BY_MARK);
    assert_eq!(host.go_on(BOTTOM), Err(3), "not homed");
    host.enable();
    assert_eq!(host.go_on(BOTTOM), Err(3), "not homed");
    host.home(BY_MARK);
    assert_eq!(host.go_on(BOTTOM), Err(7), "nothing touched");
    // A chip in the hole; work that is gone, or an electrode that is shorter.
    for (mm, why) in [(0.1, 9), (-0.15, 10)] {
        host.happen("workpiece.raised_mm", Value::Number(mm));
        host.touch();
        assert_eq!(host.go_on(BOTTOM), Err(why), "{mm} mm");
        // The work must not rise into the electrode.
        host.move_to(MARK + 100);
    }
    host.happen("workpiece.raised_mm", Value::Number(0.0));
    assert_eq!(host.go_on(REFERENCE), Err(11), "no reference");
    host.touch();
    host.start_to(MARK + 100);
    assert_eq!(host.go_on(BOTTOM), Err(12), "it moves");
    host.move_to(MARK + 100);
    host.touch();
    assert_eq!(host.go_on(BOTTOM), Ok(()), "all as it was");
}

#[test]
fn another_home_or_another_encoder_is_not_that_of_the_hole() {
    let mut host = begun(BY_MARK);
    host.enable();
    host.home_at(HERE, 900);
    host.touch();
    assert_eq!(host.go_on(BOTTOM), Err(4), "another method");
    host.set(0x6040, 0, &0x06u16.to_le_bytes());
    host.run(500);
    host.set(0x2108, 4, &3u32.to_le_bytes());
    assert_eq!(host.go_on(BOTTOM), Err(5), "another encoder");
}

#[test]
fn a_home_without_a_mark_takes_a_touch_of_what_was_not_eroded() {
    let mut host = begun(HERE);
    host.enable();
    // Somewhere in the hole.
    host.home_at(HERE, 900);
    host.touch();
    assert_eq!(host.go_on(BOTTOM), Err(8));
    let deep = host.deep();
    let truth = host.head().process.truth();
    let beside = (truth.surface_um - truth.first_surface_um) * 1e-3;
    host.happen("workpiece.raised_mm", Value::Number(beside));
    let surface = host.touch();
    assert_eq!(host.go_on(BESIDE), Ok(()));
    assert_eq!(host.read(0x2011, 11), surface);
    assert_eq!(host.deep(), deep);
}

#[test]
fn the_reference_places_the_hole_and_says_how_much_the_electrode_has_worn() {
    let mut host = Host::new(&["model.wear_positive=0.3"]);
    host.enable();
    host.home(BY_MARK);
    let reference = host.touch();
    host.set(0x2011, 5, &[2]);
    host.set(0x2011, 11, &reference.to_le_bytes());
    host.erode();
    host.until(120_000, |host| host.state() == State::Done);
    host.cut();
    host.enable();
    host.home(BY_MARK);
    let truth = host.head().process.truth();
    let (beside, wears) = ((truth.surface_um - truth.first_surface_um) * 1e-3, truth.wear_um);
    host.happen("workpiece.raised_mm", Value::Number(beside));
    let touched = host.touch();
    host.set(0x2115, 3, &0.5f32.to_le_bytes());
    assert_eq!(host.go_on(REFERENCE), Err(10), "more than it may have worn");
    host.set(0x2115, 3, &50.0f32.to_le_bytes());
    assert_eq!(host.go_on(REFERENCE), Ok(()));
    // The face is worn unevenly: what touches is what has worn least.
    let wear = host.read(0x2011, 8);
    assert!(wear > 2 && wear == touched - reference && f64::from(wear) < wears, "{wear} of {wears} um");
    assert_eq!(host.read(0x2011, 11), reference);
}

#[test]
fn a_hole_in_which_the_encoder_was_lost_is_not_gone_on_with() {
    let mut host = Host::new(&[]);
    host.begin(BY_MARK);
    host.until(60_000, |host| host.state() == State::Eroding && host.deep() >= DEPTH / 3);
    host.happen("encoder.cut", Value::Flag(true));
    host.until(5000, |host| host.state() == State::Fault);
    host.run(20);
    host.happen("encoder.cut", Value::Flag(false));
    host.cut();
    assert_eq!((host.read(0x201A, 1), host.go_on(BOTTOM)), (1, Err(6)));
}

#[test]
fn a_record_that_is_damaged_is_named_and_noise_is_nothing() {
    for (damage, state, why) in [(true, 3, 2), (false, 0, 1)] {
        let mut host = Host::new(&[]);
        host.begin(BY_MARK);
        host.until(60_000, |host| host.state() == State::Eroding);
        let battery = host.head().battery().clone();
        {
            let mut words = battery.words();
            let all = 0..words.len();
            for place in all {
                words[place] = if damage { words[place] ^ u32::from(place % 7 == 5) << 9 } else { 0x1234_5678 };
            }
        }
        host.cut();
        assert_eq!((host.read(0x201A, 1), host.go_on(BOTTOM)), (state, Err(why)));
    }
}
