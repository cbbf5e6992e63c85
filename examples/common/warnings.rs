//! Log lines of level WARN and above, kept for whoever asks.

#![allow(dead_code, reason = "shared by several binaries")]

use std::sync::Mutex;

use bevy::log::{
    tracing::{
        Event, Level, Subscriber,
        field::{Field, Visit},
    },
    tracing_subscriber::{
        Layer, Registry,
        layer::{Context, SubscriberExt},
        util::SubscriberInitExt,
    },
};

/// Log lines of level WARN and above since [`take`] was called last.
pub fn peek() -> Vec<String> {
    WARNINGS
        .lock()
        .map(|lines| lines.clone())
        .unwrap_or_default()
}

/// Log lines of level WARN and above since the last call.
pub fn take() -> Vec<String> {
    WARNINGS
        .lock()
        .map(|mut lines| core::mem::take(&mut *lines))
        .unwrap_or_default()
}

static WARNINGS: Mutex<Vec<String>> = Mutex::new(Vec::new());

/// Starts capturing.
pub fn capture() {
    // Only the first app of a process can install it.
    let _ = Registry::default().with(CaptureWarnings).try_init();
}

struct CaptureWarnings;

impl<S: Subscriber> Layer<S> for CaptureWarnings {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        if *event.metadata().level() > Level::WARN {
            return;
        }
        let mut line = Line(format!(
            "{} {}:",
            event.metadata().level(),
            event.metadata().target()
        ));
        event.record(&mut line);
        if let Ok(mut lines) = WARNINGS.lock() {
            lines.push(line.0);
        }
    }
}

struct Line(String);

impl Visit for Line {
    fn record_debug(&mut self, field: &Field, value: &dyn core::fmt::Debug) {
        if field.name() == "message" {
            self.0 += &format!(" {value:?}");
        }
    }
}
