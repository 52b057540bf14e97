"""A run whose words come from a file of text vectors, through the command line."""

from __future__ import annotations

import json

import numpy as np
import pytest
from safetensors.numpy import save_file

from degense.app.cli.main import main
from degense.engine.scene import Scene

SHORT = ("--preset", "quick", "--iterations", "60", "--max-gaussians", "1500", "--device", "cpu")


@pytest.fixture(scope="module")
def words(tiny_clip, tmp_path_factory):
    """Vectors of the clip's classes and of one thing that is not in it."""
    classes = json.loads((tiny_clip / "classes.json").read_text())["classes"]
    random = np.random.default_rng(0)
    path = tmp_path_factory.mktemp("words") / "words.safetensors"
    save_file({name: random.normal(size=64).astype(np.float32) for name in [*classes, "spleen"]}, path)
    return path


def test_a_run_speaks_as_its_file_does_and_refuses_another(tiny_clip, words, tmp_path, capsys):
    run = tmp_path / "run"
    assert main(["train", str(tiny_clip), "--out", str(run), "--encoder", str(words), *SHORT]) == 0
    name = json.loads((run / "run.json").read_text())["encoder"]
    assert name.startswith("text-vectors-")
    asked = ["segment", str(run), "--frame", "3", "--out", str(tmp_path / "m.npy"), "--prompt"]
    assert main([*asked, "Gallenblase"]) == 0
    mask = np.load(tmp_path / "m.npy", allow_pickle=False)
    labels = Scene.open(run, device="cpu").labels(3)
    truth = labels == json.loads((tiny_clip / "classes.json").read_text())["classes"].index("gallbladder")
    assert (mask & truth).sum() > 0.5 * (mask | truth).sum()
    assert main([*asked, "spleen", "--encoder", str(words)]) == 0
    assert not np.load(tmp_path / "m.npy", allow_pickle=False).any()
    capsys.readouterr()
    save_file({"liver": np.ones(64, np.float32)}, tmp_path / "other.safetensors")
    assert main([*asked, "liver", "--encoder", str(tmp_path / "other.safetensors")]) == 2
    assert f"has features of the text encoder '{name}', so 'text-vectors-" in capsys.readouterr().err
    assert main([*asked, "stomach"]) == 2
    assert "There is no text vector for 'stomach'" in capsys.readouterr().err


def test_an_encoder_without_a_teacher_is_refused(tiny_clip, words, tmp_path, capsys):
    out = str(tmp_path / "run")
    assert main(["train", str(tiny_clip), "--out", out, "--teacher", "none", "--encoder", str(words), *SHORT]) == 2
    assert "there is no teacher" in capsys.readouterr().err
