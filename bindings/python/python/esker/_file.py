"""Files: what they hold, queries of their points, exports and verification."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from typing import Any

import numpy as np

from . import _esker
from ._build import Progress, Report, native_progress, report_of
from ._filter import native
from ._names import ALIASES, PARTS, Attribute, described
from ._points import Points, array_dtype

#: What a path is.
Path = str | os.PathLike[str]
#: Node of an empty pixel in an image of indices.
NO_NODE = 2**32 - 1
#: What is called with the progress of long work.
OnProgress = Callable[[Progress], Any] | None


class File:
    """An open ``.esker`` file, with the files that it names; see :func:`open`."""

    def __init__(self, path: Path) -> None:
        self._native = _esker.File(os.fspath(path))

    def __repr__(self) -> str:
        return f"<esker.File {str(self.path)!r}: {self.count} points>"

    def __len__(self) -> int:
        """Number of points."""
        return self.count

    def __enter__(self) -> File:
        return self

    def __exit__(self, *_: object) -> None:
        """Files hold nothing that has to be closed: they are closed when nothing uses them."""

    @property
    def path(self) -> str:
        """Path or address by which it was opened."""
        return str(self._native.path)

    @cached_property
    def count(self) -> int:
        """Number of points.

        >>> esker.open("creek.esker").count
        841556
        """
        return self._native.count

    @cached_property
    def set_aside(self) -> int:
        """Number of points far from nearly all others that the file keeps beside them.

        Queries do not return these; exports without a filter write them.
        """
        return self._native.set_aside

    @cached_property
    def bounds(self) -> np.ndarray | None:
        """Least and greatest coordinates, an array of 2 x 3; None without points."""
        bounds = self._native.bounds
        return None if bounds is None else np.array(bounds)

    @cached_property
    def crs(self) -> str | None:
        """Coordinate reference system, as the first scan that has one writes it; mostly WKT."""
        return self._native.crs[0]

    @cached_property
    def unit(self) -> str | None:
        """Unit of length of the coordinates, if the scans state it."""
        return self._native.crs[1]

    @cached_property
    def scale(self) -> np.ndarray:
        """Length of a step of ``X``, ``Y`` and ``Z``."""
        return np.array(self._native.scale)

    @cached_property
    def offset(self) -> np.ndarray:
        """Coordinate of step 0 of ``X``, ``Y`` and ``Z``."""
        return np.array(self._native.offset)

    @cached_property
    def attributes(self) -> list[Attribute]:
        """The attributes of the points as stored: name, type, scale, offset, description."""
        return list(self._known.values())

    @cached_property
    def _known(self) -> dict[tuple[str, str], Attribute]:
        """The attributes by Esker's name and type."""
        native = self._native.attributes()
        return dict(zip(((name, dtype) for name, dtype, *_ in native), described(native)))

    def _named(self, native: list[Any]) -> list[Attribute]:
        """Attributes of a query by the names that they have in the file."""
        return [self._known[name, dtype] for name, dtype, *_ in native]

    @cached_property
    def dtype(self) -> np.dtype:
        """Type of :meth:`Points.array` with all columns.

        >>> esker.open("creek.esker").dtype.names[:5]
        ('X', 'Y', 'Z', 'classification', 'synthetic')
        """
        return array_dtype(self.attributes)

    @cached_property
    def nodes(self) -> np.ndarray:
        """The nodes of the octree as a record array.

        ``level`` is the depth, 0 for the root; ``bounds`` the box of the node's own points; a node
        adds its ``count`` points to those of its ancestors, with which they are about ``spacing``
        apart; ``offset`` and ``bytes`` are the place of its page; ``parent`` is an index, that of
        no node for a root.

        >>> nodes = esker.open("creek.esker").nodes
        >>> int(nodes["count"].sum())
        841556
        >>> nodes.dtype.names
        ('level', 'bounds', 'count', 'spacing', 'offset', 'bytes', 'parent')
        """
        columns = self._native.nodes()
        dtype = [
            ("level", "<u2"),
            ("bounds", "<f8", (2, 3)),
            ("count", "<u8"),
            ("spacing", "<f8"),
            ("offset", "<u8"),
            ("bytes", "<u4"),
            ("parent", "<u4"),
        ]
        nodes = np.empty(len(columns["level"]), dtype=dtype)
        for name in ("level", "count", "spacing", "offset", "bytes", "parent"):
            nodes[name] = columns[name]
        nodes["bounds"][:, 0] = columns["min"].reshape(-1, 3)
        nodes["bounds"][:, 1] = columns["max"].reshape(-1, 3)
        return nodes

    def query(
        self,
        bounds: Any = None,
        polygon: Any = None,
        resolution: float | None = None,
        classes: Any = None,
        columns: Iterable[str] | None = None,
        *,
        values: Mapping[str, Any] | None = None,
        flags: Any = None,
        without_flags: Any = None,
        threads: int = 0,
        progress: OnProgress = None,
    ) -> Points:
        """The points that meet all of these conditions.

        Args:
            bounds: A box, ``((x0, y0), (x1, y1))`` with all heights, or with z; its faces count.
            polygon: Corners in plan view, or their rings (even-odd), WKT, GeoJSON, or a shape of
                shapely; edges count.
            resolution: An even sample whose points are at most about so far apart, in the file's
                unit; nodes that are finer are not read.
            classes: ASPRS classes, numbers or names: ``2``, ``"ground"``, ``[2, "building"]``.
            columns: Attributes to read besides coordinates; all by default. Others are not read
                from the disk.
            values: Values of attributes, ``{"intensity": (100, None)}``, as :meth:`Points.scaled`
                gives them; ends count.
            flags: Points with any of these flags, such as ``"withheld"``.
            without_flags: Points with none of these flags.
            threads: Number of threads; 0 for one a core.
            progress: Is called with :class:`Progress` several times a second.

        >>> file = esker.open("creek.esker")
        >>> low, high = file.bounds
        >>> middle = (low + high) / 2
        >>> len(file.query(bounds=(low[:2], middle[:2]), columns=[])) < file.count
        True
        >>> sample = file.query(classes=["ground", 5], resolution=4.0)
        >>> 0 < len(sample) < file.count / 2
        True
        """
        chosen = native(
            bounds=bounds,
            polygon=polygon,
            resolution=resolution,
            classes=classes,
            values=values,
            flags=flags,
            without_flags=without_flags,
        )
        query = _Query(self, chosen, columns, threads, progress)
        found = query.read(None)
        return query.none() if found is None else found

    def chunks(
        self,
        n: int = 1_000_000,
        bounds: Any = None,
        polygon: Any = None,
        resolution: float | None = None,
        classes: Any = None,
        columns: Iterable[str] | None = None,
        *,
        values: Mapping[str, Any] | None = None,
        flags: Any = None,
        without_flags: Any = None,
        threads: int = 0,
        progress: OnProgress = None,
    ) -> Iterator[Points]:
        """The points of :meth:`query`, ``n`` at a time and fewer at the end, in bounded memory.

        >>> file = esker.open("creek.esker")
        >>> [len(points) for points in file.chunks(300_000, columns=[])]
        [300000, 300000, 241556]
        """
        if int(n) < 1:
            raise ValueError(f"chunks of {n} points never end; take at least 1")
        chosen = native(
            bounds=bounds,
            polygon=polygon,
            resolution=resolution,
            classes=classes,
            values=values,
            flags=flags,
            without_flags=without_flags,
        )
        query = _Query(self, chosen, columns, threads, progress)
        return iter(lambda: query.read(int(n)), None)

    def at(self, index: np.ndarray, columns: Iterable[str] | None = None) -> Points:
        """The points of an image of indices (:func:`render`), row by row, without empty pixels.

        ``index`` is any array with the fields ``node`` and ``point``.

        >>> file = esker.open("creek.esker")
        >>> images = file.render(size=(64, 48), outputs=["index"], backend="cpu")
        >>> shown = images["index"][images["index"]["node"] != esker.NO_NODE]
        >>> len(file.at(shown, columns=["intensity"])) == len(shown)
        True
        """
        flat = np.asarray(index).ravel()
        flat = flat[flat["node"] != NO_NODE]
        places = np.stack([flat["node"], flat["point"]], axis=1).astype("u4").ravel()
        stored = _stored(self, columns)
        raw, found = self._native.points_at(places, stored)
        return _points(self, self._named(raw), found)

    def export(self, out: Path, **options: Any) -> Report:
        """Writes the points, or some of them, as a scan: see :func:`export`."""
        return export(self.path, out, **options)

    def verify(self, against: Path | Iterable[Path] = (), **options: Any) -> Report:
        """Checks every byte of the file: see :func:`verify`."""
        return verify(self.path, against, **options)

    def render(self, **options: Any) -> Any:
        """Draws the file: see :func:`render`."""
        from ._picture import render

        return render(self, **options)


class _Query:
    """A query in progress."""

    def __init__(
        self,
        file: File,
        chosen: _esker.Filter,
        columns: Iterable[str] | None,
        threads: int,
        progress: OnProgress,
    ) -> None:
        self.file = file
        self.native = file._native.query(chosen, _stored(file, columns), threads)
        self.attributes = file._named(self.native.attributes())
        self.progress = native_progress(progress)

    def read(self, n: int | None) -> Points | None:
        found = self.native.read(n, self.progress)
        return None if found is None else _points(self.file, self.attributes, found)

    def none(self) -> Points:
        """No points."""
        columns = [np.empty(0, "u1") for _ in self.attributes]
        return _points(self.file, self.attributes, [np.empty(0, "<i4") for _ in range(3)] + columns)


def _points(file: File, attributes: list[Attribute], found: list[np.ndarray]) -> Points:
    """Points from the native arrays: steps, and the bytes of each column."""
    columns = {a.name: raw.view(a.dtype) for a, raw in zip(attributes, found[3:])}
    steps = (found[0], found[1], found[2])
    return Points(steps, columns, attributes, file.scale, file.offset, file.crs)


def _stored(file: File, columns: Iterable[str] | None) -> list[int] | None:
    """Indices of the attributes that have columns; None for all."""
    if columns is None:
        return None
    index = {a.name: i for i, a in enumerate(file.attributes)}
    found = []
    for name in [columns] if isinstance(columns, str) else columns:
        if name in (*"XYZ", *"xyz", "xyz"):
            continue
        known = ALIASES.get(name, name)
        packed = PARTS[known].of if known in PARTS else known
        at = next((index[each] for each in (name, known, packed) if each in index), None)
        if at is None:
            there = ", ".join(file.dtype.names or ())
            raise KeyError(f"{file.path}: has no column {name!r}; it has {there}")
        found.append(at)
    return found


def open(path: Path) -> File:
    """Opens an ``.esker`` file, and the files that it names.

    ``path`` may be an address: ``https://``, ``s3://``, ``gs://`` or ``az://``. Only what is asked
    for is read.

    >>> esker.open("creek.esker")
    <esker.File 'creek.esker': 841556 points>
    >>> esker.open("missing.esker")
    Traceback (most recent call last):
    FileNotFoundError: [Errno 2] missing.esker: cannot open it: ...
    """
    return File(path)


def export(
    file: File | Path,
    out: Path,
    *,
    bounds: Any = None,
    polygon: Any = None,
    resolution: float | None = None,
    classes: Any = None,
    values: Mapping[str, Any] | None = None,
    flags: Any = None,
    without_flags: Any = None,
    colour_bits: int | None = None,
    crs: str | None = None,
    overwrite: bool = False,
    threads: int = 0,
    progress: OnProgress = None,
) -> Report:
    """Writes a file, or the points that meet conditions (:meth:`File.query`), as a scan.

    The format follows from the name: LAS, LAZ, COPC (``.copc.laz``), PLY or text. A file that is
    there is replaced only with ``overwrite``.

    >>> report = esker.export("creek.esker", "ground.laz", classes="ground", overwrite=True)
    >>> report.points_out < report.points_in
    True
    """
    chosen = native(
        bounds=bounds,
        polygon=polygon,
        resolution=resolution,
        classes=classes,
        values=values,
        flags=flags,
        without_flags=without_flags,
    )
    path = file.path if isinstance(file, File) else os.fspath(file)
    return report_of(
        _esker.export(
            path,
            os.fspath(out),
            chosen,
            colour_bits=colour_bits,
            crs=crs,
            overwrite=overwrite,
            threads=threads,
            progress=native_progress(progress),
        )
    )


def verify(
    file: File | Path,
    against: Path | Iterable[Path] = (),
    *,
    threads: int = 0,
    progress: OnProgress = None,
    **options: Any,
) -> Report:
    """Checks every byte of a file, and with ``against`` that it has the points of these scans.

    A fault is an exception. Scans that need options to be read get those of :func:`build`.

    >>> esker.verify("creek.esker", against="creek.laz").ok
    True
    """
    path = file.path if isinstance(file, File) else os.fspath(file)
    scans = [against] if isinstance(against, (str, os.PathLike)) else list(against)
    names = [os.fspath(scan) for scan in scans]
    return report_of(_esker.verify(path, names, options, threads, native_progress(progress)))
