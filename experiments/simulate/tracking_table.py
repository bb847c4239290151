"""The table of errors along a path, under its old name."""

from experiments.simulate.tracking import tracking_table

__all__ = ["tracking_table"]
