//! The firmware: which task does what, at which priority, by when.
//!
//! On the chip this is an RTIC 2 application. Tasks own their state; what crosses a priority crosses through an atomic or a
//! single-producer queue, and the three highest take no lock at all. Nothing here computes: the core does, and
//! `edm_hal_shim::stm32f4` knows the registers.
//!
//! On a PC the same binary prints what it is: pin maps of both boards, clocks, timers, DMA streams, CAN bit timing, tasks.
#![cfg_attr(target_arch = "arm", no_std, no_main)]

#[cfg(not(target_arch = "arm"))]
fn main() {
    use edm_hal_shim::board::{Disc, F405, write_chip};
    let mut chip = String::new();
    if write_chip(&mut chip).is_err() {
        unreachable!("a string takes everything");
    }
    println!("Firmware of the EDM servo head, {}. It runs on:\n", env!("CARGO_PKG_VERSION"));
    println!("{}\n{}\n{chip}", F405::TABLE, Disc::TABLE);
    println!("cargo firmware builds it; cargo flash-head programs it.");
}

#[cfg(target_arch = "arm")]
use defmt_rtt as _;

#[cfg(target_arch = "arm")]
#[rtic::app(device = edm_hal_shim::stm32f4::pac, peripherals = true, dispatchers = [SPI3])]
mod app {
    use core::sync::atomic::{AtomicBool, Ordering::Relaxed};
    use edm_hal_shim::board;
    use edm_hal_shim::bridge::{Drive, HBridge};
    use edm_hal_shim::clock::Clock;
    use edm_hal_shim::encoder::{EdgeCounter, QuadratureLines};
    use edm_hal_shim::gap::GapFrontEnd;
    use edm_hal_shim::generator::Generator;
    use edm_hal_shim::reflex::Limits;
    use edm_hal_shim::roll::Roll;
    use edm_hal_shim::safety::{DriveSense, Safety};
    use edm_hal_shim::stm32f4::blocks::Blocks;
    use edm_hal_shim::stm32f4::bxcan::{Data, Frame, Id, StandardId};
    use edm_hal_shim::stm32f4::can::{self, Receiver, Sender};
    use edm_hal_shim::stm32f4::cycles::Cycles;
    use edm_hal_shim::stm32f4::drive::DriveAdc;
    use edm_hal_shim::stm32f4::encoder::{self as edges, Edge, Line, Lines, Timer};
    use edm_hal_shim::stm32f4::gated::{self, Gated};
    use edm_hal_shim::stm32f4::generator::Interface;
    use edm_hal_shim::stm32f4::machine::Machine;
    use edm_hal_shim::stm32f4::pac::Interrupt;
    use edm_hal_shim::stm32f4::pwm::{self, Bridge};
    use edm_hal_shim::stm32f4::safety::{self, Inputs};
    use edm_hal_shim::stm32f4::start::StartError;
    use edm_hal_shim::stm32f4::timebase::Millisecond;
    use edm_hal_shim::stm32f4::watchdog::Watchdog;
    use edm_hal_shim::stm32f4::{ccm, dying, flash, lines};
    use edm_servo_head::encoder::{DecoderCount, Handover, Quadrature, Shared as Published, TimerCount};
    use edm_servo_head::gap::{GapReading, GapSource, Quality, Voltage};
    use edm_servo_head::head::{
        Change, Command, Fault, Head, Refused, State, Status, SupervisionLimits, Supervisor, TickInput,
    };
    use edm_servo_head::settings::Settings;
    use edm_servo_head::{remote, units};
    use heapless::spsc::{Consumer, Producer, Queue};

    // The rates of the hardware are those that the core was made for.
    const _: () = assert!(board::TICK_HZ == units::TICK_HZ && board::ADC_HZ == units::ADC_HZ);
    const _: () = assert!(board::CORE_HZ == units::CLOCK_HZ);

    /// Number of this head on the bus.
    const NODE: u8 = 1;
    /// Commit of this build.
    const BUILD: u32 = match u32::from_str_radix(env!("EDM_BUILD"), 16) {
        Ok(build) => build,
        Err(_) => 0,
    };

    /// Core clock cycles of a millisecond.
    const MS: u32 = board::CORE_HZ / 1000;
    /// Who must report, and how long each may be silent.
    const GAP: usize = 0;
    const SERVO: usize = 1;
    const SUPERVISE: usize = 2;
    const PROTOCOL: usize = 3;
    static ROLL: Roll<4> = Roll::new([MS, MS, 5 * MS, 50 * MS]);
    /// What the reflex acts on: 5 short pulses or 1 ms (architecture page); current code assumed.
    static REFLEX: Limits = Limits::new(5, MS, 200);
    /// A frame came in since the last supervision.
    static HOST: AtomicBool = AtomicBool::new(false);
    /// What the encoder interrupts count; slower tasks read it.
    static ENCODER: Published = Published::new();

    /// A command on its way to the servo task, with its number for the answer.
    type Request = (u8, Command);
    type Answer = (u8, Result<(), Refused>);

    /// Decoder and lines: the three encoder interrupts have one priority, so they share without a lock.
    pub struct Decoder {
        lines: Lines,
        clock: Cycles,
        quadrature: Quadrature<&'static Published>,
    }

    impl Decoder {
        #[inline(always)]
        fn edge(&mut self, line: Line) {
            let edge = self.lines.acknowledge(line);
            let levels = self.lines.levels();
            match edge {
                Edge::Next => self.quadrature.edge(levels, self.clock.now()),
                Edge::AfterStorm => self.quadrature.resume(levels),
            }
        }
    }

    /// The servo task's outputs and inputs.
    pub struct Axis {
        head: &'static mut Head,
        bridge: Bridge,
        generator: Interface,
        inputs: Inputs,
        drive: DriveAdc,
        decoder: DecoderCount<'static, Cycles>,
        timer: TimerCount<Timer, Cycles>,
        handover: Handover,
        clock: Cycles,
        /// What reflex and stop had forced, and the retreats of the reflex, at the last tick.
        forced: lines::Forced,
        retreats: u32,
        gap: GapReading,
    }

    /// What idle logs once a second.
    #[derive(Clone, Copy)]
    pub struct Report {
        status: Status,
        shorts: u32,
        pulse: [u16; 2],
    }

    #[shared]
    struct Shared {
        #[lock_free]
        decoder: Decoder,
    }

    #[local]
    struct Local {
        reflex: Gated,
        blocks: Blocks,
        source: Voltage,
        gap_clock: Cycles,
        readings_in: Producer<'static, GapReading>,
        readings: Consumer<'static, GapReading>,
        axis: Axis,
        statuses_in: Producer<'static, Status>,
        statuses: Consumer<'static, Status>,
        faults_in: Producer<'static, Fault>,
        faults: Consumer<'static, Fault>,
        requests_in: Producer<'static, Request>,
        requests: Consumer<'static, Request>,
        answers_in: Producer<'static, Answer>,
        answers: Consumer<'static, Answer>,
        changes_in: Producer<'static, Change>,
        changes: Consumer<'static, Change>,
        reports_in: Producer<'static, Report>,
        reports: Consumer<'static, Report>,
        published_in: Producer<'static, Status>,
        published: Consumer<'static, Status>,
        received_in: Producer<'static, Frame>,
        received: Consumer<'static, Frame>,
        sending_in: Producer<'static, Frame>,
        sending: Consumer<'static, Frame>,
        millisecond: Millisecond,
        supervisor: Supervisor,
        limits: SupervisionLimits,
        supervise_clock: Cycles,
        protocol_clock: Cycles,
        receiver: Option<Receiver>,
        sender: Option<Sender>,
        watchdog: Watchdog,
        idle_clock: Cycles,
    }

    /// Starts the board, then the head, disabled and inhibited. When something does not start, the LED blinks and the log
    /// says what; pins stay harmless.
    #[init(local = [
        readings_queue: Queue<GapReading, 4> = Queue::new(),
        statuses_queue: Queue<Status, 4> = Queue::new(),
        faults_queue: Queue<Fault, 8> = Queue::new(),
        requests_queue: Queue<Request, 8> = Queue::new(),
        answers_queue: Queue<Answer, 8> = Queue::new(),
        changes_queue: Queue<Change, 16> = Queue::new(),
        reports_queue: Queue<Report, 2> = Queue::new(),
        published_queue: Queue<Status, 2> = Queue::new(),
        received_queue: Queue<Frame, 32> = Queue::new(),
        sending_queue: Queue<Frame, 32> = Queue::new(),
    ])]
    fn init(cx: init::Context) -> (Shared, Local) {
        let mut watchdog = None;
        let machine = match Machine::start(cx.device, cx.core, BUILD, NODE, &REFLEX, &mut watchdog) {
            Ok(machine) => machine,
            Err(error) => dying::halt(error, watchdog),
        };
        defmt::info!("build {=u32:08x}, {}", BUILD, machine.boot);
        let Machine { clock, mut thresholds, mut watchdog, .. } = machine;

        let settings = Settings::default();
        let Ok(active) = settings.build() else { dying::halt(StartError::Settings, Some(watchdog)) };
        let Some(head) = ccm::place(|| Head::new(active.head)) else { dying::halt(StartError::Memory, Some(watchdog)) };
        watchdog.feed();
        let (low, high) = reflex_window(&settings);
        thresholds.set_voltage(low, high);
        let source = Voltage::new(active.gap);

        let quadrature = Quadrature::on(&ENCODER, machine.lines.levels(), clock.now());
        let axis = Axis {
            head,
            bridge: machine.bridge,
            generator: machine.generator,
            inputs: machine.inputs,
            drive: machine.drive,
            decoder: DecoderCount::new(&ENCODER, clock),
            timer: TimerCount::new(machine.timer, clock),
            handover: Handover::new(),
            clock,
            forced: lines::forced(),
            retreats: 0,
            gap: GapReading::default(),
        };
        let (sender, receiver) = match machine.can {
            Ok((sender, receiver)) => (Some(sender), Some(receiver)),
            Err(error) => {
                defmt::error!("CAN: {}", error);
                (None, None)
            }
        };

        let (readings_in, readings) = cx.local.readings_queue.split();
        let (statuses_in, statuses) = cx.local.statuses_queue.split();
        let (faults_in, faults) = cx.local.faults_queue.split();
        let (requests_in, requests) = cx.local.requests_queue.split();
        let (answers_in, answers) = cx.local.answers_queue.split();
        let (changes_in, changes) = cx.local.changes_queue.split();
        let (reports_in, reports) = cx.local.reports_queue.split();
        let (published_in, published) = cx.local.published_queue.split();
        let (received_in, received) = cx.local.received_queue.split();
        let (sending_in, sending) = cx.local.sending_queue.split();
        ROLL.start(clock.now());
        let decoder = Decoder { lines: machine.lines, clock, quadrature };
        let local = Local {
            reflex: machine.reflex,
            blocks: machine.blocks,
            source,
            gap_clock: clock,
            readings_in,
            readings,
            axis,
            statuses_in,
            statuses,
            faults_in,
            faults,
            requests_in,
            requests,
            answers_in,
            answers,
            changes_in,
            changes,
            reports_in,
            reports,
            published_in,
            published,
            received_in,
            received,
            sending_in,
            sending,
            millisecond: machine.millisecond,
            supervisor: Supervisor::default(),
            limits: active.head.supervise,
            supervise_clock: clock,
            protocol_clock: clock,
            receiver,
            sender,
            watchdog,
            idle_clock: clock,
        };
        (Shared { decoder }, local)
    }

    /// Codes within which a pulse is no short, for the watchdog of the gated converter.
    fn reflex_window(settings: &Settings) -> (u16, u16) {
        let codes = settings.gap_short / settings.gap_volts_per_code;
        let zero = settings.gap_zero_code as f32;
        let full = f32::from(units::ADC_FULL_SCALE);
        if settings.gap_reversed {
            (0, (zero - codes).clamp(0.0, full) as u16)
        } else {
            ((zero + codes).clamp(0.0, full) as u16, units::ADC_FULL_SCALE)
        }
    }

    /// Deadline: 2.5 us from the sample to the pin. A short pulse is killed; a run of them forces the retreat. Late, the
    /// short lasts longer. Atomics only; never logs.
    #[task(binds = ADC, priority = 8, local = [reflex])]
    fn reflex(cx: reflex::Context) {
        cx.local.reflex.reflex();
    }

    /// Deadline: 5 us from the edge to the pins. The first edge of a limit switch, of the emergency stop or of the dielectric
    /// stops; the servo task then does what the fault asks for. Late, the axis travels on: 3 um at 0.6 m/s. Atomics only.
    #[task(binds = EXTI15_10, priority = 7)]
    fn stop(_: stop::Context) {
        safety::stop();
    }

    /// Deadline: 5 us; the hardware has switched the bridge off already. Atomics only.
    #[task(binds = TIM1_BRK_TIM9, priority = 7)]
    fn bridge_fault(_: bridge_fault::Context) {
        safety::bridge_fault();
    }

    /// Deadline: one edge spacing, 3.3 us at 300 kcount/s. Late, the transition reads as illegal and is counted; far above
    /// the rate the lines mask themselves and the timer leads. Atomics only.
    #[task(binds = EXTI0, priority = 6, shared = [decoder])]
    fn encoder_a(cx: encoder_a::Context) {
        cx.shared.decoder.edge(Line::A);
    }

    /// As `encoder_a`.
    #[task(binds = EXTI1, priority = 6, shared = [decoder])]
    fn encoder_b(cx: encoder_b::Context) {
        cx.shared.decoder.edge(Line::B);
    }

    /// As `encoder_a`.
    #[task(binds = EXTI2, priority = 6, shared = [decoder])]
    fn encoder_index(cx: encoder_index::Context) {
        cx.shared.decoder.edge(Line::Index);
    }

    /// Deadline: the servo tick, 6 us after the block. Averages and filters the block. Late, the tick runs on the reading
    /// before, marked as missing.
    #[task(binds = DMA2_STREAM0, priority = 5, local = [blocks, source, readings_in, gap_clock])]
    fn gap(cx: gap::Context) {
        let block = cx.local.blocks.block();
        let reading = cx.local.source.update(block.as_ref());
        // Full only when the servo task has missed three ticks; its roll call tells.
        let _ = cx.local.readings_in.enqueue(reading);
        ROLL.report(GAP, cx.local.gap_clock.now());
    }

    /// Deadline: the next tick, 50 us. Feed law, path, cascade, duty; outputs take effect with the next update of the timer,
    /// exactly. Late by a whole tick, the duty of the tick before holds on.
    #[task(binds = TIM1_UP_TIM10, priority = 4,
           local = [axis, readings, faults, requests, answers_in, statuses_in, changes_in])]
    fn servo(cx: servo::Context) {
        pwm::clear_tick();
        let axis = cx.local.axis;
        let forced = lines::forced();
        let storm = edges::serve();

        axis.gap.quality = Quality::Missing;
        while let Some(reading) = cx.local.readings.dequeue() {
            axis.gap = reading;
        }
        let timer = axis.timer.read();
        let mut input = TickInput {
            gap: axis.gap,
            encoder: axis.handover.read(axis.decoder.snapshot(), timer, storm),
            watch: Some(timer),
            safety: axis.inputs.read(),
            drive: axis.drive.read(),
        };
        let retreats = gated::counts().retreats;
        if retreats != axis.retreats {
            // The reflex has begun a retreat: the run of shorts is as long as it needs to be.
            axis.retreats = retreats;
            input.gap.short_ticks = u32::MAX;
        }
        while let Some(fault) = cx.local.faults.dequeue() {
            axis.head.raise(fault);
        }
        while let Some((number, command)) = cx.local.requests.dequeue() {
            let _ = cx.local.answers_in.enqueue((number, axis.head.command(command)));
        }
        let output = axis.head.tick(&input);

        let mut applied = Ok(());
        if forced.bridge_since(&axis.forced) {
            // Whatever was forced, the bridge starts from coasting.
            applied = axis.bridge.apply(Drive::Coast);
        }
        axis.forced = forced;
        applied = applied.and(axis.bridge.apply(output.drive));
        if applied.is_err() {
            lines::stop();
        }
        if output.drive != Drive::Coast && !input.safety.bridge_fault {
            pwm::arm();
        }
        axis.generator.set_pulses(output.pulses);
        lines::settle(forced);

        let status = axis.head.status();
        REFLEX.arm(status.state == State::Eroding);
        flash::permit(status.state == State::Disabled && !output.pulses);
        if status.tick.is_multiple_of(Supervisor::PERIOD) {
            let _ = cx.local.statuses_in.enqueue(*status);
        }
        if let Some(change) = axis.head.next_change() {
            let _ = cx.local.changes_in.enqueue(change);
        }
        ROLL.report(SERVO, axis.clock.now());
    }

    /// Deadline: 1 ms. Judges what no single tick can; wakes the protocol. Late, a fault is found later.
    #[task(binds = TIM7, priority = 3,
           local = [millisecond, statuses, faults_in, supervisor, limits, supervise_clock, published_in, reports_in,
                    count: u32 = 0])]
    fn supervise(cx: supervise::Context) {
        cx.local.millisecond.clear();
        *cx.local.count = cx.local.count.wrapping_add(1);
        let count = *cx.local.count;
        while let Some(status) = cx.local.statuses.dequeue() {
            let host_alive = HOST.swap(false, Relaxed);
            if let Some(fault) = cx.local.supervisor.tick(cx.local.limits, &status, host_alive) {
                let _ = cx.local.faults_in.enqueue(fault);
            }
            if count.is_multiple_of(10) {
                let _ = cx.local.published_in.enqueue(status);
            }
            if count.is_multiple_of(1000) {
                let report = Report { status, shorts: gated::counts().shorts, pulse: gated::newest() };
                let _ = cx.local.reports_in.enqueue(report);
            }
        }
        if count.is_multiple_of(10) {
            // Running already is as good.
            let _ = protocol::spawn();
        }
        ROLL.report(SUPERVISE, cx.local.supervise_clock.now());
    }

    /// Deadline: one frame, 111 us. Late by three frames, the hardware drops one and says so.
    #[task(binds = CAN1_RX0, priority = 2, local = [receiver, received_in])]
    fn can_receive(cx: can_receive::Context) {
        let Some(receiver) = cx.local.receiver else { return };
        while let Some(frame) = can::next(receiver) {
            match frame {
                Ok(frame) => {
                    HOST.store(true, Relaxed);
                    if cx.local.received_in.enqueue(frame).is_err() {
                        defmt::warn!("CAN: queue full, frame dropped");
                    }
                }
                Err(_) => defmt::warn!("CAN: overrun"),
            }
        }
        let _ = protocol::spawn();
    }

    /// Deadline: one frame, 111 us. Feeds the mailboxes; also pended by the protocol. Late, the bus idles.
    #[task(binds = CAN1_TX, priority = 2, local = [sender, sending])]
    fn can_transmit(cx: can_transmit::Context) {
        let Some(sender) = cx.local.sender else { return };
        sender.clear();
        while let Some(frame) = cx.local.sending.peek() {
            if !sender.send(frame) {
                break;
            }
            cx.local.sending.dequeue();
        }
    }

    /// Deadline: 1 ms. Commands in, answers, reports and heartbeat out. Late, the host waits.
    #[task(priority = 1, local = [received, requests_in, answers, published, sending_in, protocol_clock, reports_sent: u32 = 0])]
    async fn protocol(cx: protocol::Context) {
        let sending = cx.local.sending_in;
        let mut send = |identifier: u16, data: &[u8]| {
            let id = StandardId::new(identifier | u16::from(NODE));
            if let (Some(id), Some(data)) = (id, Data::new(data)) {
                // A full queue means that nobody listens.
                let _ = sending.enqueue(Frame::new_data(id, data));
            }
        };
        while let Some(frame) = cx.local.received.dequeue() {
            let command = StandardId::new(remote::COMMAND | u16::from(NODE)).map(Id::Standard);
            let (Some(data), true) = (frame.data(), command == Some(frame.id())) else { continue };
            let number = data.first().copied().unwrap_or(0);
            match remote::command(data) {
                Some(command) if cx.local.requests_in.enqueue((number, command)).is_ok() => {}
                _ => send(remote::ANSWER, &remote::unknown(number)),
            }
        }
        while let Some((number, result)) = cx.local.answers.dequeue() {
            send(remote::ANSWER, &remote::answer(number, result));
        }
        while let Some(status) = cx.local.published.dequeue() {
            send(remote::REPORT, &remote::report(&status));
            if cx.local.reports_sent.is_multiple_of(10) {
                let first = *cx.local.reports_sent == 0;
                send(remote::HEARTBEAT, &[if first { remote::BOOT_UP } else { remote::OPERATIONAL }]);
            }
            *cx.local.reports_sent = cx.local.reports_sent.wrapping_add(1).max(1);
        }
        rtic::pend(Interrupt::CAN1_TX);
        ROLL.report(PROTOCOL, cx.local.protocol_clock.now());
    }

    /// No deadline. Logs, and feeds the watchdog while everybody reports. It never sleeps: the cycle counter, which times the
    /// edges, would stop with the core.
    #[idle(local = [watchdog, changes, reports, idle_clock])]
    fn idle(cx: idle::Context) -> ! {
        loop {
            match ROLL.missing(cx.local.idle_clock.now()) {
                None => cx.local.watchdog.feed(),
                Some(task) => dying::silent(task),
            }
            if let Some(change) = cx.local.changes.dequeue() {
                defmt::info!("{}", change);
            }
            if let Some(Report { status, shorts, pulse }) = cx.local.reports.dequeue() {
                defmt::info!(
                    "{} at {=i64} counts, gap {=f32} V ({}), {=u32} shorts, newest pulse {}",
                    status.state,
                    status.position,
                    status.gap.filtered.0,
                    status.gap.quality,
                    shorts,
                    pulse
                );
            }
        }
    }
}
