"""Points as columns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ._names import ALIASES, PARTS, PDAL, SCAN_ANGLE_STEP, Attribute, part_of, unpacked


class Points(Mapping[str, np.ndarray]):
    """Points of a query: a mapping from names to NumPy columns.

    Columns are as stored, and are not copied on their way from the file: ``X``, ``Y`` and ``Z`` are
    whole steps of the file's grid (``int32``, those of the LAS files that it was built from), any
    attribute has its own type. Parts of packed attributes, such as ``return_number``, are unpacked
    when they are asked for. ``x``, ``y``, ``z`` and :attr:`xyz` are coordinates in ``float64``.

    >>> points = esker.open("creek.esker").query(columns=["returns", "gps_time"])
    >>> points
    <esker.Points: 841556 points, X, Y, Z, gps_time, return_number, number_of_returns>
    >>> int(points["return_number"].max()), points["gps_time"].dtype
    (5, dtype('float64'))
    >>> bool(np.all(points.X * points.scale[0] + points.offset[0] == points.xyz[:, 0]))
    True
    """

    def __init__(
        self,
        steps: tuple[np.ndarray, np.ndarray, np.ndarray],
        columns: dict[str, np.ndarray],
        attributes: list[Attribute],
        scale: np.ndarray,
        offset: np.ndarray,
        crs: str | None = None,
    ) -> None:
        #: Whole steps along each axis.
        self.X, self.Y, self.Z = steps
        #: Length of a step on each axis.
        self.scale = scale
        #: Coordinate of step 0 on each axis.
        self.offset = offset
        #: Coordinate reference system of the file.
        self.crs = crs
        #: The attributes as stored.
        self.attributes = attributes
        self._columns = columns
        self._unpacked = unpacked(attributes)

    def __len__(self) -> int:
        """Number of points."""
        return len(self.X)

    def __iter__(self) -> Iterator[str]:
        yield from ("X", "Y", "Z")
        yield from self._unpacked

    def __repr__(self) -> str:
        return f"<esker.Points: {len(self)} points, {', '.join(self)}>"

    def __eq__(self, other: object) -> bool:
        return self is other

    __hash__ = object.__hash__

    def __getitem__(self, name: str) -> np.ndarray:
        """The column called ``name``, also by PDAL's name.

        >>> points["colour"]
        Traceback (most recent call last):
        KeyError: "there is no column 'colour'; there are X, Y, Z, gps_time, ..."
        """
        if name in ("X", "Y", "Z"):
            return {"X": self.X, "Y": self.Y, "Z": self.Z}[name]
        if name in ("x", "y", "z"):
            return self._axis("xyz".index(name))
        for known in (name, ALIASES.get(name, name)):
            if known in self._columns:
                return self._columns[known]
            if known in PARTS and PARTS[known].of in self._columns:
                return part_of(known, self._columns[PARTS[known].of])
        raise KeyError(f"there is no column {name!r}; there are {', '.join(self)}")

    def __contains__(self, name: object) -> bool:
        try:
            return self[name] is not None  # type: ignore[index]
        except KeyError:
            return False

    def _axis(self, axis: int, out: np.ndarray | None = None) -> np.ndarray:
        steps = (self.X, self.Y, self.Z)[axis]
        if out is None:
            out = np.empty(len(self))
        np.multiply(steps, self.scale[axis], out=out)
        np.add(out, self.offset[axis], out=out)
        return out

    @property
    def x(self) -> np.ndarray:
        """Coordinates along x."""
        return self._axis(0)

    @property
    def y(self) -> np.ndarray:
        """Coordinates along y."""
        return self._axis(1)

    @property
    def z(self) -> np.ndarray:
        """Coordinates along z."""
        return self._axis(2)

    @property
    def xyz(self) -> np.ndarray:
        """Coordinates, a row a point; computed anew each time."""
        out = np.empty((len(self), 3))
        for axis in range(3):
            self._axis(axis, out[:, axis])
        return out

    def scaled(self, name: str) -> np.ndarray:
        """What the values of a column stand for: stored values times scale plus offset.

        Extra bytes of LAS have a scale and an offset; scan angles of LAS point formats 6 to 10 are
        stored in steps of 0.006 degrees.

        >>> points.scaled("gps_time").dtype
        dtype('float64')
        """
        values = self[name]
        for attribute in self.attributes:
            if attribute.name == ALIASES.get(name, name):
                scale, offset = attribute.scale, attribute.offset
                is_angle = attribute.name == "scan_angle" and attribute.dtype == np.int16
                if is_angle and scale == 1.0:
                    scale = SCAN_ANGLE_STEP
                return values * scale + offset
        return values.astype(float)

    def array(self, names: str = "laspy") -> np.ndarray:
        """All columns as one structured array, with the names of ``"laspy"`` or of ``"pdal"``.

        With PDAL's names, ``X``, ``Y`` and ``Z`` are coordinates in ``float64``, as in PDAL.

        >>> points.array().dtype.names
        ('X', 'Y', 'Z', 'gps_time', 'return_number', 'number_of_returns')
        >>> points.array("pdal").dtype.names
        ('X', 'Y', 'Z', 'GpsTime', 'ReturnNumber', 'NumberOfReturns')
        """
        dtype = array_dtype(self.attributes, names)
        out = np.empty(len(self), dtype=dtype)
        for axis, name in enumerate("XYZ"):
            out[name] = self._axis(axis) if names == "pdal" else self[name]
        for own, theirs in zip(self._unpacked, (dtype.names or ())[3:]):
            out[theirs] = self[own]
        return out

    def to_laspy(self) -> Any:
        """The points as ``laspy.LasData``, in the point format that holds their attributes.

        Attributes that LAS has no field for become extra bytes. A coordinate reference system in
        WKT is kept.
        """
        from ._convert import to_laspy

        return to_laspy(self)

    def to_open3d(self) -> Any:
        """Coordinates, colours and normals as ``open3d.geometry.PointCloud``."""
        from ._convert import to_open3d

        return to_open3d(self)

    def to_arrow(self) -> Any:
        """The columns as ``pyarrow.Table``, without copies where nothing is unpacked."""
        from ._convert import to_arrow

        return to_arrow(self)


def array_dtype(attributes: list[Attribute], names: str = "laspy") -> np.dtype:
    """Type of structured arrays of points with these attributes."""
    if names not in ("laspy", "pdal"):
        raise ValueError(f"there are names of laspy and of pdal, not of {names!r}")
    axis = "<f8" if names == "pdal" else "<i4"
    fields: list[tuple[str, Any]] = [(name, axis) for name in "XYZ"]
    for own, (_, dtype) in unpacked(attributes).items():
        name = PDAL.get(own, own) if names == "pdal" else own
        # Two of Esker's attributes may have one name in PDAL.
        taken = [field for field, _ in fields]
        fields.append((own if name in taken else name, dtype))
    return np.dtype(fields)
