"""Numbers over long trainings: what was planted is found, and tiny trainings are sound, stopped and gone on with."""

from __future__ import annotations

import json
import shutil

import pytest
import torch

from degense.app.cli.main import main
from degense.app.research.reliability.numerics import NumericsPlan, drawings, long_row, non_finite_of, pair_row, tensors_apart, train_all
from degense.app.session.sample import demo_run
from degense.engine.store.files import read_tensors, write_tensors


@pytest.fixture
def runs(tmp_path):
    """Two equal finished runs, with scores."""
    made = [shutil.copytree(demo_run(), tmp_path / name) for name in ("one", "two")]
    for run in made:
        info = json.loads((run / "run.json").read_text(encoding="utf-8"))
        (run / "run.json").write_text(json.dumps({**info, "rollbacks": 2}), encoding="utf-8")
        (run / "scores.json").write_text(json.dumps({"psnr_full": 30.0, "lpips": None, "clip": "a"}))
    return made


@pytest.fixture
def plan(tmp_path):
    return NumericsPlan(tmp_path / "plan", scenes=1, iterations=20, short=10)


def test_sound_runs_are_sound(runs, plan):
    assert non_finite_of(runs[0], "cpu") == 0
    found = long_row(runs[:1], plan, [])
    assert (found["outcome"], found["bad"], found["rollbacks"], found["psnr"]) == ("ok", 0, 2, [30.0])
    found = pair_row([(runs[0], runs[1])], plan, [])
    assert (found["outcome"], found["equal"], found["apart"], found["tensors"]) == ("ok", 1, [0.0], [0.0])


def test_numbers_in_the_log_that_are_none_are_found(runs, plan):
    with (runs[0] / "metrics.jsonl").open("a", encoding="utf-8") as file:
        file.write('{"iteration": 1, "loss": NaN, "losses": {"l1": Infinity}}\n')
    found = long_row(runs[:1], plan, [])
    assert (found["outcome"], found["bad"]) == ("NOT FINITE", 2)


def test_a_tensor_that_differs_is_found_and_how_far(runs, plan):
    tensors = read_tensors(runs[1] / "model.safetensors")
    name = next(name for name, tensor in tensors.items() if tensor.is_floating_point() and tensor.norm() > 0)
    write_tensors(runs[1] / "model.safetensors", {**tensors, name: 1.25 * tensors[name]})
    assert tensors_apart(*runs) == pytest.approx(0.25, rel=1e-5)
    found = pair_row([(runs[0], runs[1])], plan, [])
    assert (found["outcome"], found["equal"]) == ("DIFFERENT", 0)
    assert pair_row([(runs[0], runs[1])], NumericsPlan(plan.out, "cuda", 1), [])["outcome"] == "ok"  # there its spread is stated
    write_tensors(runs[1] / "model.safetensors", {**tensors, name: torch.zeros(1)})
    assert tensors_apart(*runs) == float("inf")


def test_a_training_that_failed_is_said(runs, plan):
    assert pair_row([], plan, ["000-once: no memory"])["outcome"] == "FAILED: 000-once: no memory"
    assert long_row([], plan, [])["outcome"] == "ok, 1 left"


def test_trainings_stop_when_the_time_is_over_and_are_done_by_the_next_call(plan):
    stopped = train_all(NumericsPlan(plan.out, scenes=1, iterations=20, short=10, seconds=0.0))
    assert stopped.count()["done"] == 0
    assert stopped.count()["failed"] == 0
    done = train_all(plan)
    assert done.count()["done"] == 3
    folder = plan.out / "batch" / "runs"
    assert pair_row([(folder / "000-once", folder / "000-again")], plan, [])["outcome"] == "ok"
    assert long_row([folder / "000-long"], plan, [])["outcome"] == "ok"


def test_what_is_drawn_beside_float64():
    found = list(drawings("cpu", 2000))
    assert [line["what"] for line in found] == ["drawn from half precision", "drawn from bfloat16", "2,000 Gaussians drawn"]
    assert {line["outcome"] for line in found} == {"ok"}


@pytest.mark.parametrize("scenes", ["3,7", "0", "many"])
def test_scenes_of_the_campaign_are_a_number(scenes, capsys):
    assert main(["bench", "reliability", "numerics", "--scenes", scenes]) == 2
    assert "--scenes" in capsys.readouterr().err
