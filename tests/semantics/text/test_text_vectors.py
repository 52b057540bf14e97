"""Text vectors from files, what a run keeps of its encoder, and which encoder a run refuses."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from safetensors.numpy import save_file
from safetensors.torch import save_file as save_tensors

from degense.engine.errors import DegenseError, PromptError, RunError
from degense.engine.semantics import EmbeddedEncoder, TextVectors, open_encoder, save_encoder
from degense.engine.semantics.text.text_vectors import VECTORS_FILE, read_vectors

NAMES = ("liver", "Grasper", "l_hook", "background", "widget")


@pytest.fixture
def file(tmp_path):
    random = np.random.default_rng(0)
    path = tmp_path / "words.safetensors"
    save_file({name: random.normal(size=(1, 16) if name == "liver" else 16).astype(np.float32) for name in NAMES}, path)
    return path


def test_names_are_found_in_all_their_wordings(file):
    encoder = TextVectors.read(file)
    assert encoder.dimension == 16
    rows = encoder.encode(["foie", "graspers", "the L-hook", "widget", "livre"])
    np.testing.assert_allclose(np.linalg.norm(rows, axis=1), 1, atol=1e-6)
    np.testing.assert_array_equal(rows, encoder.encode(["liver", "Grasper", "l_hook", "widget", "liver"]))
    assert encoder.expand("tool").shape == (2, 16)
    np.testing.assert_array_equal(encoder.expand("tool, not grasper"), encoder.encode(["l_hook"]))
    assert {"liver", "widget"} <= set(encoder.complete(""))
    with pytest.raises(PromptError, match=r"no text vector for 'spleen'; .* has vectors for Grasper, background, l_hook, liver, widget"):
        encoder.encode(["spleen"])
    with pytest.raises(PromptError, match="'banana' is not in the vocabulary"):
        encoder.encode(["banana"])


def test_classes_take_the_vectors_of_their_names(file):
    encoder = TextVectors.read(file).with_classes(["Leber", "hook"])
    np.testing.assert_array_equal(encoder.encode(["Leber", "hook", "tool"]), encoder.encode(["liver", "l_hook", "l_hook"]))
    with pytest.raises(PromptError, match="no text vector for 'fat'"):
        encoder.with_classes(["fat"])


def test_other_vectors_are_another_encoder(file, tmp_path):
    again, other = tmp_path / "again.safetensors", tmp_path / "other.safetensors"
    vectors, _ = read_vectors(file)
    save_file(dict(reversed(vectors.items())), again)
    save_file({**vectors, "widget": -vectors["widget"]}, other)
    assert TextVectors.read(again).name == TextVectors.read(file).name != TextVectors.read(other).name


@pytest.mark.parametrize(
    ("tensors", "complaint"),
    [
        ({"a": torch.ones(4), "b": torch.ones(5)}, "one vector of the same length"),
        ({"a": torch.ones(2, 4)}, "one vector of the same length"),
        ({"a": torch.tensor(1.0)}, "one vector of the same length"),
        ({"a": torch.zeros(4)}, "zero or not finite"),
        ({"a": torch.full((4,), torch.nan)}, "zero or not finite"),
        ({}, "0 text vectors"),
    ],
)
def test_files_that_hold_no_text_vectors_are_refused(tmp_path, tensors, complaint):
    save_tensors(tensors, tmp_path / "odd.safetensors")
    with pytest.raises(DegenseError, match=complaint):
        TextVectors.read(tmp_path / "odd.safetensors")


def test_damaged_and_missing_files_are_refused(tmp_path, file):
    file.write_bytes(file.read_bytes()[:-7])
    with pytest.raises(DegenseError, match="not a sound safetensors file"):
        TextVectors.read(file)
    with pytest.raises(DegenseError, match="does not exist"):
        TextVectors.read(tmp_path / "nothing.safetensors")


def test_a_run_keeps_its_encoder_and_refuses_another(tmp_path, file):
    run = tmp_path / "run"
    run.mkdir()
    encoder = TextVectors.read(file).with_classes(["Leber", "widget"])
    save_encoder(encoder, run)
    kept = open_encoder(encoder.name, encoder.classes, run)
    assert kept.name == encoder.name
    for text in ("foie", "widget", "tool", "background"):
        np.testing.assert_allclose(kept.expand(text), encoder.expand(text), atol=1e-6)
    assert open_encoder(encoder.name, encoder.classes, run, TextVectors.read(file)).classes == ("Leber", "widget")
    with pytest.raises(RunError, match=r"run has features of the text encoder 'text-vectors-.*', so 'embedded-surgical-1' cannot answer"):
        open_encoder(encoder.name, encoder.classes, run, EmbeddedEncoder())
    with pytest.raises(RunError, match="features are of 'clip-1'"):
        open_encoder("clip-1", encoder.classes, run)
    (run / VECTORS_FILE).unlink()
    with pytest.raises(RunError, match=r"lacks text_vectors.safetensors"):
        open_encoder(encoder.name, encoder.classes, run)
    save_encoder(EmbeddedEncoder(["liver"]), run)
    assert not (run / VECTORS_FILE).exists()
    assert open_encoder("embedded-surgical-1", ["liver"], run).classes == ("liver",)
