"""`trackslip localize`: poses of a robot's plate from the scans of a laser range finder beside the field."""

from experiments.options.localize import LocalizeConfig as Config

EXAMPLES = (
    ("a plate of 0.5 m by 2 cm", "trackslip localize run.mcap --plate 0.5x0.02"),
    ("a scanner whose place is known", "trackslip localize run.mcap --plate 0.5x0.02 --mount -1.5 -1.5 1.57"),
    ("by other poses", "trackslip localize run.mcap --plate 0.5x0.02 --poses /amcl_pose"),
)


def run(config: Config) -> None:
    """Locate, store and print."""
    from experiments.work.localize import run as work

    work(config)
