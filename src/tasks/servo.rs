//! The servo tick: inputs in, the head's tick, outputs out.
//!
//! Reflex and stop may force the lines at any moment of it. What they had forced is read first; outputs that were decided
//! without knowing are written, and then what was forced meanwhile is repeated ([`lines::settle`]).

use super::{Answer, Checked, Granted, REFLEX, ROLL, Request, Returned, SERVO};
use core::hint::black_box;
use edm_hal_shim::bridge::{Drive, HBridge};
use edm_hal_shim::clock::Clock;
use edm_hal_shim::encoder::EdgeCounter;
use edm_hal_shim::generator::Generator;
use edm_hal_shim::safety::{DriveSense, Safety};
use edm_hal_shim::stm32f4::cycles::Cycles;
use edm_hal_shim::stm32f4::drive::DriveAdc;
use edm_hal_shim::stm32f4::encoder::{self as edges, Timer};
use edm_hal_shim::stm32f4::generator::Interface;
use edm_hal_shim::stm32f4::pwm::{self, Bridge};
use edm_hal_shim::stm32f4::safety::Inputs;
use edm_hal_shim::stm32f4::{gated, lines};
use edm_servo_head::encoder::{DecoderCount, Handover, TimerCount};
use edm_servo_head::gap::{GapReading, Quality};
use edm_servo_head::head::{Change, Fault, Head, Reason, Refused, State, Status, Supervisor, TickInput, TickOutput};
use edm_servo_head::path::Path;
use edm_servo_head::remote;
use heapless::spsc::{Consumer, Producer};

/// The head with its inputs and outputs.
pub struct Servo {
    pub(super) head: Head<&'static mut Path>,
    pub(super) bridge: Bridge,
    pub(super) generator: Interface,
    pub(super) inputs: Inputs,
    pub(super) drive: DriveAdc,
    pub(super) decoder: DecoderCount<'static, Cycles>,
    pub(super) timer: TimerCount<Timer, Cycles>,
    pub(super) handover: Handover,
    pub(super) clock: Cycles,
    /// What reflex and stop had forced, and the retreats of the reflex, at the tick before.
    pub(super) forced: lines::Forced,
    pub(super) retreats: u32,
    pub(super) gap: GapReading,
    /// What the newest tick saw: a debugger, or the emulated chip, may look at it.
    pub(super) input: TickInput,
    /// The newest fault that another task told of, and the tick that was told.
    pub(super) told: (Fault, u32),
    pub(super) readings: Consumer<'static, GapReading>,
    pub(super) faults: Consumer<'static, Fault>,
    pub(super) requests: Consumer<'static, Request>,
    pub(super) answers: Producer<'static, Answer>,
    pub(super) granted: Producer<'static, Granted>,
    pub(super) returned: Consumer<'static, Returned>,
    pub(super) statuses: Producer<'static, Status>,
    pub(super) changes: Producer<'static, Change>,
    pub(super) checked: Producer<'static, Checked>,
}

impl Servo {
    /// One tick.
    #[inline(always)]
    pub fn tick(&mut self) {
        pwm::clear_tick();
        let forced = lines::forced();
        self.input = self.inputs();
        while let Some(fault) = self.faults.dequeue() {
            self.told = (fault, self.head.status().tick.wrapping_add(1));
            self.head.raise(fault);
        }
        self.requests();
        let output = self.head.tick(black_box(&self.input));
        self.outputs(&output, forced, self.input.safety.bridge_fault);

        let status = self.head.status();
        REFLEX.arm(status.state == State::Eroding);
        if status.tick.is_multiple_of(Supervisor::PERIOD) {
            let _ = self.statuses.enqueue(*status);
        }
        if let Some(change) = self.head.next_change() {
            let _ = self.changes.enqueue(change);
            if let (Reason::CheckEnded, Some(result)) = (change.reason, self.head.check_result()) {
                let _ = self.checked.enqueue(result);
            }
        }
        ROLL.report(SERVO, self.clock.now());
    }

    fn inputs(&mut self) -> TickInput {
        let storm = edges::serve();
        self.gap.quality = Quality::Missing;
        while let Some(reading) = self.readings.dequeue() {
            self.gap = reading;
        }
        let timer = self.timer.read();
        let retreats = gated::counts().retreats;
        let reflex = retreats != self.retreats;
        self.retreats = retreats;
        TickInput {
            gap: self.gap,
            encoder: self.handover.read(self.decoder.snapshot(), timer, storm),
            watch: Some(timer),
            safety: self.inputs.read(),
            drive: self.drive.read(),
            reflex,
        }
    }

    fn requests(&mut self) {
        while let Some((leave, answer)) = self.returned.dequeue() {
            self.head.end_leave(leave);
            let _ = self.answers.enqueue(answer);
        }
        while let Some((number, request)) = self.requests.dequeue() {
            let result = match request {
                remote::Request::Command(command) => self.head.command(command),
                remote::Request::Store => match self.store(number) {
                    // Idle answers when it has stored.
                    Ok(()) => continue,
                    refused => refused,
                },
            };
            let _ = self.answers.enqueue((number, result));
        }
    }

    fn store(&mut self, number: u8) -> Result<(), Refused> {
        let leave = self.head.give_leave()?;
        self.granted.enqueue((number, leave)).map_err(|(_, leave)| {
            self.head.end_leave(leave);
            Refused::Storing
        })
    }

    fn outputs(&mut self, output: &TickOutput, forced: lines::Forced, bridge_fault: bool) {
        let mut applied = Ok(());
        if forced.bridge_since(&self.forced) {
            // Whatever was forced, the bridge starts from coasting.
            applied = self.bridge.apply(Drive::Coast);
        }
        self.forced = forced;
        if applied.and(self.bridge.apply(output.drive)).is_err() {
            lines::stop();
        }
        if output.drive != Drive::Coast && !bridge_fault {
            pwm::arm();
        }
        self.generator.set_pulses(output.pulses);
        lines::settle(forced);
    }
}
