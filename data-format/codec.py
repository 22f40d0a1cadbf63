"""Compressed planes, section 6: LZ4 blocks in plain Python, Zstandard frames where a library is there.

The standard library has Zstandard from Python 3.14 on (`compression.zstd`); else `zstandard` serves.
"""


class NoLibrary(Exception):
    """Python cannot read this plane without a library."""


def runs(encoding, stored, value_bytes, points):
    """The values of a compressed plane, `points * value_bytes` bytes; ValueError where they are damaged."""
    lengths = [int.from_bytes(stored[4 * i : 4 * i + 4], "little") for i in range(value_bytes)]
    values, at = bytearray(points * value_bytes), 4 * value_bytes
    if at + sum(lengths) != len(stored):
        raise ValueError("the runs of a compressed plane do not fill it")
    for byte, length in enumerate(lengths):
        run = stored[at : at + length]
        at += length
        if length > points:
            raise ValueError("a run is longer than its values")
        if length < points:
            run = (lz4_block if encoding == 2 else zstd_frame)(run, points)
        values[byte::value_bytes] = run
    return bytes(values)


def lz4_block(data, length):
    """An LZ4 block that holds `length` bytes (lz4_Block_format.md of the LZ4 project)."""
    out, at = bytearray(), 0
    try:
        while True:
            token = data[at]
            literals, at = lz4_length(data, at + 1, token >> 4)
            if at + literals > len(data):
                raise ValueError("an LZ4 block ends too early")
            out += data[at : at + literals]
            at += literals
            if at == len(data):
                break
            distance = data[at] | data[at + 1] << 8
            match, at = lz4_length(data, at + 2, token & 15)
            match += 4
            if not 0 < distance <= len(out) or len(out) + match > length:
                raise ValueError("an LZ4 block points out of its values")
            start = len(out) - distance
            # Copies may overlap: what was just written is read again.
            seed = bytes(out[start : start + match])
            out += (seed * (match // len(seed) + 1))[:match]
    except IndexError:
        raise ValueError("an LZ4 block ends too early") from None
    if len(out) != length:
        raise ValueError("an LZ4 block has not one byte a point")
    return out


def lz4_length(data, at, length):
    """A length of 15 goes on in the bytes that follow, up to the first that is not 255."""
    if length == 15:
        while True:
            length += data[at]
            at += 1
            if data[at - 1] != 255:
                break
    return length, at


def zstd_frame(data, length):
    """A Zstandard frame that holds `length` bytes (RFC 8878)."""
    try:
        from compression import zstd

        out = zstd.ZstdDecompressor().decompress(data, max_length=length + 1)
    except ImportError:
        out = zstandard_frame(data, length)
    except Exception as fault:
        raise ValueError(f"a Zstandard frame: {fault}") from None
    if len(out) != length:
        raise ValueError("a Zstandard frame has not one byte a point")
    return out


def zstandard_frame(data, length):
    try:
        import zstandard
    except ImportError:
        raise NoLibrary("Zstandard asks for Python 3.14 or the package `zstandard`") from None
    try:
        return zstandard.ZstdDecompressor().decompressobj().decompress(data)[: length + 1]
    except zstandard.ZstdError as fault:
        raise ValueError(f"a Zstandard frame: {fault}") from None
