//! Firmware of the engine's tests: one scenario a run, chosen by a word in RAM; results are words in RAM.
//! Built by the test with the workspace's own compiler; it needs no crates.
#![no_std]
#![no_main]

// The gap filter as the compiler writes it, and by hand.
#[path = "../../../../hal-shim/src/stm32f4/gap_filter.rs"]
mod by_hand;
// Copies, which the linker takes in the place of the compiler's.
#[path = "../../../../hal-shim/src/stm32f4/copy.rs"]
mod copy;
#[path = "../../../../hal-shim/src/gap_filter.rs"]
mod gap_filter;
mod samples;

use core::arch::{asm, global_asm};
use core::ptr::{read_volatile, write_volatile};

const RESULT: *mut u32 = 0x2000_0000 as *mut u32;
const SCENARIO: *const u32 = 0x2000_00f0 as *const u32;

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    loop {}
}

fn put(i: usize, v: u32) {
    unsafe { write_volatile(RESULT.add(i), v) }
}

fn at(i: usize) -> u32 {
    unsafe { read_volatile(RESULT.add(i)) }
}

/// Appends an event to the order of events in word 1, four bits each.
fn note(n: u32) {
    put(1, at(1) << 4 | n);
}

fn write(address: u32, value: u32) {
    unsafe { write_volatile(address as *mut u32, value) }
}

fn read(address: u32) -> u32 {
    unsafe { read_volatile(address as *const u32) }
}

fn pend(irq: u32) {
    write(0xe000_e200 + irq / 32 * 4, 1 << (irq % 32));
}

fn enable(irq: u32, priority: u8) {
    unsafe { write_volatile((0xe000_e400 + irq) as *mut u8, priority) };
    write(0xe000_e100 + irq / 32 * 4, 1 << (irq % 32));
}

fn barrier() {
    unsafe { asm!("dsb", "isb") }
}

// The vector table: stack, reset, faults, SVC, SysTick, then interrupts 0..=81, of which 5, 6 and 7 have handlers.
global_asm!(
    ".section .vectors, \"a\"",
    ".word 0x20008000",
    ".word reset",
    ".word idle_handler",
    ".word hard_fault",
    ".word idle_handler, idle_handler, idle_handler, 0, 0, 0, 0",
    ".word sv_call",
    ".word idle_handler, 0, idle_handler",
    ".word sys_tick",
    ".rept 5",
    ".word idle_handler",
    ".endr",
    ".word irq5",
    ".word irq6",
    ".word irq7",
    ".rept 74",
    ".word idle_handler",
    ".endr",
    ".text",
    ".thumb_func",
    "hard_fault:",
    "mov r0, sp",
    "b hard_fault_rust",
    ".thumb_func",
    "sv_call:",
    "mov r0, sp",
    "b sv_call_rust",
);

#[unsafe(no_mangle)]
extern "C" fn idle_handler() {
    put(15, 0xdead);
    loop {}
}

#[unsafe(no_mangle)]
unsafe extern "C" fn hard_fault_rust(frame: *const u32) -> ! {
    put(2, read(0xe000_ed28));
    put(3, read(0xe000_ed2c));
    put(4, read(0xe000_ed38));
    put(5, unsafe { read_volatile(frame.add(6)) });
    if unsafe { read_volatile(SCENARIO) } == 10 {
        read(0x6000_0000);
    }
    loop {}
}

#[unsafe(no_mangle)]
unsafe extern "C" fn sv_call_rust(frame: *mut u32) {
    note(read(0xe000_ed04) & 0x1ff);
    // The caller's r0 comes back doubled.
    unsafe { write_volatile(frame, read_volatile(frame) * 2) };
}

#[unsafe(no_mangle)]
extern "C" fn sys_tick() {
    put(6, at(6).wrapping_add(1));
}

/// Spoils all FPU registers and the flags.
fn spoil_float() {
    unsafe {
        asm!(
            "vmov s0, {x}", "vmov s1, {x}", "vmov s2, {x}", "vmov s3, {x}", "vmov s4, {x}", "vmov s5, {x}",
            "vmov s6, {x}", "vmov s7, {x}", "vmov s8, {x}", "vmov s9, {x}", "vmov s10, {x}", "vmov s11, {x}",
            "vmov s12, {x}", "vmov s13, {x}", "vmov s14, {x}", "vmov s15, {x}", "vcmp.f32 s0, s0", "vmsr fpscr, {y}",
            x = in(reg) 0x7fc0_dead_u32, y = in(reg) 0x9000_0000_u32,
            out("s0") _, out("s1") _, out("s2") _, out("s3") _, out("s4") _, out("s5") _, out("s6") _, out("s7") _,
            out("s8") _, out("s9") _, out("s10") _, out("s11") _, out("s12") _, out("s13") _, out("s14") _, out("s15") _,
        )
    }
}

#[unsafe(no_mangle)]
extern "C" fn irq5() {
    note(5);
    let scenario = unsafe { read_volatile(SCENARIO) };
    if scenario == 1 || scenario == 13 {
        if scenario == 1 {
            spoil_float();
        }
        pend(6);
        barrier();
    }
    note(8);
}

#[unsafe(no_mangle)]
extern "C" fn irq6() {
    note(6);
    if matches!(unsafe { read_volatile(SCENARIO) }, 1 | 13) {
        spoil_float();
    }
}

#[unsafe(no_mangle)]
extern "C" fn irq7() {
    note(7);
}

fn fpu_on() {
    write(0xe000_ed88, 0x00f0_0000);
    barrier();
}

/// FPU and core registers hold patterns across an interrupt that nests another; word 0 counts the differences.
fn float_across_interrupts() {
    fpu_on();
    enable(5, 0x40);
    enable(6, 0x20);
    let bad: u32;
    unsafe {
        asm!(
            "mov r4, #1", "vmov s0, r4", "mov r4, #2", "vmov s1, r4", "mov r4, #8", "vmov s7, r4", "mov r4, #16",
            "vmov s15, r4", "mov r4, #0x60000000", "vmsr fpscr, r4",
            "mov r5, #0x20", "mov r1, #0x11", "mov r8, #0x22", "mov r12, #0x33",
            "ldr r4, =0xe000e200", "str r5, [r4]", "dsb", "isb",
            "mov r0, #0",
            "vmov r4, s0", "cmp r4, #1", "it ne", "addne r0, #1",
            "vmov r4, s1", "cmp r4, #2", "it ne", "addne r0, #1",
            "vmov r4, s7", "cmp r4, #8", "it ne", "addne r0, #1",
            "vmov r4, s15", "cmp r4, #16", "it ne", "addne r0, #1",
            "vmrs r4, fpscr", "cmp r4, #0x60000000", "it ne", "addne r0, #1",
            "cmp r1, #0x11", "it ne", "addne r0, #1",
            "cmp r8, #0x22", "it ne", "addne r0, #1",
            "cmp r12, #0x33", "it ne", "addne r0, #1",
            out("r0") bad, out("r4") _, out("r5") _, out("r8") _, out("r12") _,
            out("s0") _, out("s1") _, out("s7") _, out("s15") _, out("r1") _,
        )
    }
    put(0, bad);
}

/// A masked interrupt runs in the instruction after its mask falls, not before.
fn masks() {
    enable(5, 0x40);
    unsafe {
        asm!("msr basepri, {0}", in(reg) 0x40);
        pend(5);
        barrier();
        note(1);
        asm!("msr basepri, {0}", in(reg) 0);
        note(2);
        asm!("cpsid i");
        pend(5);
        barrier();
        note(3);
        asm!("cpsie i");
        note(4);
    }
}

fn tail_chain() {
    enable(5, 0x40);
    enable(6, 0x20);
    enable(7, 0x60);
    unsafe { asm!("cpsid i") };
    for irq in [7, 5, 6] {
        pend(irq);
    }
    unsafe { asm!("cpsie i") };
    note(1);
}

fn systick(period: u32) {
    write(0xe000_e014, period - 1);
    write(0xe000_e018, 0);
    write(0xe000_e010, 7);
}

fn sleep() {
    systick(16_000);
    for _ in 0..10 {
        unsafe { asm!("wfi") };
    }
    put(0, 1);
}

/// IT blocks under a storm of interrupts: word 0 counts wrong results.
fn it_blocks() {
    put(0, 0);
    let want = it_work();
    systick(61);
    for _ in 0..2000 {
        if it_work() != want {
            put(0, at(0) + 1);
        }
    }
    put(7, 1);
}

#[inline(never)]
fn it_work() -> u32 {
    let mut a: u32 = 0x1234;
    for i in 0..64u32 {
        unsafe {
            asm!(
                "lsls {t}, {a}, #1",
                "itete cs", "addcs {a}, {a}, #7", "addcc {a}, {a}, #13", "eorcs {a}, {a}, {i}", "addcc {a}, {a}, {i}, lsl #2",
                "tst {a}, #4",
                "ittee ne", "addne {a}, {a}, #101", "eorne {a}, {a}, #0x55", "subeq {a}, {a}, #3", "eoreq {a}, {a}, #0xaa",
                "ror {a}, {a}, #5",
                a = inout(reg) a, i = in(reg) i, t = out(reg) _, options(nomem, nostack)
            )
        }
    }
    a
}

/// Copies of every length up to two rounds of the loop, between bytes of every alignment: how many, and how many bytes are not
/// what they have to be, those around the copy included.
fn copies() {
    const ROOM: usize = 96;
    let (from, to) = (0x2000_0400 as *mut u8, 0x2000_0500 as *mut u8);
    let pattern = |i: usize| (i as u8).wrapping_mul(37).wrapping_add(11);
    let mut wrong = 0;
    let mut done = 0;
    for case in 0..18 {
        // Words twice: by each of the names that promise them.
        let (source, target) = if case < 16 { (case / 4, case % 4) } else { (0, 0) };
        for bytes in 0..=72 {
            for i in 0..ROOM {
                unsafe {
                    write_volatile(from.add(i), pattern(i));
                    write_volatile(to.add(i), 0xa5);
                }
            }
            let (source, target) = (source + 8, target + 8);
            unsafe {
                let (a, b) = (to.add(target), from.add(source));
                match case {
                    16 => copy::__aeabi_memcpy4(a, b, bytes),
                    17 => copy::__aeabi_memcpy8(a, b, bytes),
                    _ => copy::__aeabi_memcpy(a, b, bytes),
                }
            }
            for i in 0..ROOM {
                let copied = i >= target && i < target + bytes;
                let expected = if copied { pattern(i - target + source) } else { 0xa5 };
                wrong += u32::from(unsafe { read_volatile(to.add(i)) } != expected);
            }
            done += 1;
        }
    }
    put(0, done);
    put(1, wrong);
}

// Apart, so that no instruction of the FPU comes before it is enabled.
#[inline(never)]
fn filter() {
    put(0, samples::checksum(gap_filter::tick));
    put(1, samples::checksum(|c, sections, x| by_hand::tick(c, sections, x)));
}

/// Erases sector 11 and programs two words of it.
fn flash() {
    const FLASH: u32 = 0x4002_3c00;
    write(FLASH + 4, 0x4567_0123);
    write(FLASH + 4, 0xcdef_89ab);
    write(FLASH + 0x10, 2 | 11 << 3 | 2 << 8);
    write(FLASH + 0x10, 2 | 11 << 3 | 2 << 8 | 1 << 16);
    while read(FLASH + 0x0c) >> 16 & 1 == 1 {}
    put(0, read(0x080e_0000));
    write(FLASH + 0x10, 1 | 2 << 8);
    write(0x080e_0000, 0x1234_5678);
    write(0x080e_0000, 0xffff_0000);
    while read(FLASH + 0x0c) >> 16 & 1 == 1 {}
    write(FLASH + 0x10, 1 << 31);
    write(0x080e_0004, 0);
    put(3, read(0x080e_0000));
    put(4, read(0x080e_0004));
    put(5, read(FLASH + 0x0c));
}

/// Calls the code at `address`.
fn call(address: u32) -> u32 {
    let result;
    unsafe { asm!("blx {a}", a = in(reg) address | 1, lateout("r0") result, out("lr") _) };
    result
}

/// Code in RAM, called, changed and called again, with data written beside it.
fn code_in_ram() {
    const CODE: u32 = 0x2000_0200;
    for n in 1..=3 {
        // movs r0, #n; bx lr
        write(CODE, 0x4770_2000 | n);
        barrier();
        write(CODE + 16, n);
        note(call(CODE));
        note(call(CODE) + read(CODE + 16));
    }
}

/// IT blocks whose accesses are the first to a page; then one that reads flash. Word 0: instructions behind the blocks that
/// ran, two a block; word 1: sum of what was stored and read back.
fn it_accesses() {
    let (mut ran, mut sum) = (0u32, 0u32);
    for page in 0..40u32 {
        for base in [0x2000_8000, 0x1000_0000, 0x2001_4000] {
            let place = base + page * 0x400;
            unsafe {
                asm!(
                    "cmp {p}, #1000", "itt ne", "strne {p}, [{a}]", "ldrne {t}, [{a}]", "adds {n}, #1", "adds {n}, #1",
                    p = in(reg) page, a = in(reg) place, t = out(reg) sum, n = inout(reg) ran,
                );
                put(1, at(1) + sum);
            }
        }
        unsafe {
            asm!(
                "cmp {p}, #1000", "it ne", "ldrne {t}, [{a}]", "adds {n}, #1", "adds {n}, #1",
                p = in(reg) page, a = in(reg) 0x0800_0000 + page * 0x400, t = out(reg) sum, n = inout(reg) ran,
            );
        }
    }
    let _ = sum;
    put(0, ran);
}

#[inline(never)]
fn end() -> ! {
    put(9, 1);
    loop {}
}

#[unsafe(no_mangle)]
extern "C" fn reset() -> ! {
    put(8, at(8).wrapping_add(1));
    match unsafe { read_volatile(SCENARIO) } {
        0 => unsafe { asm!("vadd.f32 s0, s0, s0", out("s0") _) },
        1 | 13 => float_across_interrupts(),
        2 => masks(),
        3 => tail_chain(),
        4 => sleep(),
        5 => it_blocks(),
        6 => flash(),
        7 | 10 => put(0, read(0x6000_0000)),
        8 if at(8) < 3 => write(0xe000_ed0c, 0x05fa_0004),
        9 => put(0, read(0x4001_1004)),
        11 => {
            let mut v = 21;
            unsafe { asm!("svc #3", inout("r0") v) };
            put(0, v);
        }
        12 => unsafe { asm!("udf #0") },
        14 => unsafe {
            // Rounds of cmp, it, two skipped, sub, bne: six instructions each. Word 10 says how many.
            asm!(
                "2:", "cmp r0, #0", "itt eq", "addeq r1, #1", "addeq r1, #2", "subs r0, #1", "bne 2b",
                inout("r0") at(10) => _, out("r1") _
            )
        },
        15 => unsafe { asm!("bkpt") },
        16 => {
            systick(16_000);
            loop {
                put(0, at(0).wrapping_add(1));
            }
        }
        // Word 10 is the address.
        17 => put(0, call(at(10))),
        18 => write(at(10), 0x1234_5678),
        19 => code_in_ram(),
        20 => {
            write(0x2000_0300, 7);
            write(0x1000_0300, 8);
            put(0, read(0x2000_0300) << 4 | read(0x1000_0300));
        }
        21 => it_accesses(),
        22 => {
            fpu_on();
            filter();
        }
        23 => copies(),
        _ => (),
    }
    // Blocks of code may not sleep.
    if unsafe { read_volatile(SCENARIO) } >= 17 {
        end();
    }
    put(9, 1);
    loop {
        unsafe { asm!("wfi") };
    }
}
