"""A Slurm of one node, this machine, started by hand in a temporary folder and without accounting."""

import os
import shutil
import socket
import subprocess
import tempfile
import time
from pathlib import Path

PATH = f"{os.environ['PATH']}:/usr/sbin:/sbin"
PROGRAMS = ("munged", "slurmctld", "slurmd", "srun", "sbatch", "squeue", "scancel", "scontrol", "sinfo")
PATIENCE = 60  # seconds until the node has to be up
MEBIBYTE = 2**20

CONFIGURATION = """\
ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
JobCompType=jobcomp/none
MinJobAge=3600
SchedulerParameters=batch_sched_delay=0,sched_interval=1
NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} RealMemory={memory}
PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""
# The jobs of the Slurm plugin start their steps without SLURM_CONF, as a real cluster has its own in /etc.
SRUN = """\
#!/bin/sh
SLURM_CONF={folder}/slurm.conf exec {srun} "$@"
"""


def missing_programs() -> list[str]:
    """Return the programs that are needed and not installed."""
    return [program for program in PROGRAMS if shutil.which(program, path=PATH) is None]


class OneNodeSlurm:
    """The three daemons of a Slurm, as a context manager: they run inside of the block."""

    def __init__(self) -> None:
        # Munge wants a folder that others may enter, which those of pytest are not.
        self.folder = Path(tempfile.mkdtemp(prefix="one-node-slurm-"))
        self.folder.chmod(0o755)
        self.daemons: list[subprocess.Popen] = []

    @property
    def environment(self) -> dict[str, str]:
        """What programs of Slurm need to find this one."""
        variables = {"SLURM_CONF": f"{self.folder}/slurm.conf", "PATH": f"{self.folder}/bin:{PATH}"}
        return os.environ | variables

    def __enter__(self) -> "OneNodeSlurm":
        self._write_files()
        key, munge_socket = f"--key-file={self.folder}/munge.key", f"--socket={self.folder}/munge.socket"
        files = [f"--{name}-file={self.folder}/munged.{name}" for name in ("pid", "log", "seed")]
        self._start("munged", "--foreground", "--force", key, munge_socket, *files)
        self._wait_for(lambda: (self.folder / "munge.socket").exists())
        self._start("slurmctld", "-D", "-c")
        self._start("slurmd", "-D", "-c")
        self._wait_for(lambda: self.ask("sinfo", "--noheader", "--format=%T").strip() == "idle")
        return self

    def __exit__(self, *_: object) -> None:
        for daemon in reversed(self.daemons):
            daemon.terminate()
            daemon.wait(timeout=PATIENCE)
        shutil.rmtree(self.folder, ignore_errors=True)

    def ask(self, program: str, *arguments: str) -> str:
        """Return what a program of Slurm writes."""
        run = subprocess.run([program, *arguments], env=self.environment, capture_output=True, text=True)
        return run.stdout

    def _write_files(self) -> None:
        for name in ("state", "spool", "bin"):
            (self.folder / name).mkdir()
        with socket.socket() as first, socket.socket() as second:
            first.bind(("127.0.0.1", 0))
            second.bind(("127.0.0.1", 0))
            ports = first.getsockname()[1], second.getsockname()[1]
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // MEBIBYTE
        settings = CONFIGURATION.format(
            folder=self.folder,
            host=socket.gethostname().split(".")[0],
            user=subprocess.check_output(["id", "-un"], text=True).strip(),
            ports=ports,
            cpus=os.cpu_count(),
            memory=memory * 9 // 10,
        )
        (self.folder / "slurm.conf").write_text(settings)
        (self.folder / "munge.key").write_bytes(os.urandom(1024))
        (self.folder / "munge.key").chmod(0o600)
        srun = self.folder / "bin" / "srun"
        srun.write_text(SRUN.format(folder=self.folder, srun=shutil.which("srun", path=PATH)))
        srun.chmod(0o755)

    def _start(self, program: str, *arguments: str) -> None:
        with open(self.folder / f"{program}.out", "wb") as output:
            daemon = subprocess.Popen(
                [program, *arguments], env=self.environment, stdout=output, stderr=output
            )
        self.daemons.append(daemon)

    def _wait_for(self, is_true: object) -> None:
        deadline = time.monotonic() + PATIENCE
        while not is_true():
            said = "".join(path.read_text(errors="replace") for path in self.folder.glob("*.out"))
            assert time.monotonic() < deadline, f"this Slurm did not start:\n{said[-3000:]}"
            time.sleep(0.2)
