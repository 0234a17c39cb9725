//! `relievo ptex`, one file a command.

mod check;
mod convert;
mod eval;
mod info;

use clap::Subcommand;
use relievo::Result;

/// What there is to do with Ptex files. What each does is told where its arguments are.
#[derive(Debug, Subcommand)]
pub(crate) enum Ptex {
    Info(info::Info),
    Check(check::Check),
    Eval(eval::Eval),
    Convert(Box<convert::Convert>),
}

impl Ptex {
    pub(crate) fn run(self) -> Result<()> {
        match self {
            Self::Info(info) => info.run(),
            Self::Check(check) => check.run(),
            Self::Eval(eval) => eval.run(),
            Self::Convert(convert) => convert.run(),
        }
    }
}
