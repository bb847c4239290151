"""A command that is stopped by a signal at each of its file operations, and then run again.

`python tests/helpers/kills.py SIGNAL COMMAND [ARGUMENT ...]` prints, as JSON, the number of
operations and what went wrong. Each run is a process of its own, forked from this one, which has
imported everything already.
"""

import importlib
import json
import os
import sys
import tempfile
import threading
from pathlib import Path

from experiments.__main__ import main
from experiments.cli import run_module
from trackslip.replacement import DRAFT, LOCK, MOVING, STORE

OPERATIONS = ("mkdir", "rename", "replace", "unlink", "rmdir")
CHECKPOINT = "checkpoint.npz"  # of an unfinished training, which resumes on request


def run(arguments: list[str], out: Path, stop_at: int = 0, number: int = 0) -> tuple[int, str]:
    """Run a command, which gets a signal at an operation in `out`; returns its status and errors.

    The number of operations that it began is in a file beside `out`.
    """
    child = os.fork()
    if child == 0:
        _become([*arguments, "--out", str(out)], out, stop_at, number)
    _, status = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(status), out.with_suffix(".stderr").read_text()


def _become(arguments: list[str], out: Path, stop_at: int, number: int) -> None:
    for stream, suffix in ((1, ".stdout"), (2, ".stderr")):
        file = os.open(out.with_suffix(suffix), os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(file, stream)
    counter = open(out.with_suffix(".count"), "w")  # noqa: SIM115
    begun = 0

    def stopping(name):
        real = getattr(os, name)

        def do(path, *rest, **options):
            nonlocal begun
            main_thread = threading.current_thread() is threading.main_thread()
            if main_thread and str(path).startswith(str(out)):
                begun += 1
                counter.seek(0)
                counter.write(str(begun))
                counter.flush()
                if begun == stop_at:
                    os.kill(os.getpid(), number)
            return real(path, *rest, **options)

        return do

    for name in OPERATIONS:
        setattr(os, name, stopping(name))
    sys.argv = ["trackslip", *arguments]
    code = 1
    try:
        main()
        code = 0
    except SystemExit as stop:
        code = stop.code if isinstance(stop.code, int) else 1
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def numbers(out: Path) -> dict:
    """The results, without their times."""
    summary = json.loads((out / "summary.json").read_text())
    return {key: value for key, value in summary.items() if key != "timing"}


def failures(arguments: list[str], number: int, folder: Path) -> tuple[int, dict[int, str]]:
    """The number of file operations of a command, and what went wrong at some of them."""
    whole = folder / "whole"
    code, errors = run(arguments, whole)
    assert code == 0, errors
    count = int(whole.with_suffix(".count").read_text())
    found = {}
    for operation in range(1, count + 1):
        out = folder / f"stopped_{operation}"
        code, errors = run(arguments, out, operation, number)
        if code not in ((-9,) if number == 9 else (130, 0)) or "Traceback" in errors:
            found[operation] = f"stopped: {code} {errors}"
            continue
        resume = ["--resume"] if (out / STORE / CHECKPOINT).exists() else []
        code, errors = run([*arguments, *resume], out)
        complete = code == 2 and "contains results; --overwrite" in errors
        if code != 0 and not complete:
            found[operation] = f"again: {code} {errors}"
        elif numbers(out) != numbers(whole):
            found[operation] = "other results"
        elif {DRAFT, MOVING, LOCK, STORE} & set(os.listdir(out)):
            found[operation] = f"left behind: {os.listdir(out)}"
    return count, found


if __name__ == "__main__":
    signal_number, *words = sys.argv[1:]
    run_module(words[0])
    importlib.import_module("sim.fleet.fleet")
    with tempfile.TemporaryDirectory() as place:
        if words[0] == "tune":  # its own four paths take minutes
            path = Path(place) / "short.csv"
            path.write_text("x,y\n0,0\n0.7,0.1\n1.4,0.2\n")
            importlib.import_module("experiments.tune").TRAINING_PATHS = (str(path),)
        operations, wrong = failures(words, int(signal_number), Path(place))
    print(json.dumps({"operations": operations, "failures": wrong}))
