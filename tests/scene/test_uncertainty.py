"""The bound on the error of displacement: by hand, without evidence, and drawn."""

import numpy as np
import pytest
import torch

from degense.engine.scene import uncertainty
from degense.engine.scene.uncertainty import NEIGHBOURS, SPREADS, error_bound, is_guess, revealed_around


def line(count):
    """Gaussians in a row, a unit apart."""
    return torch.tensor([[float(k), 0, 0] for k in range(count)])


def test_neighbours_are_the_nearest_that_are_revealed():
    means, observability = line(100), torch.zeros(100)
    observability[60:] = 1
    around = revealed_around(means, observability)
    assert around.shape == (100, NEIGHBOURS)
    assert sorted(around[0].tolist()) == list(range(60, 60 + NEIGHBOURS))
    assert 80 in around[80].tolist()
    assert revealed_around(means, observability[:, None].expand(100, 1)[:, 0] * (torch.arange(100) > 97)).shape == (100, 2)


def test_what_moves_as_what_is_revealed_around_is_certain_and_what_differs_is_not():
    means, observability = line(80), torch.ones(80)
    observability[:10] = 0
    around = revealed_around(means, observability)
    together = torch.full((80, 3), 0.5)
    assert error_bound(together, around, 100.0).max() == pytest.approx(0, abs=1e-6)
    apart = together.clone()
    apart[3] += torch.tensor([3.0, 4.0, 0])  # nobody shows it, and it moves otherwise
    bound = error_bound(apart, around, 100.0)
    assert bound[3] == pytest.approx(5 * SPREADS)
    assert bound[4] == pytest.approx(0, abs=1e-6)  # what nobody shows does not count as evidence


def test_without_any_evidence_everything_is_a_guess():
    around = revealed_around(line(5), torch.zeros(5))
    assert around.shape == (5, 0)
    assert error_bound(torch.zeros(5, 3), around, 7.0).tolist() == [7.0] * 5


def test_parts_of_many_gaussians_are_put_together(monkeypatch):
    means, moved = torch.rand(50, 3), torch.rand(50, 3)
    around = revealed_around(means, torch.ones(50))
    whole = error_bound(moved, around, 100.0)
    monkeypatch.setattr(uncertainty, "ROWS", 7)
    torch.testing.assert_close(error_bound(moved, around, 100.0), whole)


def test_a_scene_draws_it_of_tissue_and_never_beyond_its_depth(scene):
    assert scene.states.uncertainty(scene.reference_frame).max() == 0
    bound = scene.states.uncertainty(5)
    assert bound.shape == (len(scene.model),)
    assert bound.max() <= 1 / scene.states.unit * (1 + 1e-5)
    drawn = scene.render(5, what=("uncertainty",))["uncertainty"]
    tissue = bound[scene.states.persistent]
    assert np.nanmin(drawn) >= float(tissue.min()) - 1e-5
    hidden = scene.renderer.blend("hidden", 5, lambda: (~scene.model.persistent).float()) > 0.5
    assert hidden.any()  # an instrument: nobody sees how tissue moves behind it
    np.testing.assert_allclose(drawn[hidden], 1 / scene.states.unit, rtol=1e-5)
    assert np.nanmax(drawn[~hidden]) <= float(tissue.max()) + 1e-5
    everything, scene.states.observability = scene.states.observability, None
    try:
        with pytest.raises(ValueError, match="no motion observability"):
            type(scene.states)(scene.model, scene.states.unit, scene.frames, 0, None).uncertainty(5)
    finally:
        scene.states.observability = everything


def test_a_guess_may_be_off_by_much_of_the_depth_and_of_itself():
    bound = np.array([0.9, 1.1, 1.1, 6.0])
    displacement = np.array([0.0, 0.5, 4.0, 4.0])
    assert is_guess(bound, displacement, 100.0).tolist() == [False, True, False, True]
