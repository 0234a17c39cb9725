//! The command line, one file a command.

mod atlas;
mod bake;
mod bench;
mod build;
mod cage;
mod compare;
mod eval;
mod info;
mod machine;
mod method;
mod ptex;
mod render;
mod scheme;
mod staging;
mod subdivide;
mod verify;
mod words;

use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::builder::styling::{AnsiColor, Style};
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

/// What each does is told where its arguments are.
#[derive(Debug, Subcommand)]
enum Command {
    Render(Box<render::Render>),
    Build(Box<build::Build>),
    Info(info::Info),
    Subdivide(subdivide::Subdivide),
    Atlas(atlas::Atlas),
    Eval(eval::Eval),
    Verify(verify::Verify),
    Bench(bench::Bench),
    Bake(Box<bake::Bake>),
    /// Look into Ptex files, check and convert them.
    #[command(subcommand)]
    Ptex(ptex::Ptex),
    /// Print a completion script for a shell.
    Completions {
        /// The shell.
        shell: clap_complete::Shell,
    },
}

/// Runs the command that the arguments name, and says why it failed.
pub(crate) fn run() -> ExitCode {
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
    let json = match &arguments.command {
        Command::Render(render) => render.reports_json(),
        Command::Build(build) => build.reports_json(),
        Command::Bake(bake) => bake.reports_json(),
        _ => false,
    };
    let result = match arguments.command {
        Command::Render(render) => render.run(arguments.quiet),
        Command::Build(build) => build.run(arguments.quiet),
        Command::Info(info) => info.run(),
        Command::Subdivide(subdivide) => subdivide.run(),
        Command::Atlas(atlas) => atlas.run(),
        Command::Eval(eval) => eval.run(),
        Command::Verify(verify) => verify.run(),
        Command::Bench(bench) => bench.run(),
        Command::Bake(bake) => bake.run(arguments.quiet),
        Command::Ptex(ptex) => ptex.run(),
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Arguments::command(), "relievo", &mut script);
            print(&script)
        }
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            report(&error, json);
            ExitCode::from(error.exit_code())
        }
    }
}

/// Refuses to write over what is read.
fn keep_inputs<'a>(inputs: &[&Path], outputs: impl IntoIterator<Item = &'a PathBuf>) -> Result<()> {
    let real = |path: &Path| path.canonicalize().ok();
    for output in outputs {
        let is_output =
            |input: &&&Path| real(input).is_some_and(|input| real(output) == Some(input));
        if let Some(input) = inputs.iter().find(is_output) {
            return Err(Error::usage(
                format!(
                    "{} would be written over {}",
                    output.display(),
                    input.display()
                ),
                "give the output another name",
            ));
        }
    }
    Ok(())
}

/// Writes to the standard output. Who closes the pipe early has read enough: that is no failure.
fn print(bytes: &[u8]) -> Result<()> {
    let mut out = std::io::stdout().lock();
    match out.write_all(bytes).and_then(|()| out.flush()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Error::failed(format!("standard output: {e}")))
        }
        _ => Ok(()),
    }
}

/// Prints an error with its advice, each on a line of its own that logs can be searched for.
fn report(error: &Error, json: bool) {
    let text = if json {
        serde_json::json!({
            "error": error.to_string(), "help": error.help(), "code": error.exit_code(),
        })
        .to_string()
    } else {
        let color = std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none();
        let style = |style: Style| if color { style } else { Style::new() };
        let red = style(AnsiColor::Red.on_default().bold());
        let bold = style(Style::new().bold());
        let help = error
            .help()
            .map_or_else(String::new, |help| format!("\n {bold}help:{bold:#} {help}"));
        format!("{red}error:{red:#} {error}{help}")
    };
    // Whoever closed the stream does not want to know.
    let _ = writeln!(std::io::stderr(), "{text}");
}
