//! What a board may not say does not compile.

#[test]
fn clashes_do_not_compile() {
    let tests = trybuild::TestCases::new();
    tests.pass("tests/refused/none.rs");
    tests.compile_fail("tests/refused/pin_twice.rs");
    tests.compile_fail("tests/refused/line_twice.rs");
}
