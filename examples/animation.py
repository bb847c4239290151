"""Draw the README's animation: the same commands on the paper's path, with and without slip
compensation.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.animation import FuncAnimation
from matplotlib.patches import Rectangle
from matplotlib.transforms import Affine2D

import sim
import trackslip
from trackslip.logs.runlog import RunLog

COLOURS = {"none": "#C1272D", "icr_radius": "#0072B2"}
LABELS = {"none": "without compensation", "icr_radius": "with the identified law"}
LENGTH, TRACK = 0.5, 0.07  # length of the robot and width of a track, as drawn [m]


def drive() -> dict[str, RunLog]:
    """Simulate the paper's feedforward control; returns a run for each slip law, by the law's
    name.
    """
    robot, path = sim.load_robot(), trackslip.paper_reference()
    laws = {
        "none": trackslip.NoSlip(),
        "icr_radius": trackslip.load_laws(robot=robot.geometry)["icr_radius"],
    }
    fleet = sim.Fleet(robot, np.tile(path.pose(0.0), (len(laws), 1)))
    pilots = [
        sim.Pilot(trackslip.Feedforward(), [k], trackslip.FixedLaw(law))
        for k, law in enumerate(laws.values())
    ]
    return dict(zip(laws, sim.closed_loop(fleet, pilots, path), strict=True))


def main(file: Path = Path("out/animation.gif"), frames: int = 80) -> None:
    """Write the animation and print how far from the end of the path the robots stop."""
    runs, path = drive(), trackslip.paper_reference()
    half_gauge = sim.load_robot().geometry.half_gauge
    figure, axes = plt.subplots(figsize=(7.2, 4.6), dpi=100, layout="constrained")
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", xlim=(-4.4, 0.5), ylim=(-0.4, 3.3))
    x, y, _ = path.pose(np.linspace(0, path.duration, 400)).T
    axes.plot(x, y, color="#dddddd", lw=6, solid_capstyle="round", label="path")
    outline = [(-LENGTH / 2, -half_gauge, LENGTH, 2 * half_gauge)]
    outline += [(-LENGTH / 2, side * half_gauge - TRACK / 2, LENGTH, TRACK) for side in (-1, 1)]
    trails, robots = {}, {}
    for name, colour in COLOURS.items():
        error = np.hypot(*(runs[name].truth.pose[-1] - path.pose(path.duration))[:2])
        print(f"{LABELS[name]}: {1e3 * error:.0f} mm from the end of the path")
        (trails[name],) = axes.plot(
            [], [], color=colour, lw=1.8, label=f"{LABELS[name]}, ends {error:.2f} m off"
        )
        patches = [Rectangle((left, low), width, height) for left, low, width, height in outline]
        robots[name] = [axes.add_patch(patch) for patch in patches]
        for patch, alpha in zip(patches, (0.35, 0.9, 0.9), strict=True):
            patch.set(facecolor=colour, edgecolor="none", alpha=alpha)
    axes.legend(loc="lower center", frameon=False)
    axes.spines[["top", "right"]].set_visible(False)

    def draw(frame: int) -> None:
        for name, run in runs.items():
            row = min(frame, frames - 1) * (len(run.time) - 1) // (frames - 1)
            driven = run.truth.pose[: row + 1]
            trails[name].set_data(driven[:, 0], driven[:, 1])
            x, y, heading = driven[-1]
            for patch in robots[name]:
                patch.set_transform(Affine2D().rotate(heading).translate(x, y) + axes.transData)

    pause = frames // 4  # frames at the end
    file.parent.mkdir(parents=True, exist_ok=True)
    FuncAnimation(figure, draw, frames=frames + pause).save(file, writer="pillow", fps=16)
    plt.close(figure)


if __name__ == "__main__":
    main()
