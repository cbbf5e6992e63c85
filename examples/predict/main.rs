//! How sharp a configuration's shadows can be, worked out without drawing anything.
//!
//! `predict --near 1 --far 500 --splits "Practical(lambda: 0.9)" --cascades 4` prints a table of
//! cascades; `predict --figure lloyd10` plots a figure of Lloyd et al. 2006. `--help` says what
//! the numbers mean.

mod arguments;
mod cascades;
mod figures;
mod hemisphere;
mod plot;
mod report;

use core::error::Error;
use std::{
    io::{Write, stdout},
    process::ExitCode,
};

use clap::{CommandFactory, Parser, error::ErrorKind};

use arguments::Arguments;

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            #[expect(clippy::print_stderr, reason = "a message for who called")]
            {
                eprintln!("error: {error}");
            }
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), Box<dyn Error>> {
    let text = if let Some(figure) = arguments.figure {
        let files = figures::write(figure, &arguments.out)?;
        let lines = files.map(|file| format!("{}\n", file.display()));
        lines.concat()
    } else {
        let setup = arguments.setup().unwrap_or_else(|message| {
            let mut command = Arguments::command();
            command.error(ErrorKind::ValueValidation, message).exit()
        });
        if arguments.csv {
            report::csv(&setup)?
        } else {
            report::table(&setup)
        }
    };
    stdout().write_all(text.as_bytes())?;
    Ok(())
}
