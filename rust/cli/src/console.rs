//! Output for the user: progress and warnings on standard error, results on standard output. With `--json` all is one
//! JSON object a line on standard output, `{"event": "progress" | "warning" | "result" | "error", ...}`.

use relume_session::{Listener, Progress};
use serde::Serialize;
use serde_json::Value;
use std::io::{IsTerminal, Write};
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Amount and form of the output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Style {
    /// JSON lines.
    pub json: bool,
    /// No progress.
    pub quiet: bool,
}

/// Prints reports as they come, but not faster than they can be read.
pub struct Console {
    style: Style,
    terminal: bool,
    last: Mutex<Option<(relume_session::Stage, Instant)>>,
    /// Keeps the result instead of printing it.
    captured: Option<Mutex<Value>>,
}

impl Console {
    pub fn new(style: Style) -> Self {
        Self { style, terminal: std::io::stderr().is_terminal(), last: Mutex::new(None), captured: None }
    }

    /// Prints nothing and keeps the result.
    pub fn capturing() -> Self {
        let captured = Some(Mutex::new(Value::Null));
        Self { captured, ..Self::new(Style { json: false, quiet: true }) }
    }

    /// The result that was kept; null if there was none.
    pub fn into_captured(self) -> Value {
        self.captured.map_or(Value::Null, |value| value.into_inner().unwrap_or_default())
    }

    /// The outcome of a command: `text` for people, `value` for programs.
    pub fn result<T: Serialize>(&self, text: &str, value: &T) {
        self.end_line();
        match &self.captured {
            Some(captured) => {
                let kept = serde_json::to_value(value).unwrap_or_default();
                *captured.lock().unwrap_or_else(std::sync::PoisonError::into_inner) = kept;
            }
            None if self.style.json => print_json("result", value),
            None => say(text),
        }
    }

    /// The one line that says what went wrong.
    pub fn error(&self, message: &str) {
        self.end_line();
        if self.style.json {
            print_json("error", &Message { message });
        } else {
            eprintln!("relume: error: {message}");
        }
    }

    /// True if another report is due: each stage's first and last, and a few a second (a line every 5 seconds in log
    /// files).
    fn due(&self, progress: &Progress) -> bool {
        let pause = Duration::from_millis(if self.terminal || self.style.json { 200 } else { 5000 });
        let mut last = self.last.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let fresh = last.is_none_or(|(stage, at)| stage != progress.stage || at.elapsed() >= pause);
        let due = fresh || progress.done >= progress.total;
        if due {
            *last = Some((progress.stage, Instant::now()));
        }
        due
    }

    fn end_line(&self) {
        if self.terminal && !self.style.json && !self.style.quiet {
            eprint!("\r\x1b[K");
        }
    }
}

impl Listener for Console {
    fn progress(&self, progress: &Progress) {
        if self.style.quiet || progress.total == 0 || !self.due(progress) {
            return;
        }
        if self.style.json {
            print_json("progress", progress);
            return;
        }
        let line = line(progress);
        if self.terminal { eprint!("\r\x1b[K{line}") } else { eprintln!("{line}") }
    }

    fn warning(&self, message: &str) {
        self.end_line();
        if self.style.json {
            print_json("warning", &Message { message });
        } else {
            eprintln!("relume: warning: {message}");
        }
    }
}

fn line(progress: &Progress) -> String {
    let stage = serde_json::to_string(&progress.stage).unwrap_or_default();
    let percent = 100 * progress.done.min(progress.total) / progress.total.max(1);
    let left = progress.remaining_s.map(|s| format!("  {} left", clock(s))).unwrap_or_default();
    format!(
        "{:<9}{percent:>3} %  {}{left}  {}",
        stage.trim_matches('"'),
        clock(progress.elapsed_s),
        progress.message
    )
    .trim_end()
    .to_string()
}

fn clock(seconds: f64) -> String {
    let s = seconds.round() as u64;
    if s < 3600 {
        format!("{}:{:02}", s / 60, s % 60)
    } else {
        format!("{}:{:02}:{:02}", s / 3600, s / 60 % 60, s % 60)
    }
}

#[derive(Serialize)]
struct Message<'a> {
    message: &'a str,
}

#[derive(Serialize)]
struct Event<'a, T> {
    event: &'a str,
    #[serde(flatten)]
    value: &'a T,
}

fn print_json<T: Serialize>(event: &str, value: &T) {
    if let Ok(text) = serde_json::to_string(&Event { event, value }) {
        say(&text);
    }
}

/// Prints a line; a closed pipe is no panic.
fn say(text: &str) {
    let _ = writeln!(std::io::stdout(), "{text}");
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume_session::Stage;

    #[test]
    fn lines_say_stage_share_and_time_left() {
        let mut progress = Progress {
            stage: Stage::Trace,
            done: 21,
            total: 84,
            elapsed_s: 65.2,
            remaining_s: Some(4000.0),
            message: "tile 21".into(),
        };
        assert_eq!(line(&progress), "trace     25 %  1:05  1:06:40 left  tile 21");
        progress = Progress { remaining_s: None, message: String::new(), total: 0, done: 0, ..progress };
        assert_eq!(line(&progress), "trace      0 %  1:05");
    }
}
