"""rehab_opt on the same task: its acceleration bound, certificate and Command included."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version

from bench.peers.contender import Array, Contender
from bench.peers.path import HandPath
from rehab_opt import Command, PoseTracker, SerialChain, Status

__all__ = ["Ours"]


class Ours(Contender):
    """`PoseTracker.step`; `not_ok` counts the ticks that its primary solver did not solve.

    Parameters
    ----------
    compiled : machine code, or CasADi's virtual machine (what `REHAB_OPT_COMPILE=0` gives).
    """

    def __init__(self, chain: SerialChain, *, dt: float, compiled: bool) -> None:
        self.name = "rehab_opt, compiled" if compiled else "rehab_opt, virtual machine"
        self.versions = {name: _version(name) for name in ("rehab_opt", "casadi", "numpy")}
        self.chain, self.dt = chain, dt
        self.tracker = PoseTracker(chain, dt=dt, compile="wait" if compiled else False)
        self.not_ok = 0

    def pose(self, q: Array) -> Array:
        return self.chain.pose(q)

    def target(self, path: HandPath, k: int) -> tuple[Array, Array]:
        return path.poses[k].copy(), path.twists[k].copy()

    def command(self, q: Array, target: tuple[Array, Array]) -> Command:
        pose, twist = target
        return self.tracker.step(q, pose, twist)

    def integrated(self, q: Array, command: Command) -> Array:
        if command.status is not Status.OK:
            self.not_ok += 1
        after: Array = q + self.dt * command.value
        return after


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "source tree"
