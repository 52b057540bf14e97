"""The first Gaussians: where they come from, how long they live, how many they are."""

import cv2
import numpy as np
import pytest
import torch

from degense.engine.training.flow.supervision import FlowSupervision
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.initialise import filled, initial_gaussians, jittered_grid, key_count, unlike
from tests.fakes import MemoryClip, MovingWall

CPU = torch.device("cpu")


class Visited(MovingWall):
    """A still wall with a tool, never valid, at the left in the first half of the frames; in the second half a bright patch."""

    TOOL, PATCH = np.s_[20:50, 6:30], np.s_[30:50, 60:84]

    def __init__(self, frames=10, **options):
        super().__init__(frames, velocity=(0.0, 0.0, 0.0), **options)
        self.read = set()

    def frame(self, index):
        self.read.add(index)
        image = super().frame(index)
        if index >= len(self) // 2:
            image[self.PATCH] = 250
        return image

    def valid(self, index):
        self.read.add(index)
        valid = super().valid(index)
        if index < len(self) // 2:
            valid[self.TOOL] = False
        return valid

    def depth(self, index):
        self.read.add(index)
        return super().depth(index)


def start(clip, budget=1200, motion=False, seed=0):
    frames = TrainingFrames(clip, 1 << 20, CPU)
    flow = FlowSupervision(frames) if motion else None
    canonical, bounds = initial_gaussians(frames, flow, budget, 3, np.random.default_rng(seed))
    position, z = frames.cameras[0].project(canonical["means"].double().numpy())
    return frames, canonical, bounds, position, z


def inside(position, area):
    rows, columns = area
    x, y = position.T
    return (x > columns.start) & (x < columns.stop) & (y > rows.start) & (y < rows.stop)


def test_only_training_frames_are_read():
    clip = Visited(20)
    start(clip, motion=True)
    assert clip.read
    assert clip.read <= set(clip.train_frames)


@pytest.mark.parametrize("seed", [0, 1])
def test_what_was_hidden_lasts_and_what_came_later_lives_around_its_time(seed):
    clip = Visited(seed=seed)
    _, canonical, _, position, _ = start(clip, seed=seed)
    middle, rate = canonical["temporal_windows"].numpy().T
    behind, patch = inside(position, clip.TOOL), inside(position, clip.PATCH)
    assert behind.sum() > 20
    assert (rate[behind] == 0).all()
    assert (rate[~inside(position, np.s_[26:54, 56:88])] == 0).all()  # its rim is blurred
    came = patch & (rate > 0)
    assert came.sum() > 20
    second_half = [clip.time(i) for i in range(5, 10)]
    assert (middle[came] >= second_half[0] - 1e-6).all()
    assert (patch & (rate == 0)).sum() > 20  # what the patch hides is still there
    colours = canonical["colors"].numpy()
    bright = colours[came].mean(1) > 0.9
    assert bright.mean() > 0.8
    assert not (colours[patch & (rate == 0)].mean(1) > 0.95).any()
    # at its own key frame a transient is whole, and two key frames on it is gone
    keys = key_count(len(clip.train_frames))
    alive = [np.exp(-0.5 * (rate[came] * step) ** 2) for step in (0.0, 4 / (keys - 1))]
    assert (alive[0] == 1).all()
    assert (alive[1] < 0.02).all()


class Passing(MovingWall):
    """A still wall; from the third frame on a bright, textured plate, nearer by a tenth, passes before it at a constant pace."""

    PACE, SIZE = (4, 1), 24  # pixels a frame, pixels

    def __init__(self, frames=10, **options):
        super().__init__(frames, velocity=(0.0, 0.0, 0.0), **options)
        texture = np.random.default_rng(5).integers(128, 256, (self.SIZE, self.SIZE, 3))
        self.plate = cv2.GaussianBlur(texture.astype(np.uint8), (0, 0), 1.0)

    def place(self, index):
        left, top = 8 + self.PACE[0] * index, 12 + self.PACE[1] * index
        return np.s_[top : top + self.SIZE, left : left + self.SIZE]

    def frame(self, index):
        image = super().frame(index)
        if index >= 2:
            image[self.place(index)] = self.plate
        return image

    def depth(self, index):
        depth = super().depth(index).copy()
        if index >= 2:
            depth[self.place(index)] *= 0.9
        return depth


@pytest.mark.parametrize("measured", [True, False], ids=["measured", "guessed"])
def test_what_passes_by_drifts_as_its_flow_says_and_what_stands_still_does_not(measured):
    clip = Passing(measured=measured)
    frames, canonical, _, position, z = start(clip, motion=True)
    middle, rate = canonical["temporal_windows"].double().numpy().T
    plate = np.zeros(len(z), bool)
    for index in clip.train_frames[2:-2]:
        rows, columns = clip.place(index)
        inner = np.s_[rows.start + 5 : rows.stop - 5, columns.start + 5 : columns.stop - 5]
        plate |= (rate > 0) & np.isclose(middle, clip.time(index)) & inside(position, inner)
    assert plate.sum() > 50
    speed = (canonical["velocities"].double().numpy() * rate[:, None])[plate] * (clip.time(1) - clip.time(0))
    pixels = speed[:, :2] / z[plate, None] * frames.cameras[0].fx
    assert np.abs(np.median(pixels, axis=0) - clip.PACE).max() < 0.3
    assert np.abs(speed[:, 2]).mean() < 0.01
    assert not canonical["velocities"][canonical["temporal_windows"][:, 1] == 0].any()
    assert not start(clip)[1]["velocities"].any(), "without flow nothing is known"


def test_tissue_that_only_moved_gives_no_transients_when_its_flow_is_known():
    clip = MovingWall(10, velocity=(0.03, 0.01, 0.0))
    counts = {}
    for motion in (False, True):
        _, canonical, _, position, _ = start(clip, motion=motion)
        middle = inside(position, np.s_[14:58, 14:82])  # what enters at the border is new
        counts[motion] = int(((canonical["temporal_windows"][:, 1] > 0).numpy() & middle).sum())
    assert counts[False] > 100
    assert counts[True] < 0.1 * counts[False]


def test_points_lie_on_the_surface_in_its_colour():
    clip = Visited()
    _, canonical, bounds, position, z = start(clip)
    np.testing.assert_allclose(z, 1.0, atol=1e-5)  # median depth is the unit
    persistent = (canonical["temporal_windows"][:, 1] == 0).numpy() & ~inside(position, clip.TOOL)
    rows, columns = position[persistent, 1].astype(int), position[persistent, 0].astype(int)
    colour = canonical["colors"].numpy()[persistent] * 255
    assert np.median(np.abs(colour - cv2.GaussianBlur(clip.frame(0), (0, 0), 1)[rows, columns])) < 6
    means = canonical["means"]
    assert ((means >= bounds[0]) & (means <= bounds[1])).all(1).float().mean() > 0.98
    extent = means.max(0).values - means.min(0).values
    assert ((bounds[1] - bounds[0]) < 1.3 * extent + 0.02).all()


def test_shapes_and_sizes():
    _, canonical, bounds, *_ = start(Visited())
    count = len(canonical["means"])
    shapes = {"means": (3,), "log_scales": (3,), "quats": (4,), "logits": (), "colors": (3,), "color_residuals": (0, 3)}
    shapes |= {"temporal_windows": (2,), "velocities": (3,), "semantics": (3,)}
    assert {name: tuple(t.shape[1:]) for name, t in canonical.items()} == shapes
    assert all(len(t) == count and t.dtype == torch.float32 and bool(torch.isfinite(t).all()) for t in canonical.values())
    assert bounds.shape == (2, 3)
    assert (bounds[1] > bounds[0]).all()
    spacing = np.sqrt(96 * 72 / (0.6 * 1200)) / 96  # pixels apart, at unit depth
    assert canonical["log_scales"].exp().median() == pytest.approx(0.6 * spacing, rel=1e-3)


@pytest.mark.parametrize("budget", [16, 50, 400])
@pytest.mark.parametrize("make", [Visited, lambda: MovingWall(10, velocity=(0.2, 0.1, 0.0)), MemoryClip])
def test_the_budget_is_kept(make, budget):
    _, canonical, *_ = start(make(), budget)
    assert 0 < len(canonical["means"]) <= budget


def test_one_frame_is_enough():
    _, canonical, *_ = start(MovingWall(1))
    assert (canonical["temporal_windows"] == 0).all()


def test_unknown_depth_is_filled_from_the_nearest_known():
    random = np.random.default_rng(4)
    depth = random.uniform(1, 2, (14, 17)).astype(np.float32)
    depth[random.random(depth.shape) < 0.7] = 0
    result = filled(depth)
    known = np.argwhere(depth > 0)
    for y, x in np.ndindex(depth.shape):
        distance = np.hypot(*(known - (y, x)).T)
        nearest = [depth[tuple(known[k])] for k in np.flatnonzero(distance <= distance.min() * 1.05 + 0.1)]  # OpenCV's are 2 % off
        assert result[y, x] in nearest
    assert result.dtype == np.float32
    assert np.array_equal(filled(result), result)
    assert (filled(np.zeros((3, 4), np.float32)) == 1).all()


def test_points_behind_unknown_depth_take_their_neighbours():
    class Patchy(MovingWall):
        def depth(self, index):
            depth = super().depth(index)
            depth[10:40, 20:50] = 0
            return depth

    *_, position, z = start(Patchy(velocity=(0.0, 0.0, 0.0)))
    assert inside(position, np.s_[10:40, 20:50]).sum() > 30
    np.testing.assert_allclose(z, 1.0, atol=1e-5)


@pytest.mark.parametrize(("width", "height", "stride"), [(40, 30, 3.0), (64, 48, 2.5), (7, 5, 1.0)])
def test_the_grid_has_one_point_a_cell_away_from_its_walls(width, height, stride):
    points = jittered_grid(width, height, stride, np.random.default_rng(1))
    assert ((points >= 0) & (points < [width, height])).all()
    place = points / stride
    share = place - np.floor(place)
    assert ((share >= 0.25) & (share <= 0.75)).all()
    cells = {tuple(cell) for cell in np.floor(place).astype(int)}
    assert len(cells) == len(points)
    whole = {(x, y) for x in range(int(width // stride)) for y in range(int(height // stride))}
    assert whole <= cells
    assert not np.array_equal(points, jittered_grid(width, height, stride, np.random.default_rng(2)))


@pytest.mark.parametrize(("frames", "keys"), [(1, 1), (7, 7), (12, 12), (47, 12), (56, 14), (96, 24), (2000, 24)])
def test_one_training_frame_in_four_is_a_key_frame_within_bounds(frames, keys):
    assert key_count(frames) == keys


def test_unlike_forgives_a_pixel_and_no_more():
    rng = np.random.default_rng(3)
    picture = rng.integers(0, 256, (12, 15, 3)).astype(np.uint8)
    for shift in ((0, 0), (1, 0), (0, -1), (-1, 1)):
        assert not unlike(picture, np.roll(picture, shift, (0, 1)))[1:-1, 1:-1].any()
    far = unlike(picture, np.roll(picture, 2, 1))
    assert (far[1:-1, 2:-2] > 0).mean() > 0.9
    plain, other = np.full((5, 6, 3), 200, np.uint8), np.full((5, 6, 3), 190, np.uint8)
    other[..., 2] = 30
    assert (unlike(plain, other) == 170).all()  # the channel that differs most, without wrapping around
