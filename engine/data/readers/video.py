"""Video files. Seeking in a video is only as exact as its index, so no seek is believed before its pixels were compared.

On opening, the part in use is decoded once, in order, and the checksum of each frame is kept (four bytes a frame). A frame asked for later
is found by reading on, when it lies just ahead, or by seeking; if its checksum is not the one from the sequential pass, the file is decoded
from its start again. That is exact for any codec and container, needs no disk cache, and costs one decoding pass on opening.
"""

from __future__ import annotations

import os
import threading
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from degense.engine.clip import Clip
from degense.engine.data.clip_options import ClipOptions
from degense.engine.data.files.cameras import ClipCameras, guessed_cameras
from degense.engine.data.files.images import MAX_PIXELS
from degense.engine.data.files.masks import border_words, field_of_view
from degense.engine.data.files.numbered import shown
from degense.engine.data.files.stored import StoredClip, clip_with_prior, looked_at
from degense.engine.errors import ClipError

SUFFIXES = (".mp4", ".avi", ".mov", ".mkv", ".webm")
CamerasOf = Callable[[int, tuple[int, int], np.ndarray | None, ClipOptions], ClipCameras]
READ_ON = 24  # frames ahead up to which decoding on is cheaper than a seek

# FFmpeg would print its own complaints beside ours
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")


def is_container(path: Path) -> bool:
    """Whether a file starts as MP4/MOV, AVI or Matroska does. FFmpeg goes by content, and a playlist called .mp4 would open other files."""
    with path.open("rb") as file:
        head = file.read(12)
    mp4 = head[4:8] in (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip")
    return mp4 or (head[:4] == b"RIFF" and head[8:12] == b"AVI ") or head[:4] == b"\x1a\x45\xdf\xa3"


def _checksum(image: np.ndarray) -> int:
    return zlib.crc32(np.ascontiguousarray(image).data)


class VideoFrames:
    """Frames of a video file, read when asked for, exact to the frame. ClipError for a file that cannot be decoded."""

    def __init__(self, path: Path, start: int = 0, stride: int = 1, max_frames: int = 2000):
        self.files = [path]  # the one file
        self.start, self.stride = start, stride
        self._lock = threading.Lock()
        if not path.is_file() or not is_container(path):
            raise ClipError(f"{shown(path)} is not a video that can be read ({', '.join(SUFFIXES)}).")
        self._capture, self._next = self._reopened(), 0
        self.announced = int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT))  # frames the container claims to have; not to be relied on
        rate = float(self._capture.get(cv2.CAP_PROP_FPS))
        #: Frames a second that the container claims; 0 where it claims none, or none between 1 and 240.
        self.rate = rate if 1 <= rate <= 240 else 0.0
        width, height = int(self._capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(self._capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
        if width * height > MAX_PIXELS:
            raise ClipError(
                f"{shown(path)} is {width} × {height} pixels, more than {MAX_PIXELS // 1_000_000} megapixels; scale it down first."
            )
        self._sums: list[int] = []
        self._scan(max_frames)

    def _reopened(self) -> cv2.VideoCapture:
        capture = cv2.VideoCapture(str(self.files[0].resolve()), cv2.CAP_FFMPEG)
        if not capture.isOpened():
            raise ClipError(f"{shown(self.files[0])} is damaged or in a codec that OpenCV cannot decode; convert it to H.264 in .mp4.")
        return capture

    def _scan(self, max_frames: int) -> None:
        """Decode the part in use once, in order."""
        expected = min(max_frames, max(1, (self.announced - self.start) // self.stride)) if self.announced > 0 else max_frames
        every = max(1, expected // 16)
        self.more = False
        while self._capture.grab():
            used = self._next >= self.start and (self._next - self.start) % self.stride == 0
            if used and len(self._sums) == max_frames:
                self.more = True
                break
            self._next += 1
            if not used:
                continue
            ok, image = self._capture.retrieve()
            if not ok:
                break
            if not self._sums:
                self.size = (image.shape[1], image.shape[0])
                self.brightest = image.max(axis=2)  # uint8 [H, W]; see `field_of_view.brightest`
            elif image.shape[1::-1] != self.size:
                raise ClipError(f"{shown(self.files[0])} changes its picture size at frame {self._next - 1}; cut it there.")
            if len(self._sums) % every == 0 and len(self._sums) % 8 != 1:  # no held-out frame
                self.brightest = np.maximum(self.brightest, image.max(axis=2))
            self._sums.append(_checksum(image))
        self._next += self.more  # the frame that showed there is more was grabbed too
        if not self._sums:
            reason = (
                f"has only {self._next} frames, but start is {self.start}"
                if 0 < self._next <= self.start
                else "has no frame that can be decoded"
            )
            raise ClipError(f"{shown(self.files[0])} {reason}.")

    def __len__(self) -> int:
        return len(self._sums)

    def read(self, index: int) -> np.ndarray:
        """RGB, uint8 [H, W, 3]. ClipError when the file no longer decodes as it did on opening."""
        target = self.start + index * self.stride
        with self._lock:
            if self._next > target or target - self._next > READ_ON:
                self._capture.set(cv2.CAP_PROP_POS_FRAMES, target)
                self._next = target
            image = self._advance(target)
            if image is None or _checksum(image) != self._sums[index]:
                self._capture.release()
                self._capture, self._next = self._reopened(), 0
                image = self._advance(target)
                if image is None or _checksum(image) != self._sums[index]:
                    raise ClipError(
                        f"{shown(self.files[0])} was changed since it was opened: frame {target} is another one now; open it again."
                    )
        return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)

    def _advance(self, target: int) -> np.ndarray | None:
        """Decode on to frame `target`, which lies ahead; None when the file ends before."""
        while self._next <= target:
            if not self._capture.grab():
                return None
            self._next += 1
        ok, image = self._capture.retrieve()
        return image if ok else None


def open_video(path: Path, options: ClipOptions) -> Clip:
    """Open a video file. ClipError when it cannot be read."""
    return video_clip(path, options, guessed_cameras)


def video_clip(path: Path, options: ClipOptions, cameras_of: CamerasOf) -> StoredClip:
    """The clip of a video file, with cameras for a number of frames of a size with a field of view."""
    pictures = VideoFrames(path, options.start, options.stride, options.max_frames)
    field = field_of_view(pictures.brightest)
    cameras = cameras_of(len(pictures), pictures.size, field, options)
    some = [pictures.read(i) for i in looked_at(len(pictures), 4)]
    words = {"frames": _frame_words(pictures, options), "masks": border_words(field, "dark border"), "labels": "none"}
    fps = (pictures.rate or 25.0) / options.stride
    return clip_with_prior(path, pictures, some, field, cameras, words, name=path.stem, fps=fps)


def _frame_words(pictures: VideoFrames, options: ClipOptions) -> str:
    words = f"{len(pictures)} frames of {pictures.size[0]} × {pictures.size[1]}"
    if pictures.rate > 0:
        words += f", {pictures.rate:.4g} a second"
    if options.stride > 1 or options.start:
        words += f", from frame {options.start}, one in {options.stride}"
    if pictures.more:
        total = f" of about {pictures.announced}" if pictures.announced > 0 else ""
        words += f"; the video{total} goes on: set start, stride or max_frames to choose others"
    elif pictures.announced > options.start + options.stride * len(pictures) + 1:
        words += f"; the file announces {pictures.announced}, but ends or breaks off earlier"
    return words
