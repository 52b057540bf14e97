"""`degense track`, on a tiny real run."""

from __future__ import annotations

import json
import shutil

import numpy as np

from degense.app.cli.main import main
from degense.engine.scene.tracks import follow_points


def test_points_are_followed_written_and_scored(scene, tmp_path, capsys):
    run = str(scene.run.path)
    (tmp_path / "points.csv").write_text("frame,x,y\n0,40,30\n4,52.5,41\n")
    assert not main(["track", run, "--points", str(tmp_path / "points.csv"), "--json", str(tmp_path / "out.json")])
    assert "2 of 2 points followed" in capsys.readouterr().out
    written = json.loads((tmp_path / "out.json").read_text())
    found = follow_points(scene, np.array([[0, 40, 30], [4, 52.5, 41]]))
    assert written["unit"] == scene.unit
    assert written["scores"] == {"pairs": 0}
    for k, point in enumerate(written["points"]):
        np.testing.assert_allclose(point["pixels"], found.pixels[k], rtol=0, atol=5.001e-4)  # a thousandth of a pixel
        np.testing.assert_allclose(point["positions"], found.positions[k], rtol=0, atol=5.001e-6 * np.abs(found.positions).max())
        assert point["visible"] == found.visible[k].tolist()
    labels = {str(t): found.pixels[:, t].tolist() for t in range(scene.frames)}
    (tmp_path / "known.json").write_text(json.dumps(labels))
    assert not main(["track", run, "--points", str(tmp_path / "known.json"), "--json", str(tmp_path / "scored.json")])
    printed = capsys.readouterr().out
    scores = json.loads((tmp_path / "scored.json").read_text())["scores"]
    assert scores["pairs"] == 2 * (scene.frames - 1)
    assert "endpoint_error" in printed


def test_a_grid_covers_the_frame(scene, tmp_path, capsys):
    assert not main(["track", str(scene.run.path), "--grid", "3", "--frame", "2", "--json", str(tmp_path / "out.json")])
    queries = [point["query"] for point in json.loads((tmp_path / "out.json").read_text())["points"]]
    width, height = scene.clip_size
    np.testing.assert_allclose(queries[0], [2, width / 6, height / 6])
    np.testing.assert_allclose(queries[-1], [2, width * 5 / 6, height * 5 / 6])
    assert "of 9 points followed" in capsys.readouterr().out


def test_without_its_recording_a_run_says_how_points_move(scene, tmp_path, capsys):
    shutil.copytree(scene.run.path, tmp_path / "elsewhere" / "run")
    assert not main(["track", str(tmp_path / "elsewhere" / "run"), "--grid", "2"])
    told = capsys.readouterr().out
    assert "Points move as the reconstruction does, because the recording is missing" in told
    assert "of 4 points followed" in told
    assert not main(["track", str(scene.run.path), "--grid", "2"])
    assert "recording is missing" not in capsys.readouterr().out


def test_errors_are_sentences(scene, tmp_path, capsys):
    assert main(["track", str(scene.run.path), "--points", str(tmp_path / "absent.csv")]) == 2
    assert main(["track", str(scene.run.path), "--grid", "2", "--frame", "99"]) == 2
    told = capsys.readouterr().err
    assert "absent.csv is no file of points" in told
    assert "the frames are 0 to" in told


def test_a_clip_is_tracked_along_its_flow_without_depth(scene, tmp_path, capsys):
    clip = scene.clip
    (tmp_path / "known.json").write_text(json.dumps({"0": [[20.5, 20.5]], "2": [[20.5, 20.5]]}))
    assert main(["track", str(clip.path), "--points", str(tmp_path / "known.json"), "--json", str(tmp_path / "out.json")]) == 0
    out = json.loads((tmp_path / "out.json").read_text())
    [point] = out["points"]
    assert point["positions"] is None
    assert len(point["pixels"]) == len(point["visible"]) == len(clip)
    assert out["scores"]["pairs"] == 1
    assert out["scores"]["delta_nothing_moves"] == 1
    assert "delta" in capsys.readouterr().out
    assert main(["track", str(tmp_path), "--grid", "2"]) == 2
