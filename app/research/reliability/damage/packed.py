"""Damages of what files keep packed, or with a check sum: unpacked before and packed again, so that the check sum does not refuse it first.

Some are bombs: a few bytes that unpack to gigabytes.
"""

from __future__ import annotations

import gzip
import random
import struct
import zlib
from functools import cache

from degense.app.research.reliability.damage.plain import bits, plainly

#: The most that is unpacked: what was damaged before may be a bomb.
MOST = 16 << 20
SIGNATURE = b"\x89PNG\r\n\x1a\n"
LENGTHS = (0, 1, 255, 65_535, 100_000, 2**31 - 1, 2**31, 2**32 - 1)
ADDED = (b"PLTE", b"tRNS", b"iCCP", b"zTXt", b"iTXt", b"eXIf", b"acTL", b"fcTL", b"IDAT", b"IEND", b"sBIT", b"gAMA")
BOMB_SIDE = 20_000  # pixels of a picture of zeros
Chunks = list[tuple[bytes, bytes]]


def gzipped(data: bytes, rng: random.Random) -> bytes:
    """What a gzip file holds damaged, or gigabytes after it; bits of one that is not sound."""
    if rng.random() < 0.05:
        return data + _zeros_gzipped()
    content = _unpacked(data, 31)
    return bits(data, rng) if content is None else gzip.compress(plainly(content, rng), mtime=0)


def nrrd(data: bytes, rng: random.Random) -> bytes:
    """The values of an NRRD file, which follow its header, damaged."""
    header, gap, values = data.partition(b"\n\n")
    return header + gap + (gzipped if values.startswith(b"\x1f\x8b") else plainly)(values, rng)


def png(data: bytes, rng: random.Random) -> bytes:
    """A PNG whose chunks are damaged, their check sums right; bits of one that is not sound."""
    chunks = _chunks(data)
    if not chunks or len(chunks[0][1]) != 13:
        return bits(data, rng)
    what = rng.random()
    if what < 0.05:
        size = struct.pack(">IIBBBBB", BOMB_SIDE, BOMB_SIDE, 8, 0, 0, 0, 0)
        return SIGNATURE + _packed([(b"IHDR", size), (b"IDAT", _zeros_packed()), (b"IEND", b"")])
    if what < 0.3:
        chunks[0] = (b"IHDR", _header(chunks[0][1], rng))
    elif what < 0.6:
        pixels = _unpacked(b"".join(content for name, content in chunks if name == b"IDAT"), 15)
        rest = [chunk for chunk in chunks if chunk[0] not in (b"IDAT", b"IEND")]
        chunks = [*rest, (b"IDAT", zlib.compress(plainly(pixels or b"", rng))), (b"IEND", b"")]
    elif what < 0.75:
        at = rng.randrange(len(chunks))
        chunks[at] = (chunks[at][0], plainly(chunks[at][1], rng))
    elif what < 0.9:
        content = rng.choice((b"", rng.randbytes(12), bytes(768), b"a\0\0" + zlib.compress(bytes(MOST))))
        chunks.insert(rng.randrange(len(chunks) + 1), (rng.choice(ADDED), content))
    else:
        at = rng.randrange(len(chunks))
        chunks[at : at + 1] = rng.choice(([], [chunks[at]] * 2, [chunks[at]] * 2000, [rng.choice(chunks), chunks[at]]))
    return SIGNATURE + _packed(chunks)


def _header(content: bytes, rng: random.Random) -> bytes:
    """Another width or height, or another kind of pixels."""
    numbers = list(struct.unpack(">IIBBBBB", content))
    at = rng.choice((0, 0, 1, 1, 2, 3, 6))
    numbers[at] = rng.choice(LENGTHS) if at < 2 else rng.choice((0, 1, 2, 3, 4, 6, 8, 16, 255))
    return struct.pack(">IIBBBBB", *numbers)


def _chunks(data: bytes) -> Chunks:
    """Names and contents; none where it is no PNG."""
    found: Chunks = []
    at = len(SIGNATURE)
    while data.startswith(SIGNATURE) and at + 12 <= len(data) and len(found) < 4000:
        length = int.from_bytes(data[at : at + 4], "big")
        found.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + length]))
        at += 12 + length
    return found


def _packed(chunks: Chunks) -> bytes:
    sums = (zlib.crc32(name + content) for name, content in chunks)
    return b"".join(
        struct.pack(">I", len(content)) + name + content + struct.pack(">I", crc) for (name, content), crc in zip(chunks, sums, strict=True)
    )


def _unpacked(data: bytes, window: int) -> bytes | None:
    """What zlib makes of it, at most `MOST` bytes; None where it is no such thing."""
    try:
        return zlib.decompressobj(window).decompress(data, MOST)
    except zlib.error:
        return None


@cache
def _zeros_gzipped() -> bytes:
    """Two gigabytes of zeros."""
    return gzip.compress(bytes(64 << 20), mtime=0) * 32


@cache
def _zeros_packed() -> bytes:
    """The pixels of a grey picture of `BOMB_SIDE`."""
    packer = zlib.compressobj()
    rows = b"".join(packer.compress(bytes(1 + BOMB_SIDE)) for _ in range(BOMB_SIDE))
    return rows + packer.flush()
