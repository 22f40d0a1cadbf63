"""Speed of reading beside laspy and lazrs, on the same scan: everything, and a box of 1 %.

Usage: reading.py SCAN.laz OUT.json [RUNS]. Each run reads in turn by both, in a process of its own,
so that none finds the memory of another. laspy reads a box as its users do: all points, then a
mask. CPU time counts all threads; wall time means little on a machine that is not idle. Both must
find the same number of points and the same sums of coordinates, which are not timed, nor is the
build of the scan.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import esker
import laspy
import numpy as np


def whole_laspy(scan: str, _: str, __: list[float]) -> Any:
    return laspy.read(scan).points


def whole_esker(_: str, built: str, __: list[float]) -> Any:
    return esker.open(built).query()


def box_laspy(scan: str, _: str, box: list[float]) -> Any:
    las = laspy.read(scan)
    x0, y0, x1, y1 = box
    x, y = np.asarray(las.x), np.asarray(las.y)
    return las.points[(x >= x0) & (x <= x1) & (y >= y0) & (y <= y1)]


def box_esker(_: str, built: str, box: list[float]) -> Any:
    return esker.open(built).query(bounds=box)


READERS = {
    "whole": {"laspy": whole_laspy, "esker": whole_esker},
    "box_1_percent": {"laspy": box_laspy, "esker": box_esker},
}


def measure(task: str, reader: str, scan: str, built: str, box: list[float]) -> dict:
    """Reads once in this process."""
    start, cpu = time.perf_counter(), time.process_time()
    points = READERS[task][reader](scan, built, box)
    times = {"wall_s": time.perf_counter() - start, "cpu_s": time.process_time() - cpu}
    sums = [int(np.asarray(c).sum(dtype=np.int64)) for c in (points.X, points.Y, points.Z)]
    return {**times, "found": [len(points), *sums]}


def main(scan: str, out: str, runs: int) -> None:
    with tempfile.TemporaryDirectory(prefix="esker-bench-") as folder:
        built = os.path.join(folder, "scan.esker")
        report = esker.build(scan, built)
        file = esker.open(built)
        (x0, y0, _), (x1, y1, _) = file.bounds.tolist()
        # A tenth of each side, in the middle.
        w, h = (x1 - x0) * 0.1, (y1 - y0) * 0.1
        box = [(x0 + x1 - w) / 2, (y0 + y1 - h) / 2, (x0 + x1 + w) / 2, (y0 + y1 + h) / 2]
        results: dict = {}
        for _ in range(runs):
            for task, readers in READERS.items():
                for reader in readers:
                    line = [
                        sys.executable,
                        __file__,
                        "--one",
                        task,
                        reader,
                        scan,
                        built,
                        json.dumps(box),
                    ]
                    text = subprocess.run(line, check=True, capture_output=True, text=True).stdout
                    results.setdefault(task, {}).setdefault(reader, []).append(json.loads(text))
        summary = {}
        for task, readers in results.items():
            found = {tuple(run["found"]) for each in readers.values() for run in each}
            if len(found) != 1:
                raise SystemExit(f"{task}: the readers differ: {found}")
            entry: dict = {"points": found.pop()[0]}
            for reader, each in readers.items():
                for name in ("cpu_s", "wall_s"):
                    entry[f"{reader}_{name}"] = [round(run[name], 4) for run in each]
            for name in ("cpu_s", "wall_s"):
                median = {
                    r: statistics.median(run[name] for run in each) for r, each in readers.items()
                }
                entry[f"speedup_{name[:-2]}"] = round(median["laspy"] / median["esker"], 2)
            summary[task] = entry
        result = {
            "command": "python bindings/python/bench/reading.py SCAN.laz OUT.json",
            "scan": Path(scan).name,
            "points": report.points_out,
            "bytes": {"laz": os.path.getsize(scan), "esker": os.path.getsize(built)},
            "versions": {
                "esker": esker.__version__,
                "laspy": laspy.__version__,
                "numpy": np.__version__,
                "python": sys.version.split()[0],
            },
            "laz_backend": str(laspy.LazBackend.detect_available()[0]),
            "cores": os.cpu_count(),
            "runs": runs,
            "tasks": summary,
        }
    Path(out).write_text(json.dumps(result, indent=2) + "\n")
    print(json.dumps(summary, indent=2))


if __name__ == "__main__":
    if sys.argv[1] == "--one":
        print(json.dumps(measure(*sys.argv[2:6], json.loads(sys.argv[6]))))
    else:
        main(sys.argv[1], sys.argv[2], int(sys.argv[3]) if len(sys.argv) > 3 else 3)
