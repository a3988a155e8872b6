"""What is said to tell more: a set of names points to the command that plans the run, a lone name does not."""

import pytest

from inertiax.diagnose.wording.explain import experiment
from inertiax.effects import CATALOGUE


@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda e: e.name)
def test_a_set_points_to_the_planned_run(effect):
    lone, of_a_set = experiment(effect, alone=True), experiment(effect, alone=False)
    assert lone == effect.separating and "--separate" not in lone
    assert of_a_set.startswith(lone) and "inertiax design --separate" in of_a_set
