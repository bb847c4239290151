"""Ten minutes of bag: encoders at 50 Hz, poses and scans of 721 beams at 20 Hz."""

import json
import subprocess
import sys

import numpy as np
import pytest
from bags import header, in_order, joint_states, pose_with_covariance, stamp, write_bag
from wandered import wandered

_CODE = """
import json, resource, sys, time
from pathlib import Path
from trackslip.ros.bag import open_bag
from trackslip.ros.drive_log import read_bags
path = Path(sys.argv[1])
(log,) = read_bags(path).runs
beams = sum(len(message.content.ranges) for message in open_bag(path).messages("/scan"))
memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
print(json.dumps([len(log.time), beams, time.process_time(), memory]))
"""
_DURATION = 600.0


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "compression"), [("ros1", "lz4"), ("sqlite3", None), ("mcap", "storage")])
def test_ten_minutes_are_read_in_fifteen_seconds_and_a_gigabyte(tmp_path, kind, compression):
    rng = np.random.default_rng(0)
    log = wandered(duration=_DURATION)
    time = np.arange(0.0, _DURATION, 0.02)
    turned = np.column_stack([np.interp(time, log.time, side) for side in np.cumsum(log.omega * 0.05, axis=0).T])
    joints = [joint_states(stamp(t), ["left", "right"], p, p) for t, p in zip(time, turned.tolist(), strict=True)]
    poses = [pose_with_covariance(stamp(t), p) for t, p in zip(log.time, log.pose.tolist(), strict=True)]
    scans = [_scan(stamp(t), rng) for t in log.time]
    path = write_bag(tmp_path / "run", kind, in_order(joints, poses, scans), compression=compression)
    done = subprocess.run([sys.executable, "-c", _CODE, str(path)], capture_output=True, text=True, check=True)
    rows, beams, seconds, memory = json.loads(done.stdout)
    assert rows == len(np.union1d(np.round(time, 9), np.round(log.time, 9)))
    assert beams == 721 * len(log.time)
    assert seconds < 15.0
    assert memory < 1.0


def _scan(at, rng):
    ranges, intensities = rng.uniform(1.0, 5.0, 721), rng.uniform(0.0, 255.0, 721)
    fields = {"header": header(at, "laser"), "range_max": 30.0, "ranges": ranges, "intensities": intensities}
    return "/scan", "sensor_msgs/msg/LaserScan", at + 1_000_000, fields
