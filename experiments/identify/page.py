"""The page of an identification, its section on laws identified from steady runs, and what the terminal shows."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from markupsafe import Markup

from experiments.common.formats import number, pair
from experiments.common.laws import parameter_bullets
from experiments.common.page import Block, Page, Plot, Section, warnings
from experiments.common.table import Table
from experiments.identify import drives, law_figures
from experiments.identify import steady_figures as figures
from experiments.identify.load_figure import slip_under_load
from experiments.identify.localization_figures import error_against_viewing_angle
from experiments.identify.sightings import sightings
from experiments.identify.steady_laws import best_text, criteria_table, lack_of_fit_text, law_table, size_text
from experiments.identify.steady_turns import InnerOuterSamples, repeated
from trackslip.doubts import severity
from trackslip.identification.result import Identification
from trackslip.logs.runlog import RunLog
from trackslip.slip.families import FAMILIES

INTRO = Markup(
    "The slip of a track is i = 1 − V / (r ω), where V is its true speed over the ground, r the sprocket radius and ω "
    "the sprocket speed: positive where the track is slower than commanded. In a turn of radius R, the <em>inner</em> "
    "track is on the side of the turning centre, the <em>outer</em> track on the other. “The paper” is Moosavian and "
    "Kalantari, <cite>Experimental Slip Estimation for Exact Kinematics Modeling and Control of a Tracked Mobile "
    "Robot</cite>, IROS 2008; its Eq. 11 is the slip law it published."
)
_COMPARED = (
    "All laws are fitted to the same runs with the same weights and judged by the motion that sprocket speeds cause. "
    "Akaike's criterion (AICc) weighs the fit against the number of parameters: differences up to 2 mean nothing, "
    "above 10 they rule a law out. Cross-validation predicts runs that were left out of the fit. The best law is the "
    "simplest of those that predict left-out radii, and then left-out runs, as well as any other within one standard "
    "error or a thousandth of the speed."
)


def page(found: Identification, title: str, command: str, manifest: Mapping[str, Any]) -> Page:
    """The page of an identification."""
    sections = [measured_slip(found, found.logs), drives.whole_drives(found), *remarks(found)]
    alarms = [Markup('<strong class="mark">Alarm</strong> {}').format(line) for line in found.alarms]
    return Page(title, command, manifest, sections, [*alarms, INTRO])


def measured_slip(found: Identification, logs: Sequence[RunLog]) -> Section | None:
    """The section of the steady samples from some runs and of their laws; None if there are none."""
    if found.steady is None:
        return None
    turns = InnerOuterSamples.of(found.samples, found.geometry)
    driven = _driven(len(found.samples), turns)
    return Section("Measured slip", [driven, *_measured(found, turns, logs), _laws(found, turns), _comparison(found)])


def remarks(found: Identification, more: Sequence[str] = ()) -> tuple[Section | None, Section | None]:
    """Excluded runs, and warnings, `more` first; alarms are at the top of the page."""
    rows = [(one.run, one.reason) for one in found.outliers]
    told = warnings([*more, *(line for line in found.warnings if line not in found.alarms)])
    return (
        Section("Excluded runs", [Table("All of them", ("run", "why"), rows, "l", folded=True)]) if rows else None,
        told,
    )


def print_identification(found: Identification, taken: Sequence[str] = ()) -> None:
    """Print alarms, what was `taken` from bags, the laws by the chosen method in full, and those by the other one."""
    for line in (*(f"ALARM: {alarm}" for alarm in found.alarms), *taken):
        print(line)
    steady = [] if found.steady is None else [law_table(found), criteria_table(found)]
    if found.method == "drive" and found.drive is not None:
        best = found.drive.laws[found.drive.best]
        drives.law_table(found.drive).print()
        drives.extra_table(best).print()
        print("".join(f"{line}\n" for line in drives.held_lines(best)))
        ahead = (drives.position_table(found.drive), drives.heading_table(found.drive))
        tables = [*ahead, *steady[:1]]
    else:
        tables = [*steady, None if found.drive is None else drives.law_table(found.drive)]
    for table in tables:
        if table is not None:
            table.print()
    for warning in found.warnings:
        if (loud := severity(warning)) != "alarm":
            print(f"{'note' if loud == 'remark' else 'warning'}: {warning}")
    if reason := _why(found):
        print(reason)
    print(f"best: {found.best}, {FAMILIES[found.best].title}")


def _why(found: Identification) -> str:
    """Why the best law is the best, where that isn't obvious; empty if it is."""
    if found.method == "drive" and found.drive is not None:
        return found.drive.reason
    chosen = found.comparison
    first, best = chosen.ranking[0], chosen.best
    if first == best:
        return ""
    if chosen.criterion.startswith("left-out"):
        return f"{first} has a smaller AICc than {best}, but does not predict {chosen.criterion} better"
    return f"{first} has a smaller AICc than {best}, but by so little that the simpler law is preferred"


def _driven(runs: int, turns: InnerOuterSamples) -> str:
    """A paragraph on the measurement of the samples."""
    where = ""
    if len(turns):
        ends = (f"{end:.2f}" for values in (turns.radius, turns.speed) for end in (values.min(), values.max()))
        where = ", at observed radii from {} to {} m and speeds from {} to {} m/s".format(*ends)
    straight = f" Nearly straight runs ({runs - len(turns)}) count for the laws but have no place on an axis of radii."
    return (
        "The robot drives at constant sprocket speeds. Each run gives one mean slip per track from its measured "
        f"motion: {len(turns)} turn{'s' * (len(turns) != 1)}{where}.{straight if runs > len(turns) else ''}"
    )


def _measured(found: Identification, turns: InnerOuterSamples, logs: Sequence[RunLog]) -> Iterator[Plot]:
    """Figures of what was measured: of one run, of localization, and of all samples."""
    if logs:
        yield Plot(
            "fig04_pose_and_velocity",
            partial(figures.pose_and_velocity, figures.typical_run(logs)),
            "Pose and velocity of one run (the paper's Fig. 4)",
            "Left: estimated position and heading (points, thinned out). Right: their derivatives after the paper's "
            "second-order Butterworth filter; they scatter by localization noise amplified by differentiation. Slip is "
            "computed from all poses of a run together.",
        )
    if (seen := sightings(logs)) is not None:
        yield Plot(
            "localization_error",
            partial(error_against_viewing_angle, seen),
            "Localization error against viewing angle",
            "Symbols: rms errors of the poses estimated from scans of an upright plate, against the angle between "
            "plate and line of sight. Lines: the Cramér-Rao bound, the smallest error that any unbiased method can "
            "reach from the same scan; it is not meaningful in the grey range. Over all angles beyond, errors are "
            f"{pair([number(ratio, 2) for ratio in seen.ratio()])} times the bound (along | across | heading).",
        )
    if len(turns):
        yield Plot(
            "fig05_slip_over_speed_and_radius",
            partial(figures.slip_against_speed_and_radius, turns, found.comparison.laws[found.comparison.best]),
            "Slip against speed and radius (the paper's Fig. 5)",
            "Left: one colour per observed radius, with the best law's slip there as a line. Thin dashed lines are "
            "Eq. 11 at the paper's observed radii (0.62, 1.34, 2.05, 2.68, 3.12 m) on the same colour scale. Right: "
            "one symbol per speed, with Eq. 11; symbols that coincide show that speed does not matter. "
            f"{spread(turns)}{_error_bars(turns)}",
        )


def spread(turns: InnerOuterSamples) -> str:
    """A sentence on how much slip differs between runs of one radius; empty if no runs share a radius."""
    groups = repeated(turns.radius)
    apart = [max((np.ptp(turns.slip[group, k]) for group in groups), default=0.0) for k in (0, 1)]
    told = "At one radius, slip differs between runs by at most {:.4f} (inner track) and {:.4f} (outer track). "
    return told.format(*apart) if groups else ""


def _error_bars(turns: InnerOuterSamples) -> str:
    if turns.errors is None:
        return "There are no error bars because the samples came without errors of measurement."
    slip, radius = (size_text(float(np.median(e))) for e in (turns.errors.slip, 1e3 * turns.errors.radius))
    return f"Error bars are standard errors of measurement (typically {slip} in slip, {radius} mm in radius)."


def _laws(found: Identification, turns: InnerOuterSamples) -> Section:
    """The subsection of the laws and their parameters."""
    blocks: list[Block | None] = [
        "A slip law gives the slip of both tracks in a turn of radius R, and so how much faster or slower each "
        "sprocket has to turn for the robot to go where it should. Each law was fitted to both tracks of all runs at "
        "once. The parameters are:",
        parameter_bullets(found.comparison.laws, found.geometry),
    ]
    if len(turns):
        blocks.append(
            Plot(
                "fig06_slip_laws",
                partial(law_figures.fitted_laws, turns, found.comparison),
                "Fitted slip laws (the paper's Fig. 6)",
                "Slip against observed radius with every fitted law and the published one, which is not fitted. Thick: "
                "the best law, the paper's exponential, fitted and published, and the constant ICR with ε.",
            )
        )
        blocks.append(
            Plot(
                "residuals_of_laws",
                partial(law_figures.residuals, turns, found.comparison),
                "Residuals of the laws",
                "Measured slip minus the law's slip in every run, on a scale that is linear near zero and logarithmic "
                "beyond; lines join the means of runs at one radius. The residuals of a good law stay in the green "
                "band and show no trend.",
            )
        )
    loaded = found.comparison.laws.get("icr_load")
    if loaded is not None:
        blocks.append(
            Plot(
                "slip_under_load",
                partial(slip_under_load, found.samples, loaded, found.geometry),
                "Slip under load",
                "One minus the speed ahead over the belts' mean speed, against the traction that slope and pull take "
                "over the load on the tracks; positive uphill. One colour per commanded curvature; lines: the law.",
            )
        )
    return Section("Laws", [*blocks, law_table(found), lack_of_fit_text(found.comparison)])


def _comparison(found: Identification) -> Section:
    """The subsection that compares the laws."""
    comparison = found.comparison
    correlated = law_figures.correlated_laws(comparison)
    criteria = Plot(
        "comparison_of_laws",
        partial(law_figures.criteria, comparison),
        "Comparison of the laws",
        "One row per law, the best in bold; further left is better. Left: AICc above the smallest. Others: errors of "
        "predicting runs left out of the fit; hollow circles are the error of the fit itself.",
    )
    correlations = Plot(
        "correlations_of_parameters",
        partial(law_figures.correlations, correlated),
        "Correlation of the parameters",
        "At +1 or −1 the samples determine only a combination of the two parameters; at 0 each is known independently.",
    )
    return Section(
        "Comparison of the laws",
        [_COMPARED, best_text(comparison), criteria, criteria_table(found), correlations if correlated else None],
    )
