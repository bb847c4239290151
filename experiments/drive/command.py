"""`trackslip drive`: a tracked robot over a course."""

from experiments.common.manifest import command_line
from experiments.common.results import DRIVE_RECORDING, PICTURES_FOLDER, RECORDINGS_FOLDER, REPORT_FILE, RUNS_FILE
from experiments.common.run import Run
from experiments.drive.config import Config
from sim.opengl import prefer_egl


def run(config: Config) -> None:
    """Drive, store the run, and print how it went."""
    if config.pictures or config.video is not None:
        prefer_egl()  # before the modules below import MuJoCo, which chooses its OpenGL then

    from experiments.drive.course import drive_course
    from experiments.drive.page import answer, page, tracks_table
    from experiments.drive.pictures import require_video, write_pictures, write_video
    from experiments.drive.recording import record_course_drive
    from experiments.drive.results import drive_summary, write_course_run
    from experiments.drive.teleop import teleoperate
    from experiments.drive.world import CourseWorld

    if config.video is not None:
        require_video()
    world = CourseWorld.of(config)
    with Run(config) as run:
        if config.teleop:
            drive = teleoperate(world)
        else:
            with run.progress(f"{world.robot.name} on {config.course}", config.duration) as advance:
                drive = drive_course(world.traverse, world.pilot(), world.flippers(), advance)
        result, about, looks = drive_summary(drive), world.about, world.with_looks()
        manifest = run.manifest(**about)
        run.write({"drive": result}, simulated=result["duration"], manifest=manifest)
        write_course_run(drive, about, run.folder / RUNS_FILE)
        with run.busy("recording"):
            record_course_drive(run.folder / RECORDINGS_FOLDER / DRIVE_RECORDING, drive, looks)
        with run.busy("pictures"):
            files = write_pictures(run.folder / PICTURES_FOLDER, drive, looks, config.pictures)
        pictures = [f"{PICTURES_FOLDER}/{file.name}" for file in files]
        reply = answer(drive, result, config.out)
        page(drive, result, reply, manifest, command_line("drive"), pictures).write(run.folder)
        if config.video is not None:
            with run.progress("video", result["duration"]) as advance:
                write_video(config.video, drive, looks, advance)
    print(f"{reply.heading}.")
    for name, value in reply.facts:
        print(f"{name}: {value}".replace("−", "-"))
    tracks_table(result).print()
    print(f"{config.out / REPORT_FILE}: {run.wall:.1f} s; next: {reply.next[0]}")
