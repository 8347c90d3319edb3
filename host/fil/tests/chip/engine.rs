//! The processor around the engine: each test runs a scenario of `firmware/traps.rs`.

#[path = "../firmware/samples.rs"]
mod samples;

use edm_fil::image::Image;
use edm_fil::machine::Machine;
use edm_fil::still::Still;
use edm_hal_shim::gap_filter;
use edm_soc::TICK_HZ;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

const RESULT: u32 = 0x2000_0000;
const SCENARIO: u32 = 0x2000_00f0;
const MS: u64 = TICK_HZ / 1000;

/// Builds the test firmware unless it is newer than its sources: each test may be a process of its own.
fn firmware() -> &'static Path {
    static ELF: OnceLock<PathBuf> = OnceLock::new();
    ELF.get_or_init(|| {
        let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/firmware");
        let elf = Path::new(env!("CARGO_TARGET_TMPDIR")).join("traps.elf");
        let lock = File::create(elf.with_extension("lock")).expect("a file for the lock");
        lock.lock().expect("one process builds at a time");
        let changed = |path: &Path| path.metadata().and_then(|data| data.modified()).ok();
        let mut files = sources.read_dir().expect("the sources").map(|file| file.expect("a source").path());
        if files.all(|file| changed(&file) < changed(&elf)) {
            return elf;
        }
        let status = Command::new("rustc")
            .args(["--edition", "2024", "--target", "thumbv7em-none-eabihf", "-Copt-level=2", "-Cpanic=abort"])
            .arg(format!("-Clink-arg=-T{}", sources.join("link.x").display()))
            .arg("-o")
            .args([&elf.with_extension("part"), &sources.join("traps.rs")])
            .status()
            .expect("rustc runs");
        assert!(status.success(), "the test firmware does not build");
        fs::rename(elf.with_extension("part"), &elf).expect("whole or not at all");
        elf
    })
}

struct Run {
    machine: Machine<Still>,
    result: Result<(), String>,
}

impl Run {
    fn of(scenario: u32, time: u64) -> Self {
        Self::with(scenario, 0, time)
    }
    fn with(scenario: u32, parameter: u32, time: u64) -> Self {
        Self::stepped(false, scenario, parameter, time)
    }
    /// With time passing by blocks of code, or by instructions.
    fn stepped(by_blocks: bool, scenario: u32, parameter: u32, time: u64) -> Self {
        let image = Image::parse(std::fs::read(firmware()).unwrap()).unwrap();
        let mut machine = Machine::new(&image, Still::default(), 8_000_000).unwrap();
        let memory = &machine.soc().memory;
        for word in (RESULT..SCENARIO).step_by(4) {
            memory.sram.store(word, 4, 0);
        }
        memory.sram.store(SCENARIO, 4, scenario);
        memory.sram.store(RESULT + 40, 4, parameter);
        machine.record_spans();
        if by_blocks {
            machine.step_by_blocks().unwrap();
        }
        let result = machine.run_until(time).map_err(|e| format!("{e:#}"));
        Self { machine, result }
    }
    fn word(&self, i: u32) -> u32 {
        self.machine.load(RESULT + 4 * i).unwrap()
    }
    fn done(self) -> Self {
        assert_eq!(self.result, Ok(()));
        assert_eq!((self.word(9), self.word(15)), (1, 0), "the scenario did not reach its end");
        self
    }
}

#[test]
fn an_fpu_instruction_before_the_fpu_is_enabled_is_a_hard_fault() {
    let run = Run::of(0, MS);
    // NOCP, escalated.
    assert_eq!((run.word(2), run.word(3)), (1 << 19, 1 << 30));
    assert_eq!(run.word(9), 0);
}

#[test]
fn float_and_core_registers_survive_nested_interrupts_that_use_the_fpu() {
    let run = Run::of(1, MS).done();
    assert_eq!((run.word(0), run.word(1)), (0, 0x568));
    assert_eq!(run.machine.stats().nesting, 2);
}

#[test]
fn a_lazily_reserved_frame_is_filled_by_the_handler_that_needs_it() {
    // The outer handler leaves the FPU alone, the inner one spoils it.
    let run = Run::of(13, MS).done();
    assert_eq!((run.word(0), run.word(1)), (0, 0x568));
}

#[test]
fn a_masked_interrupt_runs_right_after_its_mask_falls() {
    let run = Run::of(2, MS).done();
    assert_eq!(run.word(1), 0x1582_3584);
}

#[test]
fn pending_interrupts_are_chained_in_order_of_priority() {
    let run = Run::of(3, MS).done();
    assert_eq!(run.word(1), 0x6_5871);
    assert_eq!((run.machine.stats().tail_chained, run.machine.stats().nesting), (2, 1));
}

#[test]
fn wait_for_interrupt_sleeps_until_systick() {
    // 16 000 cycles of the 16 MHz reset clock are 1 ms.
    let run = Run::of(4, 12 * MS).done();
    assert_eq!(run.word(6), 11);
    let asleep = run.machine.stats().asleep as f64 / 2.0 / (12 * MS) as f64;
    assert!(asleep > 0.98, "{asleep}");
    assert_eq!(Run::of(4, 9 * MS).word(0), 0);
}

#[test]
fn a_stretched_idle_does_less_work_and_interrupts_keep_their_number() {
    let run = |factor| {
        let mut run = Run::with(16, 0, MS);
        run.machine.stretch_idle(factor);
        run.machine.run_until(100 * MS).unwrap();
        (run.machine.stats().entries[15], run.machine.stats().instructions)
    };
    let ((exact, work), (stretched, less)) = (run(1), run(20));
    assert!(exact.abs_diff(stretched) <= 1 && (95..105).contains(&exact), "{exact} {stretched}");
    assert!(less * 10 < work, "{less} {work}");
}

#[test]
fn it_blocks_survive_interrupts_at_any_place() {
    let run = Run::of(5, 400 * MS);
    assert_eq!((run.result, run.machine.load(RESULT + 28).unwrap()), (Ok(()), 1));
    assert_eq!(run.machine.load(RESULT).unwrap(), 0);
    assert!(run.machine.stats().entries[15] > 10_000);
    // SysTick every 62 cycles of 16 MHz; the rest of a block, an instruction and a late one before are at most a dozen.
    let entered: Vec<_> = run.machine.spans().iter().map(|s| s.entered * 16_000_000 / TICK_HZ / 2).collect();
    let longest = entered.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap();
    assert!(longest <= 62 + 12, "{longest} cycles");
}

#[test]
fn flash_takes_its_time_and_only_clears_bits() {
    // A 128 KiB sector: one second.
    let mut run = Run::of(6, 990 * MS);
    assert_eq!(run.word(9), 0);
    run.machine.run_until(1010 * MS).unwrap();
    let run = run.done();
    assert_eq!((run.word(0), run.word(3)), (u32::MAX, 0x1234_0000));
    // Locked: nothing programmed, PGSERR.
    assert_eq!((run.word(4), run.word(5)), (u32::MAX, 1 << 7));
}

#[test]
fn a_load_from_nowhere_is_a_bus_fault_with_its_address() {
    let run = Run::of(7, MS);
    assert_eq!((run.word(2), run.word(3), run.word(4)), (1 << 9 | 1 << 15, 1 << 30, 0x6000_0000));
}

/// Nothing and core-coupled memory (data only, RM0090 2.3.1): IBUSERR. Peripherals and system registers, which never hold
/// code (ARMv7-M B3.1): IACCVIOL.
#[test]
fn code_is_fetched_from_memory_that_may_hold_it_alone() {
    for (address, status) in
        [(0x6000_0000, 1 << 8), (0x1000_0000, 1 << 8), (0x4000_0000, 1 << 0), (0xe000_e000, 1 << 0)]
    {
        for by_blocks in [false, true] {
            let run = Run::stepped(by_blocks, 17, address, MS);
            assert_eq!(run.result, Ok(()), "{address:#x}");
            // Escalated; the frame names the place.
            assert_eq!((run.word(2), run.word(3), run.word(5)), (status, 1 << 30, address), "{address:#x} {by_blocks}");
            assert_eq!(run.word(9), 0);
        }
    }
}

#[test]
fn code_in_ram_runs_and_may_be_changed() {
    for by_blocks in [false, true] {
        assert_eq!(Run::stepped(by_blocks, 19, 0, MS).word(1), 0x0012_2436, "{by_blocks}");
    }
}

/// Address zero is the alias of flash.
#[test]
fn a_store_to_where_nothing_can_be_stored_is_a_bus_fault_with_its_address() {
    for address in [0, 4, 0x6000_0004, 0x1001_0000, 0x1fff_7a10 & !0xffff, 0x2002_0000] {
        for by_blocks in [false, true] {
            let run = Run::stepped(by_blocks, 18, address, MS);
            let status = (run.word(2), run.word(3), run.word(4));
            assert_eq!(status, (1 << 9 | 1 << 15, 1 << 30, address), "{address:#x} {by_blocks}");
            assert_eq!(run.word(9), 0);
        }
    }
}

#[test]
fn a_store_into_locked_flash_changes_nothing() {
    for by_blocks in [false, true] {
        let run = Run::stepped(by_blocks, 18, 0x080e_0000, MS);
        assert_eq!(run.machine.load(0x080e_0000).unwrap(), u32::MAX);
        // PGSERR, the interface's answer to a store without PG.
        assert_eq!((run.word(9), run.machine.load(0x0800_0004).unwrap() & 1), (1, 1));
    }
}

#[test]
fn the_first_access_to_a_page_may_be_in_an_it_block() {
    for by_blocks in [false, true] {
        let run = Run::stepped(by_blocks, 21, 0, MS);
        assert_eq!((run.word(9), run.word(0), run.word(1)), (1, 40 * 4 * 2, 3 * 39 * 40 / 2), "{by_blocks}");
    }
}

#[test]
fn both_memories_keep_what_is_stored() {
    for by_blocks in [false, true] {
        assert_eq!(Run::stepped(by_blocks, 20, 0, MS).word(0), 0x78, "{by_blocks}");
    }
}

#[test]
fn a_fault_in_the_fault_handler_is_a_lock_up() {
    let error = Run::of(10, MS).result.unwrap_err();
    assert!(error.contains("lock-up"), "{error}");
}

#[test]
fn an_undefined_instruction_is_a_usage_fault() {
    assert_eq!(Run::of(12, MS).word(2), 1 << 16);
}

#[test]
fn a_software_reset_starts_over_and_keeps_ram() {
    let run = Run::of(8, MS).done();
    assert_eq!((run.word(8), run.machine.stats().resets), (3, 2));
}

#[test]
fn an_unmodelled_register_ends_the_run_with_its_name() {
    let error = Run::of(9, MS).result.unwrap_err();
    assert!(error.contains("4-byte read of USART1 + 0x004"), "{error}");
}

#[test]
fn a_supervisor_call_reaches_its_handler_and_comes_back() {
    let run = Run::of(11, MS).done();
    assert_eq!((run.word(0), run.word(1)), (42, 11));
}

#[test]
fn skipped_instructions_of_an_it_block_are_counted() {
    let instructions = |rounds| Run::with(14, rounds, 10 * MS).done().machine.stats().instructions;
    assert_eq!(instructions(2000) - instructions(1000), 6 * 1000);
}

#[test]
fn a_breakpoint_without_a_debugger_is_a_hard_fault() {
    assert_eq!(Run::of(15, MS).word(3), 1 << 31);
}

#[test]
fn the_gap_filter_by_hand_gives_the_bits_of_the_one_in_rust() {
    let run = Run::of(22, 2000 * MS).done();
    let here = samples::checksum(gap_filter::in_rust);
    assert_eq!((run.word(0), run.word(1)), (here, here), "Rust on the chip, by hand on the chip; here {here}");
}

#[test]
fn copies_by_hand_copy_what_they_are_told_and_nothing_else() {
    let run = Run::of(23, 2000 * MS).done();
    assert_eq!((run.word(0), run.word(1)), (18 * 73, 0), "copies, wrong bytes");
}

#[test]
fn identical_runs_are_identical() {
    let run = || {
        let mut run = Run::of(5, 50 * MS);
        let memory = &run.machine.soc().memory;
        let ram: Vec<_> = (0..0x2_0000).step_by(4).map(|a| memory.sram.load(0x2000_0000 + a, 4)).collect();
        (ram, run.machine.stats().clone())
    };
    assert_eq!(run(), run());
}
