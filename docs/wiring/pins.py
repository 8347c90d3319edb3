"""Pins of the head: one row a signal, for the table of the page and the processor on sheet 1.

`make.py --check` compares pin and function with the boards of the firmware (hal-shim/src/board).
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Pin:
    signal: str  # as in the board's table
    text: str
    pin: str
    number: int  # LQFP64
    function: str
    level: str
    sheet: int
    short: str  # on sheet 1
    disc: str = ""  # pin and function on STM32F407G-DISC1 where it is another
    why: str = ""


# fmt: off
PINS = [
    Pin("gap_voltage", "gap voltage, fixed rate", "PC0", 8, "ADC1_IN10", "{scale}", 2, "gap V fixed rate", "PC5, ADC1_IN15", "PC0 enables the USB supply and has a pull-up"),
    Pin("gap_voltage_gated", "gap voltage, gate-synchronous", "PC1", 9, "ADC2_IN11", "the same", 2, "gap V gated", "PB1, ADC2_IN9", "leaves PC1 for ADC3"),
    Pin("gap_current", "gap current", "PC2", 10, "ADC2_IN12", "mid-scale = 0 A", 2, "gap I", "PC4, ADC2_IN14", "free pin next to PC5"),
    Pin("motor_current", "motor current", "PC3", 11, "ADC3_IN13", "mid-scale = 0 A", 3, "motor I", "PC1, ADC3_IN11", "PC3 is the output of the microphone"),
    Pin("bus_voltage", "bus voltage", "PA3", 17, "ADC3_IN3", "{bus}", 3, "bus voltage"),
    Pin("comparator_high", "gap above 70 %", "PC8", 39, "TIM8_CH3", "high = above", 2, "gap above 70 %"),
    Pin("comparator_low", "gap above 20 %", "PC9", 40, "TIM8_CH4", "high = above", 2, "gap above 20 %"),
    Pin("gate", "gate", "PC6", 37, "TIM8_CH1, EXTI6", "high = on; one line to PC6 and PB7", 4, "gate"),
    Pin("gate_start", "gate, start of blanking", "PB7", 59, "TIM4_CH2", "the same line", 4, "gate"),
    Pin("encoder_a", "encoder A", "PA0", 14, "TIM5_CH1, EXTI0", "3.3 V", 4, "encoder A"),
    Pin("encoder_b", "encoder B", "PA1", 15, "TIM5_CH2, EXTI1", "3.3 V", 4, "encoder B"),
    Pin("encoder_index", "index", "PA2", 16, "GPIO, EXTI2", "3.3 V", 4, "index"),
    Pin("upper_limit", "upper limit", "PC11", 52, "GPIO, EXTI11", "low = safe, {R414} up", 4, "upper limit"),
    Pin("lower_limit", "lower limit", "PC12", 53, "GPIO, EXTI12", "low = safe, {R414} up", 4, "lower limit"),
    Pin("emergency_stop", "emergency stop", "PC13", 2, "GPIO, EXTI13", "low = safe, {R414} up", 4, "emergency stop"),
    Pin("dielectric", "dielectric and enclosure OK", "PB15", 36, "GPIO, EXTI15", "low = safe, {R414} up", 4, "interlocks OK"),
    Pin("bridge_fault", "bridge fault", "PB12", 33, "TIM1_BKIN", "low = fault, {R311} **down**: unplugged is a fault", 3, "bridge fault"),
    Pin("pwm", "PWM", "PA8", 41, "TIM1_CH1", "20 kHz, {R302} down", 3, "PWM"),
    Pin("forward", "forward (toward the work)", "PB13", 34, "GPIO out", "{R303} down", 3, "forward"),
    Pin("reverse", "reverse (away from the work)", "PB0", 26, "GPIO out", "{R304} down", 3, "reverse"),
    Pin("allow_pulses", "allow pulses", "PC7", 38, "GPIO out", "high = allowed, {R419} down", 5, "allow pulses"),
    Pin("live", "live", "PB5", 57, "GPIO out", "an edge each servo tick, {R501} down", 5, "live"),
    Pin("arm", "arm", "PD2", 54, "GPIO out", "rising edge arms, {R502} down", 5, "arm"),
    Pin("armed", "armed", "PB4", 56, "GPIO in", "high = armed, {R503} down", 5, "armed"),
    Pin("off_time", "off-time request", "PA4", 20, "DAC_OUT1", "below {own} = the generator's own", 4, "off-time"),
    Pin("can_rx", "CAN RX", "PB8", 61, "CAN1_RX", "from the transceiver", 4, "CAN RX", "PD0, CAN1_RX", "PB8 goes with PB9"),
    Pin("can_tx", "CAN TX", "PB9", 62, "CAN1_TX", "to the transceiver", 4, "CAN TX", "PD1, CAN1_TX", "PB9 is the audio part's I2C data, with a pull-up"),
    Pin("led", "status LED", "PB1", 27, "GPIO out", "high = lit, 1 k in series", 1, "status LED, 1 k", "PD13, GPIO out", "LD3 orange, on the board"),
    Pin("flush_valve", "flush valve (reserved)", "PB14", 35, "GPIO out", "{R418} down", 4, "flush valve"),
    Pin("carry", "move me (coarse axis)", "PB2", 28, "GPIO out", "high = asked, {R422} down", 4, "move me"),
    Pin("step", "step of a host", "PA15", 50, "TIM2_CH1", "isolated input, low = current", 4, "step"),
    Pin("step_direction", "direction of a host", "PB10", 29, "TIM2_CH3", "isolated input, low = current", 4, "direction", "PB11, TIM2_CH4", "PB10 clocks the microphone"),
    Pin("step_ready", "ready for steps", "PC10", 51, "GPIO out", "high = ready, {R422} down", 4, "ready for steps"),
    Pin("spark_frequency", "spark frequency (reserved)", "PA6", 22, "TIM13_CH1", "isolated input", 4, "spark frequency"),
]
# fmt: on

# Pins that no signal of the firmware owns.
OTHERS = [
    ("encoder fault (not read yet)", "PC4", "24", "GPIO, EXTI4", "low = a pair is open or shorted, {R423} up", "4"),
    ("debug probe", "PA13, PA14, NRST", "46, 49, 7", "SWD", "100 nF at NRST", "1"),
    ("crystal", "PH0, PH1", "5, 6", "HSE", "8 MHz, its load capacitors", "1"),
    ("boot", "BOOT0", "60", "", "10 k down", "1"),
]

# Of them on STM32F407G-DISC1 elsewhere.
OTHERS_DISC = [("encoder fault (not read yet)", "PC4", "PE4, GPIO, EXTI4", "PC4 is the gap current")]

FREE = "PA5, PA7, PA9..PA12, PB3, PB6, PB11, PC5, PC14, PC15"

# Alternate function of what a pin does, [DS] table of alternate functions.
ALTERNATE = {"TIM1": "AF1", "TIM2": "AF1", "TIM4": "AF2", "TIM5": "AF2", "TIM8": "AF3", "TIM13": "AF9", "CAN1": "AF9"}
