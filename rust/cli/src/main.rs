//! The command line; everything is in the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    relume_cli::run(std::env::args_os()).into()
}
