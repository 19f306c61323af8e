"""An FR3 of franka-sim, which stops as the robot does: `PYTHON tests/loop/franka_robot.py`, by a Python that has it.

franka-sim wants other versions of numpy and MuJoCo than this library, so a virtual environment of its own, which the
tests are told of: `python -m venv .franka && .franka/bin/pip install franka-sim`,
`REHAB_OPT_FRANKA_SIM=.franka/bin/python`.
Its usual model has meshes that are fetched; this one has the masses of its URDF, and no shapes.
"""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

HOST, PORT = "127.0.0.1", 1337
PYTHON = os.environ.get("REHAB_OPT_FRANKA_SIM", "")
DAMPING, ARMATURE = 1.0, 0.3
"""[N m s/rad], [kg m^2] of a joint: assumptions. With 0.1 franka-sim's explicit velocity servo shakes by 0.4 rad/s."""
PATIENCE = 60.0
"""[s] until it answers."""


def model() -> str:
    """The arm as MJCF."""
    import franka_sim  # noqa: PLC0415
    import mujoco  # noqa: PLC0415

    root = ET.parse(Path(franka_sim.__file__).parent / "models" / "fr3.urdf").getroot()
    for link in root.iter("link"):
        for shape in (*link.findall("visual"), *link.findall("collision")):
            link.remove(shape)
    ET.SubElement(ET.SubElement(root, "mujoco"), "compiler", fusestatic="false", balanceinertia="true")
    spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
    for joint in spec.joints:
        joint.damping, joint.armature = DAMPING, ARMATURE
    spec.compile()
    return str(spec.to_xml())


@contextlib.contextmanager
def robot(python: str, *, fifo: int, strict: bool = False) -> Iterator[None]:
    """It answers while the body runs, as urgent as a robot; with `strict` 20 cycles without a command stop it, too."""
    command = [python, __file__, str(fifo), *(["--enforce-comm-constraints"] if strict else [])]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            until = time.monotonic() + PATIENCE
            while not _answers():
                if process.poll() is not None or time.monotonic() > until:
                    raise RuntimeError("franka-sim does not answer")
                time.sleep(0.2)
            yield
        finally:
            process.kill()


def _answers() -> bool:
    with contextlib.suppress(OSError), socket.create_connection((HOST, PORT), timeout=1.0):
        return True
    return False


def main() -> None:
    """Serve until killed; a breach of a limit stops the robot."""
    from franka_sim import run_server  # noqa: PLC0415

    with tempfile.NamedTemporaryFile("w", suffix=".xml") as file:
        file.write(model())
        file.flush()
        os.environ["FR3_MJCF"] = file.name
        with contextlib.suppress(PermissionError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(int(sys.argv.pop(1))))
        sys.argv += ["--enforce-motion-limits", "--no-gripper"]
        run_server.main()


if __name__ == "__main__":
    main()
