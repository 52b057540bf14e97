"""One rule for a prompt: whoever asks, the same pixels belong to it."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from degense.app.cli.main import main
from degense.app.cli.terminal import Bar, run_steps
from degense.app.features.export.formats import ExportOptions, get_format
from degense.app.features.prompts.mask_statistics import areas
from degense.app.features.viewer.view_rendering import ViewRequest, draw_view
from degense.app.session.view_state import PROMPT_COLOURS, Prompt, ViewState
from degense.engine.clip import UNLABELLED
from degense.engine.layers import LAYERS, LayerRequest
from degense.engine.metrics.evaluate import score_masks
from degense.engine.metrics.masks import MaskScores
from degense.engine.scene.clip_query import decode_frame, decode_splats, query_clip
from degense.engine.semantics.masks import FrameSemantics
from degense.engine.semantics.masks.cleaning import without_holes, without_specks
from degense.engine.semantics.prompts import DECODERS, PromptSet, kind_of

FRAME, THRESHOLD = 4, 0.35
TEXTS = {
    "overlapping": ("liver", "tissue", "gallbladder"),
    "nested": ("tool", "grasper", "L-hook electrocautery"),
    "negated": ("tool", "grasper", "tool, not grasper", "liver, not gallbladder"),
}
NEGATIVES = ((), ("grasper", "fat"))


@pytest.fixture(params=[(texts, decoder) for texts in TEXTS for decoder in DECODERS], ids=lambda param: f"{param[0]} {param[1]}")
def asked(request):
    texts, decoder = request.param
    return PromptSet(TEXTS[texts], (), decoder, THRESHOLD)


def by_hand(scene, prompts: PromptSet, frame: float, similarity) -> tuple[np.ndarray, np.ndarray]:
    """Masks [n, ...] and labels [...] as the rule is written down; `similarity` gives the map of one vector [D]."""

    def best(rows):
        return np.max([similarity(row) for row in rows], 0) if len(rows) else None

    classes = scene.vectors(scene.classes)
    masks, own = [], []
    for text in prompts.prompts:
        covered = scene.included(text)
        s = best(covered)
        r = best([row for row in classes if (covered @ row).max() < 0.6])
        x = best(np.concatenate([scene.excluded(text), *map(scene.included, prompts.negatives)]))
        mask = s > prompts.threshold * (0.5 if "argmax" in prompts.decoder else 1.0)
        if "argmax" in prompts.decoder:
            mask &= s >= r
        elif prompts.decoder == "rnse":
            mask &= s > np.float32(prompts.threshold / 0.5) * r
        if x is not None:
            mask &= s > x
        if kind_of(prompts.decoder) == "refined" and similarity == scene.query(frame).refined and mask.any():
            others = [values for values in (r, x) if values is not None]
            mask = without_holes(without_specks(mask, scene.query(frame).curve.least), s, prompts.threshold, np.max(others, 0))
        masks.append(mask)
        own.append(s)
    owner = np.full(masks[0].shape, UNLABELLED, np.uint8)
    for place in np.ndindex(owner.shape):
        holding = [k for k, mask in enumerate(masks) if mask[place]]
        if holding:
            owner[place] = min(holding, key=lambda k: (-own[k][place], len(scene.included(prompts.prompts[k])), k))
    return np.stack(masks), owner


@pytest.mark.parametrize("negatives", NEGATIVES)
def test_the_rule_is_the_one_that_is_written_down(scene, asked, negatives):
    prompts = PromptSet(asked.prompts, negatives, asked.decoder, THRESHOLD)
    query = scene.query(FRAME)
    found = decode_frame(scene, prompts, FRAME)
    kinds = {"pixel": query.similarity, "refined": query.refined, "mean": lambda vector: query.read(vector, "mean")}
    masks, labels = by_hand(scene, prompts, FRAME, kinds[kind_of(prompts.decoder)])
    np.testing.assert_array_equal(found.masks, masks)
    np.testing.assert_array_equal(found.labels, labels)


@pytest.mark.parametrize("negatives", NEGATIVES)
def test_the_window_shows_it(scene, asked, negatives):
    """Mask layer, overlay and areas under the timeline; negatives too, which only the window knows."""
    shown = [Prompt(text, PROMPT_COLOURS[k]) for k, text in enumerate(asked.prompts)]
    hidden = [Prompt(text, (1, 2, 3), negative=True) for text in negatives]
    state = ViewState(prompts=(*shown, *hidden, Prompt("spleen", (4, 5, 6), visible=False)), decoder=asked.decoder, threshold=THRESHOLD)
    found = decode_frame(scene, state.prompt_set, FRAME)
    layer = LAYERS["mask"].image(scene, LayerRequest(FRAME, prompt_set=state.prompt_set)).values
    np.testing.assert_array_equal(layer, found.numbers)
    np.testing.assert_array_equal(layer == 0, found.labels == UNLABELLED)
    *_, view = drawn(draw_view(scene, ViewRequest(FRAME, state, splats=False)))
    np.testing.assert_array_equal(view.masks[..., 3] > 0, found.masks.any(0))
    for index, prompt in enumerate(shown):
        owned = found.labels == index
        assert (view.masks[owned][:, :3] == prompt.colour).all()
    [(frame, shares)] = areas(scene, state, [FRAME])
    assert (frame, tuple(shares)) == (FRAME, asked.prompts)
    assert list(shares.values()) == found.areas.tolist()


@pytest.mark.parametrize("negatives", NEGATIVES)
def test_gaussians_are_decoded_as_pixels_are(scene, asked, negatives):
    """A picture whose pixels have the Gaussians' latents has their masks; there are no regions among Gaussians."""
    prompts = PromptSet(asked.prompts, negatives, asked.decoder, THRESHOLD)
    latents = scene.splats(FRAME, semantics=True).semantics.numpy()[None]
    picture = FrameSemantics(np.zeros((1, latents.shape[1], 3), np.uint8), latents, scene.basis)
    masks, labels = by_hand(scene, prompts, FRAME, lambda row: picture.similarity(row)[0])
    found = decode_splats(scene, prompts, FRAME)
    np.testing.assert_array_equal(found.masks, masks)
    np.testing.assert_array_equal(found.labels, labels)
    np.testing.assert_array_equal(LAYERS["mask"].splats(scene, LayerRequest(FRAME, prompt_set=prompts)), found.numbers)


def test_while_time_runs_pixels_are_decoded_as_gaussians_are(scene, asked):
    pixelwise = decode_frame(scene, asked, FRAME, pixelwise=True)
    masks, labels = by_hand(scene, asked, FRAME, scene.query(FRAME).similarity)
    np.testing.assert_array_equal(pixelwise.masks, masks)
    np.testing.assert_array_equal(pixelwise.labels, labels)


def test_both_commands_the_whole_clip_and_the_export_write_it(scene, asked, tmp_path):
    found = decode_frame(scene, asked, FRAME)
    base = ["segment", str(scene.run.path), "--decoder", asked.decoder, "--threshold", str(THRESHOLD)]
    base += [word for text in asked.prompts for word in ("--prompt", text)]
    one, some = ["--frame", str(FRAME)], ["--frames", f"{FRAME}:{FRAME + 1}"]
    for out, frames in (("m.npy", one), ("m.png", one), ("clip", some)):
        assert main([*base, *frames, "--out", str(tmp_path / out)]) == 0
    np.testing.assert_array_equal(np.load(tmp_path / "m.npy"), found.masks)
    np.testing.assert_array_equal(grey(tmp_path / "m.png"), found.numbers)
    name = f"{FRAME:06d}.png"
    np.testing.assert_array_equal(grey(tmp_path / "clip/labels" / name), found.labels)
    for folder, mask in zip(sorted((tmp_path / "clip/masks").iterdir()), found.masks, strict=True):
        np.testing.assert_array_equal(grey(folder / name), mask * np.uint8(255))
    [(frame, in_clip)] = query_clip(scene, asked, [FRAME])
    assert frame == FRAME
    np.testing.assert_array_equal(in_clip.masks, found.masks)
    np.testing.assert_array_equal(in_clip.labels, found.labels)
    run_steps(get_format("masks-png").export(scene, tmp_path / "export", ExportOptions(asked, source="masks")), Bar())
    np.testing.assert_array_equal(grey(tmp_path / "export/labels" / name), found.labels)


def test_scores_are_of_these_masks(scene, clip):
    scores = score_masks(scene, clip, [1], lambda fraction, message: None)["masks"]
    for decoder in DECODERS:
        expected = MaskScores(clip.classes, ("background", "black background"))
        expected.add_masks(decode_frame(scene, PromptSet(tuple(clip.classes), decoder=decoder), 1).masks, clip.labels(1), clip.valid(1))
        assert scores[decoder] == expected.result()
    assert scores["rnse"]["iou"] != scores["rnse+argmax"]["iou"]


def test_prompts_take_nothing_from_each_other_and_the_order_decides_nothing_else(scene, asked):
    together = decode_frame(scene, asked, FRAME)
    for text, mask in zip(asked.prompts, together.masks, strict=True):
        alone = PromptSet((text,), (), asked.decoder, THRESHOLD)
        np.testing.assert_array_equal(decode_frame(scene, alone, FRAME).masks[0], mask)
    turned = decode_frame(scene, PromptSet(asked.prompts[::-1], (), asked.decoder, THRESHOLD), FRAME)
    np.testing.assert_array_equal(turned.masks[::-1], together.masks)
    same = np.where(turned.labels == UNLABELLED, UNLABELLED, len(asked.prompts) - 1 - turned.labels.astype(int))
    if asked.prompts == TEXTS["nested"]:
        np.testing.assert_array_equal(same, together.labels)


def drawn(steps):
    """All views of `draw_view`, the finished one last."""
    while True:
        try:
            yield next(steps)
        except StopIteration as done:
            yield done.value
            return


def grey(path):
    return np.array(Image.open(path))
