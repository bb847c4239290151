"""References on smooth curves: figure of eight, slalom, spiral."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from trackslip.errors import require, require_positive
from trackslip.kinematics import Array
from trackslip.trajectory.path import Complex, ParametricPath, require_length
from trackslip.trajectory.profile import LIMITS, MotionLimits, ProfiledReference


def figure_eight(start: ArrayLike, half_width: float = 1.5, limits: MotionLimits = LIMITS) -> ProfiledReference:
    """Once around Bernoulli's lemniscate, from its crossing: first the left turn, then the right one.

    Args:
        start: pose (3,) at the crossing; the long axis lies 45 deg to the left of its heading.
        half_width: distance from the crossing to either tip [m]; the smallest radius is a third of it.
    """
    require_positive("half_width", half_width)

    def lemniscate(u: Array, nu: int) -> Complex:
        sine, cosine = np.sin(u), np.cos(u)
        away = 1 - 1j * sine
        factor = (cosine / away, 1j * (1 + 1j * sine) / away**2, -cosine * (3 + 1j * sine) / away**3)[nu]
        return half_width * factor

    return ProfiledReference(ParametricPath(lemniscate, [-np.pi / 2, np.pi / 2, 3 * np.pi / 2], start), limits)


def slalom(
    start: ArrayLike, amplitude: float = 0.25, wavelength: float = 2.0, periods: int = 2, limits: MotionLimits = LIMITS
) -> ProfiledReference:
    """A sine wave about a line, from one of its minima, first to the left.

    Args:
        start: pose (3,), along the line.
        amplitude: half the width [m]; the smallest radius is (wavelength / 2 pi)^2 / amplitude.
        wavelength: of the sine [m].
        periods: number of periods, at least 1.
    """
    require_positive("amplitude", amplitude)
    require_positive("wavelength", wavelength)
    require(periods >= 1, "periods", periods, "at least 1")
    require_length(periods * wavelength)
    wave = 2 * np.pi / wavelength

    def wave_line(x: Array, nu: int) -> Complex:
        sine, cosine = np.sin(wave * x), np.cos(wave * x)
        rise = (1 - cosine, wave * sine, wave**2 * cosine)[nu]
        return (x, 1.0, 0.0)[nu] + 1j * amplitude * rise

    return ProfiledReference(ParametricPath(wave_line, wavelength * np.arange(periods + 1), start), limits)


def spiral(
    start: ArrayLike,
    outer_radius: float = 1.2,
    inner_radius: float = 0.45,
    turns: float = 1.5,
    limits: MotionLimits = LIMITS,
) -> ProfiledReference:
    """Archimedes' spiral, inwards to the left: the radius decreases linearly with the angle.

    Args:
        start: pose (3,) at its outer end.
        outer_radius: distance to the centre at the start [m].
        inner_radius: distance to the centre at the end [m].
        turns: number of turns about the centre, at most 50.
    """
    require_positive("inner_radius", inner_radius)
    wider = inner_radius < outer_radius < np.inf
    require(wider, "outer_radius", outer_radius, f"greater than inner_radius = {inner_radius:g} m")
    require(0 < turns <= 50, "turns", turns, "greater than 0, at most 50")
    end = 2 * np.pi * turns
    shrinkage = (outer_radius - inner_radius) / end

    def archimedes(u: Array, nu: int) -> Complex:
        radius = outer_radius - shrinkage * u
        return (radius, 1j * radius - shrinkage, -radius - 2j * shrinkage)[nu] * np.exp(1j * u)

    return ProfiledReference(ParametricPath(archimedes, np.linspace(0, end, int(4 * turns) + 2), start), limits)
