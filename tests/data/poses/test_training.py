"""Training finds the cameras first, keeps them in the run, and resumes with the same ones."""

import numpy as np
import pytest

from degense.engine.data.readers import open_clip
from degense.engine.events import Stage, Step, TrainingProgress
from degense.engine.metrics.evaluate import evaluate
from degense.engine.scene import Scene
from degense.engine.training import TrainConfig, preparation, train

CONFIG = TrainConfig.preset_of("quick", iterations=30, max_gaussians=400, resolution=8, channels=8, flow=0.0, device="cpu")


def run_it(clip, out, stop_at=None, **options):
    events = []

    def stop():
        return stop_at is not None and any(isinstance(e, TrainingProgress) and e.iteration >= stop_at for e in events)

    return train(clip, out, CONFIG, teacher="none", events=events.append, stop=stop, **options), events


def test_the_run_keeps_the_cameras_and_says_where_they_come_from(moving, without_poses, tmp_path):
    clip = open_clip(without_poses(moving))
    run, events = run_it(clip, tmp_path / "run")
    assert [e.stage for e in events if isinstance(e, Stage)][:2] == ["poses", "load"]
    assert len({camera.viewmat.tobytes() for camera in run.cameras}) == len(clip)
    assert run.info["provenance"]["poses"].startswith("estimated: the camera moves")
    scene = Scene.open(tmp_path / "run", device="cpu")
    assert scene.clip is not None
    assert scene.camera(7).viewmat[0, 3] == run.cameras[7].viewmat[0, 3] != 0
    assert evaluate(scene, scene.clip)["poses"] == run.info["provenance"]["poses"]


def test_a_resumed_training_does_not_look_again(moving, without_poses, tmp_path, monkeypatch):
    clip = open_clip(without_poses(moving))
    stopped, _ = run_it(clip, tmp_path / "run", stop_at=25)
    assert stopped is None
    used, real = [], preparation.TrainingFrames

    def open_frames(clip, *rest):
        used.append(clip)
        return real(clip, *rest)

    monkeypatch.setattr(preparation, "find_cameras", lambda *_: pytest.fail("poses were estimated again"))
    monkeypatch.setattr(preparation, "TrainingFrames", open_frames)
    run, events = run_it(clip, tmp_path / "run", resume=True)
    assert "poses" not in [e.stage for e in events if isinstance(e, Stage)]
    for trained, kept in zip(used[0].cameras, run.cameras, strict=True):
        np.testing.assert_array_equal(trained.viewmat, kept.viewmat)
    assert not np.allclose(run.cameras[5].viewmat, np.eye(4))


def test_the_search_can_be_stopped(moving, without_poses, tmp_path):
    seen = []

    def stop():
        return any(isinstance(e, Step) and e.stage == "poses" for e in seen)

    assert train(open_clip(without_poses(moving)), tmp_path / "run", CONFIG, events=seen.append, stop=stop) is None
    assert not (tmp_path / "run").exists()


def test_screen_motion_holds_the_cameras_share(moving, without_poses, tmp_path, monkeypatch):
    """A Gaussian that does not move in the world still moves in the picture, from each frame's camera to the reference frame's."""
    run_it(open_clip(without_poses(moving)), tmp_path / "run")
    scene = Scene.open(tmp_path / "run", device="cpu")
    first = scene.states.advected_means(0)
    monkeypatch.setattr(scene.states, "advected_means", lambda frame: first)
    points = first.double().numpy()
    here, there = scene.camera(6).project(points)[0], scene.camera(0).project(points)[0]
    near = (np.abs(here) < 400).all(1) & (np.abs(there) < 400).all(1)
    np.testing.assert_allclose(
        scene.renderer._column("motion", scene.splats(6), 6, scene.camera(6)).numpy()[near], (there - here)[near], atol=1e-3
    )
    assert np.median(np.linalg.norm((there - here)[near], axis=1)) > 2
