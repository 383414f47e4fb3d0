//! Compile errors of `tau_model!` and of uses of what it declares: that places and codes arrive at the right tokens. What
//! each mistake of a description says is in `tests/equations/messages`, without a compiler.

#[test]
fn rustc_shows() {
    let cases = trybuild::TestCases::new();
    cases.pass("pass/*.rs");
    cases.compile_fail("fail/*.rs");
}
