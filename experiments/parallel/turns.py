"""Work that is timed in turns: each piece of work in a process of its own, only one of which works at a time.

Machines become faster and slower by the minute. Where times are compared, all of the work must meet the same moments.
"""

from __future__ import annotations

import contextlib
import multiprocessing
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from experiments.parallel.executors import WorkersFailedError
from experiments.parallel.workers import deaf_children

_PATIENCE = 10  # how long a process may take to end [s]

Result = TypeVar("Result")


def take_turns(
    work: Callable[..., Generator[float, None, Result]],
    arguments: Sequence[tuple[Any, ...]],
    progress: Callable[[int, float], None] = lambda k, share: None,
) -> list[Result]:
    """Do some work once for each tuple of arguments, piece by piece, and return what it returns.

    After each piece the work yields the share of it that is done [-], and waits for its next turn, which is that of
    the least share: all begin together and end together. After each turn `progress` is called with the number of the
    work, counted from 0, and the share that the turn has added.

    Raises:
        WorkersFailedError: when a process dies.
        Exception: what the work raises.
    """
    results: dict[int, Result] = {}
    with contextlib.ExitStack() as stack:
        workers = [stack.enter_context(_worker(work, those)) for those in arguments]
        shares = dict.fromkeys(range(len(workers)), 0.0)
        while shares:
            k = min(shares, key=shares.__getitem__)
            try:
                workers[k].send(None)
                answer = workers[k].recv()
            except (EOFError, OSError) as error:
                raise WorkersFailedError(f"the process of {arguments[k]} died") from error
            if not isinstance(answer, _End):
                progress(k, answer - shares[k])
                shares[k] = answer
                continue
            if answer.error is not None:
                raise answer.error
            results[k] = answer.result
            progress(k, 1.0 - shares.pop(k))
    return [results[k] for k in range(len(arguments))]


@dataclass(frozen=True)
class _End:
    """What a process sends instead of a share after its last piece."""

    result: Any = None
    error: Exception | None = None


@contextlib.contextmanager
def _worker(work: Callable[..., Generator[float, None, Any]], arguments: tuple[Any, ...]) -> Iterator[Connection]:
    """The connection to a process that does a piece of work for each message."""
    context = multiprocessing.get_context("spawn")  # copies would inherit the state of the engine's threads
    ours, theirs = context.Pipe()
    process = context.Process(target=_do, args=(work, arguments, theirs), daemon=True)
    with deaf_children():
        process.start()
    theirs.close()  # so that the process's death is noticed
    try:
        with ours:
            yield ours
        process.join(_PATIENCE)
    finally:
        process.terminate()
        process.join()


def _do(work: Callable[..., Generator[float, None, Any]], arguments: tuple[Any, ...], connection: Connection) -> None:
    pieces = work(*arguments)
    with contextlib.suppress(EOFError, BrokenPipeError):  # the other process has ended
        while True:
            connection.recv()
            try:
                connection.send(next(pieces))
            except StopIteration as end:
                connection.send(_End(end.value))
                return
            except Exception as error:
                connection.send(_End(error=error))
                return
