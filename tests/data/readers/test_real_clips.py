"""The real clips, where they are at hand."""

import numpy as np
import pytest
from PIL import Image

from degense.engine.data.readers import ClipOptions, detect, open_clip


def test_pulling(clips):
    assert detect(clips / "pulling") == "endonerf"
    clip = open_clip(clips / "pulling")
    assert len(clip) == 63
    assert clip.size == (640, 512)
    assert clip.cameras[0].fx == pytest.approx(569.4682, abs=1e-4)
    assert "255 = tool" in clip.provenance["masks"]
    assert "assumed" not in clip.provenance["masks"]
    assert "field of view" not in clip.provenance["masks"]
    assert 0.7 < np.mean([clip.valid(i).mean() for i in range(0, 63, 6)]) < 0.95
    depths = np.stack([clip.depth(i)[clip.valid(i)].mean() for i in range(0, 63, 6)])
    assert np.ptp(depths) < 0.15


def test_pulling_with_masks_turned_round(clips, tmp_path):
    """The same evidence must decide for the other polarity when the masks are inverted."""
    source = open_clip(clips / "pulling")
    for i in range(0, 63, 9):
        for kind, array in (("images", source.frame(i)), ("masks", source.valid(i).astype(np.uint8) * 255)):
            (tmp_path / kind).mkdir(exist_ok=True)
            Image.fromarray(array).save(tmp_path / kind / f"{i:06d}.png")
    clip = open_clip(tmp_path)
    assert "255 = keep" in clip.provenance["masks"]
    np.testing.assert_array_equal(clip.valid(3), source.valid(27))


def test_cholec160(clips):
    assert detect(clips / "cholec160") == "frames"
    clip = open_clip(clips / "cholec160")
    assert len(clip) == 81
    assert clip.size == (854, 480)
    assert clip.labelled_frames == [0]
    assert clip.classes[0] == "background"
    background = clip.labels(0) == 0
    assert (clip.valid(0) == ~background).mean() > 0.97
    assert not (clip.valid(0) & background).mean() > 0.002
    liver, gallbladder = (np.median(clip.depth(0)[clip.labels(0) == k]) for k in (1, 2))
    assert gallbladder < liver


def test_the_packed_video_is_exact_at_random(clips):
    clip = open_clip(clips / "pulling.mp4", ClipOptions(focal=569.4682))
    folder = open_clip(clips / "pulling")
    clip.cache.limit = 0
    for i in (62, 0, 31, 30, 59, 7):
        np.testing.assert_array_equal(clip.frame(i), folder.frame(i))
