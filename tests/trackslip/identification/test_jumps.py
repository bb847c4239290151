"""Jumps of poses."""

import numpy as np
import pytest
from looks import DRIVE, POSE, TIME, holds, look, without
from plain_drives import HUSKY, log_of

from trackslip.identification.preparation import drives_of


@pytest.mark.parametrize("kind", ["poses", "positions"])
@pytest.mark.parametrize(
    ("rows", "offset", "parts", "words"),
    [
        (slice(600, 601), 3.0, 1, ["1 wild pose left out, first at t = 60 s"]),
        (slice(600, 602), 3.0, 1, ["2 wild poses left out, first at t = 60 s"]),
        (slice(600, None), 3.0, 2, ["1 lasting jump of its poses, first at t = 60 s"]),
        (slice(0, 2), -10.0, 1, ["1 lasting jump of its poses, first at t = 0.2 s"]),
    ],
)
def test_jumps_are_left_out_or_cut(rows, offset, parts, words, kind):
    pose = without(POSE, kind)
    pose[rows, 0] += offset
    log = log_of(DRIVE, TIME, pose)
    found, (drives, _) = look(log), drives_of([log])
    assert holds(found.turn, HUSKY.turn_gain)
    cut, lines = found.without_jumps(drives, HUSKY.geometry)
    assert [line.split(": ")[1] for line in lines] == words
    assert len(cut) == parts
    for part in cut:
        assert np.hypot(*np.diff(part.pose[:, :2], axis=0).T).max() < 0.3
