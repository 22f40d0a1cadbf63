"""Compares COPC files with what laspy and copclib read of them: every voxel has its points and its
ancestors, and queries of levels and boxes give the points that a search through all points gives.
A file of steps beside it, which check.mjs writes, must have the same points.

copclib takes the cube from the bounds of the header, and not from the octree's record, so it is
asked for levels only.

Usage: python check.py FILE.copc.laz ...    needs: pip install laspy lazrs copclib
"""

import os
import struct
import sys

import copclib
import laspy
import numpy as np

BOXES = 12


def entries_of(data, offset, size, found):
    """Adds the entries of a page and of those below it; returns the number of pages."""
    pages = 1
    for at in range(offset, offset + size, 32):
        *key, offset, size, points = struct.unpack_from("<4iQ2i", data, at)
        if points == -1:
            pages += entries_of(data, offset, size, found)
        else:
            assert tuple(key) not in found, key
            found[tuple(key)] = (offset, size, points)
    return pages


def check_voxels(found, xyz, start, low, edge):
    """Chunks follow each other, and every point lies inside the voxel of its chunk."""
    first = 0
    for offset, size, points, key in sorted((*e, k) for k, e in found.items() if e[2] > 0):
        assert offset == start, key
        own = xyz[first : first + points]
        voxel_edge = edge / 2 ** key[0]
        corner = low + np.array(key[1:]) * voxel_edge
        assert (own > corner).all() and (own < corner + voxel_edge).all(), key
        start, first = start + size, first + points


def check_queries(path, found, las):
    """Queries of laspy, which rounds boxes to steps, against all points."""
    steps = np.stack([las.X, las.Y, las.Z], 1)
    xyz, header = np.array(las.xyz), las.header
    dice = np.random.default_rng(1)
    with laspy.CopcReader.open(path) as reader:
        for level in range(max(key[0] for key in found) + 1):
            want = sum(e[2] for key, e in found.items() if key[0] <= level)
            assert len(reader.query(level=range(level + 1))) == want, level
        for i in range(BOXES):
            ends = np.sort(dice.uniform(xyz.min(0), xyz.max(0), (2, 3)), 0)
            if i % 3 == 0:
                ends = np.stack([xyz[dice.integers(len(xyz))]] * 2)
            low, high = np.round((ends - header.offsets) / header.scales)
            want = ((steps >= low) & (steps <= high)).all(1).sum()
            got = reader.query(bounds=laspy.copc.Bounds(mins=ends[0], maxs=ends[1]))
            assert len(got) == want, (i, len(got), want)


def sorted_rows(steps):
    """Rows of three integers in an order that depends on the rows alone."""
    steps = np.ascontiguousarray(steps, dtype=np.int64)
    return steps[np.lexsort(steps.T)]


def check_copclib(path, found, las):
    """All points by copclib, and the voxels that it gives for a resolution."""
    reader = copclib.FileReader(path)
    nodes = reader.GetAllNodes()
    chunks = [reader.GetPoints(node) for node in nodes if node.point_count > 0]
    xyz = [np.stack([np.array(c.x), np.array(c.y), np.array(c.z)], 1) for c in chunks]
    header = las.header
    steps = np.round((np.concatenate(xyz) - header.offsets) / header.scales)
    want = sorted_rows(np.stack([las.X, las.Y, las.Z], 1))
    assert (sorted_rows(steps) == want).all(), "copclib reads other points"
    spacing = reader.copc_config.copc_info.spacing
    for level in range(max(key[0] for key in found) + 1):
        within = reader.GetNodesWithinResolution(spacing / 2**level * 1.001)
        want = sum(e[2] for key, e in found.items() if key[0] <= level)
        assert sum(node.point_count for node in within) == want, level


def check(path):
    with open(path, "rb") as file:
        data = file.read()
    assert data[377:381] == b"copc" and data[393:395] == b"\1\0"
    *centre, half, _spacing, offset, size = struct.unpack_from("<5d2Q", data, 429)
    found = {}
    pages = entries_of(data, offset, size, found)
    for level, x, y, z in found:
        assert level == 0 or (level - 1, x >> 1, y >> 1, z >> 1) in found
    las = laspy.read(path)
    assert sum(e[2] for e in found.values()) == las.header.point_count == len(las.points)
    start = struct.unpack_from("<I", data, 96)[0] + 8
    check_voxels(found, np.array(las.xyz), start, np.array(centre) - half, 2 * half)
    if len(las.points) > 0:
        check_queries(path, found, las)
        check_copclib(path, found, las)
    if os.path.exists(path + ".steps"):
        steps = np.fromfile(path + ".steps", dtype=np.int32).reshape(-1, 3)
        want = sorted_rows(np.stack([las.X, las.Y, las.Z], 1))
        assert (sorted_rows(steps) == want).all(), "copc.js reads other points"
    empty = sum(e[2] == 0 for e in found.values())
    print(f"{path}: ok, {len(las.points)} points, {len(found)} voxels, {empty} empty, {pages} pages")


for name in sys.argv[1:]:
    check(name)
