"""`trackslip reproduce`: the paper from its first run to its last figure."""

from experiments.reproduce.config import Config
from experiments.reproduce.reproduction import reproduce


def run(config: Config) -> None:
    """Drive the grid, identify the laws, verify them in closed loop, store, report and print."""
    reproduce(config)
