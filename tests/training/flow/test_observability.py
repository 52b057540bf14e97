"""Which displacement the images can reveal: exact cases on a plane, and calibration against a phantom's truth."""

import numpy as np
import pytest
import torch

from degense.engine.data.readers import open_clip
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.field import FieldConfig, SceneModel
from degense.engine.layers import LAYERS, LayerRequest
from degense.engine.scene import Scene
from degense.engine.training import TrainConfig, train
from degense.engine.training.flow.observability import motion_observability
from degense.engine.training.flow.supervision import FlowSupervision
from degense.engine.training.frames import TrainingFrames
from tests.fakes import MovingWall

HOLE = (slice(10, 34), slice(8, 32))


class HalfPlain(MovingWall):
    """A wall whose right half has no texture."""

    def frame(self, index):
        picture = super().frame(index)
        picture[self.material(index)[..., 0] > 0] = 128
        return picture


def wall_of_gaussians(frames: TrainingFrames, depth: float) -> dict[str, torch.Tensor]:
    """Opaque discs on a grid of 3 × 3 pixels, at `depth` times the wall's."""
    width, height = frames.size
    pixels = np.stack(np.meshgrid(np.arange(1.5, width, 3), np.arange(1.5, height, 3)), -1).reshape(-1, 2)
    means = frames.cameras[0].unproject(pixels, np.full(len(pixels), depth))
    count = len(means)
    return {
        "means": torch.from_numpy(means).float(),
        "log_scales": torch.full((count, 3), float(np.log(2 * depth / width))),
        "quats": torch.tensor([1.0, 0, 0, 0]).repeat(count, 1),
        "logits": torch.full((count,), 6.0),
        "colors": torch.full((count, 3), 0.5),
        "semantics": torch.zeros(count, 0),
        "color_residuals": torch.zeros(count, 0, 3),
        "temporal_windows": torch.zeros(count, 2),
        "velocities": torch.zeros(count, 3),
    }


@pytest.fixture(scope="module")
def half_plain():
    """Observability of Gaussians on the wall and of as many behind it, [rows, columns] each."""
    clip = HalfPlain(9, velocity=(0.02, 0.01, 0.0), hole=HOLE)
    frames = TrainingFrames(clip, 1 << 20, torch.device("cpu"))
    front, behind = wall_of_gaussians(frames, 1.0), wall_of_gaussians(frames, 1.2)
    canonical = {name: torch.cat([front[name], behind[name]]) for name in front}
    model = SceneModel(FieldConfig(resolution=4, time_resolution=2, levels=(1,)), torch.tensor([[-1.0, -1, 0], [1, 1, 2]]), canonical)
    shares = motion_observability(model, frames, FlowSupervision(frames)).reshape(2, 24, 32)
    return shares[0].numpy(), shares[1].numpy()


def test_texture_reveals_and_plain_walls_do_not(half_plain):
    front, _ = half_plain
    assert front[13:22, 2:13].mean() > 0.95
    assert front[2:22, 19:30].max() == 0  # far enough from the edge of the texture for a window of 7 pixels
    assert ((front >= 0) & (front <= 1)).all()


def test_what_lies_under_a_mask_or_behind_the_surface_is_not_revealed(half_plain):
    front, behind = half_plain
    assert front[5:10, 4:9].max() == 0
    assert behind.max() == 0


def test_observability_tells_good_displacement_from_guesses(tmp_path):
    """Against exact truth: pixels marked as guesses are wrong by several times as much, and tools are marked."""
    make_phantom(tmp_path / "clip", PhantomOptions(frames=20, width=128, height=96, seed=2))
    clip = open_clip(tmp_path / "clip")
    config = TrainConfig.preset_of("quick", iterations=200, max_gaussians=2500, resolution=24, semantic_steps=1, device="cpu")
    train(clip, tmp_path / "run", config, teacher="labels", events=lambda event: None, stop=lambda: False)
    scene, truth = Scene.open(tmp_path / "run", device="cpu"), clip.truth()
    errors: dict[str, list[np.ndarray]] = {"low": [], "middle": [], "high": []}
    marked = []
    for i in range(2, len(clip)):
        image = LAYERS["displacement"].image(scene, LayerRequest(i))
        share = LAYERS["observability"].image(scene, LayerRequest(i)).values
        right = np.linalg.norm(truth.displacement[i], axis=-1)
        error = np.abs(image.values - right)
        for name, low, high in (("low", 0.0, 0.3), ("middle", 0.3, 0.7), ("high", 0.7, 1.01)):
            errors[name].append(error[(share >= low) & (share < high) & np.isfinite(error)])
        marked.append(image.uncertain[np.isnan(right)])
    mean = {name: float(np.concatenate(values).mean()) for name, values in errors.items()}
    assert mean["low"] > mean["middle"] > 2 * mean["high"], mean
    assert np.concatenate(marked).mean() > 0.85  # instruments, of which the teacher says where they are: their motion is nobody's evidence
