//! `relume`: every stage without Blender.

mod args;
mod commands;
mod console;

use args::{Cli, Command};
use clap::Parser;
use console::{Console, Style};
use relume_session::{Cancel, Monitor, SessionError};
use std::process::ExitCode;
use std::sync::Arc;

/// Exit code of a run that was asked to stop: 128 + SIGINT, as shells report it.
const STOPPED: u8 = 130;

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => return usage(&error),
    };
    let console = Arc::new(Console::new(Style { json: cli.global.json, quiet: cli.global.quiet }));
    match run(cli, &console) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            console.error(&format!("{error:#}"));
            match error.downcast_ref::<SessionError>() {
                Some(SessionError::Cancelled) => STOPPED.into(),
                _ => ExitCode::FAILURE,
            }
        }
    }
}

fn run(cli: Cli, console: &Arc<Console>) -> anyhow::Result<()> {
    let cancel = Cancel::default();
    stop_on_signals(&cancel)?;
    rayon::ThreadPoolBuilder::new().num_threads(cli.global.threads).build_global()?;
    let monitor = Monitor::new(console.clone(), cancel);
    let context = commands::Context { console, monitor: &monitor, global: &cli.global };
    match cli.command {
        Command::Trace(args) => commands::trace(&args, &context),
        Command::Gather(args) => commands::gather(&args, &context),
        Command::Evaluate(args) => commands::evaluate(&args, &context),
        Command::Train(args) => commands::train(&args, &context),
        Command::Relight(args) => commands::relight(&args, &context),
        Command::Optimise(args) => commands::optimise(&args, &context),
        Command::Info(args) => commands::info(&args, &context),
        Command::Validate(args) => commands::validate(&args, &context),
        Command::Bench(args) => commands::bench(&args, &context),
    }
}

/// The first signal asks to stop cleanly, the second ends the process.
fn stop_on_signals(cancel: &Cancel) -> std::io::Result<()> {
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register_conditional_shutdown(signal, STOPPED.into(), cancel.flag().clone())?;
        signal_hook::flag::register(signal, cancel.flag().clone())?;
    }
    Ok(())
}

/// Help and version as they are; mistakes as one line.
fn usage(error: &clap::Error) -> ExitCode {
    if !error.use_stderr() {
        let _ = error.print();
        return ExitCode::SUCCESS;
    }
    let text = error.to_string();
    let lines: Vec<&str> = text.lines().map(str::trim).collect();
    // The message, with the names of missing arguments that clap puts on lines of their own.
    let end = lines.iter().position(|line| line.is_empty()).unwrap_or(lines.len());
    eprintln!("relume: {} (see relume --help)", lines[..end].join(" "));
    ExitCode::from(2)
}
