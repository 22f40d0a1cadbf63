"""What the tests share: the sample scan, files built from it, and points in a comparable order."""

from __future__ import annotations

import functools
import os
import shutil
import tempfile
import unittest
from pathlib import Path

import esker
import laspy
import numpy as np

ROOT = Path(__file__).resolve().parents[3]
SAMPLE = ROOT / "tests" / "sample" / "creek.laz"


class Case(unittest.TestCase):
    """A test with a folder of its own."""

    def setUp(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="esker-python-"))
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)

    def assert_same_points(self, a: np.ndarray, b: np.ndarray) -> None:
        """Compares structured arrays as multisets of rows."""
        self.assertEqual(packed_type(a.dtype), packed_type(b.dtype))
        self.assertEqual(len(a), len(b))
        self.assertTrue(np.array_equal(in_order(a), in_order(b)), "the points differ")


def in_order(points: np.ndarray) -> np.ndarray:
    """Rows as bytes, sorted."""
    packed = np.ascontiguousarray(points.astype(packed_type(points.dtype)))
    return np.sort(packed.view(f"V{packed.dtype.itemsize}"))


def packed_type(dtype: np.dtype) -> np.dtype:
    """The type without gaps between fields."""
    return np.dtype([(name, dtype[name]) for name in dtype.names or ()])


@functools.cache
def shared_folder() -> Path:
    """A folder of all tests, removed at the end."""
    import atexit

    folder = Path(tempfile.mkdtemp(prefix="esker-python-shared-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def write_scan(path: Path) -> None:
    """Writes the sample scan with classes, returns, intensities and times, which it has not."""
    las = laspy.convert(laspy.read(SAMPLE), point_format_id=3)
    random = np.random.default_rng(1)
    n = len(las.points)
    # Points less than 1 m above the lowest within 5 m are ground.
    cells = (las.X // 500).astype(np.int64) * 1_000_000 + las.Y // 500
    _, cell = np.unique(cells, return_inverse=True)
    lowest = np.full(cell.max() + 1, np.iinfo("i4").max)
    np.minimum.at(lowest, cell, las.Z)
    above = las.Z - lowest[cell]
    las.classification = np.where(above < 100, 2, np.where(above < 1000, 5, 6)).astype("u1")
    las.number_of_returns = random.integers(1, 6, n).astype("u1")
    las.return_number = random.integers(1, np.asarray(las.number_of_returns) + 1).astype("u1")
    las.intensity = random.integers(0, 4000, n).astype("u2")
    las.gps_time = np.sort(random.uniform(0, 1e6, n))
    las.write(path)


@functools.cache
def scan_path() -> Path:
    """The scan that most tests read."""
    path = shared_folder() / "creek.laz"
    write_scan(path)
    return path


@functools.cache
def creek() -> esker.File:
    """That scan, built and opened."""
    path = shared_folder() / "creek.esker"
    esker.build(scan_path(), path)
    return esker.open(path)


@functools.cache
def scan() -> laspy.LasData:
    """That scan as laspy reads it."""
    return laspy.read(scan_path())


def as_laspy(las: laspy.LasData, dtype: np.dtype) -> np.ndarray:
    """The points of laspy as a structured array of `dtype`, extra bytes as stored."""
    out = np.zeros(len(las.points), dtype=dtype)
    extra = set(las.point_format.extra_dimension_names)
    for name in dtype.names or ():
        out[name] = las.points.array[name] if name in extra else np.asarray(las[name])
    return out


def fields_of(las: laspy.LasData) -> set[str]:
    """Names of all fields of a scan."""
    return set(las.point_format.dimension_names)


def random_scan(path: Path, point_format: int, points: int = 3000) -> laspy.LasData:
    """Writes a scan of random values in all fields, with extra bytes, one of them scaled."""
    random = np.random.default_rng(point_format)
    header = laspy.LasHeader(point_format=point_format, version="1.4")
    header.scales, header.offsets = [0.01, 0.01, 0.001], [500_000.0, 4_100_000.0, -3.0]
    header.add_extra_dim(laspy.ExtraBytesParams("ratio", "f4", "any"))
    header.add_extra_dim(
        laspy.ExtraBytesParams("width", "i2", scales=np.array([0.5]), offsets=np.array([1.0]))
    )
    las = laspy.LasData(header, laspy.ScaleAwarePointRecord.zeros(points, header=header))
    for name in las.point_format.dimension_names:
        if name in ("X", "Y", "Z"):
            las[name] = random.integers(-100_000, 100_000, points)
        elif name in ("ratio", "gps_time"):
            las[name] = random.normal(size=points)
        elif name == "width":
            las.points.array["width"] = random.integers(-300, 300, points)
        else:
            bits = las.point_format.dimension_by_name(name).num_bits
            most = 1 << (bits - 1 if name.startswith("scan_angle") else bits)
            low = -most + 1 if name.startswith("scan_angle") else 0
            las[name] = random.integers(max(low, -15_000), min(most, 15_000), points)
    las.write(path)
    return laspy.read(path)


def esker_program() -> str | None:
    """The `esker` program, if the caller names it."""
    return os.environ.get("ESKER_PROGRAM")
