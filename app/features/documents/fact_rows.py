"""What is said of the clip or run that is open, as labels with their texts. No Qt."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from degense.engine.clip import Clip
    from degense.engine.scene import Scene


def clip_facts(clip: Clip) -> list[tuple[str, str]]:
    width, height = clip.size
    rows = [("clip", clip.name), ("length", f"{len(clip)} frames, {width} × {height}")]
    rows += list(clip.provenance.items())
    return [*rows, ("classes", ", ".join(clip.classes))] if clip.classes else rows


def run_facts(scene: Scene) -> list[tuple[str, str]]:
    info, teacher, (width, height) = scene.run.info, scene.run.info.get("teacher", {}), scene.clip_size
    rows = [
        ("run", scene.name),
        ("clip", str(info["clip"].get("path", ""))),
        ("length", f"{scene.frames} frames, {width} × {height}"),
        ("Gaussians", f"{info.get('gaussians', 0):,}"),
        ("trained", f"{info['config']['preset']}, {info['config']['routing']} routing, {info.get('train_seconds', 0):.0f} s"),
        ("teacher", f"{teacher.get('name')}: {teacher.get('provenance', 'unknown')}"),
        ("unit", f"{scene.unit}, displacement from frame {scene.reference_frame}"),
        ("classes", ", ".join(scene.classes) or "none"),
    ]
    if scene.clip_missing:
        rows.append(("missing", scene.clip_missing))
    return rows + [(key, text) for key, text in info.get("provenance", {}).items()]
