//! Everything of a board, started in the order that keeps it harmless, and handed out in parts.

use super::backup::BackupSram;
use super::blocks::{self, Blocks};
use super::boot::{self, Boot};
use super::can::{self, Filters, Receiver, Sender, SyncWaits};
use super::clocks;
use super::cycles::Cycles;
use super::drive::DriveAdc;
use super::encoder::{self, Guard, Lines, Timer};
use super::ends::{Ends, Over};
use super::flash::SettingsFlash;
use super::gate::Edges;
use super::gated::{Gated, Thresholds};
use super::generator::Interface;
use super::hal::gpio::PushPull;
use super::hal::gpio::alt::{tim2, tim8};
use super::hal::syscfg::SysCfgExt;
use super::live::Signal;
use super::pwm::{self, Bridge, Pwm, Tick};
use super::registers::Registers;
use super::safety::{self, Inputs};
use super::self_test;
use super::servo_lines::ServoLines;
use super::stack;
use super::stage::StageFlash;
use super::start::StartError;
use super::steps::Counter;
use super::supply::{self, Supply};
use super::timebase::{self, Millisecond};
use super::watchdog::Watchdog;
use super::{Board, dma, pac, pins};
use crate::pause::Pauses;
use crate::reflex::Limits;
use crate::self_test::SelfTest;

/// The parts of a running board; each goes to one task.
#[allow(missing_docs, reason = "each part says what it is")]
pub struct Machine {
    pub boot: Boot,
    pub self_test: SelfTest,
    pub registers: Registers,
    pub clock: Cycles,
    pub reflex: Gated,
    pub thresholds: Thresholds,
    pub ends: (Ends, Over),
    pub lines: Lines,
    pub guard: Guard,
    pub timer: Timer,
    pub blocks: Blocks,
    pub bridge: Bridge,
    pub generator: Interface,
    pub inputs: Inputs,
    pub drive: DriveAdc,
    pub forced: ServoLines,
    pub live: Signal,
    pub tick: Tick,
    pub millisecond: Millisecond,
    pub steps: Counter,
    /// `None`, with the reason, when the controller does not answer: the head is then as good as without a host.
    pub can: Result<(Receiver, Sender, Filters), StartError>,
    pub sync: SyncWaits,
    pub flash: SettingsFlash,
    pub backup: BackupSram,
    pub stage: StageFlash,
}

impl Machine {
    /// Starts the board. Interrupts are off; the caller unmasks them when everything has its task.
    ///
    /// `watchdog` receives the watchdog as soon as it runs, still patient, so that the caller can feed it when the start fails.
    pub fn start(
        mut device: pac::Peripherals,
        mut core: cortex_m::Peripherals,
        build: u32,
        (limits, pauses): (&'static Limits, &'static Pauses),
        watchdog: &mut Option<Watchdog>,
    ) -> Result<Machine, StartError> {
        let rcc = &mut device.RCC;
        let self_test = self_test::image(&device.CRC, rcc).and(supply::brown_out(&device.FLASH));

        stack::guard(&mut core.MPU);

        // Harmless first: what could drive is driven low, from the internal oscillator.
        let ports = pins::ports((device.GPIOA, device.GPIOB, device.GPIOC, device.GPIOD, device.GPIOE), rcc);
        if self_test.failed() {
            pins::bar();
        }
        let board = Board::new(ports);
        let Ok(generator) = Interface::new(device.DAC, board.allow_pulses, board.off_time, rcc);
        let tim1 = Pwm::new(device.TIM1, board.pwm, board.bridge_fault, rcc);
        let bridge = pwm::bridge(tim1, board.forward, board.reverse).map_err(|_| StartError::Bridge)?;
        let live = Signal::new(board.live, board.arm, board.armed);
        board.led.into_push_pull_output();
        board.flush_valve.into_push_pull_output();
        board.carry.into_push_pull_output();
        board.step_ready.into_push_pull_output();

        let boot = boot::begin(rcc, build);
        *watchdog = Some(Watchdog::start(device.IWDG)?);
        clocks::start(rcc, &device.FLASH)?;
        let clock = Cycles::start(&mut core.DCB, &mut core.DWT);

        let mut syscfg = device.SYSCFG.constrain(rcc);
        let backup = BackupSram::start(&device.PWR, rcc);
        let inputs = Inputs::new(
            safety::contact(board.upper_limit, &mut syscfg),
            safety::contact(board.lower_limit, &mut syscfg),
            safety::contact(board.emergency_stop, &mut syscfg),
            safety::contact(board.dielectric, &mut syscfg),
            Supply::watch(device.PWR, rcc),
        );
        let (lines, guard, timer) =
            encoder::new(device.TIM5, board.encoder_a, board.encoder_b, board.encoder_index, &mut syscfg, rcc);

        let _: tim2::Ch1<PushPull> = board.step.into();
        board.step_direction.into_alternate::<1>();
        let steps = Counter::new(device.TIM2, device.DMA1, rcc)?;

        board.gap_voltage.into_analog();
        board.gap_voltage_gated.into_analog();
        board.gap_current.into_analog();
        board.motor_current.into_analog();
        board.bus_voltage.into_analog();
        let streams = dma::streams(device.DMA2, rcc);
        blocks::common(&device.ADC_COMMON, rcc);
        let drive = DriveAdc::new(device.ADC3);
        let mut gate: tim8::Ch1<PushPull> = board.gate.into();
        let ends = Ends::new(&mut gate, device.TIM6, pauses, &mut syscfg, rcc);
        let edges = Edges::new(
            device.TIM8,
            (gate, board.comparator_high, board.comparator_low),
            (streams.s2, streams.s4, streams.s7),
            rcc,
        )?;
        let (reflex, thresholds) = Gated::new(device.ADC2, device.TIM4, board.gate_start, streams.s3, limits, rcc)?;
        let blocks = Blocks::new(device.ADC1, streams.s0, edges)?;
        timebase::trigger(&device.TIM3, rcc);
        timebase::start(&device.TIM3, blocks.edges().timer());
        // Nothing may drive before the gap has been seen.
        blocks.first()?;

        let can = can::start(device.CAN1, board.can_rx, board.can_tx, rcc);
        let millisecond = Millisecond::new(device.TIM7, rcc);
        let flash = SettingsFlash::new(device.FLASH);
        Ok(Machine {
            boot,
            self_test: self_test.and(pins::freeze()),
            registers: Registers::new(),
            clock,
            reflex,
            thresholds,
            ends,
            lines,
            guard,
            timer,
            blocks,
            bridge,
            generator,
            inputs,
            drive,
            forced: ServoLines(()),
            live,
            tick: Tick(()),
            millisecond,
            steps,
            can,
            sync: SyncWaits(()),
            flash,
            backup,
            stage: StageFlash::new(),
        })
    }
}
