//! The command line, one file a command.

mod eval;
mod info;
mod render;
mod scheme;
mod subdivide;

use std::io::IsTerminal;

use clap::{CommandFactory, Parser, Subcommand};
use relievo::{Error, Result};

const VERSION: &str = concat!(
    env!("CARGO_PKG_VERSION"),
    " (Embree ",
    env!("RELIEVO_EMBREE"),
    ", OpenImageIO ",
    env!("RELIEVO_OIIO"),
    ")"
);

/// A production renderer for subdivision surfaces, Ptex and deep displacement.
///
/// Exit codes: 0 done, 1 failed, 2 usage, 3 bad input, 4 out of memory budget, 130 interrupted.
#[derive(Debug, Parser)]
#[command(name = "relievo", version = VERSION, max_term_width = 100)]
struct Arguments {
    /// Say more: -v how the stages go, -vv everything.
    #[arg(short, long, action = clap::ArgAction::Count, global = true)]
    verbose: u8,
    /// Say nothing but errors.
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    quiet: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Render a scene to a picture.
    Render(Box<render::Render>),
    /// Tell what is in a scene: cameras, meshes, lights, materials, memory.
    Info(info::Info),
    /// Refine a cage to a finer OBJ file.
    Subdivide(subdivide::Subdivide),
    /// Evaluate the limit surface of a cage.
    Eval(eval::Eval),
    /// Print a completion script for a shell.
    Completions {
        /// The shell.
        shell: clap_complete::Shell,
    },
}

/// Runs the command that the arguments name.
pub(crate) fn run() -> Result<()> {
    let arguments = Arguments::parse();
    let level = match (arguments.quiet, arguments.verbose) {
        (true, _) => tracing::Level::ERROR,
        (_, 0) => tracing::Level::WARN,
        (_, 1) => tracing::Level::INFO,
        _ => tracing::Level::DEBUG,
    };
    tracing_subscriber::fmt()
        .with_max_level(level)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .without_time()
        .with_target(false)
        .init();
    match arguments.command {
        Command::Render(render) => render.run(arguments.quiet),
        Command::Info(info) => info.run(),
        Command::Subdivide(subdivide) => subdivide.run(),
        Command::Eval(eval) => eval.run(),
        Command::Completions { shell } => {
            clap_complete::generate(
                shell,
                &mut Arguments::command(),
                "relievo",
                &mut std::io::stdout(),
            );
            Ok(())
        }
    }
}

/// Prints an error with its advice.
#[expect(clippy::print_stderr, reason = "this is where errors go")]
pub(crate) fn report(error: Error) {
    if matches!(error, Error::Interrupted) {
        eprintln!("interrupted");
    } else {
        eprintln!("{:?}", miette::Report::new(error));
    }
}
