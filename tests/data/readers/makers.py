"""Small clips written to disk for the tests."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from degense.engine.data.readers import open_clip
from degense.engine.errors import ClipError

WIDTH, HEIGHT = 96, 64


def tissue(rng: np.random.Generator, width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    """A reddish textured picture, uint8 [H, W, 3], no pixel near black."""
    noise = cv2.GaussianBlur(rng.standard_normal((height, width)).astype(np.float32), (0, 0), 3)
    value = 150 + 60 * noise / np.abs(noise).max()
    return np.clip(np.stack([value, 0.5 * value, 0.45 * value], -1), 30, 255).astype(np.uint8)


def tool(index: int, width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    """An instrument that enters from the right and moves with the frame index, bool [H, W]."""
    mask = np.zeros((height, width), np.uint8)
    tip = (width // 2 - 3 * index, height // 2 + 2 * index)
    cv2.line(mask, tip, (width, height // 4), 1, height // 7)
    return mask.astype(bool)


def disc(width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    """A field of view cut by the frame, bool [H, W]."""
    ys, xs = np.mgrid[:height, :width] + 0.5
    return (xs - width / 2) ** 2 + (ys - height / 2) ** 2 < (0.44 * width) ** 2


def save(path: Path, array: np.ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(array).save(path)
    return path


def write_frames(
    folder: Path, rng: np.random.Generator, count: int = 5, with_tool: bool = False, name: str = "{:06d}.png"
) -> list[np.ndarray]:
    """Frames with an optional grey instrument; returns them."""
    frames = []
    base = tissue(rng)
    for i in range(count):
        frame = np.clip(base + rng.normal(0, 2, base.shape), 0, 255).astype(np.uint8)
        if with_tool:
            frame[tool(i)] = 120
        save(folder / name.format(i), frame)
        frames.append(frame)
    return frames


def write_endonerf(path: Path, rng: np.random.Generator, count: int = 5) -> list[np.ndarray]:
    """Images, masks (255 = tool) and identity poses."""
    frames = write_frames(path / "images", rng, count, with_tool=True)
    for i in range(count):
        save(path / f"masks/{i:06d}.png", (tool(i) * 255).astype(np.uint8))
    write_poses(path, count)
    return frames


def write_poses(path: Path, count: int, poses: np.ndarray | None = None, hwf: tuple[float, float, float] = (HEIGHT, WIDTH, 80.0)) -> None:
    """`poses_bounds.npy` from [N, 3, 4] poses; identity when none are given."""
    poses = np.tile(np.eye(3, 4), (count, 1, 1)) if poses is None else poses
    table = np.concatenate([poses, np.broadcast_to(np.array(hwf)[None, :, None], (count, 3, 1))], axis=2)
    np.save(path / "poses_bounds.npy", np.concatenate([table.reshape(count, 15), np.tile([1.0, 100.0], (count, 1))], axis=1))


def write_camera(path: Path, **changes: object) -> None:
    """`camera.json`; a change to None takes the key away."""
    data = {"width": WIDTH, "height": HEIGHT, "fx": 90.0, "fy": 91.0, "cx": 47.0, "cy": 33.0} | changes
    (path / "camera.json").write_text(json.dumps({k: v for k, v in data.items() if v is not None}))


def write_video(
    path: Path, rng: np.random.Generator, count: int, size: tuple[int, int] = (WIDTH, HEIGHT), codec: str = "mp4v", rate: float = 25
) -> None:
    """A moving texture; each frame is unlike each other one."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*codec), rate, size)
    assert writer.isOpened()
    base = tissue(rng, size[0] * 2, size[1])
    for i in range(count):
        frame = np.ascontiguousarray(base[:, i % size[0] : i % size[0] + size[0]])
        cv2.putText(frame, str(i), (4, size[1] - 8), 0, 0.7, (255, 255, 255), 1)
        writer.write(frame[..., ::-1])
    writer.release()


def fails(path, *words, options=None):
    """Opening gives a ClipError of one sentence with these words."""
    with pytest.raises(ClipError) as caught:
        open_clip(path, options)
    message = str(caught.value)
    assert "\n" not in message
    assert message.endswith(".")
    for word in words:
        assert word in message, message
