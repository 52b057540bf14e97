"""Losses against independent answers, and their behaviour at zero."""

import numpy as np
import pytest
import torch
from skimage.metrics import structural_similarity

from degense.engine.training.losses import angular, inverse_depth, photometric, region_smoothness, rigidity, rows_of, ssim_map, unit


def test_ssim_agrees_with_scikit_image_away_from_the_border():
    random = np.random.default_rng(1)
    a = random.uniform(size=(40, 50, 3))
    b = np.clip(a + random.normal(0, 0.1, a.shape), 0, 1)
    _, expected = structural_similarity(
        a, b, channel_axis=2, data_range=1.0, gaussian_weights=True, sigma=1.5, use_sample_covariance=False, full=True, truncate=3.34
    )
    ours = ssim_map(torch.from_numpy(a), torch.from_numpy(b)).numpy()
    np.testing.assert_allclose(ours[6:-6, 6:-6], expected[6:-6, 6:-6], atol=1e-6)


def test_the_gradient_of_ssim_is_right():
    torch.manual_seed(2)
    image, target = torch.rand(7, 9, 2, dtype=torch.float64, requires_grad=True), torch.rand(7, 9, 2, dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda x: ssim_map(x, target), image)


def test_photometric_ignores_invalid_pixels():
    torch.manual_seed(0)
    image, target = torch.rand(30, 30, 3), torch.rand(30, 30, 3)
    valid = torch.ones(30, 30)
    valid[:, 20:] = 0
    spoilt = image.clone()
    spoilt[:, 20:] = 7
    assert torch.equal(sum(photometric(image, target, valid, 0.2)), sum(photometric(spoilt, target, valid, 0.2)))
    assert sum(photometric(target, target, valid, 0.2)).item() == pytest.approx(0, abs=1e-6)
    assert sum(photometric(image, target, valid, 0.0)).item() == pytest.approx((image - target).abs()[:, :20].mean().item(), rel=1e-5)


def test_photometric_of_a_fully_masked_frame_is_zero_with_zero_gradient():
    image = torch.rand(16, 16, 3, requires_grad=True)
    loss = sum(photometric(image, torch.rand(16, 16, 3), torch.zeros(16, 16), 0.2))
    loss.backward()
    assert loss.item() == 0
    assert torch.count_nonzero(image.grad) == 0


def test_angles_are_measured_on_the_sphere_and_finite_at_zero():
    a = torch.tensor([[2.0, 0.0], [0.0, 3.0], [-1.0, 0.0], [0.0, 0.0]], requires_grad=True)
    b = torch.tensor([[5.0, 0.0], [1.0, 0.0], [4.0, 0.0], [1.0, 0.0]])
    loss = angular(a, b)
    assert torch.allclose(loss, torch.tensor([0.0, 1.0, 2.0, 1.0]), atol=1e-6)
    loss.sum().backward()
    assert torch.isfinite(a.grad).all()
    assert torch.isfinite(unit(torch.full((1, 4), 1e18))).all()


def test_region_smoothness_by_hand():
    latent = torch.tensor([[1.0], [3.0], [5.0], [5.0], [9.0]])
    regions = torch.tensor([0, 0, 2, 2, 2])
    # region 0: mean 2, spread 1; region 2: mean 19/3, spread (4/3 + 4/3 + 8/3)/3; region 1 is empty and does not count
    assert region_smoothness(latent, regions, 3).item() == pytest.approx((1 + 16 / 9) / 2, rel=1e-6)


def test_inverse_depth_counts_known_covered_pixels_only():
    depth, alpha = torch.tensor([[1.0, 2.0, 0.2, 4.0]]), torch.tensor([[1.0, 0.8, 0.1, 1.0]])
    target, valid = torch.tensor([[2.0, 2.5, 1.0, 0.0]]), torch.ones(1, 4)
    assert inverse_depth(depth, alpha, target, valid).item() == pytest.approx((0.5 + 0.0) / 2, abs=1e-6)


def test_rigid_motion_costs_nothing():
    neighbours, weights = torch.tensor([[1], [0], [1]]), torch.ones(3, 1)
    shift = torch.tensor([0.3, -0.2, 0.5]).expand(3, 3)
    assert rigidity(shift, neighbours, weights).item() == pytest.approx(0, abs=1e-5)


def test_neighbours_that_have_parted_are_hardly_drawn_to_each_other():
    neighbours, weights = torch.tensor([[1], [0]]), torch.tensor([[1.0], [0.5]])

    def loss_and_force(parted: float) -> tuple[float, float]:
        shift = torch.tensor([[0.0, 0.0, 0.0], [0.0, parted, 0.0]], requires_grad=True)
        value = rigidity(shift, neighbours, weights)
        value.backward()
        return value.item(), shift.grad[1, 1].item()

    near, far = loss_and_force(1e-5), loss_and_force(1.0)
    assert near == pytest.approx((0.75 * 1e-5, 0.75), rel=0.01)  # as ‖Δμ_i − Δμ_j‖
    assert far == pytest.approx((0.75 / 101, 0.75 / 101**2), rel=1e-4)


def test_rows_asked_for_many_times_get_the_same_gradient_every_time():
    """Bit for bit, and right: indexing, whose sums race, fails this nine times in ten."""
    generator = torch.Generator().manual_seed(0)
    index = torch.randint(0, 8, (100_000, 2), generator=generator)
    values, wanted = torch.randn(8, 3, generator=generator), torch.randn(100_000, 2, 3, generator=generator)
    found = []
    for _ in range(10):
        given = values.clone().requires_grad_()
        rows = rows_of(given, index)
        assert torch.equal(rows, values[index])
        found.append(torch.autograd.grad((rows * wanted).sum(), given)[0])
    assert all(torch.equal(found[0], other) for other in found)
    exact = torch.zeros(8, 3, dtype=torch.float64).index_add(0, index.reshape(-1), wanted.reshape(-1, 3).double())
    torch.testing.assert_close(found[0].double(), exact, rtol=1e-4, atol=1e-2)


@pytest.mark.cuda
@pytest.mark.parametrize(("height", "width"), [(40, 50), (7, 90), (1, 1)])
def test_the_gpus_fused_similarity_in_values_and_gradients(height, width):
    torch.manual_seed(height)
    image, target, weight = (torch.rand(height, width, 3) for _ in range(3))
    results = []
    for device, cast in (("cuda", torch.float32), ("cpu", torch.float64)):
        x = image.to(device, cast, copy=True).requires_grad_()
        similarity = ssim_map(x, target.to(device, cast))
        (similarity * weight.to(device, cast)).sum().backward()
        results.append((similarity.detach().cpu().double(), x.grad.cpu().double()))
    for fused, exact in zip(*results, strict=True):
        assert float((fused - exact).norm() / exact.norm()) < 1e-4
