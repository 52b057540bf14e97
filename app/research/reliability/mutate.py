"""Damages files as chance and malice do: bits flipped, ends cut off, numbers and texts exchanged for impossible ones, values nested.

What a format is made of is damaged where it is meant: the values of JSON, the header of .npy and safetensors, the members of an archive.
"""

from __future__ import annotations

import io
import json
import random
import re
import struct
import warnings
import zipfile
import zlib
from collections.abc import Callable
from typing import Any

NUMBERS = ("1e308", "-1e308", "1e999", "NaN", "Infinity", "-1", "0", "0.5", str(2**31), str(2**63), str(2**64), "1" + "0" * 400)
BINARY = (b"\xff" * 8, b"\0" * 8, b"\xff" * 7 + b"\x7f", b"\0" * 6 + b"\xf0\x7f", b"\xff" * 4, b"\xff\xff\xff\x7f", b"\0\0\0\x80")
#: What no input may lead to, and names of it.
OUTSIDE = "etc/passwd"
TEXTS = ("", "\0", f"../../../{OUTSIDE}", f"/{OUTSIDE}", "a" * 1_000_000, "9" * 200_000, "%s%n", "\ud800", "nan", "a\nb", "CON", "é" * 5000)
VALUES: tuple[Any, ...] = (
    *(None, True, -1, 0, 0.5, 2**31, 2**63, 10**30, 1e308, float("nan"), float("inf"), [], {}, "", [None], [[]], {"a": 1}),
    *([0] * 100_000, [1e308] * 4, "1", *TEXTS),
)
DEEP = ("[" * 300 + "]" * 300, "[" * 100_000, '{"a":' * 5000 + "1" + "}" * 5000)
#: What a damaged archive raises.
UNREADABLE = (zipfile.BadZipFile, zlib.error, EOFError, LookupError, NotImplementedError, OSError, RuntimeError, ValueError, struct.error)
_NUMBER = re.compile(rb"-?\d+(?:\.\d*)?(?:[eE][+-]?\d+)?")
_TEXT = re.compile(rb'"[^"\n]{0,200}"')
_NPY_SHAPE = re.compile(rb"\((?:\d+, ?)*\d*\)")
TYPES = ("<f8", "<f16", "<c16", "|O", "<U1000000", "|V1000000", "|b1", ">i2", "<M8[s]", "|S0", "(1000000,)<f8", "[('a', '<f8')]")


def mutated(data: bytes, name: str, rng: random.Random) -> bytes:
    """Other bytes for a file of that name, or the same with a small chance."""
    own: list[Callable[[bytes, random.Random], bytes]] = []
    suffix = name.rpartition(".")[2].lower()
    if suffix in ("json", "jsonl"):
        own = [_json_value, _json_value, _json_value, _token, _deep]
    elif suffix == "yaml":
        own = [_yaml_value, _yaml_value, _token, _line]
    elif suffix in ("toml", "xml", "csv", "txt", "nrrd", "cfg"):
        own = [_token, _token, _line]
    elif suffix == "npz":
        own = [_member, _member]
    elif suffix == "npy":
        own = [_npy, _npy]
    elif suffix == "safetensors":
        own = [_safetensors, _safetensors]
    return rng.choice([*own, *own, _bits, _binary, _cut, _chunk])(data, rng)


def _bits(data: bytes, rng: random.Random) -> bytes:
    spoilt = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8, 64)) if spoilt else 0):
        spoilt[rng.randrange(len(spoilt))] ^= 1 << rng.randrange(8)
    return bytes(spoilt)


def _binary(data: bytes, rng: random.Random) -> bytes:
    """A number of the file's, mostly of its header, exchanged for an extreme one."""
    value = rng.choice(BINARY)
    at = rng.randrange(max(1, min(len(data), rng.choice((64, 512, 1 << 30)))))
    return data[:at] + value + data[at + len(value) :]


def _cut(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.choice((0, 1, rng.randrange(len(data) + 1), max(0, len(data) - 1)))]


def _chunk(data: bytes, rng: random.Random) -> bytes:
    """A piece twice, taken out, zeroed, or noise in its place."""
    start = rng.randrange(len(data) + 1)
    end = min(len(data), start + rng.choice((1, 16, 256, 4096)))
    piece = data[start:end]
    return data[:start] + rng.choice((piece * 2, b"", bytes(len(piece)), rng.randbytes(len(piece)), b"\0")) + data[end:]


def _token(data: bytes, rng: random.Random) -> bytes:
    """A number or a text in quotation marks, exchanged."""
    pattern, others = (_NUMBER, NUMBERS) if rng.random() < 0.6 else (_TEXT, tuple(f'"{text}"' for text in TEXTS))
    found = list(pattern.finditer(data[: 1 << 20]))
    if not found:
        return _bits(data, rng)
    chosen = rng.choice(found)
    return data[: chosen.start()] + rng.choice(others).encode("utf-8", "surrogatepass") + data[chosen.end() :]


def _line(data: bytes, rng: random.Random) -> bytes:
    lines = data.split(b"\n")
    at = rng.randrange(len(lines))
    lines[at : at + 1] = rng.choice(([], [lines[at]] * 2, [lines[at]] * 2000, [rng.choice(lines)], [b"\0" + lines[at]]))
    return b"\n".join(lines)


def _deep(data: bytes, rng: random.Random) -> bytes:
    found = list(re.finditer(rb"[\[{,:]", data[: 1 << 20]))
    at = rng.choice(found).end() if found else 0
    return data[:at] + rng.choice(DEEP).encode() + data[at:]


def _json_value(data: bytes, rng: random.Random) -> bytes:
    """A value somewhere in it, exchanged for another, taken away, or doubled; of lines of JSON in one of them."""
    lines = data.splitlines(keepends=True)
    at = rng.randrange(len(lines)) if lines and all(line.startswith(b"{") for line in lines) else None
    try:
        root = [json.loads(data if at is None else lines[at])]
    except (ValueError, RecursionError):
        return _bits(data, rng)
    _exchange(root, rng)
    text = json.dumps(root[0]).encode("utf-8", "surrogatepass")
    return text if at is None else b"".join((*lines[:at], text + b"\n", *lines[at + 1 :]))


def _exchange(root: list[Any], rng: random.Random) -> None:
    """A value in the only one of `root`, or somewhere in that, exchanged for another, taken away, or doubled."""
    holder: Any = root
    key: Any = 0
    while isinstance(holder[key], (dict, list)) and holder[key] and rng.random() < 0.85:
        holder = holder[key]
        key = rng.choice(list(holder)) if isinstance(holder, dict) else rng.randrange(len(holder))
    if isinstance(holder, dict) and rng.random() < 0.15:
        del holder[key]
    elif isinstance(holder, list) and holder is not root and rng.random() < 0.15:
        holder[key : key + 1] = [holder[key]] * rng.choice((0, 2, 3))
    else:
        holder[key] = rng.choice(VALUES)


def _yaml_value(data: bytes, rng: random.Random) -> bytes:
    """As `_json_value`, of plain YAML; what OpenCV calls YAML has no value that can be exchanged so."""
    import yaml

    try:
        root = [yaml.safe_load(data)]
    except (yaml.YAMLError, ValueError, RecursionError):
        return _token(data, rng)
    _exchange(root, rng)
    return yaml.safe_dump(root[0], allow_unicode=True).encode("utf-8", "surrogatepass")


def _npy(data: bytes, rng: random.Random) -> bytes:
    """Another shape, type or length in the header of an array."""
    end = 10 + struct.unpack_from("<H", data, 8)[0] if len(data) > 10 else 0
    header = data[10:end]
    what = rng.randrange(4)
    if what == 0:
        shape = rng.choice(("(1000000000000,)", "(-1,)", "(0, 0, 0)", "(1, " * 40, "(99999999, 99999999)", "()", "(1073741824, 1)"))
        header = _NPY_SHAPE.sub(shape.encode(), header, count=1)
    elif what == 1:
        header = re.sub(rb"'[<>|=][a-zA-Z]\d+'", repr(rng.choice(TYPES)).encode(), header, count=1)
    elif what == 2:
        header = rng.choice((b"", b"{" * 9000, b"(" * 60_000, b" " * 60_000, b"__import__('os').abort()", b"[" * 500))
    else:
        version = rng.choice((b"\x01\0", b"\x02\0", b"\x03\0", b"\x09\0"))
        length = rng.choice((b"\xff\xff\xff\xff", b"\0\0\0\0", b"\xff\xff\0\0", b"\xff\xff\xff\x7f"))
        return data[:6] + version + length + data[10:]
    return data[:8] + struct.pack("<H", min(65535, len(header))) + header + data[end:]


def _member(data: bytes, rng: random.Random) -> bytes:
    """A member of an archive damaged, taken away, or there twice, the archive around it sound; bits of one that is not sound."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as old:
            members = [(name, old.read(name)) for name in old.namelist()]
    except UNREADABLE:
        members = []
    if not members:
        return _bits(data, rng)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as new, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a name that is there twice
        chosen = rng.choice(members)[0]
        for name, content in members:
            changed = rng.choice((_npy, _npy, _bits, _cut))(content, rng) if name == chosen else content
            if name != chosen or rng.random() < 0.9:
                new.writestr(name, changed)
        if rng.random() < 0.1:
            new.writestr(chosen, bytes(rng.choice((0, 10, 50_000_000))))
    return out.getvalue()


def _safetensors(data: bytes, rng: random.Random) -> bytes:
    """Another value in the header of a safetensors file, whose length fits."""
    length = int.from_bytes(data[:8], "little")
    header = _json_value(data[8 : 8 + length], rng) if rng.random() < 0.8 else _deep(data[8 : 8 + length], rng)
    return len(header).to_bytes(8, "little") + header + data[8 + length :]
