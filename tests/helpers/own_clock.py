"""A clock that a test sets, in place of the computer's."""


class Clock:
    """A clock that only those who take their time advance."""

    def __init__(self):
        self.now = 0.0
        """The time [s]."""

    def perf_counter(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds
