//! The `relievo` program: arguments to calls, errors to exit codes.

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    match cli::run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            let code = error.exit_code();
            cli::report(error);
            ExitCode::from(code)
        }
    }
}
