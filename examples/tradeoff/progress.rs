//! What is being done, and how long it will take.

use std::{
    io::{Write as _, stdout},
    time::Instant,
};

/// Counts frames against how many there will be.
pub struct Progress {
    start: Instant,
    done: usize,
    all: usize,
}

impl Progress {
    /// For so many frames.
    pub fn new(all: usize) -> Self {
        Self {
            start: Instant::now(),
            done: 0,
            all,
        }
    }

    /// A frame is over.
    pub fn step(&mut self) {
        self.done += 1;
    }

    /// Tells what comes next.
    pub fn say(&self, what: &str) {
        let share = self.done as f64 / self.all.max(1) as f64;
        let spent = self.start.elapsed().as_secs_f64();
        let left = if self.done > 0 {
            let seconds = spent * (1.0 - share).max(0.0) / share;
            format!(
                "about {:.0} min {:02.0} s left",
                (seconds / 60.0).floor(),
                (seconds % 60.0).floor()
            )
        } else {
            "starting".to_owned()
        };
        tell(&format!("[{:3.0} %, {left}] {what}\n", 100.0 * share));
    }
}

/// Writes to the terminal, at once. One that is gone is no reason to stop.
pub fn tell(text: &str) {
    let mut out = stdout();
    let _ = out.write_all(text.as_bytes()).and_then(|()| out.flush());
}
