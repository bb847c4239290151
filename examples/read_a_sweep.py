"""Drive a small sweep and read its table with polars: slip against radius on two grounds."""

import subprocess
import sys
from pathlib import Path

import polars as pl

SWEEP = "grid --radii 0.6 1.0 2.0 --speeds 0.1 0.2 --duration 8 --vary ground=stone,ice --seeds 0 1"


def main(folder: Path = Path("out/read_a_sweep")) -> None:
    """Drive the sweep, and print means and spreads over seeds and speeds."""
    command = [sys.executable, "-m", "experiments", *SWEEP.split(), "--out", str(folder)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    table = pl.read_parquet(folder / "table.parquet")
    slip = (
        table.filter(pl.col("error").is_null())
        .group_by("ground", "radius")
        .agg(
            pl.len().alias("runs"),
            pl.col("slip_l").mean().alias("inner"),
            pl.col("slip_r").mean().alias("outer"),
            (pl.col("slip_r") - pl.col("true_slip_r")).std().alias("error of outer"),
        )
        .sort("ground", "radius")
    )
    print(slip)


if __name__ == "__main__":
    main()
