"""The figure of a planned drive: its path in the area, and the speeds of the belts over time."""

from __future__ import annotations

from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from experiments.common.colours import BLUE, GREEN, GREY, ORANGE
from experiments.common.style import BAND, legend_below, make_room, plane, styled, subplots
from trackslip.planning.plan import DrivePlan


@styled
def draw_plan(plan: DrivePlan) -> Figure:
    """Draw a plan."""
    figure, (place, speeds) = subplots(3.6, 1, 2, width_ratios=(1, 1.6))
    length, width = plan.limits.area
    place.add_patch(Rectangle((-length / 2, -width / 2), length, width, fill=False, ec=GREY, lw=1.2, label="area"))
    low, (across, up) = plan.places.low, plan.places.size
    place.add_patch(Rectangle(tuple(low), across, up, color=BAND, lw=0, label="where it may get to"))
    place.plot(*plan.path.T, color=BLUE, label="expected path")
    place.plot(*plan.start[:2], "o", color=GREEN, label="start")
    plane(place, title="Path")
    for values, name, colour in zip(plan.speeds.T, ("left", "right"), (BLUE, ORANGE), strict=True):
        speeds.step(plan.time, values, where="post", color=colour, label=name)
    speeds.set(title="Belts", xlabel="time [s]", ylabel="speed [m/s]", xlim=(0, plan.limits.duration))
    make_room(speeds)
    speeds.legend(loc="upper right", ncols=2)
    legend_below(figure, place.get_legend_handles_labels()[0], ncols=4)
    return figure
