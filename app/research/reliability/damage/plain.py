"""Damages of bytes, whatever they mean: bits flipped, ends cut off, numbers exchanged for extreme ones, pieces taken out."""

from __future__ import annotations

import random

#: What no input may lead to, and names of it.
OUTSIDE = "etc/passwd"
BINARY = (b"\xff" * 8, b"\0" * 8, b"\xff" * 7 + b"\x7f", b"\0" * 6 + b"\xf0\x7f", b"\xff" * 4, b"\xff\xff\xff\x7f", b"\0\0\0\x80")


def bits(data: bytes, rng: random.Random) -> bytes:
    spoilt = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8, 64)) if spoilt else 0):
        spoilt[rng.randrange(len(spoilt))] ^= 1 << rng.randrange(8)
    return bytes(spoilt)


def binary(data: bytes, rng: random.Random) -> bytes:
    """A number of the file's, mostly of its header, exchanged for an extreme one."""
    value = rng.choice(BINARY)
    at = rng.randrange(max(1, min(len(data), rng.choice((64, 512, 1 << 30)))))
    return data[:at] + value + data[at + len(value) :]


def cut(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.choice((0, 1, rng.randrange(len(data) + 1), max(0, len(data) - 1)))]


def chunk(data: bytes, rng: random.Random) -> bytes:
    """A piece twice, taken out, zeroed, or noise in its place."""
    start = rng.randrange(len(data) + 1)
    end = min(len(data), start + rng.choice((1, 16, 256, 4096)))
    piece = data[start:end]
    return data[:start] + rng.choice((piece * 2, b"", bytes(len(piece)), rng.randbytes(len(piece)), b"\0")) + data[end:]


PLAIN = (bits, binary, cut, chunk)


def plainly(data: bytes, rng: random.Random) -> bytes:
    """One of them."""
    return rng.choice(PLAIN)(data, rng)
