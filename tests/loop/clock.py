"""A clock of a test's own, on which a loop runs as fast as it computes."""


class Clock:
    """Goes on by a microsecond a look, and by what is slept."""

    def __init__(self) -> None:
        self.now, self.oversleeps = 100.0, dict[int, float]()
        self.sleeps = 0

    def monotonic(self) -> float:
        self.now += 1e-6
        return self.now

    def sleep(self, seconds: float) -> None:
        self.sleeps += 1
        self.now += seconds + self.oversleeps.get(self.sleeps, 5e-5)
