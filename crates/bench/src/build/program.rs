//! The programs that are compared, and their command lines.

use crate::build::request::BuildBenchRequest;
use crate::build::rival::Rival;
use anyhow::{Context, Result};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A program that is measured.
#[derive(Clone, Debug)]
pub(super) enum Program {
    /// `esker bench decode`.
    Decode,
    /// `esker build`.
    Esker,
    /// Another program.
    Rival(Rival),
}

/// A command to run, and the folders of its files.
pub(super) struct Invocation {
    /// The command.
    pub command: Command,
    /// Folder of all its files.
    pub folder: PathBuf,
    /// Folder of its scratch files, inside `folder`.
    pub scratch: PathBuf,
}

impl Program {
    /// Name in reports.
    pub fn name(&self) -> &str {
        match self {
            Self::Decode => "decode",
            Self::Esker => "esker",
            Self::Rival(rival) => &rival.name,
        }
    }

    /// The command that runs the program on `input`, with output and scratch files in `folder`.
    ///
    /// # Errors
    /// If the folder for scratch files cannot be made.
    pub fn invocation(
        &self,
        request: &BuildBenchRequest,
        input: &Path,
        folder: &Path,
    ) -> Result<Invocation> {
        let [out, scratch] = [folder.join("out"), folder.join("scratch")];
        std::fs::create_dir(&scratch)
            .with_context(|| format!("{}: cannot make the folder", scratch.display()))?;
        let esker = |subcommand: &[&str], more: &[OsString]| {
            let mut command = Command::new(&request.esker);
            command.args(subcommand).args(["--json", "--progress", "none"]).arg(input).args(more);
            command
        };
        let mut command = match self {
            Self::Decode => esker(&["bench", "decode"], &request.decode_arguments),
            Self::Esker => {
                let mut command = esker(&["build"], &request.build_arguments);
                command.arg("-o").arg(out.with_extension("esker")).arg("--scratch").arg(&scratch);
                command
            }
            Self::Rival(rival) => rival.command(input, &out),
        };
        for name in ["TMPDIR", "TMP", "TEMP"] {
            command.env(name, &scratch);
        }
        Ok(Invocation { command, folder: folder.to_owned(), scratch })
    }
}
