//! ADC2: gap current and voltage inside each pulse, and the reflex's trigger.
//!
//! The gate starts TIM4 for one pulse; when the blanking is over it triggers ADC2, which converts the current, then the
//! voltage. Its analogue watchdog interrupts only when the voltage is low: a good pulse costs the processor nothing.

use super::blocks::{channel, power_up, sampling};
use super::dma::{self, Stream};
use super::gate::gate_edges;
use super::hal::gpio::PushPull;
use super::hal::gpio::alt::tim4::Ch2;
use super::start::StartError;
use super::{lines, pac, put, reset};
use crate::board::{BLANKING_CLOCK, BLANKING_MOST, GATED_SAMPLING};
use crate::must;
use crate::pause;
use crate::reflex::{self, Config, EDGE_COUNT, Limits, Run, Verdict};
use crate::timing::{Refused, blanking};
use core::sync::atomic::{AtomicU16, AtomicU32, Ordering::Relaxed};
use cortex_m::peripheral::DWT;

/// Current and voltage of the newest pulses: as many as the edges that are counted, so that both counts wrap alike.
static PULSES: [AtomicU16; RING] = [const { AtomicU16::new(0) }; RING];
const RING: usize = 2 * EDGE_COUNT as usize;
/// Short pulses so far, wrapping.
static SHORTS: AtomicU32 = AtomicU32::new(0);
/// Retreats begun so far, wrapping.
static RETREATS: AtomicU32 = AtomicU32::new(0);

const VOLTAGE: u32 = channel("gap_voltage_gated");
const CURRENT: u32 = channel("gap_current");
/// Scan; watchdog on the voltage alone, with interrupt; overrun interrupt (RM0090 13.13.2).
const CR1: u32 = VOLTAGE | 1 << 6 | 1 << 8 | 1 << 9 | 1 << 23 | 1 << 26;
/// On; DMA without end; rising edge of TIM4 channel 4.
const CR2: u32 = 1 | 1 << 8 | 1 << 9 | 0b1001 << 24 | 0b01 << 28;
const AWD: u32 = 1;
const OVR: u32 = 1 << 5;

/// Short pulses so far, wrapping. For slower tasks, and for the end of a pulse.
#[inline]
pub fn shorts() -> u32 {
    SHORTS.load(Relaxed)
}

/// Retreats that the reflex has begun so far, wrapping. For slower tasks.
#[inline]
pub fn retreats() -> u32 {
    RETREATS.load(Relaxed)
}

/// Pulses converted so far, modulo [`EDGE_COUNT`].
#[inline]
pub fn conversions() -> u32 {
    written() / 2
}

/// Codes written since the stream was enabled, modulo the ring.
#[inline(always)]
fn written() -> u32 {
    (RING as u32).wrapping_sub(dma::left::<3>()) % RING as u32
}

/// Where the current of the newest pulse is; its voltage, which follows, may still be on its way.
#[inline(always)]
fn place() -> usize {
    (written().wrapping_sub(1) & !1) as usize % RING
}

/// Current and voltage of the newest pulse of which both are there, converter codes.
pub fn newest() -> [u16; 2] {
    let at = (written().wrapping_sub(2) & !1) as usize % RING;
    [at, at + 1].map(|at| PULSES.get(at).map_or(0, |code| code.load(Relaxed)))
}

/// The pulse-synchronous converter with its blanking timer. Owned by the reflex task.
pub struct Gated {
    adc: pac::ADC2,
    run: Run,
    limits: &'static Limits,
    stream: Stream<3>,
}

/// Sets blanking and thresholds. Owned by a slower task; each register is written whole.
pub struct Thresholds {
    tim: pac::TIM4,
    _gate: Ch2<PushPull>,
}

impl Gated {
    /// Configures timer, whose channel 2 is connected to the gate, and converter with the shortest blanking and a watchdog
    /// that never trips.
    pub fn new(
        adc: pac::ADC2,
        tim: pac::TIM4,
        gate: impl Into<Ch2<PushPull>>,
        stream: Stream<3>,
        limits: &'static Limits,
        rcc: &mut pac::RCC,
    ) -> Result<(Self, Thresholds), StartError> {
        reset::<pac::TIM4>(rcc);
        // Trigger mode from the filtered channel 2; one pulse; channel 4 rises when the count is reached (PWM mode 2).
        put!(tim.ccmr1_input(), 0b0011 << 12 | 0b01 << 8);
        put!(tim.ccmr2_output(), 0b111 << 12);
        put!(tim.ccer(), 1 << 12);
        put!(tim.cr1(), 1 << 3);
        let mut thresholds = Thresholds { tim, _gate: gate.into() };
        thresholds.write_blanking(must!(blanking(0, BLANKING_CLOCK, BLANKING_MOST)));
        put!(thresholds.tim.egr(), 1);
        put!(thresholds.tim.smcr(), 0b110 << 4 | 0b110);

        sampling(&adc, CURRENT, GATED_SAMPLING.smpr);
        sampling(&adc, VOLTAGE, GATED_SAMPLING.smpr);
        put!(adc.sqr1(), (2 - 1) << 20);
        put!(adc.sqr3(), CURRENT | VOLTAGE << 5);
        put!(adc.ltr(), 0);
        put!(adc.htr(), 4095);
        put!(adc.cr1(), CR1);
        power_up(&adc);
        let mut gated = Gated { adc, run: Run::new(), limits, stream };
        gated.restart()?;
        Ok((gated, thresholds))
    }

    /// Starts DMA and converter together, so that current and voltage stay in their places. Kept out of the reflex's way.
    #[cold]
    fn restart(&mut self) -> Result<(), StartError> {
        put!(self.adc.cr2(), 1);
        put!(self.adc.sr(), 0);
        self.stream.fill(1, dma::URGENT, self.adc.dr().as_ptr().cast_const(), &PULSES)?;
        put!(self.adc.cr2(), CR2);
        Ok(())
    }

    /// The interrupt: judges the pulse and acts on the lines at once.
    #[inline(always)]
    pub fn reflex(&mut self) {
        let flags = self.adc.sr().read().bits();
        put!(self.adc.sr(), !(AWD | OVR));
        if flags & AWD != 0 {
            let current = PULSES.get(place()).map_or(0, |code| code.load(Relaxed));
            let now = DWT::cycle_count();
            match self.run.low(self.limits, lines::gate_is_open(), current, gate_edges(), now) {
                Verdict::Pass => return,
                Verdict::Kill => lines::kill_pulse(),
                Verdict::Retreat => {
                    lines::retract();
                    RETREATS.store(RETREATS.load(Relaxed).wrapping_add(1), Relaxed);
                }
            }
            SHORTS.store(SHORTS.load(Relaxed).wrapping_add(1), Relaxed);
        }
        if flags & OVR != 0 && self.restart().is_err() {
            // Without the reflex there are no pulses.
            lines::stop();
        }
    }
}

impl reflex::Thresholds for Thresholds {
    type Error = Refused;

    /// Blanking is the longer of 2 us and three time constants.
    fn set(&mut self, config: &Config) -> Result<(), Refused> {
        self.write_blanking(blanking(config.tau_ns, BLANKING_CLOCK, BLANKING_MOST)?);
        self.write_voltage(config.voltage);
        lines::set_reversed(config.motor_reversed);
        Ok(())
    }

    fn watch_ends(&mut self, pauses: &pause::Config) {
        super::ends::watch(pauses.pauses());
    }

    fn pauses_begun(&self) -> u32 {
        super::ends::begun()
    }

    fn gate_rung(&self) -> u32 {
        super::ends::rung()
    }
}

impl Thresholds {
    fn write_blanking(&mut self, ticks: u32) {
        // The one pulse ends a count later; both registers are free of preload and the counter rests between pulses.
        put!(self.tim.arr(), ticks + 1);
        put!(self.tim.ccr4(), ticks);
    }

    fn write_voltage(&mut self, (low, high): (u16, u16)) {
        // SAFETY: the register block is always there; the two threshold registers are written here alone.
        let adc = unsafe { &*pac::ADC2::ptr() };
        put!(adc.ltr(), u32::from(low));
        put!(adc.htr(), u32::from(high));
    }
}
