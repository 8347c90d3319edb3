//! From reset to running tasks: the board, what is stored, the head, the crossings.

use crate::chip::{Chip, Count, ENCODER, Rtic, SIGNALS};
use core::mem::MaybeUninit;
use edm_hal_shim::stage::Stage as _;
use edm_hal_shim::stm32f4::boot::Cause;
use edm_hal_shim::stm32f4::ends::{Ends, Over};
use edm_hal_shim::stm32f4::gated::Gated;
use edm_hal_shim::stm32f4::machine::Machine;
use edm_hal_shim::stm32f4::start::StartError;
use edm_hal_shim::stm32f4::watchdog::Watchdog;
use edm_hal_shim::stm32f4::{Board, boot, ccm, pac, pwm};
use edm_hal_shim::store::{BUFFER, Store};
use edm_hal_shim::watchdog::Watchdog as _;
use edm_runtime::board::Caller;
use edm_runtime::can::{Receive, Transmit};
use edm_runtime::encoder::Decoder;
use edm_runtime::gap::Gap;
use edm_runtime::idle::Idle;
use edm_runtime::image_store::ImageStore;
use edm_runtime::plan::Plans;
use edm_runtime::protocol::Protocol;
use edm_runtime::servo::Servo;
use edm_runtime::supervise::Supervise;
use edm_runtime::{Crossings, Note, Parts, Room, assemble};
use edm_servo_head::backup::Keeper;
use edm_servo_head::canopen::drive::{BLANK, DEVICE, Drive, Identity, Record};
use edm_servo_head::canopen::{BitRate, BusSettings, Node};
use edm_servo_head::gap::Voltage;
use edm_servo_head::path::Path;
use edm_servo_head::scope::Memory;
use edm_servo_head::settings::Settings;
use edm_servo_head::stored::StoredImage;

/// How a head is reached that has nothing stored: it waits for a node-ID.
const UNCONFIGURED: BusSettings =
    BusSettings { node: None, bit_rate: BitRate::from_hz(Board::TABLE.bit_rate).unwrap() };
/// Commit of this build, eight hexadecimal digits.
const BUILD: &str = env!("EDM_BUILD");
/// The same as a number.
const BUILD_NUMBER: u32 = match u32::from_str_radix(BUILD, 16) {
    Ok(build) => build,
    Err(_) => 0,
};

const _: () = assert!(ccm::KEPT == Memory::WORDS);

/// Every task with what it owns.
#[allow(missing_docs, reason = "each is the task of its name")]
pub struct Tasks {
    pub reflex: Gated,
    pub ends: Ends,
    pub over: Over,
    pub decoder: Decoder<Chip>,
    pub gap: Gap<Chip>,
    pub servo: Servo<Chip>,
    pub plan: &'static mut Plans<Chip>,
    pub supervise: &'static mut Supervise<Chip>,
    pub receive: Receive<Chip>,
    pub transmit: Transmit<Chip>,
    pub protocol: &'static mut Protocol<Chip>,
    pub idle: Idle<Chip>,
}

/// Memory for what is too large to be moved about the stack.
pub struct Slots {
    crossings: Crossings,
    buffer: [u8; BUFFER],
    node: MaybeUninit<Node>,
    drive: MaybeUninit<Drive>,
    protocol: MaybeUninit<Protocol<Chip>>,
    record: Record,
    image: StoredImage,
}

impl Slots {
    /// Nothing is in them.
    pub const fn new() -> Slots {
        Slots {
            crossings: Crossings::new(),
            buffer: [0; BUFFER],
            node: MaybeUninit::uninit(),
            drive: MaybeUninit::uninit(),
            protocol: MaybeUninit::uninit(),
            record: BLANK,
            image: StoredImage::NOTHING,
        }
    }
}

// Each kept apart, so that its value is built where it stays and not on the stack of `start`.
#[inline(never)]
fn place_node(slot: &'static mut MaybeUninit<Node>, settings: BusSettings) -> &'static mut Node {
    slot.write(Node::new(&DEVICE, settings, boot::serial_number()))
}

#[inline(never)]
fn defaults() -> Result<Settings, StartError> {
    Settings::with(Board::TABLE.defaults).map_err(|_| StartError::Settings)
}

/// The drive, with the board's defaults and what is stored; the node begins with that, too.
#[inline(never)]
fn place_drive(
    slot: &'static mut MaybeUninit<Drive>,
    record: &'static mut Record,
    identity: Identity,
    image: &StoredImage,
    node: &mut Node,
) -> Result<&'static mut Drive, StartError> {
    let defaults = defaults()?;
    let drive = Drive::new_in(slot, defaults, identity, record).map_err(|_| StartError::Settings)?;
    Rtic.note(&Note::Loaded(drive.restart(defaults, image)));
    Rtic.note(&Note::booted(drive.boot(node, image)));
    Ok(drive)
}

/// Starts the board, then the head, disabled and inhibited. `watchdog` keeps the watchdog when something does not start.
pub fn start(
    device: pac::Peripherals,
    core: cortex_m::Peripherals,
    slots: &'static mut Slots,
    room: Room<Chip>,
    watchdog: &mut Option<Watchdog>,
) -> Result<Tasks, StartError> {
    let machine = Machine::start(device, core, BUILD_NUMBER, (&SIGNALS.reflex, &SIGNALS.pauses), watchdog)?;
    defmt::info!("build {=str}, {}", BUILD, machine.boot);
    if machine.self_test.failed() {
        defmt::error!("{}", machine.self_test);
    }
    let store = Store::new(machine.flash, 0).map_err(|_| StartError::Settings)?;
    let mut image_store = ImageStore::new(store, &mut slots.buffer, &mut slots.image, Rtic);
    let identity = Identity {
        reset_cause: machine.boot.cause as u32,
        build: BUILD,
        self_test: machine.self_test,
        last_end: machine.boot.death as u8,
    };
    let image = image_store.load();
    let node = place_node(&mut slots.node, image.bus().unwrap_or(UNCONFIGURED));
    let drive = place_drive(&mut slots.drive, &mut slots.record, identity, image, node)?;
    node.set_program(machine.stage.id());
    let mut keeper = Keeper::new(machine.backup);
    drive.recall(keeper.load());
    // What it orders at the start is how the head begins below.
    drive.started();
    let path: &'static mut Path = ccm::place(|| Path::EMPTY).ok_or(StartError::Memory)?;
    let scope = Memory::over(ccm::kept()).ok_or(StartError::Memory)?;
    if machine.boot.cause == Cause::Power {
        scope.clear();
    }
    let can = machine.can.inspect_err(|error| defmt::error!("CAN: {}", error)).ok();
    let parts = Parts {
        clock: machine.clock,
        caller: Rtic,
        self_test: machine.self_test,
        registers: machine.registers,
        published: (Count, &ENCODER),
        lines: machine.lines,
        guard: machine.guard,
        timer: machine.timer,
        blocks: machine.blocks,
        source: Voltage::new(drive.active().gap),
        bridge: machine.bridge,
        generator: machine.generator,
        inputs: machine.inputs,
        drive: machine.drive,
        forced: machine.forced,
        live: machine.live,
        tick: machine.tick,
        millisecond: machine.millisecond,
        steps: machine.steps,
        thresholds: machine.thresholds,
        can,
        sync: machine.sync,
        scope,
    };
    let tasks = assemble(parts, room, &mut slots.crossings, &SIGNALS, drive.active(), path)
        .map_err(|_| StartError::Settings)?;
    let mut watchdog = watchdog.take().ok_or(StartError::Watchdog)?;
    watchdog.normal().map_err(|_| StartError::Watchdog)?;
    let tasks = Tasks {
        reflex: machine.reflex,
        ends: machine.ends.0,
        over: machine.ends.1,
        decoder: tasks.decoder,
        gap: tasks.gap,
        servo: tasks.servo,
        plan: tasks.plan,
        supervise: tasks.supervise,
        receive: tasks.receive,
        transmit: tasks.transmit,
        protocol: tasks.host.protocol(&mut slots.protocol, node, drive, &defaults()?),
        idle: tasks.idle.idle(watchdog, image_store, keeper, machine.stage),
    };
    // The first tick comes half a period late, and none follows it early.
    pwm::await_middle();
    Ok(tasks)
}
