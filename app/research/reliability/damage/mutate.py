"""Damages files as chance and malice do: bits flipped, ends cut off, numbers and texts exchanged for impossible ones, values nested.

What a format is made of is damaged where it is meant: the values of JSON, the header of .npy and safetensors, the members of an archive,
what a gzip file or a PNG keeps packed.
"""

from __future__ import annotations

import json
import random
import re
from collections.abc import Callable
from typing import Any

from degense.app.research.reliability.damage.archives import npy, npz, saved_tensor
from degense.app.research.reliability.damage.packed import gzipped, nrrd, png
from degense.app.research.reliability.damage.plain import OUTSIDE, PLAIN, bits

NUMBERS = ("1e308", "-1e308", "1e999", "NaN", "Infinity", "-1", "0", "0.5", str(2**31), str(2**63), str(2**64), "1" + "0" * 400)
TEXTS = ("", "\0", f"../../../{OUTSIDE}", f"/{OUTSIDE}", "a" * 1_000_000, "9" * 200_000, "%s%n", "\ud800", "nan", "a\nb", "CON", "é" * 5000)
VALUES: tuple[Any, ...] = (
    *(None, True, -1, 0, 0.5, 2**31, 2**63, 10**30, 1e308, float("nan"), float("inf"), [], {}, "", [None], [[]], {"a": 1}),
    *([0] * 100_000, [1e308] * 4, "1", *TEXTS),
)
DEEP = ("[" * 300 + "]" * 300, "[" * 100_000, '{"a":' * 5000 + "1" + "}" * 5000)
_NUMBER = re.compile(rb"-?\d+(?:\.\d*)?(?:[eE][+-]?\d+)?")
_TEXT = re.compile(rb'"[^"\n]{0,200}"')


def mutated(data: bytes, name: str, rng: random.Random) -> bytes:
    """Other bytes for a file of that name, or the same with a small chance."""
    own: list[Callable[[bytes, random.Random], bytes]] = []
    suffix = name.rpartition(".")[2].lower()
    if suffix in ("json", "jsonl"):
        own = [_json_value, _json_value, _json_value, _token, _deep]
    elif suffix == "yaml":
        own = [_yaml_value, _yaml_value, _token, _line]
    elif suffix in ("toml", "xml", "csv", "txt", "cfg"):
        own = [_token, _token, _line]
    elif suffix == "nrrd":
        own = [_token, _line, nrrd, nrrd]
    elif suffix in OWN:
        own = [OWN[suffix]] * 2
    return rng.choice([*own, *own, *PLAIN])(data, rng)


def _token(data: bytes, rng: random.Random) -> bytes:
    """A number or a text in quotation marks, exchanged."""
    pattern, others = (_NUMBER, NUMBERS) if rng.random() < 0.6 else (_TEXT, tuple(f'"{text}"' for text in TEXTS))
    found = list(pattern.finditer(data[: 1 << 20]))
    if not found:
        return bits(data, rng)
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
        return bits(data, rng)
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


def _safetensors(data: bytes, rng: random.Random) -> bytes:
    """Another value in the header of a safetensors file, whose length fits."""
    length = int.from_bytes(data[:8], "little")
    header = _json_value(data[8 : 8 + length], rng) if rng.random() < 0.8 else _deep(data[8 : 8 + length], rng)
    return len(header).to_bytes(8, "little") + header + data[8 + length :]


#: Damages of formats that are not text, by the end of a file's name.
OWN = {"npz": npz, "npy": npy, "pt": saved_tensor, "safetensors": _safetensors, "png": png, "gz": gzipped}
