//! The table of a board, and what must hold for it.

use super::Pll;
use core::fmt;

/// A pin of the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pin {
    /// Port, 'A' to 'I'.
    pub port: char,
    /// Number in the port, 0 to 15; also the number of its EXTI line.
    pub number: u8,
}

impl Pin {
    /// From a name such as `PA10`; anything else does not compile in a constant.
    pub const fn parse(name: &str) -> Pin {
        let bytes = name.as_bytes();
        assert!(bytes.len() >= 3 && bytes.len() <= 4 && bytes[0] == b'P', "a pin is named like PA10");
        let number = number(bytes.split_at(2).1);
        assert!(bytes[1] >= b'A' && bytes[1] <= b'I' && number < 16, "ports are A to I, pins 0 to 15");
        Pin { port: bytes[1] as char, number }
    }
}

impl fmt::Display for Pin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "P{}{}", self.port, self.number)
    }
}

/// One signal of a board.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Name, as in the board's struct.
    pub signal: &'static str,
    /// Where it is.
    pub pin: Pin,
    /// What the chip does with it; words that begin with EXTI, TIM, ADC or DAC claim that line or channel.
    pub function: &'static str,
    /// What is connected outside.
    pub outside: &'static str,
}

/// All that is a board's own.
#[derive(Clone, Copy, Debug)]
pub struct Table {
    /// Board and chip.
    pub name: &'static str,
    /// Crystal, Hz.
    pub crystal_hz: u32,
    /// What makes the core's 168 MHz of it.
    pub pll: Pll,
    /// Bit rate of CAN until a host configures another, bit/s: one of [`BIT_RATES`](crate::timing::can::BIT_RATES).
    pub bit_rate: u32,
    /// Settings whose default is another here than docs/settings.md says, by key.
    pub defaults: &'static [(&'static str, f32)],
    /// The signals.
    pub rows: &'static [Row],
}

impl Table {
    /// Number of the chip, such as 405 of "STM32F405RG, LQFP64": by which an update is for this board.
    pub const fn chip(&self) -> u32 {
        let name = self.name.as_bytes();
        let (mut i, mut number) = (0, 0);
        // Behind "STM32F".
        while i < 3 {
            let digit = name[6 + i];
            assert!(digit.is_ascii_digit(), "a board is named after its chip");
            number = 10 * number + (digit - b'0') as u32;
            i += 1;
        }
        number
    }

    /// The pin of a signal; a signal that is not there does not compile in a constant.
    pub const fn pin(&self, signal: &str) -> Pin {
        let mut i = 0;
        while i < self.rows.len() {
            if same(self.rows[i].signal.as_bytes(), signal.as_bytes()) {
                return self.rows[i].pin;
            }
            i += 1;
        }
        panic!("no such signal on this board")
    }

    /// Channel of the converter that a signal's function names, such as 10 for ADC1_IN10.
    pub const fn adc_channel(&self, signal: &str) -> u8 {
        let mut i = 0;
        while i < self.rows.len() {
            if same(self.rows[i].signal.as_bytes(), signal.as_bytes()) {
                let (name, _) = word(self.rows[i].function.as_bytes(), 0);
                assert!(name.len() > 7 && same(name.split_at(3).0, b"ADC"), "not a converter input");
                return number(name.split_at(7).1);
            }
            i += 1;
        }
        panic!("no such signal on this board")
    }

    /// Refuses, at compile time, a pin, an interrupt line, a timer or converter channel that is used twice, and an
    /// interrupt line that is not the pin's own.
    pub const fn check(&self) {
        let mut i = 0;
        while i < self.rows.len() {
            let row = &self.rows[i];
            if let Some(line) = exti(row.function) {
                assert!(line == row.pin.number, "a pin reaches only the EXTI line of its own number");
            }
            let mut j = i + 1;
            while j < self.rows.len() {
                let other = &self.rows[j];
                assert!(
                    row.pin.port as u32 != other.pin.port as u32 || row.pin.number != other.pin.number,
                    "a pin is used twice"
                );
                if let (Some(a), Some(b)) = (exti(row.function), exti(other.function)) {
                    assert!(a != b, "an EXTI line is used twice");
                }
                assert!(!share_a_word(row.function, other.function), "a timer or converter channel is used twice");
                j += 1;
            }
            i += 1;
        }
    }
}

impl Table {
    /// Channel of the timer that a signal's function names, such as 3 for TIM2_CH3.
    pub const fn timer_channel(&self, signal: &str) -> u8 {
        let mut i = 0;
        while i < self.rows.len() {
            if same(self.rows[i].signal.as_bytes(), signal.as_bytes()) {
                let (name, _) = word(self.rows[i].function.as_bytes(), 0);
                assert!(name.len() == 8 && same(name.split_at(3).0, b"TIM"), "not a channel of a timer");
                return number(name.split_at(7).1);
            }
            i += 1;
        }
        panic!("no such signal on this board")
    }
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Pll { m, n, q } = self.pll;
        writeln!(f, "{}, crystal {} MHz, PLL m {m} n {n} q {q}", self.name, self.crystal_hz / 1_000_000)?;
        writeln!(f, "  CAN {} kbit/s unless configured", self.bit_rate / 1000)?;
        for (key, value) in self.defaults {
            writeln!(f, "  {key} {value} unless set")?;
        }
        for row in self.rows {
            // Display of a struct does not pad: the pin is padded here.
            let space = if row.pin.number < 10 { " " } else { "" };
            writeln!(f, "  {:<17} {}{space} {:<17} {}", row.signal, row.pin, row.function, row.outside)?;
        }
        Ok(())
    }
}

pub(super) const fn same(a: &[u8], b: &[u8]) -> bool {
    if a.len() != b.len() {
        return false;
    }
    let mut i = 0;
    while i < a.len() {
        if a[i] != b[i] {
            return false;
        }
        i += 1;
    }
    true
}

/// The word of `text` that begins at `from`, and where the next one may begin.
const fn word(text: &[u8], from: usize) -> (&[u8], usize) {
    let mut start = from;
    while start < text.len() && (text[start] == b' ' || text[start] == b',') {
        start += 1;
    }
    let mut end = start;
    while end < text.len() && text[end] != b' ' && text[end] != b',' {
        end += 1;
    }
    (text.split_at(end).0.split_at(start).1, end)
}

/// Claims a resource: EXTI5, TIM5_CH1, ADC1_IN10, DAC_OUT1.
const fn claims(word: &[u8]) -> bool {
    if word.len() < 5 {
        return false;
    }
    let (head, _) = word.split_at(3);
    same(head, b"TIM") || same(head, b"ADC") || same(head, b"DAC") || same(head, b"EXT")
}

const fn share_a_word(a: &str, b: &str) -> bool {
    let (a, b) = (a.as_bytes(), b.as_bytes());
    let (mut mine, mut i) = word(a, 0);
    while !mine.is_empty() {
        if claims(mine) {
            let (mut other, mut j) = word(b, 0);
            while !other.is_empty() {
                if same(mine, other) {
                    return true;
                }
                (other, j) = word(b, j);
            }
        }
        (mine, i) = word(a, i);
    }
    false
}

const fn number(digits: &[u8]) -> u8 {
    let mut number = 0;
    let mut i = 0;
    while i < digits.len() {
        assert!(digits[i] >= b'0' && digits[i] <= b'9', "a number");
        number = 10 * number + (digits[i] - b'0');
        i += 1;
    }
    number
}

/// The EXTI line that a function claims.
const fn exti(function: &str) -> Option<u8> {
    let text = function.as_bytes();
    let (mut this, mut i) = word(text, 0);
    while !this.is_empty() {
        if this.len() > 4 && same(this.split_at(4).0, b"EXTI") {
            return Some(number(this.split_at(4).1));
        }
        (this, i) = word(text, i);
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::board::{BOARDS, F405};

    const fn row(signal: &'static str, pin: &'static str, function: &'static str) -> Row {
        Row { signal, pin: Pin::parse(pin), function, outside: "" }
    }

    fn refusal(rows: &'static [Row]) -> String {
        let table = Table { rows, ..F405::TABLE };
        let panic = std::panic::catch_unwind(|| table.check()).expect_err("the table should be refused");
        panic.downcast_ref::<&str>().unwrap().to_string()
    }

    #[test]
    fn names_of_pins() {
        assert_eq!(Pin::parse("PA0"), Pin { port: 'A', number: 0 });
        assert_eq!(Pin::parse("PI15").to_string(), "PI15");
        for bad in ["PA16", "PJ0", "PA", "A10", "PAx", "PA100"] {
            assert!(std::panic::catch_unwind(|| Pin::parse(bad)).is_err(), "{bad}");
        }
    }

    #[test]
    fn each_clash_is_refused_by_name() {
        const PIN: &[Row] = &[row("a", "PA0", "TIM5_CH1"), row("b", "PA0", "GPIO")];
        assert_eq!(refusal(PIN), "a pin is used twice");
        const LINE: &[Row] = &[row("a", "PA1", "EXTI1"), row("b", "PB1", "GPIO, EXTI1")];
        assert_eq!(refusal(LINE), "an EXTI line is used twice");
        const WRONG: &[Row] = &[row("a", "PA1", "EXTI2")];
        assert_eq!(refusal(WRONG), "a pin reaches only the EXTI line of its own number");
        const CHANNEL: &[Row] = &[row("a", "PA1", "TIM5_CH2 AF2, EXTI1"), row("b", "PB1", "AF2 TIM5_CH2")];
        assert_eq!(refusal(CHANNEL), "a timer or converter channel is used twice");
    }

    #[test]
    fn the_same_pin_number_on_two_ports_and_the_same_function_word_are_no_clash() {
        const ROWS: &[Row] = &[row("a", "PA1", "TIM5_CH2 AF2, EXTI1"), row("b", "PB1", "TIM3_CH4 AF2")];
        Table { rows: ROWS, ..F405::TABLE }.check();
    }

    #[test]
    fn every_board_offers_the_same_signals() {
        let names = |table: Table| table.rows.iter().map(|row| row.signal).collect::<Vec<_>>();
        for (_, table) in BOARDS {
            assert_eq!(names(*table), names(F405::TABLE), "{}", table.name);
        }
    }

    #[test]
    fn the_printed_table_names_every_signal_once() {
        let text = F405::TABLE.to_string();
        for row in F405::TABLE.rows {
            assert_eq!(text.lines().filter(|line| line.split_whitespace().next() == Some(row.signal)).count(), 1);
        }
        assert_eq!(F405::TABLE.pin("encoder_a"), Pin { port: 'A', number: 0 });
    }

    #[test]
    fn the_channel_of_a_converter_input_is_read_from_its_function() {
        assert_eq!((F405::TABLE.adc_channel("gap_voltage"), F405::TABLE.adc_channel("bus_voltage")), (10, 3));
        assert!(std::panic::catch_unwind(|| F405::TABLE.adc_channel("pwm")).is_err());
    }

    #[test]
    fn the_channel_of_a_timer_is_read_from_its_function() {
        let channels = BOARDS.iter().map(|(_, table)| table.timer_channel("step_direction")).collect::<Vec<_>>();
        assert_eq!((F405::TABLE.timer_channel("step"), channels), (1, vec![3, 4]));
        assert!(std::panic::catch_unwind(|| F405::TABLE.timer_channel("bridge_fault")).is_err());
    }
}
