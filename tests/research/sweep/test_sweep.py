"""A sweep: what it trains, that it resumes, that one failure stops nothing, and that its tables are those of the scores."""

from __future__ import annotations

import json
import shutil
import statistics
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from degense.app.cli.main import main
from degense.engine.data.readers import open_clip
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.errors import DegenseError
from degense.engine.research import surgeries  # noqa: F401  adds the kind "family"
from degense.engine.research.baselines.ceiling import MASK_CEILING
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.sweep.clips import share_flow, with_depth
from degense.engine.research.sweep.plan import CELLS, SweepPlan, plan_of
from degense.engine.research.sweep.tables import tables_of
from degense.engine.training.flow.supervision import FlowSupervision
from degense.engine.training.frames import TrainingFrames

CPU = torch.device("cpu")
SMALL = [
    "--device",
    "cpu",
    "--size",
    "64x48",
    "--frames",
    "8",
    "--iterations",
    "12",
    "--max-gaussians",
    "300",
    "--slots",
    "2",
    "--seeds",
    "1",
]


def asked(tmp_path, **sweep):
    return plan_of(BenchOptions("cpu", (0, 1), 1, False, tmp_path, out=tmp_path / "out", sweep={"slots": 2} | sweep))


@pytest.fixture(scope="module")
def exact(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sweep") / "exact"
    make_phantom(folder, PhantomOptions(frames=4, width=64, height=48, kind="family", seed=14))
    return folder


def test_what_is_asked_for(tmp_path):
    plan = asked(tmp_path, scenes="3,7", methods="degense,coupled", teachers="labels,degraded:model=flips,strength=3", depths="none")
    assert len(plan.jobs) == len({job.name for job in plan.jobs}) == 2 * 2 * 2 * 2
    assert plan.teachers == ("labels", "degraded:model=flips,strength=3")
    assert {job.seeded_teacher for job in plan.jobs} == {"labels", *(f"degraded:model=flips,strength=3,seed={seed}" for seed in (0, 1))}
    ours, coupled = plan.config("degense", 1), plan.config("coupled", 1)
    assert coupled == replace(ours, routing="coupled")
    assert (ours.seed, ours.preset) == (1, "balanced")
    assert plan.config("degensegs", 0).flow == 0
    assert asked(tmp_path, teachers="degraded").teachers == CELLS
    assert len(CELLS) == 9
    assert asked(tmp_path, scenes="4").scenes == (0, 1, 2, 3)
    assert asked(tmp_path, which="report").scenes == tuple(range(100, 120))
    assert asked(tmp_path, iterations=5, settings={"flow": 0.0}).config("degense", 0).flow == 0


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"which": "report", "settings": {"flow": 0.0}}, "nothing is chosen on the set report: leave flow out"),
        ({"which": "report", "iterations": 5}, "nothing is chosen on the set report"),
        ({"held_out_maps": Path("maps")}, "leave --held-out-maps out"),
        ({"which": "all"}, "no set 'all'"),
        ({"scenes": "100,"}, "its seeds are 0 to 99"),
        ({"which": "report", "scenes": "3,"}, "its seeds are 100 to 119"),
        ({"scenes": "many"}, "names no scenes"),
        ({"scenes": "104", "which": "report"}, "the set has 20 scenes, not 104; one of them is named with a comma: 104,"),
        ({"methods": "degense,magic"}, "no 'magic'"),
        ({"depths": "sonar"}, "no 'sonar'"),
        ({"preset": "slow"}, "slow"),
    ],
)
def test_what_there_is_not_is_refused(tmp_path, wrong, words):
    with pytest.raises(DegenseError, match=words):
        asked(tmp_path, **wrong)


def test_a_folder_keeps_one_sweep(tmp_path):
    asked(tmp_path, scenes="2").begin()
    asked(tmp_path, scenes="9").begin()
    with pytest.raises(DegenseError, match="other settings"):
        asked(tmp_path, frames=9).begin()
    with pytest.raises(DegenseError, match="holds no sweep"):
        replace(asked(tmp_path, tables_only=True), out=tmp_path / "other").begin()


def test_noisy_depth_is_that_of_a_phantom(exact, tmp_path):
    make_phantom(tmp_path / "noisy", PhantomOptions(frames=4, width=64, height=48, kind="family", seed=14, depth="noisy"))
    with_depth(exact, tmp_path / "made", "noisy", 14)
    one, other = open_clip(tmp_path / "noisy"), open_clip(tmp_path / "made")
    for index in range(4):
        assert np.array_equal(one.depth(index), other.depth(index))
        assert np.array_equal(one.frame(index), other.frame(index))
    assert not np.array_equal(one.depth(0), open_clip(exact).depth(0))


def test_without_depth_lengths_are_shares_of_the_scenes_depth(exact, tmp_path):
    with_depth(exact, tmp_path / "made", "none", 14)
    bare, clip = open_clip(tmp_path / "made"), open_clip(exact)
    unit = np.median(clip.depth(0))
    assert not bare.depth_measured
    assert np.median(bare.depth(0)) == pytest.approx(1, abs=0.1)
    np.testing.assert_allclose(bare.truth().displacement * unit, clip.truth().displacement, rtol=1e-5)
    for point in clip.truth().tracks[:3].astype(np.float64):
        for index, camera in enumerate(clip.cameras):
            np.testing.assert_allclose(bare.cameras[index].project(point[None, index] / unit)[0], camera.project(point[None, index])[0])


def test_shared_flow_is_the_measured_one(exact, tmp_path, monkeypatch):
    frames = TrainingFrames(open_clip(exact), 64 * 48, CPU)
    alone = FlowSupervision(frames)
    monkeypatch.setattr(FlowSupervision, "measure", FlowSupervision.measure)
    share_flow(tmp_path)
    for _ in range(2):
        shared = FlowSupervision(frames)
        for index, pairs in alone.pairs.items():
            for one, other in zip(pairs, shared.pairs[index], strict=True):
                assert one.to == other.to
                assert torch.equal(one.flow, other.flow)
                assert torch.equal(one.weight, other.weight)
    assert len(list(tmp_path.iterdir())) == 1


def test_a_sweep_goes_on_and_one_failure_stops_nothing(tmp_path, capsys):
    out = tmp_path / "out"
    command = ["bench", "surgeries", "--scenes", "14,3", *SMALL, "--methods", "degense,degensegs", "--out", str(out)]
    (out / "clips" / "003-64x48-8-exact").mkdir(parents=True)  # a clip that cannot be opened
    assert main(command) == 0
    said = capsys.readouterr()
    assert "2 of 4 trained, 2 failed" in said.err
    assert sorted(path.name for path in (out / "scores").iterdir()) == [
        "003-exact-labels-degense-0.error.txt",
        "003-exact-labels-degensegs-0.error.txt",
        "014-exact-labels-degense-0.json",
        "014-exact-labels-degensegs-0.json",
    ]
    assert "the baselines of scene 3 failed" in said.err
    assert "| baseline: propagated mask | 1 |" in said.out
    assert not list((out / "runs").iterdir())

    gone, kept = (out / "scores" / f"014-exact-labels-{name}-0.json" for name in ("degense", "degensegs"))
    gone.unlink()
    shutil.rmtree(out / "clips" / "003-64x48-8-exact")
    before = kept.stat().st_mtime_ns
    assert main([*command[:3], "14,", *command[4:]]) == 0
    assert "1 of 1 trained" in capsys.readouterr().err
    assert gone.exists()
    assert kept.stat().st_mtime_ns == before
    shutil.rmtree(out / "clips")
    shutil.rmtree(out / "flow")
    assert main([*command[:3], "14,", *command[4:]]) == 0  # nothing to do, so nothing is drawn
    assert not list((out / "clips").iterdir())
    tables = [json.loads(path.read_text()) for path in sorted(out.glob("*.json")) if path.name != "sweep.json"]
    assert [table["name"] for table in tables] == [
        f"surgeries-develop-balanced-64x48-exact-labels-{what}" for what in ("inspection", "masks", "motion")
    ]
    assert tables[1]["command"].startswith(
        "degense bench surgeries --set develop --scenes 14, --size 64x48 --frames 8 --teachers labels --depth exact --methods degense,"
    )


def made_up(plan, job, value):
    """Scores in which everything is `value`."""
    decoders = {"rnse": value, "argmax": value + 0.05}
    masks = {decoder: {"miou": miou, "boundary_f": value} for decoder, miou in decoders.items()}
    scores = {"psnr_mask": 30 * value, "miou": decoders, "miou_closed": {"rnse+argmax": value, "argmax": value}, "masks": masks}
    scores |= {
        "displacement_error": value,
        "true_displacement": 2.0,
        "displacement_scale": 100.0,
        "train_seconds": 10.0,
        "psnr_ceiling": 40.0,
        "inspection": {"average_precision": value, "ranked": {"right": [8, 1], "wrong": [0, 1]}},
    }
    path = plan.scores(job)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(scores))


def test_tables_are_of_the_scores(tmp_path):
    plan = replace(SweepPlan(tmp_path, scenes=(0, 1, 2), seeds=(0, 1)), methods=("degense", "coupled"))
    for job in plan.jobs:
        made_up(plan, job, 0.1 * (1 + job.scene) + 0.02 * job.seed)
    for scene in plan.scenes:
        path = tmp_path / "baselines" / f"{scene:03d}-labels.json"
        path.parent.mkdir(exist_ok=True)
        path.write_text(json.dumps({"vote": {"masks": {"labels": {"miou": 0.24, "boundary_f": 0.1}}}}))
        best = {"masks": {"labels": {"miou": 0.9 + 0.01 * scene, "boundary_f": 1.0}}}
        path.with_name(f"{scene:03d}-exact.json").write_text(json.dumps({MASK_CEILING: best}))
    masks, motion, inspection = tables_of(plan)
    ours, coupled, ceiling, of_masks, vote = masks.rows
    assert (of_masks["method"], of_masks["miou"], of_masks["miou worst"]) == (MASK_CEILING, pytest.approx(0.91), pytest.approx(0.9))
    assert (ours["decoder"], coupled["decoder"], ours["scenes"]) == ("rnse", "argmax", 3)
    assert ours["psnr"] == pytest.approx(30 * statistics.median((0.11, 0.21, 0.31)))
    assert (ceiling["psnr"], ceiling["psnr worst"]) == (40.0, 40.0)
    assert ours["psnr worst"] == pytest.approx(30 * 0.11)
    assert ours["miou"] == "0.210 †"  # the vote has 0.24
    assert coupled["miou"] == pytest.approx(0.26)
    assert ours["boundary"] == pytest.approx(0.21)
    assert (vote["method"], vote["miou"], vote["psnr"]) == ("baseline: vote", pytest.approx(0.24), None)
    assert motion.rows[0]["error"] == pytest.approx(0.21 / 2)
    assert motion.rows[0]["error worst"] == pytest.approx(0.31 / 2)
    assert inspection.rows[1]["ap"] == pytest.approx(0.21)
    assert inspection.rows[1]["pooled"] == pytest.approx(0.5)
    assert [row["method"] for row in inspection.rows] == ["degense", "coupled"]
    assert masks.markdown()
