"""The command line, on a tiny real run."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from degense.app.cli.main import main
from degense.app.cli.parser import build_parser
from degense.app.features.cameras.state import Stop, save_path
from degense.engine.scene.uncertainty import is_guess
from degense.widgets.splats.camera_moves import orbit
from tests.app.conftest import RUN_ARGUMENTS


def test_help_loads_nothing_heavy():
    code = (
        "import sys; from degense.app.cli.main import main\ntry: main(['--help'])\nexcept SystemExit: pass\n"
        "heavy = {'torch', 'numpy', 'cv2', 'PySide6', 'vtk', 'numba'} & set(sys.modules); raise SystemExit(str(heavy) if heavy else 0)"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    for name in build_parser()[1]:
        assert name in result.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nonsense"], "neither a command nor a file"),
        (["info", "nowhere"], "nowhere"),
        (["eval", "nowhere"], "nowhere"),
        (["render", "{run}", "--frame", "99", "--out", "{out}/x.png"], "its frames are 0 to 9"),
        (["render", "{run}", "--frame", "1", "--layer", "smell", "--out", "{out}/x.png"], "choose one of rgb"),
        (["render", "{run}", "--frame", "1", "--out", "{out}/x.bmp"], "must end in .png or .npy"),
        (["render", "{run}", "--frames", "8:3", "--out", "{out}/x"], "no such frames"),
        (["render", "{run}", "--frames", "1:3", "--out", "{out}/x.png"], "go into a folder"),
        (["render", "{run}", "--frame", "1", "--layer", "mask", "--out", "{out}/x.png"], "prompt"),
        (["segment", "{run}", "--prompt", "xyzzy", "--frame", "1", "--out", "{out}/x.png"], "xyzzy"),
        (["segment", "{run}", "--prompt", "liver", "--frame", "1", "--out", "{out}/x.png", "--decoder", "dice"], "choose one of"),
        (["export", "{run}", "--format", "doc", "--out", "{out}/x"], "choose one of ply"),
        (["export", "{run}", "--format", "masks-png", "--out", "{run}"], "not empty"),
        (["train", "{clip}", "--out", "{run}"], "not empty"),
        (["train", "{clip}", "--out", "{out}/new", "--preset", "slow"], "slow"),
        (["phantom", "{run}"], "not empty"),
    ],
)
def test_errors_are_one_line_and_status_2(arguments, words, run, tiny_clip, tmp_path, capsys):
    filled = [text.format(run=run, clip=tiny_clip, out=tmp_path) for text in arguments]
    assert main(filled) == 2
    [line] = capsys.readouterr().err.strip().splitlines()
    assert line.startswith("degense: ")
    assert words in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "arguments", [["render", "r", "--out", "x"], ["phantom", "x", "--size", "big"], ["segment", "r", "--frame", "1", "--out", "x"]]
)
def test_wrong_usage_is_status_2(arguments, capsys):
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2


def test_render_a_frame(run, tmp_path, scene):
    assert main(["render", str(run), "--frame", "4", "--out", str(tmp_path / "a.png")]) == 0
    picture = cv2.imread(str(tmp_path / "a.png"))[..., ::-1]
    assert np.array_equal(picture, scene.render_rgb(4))
    assert main(["render", str(run), "--frame", "2.5", "--layer", "displacement", "--out", str(tmp_path / "d.npy")]) == 0
    values = np.load(tmp_path / "d.npy", allow_pickle=False)
    assert np.array_equal(values, scene.render(2.5, what=("displacement",))["displacement"], equal_nan=True)
    assert len(list(tmp_path.iterdir())) == 2


def test_render_a_flight(run, tmp_path, scene):
    path, out = tmp_path / "path.json", tmp_path / "flight.mp4"
    camera = scene.camera(0)
    save_path(path, (Stop("a", camera, 0.0, 0.2), Stop("b", orbit(camera, np.array([0.0, 0.0, 90.0]), 0.3, 0.0), 9.0)))
    arguments = ["render", str(run), "--cameras", str(path), "--layer", "displacement", "--prompt", "liver", "--decoder", "threshold"]
    assert main([*arguments, "--out", str(out)]) == 0
    movie = cv2.VideoCapture(str(out))
    assert (movie.get(cv2.CAP_PROP_FRAME_COUNT), movie.get(cv2.CAP_PROP_FRAME_WIDTH)) == (6, 96)
    movie.release()
    save_path(path, (Stop("a", camera, 0.0), Stop("b", camera, 10.0)))
    assert main([*arguments, "--out", str(out)]) == 2  # the run ends at frame 9


def test_render_a_sequence(run, tmp_path):
    assert main(["render", str(run), "--frames", "2:5", "--layer", "depth", "--out", str(tmp_path / "frames")]) == 0
    assert sorted(path.name for path in (tmp_path / "frames").iterdir()) == ["000002.png", "000003.png", "000004.png"]
    assert main(["render", str(run), "--frames", ":3", "--layer", "displacement", "--out", str(tmp_path / "d.npy")]) == 0
    assert np.load(tmp_path / "d.npy", allow_pickle=False).shape == (3, 80, 96)
    assert main(["render", str(run), "--frames", "7:", "--out", str(tmp_path / "m.mp4")]) == 0
    movie = cv2.VideoCapture(str(tmp_path / "m.mp4"))
    assert int(movie.get(cv2.CAP_PROP_FRAME_COUNT)) == 3
    movie.release()


def test_a_range_fixes_the_colours(run, tmp_path):
    for name, span in (("a", "0:1000000"), ("b", "-2:-1")):
        main(["render", str(run), "--frame", "4", "--layer", "depth", f"--range={span}", "--out", str(tmp_path / f"{name}.png")])
    low, high = (cv2.imread(str(tmp_path / f"{name}.png")) for name in "ab")
    assert len(np.unique(low.reshape(-1, 3), axis=0)) <= 2  # the first colour, and grey where nothing is drawn
    assert not np.array_equal(low, high)


def test_segment_writes_what_the_engine_says(run, scene, tmp_path, capsys):
    base = ["segment", str(run), "--frame", "3", "--decoder", "threshold", "--threshold", "0.4", "--prompt", "gallbladder"]
    assert main([*base, "--out", str(tmp_path / "m.png")]) == 0
    mask = scene.query(3).similarity(scene.included("gallbladder")) > 0.4
    assert mask.any()
    assert np.array_equal(cv2.imread(str(tmp_path / "m.png"), cv2.IMREAD_UNCHANGED), mask * np.uint8(255))
    assert f"{mask.mean():.1%}" in capsys.readouterr().out
    assert main([*base, "--prompt", "liver", "--out", str(tmp_path / "m.npy")]) == 0
    both = np.load(tmp_path / "m.npy", allow_pickle=False)
    assert both.dtype == bool
    assert np.array_equal(both[0], mask)
    assert main([*base, "--prompt", "liver", "--out", str(tmp_path / "both.png")]) == 0
    values = cv2.imread(str(tmp_path / "both.png"), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(values > 0, both.any(0))
    nearer = scene.query(3).similarity(scene.included("liver")) > scene.query(3).similarity(scene.included("gallbladder"))
    assert np.array_equal(values == 2, both[1] & (nearer | ~both[0]))  # a pixel of both masks is the more similar prompt's, not the last's


def test_raw_displacement_says_how_much_of_it_is_a_guess(run, tmp_path, scene, capsys, monkeypatch):
    half = np.nanmedian(scene.render(5, what=("uncertainty",))["uncertainty"]) * scene.states.unit
    monkeypatch.setattr("degense.engine.scene.uncertainty.DOUBTFUL", half)
    out = tmp_path / "d.npy"
    assert main(["render", str(run), "--frame", "5", "--layer", "displacement", "--out", str(out)]) == 0
    drawn = scene.render(5, what=("uncertainty", "displacement"))
    share = is_guess(drawn["uncertainty"], drawn["displacement"], scene.states.depth).mean()
    assert 0 < share < 1
    assert f"{share:.1%} of the pixels hold a guess" in capsys.readouterr().out
    assert main(["render", str(run), "--frame", "5", "--layer", "support", "--out", str(out)]) == 0  # as earlier versions call it
    assert np.array_equal(np.load(out) < 0.5, scene.render(5, what=("observability",))["observability"] < 0.5)
    assert main(["render", str(run), "--frame", "5", "--layer", "depth", "--out", str(out)]) == 0
    assert capsys.readouterr().out == ""


def test_eval_writes_the_promised_keys(run, tmp_path, capsys):
    assert main(["eval", str(run), "--json", str(tmp_path / "scores.json")]) == 0
    scores = json.loads((tmp_path / "scores.json").read_text())
    promised = {"psnr_mask", "psnr_masked_product", "psnr_full", "ssim", "lpips", "miou", "displacement_error", "displacement_correlation"}
    promised |= {"spurious_displacement", "train_seconds", "gaussians", "render_fps", "query_ms"}
    assert promised <= set(scores)
    assert 0 < scores["moving"] <= scores["gaussians"]
    assert 0 < scores["uncertain_share"] < 1
    assert "psnr_mask" in capsys.readouterr().out


def test_eval_prints_no_lists(run, tmp_path, capsys):
    assert main(["eval", str(run), "--json", str(tmp_path / "scores.json")]) == 0
    printed = capsys.readouterr().out
    assert "average_precision" in printed
    assert not [line for line in printed.splitlines() if "[" in line or "ranked" in line]
    ranked = json.loads((tmp_path / "scores.json").read_text())["inspection"]["ranked"]
    assert sum(ranked["right"]) > 0  # it is in the file
    assert len(ranked["right"]) == len(ranked["wrong"]) > 10


def test_eval_without_the_clip_says_what_to_do(run, tmp_path, capsys):
    moved = run.rename(tmp_path / "alone")
    assert main(["eval", str(moved)]) == 2
    assert "--clip" in capsys.readouterr().err
    moved.rename(run)


def test_info_says_what_was_found(tiny_clip, capsys):
    assert main(["info", str(tiny_clip)]) == 0
    text = capsys.readouterr().out
    assert "10 frames, 96 × 80" in text
    assert "gallbladder" in text


def test_doctor_answers(monkeypatch, capsys):
    import degense.app.diagnostics

    monkeypatch.setattr(degense.app.diagnostics, "report", lambda: ("no GPU", False))
    assert main(["doctor"]) == 1
    assert "no GPU" in capsys.readouterr().out


def test_the_demo_draws_its_pictures(run, tiny_clip, tmp_path, monkeypatch, capsys):
    import degense.app.session.sample

    (tmp_path / "assets" / "demo").mkdir(parents=True)
    os.symlink(run, tmp_path / "assets" / "demo" / "run")
    os.symlink(tiny_clip, tmp_path / "assets" / "demo" / "clip")
    monkeypatch.setattr(degense.app.session.sample, "ASSETS", tmp_path / "assets")
    assert main(["demo", "--headless", str(tmp_path / "out")]) == 0
    names = ["displacement.png", "mask_gallbladder.png", "rgb.png", "warp.png"]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == names
    text = capsys.readouterr().out
    assert all(name in text for name in names)
    sizes = {name: cv2.imread(str(tmp_path / "out" / name)).shape for name in names}
    assert sizes["rgb.png"] == (80, 96, 3)
    assert sizes["warp.png"][1] > 96  # the colour bar


def test_a_missing_demo_is_one_sentence(monkeypatch, tmp_path, capsys):
    import degense.app.session.sample

    monkeypatch.setattr(degense.app.session.sample, "ASSETS", tmp_path)
    assert main(["demo", "--headless", str(tmp_path / "out")]) == 2
    assert "sample is missing" in capsys.readouterr().err


def start_training(clip: Path, run: Path, *more: str) -> subprocess.Popen[str]:
    arguments = ["train", str(clip), "--out", str(run), *RUN_ARGUMENTS[:2], "--iterations", "100000", "--device", "cpu", *more]
    process = subprocess.Popen(
        [sys.executable, "-m", "degense.app", *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    deadline = time.monotonic() + 120
    metrics = run / "metrics.jsonl"
    before = metrics.stat().st_size if metrics.is_file() else 0
    while not metrics.is_file() or metrics.stat().st_size == before:
        assert process.poll() is None, process.stderr and process.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.05)
    return process


def test_training_stops_in_words_and_is_resumed(tiny_clip, tmp_path):
    run = tmp_path / "run"
    process = start_training(tiny_clip, run, "--events")
    out, err = process.communicate("stop\n", timeout=120)
    events = [json.loads(line) for line in out.splitlines()]
    assert (process.returncode, err) == (0, "")
    assert events[0] == {"event": "stage", "stage": "load"}
    assert events[-1]["event"] == "stopped"
    assert events[-1]["iteration"] > 0
    assert json.loads((run / "run.json").read_text())["state"] == "stopped"
    resumed = start_training(tiny_clip, run, "--events", "--resume")
    out, _ = resumed.communicate("stop\n", timeout=120)
    assert json.loads(out.splitlines()[-1])["iteration"] > events[-1]["iteration"]


def test_a_stop_before_the_first_step_is_said_and_no_qt_was_loaded(tiny_clip, tmp_path):
    command = [sys.executable, "-X", "importtime", "-m", "degense.app", "train", tiny_clip, "--out", tmp_path / "run", "--events"]
    result = subprocess.run(command, input="stop\n", capture_output=True, text=True)
    assert json.loads(result.stdout.splitlines()[-1]) == {"event": "stopped", "iteration": 0}
    assert not (tmp_path / "run" / "run.json").exists()
    assert "degense.engine.training.trainer" in result.stderr
    assert not {"PySide6", "vtk", "pyvista"} & {line.rpartition("|")[2].strip() for line in result.stderr.splitlines()}


def test_ctrl_c_stops_training_cleanly(tiny_clip, tmp_path):
    process = start_training(tiny_clip, tmp_path / "run")
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=120)
    assert "go on with --resume" in err
    assert "Traceback" not in err
    assert json.loads((tmp_path / "run" / "run.json").read_text())["state"] == "stopped"


def test_a_closed_pipe_is_no_error(run):
    result = subprocess.run(f"{sys.executable} -m app --help | true", shell=True, capture_output=True, text=True)
    assert result.stderr == ""


def test_segment_of_a_clip_can_be_gone_on_with(run, scene, tmp_path, capsys, monkeypatch):
    out, asked = tmp_path / "masks", []
    base = ["segment", str(run), "--prompt", "gallbladder", "--prompt", "tool, not hook", "--frames"]
    original = type(scene).query
    monkeypatch.setattr(type(scene), "query", lambda self, frame, camera=None: asked.append(frame) or original(self, frame, camera))
    assert main([*base, "2:5", "--out", str(out)]) == 0
    assert asked == [2, 3, 4]
    assert main([*base, "1:6", "--out", str(out)]) == 0
    assert asked == [2, 3, 4, 1, 5]
    assert "masks of 5 frames" in capsys.readouterr().out
    assert json.loads((out / "classes.json").read_text())["classes"] == ["gallbladder", "tool, not hook"]
    assert sorted(file.name for file in (out / "labels").iterdir()) == [f"{i:06d}.png" for i in range(1, 6)]
    folders = sorted((out / "masks").iterdir())
    assert [folder.name for folder in folders] == ["01-gallbladder", "02-tool-not-hook"]
    areas = (out / "areas.csv").read_text().splitlines()
    assert areas[0] == 'frame,gallbladder,"tool, not hook"'
    masks = [cv2.imread(str(folder / "000003.png"), cv2.IMREAD_UNCHANGED) == 255 for folder in folders]
    assert masks[0].any()
    assert areas[3] == "3," + ",".join(f"{mask.mean():.6g}" for mask in masks)
    labels = cv2.imread(str(out / "labels/000003.png"), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(labels != 255, masks[0] | masks[1])
    assert main([*base, "all", "--decoder", "argmax", "--out", str(out)]) == 2
    assert "other prompts, settings or another run" in capsys.readouterr().err
    assert main([*base, "9:", "--prompt", "banana", "--out", str(tmp_path / "none")]) == 2
    assert "'banana' is not in the vocabulary" in capsys.readouterr().err
    assert not (tmp_path / "none").exists()
