"""What the reader checks beyond bytes and checksums: the rules of the table, of a node's points, of statistics.

Sections are those of SPEC.md. `require(condition, what)` raises where a rule is broken.
"""

import struct
import zlib

import numpy as np


def points_of_levels(levels):
    return (levels.astype(np.int64) * np.array([1, 256, 65536])).sum(axis=(1, 2))


def contains(cell_log2, corner, p):
    """Whether lattice points lie in cells; broadcasts."""
    shift = np.asarray(cell_log2, np.uint64)[..., None]
    return ((np.asarray(corner, np.uint64) >> shift) == (np.asarray(p, np.uint64) >> shift)).all(-1)


def bit_length(v):
    return int(v).bit_length()


def check_table(esker, require):  # section 4
    t, n = esker.table, esker.nodes
    require(esker.node_points.sum() == esker.points, "the nodes' points are not the footer's")
    if n == 0:
        require(esker.places[0][0] == 64, "pages without nodes")
        return
    log2 = t["cell_log2"].astype(np.uint64)
    require((log2 <= 32).all(), "a cell is greater than the lattice")
    aligned = (t["corner"].astype(np.uint64) >> log2[:, None] << log2[:, None]) == t["corner"]
    require(aligned.all(), "a cell's corner is not aligned")
    require(((t["level_count"] >= 1) & (t["level_count"] <= 16)).all(), "levels out of range")
    beyond = np.arange(16)[None, :] >= t["level_count"][:, None]
    require(not t["levels"][beyond].any(), "counts beyond the last level")
    counts = esker.node_points
    require(((counts >= 1) & (counts <= 1 << 18)).all(), "a node's points are out of range")
    row_bytes = sum(dtype.itemsize for dtype in esker.dtypes)
    require((counts.astype(np.uint64) * row_bytes <= 4 << 30).all(), "a node takes more than 4 GiB")
    require((t["shape"] < 16).all() and not t["reserved"].any(), "reserved bits are not zero")
    require(contains(log2, t["corner"], t["box_min"]).all(), "box_min outside the cell")
    for name in "centre", "half", "spacing":
        require(np.isfinite(t[name]).all(), f"{name} is not finite")
    require((t["half"] >= 0).all() and (t["spacing"] >= 0).all(), "a negative length")
    check_links(t, n, require)
    offsets, sizes = t["page_offset"], t["page_bytes"].astype(np.uint64)
    require((offsets % np.uint64(64) == 0).all() and (sizes % np.uint64(64) == 0).all(), "page alignment")
    order = np.lexsort((sizes, offsets))
    starts = np.concatenate(([64], 64 + np.cumsum(sizes[order].astype(np.int64))))
    require((offsets[order].astype(np.int64) == starts[:-1]).all(), "pages overlap or leave gaps")
    require(starts[-1] == esker.places[0][0], "pages do not end at the table")


def check_links(t, n, require):
    require(t[0]["parent"] == 2**32 - 1 and not t[0]["shape"] & 8, "the root has a parent")
    known = np.zeros(n, bool)
    known[0] = True
    for i in range(n):
        count, first = int(t[i]["child_count"]), int(t[i]["first_child"])
        if count == 0:
            require(first == 0, f"node {i}: a child but no children")
            continue
        require(count <= 8 and i < first and first + count <= n, f"node {i}: children out of range")
        children = t[first : first + count]
        require((children["parent"] == i).all(), f"node {i}: its children do not know it")
        known[first : first + count] = True
        check_cells(i, t[i], children, require)
    require(known.all(), "a node is not the child of its parent")


def check_cells(i, node, children, require):
    if len(children) == 1 and children[0]["shape"] & 8:
        child = children[0]
        same = child["cell_log2"] == node["cell_log2"] and (child["corner"] == node["corner"]).all()
        require(same, f"node {i}: its continuation has another cell")
        return
    log2 = int(node["cell_log2"])
    smaller = (children["cell_log2"] < log2).all() and not (children["shape"] & 8).any()
    require(smaller, f"node {i}: a child's cell is not smaller")
    inside = contains(np.uint64(log2), node["corner"], children["corner"])
    bits = children["corner"].astype(np.uint64) >> np.uint64(log2 - 1) & np.uint64(1)
    octants = (bits * np.array([1, 2, 4], np.uint64)).sum(axis=1).astype(np.int64)
    require(inside.all() and (np.diff(octants) > 0).all(), f"node {i}: its children's octants")


def check_parts(esker, require):  # section 11, parts and top of the node table
    column = esker.columns.get((9, 65535))
    if column is None:
        return
    sides = esker.columns.get((8, 65535), b"")[:-8]
    records, (size, histograms) = esker.table.tobytes(), struct.unpack_from("<II", column)
    require(1 <= size <= 2**16, "parts: their number of nodes")
    stored = b"".join(esker.columns[7, a] for a in range(len(esker.dtypes)))
    require(histograms == zlib.crc32(stored), "parts: the checksum of the histograms")
    crcs = [
        zlib.crc32(data[at * width : (at + size) * width])
        for at in range(0, esker.nodes, size)
        for data, width in ((records, 144), (sides, 16))
    ]
    require(column[8:-8] == struct.pack(f"<{len(crcs)}I", *crcs), "parts: a checksum")
    check_top(esker, esker.columns[10, 65535], sides, require)


def check_top(esker, column, sides, require):
    n, zero = struct.unpack_from("<II", column)
    require(1 <= n <= 2**16 and zero == 0, "top: its number of nodes")
    require(len(column) == 16 + n * (160 + (16 if sides else 0)), "top: its length")
    entry = np.dtype([("below", "<u8"), ("spacing", "<f4"), ("index", "<u4")])
    entries = np.frombuffer(column, entry, n, 8)
    index = entries["index"].astype(np.int64)
    require(index[0] == 0 and (np.diff(index) > 0).all(), "top: the order of its nodes")
    require(index[-1] < esker.nodes, "top: a node that is none")
    table = esker.table
    require(column[8 + 16 * n : 8 + 160 * n] == table[index].tobytes(), "top: a record")
    if sides:
        words = np.frombuffer(sides, "<u8").reshape(-1, 2)[index].tobytes()
        require(column[8 + 160 * n : -8] == words, "top: sides")
    is_in = np.zeros(esker.nodes, bool)
    is_in[index] = True
    parents = table["parent"].astype(np.int64)
    require(is_in[parents[index[1:]]].all(), "top: a node without its parent")
    above = np.full(esker.nodes, -1, np.int64)  # the node of the top that each is, or is below
    above[index] = index
    below = {int(i): [0, []] for i in index}
    for i in range(esker.nodes):
        if is_in[i]:
            first, count = int(table[i]["first_child"]), int(table[i]["child_count"])
            some = is_in[first : first + count]
            require(some.all() or not some.any(), "top: a node without its siblings")
            continue
        above[i] = above[parents[i]]
        of = below[int(above[i])]
        of[0] += int(esker.node_points[i])
        if table[i]["child_count"] == 0:
            of[1].append((float(table[i]["spacing"]), int(esker.node_points[i])))
    for e in entries:
        points, leaves = below[int(e["index"])]
        half, reached, spacing = (sum(p for _, p in leaves) + 1) // 2, 0, 0.0
        for s, p in sorted(leaves):
            reached += p
            if reached >= half:
                spacing = s
                break
        same = int(e["below"]) == points and e["spacing"].tobytes() == np.float32(spacing).tobytes()
        require(same, "top: what is below a node")


def check_points(esker, index, planes, p, classes, values, require):
    node = esker.table[index]
    require(contains(node["cell_log2"], node["corner"], p).all(), "a point outside the cell")
    low, high = p.min(axis=0), p.max(axis=0)
    shift = max(0, bit_length((high - low).max()) - 16)
    fits = (low == node["box_min"]).all() and shift == node["hot_shift"]
    require(fits, "the integer box is not that of the points")
    check_contour(node, esker.sides(index), esker.lengths, p, require)
    for a, column in enumerate(values):
        having = [a in present for present in esker.classes]
        if not all(having):
            absent = ~np.array(having)[classes]
            raw = np.ascontiguousarray(column[absent]).view(np.uint8)
            require(not raw.any(), "a value that the point does not have is not zero")
    if (7, None) in planes:
        words = planes[7, None].copy().view("<u4")
        lines = words[:, 1] & 0x7FFFFFF, words[:, 3] & 0x7FFFFFF
        clean = (words[:, 1] >> 28 == 0) & (words[:, 3] >> 29 == 0)
        require(clean.all(), "clip lines: bits that mean nothing are not zero")
        require((lines[0] != 0)[words[:, 1:].any(axis=1)].all(), "clip lines: a second without a first")
    if (6, None) in planes:
        shapes = planes[6, None]
        discs = shapes[shapes[:, 3] == 0]
        require(not discs.any(), "tangents: a disc's bytes are not zero")
        require((shapes[:, :2] != 128).all(), "tangents: an axis is out of range")
    if (11, None) in planes:
        check_compact(esker, planes, require)
    if esker.meta["normals"] == "source":
        code = octahedral([values[a] for a in esker.normals])
        stored = planes[5, None].copy().view("<i2")
        require((stored == code).all(), "normal plane: not that of nx, ny, nz")


def check_compact(esker, planes, require):
    stored, colours = planes[11, None], planes[3, None]
    require((stored[:, :7] == planes[1, None][:, :7]).all(), "compact plane: other positions")
    some, which = np.unique(colours, axis=0, return_inverse=True)
    apart = some[:, None, :3].astype(np.int32) - esker.palette[None]
    numbers = (apart * apart).sum(axis=2).argmin(axis=1)  # the first of several
    numbers[some[:, 3] == 0] = 255
    require((stored[:, 7] == numbers[which.reshape(-1)]).all(), "compact plane: not the nearest colour")


def check_contour(node, sides, lengths, p, require):
    q = node["rotation"].astype(np.float64) / 32767.0
    norm = np.sqrt((q * q).sum())
    x, y, z, w = q / norm if norm > 1e-6 else (0.0, 0.0, 0.0, 1.0)
    axes = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)],
        [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)],
        [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)],
    ])
    centre, half = node["centre"].astype(np.float64), node["half"].astype(np.float64)
    local = (p - node["corner"]) * lengths
    along = (local - centre) @ axes.T
    size = max(np.abs(centre).max(), half.max())
    slack = 1e-5 * size
    # One part in 10^12 more, since sums may be taken in another order than the writer's.
    inside = np.abs(along) <= half + slack * (1 + 1e-12)
    require(inside.all(), "a point outside the contour")
    near = max(size, local.max()) * 1e-12
    # Mask, its columns' axis, its rows' axis.
    masks = [(int(node["occupancy"]), 0, 1)] + [(m, 2, rows) for m, rows in zip(sides, (0, 1))]
    for mask, columns, rows in masks:
        check_occupancy(mask, along[:, [columns, rows]], half[[columns, rows]], near, require)


def check_occupancy(occupancy, along, half, near, require):
    def parts(axis, away, any_part):
        if half[axis] == 0:
            return np.full(len(along), any_part)
        fraction = ((along[:, axis] + away) / (2 * half[axis]) + 0.5) * 8
        return np.clip(np.trunc(fraction), 0, 7).astype(np.int64)

    low = [parts(axis, -near, 0) for axis in (0, 1)]
    high = [parts(axis, near, 7) for axis in (0, 1)]
    must = may = 0
    for u0, u1, v0, v1 in np.unique(np.stack([low[0], high[0], low[1], high[1]], 1), axis=0).tolist():
        bits = sum(1 << (v * 8 + u) for u in range(u0, u1 + 1) for v in range(v0, v1 + 1))
        may |= bits
        if u0 == u1 and v0 == v1:
            must |= bits
    fits = occupancy & ~may == 0 and must & ~occupancy == 0
    require(fits, "the occupancy is not that of the points")


def octahedral(normal):  # section 5
    with np.errstate(all="ignore"):
        nx, ny, nz = (c.astype(np.float32) for c in normal)
        s = np.abs(nx) + np.abs(ny) + np.abs(nz)
        valid = (s > 0) & np.isfinite(s)
        s = np.where(valid, s, np.float32(1))
        x, y = nx / s, ny / s
        one = np.float32(1)
        folded = np.copysign(one - np.abs(y), x), np.copysign(one - np.abs(x), y)
        xy = [np.where(nz < 0, f, c) * np.float32(32767) for f, c in zip(folded, (x, y))]
        # Exact in f64: adding a half to an f32 this small does not round.
        rounded = [np.trunc(c + np.copysign(0.5, c)) for c in (c.astype(np.float64) for c in xy)]
        codes = [np.where(valid, c, -32768).astype(np.int16) for c in rounded]
    return np.stack(codes, axis=1)


class Statistics:  # section 7
    """Collected from the points, to be compared with what is stored."""

    def __init__(self, esker):
        self.esker = esker
        attributes = range(len(esker.dtypes))
        self.own = {(kind, a): [] for a in attributes for kind in (1, 2)}
        self.bits = []
        self.finite = [(np.inf, -np.inf) for _ in attributes]
        self.counts = [np.zeros(256, np.uint64) for _ in attributes]
        self.classification = esker.find("classification", "u8")

    def add(self, classes, values):
        for a, column in enumerate(values):
            having = np.array([a in present for present in self.esker.classes])
            column = column[having[classes]]
            self.add_range(a, column)
            self.add_histogram(a, column.astype(np.float64) + 0.0)
            if a == self.classification:
                bits = np.zeros(256, bool)
                bits[column] = True
                self.bits.append(np.packbits(bits, bitorder="little"))

    def add_range(self, a, column):
        if column.dtype.kind == "f":
            column = column[~np.isnan(column)] + column.dtype.type(0)
        least, greatest = limits(column.dtype)
        if len(column):
            least, greatest = column.min(), column.max()
        self.own[1, a].append(least)
        self.own[2, a].append(greatest)

    def add_histogram(self, a, column):
        column = column[np.isfinite(column)]
        if not len(column):
            return
        low, high = self.finite[a]
        self.finite[a] = min(low, column.min()), max(high, column.max())
        low, high = self.stored_range(a)
        column = column[(column >= low) & (column <= high)]
        with np.errstate(all="ignore"):
            scale = np.float64(256) / (high * 0.5 - low * 0.5)
            bins = np.nan_to_num((column * 0.5 - low * 0.5) * scale, nan=0.0)
        bins = np.minimum(bins, 255).astype(np.int64)
        self.counts[a] += np.bincount(bins, minlength=256).astype(np.uint64)

    def stored_range(self, a):
        return np.frombuffer(self.esker.columns[7, a], "<f8", 2)

    def compare(self, require):
        esker, columns = self.esker, self.esker.columns
        for a, dtype in enumerate(esker.dtypes):
            least = np.array(self.own[1, a], dtype)
            greatest = np.array(self.own[2, a], dtype)
            below = least.copy(), greatest.copy()
            self.fold(below[0], np.minimum)
            self.fold(below[1], np.maximum)
            for kind, column in zip((1, 2, 3, 4), (least, greatest) + below):
                same = columns[kind, a] == column.tobytes()
                require(same, f"statistics: column {kind} of attribute {a}")
            histogram = np.array(self.finite[a], "<f8").tobytes() + self.counts[a].tobytes()
            require(columns[7, a] == histogram, f"statistics: histogram of attribute {a}")
        if self.classification is not None:
            bits = np.array(self.bits, np.uint8).reshape(-1, 32)
            require(columns[5, 65535] == bits.tobytes(), "statistics: classes")
            self.fold(bits, np.bitwise_or)
            require(columns[6, 65535] == bits.tobytes(), "statistics: classes of subtrees")

    def fold(self, column, join):
        for i in range(self.esker.nodes - 1, 0, -1):
            parent = self.esker.table[i]["parent"]
            column[parent] = join(column[parent], column[i])


def limits(dtype):
    """Least and greatest where there is no value."""
    if dtype.kind == "f":
        return dtype.type(np.inf), dtype.type(-np.inf)
    info = np.iinfo(dtype)
    return dtype.type(info.max), dtype.type(info.min)
