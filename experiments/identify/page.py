"""The page of an identification, and what the terminal shows."""

import shlex
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from markupsafe import Markup

from experiments.common.laws import symbol
from experiments.common.page import Answer, Bullets, Page, Plot, Section
from experiments.common.table import Table
from experiments.identify import figures, tables
from experiments.identify.turns import Turns
from trackslip.doubts import severity
from trackslip.errors import counted
from trackslip.identification.result import Identification
from trackslip.kinematics import RobotGeometry
from trackslip.slip.families import FAMILIES

INTRO = Markup(
    "The slip of a track is i = 1 − V / (r ω), where V is its true speed over the ground, r the sprocket radius and ω "
    "the sprocket speed: positive where the track is slower than commanded. In a turn of radius R, the <em>inner</em> "
    "track is on the side of the turning centre, the <em>outer</em> track on the other. “The paper” is Moosavian and "
    "Kalantari, <cite>Experimental Slip Estimation for Exact Kinematics Modeling and Control of a Tracked Mobile "
    "Robot</cite>, IROS 2008; its Eq. 11 is the slip law it published."
)
_STEADY = (
    "All laws are fitted to the same runs with the same weights and judged by the motion that sprocket speeds cause. "
    "Akaike's criterion (AICc) weighs the fit against the number of parameters: differences up to 2 mean nothing, "
    "above 10 they rule a law out. Cross-validation predicts runs that were left out of the fit. The best law is the "
    "simplest of those that predict left-out radii, and then left-out runs, as well as any other within one standard "
    "error or a thousandth of the speed."
)
_DRIVE = (
    "Every pose and every encoder reading counts. Estimated together are the trajectory, the law, where the sensor "
    "sits, the clock offset, and how large all errors are. Each law is fitted to a part of the driving and predicts "
    "the rest: from every measured pose, the sprocket speeds lead some seconds ahead. Errors include those of the "
    "measured poses at both ends, which no law can remove: where lines are flat, they are all that is left; where "
    "lines rise, the law is wrong or slip varies."
)
_SLIP = (
    "A slip law gives the slip of both tracks in a turn of radius R, and so how much faster or slower each sprocket "
    "has to turn for the robot to go where it should."
)


def page(found: Identification, title: str, command: str, manifest: Mapping[str, Any]) -> Page:
    """The page of an identification, made by `command` or in Python, where the manifest has no configuration."""
    sections = [whole_drives(found), steady_slip(found)]
    if found.method == "steady":
        sections.reverse()
    sections += [method(found), excluded_runs(found), notes(found.warnings)]
    return Page(title, command, manifest, sections, answer=_answer(found, manifest.get("config", {}).get("out")))


def _answer(found: Identification, out: str | None) -> Answer:
    """The best law, its parameters, what it gains, and what to do with it, if it is in a folder."""
    fit, parameters = found.fits()[found.best], FAMILIES[found.best].parameters
    facts = [("law", FAMILIES[found.best].title)]
    for name in fit.values:
        value, interval, *_ = tables.value_texts(fit, name)
        meaning = parameters[name].meaning
        facts.append((symbol(found.best, name), f"{value} (95 %: {interval})" + (f", {meaning}" if meaning else "")))
    why = tables.reason(found)
    lines = [tables.gain(found), f"Why {found.best}: {why}." if why else ""]
    if found.best in ("none", "constant"):
        lines.append("No law of turning describes this driving better.")
    commands = []
    if out:
        folder = shlex.quote(out)
        target = "ros2_control" if "ros2_control" in FAMILIES[found.best].targets else FAMILIES[found.best].targets[0]
        commands = [f"trackslip evaluate ANOTHER_LOG --law {folder}", f"trackslip deploy {folder} --to {target}"]
    return Answer(
        f"Best law: {found.best}", facts, [line for line in lines if line], loud_first(found.warnings), commands
    )


def loud_first(warnings: Iterable[str]) -> list[str]:
    """Alarms and doubts among some warnings, without remarks."""
    loud = {line: severity(line) for line in warnings}
    alarms = [f"Alarm: {line}" for line, kind in loud.items() if kind == "alarm"]
    return [*alarms, *(line for line, kind in loud.items() if kind not in ("alarm", "remark"))]


def notes(warnings: Iterable[str]) -> Section:
    """The remarks among some warnings."""
    remarks = [line for line in warnings if severity(line) == "remark"]
    return Section("Notes", [Bullets(remarks) if remarks else None])


def excluded_runs(found: Identification) -> Section:
    """Runs that gave no sample, or were left out of the fits."""
    rows = [(refused.run, refused.reason) for refused in found.outliers]
    return Section("Excluded runs", [Table("All of them", ("run", "why"), rows, "l") if rows else None], folded=True)


def method(found: Identification) -> Section:
    """What slip, laws and their parameters mean, and how the best law is chosen."""
    how = [_STEADY if found.steady is not None else None, _DRIVE if found.drive is not None else None]
    laws = {**(found.steady.laws if found.steady else {}), **(found.drive.laws if found.drive else {})}
    meaning = parameter_bullets(laws, found.geometry)
    return Section("Method", [INTRO, *how, "The parameters of the laws are:", meaning], folded=True)


def parameter_bullets(laws: Iterable[str], robot: RobotGeometry) -> Bullets:
    """The meaning of the parameters of some laws."""
    meanings = {p.symbol: p.meaning for law in laws for p in FAMILIES[law].parameters.values() if p.meaning}
    meanings["b"] = f"half the distance between the tracks' centre lines, {robot.half_gauge:g} m, which is not fitted"
    return Bullets([Markup("<strong>{}</strong>: {}.").format(*meaning) for meaning in meanings.items()])


def steady_slip(found: Identification) -> Section | None:
    """The slips of steady stretches and their laws; None if there are none."""
    comparison = found.steady
    if comparison is None:
        return None
    turns = Turns.of(comparison.samples, found.geometry)
    laws = speeds = None
    if len(turns):
        laws = Plot(
            "fig06_slip_laws",
            partial(figures.fitted_laws, turns, comparison),
            "Slip laws (the paper's Fig. 6)",
            "Slip against observed radius with every fitted law and the published one, which is not fitted. Thick: the "
            f"best law. {_error_bars(turns)}",
        )
        speeds = Plot(
            "fig05_slip_over_speed",
            partial(figures.slip_against_speed, turns),
            "Slip against speed (the paper's Fig. 5)",
            "One colour per observed radius: level rows show that slip does not depend on speed.",
        )
    names = [name for name, fit in comparison.laws.items() if fit.values]
    return Section(
        "Slip of steady stretches",
        [
            f"{_driven(len(comparison.samples), turns)} {_SLIP}",
            laws,
            tables.criteria_table(comparison, found.geometry),
            speeds,
            Section("Parameters of all laws", [tables.parameters_table(comparison, names)], folded=True),
        ],
    )


def _driven(runs: int, turns: Turns) -> str:
    """A sentence on the samples."""
    if not len(turns):
        return f"{counted(runs, 'run')}, all of them nearly straight."
    ends = (f"{end:.2f}" for values in (turns.radius, turns.speed) for end in (values.min(), values.max()))
    where = "at observed radii from {} to {} m and speeds from {} to {} m/s".format(*ends)
    straight = f", and {counted(runs - len(turns), 'nearly straight run')}" if runs > len(turns) else ""
    return f"{counted(len(turns), 'turn')} {where}{straight}, each with one mean slip per track."


def _error_bars(turns: Turns) -> str:
    if turns.slip_error is None or turns.radius_error is None:
        return "There are no error bars because the samples came without errors of measurement."
    slip, radius = np.median(turns.slip_error), np.median(turns.radius_error)
    return f"Bars are standard errors of measurement, typically {slip:.2g} in slip and {1e3 * radius:.2g} mm in radius."


def whole_drives(found: Identification) -> Section | None:
    """The laws of whole drives; None if they were not evaluated."""
    drive = found.drive
    if drive is None:
        return None
    fit = drive.laws[drive.best]
    duration = sum(float(each.time[-1] - each.time[0]) for each in drive.drives)
    driven = (
        f"{counted(len(drive.drives), 'drive')}, {duration:.0f} s, {counted(fit.poses, 'pose')}, without "
        f"{counted(fit.left_out, 'outlying pose')} and {counted(fit.breaks, 'lasting jump')}."
    )
    if found.method == "steady":
        driven += " Most of the driving was steady, so the laws above are the result; these are for comparison."
    errors = Plot(
        "drive_prediction_errors",
        partial(figures.prediction_errors, drive),
        "Errors of prediction",
        "Median errors against the time ahead, of driving that the laws were not fitted to. Thick: the best law.",
    )
    path = Plot(
        "drive_path",
        partial(figures.predicted_paths, found),
        "Path of the longest drive",
        "Measured positions, and where the robot should go from the black dots by its sprocket speeds alone: without "
        "slip, and by the best law.",
    )
    predicted = bool(drive.errors.get(drive.best))
    names = [name for name in drive.ranking if drive.laws[name].values]
    return Section(
        "Whole drives",
        [
            driven,
            *((errors, tables.prediction_table(drive)) if predicted else ()),
            path,
            tables.parameters_table(drive, names),
            *tables.held_lines(drive),
        ],
    )


def print_identification(found: Identification, reading: Sequence[str] = ()) -> None:
    """Print alarms, what was read from bags, the best law, how laws compare, and doubts."""
    for line in (*(f"ALARM: {alarm}" for alarm in found.alarms), *reading):
        print(line)
    if found.method == "drive" and found.drive is not None:
        tables.parameters_table(found.drive, [found.best]).print()
        if found.drive.errors.get(found.best):
            tables.prediction_table(found.drive).print()
        print("".join(f"{line}\n" for line in tables.held_lines(found.drive)), end="")
    else:
        tables.parameters_table(found.comparison, [found.best]).print()
        tables.criteria_table(found.comparison, found.geometry).print()
    for warning in found.warnings:
        if (kind := severity(warning)) != "alarm":
            print(f"{'note' if kind == 'remark' else 'warning'}: {warning}")
    if why := tables.reason(found):
        print(why)
    print(f"best: {found.best}, {FAMILIES[found.best].title}")
