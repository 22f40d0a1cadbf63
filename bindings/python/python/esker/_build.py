"""Builds: from scans, and from arrays."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from . import _esker
from ._names import ALIASES, PARTS, TYPES, Attribute


class Progress(NamedTuple):
    """How far long work is."""

    #: What is being done.
    phase: str
    #: Work done in this phase.
    done: int
    #: All work of this phase; None if it is not known.
    total: int | None
    #: Unit of both.
    unit: str


class Report:
    """What a call has done; its fields are attributes.

    >>> report = esker.verify("creek.esker")
    >>> report.ok, report.points
    (True, 841556)
    """

    def __init__(self, fields: dict[str, Any]) -> None:
        self.__dict__.update(fields)

    def __repr__(self) -> str:
        fields = ", ".join(f"{name}={value!r}" for name, value in self.__dict__.items())
        return f"esker.Report({fields})"

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"the report has no {name}; it has {', '.join(self.__dict__)}")

    def as_dict(self) -> dict[str, Any]:
        """The fields."""
        return dict(self.__dict__)


def report_of(text: str) -> Report:
    """The report from JSON."""
    return Report(json.loads(text))


def native_progress(progress: Callable[[Progress], Any] | None) -> Callable[..., Any] | None:
    """What the native part calls."""
    if progress is None:
        return None
    return lambda phase, done, total, unit: progress(Progress(phase, done, total, unit))


def build(
    inputs: Any,
    out: str | os.PathLike[str],
    *,
    scale: Any = None,
    offset: Any = None,
    memory: str | int | None = None,
    scratch: str | os.PathLike[str] | None = None,
    normals: str | None = None,
    colour_bits: int | None = None,
    compress: str | None = None,
    crs: str | None = None,
    unit: str | None = None,
    allow_loss: bool = False,
    threads: int = 0,
    progress: Callable[[Progress], Any] | None = None,
    **options: Any,
) -> Report:
    """Builds an ``.esker`` file from scans or from arrays, and proves that no point was lost.

    Args:
        inputs: A scan, a folder of scans, a list of these, or arrays: a dict of columns, a
            structured array, or :class:`Points`. Coordinates of arrays are ``xyz`` (N x 3), or
            ``x``, ``y`` and ``z``, or the whole steps ``X``, ``Y`` and ``Z`` of a grid, which
            then needs ``scale`` and ``offset``. Other columns are attributes of their own type.
            Names are Esker's, laspy's or PDAL's; ``rgb`` and ``normals`` (N x 3) are split.
        out: The file; an ``.esker`` file that is there is replaced.
        scale: Length of a step of the grid that coordinates of arrays are rounded to, one number
            or three; chosen by the coordinates by default.
        offset: Coordinate of step 0; 0 by default, or near the points if they are far from 0.
        memory: Memory that the build may use, such as ``"4GiB"``; half of the machine's by default.
        scratch: Folder for what does not fit in memory.
        normals: ``"keep"`` (default), ``"fast"``, ``"estimate"`` or ``"none"``.
        colour_bits: Contents of 16-bit colours, 8 or 16 bits; detected by default.
        compress: ``"fast"`` (default), ``"small"`` or ``"none"``.
        crs: Coordinate reference system of inputs that state none: ``"EPSG:2154"`` or WKT.
        unit: Unit of inputs that state none: metre, foot, us-foot or degree.
        allow_loss: Whether points that cannot be kept, such as those without coordinates, are
            counted in the report; otherwise they are a :class:`LossError`.
        threads: Number of threads; 0 for one a core.
        progress: Is called with :class:`Progress` several times a second; what it raises stops the
            build.
        options: ``node_capacity``, ``columns``, ``skip_lines``, ``ignore_crs``,
            ``sharp_features``, ``tangents``, ``compact``, ``apply_viewpoint``,
            ``allow_rounding``, as for ``esker build``.

    Returns:
        Counts, the hash of all points, times, sizes, the greatest rounding of a coordinate, notes.

    >>> xyz = np.random.default_rng(1).uniform(0, 100, (10_000, 3))
    >>> report = esker.build({"xyz": xyz, "intensity": np.arange(10_000)}, "c.esker", scale=0.001)
    >>> report.points_out, report.rounding_error_max <= 0.0005001
    (10000, True)
    >>> xyz[3, 2] = np.nan
    >>> esker.build({"xyz": xyz}, "c.esker")
    Traceback (most recent call last):
    esker.EskerError: arrays: row 3 is at [..., NaN], which is no place; ...
    """
    given = {
        "memory": memory,
        "scratch": None if scratch is None else os.fspath(scratch),
        "normals": normals,
        "colour_bits": colour_bits,
        "compress": compress,
        "crs": crs,
        "unit": unit,
        "allow_loss": allow_loss,
        **options,
    }
    told = native_progress(progress)
    columns = _columns(inputs)
    if columns is None:
        if scale is not None or offset is not None:
            raise ValueError("scale and offset are those of arrays; scans have their own")
        paths = [inputs] if isinstance(inputs, (str, os.PathLike)) else list(inputs)
        names = [os.fspath(path) for path in paths]
        return report_of(_esker.build(names, os.fspath(out), given, threads, told))
    if hasattr(inputs, "scale") and hasattr(inputs, "offset"):
        scale = inputs.scale if scale is None else scale
        offset = inputs.offset if offset is None else offset
        if crs is None and is_wkt(inputs.crs):
            given["crs"] = inputs.crs
    coordinates, are_steps, grid = _coordinates(columns, scale, offset)
    attributes = _attributes(columns)
    for name, values in attributes.items():
        if values.shape != (len(coordinates),):
            raise ValueError(
                f"{name} has the shape {values.shape}, and there are {len(coordinates)} points"
            )
    known = {a.name: a for a in getattr(inputs, "attributes", [])}
    native = [
        (name, _type_name(values), *_meaning(known.get(name)), _bytes(values))
        for name, values in attributes.items()
    ]
    report = _esker.build_arrays(
        _bytes(coordinates), are_steps, native, grid, os.fspath(out), given, threads, told
    )
    return report_of(report)


#: Beginnings of coordinate reference systems in WKT.
_WKT = ("PROJ", "GEOG", "GEOD", "COMPD", "COMPOUND", "BOUND", "LOCAL", "ENG")


def is_wkt(crs: str | None) -> bool:
    """Whether a coordinate reference system is in WKT."""
    return crs is not None and crs.lstrip().upper().startswith(_WKT)


def _columns(inputs: Any) -> dict[str, np.ndarray] | None:
    """Columns by name; None if the inputs are scans."""
    if isinstance(inputs, np.ndarray) and inputs.dtype.names:
        return {name: inputs[name] for name in inputs.dtype.names}
    if isinstance(inputs, np.ndarray):
        raise TypeError("an array needs named columns: give {'xyz': array}, or a structured array")
    if isinstance(inputs, Mapping):
        # Points have X, Y, Z and their attributes.
        return {str(name): np.asarray(inputs[name]) for name in inputs}
    return None


def _coordinates(
    columns: dict[str, np.ndarray], scale: Any, offset: Any
) -> tuple[np.ndarray, bool, list[list[float]] | None]:
    """Takes the coordinates from the columns: a row a point, whether they are steps, the grid."""
    of_scale = None if scale is None else np.broadcast_to(np.asarray(scale, float), 3).tolist()
    of_offset = None if offset is None else np.broadcast_to(np.asarray(offset, float), 3).tolist()
    if of_scale is not None and not all(s > 0 and np.isfinite(s) for s in of_scale):
        raise ValueError(f"scale: {scale} is no length of a step; it must be above 0")
    steps = [columns.pop(name, None) for name in ("X", "Y", "Z")]
    axes = [columns.pop(name, None) for name in ("x", "y", "z")]
    xyz = columns.pop("xyz", None)
    if xyz is None and axes[0] is not None:
        xyz = _stacked(axes, "x, y and z")
    elif xyz is None and steps[0] is not None and steps[0].dtype.kind == "f":
        xyz, steps = _stacked(steps, "X, Y and Z"), [None] * 3
    if xyz is None and steps[0] is None:
        raise ValueError("coordinates are missing: give xyz (N x 3), or x, y, z, or X, Y, Z")
    if xyz is None:
        whole = _stacked(steps, "X, Y and Z")
        if whole.dtype.kind not in "iu":
            raise TypeError("X, Y and Z are whole numbers; coordinates are called x, y and z")
        if of_scale is None or of_offset is None:
            raise ValueError("X, Y and Z are steps of a grid: give its scale and offset")
        if not _fits(whole, np.dtype("i4")):
            raise ValueError("X, Y and Z are steps of 32 bits, and some are larger")
        return np.ascontiguousarray(whole, dtype="<i4"), True, [of_scale, of_offset]
    if xyz.ndim != 2 or xyz.shape[1] != 3 or xyz.dtype.kind not in "fiu":
        raise ValueError(f"xyz is N x 3 numbers, and not {xyz.shape} of {xyz.dtype}")
    xyz = np.ascontiguousarray(xyz, dtype="<f8")
    if of_scale is None:
        if of_offset is not None:
            raise ValueError("an offset needs the scale of its grid")
        return xyz, False, None
    if of_offset is None:
        of_offset = _offset(xyz, of_scale)
    return xyz, False, [of_scale, of_offset]


def _offset(xyz: np.ndarray, scale: list[float]) -> list[float]:
    """An offset from which all points are steps of 32 bits: 0 if that is one."""
    offset = [0.0, 0.0, 0.0]
    for axis in range(3 if len(xyz) else 0):
        finite = xyz[:, axis][np.isfinite(xyz[:, axis])]
        if finite.size and np.abs(finite).max() / scale[axis] >= 2**31 - 1:
            offset[axis] = float(np.floor((finite.min() + finite.max()) / 2))
    return offset


def _stacked(axes: list[np.ndarray | None], names: str) -> np.ndarray:
    present = [axis for axis in axes if axis is not None]
    if len(present) < 3 or len({axis.shape for axis in present}) > 1:
        raise ValueError(f"coordinates need {names}, all of the same length")
    return np.stack(present, axis=-1)


def _attributes(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Columns of other names as attributes of Esker's names and types, packed where it packs."""
    found: dict[str, np.ndarray] = {}
    parts: dict[str, dict[str, np.ndarray]] = {}
    for name, values in columns.items():
        known = ALIASES.get(name, name)
        if values.ndim == 2 and values.shape[1] == 3 and known in ("rgb", "normals"):
            names = ("red", "green", "blue") if known == "rgb" else ("nx", "ny", "nz")
            for axis, each in enumerate(names):
                column = values[:, axis].astype("f4") if known == "normals" else values[:, axis]
                found[each] = _typed(each, column)
        elif known in PARTS:
            parts.setdefault(PARTS[known].of, {})[known] = values
        else:
            found[known] = _typed(known, values)
    for packed, of in parts.items():
        if packed in found:
            raise ValueError(f"{packed} and its parts {', '.join(of)} exclude each other")
        found[packed] = _packed(of)
    return found


def _packed(parts: dict[str, np.ndarray]) -> np.ndarray:
    """The column that holds these parts."""
    packed: np.ndarray | None = None
    for name, values in parts.items():
        part = PARTS[name]
        most = (1 << part.bits) - 1
        values = np.asarray(values)
        if values.dtype.kind not in "iub" or (
            values.size and not 0 <= values.min() <= values.max() <= most
        ):
            raise ValueError(f"{name} holds whole numbers from 0 to {most}")
        bits = values.astype("u1") << part.shift
        packed = bits if packed is None else packed | bits
    assert packed is not None
    return packed


def _typed(name: str, values: np.ndarray) -> np.ndarray:
    """Values in the type that LAS has for them if all fit, otherwise in their own."""
    if values.dtype.kind == "b":
        values = values.view("u1")
    if (
        values.dtype.kind not in "iuf"
        or values.dtype.itemsize not in (1, 2, 4, 8)
        or values.dtype == "f2"
    ):
        raise TypeError(f"{name}: values of {values.dtype} are not kept; convert them to numbers")
    own = values.dtype.newbyteorder("=")
    if values.dtype.kind in "iu" and own not in [np.dtype(t) for t in TYPES.get(name, ())]:
        for dtype in TYPES.get(name, ()):
            if _fits(values, np.dtype(dtype)):
                return values.astype(dtype)
    return values


def _fits(values: np.ndarray, dtype: np.dtype) -> bool:
    limits = np.iinfo(dtype)
    return not values.size or (values.min() >= limits.min and values.max() <= limits.max)


def _meaning(attribute: Attribute | None) -> tuple[float, float, str]:
    """Scale, offset and description of an attribute."""
    if attribute is None:
        return 1.0, 0.0, ""
    return attribute.scale, attribute.offset, attribute.description


def _type_name(values: np.ndarray) -> str:
    return f"{values.dtype.kind}{values.dtype.itemsize * 8}"


def _bytes(values: np.ndarray) -> np.ndarray:
    """The values as little-endian bytes, without a copy where they are that already."""
    little = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<"))
    return little.reshape(-1).view("u1")
