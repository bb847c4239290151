"""Trajectories as text files in the TUM format: `time x y z qx qy qz qw`, a line per pose."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from trackslip.errors import InvalidValueError, OutputError


def write_tum(path: str | Path, time: ArrayLike, pose: ArrayLike) -> None:
    """Write poses (K, 3) [m, m, rad] at times (K,) [s] for tools such as evo.

    Poses lie in the plane z = 0. A heading that is NaN, as it was not measured, is written as 0.

    Raises:
        InvalidValueError: if the numbers of times and poses differ.
        OutputError: if the file cannot be written.
    """
    time, pose = np.asarray(time, float), np.asarray(pose, float)
    if time.ndim != 1 or pose.shape != (len(time), 3):
        raise InvalidValueError("pose", pose.shape, f"of shape {(*time.shape, 3)}, as there are that many times")
    half, none = np.nan_to_num(pose[:, 2], nan=0.0) / 2, np.zeros(len(time))
    rows = np.column_stack([time, pose[:, :2], none, none, none, np.sin(half), np.cos(half)])
    text = "".join(" ".join(map("{:.9f}".format, row)) + "\n" for row in rows.tolist())
    try:
        Path(path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error
