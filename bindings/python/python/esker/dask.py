"""Runs the steps of a divided build (:mod:`esker.jobs`) on a Dask cluster.

    python -m esker.dask scans town.esker --to work --scheduler tcp://head:8786

Points do not travel through Dask: its tasks are the numbers of steps, and their results are small
reports. Workers need this package, the scans under the same names, and the place that ``--to``
names. A task that fails, or whose worker dies, is done again, up to ``--retries`` times.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterable
from typing import Any

from . import jobs
from ._build import Report

__all__ = ["build", "main"]


def build(
    client: Any,
    inputs: Any,
    out: str | os.PathLike[str],
    to: str | os.PathLike[str],
    *,
    count: int | None = None,
    memory: str | int | None = None,
    scratch: str | os.PathLike[str] | None = None,
    threads: int = 1,
    retries: int = 3,
    progress: Callable[[str, int, int], Any] | None = None,
    **options: Any,
) -> Report:
    """Builds ``out`` from scans by the workers of ``client``, a ``distributed.Client``.

    Args:
        inputs: A scan, a folder of scans, or a list of these, as workers see them.
        out: The file, as the worker that joins the parts sees it.
        to: The place that all workers share.
        count: Number of takes, and of builds.
        memory: Memory of each step. A worker runs as many at a time as it has threads.
        scratch: Folder for scratch files on each worker.
        threads: Threads of each step.
        retries: How often a task that failed is done again.
        progress: Is called with the kind of step, the number of steps done, and that of all.
        options: Those of :func:`esker.jobs.plan`.

    Returns:
        The report of the build.
    """
    how = {"memory": memory, "scratch": scratch, "threads": threads}
    told = progress or (lambda kind, done, steps: None)

    def run(kind: str, step: Callable[..., Report], tasks: Iterable[tuple[Any, ...]]) -> list[Any]:
        # Keys name the plan, so that other builds of the same scheduler do not share results.
        tasks = list(tasks)
        told(kind, 0, len(tasks))
        futures = [
            client.submit(_fields, step, task, how, retries=retries, pure=False) for task in tasks
        ]
        try:
            return _gather(client, kind, futures, told)
        except BaseException:
            # Also after Ctrl-C: steps that are running end by themselves, and are kept.
            client.cancel(futures)
            raise

    paths = [inputs] if isinstance(inputs, (str, os.PathLike)) else list(inputs)
    names = [_absolute(path) for path in paths]
    where, target = _absolute(to), _absolute(out)
    planned = client.submit(
        _planned, names, where, count, options, threads, retries=retries, pure=False
    ).result()
    run("take", jobs.take, [(where, i) for i in range(planned["takes"])])
    builds = run("cut", jobs.cut, [(where,)])[0]["builds"]
    run("build", jobs.build, [(where, i) for i in range(builds)])
    return Report(run("join", jobs.join, [(where, target)])[0])


def _planned(
    names: list[str], to: str, count: int | None, options: dict[str, Any], threads: int
) -> dict[str, Any]:
    return jobs.plan(names, to, jobs=count, threads=threads, **options).as_dict()


def _fields(step: Callable[..., Report], task: tuple[Any, ...], how: dict[str, Any]) -> Any:
    return step(*task, **how).as_dict()


def _gather(client: Any, kind: str, futures: list[Any], told: Callable[..., Any]) -> list[Any]:
    """The results in the order of the futures; the first error is raised."""
    from distributed import as_completed

    for done, future in enumerate(as_completed(futures), 1):
        future.result()
        told(kind, done, len(futures))
    return client.gather(futures)


def _absolute(path: str | os.PathLike[str]) -> str:
    """Paths are those of any folder; addresses and generated scans stay."""
    name = os.fspath(path)
    is_path = "://" not in name and not name.startswith(("synthetic:", "mesh:"))
    return os.path.abspath(name) if is_path else name


def main(arguments: list[str] | None = None) -> int:
    """The command ``python -m esker.dask``."""
    parser = argparse.ArgumentParser(
        prog="python -m esker.dask",
        description="Builds an .esker file on a Dask cluster. The file is that of `esker build`.",
    )
    parser.add_argument("inputs", nargs="+", metavar="IN", help="scans, or folders of scans")
    parser.add_argument("out", metavar="OUT", help="the file, as a worker sees it")
    parser.add_argument("--to", required=True, help="the place that all workers share")
    parser.add_argument(
        "--scheduler", default="local", help="address of the scheduler; a local cluster by default"
    )
    parser.add_argument("--workers", type=int, default=2, help="processes of a local cluster")
    parser.add_argument("--jobs", type=int, help="number of takes, and of builds")
    parser.add_argument("--memory", help="memory of each step, such as 2GiB")
    parser.add_argument("--scratch", help="folder for scratch files on each worker")
    parser.add_argument("--threads", type=int, default=1, help="threads of each step")
    parser.add_argument("--retries", type=int, default=3, help="how often a failed task is repeated")
    parser.add_argument("--normals", help="as in `esker build`")
    parser.add_argument("--compress", help="as in `esker build`")
    parser.add_argument("--measure", action="store_true", help="read all points before planning")
    given = parser.parse_args(arguments)
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        parser.error("it needs Dask: pip install 'dask[distributed]'")
    names = ("normals", "compress", "measure")
    options = {name: getattr(given, name) for name in names if getattr(given, name)}

    def told(kind: str, done: int, all_steps: int) -> None:
        print(f"{kind}: {done} of {all_steps}", file=sys.stderr, flush=True)

    cluster = None
    if given.scheduler == "local":
        # Each process runs one step at a time. Workers' own limits of memory would count pages of
        # mapped files, and kill them.
        cluster = LocalCluster(
            n_workers=given.workers, threads_per_worker=1, memory_limit=0, dashboard_address=None
        )
    with Client(cluster if cluster is not None else given.scheduler) as client:
        report = build(
            client,
            given.inputs,
            given.out,
            given.to,
            count=given.jobs,
            memory=given.memory,
            scratch=given.scratch,
            threads=given.threads,
            retries=given.retries,
            progress=told,
            **options,
        )
    if cluster is not None:
        cluster.close()
    print(f"{given.out}: {report.points_out} points in {report.nodes} nodes, {report.bytes_out} bytes")
    for note in report.notes:
        print(note)
    return 0


if __name__ == "__main__":
    sys.exit(main())
