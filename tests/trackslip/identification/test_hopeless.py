"""Laws that are given up."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from slip_data import GEOMETRY as SLOW
from slip_data import grid

from trackslip.errors import LogError
from trackslip.identification.comparison import compare_laws
from trackslip.identification.fit import fit
from trackslip.identification.fitted import fit_law
from trackslip.identification.hopeless import unfollowed
from trackslip.identification.samples import SlipSamples
from trackslip.identification.weighting import WeightedRuns
from trackslip.kinematics import RobotGeometry, track_slip
from trackslip.slip.base import SlipLaw
from trackslip.slip.exponential import PUBLISHED, Exponential
from trackslip.slip.families import FAMILIES, LawFamily, Look, Parameter
from trackslip.slip.icr import ConstantIcr
from trackslip.slip.turn_loss import TurnLoss

pytestmark = pytest.mark.usefixtures("few_resamples")
GEOMETRY = RobotGeometry(0.28, 0.16)


@dataclass(frozen=True)
class Hyperbola(SlipLaw):
    """A user's own law, +-size / (R +- pole), with a pole where its inner track slips without bounds."""

    size: float
    pole: float

    def __call__(self, kappa):
        direction = np.arctan(np.asarray(kappa, float))
        along, turning = np.cos(direction), np.sin(direction)
        with np.errstate(divide="ignore"):
            sides = [sign * self.size * turning / (along + sign * self.pole * turning) for sign in (-1, 1)]
        return np.stack(sides, axis=-1)


@pytest.fixture(autouse=True)
def hyperbola(monkeypatch):
    """The family of these laws, among the others."""
    size, pole = Parameter((0.3, 0.05, 1.0), -20.0, 50.0, 0.3, "m"), Parameter((1.3, 0.5, 2.0), 0.0, 50.0, 0.3, "m")
    mine = LawFamily("hyperbola", {"size": size, "pole": pole}, lambda p, _: Hyperbola(**p), Look("hyperbola"))
    monkeypatch.setitem(FAMILIES, "hyperbola", mine)


def commanded(law, count=40, noise=0.02, seed=0):
    """Samples of commands at random, some with a sprocket almost at rest."""
    rng = np.random.default_rng(seed)
    omega = rng.uniform(-10, 10, (count, 2))
    omega[: count // 2, 0] = 0.02 * omega[: count // 2, 1]
    twist = law.twist(omega, GEOMETRY) + noise * rng.standard_normal((count, 2))
    return SlipSamples(omega, twist, track_slip(omega, twist, GEOMETRY), tuple(map(str, range(count))))


def test_a_law_whose_misfit_jumps_is_given_up_and_says_so():
    """Runs near the pole of a hyperbola, which the true law does not have."""
    samples = commanded(TurnLoss(0.3, 0.28, 0.02, 0.35))
    found = compare_laws(samples, GEOMETRY)
    assert "hyperbola" not in found.laws
    reasons = [warning for warning in found.warnings if warning.startswith("law hyperbola:")]
    assert reasons == ["law hyperbola: given up: how well it fits the 40 samples changes abruptly with its parameters"]
    with pytest.raises(LogError, match="given up"):
        fit_law("hyperbola", samples, GEOMETRY)
    vague = fit_law("hyperbola", samples, GEOMETRY, vague=True)
    assert vague.notes == tuple(reasons)
    assert vague.bootstrap95 == {}


def test_a_law_without_motions_for_the_samples_is_given_up():
    """No robot turns on the spot by this law, whose inner track slips by more than its speed in tight turns."""
    samples = commanded(ConstantIcr(0.3, 0.28))
    runs = WeightedRuns.of(samples, GEOMETRY)
    fits = replace(fit(FAMILIES["hyperbola"], runs), values=np.array([[1.0, 0.4]]))
    assert "no motion has the sprocket speeds of" in unfollowed("hyperbola", fits)[0]


@pytest.mark.parametrize(
    ("name", "law"),
    [("exponential", PUBLISHED), ("hyperbola", Hyperbola(0.043, 0.27))],
)
def test_laws_that_made_the_samples_are_followed(name, law):
    for seed in range(5):
        assert unfollowed(name, fit(FAMILIES[name], WeightedRuns.of(grid(law, seed=seed), SLOW))) == ()


def test_turns_in_place_are_motions():
    """Between a left and a right turn in place, slips are in between those of the law."""
    law = Exponential(0.3, -1.0, 0.1, -1.0)
    omega = np.array(
        [[-5.0, 5.0], [-5.5, 5.0], [5.0, -5.0], [2.0, 5.0], [5.0, 3.0], [4.0, 5.0], [1.0, 5.0], [5.0, 2.0]]
    )
    twist = law.twist(omega, GEOMETRY) + 1e-3 * np.random.default_rng(0).standard_normal(omega.shape)
    samples = SlipSamples(omega, twist, track_slip(omega, twist, GEOMETRY), tuple("abcdefgh"))
    fits = fit(FAMILIES["exponential"], WeightedRuns.of(samples, GEOMETRY))
    assert fits.law.turns_in_place(omega, GEOMETRY)[0].any()
    assert not any("no motion" in why for why in unfollowed("exponential", fits))
