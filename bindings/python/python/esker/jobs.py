"""Steps of a build that is divided among processes or machines.

The steps are those of ``esker job``: one :func:`plan`, its takes, one :func:`cut`, its builds, one
:func:`join`. They share nothing but a place: a folder that all machines see, or an address such as
``s3://bucket/work``. Any scheduler may run them: within a kind in any order, at the same time,
again, or twice. :mod:`esker.dask` runs them on a Dask cluster. The file is that of
:func:`esker.build`, to the byte.

>>> import esker.jobs
>>> planned = esker.jobs.plan("creek.laz", "work", jobs=2)
>>> taken = [esker.jobs.take("work", i).points for i in range(planned.takes)]
>>> builds = esker.jobs.cut("work").builds
>>> built = [esker.jobs.build("work", i).points for i in range(builds)]
>>> report = esker.jobs.join("work", "creek-joined.esker")
>>> report.points_out == sum(taken) == sum(built) == 841556
True
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from typing import Any

from . import _esker
from ._build import Progress, Report, native_progress, report_of

__all__ = ["build", "cut", "join", "plan", "status", "take"]

Path = str | os.PathLike[str]


def plan(
    inputs: Path | Iterable[Path],
    to: Path,
    *,
    jobs: int | None = None,
    measure: bool = False,
    allow_loss: bool = False,
    threads: int = 0,
    progress: Callable[[Progress], Any] | None = None,
    **options: Any,
) -> Report:
    """Plans the build of scans into a place, which has no other plan.

    Args:
        inputs: A scan, a folder of scans, or a list of these.
        to: The place.
        jobs: Number of takes, and of builds; one for each 64 million points by default.
        measure: Whether all points are read first, whatever headers state.
        allow_loss: As in :func:`esker.build`.
        options: Those of :func:`esker.build` for scans.

    Returns:
        The number of takes, and what each step needs.
    """
    paths = [inputs] if isinstance(inputs, (str, os.PathLike)) else list(inputs)
    names = [os.fspath(path) for path in paths]
    given = {"allow_loss": allow_loss, **options}
    told = native_progress(progress)
    return report_of(_esker.job_plan(names, os.fspath(to), given, jobs, measure, threads, told))


def take(to: Path, index: int, **how: Any) -> Report:
    """Decodes the scans of take ``index`` of the plan in a place, unless that is done.

    Args:
        how: ``memory``, ``scratch``, ``threads`` and ``progress``, as in :func:`esker.build`.
    """
    return _step("take", to, index, **how)


def cut(to: Path, **how: Any) -> Report:
    """Sums up all takes of the plan in a place, unless that is done; says how many builds follow.

    Args:
        how: As in :func:`take`.
    """
    return _step("cut", to, 0, **how)


def build(to: Path, index: int, **how: Any) -> Report:
    """Builds the parts of job ``index`` of the plan in a place, unless that is done.

    Args:
        how: As in :func:`take`.
    """
    return _step("build", to, index, **how)


def join(
    to: Path,
    out: Path,
    *,
    memory: str | int | None = None,
    scratch: Path | None = None,
    threads: int = 0,
    progress: Callable[[Progress], Any] | None = None,
) -> Report:
    """Joins the parts of the plan in a place to the file ``out``, once it is proved to have all
    points; returns the report of the build.
    """
    given, told = _resources(memory, scratch), native_progress(progress)
    return report_of(_esker.job_join(os.fspath(to), os.fspath(out), given, threads, told))


def status(to: Path) -> Report:
    """What is done of the plan in a place, what is missing, and what killed jobs have left."""
    return report_of(_esker.job_status(os.fspath(to)))


def _step(
    step: str,
    to: Path,
    index: int,
    *,
    memory: str | int | None = None,
    scratch: Path | None = None,
    threads: int = 0,
    progress: Callable[[Progress], Any] | None = None,
) -> Report:
    given, told = _resources(memory, scratch), native_progress(progress)
    return report_of(_esker.job_step(step, os.fspath(to), index, given, threads, told))


def _resources(memory: str | int | None, scratch: Path | None) -> dict[str, Any]:
    return {"memory": memory, "scratch": None if scratch is None else os.fspath(scratch)}
