"""`FrameSemantics`: decoders, caches, prompts that cover several classes, and pictures of any kind."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import torch

from degense.engine.clip import UNLABELLED
from degense.engine.semantics import EmbeddedEncoder, fit_basis
from degense.engine.semantics.masks import FrameSemantics
from degense.engine.semantics.prompts import DECODERS, PromptVectors
from tests.semantics.masks.scenes import labels_of, latents, mask_of, overlap, scene

CLASSES = ("liver", "fat", "gallbladder", "grasper", "L-hook electrocautery")


@pytest.fixture(scope="module")
def asked():
    """A query, its class vectors, its encoder and the truth."""
    rgb, labels = scene(256, 200, seed=5)
    labels = labels.copy()
    labels[(labels == 3) & (np.arange(256) > 140)] = 4
    encoder = EmbeddedEncoder(CLASSES)
    vectors = encoder.encode(CLASSES)
    basis = fit_basis(vectors, np.ones(len(vectors)))
    return FrameSemantics(rgb, latents(labels, basis.project(vectors), 0.5, 0.05, 0.002), basis), vectors, encoder, labels


def test_similarity_is_the_cosine_in_the_long_space(asked):
    query, vectors, encoder, _ = asked
    lifted = query._aggregation.unit @ query.basis.matrix.T
    expected = lifted @ encoder.encode(["organ"])[0]
    np.testing.assert_allclose(query.similarity(3.0 * encoder.encode(["organ"])[0]), expected, atol=1e-5)
    np.testing.assert_allclose(query.similarity(vectors), (lifted @ vectors.T).max(-1), atol=1e-5)


@pytest.mark.parametrize("decoder", DECODERS)
def test_masks_find_their_classes(asked, decoder):
    query, vectors, _, labels = asked
    scores = [overlap(mask_of(query, vectors[c], decoder, classes=vectors), labels == c) for c in range(5)]
    assert np.mean(scores) > 0.93
    owners = labels_of(query, vectors, decoder)
    assert owners.dtype == np.uint8
    assert np.mean(owners == labels) > 0.97


@pytest.mark.parametrize("decoder", DECODERS)
def test_a_kind_covers_its_members_and_they_do_not_compete(asked, decoder):
    query, vectors, encoder, labels = asked
    for prompt in (encoder.encode(["all tools"])[0], encoder.expand("all tools")):
        assert overlap(mask_of(query, prompt, decoder, 0.5, classes=vectors), labels >= 3) > 0.9


def test_plain_decoders_match_loops(asked):
    query, vectors, _, _ = asked
    cosines = (query._aggregation.unit @ query.basis.matrix.T) @ vectors.T
    mask, best = mask_of(query, vectors[1], "threshold", 0.42), mask_of(query, vectors[1], "argmax", 0.5, vectors)
    labels = labels_of(query, vectors, "argmax")
    for y, x in np.random.default_rng(0).integers(0, (200, 256), (400, 2)):
        own, others = cosines[y, x, 1], np.delete(cosines[y, x], 1)
        assert mask[y, x] == (own > 0.42)
        assert best[y, x] == (own > 0.25 and own >= others.max())
        assert labels[y, x] == cosines[y, x].argmax()


def test_absent_words_give_empty_masks(asked):
    query, vectors, encoder, _ = asked
    for decoder in DECODERS:
        mask = mask_of(query, encoder.encode(["smoke"])[0], decoder, 0.5, vectors)
        assert not mask.any()
        assert query.confidence(encoder.encode(["smoke"])[0], mask, vectors) == 0.0


def test_a_higher_threshold_never_adds_pixels(asked):
    query, vectors, _, _ = asked
    areas = [mask_of(query, vectors[0], "threshold", t).sum() for t in np.linspace(-1, 1, 9)]
    assert areas == sorted(areas, reverse=True)


def test_where_two_classes_mix_the_shares_decide_and_the_threshold_moves_the_border():
    basis = fit_basis(np.eye(2), np.ones(2))
    share = np.broadcast_to(np.linspace(0, 1, 201, dtype=np.float32), (40, 201))
    latent = np.stack([share, 1 - share], -1) @ basis.matrix
    query, vectors = FrameSemantics(np.full((40, 201, 3), 90, np.uint8), latent.astype(np.float32), basis), np.eye(2, dtype=np.float32)
    for decoder in ("rnse", "rnse+argmax"):
        first, second = (mask_of(query, vector, decoder, 0.5, vectors) for vector in vectors)
        assert abs(first[20].sum() - 100) <= 2
        assert (first & second).sum() <= 40
    borders = [mask_of(query, vectors[0], "rnse", threshold, vectors)[20].argmax() / 200 for threshold in (0.3, 0.4, 0.6, 0.8)]
    np.testing.assert_allclose(borders, [0.375, 0.444, 0.545, 0.615], atol=0.02)  # where the shares are as threshold to 0.5
    assert mask_of(query, vectors[0], "rnse", 0.5)[20].argmax() / 200 == pytest.approx(0.366, abs=0.02)  # no class is known to compete


def test_confidence_falls_with_rivals_and_doubt(asked):
    query, vectors, _, labels = asked
    sure = query.confidence(vectors[0], labels == 0, vectors)
    assert 0.8 < sure <= 1.0
    assert query.confidence(vectors[0], labels >= 0, vectors) < 0.7 * sure
    assert query.confidence(vectors[3], labels == 3, vectors) < query.confidence(vectors[3], labels == 3)


def test_maps_are_kept_and_shared_but_not_writable(asked):
    query, vectors, _, _ = asked
    assert query.refined(vectors[2]) is query.refined(vectors[2].copy())
    with pytest.raises(ValueError, match="read-only"):
        query.refined(vectors[2])[0, 0] = 1


@pytest.mark.parametrize("device", ["memory", "tensors"])
def test_asked_alone_or_together_is_the_same_to_the_last_bit(asked, device):
    _, vectors, encoder, _ = asked
    rgb, latent = asked[0]._aggregation._rgb, asked[0]._aggregation.unit

    def new() -> FrameSemantics:
        return FrameSemantics(*((rgb, latent) if device == "memory" else map(torch.from_numpy, (rgb, latent))), asked[0].basis)

    texts = ("liver", "tool, not grasper", "fat", "tissue")
    included, excluded = tuple(map(encoder.expand, texts)), tuple(map(encoder.exclude, texts))
    for decoder in DECODERS:
        together = new()
        masks = together.decode(PromptVectors(included, excluded, vectors, decoder, 0.45)).masks
        for own, others, mask in zip(included, excluded, masks, strict=True):
            alone = new()
            np.testing.assert_array_equal(mask_of(alone, own, decoder, 0.45, vectors, others), mask)
            np.testing.assert_array_equal(alone.refined(own), together.refined(own))
            np.testing.assert_array_equal(alone.similarity(own), together.similarity(own))


@pytest.mark.parametrize("device", ["memory", "tensors"])
def test_frames_asked_in_several_threads_at_once_are_the_same(asked, device):
    _, vectors, _, _ = asked
    rgb, latent = asked[0]._aggregation._rgb, asked[0]._aggregation.unit

    def masks(_: int) -> np.ndarray:
        query = FrameSemantics(*((rgb, latent) if device == "memory" else map(torch.from_numpy, (rgb, latent))), asked[0].basis)
        return query.decode(PromptVectors(tuple(vectors), (), vectors)).masks

    with ThreadPoolExecutor(4) as pool:
        for found in pool.map(masks, range(8)):
            np.testing.assert_array_equal(found, masks(0))


@pytest.mark.parametrize("decoder", DECODERS)
def test_latents_without_a_picture_are_decoded_pixel_by_pixel(asked, decoder):
    """As those of Gaussians are, in memory and as tensors."""
    query, vectors, _, _ = asked
    latents = query._aggregation.unit.reshape(1, -1, query.basis.rank)
    prompts = PromptVectors(tuple(vectors), (), vectors, decoder, 0.4)
    expected = query.decode(prompts, pixelwise=True)
    for values in (latents, torch.from_numpy(latents)):
        splats = FrameSemantics(None, values, query.basis)
        found = splats.decode(prompts)
        assert np.mean(found.masks.reshape(expected.masks.shape) == expected.masks) > 0.9999
        assert np.mean(found.labels.reshape(expected.labels.shape) == expected.labels) > 0.9999
        with pytest.raises(ValueError, match="without a picture"):
            splats.refined(vectors[0])


@pytest.mark.parametrize("decoder", DECODERS)
def test_what_is_excluded_leaves_the_mask_whatever_the_decoder(asked, decoder):
    query, vectors, encoder, labels = asked
    mask = mask_of(query, encoder.expand("tool, not grasper"), decoder, 0.3, vectors, encoder.exclude("tool, not grasper"))
    assert overlap(mask, labels == 4) > (0.85 if decoder == "rnse-paper" else 0.9)  # plain means fray what is thin
    assert not mask_of(query, vectors[3], decoder, 0.3, vectors, vectors[3:4]).any()  # nothing is more alike than itself


def test_alpha_weighs_the_similarity(asked):
    query, vectors, _, _ = asked
    alpha = np.full((200, 256), 0.25, np.float32)
    thin = FrameSemantics(query._aggregation._rgb, query._aggregation.unit, query.basis, alpha)
    np.testing.assert_allclose(thin.similarity(vectors[0]), 0.25 * query.similarity(vectors[0]), atol=1e-5)
    assert not mask_of(thin, vectors[0]).any()


@pytest.mark.parametrize("decoder", DECODERS)
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (3, 2), (17, 23)])
@pytest.mark.parametrize("kind", ["random", "constant", "zero", "nan"])
def test_no_picture_is_too_odd(decoder, shape, kind):
    rng = np.random.default_rng(1)
    rgb = np.full((*shape, 3), 9, np.uint8) if kind == "constant" else rng.integers(0, 256, (*shape, 3)).astype(np.uint8)
    latent = {
        "random": rng.normal(size=(*shape, 1)),
        "constant": np.ones((*shape, 1)),
        "zero": np.zeros((*shape, 1)),
        "nan": np.full((*shape, 1), np.nan),
    }[kind].astype(np.float32)
    basis = fit_basis(np.eye(4)[:1], np.ones(1))
    query = FrameSemantics(rgb, latent, basis, np.ones(shape, np.float32))
    vectors = np.eye(4, dtype=np.float32)[:2]
    assert np.isfinite(query.similarity(vectors[0])).all()
    assert np.isfinite(query.refined(vectors[0])).all()
    assert query._aggregation.regions.shape == shape
    mask, labels = mask_of(query, vectors[0], decoder, 0.5, vectors), labels_of(query, vectors, decoder)
    assert mask.shape == labels.shape == shape
    assert np.isfinite(query.confidence(vectors[0], mask, vectors))
    if kind in ("zero", "nan"):
        assert not mask.any()
        assert (labels == UNLABELLED).all()
    if kind == "constant":
        assert mask.all()
        assert (labels == 0).all()


def test_wrong_shapes_are_refused(asked):
    query, *_ = asked
    rgb, unit, basis = query._aggregation._rgb, query._aggregation.unit, query.basis
    with pytest.raises(ValueError, match="latent must be"):
        FrameSemantics(rgb, unit[..., :2], basis)
    with pytest.raises(ValueError, match="rgb must be"):
        FrameSemantics(rgb.astype(np.float32), unit, basis)
    with pytest.raises(ValueError, match="alpha must be"):
        FrameSemantics(rgb, unit, basis, np.ones((2, 2), np.float32))
    with pytest.raises(ValueError, match="vectors of length 128"):
        query.similarity(np.ones(5))
