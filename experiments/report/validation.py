"""The page of a validation: headline numbers, and figures that compare the simulator with theory."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from experiments.report.figures import validation as figures
from experiments.report.figures import validation_turning as turning_figures
from experiments.report.figures.validation_turning import expected_twist, nearest_ratio, own
from experiments.report.formats import MISSING, pair, percent, significant, span
from experiments.report.page import Block, Bullets, Note, Page, Panels, Plot, Section, relative_command
from experiments.report.table import Table
from experiments.validation import convergence, energy
from experiments.validation.results import Validation, ValidationSummary
from experiments.validation.standing import ANGLES, REFERENCE_ANGLE
from experiments.validation.turning import WATCH, Turns
from sim.drive.drive import Drive
from sim.robot.parameters import SINK
from sim.robot.robot import load_robot
from trackslip.kinematics import Array

TITLE = "The simulator compared with theory"
_HEADER = ("quantity", "theory", "recipe", "default contact")
_INTRO = (
    "A tracked robot turns by running its tracks at different speeds, which makes them slide over the ground. How they "
    "slide follows from dry friction alone and can be computed without a simulator. This page compares the simulator "
    "with that theory. It shows three sets of results:"
)
_COMPARED = (
    "<strong>Theory</strong>: quasi-static Coulomb friction under two uniformly loaded lines. Wherever a track slides, "
    "the ground resists with a force that depends on the direction of sliding but not on its speed; the force lies on "
    "a friction ellipse along and across the track and dissipates as much energy as possible. In a steady turn these "
    "forces balance the robot's momentum, and the loads follow from weight and momentum.",
    "<strong>The recipe</strong>: the contacts of this project's model, which produce all its results. {points} points "
    "represent the two tracks; the load on each follows from its penetration, and friction is stiff.",
    "<strong>MuJoCo's default contact</strong>: the same robot with the same friction coefficients, and MuJoCo's "
    "defaults for all other properties of contacts, solver and step.",
)
_SLIP = (
    "The slip of a track is i = 1 − V / (r ω), where V is its true speed over the ground, r the nominal sprocket "
    "radius and ω the sprocket speed. In a turn, the <em>outer</em> track is slower over the ground than it runs, the "
    "<em>inner</em> track faster. Each turns about an instantaneous centre of rotation (ICR) at a distance D outside "
    "its centre line; b is half the distance between the tracks. The yaw rate is the difference of the tracks' speeds "
    "divided by 2 (b + D), the distance between the ICRs."
)
_NOTE = (
    "Over {turns} steady turns: radii from {radii}, speeds from {speeds}, friction across / along from {ratios}, "
    "{lengths} contact lengths, {places} centres of mass. Errors are absolute values, worst | median. The error of D "
    "alone excludes b, which needs no simulation; slip depends on D."
)
_CAPTIONS = {
    "turns": "<em>Error of the ICRs' half width</em>: share of the turns whose error is below the value on the "
    "logarithmic axis. The recipe's curves lie {decades} powers of ten to the left of the default contact's. Half of "
    "its turns are within {icr_median} of theory and all within {icr_worst}. With the default contact, half of the "
    "turns are off by more than {naive_icr_median}, and {naive_wider} turn too little. <em>Slip of both tracks</em>: "
    "of the robot itself, at all radii, speeds and friction ratios. The recipe's slips lie on the line; the default "
    "contact's scatter and are mostly too large.",
    "left": "Errors of the recipe, on linear axes. <em>Against yaw rate</em>: the points of one friction ratio lie on "
    "a line. It rises because sliding still lifts a point slightly, and the ends of the tracks slide faster in a "
    "faster turn. Its value at the slowest turns is the error of approximating a continuous track by "
    "{points_per_track} points. The two partly cancel, so <strong>a robot that turns faster than {fastest} can be "
    "further off</strong> than any shown here. <em>By shape of the robot</em>: smallest, median and largest error over "
    "all turns, for each contact length and each shift of the centre of mass, as a percentage of that length and of b. "
    "<em>Lateral speed</em>: its error is proportional to the centripetal acceleration and to the time that a contact "
    "takes to grip, here {lag} by the slope. It shifts the ICRs {shift} too far forward at {top_speed}.",
    "slip": "One symbol per speed; slip of the outer track is positive, of the inner track negative. With dry "
    "friction, the slip of a real track does not depend on speed. <em>Recipe</em>: the symbols coincide and lie on the "
    "line of theory; at one radius they differ by at most {spread}. <em>MuJoCo's default contact</em>: the same speeds "
    "scatter irregularly, by up to {naive_spread}.",
    "loads": "Symbols are medians over {loaded_turns} turns, thick bars span the middle half and thin lines the whole "
    "range, at one instant. <em>Pads</em>: with the recipe, all carry about the same load. With the default contact "
    "the ends carry most, because it lifts sliding points and the ends slide fastest; the robot shakes, so that a pad "
    "may carry nothing or several times its share. <em>Points</em>: the recipe's {points} points on a finer scale. In "
    "theory, too, loads deviate from their mean by up to {expected_spread}, because momentum loads the outer track, "
    "here the right one, and an off-centre mass loads its side. The recipe deviates from theory by {pad_spread} at "
    "most, a remainder of the same effect: the ends carry more.",
    "slopes": "<em>Parked</em>: a robot should stand still up to the friction angle, drawn as a vertical line in the "
    "same style as its curve. The simulated robots creep (logarithmic axis): at most {creep} on {creep_angle}, the "
    "grey bar, and {largest_creep} just below the friction angle. <em>Sliding</em>: beyond the friction angle, symbols "
    "should lie on the lines of Coulomb's law; they are off by {sliding} at most.",
    "steps": "{robots} robots drive random sprocket speeds for {duration}, {travelled} on average. Their final "
    "positions are compared with those of a step of {reference}. Both axes are logarithmic. Errors proportional to the "
    "step, as they should be, lie on the dashed line, which allows for the error of the reference itself. The two "
    "solvers end {solvers} apart, far less than the error of the step. This compares the recipe with itself and says "
    "nothing about its omissions.",
    "energy": "<em>Since the start</em>: nearly all the work that the belts of {energy_robots} robots, driving at "
    "random, do on the contacts is lost where they slide (dashed, on the thick line). <em>Enlarged</em>: the remainder "
    "of {traction} after friction and after the {damping} lost in vertical motion should equal the kinetic and "
    "potential energy. The unaccounted energy stays below {residual_joule}, {residual} of the largest energy stored. "
    "The friction loss computed from contact forces differs by {friction_loss} from Coulomb's law applied to loads and "
    "sliding speeds, because a contact that hardly slides does not use its full friction.",
}
_LIMITS = (
    "That the theory holds on real ground. It assumes dry friction on a hard plane; soil shears and yields, and real "
    "tracks have shoes.",
    "Sharper and faster turns. Radii are {radii} and yaw rates at most {fastest}; turning on the spot, the robot could "
    "reach about {on_the_spot}.",
    "Time-averaged loads with the default contact. The robot shakes and loads are instantaneous, so the worst values "
    "exceed those of a mean over time. Twists are averaged over {watch}.",
)


def page(found: Validation, summary: ValidationSummary, manifest: Mapping[str, Any], command: str) -> Page:
    """The headline numbers, and the figures."""
    numbers, small = facts(found, summary), conditions(found, manifest, command)
    turns, naive = found.turns, found.naive_turns

    def told(text: str) -> Markup:
        return Markup(text).format(**numbers)

    def plot(name: str, heading: str, figure: Panels) -> Plot:
        return Plot(name, figure, heading, told(_CAPTIONS[name]), small[name])

    turning = (
        plot("turns", "Errors in the turns", turning_figures.icr_and_slip(turns, naive, found.parameters)),
        plot("left", "Remaining errors and their causes", turning_figures.what_is_left(turns, found.parameters)),
        plot(
            "slip",
            "Slip against radius",
            turning_figures.slip_against_radius(turns, naive, found.parameters, found.ground),
        ),
    )
    standing = (
        plot("loads", "Loads along the tracks", figures.pad_loads(found.loads, found.naive_loads)),
        plot("slopes", "On slopes", figures.slopes(found.creep, found.slide, found.ground)),
    )
    numerics = (
        plot("steps", "Physics step and solver", figures.steps_and_solvers(found.convergence, physics_step(found))),
        plot("energy", "Energy", figures.energies(found.energy)),
    )
    sections = [
        Section("In numbers", [table_of(found, summary), Note(told(_NOTE))]),
        Section("Turning", turning),
        Section("Standing and sliding", standing),
        Section("Numerics", numerics),
        Section("What this does not show", [Bullets([told(text) for text in _LIMITS])]),
    ]
    intro: list[Block] = [_INTRO, Bullets([told(text) for text in _COMPARED]), Markup(_SLIP)]
    return Page(TITLE, command, manifest, sections, intro)


def table_of(found: Validation, summary: ValidationSummary) -> Table:
    """The headline numbers."""
    turns, naive = found.turns, found.naive_turns
    b = found.parameters.half_gauge
    offset = [(t.half_width - b) / (t.expected_half_width - b) - 1 for t in (turns, naive)]
    spread = summary.pad_load_spread, summary.naive_pad_load_spread
    step = physics_step(found)
    error = found.convergence.step_error.get(step, math.nan)
    after = f"after {convergence.DURATION:g} s"
    table = [
        ("b + D, worst | median error", "0", *(_worst_and_median(100 * t.icr_error, "%") for t in (turns, naive))),
        ("D alone, worst | median error", "0", *(_worst_and_median(100 * error, "%") for error in offset)),
        ("slip, worst | median error", "0", *(_worst_and_median(t.slip_error) for t in (turns, naive))),
        ("lateral speed, worst | median error", "0",
         *(_worst_and_median(1e3 * (t.lateral - t.expected_lateral), "mm/s") for t in (turns, naive))),
        ("load of a contact point, largest deviation from theory", "0", *(percent(value) for value in spread)),
        ("sink on level ground", significant(1e3 * SINK, "mm"),
         significant(summary.sink_mm, "mm", 3), significant(1e3 * float(found.naive_loads.sink.mean()), "mm")),
        ("roll | pitch in turns, largest", "0",
         pair([significant(summary.roll_deg), significant(summary.pitch_deg)], "deg")),
        ("creep, parked on " + _creep_angle(found), "0", significant(summary.creep_mm_per_s, "mm/s")),
        ("acceleration beyond the friction angle, relative error", "0",
         percent(summary.sliding_acceleration_error)),
        ("sideways drift in 10 m straight on", "0", significant(summary.straight_drift_mm, "mm")),
        (f"error of the physics step of {1e3 * step:g} ms, {after}", "0", significant(1e3 * error, "mm")),
        (f"solvers CG and Newton, apart {after}", "0", significant(summary.solver_difference_mm, "mm")),
        ("energy not accounted for, of the largest energy stored", "0", percent(summary.energy_residual)),
        ("friction loss, deviation from Coulomb's law", "0", percent(summary.friction_loss_error)),
    ]  # fmt: skip
    return Table(TITLE, _HEADER, [(*cells, *[MISSING] * (len(_HEADER) - len(cells))) for cells in table])


def physics_step(found: Validation) -> float:
    """The physics step of the model [s]."""
    return float(load_robot(parameters=found.parameters).model.opt.timestep)


def facts(found: Validation, summary: ValidationSummary) -> dict[str, str]:
    """Numbers for the text."""
    turns, naive = found.turns, found.naive_turns
    v, w = expected_twist(turns, found.parameters).T
    plain = own(turns, found.parameters)
    lag = -float(np.polyfit((v * w)[plain], (turns.lateral - turns.expected_lateral)[plain], 1)[0])
    points, lengths = found.loads.load.shape[1], len(np.unique(turns.length))
    top_yaw_rate = Drive().top_speed / float(np.median(turns.expected_half_width[plain]))
    return {
        "points": str(points),
        "points_per_track": str(points // 2),
        "turns": f"{len(turns.radius):,}",
        "radii": span(turns.radius, "m"),
        "speeds": span(turns.speed, "m/s"),
        "ratios": span(turns.ratio),
        "lengths": str(lengths),
        "places": str(len(turns.radius) // len(turns.radius[plain]) // lengths),
        "decades": f"{math.log10(np.median(np.abs(naive.icr_error)) / np.median(np.abs(turns.icr_error))):.1f}",
        "naive_wider": f"{np.mean(naive.icr_error > 0):.0%}".replace("%", " %"),
        "fastest": significant(float(np.abs(w).max()), "rad/s"),
        "on_the_spot": significant(top_yaw_rate, "rad/s"),
        "lag": significant(1e3 * lag, "ms"),
        "shift": significant(1e3 * lag * float(turns.speed.max()), "mm"),
        "spread": significant(_speed_spread(found, turns)),
        "naive_spread": significant(_speed_spread(found, naive)),
        "expected_spread": percent(float(np.abs(found.loads.expected - 1).max())),
        "watch": f"{WATCH:g} s",
        "creep_angle": _creep_angle(found),
        "robots": str(convergence.ROBOTS),
        "duration": f"{convergence.DURATION:g} s",
        "reference": f"{1e3 * convergence.REFERENCE_STEP:g} ms",
        "energy_robots": str(energy.ROBOTS),
        "icr_median": percent(summary.icr_error.median),
        "icr_worst": percent(summary.icr_error.worst),
        "naive_icr_median": percent(summary.naive_icr_error.median),
        "top_speed": significant(float(turns.speed.max()), "m/s"),
        "loaded_turns": str(len(found.loads.load)),
        "pad_spread": percent(summary.pad_load_spread),
        "creep": significant(summary.creep_mm_per_s, "mm/s"),
        "largest_creep": significant(1e3 * float(found.creep.speed.max()), "mm/s"),
        "sliding": percent(summary.sliding_acceleration_error),
        "travelled": significant(found.convergence.travelled, "m"),
        "solvers": significant(summary.solver_difference_mm, "mm"),
        "traction": significant(float(found.energy.traction[-1]), "J", 3),
        "damping": significant(float(found.energy.damping[-1]), "J"),
        "residual": percent(summary.energy_residual),
        "friction_loss": percent(summary.friction_loss_error),
        "residual_joule": significant(found.energy.residual * float(np.abs(found.energy.kinetic).max()), "J"),
    }


def conditions(found: Validation, manifest: Mapping[str, Any], command: str) -> dict[str, str]:
    """Robot, ground, seed and command of each figure, on one line."""
    p, ground = found.parameters, found.ground
    file = manifest.get("config", {}).get("robot")
    size = f"b {1e3 * p.half_gauge:g} mm, contact {1e3 * p.contact_length:g} mm, {p.mass:g} kg"
    robot = f"{'shipped robot' if file is None else Path(file).name}: {size}"
    friction = f"friction {ground.along:g} along, {{}} across".format
    own_ground, ratios = friction(f"{ground.across:g}"), friction(span(ground.along * found.turns.ratio))
    nearest = friction(f"{ground.along * nearest_ratio(found.turns, ground):.3g}")
    fixed, random = "no random numbers", f"seed {manifest.get('seed', MISSING)}"
    of_figures = {
        **dict.fromkeys(("turns", "left"), (ratios, fixed)),
        "slip": (nearest, fixed),
        **dict.fromkeys(("loads", "slopes"), (own_ground, fixed)),
        **dict.fromkeys(("steps", "energy"), (own_ground, random)),
    }
    return {name: " · ".join([robot, *parts, relative_command(command)]) for name, parts in of_figures.items()}


def _speed_spread(found: Validation, turns: Turns) -> float:
    """Largest difference of slip between the speeds of one radius, of the robot itself near its ground's friction."""
    rows = own(found.turns, found.parameters) & (found.turns.ratio == nearest_ratio(found.turns, found.ground))
    slips = (turns.slip[rows & (turns.radius == radius)] for radius in np.unique(turns.radius))
    return max(float(np.nan_to_num(np.ptp(slip, axis=0)).max()) for slip in slips)


def _creep_angle(found: Validation) -> str:
    """The slope whose creep the summary reports: the reference, or less where that does not hold a robot."""
    at_reference = int(np.argmin(np.abs(ANGLES - REFERENCE_ANGLE)))
    return span(np.degrees(found.creep.angle[:, at_reference]), "°")


def _worst_and_median(error: Array, unit: str = "") -> str:
    size = np.abs(error)
    return pair([significant(float(np.nanmax(size))), significant(float(np.nanmedian(size)))], unit)
