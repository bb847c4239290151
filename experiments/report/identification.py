"""Laws identified from steady runs: their tables, their part of a page, and the page of an identification."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from markupsafe import Markup

from experiments.driving.paper_model import geometry_of
from experiments.measuring.inner_outer import InnerOuterSamples
from experiments.measuring.sightings import Sightings, sightings
from experiments.measuring.value_groups import is_narrow, repeated, value_groups
from experiments.report.drives import whole_drives
from experiments.report.figures import laws as law_figures
from experiments.report.figures import steady_runs as figures
from experiments.report.figures.localization import error_against_viewing_angle
from experiments.report.figures.slip_under_load import slip_under_load
from experiments.report.formats import MISSING, number, significant
from experiments.report.laws import SYMBOLS, digits_for, law_cell, parameter_bullets, shown, unit_of
from experiments.report.page import Block, Bullets, Page, Plot, Section, warnings
from experiments.report.table import Cell, Table
from trackslip.identification.comparison import Comparison
from trackslip.identification.fitted import FittedLaw
from trackslip.identification.replicates import LackOfFit
from trackslip.identification.result import Identification
from trackslip.identification.weighting import relative_errors
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog
from trackslip.metrics import rms
from trackslip.slip.exponential import PUBLISHED

INTRO = Markup(
    "A tracked robot turns by driving its tracks at different speeds, and the tracks slip. The slip of a track is "
    "i = 1 − V / (r ω), where V is its true speed over the ground, r the sprocket radius and ω the sprocket speed: "
    "positive where the track is slower than commanded. In a turn, the <em>inner</em> track is on the side of the "
    "turning centre, the <em>outer</em> track on the other; in a left turn the inner track is the left one. R is the "
    "radius of the path. “The paper” is Moosavian and Kalantari, <cite>Experimental Slip Estimation for Exact "
    "Kinematics Modeling and Control of a Tracked Mobile Robot</cite>, IROS 2008; its Eq. 11 is the slip law it "
    "published."
)
_BASELINES = ("none", "constant")
_LAW_HEADER = ("law", "parameter", "value ± std. error", "95 % interval", "by bootstrap")
_LAW_NOTE = (
    "The standard error is the scatter of the value over repeated measurements. The 95 % interval holds all values "
    "with which the law describes the samples nearly as well as at its best (the likelihood profile) and need not be "
    "symmetric. The bootstrap interval comes from fits to resampled runs; where the two differ, trust the wider one."
)
_CRITERIA_HEADER = (
    *("law", "free", "rms", "AICc", "weight", "cv radius", "cv speed", "cv run"),
    *("cv v [mm/s]", "cv w [mrad/s]", "lack of fit"),
)
_CRITERIA_NOTE = (
    "free: fitted parameters. rms: residual of the fit. AICc: above the least. cv: cross-validation, the rms error of "
    "predicting left-out radii, speeds or runs; v and w: of the robot's speed and yaw rate at left-out radii. A dash "
    "means too few runs, radii or speeds. The published law is not fitted; its residual is its distance from these "
    "samples."
)
_TESTS = {
    "F": "Lack of fit, F: misfit of the law relative to the scatter of runs with the same commanded radius, about 1 "
    "if the law is true. ",
    "chi2": "Lack of fit, χ²: squared residuals in units of the errors of measurement, about the number in brackets "
    "if the law is true. ",
}
_CERTAIN = 0.001  # probabilities below this are printed as an upper limit


def page(found: Identification, title: str, command: str, manifest: Mapping[str, Any]) -> Page:
    """The page of an identification."""
    sections = [measured_slip(found), whole_drives(found), *remarks(found)]
    return Page(title, command, manifest, sections, [INTRO])


def law_table(found: Identification) -> Table:
    """The parameters of the fitted laws, simple ones first, and of the published one."""
    comparison = found.comparison
    rows: list[tuple[str | Cell, ...]] = []
    for name, law in comparison.laws.items():
        parameters = [_parameter(law, key) for key in law.values]
        rows += _of_law(law_cell(name, best=name == comparison.best), parameters)
    published = [
        (SYMBOLS[key], f"{value:g} {unit_of('exponential', key)[1]}".rstrip().replace("-", "−"), MISSING, MISSING)
        for key, value in vars(PUBLISHED).items()
    ]
    rows += _of_law(law_cell("published"), published)
    return Table(f"Slip laws from {len(found.samples)} steady samples", _LAW_HEADER, rows, "llr", _LAW_NOTE)


def _of_law(law: Cell, parameters: Sequence[tuple[str, ...]]) -> Iterator[tuple[str | Cell, ...]]:
    for k, cells in enumerate(parameters):
        yield (law if k == 0 else "", *cells)


def criteria_table(found: Identification) -> Table:
    """The fitted laws by AICc, the best one first; the published one last."""
    comparison, samples = found.comparison, found.samples
    least = min((value for value in comparison.aicc.values() if value is not None), default=0.0)
    rows: list[tuple[str | Cell, ...]] = []
    for name in comparison.ranking:
        law, aicc, validation = comparison.laws[name], comparison.aicc[name], comparison.validation[name]
        numbers = (
            str(len(law.values)),
            number(law.rms, 5),
            number(None if aicc is None else aicc - least, 1),
            number(comparison.weight[name], 2),
            number(validation.radius, 5),
            number(validation.speed, 5),
            number(validation.run, 5),
            number(None if validation.linear_speed is None else 1e3 * validation.linear_speed, 2),
            number(None if validation.yaw_rate is None else 1e3 * validation.yaw_rate, 2),
        )
        best = name == comparison.best
        rows.append((law_cell(name, best, formula=False), *numbers, _verdict(law.lack_of_fit, law.lacks_fit)))
    residual = rms(relative_errors(PUBLISHED.twist(samples.omega, found.geometry), samples, found.geometry))
    rows.append((law_cell("published", formula=False), "0", number(residual, 5), *[MISSING] * 8))
    tests = {law.lack_of_fit.test for law in comparison.laws.values() if law.lack_of_fit is not None}
    note = "".join(_TESTS[test] for test in _TESTS if test in tests)
    note += "p is the probability of such a value by chance; below 0.01 the law “misses”. " if tests else (
        "Lack of fit cannot be tested here: no runs repeat each other, and errors of measurement are not known. "
    )  # fmt: skip
    align = "l" + "r" * 9 + "l"
    return Table("Laws compared, the best first", _CRITERIA_HEADER, rows, align, note + _CRITERIA_NOTE)


def measured_slip(
    found: Identification, logs: Sequence[RunLog] | None = None, seen: Sightings | None = None
) -> Section | None:
    """The section of the steady samples and of their laws; None if there are none.

    Args:
        found: the identification.
        logs: the runs, by default those of the identification.
        seen: their poses, if they are known already.
    """
    if found.steady is None:
        return None
    logs = found.logs if logs is None else logs
    turns = InnerOuterSamples.of(found.samples, found.geometry)
    seen = sightings(logs) if seen is None else seen
    blocks = [
        _driven(len(found.samples), turns),
        _pose_and_velocity(logs) if logs else None,
        None if seen is None else _localization(seen),
        _samples(found.comparison, turns) if len(turns) else None,
    ]
    return Section("Measured slip", [*blocks, _laws(found, turns), _comparison(found)])


def remarks(found: Identification, more: Sequence[str] = ()) -> tuple[Section | None, Section | None]:
    """What was left out, and warnings, `more` first; runs that were left out are not among the warnings as well."""
    excluded = [Markup("<strong>{}</strong>: {}.").format(one.run, one.reason) for one in found.outliers]
    why = "Runs that cannot be used, or whose motion no law explains together with the other runs':"
    known = set(map(str, found.outliers))
    told = warnings([*more, *(line for line in found.warnings if line not in known)])
    return (Section("Excluded runs", [why, Bullets(excluded)]) if excluded else None, told)


def _driven(runs: int, turns: InnerOuterSamples) -> str:
    """How the samples were measured."""
    who = "The only run" if runs == 1 else f"Each of {runs} runs"
    where = ""
    if len(turns):
        radii, speeds = _range(turns.radius, ".2f"), _range(turns.speed, ".2f")
        where = f", at observed radii of {radii} m and speeds of {speeds} m/s"
    straight = runs - len(turns)
    more = f" {straight} of them were nearly straight: they count for the laws but have no place on the figures' "
    return (
        f"The robot drives at constant sprocket speeds. {who} gives one mean slip per track{where}, from its measured "
        f"motion and sprocket speeds.{more + 'radius axis.' if straight else ''}"
    )


def _pose_and_velocity(logs: Sequence[RunLog]) -> Plot:
    truth = "Thin solid lines are the simulator's truth. " if logs[0].truth is not None else ""
    paper = "Dashed lines show the circle that the same sprocket speeds would drive with the published slip law. "
    return Plot(
        "fig04_pose_and_velocity",
        partial(figures.pose_and_velocity, figures.typical_run(logs)),
        "Pose and velocity of one run (the paper's Fig. 4)",
        "Left: estimated position and heading (points, thinned out). Right: their derivatives after a second-order "
        f"Butterworth filter run forwards and backwards. {truth}{paper if by_paper(logs) else ''}The scatter on the "
        "right is localization noise amplified by differentiation; the slip of a run is computed from all its poses "
        "together. Where no pose is valid, the curves follow an arc.",
    )


def by_paper(logs: Sequence[RunLog]) -> bool:
    """Whether figures show what robots of the same geometry do by the paper's equations."""
    return any(geometry_of(log.metadata) for log in logs)


def _localization(seen: Sightings) -> Plot:
    facts = seen.facts()
    missed = f"; {facts['missed']} gave no measurement, {facts['missed_below']}" if facts["missed"] != "0" else ""
    ratio = f"; over all angles the errors are {facts['ratio']} times the bound (along | across | heading)"
    return Plot(
        "localization_error",
        partial(error_against_viewing_angle, seen),
        "Localization error against viewing angle",
        "The scanner sees an upright plate on the robot, and each scan gives a pose. The viewing angle lies between "
        "the plate and the line of sight: at 0° the plate is seen edge-on, at 90° broadside. Symbols are root mean "
        f"square errors of the estimated poses ({facts['looked']} poses evaluated{missed}). Lines are the Cramér-Rao "
        "bound, the smallest error that any unbiased method can reach from the same single scan; it follows from "
        "range noise, beam spacing and the beams that hit the plate. Symbols on the lines leave no room for "
        f"improvement{ratio if facts['ratio'] else ''}. Below {facts['least_angle']} (grey) the bound is not "
        "meaningful, because there the face that a beam hits reveals the heading, not its range. Seen broadside, the "
        "ranges of all beams determine the distance along the line of sight, and only the two ends of the plate the "
        "position across it; close to edge-on it is the other way round.",
    )


def _samples(comparison: Comparison, turns: InnerOuterSamples) -> Plot:
    line = "with the best law's slip at that radius as a line, which is flat where slip does not depend on speed"
    if not all(is_narrow(turns.radius[group]) for group in value_groups(turns.radius)):
        line = "or per range of radii, because the radii are scattered"
    apart = spread(turns)
    return Plot(
        "fig05_slip_over_speed_and_radius",
        partial(figures.slip_against_speed_and_radius, turns, comparison.laws[comparison.best]),
        "Slip against speed and radius (the paper's Fig. 5)",
        f"Top: inner track; bottom: outer track. Left: one colour per observed radius, {line}. Thin dashed lines are "
        "Eq. 11 at the paper's observed radii (0.62, 1.34, 2.05, 2.68, 3.12 m) on the same colour scale. Right: one "
        "symbol per speed, with Eq. 11; symbols that coincide show that speed does not matter. "
        + (f"At one radius, slip differs between runs by at most {apart}. " if apart else "")
        + _error_bars(turns),
    )


def spread(turns: InnerOuterSamples) -> str:
    """The largest difference of a track's slip between runs of one radius; empty if no runs share a radius."""
    groups = repeated(turns.radius)
    inner, outer = (max((np.ptp(turns.slip[group, k]) for group in groups), default=0.0) for k in (0, 1))
    return f"{inner:.4f} (inner track) and {outer:.4f} (outer track)" if groups else ""


def _error_bars(turns: InnerOuterSamples) -> str:
    if turns.errors is None:
        return "There are no error bars because the samples came without errors of measurement."
    factor = figures.bar_factor(turns)
    larger = f", enlarged {factor} times because they would otherwise be smaller than the symbols"
    slip, radius = _size(float(np.median(turns.errors.slip))), _size(1e3 * float(np.median(turns.errors.radius)))
    return (
        f"Error bars are standard errors of measurement{larger if factor != 1 else ''} (typically {slip} in slip, "
        f"{radius} mm in radius)."
    )


def _laws(found: Identification, turns: InnerOuterSamples) -> Section:
    """The subsection of the laws and their parameters."""
    count = len(found.samples)
    blocks: list[Block | None] = [
        "A slip law gives the slip of both tracks in a turn of radius R and, for one of the laws, at a speed v. With "
        "the right law a robot goes where it should, because the law tells how much faster or slower each sprocket "
        f"has to turn. Each law was fitted to both tracks of {'the only run' if count == 1 else f'all {count} runs'} "
        "at once. The parameters are:",
        parameter_bullets(found.geometry),
        *(_law_plots(found, turns) if len(turns) else ()),
    ]
    loaded = found.comparison.laws.get("icr_load")
    if loaded is not None:
        blocks.append(
            Plot(
                "slip_under_load",
                partial(slip_under_load, found.samples, loaded, found.geometry),
                "Slip under load",
                "One minus the speed ahead over the mean speed of the belts, against the traction that slope and pull "
                "take, over the load on the tracks; positive uphill. One colour per commanded curvature, with the law "
                "of slip under load as lines. Slip differs from it where the ground gives way faster than in "
                "proportion.",
            )
        )
    return Section("Laws", [*blocks, law_table(found), _lack_of_fit(found.comparison)])


def _law_plots(found: Identification, turns: InnerOuterSamples) -> Iterator[Plot]:
    yield Plot(
        "fig06_slip_laws",
        partial(law_figures.fitted_laws, turns, found.comparison),
        "Fitted slip laws (the paper's Fig. 6)",
        "Slip against observed radius, outer track left and inner track right, with every fitted law and the "
        "published one, which is not fitted. The law with speed is drawn at the median speed. Thick: the best law, the "
        f"paper's exponential, fitted and published, and the constant ICR with ε. {_error_bars(turns)} The residuals "
        "in the next figure distinguish the laws.",
    )
    band, meaning = law_figures.residual_band(turns, found.comparison)
    beyond = "the samples came without errors of measurement, so the band shows how far runs are from the best law"
    if turns.errors is not None:
        beyond = "residuals outside it are not measurement noise"
    yield Plot(
        "residuals_of_laws",
        partial(law_figures.residuals, turns, found.comparison),
        "Residuals of the laws",
        "Measured slip minus the law's slip in every run, one panel per law. The residuals of a good law stay close to "
        "zero and show no trend. All panels share one scale, linear near zero and logarithmic beyond, because the laws "
        f"differ by powers of ten. {'Lines join the means of runs at one radius. ' if spread(turns) else ''}"
        f"{'Error bars are standard errors, drawn to scale. ' if turns.errors is not None else ''}"
        f"The green band is ±{band:.1g}, {meaning}: {beyond}.",
    )


def _lack_of_fit(comparison: Comparison) -> str:
    """Which laws have the wrong shape, and what that means for their parameters; empty if none has."""
    lacking = {
        name: law.lack_of_fit
        for name, law in comparison.laws.items()
        if law.lack_of_fit is not None and law.lacks_fit and name not in _BASELINES
    }
    if not lacking:
        return ""
    repeats = any(one.test == "F" for one in lacking.values())
    than = "runs at one radius are from each other" if repeats else "their errors of measurement allow"
    factors = [one.inflation for one in lacking.values() if one.inflation > 1]
    inflated = factors and (
        f" Their standard errors and 95 % intervals are therefore multiplied by {_range(np.array(factors), '.2g')}, "
        "the ratio of the misfit to what chance allows. They describe the best compromise over the radii driven here, "
        "not at other radii."
    )
    return Markup(
        "<strong>Lack of fit</strong> of the {}: the samples are farther from the law than {}. This cannot be chance: "
        "the law has the wrong shape. No parameters are then true, and errors computed from the scatter alone would be "
        "far too small.{}"
    ).format(_listed(shown(name).title for name in lacking), than, inflated or "")


def _comparison(found: Identification) -> Section:
    """The subsection that compares the laws."""
    comparison = found.comparison
    correlated = law_figures.correlated_laws(comparison)
    return Section(
        "Comparison of the laws",
        [
            "All laws are fitted to the same runs with the same weights and judged by the motion that sprocket speeds "
            "cause: slip and radius are both computed from the measured motion, so fitting one against the other would "
            "favour some laws. More parameters always fit better; two methods keep the comparison fair.",
            Bullets(
                [
                    Markup(
                        "<strong>Akaike's criterion</strong> (AICc) weighs the fit against the number of parameters, "
                        "corrected for small samples. Only differences count: up to 2 they mean nothing, above 10 they "
                        "rule a law out. The <em>weight</em> of a law is its probability of being the one of these "
                        "that predicts best."
                    ),
                    Markup(
                        "<strong>Cross-validation</strong>: all runs of one radius (or one speed) are left out, and "
                        "the law fitted to the others predicts them; this is repeated for every radius (or speed). An "
                        "error far above that of the fit means that the law merely follows the samples. Errors are "
                        "those of the track speeds, relative to the faster sprocket's. The error of the yaw rate is "
                        "the one that a driver notices."
                    ),
                ]
            ),
            "The best law is the simplest of those that predict left-out radii, and then left-out runs, as well as any "
            "other: by no more than one standard error, or a thousandth of the speed, worse than the one that predicts "
            "best.",
            _best(comparison),
            Plot(
                "comparison_of_laws",
                partial(law_figures.criteria, comparison),
                "Comparison of the laws",
                "One row per law, sorted by the criterion, with the best law in bold. Further left is better. Left: "
                "AICc above the smallest, linear up to 10 and logarithmic beyond. Others: errors of predicting runs "
                "left out of the fit, on logarithmic scales. Hollow circles are the error of the fit itself; a gap "
                "between the two shows a law that fits better than it predicts.",
            ),
            criteria_table(found),
            Plot(
                "correlations_of_parameters",
                partial(law_figures.correlations, correlated),
                "Correlation of the parameters",
                "Correlation between the errors of two parameters of a law. At +1 or −1 the samples determine only a "
                "combination of the two, and an error of one is compensated by the other; at 0 each is known "
                "independently.",
            )
            if correlated
            else None,
        ],
    )


def _best(comparison: Comparison) -> str:
    """The best law and how well it predicts, and the paper's exponential where it differs."""
    best, count = shown(comparison.best).title, len(comparison.laws[comparison.best].values)
    chosen = f" (there are too few samples for the criterion of prediction, so it was chosen by {comparison.criterion})"
    errors = [_errors(comparison, name) for name in dict.fromkeys([comparison.best, "exponential"])]
    return Markup("The best law here is <strong>{}</strong>, with {} parameter{}{}. {}.").format(
        best,
        count,
        "" if count == 1 else "s",
        chosen if comparison.criterion in ("AICc", "scatter") else "",
        "; ".join(filter(None, errors)),
    )


def _errors(comparison: Comparison, name: str) -> str:
    """How far a law is off in the fit and at left-out radii and speeds."""
    if name not in comparison.laws:
        return ""
    errors = comparison.validation[name]
    who = "It" if name == comparison.best else f"the {shown(name).title}"
    told = f"{who} leaves a residual of {_size(comparison.laws[name].rms)} of the speed (rms)"
    if _size(errors.radius) == MISSING:
        return told
    yaw_rate = None if errors.yaw_rate is None else 1e3 * errors.yaw_rate
    return (
        f"{told} and mispredicts left-out radii by {_size(errors.radius)} and left-out speeds by "
        f"{_size(errors.speed)}, and by {_size(yaw_rate)} mrad/s in yaw rate"
    )


def _parameter(law: FittedLaw, key: str) -> tuple[str, ...]:
    """Value and intervals with as many decimals as show two digits of the standard error."""
    factor, unit = unit_of(law.name, key)
    error = factor * law.stderr[key]
    digits = digits_for(error)
    ends = law.interval95[key], law.bootstrap95.get(key)
    intervals = (MISSING if e is None else " to ".join(number(factor * x, digits) for x in e) for e in ends)
    value = f"{number(factor * law.values[key], digits)} ± {number(error, digits)} {unit}".rstrip()
    return (SYMBOLS.get(key, key), value, *intervals)


def _verdict(lack: LackOfFit | None, misses: bool) -> Cell:
    """Whether a law fits, and the test's statistic and probability."""
    if lack is None:
        return Cell("unknown")
    name = {"chi2": "χ²"}.get(lack.test, lack.test)
    freedom = ", ".join(map(str, lack.freedom))
    chance = f"p < {_CERTAIN}" if lack.probability < _CERTAIN else f"p = {lack.probability:.2g}"
    size = f"{lack.statistic:.0f}" if lack.statistic >= 100 else f"{lack.statistic:.3g}"
    verdict, test = "misses" if misses else "fits", f"{name}({freedom}) = {size}, {chance}"
    return Cell(verdict, f"{verdict} {test}", [test])


def _size(value: float | None) -> str:
    """A positive number with two significant digits; MISSING for anything else."""
    return significant(value) if value is not None and value > 0 else MISSING


def _range(values: Array, form: str) -> str:
    low, high = format(values.min(), form), format(values.max(), form)
    return low if low == high else f"{low} to {high}"


def _listed(names: Iterable[str]) -> str:
    *most, last = names
    return f"{', '.join(most)} and {last}" if most else last
