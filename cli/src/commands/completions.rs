//! `esvo completions`.

use std::path::PathBuf;

use clap::{Args, Command};
use clap_complete::Shell;
use esvo_bench::output::write_text;

use crate::fail::{Failure, complain, print};
use crate::files::check_output;

/// Print the completion script of a shell.
#[derive(Debug, Args)]
#[command(after_help = "\
With the script in place, the shell completes commands, options and their values when Tab is
pressed.

Examples:
  esvo completions bash -o ~/.local/share/bash-completion/completions/esvo
  esvo completions zsh -o ~/.zfunc/_esvo            ~/.zfunc must be in $fpath
  esvo completions fish -o ~/.config/fish/completions/esvo.fish
  esvo completions powershell >> $PROFILE")]
pub(crate) struct CompletionsArguments {
    /// The shell
    #[arg(value_enum)]
    shell: Shell,
    /// Write the script to this file instead of printing it
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

/// Prints the script or writes it to a file. `esvo` is the definition of the command line.
pub(crate) fn run_completions(arguments: &CompletionsArguments, esvo: Command) -> Result<(), Failure> {
    let script = completion_script(arguments.shell, esvo)?;
    let Some(output) = &arguments.output else { return print(&script) };
    check_output(output)?;
    write_text(output, &script)?;
    complain("written", &output.display().to_string());
    Ok(())
}

fn completion_script(shell: Shell, mut esvo: Command) -> Result<String, Failure> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut esvo, "esvo", &mut script);
    Ok(String::from_utf8(script)?)
}
