"""Point clouds of any size, out of core: reads, builds, exports and draws ``.esker`` files.

>>> import esker
>>> report = esker.build("creek.laz", "creek.esker")
>>> report.points_in == report.points_out == 841556
True
>>> file = esker.open("creek.esker")
>>> file.count
841556
>>> ground = file.query(classes="ground", columns=["intensity"])
>>> ground.xyz.shape, ground["intensity"].dtype
((..., 3), dtype('uint16'))

Errors: what the system refuses is an ``OSError`` of the kind that Python has for it
(``FileNotFoundError``, ``PermissionError`` ...), whether the file is on this machine or at an
address; a wrong argument is a ``ValueError`` or a ``TypeError``; a column that is not there is a
``KeyError``; everything else that Esker refuses, such as a damaged file, is an
:class:`EskerError`. :class:`LossError`, a kind of it, is raised by builds that would lose points.
"""

from ._build import Progress, Report, build
from ._esker import EskerError, LossError, __version__
from ._file import NO_NODE, File, export, open, verify
from ._picture import Picture, render
from ._points import Points

__all__ = [
    "NO_NODE",
    "EskerError",
    "File",
    "LossError",
    "Picture",
    "Points",
    "Progress",
    "Report",
    "__version__",
    "build",
    "export",
    "open",
    "render",
    "verify",
]
