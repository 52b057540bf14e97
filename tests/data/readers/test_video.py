"""Video files: each frame is the one a plain sequential decoding gives, in whatever order it is asked for."""

import tracemalloc

import cv2
import numpy as np
import pytest

from degense.engine.data.readers import ClipOptions, detect, open_clip
from degense.engine.data.readers.video import VideoFrames
from degense.engine.errors import ClipError
from tests.data.readers.makers import disc, tissue, write_video


def sequential(path):
    capture, frames = cv2.VideoCapture(str(path)), []
    while (read := capture.read())[0]:
        frames.append(cv2.cvtColor(read[1], cv2.COLOR_BGR2RGB))
    return frames


@pytest.mark.parametrize(("codec", "suffix"), [("mp4v", ".mp4"), ("MJPG", ".avi"), ("XVID", ".avi"), ("FFV1", ".mkv")])
def test_random_access_is_exact(tmp_path, codec, suffix):
    path = tmp_path / f"clip{suffix}"
    write_video(path, np.random.default_rng(1), 70, codec=codec)
    frames = sequential(path)
    clip = open_clip(path)
    clip.cache.limit = 0
    assert detect(path) == "video"
    assert len(clip) == len(frames) == 70
    for i in [0, 69, 3, 4, 40, 39, 38, *np.random.default_rng(2).integers(0, 70, 20)]:
        np.testing.assert_array_equal(clip.frame(int(i)), frames[i])


class Liar:
    """A capture whose seeks land elsewhere, as they do in files without a sound index."""

    def __init__(self, capture, off):
        self.capture, self.off = capture, off

    def set(self, what, value):
        return self.capture.set(what, max(0, value + self.off))

    def __getattr__(self, name):
        return getattr(self.capture, name)


@pytest.mark.parametrize("off", [-3, 2, 1000])
def test_a_seek_that_lands_elsewhere_is_noticed(tmp_path, monkeypatch, off):
    path = tmp_path / "clip.mp4"
    write_video(path, np.random.default_rng(3), 60)
    frames = sequential(path)
    honest = VideoFrames._reopened
    monkeypatch.setattr(VideoFrames, "_reopened", lambda self: Liar(honest(self), off))
    video = VideoFrames(path)
    for i in (50, 5, 59, 30, 31, 0):
        np.testing.assert_array_equal(video.read(i), frames[i])


def test_start_stride_and_max_frames(tmp_path):
    path = tmp_path / "clip.mp4"
    write_video(path, np.random.default_rng(4), 50)
    frames = sequential(path)
    clip = open_clip(path, ClipOptions(start=3, stride=4, max_frames=9))
    assert len(clip) == 9
    for i in (8, 0, 5):
        np.testing.assert_array_equal(clip.frame(i), frames[3 + 4 * i])
    assert "from frame 3, one in 4" in clip.provenance["frames"]
    assert "of about 50 goes on" in clip.provenance["frames"]
    whole = open_clip(path, ClipOptions(stride=7))
    assert len(whole) == 8
    assert "goes on" not in whole.provenance["frames"]
    exactly = open_clip(path, ClipOptions(max_frames=50))
    assert len(exactly) == 50
    assert "goes on" not in exactly.provenance["frames"]
    with pytest.raises(ClipError, match="has only 50 frames, but start is 50"):
        open_clip(path, ClipOptions(start=50))


def test_opening_holds_no_frames(tmp_path):
    path = tmp_path / "long.avi"
    write_video(path, np.random.default_rng(5), 400, (160, 128), "MJPG")
    one = 160 * 128 * 3
    tracemalloc.start()
    try:
        clip = open_clip(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(clip) == 400
    assert peak < 120 * one  # the depth prior looks at four frames at once; all 400 would be 25 MB


def test_field_of_view_of_a_video(tmp_path):
    rng = np.random.default_rng(6)
    writer = cv2.VideoWriter(str(tmp_path / "scope.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 25, (160, 128))
    for _ in range(12):
        writer.write(np.where(disc(160, 128)[..., None], tissue(rng, 160, 128)[..., ::-1], 0).astype(np.uint8))
    writer.release()
    clip = open_clip(tmp_path / "scope.avi")
    assert not clip.valid(3)[~disc(160, 128)].any()
    assert clip.valid(3)[disc(160, 128)].mean() > 0.9
    assert "dark border" in clip.provenance["masks"]


def test_a_video_cut_short_gives_what_is_there(tmp_path):
    whole = tmp_path / "whole.avi"
    write_video(whole, np.random.default_rng(7), 60, (160, 128), "MJPG")
    cut = tmp_path / "cut.avi"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    clip = open_clip(cut)
    assert 10 < len(clip) < 60
    np.testing.assert_array_equal(clip.frame(len(clip) - 2), sequential(whole)[len(clip) - 2])


def test_a_video_replaced_after_opening_is_an_error(tmp_path):
    path = tmp_path / "clip.mp4"
    write_video(path, np.random.default_rng(8), 60)
    clip = open_clip(path)
    write_video(path, np.random.default_rng(9), 60)
    clip.pictures._capture = clip.pictures._reopened()
    with pytest.raises(ClipError, match="was changed since it was opened"):
        clip.frame(30)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"not a video at all",
        b"#EXTM3U\n#EXTINF:1,\nhttp://127.0.0.1:9/x.ts\n",
        b"ffconcat version 1.0\nfile /etc/hostname\n",
        b"\0\0\0\x18ftypmp42",
    ],
)
def test_what_only_pretends_to_be_a_video(tmp_path, content):
    path = tmp_path / "clip.mp4"
    path.write_bytes(content)
    with pytest.raises(ClipError, match=r"clip\.mp4 is (not a video|damaged)"):
        open_clip(path)


@pytest.mark.parametrize("suffix", [".avi", ".mp4"])
def test_frame_rate(tmp_path, suffix):
    path = tmp_path / f"clip{suffix}"
    write_video(path, np.random.default_rng(10), 30, codec="MJPG" if suffix == ".avi" else "mp4v", rate=30)
    assert open_clip(path).fps == pytest.approx(30)
    assert open_clip(path, ClipOptions(stride=4)).fps == pytest.approx(7.5)


@pytest.mark.parametrize("claimed", [0.0, 0.5, 1e5, float("nan")])
def test_an_absurd_frame_rate_is_not_believed(tmp_path, monkeypatch, claimed):
    path = tmp_path / "clip.avi"
    write_video(path, np.random.default_rng(11), 10, codec="MJPG", rate=30)
    honest = VideoFrames._reopened
    monkeypatch.setattr(VideoFrames, "_reopened", lambda self: Claimant(honest(self), claimed))
    clip = open_clip(path)
    assert clip.fps == 25
    assert "a second" not in clip.provenance["frames"]


class Claimant:
    """A capture of a file that announces a frame rate of its own."""

    def __init__(self, capture, rate):
        self.capture, self.rate = capture, rate

    def get(self, what):
        return self.rate if what == cv2.CAP_PROP_FPS else self.capture.get(what)

    def __getattr__(self, name):
        return getattr(self.capture, name)
