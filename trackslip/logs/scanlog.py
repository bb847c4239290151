"""The scans of the plate during a run, for methods that fit a motion to ranges."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from trackslip.errors import LogError
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

    def first_beam(self) -> np.ndarray:
        """(T,) index of the first beam of the cluster; 0 if there is none."""
        step = self.scan.beam_step
        index = np.rint((self.cluster.bearing[:, 0] - self.scan.bearings[0]) / step).astype(int)
        return np.where(self.cluster.count > 0, index, 0)

    def ranges(self) -> tuple[Array, np.ndarray]:
        """Ranges of all rows in sequence, and their number in each row (T,).

        The ranges of a row start at its first beam [m], with NaN for beams without a return or from something else.
        """
        cluster, width = self.cluster, self.cluster.width
        within = np.arange(cluster.hit.shape[1]) < width[:, None]
        return np.where(cluster.hit, cluster.range, np.nan)[within], width

    def metadata(self) -> dict[str, Any]:
        """Everything but the ranges, JSON-compatible."""
        scan = self.scan
        return {
            "first_bearing": float(scan.bearings[0]),
            "beam_step": scan.beam_step,
            "beams": len(scan.bearings),
            "noise": scan.noise,
            "max_range": scan.max_range if np.isfinite(scan.max_range) else None,
            "dropout": scan.dropout,
            "mount": [float(value) for value in scan.mount],
            "plate": {"length": self.plate.length, "thickness": self.plate.thickness},
        }

    @classmethod
    def of(
        cls,
        metadata: Mapping[str, Any],
        first_beam: np.ndarray,
        ranges: Array,
        width: np.ndarray,
        lost: np.ndarray,
        hidden: Array,
    ) -> ScanLog:
        """Restore from the results of the methods of the same names and the clusters' `lost` (T,) and `hidden` (T, 2).

        Raises LogError if they are invalid.
        """
        try:
            beams = int(metadata["beams"])
            bearings = metadata["first_bearing"] + metadata["beam_step"] * np.arange(beams)
            reach = metadata["max_range"]
            scan = Scan(
                bearings,
                np.empty((0, beams)),
                float(metadata["noise"]),
                np.array(metadata["mount"], float),
                np.inf if reach is None else float(reach),
                float(metadata["dropout"]),
            )
            plate = Plate(**metadata["plate"])
        except (KeyError, TypeError, ValueError) as error:
            raise LogError(f"invalid description of its scanner ({type(error).__name__}: {error})") from error
        if (first_beam < 0).any() or (first_beam + width > beams).any():
            raise LogError(f"its ranges are of other beams than the scanner's {beams}")
        column = np.arange(width.max(initial=1))
        padded = np.full((len(width), len(column)), np.nan)
        padded[column < width[:, None]] = ranges
        hit = np.isfinite(padded)
        bearing = bearings[np.minimum(first_beam[:, None] + column, beams - 1)]
        return cls(scan, plate, Cluster(bearing, np.where(hit, padded, 1.0), hit, hit.sum(axis=1), lost, hidden))
