//! The program `tau`; see [`tau_cli`].
//!
//! It has an allocator of its own, mimalloc, where the library leaves that to its user. Version 2, because version 3
//! keeps half as much memory again.

use std::process::ExitCode;

use mimalloc::MiMalloc;

// Discovery allocates many matrices of all sizes: it takes a tenth longer with the usual allocator.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

fn main() -> ExitCode {
    tau_cli::main()
}
