"""rehab_opt on the same task: its acceleration bound, certificate and Command included."""

from __future__ import annotations

from collections import Counter
from importlib.metadata import PackageNotFoundError, version

from bench.peers.contender import Array, Contender
from bench.peers.path import HandPath
from rehab_opt import PoseTracker, SerialChain
from rehab_opt.control.command import Status

__all__ = ["Ours"]


class Ours(Contender):
    """`PoseTracker.step` and the integration a caller would write.

    Parameters
    ----------
    compiled : machine code, or CasADi's virtual machine (what `REHAB_OPT_COMPILE=0` gives).
    """

    def __init__(self, chain: SerialChain, *, dt: float, compiled: bool) -> None:
        self.name = "rehab_opt, compiled" if compiled else "rehab_opt, virtual machine"
        self.versions = {name: _version(name) for name in ("rehab_opt", "casadi", "numpy")}
        self.chain, self.dt = chain, dt
        self.tracker = PoseTracker(chain, dt=dt, compile=compiled)
        self.statuses: Counter[Status] = Counter()

    def pose(self, q: Array) -> Array:
        return self.chain.pose(q)

    def target(self, path: HandPath, k: int) -> tuple[Array, Array]:
        return path.poses[k].copy(), path.twists[k].copy()

    def tick(self, q: Array, target: tuple[Array, Array]) -> Array:
        pose, twist = target
        command = self.tracker.step(q, pose, twist)
        self.statuses[command.status] += 1
        after: Array = q + self.dt * command.value
        return after


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "source tree"
