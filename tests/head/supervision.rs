//! The supervision alone, a millisecond at a time: every limit from both sides, and either way.

use edm_hal_shim::bridge::Drive;
use edm_hal_shim::encoder::RawCount;
use edm_hal_shim::reflex::PulseCounts;
use edm_servo_head::encoder::Snapshot;
use edm_servo_head::gap::Quality;
use edm_servo_head::gap::pulses::Class;
use edm_servo_head::gap::voltage::Average;
use edm_servo_head::head::{Counters, Fault, Measured, State, SupervisionConfig, Supervisor};
use edm_servo_head::settings::Settings;
use edm_servo_head::units::{CountsPerSecond, TICKS_PER_MS};

/// What the supervision of a healthy head sees, which holds its position at its net weight.
struct Watched {
    supervisor: Supervisor,
    config: SupervisionConfig,
    now: Measured,
    /// Counts in a millisecond; one that goes to and fro by two counts has 0 of them, but does not
    /// stand still, as one that trembles by one does: a single line of it still works.
    counts: i32,
    trembles: i32,
    count: i32,
    ms: i32,
    /// The second counter, where wired, is off by this.
    watch: Option<i32>,
    /// Duty that was in force, current that flowed, A, and voltage of the bus.
    duty: f64,
    amps: f64,
    bus: f64,
    host_alive: bool,
    /// Edges of the gate and conversions in a millisecond, if not as many as are permitted.
    pulses: Option<[u8; 2]>,
    counted: PulseCounts,
    /// The converter of the drive has stopped.
    stands: bool,
    /// That of the motor current gives one code in a millisecond.
    one_code: bool,
}

impl Watched {
    fn with(change: impl FnOnce(&mut Settings)) -> Watched {
        let mut settings = Settings::default();
        change(&mut settings);
        let config = settings.build().unwrap().head.supervision();
        let mut watched = Watched {
            supervisor: Supervisor::default(),
            config,
            now: Measured { quality: Quality::Valid, ..Measured::default() },
            counts: 0,
            trembles: 2,
            count: 0,
            ms: 0,
            watch: None,
            duty: 0.0,
            amps: 0.0,
            bus: 48.0,
            host_alive: true,
            pulses: None,
            counted: PulseCounts::default(),
            stands: false,
            one_code: false,
        };
        // Disabled; then the loop is closed.
        assert_eq!(watched.first(5), None);
        watched.now.state = State::Ready;
        watched.now.closed = true;
        watched.now.duty = config.limits.breakaway.holding;
        assert_eq!(watched.first(5), None);
        watched
    }

    fn new() -> Watched {
        Watched::with(|_| {})
    }

    fn look(&mut self) -> Option<Fault> {
        self.ms += 1;
        self.count += self.counts;
        let count = self.count + self.trembles * (self.ms & 1);
        let raw = RawCount { count: count as u32, ..RawCount::default() };
        let watch = self.watch.map(|off| RawCount { count: raw.count.wrapping_add_signed(off), ..raw });
        let [edges, conversions] = self.pulses.unwrap_or(if self.now.pulses { [20, 10] } else { [0; 2] });
        let counted = &mut self.counted;
        counted.edges = counted.edges.wrapping_add(edges);
        counted.conversions = counted.conversions.wrapping_add(conversions);
        // The gap voltage has shown as many pulses.
        self.now.counts.classes[Class::Open as usize] += u32::from(edges / 2);
        // Sound converters and comparators.
        let noise = self.ms as u16 % 7;
        // Current flows, without a voltage.
        (counted.newest, counted.comparators) = ([3000 + noise, 420 + noise], [counted.edges; 2]);
        let counters = Counters {
            used: Snapshot { raw, ..Snapshot::default() },
            watch,
            pulses: self.counted,
            drive_stands: self.stands,
        };
        let code = (self.amps / f64::from(self.config.amps_per_code.0)).round() as i32;
        self.now.bus = (self.bus / f64::from(self.config.bus_per_code.0)).round() as u16;
        let sums = &mut self.now.sums;
        sums.ticks += TICKS_PER_MS;
        sums.newest = code;
        sums.current += code * TICKS_PER_MS as i32;
        // A sound converter has noise.
        sums.squares = sums.squares.wrapping_add((code * code) as u32 * TICKS_PER_MS + u32::from(!self.one_code));
        sums.duty += (self.duty * f64::from(Drive::FULL) * f64::from(TICKS_PER_MS)).round() as i32;
        // A sound converter, unless it gives one code.
        let code = if self.now.code == 0 { 2000 + self.ms as u16 % 2 } else { self.now.code };
        let now = Measured { permitted: self.now.permitted || self.now.pulses, code, ..self.now };
        self.supervisor.tick(&self.config, &now, &counters, self.host_alive)
    }

    /// The first fault within so many milliseconds, and which of them found it.
    fn first(&mut self, ms: u32) -> Option<(u32, Fault)> {
        (1..=ms).find_map(|ms| self.look().map(|fault| (ms, fault)))
    }
}

/// What is wrong now is found after so many milliseconds; or never.
fn finds(fault: Option<(u32, Fault)>, case: &str, wrong: impl FnOnce(&mut Watched)) {
    let mut watched = Watched::new();
    wrong(&mut watched);
    assert_eq!(watched.first(1000), fault, "{case}");
}

const WAYS: [f32; 2] = [1.0, -1.0];

#[test]
fn a_gap_voltage_of_one_code_is_none_whether_there_are_pulses_or_not() {
    let gap = Some((401, Fault::GapSignalInvalid));
    for pulses in [false, true] {
        finds(gap, "one code", |w| (w.now.code, w.now.pulses) = (2000, pulses));
        finds(None, "at the end of its range", |w| (w.now.code, w.now.pulses) = (4095, pulses));
    }
    finds(None, "disabled", |w| (w.now.code, w.now.state, w.now.closed) = (2000, State::Disabled, false));
    let mut watched = Watched::new();
    for _ in 0..5 {
        watched.now.code = 2000;
        assert_eq!(watched.first(400), None);
        watched.now.code = 0;
        assert_eq!(watched.first(2), None);
    }
}

#[test]
fn a_following_error_is_too_large_either_way_and_for_longer_than_its_time() {
    for way in WAYS {
        finds(None, "200 counts", |w| w.now.following = 200.0 * way);
        finds(Some((11, Fault::FollowingError)), "more", |w| w.now.following = 200.1 * way);
        finds(None, "without a loop", |w| (w.now.closed, w.now.following) = (false, 300.0 * way));
        // A reaction does not push a head down that has risen by itself.
        let fault = (way < 0.0).then_some((11, Fault::FollowingError));
        finds(fault, "in a fault's reaction", |w| (w.now.state, w.now.following) = (State::Fault, 300.0 * way));
    }
}

#[test]
fn what_lasts_has_to_last_without_a_pause() {
    let mut watched = Watched::new();
    for _ in 0..20 {
        watched.now.following = 300.0;
        assert_eq!(watched.first(10), None);
        watched.now.following = 0.0;
        assert_eq!(watched.first(1), None);
    }
}

#[test]
fn a_head_that_runs_against_a_saturated_duty_has_a_wrong_polarity_either_way() {
    let runs = |duty: f32, mm_s: f32| {
        move |w: &mut Watched| {
            w.now.saturated = true;
            w.now.duty = duty;
            w.now.velocity = CountsPerSecond(mm_s * 1000.0);
        }
    };
    for way in WAYS {
        finds(None, "as fast as it may be", runs(0.9 * way, -50.0 * way));
        finds(Some((11, Fault::PolarityWrong)), "faster", runs(0.9 * way, -50.1 * way));
        finds(None, "the way it is pushed", runs(0.9 * way, 80.0 * way));
        finds(None, "not saturated", |w| {
            runs(0.9 * way, -80.0 * way)(w);
            w.now.saturated = false;
        });
        finds(None, "without a loop", |w| {
            runs(0.9 * way, -80.0 * way)(w);
            w.now.closed = false;
        });
    }
}

#[test]
fn a_lift_that_sinks_has_a_wrong_polarity_and_one_that_rises_has_not() {
    let lifts = |duty: f32, mm_s: f32| {
        move |w: &mut Watched| {
            (w.now.state, w.now.closed) = (State::Fault, false);
            w.now.duty = duty;
            w.now.velocity = CountsPerSecond(mm_s * 1000.0);
        }
    };
    finds(None, "slowly", lifts(-0.01, 50.0));
    finds(Some((11, Fault::PolarityWrong)), "fast", lifts(-0.01, 50.1));
    finds(None, "rises", lifts(-0.01, -80.0));
    finds(None, "is let down", lifts(0.01, 80.0));
}

/// When a mass of 0.2 kg that a friction holds must have gone the 8 um that are waited for, under a push of the default actuator
/// that becomes what is needed in half a second; and have overcome a film (N s/m) by the 3 um that it may keep unseen.
fn lost(push: f32, friction: f32, film: f64) -> Option<(u32, Fault)> {
    let newtons = |duty: f64| duty * 48.0 / 12.4 * 7.5;
    let (mut impulse, mut way) = (0.0, 0.0);
    (1..10_000).find_map(|ms| {
        way += impulse / 0.2 * 1e-3;
        let push = f64::from(push) * (1.0 - 1.0 / 512.0f64).powi(ms as i32 - 1);
        impulse += newtons(push - f64::from(friction)) * 1e-3;
        (way > 8e-6 && impulse > film * 3e-6).then_some((ms, Fault::EncoderLost))
    })
}

#[test]
fn an_encoder_that_stands_still_against_what_moves_a_head_is_lost_either_way() {
    let config = Watched::new().config.limits.breakaway;
    for (way, still) in [(1.0, 0), (-1.0, 0), (1.0, 1), (-1.0, 1)] {
        // By a following error, once the duty is beyond the friction as well.
        let follows = |error: f32, duty: f32| {
            move |w: &mut Watched| {
                w.trembles = still;
                w.now.following = config.following * error * way;
                w.now.duty = config.holding + config.friction * duty * way;
            }
        };
        finds(None, "held by friction", follows(0.99, 1.05));
        finds(None, "a duty within the friction", follows(1.01, 0.95));
        finds(None, "one that still pushes the other way", follows(1.01, -1.05));
        finds(lost(config.friction * 1.05, config.friction, 0.0), "not held", follows(1.01, 1.05));
        finds(lost(config.friction * 3.0, config.friction, 0.0), "pushed harder", follows(1.01, 3.0));
        finds(None, "but it counts", |w| {
            follows(1.01, 1.05)(w);
            w.trembles = 2;
        });
        // By what the loop gives, under any error that is more than a tremble.
        let pushed = |share: f32, following: f32| {
            move |w: &mut Watched| {
                w.trembles = still;
                w.now.duty = config.holding + config.push * share * way;
                w.now.following = following * way;
            }
        };
        let lost = lost(config.push * 1.05, config.friction, 0.0);
        finds(None, "a push that friction holds", pushed(0.99, -config.tremble - 0.1));
        finds(lost, "one that it does not", pushed(1.05, config.tremble + 0.1));
        finds(lost, "whichever way the error", pushed(1.05, -config.tremble - 0.1));
        finds(None, "a tremble", pushed(1.05, config.tremble));
        for state in [State::Fault, State::Commissioning] {
            finds(None, "from stop to stop", |w| {
                pushed(1.05, 10.0)(w);
                w.now.state = state;
            });
        }
        finds(None, "without a loop", |w| {
            pushed(1.05, 10.0)(w);
            w.now.closed = false;
        });
    }
}

#[test]
fn a_head_that_turns_round_may_be_where_it_was() {
    let turns = |velocity: f32, sides: [f32; 2]| {
        let mut watched = Watched::new();
        let breakaway = watched.config.limits.breakaway;
        watched.trembles = 0;
        watched.now.following = 2.0 * breakaway.following;
        watched.now.velocity = CountsPerSecond(velocity);
        (0..100).find_map(|ms| {
            watched.now.duty = breakaway.holding + 2.0 * breakaway.push * sides[ms % 2];
            watched.look()
        })
    };
    // Braked at the end of a jump, and driven back at once.
    assert_eq!(turns(0.0, [-1.0, 1.0]), None);
    assert_eq!(turns(0.0, [1.0, 1.0]), Some(Fault::EncoderLost), "pushed one way");
    // Edges since the look before; the newest one of an encoder that counts no more is older.
    for velocity in [2000.0, -2000.0] {
        assert_eq!(turns(velocity, [1.0, 1.0]), None);
        assert_eq!(turns(0.99 * velocity, [1.0, 1.0]), Some(Fault::EncoderLost));
    }
}

#[test]
fn a_weight_that_was_held_for_long_is_no_push() {
    for way in WAYS {
        let mut watched = Watched::new();
        let breakaway = watched.config.limits.breakaway;
        watched.now.duty = breakaway.holding + 2.0 * breakaway.push * way;
        assert_eq!(watched.first(3000), None);
        (watched.trembles, watched.now.following) = (0, breakaway.tremble + 1.0);
        assert_eq!(watched.first(100), None);
        // Nor is the duty of before, when it has gone.
        watched.now.duty = breakaway.holding;
        assert_eq!(watched.first(100), None);
        // And what was needed is forgotten with the loop.
        watched.now.closed = false;
        assert_eq!(watched.first(1), None);
        (watched.now.closed, watched.now.duty) = (true, breakaway.holding + 2.0 * breakaway.push * way);
        assert_eq!(watched.first(100), lost(2.0 * breakaway.push, breakaway.friction, 0.0));
    }
}

#[test]
fn a_head_that_the_film_under_a_large_face_holds_is_given_the_time_to_move() {
    for (face, force) in [(5000.0, 2.0), (10_000.0, 2.0), (25_000.0, 5.0), (25_000.0, 20.0)] {
        let mut watched = Watched::with(|settings| (settings.face, settings.axis_breakaway) = (face, 0.0));
        // 3 pi mu R^4 / 2 h^3 with 2.4 mPa s and 20 um.
        let film = 1.5 * std::f64::consts::PI * 2.4e-3 * (f64::from(face) * 1e-6).powi(4) / 20e-6f64.powi(3);
        let breakaway = watched.config.limits.breakaway;
        watched.trembles = 0;
        watched.now.following = breakaway.following + 1.0;
        let push = (force * 12.4 / 7.5 / 48.0) as f32;
        watched.now.duty = breakaway.holding + push;
        let (found, fault) = watched.first(5000).unwrap();
        let (wanted, _) = lost(push, 0.0, film).unwrap();
        assert!(found.abs_diff(wanted) <= 1 + wanted / 100, "{face} um, {force} N: {found} ms, not {wanted}");
        assert_eq!(fault, Fault::EncoderLost);
    }
}

#[test]
fn an_encoder_that_contradicts_the_back_emf_is_lost_either_way() {
    for way in [1.0, -1.0] {
        // The duty that generates at so many mm/s, in a winding without current.
        let generates = |mm_s: f64| way * mm_s * 1e-3 * 7.5 / 48.0;
        let lost = |fault: Option<(u32, Fault)>| fault.map(|(_, fault)| fault);
        for (mm_s, counts, fault) in [
            (45.0, 0, None),
            (55.0, 0, Some(Fault::EncoderLost)),
            (200.0, 200, None),
            (200.0, 155, None),
            (200.0, 245, None),
            (200.0, 145, Some(Fault::EncoderLost)),
            (200.0, 255, Some(Fault::EncoderLost)),
            (30.0, -30, Some(Fault::EncoderLost)),
        ] {
            let mut watched = Watched::new();
            watched.duty = generates(mm_s);
            watched.counts = counts * way as i32;
            assert_eq!(lost(watched.first(1000)), fault, "{mm_s} mm/s, {counts} counts/ms, {way}");
            let mut watched = Watched::new();
            (watched.duty, watched.counts, watched.now.closed) = (generates(mm_s), counts * way as i32, false);
            assert_eq!(watched.first(1000), None, "without a loop");
        }
        // 1 A of 12.4 ohm: a fifth of 12.4 V is forgiven, and 50 mm/s, 0.375 V.
        for (share, fault) in
            [(0.79, None), (1.21, None), (0.75, Some(Fault::EncoderLost)), (1.25, Some(Fault::EncoderLost))]
        {
            let mut watched = Watched::new();
            (watched.amps, watched.duty) = (way, way * share * 12.4 / 48.0);
            assert_eq!(lost(watched.first(1000)), fault, "{share} of the resistance, {way}");
        }
    }
}

#[test]
fn counters_apart_are_a_lost_encoder_either_way_wherever_it_is_asked() {
    for way in [1, -1] {
        for (closed, state, asked) in [
            (true, State::Ready, true),
            (true, State::Fault, true),
            (false, State::Proving, true),
            (false, State::Disabled, false),
            (false, State::Fault, false),
        ] {
            for (apart, lost) in [(1, false), (2, true)] {
                let mut watched = Watched::new();
                watched.watch = Some(0);
                assert_eq!(watched.first(5), None);
                (watched.now.closed, watched.now.state) = (closed, state);
                watched.watch = Some(apart * way);
                let fault = (asked && lost).then_some((3, Fault::EncoderLost));
                assert_eq!(watched.first(100), fault, "{state:?}, {}", apart * way);
            }
        }
    }
}

#[test]
fn a_current_is_too_much_either_way_in_every_state() {
    for way in [1.0, -1.0] {
        for closed in [true, false] {
            for (amps, fault) in [(3.745, None), (3.755, Some((3, Fault::OverCurrent)))] {
                let mut watched = Watched::new();
                watched.now.closed = closed;
                (watched.amps, watched.duty) = (amps * way, amps * way * 12.4 / 48.0);
                assert_eq!(watched.first(200), fault, "{amps} A, {way}");
                let shown = watched.supervisor.monitored().current.0;
                assert!((f64::from(shown) - amps * way).abs() < 0.01, "{shown}");
            }
        }
    }
}

#[test]
fn a_drive_that_is_not_measured_is_named_after_three_milliseconds_unless_it_is_disabled() {
    finds(Some((3, Fault::DriveSignalLost)), "not converted", |watched| watched.stands = true);
    finds(None, "disabled", |watched| (watched.stands, watched.now.state) = (true, State::Disabled));
    let mut watched = Watched::new();
    for _ in 0..100 {
        // One conversion is enough.
        watched.stands = true;
        assert_eq!(watched.first(2), None);
        watched.stands = false;
        assert_eq!(watched.first(1), None);
    }
}

#[test]
fn a_winding_gets_hot_by_a_current_of_either_sign() {
    for way in [1.0, -1.0] {
        let mut watched = Watched::with(|settings| settings.motor_thermal = 1.0);
        (watched.amps, watched.duty) = (2.0 * way, 2.0 * way * 12.4 / 48.0);
        // 1 A for ever: 1 s * ln(4 / 3) at 2 A.
        assert_eq!(watched.first(280), None);
        assert!(!watched.supervisor.monitored().reduced);
        assert_eq!(watched.first(20), None);
        assert!(watched.supervisor.monitored().reduced);
    }
}

#[test]
fn a_bus_sags_at_once_while_a_loop_is_closed() {
    // 36 V, to a step of the converter.
    finds(None, "enough", |w| w.bus = 36.02);
    finds(Some((1, Fault::BusSag)), "less", |w| w.bus = 35.98);
    finds(None, "without a loop", |w| (w.now.closed, w.bus) = (false, 0.0));
}

#[test]
fn a_bad_gap_reading_matters_while_pulses_are_on() {
    for (quality, fault) in [
        (Quality::Missing, Fault::GapSignalInvalid),
        (Quality::Saturated, Fault::GapSignalInvalid),
        (Quality::Reversed, Fault::GapReversed),
        (Quality::Unclear, Fault::BurningUnclear),
        (Quality::NoGate, Fault::GateMissing),
    ] {
        finds(Some((21, fault)), "with pulses", |w| (w.now.pulses, w.now.quality) = (true, quality));
        finds(None, "without", |w| w.now.quality = quality);
    }
    finds(None, "good", |w| w.now.pulses = true);
    // A gate that is always open is none, where the average is made by it.
    let open = |w: &mut Watched| (w.now.pulses, w.pulses) = (true, Some([0, 0]));
    finds(Some((21, Fault::GateMissing)), "no edges", open);
    let mut watched = Watched::with(|settings| settings.gap_average = Average::Plain);
    open(&mut watched);
    assert_eq!(watched.first(1000), None, "nobody needs them");
}

#[test]
fn pulses_that_the_reflex_does_not_see_or_nobody_permitted_matter_while_the_head_is_enabled() {
    finds(None, "good", |w| (w.now.permitted, w.pulses) = (true, Some([20, 10])));
    finds(Some((2, Fault::ReflexLost)), "not converted", |w| (w.now.permitted, w.pulses) = (true, Some([20, 0])));
    let short = |w: &mut Watched| (w.now.permitted, w.now.short, w.pulses) = (true, true, Some([20, 10]));
    finds(Some((2, Fault::ReflexLost)), "shorts not found", short);
    finds(Some((4, Fault::UnpermittedPulses)), "nobody permitted them", |w| w.pulses = Some([20, 10]));
    let disabled = |w: &mut Watched| (w.now.state, w.now.closed, w.pulses) = (State::Disabled, false, Some([20, 10]));
    finds(None, "disabled", disabled);
}

#[test]
fn a_host_may_be_silent_for_its_time_and_where_none_is_followed() {
    let silent = |host_ms, state| {
        let mut watched = Watched::with(|settings| settings.host_ms = host_ms);
        (watched.host_alive, watched.now.state) = (false, state);
        watched.first(1000)
    };
    assert_eq!(silent(100, State::Eroding), Some((101, Fault::HostSilent)));
    assert_eq!(silent(0, State::Eroding), None, "nobody is expected");
    assert_eq!(silent(100, State::Fault), None, "it reacts already");
    assert_eq!(silent(100, State::Disabled), None);
    let mut watched = Watched::with(|settings| settings.host_ms = 100);
    for _ in 0..5 {
        watched.host_alive = false;
        assert_eq!(watched.first(100), None);
        watched.host_alive = true;
        assert_eq!(watched.first(1), None);
    }
}

#[test]
fn of_two_faults_the_more_urgent_is_told() {
    let mut watched = Watched::new();
    (watched.amps, watched.duty) = (4.0, 4.0 * 12.4 / 48.0);
    assert_eq!(watched.first(2), None);
    watched.bus = 0.0;
    assert_eq!(watched.look(), Some(Fault::OverCurrent), "and the bus sags");
    (watched.amps, watched.duty) = (0.0, 0.0);
    assert_eq!(watched.look(), Some(Fault::BusSag));
    finds(Some((11, Fault::PolarityWrong)), "polarity, following error", |w| {
        (w.now.saturated, w.now.duty, w.now.velocity) = (true, 0.9, CountsPerSecond(-1e5));
        w.now.following = 1e4;
    });
}

#[test]
fn a_motor_current_that_gives_one_code_while_the_duty_changes_is_lost_and_a_resting_one_is_not() {
    // A step of a tenth of a volt is 8 mA, three codes; two tenths are six.
    let lost_after = |volts: f64, amps: f64, codes: f64| {
        let mut watched = Watched::new();
        watched.one_code = true;
        let base = watched.amps;
        (1..=400).find_map(|ms| {
            let up = f64::from(ms & 1);
            watched.duty = up * volts / 48.0;
            watched.amps = base + amps * up + 0.00269 * codes * up;
            watched.look()
        })
    };
    assert_eq!(lost_after(0.2, 0.0, 0.0), Some(Fault::DriveSignalLost));
    assert_eq!(lost_after(0.2, 0.0, 1.0), None, "it changes, though by a single code");
    assert_eq!(lost_after(0.2, 0.2 / 12.4, 0.0), None, "it follows");
    assert_eq!(lost_after(0.1, 0.0, 0.0), None, "three codes may be what a winding does not show");
    assert_eq!(lost_after(0.0, 0.0, 0.0), None, "at rest");
}

#[test]
fn a_motor_current_without_noise_is_lost_though_the_head_rests_or_goes_steadily() {
    let lost_after = |one_code: bool| {
        let mut watched = Watched::new();
        watched.one_code = one_code;
        watched.first(1000)
    };
    assert_eq!(lost_after(true), Some((402, Fault::DriveSignalLost)));
    assert_eq!(lost_after(false), None);
}
