//! A host that keeps the path leads the head over the bus, pulses on.

use crate::rig::Rig;
use edm_servo_head::head::State;

/// What 1000 per mille mean, um/s.
const FEED: i32 = 200;
/// Time from a set point to the next, ms.
const PERIOD: i32 = 5;

/// Guided in cyclic synchronous position, 5 ms a set point by RPDO 2 and SYNC, some um above the work.
fn guided(above: i32) -> (Rig, i32) {
    let mut rig = Rig::ready();
    rig.write(0x1401, 2, &[1]);
    rig.write(0x60C2, 1, &[PERIOD as u8]);
    rig.write32(0x2001, 8, FEED);
    rig.mode(1);
    let truth = rig.machine.process.truth();
    let surface = truth.surface_um as i32 - (truth.position_um as i32 - rig.position() as i32);
    rig.move_to(surface - above, 3000);
    rig.mode(8);
    rig.write(0x2001, 1, &[2]);
    rig.until(20, |rig| rig.machine.status().state == State::Guiding);
    (rig, surface)
}

/// A CNC that goes by the adaptive feed.
struct Cnc {
    /// Where it is, nm.
    at: i64,
    /// Set points sent while the head has led.
    led: u32,
    /// Deepest set point of the head against the host's, counts; the loop over it may overshoot by a few in coming back.
    beyond: f32,
}

impl Cnc {
    fn new(rig: &Rig) -> Cnc {
        Cnc { at: rig.position() * 1000, led: 0, beyond: 0.0 }
    }

    fn target(&self) -> i32 {
        (self.at / 1000) as i32
    }

    /// One set point, not beyond `depth`; the drive's answer is read over the bus.
    fn cycle(&mut self, rig: &mut Rig, depth: i32) {
        let feed = i64::from(rig.read(0x2004, 8) as u16 as i16);
        self.at = (self.at + feed * i64::from(FEED * PERIOD) / 1000).min(i64::from(depth) * 1000);
        rig.send(0x305, &self.target().to_le_bytes());
        rig.send(0x80, &[]);
        rig.run(PERIOD as u64 - 2);
        // What the drive hears of in the next millisecond.
        let leads = rig.machine.status().state == State::Retreating;
        rig.run(1);
        assert!(!(leads && rig.status() & 0x1000 != 0), "the head leads, and bit 12 says that it follows");
        self.led += u32::from(rig.status() & 0x1000 == 0);
        let ahead = rig.machine.status().setpoint.to_f32() - self.target() as f32;
        self.beyond = self.beyond.max(ahead);
    }
}

#[test]
fn a_cnc_bores_by_its_own_set_points_and_the_adaptive_feed() {
    let (mut rig, surface) = guided(30);
    let mut cnc = Cnc::new(&rig);
    let depth = surface + 20;
    let mut cycles = 0;
    while cnc.target() < depth || (rig.position() as i32 - depth).abs() > 2 {
        cnc.cycle(&mut rig, depth);
        cycles += 1;
        assert!(cycles < 60_000, "at {} of {depth}, the host at {}", rig.position(), cnc.target());
        assert!(rig.machine.status().state.pulses(), "{:?}", rig.machine.status());
    }
    // It goes on keeping the gap there, and no deeper.
    for _ in 0..100 {
        cnc.cycle(&mut rig, depth);
    }
    // Before the host falls silent, wherever it was on its way to.
    assert_eq!(rig.machine.status().late_set_points, 0);
    let deepest = rig.read(0x2006, 4) as i32;
    assert!((deepest - depth).abs() <= 2, "{deepest} of {depth}");
    assert!(cnc.beyond <= 1.0, "{} counts beyond the host", cnc.beyond);
    assert!(rig.read(0x2006, 3) > 1000);
    assert_eq!(rig.read(0x2001, 1), 2, "guided all the time");
}

#[test]
fn a_short_is_retreated_from_and_the_host_is_told_who_leads() {
    let (mut rig, surface) = guided(200);
    let mut cnc = Cnc::new(&rig);
    for _ in 0..20 {
        cnc.cycle(&mut rig, surface);
    }
    let before = (rig.position(), cnc.target());
    assert_eq!((rig.read(0x2000, 8), rig.status() & 0x1000), (1, 0x1000));
    assert!(before.1 > surface - 200 + 5);
    rig.machine.process.fault_inputs.short = true;
    cnc.cycle(&mut rig, surface);
    cnc.cycle(&mut rig, surface);
    assert_eq!((rig.read(0x2000, 8), rig.status() & 0x1000), (3, 0));
    assert!(rig.position() < before.0 - 10, "{} from {}", rig.position(), before.0);
    // The host is called back, along its own path.
    assert!((rig.read(0x2004, 8) as u16 as i16) < 0);
    rig.machine.process.fault_inputs.short = false;
    for _ in 0..40 {
        cnc.cycle(&mut rig, surface);
    }
    assert_eq!((rig.read(0x2000, 8), rig.status() & 0x1000), (1, 0x1000));
    assert!((rig.position() as i32 - cnc.target()).abs() <= 3);
    assert!(cnc.led >= 2 && cnc.beyond <= 1.0, "{} {}", cnc.led, cnc.beyond);
}

#[test]
fn profile_and_interpolated_positions_are_followed_with_pulses_on() {
    let mut rig = Rig::ready();
    rig.mode(1);
    rig.write(0x2001, 1, &[2]);
    for target in [600, 300] {
        rig.write32(0x607A, 0, target);
        rig.control(0x0F);
        rig.control(0x1F);
        assert_eq!(rig.status() & 0x1400, 0x1000, "taken, and not there");
        rig.until(1000, |rig| rig.status() & 0x0400 != 0);
        assert!((rig.position() as i32 - target).abs() <= 2, "{}", rig.position());
        assert_eq!(rig.machine.status().state, State::Guiding);
    }
    rig.write(0x2001, 1, &[0]);
    rig.mode(7);
    rig.write(0x60C2, 1, &[10]);
    rig.write(0x2001, 1, &[2]);
    let start = rig.position() as i32;
    for n in 1..=20 {
        rig.write32(0x60C1, 1, start + n * 20);
    }
    rig.control(0x1F);
    rig.run(250);
    assert!((rig.position() as i32 - start - 400).abs() <= 2, "{}", rig.position());
    assert_eq!(rig.machine.status().state, State::Guiding);
}

#[test]
fn whatever_ends_guiding_ends_what_2001h_says_of_it() {
    type End = (&'static str, fn(&mut Rig));
    let ends: [End; 7] = [
        ("2001h:1 = 0", |rig| rig.write(0x2001, 1, &[0])),
        ("2001h:2 = 1", |rig| rig.write(0x2001, 2, &[1])),
        ("halt", |rig| rig.control(0x10F)),
        ("quick stop", |rig| rig.control(0x0B)),
        ("disable operation", |rig| rig.control(0x07)),
        ("disable voltage", |rig| rig.control(0x00)),
        ("a mode", |rig| rig.write(0x6060, 0, &[3])),
    ];
    for (what, end) in ends {
        let (mut rig, surface) = guided(200);
        let mut cnc = Cnc::new(&rig);
        for _ in 0..20 {
            cnc.cycle(&mut rig, surface);
        }
        end(&mut rig);
        rig.run(50);
        assert!(!rig.machine.status().state.pulses(), "{what}");
        assert_eq!((rig.read(0x2001, 1), rig.read(0x2000, 8), rig.read(0x2004, 8)), (0, 0, 0), "{what}");
    }
}

#[test]
fn guiding_is_refused_where_nothing_would_be_followed() {
    type Before = (&'static str, fn(&mut Rig));
    let before: [Before; 4] = [
        ("halted", |rig| rig.control(0x10F)),
        ("disabled", |rig| rig.control(0x07)),
        ("profile velocity", |rig| rig.mode(3)),
        ("homing", |rig| rig.mode(6)),
    ];
    for (what, before) in before {
        let mut rig = Rig::ready();
        rig.mode(8);
        before(&mut rig);
        rig.run(50);
        assert_eq!(rig.try_write(0x2001, 1, &[2]), Err(0x0800_0022), "{what}");
        assert_eq!(rig.read(0x2001, 1), 0, "{what}");
    }
    // What the head itself refuses is told by an event, and 2001h does not say otherwise.
    let mut rig = Rig::ready();
    rig.mode(8);
    rig.machine.process.fault_inputs.safety.dielectric = true;
    rig.run(2);
    rig.sent.clear();
    rig.write(0x2001, 1, &[2]);
    rig.run(2);
    assert_eq!((rig.read(0x2001, 1), rig.read(0x2000, 4), rig.read(0x2000, 7)), (0, 8, 1));
    assert!(rig.sent.iter().any(|(_, frame)| frame.id() == 0x185 && frame.data()[3..5] == [8, 1]));
}

#[test]
fn erosion_begins_out_of_guiding() {
    let (mut rig, surface) = guided(200);
    rig.write(0x2001, 1, &[1]);
    rig.write32(0x607A, 0, surface - 100);
    rig.until(50, |rig| rig.machine.status().state == State::Seeking);
    rig.until(2000, |rig| rig.machine.status().state == State::Done);
    assert!((rig.position() as i32 - surface + 100).abs() <= 1);
}

#[test]
fn no_mode_is_a_mode_without_positions_and_guides_nobody() {
    let mut rig = Rig::ready();
    rig.mode(0);
    assert_eq!(rig.try_write(0x2001, 1, &[2]), Err(0x0800_0022));
}

#[test]
fn profile_velocity_that_is_chosen_out_of_no_mode_ends_guiding() {
    let mut rig = Rig::ready();
    rig.mode(0);
    rig.write32(0x60FF, 0, 500);
    if rig.try_write(0x2001, 1, &[2]).is_ok() {
        rig.run(20);
        let _ = rig.try_write(0x6060, 0, &[3]);
        rig.run(200);
    }
    assert!(!rig.machine.status().state.pulses(), "{:?} at {}", rig.machine.status().state, rig.position());
}
