//! From reset to running tasks: the board, the settings, the head, the queues.

use super::can::{Receive, Transmit};
use super::encoder::{self, Decoder};
use super::gap::Gap;
use super::idle::Idle;
use super::keeper::Keeper;
use super::protocol::{Protocol, Uptime, log_boot, log_report};
use super::servo::{Carried, Servo};
use super::supervise::Supervise;
use super::timers::Timers;
use super::{BUILD, BUILD_NUMBER, ENCODER, NODE, Queues, REFLEX, ROLL};
use core::mem::MaybeUninit;
use edm_hal_shim::clock::Clock;
use edm_hal_shim::encoder::QuadratureLines;
use edm_hal_shim::generator::Generator;
use edm_hal_shim::stm32f4::gated::Gated;
use edm_hal_shim::stm32f4::machine::Machine;
use edm_hal_shim::stm32f4::start::StartError;
use edm_hal_shim::stm32f4::watchdog::Watchdog;
use edm_hal_shim::stm32f4::{boot, ccm, lines, pac};
use edm_hal_shim::store::BUFFER;
use edm_servo_head::canopen::Node;
use edm_servo_head::canopen::drive::{BLANK, DEVICE, Drive, Identity, Record};
use edm_servo_head::encoder::{DecoderCount, Handover, Quadrature, TimerCount};
use edm_servo_head::gap::Voltage;
use edm_servo_head::head::{Fault, Head, State, Supervisor, TickInput};
use edm_servo_head::path::Path;
use edm_servo_head::settings::{SettingError, Settings};
use edm_servo_head::stored::StoredImage;

/// Every task with what it owns.
#[allow(missing_docs, reason = "each is the task of its name")]
pub struct Tasks {
    pub reflex: Gated,
    pub decoder: Decoder,
    pub gap: Gap,
    pub servo: Servo,
    pub supervise: Supervise,
    pub receive: Receive,
    pub transmit: Transmit,
    pub protocol: Protocol,
    pub idle: Idle,
}

/// Memory for what is too large to be moved about the stack.
pub struct Slots {
    node: MaybeUninit<Node>,
    drive: MaybeUninit<Result<Drive, SettingError>>,
    record: Record,
    image: StoredImage,
}

/// Node and drive with their values.
const _: () = assert!(size_of::<Slots>() - size_of::<Record>() - size_of::<StoredImage>() <= 4096);

impl Slots {
    /// Nothing is in them.
    pub const fn new() -> Slots {
        Slots { node: MaybeUninit::uninit(), drive: MaybeUninit::uninit(), record: BLANK, image: StoredImage::NOTHING }
    }
}

#[inline(never)]
fn place_node(slot: &'static mut MaybeUninit<Node>) -> &'static mut Node {
    slot.write(Node::new(&DEVICE, NODE, boot::serial_number()))
}

#[inline(never)]
fn place_drive(
    slot: &'static mut MaybeUninit<Result<Drive, SettingError>>,
    identity: Identity,
    record: &'static mut Record,
) -> Result<&'static mut Drive, StartError> {
    let drive = slot.write(Drive::new(Settings::default(), identity, record));
    drive.as_mut().map_err(|_| StartError::Settings)
}

/// Node and drive begin with what is kept.
#[inline(never)]
fn restore(keeper: &mut Keeper, node: &mut Node, drive: &mut Drive) {
    let image = keeper.load();
    log_report(&drive.restart(Settings::default(), image));
    log_boot(drive.boot(node, image));
}

/// Starts the board, then the head, disabled and inhibited. `watchdog` keeps the watchdog when something does not start.
pub fn start(
    device: pac::Peripherals,
    core: cortex_m::Peripherals,
    queues: &'static mut Queues,
    buffer: &'static mut [u8; BUFFER],
    slots: &'static mut Slots,
    watchdog: &mut Option<Watchdog>,
) -> Result<Tasks, StartError> {
    let machine = Machine::start(device, core, BUILD_NUMBER, &REFLEX, watchdog)?;
    defmt::info!("build {=str}, {}", BUILD, machine.boot);
    let Machine { clock, mut thresholds, mut generator, .. } = machine;
    let mut keeper = Keeper::new(machine.flash, buffer, &mut slots.image)?;
    let identity = Identity { reset_cause: machine.boot.cause as u32, build: BUILD };
    let node = place_node(&mut slots.node);
    let drive = place_drive(&mut slots.drive, identity, &mut slots.record)?;
    restore(&mut keeper, node, drive);
    // The first order is to configure the head, which begins with it below.
    let _ = drive.take();
    let active = drive.active().clone();
    let path = ccm::place(|| Path::EMPTY).ok_or(StartError::Memory)?;
    thresholds.set(&active.reflex).map_err(|_| StartError::Settings)?;
    REFLEX.set(&active.reflex);
    generator.request_off_time(active.off_time_ns);

    let (sender, receiver, filters) = match machine.can {
        Ok((sender, receiver, filters)) => (Some(sender), Some(receiver), Some(filters)),
        Err(error) => {
            defmt::error!("CAN: {}", error);
            (None, None, None)
        }
    };
    let quadrature = Quadrature::on(encoder::Shared, machine.lines.levels(), clock.now());
    let (statuses_in, statuses) = queues.statuses.split();
    let (faults_in, faults) = queues.faults.split();
    let (requests_in, requests) = queues.requests.split();
    let (answers_in, answers) = queues.answers.split();
    let (granted_in, granted) = queues.granted.split();
    let (returned_in, returned) = queues.returned.split();
    let (changes_in, changes) = queues.changes.split();
    let (checked_in, checked) = queues.checked.split();
    let (reports_in, reports) = queues.reports.split();
    let (published_in, published) = queues.published.split();
    let (configurations_in, configurations) = queues.configurations.split();
    let (gaps_in, gaps) = queues.gaps.split();
    let (limits_in, limits) = queues.limits.split();
    let (resets_in, resets) = queues.resets.split();
    let (received_in, received) = queues.received.split();
    let (sending_in, sending) = queues.sending.split();

    let servo = Servo {
        head: Head::new(active.head, path),
        bridge: machine.bridge,
        generator,
        inputs: machine.inputs,
        drive: machine.drive,
        decoder: DecoderCount::new(&ENCODER, clock),
        timer: TimerCount::new(machine.timer, clock),
        handover: Handover::new(),
        clock,
        forced: lines::forced(),
        retreats: 0,
        state: State::Disabled,
        input: TickInput::default(),
        reading: 0,
        told: (Fault::HostSilent, 0),
        carried: Carried::NONE,
        at_sync: None,
        timed: 0,
        faults,
        requests,
        answers: answers_in,
        configurations,
        granted: granted_in,
        returned,
        statuses: statuses_in,
        published: published_in,
        changes: changes_in,
        checked: checked_in,
    };
    let supervise = Supervise {
        millisecond: machine.millisecond,
        supervisor: Supervisor::default(),
        limits: active.head.supervise,
        clock,
        count: 0,
        statuses,
        settings: limits,
        faults: faults_in,
        reports: reports_in,
    };
    let protocol = Protocol {
        clock,
        uptime: Uptime::new(clock.now()),
        node,
        drive,
        filters,
        thresholds,
        timers: Timers::new(clock.now()),
        known: 0,
        syncs: 0,
        received,
        sending: sending_in,
        published,
        changes,
        checked,
        requests: requests_in,
        answers,
        configurations: configurations_in,
        gaps: gaps_in,
        limits: limits_in,
        resets: resets_in,
    };
    let mut watchdog = watchdog.take().ok_or(StartError::Watchdog)?;
    watchdog.normal()?;
    let idle = Idle { watchdog, keeper, clock, reset: None, reports, granted, returned: returned_in, resets };
    ROLL.start(clock.now());
    Ok(Tasks {
        reflex: machine.reflex,
        decoder: Decoder { lines: machine.lines, clock, quadrature },
        gap: Gap { blocks: machine.blocks, source: Voltage::new(active.gap), clock, block: None, settings: gaps },
        servo,
        supervise,
        receive: Receive { receiver, clock, received: received_in },
        transmit: Transmit { sender, sending },
        protocol,
        idle,
    })
}
