"""Reading clips: `open_clip` takes a folder or a video file and gives a `Clip`; one file a layout."""

from degense.engine.data.clip_options import LAYOUTS, ClipOptions
from degense.engine.data.files.stored import describe, fingerprint, frame_names
from degense.engine.data.readers.detect import detect, open_clip, with_labels

__all__ = ["LAYOUTS", "ClipOptions", "describe", "detect", "fingerprint", "frame_names", "open_clip", "with_labels"]
