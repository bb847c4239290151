"""The scans of the plate during a run, for methods that fit a motion to ranges."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.scan import Cluster, Plate, Scan


@dataclass(frozen=True)
class ScanLog:
    """The returns of each scan that were attributed to the plate."""

    scan: Scan
    """The scanner, without ranges: (0, B)."""
    plate: Plate
    """The plate that was scanned."""
    cluster: Cluster
    """One cluster per row of the log, without returns where none was found."""
    full: Array | None = None  # (T, B) all ranges of the scans, NaN for no return [m]

    def between(self, first: int, end: int) -> ScanLog:
        """The scans from row `first` up to, but not including, `end`."""
        full = None if self.full is None else self.full[first:end]
        return replace(self, cluster=self.cluster.take(np.arange(first, end)), full=full)

    def first_beam(self) -> np.ndarray:
        """(T,) index of the first beam of the cluster; 0 if there is none."""
        step = self.scan.beam_step
        index = np.rint((self.cluster.bearing[:, 0] - self.scan.bearings[0]) / step).astype(int)
        return np.where(self.cluster.count > 0, index, 0)

    def ranges(self) -> tuple[Array, np.ndarray]:
        """Ranges [m] of all rows in sequence, each from its first beam, and their number in each row (T,).

        NaN stands for no return, or one from another object.
        """
        cluster, width = self.cluster, self.cluster.width
        within = np.arange(cluster.hit.shape[1]) < width[:, None]
        return np.where(cluster.hit, cluster.range, np.nan)[within], width
