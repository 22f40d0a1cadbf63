"""Names of attributes: Esker's own, those of laspy, and those of PDAL.

A file keeps the bit fields of LAS 1.4 packed, in ``returns`` and ``flags``. They are unpacked where
they are asked for by the names of their parts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Attribute(NamedTuple):
    """An attribute of the points of a file, as it is stored."""

    #: Name; the key of the column.
    name: str
    #: Type of the stored values.
    dtype: np.dtype
    #: Values that the attribute stands for are stored ones times ``scale`` plus ``offset``.
    scale: float
    #: See ``scale``.
    offset: float
    #: Description in the scan; empty if there is none.
    description: str


class Part(NamedTuple):
    """Bits of a packed attribute."""

    of: str
    shift: int
    bits: int
    dtype: str


#: Parts of packed attributes by laspy's names, in laspy's order.
PARTS = {
    "return_number": Part("returns", 0, 4, "u1"),
    "number_of_returns": Part("returns", 4, 4, "u1"),
    "synthetic": Part("flags", 0, 1, "u1"),
    "key_point": Part("flags", 1, 1, "u1"),
    "withheld": Part("flags", 2, 1, "u1"),
    "overlap": Part("flags", 3, 1, "u1"),
    "scanner_channel": Part("flags", 4, 2, "u1"),
    "scan_direction_flag": Part("flags", 6, 1, "u1"),
    "edge_of_flight_line": Part("flags", 7, 1, "u1"),
}

#: PDAL's names of Esker's attributes and their parts.
PDAL = {
    "intensity": "Intensity",
    "return_number": "ReturnNumber",
    "number_of_returns": "NumberOfReturns",
    "synthetic": "Synthetic",
    "key_point": "KeyPoint",
    "withheld": "Withheld",
    "overlap": "Overlap",
    "scanner_channel": "ScanChannel",
    "scan_direction_flag": "ScanDirectionFlag",
    "edge_of_flight_line": "EdgeOfFlightLine",
    "classification": "Classification",
    "user_data": "UserData",
    "scan_angle": "ScanAngleRank",
    "scan_angle_rank": "ScanAngleRank",
    "point_source_id": "PointSourceId",
    "gps_time": "GpsTime",
    "red": "Red",
    "green": "Green",
    "blue": "Blue",
    "nir": "Infrared",
    "nx": "NormalX",
    "ny": "NormalY",
    "nz": "NormalZ",
}

#: Esker's names for PDAL's, and for laspy's that differ.
ALIASES = {theirs: ours for ours, theirs in PDAL.items() if ours != "scan_angle_rank"} | {
    "raw_classification": "classification",
}

#: Types that LAS has for attributes; whole numbers of other types that fit are stored as these.
TYPES = {
    "intensity": ("u2",),
    "returns": ("u1",),
    "flags": ("u1",),
    "classification": ("u1",),
    "user_data": ("u1",),
    "scan_angle": ("i2",),
    "scan_angle_rank": ("i1",),
    "point_source_id": ("u2",),
    "red": ("u1", "u2"),
    "green": ("u1", "u2"),
    "blue": ("u1", "u2"),
    "nir": ("u2",),
}

#: Step of the scan angles of LAS point formats 6 to 10, degrees.
SCAN_ANGLE_STEP = 0.006


def described(attributes: list[tuple[str, str, float, float, str]]) -> list[Attribute]:
    """Attributes from their native form.

    The second of two of one name, and those with the name of coordinates or of a part of a packed
    attribute, get that of their type.
    """
    packed = {name for name, dtype, *_ in attributes if np.dtype(dtype) == np.dtype("u1")}
    taken = {
        *("X", "Y", "Z", "x", "y", "z", "xyz"),
        *(n for n, p in PARTS.items() if p.of in packed),
    }
    found: list[Attribute] = []
    for name, dtype, scale, offset, description in attributes:
        if name in taken or any(a.name == name for a in found):
            name = f"{name}:{np.dtype(dtype).name}"
        found.append(Attribute(name, np.dtype(dtype), scale, offset, description))
    return found


def unpacked(attributes: list[Attribute]) -> dict[str, tuple[str, np.dtype]]:
    """Names of all columns with packed ones in parts: the stored attribute, and the type."""
    columns: dict[str, tuple[str, np.dtype]] = {}
    for attribute in attributes:
        is_byte = attribute.dtype == np.dtype("u1")
        parts = [n for n, p in PARTS.items() if p.of == attribute.name and is_byte]
        for name in parts:
            columns[name] = (attribute.name, np.dtype(PARTS[name].dtype))
        if not parts:
            columns[attribute.name] = (attribute.name, attribute.dtype)
    return columns


def part_of(name: str, packed: np.ndarray) -> np.ndarray:
    """The part ``name`` of a packed column."""
    part = PARTS[name]
    return (packed >> part.shift) & ((1 << part.bits) - 1)
