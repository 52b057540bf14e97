"""Two short trainings on surgeries of the set `develop` reach what the program reached when the bars were set.

A change that costs quality fails. The bars leave room for other roundings: behind each stands what three training seeds gave on
a CPU, least to greatest. Without optical flow (`flow=0`) both displacement errors fail, and without semantic distillation (`lift=false`,
`semantic_steps=1`) mIoU: .032.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from degense.engine.data.readers import open_clip
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.metrics.evaluate import evaluate
from degense.engine.research import surgeries  # noqa: F401  adds the kind "family"
from degense.engine.research.raster_reference import rasterize_reference
from degense.engine.scene import Scene
from degense.engine.training import TrainConfig, train


@dataclass(frozen=True)
class Bars:
    """Lengths of motion are by the mean true motion."""

    seed: int
    teacher: str
    psnr: float
    miou: float
    error: float
    correlation: float
    static: float
    charred: float


SURGERIES = (
    Bars(
        seed=14,  # textured; a grasper pulls while tissue that stands still chars softly
        teacher="labels",
        psnr=31.8,  # 32.4 to 32.7 dB
        miou=0.73,  # .771 to .787
        error=0.58,  # .430 to .522; .75 without flow
        correlation=0.62,  # .686 to .775
        static=0.28,  # .162 to .218
        charred=0.16,  # .054 to .085
    ),
    Bars(
        seed=37,  # five organs, a cut, two tools, a sharp burn; the teacher is wrong in a fifth of the regions of every frame
        teacher="degraded:model=flips,strength=2",
        psnr=35.6,  # 36.3 to 36.4 dB
        miou=0.82,  # .873 to .882
        error=0.23,  # .182 to .199; .32 without flow
        correlation=0.92,  # .950 to .959
        static=0.18,  # .112 to .139
        charred=0.18,  # .075 to .112
    ),
)


@pytest.fixture(scope="module", params=SURGERIES, ids=lambda bars: f"surgery {bars.seed}")
def trained(request, tmp_path_factory):
    bars, folder = request.param, tmp_path_factory.mktemp("quality")
    make_phantom(folder / "clip", PhantomOptions(frames=17, width=96, height=80, kind="family", seed=bars.seed))
    clip = open_clip(folder / "clip")
    config = TrainConfig.preset_of("quick", iterations=300, max_gaussians=2000, device="cpu")
    train(clip, folder / "run", config, teacher=bars.teacher, events=lambda event: None, stop=lambda: False)
    scene = Scene.open(folder / "run", device="cpu", clip=clip)
    return bars, scene, evaluate(scene, clip, parts=("masks", "motion"))


def test_pictures(trained):
    bars, _, scores = trained
    assert scores["psnr_mask"] > bars.psnr


def test_masks_that_the_window_shows(trained):
    bars, _, scores = trained
    assert scores["miou"]["rnse"] > bars.miou


def test_motion(trained):
    bars, _, scores = trained
    assert scores["displacement_error"] / scores["true_displacement"] < bars.error
    assert scores["displacement_correlation"] > bars.correlation
    assert scores["displacement_coverage"] > 0.99


def test_false_motion(trained):
    bars, _, scores = trained
    assert scores["false_motion"] / scores["true_displacement"] < bars.static
    assert scores["spurious_displacement_static"] / scores["true_displacement"] < bars.charred


def test_what_is_shown_is_what_the_oracle_draws(trained):
    """The float64 rasterizer draws the same Gaussians; what is shown has 8 bits."""
    _, scene, _ = trained
    for frame in (0, 9, 16):
        splats = scene.splats(frame)
        image, _, _ = rasterize_reference(splats, splats.colors, scene.camera(frame), None, None)
        exact = 255 * np.clip(image.numpy(), 0, 1)
        apart = np.abs(scene.render_rgb(frame) - exact)
        assert apart.max() < 1.5
        assert apart.mean() < 0.3


def test_motion_along_the_line_of_sight_with_depth_that_errs(tmp_path):
    """Surgery 71 moves mostly along the line of sight, by less than depth as a stereo endoscope measures it errs in a frame."""
    make_phantom(tmp_path / "clip", PhantomOptions(frames=25, width=128, height=96, kind="family", seed=71, depth="noisy"))
    clip = open_clip(tmp_path / "clip")
    config = TrainConfig.preset_of("quick", iterations=300, max_gaussians=2000, device="cpu")
    train(clip, tmp_path / "run", config, teacher="none", events=lambda event: None, stop=lambda: False)
    scores = evaluate(Scene.open(tmp_path / "run", device="cpu", clip=clip), clip, parts=("motion",))
    true = scores["true_displacement"]
    assert scores["displacement_error"] < 0.34 * true  # .25 in two seeds; .53 and .56 with `depth_together=false`
    assert scores["recovered_share"] > 0.68  # .79; .46 and .48
    assert scores["sure_kept"] > 0.8  # .89 and .90; .57 and .59
    assert scores["false_motion"] < 0.2 * true  # .10 and .11
