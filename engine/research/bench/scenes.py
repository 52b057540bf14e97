"""The trained scene that benches of field and viewing measure on."""

from __future__ import annotations

import torch

from degense.engine.data.readers import open_clip
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.events import Event, TrainingProgress
from degense.engine.field import SceneModel
from degense.engine.progress import Progress
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.raster_reference import rotation_matrices
from degense.engine.scene import Scene
from degense.engine.training import TrainConfig, train

SPLIT_SHIFT, SPLIT_SCALE = 0.6, 0.8  # of a split Gaussian's longest axis: where its halves lie, and how long they are


def trained_scene(options: BenchOptions, progress: Progress) -> tuple[Scene, str]:
    """A scene trained briefly on a phantom, with semantics, and what to say about it. Made once for a scratch folder, then kept there.

    How well it is trained hardly matters to a time; that it moves, recolours and overlaps as scenes do does.
    """
    if options.quick:
        story, preset, training = PhantomOptions(frames=12, width=160, height=128), "quick", {"iterations": 60, "max_gaussians": 3_000}
    elif options.device == "cpu":
        story, preset, training = PhantomOptions(frames=24, width=640, height=512), "quick", {"iterations": 400, "max_gaussians": 20_000}
    else:
        story, preset, training = PhantomOptions(frames=48, width=640, height=512), "balanced", {"iterations": 2_000}
    clip_folder, run_folder = options.scratch / "phantom", options.scratch / "scene"
    if not clip_folder.exists():
        make_phantom(clip_folder, story, lambda fraction, message: progress(0.2 * fraction, message))
    clip = open_clip(clip_folder)
    if not (run_folder / "model.safetensors").exists():
        config = TrainConfig.preset_of(preset, device=options.device, **training)

        def tell(event: Event) -> None:
            if isinstance(event, TrainingProgress):
                progress(0.2 + 0.8 * event.iteration / event.iterations, "training a scene to measure on")

        train(clip, run_folder, config, events=tell, stop=lambda: False)
    scene = Scene.open(run_folder, device=options.device, clip=clip)
    words = (
        f"a phantom of {story.frames} frames, {story.width} × {story.height}, seed 0, trained for {training['iterations']:,} steps from "
        f"the preset {preset}, with {scene.model.config.rank} semantic channels, then brought to the number of Gaussians named "
        "(the faintest left out, or the largest split in two)"
    )
    return scene, words


def with_count(scene: Scene, count: int) -> Scene:
    """The same scene with exactly `count` Gaussians, and nothing baked yet."""
    model = scene.model
    canonical = {name: value.detach().clone() for name, value in model.canonical.items()}
    others = {name: value.clone() for name in ("semantic_coefficients", "still") if (value := getattr(model, name)) is not None}
    canonical |= others
    if len(model) > count:
        kept = canonical["logits"].topk(count).indices.sort().values
        canonical = {name: value[kept] for name, value in canonical.items()}
    while (present := len(canonical["means"])) < count:
        largest = canonical["log_scales"].sum(1).topk(min(present, count - present)).indices
        canonical = _split(canonical, largest)
    others = {name: canonical.pop(name) for name in others}
    other = SceneModel(model.config, model.bounds, canonical).to(model.bounds.device)
    values = model.state_dict() | {f"canonical.{name}": value for name, value in canonical.items()}
    other.load_state_dict({name: values[name] for name in other.state_dict()})
    if "semantic_coefficients" in others:
        other.set_semantic_coefficients(others["semantic_coefficients"])
    if "still" in others:
        other.set_still(others["still"])
    return Scene(scene.run, other.eval().requires_grad_(False), scene.basis, scene.encoder, scene.clip)


def _split(canonical: dict[str, torch.Tensor], rows: torch.Tensor) -> dict[str, torch.Tensor]:
    """Gaussians with those of `rows` cut in two across their longest axis."""
    children = {name: value[rows].clone() for name, value in canonical.items()}
    scales = children["log_scales"].exp()
    axis = scales.argmax(1)
    turn = rotation_matrices(children["quats"].double().cpu()).float().to(scales.device)
    each = torch.arange(len(rows), device=scales.device)
    shift = turn[each, :, axis] * (SPLIT_SHIFT * scales[each, axis])[:, None]
    children["log_scales"][each, axis] += torch.tensor(SPLIT_SCALE, device=scales.device).log()
    parents = {name: value.clone() for name, value in canonical.items()}
    parents["log_scales"][rows] = children["log_scales"]
    parents["means"][rows] -= shift
    children["means"] += shift
    return {name: torch.cat([parents[name], children[name]]) for name in canonical}
