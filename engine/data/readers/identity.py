"""What a clip is known by: the lines that describe it, the names of its frames, and a fingerprint."""

from __future__ import annotations

import hashlib
from pathlib import Path

from degense.engine.clip import Clip
from degense.engine.data.files.stored import StoredClip, sampled

DESCRIBED = ("frames", "poses", "focal", "masks", "depth", "labels", "strokes")
PIECE = 2**20


def describe(clip: Clip) -> str:
    """The lines a user sees: name, length and size, then where each thing comes from."""
    width, height = clip.size
    lines = [f"{clip.name}: {len(clip)} frames, {width} × {height}"]
    lines += [f"  {key:<7} {clip.provenance[key]}" for key in DESCRIBED if key in clip.provenance]
    if clip.classes:
        lines.append(f"  classes {', '.join(clip.classes)}")
    return "\n".join(lines)


def frame_names(clip: Clip) -> tuple[str, ...]:
    """What label files of the frames are called: the stems of the pictures, numbers where the frames are no files of their own."""
    if isinstance(clip, StoredClip) and len(clip.pictures.files) == len(clip) > 1:
        return tuple(file.stem for file in clip.pictures.files)
    return tuple(f"{index:06d}" for index in range(len(clip)))


def fingerprint(clip: Clip) -> str:
    """A name for a clip's frames that survives moving the folder: sha256, 64 hexadecimal digits.

    It covers the number and size of the frames, the names and byte sizes of their files, and the bytes of a few of them (of a large file:
    a piece at its start, middle and end). Masks, depth and labels are not covered: adding a label map leaves the clip the same.
    A clip that lies in no files is told by the pixels of a few frames.
    """
    digest = hashlib.sha256(f"{len(clip)} {clip.size[0]}x{clip.size[1]}\n".encode())
    if not isinstance(clip, StoredClip):
        for i in sampled(len(clip), 4):
            digest.update(clip.frame(i).tobytes())
        return digest.hexdigest()
    files = clip.pictures.files
    for file in files:
        digest.update(f"{file.name}\0{file.stat().st_size}\n".encode("utf-8", "surrogateescape"))
    for i in sampled(len(files), 4):
        _add_pieces(files[i], digest)
    return digest.hexdigest()


def _add_pieces(path: Path, digest: hashlib._Hash) -> None:
    size = path.stat().st_size
    with path.open("rb") as file:
        for offset in (0,) if size <= 3 * PIECE else (0, size // 2, size - PIECE):
            file.seek(offset)
            digest.update(file.read(3 * PIECE if size <= 3 * PIECE else PIECE))
