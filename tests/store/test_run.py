"""Cameras and models of a run folder: what was written comes back, and damage is told from it."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import torch

from degense.app.session.sample import demo_run
from degense.engine.camera import Camera
from degense.engine.errors import RunError
from degense.engine.field import FieldConfig, SceneModel
from degense.engine.field.model import CANONICAL
from degense.engine.store import Run
from degense.engine.store.files import write_json, write_tensors
from degense.engine.store.migrations import current_layer
from degense.engine.store.run import LabelSupport, build_model, cameras_from_json, cameras_to_json

FILE = Path("run") / "run.json"


def moved(x):
    viewmat = np.eye(4)
    viewmat[0, 3] = x
    return Camera(64, 48, 70.5, 71.5, 31.0, 25.0, viewmat)


@pytest.mark.parametrize("places", [[0.25], [0.5] * 5, [0.0, 1.0, -2.0]])
def test_cameras_come_back(places):
    cameras = [moved(x) for x in places]
    written = cameras_to_json(cameras)
    assert len(written["viewmats"]) == len(set(places))
    for camera, again in zip(cameras, cameras_from_json(written, FILE), strict=True):
        assert (again.width, again.height, again.fx, again.fy, again.cx, again.cy) == (64, 48, 70.5, 71.5, 31.0, 25.0)
        np.testing.assert_array_equal(again.viewmat, camera.viewmat)


@pytest.mark.parametrize(
    "change",
    [
        {"count": 0},
        {"count": 10**9},
        {"count": 4},
        {"width": 0},
        {"height": 10**6},
        {"fx": float("nan")},
        {"fy": "wide"},
        {"cx": None},
        {"viewmats": 1.0},
        {"viewmats": []},
        {"viewmats": [1.0, 2.0, 3.0]},
        {"viewmats": [[[1.0]]]},
        {"viewmats": [np.full((4, 4), np.inf).tolist()]},
    ],
    ids=repr,
)
def test_damaged_cameras_are_refused(change):
    written = cameras_to_json([moved(x) for x in (0.0, 1.0, 2.0)]) | change
    with pytest.raises(RunError, match=r"run\.json: the cameras"):
        cameras_from_json(written, FILE)


def small(rank=2):
    generator = torch.Generator().manual_seed(3)
    shapes = {"means": 3, "log_scales": 3, "quats": 4, "colors": 3, "semantics": rank, "temporal_windows": 2, "velocities": 3}
    canonical = {name: torch.randn(5, width, generator=generator) for name, width in shapes.items()}
    canonical |= {"logits": torch.randn(5, generator=generator), "color_residuals": torch.randn(5, 2, 3, generator=generator)}
    config = FieldConfig(rank=rank, color_knots=2, channels=2, resolution=4, time_resolution=3, levels=(1,))
    return SceneModel(config, torch.tensor([[-1.0, -1, -1], [1, 1, 1]]), canonical)


def test_observability_comes_back(tmp_path):
    run, observability = Run(tmp_path, {}), torch.tensor([0.0, 0.25, 1.0])
    assert run.load_observability(3) is None
    run.save_observability(observability)
    assert torch.equal(run.load_observability(3), observability)


def test_observability_of_an_earlier_version_is_read(tmp_path):
    write_tensors(tmp_path / "observability.safetensors", {"observability": torch.tensor([0.0, 0.25, 1.0])})
    assert Run(tmp_path, {}).load_observability(3).tolist() == [0.0, 0.25, 1.0]


@pytest.mark.parametrize(
    "tensors",
    [
        {"observability": torch.zeros(4)},
        {"observability": torch.zeros(3, 1)},
        {"observability": torch.zeros(3, dtype=torch.float64)},
        {"observability": torch.tensor([0.0, 0.5, 1.5])},
        {"observability": torch.tensor([0.0, -0.5, 1.0])},
        {"observability": torch.tensor([0.0, float("nan"), 1.0])},
        {"weight": torch.zeros(3)},
    ],
    ids=["longer", "shape", "type", "above", "below", "nan", "name"],
)
def test_damaged_observability_is_refused(tmp_path, tensors):
    write_tensors(tmp_path / "observability.safetensors", tensors)
    with pytest.raises(RunError, match=r"observability\.safetensors"):
        Run(tmp_path, {}).load_observability(3)


CAMERA = {"width": 4, "height": 4, "fx": 4.0, "fy": 4.0, "cx": 2.0, "cy": 2.0, "count": 5, "viewmats": [torch.eye(4).tolist()]}


def test_label_support_comes_back(tmp_path):
    run, support = Run(tmp_path, {"cameras": CAMERA}), torch.tensor([0.0, 0.25, 1.0])
    assert run.load_label_support(3) is None
    run.save_label_support(LabelSupport(support, 1 - support, [0, 4]))
    again = run.load_label_support(3)
    assert torch.equal(again.shown, support)
    assert torch.equal(again.familiar, 1 - support)
    assert again.frames == [0, 4]


@pytest.mark.parametrize(
    "tensors",
    [
        {"shown": torch.zeros(4)},
        {"shown": torch.tensor([0.0, 0.5, 1.5])},
        {"familiar": torch.zeros(2)},
        {"familiar": torch.tensor([0.0, -0.5, 1.0])},
        {"frames": torch.tensor([5])},
        {"frames": torch.tensor([-1])},
        {"frames": torch.tensor([0.0])},
        {"frames": torch.zeros(0, dtype=torch.int64)},
    ],
    ids=["longer", "above", "shorter", "below", "late", "early", "type", "none"],
)
def test_damaged_label_support_is_refused(tmp_path, tensors):
    sound = {"shown": torch.zeros(3), "familiar": torch.zeros(3), "frames": torch.tensor([0])}
    write_tensors(tmp_path / "label_support.safetensors", sound | tensors)
    with pytest.raises(RunError, match=r"label_support\.safetensors"):
        Run(tmp_path, {"cameras": CAMERA}).load_label_support(3)


def test_layers_of_earlier_versions_have_todays_names():
    assert current_layer("support") == "observability"
    assert current_layer("rgb") == "rgb"


@pytest.mark.parametrize("moving", [None, [1, 3]])
@pytest.mark.parametrize("responds", [False, True])
def test_a_model_comes_back(moving, responds):
    model = small()
    if moving is not None:
        model.set_moving(torch.tensor(moving))
    if responds:
        model.set_semantic_coefficients(torch.randn(5, 3, 2))
    again = build_model(model.config.to_json(), dict(model.state_dict()), FILE)
    for name, tensor in model.state_dict().items():
        assert torch.equal(tensor, again.state_dict()[name]), name


def test_a_model_of_a_version_without_drifts_comes_back(tmp_path):
    model, run = small(), Run(tmp_path, {})
    run.info |= {"field": model.config.to_json(), "state": "finished"}
    write_tensors(tmp_path / "model.safetensors", {n: t for n, t in model.state_dict().items() if n != "canonical.velocities"})
    again = run.load_model().state_dict()
    assert not again.pop("canonical.velocities").any()
    assert all(torch.equal(tensor, model.state_dict()[name]) for name, tensor in again.items())


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda field, tensors: tensors.pop("bounds"), "lacks the canonical Gaussians"),
        (lambda field, tensors: tensors.update(semantic_coefficients=torch.zeros(5, 3, 9)), "does not fit the configuration"),
        (lambda field, tensors: tensors.pop("canonical.quats"), "lacks the canonical Gaussians"),
        (lambda field, tensors: tensors.pop("kinematics.states.weight"), "does not fit the configuration"),
        (lambda field, tensors: tensors.update(moving=torch.tensor([5])), "does not fit the configuration"),
        (lambda field, tensors: field.update(channels=3), "does not fit the configuration"),
        (lambda field, tensors: field.update(unheard_of=1), "does not fit the configuration"),
        (lambda field, tensors: tensors.update({"canonical.means": torch.zeros(())}), "does not fit the configuration"),
        (lambda field, tensors: tensors.update({"canonical.means": torch.zeros(5, 7)}), "does not fit the configuration"),
        (lambda field, tensors: tensors.update({"canonical.logits": torch.zeros(4)}), "does not fit the configuration"),
        (lambda field, tensors: tensors.update({"bounds": torch.zeros(2)}), "does not fit the configuration"),
        (lambda field, tensors: tensors.update({"canonical.semantics": torch.zeros(5, 3)}), "does not fit the configuration"),
    ],
)
def test_a_damaged_model_is_refused(damage, said):
    model = small()
    field, tensors = model.config.to_json(), dict(model.state_dict())
    damage(field, tensors)
    with pytest.raises(RunError, match=said):
        build_model(field, tensors, FILE)


@pytest.mark.parametrize(
    "change",
    [
        {"clip": 3},
        {"clip": {"name": "a"}},
        {"clip": {"path": "a\0b", "fingerprint": "x"}},
        {"config": {}},
        {"unit": 0},
        {"unit": "mm"},
        {"unit": True},
        {"classes": [1]},
        {"classes": "liver"},
        {"reference_frame": -1},
        {"fps": 0},
        {"encoder": 5},
        {"teacher": "labels"},
        {"teacher": {"name": 3}},
        {"provenance": {"poses": 3}},
        {"train_seconds": {}},
        {"gaussians": "9000"},
        {"field": {}},
        {"field": {"levels": []}},
        {"field": {"levels": [1], "rank": -1}},
        {"field": {"levels": [1], "resolution": 10**9}},
        {"field": {"levels": [1], "resolution": 1}},
        {"field": {"levels": [1], "time_resolution": 0}},
        {"field": {"levels": [1], "static": 1}},
        {"field": {"levels": [1], "routing": "none"}},
        {"field": {"levels": [1], "colour": 1}},
    ],
)
def test_values_of_another_kind_are_refused_when_it_is_opened(tmp_path, change):
    run = tmp_path / "run"
    shutil.copytree(demo_run(), run, ignore=shutil.ignore_patterns("previews", "*.safetensors"))
    assert Run.open(run).info["state"] == "finished"
    write_json(run / "run.json", Run.open(run).info | change)
    with pytest.raises(RunError, match=next(iter(change))):
        Run.open(run)


def test_planes_that_the_file_does_not_hold_are_not_made():
    tensors = {f"canonical.{name}": torch.zeros(1) for name in CANONICAL} | {"bounds": torch.zeros(2, 3)}
    with pytest.raises(RunError, match="too small for the planes"):
        build_model({"levels": [1 << 10], "resolution": 1 << 20}, tensors, FILE)
