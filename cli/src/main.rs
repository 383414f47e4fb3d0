//! The command line `tau`; see [`tau_cli`].

use std::process::ExitCode;

use mimalloc::MiMalloc;

// Discovery allocates many matrices of all sizes: it takes a tenth longer with the usual allocator.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

fn main() -> ExitCode {
    tau_cli::main()
}
