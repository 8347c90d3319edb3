//! The timing rules against pieces of code timed by hand from the Cortex-M4 technical reference manual.

use edm_fil::image::Image;
use edm_fil::machine::Machine;
use edm_fil::still::Still;
use std::path::Path;
use std::process::Command;

/// Case, instructions, estimated cycles. A return costs 1 + 2.
const CASES: [(&str, u64, u64); 14] = [
    // 2 + 1 + 1: loads follow each other without a gap.
    ("ldr3", 4, 7),
    // 1 + 1 + 2 + 2: the address comes from the load before.
    ("ldrdep", 5, 9),
    // 2 + 1.
    ("ldrstr", 3, 6),
    // 1 + (2 + 1): the address comes from the addition before.
    ("agu", 3, 7),
    // 1 + 1 + 1 stall.
    ("fstall", 3, 6),
    ("fnostall", 3, 5),
    ("vfma3", 2, 6),
    // 1 + 14, in which ten others run, + 1.
    ("vdivov", 14, 19),
    // 1 + 4 x 1 + 3 x 3 + 1.
    ("loop4", 10, 18),
    // Both members of the block take their cycle.
    ("it_skip", 5, 7),
    ("it_tail", 4, 6),
    // 1 + 5, and 1 + 5 + 2.
    ("pushpop", 2, 14),
    // 1 + 15.
    ("vldm15", 2, 19),
    ("cond_not", 3, 5),
];

#[test]
fn hand_timed_cases_cost_what_the_manual_says() {
    let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/firmware");
    let elf = Path::new(env!("CARGO_TARGET_TMPDIR")).join("cases.elf");
    let status = Command::new("rustc")
        .args(["--edition", "2024", "--target", "thumbv7em-none-eabihf", "-Copt-level=2", "-Cpanic=abort"])
        .arg(format!("-Clink-arg=-T{}", sources.join("link.x").display()))
        .arg("-o")
        .args([&elf, &sources.join("cases.rs")])
        .status()
        .expect("rustc runs");
    assert!(status.success(), "the test firmware does not build");
    let image = Image::parse(std::fs::read(&elf).unwrap()).unwrap();
    let mut machine = Machine::new(&image, Still::default(), 8_000_000).unwrap();
    machine.start_meter(Box::new(|_| 0)).unwrap();
    machine.run_until(20_000).unwrap();
    let mut starts: Vec<_> =
        image.symbols().filter_map(|(name, at)| Some((at & !1, name.strip_prefix("n_")?))).collect();
    starts.sort();
    let thread = &machine.meter().unwrap().tasks().unwrap()[&0];
    for (name, instructions, cycles) in CASES {
        let place = starts.iter().position(|s| s.1 == name).unwrap();
        let range = starts[place].0..starts[place + 1].0;
        let spent = thread
            .places
            .range(range)
            .fold((0, 0, 0, 0), |a, (_, c)| (a.0 + c.instructions, a.1 + c.warm, a.2 + c.low, a.3 + c.high));
        assert_eq!((spent.0, spent.1), (instructions, cycles), "{name}");
        assert!(spent.2 <= spent.1 && spent.1 <= spent.3, "{name}: {spent:?}");
    }
}
