"""Tables of how many courses controllers cross."""

from __future__ import annotations

from experiments.measuring.crossing import POLICY, SCRIPTED, CrossingGain, CrossingRate
from experiments.report.formats import number

CROSSING_HEADER = ("controller", "difficulty", "crossed [%]", "95 % interval", "tipped", "stuck", "other", "time [s]")


def crossing_row(one: CrossingRate) -> tuple[str, ...]:
    """Cells of one rate."""
    interval = f"{100 * one.low:.1f} to {100 * one.high:.1f}"
    counts = str(one.tipped), str(one.stuck), str(one.other)
    return one.controller, f"{one.difficulty:.3g}", f"{100 * one.rate:.1f}", interval, *counts, number(one.time, 1)


def gain_text(gain: CrossingGain) -> str:
    """A sentence on the difference."""
    rate = f"{100 * gain.gain:+.1f} points, 95 % interval {100 * gain.low:+.1f} to {100 * gain.high:+.1f}"
    alone = f"{gain.only_policy} courses are crossed by the {POLICY} alone, {gain.only_scripted} by the {SCRIPTED} one"
    return f"{POLICY} - {SCRIPTED}: {rate}; {alone}"
