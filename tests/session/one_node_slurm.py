"""Many people through a real Slurm of one node: `python -m tests.session.one_node_slurm [PEOPLE]`; 24 by default.

Debian's packages slurmctld, slurmd, slurm-client and munge (apt-get install --no-install-recommends), and
dask-jobqueue. Their daemons are started here, in a folder of their own, as who runs this; the machine's Slurm is left
alone.

Three runs into one folder of results. In the first a person takes their worker with them each time, a job is cancelled
half-way, and Slurm's controller is killed and started again. The second one, of the other half, is killed (SIGKILL)
while people are computed, its dask scheduler with it. The third does the rest. Every computation leaves a line in a
file, which is counted.
"""

from __future__ import annotations

import argparse
import getpass
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from rehab_opt.session.many.participant import Participant
from rehab_opt.session.many.pools import cores
from rehab_opt.session.many.results import ResultRow
from rehab_opt.session.many.run import run_many
from tests.session.stand_in_work import person, quick

NEEDED = ("munged", "slurmctld", "slurmd", "sbatch", "squeue", "scancel", "scontrol")
CONFIG = """
ClusterName=one
SlurmctldHost={host}(127.0.0.1)
SlurmUser={user}
SlurmdUser={user}
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SwitchType=switch/none
MpiDefault=none
SelectType=select/linear
SelectTypeParameters=CR_Memory
ReturnToService=2
SchedulerParameters=sched_interval=1
NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} RealMemory={memory} State=UNKNOWN
PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP OverSubscribe=FORCE:4
"""


def free_port() -> int:
    with socket.socket() as asked:
        asked.bind(("127.0.0.1", 0))
        return int(asked.getsockname()[1])


@contextmanager
def daemon(*command: str) -> Iterator[subprocess.Popen[bytes]]:
    """A daemon in the foreground, ended with what it is needed for."""
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as started:
        try:
            yield started
        finally:
            started.terminate()
            try:
                started.wait(20.0)
            except subprocess.TimeoutExpired:
                started.kill()


def until(what: str, holds: object, seconds: float = 120.0) -> None:
    """Wait."""
    assert callable(holds)
    late = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < late, f"{what} took more than {seconds:g} s"
        time.sleep(0.2)


def said(*command: str) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout


class Slurm:
    """One node, in a folder."""

    def __init__(self, folder: Path, opened: ExitStack) -> None:
        self._folder, self._opened = folder, opened
        for name in ("state", "spool"):
            (folder / name).mkdir()
        self.conf = folder / "slurm.conf"
        facts = {"host": socket.gethostname(), "user": getpass.getuser(), "ports": (free_port(), free_port())}
        memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2**20
        self.conf.write_text(CONFIG.format(**facts, folder=folder, cpus=os.cpu_count() or cores(), memory=memory - 1))
        os.environ["SLURM_CONF"] = str(self.conf)
        key = folder / "munge.key"
        key.write_bytes(os.urandom(128))
        key.chmod(0o600)
        folder.chmod(0o711)  # who may not pass through it cannot be authenticated
        munge = [f"--{what}={folder / name}" for what, name in (
            ("key-file", "munge.key"), ("socket", "munge.socket"), ("pid-file", "munge.pid"),
            ("log-file", "munge.log"), ("seed-file", "munge.seed"),
        )]  # fmt: skip
        opened.enter_context(daemon("munged", "--foreground", "--force", *munge))
        until("munge", (folder / "munge.socket").exists)
        self.control()
        opened.enter_context(daemon("slurmd", "-D", "-f", str(self.conf), "-L", str(folder / "slurmd.log")))
        until("the node", lambda: "idle" in said("sinfo", "-h", "-o", "%t"))

    def control(self) -> None:
        """Start the controller."""
        log = str(self._folder / "slurmctld.log")
        self.controller = self._opened.enter_context(daemon("slurmctld", "-D", "-f", str(self.conf), "-L", log))
        until("the controller", lambda: "UP" in said("scontrol", "ping"))

    def control_anew(self) -> None:
        """Kill the controller, and start it from what it has saved."""
        self.controller.kill()
        self.controller.wait()
        self.control()


def run_on_slurm(people: list[Participant], out: Path, jobs: int) -> tuple[ResultRow, ...]:
    """The run, as a user of a cluster writes it."""
    from dask_jobqueue import SLURMCluster  # noqa: PLC0415
    from distributed import Client  # noqa: PLC0415

    with (
        SLURMCluster(
            cores=1, processes=1, memory="1GiB", queue="all", walltime="01:00:00", silence_logs=50,
            log_directory=str(out.parent / "logs"), local_directory=str(out.parent / "scratch"),
            scheduler_options={"dashboard_address": None, "host": "127.0.0.1"},
        ) as cluster,
        Client(cluster) as client,
    ):  # fmt: skip
        cluster.adapt(minimum_jobs=jobs, maximum_jobs=jobs)  # a job that is lost is asked for again
        return run_many(people, out=out, executor=client.get_executor(), work=quick)


def end_jobs() -> None:
    """What is left of them; a job that ends when its controller has gone asks for it for ever."""
    said("scancel", "--user", getpass.getuser())
    until("the end of the jobs", lambda: not said("squeue", "-h", "-o", "%i"))


def logged(log: Path) -> Counter[str]:
    return Counter(log.read_text(encoding="utf-8").split() if log.exists() else ())


def three_runs(slurm: Slurm, folder: Path, count: int) -> None:
    """Break them, count, say."""
    log, out = folder / "log", folder / "out"
    half = count // 2
    people = [person(f"P{i}", f"fine {log}") for i in range(half)]
    people[half // 3] = person(f"P{half // 3}", f"killed {log}")

    def disturb() -> None:
        until("a third of the first run", lambda: len(logged(log)) >= half // 3, 600.0)
        jobs = said("squeue", "-h", "-t", "R", "-o", "%i").split()
        said("scancel", jobs[0])
        slurm.control_anew()

    disturbed = threading.Thread(target=disturb)
    disturbed.start()
    first = run_on_slurm(people, out, 2)
    disturbed.join()
    done = [row.status == "done" for row in first]
    why = first[half // 3].error[:40]
    print(f"first run, a job cancelled, the controller killed: {sum(done)} of {half} done, of one {why!r}")
    assert done == [i != half // 3 for i in range(half)]
    before = logged(log)
    command = [sys.executable, "-m", "tests.session.one_node_slurm", "--part", str(folder), str(half), str(count)]
    with subprocess.Popen(command) as second:
        until("half of the second run", lambda: len(logged(log)) >= half + (count - half) // 2, 600.0)
        second.send_signal(signal.SIGKILL)
    kept = {name for name in logged(log) if (out / name / "result.json").exists()}
    end_jobs()
    again = logged(log)
    people = [person(f"P{i}", f"fine {log}") for i in range(count)]
    third = run_on_slurm(people, out, 2)
    computed = {name for name in logged(log) if logged(log)[name] > again[name]}
    print(f"second run killed with its scheduler when {len(kept) - half + 1} of {count - half} were kept")
    print(f"third run: {sum(row.status == 'done' for row in third)} of {count} done, {len(computed)} computed")
    print(f"of those that were kept before: {len(computed & kept)}")
    print(f"given to a worker more than once, since one was lost: {sum(times > 1 for times in before.values())}")
    assert all(row.status == "done" for row in third)
    assert not computed & kept


def main() -> None:
    """Start Slurm and run."""
    options = argparse.ArgumentParser()
    options.add_argument("people", type=int, nargs="?", default=24)
    options.add_argument("--part", nargs=3, metavar=("FOLDER", "FIRST", "LAST"))
    asked = options.parse_args()
    if asked.part:  # of the second run: a process of its own, to be killed
        folder, first, last = Path(asked.part[0]), *map(int, asked.part[1:])
        run_on_slurm([person(f"P{i}", f"fine {folder / 'log'}") for i in range(first, last)], folder / "out", 1)
        return
    missing = [name for name in NEEDED if shutil.which(name) is None]
    if missing:
        sys.exit(f"not here: {', '.join(missing)}; Debian has them in slurmctld, slurmd, slurm-client and munge")
    with tempfile.TemporaryDirectory(prefix="slurm-") as place, ExitStack() as opened:
        slurm = Slurm(Path(place), opened)
        print(said("sinfo", "--version").strip(), "of one node:", said("sinfo", "-h").strip(), flush=True)
        try:
            three_runs(slurm, Path(place), asked.people)
        finally:
            end_jobs()


if __name__ == "__main__":
    main()
