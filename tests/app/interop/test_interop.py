"""Runs in other programs: napari's reader plugin, and rerun."""

from __future__ import annotations

import importlib
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
import pytest
import yaml

import degense.app.interop.napari_reader as napari_reader
from degense.app.cli.main import main
from degense.app.session.sample import demo_run
from degense.engine.scene import Scene
from degense.engine.scene.clip_query import decode_frame
from degense.engine.semantics.prompts import PromptSet
from tests.house.source import ROOT

RUN = str(demo_run())


def test_the_manifest_names_what_there_is():
    """npe2 finds the manifest by an entry point, and the reader by the manifest."""
    manifest = yaml.safe_load((ROOT / "app" / "interop" / "napari.yaml").read_text(encoding="utf-8"))
    [command] = manifest["contributions"]["commands"]
    module, name = command["python_name"].split(":")
    assert getattr(importlib.import_module(module), name) is napari_reader.get_reader
    [reader] = manifest["contributions"]["readers"]
    assert reader == {"command": command["id"], "accepts_directories": True, "filename_patterns": ["*"]}
    assert '[project.entry-points."napari.manifest"]' in (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    for entry in entry_points(group="napari.manifest", name="degense"):
        assert entry.value == "degense.app.interop:napari.yaml"
    command_line = [sys.executable, "-m", "npe2", "validate", "--imports", str(ROOT / "app" / "interop" / "napari.yaml")]
    told = subprocess.run(command_line, capture_output=True, text=True)
    assert told.returncode == 0, told.stdout + told.stderr


def test_napari_reads_a_run_frame_by_frame(tmp_path):
    assert napari_reader.get_reader(str(tmp_path)) is None
    assert napari_reader.get_reader([RUN]) is None
    layers = napari_reader.get_reader(RUN)(RUN)
    assert [kind for *_, kind in layers] == ["image", "image", "image", "labels"]
    (colours, about, _), (moved, *_), _, (masks, *_) = layers
    assert (colours.shape, colours.dtype, about["rgb"]) == ((24, 224, 288, 3), np.uint8, True)
    scene = Scene.open(demo_run())
    assert np.array_equal(colours[5], scene.render_rgb(5))
    assert np.array_equal(colours[np.int64(5), 10:20, :, 0], scene.render_rgb(5)[10:20, :, 0])
    assert colours[-1].shape == (224, 288, 3)
    assert colours[2:4].shape == (2, 224, 288, 3)
    assert np.nanmax(moved[23]) > 5
    assert np.array_equal(masks[7], decode_frame(scene, PromptSet(scene.classes), 7).numbers)
    with pytest.raises(IndexError):
        colours[24]


def test_rerun_gets_cameras_frames_and_gaussians(tmp_path):
    out = tmp_path / "a.rrd"
    assert main(["view", RUN, "--rerun", "--save", str(out)]) == 0
    written = out.read_bytes()
    for name in (b"/scene/camera/image", b"/scene/gaussians", b"/displacement", b"/recorded", b"GaussianSplats3D:centers"):
        assert name in written


def test_rerun_is_asked_for_in_a_sentence(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert main(["view", RUN, "--rerun", "--save", str(tmp_path / "a.rrd")]) == 2
    assert "pip install 'degense[rerun]'" in capsys.readouterr().err
    assert not [*Path(tmp_path).iterdir()]
