"""Small grids, and fleets that fail."""

from experiments.simulate.grid_runs import drive_cells
from trackslip.logs.logfile import read_runs

SHORT = ("--radii", "0.6", "1.5", "--speeds", "0.2", "--duration", "4", "--executor", "inline")
ONE = ("--radii", "0.6", *SHORT[3:])
SWEEP = (*SHORT, "--vary", "friction_ratio=1.0,1.2", "--seeds", "0", "1")


def logs(folder):
    """The runs in a folder by their ids."""
    return {log.metadata["id"]: log for log in read_runs(folder / "runs.parquet")}


def fragile(cells, *rest):
    """Drive a fleet that fails if some radius is too wide."""
    if any(cell.radius == 1.5 for cell in cells):
        raise MemoryError("too wide")
    return drive_cells(cells, *rest)
