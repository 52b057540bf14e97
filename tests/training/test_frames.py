"""What a training keeps of its frames."""

import torch

from degense.engine.training.frames import TrainingFrames
from tests.fakes import MemoryClip

CPU = torch.device("cpu")


class Asked(MemoryClip):
    """Remembers whose depth was asked for."""

    def __init__(self, **options):
        super().__init__(**options)
        self.depths = []

    def depth(self, index):
        self.depths.append(index)
        return super().depth(index)


def test_guessed_depth_is_not_made_for_every_frame():
    clip = Asked(measured=False)
    frames = TrainingFrames(clip, 1 << 20, CPU)
    clip.depths.clear()
    assert not any(frames[i].depth.any() for i in clip.train_frames)
    assert clip.depths == []


def test_measured_depth_is_kept_in_the_unit_of_training():
    clip = Asked()
    frames = TrainingFrames(clip, 1 << 20, CPU)
    torch.testing.assert_close(frames[3].depth, torch.from_numpy(clip.depth(3)) * frames.unit)
    assert frames[3] is frames[3]
