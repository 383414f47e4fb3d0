//! The command line `tau`; see [`tau::cli`].

use std::process::ExitCode;

use mimalloc::MiMalloc;

// Discovery allocates many matrices of all sizes: a sixth of its time goes to the usual allocator.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

fn main() -> ExitCode {
    tau::cli::main()
}
