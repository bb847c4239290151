import numpy as np
import pytest

from experiments.validation.terrain.subjects import UP, Box, FromFile
from experiments.validation.terrain.trial import Level, Trial, limit


@pytest.mark.parametrize("truth", [0.31, 0.5, 0.689])
@pytest.mark.parametrize("rounds", [1, 2, 3])
def test_the_limit_is_found_to_the_last_interval(truth, rounds):
    found = limit(lambda values: values <= truth, 0.0, 1.0, 5, rounds)
    assert abs(found - truth) <= 0.5 * 0.25 / 6 ** (rounds - 1) + 1e-12


@pytest.mark.parametrize("truth", [-0.1, 1.1])
def test_a_limit_elsewhere_is_not_a_number(truth):
    assert np.isnan(limit(lambda values: values <= truth, 0.0, 1.0, 5, 3))


@pytest.mark.parametrize("subject", [Box(), FromFile("rescue")], ids=lambda one: one.name)
def test_robots_stand_on_their_tracks_where_theory_has_them(subject):
    stand = subject.stand(Level(), "fast", flippers=UP)
    trial = Trial(stand, 1, 1)
    trial.drive(np.zeros(2))
    start = trial.position[0].copy()
    trial.advance(2.0)
    sunk, ahead = start - trial.position[0], stand.view.centre_of_mass[0]
    assert 0 < sunk[2] < 5e-3
    assert np.abs(sunk[:2]).max() < 1e-3
    assert trial.leaning()[0] < 1e-3 + np.abs(ahead) / stand.half_length
    assert trial.centre_of_mass()[0] == pytest.approx(trial.position[0, 0] + ahead, abs=1e-3)
    np.testing.assert_allclose(trial.belts.read().load.sum(), stand.model.body_subtreemass[0] * 9.81, rtol=0.01)


@pytest.mark.parametrize("subject", [Box(), FromFile("rescue")], ids=lambda one: one.name)
def test_the_centre_of_mass_is_shifted(subject):
    before, after = (subject.stand(Level(), "fast", shift).view.centre_of_mass for shift in (0.0, 0.05))
    assert after[0] - before[0] == pytest.approx(0.05, abs=1e-9)
    assert after[1] == pytest.approx(before[1], abs=1e-9)
