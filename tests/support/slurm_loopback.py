"""A SLURM of two nodes on this machine: slurmctld and two slurmd on loopback, files in a folder."""

import os
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

NODES = ("one", "two")
PROGRAMS = ("slurmctld", "slurmd", "munged", "sbatch", "squeue", "scontrol", "sinfo")
START_SECONDS = 120
"""For daemons on a busy machine."""

CONFIGURATION = """\
ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.sock
CredType=cred/munge
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool-%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd-%n.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
ReturnToService=2
SchedulerParameters=sched_interval=1
MpiDefault=none
NodeName=one NodeHostname={host} NodeAddr=127.0.0.1 Port={ports[1]} CPUs=1 RealMemory=2000
NodeName=two NodeHostname={host} NodeAddr=127.0.0.1 Port={ports[2]} CPUs=1 RealMemory=2000
PartitionName=debug Nodes=one,two Default=YES MaxTime=60 State=UP
"""


def why_not() -> str | None:
    """Why SLURM cannot run here, None if it can."""
    missing = [name for name in PROGRAMS if shutil.which(name) is None]
    if missing:
        return f"needs {', '.join(missing)}: apt install slurmctld slurmd slurm-client munge"
    return None if os.geteuid() == 0 else "needs root: slurmd starts the processes of jobs"


@dataclass
class Slurm:
    """The daemons, and the commands that tests need."""

    folder: Path
    daemons: dict[str, "subprocess.Popen[bytes]"] = field(default_factory=dict)

    def start(self, name: str, *command: str) -> None:
        """Starts a daemon that stays in the foreground; its log is `<name>.log`."""
        with (self.folder / f"{name}.log").open("ab") as log:
            self.daemons[name] = subprocess.Popen([*command], stdout=log, stderr=log)

    def start_controller(self) -> None:
        """Starts slurmctld, which finds the jobs that it had."""
        self.start("slurmctld", "slurmctld", "-D")

    def stop(self, name: str) -> None:
        """Ends a daemon; slurmctld saves the state of its jobs."""
        daemon = self.daemons.pop(name)
        daemon.terminate()
        daemon.wait(START_SECONDS)

    def update(self, node: str, state: str) -> None:
        change = ["scontrol", "update", f"NodeName={node}", f"State={state}", "Reason=test"]
        subprocess.run(change, check=True, capture_output=True)

    def states(self) -> list[str]:
        """The states of the nodes, in their order; none while slurmctld is down."""
        found = subprocess.run(
            ["sinfo", "-h", "-N", "-o", "%T"], capture_output=True, text=True, check=False
        )
        return found.stdout.split()

    def nodes_of_jobs(self) -> list[str]:
        found = subprocess.run(
            ["squeue", "-h", "-t", "R", "-o", "%N"], capture_output=True, text=True, check=False
        )
        return found.stdout.split()

    def wait_for(self, condition: object, what: str) -> None:
        assert callable(condition)
        end = time.monotonic() + START_SECONDS
        while not condition():
            logs = {log.name: log.read_text()[-500:] for log in self.folder.glob("*.log")}
            assert time.monotonic() < end, f"{what} did not happen: {logs}"
            time.sleep(0.2)


def _free_ports(n: int) -> list[int]:
    sockets = [socket.socket() for _ in range(n)]
    for each in sockets:
        each.bind(("127.0.0.1", 0))
    ports = [each.getsockname()[1] for each in sockets]
    for each in sockets:
        each.close()
    return ports


@contextmanager
def slurm_cluster(folder: Path) -> Iterator[Slurm]:
    """Starts a cluster whose files are in a folder; `SLURM_CONF` is set until it ends."""
    (folder / "state").mkdir(parents=True)
    for node in NODES:
        (folder / f"spool-{node}").mkdir()
    text = CONFIGURATION.format(host=socket.gethostname(), folder=folder, ports=_free_ports(3))
    (folder / "slurm.conf").write_text(text)
    (folder / "munge.key").write_bytes(os.urandom(1024))
    (folder / "munge.key").chmod(0o400)
    files = {"key-file": "key", "socket": "sock", "pid-file": "pid", "seed-file": "seed"}
    options = [f"--{option}={folder}/munge.{end}" for option, end in files.items()]
    slurm, before = Slurm(folder), os.environ.get("SLURM_CONF")
    os.environ["SLURM_CONF"] = str(folder / "slurm.conf")
    try:
        slurm.start("munged", "munged", "--force", "--foreground", *options)
        slurm.wait_for((folder / "munge.sock").exists, "munged")
        slurm.start_controller()
        for node in NODES:
            slurm.start(node, "slurmd", "-D", "-N", node)
        slurm.wait_for(lambda: slurm.states() == ["idle"] * len(NODES), "two idle nodes")
        yield slurm
    finally:
        for name in list(slurm.daemons):
            slurm.stop(name)
        if before is None:
            del os.environ["SLURM_CONF"]
        else:
            os.environ["SLURM_CONF"] = before
