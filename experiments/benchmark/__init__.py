"""`trackslip benchmark`: every controller with every compensation, on paths and grounds, in one table."""

from experiments.benchmark.command import run

__all__ = ["run"]
