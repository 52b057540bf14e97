"""Writes a phantom as a clip folder in the *frames* layout, truth included."""

from __future__ import annotations

import json
import shutil
import tempfile
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from PIL import Image

from degense.engine.data.synthetic.recording import PhantomTracks, Recorder, psnr
from degense.engine.data.synthetic.scene import KINDS, PhantomFrame, PhantomScene
from degense.engine.errors import DegenseError
from degense.engine.progress import Progress, silent


@dataclass(frozen=True)
class PhantomOptions:
    """What to synthesise. The same options give the same bytes."""

    frames: int = 40  # the story (of the kind) always fills the clip: fewer frames play it faster
    width: int = 320  # pixels
    height: int = 256  # pixels
    seed: int = 0  # varies shapes, places, textures and motion
    camera_motion: float = 0.0  # amplitude of the camera's smooth path, mm, 0 to 15; 0 stands still
    #: Standard deviation of the sensor noise, 8-bit grey levels. 1.5 (with rounding) puts the noise floor at 44.5 dB: a perfect
    #: reconstruction scores no more, and 44.3 dB once it is rounded to 8 bits too.
    noise: float = 1.5
    #: "cautery": a grasper pulls the gallbladder while an electrocautery hook chars tissue that stands still. "family": a surgery that the
    #: seed draws, noise, compression and camera included (`engine.research.surgeries`, once imported).
    kind: str = "cautery"
    #: What is written to `depth/`: the truth, what a stereo endoscope would measure, or nothing.
    depth: Literal["exact", "noisy", "none"] = "exact"
    #: Write `masks/NNNNNN.png` too, 255 = pixels that a tool shows in, so that the tools are neither reconstructed nor scored.
    tool_masks: bool = False

    def __post_init__(self) -> None:
        limits = {
            "frames": (1, 2000),
            "width": (32, 1920),
            "height": (32, 1920),
            "camera_motion": (0, 15),
            "noise": (0, 64),
            "seed": (0, 2**63),
        }
        for name, (low, high) in limits.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise DegenseError(f"A phantom cannot be made with {name} {value}: choose {low} to {high}.")
        if not 0.5 <= self.height / self.width <= 1.5:
            raise DegenseError(
                f"A phantom of {self.width} × {self.height} pixels has a strange shape: choose a height of 0.5 to 1.5 times the width."
            )
        if self.kind not in KINDS:
            raise DegenseError(f"There is no phantom of the kind '{self.kind}': choose {' or '.join(KINDS)}.")
        if self.depth not in ("exact", "noisy", "none"):
            raise DegenseError(f"A phantom has no depth '{self.depth}': choose exact, noisy or none.")


def make_phantom(out: Path, options: PhantomOptions = PhantomOptions(), progress: Progress = silent) -> None:
    """Write a synthetic clip.

    `images/NNNNNN.png`; `labels/NNNNNN.png` (8-bit index with a palette) and `classes.json`; `depth/NNNNNN.npy` (float32 camera z, mm);
    `camera.json` (intrinsics, `viewmats` world → camera); `surgery.json`, what is seen and what a perfect reconstruction would score;
    `gt.npz` with `displacement` float32 [T, H, W, 3], mm, `cautery` bool [T, H, W], `tracks` float32 [K, T, 3] and `visible` bool [K, T],
    see `engine.clip.Truth`. Displacement is a property of the tissue: it is in the axes of the camera at frame 0, which are the world's,
    even when the camera moves. `cautery` marks tissue from its first visible change of colour on: it moves as it would without. What a cut
    lays open was hidden at frame 0; its place there is exact too.

    The folder `out` must not exist yet or be empty. It appears when everything is written, so a stopped run leaves nothing behind.
    DegenseError when it is in use or cannot be written.
    """
    out = Path(out).absolute()
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise DegenseError(f"{out} is not an empty folder: choose a new one for the phantom.")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(prefix=f".{out.name}.", dir=out.parent))
    except OSError as error:
        raise DegenseError(f"{out} cannot be written ({error.strerror}): choose another folder.") from error
    try:
        _write(draft, options, progress)
        draft.chmod(0o755)
        if out.exists():
            out.rmdir()
        draft.rename(out)
    except OSError as error:
        raise DegenseError(f"{out} cannot be written ({error.strerror}): free some space or choose another folder.") from error
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def _write(folder: Path, options: PhantomOptions, progress: Progress) -> None:
    progress(0.0, "growing tissue")
    for name in ("images", "labels", *(["depth"] if options.depth != "none" else []), *(["masks"] if options.tool_masks else [])):
        (folder / name).mkdir()
    scene = PhantomScene(options.kind, options.width, options.height, options.seed, options.camera_motion)
    times = np.linspace(0.0, 1.0, options.frames) if options.frames > 1 else np.zeros(1)
    (folder / "classes.json").write_text(json.dumps({"classes": list(scene.stage.classes)}, indent=1) + "\n", encoding="utf-8")
    (folder / "camera.json").write_text(json.dumps(_cameras(scene, times), indent=1) + "\n", encoding="utf-8")

    shape = (options.frames, options.height, options.width)
    cautery, tracks, ceilings = np.zeros(shape, bool), PhantomTracks(scene, options.seed), []
    stage = scene.stage
    recorder = Recorder(options.seed, options.noise if stage.noise is None else stage.noise, stage.jpeg)
    # Written frame by frame, as np.savez_compressed would, because a long clip's displacement does not fit in memory.
    with zipfile.ZipFile(folder / "gt.npz", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        with archive.open(zipfile.ZipInfo("displacement.npy"), "w", force_zip64=True) as file:
            np.lib.format.write_array_header_1_0(file, {"descr": "<f4", "fortran_order": False, "shape": (*shape, 3)})
            for i, s in enumerate(times):
                view = scene.view(float(s))
                image = recorder.frame(view.rgb, i)
                ceilings.append(psnr(image, view.rgb))
                _write_frame(folder, i, view, image, scene.stage.palette)
                if options.depth != "none":
                    depth = view.depth if options.depth == "exact" else recorder.stereo_depth(view.depth, image, scene.focal, i)
                    np.save(folder / "depth" / f"{i:06d}.npy", depth)
                if options.tool_masks:
                    Image.fromarray(np.where(view.tools, 255, 0).astype(np.uint8)).save(folder / "masks" / f"{i:06d}.png")
                file.write(view.displacement.tobytes())
                cautery[i] = view.cautery
                tracks.add(float(s), view)
                progress((i + 1) / options.frames, f"photographed frame {i + 1} of {options.frames}")
        for name, array in zip(("cautery", "tracks", "visible"), (cautery, *tracks.arrays()), strict=True):
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as file:
                np.lib.format.write_array(file, array)
    ceiling = {"psnr_ceiling": round(float(np.mean(ceilings)), 2)}
    facts = {"kind": options.kind, "seed": options.seed, "depth": options.depth} | ceiling | stage.facts
    (folder / "surgery.json").write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")


def _write_frame(folder: Path, index: int, view: PhantomFrame, image: np.ndarray, palette: Sequence[tuple[int, int, int]]) -> None:
    stem = f"{index:06d}"
    encoded = cv2.imencode(".png", image[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 3])[1]
    (folder / "images" / f"{stem}.png").write_bytes(encoded.tobytes())
    labels = Image.fromarray(view.labels)
    labels.putpalette(np.array(palette, np.uint8).tobytes())
    labels.save(folder / "labels" / f"{stem}.png")


def _cameras(scene: PhantomScene, times: np.ndarray) -> dict:
    cameras = [scene.camera(float(s)) for s in times]
    first = cameras[0]
    return {
        **{name: getattr(first, name) for name in ("width", "height", "fx", "fy", "cx", "cy")},
        "unit": "mm",
        "viewmats": [camera.viewmat.tolist() for camera in cameras],
    }
