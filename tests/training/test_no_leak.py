"""A training sees training frames, and of labels only what its teacher says; what scores are taken from stays unseen."""

import json
import shutil
from dataclasses import fields

import cv2
import numpy as np
import pytest
import torch

import degense.engine.research.degraded_teachers  # noqa: F401 (adds the teacher "degraded")
from degense.engine.data.clip_options import ClipOptions
from degense.engine.data.files.stored import StoredClip
from degense.engine.data.poses import estimate_poses
from degense.engine.data.readers import open_clip
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.events import Stage
from degense.engine.semantics import EmbeddedEncoder
from degense.engine.semantics.teachers import LabelTeacher, teacher_by_name
from degense.engine.store.files import read_tensors
from degense.engine.training import TrainConfig, train
from degense.engine.training.flow.supervision import FlowSupervision
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.semantic.targets import SemanticTargets
from degense.engine.vocabulary import instruments

CPU = torch.device("cpu")
LABELLED = (0, 2, 4, 5, 6, 7, 9)  # of the training frames 0, 2 … 8, 10, 11, and of the held-out frames 1 and 9 one


class Watched(StoredClip):
    """A clip that gives nothing of held-out frames, no truth, and label maps to a teacher only: all else raises.

    Attributes
    ----------
    read : set of int
        Frames whose label maps the teacher read.
    teaching : bool
        Whether it is the teacher that reads now.
    """

    def __init__(self, clip):
        super().__init__(**{item.name: getattr(clip, item.name) for item in fields(StoredClip)})
        self.read: set[int] = set()
        self.teaching = False

    def frame(self, index):
        return super().frame(self._trained_on(index))

    def valid(self, index):
        return super().valid(self._trained_on(index))

    def depth(self, index):
        return super().depth(self._trained_on(index))

    def labels(self, index):
        assert self.teaching, f"the label map of frame {index} is read, and not by the teacher"
        found = super().labels(self._trained_on(index))
        self.read |= set() if found is None else {index}
        return found

    def strokes(self, index):
        return super().strokes(self._trained_on(index))

    def truth(self):
        raise AssertionError("the truth is read")

    def _trained_on(self, index):
        assert index not in self.test_frames, f"the held-out frame {index} is read"
        return index


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A phantom whose camera moves and is unknown; tools cross it. Some of its frames have label maps."""
    folder = tmp_path_factory.mktemp("clip") / "phantom"
    make_phantom(folder, PhantomOptions(12, 128, 96, camera_motion=8.0))
    for i in set(range(12)) - set(LABELLED):
        (folder / "labels" / f"{i:06d}.png").unlink()
    camera = json.loads((folder / "camera.json").read_text())
    del camera["viewmats"]
    (folder / "camera.json").write_text(json.dumps(camera))
    return folder


def opened(folder):
    return open_clip(folder, ClipOptions(poses="estimate"))


def trained(clip, out, teacher, **settings):
    """Every tensor and camera of a short training, and the stages it had."""
    values = {"iterations": 12, "max_gaussians": 400, "resolution": 8, "channels": 8, "semantic_steps": 4, "device": "cpu"}
    events = []
    config = TrainConfig.preset_of("quick", **(values | settings))
    run = train(clip, out, config, teacher=teacher, events=events.append, stop=lambda: False)
    tensors = read_tensors(out / "model.safetensors") | read_tensors(out / "observability.safetensors")
    cameras = {f"camera {i}": torch.from_numpy(camera.viewmat) for i, camera in enumerate(run.cameras)}
    return {**tensors, **cameras, "unit": torch.tensor(run.info["unit"])}, [e.stage for e in events if isinstance(e, Stage)]


def unlike(some, others):
    """Names of tensors that are not equal to the last bit."""
    assert set(some) == set(others)
    return [name for name, values in some.items() if not torch.equal(values, others[name])]


@pytest.fixture
def teaching(monkeypatch):
    """A watched clip knows when the teacher by label maps reads."""
    real = LabelTeacher.targets

    def targets(self, frame):
        self._clip.teaching = True
        try:
            return real(self, frame)
        finally:
            self._clip.teaching = False

    monkeypatch.setattr(LabelTeacher, "targets", targets)


def test_without_a_teacher_labels_and_truth_change_no_bit(folder, tmp_path):
    bare = shutil.copytree(folder, tmp_path / "bare")
    shutil.rmtree(bare / "labels")
    (bare / "gt.npz").unlink()
    clip = Watched(opened(folder))
    assert clip.truth_file is not None
    assert instruments(clip.classes)
    with_labels, stages = trained(clip, tmp_path / "with", "none", iterations=60)
    without, _ = trained(opened(bare), tmp_path / "without", "none", iterations=60)
    assert not clip.read
    assert stages[:3] == ["poses", "load", "flow"]
    assert unlike(with_labels, without) == []
    assert not torch.equal(with_labels["camera 7"], with_labels["camera 0"])  # there were cameras to find


@pytest.mark.parametrize(
    ("teacher", "routing"),
    [("labels", "isolated"), ("labels", "paper"), *((f"degraded:model={model}", "isolated") for model in ("features", "flips", "drift"))],
)
def test_only_the_teacher_reads_labels_and_only_those_of_training_frames(folder, tmp_path, teaching, teacher, routing):
    clip = Watched(open_clip(folder, ClipOptions(poses="still")))
    _, stages = trained(clip, tmp_path / "run", teacher, routing=routing)
    assert clip.read == set(LABELLED) - set(clip.test_frames)
    assert stages[:3] == ["load", "teacher", "flow"]


def test_cameras_are_found_by_labels_only_where_those_teach(folder, tmp_path, teaching, monkeypatch):
    asked = []
    monkeypatch.setattr(
        "degense.engine.training.preparation.find_cameras",
        lambda clip, tell, labelled: (asked.append(labelled), open_clip(folder, ClipOptions(poses="still")))[1],
    )
    for teacher in ("labels", "degraded", "none", None):
        trained(opened(folder), tmp_path / str(teacher), teacher, iterations=1, semantic_steps=1)
    assert asked == [True, False, False, True]
    clip = Watched(opened(folder))
    unseen = estimate_poses(clip).viewmats
    clip.teaching = True
    seen = estimate_poses(clip, labelled=True).viewmats
    assert clip.read == set(LABELLED) - set(clip.test_frames)
    assert not np.array_equal(seen, unseen)


def test_the_teacher_says_where_instruments_are(folder):
    """Exactly where the label maps are the teacher; roughly where they are degraded; nowhere by patches or in frames without labels."""
    clip = open_clip(folder)
    frames, tools = TrainingFrames(clip, 64 * 48, CPU), instruments(clip.classes)
    names = ("labels", "degraded:model=flips", "degraded")
    exact, rough, coarse = (SemanticTargets(teacher_by_name(name, clip, EmbeddedEncoder()), frames) for name in names)
    for i in (2, 4, 7):
        found = exact.tools(i)
        assert np.array_equal(found, np.isin(clip.labels(i)[::2, ::2], tools) & frames.valid(i))
        assert found.any()
        assert (rough.tools(i) & found).sum() > 0
        assert coarse.tools(i) is None
    assert exact.tools(8) is exact.tools(9) is None
    flow = FlowSupervision(frames, tools=exact.tools)
    for pair in flow.pairs[4]:
        assert not pair.weight[0].numpy()[exact.tools(4)].any()
    blind = FlowSupervision(frames, constancy=False)
    assert any(pair.weight[0].numpy()[exact.tools(4)].any() for pair in blind.pairs[4])


@pytest.mark.parametrize("measured", [True, False])
def test_what_a_reader_tells_of_a_clip_does_not_depend_on_held_out_frames(folder, tmp_path, measured):
    """The field of view, what masks mean, a prior of depth, and the range of measured depth."""
    clips = []
    for name in ("as it is", "changed"):
        copy = shutil.copytree(folder, tmp_path / name, ignore=shutil.ignore_patterns(*([] if measured else ["depth"])))
        (copy / "masks").mkdir()
        for i in range(12):
            mask = np.zeros((96, 128), np.uint8)
            mask[20:40, 30 + i : 60] = 255
            changed = name == "changed" and i in (1, 9)
            cv2.imwrite(str(copy / "masks" / f"{i:06d}.png"), 255 - mask if changed else mask)
            if changed:
                cv2.imwrite(str(copy / "images" / f"{i:06d}.png"), np.random.default_rng(i).integers(0, 256, (96, 128, 3), np.uint8))
                if measured:
                    np.save(copy / "depth" / f"{i:06d}.npy", np.full((96, 128), 1e4, np.float32))
        clips.append(opened(copy))
    one, other = clips
    assert one.provenance == other.provenance
    assert one.depth_measured == measured
    for i in one.train_frames:
        assert np.array_equal(one.valid(i), other.valid(i))
        assert np.array_equal(one.depth(i), other.depth(i))
