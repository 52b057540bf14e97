"""A clip is recognised where its folder was moved, and not where its frames changed."""

import shutil
import sys
from pathlib import Path

import numpy as np

from degense.engine.camera import Camera
from degense.engine.clip import Clip
from degense.engine.data.readers import fingerprint, open_clip
from tests.data.readers.makers import save, tissue, write_endonerf, write_frames, write_video


def test_moving_keeps_it_and_changing_frames_does_not(tmp_path):
    write_endonerf(tmp_path / "a", np.random.default_rng(1))
    before = fingerprint(open_clip(tmp_path / "a"))
    assert len(before) == 64
    shutil.copytree(tmp_path / "a", tmp_path / "b/c")
    assert fingerprint(open_clip(tmp_path / "b/c")) == before
    for i in range(5):
        (tmp_path / f"b/c/masks/{i:06d}.png").unlink()
    assert fingerprint(open_clip(tmp_path / "b/c")) == before
    save(tmp_path / "b/c/images/000000.png", tissue(np.random.default_rng(2)))
    assert fingerprint(open_clip(tmp_path / "b/c")) != before


def test_names_and_count_matter(tmp_path):
    write_frames(tmp_path / "a", np.random.default_rng(3), 3)
    before = fingerprint(open_clip(tmp_path / "a"))
    (tmp_path / "a/000001.png").rename(tmp_path / "a/000005.png")
    renamed = fingerprint(open_clip(tmp_path / "a"))
    (tmp_path / "a/000005.png").unlink()
    assert len({before, renamed, fingerprint(open_clip(tmp_path / "a"))}) == 3


def test_large_files_are_sampled_at_their_end_too(tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules["degense.engine.data.files.stored"], "PIECE", 2000)
    path = tmp_path / "clip.avi"
    write_video(path, np.random.default_rng(4), 12, codec="MJPG")
    assert path.stat().st_size > 8000
    clip = open_clip(path)
    before = fingerprint(clip)
    data = bytearray(path.read_bytes())
    data[-100] ^= 1
    path.write_bytes(data)
    assert fingerprint(clip) != before


class Made(Clip):
    depth_measured = False

    def frame(self, index):
        return np.full((4, 6, 3), index + self.level, np.uint8)

    def valid(self, index):
        return np.ones((4, 6), bool)

    def depth(self, index):
        return np.ones((4, 6), np.float32)


def test_clips_without_files_are_told_by_their_pixels():
    a, b = (Made("made", Path("."), [Camera(6, 4, 5, 5, 3, 2)] * 9) for _ in range(2))
    a.level = b.level = 1
    assert fingerprint(a) == fingerprint(b)
    b.level = 2
    assert fingerprint(a) != fingerprint(b)
