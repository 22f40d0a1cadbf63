"""XXH3-128 with a seed, over many records of equal length at once, in numpy.

From the specification of xxHash; all lengths. In: an (n, length) array of bytes. Out: the low and the
high 64 bits of each record's hash.
"""

import numpy as np

MASK = 2**64 - 1
PRIME32_1, PRIME32_2, PRIME32_3 = 0x9E3779B1, 0x85EBCA77, 0xC2B2AE3D
PRIME64_1, PRIME64_2, PRIME64_3 = 0x9E3779B185EBCA87, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9
PRIME64_4, PRIME64_5 = 0x85EBCA77C2B2AE63, 0x27D4EB2F165667C5
PRIME_MX1, PRIME_MX2 = 0x165667919E3779F9, 0x9FB21C651E98DF25
SECRET = bytes.fromhex(
    "b8fe6c3923a44bbe7c01812cf721ad1cded46de9839097db7240a4a4b7b3671f"
    "cb79e64eccc0e578825ad07dccff7221b8084674f743248ee03590e6813a264c"
    "3c2852bb91c300cb88d0658b1b532ea371644897a20df94e3819ef46a9deacd8"
    "a8fa763fe39c343ff9dcbbc7c70b4f1d8a51e04bcdb45931c89f7ec9d9787364"
    "eac5ac8334d3ebc3c581a0fffa1363eb170ddd51b7f0da49d316552629d4689e"
    "2b16be587d47a1fc8ff8b8d17ad031ce45cb3a8f95160428afd7fbcabb4b407e"
)


def _u(value):
    return np.uint64(value & MASK)


def _secret64(at, secret=SECRET):
    return int.from_bytes(secret[at : at + 8], "little")


def _secret32(at):
    return int.from_bytes(SECRET[at : at + 4], "little")


def _read64(records, at):
    return np.ascontiguousarray(records[:, at : at + 8]).view("<u8")[:, 0].astype(np.uint64)


def _read32(records, at):
    return np.ascontiguousarray(records[:, at : at + 4]).view("<u4")[:, 0].astype(np.uint64)


def _multiply(a, b):
    """The 128-bit product as low and high half."""
    low32 = _u(0xFFFFFFFF)
    s = _u(32)
    al, ah, bl, bh = a & low32, a >> s, b & low32, b >> s
    ll, lh, hl, hh = al * bl, al * bh, ah * bl, ah * bh
    middle = (ll >> s) + (lh & low32) + (hl & low32)
    return (ll & low32) | (middle << s), hh + (lh >> s) + (hl >> s) + (middle >> s)


def _fold(a, b):
    low, high = _multiply(a, b)
    return low ^ high


def _avalanche(h):
    h = h ^ (h >> _u(37))
    h = h * _u(PRIME_MX1)
    return h ^ (h >> _u(32))


def _avalanche64(h):
    h = h ^ (h >> _u(33))
    h = h * _u(PRIME64_2)
    h = h ^ (h >> _u(29))
    h = h * _u(PRIME64_3)
    return h ^ (h >> _u(32))


def _swap64(h):
    return h.astype("<u8").byteswap().astype(np.uint64)


def _1_to_3(records, seed):
    length = records.shape[1]
    first, middle, last = (records[:, i].astype(np.uint64) for i in (0, length >> 1, length - 1))
    low = (first << _u(16)) | (middle << _u(24)) | last | _u(length << 8)
    swapped = low.astype("<u4").byteswap().astype(np.uint64)
    high = ((swapped << _u(13)) | (swapped >> _u(19))) & _u(0xFFFFFFFF)
    flip_low = (_secret32(0) ^ _secret32(4)) + seed
    flip_high = (_secret32(8) ^ _secret32(12)) - seed
    return _avalanche64(low ^ _u(flip_low)), _avalanche64(high ^ _u(flip_high))


def _4_to_8(records, seed):
    length = records.shape[1]
    seed ^= int.from_bytes((seed & 0xFFFFFFFF).to_bytes(4, "little"), "big") << 32
    value = _read32(records, 0) + (_read32(records, length - 4) << _u(32))
    keyed = value ^ _u((_secret64(16) ^ _secret64(24)) + seed)
    low, high = _multiply(keyed, _u(PRIME64_1 + (length << 2)))
    high = high + (low << _u(1))
    low = low ^ (high >> _u(3))
    low = (low ^ (low >> _u(35))) * _u(PRIME_MX2)
    return low ^ (low >> _u(28)), _avalanche(high)


def _9_to_16(records, seed):
    length = records.shape[1]
    low, high = _read64(records, 0), _read64(records, length - 8)
    flip_low = (_secret64(32) ^ _secret64(40)) - seed
    flip_high = (_secret64(48) ^ _secret64(56)) + seed
    m_low, m_high = _multiply(low ^ high ^ _u(flip_low), _u(PRIME64_1))
    m_low = m_low + _u((length - 1) << 54)
    high = high ^ _u(flip_high)
    m_high = m_high + high + (high & _u(0xFFFFFFFF)) * _u(PRIME32_2 - 1)
    m_low = m_low ^ _swap64(m_high)
    h_low, h_high = _multiply(m_low, _u(PRIME64_2))
    h_high = h_high + m_high * _u(PRIME64_2)
    return _avalanche(h_low), _avalanche(h_high)


def _mix16(records, at, secret_at, seed):
    low = _read64(records, at) ^ _u(_secret64(secret_at) + seed)
    high = _read64(records, at + 8) ^ _u(_secret64(secret_at + 8) - seed)
    return _fold(low, high)


def _mix32(acc, records, at1, at2, secret_at, seed):
    low, high = acc
    low = low + _mix16(records, at1, secret_at, seed)
    low = low ^ (_read64(records, at2) + _read64(records, at2 + 8))
    high = high + _mix16(records, at2, secret_at + 16, seed)
    high = high ^ (_read64(records, at1) + _read64(records, at1 + 8))
    return low, high


def _finish(acc, length, seed):
    low, high = acc
    mixed = low * _u(PRIME64_1) + high * _u(PRIME64_4) + _u((length - seed) * PRIME64_2)
    return _avalanche(low + high), _u(0) - _avalanche(mixed)


def _start(records):
    n, length = records.shape
    return np.full(n, _u(length * PRIME64_1)), np.zeros(n, np.uint64)


def _17_to_128(records, seed):
    length = records.shape[1]
    acc = _start(records)
    for i in reversed(range((length - 1) // 32 + 1)):
        acc = _mix32(acc, records, 16 * i, length - 16 * (i + 1), 32 * i, seed)
    return _finish(acc, length, seed)


def _129_to_240(records, seed):
    length = records.shape[1]
    acc = _start(records)
    for i in range(4):
        acc = _mix32(acc, records, 32 * i, 32 * i + 16, 32 * i, seed)
    acc = _avalanche(acc[0]), _avalanche(acc[1])
    for i in range(4, length // 32):
        acc = _mix32(acc, records, 32 * i, 32 * i + 16, 3 + 32 * (i - 4), seed)
    acc = _mix32(acc, records, length - 16, length - 32, 136 - 17 - 16, -seed)
    return _finish(acc, length, seed)


def _long(records, seed):
    n, length = records.shape
    secret = b"".join(
        ((_secret64(i) + (seed if i % 16 == 0 else -seed)) & MASK).to_bytes(8, "little")
        for i in range(0, 192, 8)
    )
    start = [
        PRIME32_3, PRIME64_1, PRIME64_2, PRIME64_3, PRIME64_4, PRIME32_2, PRIME64_5, PRIME32_1,
    ]
    acc = [np.full(n, _u(v)) for v in start]

    def accumulate(at, secret_at):
        values = [_read64(records, at + 8 * i) for i in range(8)]
        for i, value in enumerate(values):
            keyed = value ^ _u(_secret64(secret_at + 8 * i, secret))
            acc[i ^ 1] = acc[i ^ 1] + value
            acc[i] = acc[i] + (keyed & _u(0xFFFFFFFF)) * (keyed >> _u(32))

    stripes = (len(secret) - 64) // 8
    block = 64 * stripes
    blocks = (length - 1) // block
    for b in range(blocks):
        for i in range(stripes):
            accumulate(b * block + 64 * i, 8 * i)
        for i in range(8):
            mixed = acc[i] ^ (acc[i] >> _u(47)) ^ _u(_secret64(len(secret) - 64 + 8 * i, secret))
            acc[i] = mixed * _u(PRIME32_1)
    for i in range((length - 1 - block * blocks) // 64):
        accumulate(blocks * block + 64 * i, 8 * i)
    accumulate(length - 64, len(secret) - 64 - 7)

    def merge(at, h):
        for i in range(0, 8, 2):
            low = acc[i] ^ _u(_secret64(at + 8 * i, secret))
            high = acc[i + 1] ^ _u(_secret64(at + 8 * i + 8, secret))
            h = h + _fold(low, high)
        return _avalanche(h)

    low = merge(11, np.full(n, _u(length * PRIME64_1)))
    high = merge(len(secret) - 64 - 11, np.full(n, _u(~(length * PRIME64_2))))
    return low, high


def hash128(records, seed):
    """Low and high halves of the hashes of the rows of a uint8 array (n, length), length at least 1."""
    length = records.shape[1]
    steps = (3, _1_to_3), (8, _4_to_8), (16, _9_to_16), (128, _17_to_128), (240, _129_to_240)
    for longest, step in steps:
        if length <= longest:
            return step(records, seed)
    return _long(records, seed)


def hash128_sum(records, seed):
    """The sum modulo 2^128 of the hashes of the rows."""
    total = 0
    for at in range(0, len(records), 1 << 16):
        for half, shift in zip(hash128(records[at : at + (1 << 16)], seed), (0, 64)):
            low = int((half & _u(0xFFFFFFFF)).sum(dtype=np.uint64))
            high = int((half >> _u(32)).sum(dtype=np.uint64))
            total += (low + (high << 32)) << shift
    return total % 2**128
