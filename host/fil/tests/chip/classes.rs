//! The same pulses on the chip, in the core on a PC, and in a recording that is replayed: the same classes.
//!
//! `EDM_CLASSES` is the number of pulses.

use crate::common;
use edm_fil::host;
use edm_fil::image::Image;
use edm_fil::rig::{Emulated, Witness};
use edm_hal_shim::edges::gate_mask;
use edm_hal_shim::gap::{BLOCK, Edges, GapBlock};
use edm_servo_head::gap::pulses::{Class, PulseStream};
use edm_servo_head::gap::{GapSource as _, Voltage};
use edm_servo_head::head::State;
use edm_servo_head::settings::{Declared as _, Settings, Value};
use edm_servo_head::units::{Nanometres, TICKS_PER_MS};
use edm_sim::machine::Rig as _;
use edm_sim::replay;
use edm_sim::replay::converter::Gate;
use edm_sim::replay::recording::Recording;
use edm_sim::run::Setup;
use edm_soc::TICK_HZ;

/// Pulses before those that are compared: the first may have begun before the recording. Of two lists one may begin so many earlier.
const BEFORE: usize = 100;
const EARLIER: usize = 4;
/// Cycles by which noise moves the moment at which a recorded voltage crosses a threshold: 4 V of a collapse of 60 V in 0.3 us (estimated).
const NOISE: i32 = 8;
/// Core cycles from the beginning of a window to the middle of the first conversion of the block that is the newest when it is looked at:
/// its last conversion is complete 6 us before, after 12 cycles of 21 MHz, and its aperture has 15.
const FIRST: f64 = -(6.0 * 168.0 + 12.0 * 8.0 + 7.5 * 8.0 + 24.0 * 336.0);

/// Classes of the pulses of blocks, one by one, by the core on a PC.
struct Native {
    source: Voltage,
    stream: PulseStream,
    blocks: usize,
    classes: Vec<Class>,
}

impl Native {
    fn new(settings: &Settings) -> Native {
        let active = settings.build().unwrap();
        let stream = PulseStream::new(settings.boundaries().build().unwrap());
        Native { source: Voltage::new(active.gap), stream, blocks: 0, classes: Vec::new() }
    }

    /// Takes a block as the head does; gives all counts.
    fn block(&mut self, block: &GapBlock) -> [u32; 6] {
        self.blocks += 1;
        if self.blocks.is_multiple_of(TICKS_PER_MS as usize) {
            self.stream.look();
        }
        self.stream.block(block, |pulse| self.classes.push(pulse.class));
        let counted = self.source.update(Some(block)).pulses.classes;
        assert_eq!(counted, self.stream.counts().classes);
        counted
    }
}

/// A block whose edges of the high comparator, and of the gate, came so many cycles later.
fn moved(block: &GapBlock, high: i32, gate: i32) -> GapBlock {
    let edges = |edges: &Edges, by: i32| {
        let mut moved = Edges::NONE;
        for at in edges.times() {
            assert!(moved.push((i32::from(*at) + by).clamp(0, 8675) as u16));
        }
        moved
    };
    let mut other =
        GapBlock { high_edges: edges(&block.high_edges, high), gate_edges: edges(&block.gate_edges, gate), ..*block };
    if gate != 0 {
        // What comes behind the block is not known here: the last conversion stays.
        let last = 1 << (BLOCK - 1);
        let gated = gate_mask(block.gate_was_open, other.gate_edges.times(), u32::MAX);
        other.gate = gated & !last | block.gate & last;
    }
    other
}

/// Numbers of the pulses that differ, of those from `BEFORE` on, at the shift at which the fewest do, with the class in the other list.
fn compare(name: &str, pulses: usize, of: &[Class], with: &[Class]) -> Vec<(usize, Class)> {
    let at = |shift: usize| {
        let pairs = of[BEFORE..].iter().zip(&with[BEFORE - EARLIER + shift..]).take(pulses);
        assert_eq!(pairs.len(), pulses);
        (BEFORE..).zip(pairs).filter(|(_, (a, b))| a != b).map(|(n, (_, b))| (n, *b)).collect::<Vec<_>>()
    };
    let differ = (0..=2 * EARLIER).map(at).min_by_key(Vec::len).unwrap();
    println!("classes: {name}: {} of {pulses} differ", differ.len());
    differ
}

fn wanted(pulses: usize) -> usize {
    std::env::var("EDM_CLASSES").ok().and_then(|pulses| pulses.parse().ok()).unwrap_or(pulses)
}

/// The recording has a sample every other cycle: what it does not show of an edge, the stamps of the chip hardly show.
#[test]
fn ten_thousand_pulses_have_the_same_classes_on_the_chip_on_a_pc_and_in_a_recording() {
    thrice(32.0, 8.0, 0.5, wanted(10_000), 84e6);
}

/// As fast as `replay` reads a file. Noise of 20 dB below the burning voltage, and conversions enough after most ignitions: ten thousand at a release.
#[test]
fn noisy_pulses_have_the_same_classes_on_the_chip_on_a_pc_and_in_a_recording() {
    thrice(160.0, 40.0, 4.0, wanted(2000), 1e7);
}

fn thrice(on_us: f64, off_us: f64, noise_v: f64, pulses: usize, rate: f64) {
    let image = Image::parse(common::firmware().to_vec()).unwrap();
    let Setup { process: mut plant, head, .. } = Setup::load("sinker").unwrap();
    for (key, value) in [("model.on_us", on_us), ("model.off_us", off_us), ("front_end.noise_v", noise_v)] {
        plant.set(key, Value::Number(value)).unwrap();
    }
    plant.installation.surface = 0.2;
    let settings = Settings { commissioned: true, ..head };
    let mut rig = Emulated::start(&image, plant, &settings, 1, Witness::None).unwrap();
    host::begin(&mut rig).unwrap();
    common::bore(&mut rig, Nanometres(3_000_000));
    let eroding = (0..200_000).any(|_| {
        rig.tick().unwrap();
        rig.status().state == State::Eroding
    });
    assert!(eroding, "{:?}", rig.status());
    rig.process_mut().fault_inputs.arcs = 0.2;
    let made = rig.process_mut().truth().pulses;
    let begun = rig.pulses().unwrap().counted;
    let (mut chip, mut own) = (Native::new(&settings), Native::new(&settings));
    let mut recording = Recording { start_s: 0.0, rate, gate: Some(Vec::new()), ..Recording::default() };
    // The same with edges that come a step of the recording sooner or later.
    let step = (TICK_HZ as f64 / rate).ceil() as i32 + NOISE;
    let mut beside = [(step, 0), (-step, 0), (0, step), (0, -step)].map(|by| (by, Native::new(&settings)));
    let (mut begin, mut samples, mut before) = (None, 0u64, None);
    while chip.classes.len() < pulses + 2 * BEFORE {
        rig.tick().unwrap();
        // The chip and the core on a PC, on the block of the chip: all counts.
        let block = rig.block().unwrap().expect("a block");
        let (counted, native) = (rig.pulses().unwrap().counted.classes, chip.block(&block));
        let since = |first: &[u32; 6], now: [u32; 6]| -> [u32; 6] { std::array::from_fn(|i| now[i] - first[i]) };
        let (first, mine) = *before.get_or_insert((counted, native));
        // A pulse that was open when this began is another one to a stream that has not seen it open.
        if chip.blocks > 20 {
            assert_eq!(since(&first, counted), since(&mine, native), "block {}", chip.blocks);
        } else {
            before = Some((counted, native));
        }
        for ((high, gate), native) in &mut beside {
            native.block(&moved(&block, *high, *gate));
        }
        // The block that a native head makes of the same process.
        let block = rig.process().sensors().block;
        own.block(&block);
        // The line as an oscilloscope records it, beginning with the first conversion of a block.
        let began = rig.window_began();
        let begin = *begin.get_or_insert(began as f64 + FIRST + 2.0 * 8400.0);
        let world = &mut rig.machine_mut().soc().world;
        loop {
            let at = (begin + samples as f64 * TICK_HZ as f64 / rate).round() as u64;
            if at >= began + 8400 {
                break;
            }
            let (volts, gate) = world.scope(at);
            recording.gap_v.push(volts);
            recording.gate.as_mut().unwrap().push(gate);
            samples += 1;
        }
    }
    // What the chip recognises; a pulse or two are on their way.
    let made = rig.process_mut().truth().pulses.since(&made);
    let named = rig.pulses().unwrap().counted.since(&begun);
    let [open, spark, arc, uncertain] =
        [Class::Open, Class::Spark, Class::Arc, Class::Uncertain].map(|class| named.class(class));
    println!(
        "classes: {on_us} us on, noise of {noise_v} V: open {open} of {}, spark {spark} of {}, arc {arc} of {}, uncertain {uncertain} of {}",
        made.open,
        made.spark,
        made.arc,
        made.total()
    );
    // None is called by another's name, but for what ignites with the end of its gate.
    assert!(u64::from(arc) <= made.arc + 2 + made.arc / 1000, "{named:?}, {made:?}");
    assert!(u64::from(spark) <= made.spark + 2 + made.spark / 1000, "{named:?}, {made:?}");
    assert!(u64::from(open) <= made.open + 2 + made.open / 100, "{named:?}, {made:?}");
    assert!(u64::from(uncertain) * 100 <= made.total(), "{named:?}, {made:?}");
    let replayed = replay::run(&recording, &settings, Gate::AsRecorded).unwrap();
    let replayed: Vec<Class> = replayed.rows.iter().flat_map(|row| row.classes.iter().copied()).collect();
    let of = |class: Class| chip.classes.iter().filter(|of| **of == class).count();
    let kinds = [Class::Open, Class::Spark, Class::Arc].map(of);
    assert!(kinds.iter().all(|count| *count > pulses / 20), "{kinds:?}");
    // Stamps and conversions are off by a few cycles: what differs, lies there.
    for (name, with) in [("a native head's own blocks", &own.classes), ("a recording", &replayed)] {
        let differ = compare(name, pulses, &chip.classes, with);
        assert!(differ.len() * 1000 <= pulses, "{name}: {} of {pulses}", differ.len());
        // A sample of the recording has a noise of its own: one that both call by a name has the same, but for such an edge.
        let named = |n: usize, class| class != Class::Uncertain && chip.classes.get(n) != Some(&Class::Uncertain);
        for (n, class) in differ.into_iter().filter(|(n, class)| named(*n, *class)) {
            assert!(
                beside.iter().any(|(_, native)| native.classes.get(n) == Some(&class)),
                "pulse {n}: {:?}, in {name} {class:?}",
                chip.classes[n]
            );
        }
    }
}
