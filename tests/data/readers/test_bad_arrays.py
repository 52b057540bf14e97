"""Whatever is wrong with the arrays, classes and cameras of a clip, the user gets one sentence that names the file and the reason."""

import json
import pickle
import shutil
import tracemalloc
import zipfile

import numpy as np
import pytest

from degense.engine.data.files.numpy_files import npz_headers, read_npz
from degense.engine.data.readers import open_clip
from degense.engine.errors import ClipError
from tests.data.readers.makers import HEIGHT, WIDTH, fails, save, write_camera


def pickled(path):
    with path.open("wb") as file:
        np.lib.format.write_array(file, np.array([{"a": print}], dtype=object), allow_pickle=True)


@pytest.mark.parametrize("kind", ["cut", "text", "pickle", "object", "complex", "npz"])
def test_unsound_npy(endonerf, kind):
    path = endonerf / "poses_bounds.npy"
    if kind == "cut":
        path.write_bytes(path.read_bytes()[:-100])
    elif kind == "text":
        path.write_text("1 0 0")
    elif kind == "pickle":
        path.write_bytes(pickle.dumps(np.eye(3)))
    elif kind == "object":
        pickled(path)
    elif kind == "complex":
        np.save(path, np.zeros((5, 17), complex))
    else:
        np.savez(endonerf / "x.npz", a=np.eye(3))
        path.write_bytes((endonerf / "x.npz").read_bytes())
    fails(endonerf, "poses_bounds.npy")


def test_npy_that_announces_more_than_it_holds(frames):
    (frames / "depth").mkdir()
    for i in range(4):
        np.save(frames / f"depth/{i:06d}.npy", np.ones((HEIGHT, WIDTH), np.float32))
    bomb = (frames / "depth/000002.npy").read_bytes().replace(b"(64, 96)", b"(99999, 99999)", 1)
    (frames / "depth/000002.npy").write_bytes(bomb)
    fails(frames, "depth", "000002.npy is not a sound .npy file")


def test_depth_of_another_size_or_without_depth(frames):
    (frames / "depth").mkdir()
    for i in range(4):
        np.save(frames / f"depth/{i:06d}.npy", np.ones((HEIGHT, WIDTH + 1), np.float32))
    fails(frames, "000000.npy has shape [64, 97]")
    for i in range(4):
        np.save(frames / f"depth/{i:06d}.npy", np.full((HEIGHT, WIDTH), np.nan, np.float32))
    fails(frames, "holds no depth")


@pytest.mark.parametrize(
    "text",
    [
        "{",
        "[]",
        '{"classes": []}',
        '{"classes": "liver"}',
        '{"classes": ["a", 3]}',
        '{"classes": ["a", "a"]}',
        '{"classes": ["", "b"]}',
        "[" * 5000,
    ],
)
def test_malformed_classes(frames, text):
    save(frames / "labels/000001.png", np.zeros((HEIGHT, WIDTH), np.uint8))
    (frames / "classes.json").write_text(text)
    fails(frames, "classes.json")


def test_labels_without_classes_beyond_them_or_for_no_frame(frames):
    labels = np.zeros((HEIGHT, WIDTH), np.uint8)
    save(frames / "labels/000001.png", labels)
    fails(frames, "no classes.json")
    (frames / "classes.json").write_text(json.dumps({"classes": ["a", "b"]}))
    labels[3, 3] = 2
    save(frames / "labels/000001.png", labels)
    fails(frames, "000001.png has the label value 2", "names only 2 classes")
    save(frames / "labels/000001.png", labels * 0)
    save(frames / "labels/000009.png", labels * 0)
    fails(frames, "000009.png belongs to no frame")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"fx": None}, "needs a number 'fx'"),
        ({"fx": "90"}, "needs a number 'fx'"),
        ({"cx": float("nan")}, "NaN is no number"),
        ({"fy": -3}, "not positive"),
        ({"width": 640}, "is for 640 × 64 pixels"),
        ({"viewmats": [[1, 2], [3]]}, "not a list of 4 × 4 matrices"),
        ({"viewmats": np.tile(np.eye(4), (3, 1, 1)).tolist()}, "must be [4, 4, 4]"),
        ({"viewmats": np.tile(2 * np.eye(4), (4, 1, 1)).tolist()}, "no rigid map"),
        ({"viewmats": np.tile(np.diag([1.0, 1, -1, 1]), (4, 1, 1)).tolist()}, "no rotation"),
    ],
)
def test_wrong_camera_json(frames, changes, words):
    write_camera(frames, **changes)
    fails(frames, "camera.json", words)


def truth(count=4, **changes):
    arrays = {"displacement": np.zeros((count, HEIGHT, WIDTH, 3), np.float32), "cautery": np.zeros((count, HEIGHT, WIDTH), bool)}
    return {k: v for k, v in (arrays | changes).items() if v is not None}


def test_wrong_truth(frames):
    path = frames / "gt.npz"
    np.savez_compressed(path, **truth(3))
    fails(frames, "gt.npz", "'displacement' is float32 [3, 64, 96, 3], but must be float [4, 64, 96, 3]")
    np.savez_compressed(path, **truth(cautery=None))
    fails(frames, "gt.npz has no array 'cautery'")
    np.savez_compressed(path, **truth(cautery=np.zeros((4, HEIGHT, WIDTH), object)))
    fails(frames, "gt.npz", "'cautery' is object")
    np.savez_compressed(path, **truth())
    path.write_bytes(path.read_bytes()[:-200])
    fails(frames, "gt.npz is not a sound .npz archive")


def test_damaged_truth_is_found_when_it_is_read(frames):
    path = frames / "gt.npz"
    np.savez(path, **truth(displacement=np.random.default_rng(8).random((4, HEIGHT, WIDTH, 3)).astype(np.float32)))
    with zipfile.ZipFile(path) as archive:
        offset = archive.getinfo("displacement.npy").header_offset
    data = bytearray(path.read_bytes())
    data[offset + 5000] ^= 255
    path.write_bytes(data)
    clip = open_clip(frames)
    with pytest.raises(ClipError, match=r"gt\.npz: the array 'displacement' is damaged"):
        clip.truth()


def npy_with(header: bytes, length: int | None = None, version: bytes = b"\x01\x00") -> bytes:
    size = (len(header) if length is None else length).to_bytes(2 if version == b"\x01\x00" else 4, "little")
    return b"\x93NUMPY" + version + size + header


@pytest.mark.parametrize(
    "content",
    [
        npy_with(b"{'descr': '<f8', 'fortran_order': False, 'shape': (2,", 65_000),
        npy_with(b"{" * 9000, version=b"\x02\x00"),
        npy_with(b" " * (3 << 20), version=b"\x02\x00"),
        npy_with(b"", 2**32 - 1, b"\x03\x00"),
        npy_with(b"{'descr': '<f8', 'fortran_order': False, 'shape': (-1,), }\n"),
        npy_with(b"((((\n"),
    ],
)
def test_headers_that_are_none(frames, content):
    """Endless, cut short, unclosed or of negative size; alone and in an archive."""
    depth = frames / "depth"
    depth.mkdir()
    for index in range(4):
        (depth / f"{index:06d}.npy").write_bytes(content)
    fails(frames, "is not a sound .npy file")
    shutil.rmtree(depth)
    with zipfile.ZipFile(frames / "gt.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("displacement.npy", content)
    fails(frames, "gt.npz is not a sound .npz archive")


def test_an_array_of_an_archive_takes_no_more_memory_than_it_holds(tmp_path):
    """Its header announces two gigabytes; there are a hundred bytes."""
    path = tmp_path / "a.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a.npy", npy_with(b"{'descr': '<f8', 'fortran_order': False, 'shape': (1024, 262144), }\n") + bytes(100))
    assert npz_headers(path)["a"][0] == (1024, 262_144)
    tracemalloc.start()
    try:
        with pytest.raises(ClipError, match="'a' is damaged"):
            read_npz(path, "a")
        assert tracemalloc.get_traced_memory()[1] < 64 << 20
    finally:
        tracemalloc.stop()


def test_an_archive_is_read_as_numpy_reads_it(tmp_path):
    arrays = {"a": np.asfortranarray(np.arange(6.0).reshape(2, 3)), "b": np.array(True), "c": np.zeros((0, 3), np.float16)}
    np.savez_compressed(tmp_path / "a.npz", **arrays)
    for name, array in arrays.items():
        found = read_npz(tmp_path / "a.npz", name)
        assert found.dtype == array.dtype
        assert np.array_equal(found, array)
