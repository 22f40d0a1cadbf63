"""Metadata, section 8: strict reading of the JSON, and the kind of every member that SPEC.md names.

Python's `json` takes more than JSON has (NaN, lone surrogates, other encodings than UTF-8), and loses what
the rules depend on (whether a number was written as an integer, whether a member occurs twice).
"""

import json
import re

DEPTH = 100
TYPES = "u8", "i8", "u16", "i16", "u32", "i32", "u64", "i64", "f32", "f64"
LEAST_NORMAL = 2.0**-1022


class Members(dict):
    """An object, with its members as they stand there."""

    def __init__(self, pairs):
        super().__init__(pairs)
        self.pairs = pairs


def parse(data, version):
    """The metadata's object; ValueError where it is not as section 8, and 12 for version 2, say."""
    text = data.decode("utf-8")
    check_depth(text)
    meta = json.loads(
        text, object_pairs_hook=Members, parse_int=integer_of, parse_constant=no_constant
    )
    METADATA(meta)
    if version == 2:
        check_factor(meta["lattice"])
    return meta


def check_factor(lattice):
    FACTOR(lattice)
    factor = [float(f) for f in lattice["factor"]]
    need(all(1e-9 <= f <= 1e9 for f in factor), "a factor out of range")
    need(factor != [1.0] * 3, "all factors are 1")
    for axis in range(3):
        positive(lattice["scale"][axis] * factor[axis])
        number(lattice["offset"][axis] * factor[axis])


def check_depth(text):
    depth = 0
    for token in re.finditer(r'"(?:[^"\\]|\\.)*"|[][{}]', text, re.DOTALL):
        if token[0] in "[{":
            depth += 1
            need(depth <= DEPTH, f"JSON deeper than {DEPTH} levels")
        elif token[0] in "]}":
            depth -= 1


def integer_of(text):
    if text == "-0" or len(text) > 20:
        return float(text)
    value = int(text)
    return value if -(2**63) <= value < 2**64 else float(text)


def no_constant(word):
    raise ValueError(f"{word} is no JSON")


def need(condition, what):
    if not condition:
        raise ValueError(f"metadata: {what}")


# Each of these checks a value.


def string(value):
    need(type(value) is str, "no string")
    value.encode("utf-8")  # no lone surrogates


def boolean(value):
    need(type(value) is bool, "no boolean")


def number(value):
    finite = type(value) is int or type(value) is float and abs(value) < float("inf")
    need(finite, "no number")


def real(value):
    if type(value) is str:
        need(value in ("NaN", "inf", "-inf"), "no real")
    else:
        number(value)


def positive(value):
    number(value)
    need(value >= LEAST_NORMAL, "a scale is not positive and normal")


def rounding_error(value):
    number(value)
    need(value >= 0 and str(float(value))[0] != "-", "a rounding error below 0")


def digits(value):
    string(value)
    need(re.fullmatch("[0-9a-fA-F]{32}", value), "a hash is not 32 hexadecimal digits")


def integer(low, high):
    def check(value):
        need(type(value) is int and low <= value <= high, "no integer in its range")

    return check


def unsigned(bits):
    return integer(0, 2**bits - 1)


def word(*words):
    def check(value):
        need(type(value) is str and value in words, f"none of {words}")

    return check


def nullable(kind):
    return lambda value: value is None or kind(value)


def array(kind, count=None):
    def check(value):
        need(type(value) is list and count in (None, len(value)), "no array, or of another length")
        for item in value:
            kind(item)

    return check


def mapping(kind):
    def check(value):
        need(type(value) is Members, "no object")
        for name, item in value.pairs:
            string(name)
            kind(item)

    return check


def structure(members, optional=()):
    def check(value):
        need(type(value) is Members, "no object")
        names = [name for name, _ in value.pairs]
        for name in names:
            string(name)
        for name, kind in members.items():
            count = names.count(name)
            need(count == 1 or count == 0 and name in optional, f"{name} is missing, or there twice")
            if count:
                kind(value[name])

    return check


DEPTHS = "sixteen", "eight"
BLOCK = structure({"name": string, "offset": unsigned(64), "bytes": unsigned(64)})
LATTICE = structure({
    "scale": array(positive, 3), "offset": array(number, 3),
    "shift": array(integer(-(2**54), 2**54), 3),
})  # fmt: skip
FACTOR = structure({"factor": array(number, 3)})
ATTRIBUTE = structure({
    "name": string, "type": word(*TYPES), "description": string, "scale": real, "offset": real,
})  # fmt: skip
CLASS = structure({"present": array(unsigned(16)), "colour_depth": word(*DEPTHS)})
PLANE = structure({
    "kind": unsigned(16), "attribute": nullable(unsigned(16)), "hot": boolean,
    "value_bytes": integer(0, 65536),
})  # fmt: skip
GRID = structure({
    "name": string, "kind": word("integer", "float", "decimal"), "scale": array(real, 3),
    "offset": array(real, 3), "bounds": nullable(array(array(real, 3), 2)),
})  # fmt: skip
CRS = structure({"text": string, "unit": nullable(string)})
SOURCE = structure({
    "path": string, "format": string, "grid": GRID, "points": unsigned(64),
    "refused": mapping(unsigned(64)), "rounding_error_max": rounding_error,
    "colour_depth": nullable(word(*DEPTHS)), "colour_depth_forced": boolean, "class": unsigned(16),
    "crs": nullable(CRS), "notes": array(string), "verbatim": array(BLOCK),
})  # fmt: skip
POINT = structure({"source": unsigned(32), "place": array(number, 3), "values": string})
SET_ASIDE = structure({"hash": string, "points": array(POINT)})
TREE = structure({"path": string, "footer_hash": digits})
METADATA = structure({
    "generator": string, "lattice": LATTICE, "bounds": nullable(array(array(unsigned(32), 3), 2)),
    "node_capacity": unsigned(32), "attributes": array(ATTRIBUTE), "classes": array(CLASS),
    "normals": word("none", "source", "estimated", "oriented"), "compress": string,
    "planes": array(PLANE), "sources": array(SOURCE), "forest": array(TREE),
    "palette": nullable(array(array(unsigned(8), 3))), "set_aside": nullable(SET_ASIDE),
}, optional={"palette", "set_aside"})  # fmt: skip
