//! The firmware: which task does what, at which priority, by when.
//!
//! On the chip this is an RTIC 2 application. What a task does, and the data between tasks, are in `edm_runtime`,
//! which a PC runs as well; the three highest take no lock at all. The core computes, and `edm_hal_shim::stm32f4` knows the
//! registers. What each task costs in the worst case is in docs/performance.md; the costs named here are estimates.
//!
//! On a PC the same binary prints what it is: tables of the boards, clocks, timers, DMA streams, CAN bit timing, tasks.
#![cfg_attr(target_arch = "arm", no_std, no_main)]

#[cfg(not(target_arch = "arm"))]
fn main() {
    use edm_hal_shim::board::{BOARDS, write_chip};
    let mut chip = String::new();
    if write_chip(&mut chip).is_err() {
        unreachable!("a string takes everything");
    }
    println!("Firmware of the EDM servo head, {}. It runs on:\n", env!("CARGO_PKG_VERSION"));
    for (_, table) in BOARDS {
        println!("{table}");
    }
    println!("{chip}");
    println!("cargo firmware builds it; cargo flash-head programs it.");
}

#[cfg(target_arch = "arm")]
use defmt_rtt as _;

#[cfg(target_arch = "arm")]
mod chip;
#[cfg(target_arch = "arm")]
mod start;

#[cfg(target_arch = "arm")]
#[rtic::app(device = edm_hal_shim::stm32f4::pac, peripherals = true, dispatchers = [])]
mod app {
    use crate::chip::Chip;
    use crate::start;
    use crate::start::{Slots, Tasks};
    use core::mem::MaybeUninit;
    use edm_hal_shim::can::Inbox;
    use edm_hal_shim::encoder::Line;
    use edm_hal_shim::stm32f4::ends::{Ends, Over};
    use edm_hal_shim::stm32f4::gated::Gated;
    use edm_hal_shim::stm32f4::halt::halt;
    use edm_hal_shim::stm32f4::safety;
    use edm_runtime::can::{Receive, Transmit};
    use edm_runtime::encoder::Decoder;
    use edm_runtime::gap::Gap;
    use edm_runtime::idle::Idle;
    use edm_runtime::plan::Plans;
    use edm_runtime::protocol::Protocol;
    use edm_runtime::servo::Servo;
    use edm_runtime::supervise::Supervise;
    use edm_runtime::{Room, TickCrossings};

    #[shared]
    struct Shared {
        #[lock_free]
        decoder: Decoder<Chip>,
        #[lock_free]
        receive: Receive<Chip>,
        protocol: &'static mut Protocol<Chip>,
    }

    #[local]
    struct Local {
        reflex: Gated,
        ends: Ends,
        over: Over,
        // Beside the code of these tasks, in SRAM1, each access would share that with what is fetched.
        #[unsafe(link_section = ".ccmram.gap")]
        gap: Gap<Chip>,
        #[unsafe(link_section = ".ccmram.servo")]
        servo: Servo<Chip>,
        plan: &'static mut Plans<Chip>,
        supervise: &'static mut Supervise<Chip>,
        transmit: Transmit<Chip>,
        idle: Idle<Chip>,
    }

    /// Starts everything, disabled and inhibited. When something does not start, the LED blinks, the log says what, and the
    /// pins stay harmless.
    #[init(local = [
        slots: Slots = Slots::new(),
        plan_room: MaybeUninit<Plans<Chip>> = MaybeUninit::uninit(),
        supervise_room: MaybeUninit<Supervise<Chip>> = MaybeUninit::uninit(),
        // In SRAM2, which no code is fetched from.
        #[unsafe(link_section = ".shared_later")]
        crossings: MaybeUninit<TickCrossings> = MaybeUninit::uninit(),
    ])]
    fn init(cx: init::Context) -> (Shared, Local) {
        let mut watchdog = None;
        let init::LocalResources { slots, plan_room: plan, supervise_room: supervise, crossings, .. } = cx.local;
        let room = Room { plan, supervise, crossings };
        match start::start(cx.device, cx.core, slots, room, &mut watchdog) {
            Ok(Tasks {
                reflex,
                ends,
                over,
                decoder,
                gap,
                servo,
                plan,
                supervise,
                receive,
                transmit,
                protocol,
                idle,
            }) => (
                Shared { decoder, receive, protocol },
                Local { reflex, ends, over, gap, servo, plan, supervise, transmit, idle },
            ),
            Err(error) => halt(error, watchdog),
        }
    }

    /// Deadline: 2.5 us from the sample to the pin. A short pulse is killed; a run of them forces the retreat. Atomics only;
    /// never logs. Cost: 1 us, at each short pulse. Late: the short lasts longer.
    #[task(binds = ADC, priority = 9, local = [reflex])]
    fn reflex(cx: reflex::Context) {
        cx.local.reflex.reflex();
    }

    /// Deadline: 5 us from the edge to the pins. The first edge of a limit switch, of the emergency stop or of the dielectric
    /// stops; the servo task then does what the fault asks for. Atomics only. Cost: 0.5 us, at each edge. Late: the axis
    /// travels on, 3 um in 5 us at 0.6 m/s.
    #[task(binds = EXTI15_10, priority = 8)]
    fn stop(_: stop::Context) {
        safety::stop();
    }

    /// Deadline: 5 us. Atomics only. Cost: 0.5 us, at each fault. Late: nothing, the hardware has switched the bridge off.
    #[task(binds = TIM1_BRK_TIM9, priority = 8)]
    fn bridge_fault(_: bridge_fault::Context) {
        safety::bridge_fault();
    }

    /// Deadline: 5 us from the edge to the pins. The chip's supply falls. Atomics only. Cost: 0.5 us, once. Late: the brown-out
    /// reset comes first, and lets the pins go as well.
    #[task(binds = PVD, priority = 8)]
    fn supply(_: supply::Context) {
        safety::supply();
    }

    /// Deadline: 1 us from the edge of the gate to the pin, if the pulse has a pause. Atomics only. Cost: 1.3 us, at the end of each pulse
    /// while any class has a pause; else it does not run. Late: the next pulse may begin before the pause, which it then has no more.
    #[task(binds = EXTI9_5, priority = 8, local = [ends])]
    fn pulse_end(cx: pulse_end::Context) {
        cx.local.ends.pulse();
    }

    /// Deadline: 1 us. Lets pulses go on after a pause, if nothing else holds them. Atomics only. Cost: 0.6 us, after each pause. Late: the
    /// pause is longer; not at all: the servo task ends it.
    #[task(binds = TIM6_DAC, priority = 8, local = [over])]
    fn pause_over(cx: pause_over::Context) {
        cx.local.over.pause();
    }

    /// Deadline: one edge spacing, 3.3 us at 300 kcount/s. Atomics only; the decoder, which the three of one priority share without a
    /// lock, has no bytes. Cost: 0.5 us, at each edge, 0.9 near an index mark. Late: the transition reads as illegal and is counted;
    /// far above the rate the lines mask themselves and the timer leads.
    #[task(binds = EXTI0, priority = 7, shared = [decoder])]
    fn encoder_a(cx: encoder_a::Context) {
        cx.shared.decoder.edge(Line::A);
    }

    /// As `encoder_a`.
    #[task(binds = EXTI1, priority = 7, shared = [decoder])]
    fn encoder_b(cx: encoder_b::Context) {
        cx.shared.decoder.edge(Line::B);
    }

    /// As `encoder_a`.
    #[task(binds = EXTI2, priority = 7, shared = [decoder])]
    fn encoder_index(cx: encoder_index::Context) {
        cx.shared.decoder.edge(Line::Index);
    }

    /// Deadline: the servo tick, 6 us after the block. Averages and filters the block, and classifies its pulses. Cost: 12 us, 21 us at
    /// 100 000 pulses a second, 20 000 times a second, so that the tick waits for it.
    /// Late: the tick waits for it.
    #[task(binds = DMA2_STREAM0, priority = 6, local = [gap])]
    fn gap(cx: gap::Context) {
        cx.local.gap.block();
    }

    /// Deadline: the next tick, 50 us. Position, velocity, cascade, duty, and what is urgent. Outputs take effect with the next
    /// update of the timer, exactly. Neither logs nor locks. Cost: 4.5 us, moving 6 us, at worst 14 us, 20 000 times a second.
    /// Late by a whole tick: the duty of the tick before holds on.
    #[task(binds = TIM1_UP_TIM10, priority = 5, local = [servo])]
    fn servo(cx: servo::Context) {
        cx.local.servo.tick();
    }

    /// Deadline: one frame, 111 us. Cost: 3 us a frame. Late by three frames: the hardware drops one and says so.
    #[task(binds = CAN1_RX0, priority = 4, shared = [receive])]
    fn can_receive(cx: can_receive::Context) {
        cx.shared.receive.frames(Inbox::Others);
    }

    /// Deadline: 47 us, the shortest frame. As `can_receive`, for SYNC. Cost: 3 us. Late: the frame behind it is taken for one
    /// before it.
    #[task(binds = CAN1_RX1, priority = 4, shared = [receive])]
    fn can_sync(cx: can_sync::Context) {
        cx.shared.receive.frames(Inbox::Sync);
    }

    /// Deadline: one frame, 111 us. Feeds the mailboxes; also pended by the protocol. Cost: 2 us a frame. Late: the bus idles.
    #[task(binds = CAN1_TX, priority = 4, local = [transmit])]
    fn can_transmit(cx: can_transmit::Context) {
        cx.local.transmit.frames();
    }

    /// Deadline: 100 us, the second tick after the one that asks for it. States, feed law, limits, path. The vector is that of
    /// a peripheral not in use. Cost: 40 us, at worst 70 us, 2000 to 4000 times a second. Late: the trajectory goes on in a straight
    /// line; late for a millisecond, the head coasts.
    #[task(binds = SPI2, priority = 3, local = [plan])]
    fn plan(cx: plan::Context) {
        cx.local.plan.run();
    }

    /// Deadline: 1 ms. Judges what no single tick can. Cost: 21 us, 1000 times a second. Late: a fault is found later.
    #[task(binds = TIM7, priority = 2, local = [supervise])]
    fn supervise(cx: supervise::Context) {
        cx.local.supervise.tick();
    }

    /// Deadline: 1 ms. CANopen node and drive; pended by the servo tick once a millisecond, by every frame, and by an empty
    /// queue to the controller. The vector is that of a peripheral not in use: unlike a software task it runs again when it
    /// is asked to while it runs. Cost: 47 us, 1000 times a second, and more with frames. Late: the host waits.
    #[task(binds = SPI3, priority = 1, shared = [protocol])]
    fn protocol(mut cx: protocol::Context) {
        cx.shared.protocol.lock(|protocol| protocol.run());
    }

    /// No deadline. Logs, stores settings, and feeds the watchdog while everybody reports. It never sleeps: the cycle counter,
    /// which times the edges, would stop with the core.
    #[idle(local = [idle], shared = [protocol])]
    fn idle(mut cx: idle::Context) -> ! {
        loop {
            cx.local.idle.round(&mut cx.shared.protocol);
        }
    }
}
