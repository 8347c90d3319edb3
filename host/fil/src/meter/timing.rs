//! What an instruction costs a Cortex-M4F, before it is known what surrounds it.
//!
//! Source: Cortex-M4 technical reference manual DDI 0439 (r0p1), table 3-1 (integer), section 3.3.2 and 3.3.3 (loads and
//! stores in sequence), table 7-1 (FPU). P is the refill after a taken branch: the manual says 1 to 3.
//!
//! | instruction | low | estimate | high |
//! | --- | --- | --- | --- |
//! | data processing, multiply (long, accumulate) | 1 | 1 | 1 |
//! | IT | 0, folded | 1 | 1 |
//! | instruction of an IT block that is skipped | 1 | 1 | 1 |
//! | SDIV, UDIV | 2 | 2 to 12, by the operands' lengths | 12 |
//! | LDR | 2; 1 behind a load | 2; 1 behind a load whose result is not its address | as estimated |
//! | STR with immediate offset | 1 | 1 | 1 |
//! | STR with register offset | as LDR | as LDR | as LDR |
//! | LDRD, STRD; LDM, STM, PUSH, POP of n | 3; 1 + n | the same | the same |
//! | branch taken, POP and LDM with PC | + 1 | + 2 | + 3 |
//! | TBB, TBH | 2 + 1 | 2 + 2 | 2 + 3 |
//! | MRS, MSR; barriers | 1; 1 | 2; 4 | 2; 4 |
//! | VADD, VSUB, VMUL, VCMP, VCVT, VMOV, VABS, VNEG | 1 | 1 | 1 |
//! | VMLA, VFMA and their kin | 3 | 3 | 3 |
//! | VDIV, VSQRT | 14, integer work behind it runs beside it | the same | 14, nothing beside it |
//! | VLDR, VSTR of one register | 1 | 2 | 2 |
//! | VLDM, VSTM, VPUSH, VPOP of n words; VLDR of two | 1 + n; 3 | the same | the same |
//! | FPU result used by the next instruction, except as an addend | + 1 | + 1 | + 1 |
//! | result of data processing used as an address at once | 0 | + 1 | + 1 |

use anyhow::{Result, anyhow};
use capstone::arch::arm::{ArchExtraMode, ArchMode, ArmCC, ArmOperandType};
use capstone::prelude::*;
use capstone::{AccessType, RegId};

/// Classes that the sequence rules tell apart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kind {
    /// Data processing and whatever has no rule of its own.
    #[default]
    Plain,
    /// IT.
    If,
    /// Load of one word, half word or byte.
    Load,
    /// Store of one; `register offset` in [`Timing::indexed`].
    Store,
    /// VLDR.
    FloatLoad,
    /// VSTR.
    FloatStore,
    /// SDIV, UDIV.
    Divide,
    /// VDIV, VSQRT.
    FloatDivide,
    /// Takes `base`, but perhaps only one.
    Short,
}

/// Set of registers: bits 0..=15 are r0..=pc, 16..=47 s0..=s31.
pub type Registers = u64;

/// One instruction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Timing {
    /// Bytes.
    pub size: u8,
    /// Cycles by itself.
    pub base: u8,
    /// Class.
    pub kind: Kind,
    /// May continue elsewhere than behind itself.
    pub branch: bool,
    /// Belongs to the FPU.
    pub float: bool,
    /// Its FPU result is late for the next instruction.
    pub late: bool,
    /// Address is a sum of two registers.
    pub indexed: bool,
    /// Registers read, addend not included.
    pub reads: Registers,
    /// FPU register that is added to, which is needed late.
    pub addend: Registers,
    /// Registers of the address.
    pub address: Registers,
    /// Registers written.
    pub writes: Registers,
    /// Core registers of a division: dividend, divisor.
    pub operands: (u8, u8),
    /// Of a signed division.
    pub signed: bool,
    /// Waits for all stores.
    pub barrier: bool,
}

impl Timing {
    /// Loads or stores, or waits until what was stored before is there.
    pub fn uses_bus(&self) -> bool {
        self.address != 0 || self.barrier
    }
}

/// Decoder with the registers of each instruction: Capstone.
pub struct Decoder(Capstone);

impl Decoder {
    /// A decoder for ARMv7E-M.
    ///
    /// # Errors
    /// When the library cannot be set up.
    pub fn new() -> Result<Self> {
        let build = Capstone::new().arm().mode(ArchMode::Thumb).extra_mode([ArchExtraMode::MClass].into_iter());
        Ok(Self(build.detail(true).build().map_err(|e| anyhow!("disassembler: {e}"))?))
    }

    /// Timing of the instruction that `code` begins with.
    ///
    /// # Errors
    /// For what is no instruction.
    pub fn decode(&self, address: u32, code: &[u8]) -> Result<Timing> {
        let error = |e| anyhow!("disassembler at {address:#010x}: {e}");
        let list = self.0.disasm_count(code, address.into(), 1).map_err(error)?;
        let instruction = list.first().ok_or_else(|| anyhow!("no instruction at {address:#010x}: {code:02x?}"))?;
        let detail = self.0.insn_detail(instruction).map_err(error)?;
        let arch = detail.arch_detail();
        let arm = arch.arm().ok_or_else(|| anyhow!("disassembler: no detail"))?;
        let mut t = Timing { size: instruction.len() as u8, base: 1, ..Timing::default() };
        let mut registers = Vec::new();
        for operand in arm.operands() {
            match operand.op_type {
                ArmOperandType::Reg(r) => {
                    let set = self.set(r);
                    registers.push(set);
                    let access = operand.access.unwrap_or(AccessType::ReadOnly);
                    t.reads |= if access.is_readable() { set } else { 0 };
                    t.writes |= if access.is_writable() { set } else { 0 };
                }
                ArmOperandType::Mem(m) => {
                    t.address |= self.set(m.base()) | self.set(m.index());
                    t.indexed = self.set(m.index()) != 0;
                }
                _ => {}
            }
        }
        t.reads |= t.address;
        let text = instruction.mnemonic().unwrap_or("");
        t.float = text.starts_with('v');
        // "beq.w", "addseq.w", "vmulgt.f32": without width, type and condition.
        let name = text.split('.').next().unwrap_or(text);
        let conditional = !matches!(arm.cc(), ArmCC::ARM_CC_AL | ArmCC::ARM_CC_INVALID);
        let name = if conditional && name.len() > 2 { &name[..name.len() - 2] } else { name };
        classify(&mut t, name, &registers);
        // Whatever writes PC goes elsewhere.
        t.branch |= t.writes & 1 << 15 != 0;
        Ok(t)
    }

    fn set(&self, register: RegId) -> Registers {
        let Some(name) = self.0.reg_name(register) else { return 0 };
        let number = |prefix| name.strip_prefix(prefix).and_then(|n: &str| n.parse::<u32>().ok());
        match name.as_str() {
            "sb" => 1 << 9,
            "sl" => 1 << 10,
            "fp" => 1 << 11,
            "ip" => 1 << 12,
            "sp" => 1 << 13,
            "lr" => 1 << 14,
            "pc" => 1 << 15,
            _ => match (number('r'), number('s'), number('d')) {
                (Some(n @ 0..16), ..) => 1 << n,
                (_, Some(n @ 0..32), _) => 1 << (16 + n),
                (.., Some(n @ 0..16)) => 0b11 << (16 + 2 * n),
                _ => 0,
            },
        }
    }
}

fn classify(t: &mut Timing, name: &str, registers: &[Registers]) {
    let list = |skip: usize| registers.iter().skip(skip).map(|r| r.count_ones() as u8).sum::<u8>();
    // Multiple transfers: base register first, except for PUSH and POP.
    let multiple = |t: &mut Timing, skip: usize, load: bool| {
        t.base = 1 + list(skip);
        t.address |= if skip == 1 { registers.first().copied().unwrap_or(0) } else { 1 << 13 };
        let moved = registers.iter().skip(skip).fold(0, |a, r| a | r);
        if load {
            t.writes |= moved;
            t.reads = t.address;
        } else {
            t.writes &= !moved;
            t.reads = moved | t.address;
        }
    };
    match name {
        _ if name.starts_with("it") => t.kind = Kind::If,
        "b" | "bl" | "bx" | "blx" | "cbz" | "cbnz" => t.branch = true,
        "tbb" | "tbh" => (t.branch, t.base) = (true, 2),
        "ldrd" | "strd" => t.base = 3,
        "ldm" | "ldmdb" | "vldmia" | "vldmdb" => multiple(t, 1, true),
        "stm" | "stmdb" | "vstmia" | "vstmdb" => multiple(t, 1, false),
        "pop" | "vpop" => multiple(t, 0, true),
        "push" | "vpush" => multiple(t, 0, false),
        "vldr" if list(0) == 1 => (t.kind, t.base) = (Kind::FloatLoad, 2),
        "vstr" if list(0) == 1 => (t.kind, t.base) = (Kind::FloatStore, 2),
        "vldr" | "vstr" => t.base = 3,
        "sdiv" | "udiv" => {
            t.kind = Kind::Divide;
            t.signed = name == "sdiv";
            let number = |i: usize| registers.get(i).map_or(0, |r| r.trailing_zeros() as u8);
            let last = registers.len().saturating_sub(1);
            t.operands = (number(last.saturating_sub(1)), number(last));
        }
        "vdiv" | "vsqrt" => (t.kind, t.base, t.late) = (Kind::FloatDivide, 14, true),
        "vmla" | "vmls" | "vnmla" | "vnmls" | "vfma" | "vfms" | "vfnma" | "vfnms" => {
            (t.base, t.late) = (3, true);
            t.addend = registers.first().copied().unwrap_or(0);
            t.writes |= t.addend;
            t.reads = registers.iter().skip(1).fold(0, |a, r| a | r);
        }
        "vadd" | "vsub" | "vmul" | "vnmul" | "vcvt" => t.late = true,
        "vmov" if registers.len() == 3 => t.base = 2,
        "mrs" | "msr" => (t.kind, t.base) = (Kind::Short, 2),
        "dsb" | "dmb" | "isb" => (t.kind, t.base, t.barrier) = (Kind::Short, 4, name != "isb"),
        _ if name.starts_with("ldr") => (t.kind, t.base) = (Kind::Load, 2),
        _ if name.starts_with("str") => (t.kind, t.base) = (Kind::Store, if t.indexed { 2 } else { 1 }),
        _ => {}
    }
}
