"""Learning rates over a schedule."""

import pytest
import torch

from degense.engine.training.adam import Adam
from degense.engine.training.config import TrainConfig
from degense.engine.training.optimiser import COOLDOWN, DECAYING, SETTLED, set_rates


def rates(progress, caution=1.0, names=("means", "colors"), **changes):
    """Of groups, by default of one that decays and one that does not, all 1 at the start."""
    assert "means" in DECAYING
    assert "colors" not in DECAYING
    groups = [{"name": name, "params": [torch.nn.Parameter(torch.zeros(1))], "lr": 1.0} for name in names]
    optimizer = Adam(groups)
    for group in optimizer.param_groups:
        group["base"] = 1.0
    set_rates(optimizer, TrainConfig(**changes), progress, caution)
    return [group["lr"] for group in optimizer.param_groups]


def test_before_the_cool_down_only_positions_and_field_slow_down():
    assert rates(0.0) == [1.0, 1.0]
    assert rates(0.5, rate_final=0.01) == [pytest.approx(0.1), 1.0]
    assert rates(1 - COOLDOWN)[1] == pytest.approx(1.0)


def test_at_the_end_everything_has_settled():
    assert rates(1.0, rate_final=0.1) == [pytest.approx(0.1 * SETTLED), pytest.approx(SETTLED)]
    assert rates(1 - COOLDOWN / 2)[1] == pytest.approx((1 + SETTLED) / 2)


def test_caution_slows_all():
    assert rates(0.0, caution=0.25) == [0.25, 0.25]


def test_the_field_goes_through_its_rates_in_its_own_iterations():
    own = {"names": ("planes", "means"), "iterations": 400, "motion_iterations": 100}
    for progress in (0.0, 0.1, 0.2, 0.25):
        assert rates(progress, **own)[0] == pytest.approx(rates(4 * progress)[0])
        assert rates(progress, **own)[1] == pytest.approx(rates(progress)[0])
    assert rates(0.26, **own)[0] == 0
