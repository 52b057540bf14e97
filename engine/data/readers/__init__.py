"""Reading clips: `open_clip` takes a folder or a video file and gives a `Clip`; one file a layout."""

from degense.engine.data.clip_options import LAYOUTS, ClipOptions
from degense.engine.data.readers.detect import detect, open_clip, with_labels
from degense.engine.data.readers.identity import describe, fingerprint, frame_names

__all__ = ["LAYOUTS", "ClipOptions", "describe", "detect", "fingerprint", "frame_names", "open_clip", "with_labels"]
