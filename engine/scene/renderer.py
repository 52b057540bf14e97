"""Drawing a scene: its channels, one number a Gaussian, and the semantics of a frame; frames of the surgeon's camera are kept."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from degense.engine.camera import Camera
from degense.engine.errors import DegenseError
from degense.engine.latest import Latest
from degense.engine.raster import camera_depths, rasterize
from degense.engine.scene.labelled import LabelledPlaces
from degense.engine.scene.states import States
from degense.engine.semantics import Basis
from degense.engine.semantics.masks import FrameSemantics, query_of
from degense.engine.semantics.masks.confidence import MARGINS_AS_CHANCES, ConfidenceCurve
from degense.engine.splats import Splats

CHANNELS = ("alpha", "rgb", "depth", "latent", "displacement", "uncertainty", "motion", "observability", "before")
OF_TISSUE = ("displacement", "uncertainty", "before")  # drawn of the persistent Gaussians where there are any
#: What is kept of drawn frames, and of the semantics of frames: some ten times as large, and drawn anew in about 20 ms
#: (docs/decisions/0052). The newest is kept whatever its size.
FRAME_BYTES, QUERY_BYTES = 64 << 20, 16 << 20
COVERED = 0.5  # alpha below which a pixel shows nothing
NEEDS_TEACHER = "train it from a clip with label maps, or with another teacher"
NO_OBSERVABILITY = "does not say which motion its recording reveals: it was made by an older version, or without optical flow"


class Renderer:
    """What a scene looks like. `name` is the run's, for sentences of errors; `camera_at` gives the surgeon's camera."""

    only_surgeons = False  # whether nothing can be drawn from another camera than the surgeon's

    def __init__(self, name: str, states: States, basis: Basis | None, camera_at: Callable[[float], Camera]):
        self.name, self.states, self.basis, self.camera_at = name, states, basis, camera_at
        self.curve: ConfidenceCurve = MARGINS_AS_CHANCES  # of the confidence of masks
        self.labelled: LabelledPlaces | None = None  # where the teacher labels few frames
        self.forget()

    def forget(self) -> None:
        """Forget drawn frames and their semantics; baked states stay."""
        self._cache, self._queries = Latest(FRAME_BYTES), Latest(QUERY_BYTES)

    def render(self, frame: float, camera: Camera | None = None, what: tuple[str, ...] = ("rgb",)) -> dict[str, np.ndarray]:
        """Draw one instant, all wanted channels in one pass; without a camera by the surgeon's, whose frames are kept.

        Of `CHANNELS`, float32: `alpha` [H, W], the opacity; `rgb` [H, W, 3] in [0, 1]; `depth` [H, W], clip units; `latent` [H, W, d];
        `displacement` [H, W] and `uncertainty` [H, W], how far off it may be, clip units, of the persistent Gaussians where there are
        any, and the scene's depth where transient ones hide them: nobody sees how tissue moves behind an instrument; `motion` [H, W, 2],
        pixels from here to the same point at the reference frame; `observability` [H, W] in [0, 1]; `before` [H, W, 3], the colours that
        the persistent Gaussians had at the reference frame. All but the opacity, colours and latents are NaN where nothing is.
        """
        if unknown := set(what) - set(CHANNELS):
            raise ValueError(f"nothing is called {sorted(unknown)}; choose from {CHANNELS}")
        if camera is not None:
            return self.draw(frame, camera, what)
        key = ("render", float(frame), what)
        return self._cache.get(key, lambda: self.draw(frame, self.camera_at(frame), what), lambda d: sum(a.nbytes for a in d.values()))

    def render_rgb(self, frame: float, camera: Camera | None = None) -> np.ndarray:
        """The colours of `render`, uint8 [H, W, 3]. Of the surgeon's camera they are kept as they are: a fifth of what `render` keeps."""
        if camera is not None:
            return self._drawn_rgb(frame, camera)
        return self._cache.get(("rgb", float(frame)), lambda: self._drawn_rgb(frame, self.camera_at(frame)), lambda image: image.nbytes)

    def _drawn_rgb(self, frame: float, camera: Camera) -> np.ndarray:
        return (self.draw(frame, camera, ("rgb",))["rgb"] * 255 + 0.5).astype(np.uint8)

    @torch.no_grad()
    def draw(self, frame: float, camera: Camera, what: tuple[str, ...]) -> dict[str, np.ndarray]:
        """`render` without the cache."""
        splats = self.states.splats(frame, semantics="latent" in what)
        columns = {name: self._column(name, splats, frame, camera) for name in what}
        transient = [(~self.states.model.persistent)[:, None].float()] if "uncertainty" in what else []
        drawn = rasterize(splats, torch.cat([*columns.values(), *transient], 1), camera, clean=True)
        image, alpha = drawn.image.cpu().numpy(), drawn.alpha.cpu().numpy()
        out: dict[str, np.ndarray] = {}
        first = 0
        for name, column in columns.items():
            value = image[..., first : first + column.shape[1]]
            first += column.shape[1]
            if name == "rgb":
                value = np.clip(value, 0, 1)
            elif name not in ("alpha", "latent"):
                value = np.where(alpha[..., None] >= COVERED, value / np.maximum(alpha[..., None], COVERED), np.nan)
            if name in OF_TISSUE and len(rows := self.states.persistent) < len(splats):
                # blood or char hides tissue that goes on moving, and has no place of its own at the reference frame
                tissue = _blended(splats.map(lambda part: part[rows]), column[rows], camera)
                value = np.where(np.isfinite(tissue), tissue, value)
            if name == "uncertainty":
                hidden = image[..., -1] > 0.5 * alpha
                value = np.where(hidden[..., None] & np.isfinite(value), np.float32(self.states.depth), value)
            out[name] = np.ascontiguousarray(value[..., 0] if value.shape[-1] == 1 else value)
        return out

    def _column(self, name: str, splats: Splats, frame: float, camera: Camera) -> Tensor:
        """The features [N, c] that are blended for a channel. DegenseError when the run has none."""
        states = self.states
        if name == "alpha":
            return splats.colors.new_ones(len(splats), 1)
        if name == "rgb":
            return splats.colors
        if name == "depth":
            return camera_depths(splats.means, camera)[:, None]
        if name == "before":
            return states.splats(states.reference_frame).colors
        if name == "displacement":
            return states.displacement(frame)[:, None]
        if name == "latent":
            if self.basis is None:
                raise DegenseError(f"{self.name} was trained without semantics, so it has no latent features to show")
            return splats.semantics
        if name in ("observability", "uncertainty"):
            if states.observability is None:
                raise DegenseError(f"{self.name} {NO_OBSERVABILITY}")
            return (states.observability if name == "observability" else states.uncertainty(frame))[:, None]
        moves_with_the_clip = camera is self.camera_at(frame)
        return states.screen_motion(frame, camera, self.camera_at(states.reference_frame) if moves_with_the_clip else camera)

    def blend(self, name: str, frame: float, values: Callable[[], Tensor], camera: Camera | None = None) -> np.ndarray:
        """One number a Gaussian, [N], blended over the Gaussians of each pixel: Σ v·w / Σ w, float32 [H, W], NaN where nothing is.

        With the surgeon's camera (None) the result is kept under `name`.
        """

        @torch.no_grad()
        def drawn(view: Camera) -> np.ndarray:
            return _blended(self.states.splats(frame), values()[:, None], view)[..., 0]

        if camera is not None:
            return drawn(camera)
        return self._cache.get(("blend", name, float(frame)), lambda: drawn(self.camera_at(frame)), lambda blended: blended.nbytes)

    def query(self, frame: float, camera: Camera | None = None) -> FrameSemantics:
        """The frame's semantics, ready for any number of prompts; kept for the surgeon's camera. DegenseError without semantics."""
        if camera is not None:
            return self.new_query(frame, camera)
        view = self.camera_at(frame)
        weight = view.width * view.height * 4 * ((self.basis.rank if self.basis is not None else 0) + 32)
        if float(frame) not in self._queries:
            self._queries.make_room(weight)
        return self._queries.get(float(frame), lambda: self.new_query(frame, view), lambda _: weight)

    @torch.no_grad()
    def new_query(self, frame: float, camera: Camera) -> FrameSemantics:
        """`query` without the cache; on a GPU the drawn frame stays there."""
        if self.basis is None:
            raise DegenseError(f"{self.name} was trained without semantics, so it cannot be prompted; {NEEDS_TEACHER}")
        splats = self.states.splats(frame, semantics=True)
        drawn = rasterize(splats, torch.cat([splats.colors, splats.semantics], 1), camera, clean=True)
        return query_of(drawn, self.basis, self.curve, self.known(frame, camera))

    def known(self, frame: float, camera: Camera) -> Tensor | None:
        """Which pixels show what a labelled frame shows, bool [H, W]; None where the teacher labels the whole clip."""
        return self.labelled.pixels(frame, camera) if self.labelled is not None else None


def _blended(splats: Splats, values: Tensor, camera: Camera) -> np.ndarray:
    """Numbers [N, c] blended over the Gaussians of each pixel: Σ v·w / Σ w, float32 [H, W, c], NaN where nothing is."""
    drawn = rasterize(splats, values, camera, clean=True)
    image, alpha = drawn.image.cpu().numpy(), drawn.alpha.cpu().numpy()[..., None]
    return np.where(alpha >= COVERED, image / np.maximum(alpha, COVERED), np.nan).astype(np.float32)
