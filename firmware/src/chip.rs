//! The chip as a [`Board`], and RTIC as the caller of its tasks.

use core::borrow::Borrow;
use edm_hal_shim::stm32f4::pac::Interrupt;
use edm_hal_shim::stm32f4::{
    backup, blocks, can, cycles, drive, encoder, flash, gate, gated, generator, lines, live, pwm, registers, safety,
    servo_lines, stage, steps, timebase, watchdog,
};
use edm_hal_shim::store::Store;
use edm_runtime::board::{Board, Caller, Pulse};
use edm_runtime::{Note, Signals};
use edm_servo_head::encoder::Shared as Published;
use edm_servo_head::gap::Voltage;
use edm_servo_head::head::{Status, WritePermit};

/// The vector that runs the plan task; its peripheral is not in use.
pub const PLAN: Interrupt = Interrupt::SPI2;
/// The same for the protocol task.
pub const PROTOCOL: Interrupt = Interrupt::SPI3;

/// Atomics of the tasks.
pub static SIGNALS: Signals = Signals::new();
/// What the encoder interrupts count.
pub static ENCODER: Published = Published::new();

/// The published count: a place that the compiler knows, where a reference would have to be loaded at every edge.
pub struct Count;

impl Borrow<Published> for Count {
    #[inline(always)]
    fn borrow(&self) -> &Published {
        &ENCODER
    }
}

/// The STM32F405 or F407 of a board.
pub struct Chip;

impl Board for Chip {
    type Clock = cycles::Cycles;
    type Published = Count;
    type Lines = encoder::Lines;
    type Guard = encoder::Guard;
    type Timer = encoder::Timer;
    type FrontEnd = blocks::Blocks;
    type Source = Voltage;
    type Bridge = pwm::Bridge;
    type Generator = generator::Interface;
    type Inputs = safety::Inputs;
    type Drive = drive::DriveAdc;
    type Forced = servo_lines::ServoLines;
    type Live = live::Signal;
    type Tick = pwm::Tick;
    type Millisecond = timebase::Millisecond;
    type Steps = steps::Counter;
    type Registers = registers::Registers;
    type Thresholds = gated::Thresholds;
    type Inboxes = can::Receiver;
    type Sync = can::SyncWaits;
    type Mailboxes = can::Sender;
    type Filters = can::Filters;
    type Watchdog = watchdog::Watchdog;
    type Storage = Store<flash::SettingsFlash, WritePermit>;
    type Backup = backup::BackupSram;
    type Stage = stage::StageFlash;
    type Caller = Rtic;
}

/// Calls tasks by pending their vectors, and logs by defmt.
#[derive(Clone, Copy)]
pub struct Rtic;

impl Caller for Rtic {
    fn plan(&self) {
        rtic::pend(PLAN);
    }

    fn protocol(&self) {
        rtic::pend(PROTOCOL);
    }

    fn transmit(&self) {
        rtic::pend(Interrupt::CAN1_TX);
    }

    fn supervise(&self) {
        rtic::pend(Interrupt::TIM7);
    }

    fn note(&self, note: &Note) {
        match note {
            Note::Lost(_) | Note::NotStored | Note::Checked(Err(_)) => defmt::warn!("{}", note),
            Note::Loaded(report) if report.is_whole() => {}
            Note::WatchdogStuck
            | Note::ThresholdsRefused
            | Note::StoreUnreadable
            | Note::Loaded(_)
            | Note::BootRefused(_) => {
                defmt::error!("{}", note);
            }
            // A message is one critical section, for which the protocol waits: a few words each, and not all that is known.
            Note::Status(Status { state, fault, position, following, gap, late_plans, .. }) => {
                defmt::info!("{}, {}, at {=i64}, {=f32} behind", state, fault, position, following);
                defmt::info!("gap {=f32} V, {}; {=u32} plans late", gap.filtered.0, gap.quality, late_plans);
            }
            Note::Pulses(Pulse { shorts, codes: [current, voltage] }) => {
                defmt::info!("{=u32} shorts, newest pulse {=u16}, {=u16}", shorts, current, voltage);
                defmt::info!("{}", gate::captures());
            }
            _ => defmt::info!("{}", note),
        }
    }

    fn light(&self, lit: bool) {
        lines::led(lit);
    }

    fn ask(&self, asks: bool) {
        lines::ask(asks);
    }

    fn takes_steps(&self, takes: bool) {
        lines::takes_steps(takes);
    }

    fn pulse(&self) -> Pulse {
        Pulse { shorts: gated::shorts(), codes: gated::newest() }
    }
}
