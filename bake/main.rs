//! The command `lumel`: arguments to settings, the library, and back to an exit code.
//!
//! Exit codes: 0 done, 1 failed, 2 usage, 3 done but `--verify` found a difference, 75 parts of other shards are missing, 130 interrupted. Results go to files, or to stdout where the command prints
//! something (`plan`, `inspect`, `form-factors`, `compare`, `cache`, `completions`); progress, warnings and errors go to stderr.

mod args;
mod bake;
mod cache;
mod compare;
mod config;
mod console;
mod destination;
mod earlier;
mod failure;
mod form_factors;
mod inspect;
mod interrupt;
mod log;
mod plan;
mod print;
mod relight;
mod render;

use args::{Args, Command};
use clap::Parser;
use console::Console;
use std::process::ExitCode;

fn main() -> ExitCode {
    let args = Args::parse();
    let console = Console::new(&args.console);
    failure::exit_code(&console, || {
        log::start(&args.console)?;
        match &args.command {
            Command::Bake(a) => bake::bake(a, &console),
            Command::Plan(a) => plan::plan(a, &console),
            Command::Merge(a) => plan::merge(a, &console),
            Command::Relight(a) => relight::relight(a, &console),
            Command::Mix(a) => relight::mix(a, &console),
            Command::Unwrap(a) => bake::unwrap(a, &console),
            Command::Inspect(a) => inspect::inspect(a, &console),
            Command::FormFactors(a) => form_factors::form_factors(a, &console),
            Command::Render(a) => render::render(a, &console),
            Command::Compare(a) => compare::compare(a),
            Command::Cache(a) => cache::cache(a, &console),
            Command::Completions(a) => print::completions(a.shell),
        }
    })
}
