"""A worker process of `experiments.common.pool`: does the tasks that arrive on standard input.

Tasks and outcomes are pickled twice, so that one that can't be unpickled is an error of its task.
"""

import os
import pickle
import queue
import signal
import sys
import threading
import traceback
from typing import BinaryIO, NoReturn


def main() -> None:
    """Do tasks, one at a time, until standard input ends, as it does when the command ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the command ends its workers
    outcomes = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what tasks print doesn't get between the outcomes
    tasks: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(sys.stdin.buffer, tasks), daemon=True).start()
    while True:
        pickle.dump(_outcome(tasks.get()), outcomes)
        outcomes.flush()


def _receive(stream: BinaryIO, tasks: "queue.SimpleQueue[bytes]") -> NoReturn:
    """Pass on tasks, and end the process, even in the middle of a task, when the stream ends."""
    try:
        while True:
            tasks.put(pickle.load(stream))
    finally:
        os._exit(0)


def _outcome(task: bytes) -> bytes:
    """Do a task; returns whether it succeeded and its result, or its error, with the traceback as a
    note.
    """
    try:
        do, argument = pickle.loads(task)
        return pickle.dumps((True, do(argument)))
    except BaseException as error:  # tasks may raise anything
        error.add_note(traceback.format_exc())
        try:
            return pickle.dumps((False, error))
        except Exception:  # an error that can't be pickled
            return pickle.dumps((False, RuntimeError(repr(error))))


if __name__ == "__main__":
    main()
