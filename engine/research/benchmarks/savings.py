"""What is skipped where a scene does not need it, one saving at a time: on and off, time saved and error added."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from statistics import median

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from degense.engine.field.hexplane import HexPlane, sample_levels
from degense.engine.field.static_gaussians import find_moving
from degense.engine.metrics.image import psnr
from degense.engine.progress import Progress
from degense.engine.raster import rasterize
from degense.engine.raster.limits import MAX_ALPHA, MIN_ALPHA, MIN_TRANSMITTANCE
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Cell, Column, Table
from degense.engine.research.bench.timing import measure_in_turn
from degense.engine.research.raster_reference import project
from degense.engine.scene import Scene
from degense.engine.semantics.masks import FrameSemantics
from degense.engine.semantics.prompts import PromptVectors

SAMPLED = 256  # pixels on which early termination is looked at


@dataclass(frozen=True)
class Saving:
    """One saving.

    Attributes
    ----------
    name : str
    ways : (callable, callable) or None
        The work without and with it; None where the code cannot leave it out, so that there is no time to compare.
    error : str
        What it adds, in words with a number.
    """

    name: str
    ways: tuple[Callable[[], object], Callable[[], object]] | None
    error: str


def savings_table(scene: Scene, words: str, options: BenchOptions, progress: Progress) -> Table:
    """Every saving on and off, on one scene."""
    table = Table(
        "field-savings",
        "What the savings save, and what they cost",
        f"{words}. Wall times, {options.repeats} repeats after 3 that warm up, without and with in turn; the share saved is of medians. "
        f"Pictures have {scene.clip_size[0]} × {scene.clip_size[1]} pixels.",
        [
            Column("name", "saving"),
            Column("off", "without, ms"),
            Column("on", "with, ms"),
            Column("saved", "saved, %", 0),
            Column("error", "error added"),
        ],
    )
    for done, maker in enumerate(SAVINGS):
        progress(done / len(SAVINGS), "savings, on and off")
        for saving in maker(scene):
            row: dict[str, Cell] = {"name": saving.name, "error": saving.error}
            if saving.ways is not None:
                off, on = measure_in_turn(saving.ways, options.repeats, options.device)
                row |= {"off": off, "on": on, "saved": 100 * (1 - median(on) / median(off))}
            table.rows.append(row)
    return table


def _baking(scene: Scene) -> Iterator[Saving]:
    frame = scene.frames // 2
    live, baked = scene.model.at(scene.time(frame)).splats, scene.splats(frame, semantics=True)
    unit = scene.run.info["unit"]
    error = max((live.means / unit - baked.means).abs().max().item(), (live.colors - baked.colors).abs().max().item())
    yield Saving(
        "baked states instead of the field",
        (lambda: scene.model.at(scene.time(frame)), lambda: scene.splats(frame, semantics=True)),
        f"{error:.0e} of centres and colours",
    )


def _semantic_channels(scene: Scene) -> Iterator[Saving]:
    frame = scene.frames // 2
    camera, t = scene.camera(frame), scene.time(frame)
    splats = scene.splats(frame, semantics=True)
    everything = torch.cat([splats.colors, splats.semantics], 1)

    def drawn(features: Tensor) -> Tensor:
        return rasterize(splats, features, camera).image

    error = (drawn(everything)[..., :3] - drawn(splats.colors)).abs().max().item()
    yield Saving(
        f"no semantic channels in the picture ({splats.semantics.shape[1]} of them)",
        (lambda: drawn(everything), lambda: drawn(splats.colors)),
        f"{255 * error:.0e} of 255 in the colours",
    )
    with_, without = scene.model.at(t).splats, scene.model.at(t, semantics=False).splats
    error = max((getattr(with_, name) - getattr(without, name)).abs().max().item() for name in ("means", "opacities", "colors"))
    yield Saving(
        "no semantics in the field",
        (lambda: scene.model.at(t), lambda: scene.model.at(t, semantics=False)),
        f"{error:.0e} of centres, opacities and colours",
    )


def _lines(scene: Scene) -> Iterator[Saving]:
    model, t = scene.model, scene.time(scene.frames // 2)
    points = model.normalised(model.canonical["means"]).clamp(-1, 1)
    planes = still_planes(model.planes, t)

    def sampled() -> Tensor:
        return sample_levels(points, list(model.planes.space), model.planes.lines(t))

    truth = bilinear_planes(model.planes.space, planes, points, t)
    for name, on in (("in plain torch", sampled), ("as the engine has it, fused", lambda: model.planes(points, t))):
        error = ((on() - truth).norm() / truth.norm()).item()
        ways = (lambda: bilinear_planes(model.planes.space, planes, points, t), on)
        yield Saving(f"time planes as lines, {name}", ways, f"{error:.0e} of a feature")


def still_planes(planes: HexPlane, t: float) -> list[Tensor]:
    """Time planes [3, K, R, C], as large as the real ones, that hold at every time what those hold at `t`, however they interpolate."""
    return [line[:, None].repeat(1, time.shape[1], 1, 1) for line, time in zip(planes.lines(t), planes.time, strict=True)]


def bilinear_planes(space: Iterable[Tensor], time: Iterable[Tensor], points: Tensor, t: float) -> Tensor:
    """H(p, t) by six bilinear look-ups a level, as peers do it: features [N, channels × levels] of points [N, 3] in [-1, 1]."""
    spots = torch.cat([points, torch.full_like(points[:, :1], t)], 1)
    features = []
    for of_space, of_time in zip(space, time, strict=True):
        product = torch.ones_like(of_space[0, 0, 0]).expand(len(points), -1)
        for plane, (column, row) in zip((*of_space, *of_time), ((0, 1), (0, 2), (1, 2), (0, 3), (1, 3), (2, 3)), strict=True):
            grid = spots[:, [column, row]][None, :, None]
            product = product * F.grid_sample(plane.permute(2, 0, 1)[None], grid, padding_mode="border", align_corners=True)[0, ..., 0].T
        features.append(product)
    return torch.cat(features, 1)


def _still_gaussians(scene: Scene) -> Iterator[Saving]:
    model, frame = scene.model, scene.frames // 2
    t, camera = scene.time(frame), scene.camera(frame)
    lean = copy.copy(model)
    lean._buffers = dict(model._buffers)
    lean.moving = find_moving(model, [scene.time(i) for i in range(scene.frames)], camera.fx)
    pictures = []
    for states in (model.at(t).splats, lean.at(t).splats):
        drawn = rasterize(states, states.colors, camera.with_unit(scene.run.info["unit"]))
        pictures.append(drawn.image.clamp(0, 1).cpu().numpy())
    share = 1 - len(lean.moving) / len(model)
    error = f"{psnr(pictures[1], pictures[0]):.1f} dB against the picture with all of them"
    yield Saving(f"still Gaussians out of the field ({share:.0%} of them)", (lambda: model.at(t), lambda: lean.at(t)), error)


def _early_termination(scene: Scene) -> Iterator[Saving]:
    """The kernels cannot draw on, so what that would change is computed in float64, on some pixels of the scene."""
    frame = scene.frames // 2
    camera = scene.camera(frame)
    splats = scene.splats(frame).to("cpu").map(Tensor.double)
    centres, depths, _, precisions = project(splats.means, splats.quats, splats.scales, camera)
    order = depths.argsort()
    centres, precisions, opacities, colors = centres[order], precisions[order], splats.opacities[order], splats.colors[order]
    pixels = torch.from_numpy(np.random.default_rng(0).uniform(0, [camera.width, camera.height], (SAMPLED, 2)))
    largest, pairs, skipped = 0.0, 0, 0
    for chunk in pixels.split(32):
        offset = chunk[:, None] - centres
        alpha = (opacities * torch.exp(-0.5 * torch.einsum("pni,nij,pnj->pn", offset, precisions, offset))).clamp(max=MAX_ALPHA)
        alpha = torch.where(alpha >= MIN_ALPHA, alpha, 0.0)
        after = torch.cumprod(1 - alpha, 1)
        weights = alpha * torch.cat([torch.ones_like(after[:, :1]), after[:, :-1]], 1)
        beyond = (after <= MIN_TRANSMITTANCE) & (alpha > 0)
        largest = max(largest, ((weights * beyond) @ colors).abs().max().item())
        pairs, skipped = pairs + int((alpha > 0).sum()), skipped + int(beyond.sum())
    error = f"{255 * largest:.1e} of 255 at most, for {skipped / max(pairs, 1):.0%} of the Gaussians that lie on a pixel"
    yield Saving(f"pixels finished at transmittance {MIN_TRANSMITTANCE:g}", None, error)


def _kept_maps(scene: Scene) -> Iterator[Saving]:
    frame = scene.frames // 2
    vectors = scene.vectors(scene.classes)
    drawn = scene.renderer.draw(frame, scene.camera(frame), ("rgb", "latent", "alpha"))
    rgb, latent, alpha = (drawn["rgb"] * 255 + 0.5).astype(np.uint8), drawn["latent"], drawn["alpha"]
    assert scene.basis is not None
    basis = scene.basis

    def anew(threshold: float = 0.5) -> np.ndarray:
        return FrameSemantics(rgb, latent, basis, alpha).decode(PromptVectors((vectors[0],), threshold=threshold)).masks

    kept = FrameSemantics(rgb, latent, basis, alpha)
    kept.decode(PromptVectors((vectors[1],)))
    turn = np.random.default_rng(0)

    def new_prompt() -> np.ndarray:
        # a fresh direction near a class, so that nothing is answered from kept maps
        return kept.decode(PromptVectors((vectors[0] + turn.normal(0, 1e-6, vectors.shape[1]),))).masks

    for name, on in (
        ("superpixels kept, another prompt", new_prompt),
        ("similarities kept, another threshold", lambda: kept.decode(PromptVectors((vectors[0],))).masks),
    ):
        differ = np.count_nonzero(on() != anew())
        yield Saving(f"{name} on the same picture", (anew, on), f"{differ} pixels of the mask")


def _resolution(scene: Scene) -> Iterator[Saving]:
    frame = scene.frames // 2
    camera = scene.camera(frame)
    full = scene.renderer.draw(frame, camera, ("rgb",))["rgb"]

    def half() -> np.ndarray:
        small = scene.renderer.draw(frame, camera.scaled(0.5), ("rgb",))["rgb"]
        return cv2.resize(small, (camera.width, camera.height), interpolation=cv2.INTER_LINEAR)

    error = f"{psnr(half(), full):.1f} dB against the full picture"
    yield Saving("half the resolution, enlarged again", (lambda: scene.renderer.draw(frame, camera, ("rgb",)), half), error)


#: Everything that can be switched, in the order of the table. A new saving is one more function here.
SAVINGS: tuple[Callable[[Scene], Iterator[Saving]], ...] = (
    _baking,
    _semantic_channels,
    _lines,
    _still_gaussians,
    _early_termination,
    _kept_maps,
    _resolution,
)
