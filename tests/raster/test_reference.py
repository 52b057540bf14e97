"""The reference against code that shares nothing with it: a plain loop, finite differences, gsplat's torch twin of its projection."""

import math
from dataclasses import fields

import numpy as np
import pytest
import torch

from degense.engine.camera import Camera
from degense.engine.raster import camera_depths
from degense.engine.research.bench.raster_scenes import draw_scene, random_scene
from degense.engine.research.raster_reference import project
from degense.engine.splats import Splats


def draw_by_hand(means, quats, scales, opacities, features, camera, background):
    """Pixel by pixel, Gaussian by Gaussian, in scalar float64."""
    rotation, translation = camera.viewmat[:3, :3], camera.viewmat[:3, 3]
    splats = []
    for mean, quat, scale, opacity, feature in zip(means, quats, scales, opacities, features, strict=True):
        x, y, z = rotation @ mean + translation
        if z < 0.01:
            continue
        w, i, j, k = quat / np.linalg.norm(quat)
        turn = np.array(
            [
                [w * w + i * i - j * j - k * k, 2 * (i * j - w * k), 2 * (i * k + w * j)],
                [2 * (i * j + w * k), w * w - i * i + j * j - k * k, 2 * (j * k - w * i)],
                [2 * (i * k - w * j), 2 * (j * k + w * i), w * w - i * i - j * j + k * k],
            ]
        )
        covariance = rotation @ turn @ np.diag(scale**2) @ turn.T @ rotation.T
        low_x, high_x = -camera.cx / camera.fx - 0.15 * camera.width / camera.fx, (1.15 * camera.width - camera.cx) / camera.fx
        low_y, high_y = -camera.cy / camera.fy - 0.15 * camera.height / camera.fy, (1.15 * camera.height - camera.cy) / camera.fy
        slope_x, slope_y = min(max(x / z, low_x), high_x), min(max(y / z, low_y), high_y)
        jacobian = np.array([[camera.fx, 0, -camera.fx * slope_x], [0, camera.fy, -camera.fy * slope_y]]) / z
        precision = np.linalg.inv(jacobian @ covariance @ jacobian.T + 0.3 * np.eye(2))
        center = np.array([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy])
        splats.append((z, center, precision, opacity, feature))
    splats.sort(key=lambda splat: splat[0])
    image, alpha = np.zeros((camera.height, camera.width, features.shape[1])), np.zeros((camera.height, camera.width))
    for row in range(camera.height):
        for column in range(camera.width):
            light = 1.0
            for _, center, precision, opacity, feature in splats:
                offset = np.array([column + 0.5, row + 0.5]) - center
                strength = min(0.999, opacity * math.exp(-0.5 * offset @ precision @ offset))
                if strength < 1 / 255:
                    continue
                if light * (1 - strength) <= 1e-4:
                    break
                image[row, column] += strength * light * feature
                light *= 1 - strength
            image[row, column] += light * background
            alpha[row, column] = 1 - light
    return image, alpha


@pytest.mark.parametrize(
    ("seed", "turned", "footprint", "count"), [(0, False, 3.0, 60), (1, True, 2.0, 60), (2, True, 25.0, 40), (3, False, 6.0, 400)]
)
def test_forward_equals_a_plain_loop(seed, turned, footprint, count):
    splats, camera = random_scene(count, 13, 11, 3, seed, footprint=footprint, turned=turned)
    splats = splats.map(torch.Tensor.double)
    tensors = (splats.means, splats.quats, splats.scales, splats.opacities, splats.semantics)
    background = torch.tensor([0.2, 0.5, 0.9], dtype=torch.float64)
    image, alpha = draw_by_hand(*(tensor.numpy() for tensor in tensors), camera, background.numpy())
    render = draw_scene(splats, camera, background=background, backend="reference")
    np.testing.assert_allclose(render.image, image, atol=1e-12)
    np.testing.assert_allclose(render.alpha, alpha, atol=1e-12)


@pytest.mark.parametrize("turned", [False, True])
def test_gradients_equal_finite_differences(turned):
    splats, camera = random_scene(4, 4, 3, 2, 5, footprint=4.0, turned=turned)
    inputs = [getattr(splats, field.name).double() for field in fields(splats)]
    inputs[3] = inputs[3] * 0.5 + 0.2  # away from the jumps at 1/255, 0.999 and the end of the light
    inputs += [torch.tensor([0.3, 0.7], dtype=torch.float64), torch.zeros(4, 2, dtype=torch.float64)]
    for tensor in inputs:
        tensor.requires_grad_()

    def picture(*values):
        render = draw_scene(Splats(*values[:6]), camera, background=values[6], screen_offsets=values[7], backend="reference")
        return render.image, render.alpha

    assert torch.autograd.gradcheck(picture, inputs)


@pytest.mark.parametrize("seed", [0, 1])
def test_projection_equals_gsplats_torch_twin(seed):
    twin = pytest.importorskip("gsplat.cuda._torch_impl")
    splats, camera = random_scene(300, 64, 48, 1, seed, footprint=8.0, turned=True)
    means, quats, scales = splats.means.double(), splats.quats.double(), splats.scales.double()
    means = means + torch.randn(means.shape, generator=torch.Generator().manual_seed(seed)).double() * 0.3  # far outside the picture too
    covariances, _ = twin._quat_scale_to_covar_preci(quats, scales, True, False)
    view, lens = torch.from_numpy(camera.viewmat)[None], torch.from_numpy(camera.intrinsics)[None]
    _, centers, depths, conics, _ = twin._fully_fused_projection(means, covariances, view, lens, camera.width, camera.height)
    center, depth, covariance, inverse = project(means, quats, scales, camera)
    near = depth > 0.01
    precision = inverse[near]
    torch.testing.assert_close(precision, torch.linalg.inv(covariance[near]))
    torch.testing.assert_close(center[near], centers[0, near])
    torch.testing.assert_close(depth, depths[0])
    torch.testing.assert_close(torch.stack([precision[:, 0, 0], precision[:, 0, 1], precision[:, 1, 1]], 1), conics[0, near])


def test_depth_is_the_camera_z():
    splats, camera = random_scene(20, 8, 8, 1, 0, turned=True)
    means = splats.means.double().requires_grad_()
    depths = camera_depths(means, camera)
    np.testing.assert_allclose(depths.detach(), camera.project(means.detach().numpy())[1])
    depths.sum().backward()
    np.testing.assert_allclose(means.grad, np.broadcast_to(camera.viewmat[2, :3], (20, 3)))
    assert camera_depths(means.detach().half(), camera).dtype == torch.float32


def test_a_camera_that_changes_in_place_is_seen():
    camera = Camera(8, 8, 10.0, 10.0, 4.0, 4.0)
    point = torch.tensor([[0.0, 0.0, 1.0]])
    assert camera_depths(point, camera).item() == 1.0
    camera.viewmat[2, 3] = 2.0
    assert camera_depths(point, camera).item() == 3.0
