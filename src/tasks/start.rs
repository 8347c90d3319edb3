//! From reset to running tasks: the board, the settings, the head, the queues.

use super::can::{Receive, Transmit};
use super::encoder::Decoder;
use super::gap::Gap;
use super::idle::Idle;
use super::keeper::Keeper;
use super::protocol::Protocol;
use super::servo::Servo;
use super::supervise::Supervise;
use super::{BUILD, ENCODER, NODE, Queues, REFLEX, ROLL};
use edm_hal_shim::clock::Clock;
use edm_hal_shim::encoder::QuadratureLines;
use edm_hal_shim::generator::Generator;
use edm_hal_shim::stm32f4::gated::Gated;
use edm_hal_shim::stm32f4::machine::Machine;
use edm_hal_shim::stm32f4::start::StartError;
use edm_hal_shim::stm32f4::watchdog::Watchdog;
use edm_hal_shim::stm32f4::{ccm, lines, pac};
use edm_hal_shim::store::BUFFER;
use edm_servo_head::encoder::{DecoderCount, Handover, Quadrature, TimerCount};
use edm_servo_head::gap::Voltage;
use edm_servo_head::head::{Fault, Head, State, Supervisor, TickInput};
use edm_servo_head::path::Path;
use edm_servo_head::remote::Heartbeat;

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

/// Starts the board, then the head, disabled and inhibited. `watchdog` keeps the watchdog when something does not start.
pub fn start(
    device: pac::Peripherals,
    core: cortex_m::Peripherals,
    queues: &'static mut Queues,
    buffer: &'static mut [u8; BUFFER],
    watchdog: &mut Option<Watchdog>,
) -> Result<Tasks, StartError> {
    let machine = Machine::start(device, core, BUILD, NODE, &REFLEX, watchdog)?;
    defmt::info!("build {=u32:08x}, {}", BUILD, machine.boot);
    let Machine { clock, mut thresholds, mut generator, .. } = machine;
    let (keeper, active) = Keeper::load(machine.flash, buffer)?;
    let path = ccm::place(|| Path::EMPTY).ok_or(StartError::Memory)?;
    thresholds.set(&active.reflex).map_err(|_| StartError::Settings)?;
    REFLEX.set(&active.reflex);
    generator.request_off_time(active.off_time_ns);

    let (sender, receiver) = match machine.can {
        Ok((sender, receiver)) => (Some(sender), Some(receiver)),
        Err(error) => {
            defmt::error!("CAN: {}", error);
            (None, None)
        }
    };
    let quadrature = Quadrature::on(&ENCODER, machine.lines.levels(), clock.now());
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
        faults,
        requests,
        answers: answers_in,
        granted: granted_in,
        returned,
        statuses: statuses_in,
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
        faults: faults_in,
        published: published_in,
        reports: reports_in,
    };
    let protocol = Protocol {
        clock,
        heartbeat: Heartbeat::default(),
        received,
        requests: requests_in,
        answers,
        published,
        sending: sending_in,
    };
    let mut watchdog = watchdog.take().ok_or(StartError::Watchdog)?;
    watchdog.normal()?;
    let idle = Idle { watchdog, keeper, clock, changes, checked, reports, granted, returned: returned_in };
    ROLL.start(clock.now());
    Ok(Tasks {
        reflex: machine.reflex,
        decoder: Decoder { lines: machine.lines, clock, quadrature },
        gap: Gap { blocks: machine.blocks, source: Voltage::new(active.gap), clock, block: None },
        servo,
        supervise,
        receive: Receive { receiver, received: received_in },
        transmit: Transmit { sender, sending },
        protocol,
        idle,
    })
}
