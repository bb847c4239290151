"""`trackslip validate`: how far the simulator is from theory."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from experiments.driving.sample_runs import record_turns
from experiments.options.validate import ValidateConfig
from experiments.report.terminal import print_table, progress
from experiments.report.validation import render
from experiments.storage.manifest import command_line, make_manifest
from experiments.storage.plain_json import plain, write_json
from experiments.storage.results import MANIFEST_FILE, REPORT_FILE, SUMMARY_FILE, results_folder
from experiments.validation.convergence import converge
from experiments.validation.energy import account
from experiments.validation.results import Validation, summarise
from experiments.validation.standing import creep, loads, slide, straight_drift
from experiments.validation.turning import turn
from sim.ground.ground import Ground
from sim.robot.file import load_robot_file
from sim.robot.parameters import RobotParameters
from sim.robot.robot import load_robot
from sim.seeds import generator


def run(config: ValidateConfig) -> None:
    """Measure, store and print."""
    began = time.perf_counter()
    parameters, ground = load_robot_file(config.robot)
    ground = Ground(ground.along, ground.across)  # even, level, lasting
    with results_folder(config.out) as folder:
        stages: dict[str, float] = {}
        found = validate(parameters, ground, config, stages)
        wall = time.perf_counter() - began
        summary = plain(summarise(found) | {"timing": {"wall_s": wall, "stages": stages}})
        about = make_manifest(
            "validate",
            config,
            wall,
            seed=config.seed,
            model_sha256=load_robot(parameters=parameters).digest,
            robot=parameters,
            ground=ground,
        )
        page = render(found, summary, about, command_line("validate"))
        page.write(folder, config.pdf)
        write_json(folder / SUMMARY_FILE, summary)
        write_json(folder / MANIFEST_FILE, about)
        if config.rrd:
            record_turns(folder, config.robot, config)
    print_table("The simulator against theory", ("quantity", "measured"), rows(summary))
    print(f"{config.out / REPORT_FILE}: {time.perf_counter() - began:.1f} s")


def validate(
    parameters: RobotParameters, ground: Ground, config: ValidateConfig, stages: dict[str, float]
) -> Validation:
    """All measurements; how long each stage took goes into `stages` [s]."""
    threads = config.threads
    with _stage(stages, "turning") as report:
        turns = turn(parameters, ground, threads, False, report)
    with _stage(stages, "turning, default contact") as report:
        naive_turns = turn(parameters, ground, threads, True, report)
    with _stage(stages, "standing"):
        found_loads, naive_loads = (loads(parameters, ground, threads, default) for default in (False, True))
        found_creep, found_slide = creep(parameters, ground, threads), slide(parameters, ground, threads)
        drift = straight_drift(parameters, ground, threads)
    with _stage(stages, "convergence") as report:
        convergence = converge(parameters, ground, generator(config.seed, "convergence"), threads, report)
    with _stage(stages, "energy"):
        energy = account(parameters, ground, generator(config.seed, "energy"), threads)
    return Validation(
        parameters=parameters,
        ground=ground,
        turns=turns,
        naive_turns=naive_turns,
        loads=found_loads,
        naive_loads=naive_loads,
        creep=found_creep,
        slide=found_slide,
        drift=drift,
        convergence=convergence,
        energy=energy,
    )


def rows(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """A summary as rows of text."""

    def pair(key: str, percent: bool) -> str:
        worst, median = (summary[key][name] for name in ("worst", "median"))
        return f"{worst:.2%} | {median:.2%}" if percent else f"{worst:.4f} | {median:.4f}"

    own_step = [f"{entry['dt'] * 1e3:g} ms {entry['position_error_mm']:.2f}" for entry in summary["timestep"]]
    return [
        ("turns, simulated and by theory", f"{summary['turns']}"),
        ("half width of the ICRs, worst | median error", pair("icr_error", True)),
        ("  with MuJoCo's default contact", pair("naive_icr_error", True)),
        ("slip, worst | median error", pair("slip_error", False)),
        ("  with MuJoCo's default contact", pair("naive_slip_error", False)),
        ("lateral speed, worst error", f"{summary['lateral_speed_error_mm_per_s']:.2f} mm/s"),
        ("load of a point of contact, largest deviation", f"{summary['pad_load_spread']:.1%}"),
        ("  with MuJoCo's default contact", f"{summary['naive_pad_load_spread']:.0%}"),
        ("sink", f"{summary['sink_mm']:.2f} mm"),
        ("roll | pitch in turns, largest", f"{summary['roll_deg']:.3f} | {summary['pitch_deg']:.3f} deg"),
        (f"creep, parked on {summary['creep_angle_deg']:.3g} deg", f"{summary['creep_mm_per_s']:.3f} mm/s"),
        ("sliding beyond the friction angle, worst error", f"{summary['sliding_acceleration_error']:.1%}"),
        ("drift to the side after 10 m straight on", f"{summary['straight_drift_mm']:.4f} mm"),
        ("CG and Newton, apart after 30 s", f"{summary['solver_difference_mm']:.3f} mm"),
        ("error of the step after 30 s [mm]", ", ".join(own_step)),
        ("energy not accounted for, of what is stored", f"{summary['energy_residual']:.2%}"),
        ("loss in friction, from Coulomb's law", f"{summary['friction_loss_error']:+.1%}"),
    ]


@contextmanager
def _stage(stages: dict[str, float], name: str) -> Iterator[Any]:
    began = time.perf_counter()
    with progress(name, 1.0, "of the stage") as report:
        yield report
    stages[name] = time.perf_counter() - began
