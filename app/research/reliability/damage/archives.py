"""Damages of arrays and archives: headers of .npy, members of .npz and of what torch saves."""

from __future__ import annotations

import io
import random
import re
import struct
import warnings
import zipfile
import zlib
from collections.abc import Callable, Sequence

from degense.app.research.reliability.damage.plain import OUTSIDE, binary, bits, chunk, cut

Damage = Callable[[bytes, random.Random], bytes]
#: What a damaged archive raises.
UNREADABLE = (zipfile.BadZipFile, zlib.error, EOFError, LookupError, NotImplementedError, OSError, RuntimeError, ValueError, struct.error)
LARGEST = 1 << 26  # bytes of a member that is unpacked
_SHAPE = re.compile(rb"\((?:\d+, ?)*\d*\)")
SHAPES = ("(1000000000000,)", "(-1,)", "(0, 0, 0)", "(1, " * 40, "(99999999, 99999999)", "()", "(1073741824, 1)")
TYPES = ("<f8", "<f16", "<c16", "|O", "<U1000000", "|V1000000", "|b1", ">i2", "<M8[s]", "|S0", "(1000000,)<f8", "[('a', '<f8')]")
#: Pickles that make a folder, outside of where they lie, and that are endless.
PICKLES = (
    b"\x80\x02cposix\nmkdir\n(V../../../" + OUTSIDE.encode() + b"\ntR.",
    b"\x80\x02" + b"(" * 100_000 + b".",
    b"\x80\x02]" + b"]a" * 5000 + b".",
)


def npy(data: bytes, rng: random.Random) -> bytes:
    """Another shape, type or length in the header of an array."""
    end = 10 + struct.unpack_from("<H", data, 8)[0] if len(data) > 10 else 0
    header = data[10:end]
    what = rng.randrange(4)
    if what == 0:
        header = _SHAPE.sub(rng.choice(SHAPES).encode(), header, count=1)
    elif what == 1:
        header = re.sub(rb"'[<>|=][a-zA-Z]\d+'", repr(rng.choice(TYPES)).encode(), header, count=1)
    elif what == 2:
        header = rng.choice((b"", b"{" * 9000, b"(" * 60_000, b" " * 60_000, b"__import__('os').abort()", b"[" * 500))
    else:
        version = rng.choice((b"\x01\0", b"\x02\0", b"\x03\0", b"\x09\0"))
        length = rng.choice((b"\xff\xff\xff\xff", b"\0\0\0\0", b"\xff\xff\0\0", b"\xff\xff\xff\x7f"))
        return data[:6] + version + length + data[10:]
    return data[:8] + struct.pack("<H", min(65535, len(header))) + header + data[end:]


def pickled(data: bytes, rng: random.Random) -> bytes:
    """A hostile pickle in place of one."""
    return rng.choice(PICKLES)


def npz(data: bytes, rng: random.Random) -> bytes:
    return _member(data, rng, (npy, npy, bits, cut), zipfile.ZIP_DEFLATED)


def saved_tensor(data: bytes, rng: random.Random) -> bytes:
    """A member of what torch saved: its pickle, its numbers, its version."""
    return _member(data, rng, (bits, bits, binary, chunk, cut, pickled), zipfile.ZIP_STORED)


def _member(data: bytes, rng: random.Random, damages: Sequence[Damage], packing: int) -> bytes:
    """A member of an archive damaged, taken away, or there twice, the archive around it sound; bits of one that is not sound."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as old:
            large = sum(info.file_size for info in old.infolist()) > LARGEST
            members = [] if large else [(name, old.read(name)) for name in old.namelist()]
    except UNREADABLE:
        members = []
    if not members:
        return bits(data, rng)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", packing) as new, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a name that is there twice
        chosen = rng.choice(members)[0]
        for name, content in members:
            changed = rng.choice(damages)(content, rng) if name == chosen else content
            if name != chosen or rng.random() < 0.9:
                new.writestr(name, changed)
        if rng.random() < 0.1:
            new.writestr(chosen, bytes(rng.choice((0, 10, 50_000_000))), zipfile.ZIP_DEFLATED)
    return out.getvalue()
