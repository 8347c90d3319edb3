//! Thumb instructions, as far as they lead elsewhere or move the stack pointer (ARMv7-M manual, A5 and A7.7).
//!
//! Our own decoder: the library that knows every instruction (capstone) needs a C compiler, and the one in Rust (yaxpeax-arm) does
//! not know `vpush`. An instruction that is not recognised here is taken for one that does neither.

/// What an instruction does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// Nothing that matters here.
    None,
    /// Goes, or may go, to an address; a call comes back.
    Branch { to: u32, kind: Branch },
    /// Goes where a register or memory says, as a call or for good.
    Indirect,
    /// Nothing comes after it: a return, a trap, a jump by a table within the function.
    End,
    /// Takes bytes of the stack.
    Takes(u32),
    /// Sets the stack pointer to what a register or memory holds.
    StackPointer,
    /// `movw`: low half of a value in a register.
    Low { register: u32, half: u32 },
    /// `movt`: high half.
    High { register: u32, half: u32 },
    /// Sets PRIMASK: `cpsid i` or `msr primask` (B5.2.1 and B5.2.3).
    Masks,
}

/// A branch to an address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Branch {
    /// `bl`.
    Call,
    /// `b`.
    Always,
    /// `b<condition>`, `cbz`, `cbnz`.
    Maybe,
}

/// Number of the stack pointer.
const SP: u32 = 13;
const LR: u32 = 14;
const PC: u32 = 15;

/// The instructions of a stretch of code that lies at `address`, each with its address.
pub fn effects(address: u32, code: &[u8]) -> impl Iterator<Item = (u32, Effect)> {
    let halves = code.as_chunks::<2>().0.iter().map(|half| u32::from(u16::from_le_bytes(*half)));
    let mut halves = (address..).step_by(2).zip(halves);
    std::iter::from_fn(move || {
        let (at, first) = halves.next()?;
        // Of one or two half-words (A5.1).
        let effect = if first >> 11 < 0b11101 {
            short(at, first, halves.clone().map(|half| half.1))
        } else {
            long(at, first, halves.next()?.1)
        };
        Some((at, effect))
    })
}

/// `offset` from the program counter, which is two instructions ahead.
fn ahead(at: u32, offset: i32) -> u32 {
    at.wrapping_add(4).wrapping_add_signed(offset)
}

/// The low `bits` of `value` as a signed number.
fn signed(value: u32, bits: u32) -> i32 {
    (value << (32 - bits)).cast_signed() >> (32 - bits)
}

fn short(at: u32, i: u32, next: impl Iterator<Item = u32>) -> Effect {
    let branch = |offset, kind| Effect::Branch { to: ahead(at, offset), kind };
    // Moves and additions between any two registers.
    let (to, from) = (i >> 4 & 8 | i & 7, i >> 3 & 0xF);
    match i {
        0xB672 => Effect::Masks,
        0x4400..=0x44FF | 0x4600..=0x46FF if to == SP => Effect::StackPointer,
        0x4600..=0x46FF if to == PC && is_table(next) => Effect::End,
        0x4400..=0x44FF | 0x4600..=0x46FF if to == PC => Effect::Indirect,
        0x4700..=0x477F if from == LR => Effect::End,
        0x4700..=0x47FF => Effect::Indirect,
        // push
        0xB400..=0xB5FF => Effect::Takes((i & 0x1FF).count_ones() * 4),
        // sub sp
        0xB080..=0xB0FF => Effect::Takes((i & 0x7F) * 4),
        // pop {..., pc}; udf
        0xBD00..=0xBDFF | 0xDE00..=0xDEFF => Effect::End,
        0xB100..=0xB1FF | 0xB300..=0xB3FF | 0xB900..=0xB9FF | 0xBB00..=0xBBFF => {
            branch((i >> 3 & 0x40 | i >> 2 & 0x3E).cast_signed(), Branch::Maybe)
        }
        0xD000..=0xDDFF => branch(signed(i, 8) * 2, Branch::Maybe),
        0xE000..=0xE7FF => branch(signed(i, 11) * 2, Branch::Always),
        _ => Effect::None,
    }
}

/// Whether a row of `b.w` comes next, aligned by a `nop`: the compiler's jump table for arms that are far away.
fn is_table(mut next: impl Iterator<Item = u32>) -> bool {
    let first = next.find(|half| *half != 0xBF00);
    matches!((first, next.next()), (Some(0xF000..=0xF7FF), Some(second)) if second & 0xD000 == 0x9000)
}

fn long(at: u32, first: u32, second: u32) -> Effect {
    let (base, to) = (first & 0xF, second >> 8 & 0xF);
    let low = second & 0xFF;
    let immediate = first << 1 & 0x800 | second >> 4 & 0x700 | low;
    match (first, second) {
        (0xF000..=0xF7FF, 0x8000..) => control(at, first, second),
        // movw and movt
        (0xF240..=0xF24F | 0xF640..=0xF64F, _) => Effect::Low { register: to, half: base << 12 | immediate },
        (0xF2C0..=0xF2CF | 0xF6C0..=0xF6CF, _) => Effect::High { register: to, half: base << 12 | immediate },
        // add sp, and sub sp, with an expanded or a plain number
        (0xF10D | 0xF50D | 0xF11D | 0xF51D | 0xF20D | 0xF60D, _) if to == SP => Effect::None,
        (0xF1AD | 0xF5AD | 0xF1BD | 0xF5BD, _) if to == SP => Effect::Takes(expanded(immediate)),
        (0xF2AD | 0xF6AD, _) if to == SP => Effect::Takes(immediate),
        // Any other result of registers and numbers.
        (0xF000..=0xF7FF | 0xEA00..=0xEBFF, _) if to == SP => Effect::StackPointer,
        // push, pop {..., pc}, and loading the program counter from elsewhere
        (0xE92D, _) => Effect::Takes(second.count_ones() * 4),
        (0xE8BD, 0x8000..) => Effect::End,
        (0xE890..=0xE8BF | 0xE910..=0xE93F, 0x8000..) if first & 0x10 != 0 => Effect::Indirect,
        // tbb and tbh
        (0xE8D0..=0xE8DF, _) if second & 0xFFE0 == 0xF000 => Effect::End,
        // Loads and stores that move the stack pointer down: of one register, of two, of several of the FPU
        _ if first & 0xFE8F == 0xF80D && second & 0xB00 == 0x900 => Effect::Takes(low),
        _ if first & 0xFEEF == 0xE86D => Effect::Takes(low * 4),
        _ if first & 0xFFBF == 0xED2D && second & 0xE00 == 0xA00 => Effect::Takes(low * 4),
        // ldr sp and ldr pc, of which one pops
        (0xF85D, 0xFB04) => Effect::End,
        (0xF850..=0xF85F | 0xF8D0..=0xF8DF, _) if second >> 12 == SP => Effect::StackPointer,
        (0xF850..=0xF85F | 0xF8D0..=0xF8DF, _) if second >> 12 == PC => Effect::Indirect,
        _ => Effect::None,
    }
}

/// Branches and what else shares their room (A5.3.4).
fn control(at: u32, first: u32, second: u32) -> Effect {
    let sign = first >> 10 & 1;
    let (j1, j2) = (second >> 13 & 1, second >> 11 & 1);
    let far = || {
        let bits = sign << 23 | (j1 ^ sign ^ 1) << 22 | (j2 ^ sign ^ 1) << 21 | (first & 0x3FF) << 11 | second & 0x7FF;
        ahead(at, signed(bits, 24) * 2)
    };
    match second >> 12 & 0b101 {
        0b101 => Effect::Branch { to: far(), kind: Branch::Call },
        0b001 => Effect::Branch { to: far(), kind: Branch::Always },
        0b000 if first >> 7 & 0b111 != 0b111 => {
            let bits = sign << 19 | j2 << 18 | j1 << 17 | (first & 0x3F) << 11 | second & 0x7FF;
            Effect::Branch { to: ahead(at, signed(bits, 20) * 2), kind: Branch::Maybe }
        }
        0b000 if first & 0xFFE0 == 0xF380 => match second & 0xFF {
            8 | 9 => Effect::StackPointer,
            0x10 => Effect::Masks,
            _ => Effect::None,
        },
        // udf.w
        0b000 if first & 0xFFF0 == 0xF7F0 && second & 0xF000 == 0xA000 => Effect::End,
        _ => Effect::None,
    }
}

/// The number that twelve bits stand for (A5.3.2); the stack pointer is never moved by one of the repeated patterns.
fn expanded(twelve: u32) -> u32 {
    match twelve >> 10 {
        0 => twelve,
        _ => (0x80 | twelve & 0x7F).rotate_right(twelve >> 7),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Effect of the first instruction of a stretch at 0800'1000h.
    fn effect(halves: &[u16]) -> Effect {
        let bytes: Vec<u8> = halves.iter().flat_map(|half| half.to_le_bytes()).collect();
        effects(0x0800_1000, &bytes).next().unwrap().1
    }

    #[test]
    fn masks_by_hand() {
        // cpsid i; cpsie i; msr primask, r3; msr basepri, r3
        let all = [effect(&[0xB672]), effect(&[0xB662]), effect(&[0xF383, 0x8810]), effect(&[0xF383, 0x8811])];
        assert_eq!(all, [Effect::Masks, Effect::None, Effect::Masks, Effect::None]);
        // The second half of another instruction masks nothing.
        assert_eq!(effect(&[0xF8D0, 0xB672]), Effect::None);
    }

    #[test]
    fn what_is_taken_of_the_stack_by_hand() {
        for (halves, bytes) in [
            (&[0xB510][..], 8),          // push {r4, lr}
            (&[0xB084], 16),             // sub sp, #16
            (&[0xF5AD, 0x4D2C], 44_032), // sub.w sp, sp, #44032
            (&[0xF6AD, 0x4D70], 0xC70),  // subw sp, sp, #3184
            (&[0xF1AD, 0x0D08], 8),      // sub.w sp, sp, #8
            (&[0xE92D, 0x4FF0], 36),     // push.w {r4-r11, lr}
            (&[0xF84D, 0xBD04], 4),      // str r11, [sp, #-4]!
            (&[0xE96D, 0x4504], 16),     // strd r4, r5, [sp, #-16]!
            (&[0xED2D, 0x8B10], 64),     // vpush {d8-d15}
            (&[0xED2D, 0x8A01], 4),      // vpush {s16}
        ] {
            assert_eq!(effect(halves), Effect::Takes(bytes), "{halves:#06x?}");
        }
        for (what, halves) in [
            ("add sp, #508", &[0xB07F][..]),
            ("addw sp, sp, #1036", &[0xF20D, 0x4D0C]),
            ("add.w sp, sp, #1024", &[0xF50D, 0x6D80]),
            ("ldr.w r11, [r0, #132]", &[0xF8D0, 0xB084]),
            ("ldr r11, [sp], #4", &[0xF85D, 0xBB04]),
            ("str r1, [sp, #4]", &[0x9101]),
            ("strd r4, r5, [sp, #16]", &[0xE9CD, 0x4504]),
            ("add r0, sp, #8", &[0xA802]),
            ("mov r7, sp", &[0x466F]),
        ] {
            assert_eq!(effect(halves), Effect::None, "{what}");
        }
        for (what, halves) in [
            ("mov sp, r4", &[0x46A5][..]),
            ("add sp, r1", &[0x448D]),
            ("sub.w sp, sp, r0", &[0xEBAD, 0x0D00]),
            ("sub.w sp, r7, #16", &[0xF1A7, 0x0D10]),
            ("ldr.w sp, [r0]", &[0xF8D0, 0xD000]),
            ("msr msp, r0", &[0xF380, 0x8808]),
        ] {
            assert_eq!(effect(halves), Effect::StackPointer, "{what}");
        }
    }

    #[test]
    fn branches_by_hand() {
        let to = |offset: i32, kind| Effect::Branch { to: 0x0800_1004u32.wrapping_add_signed(offset), kind };
        for (halves, effect_) in [
            (&[0xE7FE][..], to(-4, Branch::Always)),
            (&[0xD1FC], to(-8, Branch::Maybe)),
            (&[0xB108], to(2, Branch::Maybe)),         // cbz r0
            (&[0xBBF8], to(126, Branch::Maybe)),       // cbnz r0
            (&[0xF7FF, 0xFFFE], to(-4, Branch::Call)), // bl
            (&[0xF000, 0xF800], to(0, Branch::Call)),
            (&[0xF7FF, 0xBFFE], to(-4, Branch::Always)), // b.w
            (&[0xF43F, 0xAFFE], to(-4, Branch::Maybe)),  // beq.w
            (&[0xF040, 0x8002], to(4, Branch::Maybe)),   // bne.w
        ] {
            assert_eq!(effect(halves), effect_, "{halves:#06x?}");
        }
        for (what, halves) in [
            ("blx r2", &[0x4790][..]),
            ("bx r3", &[0x4718]),
            ("mov pc, r0", &[0x4687]),
            ("mov pc, r0; nop; bl", &[0x4687, 0xBF00, 0xF000, 0xF800]),
            ("ldr.w pc, [r0, #4]", &[0xF8D0, 0xF004]),
            ("ldmia r0, {r1, pc}", &[0xE890, 0x8002]),
        ] {
            assert_eq!(effect(halves), Effect::Indirect, "{what}");
        }
        for (what, halves) in [
            ("bx lr", &[0x4770][..]),
            ("pop {r7, pc}", &[0xBD80]),
            ("pop.w {r4-r8, pc}", &[0xE8BD, 0x81F0]),
            ("ldr pc, [sp], #4", &[0xF85D, 0xFB04]),
            ("udf #254", &[0xDEFE]),
            ("udf.w #0", &[0xF7F0, 0xA000]),
            ("tbb [pc, r0]", &[0xE8DF, 0xF000]),
            ("tbh [pc, r0, lsl #1]", &[0xE8DF, 0xF010]),
            ("mov pc, r0; nop; b.w", &[0x4687, 0xBF00, 0xF7FF, 0xBFFE]),
            ("mov pc, r0; b.w", &[0x4687, 0xF7FF, 0xBFFE]),
        ] {
            assert_eq!(effect(halves), Effect::End, "{what}");
        }
        for (what, halves) in [
            ("pop.w {r4-r8, lr}", &[0xE8BD, 0x41F0][..]),
            ("dsb", &[0xF3BF, 0x8F4F]),
            ("mrs r0, msp", &[0xF3EF, 0x8008]),
            ("svc #0", &[0xDF00]),
            ("ldrexb r0, [r0]", &[0xE8D0, 0x0F4F]),
            ("movs r0, #1", &[0x2001]),
        ] {
            assert_eq!(effect(halves), Effect::None, "{what}");
        }
    }

    #[test]
    fn halves_of_an_address_by_hand() {
        // movw r1, #0x8e74; movt r1, #0x802
        assert_eq!(effect(&[0xF648, 0x6174]), Effect::Low { register: 1, half: 0x8E74 });
        assert_eq!(effect(&[0xF6C0, 0x0102]), Effect::High { register: 1, half: 0x802 });
    }
}
