"""Kinds of doubts about logs and laws, in one table: their words, how loud they are, and whether a user can insist."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from trackslip.errors import LogError, counted

Severity = Literal["alarm", "doubt", "remark"]
Accepted = Literal["headings", "outliers", "short", "signs", "units", "unsteady"]
"""What a user can insist on although it looks wrong."""
ACCEPTED: tuple[str, ...] = get_args(Accepted)
MANY = 0.1
"""Share of runs or poses left out that is an alarm, and of the runs that tell a unit."""


@dataclass(frozen=True)
class Kind:
    """A kind of doubt."""

    text: str
    """To be formatted."""
    accept: Accepted | None = None
    """The word with which a user insists on what it refuses."""
    severity: Severity = "doubt"


_UNITS = "check the units (rad/s, m, rad, s), the gear and sprocket_radius = {radius:g} m"
_SWAPPED = "are the tracks swapped, does phi run clockwise, or do the encoders count backwards?"
KINDS = {
    # runs and drives that are left out
    "": Kind("{reason}"),
    "unusable": Kind("{reason}"),
    "headings": Kind("column phi: headings don't fit the path", "headings"),
    "short": Kind("{poses} while it drives, needs at least {least}", "short"),
    "still": Kind("the sprockets stand still"),
    "brief": Kind("{why}"),
    "unsteady": Kind(
        "its sprockets are steady from {begin:.12g} s to {end:.12g} s, but its motion is not: v changes by {v:+.3g} "
        "m/s and w by {w:+.3g} rad/s from the first half to the second",
        "unsteady",
    ),
    "outlier": Kind(
        "its motion deviates by {far:.3g} of its speed from what fits the other runs, which scatter by {scatter:.2g}",
        "outliers",
    ),
    "slip": Kind("slip {slip:.3g} of the faster track is implausible (over {most}): " + _UNITS, "units"),
    "ways": Kind("the poses {wrong} as the sprockets drive: " + _UNITS, "units"),
    "hopeless": Kind("the drives hardly determine the law: {why}", "units"),
    "encoder": Kind(
        "its {side} track moves at {v:+.3g} m/s where its sprocket says {says:+.3g} m/s: does its encoder count "
        "backwards?",
        "signs",
    ),
    "turn": Kind("it turns at {w:+.3g} rad/s where its sprockets say {says:+.3g} rad/s: " + _SWAPPED, "signs"),
    "against": Kind("the robot turns against its sprockets: " + _SWAPPED, "signs"),
    "mirrored": Kind("the robot turns as if the encoder of the {side} sprocket counted backwards: does it?", "signs"),
    "backwards": Kind(
        "the robot moves backwards where its sprockets drive forwards: are both encoders swapped and reversed, or does "
        "phi point backwards?",
        "signs",
    ),
    # runs that are used in part
    "gap": Kind("its clock has a gap from t = {begin:.12g} s to {end:.12g} s"),
    "jump": Kind("its pose jumps by {size} at t = {time:.12g} s{stays}"),
    "part": Kind("steady, and used, from {begin:.12g} s to {end:.12g} s only"),
    "rows": Kind("{note}"),
    # laws
    "left out": Kind("{what} left out ({share:.0f} %), so the laws hold for the rest alone: {why}", severity="alarm"),
    "halves": Kind(
        "law {law} contradicts itself: intervals of the first and of the second half of the driving exclude each "
        "other, {what}: did ground, load or clocks change, or is the law wrong?",
        severity="alarm",
    ),
    "little": Kind("the driving shows too little: {what}", severity="alarm"),
    "held": Kind("{name} is held at {value:g}: {why}"),
    "rough": Kind("law {law}: the fit to whole drives did not converge, so its values and errors are rough"),
    "wild": Kind("law {law}: {what}"),
    "alike": Kind("the covariances of the poses don't tell how they scatter: all poses count alike"),
    "breaks": Kind("{what} of the poses left out: lasting jumps, or slip out of all proportion"),
    "misses": Kind(
        "law {law}: it misses the samples by {by:.2g} rms, more than they scatter (lack of fit), so its intervals are "
        "widened"
    ),
    "inside": Kind(
        "law {law}: {name} = {value:.1f} ± {error:.2g} mm is negative, but tracks that skid have their ICRs outside: "
        "is half_gauge right, do the poses turn too far, or does the sensor sit off the middle (--sensor X Y YAW, or "
        "--estimate-sensor)?"
    ),
    "far": Kind(
        "law {law}: {name} = {value:+.0%}, so the robot goes {times:.2g} times as far as its sprockets drive, which is "
        "possible on ice; elsewhere, are gear and sprocket_radius right?"
    ),
    "sides": Kind(
        "law icr_sides: D_left and D_right differ by {differ}: the sensor may sit {sits} of the middle (--sensor X Y "
        "YAW, or --estimate-sensor); an offset and unequal ICRs can't be told apart"
    ),
    "unequal": Kind(
        "left and right turns differ: {law} describes both, the other laws assume symmetry", None, "remark"
    ),
    "sensor": Kind("{what}; the law allows for it", None, "remark"),
}
"""All kinds, by name."""


class Doubt(str):
    """A line that knows its kind, the run that it is about, and a guess at the cause, which may be wrong."""

    kind, run, reason, guess, left_out = "", "", "", "", False

    @classmethod
    def about(cls, run: str, kind: str, reason: str, guess: str = "", left_out: bool = False, of: str = "") -> Doubt:
        """The line on a run, or on several that are described by `of`, or on everything if `run` is ""."""
        accept, subject = KINDS[kind].accept, of or f"run {run!r}{' left out' * left_out}"
        doubt = cls(
            f"{subject}: " * (run != "") + reason + guess + f" (--accept {accept} insists)" * (accept is not None)
        )
        doubt.kind, doubt.run, doubt.reason, doubt.guess, doubt.left_out = kind, run, reason, guess, left_out
        return doubt


def doubt(kind: str, run: str = "", guess: str = "", **values: object) -> Doubt:
    """A doubt in the words of the table, with values."""
    return Doubt.about(run, kind, KINDS[kind].text.format(**values), guess)


def refuse(kind: str, accept: Collection[str] = (), run: str = "", guess: str = "", **values: object) -> None:
    """Raise LogError for a doubt, unless the user insists."""
    if KINDS[kind].accept not in accept:
        raise LogError(doubt(kind, run, guess, **values))


def severity(line: str) -> Severity:
    """How loud a line is."""
    return KINDS[getattr(line, "kind", "")].severity


def in_few_lines(lines: Iterable[str], runs: int) -> tuple[str, ...]:
    """A line for each kind of doubt about `runs` runs, alarms first.

    Guesses are told if all agree and more than a few runs make them. It is an alarm if many runs are left out.
    """
    every = [line if isinstance(line, Doubt) else Doubt(line) for line in lines]
    guesses = [one.guess for one in every if one.guess]
    known = len(set(guesses)) == 1 and len(guesses) > MANY * runs
    groups: dict[str, list[Doubt]] = {}
    for one in every:
        groups.setdefault(one.kind or one, []).append(one)
    found = [joined(group, runs, known) for group in groups.values()]
    lost = {one.run for one in every if one.left_out and one.kind != "still"}
    if len(lost) > MANY * runs:
        what = f"{len(lost):,} of {counted(runs, 'run')}"
        found.append(doubt("left out", what=what, share=100 * len(lost) / runs, why="see the warnings"))
    return tuple(sorted(found, key=lambda line: severity(line) != "alarm"))


def joined(group: Sequence[Doubt], runs: int, known: bool) -> Doubt:
    """One line for doubts of a kind; guesses are left out unless they are `known`."""
    first, of = group[0], ""
    if not first.run:
        return first
    if len(group) > 1:
        many = "left out" if first.left_out else f"({len(group)} times)"
        some = len({one.run for one in group})
        of = (
            f"run {first.run!r} {many}"
            if some == 1
            else f"{some:,} of {counted(runs, 'run')} {many}, such as {first.run!r}"
        )
    return Doubt.about(first.run, first.kind, first.reason, first.guess * known, first.left_out, of)
