"""`trackslip drive`: drive a tracked robot over a course."""

from dataclasses import replace
from typing import Final

from experiments.common.manifest import command_line
from experiments.common.results import (
    DRIVE_RECORDING,
    PICTURES_FOLDER,
    RECORDINGS_FOLDER,
    REPORT_FILE,
    RUNS_FILE,
)
from experiments.common.run import Run
from experiments.drive.config import Config
from sim.engine.opengl import may_draw, prefer_egl
from trackslip.errors import TrackslipError, counted

_USUAL: Final = 3  # number of pictures unless the option names another


def check_robot(source: str) -> None:
    """Print what is known about a robot; raises TrackslipError if it can't drive."""
    from sim.robot.check import check

    checked = check(source)
    print(checked)
    if checked.errors:
        raise TrackslipError(f"robot {source}: {counted(len(checked.errors), 'error')}, see above")


def run(config: Config) -> None:
    """Drive the course, store the run, and print how it went; or only check the robot."""
    if config.check:
        check_robot(config.robot)
        return
    count = config.pictures
    if count is None:
        count = _USUAL if may_draw() else 0
    if count:
        prefer_egl()  # before the modules below import MuJoCo, which then chooses its OpenGL

    from experiments.drive.course import drive_course
    from experiments.drive.page import answer, page, tracks_table
    from experiments.drive.pictures import write_pictures
    from experiments.drive.recording import record_course_drive
    from experiments.drive.results import drive_summary, write_course_run
    from experiments.drive.world import about_world, driver, make_world
    from experiments.simulate.motors import without_motors
    from sim.motors.motor import TOP_SPEED, or_tireless
    from sim.robot.tracked_model import build_tracked

    world = make_world(config)
    robot = world.tracked.robot
    course = world.course[0]
    about = about_world(world)
    looks = build_tracked(
        robot, course, preset=config.preset, friction=course.frictions, looks=True
    )
    motors = replace(or_tireless(robot.drive), top_speed=world.top_speed)
    notes = without_motors(config.robot, motors)
    if robot.drive is None and world.top_speed > TOP_SPEED:
        notes.append(
            f"a robot without motors is as fast as `drive` is told, {world.top_speed:g} m/s here; "
            f"in all other commands, its top speed is {TOP_SPEED:g} m/s"
        )
    with Run(config) as run:
        with run.progress(f"{robot.name} on {config.course}", config.duration) as advance:
            drive = drive_course(world, driver(config, world), advance)
        result = drive_summary(drive)
        manifest = run.manifest(**about)
        run.write({"drive": result}, simulated=result["duration"], manifest=manifest)
        write_course_run(drive, about, run.folder / RUNS_FILE)
        with run.busy("recording"):
            record_course_drive(run.folder / RECORDINGS_FOLDER / DRIVE_RECORDING, drive, looks)
        with run.busy("pictures"):
            pictures = []
            try:
                pictures = write_pictures(run.folder / PICTURES_FOLDER, drive, looks, count)
            except TrackslipError as error:
                if config.pictures is not None:
                    raise
                notes.append(f"there are no pictures, as {error}")
        reply = answer(drive, result, config.out, notes)
        table = tracks_table(result)
        page(drive, reply, table, manifest, command_line("drive"), pictures).write(run.folder)
    print(f"{reply.heading}.")
    for name, value in reply.facts:
        print(f"{name}: {value}")
    table.print()
    for warning in reply.warnings:
        print(f"Warning: {warning}.")
    for note in notes:
        print(f"Note: {note}.")
    print(f"{config.out / REPORT_FILE}: {run.wall:.1f} s; next: {reply.next[0]}")
