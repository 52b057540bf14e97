"""How the sweep reads the names of teachers."""

from degense.engine.research.sweep.plan import CELLS, seeded, slug, teachers_of


def test_names_are_taken_apart_at_commas_between_teachers():
    assert teachers_of("labels,degraded:model=flips,strength=2,unseen") == ("labels", "degraded:model=flips,strength=2", "unseen")
    assert teachers_of("degraded,unseen") == (*CELLS, "unseen")


def test_teachers_that_err_have_the_chances_of_a_seed():
    assert seeded("unseen", 3) == "unseen:seed=3"
    assert seeded("unseen:seed=1", 3) == "unseen:seed=1"
    assert seeded("degraded:model=flips", 3) == "degraded:model=flips,seed=3"
    assert seeded("labels", 3) == "labels"
    assert slug("unseen:seed=3") == "unseen-seed-3"
