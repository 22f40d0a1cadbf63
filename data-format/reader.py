#!/usr/bin/env python3
"""An independent reader of .esker files, written from SPEC.md alone: standard library and numpy.

    python3 reader.py FILE [--json] [--quiet] [--points OUT.npy] [--csv OUT.csv]

Prints the contents of the file and checks every rule of the specification. The exit code is 0 only
if all rules hold, and 2 if a plane cannot be decoded without a library (see codec.py). Of a forest
it reads the tree of the file itself. Section numbers in comments are those of SPEC.md.
"""

import argparse
import json
import struct
import sys
import zlib

import numpy as np

import checks
import codec
import metadata
from xxh3 import hash128, hash128_sum

TYPES = {
    "u8": "u1", "i8": "i1", "u16": "<u2", "i16": "<i2", "u32": "<u4",
    "i32": "<i4", "u64": "<u8", "i64": "<i8", "f32": "<f4", "f64": "<f8",
}  # fmt: skip
POSITION, RESIDUAL, COLOUR, INTENSITY, NORMAL = 1, 2, 3, 4, 5
TANGENT, CLIP, CLASS, REMAINDER, ATTRIBUTE, COMPACT = 6, 7, 8, 9, 10, 11
KNOWN = {POSITION, RESIDUAL, COLOUR, INTENSITY, NORMAL, CLASS, REMAINDER, ATTRIBUTE}
VERSIONS = 1, 2
SIDES, PARTS, TOP = 8, 9, 10  # kinds of columns
CLIP_LINES = (CLIP, None, False, 16)
TANGENTS = (TANGENT, None, True, 4)
NUMBERED = (COMPACT, None, True, 8)
GAINED = TANGENTS, NUMBERED, CLIP_LINES  # section 11
NODE = np.dtype([
    ("corner", "<u4", 3), ("cell_log2", "u1"), ("shape", "u1"), ("child_count", "u1"),
    ("level_count", "u1"), ("parent", "<u4"), ("first_child", "<u4"), ("levels", "u1", (16, 3)),
    ("centre", "<f4", 3), ("half", "<f4", 3), ("rotation", "<i2", 4), ("occupancy", "<u8"),
    ("spacing", "<f4"), ("box_min", "<u4", 3), ("hot_shift", "u1"), ("reserved", "u1", 3),
    ("page_bytes", "<u4"), ("page_offset", "<u8"),
])  # fmt: skip


class Damaged(Exception):
    """Something in the file is not as SPEC.md says."""


FAULTS = (
    Damaged, OSError, LookupError, TypeError, ValueError, ArithmeticError, MemoryError, struct.error,
)  # fmt: skip


def require(condition, what):
    if not condition:
        raise Damaged(what)


def up(n, multiple=64):
    return -(-n // multiple) * multiple


def seed_of(attributes):
    """Section 9: FNV-1a of the names and types."""
    seed = 0xCBF29CE484222325
    for byte in "".join(f"{a['name']}:{a['type']}\n" for a in attributes).encode():
        seed = (seed ^ byte) * 0x100000001B3 % 2**64
    return seed


class Esker:
    """An opened file: footer, metadata, table and statistics, checked."""

    def __init__(self, path):
        self.file = open(path, "rb")
        self.bytes = self.file.seek(0, 2)
        require(self.bytes >= 256, "cut short, or not an .esker file")
        self.read_footer()
        self.read_header()
        self.read_metadata()
        self.table = np.frombuffer(self.section("node table", self.places[0]), NODE)
        self.node_points = checks.points_of_levels(self.table["levels"])
        self.columns = self.read_statistics()
        self.section("verbatim blocks", self.places[3])

    def at(self, offset, length):
        require(offset + length <= self.bytes, "a place beyond the end of the file")
        self.file.seek(offset)
        return self.file.read(length)

    def section(self, name, place):
        data = self.at(place[0], place[1])
        require(zlib.crc32(data) == place[2], f"{name}: its CRC does not match")
        return data

    def read_header(self):
        header = self.at(0, 64)
        fields = struct.unpack("<8sII44sI", header)
        expected = (b"\x89ESKER\r\n", self.version, 64, bytes(44), zlib.crc32(header[:60]))
        require(fields == expected, "the header is damaged")

    def read_footer(self):  # section 3
        footer = self.at(self.bytes - 192, 192)
        magic, version, size = struct.unpack_from("<8sII", footer)
        (crc,) = struct.unpack_from("<I", footer, 188)
        valid = magic == b"ESKEREND" and crc == zlib.crc32(footer[:188])
        require(valid, "cut short, or not an .esker file: no valid footer")
        require(version in VERSIONS and size == 192, f"version {version} is not read by this reader")
        self.version = version
        self.points, self.nodes, low, high = struct.unpack_from("<QQQQ", footer, 16)
        self.hash = low | high << 64
        self.rounding, self.capacity, zero = struct.unpack_from("<dII", footer, 48)
        sections = [struct.unpack_from("<QQII", footer, 64 + 24 * i) for i in range(4)]
        (length,) = struct.unpack_from("<Q", footer, 160)
        zeros = zero == 0 and all(s[3] == 0 for s in sections) and footer[168:188] == bytes(20)
        require(zeros, "reserved bytes of the footer are not zero")
        require(length == self.bytes, "cut short: the footer tells another length")
        self.places = [s[:3] for s in sections]
        end = self.places[0][0]
        for place in self.places:
            require(place[0] == end, "the sections do not follow each other")
            end += place[1]
        require(end == self.bytes - 192 and self.places[0][0] >= 64, "the sections leave a gap")
        require(self.places[0][1] == 144 * self.nodes, "the table's length is not that of its nodes")
        low, high = hash128(np.frombuffer(footer, np.uint8)[None, :], 0)
        self.footer_hash = int(low[0]) | int(high[0]) << 64

    def read_metadata(self):  # section 8
        require(self.places[2][1] <= 2**30, "the metadata are too long")
        self.meta = metadata.parse(self.section("metadata", self.places[2]), self.version)
        meta = self.meta
        names = [int(tree["footer_hash"], 16) for tree in meta["forest"]]
        valid = len(names) < 512 and len(set(names)) == len(names)
        require(valid, "the forest names a file twice, or too many")
        ways = [tree["path"] for tree in meta["forest"]]
        require(all(w and not w.startswith("/") for w in ways), "the forest names a file by no way")
        require(meta["node_capacity"] == self.capacity, "node capacity differs from the footer's")
        rounding = max([0.0] + [float(s["rounding_error_max"]) for s in meta["sources"]])
        same = struct.pack("<d", rounding) == struct.pack("<d", self.rounding)
        require(same, "rounding error differs from the footer's")
        self.lattice = meta["lattice"]
        # Contours are in metres where version 2 has factors for that.
        factor = self.lattice["factor"] if self.version == 2 else (1, 1, 1)
        self.lengths = np.array(self.lattice["scale"], float) * np.array(factor, float)
        self.bounds = meta["bounds"]
        self.attributes = meta["attributes"]
        order = [(a["name"].encode(), list(TYPES).index(a["type"])) for a in self.attributes]
        require(order == sorted(set(order)), "attributes are not in canonical order")
        self.dtypes = [np.dtype(TYPES[a["type"]]) for a in self.attributes]
        self.classes = [c["present"] for c in meta["classes"]]
        counts = len(self.attributes), len(self.classes)
        require(max(counts) <= 65000 and counts[0] * counts[1] <= 2**22, "too many attributes or classes")
        for present in self.classes:
            valid = present == sorted(set(present)) and all(0 <= a < len(order) for a in present)
            require(valid, "a class names attributes that do not exist")
        require(self.classes or not self.points, "points without a class")
        self.depths = [c["colour_depth"] for c in meta["classes"]]
        self.seeds = [seed_of([self.attributes[a] for a in c]) for c in self.classes]
        require(
            all(s["class"] < max(1, len(self.classes)) for s in meta["sources"]),
            "a source's class does not exist",
        )
        self.read_set_aside()
        blocks = [(b["offset"], b["bytes"]) for s in meta["sources"] for b in s["verbatim"]]
        end = 0
        for offset, length in blocks:
            require(offset == end, "verbatim blocks do not follow each other")
            end += length
        require(end == self.places[3][1], "verbatim blocks do not fill their section")
        self.derive_planes()

    def read_set_aside(self):  # section 8, points set aside
        aside = self.meta.get("set_aside")
        if aside is None:
            return
        require(len(aside["points"]) <= 65536, "more points are set aside than a file can have")
        total = 0
        for point in aside["points"]:
            require(0 <= point["source"] < len(self.meta["sources"]), "a point has no source")
            of = self.meta["sources"][point["source"]]["class"]
            require(of < len(self.classes), "the class of a point's source does not exist")
            size = sum(self.dtypes[a].itemsize for a in self.classes[of])
            valid = set(point["values"]) <= set("0123456789abcdef")
            require(valid and len(point["values"]) == 2 * size, "a point has other values")
            place = [float(c) for c in point["place"]]
            record = struct.pack("<3d", *place) + bytes.fromhex(point["values"])
            low, high = hash128(np.frombuffer(record, np.uint8)[None, :], self.seeds[of])
            total += int(low[0]) | int(high[0]) << 64
        require(f"{total % 2**128:032x}" == aside["hash"], "the points set aside have another hash")

    def find(self, name, kind):
        for i, a in enumerate(self.attributes):
            if (a["name"], a["type"]) == (name, kind):
                return i
        return None

    def derive_planes(self):  # section 5
        def triple(names, kind):
            found = [self.find(n, kind) for n in names]
            return None if None in found else found

        rgb = "red", "green", "blue"
        choices = [t for t in (triple(rgb, "u16"), triple(rgb, "u8")) if t]
        has_all = lambda present: [t for t in choices if set(t) <= set(present)]
        self.colours = [(has_all(present) or [None])[0] for present in self.classes]
        self.intensity = self.find("intensity", "u16")
        self.normals = triple(("nx", "ny", "nz"), "f32")
        self.in_colour = set()
        for a in range(len(self.attributes)):
            having = [c for c, present in enumerate(self.classes) if a in present]
            if having and all(self.colours[c] and a in self.colours[c] for c in having):
                self.in_colour.add(a)
        sixteen = [c for c in self.colours if c and self.attributes[c[0]]["type"] == "u16"]
        planes = [(POSITION, None, True, 8)]
        planes += [(COLOUR, None, True, 4)] if any(self.colours) else []
        planes += [(INTENSITY, None, True, 2)] if self.intensity is not None else []
        origin = self.meta["normals"]
        known = origin in ("none", "estimated", "oriented") or origin == "source" and self.normals
        require(known, "the origin of normals does not suit the attributes")
        planes += [(NORMAL, None, True, 4)] if origin != "none" else []
        planes += [(RESIDUAL, None, True, 0)]
        planes += [(CLASS, None, False, 2)] if len(self.classes) > 1 else []
        planes += [(REMAINDER, None, False, 3)] if sixteen else []
        for a, dtype in enumerate(self.dtypes):
            if a != self.intensity and a not in self.in_colour:
                planes.append((ATTRIBUTE, a, False, dtype.itemsize))
        members = "kind", "attribute", "hot", "value_bytes"
        self.planes = [tuple(p[m] for m in members) for p in self.meta["planes"]]
        require(len(self.planes) <= 65016, "too many planes")
        of_attributes = all(p[0] == ATTRIBUTE or p[1] is None for p in self.planes)
        require(of_attributes, "a plane of another kind names an attribute")
        self.palette = self.read_palette()
        self.gained = [p for p in GAINED if p != NUMBERED or self.palette is not None]
        known = [p for p in self.planes if p[0] in KNOWN or p in self.gained]
        for plane in reversed(self.gained):
            if plane in known:
                planes.insert(planes.index((RESIDUAL, None, True, 0)) + 1, plane)
        tangents = TANGENTS in known
        require(not tangents or origin != "none", "tangents of a file without normals")
        require(NUMBERED not in known or any(self.colours), "a compact plane without colours")
        require(known == planes, "the planes are not those that the attributes ask for")
        hot = [p[2] for p in self.planes]
        require(hot == sorted(hot, reverse=True), "a hot plane stands behind a cold one")

    def read_palette(self):  # section 11
        """The colours that a compact plane numbers; none where they are not what such a plane has."""
        colours = self.meta.get("palette") or []
        return np.array(colours, np.int32) if 1 <= len(colours) <= 255 else None

    def read_statistics(self):  # section 7
        data = self.section("statistics", self.places[1])
        magic, count, nodes = struct.unpack_from("<4sIQ", data)
        require(magic == b"ESST" and nodes == self.nodes, "statistics: not of this file")
        columns, end = {}, 16 + 24 * count
        for i in range(count):
            kind, attribute, zero, offset, length = struct.unpack_from("<HHIQQ", data, 16 + 24 * i)
            valid = offset == end and zero == 0 and (kind, attribute) not in columns
            require(valid, "statistics: a column is not where it should be")
            columns[kind, attribute] = data[offset : offset + length]
            end = up(offset + length, 8)
            require(not any(data[offset + length : end]), "statistics: padding is not zero")
        require(end == len(data), "statistics: the columns do not fill the section")
        self.check_sides(columns.get((SIDES, 65535)))
        self.check_sealed(columns.get((PARTS, 65535)), columns.get((TOP, 65535)))
        return columns

    def check_sealed(self, *columns):  # section 11
        require(len({column is None for column in columns}) == 1, "statistics: parts or top alone")
        for column in columns:
            if column is not None:
                require(len(column) > 16, "statistics: a column of parts is too short")
                crc = struct.unpack_from("<Q", column, len(column) - 8)[0]
                require(crc == zlib.crc32(column[:-8]), "statistics: the checksum of parts or top")

    def check_sides(self, column):  # section 11
        if column is None:
            return
        require(len(column) == 16 * self.nodes + 8, "statistics: sides of another table")
        crc = struct.unpack_from("<Q", column, 16 * self.nodes)[0]
        require(crc == zlib.crc32(column[:-8]), "statistics: the checksum of the sides")

    def sides(self, node):
        """Occupancies of the two sides of a node's contour; none where the file does not tell."""
        column = self.columns.get((SIDES, 65535))
        return () if column is None else struct.unpack_from("<QQ", column, 16 * node)

    # Pages

    def read_page(self, index):  # section 6
        """The planes of a node: values by (kind, attribute), one a point; all bytes checked."""
        node, n = self.table[index], int(self.node_points[index])
        page = self.at(int(node["page_offset"]), int(node["page_bytes"]))
        shift = int(node["hot_shift"])
        size = 16 + 20 * len(self.planes)
        magic, points, count, zero = struct.unpack_from("<4sIHH", page)
        expected = (b"ESPG", n, len(self.planes), 0)
        require((magic, points, count, zero) == expected, "the directory is not that of the node")
        (crc,) = struct.unpack_from("<I", page, size - 4)
        require(crc == zlib.crc32(page[: size - 4]), "the directory's CRC does not match")
        planes, end = {}, size
        for i, (kind, attribute, hot, value_bytes) in enumerate(self.planes):
            entry = struct.unpack_from("<HHB3sIII", page, 12 + 20 * i)
            number, of, encoding, zeros, offset, length, crc = entry
            same = number == kind and of == (65535 if attribute is None else attribute)
            require(same and zeros == bytes(3), "a plane is not the one that the metadata list")
            require(offset == up(end), "a plane is not where it should be")
            require(not any(page[end:offset]), "padding between planes is not zero")
            data, end = page[offset : offset + length], offset + length
            require(zlib.crc32(data) == crc, f"plane of kind {kind}: its CRC does not match")
            if kind not in KNOWN and (kind, attribute, hot, value_bytes) not in self.gained:
                continue
            if kind == RESIDUAL:
                value_bytes = 0 if shift == 0 else 4 if shift <= 10 else 6
            require(encoding == 0 or not hot, "a hot plane is not raw")
            require(encoding <= 3, f"plane of kind {kind}: encoding {encoding} is of a later version")
            if encoding < 2:
                require(length == value_bytes * (1 if encoding else n), "a plane's length is wrong")
                data = data * n if encoding else data
            else:
                require(length < value_bytes * n, "a compressed plane is longer than the raw one")
                data = codec.runs(encoding, data, value_bytes, n)
            if not hot:
                alike = n >= 2 and data == data[:value_bytes] * n
                require(alike == (encoding == 1), "a cold plane has the wrong encoding")
            planes[kind, attribute] = np.frombuffer(data, np.uint8).reshape(n, value_bytes)
        require(up(end) == len(page) and not any(page[end:]), "the planes do not fill the page")
        return planes

    def decode(self, index, planes):  # section 5
        """Exact lattice coordinates, classes, and one column of values an attribute."""
        node, n = self.table[index], int(self.node_points[index])
        shift = np.uint64(node["hot_shift"])
        position = planes[POSITION, None]
        require(not position[:, 7].any(), "position plane: the last byte is not zero")
        q = np.ascontiguousarray(position[:, :6]).view("<u2").astype(np.uint64)
        low = self.residual(planes[RESIDUAL, None], int(shift))
        p = node["box_min"].astype(np.uint64) + ((q << shift) | low)
        require((p < 2**32).all() and (low >> shift == 0).all(), "a point leaves the lattice")
        classes = np.zeros(n, np.int64)
        if len(self.classes) > 1:
            classes = planes[CLASS, None].copy().view("<u2")[:, 0].astype(np.int64)
            require((classes < len(self.classes)).all(), "a point's class does not exist")
        columns = []
        for a, dtype in enumerate(self.dtypes):
            raw = planes.get((ATTRIBUTE, a))
            if a == self.intensity:
                raw = planes[INTENSITY, None]
            if a in self.in_colour:
                raw = np.zeros((n, dtype.itemsize), np.uint8)
            columns.append(np.array(raw))
        self.colour_columns(planes, classes, columns)
        values = [c.view(d)[:, 0] for c, d in zip(columns, self.dtypes)]
        return p.astype(np.uint32), position[:, 6], classes, values

    def residual(self, plane, shift):
        n = len(plane)
        if shift == 0:
            return np.zeros((n, 3), np.uint64)
        if shift > 10:
            return plane.copy().view("<u2").astype(np.uint64)
        packed = plane.copy().view("<u4").astype(np.uint64)
        require((packed < 1 << 30).all(), "residual plane: the upper bits are not zero")
        return (packed >> np.array([0, 10, 20], np.uint64)) & np.uint64(1023)

    def colour_columns(self, planes, classes, columns):
        """Fills the attributes that live in the colour plane; checks all colour of the page."""
        if (COLOUR, None) not in planes:
            return
        colour, remainder = planes[COLOUR, None], planes.get((REMAINDER, None))
        for c, rgb in enumerate(self.colours or [None]):
            mine = classes == c
            require((colour[mine, 3] == (255 if rgb else 0)).all(), "colour: the fourth byte is wrong")
            wide = rgb and self.attributes[rgb[0]]["type"] == "u16"
            if not wide and remainder is not None:
                require(not remainder[mine].any(), "colour remainder where there is none")
            if not rgb:
                require(not colour[mine].any(), "colour where there is none")
                continue
            hot_byte = 1 if wide and self.depths[c] == "sixteen" else 0
            for k, a in enumerate(rgb):
                exact = np.zeros((int(mine.sum()), self.dtypes[a].itemsize), np.uint8)
                exact[:, hot_byte] = colour[mine, k]
                if wide:
                    exact[:, 1 - hot_byte] = remainder[mine, k]
                if a in self.in_colour:
                    columns[a][mine] = exact
                else:
                    require((columns[a][mine] == exact).all(), "colour is not that of the attribute")

    def page_hash(self, p, classes, values):  # section 9
        total = 0
        for c, present in enumerate(self.classes):
            mine = classes == c
            parts = [np.ascontiguousarray(p[mine].astype("<u4")).view(np.uint8).reshape(-1, 12)]
            for a in present:
                raw = np.ascontiguousarray(values[a][mine]).view(np.uint8)
                parts.append(raw.reshape(-1, self.dtypes[a].itemsize))
            total += hash128_sum(np.concatenate(parts, axis=1), self.seeds[c])
        return total


def check(esker, keep):
    """Checks the whole file; the points of each node where `keep`."""
    checks.check_table(esker, require)
    checks.check_parts(esker, require)
    total, kept = 0, []
    statistics = checks.Statistics(esker)
    bounds = None
    for index in range(esker.nodes):
        try:
            planes = esker.read_page(index)
            p, _, classes, values = esker.decode(index, planes)
            checks.check_points(esker, index, planes, p, classes, values, require)
        except (Damaged, struct.error) as fault:
            raise Damaged(f"page of node {index}: {fault}") from None
        total += esker.page_hash(p, classes, values)
        low, high = bounds or (p[0], p[0])
        bounds = np.minimum(low, p.min(axis=0)), np.maximum(high, p.max(axis=0))
        statistics.add(classes, values)
        if keep:
            kept.append((p, classes, values))
    total %= 2**128
    require(total == esker.hash, f"multiset hash {total:032x}, the footer says {esker.hash:032x}")
    found = [b.tolist() for b in bounds] if bounds else None
    require(found == esker.bounds, "the metadata's bounds are not those of the points")
    statistics.compare(require)
    return kept


def point_array(esker, kept):
    """All points as one structured array: x, y, z, class, and `name:type` for each attribute."""
    fields = [("x", "<u4"), ("y", "<u4"), ("z", "<u4"), ("class", "<u2")]
    names = [f"{a['name']}:{a['type']}" for a in esker.attributes]
    out = np.zeros(esker.points, fields + list(zip(names, esker.dtypes)))
    at = 0
    for p, classes, values in kept:
        run = out[at : at + len(p)]
        for axis, field in enumerate("xyz"):
            run[field] = p[:, axis]
        run["class"] = classes
        for name, column in zip(names, values):
            run[name] = column
        at += len(p)
    return out


def summary(esker):
    return {
        "ok": True,
        "version": esker.version,
        "points": esker.points,
        "nodes": esker.nodes,
        "multiset_hash": f"{esker.hash:032x}",
        "footer_hash": f"{esker.footer_hash:032x}",
        "bytes": esker.bytes,
        "node_capacity": esker.capacity,
        "rounding_error_max": esker.rounding,
        "lattice": esker.lattice,
        "bounds": esker.bounds,
        "attributes": [f"{a['name']}:{a['type']}" for a in esker.attributes],
        "classes": len(esker.classes),
        "normals": esker.meta["normals"],
        "compress": esker.meta["compress"],
        "sources": [s["path"] for s in esker.meta["sources"]],
        "forest": esker.meta["forest"],
    }


def main():
    parser = argparse.ArgumentParser(description="Reads and checks an .esker file.")
    parser.add_argument("file")
    parser.add_argument("--json", action="store_true", help="one object on one line")
    parser.add_argument("--quiet", action="store_true", help="print only what is wrong")
    parser.add_argument("--points", metavar="OUT.npy", help="write the exact points")
    parser.add_argument("--csv", metavar="OUT.csv", help="write the exact points as text")
    options = parser.parse_args()
    try:
        esker = Esker(options.file)
        kept = check(esker, options.points or options.csv)
    except codec.NoLibrary as fault:
        if options.json:
            print(json.dumps({"ok": False, "error": str(fault)}))
        print(f"{options.file}: {fault}", file=sys.stderr)
        return 2
    except FAULTS as fault:
        if options.json:
            print(json.dumps({"ok": False, "error": str(fault)}))
        print(f"{options.file}: {type(fault).__name__}: {fault}", file=sys.stderr)
        return 1
    if options.points or options.csv:
        points = point_array(esker, kept)
        if options.points:
            np.save(options.points, points)
        if options.csv:
            with open(options.csv, "w", encoding="utf-8") as out:
                print(",".join(points.dtype.names), file=out)
                out.writelines(",".join(map(repr, row)) + "\n" for row in points.tolist())
    if options.json:
        print(json.dumps(summary(esker)))
    elif not options.quiet:
        for name, value in summary(esker).items():
            print(f"{name:20} {value}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
