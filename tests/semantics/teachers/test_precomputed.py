"""Features from files: every peer's layout is read as documented, and what does not fit is refused in one sentence."""

import pickle
import zipfile

import numpy as np
import pytest
import torch

from degense.engine.data.readers import open_clip
from degense.engine.errors import ClipError, DegenseError
from degense.engine.semantics.teachers import PrecomputedTeacher, precomputed, teacher_by_name, teacher_choices
from degense.engine.semantics.teachers.precomputed import TEXT_VECTORS
from degense.engine.semantics.text.text_vectors import write_vectors
from tests.data.readers.makers import save, tissue
from tests.semantics.teachers.peers import DIMENSION, WRITERS, class_vectors

NAMES = ("liver", "gallbladder", "fat")
WIDTH, HEIGHT = 48, 32


@pytest.fixture
def folder(tmp_path):
    """A clip of four frames without labels, and an empty folder of features with text vectors."""
    random = np.random.default_rng(0)
    for i in range(4):
        save(tmp_path / "images" / f"v_{i:03d}.png", tissue(random, WIDTH, HEIGHT))
    features = tmp_path / "features"
    features.mkdir()
    write_vectors(features / TEXT_VECTORS, dict(zip(NAMES, class_vectors(NAMES), strict=True)), "made-up")
    return features


def labels_of(index):
    labels = np.zeros((HEIGHT, WIDTH), np.uint8)
    labels[8:24, 4 + 4 * index : 24 + 4 * index] = 1
    labels[24:, 24:] = 2
    return labels


def write_all(folder, kind, frames=(0, 1, 2, 3)):
    for i in frames:
        WRITERS[kind](folder, f"v_{i:03d}", labels_of(i), class_vectors(NAMES))


@pytest.mark.parametrize("kind", WRITERS)
def test_each_layout_is_read_as_documented(folder, kind):
    write_all(folder, kind)
    clip = open_clip(folder.parent)
    teacher = PrecomputedTeacher(clip, folder, level=2 if kind == "langsplat" else 0)
    assert teacher.frames == [0, 2, 3]
    assert teacher.targets(1) is None
    assert teacher.encoder.name == "made-up"
    assert teacher.pixelwise == (kind == "langsplat")
    assert "3 of 3 training frames" in teacher.provenance
    words = teacher.encoder.encode(NAMES)
    for frame in teacher.frames:
        vectors, index = teacher.targets(frame)
        assert (vectors.dtype, index.dtype, index.shape) == (np.float32, np.int32, (HEIGHT, WIDTH))
        np.testing.assert_allclose(np.linalg.norm(vectors[np.unique(index[index >= 0])], axis=1), 1, atol=1e-3)
        best, truth = (vectors @ words.T).argmax(1)[index], labels_of(frame)
        spoken = index >= 0
        assert (best == truth)[spoken].mean() > (0.999 if kind == "langsplat" else 0.9)
        assert spoken[2:].all()
        assert spoken[:2].any() == (kind != "langsplat")


def test_channels_first_and_last_are_told_apart_by_the_text_vectors(folder):
    dense = np.random.default_rng(1).normal(size=(8, 12, DIMENSION)).astype(np.float32)
    clip = open_clip(folder.parent)
    for shape in (dense, np.moveaxis(dense, -1, 0), dense[None], np.moveaxis(dense, -1, 0)[None]):
        np.save(folder / "v_000.npy", shape)
        vectors, index = PrecomputedTeacher(clip, folder).targets(0)
        cell = dense[5, 7] / np.linalg.norm(dense[5, 7])
        np.testing.assert_allclose(vectors[index[int(5.5 * 4), int(7.5 * 4)]], cell, atol=1e-5)


def test_the_choice_of_teachers_says_what_each_would_use(folder):
    clip = open_clip(folder.parent)
    choices = {choice.name: choice for choice in teacher_choices(clip)}
    assert [name for name, choice in choices.items() if choice.available] == ["precomputed", "none"]
    assert choices["precomputed"].reason == "features in features/ beside the clip"
    assert "add labels/" in choices["labels"].reason
    write_all(folder, "langsplat")
    assert teacher_by_name("precomputed", clip).pixelwise
    again = teacher_by_name(f"precomputed:{folder}?level=2", clip)
    assert teacher_by_name(again.name, clip).provenance == again.provenance
    (folder.parent / "sam_embeddings").mkdir()
    with pytest.raises(ClipError, match="holds sam_embeddings, features; name the folder"):
        teacher_by_name("precomputed", clip)
    for wrong in ("precomputed:x?depth=2", "precomputed:x?level=two", "labels:now"):
        with pytest.raises(DegenseError, match=r"level|no teacher"):
            teacher_by_name(wrong, clip)


def _zeros(*shape, dtype=np.float32):
    return lambda path: np.save(path, np.zeros(shape, dtype))


WRONG = {
    "other dimension": (_zeros(7, 8, 12), "vectors of 7 numbers, but the text vectors beside it have 20"),
    "integers": (_zeros(DIMENSION, 8, 12, dtype=np.int32), "int32 values"),
    "flat": (_zeros(DIMENSION, 96), r"shape \[20, 96\]"),
    "two frames": (_zeros(2, DIMENSION, 8, 12), r"shape \[2, 20, 8, 12\]"),
    "either way": (_zeros(DIMENSION, 8, DIMENSION), "first or last axis"),
    "nothing": (_zeros(DIMENSION, 8, 12), "nothing but zeros"),
    "not finite": (lambda path: np.save(path, np.full((DIMENSION, 8, 12), np.nan, np.float32)), "not numbers"),
    "other shape": (lambda path: np.save(path, np.ones((DIMENSION, 8, 30), np.float32)), "not the shape of the frames"),
    "objects": (lambda path: np.save(path, np.array([{}], dtype=object), allow_pickle=True), "pickled"),
    "cut short": (lambda path: path.write_bytes(b"\x93NUMPY\x01\x00v\x00{'descr'"), "not a sound"),
}


@pytest.mark.parametrize("case", WRONG)
def test_arrays_that_do_not_fit_are_refused_by_name(folder, case):
    write, words = WRONG[case]
    write(folder / "v_000.npy")
    with pytest.raises(ClipError, match=rf"v_000\.npy.*{words}"):
        PrecomputedTeacher(open_clip(folder.parent), folder).targets(0)


def test_a_huge_array_is_refused_before_it_is_read(folder):
    path = folder / "v_000.npy"
    np.lib.format.open_memmap(path, mode="w+", dtype=np.float16, shape=(DIMENSION, 8000, 12000))  # a sparse file of 4 GB
    with pytest.raises(ClipError, match=r"v_000\.npy would take 7\.2 GB"):
        PrecomputedTeacher(open_clip(folder.parent), folder)


def test_segments_are_checked_against_their_vectors(folder):
    clip = open_clip(folder.parent)
    write_all(folder, "langsplat", frames=(0,))
    with pytest.raises(ClipError, match=r"levels 0 to 3, not 4; choose one of them with \?level="):
        PrecomputedTeacher(clip, folder, level=4)
    np.save(folder / "v_000_s.npy", np.full((4, HEIGHT, WIDTH), 99.0))
    with pytest.raises(ClipError, match=r"v_000_s\.npy must name segments −1 \(none\) to 3"):
        PrecomputedTeacher(clip, folder)
    (folder / "v_000_f.npy").unlink()
    with pytest.raises(ClipError, match=r"v_000_f\.npy with their vectors is missing"):
        PrecomputedTeacher(clip, folder)


def test_a_torch_file_that_would_run_code_is_refused(folder, tmp_path, monkeypatch):
    class Evil:
        def __reduce__(self):
            return (open, (str(tmp_path / "owned"), "w"))

    path = folder / "v_000_fmap_CxHxW.pt"
    torch.save({"map": Evil()}, path)
    clip = open_clip(folder.parent)
    with pytest.raises(ClipError, match="holds more than tensors"):
        PrecomputedTeacher(clip, folder)
    assert not (tmp_path / "owned").exists()
    path.write_bytes(pickle.dumps(Evil()))
    with pytest.raises(ClipError, match="not a saved torch tensor"):
        PrecomputedTeacher(clip, folder)
    torch.save({"map": torch.ones(3)}, path)
    with pytest.raises(ClipError, match="holds no tensor of floats"):
        PrecomputedTeacher(clip, folder)
    torch.save(torch.ones(1).half().expand(DIMENSION, 20_000, 30_000), path)  # a few bytes that unfold to 45 GB
    with pytest.raises(ClipError, match="would take"):
        PrecomputedTeacher(clip, folder)
    monkeypatch.setattr(precomputed, "MOST_BYTES", 1 << 20)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("bomb", bytes(2 << 20))
    with pytest.raises(ClipError, match=r"would take"):
        PrecomputedTeacher(clip, folder)


def test_what_is_missing_is_said(folder):
    clip = open_clip(folder.parent)
    with pytest.raises(ClipError, match=r"holds no features of this clip; they must be named like its frames, such as v_000\.npy"):
        PrecomputedTeacher(clip, folder)
    write_all(folder, "plain", frames=(1,))
    with pytest.raises(ClipError, match="held-out frames only"):
        PrecomputedTeacher(clip, folder)
    write_all(folder, "plain", frames=(0,))
    write_all(folder, "langsplat", frames=(2,))
    with pytest.raises(ClipError, match="mixes dense features and segment features"):
        PrecomputedTeacher(clip, folder)
    (folder / TEXT_VECTORS).unlink()
    with pytest.raises(DegenseError, match="text_vectors"):
        PrecomputedTeacher(clip, folder)
    with pytest.raises(ClipError, match="is no folder"):
        PrecomputedTeacher(clip, folder / "nowhere")
