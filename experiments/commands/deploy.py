"""`trackslip deploy`: an identified law for another program."""

from experiments.options.deploy import DeployConfig as Config

EXAMPLES = (
    ("parameters of diff_drive_controller", "trackslip deploy out/identify"),
    ("a C header with another law", "trackslip deploy out/identify --to c --law exponential --out slip.h"),
    ("the shipped robot's law in Python", "trackslip deploy --to python --out slip.py"),
)


def run(config: Config) -> None:
    """Print the law, or write it."""
    from experiments.work.deploy import run as work

    work(config)
