//! Rival programs of the benchmark of building, and their command lines: known ones by their names,
//! others by a line with placeholders for input and output.

use anyhow::{Context, Result, bail};
use std::ffi::{OsStr, OsString};
use std::path::Path;
use std::process::Command;

/// Argument of a rival's command line.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Argument {
    /// The same in every run.
    Plain(OsString),
    /// Path of the input.
    In,
    /// Path of the output, with this ending.
    Out(&'static str),
}

/// A rival program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rival {
    /// Name in reports.
    pub(super) name: String,
    program: OsString,
    arguments: Vec<Argument>,
}

impl Rival {
    /// Parses the value of `--against`: the path of a known program, or a command line with the
    /// words `{in}` and `{out}`, split at spaces.
    ///
    /// # Errors
    /// If the program is not known, or the line lacks `{in}` or `{out}`.
    pub fn parse(text: &str) -> Result<Self> {
        if !text.contains("{in}") && !text.contains("{out}") {
            let name = name_of(OsStr::new(text));
            let arguments = match name.to_ascii_lowercase().as_str() {
                "potreeconverter" => {
                    vec![Argument::In, Argument::Plain("-o".into()), Argument::Out("")]
                }
                // A progress bar would cost it time.
                "copc_converter" => {
                    let plain = ["--progress", "plain"].map(|w| Argument::Plain(w.into()));
                    [plain.as_slice(), &[Argument::In, Argument::Out(".copc.laz")]].concat()
                }
                _ => bail!(
                    "`{text}` is not a known program (PotreeConverter, copc_converter): give its command line, as in --against \"{text} {{in}} {{out}}\""
                ),
            };
            return Ok(Self { name, program: text.into(), arguments });
        }
        let mut words = text.split_whitespace();
        let program = words.next().context("an empty command line")?;
        let argument = |word: &str| match word {
            "{in}" => Argument::In,
            "{out}" => Argument::Out(""),
            plain => Argument::Plain(plain.into()),
        };
        let arguments: Vec<Argument> = words.map(argument).collect();
        if !arguments.contains(&Argument::In) || !arguments.contains(&Argument::Out("")) {
            bail!("`{text}` must have {{in}} and {{out}} among its words");
        }
        Ok(Self { name: name_of(OsStr::new(program)), program: program.into(), arguments })
    }

    /// The command that builds `input` to `out`.
    pub(super) fn command(&self, input: &Path, out: &Path) -> Command {
        let mut command = Command::new(&self.program);
        for argument in &self.arguments {
            match argument {
                Argument::Plain(word) => command.arg(word),
                Argument::In => command.arg(input),
                Argument::Out(ending) => {
                    let mut out = out.as_os_str().to_owned();
                    out.push(ending);
                    command.arg(out)
                }
            };
        }
        command
    }
}

/// Name of a program without its folder, and without `.exe`.
fn name_of(program: &OsStr) -> String {
    let path = Path::new(program);
    let name = if path.extension().is_some_and(|e| e == "exe") {
        path.file_stem()
    } else {
        path.file_name()
    };
    name.unwrap_or(program).to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rivals_are_known_by_name_and_others_are_given_by_their_command_line() {
        let potree = Rival::parse("/opt/PotreeConverter").unwrap();
        assert_eq!(potree.name, "PotreeConverter");
        assert_eq!(
            potree.arguments,
            [Argument::In, Argument::Plain("-o".into()), Argument::Out("")]
        );
        let copc = Rival::parse("/a b/copc_converter").unwrap();
        assert_eq!(copc.program, "/a b/copc_converter");
        assert_eq!(copc.arguments[2..], [Argument::In, Argument::Out(".copc.laz")]);
        let line = Rival::parse("/bin/untwine -i {in} -o {out}").unwrap();
        assert_eq!((line.name.as_str(), line.arguments.len()), ("untwine", 4));
        for (text, word) in [
            ("/bin/untwine", "{in} {out}"),
            ("untwine {in}", "{out}"),
            ("untwine -o={out} {in}", "among its words"),
        ] {
            let error = Rival::parse(text).unwrap_err().to_string();
            assert!(error.contains(word), "{error}");
        }
    }
}
