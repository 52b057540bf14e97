"""Reading clips: `open_clip` takes a folder or a video file and gives a `Clip`; one file a layout."""

from engine.readers.describe import describe
from engine.readers.detect import detect, open_clip
from engine.readers.fingerprint import fingerprint
from engine.readers.options import LAYOUTS, ClipOptions
from engine.readers.relabelled import frame_names, with_labels

__all__ = ["LAYOUTS", "ClipOptions", "describe", "detect", "fingerprint", "frame_names", "open_clip", "with_labels"]
