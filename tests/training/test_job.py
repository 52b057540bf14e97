"""A whole training on a tiny clip: it learns, stops, resumes exactly, survives divergence, and leaves a run that opens."""

import json

import numpy as np
import pytest
import torch

import degense.engine.training.job as training
from degense.engine.errors import DegenseError, RunError
from degense.engine.events import Done, Reliability, Rollback, Stage, Stopped, TrainingProgress, read_progress
from degense.engine.scene import Scene
from degense.engine.semantics.masks.confidence import ConfidenceCurve
from degense.engine.store import Run
from degense.engine.store.files import read_json, read_tensors, write_json, write_tensors
from degense.engine.training import TrainConfig, train
from degense.engine.training.checkpoint import load_checkpoint
from tests.fakes import MemoryClip


@pytest.fixture(autouse=True)
def _memory_clips_have_a_fingerprint(monkeypatch):
    monkeypatch.setattr(training, "fingerprint", lambda clip: str(clip.path))


def tiny(**overrides):
    values = {"iterations": 60, "max_gaussians": 400, "resolution": 8, "channels": 8, "checkpoint_seconds": 1e9, "device": "cpu"}
    return TrainConfig.preset_of("quick", **(values | overrides))


def run_it(clip, out, config, stop_at=None, **options):
    events = []

    def stop():
        return stop_at is not None and any(isinstance(e, TrainingProgress) and e.iteration >= stop_at for e in events)

    return train(clip, out, config, events=events.append, stop=stop, **options), events


@pytest.mark.parametrize("routing", ["isolated", "paper", "coupled"])
def test_it_learns_and_leaves_a_run(tmp_path, routing):
    clip = MemoryClip()
    run, events = run_it(clip, tmp_path / "run", tiny(routing=routing, iterations=150))
    reports = [e for e in events if isinstance(e, TrainingProgress)]
    progress = [e for e in reports if e.psnr is not None]
    assert progress[-1].psnr > progress[0].psnr + 3
    stages = [e.stage for e in events if isinstance(e, Stage)]
    assert stages == ["load", "teacher", "flow", "coarse", "joint", *(["semantics"] if routing == "isolated" else [])]
    assert events[-1] == Done(str(tmp_path / "run"))
    told = [e.words for e in events if isinstance(e, Reliability)]
    assert told == ["this teacher calls the same place differently in 0% of the frames"]
    assert run.info["teacher"]["disagreement"] < 0.005
    assert ConfidenceCurve.from_json(run.info["confidence"])(np.ones(1)) > 0.9, "where all is exact and no toss-up"
    assert run.info["teacher"]["provenance"].endswith(told[0])
    assert (tmp_path / "run" / "previews" / "last.png").stat().st_size > 100
    log = [json.loads(line) for line in (tmp_path / "run" / "metrics.jsonl").read_text().splitlines()]
    assert [line["losses"] for line in log] == [e.losses for e in reports]
    together = {"shape", "displacement", "rigidity", "l1", "ssim", "depth", "flow", "plane_space", "plane_time", "plane_static"}
    joint = {"align", "region"} if routing != "isolated" else set()
    for event in reports:
        assert sum(event.losses.values()) == pytest.approx(event.loss, rel=1e-4)
    assert together | joint <= set(progress[-1].losses)
    assert joint or not {"align", "region"} & set(progress[-1].losses)
    distilled = reports[len(progress) :]
    assert reports == progress + distilled
    assert bool(distilled) == (routing == "isolated")
    assert {e.iterations for e in reports} == {300 if distilled else 150}  # those of the distillation are counted from the start
    for number, event in enumerate(distilled):
        assert set(event.losses) == {"align", "region", "delta_semantics"}
        assert event.iteration == min(150 + 25 * (number + 1), event.iterations)
    assert not distilled or (distilled[-1].losses["align"] < distilled[0].losses["align"] and distilled[-1].eta == 0)
    scene = Scene.open(tmp_path / "run", device="cpu", clip=clip)
    assert scene.has_semantics
    assert scene.render(3)["rgb"].shape == (40, 48, 3)
    assert run.info["state"] == "finished"
    assert run.info["unit"] == pytest.approx(0.5)


def test_test_frames_are_never_read(tmp_path):
    class Watching(MemoryClip):
        def frame(self, index):
            assert index not in self.test_frames
            return super().frame(index)

        def labels(self, index):
            assert index not in self.test_frames
            return super().labels(index)

    run, _ = run_it(Watching(), tmp_path / "run", tiny(iterations=30))
    assert run is not None


def test_stopped_and_resumed_is_the_same_as_not_stopped(tmp_path):
    clip = MemoryClip()
    run_it(clip, tmp_path / "whole", tiny(iterations=130, densify_every=50))
    stopped, events = run_it(clip, tmp_path / "parts", tiny(iterations=130, densify_every=50), stop_at=75)
    assert stopped is None
    assert events[-1] == Stopped(75)
    assert Run.open(tmp_path / "parts").info["state"] == "stopped"
    half = Run.open(tmp_path / "parts")
    with pytest.raises(RunError, match="resume"):
        half.load_model()
    half.info["config"]["flow_final"] = 0.5  # a setting of an earlier version, which stands in nobody's way
    half.save()
    finished, resumed = run_it(clip, tmp_path / "parts", tiny(), resume=True)
    assert finished.info["state"] == "finished"
    clock = [e.seconds for e in (*events, *resumed) if isinstance(e, TrainingProgress)]
    assert clock == sorted(clock)  # it goes on, and does not start again
    assert read_progress(tmp_path / "parts" / "metrics.jsonl") == [e for e in (*events, *resumed) if isinstance(e, TrainingProgress)]
    whole, parts = (read_tensors(tmp_path / name / "model.safetensors") for name in ("whole", "parts"))
    for name in whole:
        assert torch.equal(whole[name], parts[name]), name


def test_a_checkpoint_of_an_earlier_version_is_resumed_to_the_same_bits(tmp_path):
    """What `degense.engine.store.migrations` says had other names: tensors, their moments, the trainer's progress and settings.

    The training had stopped early: at step 40 it left ten steps out.
    """
    clip = MemoryClip()
    run_it(clip, tmp_path / "whole", tiny(iterations=60, appearance=True))
    run_it(clip, tmp_path / "parts", tiny(iterations=60, appearance=True), stop_at=50)
    tensors = {"color_residuals": "tints", "velocities": "drifts", "temporal_windows": "lifetimes"}
    (path,) = (tmp_path / "parts" / "checkpoints").glob("step-*.safetensors")
    renamed = {}
    for name, values in read_tensors(path).items():
        of, dot, rest = name.partition("canonical.")
        now, *key = rest.split(".")
        renamed[of + dot + ".".join([tensors.get(now, now), *key])] = values
    assert {"model/canonical.tints", "moments/canonical.tints.exp_avg", "model/canonical.lifetimes"} <= set(renamed)
    write_tensors(path, renamed)
    path.rename(path.with_name("step-0000040.safetensors"))
    progress = read_json(path.parent / "last.json", 1 << 128)
    progress = {"caution" if name == "rate_scale" else name: value for name, value in progress.items()}
    write_json(path.parent / "last.json", progress | {"iteration": 40, "early": {"skipped": 10, "seen": [[40, 20.0]]}})
    settings = {
        "delta_color": "recolour",
        "delta_semantics": "resemantics",
        "color_residual": "tint",
        "color_residual_change": "tint_change",
    }
    settings |= {"rate_color_residuals": "rate_tints", "velocities": "drifts", "persistent": "lasting"}
    settings |= {"plane_static": "plane_still"}
    run = Run.open(tmp_path / "parts")
    assert set(settings) <= set(run.info["config"])
    run.info["config"] = {settings.get(name, name): value for name, value in run.info["config"].items()}
    run.info["config"] |= {"flow_final": 0.5, "fit": True, "early_stop": False, "early_stopping": False}
    run.save()
    finished, _ = run_it(clip, tmp_path / "parts", tiny(), resume=True)
    assert finished.info["state"] == "finished"
    whole, parts = (read_tensors(tmp_path / name / "model.safetensors") for name in ("whole", "parts"))
    assert set(whole) == set(parts)
    assert [name for name in whole if not torch.equal(whole[name], parts[name])] == []


def test_a_checkpoint_with_a_consensus_without_accuracy_is_resumed(tmp_path):
    """Checkpoints of versions before decision 48 hold no accuracy of the teacher."""
    clip, config = MemoryClip(), tiny(routing="coupled")
    run_it(clip, tmp_path / "whole", config)
    run_it(clip, tmp_path / "parts", config, stop_at=50)
    (path,) = (tmp_path / "parts" / "checkpoints").glob("step-*.safetensors")
    tensors = read_tensors(path)
    tensors["consensus/disagreement"] += 0.25
    del tensors["consensus/accuracy"]
    write_tensors(path, tensors)
    assert load_checkpoint(path.parent)["consensus"]["accuracy"] == 1 - tensors["consensus/disagreement"]
    finished, _ = run_it(clip, tmp_path / "parts", tiny(), resume=True)
    assert finished.info["state"] == "finished"
    assert finished.info["teacher"]["disagreement"] == tensors["consensus/disagreement"]
    whole, parts = (read_tensors(tmp_path / name / "model.safetensors") for name in ("whole", "parts"))
    assert [name for name in whole if not torch.equal(whole[name], parts[name])] == []


def test_divergence_rolls_back_and_says_so(tmp_path, monkeypatch):
    real, poisoned = training.Trainer.step, []

    def step(self):
        real(self)
        if self.iteration == 150 and not poisoned:
            poisoned.append(True)
            self.model.canonical["means"].data[0] = float("nan")

    monkeypatch.setattr(training.Trainer, "step", step)
    run, events = run_it(MemoryClip(), tmp_path / "run", tiny(iterations=220))
    rollback = next(e for e in events if isinstance(e, Rollback))
    assert rollback.iteration == 100
    assert "halved" in rollback.reason
    later = [e for e in events[events.index(rollback) :] if isinstance(e, TrainingProgress)]
    assert [e.iteration for e in later[:4]] == [125, 150, 175, 200]
    assert later[0].loss == pytest.approx(later[1].loss, rel=0.5), "the mean of 25 steps, not the sum of more"
    assert run.info["state"] == "finished"
    assert all(torch.isfinite(t).all() for t in read_tensors(tmp_path / "run" / "model.safetensors").values())


def test_endless_divergence_ends_in_one_sentence(tmp_path, monkeypatch):
    real = training.Trainer.step

    def step(self):
        real(self)
        if self.iteration > 100:
            self.model.canonical["means"].data[0] = float("inf")

    monkeypatch.setattr(training.Trainer, "step", step)
    with pytest.raises(DegenseError, match="diverged"):
        run_it(MemoryClip(), tmp_path / "run", tiny(iterations=400))
    assert Run.open(tmp_path / "run").info["state"] == "diverged"


def test_a_clip_without_labels_trains_without_semantics(tmp_path):
    clip = MemoryClip(labels=False, measured=False)
    run_it(clip, tmp_path / "run", tiny(iterations=30))
    scene = Scene.open(tmp_path / "run", device="cpu", clip=clip)
    assert not scene.has_semantics
    with pytest.raises(DegenseError, match="without semantics"):
        scene.query(0)


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_very_short_clips(tmp_path, frames):
    run, _ = run_it(MemoryClip(frames), tmp_path / "run", tiny(iterations=20))
    assert run.info["state"] == "finished"


def test_refusals_are_one_sentence(tmp_path):
    clip = MemoryClip()
    run_it(clip, tmp_path / "run", tiny(iterations=5))
    with pytest.raises(DegenseError, match="already holds a run"):
        run_it(clip, tmp_path / "run", tiny())
    with pytest.raises(DegenseError, match="finished"):
        run_it(clip, tmp_path / "run", tiny(), resume=True)
    with pytest.raises(DegenseError, match="not the clip"):
        run_it(MemoryClip(seed=5), tmp_path / "run", tiny(), resume=True)
    with pytest.raises(DegenseError, match="preset"):
        TrainConfig.preset_of("fast")
    with pytest.raises(DegenseError, match="routing"):
        TrainConfig.preset_of("quick", routing="loose")
    with pytest.raises(DegenseError, match="coarse_iterations must be less than the iterations: 100 of 100"):
        TrainConfig.preset_of("quick", iterations=100, coarse_iterations=100)
    with pytest.raises(DegenseError, match="resolution must be at least 2"):
        TrainConfig.preset_of("quick", resolution=1)
    with pytest.raises(DegenseError, match="coarse_frames is first or all, not 'last'"):
        TrainConfig.preset_of("quick", coarse_frames="last")
    with pytest.raises(DegenseError, match="no distillation 'points'"):
        run_it(clip, tmp_path / "none", tiny(distillation="points"))
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.txt").write_text("mine")
    with pytest.raises(RunError, match="not empty"):
        run_it(clip, tmp_path / "other", tiny())


def test_fewer_iterations_shorten_the_coarse_stage_in_proportion():
    for preset, iterations, coarse in (("quick", 120, 24), ("quick", 2000, 160), ("balanced", None, 600), ("best", 5000, 300)):
        assert TrainConfig.preset_of(preset, iterations=iterations).coarse_iterations == coarse


def test_hostile_run_folders(tmp_path):
    clip = MemoryClip()
    run_it(clip, tmp_path / "run", tiny(iterations=5))
    path = tmp_path / "run" / "run.json"
    good = json.loads(path.read_text())
    for change, match in (
        ({"format": 99}, "newer"),
        ({"format": "x"}, "not written"),
        ({"field": {**good["field"], "channels": 16}}, "does not fit"),
        ({"field": {**good["field"], "surprise": 1}}, "surprise.*damaged"),
        ({"cameras": {**good["cameras"], "width": -4}}, "no sense"),
        ({"cameras": {**good["cameras"], "count": 10**12}}, "no sense"),
    ):
        path.write_text(json.dumps(good | change))
        with pytest.raises(RunError, match=match):
            Scene.open(tmp_path / "run", device="cpu", clip=clip)
    path.write_text("{")
    with pytest.raises(RunError, match="cannot be read"):
        Run.open(tmp_path / "run")
