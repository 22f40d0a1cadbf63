//! The programs that are compared, and their command lines: rivals are known by their names, others by a
//! line that says where input and output stand in it.

use super::{Plan, places};
use anyhow::{Context, Result, bail};
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use std::process::Command;

/// A word of a rival's command line.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Word {
    /// As it stands.
    Plain(OsString),
    /// The input.
    In,
    /// What it is to make, with this ending.
    Out(&'static str),
}

/// A rival: its name in reports, and its command line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Against {
    name: String,
    program: OsString,
    words: Vec<Word>,
}

impl Against {
    /// From what the user wrote: the path of a program that is known, or a command line with `{in}` and
    /// `{out}` in it, of words without spaces.
    ///
    /// # Errors
    /// Where the program is not known, or the line has no `{in}` or no `{out}`.
    pub fn parse(text: &str) -> Result<Self> {
        if !text.contains("{in}") && !text.contains("{out}") {
            let name = name_of(OsStr::new(text));
            let words = match name.to_ascii_lowercase().as_str() {
                "potreeconverter" => vec![Word::In, Word::Plain("-o".into()), Word::Out("")],
                // Its bar would cost it time.
                "copc_converter" => {
                    let plain = ["--progress", "plain"].map(|w| Word::Plain(w.into()));
                    [plain.as_slice(), &[Word::In, Word::Out(".copc.laz")]].concat()
                }
                _ => bail!(
                    "`{text}` is no program that is known (PotreeConverter, copc_converter): say how it is called, as in --against \"{text} {{in}} {{out}}\""
                ),
            };
            return Ok(Self { name, program: text.into(), words });
        }
        let mut words = text.split_whitespace();
        let program = words.next().context("an empty command line")?;
        let word = |word: &str| match word {
            "{in}" => Word::In,
            "{out}" => Word::Out(""),
            plain => Word::Plain(plain.into()),
        };
        let words: Vec<Word> = words.map(word).collect();
        if !words.contains(&Word::In) || !words.contains(&Word::Out("")) {
            bail!("`{text}` must have {{in}} and {{out}} among its words");
        }
        Ok(Self { name: name_of(OsStr::new(program)), program: program.into(), words })
    }
}

/// A program's name without folders and ending.
fn name_of(program: &OsStr) -> String {
    let path = Path::new(program);
    let name = if path.extension().is_some_and(|e| e == "exe") {
        path.file_stem()
    } else {
        path.file_name()
    };
    name.unwrap_or(program).to_string_lossy().into_owned()
}

/// What is run.
#[derive(Clone, Debug)]
pub enum Program {
    /// Decoding alone.
    Decode,
    /// Ours.
    Esker,
    /// Another.
    Rival(Against),
}

impl Program {
    /// Its name in reports.
    pub fn name(&self) -> &str {
        match self {
            Self::Decode => "decode",
            Self::Esker => "esker",
            Self::Rival(against) => &against.name,
        }
    }

    /// The command that runs it on this input, with output and scratch in this folder.
    ///
    /// # Errors
    /// Where the folder for scratch files cannot be made.
    pub fn command(&self, plan: &Plan, input: &Path, folder: &Path) -> Result<Run> {
        let [out, scratch] = places(folder);
        std::fs::create_dir(&scratch)
            .with_context(|| format!("{}: cannot make the folder", scratch.display()))?;
        let ours = |words: &[&str], more: &[OsString]| {
            let mut command = Command::new(&plan.esker);
            command.args(words).args(["--json", "--progress", "none"]).arg(input).args(more);
            command
        };
        let mut command = match self {
            Self::Decode => ours(&["bench", "decode"], &plan.decode_words),
            Self::Esker => {
                let mut command = ours(&["build"], &plan.build_words);
                command.arg("-o").arg(out.with_extension("esker")).arg("--scratch").arg(&scratch);
                command
            }
            Self::Rival(against) => {
                let mut command = Command::new(&against.program);
                for word in &against.words {
                    match word {
                        Word::Plain(word) => command.arg(word),
                        Word::In => command.arg(input),
                        Word::Out(ending) => {
                            let mut out = out.clone().into_os_string();
                            out.push(ending);
                            command.arg(out)
                        }
                    };
                }
                command
            }
        };
        for name in ["TMPDIR", "TMP", "TEMP"] {
            command.env(name, &scratch);
        }
        Ok(Run { command, folder: folder.to_owned(), scratch })
    }
}

/// A command that is to be run, and where its files will lie.
pub struct Run {
    /// The command.
    pub command: Command,
    /// The folder of all its files.
    pub folder: PathBuf,
    /// The folder for scratch files.
    pub scratch: PathBuf,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rivals_are_known_by_their_names_and_others_by_their_lines() {
        let potree = Against::parse("/opt/PotreeConverter").unwrap();
        assert_eq!(potree.name, "PotreeConverter");
        assert_eq!(potree.words, [Word::In, Word::Plain("-o".into()), Word::Out("")]);
        let copc = Against::parse("/a b/copc_converter").unwrap();
        assert_eq!(copc.program, "/a b/copc_converter");
        assert_eq!(copc.words[2..], [Word::In, Word::Out(".copc.laz")]);
        let line = Against::parse("/bin/untwine -i {in} -o {out}").unwrap();
        assert_eq!((line.name.as_str(), line.words.len()), ("untwine", 4));
        for (text, word) in [
            ("/bin/untwine", "{in} {out}"),
            ("untwine {in}", "{out}"),
            ("untwine -o={out} {in}", "among its words"),
        ] {
            let error = Against::parse(text).unwrap_err().to_string();
            assert!(error.contains(word), "{error}");
        }
    }
}
