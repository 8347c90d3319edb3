//! Signals between peripherals, pins and the interrupt controller.

use super::bus::Block;
use super::{PORTS, Soc, slot};
use crate::adc::{Adc, Trigger};
use crate::crc::Crc;
use crate::dac::Dac;
use crate::dma::Dma;
use crate::gpio::Mode;
use crate::pins::{self, Signal};
use crate::rcc::Gate;
use crate::timer::{Event, KINDS, Timer, sr};
use crate::world::{Drive, Pin, World};

/// Slaves that can listen to the trigger output of a timer, and as which of their ITR0..3 (RM0090 tables 93, 97, 101).
pub(super) fn slaves(master: u8) -> &'static [(usize, u32)] {
    match master {
        1 => &[(2, 0), (3, 0), (4, 0), (8, 0)],
        2 => &[(1, 1), (3, 1), (4, 1), (5, 0), (8, 1), (9, 0)],
        3 => &[(1, 2), (2, 2), (4, 2), (5, 1), (9, 1)],
        4 => &[(1, 3), (2, 3), (3, 3), (5, 2), (8, 2), (12, 0)],
        5 => &[(1, 0), (3, 2), (8, 3), (12, 1)],
        8 => &[(2, 1), (4, 3), (5, 3)],
        _ => &[],
    }
}

/// DMA1 and DMA2, as places.
const DMA1: usize = 0;
pub(super) const DMA2: usize = 1;

/// Streams of DMA2 and their channel that serve a converter (§10.3.3, table 43).
pub(super) const ADC_STREAMS: [[(usize, u32); 2]; 3] = [[(0, 0), (4, 0)], [(2, 1), (3, 1)], [(0, 2), (1, 2)]];

/// The controller, its streams and their channel that serve request `source` of TIM2 (table 42), TIM1 or TIM8 (table 43).
fn timer_streams(timer: u8, source: u8) -> (usize, &'static [(usize, u32)]) {
    let streams: &[(usize, u32)] = match (timer, source) {
        (2, 0) => &[(1, 3), (7, 3)],
        (2, 1) => &[(5, 3)],
        (2, 2) => &[(6, 3)],
        (2, 3) => &[(1, 3)],
        (2, 4) => &[(6, 3), (7, 3)],
        (1, 0) => &[(5, 6)],
        (1, 1) => &[(1, 6), (3, 6), (6, 0)],
        (1, 2) => &[(2, 6), (6, 0)],
        (1, 3) => &[(6, 6), (6, 0)],
        (1, 4) => &[(4, 6)],
        (1, 6) => &[(0, 6), (4, 6)],
        (8, 0) => &[(1, 7)],
        (8, 1) => &[(2, 7), (2, 0)],
        (8, 2) => &[(3, 7), (2, 0)],
        (8, 3) => &[(4, 7), (2, 0)],
        (8, 4 | 6) => &[(7, 7)],
        _ => &[],
    };
    (if timer == 2 { DMA1 } else { DMA2 }, streams)
}

/// Interrupt of each DMA stream (§12.2, vector table).
const DMA_LINES: [[u8; 8]; 2] = [[11, 12, 13, 14, 15, 16, 17, 47], [56, 57, 58, 59, 60, 68, 69, 70]];

impl<W: World> Soc<W> {
    /// Runs `f` on a timer and lets everything it causes happen.
    pub(super) fn with_timer<T>(&mut self, n: usize, f: impl FnOnce(&mut Timer, u64, &mut Vec<Event>) -> T) -> T {
        if self.routine.is_some_and(|routine| routine.timer == n) {
            self.end_routine();
        }
        let mut out = self.spare.pop().unwrap_or_default();
        let result = f(&mut self.timers[n], self.now, &mut out);
        self.set_due(slot::TIMER + n, self.timers[n].due());
        self.refresh_timer_lines(n);
        for event in out.drain(..) {
            self.timer_event(n, event);
        }
        self.spare.push(out);
        result
    }

    fn timer_event(&mut self, n: usize, event: Event) {
        let number = KINDS[n].number;
        match event {
            Event::Trgo => {
                self.trigger_adcs(Trigger::Trgo(number), true);
                self.trigger_adcs(Trigger::Trgo(number), false);
                for &(slave, itr) in slaves(number) {
                    if self.timers[slave - 1].listens(itr) {
                        self.with_timer(slave - 1, |t, now, out| t.trigger(now, out));
                    }
                }
            }
            Event::Output(channel, level) => self.trigger_adcs(Trigger::Output(number, channel + 1), level),
            Event::Dma(source) => {
                let (controller, streams) = timer_streams(number, source);
                self.serve_dma(controller, streams);
            }
            Event::Waveform => {
                for i in 0..self.timer_pins[n].len() {
                    let (port, pin, _) = self.timer_pins[n][i];
                    self.refresh_drive(port.into(), pin);
                }
            }
        }
    }

    fn refresh_timer_lines(&mut self, n: usize) {
        let r = self.timers[n].requests();
        let any = |soc: &Self, timer: usize| soc.timers[timer].requests() != 0;
        let nvic_line = |soc: &mut Self, line: u8, level: bool| soc.core.nvic.set_line(line, level);
        // TIM1 and TIM8 share three of their four vectors with TIM9..11 and TIM12..14.
        let shared = |first: u8, partners: usize, advanced: usize, soc: &mut Self| {
            let a = soc.timers[advanced].requests();
            for (i, flag) in [sr::BIF, sr::UIF, sr::TIF].into_iter().enumerate() {
                let level = a & flag != 0 || any(soc, partners + i);
                nvic_line(soc, first + i as u8, level);
            }
            nvic_line(soc, first + 3, a & 0x1e != 0);
        };
        match KINDS[n].number {
            1 | 9..=11 => shared(24, 8, 0, self),
            8 | 12..=14 => shared(43, 11, 7, self),
            2 => nvic_line(self, 28, r != 0),
            3 => nvic_line(self, 29, r != 0),
            4 => nvic_line(self, 30, r != 0),
            5 => nvic_line(self, 50, r != 0),
            6 => nvic_line(self, 54, r != 0),
            _ => nvic_line(self, 55, r != 0),
        }
    }

    fn trigger_adcs(&mut self, source: Trigger, rising: bool) {
        for n in 0..3 {
            if self.adcs[n].trigger(source, rising, self.now) {
                self.set_due(slot::ADC + n, self.adcs[n].due());
            }
        }
    }

    pub(super) fn fire_adc(&mut self, n: usize) {
        if self.adcs[n].fire(self.now, &mut self.world) {
            let stopped = self.serve_dma(DMA2, &ADC_STREAMS[n]);
            if stopped {
                self.adcs[n].dma_complete();
            }
        }
        self.refresh_adc(n);
        self.begin_routine(n);
    }

    /// One DMA transfer by the first of `streams` of a controller that is set up for it. Returns whether the stream has stopped with it.
    fn serve_dma(&mut self, n: usize, streams: &[(usize, u32)]) -> bool {
        let Some((stream, transfer)) = streams.iter().find_map(|&(s, c)| Some((s, self.dma[n].next(s, c)?))) else {
            return false;
        };
        let value = match transfer.from {
            0x4001_2000..0x4001_2300 => {
                let adc = (transfer.from >> 8 & 3) as usize;
                self.end_routine_of(adc);
                self.adcs[adc].read(transfer.from & 0xff).ok()
            }
            0x4000_0000..0x6000_0000 => self.read_word(transfer.from).map_err(|f| self.fail(transfer.from, f)).ok(),
            from => self.memory.dma_load(from, transfer.size),
        };
        let moved = value.and_then(|v| self.memory.dma_store(transfer.to, transfer.size, v)).is_some();
        let stopped = self.dma[n].done(stream, moved);
        let request = self.dma[n].request(stream);
        self.core.nvic.set_line(DMA_LINES[n][stream], request);
        stopped
    }

    pub(super) fn refresh_adc(&mut self, n: usize) {
        self.set_due(slot::ADC + n, self.adcs[n].due());
        let request = self.adcs.iter().any(Adc::request);
        self.core.nvic.set_line(18, request);
    }

    pub(super) fn refresh_dma(&mut self, n: usize) {
        for (stream, line) in DMA_LINES[n].into_iter().enumerate() {
            self.core.nvic.set_line(line, self.dma[n].request(stream));
        }
    }

    pub(super) fn refresh_can(&mut self) {
        self.set_due(slot::CAN, self.can.due());
        for (line, request) in (19..).zip(self.can.requests()) {
            self.core.nvic.set_line(line, request);
        }
    }

    pub(super) fn refresh_exti(&mut self) {
        let r = self.exti.requests();
        for n in 0..5 {
            self.core.nvic.set_line(6 + n, r >> n & 1 == 1);
        }
        self.core.nvic.set_line(23, r & 0x3e0 != 0);
        self.core.nvic.set_line(40, r & 0xfc00 != 0);
        for (n, line) in [(16, 1), (17, 41), (18, 42), (19, 62), (20, 76), (21, 2), (22, 3)] {
            self.core.nvic.set_line(line, r >> n & 1 == 1);
        }
    }

    /// The voltage detector is interrupt line 16 (§12.2.5).
    pub(super) fn refresh_supply(&mut self) {
        if let Some(low) = self.rcc.detect() {
            self.exti.edge(16, low);
            self.refresh_exti();
        }
    }

    pub(super) fn report_dac(&mut self) {
        for channel in 0..2 {
            let code = self.dac.code(channel);
            if code != self.dac_out[channel] {
                self.dac_out[channel] = code;
                self.world.dac(self.now, channel as u8 + 1, code);
                self.world_changed();
            }
        }
    }

    /// A port's registers have changed: signals, drives and levels of its pins follow.
    pub(super) fn refresh_port(&mut self, port: usize) {
        self.refresh_pins(port, u16::MAX);
    }

    /// The same for some of its pins.
    pub(super) fn refresh_pins(&mut self, port: usize, pins: u16) {
        for n in (0..16).filter(|n| pins >> n & 1 == 1) {
            let signal = match self.gpio[port].mode(n) {
                Mode::Alternate(af) => pins::signal(port as u8, n, af),
                _ => None,
            };
            let was = self.routes[port][usize::from(n)];
            if signal != was {
                self.routes[port][usize::from(n)] = signal;
                self.reroute(port, n, was, signal);
            }
            self.refresh_drive(port, n);
            self.refresh_level(port, n);
        }
    }

    fn reroute(&mut self, port: usize, n: u8, was: Option<Signal>, is: Option<Signal>) {
        if let Some(old) = was {
            self.feed(old, None);
        }
        for pins in &mut self.timer_pins {
            pins.retain(|p| (usize::from(p.0), p.1) != (port, n));
        }
        match is {
            Some(Signal::Channel(t, c)) => self.timer_pins[usize::from(t) - 1].push((port as u8, n, c - 1)),
            Some(Signal::ChannelAndTrigger(t)) => self.timer_pins[usize::from(t) - 1].push((port as u8, n, 0)),
            _ => (),
        }
        let routed = |s: Signal| self.routes.iter().flatten().any(|r| *r == Some(s));
        self.can.connected = routed(Signal::CanRx) && routed(Signal::CanTx);
        if let Some(new) = is {
            self.feed(new, Some(self.gpio[port].level(n)));
        }
    }

    /// What the chip drives a pin with, reported to the world when it changes.
    fn refresh_drive(&mut self, port: usize, n: u8) {
        let drive = match self.routes[port][usize::from(n)] {
            Some(Signal::Channel(t, c)) => self.timers[usize::from(t) - 1].drive(usize::from(c) - 1),
            Some(Signal::ChannelAndTrigger(t)) => self.timers[usize::from(t) - 1].drive(0),
            Some(Signal::CanTx) => Drive::Level(true),
            _ => self.gpio[port].output(n).unwrap_or_default(),
        };
        let last = &mut self.drives[port][usize::from(n)];
        if *last != drive {
            *last = drive;
            self.world.drive(self.now, Pin { port: port as u8, number: n }, drive);
            self.world_changed();
        }
    }

    /// The level of a pin may have changed: EXTI and the signal behind it see the edge.
    pub(super) fn refresh_level(&mut self, port: usize, n: u8) {
        let level = self.gpio[port].level(n);
        if (self.levels[port] >> n & 1 == 1) == level {
            return;
        }
        self.levels[port] ^= 1 << n;
        if self.exti.port(n) as usize == port && self.exti.edge(n, level) {
            self.refresh_exti();
            self.trigger_adcs(Trigger::Exti(n), level);
        }
        if let Some(signal) = self.routes[port][usize::from(n)] {
            self.feed(signal, Some(level));
        }
    }

    /// The input `signal` is at `level`, or no pin leads to it any more.
    fn feed(&mut self, signal: Signal, level: Option<bool>) {
        let high = level == Some(true);
        let timer = |t: u8| usize::from(t) - 1;
        match signal {
            Signal::Channel(t, c) => {
                self.with_timer(timer(t), |x, now, out| x.set_input(usize::from(c) - 1, high, now, out))
            }
            Signal::ChannelAndTrigger(t) => self.with_timer(timer(t), |x, now, out| {
                x.set_input(0, high, now, out);
                x.set_etr(high, now, out);
            }),
            Signal::Trigger(t) => self.with_timer(timer(t), |x, now, out| x.set_etr(high, now, out)),
            Signal::Break(t) => self.with_timer(timer(t), |x, _, out| x.set_break(level, out)),
            Signal::CanRx | Signal::CanTx => (),
        }
    }

    /// A timer's break settings have changed: look at its input anew.
    pub(super) fn refresh_break(&mut self, n: usize) {
        let wanted = Some(Signal::Break(KINDS[n].number));
        for port in 0..PORTS {
            for pin in 0..16 {
                if self.routes[port][usize::from(pin)] == wanted {
                    let level = self.gpio[port].level(pin);
                    self.with_timer(n, |t, _, out| t.set_break(Some(level), out));
                }
            }
        }
    }

    /// Puts one peripheral back to its reset state.
    pub(super) fn reset_block(&mut self, block: Block) {
        match block {
            Block::Timer(n) => self.reset_timer(n),
            Block::Adc if self.rcc.in_reset(Gate::Apb2(8)) => {
                self.adcs = [1, 2, 3].map(Adc::new);
                self.adc_common = 0;
                self.follow_adc_clock();
                for n in 0..3 {
                    self.refresh_adc(n);
                }
            }
            Block::Can => {
                self.can.reset();
                self.refresh_can();
            }
            Block::Crc => self.crc = Crc::new(),
            Block::Dac => {
                self.dac = Dac::default();
                self.report_dac();
            }
            Block::Dma(n) => {
                self.dma[n] = Dma::new();
                self.refresh_dma(n);
            }
            Block::Gpio(n) => {
                self.gpio[n].reset(n);
                self.refresh_port(n);
            }
            Block::Syscfg => self.exti.reset_syscfg(),
            Block::Adc | Block::Backup(_) | Block::Exti | Block::Flash | Block::Iwdg | Block::Pwr | Block::Rcc => (),
        }
    }

    fn reset_timer(&mut self, n: usize) {
        let fresh = Timer::new(KINDS[n]);
        self.with_timer(n, |t, now, out| {
            let clock = t.clock();
            *t = fresh;
            t.set_clock(clock, now, out);
            out.push(Event::Waveform);
        });
        for port in 0..PORTS {
            for pin in 0..16u8 {
                let belongs = match self.routes[port][usize::from(pin)] {
                    Some(
                        Signal::Channel(t, _) | Signal::ChannelAndTrigger(t) | Signal::Trigger(t) | Signal::Break(t),
                    ) => t == KINDS[n].number,
                    _ => false,
                };
                if let (true, Some(signal)) = (belongs, self.routes[port][usize::from(pin)]) {
                    let level = self.gpio[port].level(pin);
                    self.feed(signal, Some(level));
                }
            }
        }
    }
}
