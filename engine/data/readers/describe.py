"""What a user is told of an opened clip."""

from __future__ import annotations

from degense.engine.clip import Clip

KEYS = ("frames", "poses", "focal", "masks", "depth", "labels", "strokes")


def describe(clip: Clip) -> str:
    """The lines a user sees: name, length and size, then where each thing comes from."""
    width, height = clip.size
    lines = [f"{clip.name}: {len(clip)} frames, {width} × {height}"]
    lines += [f"  {key:<7} {clip.provenance[key]}" for key in KEYS if key in clip.provenance]
    if clip.classes:
        lines.append(f"  classes {', '.join(clip.classes)}")
    return "\n".join(lines)
