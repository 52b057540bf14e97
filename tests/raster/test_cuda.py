"""The gsplat back end against the reference, where there is a GPU."""

import pytest

from degense.engine.research.bench.raster_check import cases, compare, hostile_cases

pytestmark = pytest.mark.cuda


@pytest.mark.parametrize("case", [*cases(31), *hostile_cases(32)], ids=lambda case: case.name)
def test_agrees_with_the_reference(case):
    result = compare(case, "cuda")
    assert result.passes, result
