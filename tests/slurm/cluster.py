"""Slurm on one machine: munged, slurmctld and two slurmd's in one folder, ended by their process ids.

Each node is a process-id namespace with a host name of its own: killing its first process ends everything
on the node at once, as if its power were cut.
"""

import getpass
import os
import secrets
import shutil
import signal
import socket
import subprocess
import time
from contextlib import suppress
from pathlib import Path

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "srun", "squeue", "scontrol")
PATIENCE_S = 30.0  # the daemons answer within a second
NODE_MB = 4000

CONF = """\
ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={port}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.sock,cred_expire=5
CredType=cred/munge
SlurmUser={user}
SlurmdUser={user}
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU_Memory
MpiDefault=none
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/linux
JobAcctGatherFrequency=1
JobAcctGatherParams=OverMemoryKill
MinJobAge=3600
ReturnToService=2
SlurmdTimeout=30
KillWait=1
Prolog={folder}/prolog
SlurmdParameters=config_overrides
SlurmdSpoolDir={folder}/spool-%n
SlurmdPidFile={folder}/slurmd-%n.pid
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdLogFile={folder}/slurmd-%n.log
SlurmctldLogFile={folder}/slurmctld.log
StateSaveLocation={folder}/state
NodeName=n1 NodeHostname={host} NodeAddr=127.0.0.1 Port={port_1} CPUs=2 RealMemory={memory}
NodeName=n2 NodeHostname={host} NodeAddr=127.0.0.1 Port={port_2} CPUs=2 RealMemory={memory}
PartitionName=main Nodes=ALL Default=YES State=UP
"""


def missing() -> str | None:
    """Return why no cluster can be started here, None if one can."""
    places = os.pathsep.join([os.environ.get("PATH", ""), "/usr/sbin", "/sbin"])
    absent = [name for name in PROGRAMS if shutil.which(name, path=places) is None]
    if absent:
        return f"Slurm is not installed: {', '.join(absent)}"
    namespaces = [*_namespaces("probe"), "true"]
    if subprocess.run(namespaces, capture_output=True, check=False).returncode:
        return "this machine does not allow namespaces of process ids and host names"
    return None


def _namespaces(host: str) -> list[str]:
    """Return the command that runs another one as a computer of its own."""
    own = ["unshare", "--uts", "--pid", "--fork", "--kill-child", "--mount-proc"]
    # The shell stays as the first process, and reaps what the daemons leave behind.
    return [*own, "sh", "-c", f'hostname {host}; "$@"; exit $?', "sh"]


class Cluster:
    """A running cluster with the nodes n1 and n2."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.environment = dict(os.environ) | {
            "SLURM_CONF": str(folder / "slurm.conf"),
            "PATH": os.pathsep.join([str(folder / "bin"), os.environ["PATH"], "/usr/sbin", "/sbin"]),
        }
        self._munged: subprocess.Popen[bytes] | None = None
        self._controller: subprocess.Popen[bytes] | None = None
        self.nodes: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> "Cluster":
        try:
            self._start()
        except BaseException:
            self.__exit__()
            raise
        return self

    def _start(self) -> None:
        folder = self.folder
        for name in ("bin", "state"):
            (folder / name).mkdir(parents=True)
        folder.chmod(0o755)
        (folder / "munge.key").write_bytes(secrets.token_bytes(1024))
        (folder / "munge.key").chmod(0o400)
        port, port_1, port_2 = _free_ports(3)
        host, user = socket.gethostname().split(".")[0], getpass.getuser()
        values = {"folder": folder, "host": host, "user": user, "memory": NODE_MB}
        values |= {"port": port, "port_1": port_1, "port_2": port_2}
        (folder / "slurm.conf").write_text(CONF.format_map(values))
        # A node starts no job while the file `broken-NODE` is there.
        prolog = folder / "prolog"
        prolog.write_text(f"#!/bin/sh\n! test -e {folder}/broken-$SLURMD_NODENAME\n")
        prolog.chmod(0o755)
        # The executor starts `srun` without SLURM_CONF; on a real cluster the file lies in /etc/slurm.
        srun = folder / "bin" / "srun"
        real = shutil.which("srun", path=self.environment["PATH"])
        srun.write_text(f'#!/bin/sh\nSLURM_CONF={folder}/slurm.conf exec {real} "$@"\n')
        srun.chmod(0o755)
        files = {name: f"--{name}-file={folder}/munge.{name}" for name in ("key", "pid", "log", "seed")}
        line = ["munged", "--foreground", "--force", f"--socket={folder}/munge.sock", *files.values()]
        self._munged = self._popen(line)
        _wait_for(lambda: (folder / "munge.sock").exists())
        self._controller = self._popen(["slurmctld", "-D", "-c", "-f", str(folder / "slurm.conf")])
        for node in ("n1", "n2"):
            self.start_node(node)
        _wait_for(lambda: self.run("sinfo", "--noheader", "--format=%T").split() == ["idle"])

    def _popen(self, line: list[str]) -> subprocess.Popen[bytes]:
        out = (self.folder / "daemons.log").open("ab")
        return subprocess.Popen(
            line,
            env=self.environment,
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=out,
            start_new_session=True,
        )

    def start_node(self, node: str) -> None:
        """Start a node; one that was cut off joins again, empty."""
        line = ["slurmd", "-D", "-N", node, "-f", str(self.folder / "slurm.conf")]
        self.nodes[node] = self._popen([*_namespaces(node), *line])

    def cut_off(self, node: str) -> None:
        """Kill everything on a node at once."""
        (first,) = children(self.nodes[node].pid)
        os.kill(first, signal.SIGKILL)
        self.nodes[node].wait()

    def run(self, *line: str) -> str:
        """Return what one of Slurm's commands prints."""
        return subprocess.run(line, env=self.environment, capture_output=True, text=True, check=False).stdout

    def __exit__(self, *_: object) -> None:
        for node, process in self.nodes.items():
            if process.poll() is None:
                with suppress(ValueError, ProcessLookupError):
                    self.cut_off(node)
        for daemon in (self._controller, self._munged):
            if daemon is not None:
                daemon.terminate()
                daemon.wait()


def children(pid: int) -> list[int]:
    """Return the processes that a process has started."""
    return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def _free_ports(count: int) -> list[int]:
    sockets = [socket.create_server(("127.0.0.1", 0)) for _ in range(count)]
    ports = [each.getsockname()[1] for each in sockets]
    for each in sockets:
        each.close()
    return ports


def _wait_for(condition: object) -> None:
    began = time.monotonic()
    while not condition():  # type: ignore[operator]
        assert time.monotonic() - began < PATIENCE_S, "the cluster does not start"
        time.sleep(0.05)
