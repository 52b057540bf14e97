"""Damages reach what a format is made of, and a file that was damaged before can be damaged again."""

from __future__ import annotations

import gzip
import io
import random
import warnings
import zipfile
import zlib

import cv2
import numpy as np
import pytest
import torch
from PIL import Image
from safetensors.numpy import save

from degense.app.research.reliability.damage.archives import PICKLES, saved_tensor
from degense.app.research.reliability.damage.mutate import mutated
from degense.app.research.reliability.damage.packed import BOMB_SIDE, gzipped, nrrd, png

FRAME = np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8)
PNG = cv2.imencode(".png", FRAME)[1].tobytes()


def saved(write, *arrays, **named) -> bytes:
    """What numpy or torch writes."""
    out = io.BytesIO()
    write(*arrays, out) if write is torch.save else write(out, *arrays, **named)
    return out.getvalue()


def many(damage, data: bytes, count: int) -> list[bytes]:
    rng = random.Random(7)
    return [damage(data, rng) for _ in range(count)]


@pytest.mark.parametrize(
    "name", ["a.npz", "a.npy", "a.safetensors", "a.json", "a.jsonl", "a.yaml", "a.toml", "a.png", "a.gz", "a.nrrd", "a.pt"]
)
def test_what_is_damaged_is_damaged_further(name):
    """Inputs that are kept are damaged again and again, also when nothing of their format is left."""
    sound = {
        "a.npz": saved(np.savez, a=np.arange(12.0), b=np.zeros((3, 4), np.uint8)),
        "a.npy": saved(np.save, np.arange(12.0)),
        "a.safetensors": save({"a": np.zeros((2, 3), np.float32)}),
        "a.json": b'{"a": [1, {"b": "c"}], "d": null}',
        "a.jsonl": b'{"a": 1}\n{"a": 2}\n',
        "a.yaml": b"a: [1, 2]\nb: {c: d}\n",
        "a.toml": b'a = 1\nb = "c"\n',
        "a.png": PNG,
        "a.gz": gzip.compress(bytes(range(64))),
        "a.nrrd": b"NRRD0004\ntype: uchar\n\n" + gzip.compress(bytes(64)),
        "a.pt": saved(torch.save, torch.zeros(3)),
    }[name]
    rng = random.Random(0)
    for _ in range(60):
        data = sound
        for _ in range(6):
            data = mutated(data, name, rng)[:100_000]
            assert isinstance(data, bytes)


def test_what_gzip_holds_is_damaged_and_packed_again():
    content = bytes(range(256)) * 40
    bombs, sound = 0, 0
    for data in many(gzipped, gzip.compress(content), 60):
        with gzip.open(io.BytesIO(data)) as file:
            found = file.read(1 << 20)  # its check sum is looked at when the end is reached
        bombs += len(data) > 1 << 20
        sound += found != content
    assert bombs >= 1
    assert sound >= 50


def test_values_of_nrrd_are_damaged_and_packed_again():
    header = b"NRRD0004\nencoding: gzip\n\n"
    damaged = [data for data in many(nrrd, header + gzip.compress(bytes(500)), 30) if len(data) < 1 << 20]
    assert len(damaged) > 20
    assert all(data.startswith(header) for data in damaged)
    assert sum(gzip.decompress(data[len(header) :]) != bytes(500) for data in damaged) > 15


def parts(data: bytes) -> list[tuple[bytes, bytes, int]]:
    """Name, content and check sum of each chunk of a PNG."""
    found, at = [], 8
    while at < len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        end = at + 8 + length
        found.append((data[at + 4 : at + 8], data[at + 8 : end], int.from_bytes(data[end : end + 4], "big")))
        at = end + 4
    return found


def test_chunks_of_a_png_are_damaged_with_check_sums_that_are_right():
    damaged = many(png, PNG, 80)
    assert all(zlib.crc32(name + content) == crc for data in damaged for name, content, crc in parts(data))
    heads = {parts(data)[0][1][:8] for data in damaged if parts(data)[0][0] == b"IHDR"}
    assert len(heads) > 4, "other widths and heights"
    bombs = [data for data in damaged if parts(data)[0][1][:8] == 2 * BOMB_SIDE.to_bytes(4, "big")]
    assert bombs
    assert all(len(data) < 1 << 20 for data in bombs)


def test_damaged_pixels_of_a_png_are_decoded():
    """By a reader that refuses what has a wrong check sum."""
    others = 0
    for data in many(png, PNG, 60):
        if len(data) < 1 << 18:
            try:
                others += not np.array_equal(np.asarray(Image.open(io.BytesIO(data)).convert("RGB")), FRAME[..., ::-1])
            except (OSError, SyntaxError, ValueError, zlib.error, Image.DecompressionBombError):
                continue
    assert others >= 3


def test_members_of_what_torch_saved_are_damaged_in_a_sound_archive():
    data = saved(torch.save, torch.ones(200))
    names = set(zipfile.ZipFile(io.BytesIO(data)).namelist())
    hostile = 0
    for damaged in many(saved_tensor, data, 60):
        with warnings.catch_warnings(), zipfile.ZipFile(io.BytesIO(damaged)) as archive:
            assert archive.testzip() is None
            assert set(archive.namelist()) <= names
            hostile += any(archive.read(name) in PICKLES for name in archive.namelist())
    assert hostile >= 2
