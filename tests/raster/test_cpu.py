"""The numba back end against the reference, and what it promises beyond numbers: the same result always, from any thread."""

import subprocess
import sys
import threading

import pytest
import torch

from degense.engine.raster import cpu, rasterize
from degense.engine.research.bench.raster_check import Case, cases, compare, draw
from degense.engine.research.bench.raster_scenes import draw_scene, random_scene
from degense.engine.research.bench.timing import threads

SEED = 77


@pytest.mark.parametrize("case", list(cases(SEED)), ids=lambda case: case.name)
def test_agrees_with_the_reference(case):
    result = compare(case, "cpu")
    assert result.finite
    assert result.outliers <= 1e-3
    assert max(result.image, result.alpha) <= 1 / 255 + 1e-3
    assert result.radii == 0
    assert result.gradients.keys() >= {"means", "features"} & set(case.wanted)
    assert all(error <= 1e-2 for error in result.gradients.values()), result.gradients


def test_long_thin_gaussians_agree():
    """Ellipses of 1 : 1000: where a float32 inverse of the covariance would be noise."""
    splats, camera = random_scene(40, 64, 48, 3, SEED)
    splats.scales[:] = torch.tensor([3.0, 1e-4, 1e-4])
    result = compare(Case("needles", splats, camera), "cpu")
    assert max(result.image, result.alpha) <= 1 / 255 + 1e-3
    assert result.outliers <= 1e-3
    assert all(error <= 1e-2 for error in result.gradients.values()), result.gradients


def leaves_of(splats):
    return splats.map(lambda tensor: tensor.clone().requires_grad_())


def tensors_of(splats):
    return splats.means, splats.quats, splats.scales, splats.opacities, splats.semantics


def gradients_of(splats, camera, offsets):
    leaves = leaves_of(splats)
    shift = offsets.clone().requires_grad_()
    render = draw_scene(leaves, camera, screen_offsets=shift)
    (render.image.square().sum() + render.alpha.sin().sum()).backward()
    return [render.image.detach(), render.alpha.detach(), render.radii, *(leaf.grad for leaf in tensors_of(leaves)), shift.grad]


def test_the_same_input_gives_the_same_bits_on_any_number_of_threads():
    splats, camera = random_scene(3000, 200, 150, 5, SEED)
    offsets = torch.zeros(3000, 2)
    results = []
    for count in (1, 2, 2, 5):
        with threads(count):
            results.append(gradients_of(splats, camera, offsets))
    for result in results[1:]:
        assert all(torch.equal(a, b) for a, b in zip(result, results[0], strict=True))


def test_python_threads_draw_at_once():
    scenes = [random_scene(800, 120, 90, 4, SEED + i) for i in range(4)]
    alone = [gradients_of(*scene, torch.zeros(800, 2)) for scene in scenes]
    together: list = [None] * 4

    def work(i):
        for _ in range(5):
            together[i] = gradients_of(*scenes[i], torch.zeros(800, 2))

    threads = [threading.Thread(target=work, args=(i,)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
        assert not thread.is_alive()
    for one, other in zip(alone, together, strict=True):
        assert all(torch.equal(a, b) for a, b in zip(one, other, strict=True))


def test_bands_of_tile_rows_change_nothing(monkeypatch):
    splats, camera = random_scene(1500, 100, 130, 3, SEED, footprint=6.0)
    whole = gradients_of(splats, camera, torch.zeros(1500, 2))
    monkeypatch.setattr(cpu, "SLOT_BYTES", 40_000)
    banded = gradients_of(splats, camera, torch.zeros(1500, 2))
    for a, b in zip(whole[3:], banded[3:], strict=True):
        torch.testing.assert_close(a, b, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("limit", [1, 7, 100])
def test_bands_cover_every_row_once_and_keep_the_limit(limit):
    visits = torch.cat(
        [torch.zeros(1, dtype=torch.long), torch.randint(0, 12, (9,), generator=torch.Generator().manual_seed(limit)).cumsum(0)]
    ).numpy()
    bands = cpu._bands(visits, limit)
    assert [row for first, last in bands for row in range(first, last)] == list(range(9))
    assert all(visits[last] - visits[first] <= limit or last == first + 1 for first, last in bands)


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.float64])
def test_other_precisions_are_computed_in_float32(dtype):
    splats, camera = random_scene(100, 40, 30, 3, SEED)
    splats = splats.map(lambda tensor: tensor.to(dtype).requires_grad_())
    render = draw_scene(splats, camera)
    same = draw_scene(splats.detach().map(torch.Tensor.float), camera)
    assert render.image.dtype == render.alpha.dtype == torch.float32
    assert torch.equal(render.image, same.image)
    render.image.sum().backward()
    assert all(tensor.grad.dtype == dtype and tensor.grad.isfinite().all() for tensor in tensors_of(splats))


def test_only_wanted_gradients_are_computed():
    splats, camera = random_scene(100, 40, 30, 3, SEED)
    full = gradients_of(splats, camera, torch.zeros(100, 2))
    leaf = splats.semantics.clone().requires_grad_()
    render = rasterize(splats, leaf, camera)
    (render.image.square().sum() + render.alpha.sin().sum()).backward()
    torch.testing.assert_close(leaf.grad, full[7])
    assert not draw_scene(splats, camera).image.requires_grad


def test_alpha_alone_can_be_the_loss():
    splats, camera = random_scene(100, 40, 30, 3, SEED)
    pulls = []
    for backend in ("cpu", "reference"):
        leaves = leaves_of(splats)
        draw_scene(leaves, camera, backend=backend).alpha.square().sum().backward()
        pulls.append([leaf.grad for leaf in tensors_of(leaves)[:4]])
    for a, b in zip(*pulls, strict=True):
        assert (a - b).norm() <= 1e-2 * b.norm()


def test_drawing_on_the_cpu_does_not_import_gsplat():
    program = (
        "import sys; from degense.engine.research.bench.raster_scenes import draw_scene, random_scene;"
        "draw_scene(*random_scene(10, 8, 8, 1, 0)); sys.exit('gsplat' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_a_moved_picture_is_drawn_where_the_offsets_put_it():
    splats, camera = random_scene(100, 40, 30, 3, SEED)
    moved = draw_scene(splats, camera, screen_offsets=torch.full((100, 2), 7.0)).image
    _, gradients = draw(Case("moved", splats, camera, None, torch.full((100, 2), 7.0)), "cpu")
    still = draw_scene(splats, camera).image
    torch.testing.assert_close(moved[7:, 7:], still[:-7, :-7], atol=1e-4, rtol=0)
    assert gradients["offsets"].abs().sum() > 0
