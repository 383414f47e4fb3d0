//! The command line `tau`; see [`tau::cli`].

use std::process::ExitCode;

fn main() -> ExitCode {
    tau::cli::main()
}
