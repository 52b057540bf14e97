"""Real clips: what is trained and scored on them, that a changed clip is trained anew, and that tables are those of the scores."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from degense.app.cli.main import main
from degense.engine.data.readers import open_clip
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.errors import DegenseError
from degense.engine.metrics.image import psnr
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.real_clips.plan import ClipsPlan, plan_of
from degense.engine.research.real_clips.tables import tables_of
from degense.engine.research.real_clips.work import held_out_labels
from degense.engine.semantics.teachers import default_teacher

MARKS = [[20.5, 20.5], [40.5, 24.5]]
SMALL = ["--iterations", "12", "--max-gaussians", "300", "--slots", "2", "--seeds", "1", "--device", "cpu"]


@pytest.fixture(scope="module")
def clips(tmp_path_factory) -> Path:
    """`labelled`: label maps of all frames; `masked`: tools are masked; `one`: one label map, no cameras; `marked`: a video and points."""
    folder = tmp_path_factory.mktemp("real")
    absent = {
        "labelled": ("gt.npz",),
        "masked": ("gt.npz", "depth", "labels", "classes.json"),
        "one": ("gt.npz", "depth", "camera.json"),
        "marked": ("gt.npz", "depth", "labels", "classes.json", "camera.json", "images", "surgery.json"),
    }
    for name, gone in absent.items():
        make_phantom(folder / name, PhantomOptions(frames=10, width=64, height=48, tool_masks=name == "masked"))
        frames = [cv2.imread(str(path)) for path in sorted((folder / name / "images").iterdir())]
        for path in (folder / name / part for part in gone if (folder / name / part).exists()):
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    for path in sorted((folder / "one" / "labels").iterdir())[1:]:
        path.unlink()
    video = cv2.VideoWriter(str(folder / "marked" / "clip.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 25, (64, 48))
    for frame in frames:
        video.write(frame)
    video.release()
    away = [[x + 3, y + 4] for x, y in MARKS]  # five pixels from where the points are later
    (folder / "marked" / "labels.json").write_text(json.dumps({"0": away, "4": MARKS, "9": MARKS}))
    return folder


def asked(out: Path, *clips: Path, **sweep) -> ClipsPlan:
    return plan_of(BenchOptions("cpu", (0,), 1, False, out, clips=clips, out=out, sweep={"slots": 2} | sweep))


def tables_in(out: Path) -> dict[str, dict]:
    """The rows of each table by method."""
    found = [json.loads(path.read_text()) for path in sorted(out.glob("clips-*.json"))]
    return {table["name"]: {row["method"]: row for row in table["rows"]} for table in found}


def test_clips_of_every_kind_from_end_to_end(clips, tmp_path, capsys):
    out = tmp_path / "out"
    named = [word for name in ("labelled", "masked", "one", "marked/clip.avi") for word in ("--clip", str(clips / name))]
    command = ["bench", "clips", *named, *SMALL, "--methods", "degense", "--out", str(out)]
    assert main(command) == 0
    said = capsys.readouterr()
    assert "4 of 4 trained" in said.err
    assert "## The clip masked" in said.out
    assert not list((out / "runs").iterdir())
    tables = tables_in(out)
    assert list(tables) == ["clips-labelled", "clips-marked-clip", "clips-masked", "clips-one"]
    pictures = {"method", "seconds", "psnr", "ssim"}
    columns = {name: set(rows["degense"]) for name, rows in tables.items()}
    assert columns["clips-masked"] == columns["clips-one"] == pictures  # the label map of `one` is trained on, so it is not scored
    assert columns["clips-labelled"] == pictures | {"miou"}
    assert columns["clips-marked-clip"] == pictures | {"delta", "error", "median", "followed"}
    assert "baseline: majority vote" in tables["clips-labelled"]

    clip = open_clip(clips / "masked")
    expected = np.mean([psnr(clip.frame(before), clip.frame(frame), clip.valid(frame)) for before, frame in ((0, 1), (8, 9))])
    assert tables["clips-masked"]["baseline: nearest training frame"]["psnr"] == [pytest.approx(expected)]
    still = tables["clips-marked-clip"]["baseline: nothing moves"]
    assert (still["error"], still["median"], still["delta"]) == ([5.0], [5.0], [pytest.approx(4 / 5)])  # 5 px: within 8, 16, 32, 64
    ours = tables["clips-marked-clip"]["degense"]
    assert isinstance(ours["delta"], str) or ours["delta"][0] >= 4 / 5  # marked with †, or not below a baseline

    kept = {path: path.stat().st_mtime_ns for path in (out / "scores").glob("*.json")}
    assert main(command) == 0
    assert "trained" not in capsys.readouterr().err  # nothing is done again
    assert {path: path.stat().st_mtime_ns for path in (out / "scores").glob("*.json")} == kept
    saved = json.loads((out / "clips-masked-cpu.json").read_text())
    assert saved["command"].startswith(
        "degense bench clips --clip labelled --clip masked --clip one --clip marked-clip --methods degense --preset"
    )


def test_teachers_and_what_is_scored(clips):
    found = {name: open_clip(clips / name) for name in ("labelled", "masked", "one")}
    assert {name: default_teacher(clip) for name, clip in found.items()} == {"labelled": "labels", "masked": "none", "one": "labels"}
    assert {name: held_out_labels(clip) for name, clip in found.items()} == {"labelled": [1, 9], "masked": [], "one": []}


def test_a_changed_clip_is_another_one(clips, tmp_path):
    copy = tmp_path / "masked"
    shutil.copytree(clips / "masked", copy)
    before = asked(tmp_path / "out", copy).jobs[0].name
    assert asked(tmp_path / "out", copy).jobs[0].name == before
    for path in (copy / "masks").iterdir():
        mask = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        mask[40:] = 255  # a strip at the lower edge that is not to be scored
        cv2.imwrite(str(path), mask)
    assert not open_clip(copy).valid(1)[40:].any()
    assert asked(tmp_path / "out", copy).jobs[0].name != before


@pytest.mark.parametrize(
    ("sweep", "words"),
    [
        ({"scenes": "3", "depths": "none"}, "leave --scenes, --depth out"),
        ({"methods": "magic"}, "no 'magic'"),
        ({"preset": "slow"}, "slow"),
    ],
)
def test_what_there_is_not_is_refused(clips, tmp_path, sweep, words):
    with pytest.raises(DegenseError, match=words):
        asked(tmp_path, clips / "masked", **sweep)


def test_clips_are_named_and_told_apart(clips, tmp_path):
    with pytest.raises(DegenseError, match="each with --clip"):
        asked(tmp_path)
    with pytest.raises(DegenseError, match="2 clips are called 'masked'"):
        asked(tmp_path, clips / "masked", clips / "masked")


def made_up(plan: ClipsPlan, method: str, seed: int, **scores) -> None:
    [job] = [job for job in plan.jobs if (job.method, job.seed) == (method, seed)]
    path = plan.scores(job)
    path.parent.mkdir(parents=True, exist_ok=True)
    facts = {"clip_size": [64, 48], "clip_frames": 10, "poses": "given", "teacher": "none", "frames": [1, 9], "valid_share": 0.9}
    path.write_text(json.dumps(facts | scores))


def test_tables_are_of_the_scores(clips, tmp_path):
    plan = replace(asked(tmp_path, clips / "masked", methods="degense,coupled,surgtpgs"), seeds=(0, 1))
    with pytest.raises(DegenseError, match="holds no scores"):
        tables_of(plan)
    for seed in (0, 1):
        made_up(plan, "degense", seed, psnr_mask=30.0 + seed, tracks={"endpoint_error": 4.0, "pairs": 6, "points": 2})
        made_up(plan, "coupled", seed, psnr_mask=25.0 + seed, tracks={"endpoint_error": 9.0, "pairs": 6, "points": 2})
    (tmp_path / "baselines").mkdir()
    still = {"psnr_mask": 28.0, "tracks": {"endpoint_error": 5.0}}
    (tmp_path / "baselines" / f"{plan.scenes[0].slug}.json").write_text(json.dumps({"still": still}))
    [table] = tables_of(plan)
    ours, coupled, missing, baseline = table.rows
    assert (ours["psnr"], ours["error"]) == ([30.0, 31.0], [4.0, 4.0])
    assert (coupled["psnr"], coupled["error"]) == ("25.50 (25.00–26.00) †", "9.0 (9.0–9.0) †")  # below 28 dB, above 5 px
    assert missing == {"method": "surgtpgs", "psnr": None, "error": None}
    assert baseline == {"method": "baseline: still", "psnr": [28.0], "error": [5.0]}
    assert "90% of the pixels are valid" in table.protocol
