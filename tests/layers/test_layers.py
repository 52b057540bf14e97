"""Every layer of the registry, drawn on a tiny real run."""

import cv2
import numpy as np
import pytest

from degense.engine.camera import Camera
from degense.engine.errors import DegenseError, PromptError
from degense.engine.layers import LAYERS, LayerImage, LayerRequest, layer_range
from degense.engine.layers.layer import MASK_COLOURS, colourise
from degense.engine.scene.uncertainty import is_guess
from degense.engine.semantics.prompts import DECODERS, PromptSet

PROMPTS = ("gallbladder", "liver")
SIDE = 5


def request(frame=SIDE, prompts=PROMPTS, camera=None, **options):
    return LayerRequest(frame, camera, PromptSet(prompts, **options))


def elsewhere(scene):
    """A camera a little to the right of the surgeon's, at half the size."""
    viewmat = np.eye(4)
    viewmat[0, 3] = -3.0
    surgeon = scene.camera(0)
    return Camera(32, 24, surgeon.fx / 2, surgeon.fy / 2, 16, 12, viewmat)


@pytest.mark.parametrize("name", LAYERS)
@pytest.mark.parametrize("frame", [0, SIDE, 8, 2.5])
def test_every_layer_draws_a_picture_and_the_splats(scene, name, frame):
    layer = LAYERS[name]
    image = layer.image(scene, request(frame))
    shape = (48, 64)
    assert image.kind == layer.kind
    assert image.unit == layer.unit(scene)
    if image.kind == "colour":
        assert image.values.shape == (*shape, 3)
        assert image.values.dtype == np.float32
        assert ((image.values >= 0) & (image.values <= 1)).all()
    elif image.kind == "scalar":
        assert image.values.shape == shape
        assert image.values.dtype == np.float32
        assert not np.isinf(image.values).any()
        assert np.isfinite(image.values).mean() > (0.9 if name != "warp" else 0.1)
    else:
        assert image.values.shape == shape
        assert image.values.dtype == np.uint8
        assert set(np.unique(image.values)) <= set(range(len(PROMPTS) + 1))
    values = layer.splats(scene, request(frame))
    count = len(scene.model)
    assert values.shape == ((count, 3) if layer.kind == "colour" else (count,))
    assert values.dtype == image.values.dtype
    assert not np.isinf(values).any()
    if name != "warp":
        assert not np.isnan(values).any()
    if name == "rgb":  # the model's own: the rasterizer clips pixels, not Gaussians
        np.testing.assert_array_equal(values, scene.splats(frame).colors.cpu().numpy())
    elif layer.kind == "colour":
        assert ((values >= 0) & (values <= 1)).all()


@pytest.mark.parametrize("name", [name for name in LAYERS if name != "warp"])
def test_every_layer_follows_the_camera(scene, name):
    camera = elsewhere(scene)
    layer, view = LAYERS[name], request(camera=elsewhere(scene))
    image = layer.image(scene, view)
    assert image.values.shape[:2] == (camera.height, camera.width)
    assert len(layer.splats(scene, view)) == len(scene.model)
    surgeon = cv2.resize(layer.image(scene, request()).values, (32, 24), interpolation=cv2.INTER_NEAREST)
    assert not np.array_equal(np.nan_to_num(image.values), np.nan_to_num(surgeon))


def test_what_is_not_covered_is_unknown(scene):
    viewmat = np.eye(4)
    viewmat[0, 3] = 40.0  # half of the view is beside the scene
    surgeon = scene.camera(0)
    aside = Camera(64, 48, surgeon.fx, surgeon.fy, 32, 24, viewmat)
    for name in ("depth", "displacement"):
        values = LAYERS[name].image(scene, request(camera=aside)).values
        uncovered = scene.render(SIDE, aside, ("alpha",))["alpha"] < 0.5
        assert uncovered.any()
        assert not uncovered.all()
        assert np.array_equal(np.isnan(values), uncovered)


def test_units_and_what_they_measure(scene, clip):
    assert {name: layer.unit(scene) for name, layer in LAYERS.items()} == {
        "rgb": "",
        "depth": "mm",
        "features": "",
        "similarity": "cosine",
        "mask": "",
        "displacement": "mm",
        "uncertainty": "mm",
        "speed": "mm/s",
        "rotation": "°",
        "scale": "log₂ volume",
        "appearance": "ΔE",
        "warp": "px",
        "observability": "",
    }
    depth = LAYERS["depth"].image(scene, request()).values
    assert np.median(np.abs(depth - clip.depth(SIDE))) < 3
    z = LAYERS["depth"].splats(scene, request())
    np.testing.assert_allclose(z, scene.splats(SIDE).means[:, 2].numpy(), rtol=1e-5)  # the camera stands at the origin
    colour = LAYERS["rgb"].image(scene, request()).values
    assert 10 * np.log10(1 / np.mean((colour - clip.frame(SIDE) / 255) ** 2)) > 20


def test_displacement_is_zero_at_the_reference_frame_and_not_later(scene):
    reference, layer = scene.reference_frame, LAYERS["displacement"]
    assert np.nanmax(np.abs(layer.image(scene, request(reference)).values)) == 0
    assert layer.splats(scene, request(reference)).max() == 0
    means = [scene.states.advected_means(frame).numpy().astype(np.float64) for frame in (SIDE, reference)]
    np.testing.assert_allclose(layer.splats(scene, request()), np.linalg.norm(means[0] - means[1], axis=1), atol=1e-4)
    assert np.nanmax(layer.image(scene, request()).values) > 0.1


def test_a_displacement_that_nothing_reveals_is_marked_as_a_guess(scene):
    """Nothing but the uncertainty decides, pixel by pixel and Gaussian by Gaussian; the value itself stays."""
    layer, observability = LAYERS["displacement"], LAYERS["observability"]
    image, bound = layer.image(scene, request()), LAYERS["uncertainty"].image(scene, request()).values
    depth = scene.states.depth
    assert np.array_equal(image.uncertain, is_guess(bound, image.values, depth))
    assert 0 < image.uncertain.mean() < 1
    assert np.isfinite(image.values[image.uncertain]).all()
    assert np.array_equal(
        layer.uncertain_splats(scene, request()),
        is_guess(LAYERS["uncertainty"].splats(scene, request()), layer.splats(scene, request()), depth),
    )
    np.testing.assert_array_equal(observability.splats(scene, request()), scene.observability.numpy())
    assert layer_range(scene, observability, request(), "frame") == (0.0, 1.0)


def test_displacement_and_where_it_is_a_guess_take_one_drawing(scene, monkeypatch):
    drawn = []
    draw = scene.renderer.draw
    monkeypatch.setattr(scene.renderer, "draw", lambda frame, camera, what: drawn.append(what) or draw(frame, camera, what))
    scene.renderer.forget()
    image = LAYERS["displacement"].image(scene, request(7))
    assert drawn == [("displacement", "uncertainty")]
    assert np.array_equal(image.values, scene.render(7, None, ("displacement",))["displacement"], equal_nan=True)
    bound = scene.render(7, None, ("uncertainty",))["uncertainty"]
    assert np.array_equal(image.uncertain, is_guess(bound, image.values, scene.states.depth))


def test_at_the_reference_frame_nothing_is_a_guess(scene):
    start = request(scene.reference_frame)
    assert LAYERS["displacement"].image(scene, start).uncertain is None
    assert LAYERS["displacement"].uncertain_splats(scene, start) is None


def test_runs_without_observability_still_open_and_mark_nothing(unobserved):
    assert unobserved.observability is None
    assert LAYERS["displacement"].image(unobserved, request()).uncertain is None
    for draw in [draw for name in ("observability", "uncertainty") for draw in (LAYERS[name].image, LAYERS[name].splats)]:
        with pytest.raises(DegenseError, match="older version"):
            draw(unobserved, request())


def test_zero_that_is_known_and_zero_that_is_a_guess_look_different():
    still, uncertain = np.zeros((48, 64), np.float32), np.zeros((48, 64), bool)
    uncertain[:, 32:] = True
    for cmap in ("viridis", "magma", "cividis"):
        picture = colourise(LayerImage(still, "mm", "scalar", uncertain), 0.0, 1.0, cmap)
        assert (picture[:, :32] == picture[0, 0]).all()
        grey = picture[:, 32:].astype(float) @ [0.299, 0.587, 0.114]
        assert np.ptp(grey) > 100  # a hatch that one can see without colours
        marked = np.abs(grey - grey.min()) > 50
        assert 0.1 < marked.mean() < 0.5


def test_similarity_is_the_best_of_the_prompts(scene):
    layer = LAYERS["similarity"]
    both = layer.image(scene, request()).values
    each = [layer.image(scene, request(prompts=(prompt,))).values for prompt in PROMPTS]
    np.testing.assert_allclose(both, np.maximum(*each), atol=1e-6)
    assert ((both >= -1.001) & (both <= 1.001)).all()
    splats = layer.splats(scene, request())
    latents = scene.splats(SIDE).semantics.numpy().astype(np.float64)
    lifted = latents @ scene.basis.matrix.T.astype(np.float64)
    lifted /= np.maximum(np.linalg.norm(lifted, axis=1, keepdims=True), 1e-6)
    expected = (lifted @ scene.encoder.encode(list(PROMPTS)).T).max(1)
    np.testing.assert_allclose(splats, expected, atol=1e-3)


def test_similarity_is_higher_where_the_label_is(scene, clip):
    labels = clip.labels(SIDE)
    values = LAYERS["similarity"].image(scene, request(prompts=("gallbladder",))).values
    wanted = labels == clip.classes.index("gallbladder")
    assert values[wanted].mean() > values[~wanted].mean() + 0.2


@pytest.mark.parametrize("decoder", DECODERS)
def test_masks_name_their_prompt(scene, clip, decoder):
    labels = clip.labels(SIDE)
    image = LAYERS["mask"].image(scene, request(decoder=decoder)).values
    swapped = LAYERS["mask"].image(scene, request(prompts=PROMPTS[::-1], decoder=decoder)).values
    for position, prompt in enumerate(PROMPTS):
        wanted, found = labels == clip.classes.index(prompt), image == position + 1
        assert (wanted & found).sum() / (wanted | found).sum() > 0.5
        assert (found & (swapped == 2 - position)).sum() > 0.8 * found.sum()


def test_a_kind_of_thing_is_a_prompt_too(scene):
    """ "Tool" covers grasper and hook; its similarity is that of the better one."""
    values = LAYERS["similarity"].image(scene, request(prompts=("tool",))).values
    vectors = scene.included("tool")
    assert len(vectors) > 1
    np.testing.assert_allclose(values, scene.query(SIDE).similarity(vectors), atol=1e-6)


def test_the_threshold_decides_about_splats(scene):
    layer = LAYERS["mask"]
    counts = [np.count_nonzero(layer.splats(scene, request(threshold=threshold))) for threshold in (-1.1, 0.5, 0.9, 1.1)]
    assert counts[0] == len(scene.model)
    assert counts == sorted(counts, reverse=True)
    assert counts[-1] == 0


def test_what_is_missing_is_said_in_one_sentence(scene, speechless, lonely, unobserved):
    for name, layer in LAYERS.items():
        reasons = {
            "semantics": layer.missing(speechless, PROMPTS),
            "clip": layer.missing(lonely, PROMPTS),
            "prompt": layer.missing(scene, ()),
        }
        assert bool(reasons["semantics"]) == (name in ("features", "similarity", "mask"))
        assert bool(reasons["clip"]) == (name == "warp")
        assert bool(reasons["prompt"]) == (name in ("similarity", "mask"))
        assert bool(layer.missing(unobserved, PROMPTS)) == (name in ("observability", "uncertainty"))
        assert layer.missing(scene, PROMPTS) == ""
        for cause, (shown, prompts) in {"semantics": (speechless, PROMPTS), "clip": (lonely, PROMPTS), "prompt": (scene, ())}.items():
            for draw in (layer.image, layer.splats):
                if reasons[cause]:
                    with pytest.raises(DegenseError) as caught:
                        draw(shown, request(prompts=prompts))
                    message = str(caught.value)
                    assert message
                    assert "\n" not in message
                else:
                    draw(shown, request(prompts=prompts))


def test_unknown_words_and_foreign_cameras_are_refused(scene):
    with pytest.raises(PromptError, match="spleeenqq"):
        LAYERS["mask"].image(scene, request(prompts=("spleeenqq",)))
    with pytest.raises(DegenseError, match="recording's own view"):
        LAYERS["warp"].image(scene, request(camera=elsewhere(scene)))


def test_the_range_of_a_frame_and_of_the_sequence(scene):
    layer, here = LAYERS["displacement"], request(SIDE)
    frame, sequence = layer_range(scene, layer, here, "frame"), layer_range(scene, layer, here, "sequence")
    values = layer.image(scene, here).values
    assert frame == (0.0, pytest.approx(np.nanpercentile(values, 99)))
    everything = np.concatenate([layer.image(scene, request(i)).values.ravel() for i in range(9)])
    assert sequence == (0.0, pytest.approx(np.nanpercentile(everything, 99)))
    assert frame != sequence
    assert layer_range(scene, layer, request(0), "sequence") == sequence
    assert layer_range(scene, layer, request(0), "frame") != sequence
    depth = LAYERS["depth"]
    assert layer_range(scene, depth, here, "frame") == pytest.approx(np.nanpercentile(depth.image(scene, here).values, [1, 99]))
    assert layer_range(scene, LAYERS["similarity"], here, "frame") == (0.0, 1.0)


def test_a_range_is_never_empty(scene):
    low, high = layer_range(scene, LAYERS["displacement"], request(scene.reference_frame), "frame")
    assert low == 0 < high
    behind = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, -1e4], [0, 0, 0, 1]])
    nowhere = Camera(32, 24, 30.0, 30.0, 16, 12, behind)
    assert np.isnan(LAYERS["depth"].image(scene, request(camera=nowhere)).values).all()
    assert layer_range(scene, LAYERS["depth"], request(camera=nowhere), "frame") == (0.0, 1.0)


def test_pictures_become_colours(scene):
    for layer in LAYERS.values():
        picture = colourise(layer.image(scene, request()), 0.0, 1.0, layer.cmap)
        assert (picture.shape, picture.dtype) == ((48, 64, 3), np.uint8)
    mask = colourise(LayerImage(np.array([[0, 1, 2, 8]], np.uint8), "", "mask"), 0, 1)
    assert np.array_equal(mask[0], [(0, 0, 0), MASK_COLOURS[0], MASK_COLOURS[1], MASK_COLOURS[0]])
    assert colourise(LayerImage(np.array([[[0, 0.5, 1]]], np.float32), "", "colour"), 0, 1).tolist() == [[[0, 128, 255]]]
