"""A trained run, ready to be looked at: states in time, pictures, queries. Lengths are in the clip's own unit."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch
from torch import Tensor

from degense.engine.camera import Camera
from degense.engine.clip import Clip
from degense.engine.errors import DegenseError, RunError
from degense.engine.field import SceneModel
from degense.engine.field.live import LiveField
from degense.engine.motion import displacement
from degense.engine.motion.observed import ObservedMotion
from degense.engine.raster import camera_depths, rasterize
from degense.engine.semantics import Basis, TextEncoder, open_encoder
from degense.engine.semantics.masks import FrameSemantics, query_of
from degense.engine.splats import Splats
from degense.engine.store import Run

Value = TypeVar("Value")
CHANNELS = ("rgb", "depth", "latent", "displacement", "motion", "support")
STATE_BYTES, PICTURE_BYTES = 1 << 30, 256 << 20
KEPT_PROMPTS = 1000
NEEDS_TEACHER = "train it from a clip with label maps, or with another teacher"
NO_SUPPORT = "does not say which motion its recording reveals: it was made by an older version, or without optical flow"
COVERED = 0.5  # alpha below which a pixel shows nothing
REVEALED = 0.5  # support below which a displacement is uncertain: the recording showed it in less than half of the frames


class Cache:
    """Least recently used values, bounded by their bytes."""

    def __init__(self, limit: int):
        self.limit, self.size = limit, 0
        self._held: OrderedDict[Hashable, tuple[int, Any]] = OrderedDict()

    def __contains__(self, key: Hashable) -> bool:
        return key in self._held

    def get(self, key: Hashable, make: Callable[[], Value], weigh: Callable[[Value], int]) -> Value:
        if key in self._held:
            self._held.move_to_end(key)
            return self._held[key][1]
        value = make()
        self._held[key] = (weigh(value), value)
        self.size += self._held[key][0]
        while self.size > self.limit and len(self._held) > 1:
            self.size -= self._held.popitem(last=False)[1][0]
        return value


class Scene:
    """One opened run.

    Attributes
    ----------
    run : Run
    model : SceneModel
    basis : Basis or None
    encoder : TextEncoder or None
        The encoder that made the run's features; no other may answer prompts.
    clip : Clip or None
        The recording, when it is still where it was.
    clip_missing : str
        Why `clip` is None, in one sentence; empty otherwise.
    support : Tensor or None
        Share [N] of its frames in which the recording reveals how far each Gaussian has moved; None for a run that kept none.
    """

    def __init__(
        self,
        run: Run,
        model: SceneModel,
        basis: Basis | None,
        encoder: TextEncoder | None,
        clip: Clip | None,
        clip_missing: str = "",
        support: Tensor | None = None,
    ):
        self.run, self.model, self.basis, self.encoder, self.clip, self.clip_missing = run, model, basis, encoder, clip, clip_missing
        self.cameras = run.cameras
        self.support = support.to(model.bounds.device) if support is not None else None
        self._states, self._pictures = Cache(STATE_BYTES), Cache(PICTURE_BYTES)
        self._asked: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self._vectors: dict[tuple[str, ...], np.ndarray] = {}  # of the last texts: those of the classes, again and again

    @classmethod
    def open(
        cls,
        path: Path | str,
        *,
        device: str | torch.device | None = None,
        clip: Clip | None = None,
        encoder: TextEncoder | None = None,
    ) -> Scene:
        """Open a run folder. RunError when it is damaged, or `encoder` did not make its features.

        `device` None takes a GPU when there is one; `encoder` None takes what the run keeps of its own.
        """
        run = Run.open(path)
        if device is None:
            device = "cuda" if torch.cuda.is_available() else "cpu"
        model = run.load_model(device).eval().requires_grad_(False)
        name = run.info.get("encoder")
        if encoder is not None and name is None:
            raise RunError(f"{run.path.name} was trained without semantics, so no encoder can answer prompts; {NEEDS_TEACHER}")
        speaks, basis = open_encoder(name, tuple(run.info["classes"]), run.path, encoder) if name else None, run.load_basis()
        if speaks is not None and (basis is None or basis.dimension != speaks.dimension):
            length = "no length" if basis is None else f"length {basis.dimension}"
            raise RunError(
                f"{run.path.name} has features of {length}, and text vectors of length {speaks.dimension}; one of them is damaged"
            )
        missing = ""
        if clip is None:
            clip, missing = _find_clip(run)
        return cls(run, model, basis, speaks, clip, missing, run.load_support(len(model)))

    # -- facts -----------------------------------------------------------------------------------------------------------------------------
    @property
    def name(self) -> str:
        return self.run.path.name

    @property
    def frames(self) -> int:
        return len(self.cameras)

    @property
    def clip_size(self) -> tuple[int, int]:
        """(width, height), pixels."""
        return self.cameras[0].width, self.cameras[0].height

    @property
    def classes(self) -> tuple[str, ...]:
        return tuple(self.run.info["classes"])

    @property
    def unit(self) -> str:
        return self.run.info["unit_name"]

    @property
    def fps(self) -> float:
        return float(self.run.info["fps"])

    @property
    def reference_frame(self) -> int:
        """Displacement is measured from this frame."""
        return int(self.run.info["reference_frame"])

    @property
    def has_semantics(self) -> bool:
        return self.basis is not None

    def camera(self, frame: float) -> Camera:
        """The surgeon's camera at a frame (the nearest one for fractions)."""
        return self.cameras[int(np.clip(round(frame), 0, self.frames - 1))]

    def time(self, frame: float) -> float:
        return 2.0 * frame / (self.frames - 1) - 1.0 if self.frames > 1 else 0.0

    def observed(self, frame: int) -> np.ndarray | None:
        """The recorded frame, uint8 [H, W, 3]; None without the clip."""
        return self.clip.frame(frame) if self.clip is not None else None

    def labels(self, frame: int) -> np.ndarray | None:
        """The clip's label map, uint8 [H, W]; None where there is none."""
        return self.clip.labels(frame) if self.clip is not None else None

    # -- states ----------------------------------------------------------------------------------------------------------------------------
    def splats(self, frame: float, *, semantics: bool = False) -> Splats:
        """All Gaussians at a frame (baked: evaluated once, then kept), in the clip's unit.

        `semantics` False: latents may be missing (rank 0), since most views need none.
        """
        whole = semantics or ("splats", float(frame), True) in self._states
        return self._states.get(("splats", float(frame), whole), lambda: self._evaluate(frame, whole), _bytes_of)

    def _evaluate(self, frame: float, semantics: bool) -> Splats:
        return self.live(self.time(frame), semantics=semantics).map(Tensor.clone)

    @cached_property
    def live(self) -> LiveField:
        """The scene at any time, in the clip's unit; what it returns is overwritten by its next call."""
        return LiveField(self.model, 1.0 / self.run.info["unit"])

    def carried(self, frame: float) -> Tensor:
        """Centres [N, 3] at a frame as the field alone carries them, clip units.

        Drifts are left out: an instrument that comes and goes has no place at the reference frame that it could have moved from.
        """
        return self.splats(frame).means - self.model.travel_at(self.time(frame)) / self.run.info["unit"]

    def displacement(self, frame: float) -> Tensor:
        """‖μ(t) − μ(reference)‖ of every Gaussian, drifts left out, [N], clip units."""
        return displacement(self.carried(frame), self.carried(self.reference_frame))

    @cached_property
    def persistent(self) -> Tensor:
        """Rows of the Gaussians that exist for ever, int64 [M]: tissue, not what comes and goes (instruments, blood, char)."""
        return (self.model.canonical["temporal_windows"][:, 1] == 0).nonzero()[:, 0]

    @cached_property
    def feature_axes(self) -> np.ndarray:
        """Three directions [d, 3] along which the scene's latents differ most, the same at every frame."""
        latents = self.splats(self.reference_frame, semantics=True).semantics.cpu().numpy().astype(np.float64)
        latents /= np.maximum(np.linalg.norm(latents, axis=1, keepdims=True), 1e-6)
        _, _, axes = np.linalg.svd(latents - latents.mean(0), full_matrices=False)
        axes = axes[:3].T
        return np.pad(axes, ((0, 0), (0, 3 - axes.shape[1])))

    def vectors(self, prompts: tuple[str, ...]) -> np.ndarray:
        """Unit text vectors [n, D]. DegenseError without semantics, PromptError for an unknown word."""
        if self.encoder is None:
            raise DegenseError(f"{self.name} was trained without semantics, so it cannot be prompted; {NEEDS_TEACHER}")
        if prompts not in self._vectors:
            self._vectors = {prompts: self.encoder.encode(list(prompts))}
        return self._vectors[prompts]

    def meanings(self, prompt: str) -> np.ndarray:
        """Unit vectors [m, D] of what a prompt covers: one row, or one for each class of a kind ("tool"). Raises as `vectors` does."""
        return self._read(prompt)[0]

    def exclusions(self, prompt: str) -> np.ndarray:
        """Unit vectors [k, D], k ≥ 0, of what a prompt says it does not mean ("tool, not grasper"). Raises as `vectors` does."""
        return self._read(prompt)[1]

    def _read(self, prompt: str) -> tuple[np.ndarray, np.ndarray]:
        """What a prompt means and what not; read once."""
        if prompt not in self._asked:
            self.vectors(())
            assert self.encoder is not None
            self._asked[prompt] = self.encoder.expand(prompt), self.encoder.exclude(prompt)
            while len(self._asked) > KEPT_PROMPTS:
                del self._asked[next(iter(self._asked))]
        return self._asked[prompt]

    # -- pictures --------------------------------------------------------------------------------------------------------------------------
    def render(self, frame: float, camera: Camera | None = None, what: tuple[str, ...] = ("rgb",)) -> dict[str, np.ndarray]:
        """Draw one instant, all wanted channels in one pass.

        Parameters
        ----------
        camera : Camera or None
            None is the surgeon's camera, whose pictures are kept.
        what : tuple of str
            Of `CHANNELS`: `rgb` float32 [H, W, 3] in [0, 1]; `depth` float32 [H, W], clip units, NaN where nothing is; `latent` float32
            [H, W, d]; `displacement` float32 [H, W], clip units, NaN where nothing is (what comes and goes is looked through where
            something that lasts lies behind it); `motion` float32 [H, W, 2], offset in pixels from here to the same point at the reference
            frame, NaN where nothing is; `support` float32 [H, W] in [0, 1], NaN where nothing is.

        Returns
        -------
        dict with those names and `alpha` [H, W].
        """
        if unknown := set(what) - set(CHANNELS):
            raise ValueError(f"nothing is called {sorted(unknown)}; choose from {CHANNELS}")
        if camera is not None:
            return self.draw(frame, camera, what)
        key = ("render", float(frame), what)
        return self._pictures.get(key, lambda: self.draw(frame, self.camera(frame), what), lambda d: sum(a.nbytes for a in d.values()))

    @torch.no_grad()
    def draw(self, frame: float, camera: Camera, what: tuple[str, ...]) -> dict[str, np.ndarray]:
        """`render` without the cache."""
        splats = self.splats(frame, semantics="latent" in what)
        columns: dict[str, Tensor] = {}
        for name in what:
            if name == "rgb":
                columns[name] = splats.colors
            elif name == "depth":
                columns[name] = camera_depths(splats.means, camera)[:, None]
            elif name == "latent":
                if not self.has_semantics:
                    raise DegenseError(f"{self.name} was trained without semantics, so it has no latent features to show")
                columns[name] = splats.semantics
            elif name == "displacement":
                columns[name] = self.displacement(frame)[:, None]
            elif name == "support":
                if self.support is None:
                    raise DegenseError(f"{self.name} {NO_SUPPORT}")
                columns[name] = self.support[:, None]
            else:
                columns[name] = self._screen_motion(frame, camera)
        features = torch.cat(list(columns.values()), 1)
        drawn = rasterize(splats, features, camera, clean=True)
        image, alpha = drawn.image.cpu().numpy(), drawn.alpha.cpu().numpy()
        out, first = {"alpha": alpha}, 0
        for name, column in columns.items():
            value = image[..., first : first + column.shape[1]]
            first += column.shape[1]
            if name == "rgb":
                value = np.clip(value, 0, 1)
            elif name != "latent":
                value = np.where(alpha[..., None] >= COVERED, value / np.maximum(alpha[..., None], COVERED), np.nan)
            if name == "displacement" and len(self.persistent) < len(self.model):
                # blood or char hides tissue that goes on moving, and has no place of its own at the reference frame
                tissue = _blended(splats.map(lambda part: part[self.persistent]), columns[name][self.persistent, 0], camera)[..., None]
                value = np.where(np.isfinite(tissue), tissue, value)
            out[name] = np.ascontiguousarray(value[..., 0] if name in ("depth", "displacement", "support") else value)
        return out

    def blend(self, name: str, frame: float, values: Callable[[], Tensor], camera: Camera | None = None) -> np.ndarray:
        """One number a Gaussian, [N], blended over the Gaussians of each pixel: Σ v·w / Σ w, float32 [H, W], NaN where nothing is.

        With the surgeon's camera (None) the picture is kept under `name`.
        """

        @torch.no_grad()
        def drawn(view: Camera) -> np.ndarray:
            return _blended(self.splats(frame), values(), view)

        if camera is not None:
            return drawn(camera)
        return self._pictures.get(("blend", name, float(frame)), lambda: drawn(self.camera(frame)), lambda picture: picture.nbytes)

    def _screen_motion(self, frame: float, camera: Camera) -> Tensor:
        here, there = self.carried(frame), self.carried(self.reference_frame)
        reference = self.camera(self.reference_frame) if camera is self.camera(frame) else camera
        start, _ = camera.project(here.cpu().numpy())
        end, _ = reference.project(there.cpu().numpy())
        limit = 4.0 * max(camera.width, camera.height)
        return torch.from_numpy(np.clip(end - start, -limit, limit)).float().to(here.device)

    def picture(self, frame: float, camera: Camera | None = None) -> np.ndarray:
        """RGB uint8 [H, W, 3]."""
        return (self.render(frame, camera)["rgb"] * 255 + 0.5).astype(np.uint8)

    def query(self, frame: float, camera: Camera | None = None) -> FrameSemantics:
        """The frame's masks, ready for any number of prompts; kept for the surgeon's camera."""

        if camera is not None:
            return self.new_query(frame, camera)
        width, height = self.clip_size
        rank = self.basis.rank if self.basis is not None else 0
        weight = width * height * 4 * (rank + 32)
        return self._pictures.get(("query", float(frame)), lambda: self.new_query(frame, self.camera(frame)), lambda _: weight)

    def forget_pictures(self) -> None:
        """Forget drawn pictures and queries; baked states stay."""
        self._pictures = Cache(PICTURE_BYTES)

    @torch.no_grad()
    def new_query(self, frame: float, camera: Camera) -> FrameSemantics:
        """`query` without the cache; on a GPU the picture stays there. DegenseError without semantics."""
        if self.basis is None:
            raise DegenseError(f"{self.name} was trained without semantics, so it cannot be prompted; {NEEDS_TEACHER}")
        splats = self.splats(frame, semantics=True)
        features = torch.cat([splats.colors, splats.semantics], 1)
        drawn = rasterize(splats, features, camera, clean=True)
        return query_of(drawn, self.basis)

    @cached_property
    def observed_motion(self) -> ObservedMotion:
        """What the recording shows of motion since the reference frame. DegenseError without the clip."""
        if self.clip is None:
            raise DegenseError(f"warp compares the scene with the recording, which is missing: {self.clip_missing}")
        return ObservedMotion(self.clip, self.reference_frame)


def _blended(splats: Splats, values: Tensor, camera: Camera) -> np.ndarray:
    """One number a Gaussian, [N], blended over those of each pixel: Σ v·w / Σ w, float32 [H, W], NaN where nothing is."""
    drawn = rasterize(splats, values[:, None], camera, clean=True)
    image, alpha = drawn.image[..., 0].cpu().numpy(), drawn.alpha.cpu().numpy()
    return np.where(alpha >= COVERED, image / np.maximum(alpha, COVERED), np.nan).astype(np.float32)


def _bytes_of(splats: Splats) -> int:
    return sum(tensor.nbytes for tensor in vars(splats).values())


def _find_clip(run: Run) -> tuple[Clip | None, str]:
    """The run's clip, or None and why not."""
    from degense.engine.data.readers import ClipOptions, fingerprint, open_clip

    recorded = run.info["clip"]
    path = (run.path / recorded["path"]).resolve()
    try:
        clip = open_clip(path, ClipOptions(**recorded.get("options", {})))
        if fingerprint(clip) != recorded["fingerprint"]:
            return None, f"{path} has changed since the training"
    except TypeError:
        return None, f"{run.path / 'run.json'} names options for its clip that this version does not know"
    except DegenseError as error:
        return None, str(error)
    return clip, ""
