//! `esker job`: the steps of a build that is divided among jobs of a scheduler, and the number of
//! the step that a job is to do.

use crate::job_options::{StepHow, To};
use crate::job_run::{self, Run};
use crate::output::Output;
use crate::shared::BuildHow;
use anyhow::{Context, Result, ensure};
use clap::{Args as ClapArgs, Subcommand};
use esker_engine::PlanHow;
use esker_engine::calls::{build, job};
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Steps of a divided build. They share a place, and may be run in any order within a kind, again
/// or twice.
#[derive(Subcommand)]
pub enum Job {
    /// Plan the build: open the scans, choose what all steps must agree on, and divide the scans
    /// among jobs. Prints how many jobs there are and what each needs.
    Plan(Plan),
    /// Decode the scans of one job, and sort their points into cells.
    Take(Numbered),
    /// Sum up all takes, and divide the cells into parts.
    Cut(Cut),
    /// Build the parts of one job.
    Build(Numbered),
    /// Join the parts to the file, once it is proved that it holds all points.
    Join(Join),
    /// Print what is done, what is missing, and what killed jobs have left.
    Status(Status),
    /// Run all steps of the plan as processes of this machine.
    Run(Run),
}

#[derive(ClapArgs)]
pub struct Plan {
    /// The scans, or folders, as in `esker build`.
    #[arg(required = true, value_name = "IN")]
    pub inputs: Vec<PathBuf>,
    #[command(flatten)]
    pub to: To,
    /// Number of jobs that decode scans, and of those that build parts; by default one for
    /// each 64 million points.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..100_000))]
    pub jobs: Option<u32>,
    /// Read all points first, for their bounds and colours, whatever headers state.
    #[arg(long)]
    pub measure: bool,
    #[command(flatten)]
    pub how: BuildHow,
    #[command(flatten)]
    pub output: Output,
}

/// A step of which there is one for each job.
#[derive(ClapArgs)]
pub struct Numbered {
    #[command(flatten)]
    pub to: To,
    /// Number of the job, from 0, which the number of all jobs may follow: 3/8. By default that of
    /// the task of a Slurm array, or of an indexed job of AWS Batch or Kubernetes.
    #[arg(long, value_name = "I[/N]")]
    pub job: Option<Index>,
    #[command(flatten)]
    pub how: StepHow,
    #[command(flatten)]
    pub output: Output,
}

#[derive(ClapArgs)]
pub struct Cut {
    #[command(flatten)]
    pub to: To,
    #[command(flatten)]
    pub how: StepHow,
    #[command(flatten)]
    pub output: Output,
}

#[derive(ClapArgs)]
pub struct Join {
    #[command(flatten)]
    pub to: To,
    /// The file to write.
    #[arg(short, long, value_name = "OUT")]
    pub out: PathBuf,
    #[command(flatten)]
    pub how: StepHow,
    #[command(flatten)]
    pub output: Output,
}

#[derive(ClapArgs)]
pub struct Status {
    #[command(flatten)]
    pub to: To,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}

/// Number of a job, from 0, and the number of all jobs, if it is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Index(u32, Option<u32>);

impl FromStr for Index {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        let (index, count) = match text.split_once('/') {
            Some((index, count)) => (index, Some(count)),
            None => (text, None),
        };
        let number = |text: &str| {
            text.parse::<u32>().with_context(|| format!("`{text}` is no whole number from 0"))
        };
        Ok(Self(number(index)?, count.map(number).transpose()?))
    }
}

impl Index {
    /// The number of the job among `count`; without one, that which a scheduler has set.
    fn among(given: Option<Self>, count: u32, env: &dyn Fn(&str) -> Option<String>) -> Result<u32> {
        let number = |name: &str| -> Result<Option<u32>> {
            let text = env(name).filter(|text| !text.is_empty());
            let parsed = text.map(|text| text.parse().with_context(|| format!("{name}={text}")));
            parsed.transpose()
        };
        let index = match given {
            Some(Self(index, stated)) => {
                let stated = stated.unwrap_or(count);
                ensure!(stated == count, "the step has {count} jobs, and --job says {stated}");
                index
            }
            None => {
                let slurm = slurm(&number, count)?;
                let batch = || number("AWS_BATCH_JOB_ARRAY_INDEX");
                let indexed = || number("JOB_COMPLETION_INDEX");
                let found = match slurm {
                    Some(index) => Some(index),
                    None => batch()?.or(indexed()?),
                };
                found.context(
                    "which job is this? Give --job I, or run it as a task of a Slurm array, or as an \
                     indexed job of AWS Batch or Kubernetes",
                )?
            }
        };
        let last = count.max(1) - 1;
        ensure!(index < count, "there is no job {index}: the step has jobs 0 to {last}");
        Ok(index)
    }
}

/// Number of the task of a Slurm array. An array of as many tasks as there are jobs may begin
/// elsewhere than at 0; one of fewer tasks, as to run some again, names them.
fn slurm(number: &dyn Fn(&str) -> Result<Option<u32>>, count: u32) -> Result<Option<u32>> {
    let Some(index) = number("SLURM_ARRAY_TASK_ID")? else { return Ok(None) };
    let min = number("SLURM_ARRAY_TASK_MIN")?.unwrap_or(0);
    let span = number("SLURM_ARRAY_TASK_MAX")?.and_then(|max| max.checked_sub(min)?.checked_add(1));
    let is_whole = number("SLURM_ARRAY_TASK_COUNT")? == Some(count) && span == Some(count);
    Ok(Some(if is_whole { index.saturating_sub(min) } else { index }))
}

/// Runs a step; `stop` is set when the user interrupts it.
pub fn run(job: Job, stop: Arc<AtomicBool>) -> Result<()> {
    match job {
        Job::Plan(Plan { inputs, to: To { to }, jobs, measure, how, output }) => {
            let divide = PlanHow { jobs, measures: measure };
            let (options, threads) = (how.options(), how.threads.count);
            output.report(
                stop,
                |progress| job::plan(&inputs, &to, &options, &divide, threads, progress),
                |report| report.text(&to),
            )
        }
        Job::Take(Numbered { to: To { to }, job, how, output }) => {
            let index = Index::among(job, job::takes(&to)?, &|name| std::env::var(name).ok())?;
            let (resources, threads) = (how.resources(), how.threads.count);
            output.report(
                stop,
                |progress| job::take(&to, index, &resources, threads, progress),
                job::TakeReport::text,
            )
        }
        Job::Cut(Cut { to: To { to }, how, output }) => {
            let (resources, threads) = (how.resources(), how.threads.count);
            output.report(
                stop,
                |progress| job::cut(&to, &resources, threads, progress),
                job::CutReport::text,
            )
        }
        Job::Build(Numbered { to: To { to }, job, how, output }) => {
            let index = Index::among(job, job::builds(&to)?, &|name| std::env::var(name).ok())?;
            let (resources, threads) = (how.resources(), how.threads.count);
            output.report(
                stop,
                |progress| job::build(&to, index, &resources, threads, progress),
                job::PartsReport::text,
            )
        }
        Job::Join(Join { to: To { to }, out, how, output }) => {
            let (resources, threads) = (how.resources(), how.threads.count);
            output.report(
                stop,
                |progress| job::join(&to, &out, &resources, threads, progress),
                |report| build::text(report, &out),
            )
        }
        Job::Status(Status { to: To { to }, json }) => {
            let report = job::status(&to)?;
            crate::output::print(json, &report, || report.text(&to))
        }
        Job::Run(run) => job_run::run(&run, stop),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn among(given: Option<&str>, count: u32, env: &[(&str, &str)]) -> Result<u32> {
        let given = given.map(|text| text.parse().unwrap());
        let value = |name: &str| env.iter().find(|(n, _)| *n == name).map(|(_, v)| v.to_string());
        Index::among(given, count, &value)
    }

    #[test]
    fn the_index_comes_from_the_option_or_the_scheduler() {
        assert_eq!(among(Some("3/8"), 8, &[("SLURM_ARRAY_TASK_ID", "5")]).unwrap(), 3);
        assert_eq!(among(Some("7"), 8, &[]).unwrap(), 7);
        assert_eq!(among(None, 8, &[("AWS_BATCH_JOB_ARRAY_INDEX", "0")]).unwrap(), 0);
        assert_eq!(among(None, 8, &[("JOB_COMPLETION_INDEX", "4")]).unwrap(), 4);
        among(Some("3/9"), 8, &[]).unwrap_err();
        among(Some("8"), 8, &[]).unwrap_err();
        among(None, 8, &[]).unwrap_err();
        among(None, 8, &[("JOB_COMPLETION_INDEX", "x")]).unwrap_err();
        "1/x".parse::<Index>().unwrap_err();
        "-1".parse::<Index>().unwrap_err();
    }

    #[test]
    fn arrays_of_slurm_may_begin_anywhere_and_be_run_in_part() {
        let task = |id, min, max, count| {
            let env = [
                ("SLURM_ARRAY_TASK_ID", id),
                ("SLURM_ARRAY_TASK_MIN", min),
                ("SLURM_ARRAY_TASK_MAX", max),
                ("SLURM_ARRAY_TASK_COUNT", count),
            ];
            among(None, 8, &env).unwrap()
        };
        assert_eq!(task("3", "0", "7", "8"), 3);
        assert_eq!(task("3", "1", "8", "8"), 2);
        // Some again: these are the numbers that `esker job status` prints.
        assert_eq!(task("3", "3", "5", "2"), 3);
        assert_eq!(among(None, 8, &[("SLURM_ARRAY_TASK_ID", "6")]).unwrap(), 6);
    }
}
