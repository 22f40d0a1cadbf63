"""Builds that are divided among processes give the file of one process."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
import unittest
from pathlib import Path

import esker
import esker.jobs
from support import SAMPLE, Case

MEMORY = "256MiB"

try:
    import distributed
except ImportError:
    distributed = None


def _take(place: str, index: int) -> int:
    return esker.jobs.take(place, index, memory=MEMORY, threads=1).points


class Jobs(Case):
    def whole(self) -> bytes:
        out = self.folder / "whole.esker"
        esker.build(SAMPLE, out)
        return out.read_bytes()

    def test_processes_that_share_a_folder_build_the_file_of_one(self) -> None:
        place = str(self.folder / "work")
        planned = esker.jobs.plan(SAMPLE, place, jobs=3)
        self.assertEqual(planned.takes, 3)
        with multiprocessing.get_context("spawn").Pool(2) as pool:
            # Each take twice, at the same time or after each other.
            points = pool.starmap(_take, [(place, i % 3) for i in range(6)])
        self.assertEqual(sum(points), 2 * 841_556)
        steps = esker.jobs.status(place).steps
        self.assertEqual((steps["take"]["missing"], steps["cut"]["missing"]), ("", "0"))
        for i in range(esker.jobs.cut(place).builds):
            esker.jobs.build(place, i, memory=MEMORY)
        out = self.folder / "many.esker"
        report = esker.jobs.join(place, out)
        self.assertEqual(report.points_out, 841_556)
        self.assertEqual(out.read_bytes(), self.whole())
        self.assertEqual(esker.jobs.status(place).leftovers, [])

    def test_missing_steps_and_other_plans_are_errors_that_name_them(self) -> None:
        place = self.folder / "work"
        with self.assertRaisesRegex(esker.EskerError, "plan.json"):
            esker.jobs.take(place, 0)
        esker.jobs.plan(SAMPLE, place, jobs=2)
        with self.assertRaisesRegex(esker.EskerError, "take/0000"):
            esker.jobs.cut(place)
        with self.assertRaisesRegex(esker.EskerError, "plan.json"):
            esker.jobs.plan(SAMPLE, place, jobs=2, normals="none")
        with self.assertRaisesRegex(ValueError, "no option"):
            esker.jobs.plan(SAMPLE, place, colour="red")

    @unittest.skipUnless(distributed, "needs dask[distributed]")
    def test_a_cluster_of_dask_builds_the_file_of_one_process(self) -> None:
        out, place = self.folder / "many.esker", self.folder / "work"
        words = [sys.executable, "-m", "esker.dask", SAMPLE, out, "--to", place]
        done = subprocess.run(
            [*words, "--jobs", "4", "--workers", "2", "--memory", MEMORY],
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("take: 4 of 4", done.stderr)
        self.assertIn("841556 points", done.stdout)
        self.assertEqual(out.read_bytes(), self.whole())

    @unittest.skipUnless(distributed, "needs dask[distributed]")
    def test_a_worker_that_is_killed_costs_only_its_step(self) -> None:
        from esker.dask import build

        out, place = self.folder / "many.esker", self.folder / "work"
        killed: list[int] = []
        options = {"n_workers": 2, "threads_per_worker": 1, "memory_limit": 0}
        with (
            distributed.LocalCluster(**options, dashboard_address=None) as cluster,
            distributed.Client(cluster) as client,
        ):

            def kill_one(kind: str, done: int, count: int) -> None:
                if kind == "build" and done == 0:
                    process = next(iter(cluster.workers.values())).process
                    time.sleep(0.05)
                    os.kill(process.pid, signal.SIGKILL)
                    killed.append(process.pid)

            report = build(
                client, SAMPLE, out, place, count=4, memory=MEMORY, progress=kill_one
            )
        self.assertEqual((len(killed), report.points_out), (1, 841_556))
        self.assertEqual(out.read_bytes(), self.whole())
        self.assertEqual([p for p in Path(place).rglob("*.new")], [])
