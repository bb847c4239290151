"""Pads of the tracks: capsules along the direction of travel, which touch the ground at two points or at one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from sim.width import WIDEST
from trackslip.kinematics import SIDES, Array

_TILT = np.radians(45.0)  # of a pad with one point: its lower end touches, and its axis still gives the directions
_LENGTH = 0.02  # between the ends of such a pad [m]
_POINTS, _GROWTH = 10, 1.6  # points of a track as long as the gauge, and the power of the gauge with which they grow
_ENOUGH = 1.2  # gauge over contact length up to which those of a track as long as the gauge will do [-]
_SHEARING = 4  # points of a wheel's patch on shearing ground
_CALMER = 25.0  # tracks' load shifted to points that slide, over wheels', at most [-]
_FASTER = 2.0  # grip of wide tracks over that of others [-]


def points_per_track(half_gauge: float, contact_length: float) -> int:
    """Even number of points at which a track of this size touches the ground [-].

    The ICRs of a short, wide robot are so close to its tracks that only the elements of track within a few
    millimetres of its middle slide along themselves more than across: the wider the robot, the finer its points.
    Beyond WIDEST there are no more.
    """
    width = min(2 * half_gauge / contact_length, WIDEST)
    return _POINTS if width <= _ENOUGH else 2 * math.ceil(_POINTS * width**_GROWTH / 2)


def lay_wheels(spec: Any, axles: Sequence[float], patch_length: float) -> None:
    """Replace the pads of a model by one under each wheel, whose two points spread as a uniform patch does.

    Wheels don't press harder where they slide faster by as much as tracks do, for their robots are faster; impratio
    makes up for it, so that creep is the same. The more axles, the less so, as the engine knows no softer points than
    those of shearing ground then are.
    """
    from sim.tracks.presets import LEAST_ODDS  # late: MuJoCo takes 0.1 s

    chassis = spec.body("chassis")
    pads = [geom.name for geom in chassis.geoms if "_pad" in geom.name]  # as many as a side has points
    odds = _odds(next(pair for pair in spec.pairs if pair.geomname2 == pads[0])) * len(pads)
    calmer = min(_CALMER, odds / (_SHEARING * len(axles)) / LEAST_ODDS)
    lay_pads(spec, at=_in_patches(axles, patch_length, np.array([-1, 1]) / math.sqrt(12)), calmer=calmer)
    spec.option.impratio *= calmer
    for site in (site for site in chassis.sites if "_footprint" in site.name):
        site.size[0] = np.abs(axles).max() + patch_length


def shearing_points(axles: Sequence[float], patch_length: float) -> Array:
    """Points of a side under wheels as shearing ground needs them: the middles of equal segments [m]."""
    return _in_patches(axles, patch_length, (np.arange(_SHEARING) + 0.5) / _SHEARING - 0.5)


def _in_patches(axles: Sequence[float], patch_length: float, share: Array) -> Array:
    """Points of a side at the same shares of the patch under each axle [m]."""
    return np.asarray(np.add.outer(axles, patch_length * share).ravel())


def lay_wide_tracks(spec: Any, points: int) -> None:
    """Replace the pads of a model by more, with `points` a track.

    They grip faster: near the middle of a short track the time that the grip takes, at the speed of the robot, is a way
    that counts.
    """
    lay_pads(spec, points, faster=_FASTER)


def lay_pads(
    spec: Any,
    points: int | None = None,
    single: bool = False,
    at: Array | None = None,
    faster: float = 1.0,
    calmer: float = 1.0,
) -> None:
    """Replace the pads of a model by others that touch the ground at `points` points a track.

    The points are the middles of equal segments of the tracks, by default as many as before, unless those of a side
    are `at` given places [m]; a pad has two of them, unless it is `single`. All points together carry the robot at the
    same depth, and creep as slowly, as before. `faster` and `calmer` are for `_softer`.
    """
    chassis = spec.body("chassis")
    pads = [geom for geom in chassis.geoms if "_pad" in geom.name]
    pairs = {pair.geomname2: pair for pair in spec.pairs}
    ends = np.concatenate([np.reshape(pad.fromto, (2, 3)) for pad in pads])
    old, like, (_, half_gauge, height) = len(ends) // 2, pads[0], np.abs(ends[0])
    x = _spread(ends[:, 0].min(), ends[:, 0].max(), old, points or old) if at is None else at
    softer = _softer(pairs[like.name], old / len(x), faster, calmer)
    raised = _LENGTH * np.array([np.cos(_TILT), 0.0, np.sin(_TILT)])
    for side, y in zip(("left", "right"), half_gauge * -SIDES, strict=True):
        place = np.stack([x, np.full_like(x, y), np.full_like(x, height)], axis=1)
        spans = np.hstack([place, place + raised]) if single else place.reshape(-1, 6)
        for k, span in enumerate(spans):
            name, size = f"{side}_pad{k}_of{len(spans)}", [like.size[0], 0.0, 0.0]
            unseen = {"mass": 0.0, "contype": 0, "conaffinity": 0, "group": like.group}
            chassis.add_geom(name=name, type=like.type, size=size, fromto=span, **unseen)
            pair = pairs[like.name]
            spec.add_pair(
                geomname1=pair.geomname1, geomname2=name, condim=pair.condim, friction=pair.friction, **softer
            )
    for pad in pads:
        spec.delete(pairs[pad.name])
        spec.delete(pad)


def _spread(first: float, last: float, old: int, new: int) -> Array:
    """Middles (new,) of equal segments of the track on which `old` of them are from `first` to `last` [m]."""
    if new == old:
        return np.linspace(first, last, old)
    half = (last - first) / 2 * old / (old - 1)
    return np.asarray((first + last) / 2 + half * ((2 * np.arange(new) + 1) / new - 1))


def _softer(pair: Any, share: float, faster: float, calmer: float) -> dict[str, Any]:
    """Contact parameters for `share` of the load of a pair, and a grip that is so many times `faster`.

    The impedance falls by both, and by how much `calmer` the loads of points are to be where these slide. Stiffness,
    damping and the rate of the grip are all multiplied by the impedance, which doesn't change with depth.
    """
    impedance, odds = pair.solimp[0], _odds(pair) * share / (faster * calmer)
    scaled = odds / (1 + odds)
    factor = faster * scaled / impedance
    solref, solreffriction, solimp = (np.array(getattr(pair, n)) for n in ("solref", "solreffriction", "solimp"))
    solimp[:2] = scaled
    solreffriction[1] *= factor
    return {"solref": solref * (factor * calmer), "solreffriction": solreffriction, "solimp": solimp}


def _odds(pair: Any) -> float:
    """Impedance d of a pair as d / (1 - d), which points share."""
    return float(pair.solimp[0] / (1 - pair.solimp[0]))
