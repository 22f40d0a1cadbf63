"""Points as the types of other packages, which need not be installed."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

import numpy as np

from ._build import is_wkt

if TYPE_CHECKING:
    from ._points import Points

#: Fields of LAS beside bit fields and colours.
_FIELDS = ("intensity", "classification", "user_data", "point_source_id", "gps_time")


def _package(name: str, to: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ImportError(f"{to} needs the package {name}: pip install {name}") from error


def to_laspy(points: Points) -> Any:
    """See :meth:`Points.to_laspy`."""
    laspy = _package("laspy", "to_laspy")
    stored = {a.name: a for a in points.attributes}
    is_old = "scan_angle_rank" in stored and "scan_angle" not in stored
    has_colour, has_nir = "red" in stored, "nir" in stored
    is_old = is_old and not has_nir
    if is_old:
        flags = points["flags"] if "flags" in stored else np.zeros(0, "u1")
        classes = points["classification"] if "classification" in stored else np.zeros(0, "u1")
        returns = points["returns"] if "returns" in stored else np.zeros(0, "u1")
        # Formats 0 to 5 have neither channels nor an overlap, and smaller numbers.
        small = returns.size == 0 or not np.any(returns & 0x88)
        is_old = small and not np.any(flags & 0x38) and not np.any(classes > 31)
    if is_old:
        format_id = (1 if "gps_time" in stored else 0) + (2 if has_colour else 0)
    else:
        format_id = 8 if has_nir else 7 if has_colour else 6
    header = laspy.LasHeader(point_format=format_id, version="1.4")
    header.scales, header.offsets = points.scale, points.offset
    if is_wkt(points.crs):
        header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(points.crs))
        header.global_encoding.wkt = True
    known = set(laspy.PointFormat(format_id).dimension_names)
    extra = [a for a in points.attributes if not _is_field(a, known)]
    for a in extra:
        scaled = (a.scale, a.offset) != (1.0, 0.0)
        header.add_extra_dim(
            laspy.ExtraBytesParams(
                name=a.name,
                type=a.dtype,
                description=a.description[:31],
                scales=np.array([a.scale]) if scaled else None,
                offsets=np.array([a.offset]) if scaled else None,
            )
        )
    record = laspy.ScaleAwarePointRecord.zeros(len(points), header=header)
    las = laspy.LasData(header, record)
    las.X, las.Y, las.Z = points.X, points.Y, points.Z
    for name in points:
        if name in "XYZ":
            continue
        column = points[name]
        if any(a.name == name for a in extra):
            # Stored values: laspy would scale what is assigned by name.
            las.points.array[name] = column
        elif name == "scan_angle_rank" and not is_old:
            las.scan_angle = np.round(column.astype(float) / 0.006).astype("i2")
        elif name in known:
            las[name] = column
    las.update_header()
    return las


def _is_field(attribute: Any, known: set[str]) -> bool:
    """Whether a field of the point format holds the values of an attribute."""
    name, dtype = attribute.name, attribute.dtype
    if name in ("returns", "flags"):
        return bool(dtype == np.uint8)
    if name in ("red", "green", "blue", "nir"):
        return name in known and dtype in (np.uint8, np.uint16)
    if name == "scan_angle_rank":
        return bool(dtype == np.int8)
    if name == "scan_angle":
        return name in known and dtype == np.int16
    types = {"intensity": "u2", "point_source_id": "u2", "gps_time": "f8"}
    return name in _FIELDS and name in known and dtype == np.dtype(types.get(name, "u1"))


def to_open3d(points: Points) -> Any:
    """See :meth:`Points.to_open3d`."""
    open3d = _package("open3d", "to_open3d")
    cloud = open3d.geometry.PointCloud()
    cloud.points = open3d.utility.Vector3dVector(points.xyz)
    if all(name in points for name in ("red", "green", "blue")):
        colours = np.stack([points[name] for name in ("red", "green", "blue")], axis=1)
        # Colours of 16 bits may hold values of 8.
        is_wide = colours.dtype.itemsize > 1 and (colours.max(initial=0) > 255)
        full = 65535.0 if is_wide else 255.0
        cloud.colors = open3d.utility.Vector3dVector(colours / full)
    if all(name in points for name in ("nx", "ny", "nz")):
        normals = np.stack([points[name] for name in ("nx", "ny", "nz")], axis=1)
        cloud.normals = open3d.utility.Vector3dVector(normals.astype(float))
    return cloud


def to_arrow(points: Points) -> Any:
    """See :meth:`Points.to_arrow`."""
    arrow = _package("pyarrow", "to_arrow")
    metadata = {"scale": points.scale.tolist(), "offset": points.offset.tolist()}
    if points.crs:
        metadata["crs"] = points.crs
    table = arrow.table({name: arrow.array(points[name]) for name in points})
    return table.replace_schema_metadata({key: str(value) for key, value in metadata.items()})
