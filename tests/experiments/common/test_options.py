import re
from dataclasses import dataclass
from typing import Annotated, ClassVar

import pytest

from experiments.common.options import (
    Distinct,
    Excludes,
    Needs,
    NonNegative,
    Options,
    Positive,
    Whole,
    Within,
)
from trackslip.errors import InvalidValueError

NAN = float("nan")
INF = float("inf")


@dataclass(frozen=True)
class Config(Options):
    speed: Annotated[float, Within(0.1, 2.0, "m/s")] = 0.3
    radii: Annotated[tuple[float, ...], Positive(3.0, "m")] = (1.0,)
    noise: Annotated[float | None, NonNegative()] = None
    jobs: Annotated[int, Whole(1, 8)] = 1
    seeds: Annotated[tuple[int, ...], Distinct("seed")] = (0,)
    method: str = "arc"
    bag: bool = False
    exclusions: ClassVar = (Excludes(("noise",), "method", ("paper",)), Needs(("jobs",), "bag"))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        *(({"speed": speed}, "must be from 0.1 to 2 m/s") for speed in (0.0, 2.1, NAN)),
        *(({"radii": (1.0, radius)}, "radii = ") for radius in (0.0, -1.0, 3.1, NAN, INF)),
        *(({"noise": noise}, "noise = ") for noise in (-1.0, NAN, INF)),
        *(({"jobs": jobs, "bag": True}, "must be an integer from 1 to 8") for jobs in (0, 9)),
        ({"seeds": ()}, "seeds = (): must be at least one seed"),
        ({"seeds": (1, 1)}, "seeds = (1, 1): must be all different"),
        ({"noise": 0.1, "method": "paper"}, "noise = 0.1: must be left out with --method paper"),
        ({"jobs": 2}, "jobs = 2: must be left out without --bag"),
    ],
)
def test_what_is_out_of_bounds_or_without_effect_is_refused(given, message):
    with pytest.raises(InvalidValueError, match=re.escape(message)):
        Config(**given)


def test_what_is_within_bounds_is_taken():
    for given in (
        {"speed": 2.0, "radii": (3.0, 0.1), "noise": 0.0},
        {"jobs": 8, "bag": True, "method": "paper"},
    ):
        config = Config(**given)
        assert {name: getattr(config, name) for name in given} == given
