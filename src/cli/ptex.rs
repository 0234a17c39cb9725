//! `relievo ptex`, one file a command.

mod check;
mod convert;
mod eval;
mod info;

use clap::Subcommand;
use relievo::Result;

/// What there is to do with Ptex files.
#[derive(Debug, Subcommand)]
pub(crate) enum Ptex {
    /// Tell what is in a Ptex file: faces, sizes, meta data.
    Info(info::Info),
    /// Find what is wrong with a Ptex file.
    Check(check::Check),
    /// Filter a Ptex file at given places.
    Eval(eval::Eval),
    /// Make Ptex files from images, images from Ptex files, and other sizes and types.
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
