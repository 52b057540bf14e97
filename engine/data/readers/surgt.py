"""A case of SurgT: a stereo video of one piece of tissue, `info.yaml`, `calibration.yaml` and bounding boxes; the left view is read."""

from __future__ import annotations

from pathlib import Path

from degense.engine.camera import Camera
from degense.engine.clip import Clip
from degense.engine.data.clip_options import ClipOptions
from degense.engine.data.files.cameras import clip_cameras, guessed_cameras
from degense.engine.data.files.masks import border_words, brightest, field_of_view
from degense.engine.data.files.numbered import shown
from degense.engine.data.files.remapped import RemappedFrames
from degense.engine.data.files.stored import clip_with_prior, looked_at
from degense.engine.data.files.surgt_case import read_case, rectification
from degense.engine.data.readers.video import VideoFrames
from degense.engine.errors import ClipError


def open_surgt(path: Path, options: ClipOptions) -> Clip:
    """Open a case, rectified as its ground truth is. ClipError when it cannot be read."""
    case = read_case(path)
    places, (fx, fy, cx, cy) = rectification(path, case.size)
    video = VideoFrames(case.video, options.start, options.stride, options.max_frames)
    if video.size not in ((2 * case.size[0], case.size[1]), (case.size[0], 2 * case.size[1])):
        told = f"{video.size[0]} × {video.size[1]}"
        raise ClipError(f"{shown(case.video)} is {told} pixels, but two views of {case.size[0]} × {case.size[1]} are needed.")
    pictures = RemappedFrames(video, case.crop, places)
    some = [pictures.read(i) for i in looked_at(len(pictures), 4)]
    field = field_of_view(brightest(some))
    if options.focal:
        cameras = guessed_cameras(len(pictures), case.size, field, options)
    else:
        focal = f"{fx:.6g} pixels, from calibration.yaml, rectified"
        cameras = clip_cameras([Camera(*case.size, fx, fy, cx, cy)] * len(pictures), None, focal, options)
    frames = f"{len(pictures)} frames of {case.size[0]} × {case.size[1]}, left view of {case.video.name}, rectified"
    words = {"frames": frames, "masks": border_words(field, "dark border"), "labels": "none"}
    fps = (video.rate or 25.0) / options.stride
    return clip_with_prior(path, pictures, some, field, cameras, words, fps=fps)
