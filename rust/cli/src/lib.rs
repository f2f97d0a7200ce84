//! `relume`: every stage without Blender, as a command line and, for programs that embed it, as one call.

mod args;
mod commands;
mod console;
mod emit;

use args::{Cli, Command};
use clap::Parser;
use console::{Console, Style};
use relume_session::{Cancel, Monitor, SessionError, on_threads};
use serde_json::Value;
use signal_hook::SigId;
use std::ffi::OsString;
use std::sync::Arc;

/// Exit code of a run that was asked to stop: 128 + SIGINT, as shells report it.
const STOPPED: u8 = 130;
/// Exit code of work on a part that may succeed later or elsewhere: `EX_TEMPFAIL`, as mail systems report it.
const TRY_AGAIN: u8 = 75;

/// Runs a command line (program name first), prints as it goes, and returns the exit code. SIGINT and SIGTERM stop it
/// cleanly.
pub fn run(args: impl IntoIterator<Item = OsString>) -> u8 {
    let args: Vec<OsString> = args.into_iter().collect();
    let cli = match Cli::try_parse_from(&args) {
        Ok(cli) => cli,
        Err(error) => return usage(&error, args.iter().any(|argument| argument == "--json")),
    };
    let console = Arc::new(Console::new(Style { json: cli.global.json, quiet: cli.global.quiet }));
    let is_work = matches!(cli.command, Command::Work(_));
    match run_with_signals(cli, &console) {
        Ok(()) => 0,
        Err(error) => {
            console.error(&error.to_string());
            match error.downcast_ref::<SessionError>() {
                Some(SessionError::Cancelled) => STOPPED,
                Some(error) if is_work && error.may_pass() => TRY_AGAIN,
                _ => 1,
            }
        }
    }
}

/// Runs a command line (without a program name), prints nothing and returns what `--json` would print as its result.
/// Progress and warnings go to `monitor`, which can also stop it.
///
/// # Errors
/// Error message of the command line, in one line.
pub fn run_captured(args: impl IntoIterator<Item = OsString>, monitor: &Monitor) -> anyhow::Result<Value> {
    let args = std::iter::once(OsString::from("relume")).chain(args);
    let cli = Cli::try_parse_from(args).map_err(|error| anyhow::anyhow!(one_line(&error)))?;
    let console = Console::capturing();
    dispatch(cli, &console, monitor)?;
    Ok(console.into_captured())
}

fn run_with_signals(cli: Cli, console: &Arc<Console>) -> anyhow::Result<()> {
    let cancel = Cancel::default();
    let signals = stop_on_signals(&cancel)?;
    let result = dispatch(cli, console, &Monitor::new(console.clone(), cancel));
    signals.into_iter().for_each(|signal| {
        signal_hook::low_level::unregister(signal);
    });
    result
}

fn dispatch(cli: Cli, console: &Console, monitor: &Monitor) -> anyhow::Result<()> {
    let context = commands::CommandContext { console, monitor, global: &cli.global };
    on_threads(cli.global.threads, || command(cli.command, &context))
}

fn command(command: Command, context: &commands::CommandContext) -> anyhow::Result<()> {
    match command {
        Command::Trace(args) => commands::trace(&args, context),
        Command::Plan(args) => commands::plan(&args, context),
        Command::Work(args) => commands::work(&args, context),
        Command::Collect(args) => commands::collect(&args, context),
        Command::Gather(args) => commands::gather(&args, context),
        Command::Evaluate(args) => commands::evaluate(&args, context),
        Command::Train(args) => commands::train(&args, context),
        Command::Relight(args) => commands::relight(&args, context),
        Command::Optimise(args) => commands::optimise(&args, context),
        Command::Info(args) => commands::info(&args, context),
        Command::Validate(args) => commands::validate(&args, context),
        Command::Devices => commands::devices(context.console),
    }
}

/// The first signal asks to stop cleanly, the second ends the process.
fn stop_on_signals(cancel: &Cancel) -> std::io::Result<Vec<SigId>> {
    let mut registered = Vec::new();
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        let flag = cancel.flag();
        let shutdown =
            signal_hook::flag::register_conditional_shutdown(signal, STOPPED.into(), flag.clone())?;
        registered.extend([shutdown, signal_hook::flag::register(signal, flag.clone())?]);
    }
    Ok(registered)
}

/// Help and version as they are; mistakes as one line, or one JSON object.
fn usage(error: &clap::Error, json: bool) -> u8 {
    if !error.use_stderr() {
        let _ = error.print();
        return 0;
    }
    Console::new(Style { json, quiet: true }).error(&format!("{} (see relume --help)", one_line(error)));
    2
}

/// The message of a wrong command line, with the names of missing arguments that clap puts on lines of their own.
fn one_line(error: &clap::Error) -> String {
    let text = error.to_string();
    let lines: Vec<&str> = text.lines().map(str::trim).collect();
    let end = lines.iter().position(|line| line.is_empty()).unwrap_or(lines.len());
    lines[..end].join(" ").trim_start_matches("error: ").to_owned()
}
