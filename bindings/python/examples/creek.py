"""Point clouds in Python, on the sample scan: ground by NumPy, a height map, and pictures.

Run it with a folder to write to, or paste it cell by cell into a notebook, where pictures show
themselves.
"""

# %% Build: any scan, within a bound of memory; no point is lost.
import sys
from pathlib import Path

import esker
import numpy as np

out = Path(sys.argv[1] if len(sys.argv) > 1 else "example")
out.mkdir(exist_ok=True)
scan = Path(__file__).resolve().parents[3] / "tests" / "sample" / "creek.laz"
report = esker.build(scan, out / "creek.esker")
print(f"{report.points_out} points, coordinates off by {report.rounding_error_max} at most")

# %% Read: columns as NumPy arrays, all of them or those that are asked for.
creek = esker.open(out / "creek.esker")
points = creek.query(columns=["red", "green", "blue"])
print(points, points["red"].dtype)

# %% Classify: points less than 0.5 m above the lowest within 4 m are ground (class 2).
cells = np.floor((points.xyz[:, :2] - creek.bounds[0, :2]) / 4.0).astype(int)
width, height = cells.max(axis=0) + 1
cell = cells[:, 1] * width + cells[:, 0]
lowest = np.full(width * height, np.inf)
np.minimum.at(lowest, cell, points.z)
classes = np.where(points.z - lowest[cell] < 0.5, 2, 1).astype("u1")

# %% Build from arrays: the same whole steps, with the new column.
columns = {name: points[name] for name in points} | {"classification": classes}
esker.build(columns, out / "ground.esker", scale=points.scale, offset=points.offset)
ground = esker.open(out / "ground.esker")

# %% Height map of the ground: mean height of a metre, by chunks, whatever the size of the file.
low, high = ground.bounds
shape = tuple(np.ceil((high - low)[:2]).astype(int) + 1)
total, count = np.zeros(shape), np.zeros(shape)
for part in ground.chunks(200_000, classes="ground", columns=[]):
    at = tuple((part.xyz[:, :2] - low[:2]).astype(int).T)
    np.add.at(total, at, part.z)
    np.add.at(count, at, 1)
with np.errstate(invalid="ignore"):
    heights = total / count
print(f"ground from {np.nanmin(heights):.1f} m to {np.nanmax(heights):.1f} m")

# %% Pictures: closed surfaces, without a window and without a graphics card.
picture = ground.render(size=(640, 400), colour="elevation", classes="ground")
picture.save(out / "ground.png")
picture

# %% The same view as arrays: how far away, and which way the surface looks.
images = ground.render(size=(640, 400), outputs=("depth", "normal", "index"))
seen = ground.at(images["index"], columns=["classification"])
share = np.mean(seen["classification"] == 2)
print(f"{share:.0%} of the pixels with a point show ground")
