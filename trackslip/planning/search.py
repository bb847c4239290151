"""Search for the route whose drive determines a law best."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.optimize

from trackslip.kinematics import Array
from trackslip.planning.route import MOST_BOW, WAYPOINTS, Route

_POPULATION = 40
_SHARES, _PAIRS = (0.25, 0.35, 0.45, 0.55), (2, 3, 4, 6)  # of spins in the lines that it begins with
_LAST = len(WAYPOINTS) - 1
_GENES = np.array(
    [  # lowest and highest value of each field of a route, and whether it is a whole number
        (0, _LAST, True),
        (0, _LAST, True),
        (0, 1, True),
        (0, 1, True),
        (-MOST_BOW, MOST_BOW, True),
        (-MOST_BOW, MOST_BOW, True),
        (0.02, 0.6, False),
        (1, 12, True),
        (0.2, 1.0, False),
        (0.0, 1.0, False),
        (0.0, 0.05, False),
    ]
)


def best_route(cost: Callable[[Route], float], evaluations: int, rng: np.random.Generator) -> tuple[Route, float]:
    """The best of about so many routes, and its cost, by differential evolution (Storn and Price, 1997).

    It begins with lines along the diagonal, with several shares and numbers of spins, and random routes.
    """
    low, high, whole = _GENES.T
    first = rng.uniform(low, high, (_POPULATION, len(_GENES)))
    lines = [(0, _LAST, 0, 1, 0, 0, share, pairs, 1.0, 0.5, 0.01) for share in _SHARES for pairs in _PAIRS]
    first[: len(lines)] = lines
    first = np.where(whole == 1, np.round(first), first)
    found = scipy.optimize.differential_evolution(
        lambda genes: cost(_route(genes)),
        _GENES[:, :2],
        integrality=whole == 1,
        init=first,
        maxiter=max(0, evaluations // _POPULATION - 1),
        polish=False,
        tol=0.0,
        rng=rng,
    )
    return _route(found.x), float(found.fun)


def _route(genes: Array) -> Route:
    start, end, *legs, spinning, pairs, size, ends, shrink = genes.tolist()
    backwards, bow = (bool(legs[0]), bool(legs[1])), (int(legs[2]), int(legs[3]))
    return Route(int(start), int(end), backwards, bow, spinning, int(pairs), size, ends, shrink)
