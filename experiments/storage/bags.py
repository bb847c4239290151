"""ROS 2 bags among the results."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from experiments.storage.file_names import file_names
from experiments.storage.results import BAGS_FOLDER
from trackslip.logs.runlog import RunLog


def write_bags(
    folder: Path,
    names: Sequence[str],
    logs: Iterable[RunLog],
    options: Callable[[RunLog], dict[str, Any]] = lambda log: {},
    done: Callable[[float], None] = lambda bags: None,
) -> dict[str, str]:
    """Write a bag of each run, called `names`, to BAGS_FOLDER in `folder`; returns their places in it by these names.

    `options` gives more arguments of `write_bag`; `done` is called with the number of bags since the last call.
    """
    from trackslip.ros.writer import write_bag  # late: few need it

    places = {}
    for log, name, file in zip(logs, names, file_names(names), strict=True):
        write_bag(log, folder / BAGS_FOLDER / file, **options(log))
        places[name] = f"{BAGS_FOLDER}/{file}"
        done(1)
    return places


def bags_text(out: Path, bags: Mapping[str, str]) -> str:
    """A line that says where the bags are."""
    if len(bags) == 1:
        return f"{out / next(iter(bags.values()))}: a ROS 2 bag"
    return f"{out / BAGS_FOLDER}: {len(bags)} ROS 2 bags"
