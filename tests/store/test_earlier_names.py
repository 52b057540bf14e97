"""What the first version wrote opens, though its tensors, settings, layers and files had other names: it shows what that version showed.

`earlier-names.tar.xz` was written on 28 November 2026 by the program of commit bac438e (23 November), before it was renamed: a clip of six
frames (`clip`), its finished run with a session (`run`), the same training stopped at step 25 of 40 (`stopped`), and what that program
itself drew of the run (`frame-3.png`, `displacement-5.npy`). Numbers of tensors have eight bits of mantissa, for the sake of the size;
they were rounded before that program drew them.
"""

from __future__ import annotations

import tarfile
from pathlib import Path

import cv2
import numpy as np
import pytest

from degense.app.session import session_file
from degense.app.session.view_state import ViewState
from degense.engine.data.readers import open_clip
from degense.engine.events import TrainingProgress
from degense.engine.scene import Scene
from degense.engine.store.files import read_tensors
from degense.engine.store.run import Run
from degense.engine.training import TrainConfig, train

KEPT = Path(__file__).parent / "earlier-names.tar.xz"


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("kept")
    with tarfile.open(KEPT) as archive:
        for member in archive:
            assert member.isfile()
            path = folder / member.name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(archive.extractfile(member).read())
    return folder


def test_it_holds_the_earlier_names(unpacked):
    names = {*read_tensors(unpacked / "run" / "model.safetensors"), *read_tensors(unpacked / "run" / "support.safetensors")}
    assert names >= {"canonical.tints", "canonical.drifts", "canonical.lifetimes", "responses", "support"}
    settings = Run.open(unpacked / "run").info["config"]
    assert {"recolour", "resemantics", "tint", "tint_change", "rate_tints", "drifts", "lasting", "plane_still", "fit"} <= {*settings}
    checkpoint = (unpacked / "stopped" / "checkpoints" / "last.json").read_text(encoding="utf-8")
    assert all(f'"{name}"' in checkpoint for name in ("caution", "early"))


def test_a_frame_and_its_displacement_are_drawn_as_they_were(unpacked):
    scene = Scene.open(unpacked / "run", device="cpu")
    drawn = cv2.imread(str(unpacked / "frame-3.png"))[..., ::-1]
    assert drawn.std() > 20
    assert np.abs(scene.render_rgb(3).astype(int) - drawn).max() <= 1
    displacement = np.load(unpacked / "displacement-5.npy")
    assert np.nanmax(displacement) > 0.1
    np.testing.assert_allclose(scene.render(5, what=("displacement",))["displacement"], displacement, rtol=1e-3, atol=1e-3)


def test_its_layer_of_observability_and_its_session_come_back(unpacked):
    scene = Scene.open(unpacked / "run", device="cpu")
    assert np.nanmean(scene.render(3, what=("observability",))["observability"]) == pytest.approx(0.45195, abs=1e-3)
    saved = session_file.read(unpacked / "run" / "session.json")
    view = ViewState.from_json(saved.states[session_file.VIEW], "session.json")
    assert view.layer == "observability"
    assert [layer for layer, _ in view.ranges] == ["observability"]
    assert [prompt.text for prompt in view.prompts] == ["liver"]


def test_its_stopped_training_goes_on_to_the_end(unpacked):
    clip, path, events = open_clip(unpacked / "clip"), unpacked / "stopped", []
    run = train(clip, path, TrainConfig.preset_of("quick", device="cpu"), resume=True, events=events.append, stop=lambda: False)
    assert run.info["state"] == "finished"
    steps = [event.iteration for event in events if isinstance(event, TrainingProgress)]
    assert 25 < min(steps) <= 40 <= max(steps)
    error = np.abs(Scene.open(path, device="cpu").render_rgb(3).astype(int) - clip.frame(3)).mean()
    earlier = np.abs(cv2.imread(str(unpacked / "frame-3.png"))[..., ::-1].astype(int) - clip.frame(3)).mean()
    assert error < 1.2 * earlier  # learned as well as by the program that began it
