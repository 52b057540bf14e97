"""The benchmarks about learning make their tables from scores as `evaluate` gives them; what they train is tried elsewhere."""

from dataclasses import replace

import pytest

from degense.engine.progress import silent
from degense.engine.research.bench import trainings
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.workers import run_jobs
from degense.engine.research.benchmarks import ablation, parts
from degense.engine.research.systems import as_system
from degense.engine.semantics.prompts import DECODERS
from degense.engine.training.config import TrainConfig


@pytest.fixture
def asked(monkeypatch, tmp_path):
    """Benchmarks on made-up scores: mIoU falls with everything that differs from the default, and a bit with the seed."""
    seen = []

    def score_all(jobs, options, progress, words):
        seen.extend(jobs)
        default = TrainConfig()
        found = []
        for job in jobs:
            c = job.config
            miou = 0.9 - 0.1 * sum(getattr(c, k) != getattr(default, k) for k in ("routing", "angular", "appearance", "guided"))
            miou -= 0.01 * c.seed
            iou = {"liver": miou, "grasper": None}
            masks = {d: {"boundary_f": 0.5, "iou": iou, "floor": {"liver": 0.2, "grasper": None}} for d in DECODERS}
            scores = {"miou": {d: miou - 0.05 * (d == "threshold") for d in DECODERS}, "masks": masks, "rank": 8}
            scores |= {
                "displacement_error": 0.1,
                "displacement_scale": 100.0,
                "displacement_correlation": 0.9,
                "recovered_share": 0.8,
                "spurious_displacement": 0.05,
            }
            scores["spurious_displacement_static"] = 0.02
            scores |= {"true_displacement": 1.0, "largest_displacement": 10.0, "false_motion": 0.01, "psnr_mask": 33.0, "ssim": 0.9}
            found.append(scores | {"train_seconds": 5.0, "query_ms": 4.0, "query_new_frame_ms": 60.0})
        return found

    def clips(options, progress, scenes):
        names = [f"{kind} {seed}" if seed else kind for kind, seed in scenes]
        return {name: tmp_path / name for name in names}

    for module in (ablation, parts):
        monkeypatch.setattr(module, "score_all", score_all)
        monkeypatch.setattr(module, "phantoms", clips)
    return seen, BenchOptions("cpu", (0, 1), 1, True, tmp_path)


def test_the_ablation_changes_routing_and_loss_and_nothing_else(asked):
    jobs, options = asked
    tables = {table.name: table for table in ablation.run(options, silent)}
    assert len(jobs) == len({j.out for j in jobs}) == 4 * len(ablation.SCENES) * len(options.seeds) >= 4 * 4 * 2
    assert {(j.config.routing, j.config.angular) for j in jobs} == set(ablation.VARIANTS)
    for seed in options.seeds:
        wanted = as_system("degensegs", trainings.base_config(options, seed=seed))
        same = {replace(j.config, routing=wanted.routing, angular=wanted.angular) for j in jobs if j.config.seed == seed}
        assert same == {wanted}
        assert {j.teacher for j in jobs if j.config.seed == seed} == {trainings.vlm_like(seed)}
    assert (wanted.lift, wanted.guided, wanted.coarse_frames, wanted.linear_states) == (False, False, "all", True)
    rows = {(row["decoupled"], row["angular"]): row for row in tables["ablation"].rows}
    # made-up scores fall by 0.1 with each of routing, loss, appearance and guided targets that is not the default, and 0.05 by threshold
    assert rows["✓", "✓"]["rnse-paper"] == pytest.approx([0.6, 0.59])
    assert rows["×", "×"]["threshold"] == pytest.approx([0.45, 0.44])
    added = {row["effect"]: row for row in tables["ablation-effects"].rows}
    assert added["AASD, coupled, threshold"]["points"] == pytest.approx([10] * len(ablation.SCENES) * 2)
    assert added["S-G decoupling, L1, threshold → rnse-paper"]["points"] == pytest.approx([5] * len(ablation.SCENES) * 2)
    assert added["S-G decoupling, L1, threshold"]["better"] == f"0 of {2 * len(ablation.SCENES)}"
    assert len(tables["ablation-scenes"].rows) == 4 * 2
    assert all(table.markdown() for table in tables.values())


def test_each_part_is_taken_from_the_default_alone(asked):
    jobs, options = asked
    tables = {table.name: table for table in parts.run(options, silent)}
    pairs = len(parts.SCENES) * len(options.seeds)
    assert len(jobs) == len({j.out for j in jobs}) == (1 + len(parts.PARTS)) * pairs
    for job, changes in zip(jobs, [{}] * pairs + [part for part in parts.PARTS.values() for _ in range(pairs)], strict=True):
        default = trainings.base_config(options, seed=job.config.seed)
        assert replace(job.config, given=()) == replace(default, **changes, given=()) != replace(default, iterations=1, given=())
        assert not changes or any(getattr(default, name) != value for name, value in changes.items())
        assert job.teacher == trainings.vlm_like(job.config.seed)
    rows = {row["part"]: row for row in tables["parts"].rows}
    # made-up scores fall by 0.1 with routing, loss, appearance and guided targets, nothing else
    assert rows["nothing: default"]["miou"] == pytest.approx([0.9, 0.89] * len(parts.SCENES))
    assert rows["guided upsampling"]["miou"] == pytest.approx([-0.1] * pairs)
    assert (rows["guided upsampling"]["miou worse"], rows["rigidity"]["miou worse"]) == (str(pairs), "0")
    assert rows["guided upsampling"]["switch"] == "`guided=false`"
    assert {row["decoder"]: row["miou"][0] for row in tables["parts-decoders"].rows}["threshold"] == pytest.approx(0.85)
    assert all(table.markdown() for table in tables.values())


def test_workers_answer_every_job_and_raise_what_fails():
    assert dict(run_jobs(abs, [-1, 2, -3], 2, silent, "jobs")) == {0: 1, 1: 2, 2: 3}
    with pytest.raises(TypeError):
        dict(run_jobs(abs, [1, "x"], 1, silent, "jobs"))
