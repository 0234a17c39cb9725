//! The `relievo` program: arguments to calls, errors to exit codes.

mod cli;

use std::process::ExitCode;

/// Exit code 4 is what [`relievo::Error::Memory`] ends with, too.
#[global_allocator]
static ALLOCATOR: exhausted::OrExit = exhausted::OrExit::new(
    4,
    "error: the system has no more memory for this program\n help: dice more coarsely (--dicing-rate), choose --method \
     compact or cache, or let the program have more memory\n",
);

fn main() -> ExitCode {
    cli::run()
}
