"""Pictures."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from . import _esker
from ._build import Progress, Report, native_progress, report_of
from ._file import File
from ._filter import native

#: Pictures that :func:`render` returns beside the colours.
_OUTPUTS = ("depth", "normal", "index")
#: Type of images of indices.
_INDEX = np.dtype([("node", "<u4"), ("point", "<u4")])


class Picture(np.ndarray):
    """Colours of a picture, sRGB with straight alpha: ``uint8``, height x width x 4.

    Notebooks show it.

    >>> picture = esker.render("creek.esker", size=(64, 48))
    >>> picture.shape, picture.dtype
    ((48, 64, 4), dtype('uint8'))
    >>> picture.png()[:4]
    b'\\x89PNG'
    """

    #: What was drawn: counts, camera, legend of the colours, times, notes.
    report: Report | None

    def __array_finalize__(self, other: Any) -> None:
        self.report = getattr(other, "report", None)

    def png(self) -> bytes:
        """The bytes of a PNG file."""
        if self.ndim != 3 or self.shape[2] != 4 or self.dtype != np.uint8:
            raise ValueError(
                f"a picture is height x width x 4 of uint8, not {self.shape} of {self.dtype}"
            )
        height, width, _ = self.shape
        return _esker.png(np.ascontiguousarray(self).tobytes(), width, height)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes a PNG file."""
        with open(path, "wb") as file:
            file.write(self.png())

    def _repr_png_(self) -> bytes | None:
        is_picture = self.ndim == 3 and self.shape[2] == 4 and self.dtype == np.uint8
        return self.png() if is_picture and self.size else None


def render(
    file: File | str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
    *,
    size: tuple[int, int] | None = None,
    camera: str | Mapping[str, Any] | None = None,
    method: str | None = None,
    colour: str | None = None,
    outputs: Iterable[str] = (),
    bounds: Any = None,
    polygon: Any = None,
    resolution: float | None = None,
    classes: Any = None,
    values: Mapping[str, Any] | None = None,
    flags: Any = None,
    without_flags: Any = None,
    backend: str | None = None,
    threads: int | None = None,
    build: Mapping[str, Any] | None = None,
    progress: Callable[[Progress], Any] | None = None,
    **options: Any,
) -> Any:
    """Draws a picture, without a window; no graphics card is needed.

    Args:
        file: An open file, or paths of ``.esker`` files, of scans, or of a scene document, whose
            fields count where no argument is given.
        size: Width and height in pixels; 1024 x 1024 by default.
        camera: ``"eye=x,y,z;target=x,y,z;fovy=60"`` or the same as a dict; fitted by default.
        method: ``"auto"`` (default), ``"points"``, ``"pull-push"``, ``"ewa"`` or ``"lit"``.
        colour: What gives points their colour: ``"rgb"``, ``"elevation"``, ``"intensity:0..400"``.
        outputs: Images to return beside the colours, in a dict with ``"colour"``. ``"depth"``:
            eye depth in the file's unit, ``float32``, infinite where nothing is drawn.
            ``"normal"``: unit normal of the shown surface on the side of the eye, height x width x
            3 of ``float32``, from the depths of neighbouring pixels; NaN where nothing is drawn.
            ``"index"``: node and index of the nearest point that falls on the pixel, fields
            ``node`` and ``point`` (:meth:`File.at`); ``node`` is :data:`NO_NODE` where there is
            none, as between the points of a surface.
        bounds, polygon, resolution, classes, values, flags, without_flags: Which points are drawn,
            as for :meth:`File.query`.
        backend: ``"auto"`` (default), ``"cpu"`` or ``"gpu"``.
        threads: Number of threads; 0 for one a core.
        build: Options of :func:`build` for scans.
        progress: Is called with :class:`Progress`.
        options: ``window`` (``"x,y,w,h"``), ``budget_points``, ``target_spacing``, ``point_size``,
            ``eye_dome``, ``highlights``, ``even_exposure``, ``cull_back``, ``full``, ``lights``,
            ``samples``, ``bounces``, ``seed``, ``exposure``, as for ``esker render``.

    >>> picture = esker.render("creek.esker", size=(64, 48), colour="elevation", backend="cpu")
    >>> picture.report.legend
    'elevation 894.348 .. ...'
    >>> both = esker.render("creek.esker", size=(64, 48), outputs=["depth"], backend="cpu")
    >>> bool(np.isfinite(both["depth"]).any())
    True
    """
    wanted = [outputs] if isinstance(outputs, str) else list(outputs)
    for name in wanted:
        if name not in (*_OUTPUTS, "colour"):
            raise ValueError(
                f"there is no output {name!r}; there are colour, {', '.join(_OUTPUTS)}"
            )
    request = {
        "size": size,
        "camera": _camera(camera),
        "method": method,
        "colour": colour,
        "backend": backend,
        "threads": threads,
        **options,
    }
    request = {name: value for name, value in request.items() if value is not None}
    conditions = {
        "bounds": bounds,
        "polygon": polygon,
        "resolution": resolution,
        "classes": classes,
        "values": values,
        "flags": flags,
        "without_flags": without_flags,
    }
    is_filtered = any(value is not None for value in conditions.values())
    if isinstance(file, File):
        subject: Any = file._native
    else:
        paths = [file] if isinstance(file, (str, os.PathLike)) else list(file)
        subject = [os.fspath(path) for path in paths]
    report, (height, width), rgba, depth, normals, points = _esker.render(
        subject,
        native(**conditions) if is_filtered else None,
        request,
        dict(build or {}),
        ("normal" in wanted, "index" in wanted),
        native_progress(progress),
    )
    picture = rgba.reshape(height, width, 4).view(Picture)
    picture.report = report_of(report)
    if not wanted:
        return picture
    images: dict[str, np.ndarray] = {"colour": picture}
    if "depth" in wanted:
        images["depth"] = depth.reshape(height, width)
    if "normal" in wanted:
        images["normal"] = normals.reshape(height, width, 3)
    if "index" in wanted:
        images["index"] = points.view(_INDEX).reshape(height, width)
    return images


def _camera(camera: str | Mapping[str, Any] | None) -> str | None:
    """The camera in words."""
    if camera is None or camera == "fit":
        return None
    if isinstance(camera, str):
        return camera

    def number(value: Any) -> str:
        return value if isinstance(value, str) else repr(float(value))

    def words(value: Any) -> str:
        return number(value) if np.ndim(value) == 0 else ",".join(number(v) for v in value)

    return ";".join(f"{name}={words(value)}" for name, value in camera.items())
