"""The page of an identification, and its section on laws identified from steady runs."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from markupsafe import Markup

from experiments.driving.paper_model import geometry_of
from experiments.measuring.sightings import Sightings, sightings
from experiments.measuring.steady_turns import InnerOuterSamples, is_narrow, repeated, value_groups
from experiments.report.drives import whole_drives
from experiments.report.figures import laws as law_figures
from experiments.report.figures import steady_runs as figures
from experiments.report.figures.localization import error_against_viewing_angle
from experiments.report.figures.slip_under_load import slip_under_load
from experiments.report.laws import parameter_bullets
from experiments.report.page import Block, Bullets, Page, Plot, Section, warnings
from experiments.report.steady_laws import best_text, criteria_table, lack_of_fit_text, law_table, range_text, size_text
from trackslip.identification.comparison import Comparison
from trackslip.identification.result import Identification
from trackslip.logs.runlog import RunLog

INTRO = Markup(
    "A tracked robot turns by driving its tracks at different speeds, and the tracks slip. The slip of a track is "
    "i = 1 − V / (r ω), where V is its true speed over the ground, r the sprocket radius and ω the sprocket speed: "
    "positive where the track is slower than commanded. In a turn, the <em>inner</em> track is on the side of the "
    "turning centre, the <em>outer</em> track on the other; in a left turn the inner track is the left one. R is the "
    "radius of the path. “The paper” is Moosavian and Kalantari, <cite>Experimental Slip Estimation for Exact "
    "Kinematics Modeling and Control of a Tracked Mobile Robot</cite>, IROS 2008; its Eq. 11 is the slip law it "
    "published."
)
_COMPARED = (
    "All laws are fitted to the same runs with the same weights and judged by the motion that sprocket speeds cause: "
    "slip and radius are both computed from the measured motion, so fitting one against the other would favour some "
    "laws. More parameters always fit better; two methods keep the comparison fair."
)
_CRITERIA = Bullets(
    [
        Markup(
            "<strong>Akaike's criterion</strong> (AICc) weighs the fit against the number of parameters, corrected "
            "for small samples. Differences up to 2 mean nothing, above 10 they rule a law out. The <em>weight</em> of "
            "a law is its probability of being the one of these that predicts best."
        ),
        Markup(
            "<strong>Cross-validation</strong>: all runs of one radius (or one speed) are left out, and the law fitted "
            "to the others predicts them. An error far above that of the fit means that the law merely follows the "
            "samples. Errors are those of the track speeds, relative to the faster sprocket's."
        ),
    ]
)
_CHOSEN = (
    "The best law is the simplest of those that predict left-out radii, and then left-out runs, as well as any other: "
    "by no more than one standard error, or a thousandth of the speed, worse than the one that predicts best."
)


def page(found: Identification, title: str, command: str, manifest: Mapping[str, Any]) -> Page:
    """The page of an identification."""
    sections = [measured_slip(found), whole_drives(found), *remarks(found)]
    return Page(title, command, manifest, sections, [INTRO])


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
    """Excluded runs, and warnings, `more` first; excluded runs are not repeated among the warnings."""
    excluded = [Markup("<strong>{}</strong>: {}.").format(one.run, one.reason) for one in found.outliers]
    why = "Runs that cannot be used, or whose motion no law explains together with the other runs':"
    known = set(map(str, found.outliers))
    told = warnings([*more, *(line for line in found.warnings if line not in known)])
    return (Section("Excluded runs", [why, Bullets(excluded)]) if excluded else None, told)


def _driven(runs: int, turns: InnerOuterSamples) -> str:
    """A paragraph on the measurement of the samples."""
    who = "The only run" if runs == 1 else f"Each of {runs} runs"
    where = ""
    if len(turns):
        radii, speeds = range_text(turns.radius, ".2f"), range_text(turns.speed, ".2f")
        where = f", at observed radii of {radii} m and speeds of {speeds} m/s"
    straight = runs - len(turns)
    more = f" {straight} of them were nearly straight: they count for the laws but have no place on the figures' "
    return (
        f"The robot drives at constant sprocket speeds. {who} gives one mean slip per track{where}, from its measured "
        f"motion and sprocket speeds.{more + 'radius axis.' if straight else ''}"
    )


def _pose_and_velocity(logs: Sequence[RunLog]) -> Plot:
    truth = " Thin solid lines are the simulator's truth." if logs[0].truth is not None else ""
    paper = " Dashed: the circle that the same sprocket speeds would drive with the published slip law."
    return Plot(
        "fig04_pose_and_velocity",
        partial(figures.pose_and_velocity, figures.typical_run(logs)),
        "Pose and velocity of one run (the paper's Fig. 4)",
        "Left: estimated position and heading (points, thinned out). Right: their derivatives after a second-order "
        f"Butterworth filter run forwards and backwards.{truth}{paper if by_paper(logs) else ''} The scatter on the "
        "right is localization noise amplified by differentiation; slip is computed from all poses of a run together.",
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
        "The scanner sees an upright plate on the robot, and each scan gives a pose. The viewing angle is that between "
        "plate and line of sight: 0° edge-on, 90° broadside. Symbols: root mean square errors of the estimated poses "
        f"({facts['looked']} poses evaluated{missed}). Lines: the Cramér-Rao bound, the smallest error that any "
        "unbiased method can reach from the same scan, by range noise, beam spacing and the beams that hit the plate. "
        f"Symbols on the lines leave no room for improvement{ratio if facts['ratio'] else ''}. Below "
        f"{facts['least_angle']} (grey) the bound is not meaningful, because the face that a beam hits reveals the "
        "heading there, not its range. Broadside, the ranges of all beams determine the distance along the line of "
        "sight and only the plate's two ends the position across it; close to edge-on it is the other way round.",
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
    slip, radius = (
        size_text(float(np.median(turns.errors.slip))),
        size_text(1e3 * float(np.median(turns.errors.radius))),
    )
    return (
        f"Error bars are standard errors of measurement{larger if factor != 1 else ''} (typically {slip} in slip, "
        f"{radius} mm in radius)."
    )


def _laws(found: Identification, turns: InnerOuterSamples) -> Section:
    """The subsection of the laws and their parameters."""
    count = len(found.samples)
    blocks: list[Block | None] = [
        "A slip law gives the slip of both tracks in a turn of radius R, and so how much faster or slower each "
        "sprocket has to turn for the robot to go where it should. Each law was fitted to both tracks of "
        f"{'the only run' if count == 1 else f'all {count} runs'} at once. The parameters are:",
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
                "One minus the speed ahead over the belts' mean speed, against the traction that slope and pull take "
                "over the load on the tracks; positive uphill. One colour per commanded curvature; lines: the law. "
                "Slip differs from it where the ground gives way faster than in proportion.",
            )
        )
    return Section("Laws", [*blocks, law_table(found), lack_of_fit_text(found.comparison)])


def _law_plots(found: Identification, turns: InnerOuterSamples) -> Iterator[Plot]:
    yield Plot(
        "fig06_slip_laws",
        partial(law_figures.fitted_laws, turns, found.comparison),
        "Fitted slip laws (the paper's Fig. 6)",
        "Slip against observed radius, outer track left and inner track right, with every fitted law (that with speed "
        "at the median speed) and the published one, which is not fitted. Thick: the best law, the paper's "
        f"exponential, fitted and published, and the constant ICR with ε. {_error_bars(turns)}",
    )
    band, meaning = law_figures.residual_band(turns, found.comparison)
    means = "Lines join the means of runs at one radius. " if spread(turns) else ""
    noise = "It shows how far runs are from the best law, for the samples came without errors of measurement."
    if turns.errors is not None:
        noise = "Residuals outside it are not measurement noise. Error bars are standard errors, drawn to scale."
    yield Plot(
        "residuals_of_laws",
        partial(law_figures.residuals, turns, found.comparison),
        "Residuals of the laws",
        "Measured slip minus the law's slip in every run, one panel per law, on one scale that is linear near zero and "
        "logarithmic beyond. The residuals of a good law stay close to zero and show no trend. "
        f"{means}The green band is ±{band:.1g}, {meaning}. {noise}",
    )


def _comparison(found: Identification) -> Section:
    """The subsection that compares the laws."""
    comparison = found.comparison
    correlated = law_figures.correlated_laws(comparison)
    correlations = Plot(
        "correlations_of_parameters",
        partial(law_figures.correlations, correlated),
        "Correlation of the parameters",
        "Correlation between the errors of two parameters of a law. At +1 or −1 the samples determine only a "
        "combination of the two, and an error of one is compensated by the other; at 0 each is known independently.",
    )
    criteria = Plot(
        "comparison_of_laws",
        partial(law_figures.criteria, comparison),
        "Comparison of the laws",
        "One row per law, sorted by the criterion, the best law in bold; further left is better. Left: AICc above the "
        "smallest, linear up to 10 and logarithmic beyond. Others: errors of predicting runs left out of the fit. "
        "Hollow circles are the error of the fit itself; a gap shows a law that fits better than it predicts.",
    )
    return Section(
        "Comparison of the laws",
        [
            _COMPARED,
            _CRITERIA,
            _CHOSEN,
            best_text(comparison),
            criteria,
            criteria_table(found),
            correlations if correlated else None,
        ],
    )
