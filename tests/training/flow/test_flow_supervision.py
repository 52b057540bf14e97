"""Flow supervision on a wall whose motion is known exactly."""

import numpy as np
import pytest
import torch

from degense.engine.camera import Camera
from degense.engine.motion import consistent
from degense.engine.raster.camera_tensors import project, unproject, view_and_lens
from degense.engine.training.flow.motion_error import look_up, motion_error, surface_visibility
from degense.engine.training.flow.supervision import FlowSupervision, Pair
from degense.engine.training.frames import TrainingFrames
from tests.fakes import MovingWall

CPU = torch.device("cpu")


def error_of(flow, here, there, visible, frame, pair):
    return motion_error(here, there, visible, *flow.inputs(frame, pair))


def seen_by(camera):
    return view_and_lens(camera, CPU)


SLIDING, COMING = (0.06, 0.03, 0.0), (0.04, -0.02, -0.05)


def exact_pair(clip, here, there):
    """The truth, in the form of measured flow."""
    width, height = clip.size
    relative = clip.flow(here, there) / [width, height]
    ones = torch.ones(1, height, width).half()
    return Pair(there, torch.from_numpy(relative).permute(2, 0, 1).half(), ones, ones)


def points_on(clip, flow, here, there, seed, count=300):
    """Random points of the wall at two frames, float [N, 3] in the trainer's unit, away from the edge of both pictures."""
    random = np.random.default_rng(seed)
    inside = random.uniform(-0.8, 0.8, (count, 2))
    at_start = np.c_[inside, np.full(count, 3.0)]
    return [torch.from_numpy((at_start + i * clip.velocity) * flow.frames.unit).float() for i in (here, there)]


def prepared(velocity, measured=True, **options):
    clip = MovingWall(velocity=velocity, measured=measured, **options)
    return clip, FlowSupervision(TrainingFrames(clip, 1 << 20, CPU))


@pytest.mark.parametrize(("velocity", "measured", "seed"), [(SLIDING, True, 1), (SLIDING, False, 2), (COMING, True, 3)])
def test_the_true_motion_costs_nothing_and_every_other_costs_its_distance(velocity, measured, seed):
    clip, flow = prepared(velocity, measured)
    here, there = points_on(clip, flow, 0, 4, seed)
    pair, visible = exact_pair(clip, 0, 4), torch.ones(len(here))
    assert error_of(flow, here, there, visible, 0, pair) < 2e-4
    still = error_of(flow, here, here, visible, 0, pair)
    way = 4 * np.linalg.norm(velocity) * flow.frames.unit
    assert float(still) == pytest.approx(way, rel=0.05)
    half = error_of(flow, here, (here + there) / 2, visible, 0, pair)
    assert float(half) == pytest.approx(way / 2, rel=0.1)


@pytest.mark.parametrize("measured", [True, False])
def test_the_gradient_pulls_every_point_the_right_way_and_only_visible_ones(measured):
    clip, flow = prepared(SLIDING, measured)
    here, _ = points_on(clip, flow, 0, 4, 3)
    visible = (torch.arange(len(here)) % 3 > 0).float()
    there = here.clone().requires_grad_()
    error_of(flow, here, there, visible, 0, exact_pair(clip, 0, 4)).backward()
    wanted = torch.tensor(SLIDING) / np.linalg.norm(SLIDING)
    pull = -there.grad
    assert (pull[visible == 0] == 0).all()
    direction = torch.nn.functional.normalize(pull[visible > 0], dim=1)
    assert (direction @ wanted > 0.9).all()
    if measured:
        assert (direction @ wanted > 0.99).all()
    else:  # flow alone says nothing along the line of sight
        ray = torch.nn.functional.normalize(here[visible > 0], dim=1)
        assert ((direction * ray).sum(1).abs() < 0.02).all()


def test_points_without_flow_count_for_nothing():
    clip, flow = prepared(SLIDING)
    here, _ = points_on(clip, flow, 0, 4, 4)
    pair, visible = exact_pair(clip, 0, 4), torch.ones(len(here))
    pair.weight[..., : clip.size[0] // 2] = 0
    there = here.clone().requires_grad_()
    error_of(flow, here, there, visible, 0, pair).backward()
    column = project(here, seen_by(clip.cameras[0]))[0][:, 0] * clip.size[0]
    touched = there.grad.abs().sum(1) > 0
    assert not touched[column < clip.size[0] / 2].any()
    assert touched[column > clip.size[0] / 2 + 1].all()
    pair.weight[:] = 0
    assert error_of(flow, here, there, visible, 0, pair) == 0


def test_no_flow_is_lost_to_rounding():
    """Bilinear weights add up to a little less than 1 for one point in seventy."""
    clip, flow = prepared(SLIDING)
    here, _ = points_on(clip, flow, 0, 4, 5, count=4000)
    there = here.clone().requires_grad_()
    error_of(flow, here, there, torch.ones(len(here)), 0, exact_pair(clip, 0, 4)).backward()
    assert (there.grad.abs().sum(1) > 0).all()


def test_a_jump_in_depth_is_no_motion():
    class Torn(MovingWall):
        def depth(self, index):
            depth = super().depth(index)
            if index == 4:
                depth[:, 48:] *= 1.3
            return depth

    clip = Torn(velocity=(0.0, 0.0, 0.0))
    flow = FlowSupervision(TrainingFrames(clip, 1 << 20, CPU))
    here, _ = points_on(clip, flow, 0, 4, 6)
    column = project(here, seen_by(clip.cameras[0]))[0][:, 0] * clip.size[0]
    whole = ((column - 48).abs() > 1).float()  # pixels at the rim of the tear see a mixture
    assert error_of(flow, here, here, whole, 0, exact_pair(clip, 0, 4)) < 1e-6


def test_without_depth_motion_along_the_line_of_sight_is_held_back():
    clip, flow = prepared((0.0, 0.0, 0.0), measured=False)
    here, _ = points_on(clip, flow, 0, 4, 6)
    here[:, :2] *= 0.02  # near the axis, where moving along it shifts no pixel
    nearer = here - torch.tensor([0.0, 0.0, 0.1])
    costs = [error_of(flow, here, there, torch.ones(len(here)), 0, exact_pair(clip, 0, 4)) for there in (here, nearer)]
    assert costs[0] < 1e-6 < 0.005 < costs[1] < 0.1


@pytest.mark.parametrize("seed", [7, 8])
def test_measured_flow_is_the_true_flow(seed):
    clip, flow = prepared(SLIDING, seed=seed)
    width, height = clip.size
    train = clip.train_frames
    assert set(flow.pairs) == set(train)
    for here, pairs in flow.pairs.items():
        partners = {pair.to for pair in pairs}
        position = train.index(here)
        assert partners == ({train[0]} if here != train[0] else set(train[1:])) | {
            train[k] for k in (position - 1, position + 1) if 0 <= k < len(train)
        }
        for pair in pairs:
            found = pair.flow.float().numpy() * np.array([width, height])[:, None, None]
            error = np.linalg.norm(found.transpose(1, 2, 0) - clip.flow(here, pair.to), axis=-1)
            believed = pair.weight[0].numpy() > 0
            assert believed.mean() > 0.5
            assert np.median(error[believed]) < 0.5
            assert np.quantile(error[believed], 0.98) < 2


def test_measured_flow_makes_the_true_motion_cheap():
    clip, flow = prepared(COMING)
    here, there = points_on(clip, flow, 0, 4, 9)
    visible = torch.ones(len(here))
    pair = next(p for p in flow.pairs[0] if p.to == 4)
    assert error_of(flow, here, there, visible, 0, pair) < 0.1 * error_of(flow, here, here, visible, 0, pair)


def test_tools_and_their_surroundings_have_no_flow():
    hole = np.s_[20:40, 30:60]
    _, flow = prepared(SLIDING, hole=hole)
    for pairs in flow.pairs.values():
        for pair in pairs:
            assert not pair.weight[0].numpy()[17:43, 27:63].any()

    clip = MovingWall(6, velocity=SLIDING)
    tool = np.zeros(clip.size[::-1], bool)
    tool[hole] = True
    frames = TrainingFrames(clip, 1 << 20, CPU)
    told = FlowSupervision(frames, tools=lambda frame: tool if frame == 2 else None)
    for frame, pairs in told.pairs.items():
        for pair in pairs:
            assert pair.weight[0].numpy()[25:35, 35:55].any() == (frame != 2 and pair.to != 2)
            assert frame != 2 or not pair.weight[0].numpy()[17:43, 27:63].any()


@pytest.mark.parametrize(("source", "frame"), [(0, 4), (4, 0), (2, 4), (3, 3), (0, 0)])
def test_a_frame_is_warped_to_where_its_tissue_is(source, frame):
    clip, flow = prepared(SLIDING, seed=source + frame)
    marked = clip.material(source)[..., 0] > 0.1
    moved, known = flow.warped(marked.astype(np.int32), source, frame)
    expected = clip.material(frame)[..., 0] > 0.1
    assert moved.dtype == np.int32
    assert known.mean() > 0.6
    assert (moved[known] == expected[known]).mean() > 0.985
    colours, again = flow.warped(clip.frame(source), source, frame)
    assert colours.shape == clip.frame(0).shape
    assert np.array_equal(again, known)
    difference = np.abs(colours.astype(int) - clip.frame(frame))[known]
    assert np.median(difference) <= 12
    untouched = ~known
    assert source == frame or not untouched.any() or set(np.unique(moved[untouched])) <= {0, 1}


def test_carrying_by_an_unknown_way_moves_nothing():
    _, flow = prepared(SLIDING)
    picture = np.random.default_rng(0).integers(0, 9, (72, 96))
    moved, known = flow.warped(picture, 1, 4)  # frame 1 is held out: nothing is known of its motion
    assert not known.any()
    assert moved.shape == picture.shape


def test_agreeing_with_the_flow_back_is_what_weighs():
    """The check that makes weights is the one of engine.motion, at the flow's own size."""
    _, flow = prepared(SLIDING)
    first = {p.to: p for p in flow.pairs[0]}
    back = {p.to: p for p in flow.pairs[4]}
    width, height = flow.size
    out = first[4].flow.float().numpy().transpose(1, 2, 0) * [width, height]
    home = back[0].flow.float().numpy().transpose(1, 2, 0) * [width, height]
    believed = first[4].weight[0].numpy() > 0
    agree = consistent(out.astype(np.float32), home.astype(np.float32), tolerance=0.75)  # half precision costs some hundredths of a pixel
    assert not (believed & ~agree).any()


def test_surface_visibility_by_hand():
    camera = Camera(10, 8, 10.0, 10.0, 5.0, 4.0)
    depth, alpha = torch.full((8, 10), 2.0), torch.ones(8, 10)
    alpha[:, 5:] = 0.5
    depth[:, 5:] = 1.5  # blended, so the surface is at 3 there
    means = torch.tensor(
        [
            [-0.4, 0.0, 2.0],  # on the surface
            [-0.4, 0.0, 2.05],  # within 3 %
            [-0.4, 0.0, 2.07],  # beyond
            [-0.4, 0.0, 1.9],  # in front of it
            [0.6, 0.0, 3.0],  # on the half covered surface
            [0.4, 0.0, 2.0],  # in front of that
            [-0.4, 0.0, 2.0],  # not drawn
            [-0.4, 0.0, 2.0],  # faint
            [-40.0, 0.0, 2.0],  # out of the picture
        ]
    )
    opacities = torch.tensor([0.9] * 7 + [0.05, 0.9])
    radii = torch.tensor([3, 3, 3, 3, 3, 3, 0, 3, 3], dtype=torch.int32)
    result = surface_visibility(means.requires_grad_(), opacities, radii, depth, alpha, seen_by(camera))
    assert result.tolist() == [1, 1, 0, 0, 1, 0, 0, 0, 0]
    assert not result.requires_grad


@pytest.mark.parametrize("seed", [0, 1])
def test_projection_is_the_cameras(seed):
    random = np.random.default_rng(seed)
    turn, _ = np.linalg.qr(random.normal(size=(3, 3)))
    viewmat = np.eye(4)
    viewmat[:3, :3], viewmat[:3, 3] = turn * np.sign(np.linalg.det(turn)), random.normal(size=3)
    camera = Camera(40, 30, 33.0, 35.0, 18.0, 16.0, viewmat)
    pixels, z = random.uniform(0, 30, (50, 2)), random.uniform(0.5, 3, 50)
    points = torch.from_numpy(camera.unproject(pixels, z))
    seen = view_and_lens(camera, CPU, torch.float64)
    position, depth = project(points, seen)
    np.testing.assert_allclose(position.numpy() * [40, 30], pixels, atol=1e-9)
    np.testing.assert_allclose(depth.numpy(), z, atol=1e-9)
    np.testing.assert_allclose(unproject(position, depth, seen).numpy(), points.numpy(), atol=1e-9)


def test_look_up_reads_pixel_centres_and_zero_outside():
    picture = torch.rand(2, 3, 4, generator=torch.Generator().manual_seed(1))
    centre = torch.tensor([[(2 + 0.5) / 4, (1 + 0.5) / 3], [5.0, 0.5]]) * 2 - 1
    found = look_up(picture, centre)
    assert torch.allclose(found[0], picture[:, 1, 2])
    assert (found[1] == 0).all()
