//! A host guides the head with pulses on.

use crate::bench::Bench;
use edm_servo_head::head::{Command, Fault, Guidance, MotionLimits, Reason, Refused, State};
use edm_servo_head::units::{Fixed, MicrometresPerSecond, MicrometresPerSecond2, Nanometres, PLAN_TICKS, TICK_HZ};

/// Servo ticks from a set point to the next.
const PERIOD: u32 = 20;
/// `feed.acceleration_m_s2`, counts/s^2.
const ACCELERATION: f64 = 5e6;

/// Follows the set points of a host.
struct Host {
    bench: Bench,
    /// Velocity of the set point, counts/s, and its largest change from a tick to one a plan later.
    velocity: f64,
    velocities: Vec<f64>,
    hardest: f64,
    at: Fixed,
    /// Where the host is, nm, and how fast, um/s.
    to: i64,
    feed: f64,
}

impl Host {
    /// Guides a head that stands at 1 mm, the work a metre away.
    fn guiding() -> Host {
        let mut bench = Bench::cleared();
        bench.command(Command::Position(Nanometres(1_000_000), limits(20_000.0)));
        bench.run_until(1.0, |bench| bench.state() == State::Ready);
        bench.command(Command::Guide);
        bench.run(0.01);
        let at = bench.head.status().setpoint;
        let to = at.round() * 1000;
        Host { bench, velocity: 0.0, velocities: vec![0.0; 5], hardest: 0.0, at, to, feed: 0.0 }
    }

    fn ticks(&mut self, ticks: u32) {
        for _ in 0..ticks {
            self.bench.tick();
            let at = self.bench.head.status().setpoint;
            self.velocity = (at.0 - self.at.0) as f64 / 2f64.powi(24) * f64::from(TICK_HZ);
            self.at = at;
            // The fifth before it: a plan ago.
            let before = self.velocities.remove(0);
            self.velocities.push(self.velocity);
            self.hardest = self.hardest.max((self.velocity - before).abs());
        }
    }

    fn set_point(&mut self) {
        self.to += (self.feed * 1e3 * f64::from(PERIOD) / f64::from(TICK_HZ)) as i64;
        self.bench.command(Command::Follow(Nanometres(self.to), PERIOD));
    }

    /// So many set points, each in time.
    fn leads(&mut self, points: u32, feed: f64) {
        self.feed = feed;
        for _ in 0..points {
            self.set_point();
            self.ticks(PERIOD);
        }
    }

    fn guidance(&self) -> Guidance {
        self.bench.head.status().guidance
    }

    fn late(&self) -> u32 {
        self.bench.head.status().late_set_points
    }

    /// Counts by which the set point is ahead of the host's newest.
    fn ahead(&self) -> f64 {
        self.at.to_f32() as f64 - self.to as f64 / 1000.0
    }
}

fn limits(velocity: f32) -> MotionLimits {
    let ramp = MicrometresPerSecond2(1e6);
    MotionLimits { velocity: MicrometresPerSecond(velocity), acceleration: ramp, deceleration: ramp }
}

/// Change of velocity in the time of a plan that the acceleration allows. A set point may come between two plans.
const STEP: f64 = ACCELERATION * 7.0 / TICK_HZ as f64;

#[test]
fn a_guided_head_follows_set_points_either_way_with_pulses_on() {
    let mut host = Host::guiding();
    for feed in [200.0, 4000.0, -4000.0, -200.0] {
        host.leads(300, feed);
        assert!(host.bench.output.pulses);
        assert_eq!(host.guidance(), Guidance::Follows, "{feed} um/s");
        assert!((host.velocity - feed).abs() < feed.abs() * 0.01, "{feed} um/s: {}", host.velocity);
        // Half a period and a plan behind, at the end of a period; the bench's commands are judged by an estimate as old.
        let behind = -host.ahead() / feed * f64::from(TICK_HZ);
        assert!((9.0..=15.0).contains(&behind), "{feed} um/s: {behind} ticks");
    }
    host.leads(200, 0.0);
    assert_eq!(host.guidance(), Guidance::Rests);
    assert!(host.ahead().abs() < 0.01 && host.hardest < STEP, "{} counts, {} counts/s", host.ahead(), host.hardest);
    assert_eq!((host.late(), host.bench.state()), (0, State::Guiding));
}

#[test]
fn a_set_point_late_by_half_a_period_makes_no_step_and_a_later_one_is_waited_for() {
    // The bench's commands are judged by an estimate that may be a plan old.
    for late in 0..=PERIOD / 2 - PLAN_TICKS {
        let mut host = Host::guiding();
        host.leads(100, 3000.0);
        (host.hardest, host.feed) = (0.0, 3000.0);
        // One that is late; those after it are in time again.
        host.ticks(late);
        host.set_point();
        host.ticks(PERIOD - late);
        for _ in 0..20 {
            host.set_point();
            host.ticks(PERIOD);
        }
        // A tick of 30: the clock of the host is followed.
        assert!(host.hardest < 0.04 * 3000.0, "{late} ticks: {} counts/s", host.hardest);
        assert_eq!(host.late(), 0, "{late} ticks: it comes before the head has arrived");
    }
    let mut host = Host::guiding();
    host.leads(100, 3000.0);
    host.hardest = 0.0;
    host.ticks(PERIOD);
    assert_eq!((host.late(), host.guidance()), (1, Guidance::Waits));
    host.ticks(5 * PERIOD);
    assert!(host.velocity.abs() < 1.0 && host.ahead().abs() < 2.0, "{} counts/s, {}", host.velocity, host.ahead());
    host.leads(100, 3000.0);
    assert!(host.hardest < STEP, "{} counts/s", host.hardest);
    assert_eq!((host.late(), host.guidance()), (1, Guidance::Follows));
}

#[test]
fn a_host_whose_clock_runs_otherwise_is_followed_without_a_late_set_point() {
    for (every, extra) in [(50, 1), (50, -1)] {
        let mut host = Host::guiding();
        host.leads(100, 3000.0);
        host.hardest = 0.0;
        for n in 0..5000 {
            host.feed = if n % 200 < 100 { 3000.0 } else { -3000.0 };
            host.set_point();
            host.ticks(if n % every == 0 { (PERIOD as i32 + extra) as u32 } else { PERIOD });
        }
        assert_eq!(host.late(), 0, "{extra}");
        assert!(host.hardest < STEP, "{} counts/s", host.hardest);
    }
}

#[test]
fn in_a_retreat_the_head_leads_and_comes_back_to_a_host_that_went_on_without_a_step() {
    for feed in [-500.0, 0.0, 300.0, 3000.0] {
        let mut host = Host::guiding();
        host.leads(100, feed);
        host.bench.surface_um = host.bench.um() - 100.0;
        host.leads(15, feed);
        assert_eq!(host.bench.state(), State::Retreating, "{feed}");
        assert_eq!(host.guidance(), Guidance::Leads);
        assert!(host.bench.head.status().feed.0 < 0.0);
        assert!(host.ahead() < -10.0, "{feed}: straight up, {} counts", host.ahead());
        host.bench.surface_um = 1e6;
        host.leads(1, feed);
        host.hardest = 0.0;
        let mut furthest = f64::MIN;
        let mut points = 0;
        while host.guidance() == Guidance::Leads {
            host.leads(1, feed);
            furthest = furthest.max(host.ahead());
            assert!(
                host.bench.head.status().feed.0 <= 0.0 || host.guidance() != Guidance::Leads,
                "the host is to wait"
            );
            points += 1;
            assert!(points < 1000, "{feed}: {} counts behind", host.ahead());
        }
        host.leads(20, feed);
        assert_eq!(host.bench.state(), State::Guiding);
        assert!(host.hardest < STEP, "{feed}: {} counts/s", host.hardest);
        assert!(furthest < 1.0 + feed.abs() * 0.002, "{feed}: {furthest} counts beyond the host");
        assert!((host.velocity - feed).abs() < 1.0 + feed.abs() * 0.01, "{feed}: {}", host.velocity);
    }
}

#[test]
fn guiding_begins_in_motion_and_positions_on_a_profile() {
    let mut host = Host::guiding();
    host.bench.command(Command::Position(Nanometres(3_000_000), limits(4000.0)));
    host.ticks(2000);
    assert_eq!((host.bench.state(), host.guidance()), (State::Guiding, Guidance::Follows));
    assert!((host.velocity - 4000.0).abs() < 1.0);
    host.ticks(12_000);
    assert_eq!(host.guidance(), Guidance::Rests);
    assert!((host.at.to_f32() - 3000.0).abs() < 0.01);
    assert!(host.hardest < STEP);
    // From a motion without pulses.
    host.bench.command(Command::Hold);
    host.ticks(5);
    assert_eq!(host.bench.state(), State::HoldingPosition);
    host.bench.command(Command::Position(Nanometres(2_000_000), limits(4000.0)));
    host.ticks(2000);
    host.hardest = 0.0;
    host.bench.command(Command::Guide);
    host.ticks(100);
    assert!(host.bench.output.pulses && (host.velocity + 4000.0).abs() < 1.0);
    host.ticks(10_000);
    assert!((host.at.to_f32() - 2000.0).abs() < 0.01 && host.hardest < STEP);
}

#[test]
fn a_guided_head_in_motion_comes_to_rest_on_a_ramp() {
    for end in [Command::Hold, Command::Brake(MicrometresPerSecond2(1e6))] {
        let mut host = Host::guiding();
        host.leads(100, 4000.0);
        host.hardest = 0.0;
        host.bench.command(end);
        host.ticks(5);
        assert!(!host.bench.output.pulses);
        assert_eq!(host.bench.state(), State::Positioning);
        host.ticks(200);
        assert_eq!((host.bench.state(), host.guidance()), (State::Ready, Guidance::No));
        assert!(host.hardest < STEP, "{} counts/s", host.hardest);
    }
}

#[test]
fn a_fault_leads_a_guided_head_straight_up_from_where_it_is() {
    let mut host = Host::guiding();
    host.leads(300, 3000.0);
    let before = host.bench.um();
    host.bench.head.raise(Fault::HostSilent);
    host.ticks(2);
    assert!(!host.bench.output.pulses);
    host.ticks(20_000);
    let lift = before - host.bench.um();
    let safe = f64::from(host.bench.settings.retreat_safe);
    assert!((lift - safe).abs() < 0.05 * safe, "{lift} um of {safe}");
}

#[test]
fn a_guided_head_goes_no_faster_than_the_approach_where_it_has_not_been() {
    let mut host = Host::guiding();
    host.bench = Bench::ready();
    host.bench.surface_um = 1e6;
    host.bench.command(Command::Guide);
    host.ticks(100);
    host.bench.command(Command::Position(Nanometres(3_000_000), limits(50_000.0)));
    host.ticks(2000);
    assert!((host.velocity - 5000.0).abs() < 1.0, "{}", host.velocity);
    assert!(host.bench.head.status().approaching);
}

#[test]
fn what_would_end_guiding_without_a_word_is_refused() {
    let mut host = Host::guiding();
    let state = Err(Refused::State(State::Guiding));
    assert_eq!(host.bench.head.command(Command::Guide), state);
    assert_eq!(host.bench.head.command(Command::Start), state);
    assert_eq!(host.bench.head.command(Command::MoveBy(Nanometres(1000))), state);
    assert_eq!(host.bench.head.command(Command::Touch(Nanometres(1000), limits(1000.0))), state);
    assert_eq!(host.bench.head.command(Command::ClearPath), state);
    let changes: Vec<_> = host.bench.changes().iter().map(|change| change.reason).collect();
    assert_eq!(changes.last(), Some(&Reason::Started));
}

#[test]
fn a_late_set_point_does_not_hide_that_the_head_leads_out_of_a_short() {
    let mut host = Host::guiding();
    host.leads(100, 3000.0);
    host.ticks(2 * PERIOD);
    assert_eq!(host.guidance(), Guidance::Waits);
    host.bench.surface_um = host.bench.um() - 100.0;
    host.ticks(60);
    assert_eq!((host.bench.state(), host.guidance()), (State::Retreating, Guidance::Leads));
}

#[test]
fn a_setpoint_in_per_cent_of_the_open_circuit_asks_a_guiding_host_for_feed() {
    use edm_servo_head::settings::SetpointUnit;
    let mut bench = Bench::with(|settings| settings.gap_setpoint_unit = SetpointUnit::PercentOfOpen);
    bench.make_ready();
    bench.command(Command::Guide);
    bench.run(1.0);
    assert_eq!(bench.head.status().guidance, Guidance::Rests);
    assert!(bench.head.status().feed.0 > 0.0, "the gap is open, and the host waits: {:?}", bench.head.status().feed);
}

#[test]
fn guiding_that_begins_while_a_held_retreat_still_moves_makes_no_step() {
    let mut host = Host::guiding();
    host.leads(100, 500.0);
    host.bench.surface_um = host.bench.um() - 300.0;
    host.ticks(200);
    assert_eq!(host.bench.state(), State::Retreating);
    host.bench.surface_um = 1e6;
    host.hardest = 0.0;
    host.bench.command(Command::Hold);
    // Not before the path rests.
    let mut refused = 0;
    while host.bench.head.command(Command::Guide).is_err() {
        refused += 1;
        host.ticks(1);
    }
    assert!((1..100).contains(&refused), "{refused}");
    host.ticks(100);
    assert_eq!(host.bench.state(), State::Guiding);
    assert!(host.hardest < STEP, "{} counts/s", host.hardest);
}

#[test]
fn a_touch_under_way_is_not_gone_on_with_into_the_work_when_guiding_begins() {
    let mut bench = Bench::ready();
    bench.command(Command::Touch(Nanometres(4_000_000), limits(3000.0)));
    bench.run(0.05);
    if bench.head.command(Command::Guide).is_ok() {
        bench.run(2.0);
        let shorts = bench.changes().iter().filter(|change| change.reason == Reason::Short).count();
        assert_eq!(shorts, 0, "the head goes on hitting the work at {} um", bench.um());
    }
}

#[test]
fn whatever_a_host_sends_and_whenever_a_short_comes_no_limit_is_passed() {
    for seed in 1..=12u64 {
        let mut random = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
        let mut next = |n: u64| {
            random ^= random << 13;
            random ^= random >> 7;
            random ^= random << 17;
            random % n
        };
        let mut host = Host::guiding();
        let most = f64::from(host.bench.settings.build().unwrap().head.axis.gains.velocity_limit().0);
        for _ in 0..400 {
            let to = match next(8) {
                0 => next(12_000_000) as i64,
                1 => host.to + 20_000_000,
                2 => host.to - 20_000_000,
                _ => host.to + next(40_000) as i64 - 20_000,
            };
            host.to = to.clamp(-1_000_000, 13_000_000);
            host.bench.command(Command::Follow(Nanometres(host.to), [1, 20, 100, 5_000][next(4) as usize]));
            if next(20) == 0 {
                host.bench.surface_um = host.bench.um() - next(200) as f64;
            } else if next(3) == 0 {
                host.bench.surface_um = 1e6;
            }
            for _ in 0..1 + next(60) {
                let state = host.bench.state();
                host.hardest = 0.0;
                host.ticks(1);
                let both = state == State::Guiding && host.bench.state() == State::Guiding;
                assert!(host.velocity.abs() < most * 1.01, "seed {seed}: {} counts/s, {most} at most", host.velocity);
                let at = host.at.to_f32();
                assert!(!both || (-2000.0..14_000.0).contains(&at), "seed {seed}: at {at}");
            }
            if host.bench.state() == State::Fault {
                println!("seed {seed}: {:?}", host.bench.fault());
                break;
            }
        }
    }
}

#[test]
fn a_guided_head_does_not_go_past_the_end_of_its_travel() {
    let mut host = Host::guiding();
    host.bench.command(Command::Position(Nanometres(12_000_000), limits(20_000.0)));
    host.ticks(20_000);
    assert_eq!(host.guidance(), Guidance::Rests);
    let mut highest = f32::MAX;
    // A host that goes as fast as the head may, and stops at the end.
    host.to = 12_000_000;
    for _ in 0..400 {
        host.to = (host.to - 95_000).max(0);
        assert_eq!(host.bench.fault(), None, "set point at {highest} um, the travel begins at 0");
        host.bench.command(Command::Follow(Nanometres(host.to), PERIOD));
        for _ in 0..PERIOD {
            host.ticks(1);
            highest = highest.min(host.at.to_f32());
        }
    }
    assert!(highest > -5.0, "set point at {highest} um, the travel begins at 0");
}
