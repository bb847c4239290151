"""`trackslip drive`: a tracked robot over a course."""

from __future__ import annotations

import hashlib
import shlex
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from experiments.driving.course_pilots import CoursePilot
from experiments.driving.course_run import CourseRun, drive_course
from experiments.driving.course_table import write_course_run
from experiments.driving.course_world import CourseWorld
from experiments.driving.teleop import HELP, Keyboard, Teleop
from experiments.measuring.course_drive import DriveResult
from experiments.options.drive import DriveConfig
from experiments.recording import record_course_drive
from experiments.recording.course_pictures import write_pictures, write_video
from experiments.recording.video import require_video
from experiments.report.course_drive import TRACKS_HEADER, lines, render, sentence, track_rows
from experiments.report.formats import for_terminal
from experiments.report.terminal import busy, print_table, progress
from experiments.storage.manifest import command_line, make_manifest
from experiments.storage.results import (
    DRIVE_RECORDING,
    PICTURES_FOLDER,
    RECORDINGS_FOLDER,
    REPORT_FILE,
    RUNS_FILE,
    results_folder,
    write_results,
)
from sim.traverse.world import Traverse

_NAME = "drive"


def run(config: DriveConfig) -> None:
    """Drive, store the run, and print how it went."""
    began = time.perf_counter()
    if config.video is not None:
        require_video()
    world = CourseWorld.of(config)
    with results_folder(config.out) as folder:
        driven = _teleoperate(world) if config.teleop else _drive(world, world.pilot())
        wall = time.perf_counter() - began
        result = DriveResult.of(driven, world.course)
        about = _about(world)
        manifest = make_manifest("drive", config, wall, **about)
        summary = {"drive": asdict(result), "timing": {"wall_s": wall, "simulated_s": result.duration}}
        write_results(folder, summary, manifest)
        radius = max(r for _, _, r in world.robot.hull)
        write_course_run(driven, _NAME, about, radius, folder / RUNS_FILE)
        looks = world.with_looks()
        with busy("recording"):
            record_course_drive(folder / RECORDINGS_FOLDER / DRIVE_RECORDING, driven, looks, about)
        if config.pictures:
            with busy("pictures"):
                write_pictures(folder / PICTURES_FOLDER, driven, looks, world.course, config.pictures)
        pictures = sorted((folder / PICTURES_FOLDER).glob("*.png"))
        names = [f"{PICTURES_FOLDER}/{file.name}" for file in pictures]
        render(driven, result, world.course, manifest, command_line("drive"), names).write(folder)
        if config.video is not None:
            with progress("video", result.duration) as advance:
                write_video(config.video, driven, looks, world.course, advance)
    print(f"{sentence(result)}.")
    for line in lines(result):
        print(*for_terminal([[line]])[0])
    print_table("Tracks", TRACKS_HEADER, for_terminal(track_rows(result)))
    shown = shlex.quote(str(config.out))
    print(f"{config.out / REPORT_FILE}: {time.perf_counter() - began:.1f} s; next: trackslip view {shown}")


def _drive(world: CourseWorld, pilot: CoursePilot) -> CourseRun:
    """Drive without anybody watching."""
    with progress(f"{world.robot.name} on {world.config.course}", world.config.duration) as advance:

        def each(traverse: Traverse, _: CoursePilot) -> bool:
            advance(traverse.period)
            return True

        return drive_course(world.traverse, pilot, world.flippers(), each)


def _teleoperate(world: CourseWorld) -> CourseRun:
    """Drive by the keyboard."""
    by_reflex = world.config.flipper_angles() is None
    keyboard = Keyboard(world.traverse.tracked, world.top_speed, by_reflex, world.set_angles)
    viewer = Teleop(world.with_looks(), keyboard)
    print(HELP, flush=True)
    reflex = world.flippers()
    try:
        return drive_course(
            world.traverse, keyboard, lambda now: reflex(now) if keyboard.by_reflex else keyboard.angles, viewer
        )
    finally:
        viewer.close()


def _about(world: CourseWorld) -> dict[str, Any]:
    """What describes the run: robot, course, model, as far as the options don't."""
    robot, course, model = world.robot, world.course, world.traverse.tracked.model
    buffer = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return {
        "geometry": {"half_gauge": robot.half_gauge, "sprocket_radius": max(r for _, _, r in robot.hull)},
        "robot": {**asdict(robot), "model": Path(robot.model).name},
        "course": {"friction": course.friction, "seed": course.seed, "goal": course.goal, "width": course.width},
        "seed": course.seed,
        "mass": float(model.body_subtreemass[world.traverse.tracked.body]),
        "timestep": float(model.opt.timestep),
        "model_sha256": hashlib.sha256(buffer.tobytes()).hexdigest(),
    }
