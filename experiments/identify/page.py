"""The page on an identification, and its tables on the terminal."""

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any, Final

from markupsafe import Markup

from experiments.common.page import Bullets, Page, Plot, Section
from experiments.identify import figures, tables
from experiments.identify.card import card
from experiments.identify.turns import Turns
from trackslip.errors import counted
from trackslip.identification.comparison import Comparison
from trackslip.identification.result import Identification
from trackslip.kinematics import RobotGeometry
from trackslip.laws.families import FAMILIES

INTRO: Final = Markup(
    "The slip of a track is i = 1 − V / (r ω), where V is its true speed over the ground, r the "
    "sprocket radius and ω "
    "the sprocket speed: positive where the track is slower than commanded. In a turn of radius "
    "R, the <em>inner</em> "
    "track is on the side of the turning centre, the <em>outer</em> track on the other. “The "
    "paper” is Moosavian and "
    "Kalantari, <cite>Experimental Slip Estimation for Exact Kinematics Modeling and Control of "
    "a Tracked Mobile "
    "Robot</cite>, IROS 2008; its Eq. 11 is the slip law it published."
)
_SHOWN: Final = 3  # number of laws that are drawn, the best first; the others are folded
_STEADY: Final = (
    "All laws are fitted to the same runs and judged by the motion that sprocket speeds cause. "
    "The best law is the "
    "simplest of those that predict left-out radii, and then left-out runs, as well as any other "
    "within one standard "
    "error or a thousandth of the speed."
)
_DRIVE: Final = (
    "The poses are cut into windows. In each window, the path that the belts drive under a law "
    "is aligned with the "
    "poses; the fit chooses the law's parameters, the sensor's place and the clock so that the "
    "remaining errors are "
    "smallest. Prediction errors refer to driving that the law was not fitted to, and include "
    "the errors of the "
    "measured poses at both ends, which no law can remove."
)
_SLIP: Final = (
    "A slip law gives the slip of both tracks in a turn of radius R, and so how much faster or "
    "slower each sprocket "
    "has to turn for the robot to go where it should."
)


def page(
    result: Identification,
    title: str,
    command: str,
    manifest: Mapping[str, Any],
    taken: Sequence[str] = (),
) -> Page:
    """The page on an identification, made by `command` or, if the manifest has no configuration, in
    Python.

    `taken` lists what was read from bags.
    """
    sections = [whole_drives(result), steady_slip(result)]
    if result.method == "steady":
        sections.reverse()
    sections += [method(result), notes(result.warnings)]
    answer = card(result, manifest.get("config", {}).get("out"), taken)
    return Page(title, command, manifest, sections, answer=answer)


def notes(warnings: Sequence[str]) -> Section:
    """The section with notes on data that was left out, and other warnings."""
    return Section("Notes", [Bullets(warnings) if warnings else None], folded=True)


def method(result: Identification) -> Section:
    """The section that explains slip, the laws and their parameters, and the choice of the best
    law.
    """
    how = [
        _STEADY if result.steady is not None else None,
        _DRIVE if result.drive is not None else None,
    ]
    laws = {
        **(result.steady.laws if result.steady else {}),
        **(result.drive.laws if result.drive else {}),
    }
    meaning = parameter_bullets(laws, result.geometry)
    return Section("Method", [INTRO, *how, "The parameters of the laws are:", meaning], folded=True)


def parameter_bullets(laws: Iterable[str], robot: RobotGeometry) -> Bullets:
    """The meanings of the laws' parameters, as a list."""
    meanings = {
        p.symbol: p.meaning for law in laws for p in FAMILIES[law].parameters.values() if p.meaning
    }
    meanings["b"] = (
        f"half the distance between the tracks' centre lines, {robot.half_gauge:g} m, which is "
        "not fitted"
    )
    return Bullets(
        [Markup("<strong>{}</strong>: {}.").format(*meaning) for meaning in meanings.items()]
    )


def steady_slip(result: Identification) -> Section | None:
    """The section on the slips in steady stretches and their laws; None if there are no steady
    stretches.
    """
    comparison = result.steady
    if comparison is None:
        return None
    turns = Turns.of(comparison.samples, result.geometry)
    best, others = _best_and_others(comparison)
    laws = speeds = all_laws = None
    if len(turns):
        laws = Plot(
            "fig06_slip_laws",
            partial(figures.fitted_laws, turns, comparison, best),
            "Slip laws (the paper's Fig. 6)",
            f"Slip against observed radius with {_laws_drawn(best, others)} and the published one, "
            "which is not fitted. Thick: the best law. Bars: standard errors of measurement, where "
            "they are known.",
        )
        all_laws = Plot(
            "all_slip_laws",
            partial(figures.fitted_laws, turns, comparison, [*best, *others]),
            "All slip laws",
            "Slip against observed radius with every fitted law and the published one.",
        )
        speeds = Plot(
            "fig05_slip_over_speed",
            partial(figures.slip_against_speed, turns),
            "Slip against speed (the paper's Fig. 5)",
            "One colour per observed radius: level rows show that slip does not depend on speed.",
        )
    return Section(
        "Slip of steady stretches",
        [
            f"{_driven(len(comparison.samples), turns)} {_SLIP}",
            laws,
            tables.criteria_table(comparison, result.geometry),
            speeds,
            tables.parameters_table(comparison, best),
            _folded("Other laws of steady stretches", comparison, others, all_laws),
        ],
        folded=result.method == "drive",
    )


def _best_and_others(comparison: Comparison) -> tuple[list[str], list[str]]:
    """Names of the laws that are shown, the best first, and of those that are folded."""
    names = [*comparison.laws]
    return names[:_SHOWN], names[_SHOWN:]


def _laws_drawn(best: Sequence[str], others: Sequence[str]) -> str:
    """The laws in a figure, in words."""
    return f"the {len(best)} best laws" if others else "every fitted law"


def _folded(
    heading: str, comparison: Comparison, others: Sequence[str], plot: Plot | None
) -> Section | None:
    """The folded section on the laws that aren't among the best; None if there are none."""
    if not others:
        return None
    return Section(heading, [plot, tables.parameters_table(comparison, others)], folded=True)


def _driven(runs: int, turns: Turns) -> str:
    """A sentence on the number of samples, and their radii and speeds."""
    if not len(turns):
        return f"{counted(runs, 'run')}, all of them nearly straight."
    radii = f"{turns.radius.min():.2f} to {turns.radius.max():.2f} m"
    speeds = f"{turns.speed.min():.2f} to {turns.speed.max():.2f} m/s"
    where = f"at observed radii from {radii} and speeds from {speeds}"
    straight = runs - len(turns)
    others = f", and {counted(straight, 'nearly straight run')}" if straight > 0 else ""
    return f"{counted(len(turns), 'turn')} {where}{others}, each with one mean slip per track."


def whole_drives(result: Identification) -> Section | None:
    """The section on the laws from whole drives; None if whole drives were not evaluated."""
    drive = result.drive
    if drive is None:
        return None
    fit = drive.laws[drive.best]
    duration = sum(float(each.time[-1] - each.time[0]) for each in drive.look.drives)
    driven = (
        f"{counted(len(drive.look.drives), 'drive')}, {duration:.0f} s, "
        f"{counted(fit.poses, 'pose')}."
    )
    if result.method == "steady":
        driven += (
            " Most of the driving was steady, so its laws are the result; these are for comparison."
        )
    best, others = _best_and_others(drive)
    ahead = f"the next {figures.AHEAD:g} s"
    path = Plot(
        "drive_path",
        partial(figures.predicted_paths, result, best),
        "Path of the longest drive",
        f"Measured positions, and where the robot should go in {ahead} from the black dots by its "
        f"sprocket speeds alone: without slip (none), and by {_laws_drawn(best, others)}.",
    )
    all_paths = Plot(
        "drive_path_all_laws",
        partial(figures.predicted_paths, result, [*best, *others]),
        "Path of the longest drive, by all laws",
        "A click on a law in the legend hides it.",
    )
    has_errors = drive.errors.get(drive.best)
    return Section(
        "Whole drives",
        [
            driven,
            path,
            *(tables.prediction_tables(drive) if has_errors else ()),
            tables.parameters_table(drive, best),
            _folded("Other laws of whole drives", drive, others, all_paths),
        ],
        folded=result.method == "steady",
    )


def print_all(result: Identification) -> None:
    """Print the tables for every law, and all notes."""
    if result.method == "drive" and result.drive is not None:
        tables.parameters_table(result.drive).print()
        if result.drive.errors.get(result.best):
            for table in tables.prediction_tables(result.drive):
                table.print()
    else:
        tables.parameters_table(result.comparison).print()
        tables.criteria_table(result.comparison, result.geometry).print()
    for warning in result.warnings:
        print(f"note: {warning}")
