"""Native part of the package `esker`."""

from collections.abc import Callable
from os import PathLike
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

__version__: str

_Path: TypeAlias = str | PathLike[str]
_Bytes: TypeAlias = npt.NDArray[np.uint8]
_Progress: TypeAlias = Callable[[str, int, int | None, str], Any] | None
_Attribute: TypeAlias = tuple[str, str, float, float, str]

class EskerError(Exception):
    """What Esker refuses, and what to do."""

class LossError(EskerError):
    """Points of an input would be lost."""

class Filter:
    """Which points are wanted."""

    def __init__(
        self,
        *,
        bounds: list[list[float]] | None = None,
        polygon: list[list[list[list[float]]]] | None = None,
        classes: str | None = None,
        values: list[str] | None = None,
        flags: str | None = None,
        without_flags: str | None = None,
        resolution: float | None = None,
    ) -> None: ...

class File:
    """An open `.esker` file, with the files that it names."""

    path: _Path
    count: int
    set_aside: int
    bounds: list[list[float]] | None
    scale: list[float]
    offset: list[float]
    crs: tuple[str | None, str | None]
    def __init__(self, path: _Path) -> None: ...
    def attributes(self) -> list[_Attribute]: ...
    def nodes(self) -> dict[str, npt.NDArray[Any]]: ...
    def query(
        self, filter: Filter, columns: list[int] | None = None, threads: int = 0
    ) -> Query: ...
    def points_at(
        self, places: npt.NDArray[np.uint32], columns: list[int] | None = None, threads: int = 0
    ) -> tuple[list[_Attribute], list[npt.NDArray[Any]]]: ...

class Query:
    """Points that are being read."""

    def attributes(self) -> list[_Attribute]: ...
    def read(
        self, points: int | None = None, progress: _Progress = None
    ) -> list[npt.NDArray[Any]] | None: ...

def build(
    inputs: list[str],
    out: str,
    options: dict[str, Any],
    threads: int = 0,
    progress: _Progress = None,
) -> str: ...
def build_arrays(
    coordinates: _Bytes,
    are_steps: bool,
    columns: list[tuple[str, str, float, float, str, _Bytes]],
    grid: list[list[float]] | None,
    out: str,
    options: dict[str, Any],
    threads: int = 0,
    progress: _Progress = None,
) -> str: ...
def job_plan(
    inputs: list[_Path],
    to: _Path,
    options: dict[str, Any],
    jobs: int | None = None,
    measure: bool = False,
    threads: int = 0,
    progress: _Progress = None,
) -> str: ...
def job_step(
    step: str,
    to: _Path,
    index: int,
    options: dict[str, Any],
    threads: int = 0,
    progress: _Progress = None,
) -> str: ...
def job_join(
    to: _Path,
    out: _Path,
    options: dict[str, Any],
    threads: int = 0,
    progress: _Progress = None,
) -> str: ...
def job_status(to: _Path) -> str: ...
def export(
    file: str,
    out: str,
    filter: Filter,
    colour_bits: int | None = None,
    crs: str | None = None,
    overwrite: bool = False,
    threads: int = 0,
    progress: _Progress = None,
) -> str: ...
def verify(
    file: str,
    against: list[str],
    options: dict[str, Any],
    threads: int = 0,
    progress: _Progress = None,
) -> str: ...
def render(
    subject: File | list[str],
    filter: Filter | None,
    request: dict[str, Any],
    build: dict[str, Any],
    layers: tuple[bool, bool] = (False, False),
    progress: _Progress = None,
) -> tuple[
    str,
    tuple[int, int],
    _Bytes,
    npt.NDArray[np.float32],
    npt.NDArray[np.float32],
    npt.NDArray[np.uint32],
]: ...
def png(rgba: bytes, width: int, height: int) -> bytes: ...
