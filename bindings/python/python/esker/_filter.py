"""Filters of points: from what Python has for boxes, polygons and classes to the native filter."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from . import _esker

#: Numbers of a polygon in words.
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"

Ring = list[list[float]]


def native(
    *,
    bounds: Any = None,
    polygon: Any = None,
    resolution: float | None = None,
    classes: Any = None,
    values: Mapping[str, Any] | None = None,
    flags: Any = None,
    without_flags: Any = None,
) -> _esker.Filter:
    """The native filter."""
    return _esker.Filter(
        bounds=None if bounds is None else box(bounds),
        polygon=None if polygon is None else polygons(polygon),
        classes=None if classes is None else words(classes, "classes"),
        values=None if values is None else [range_of(*item) for item in values.items()],
        flags=None if flags is None else words(flags, "flags"),
        without_flags=None if without_flags is None else words(without_flags, "without_flags"),
        resolution=None if resolution is None else float(resolution),
    )


def box(bounds: Any) -> list[list[float]]:
    """Least and greatest corner of a box; one of two axes has all heights.

    >>> box(((1, 2), (3, 4)))
    [[1.0, 2.0, -inf], [3.0, 4.0, inf]]
    """
    flat = np.asarray(bounds, dtype=float).ravel()
    if flat.size == 4:
        (x0, y0), (x1, y1) = flat.reshape(2, 2).tolist()
        return [[x0, y0, -np.inf], [x1, y1, np.inf]]
    if flat.size == 6:
        return flat.reshape(2, 3).tolist()
    raise ValueError(
        f"bounds of {flat.size} numbers are no box: give ((x0, y0), (x1, y1)) or "
        "((x0, y0, z0), (x1, y1, z1))"
    )


def words(names: Any, what: str) -> str:
    """Classes or flags as words: numbers, ranges and names of ASPRS classes.

    >>> words([2, "building"], "classes")
    '2,building'
    """
    if isinstance(names, str):
        return names
    if isinstance(names, (int, np.integer)) and not isinstance(names, bool):
        return str(names)
    if isinstance(names, Iterable):
        each = [words(name, what) for name in names]
        if each:
            return ",".join(each)
    raise ValueError(f"{what} are numbers or names, such as [2, 'building'], not {names!r}")


def range_of(name: str, wanted: Any) -> str:
    """Wanted values of an attribute: one, or the least and the greatest, None where it is open.

    >>> range_of("intensity", (100, None))
    'intensity:100..'
    """
    low, high = wanted if isinstance(wanted, Sequence) else (wanted, wanted)
    ends = ["" if end is None else repr(np.asarray(end).item()) for end in (low, high)]
    return f"{name}:{ends[0]}..{ends[1]}"


def polygons(polygon: Any) -> list[list[Ring]]:
    """Polygons, each as its rings: from corners, rings, WKT, GeoJSON or shapely.

    >>> polygons([(0, 0), (4, 0), (0, 3)])
    [[[[0.0, 0.0], [4.0, 0.0], [0.0, 3.0]]]]
    >>> polygons("POLYGON ((0 0, 4 0, 0 3, 0 0))") == polygons("0,0 4,0 0,3 0,0")
    True
    """
    if isinstance(polygon, str):
        return _of_text(polygon)
    if hasattr(polygon, "__geo_interface__"):
        polygon = polygon.__geo_interface__
    if isinstance(polygon, Mapping):
        return _of_json(polygon)
    if len(polygon) and np.ndim(polygon[0][0]) == 0:
        return [[_ring(polygon)]]
    return [[_ring(ring) for ring in polygon]]


def _ring(corners: Any) -> Ring:
    ring = np.asarray(corners, dtype=float)
    if ring.ndim != 2 or ring.shape[1] not in (2, 3):
        raise ValueError("a polygon has corners of x and y, such as [(0, 0), (4, 0), (0, 3)]")
    flat: Ring = ring[:, :2].tolist()
    return flat


def _of_json(geometry: Mapping[str, Any]) -> list[list[Ring]]:
    kind = geometry.get("type")
    if kind == "Polygon":
        return [[_ring(ring) for ring in geometry["coordinates"]]]
    if kind == "MultiPolygon":
        return [[_ring(ring) for ring in rings] for rings in geometry["coordinates"]]
    if kind == "Feature":
        return _of_json(geometry["geometry"])
    inner = {"FeatureCollection": "features", "GeometryCollection": "geometries"}.get(str(kind))
    if inner is not None:
        return [rings for part in geometry[inner] for rings in _of_json(part)]
    raise ValueError(f"a polygon is a Polygon or MultiPolygon of GeoJSON, not {kind!r}")


def _of_text(text: str) -> list[list[Ring]]:
    named = re.match(
        r"\s*(?:SRID=\d+;)?\s*(MULTI)?POLYGON\s*(?:Z|M|ZM)?\s*(\(.*\))\s*$",
        text,
        re.IGNORECASE | re.DOTALL,
    )
    if named is None:
        numbers = re.split(r"[\s,;]+", text.strip())
        if len(numbers) % 2 or not all(re.fullmatch(_NUMBER, n) for n in numbers):
            raise ValueError(f"{text[:40]!r} is neither WKT of a polygon nor corners 'x,y x,y x,y'")
        return [[_ring(np.asarray(numbers, dtype=float).reshape(-1, 2))]]
    # Every innermost pair of brackets is a ring.
    body = named[2] if named[1] else f"({named[2]})"
    found = re.findall(r"\(\s*(\([^()]*\)(?:\s*,\s*\([^()]*\))*)\s*\)", body)
    if not found:
        raise ValueError(f"{text[:40]!r} is no polygon in WKT")

    def ring(corners: str) -> Ring:
        try:
            return _ring([[float(n) for n in corner.split()[:2]] for corner in corners.split(",")])
        except ValueError as error:
            raise ValueError(f"{corners[:40]!r} is no ring of a polygon in WKT") from error

    return [[ring(r) for r in re.findall(r"\(([^()]*)\)", rings)] for rings in found]
