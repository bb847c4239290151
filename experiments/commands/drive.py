"""`trackslip drive`: a tracked robot over a course."""

from experiments.options.drive import DriveConfig as Config

EXAMPLES = (
    ("the rescue robot on stairs, flippers by reflex", "trackslip drive"),
    ("slowly over a step, with pictures", "trackslip drive --course step10 --speed 0.1 --flippers up --pictures 8"),
    ("your own robot and course, as a video", "trackslip drive --robot r.toml --course c.toml --video drive.mp4"),
    ("by the keyboard", "trackslip drive --course arena --teleop"),
)


def run(config: Config) -> None:
    """Drive, store the run, and print how it went."""
    if config.pictures or config.video is not None:
        from sim.opengl import prefer_egl

        prefer_egl()
    from experiments.work.drive import run as work

    work(config)
