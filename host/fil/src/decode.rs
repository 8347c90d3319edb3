//! What the engine has to know about an instruction before it runs: length, class, place in an IT block, nominal cycles.
//!
//! Nominal cycles are those of the Cortex-M4 technical reference manual (DDI 0439, table 3-1 and 7-1) from flash without
//! wait: 1 for data processing, 2 for a load, 1 + n for n registers, 14 for VDIV and VSQRT. A taken branch costs
//! [`REFILL`] more; data-dependent division is taken as 6.

/// Cycles to refill the pipeline after a taken branch (1..3 in the manual).
pub const REFILL: u8 = 2;

/// What is special about an instruction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Class {
    /// Nothing.
    #[default]
    Plain,
    /// Uses the FPU.
    Float,
    /// May change PRIMASK, FAULTMASK or BASEPRI.
    Masks,
    /// Waits for an interrupt.
    Wait,
    /// Waits for or sends an event: refused.
    Event,
}

/// One decoded instruction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Instruction {
    /// Bytes; zero: not decoded yet.
    pub size: u8,
    /// Cycles without branch penalty.
    pub cycles: u8,
    /// Class.
    pub class: Class,
    /// Inside an IT block (not the IT itself).
    pub in_it: bool,
    /// Instructions of the IT block this instruction opens.
    pub opens: u8,
}

/// Decodes the instruction whose half words are `first` and, if it is a long one, `second`.
pub fn decode(first: u16, second: u16) -> Instruction {
    let (a, b) = (u32::from(first), u32::from(second));
    if a >> 11 < 0x1d { short(a) } else { long(a, b) }
}

fn short(a: u32) -> Instruction {
    let plain = Instruction { size: 2, cycles: 1, ..Instruction::default() };
    let class = |class| Instruction { class, ..plain };
    let cycles = |cycles: u32| Instruction { cycles: cycles as u8, ..plain };
    match a {
        0xbf30 => class(Class::Wait),
        0xbf20 | 0xbf40 => class(Class::Event),
        _ if a & 0xff00 == 0xbf00 && a & 15 != 0 => Instruction { opens: 4 - (a & 15).trailing_zeros() as u8, ..plain },
        _ if a & 0xffe8 == 0xb660 => class(Class::Masks),
        // Literal, register-offset and immediate loads; stores go through the write buffer.
        _ if a >> 11 == 0b01001 => cycles(2),
        _ if a >> 12 == 5 && a & 0x0e00 >= 0x0600 => cycles(2),
        _ if matches!(a >> 11, 0b01101 | 0b01111 | 0b10001 | 0b10011) => cycles(2),
        // POP, PUSH, LDM, STM.
        _ if a & 0xf600 == 0xb400 => cycles(1 + (a & 0x1ff).count_ones()),
        _ if a >> 12 == 0xc => cycles(1 + (a & 0xff).count_ones()),
        _ => plain,
    }
}

fn long(a: u32, b: u32) -> Instruction {
    let plain = Instruction { size: 4, cycles: 1, ..Instruction::default() };
    let cycles = |cycles: u32| Instruction { cycles: cycles as u8, ..plain };
    if a & 0xec00 == 0xec00 && matches!(b >> 8 & 15, 10 | 11) {
        return Instruction { class: Class::Float, cycles: float(a, b), ..plain };
    }
    match a {
        _ if a & 0xffe0 == 0xf380 && b & 0xd000 == 0x8000 => Instruction { class: Class::Masks, cycles: 2, ..plain },
        // WFI.W and friends.
        0xf3af if b == 0x8003 => Instruction { class: Class::Wait, ..plain },
        0xf3af if b == 0x8002 || b == 0x8004 => Instruction { class: Class::Event, ..plain },
        0xf3bf => cycles(4),                                            // DSB, DMB, ISB
        0xf3ef => cycles(2),                                            // MRS
        _ if a & 0xfe40 == 0xe800 => cycles(1 + b.count_ones()),        // LDM, STM
        _ if a & 0xfff0 == 0xe8d0 && b & 0xffe0 == 0xf000 => cycles(2), // TBB, TBH
        _ if a & 0xfe50 == 0xe850 || a & 0xfe50 == 0xe840 => cycles(3), // LDRD, STRD, exclusives
        _ if a & 0xfe10 == 0xf810 => cycles(2),                         // loads
        _ if matches!(a & 0xfff0, 0xfb90 | 0xfbb0) => cycles(6),        // SDIV, UDIV
        _ => plain,
    }
}

/// FPU instructions (DDI 0439, table 7-1).
fn float(a: u32, b: u32) -> u8 {
    let data = a & 0xff00 == 0xee00;
    let multiple = a & 0xfe00 == 0xec00 && a & 0x0f40 != 0x0c40;
    match a {
        _ if data && b & 0x10 != 0 => 1,                         // VMOV, VMRS, VMSR
        _ if data && a & 0xb0 == 0x80 && b & 0x40 == 0 => 14,    // VDIV
        _ if data && a & 0xbf == 0xb1 && b & 0xc0 == 0xc0 => 14, // VSQRT
        _ if data && matches!(a & 0xb0, 0x00 | 0x10 | 0xa0 | 0x90) && a & 0xb0 != 0x20 => 3, // VMLA, VFMA
        _ if data => 1,
        _ if a & 0xff20 == 0xed00 => 2,        // VLDR, VSTR
        _ if multiple => 1 + (b & 0xff) as u8, // VLDM, VSTM, VPUSH, VPOP
        _ => 2,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn class(first: u16, second: u16) -> Class {
        decode(first, second).class
    }

    #[test]
    fn lengths_follow_the_first_half_word() {
        for (first, size) in [(0x2000, 2), (0xe7fe, 2), (0xe8bd, 4), (0xf000, 4), (0xdfff, 2)] {
            assert_eq!(decode(first, 0).size, size, "{first:#x}");
        }
    }

    #[test]
    fn classes_are_found() {
        assert_eq!(class(0xbf30, 0), Class::Wait); // wfi
        assert_eq!(class(0xbf00, 0), Class::Plain); // nop
        assert_eq!(class(0xb662, 0), Class::Masks); // cpsie i
        assert_eq!(class(0xb671, 0), Class::Masks); // cpsid f
        assert_eq!(class(0xf380, 0x8811), Class::Masks); // msr basepri, r0
        assert_eq!(class(0xf3ef, 0x8011), Class::Plain); // mrs r0, basepri
        assert_eq!(class(0xee30, 0x0a00), Class::Float); // vadd.f32 s0, s0, s0
        assert_eq!(class(0xed90, 0x0a00), Class::Float); // vldr s0, [r0]
        assert_eq!(class(0xed2d, 0x8b02), Class::Float); // vpush {d8}
        assert_eq!(class(0xeef1, 0xfa10), Class::Float); // vmrs
        assert_eq!(class(0xf000, 0xf800), Class::Plain); // bl
    }

    #[test]
    fn an_it_block_has_one_to_four_instructions() {
        for (first, opens) in [(0xbf08, 1), (0xbf0c, 2), (0xbf0e, 3), (0xbf0f, 4), (0xbf00, 0)] {
            assert_eq!(decode(first, 0).opens, opens, "{first:#x}");
        }
    }

    #[test]
    fn nominal_cycles_are_those_of_the_manual() {
        for (first, second, cycles) in [
            (0x1840, 0, 1),       // adds
            (0x6800, 0, 2),       // ldr r0, [r0]
            (0x6000, 0, 1),       // str
            (0xb5f0, 0, 6),       // push {r4-r7, lr}
            (0xfbb0, 0xf0f1, 6),  // udiv
            (0xee80, 0x0a00, 14), // vdiv.f32
            (0xeeb1, 0x0ac0, 14), // vsqrt.f32
            (0xee20, 0x0a00, 1),  // vmul.f32
            (0xeea0, 0x0a00, 3),  // vfma.f32
            (0xed90, 0x0a00, 2),  // vldr
        ] {
            assert_eq!(decode(first, second).cycles, cycles, "{first:#x} {second:#x}");
        }
    }
}
