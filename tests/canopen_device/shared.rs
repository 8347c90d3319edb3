//! Three heads on one bus go along one path: the first leads it through its gap, and its set points of X and Y, which are those of
//! one path coordinate, are followed by the other two at every SYNC.

use crate::rig::Rig;
use edm_servo_head::head::{Fault, State};

/// Node-IDs: down, X and Y.
const NODES: [u8; 3] = [1, 2, 3];
/// PDO of the leader with its set points.
const PLACES: u16 = 0x381;
/// Where X and Y are 0, as the positions of their heads, um.
const ORIGIN: i32 = 6000;
/// Largest deviation, counts.
const DEVIATION: f64 = 2.0;

/// The bus, with a SYNC every millisecond.
struct Bus {
    heads: Vec<Rig>,
    /// Frames of each head that the others have had.
    passed: Vec<usize>,
    /// Where each was when its origin was set, um; a count is one.
    origins: Vec<f64>,
    /// Heads without power.
    dead: Vec<usize>,
    /// What was sent by each.
    emergencies: Vec<Vec<u16>>,
}

impl Bus {
    /// X and Y in the middle of their travel, the leader above the work; every head watches the two others.
    fn new() -> Bus {
        let mut heads: Vec<Rig> = NODES
            .iter()
            .map(|id| {
                let mut rig = Rig::with_id(*id, |settings, plant| {
                    // The set points are 2 ms late, and a servo takes its time where the gap reverses the feed: 2.4 counts at 0.2 mm/s
                    // and 60 Hz, 5.2 in a retreat of 1 mm/s.
                    settings.retreat_velocity = 100.0;
                    (settings.feed_max, settings.feed_retreat_max) = (100.0, 100.0);
                    settings.servo_position_hz = 100.0;
                    settings.jump_height = 500.0;
                    settings.jump_float = 50.0;
                    // X and Y move nothing that could touch.
                    plant.installation.surface = if *id == NODES[0] { 2.0 } else { 11.9 };
                });
                rig.make_ready();
                rig
            })
            .collect();
        for (place, rig) in heads.iter_mut().enumerate() {
            // Quick stop when another is lost: a retrace of its own path would lead X or Y aside.
            rig.write(0x6007, 0, &3i16.to_le_bytes());
            let pdo = |rig: &mut Rig, communication: u16, mapping: u16, id: u32, entries: &[u32]| {
                rig.write(communication, 1, &(id | 1 << 31).to_le_bytes());
                rig.write(communication, 2, &[1]);
                rig.write(mapping, 0, &[0]);
                for (sub, entry) in (1..).zip(entries) {
                    rig.write(mapping, sub, &entry.to_le_bytes());
                }
                rig.write(mapping, 0, &[entries.len() as u8]);
                rig.write(communication, 1, &id.to_le_bytes());
            };
            if place == 0 {
                pdo(rig, 0x1802, 0x1A02, PLACES.into(), &[0x200E_0C20, 0x200E_0D20]);
            } else {
                let own = 0x2017_0120;
                let entries = if place == 1 { [own, 0x0004_0020] } else { [0x0004_0020, own] };
                pdo(rig, 0x1402, 0x1602, PLACES.into(), &entries);
                rig.write32(0x2017, 2, ORIGIN * 1000);
                rig.write(0x60C2, 1, &[1]);
                rig.mode(1);
                rig.move_to(ORIGIN, 20_000);
                rig.mode(8);
            }
        }
        // At one time, as on one bus.
        let ms = heads.iter().map(|rig| rig.ms).max().unwrap();
        heads.iter_mut().for_each(|rig| rig.run(ms - rig.ms));
        let passed = heads.iter().map(|rig| rig.sent.len()).collect();
        let origins = heads.iter().map(|rig| rig.machine.process.truth().position_um).collect();
        let mut bus = Bus { heads, passed, origins, dead: Vec::new(), emergencies: vec![Vec::new(); 3] };
        // Everybody is heard before anybody is watched.
        for place in 0..3 {
            bus.write(place, 0x1017, 0, &10u16.to_le_bytes());
        }
        bus.run(20);
        for (place, own) in NODES.iter().enumerate() {
            for (sub, id) in (1..).zip(NODES.iter().filter(|id| *id != own)) {
                bus.write(place, 0x1016, sub, &(u32::from(*id) << 16 | 50).to_le_bytes());
            }
        }
        bus.run(50);
        bus
    }

    /// One millisecond of everybody.
    fn step(&mut self) {
        for (place, rig) in self.heads.iter_mut().enumerate() {
            if !self.dead.contains(&place) {
                rig.send(0x80, &[]);
                rig.step();
            }
        }
        self.pass();
    }

    fn pass(&mut self) {
        for (from, id) in NODES.iter().enumerate() {
            let new = self.heads[from].sent[self.passed[from]..].to_vec();
            self.passed[from] = self.heads[from].sent.len();
            for (_, frame) in new {
                if frame.id() == 0x80 + u16::from(*id) {
                    self.emergencies[from].push(u16::from_le_bytes([frame.data()[0], frame.data()[1]]));
                }
                for to in (0..3).filter(|to| *to != from && !self.dead.contains(to)) {
                    self.heads[to].send(frame.id(), frame.data());
                }
            }
        }
    }

    fn run(&mut self, ms: u64) {
        (0..ms).for_each(|_| self.step());
    }

    /// By SDO; the others go on meanwhile.
    fn write(&mut self, place: usize, index: u16, sub: u8, value: &[u8]) {
        self.try_write(place, index, sub, value).unwrap();
    }

    /// The same, of what may be refused.
    fn try_write(&mut self, place: usize, index: u16, sub: u8, value: &[u8]) -> Result<(), u32> {
        let before = self.heads[place].ms;
        let answer = self.heads[place].try_write(index, sub, value);
        for other in (0..3).filter(|other| *other != place && !self.dead.contains(other)) {
            while self.heads[other].ms < self.heads[place].ms {
                self.heads[other].send(0x80, &[]);
                self.heads[other].step();
            }
        }
        assert!(self.heads[place].ms > before);
        self.pass();
        answer
    }

    fn leader(&self) -> &Rig {
        &self.heads[0]
    }

    /// How far X and Y are from where the path has them, counts.
    fn deviation(&self) -> f64 {
        let beside = self.leader().machine.status().beside;
        let off = |place: usize| {
            let um = f64::from(beside[place - 1].to_f32());
            (self.heads[place].machine.process.truth().position_um - self.origins[place] - um).abs()
        };
        off(1).max(off(2))
    }

    fn until(&mut self, ms: u64, mut done: impl FnMut(&mut Bus) -> bool) {
        for _ in 0..ms {
            self.step();
            if done(self) {
                return;
            }
        }
        panic!("not within {ms} ms: {:?}", self.leader().machine.status());
    }

    /// Erodes around a circle of 0.1 mm that goes down by 0.2 mm, in two turns.
    fn eroding() -> Bus {
        let mut bus = Bus::new();
        let truth = bus.leader().machine.process.truth();
        let surface = bus.leader().position() as i32 * 1000 + ((truth.surface_um - truth.position_um) * 1000.0) as i32;
        let leader = &mut bus.heads[0];
        leader.mode(1);
        let segment = |bus: &mut Bus, shape: u8, to: [i32; 3], centre: [i32; 2]| {
            for (sub, value) in (1..).zip([to[0], to[1], to[2], centre[0], centre[1]]) {
                bus.write(0, 0x200E, sub, &value.to_le_bytes());
            }
            bus.write(0, 0x200E, 6, &[shape]);
            bus.write(0, 0x200E, 7, &[0]);
            bus.write(0, 0x200E, 8, &[1]);
            bus.run(3);
        };
        segment(&mut bus, 0, [surface - 100_000, 100_000, 0], [0; 2]);
        segment(&mut bus, 0, [surface - 30_000, 100_000, 0], [0; 2]);
        for turn in 1..3 {
            segment(&mut bus, 1, [surface - 30_000 + turn * 100_000, 100_000, 0], [-100_000, 0]);
        }
        assert_eq!(bus.heads[0].read(0x200E, 9), 0);
        bus.write(0, 0x2001, 1, &[1]);
        bus.until(20_000, |bus| {
            assert!(bus.deviation() <= DEVIATION, "{} counts while it seeks", bus.deviation());
            bus.leader().machine.status().state == State::Eroding
        });
        bus
    }
}

#[test]
fn three_heads_stay_on_one_path_while_it_is_fed_along_retreated_along_and_left_for_a_jump() {
    let mut bus = Bus::eroding();
    let (mut most, mut back, mut travelled) = (0f64, 0f64, 0f64);
    let first = bus.leader().machine.status().path;
    for ms in 0..6000 {
        bus.step();
        most = most.max(bus.deviation());
        travelled = travelled.max(bus.leader().machine.status().path.minus(first).to_f32().into());
        if ms % 1500 == 1000 {
            bus.heads[0].machine.process.fault_inputs.short = true;
            bus.until(50, |bus| bus.leader().machine.status().state == State::Retreating);
            for _ in 0..20 {
                bus.step();
                back = back.max(bus.deviation());
            }
            bus.heads[0].machine.process.fault_inputs.short = false;
        }
    }
    assert!(most.max(back) <= DEVIATION, "{most} counts in the feed, {back} in retreats");
    assert!(travelled > 60.0, "{travelled} um of path");
    let shorts = bus.heads[0].read(0x2006, 1);
    println!("largest deviation {most:.2} counts, {back:.2} in {shorts} retreats, over {travelled:.0} um of path");
    // It may be retreating just then.
    while bus.try_write(0, 0x2001, 7, &[1]).is_err() {
        bus.until(5000, |bus| bus.leader().machine.status().state == State::Eroding);
    }
    bus.until(100, |bus| bus.leader().machine.status().state == State::Jumping);
    // The float point is one step of the path, and the electrode is out of the work until it is reached.
    bus.until(1000, |bus| bus.leader().machine.status().state == State::Eroding);
    for _ in 0..1000 {
        assert!(bus.deviation() <= DEVIATION, "{} counts after the jump", bus.deviation());
        bus.step();
    }
    assert!(bus.heads.iter().all(|rig| rig.machine.status().fault.is_none()));
}

#[test]
fn a_follower_that_is_lost_stops_the_others_and_they_say_why() {
    let mut bus = Bus::eroding();
    bus.dead.push(1);
    bus.run(100);
    let y = bus.heads[2].position();
    for place in [0, 2] {
        let rig = &bus.heads[place];
        assert!(!rig.machine.status().state.pulses(), "node {}: {:?}", rig.id, rig.machine.status().state);
        assert_eq!(bus.emergencies[place].last(), Some(&0x8130), "node {}: life guard or heartbeat", rig.id);
    }
    let (path, down) = (bus.leader().machine.status().path, bus.leader().position());
    bus.run(500);
    assert_eq!((bus.leader().machine.status().path, bus.heads[2].position()), (path, y), "both hold where they are");
    assert!((bus.leader().position() - down).abs() <= 1);
}

#[test]
fn a_leader_that_is_lost_stops_the_followers_where_they_are() {
    let mut bus = Bus::eroding();
    bus.run(500);
    bus.dead.push(0);
    bus.run(100);
    let places = [1, 2].map(|place| bus.heads[place].position());
    bus.run(500);
    for (place, before) in [1, 2].into_iter().zip(places) {
        let rig = &bus.heads[place];
        assert!((rig.position() - before).abs() <= 1);
        assert_eq!(bus.emergencies[place].last(), Some(&0x8130));
        assert_ne!(rig.machine.status().fault, Some(Fault::FollowingError));
        // Quick stop active, and on.
        assert_eq!(rig.status() & 0x6F, 0x07, "node {}: {:#06x}", rig.id, rig.status());
    }
}
