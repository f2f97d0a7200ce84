"""Bakes under real farm managers on this machine; run by name: pytest tests/farm_managers.py

Slurm, with two workers, needs Debian's slurm-wlm and munge, and root; daemons, state and ports are the test's own. Open
Job Description needs openjd-cli (tested with 0.8.0) beside this Python, or the program's path in OPENJD. RELUME may
name another program of Relume than the one beside this Python.
"""

import os
import shutil
import socket
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
RELUME = Path(os.environ.get("RELUME") or Path(sys.executable).with_name("relume"))
ROOM = [str(ROOT / "tests" / "data" / "room.obj"), "--up", "z", "--width", "64", "--height", "48", "--tile", "8"]
DAEMONS = ("munged", "slurmctld", "slurmd", "sbatch")
CONFIGURATION = """\
ClusterName=relume
SlurmctldHost=localhost(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge/socket
SlurmctldPidFile={folder}/slurmctld.pid
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool-%n
SlurmdPidFile={folder}/slurmd-%n.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
MpiDefault=none
KillWait=2
NodeName=worker1 NodeHostname=localhost NodeAddr=127.0.0.1 Port={ports[1]} CPUs=1
NodeName=worker2 NodeHostname=localhost NodeAddr=127.0.0.1 Port={ports[2]} CPUs=1
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""


def free_ports(count):
    """Ports of this machine that nobody listens on."""
    with ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(count)]
        for each in sockets:
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in sockets]


def wait_for(what, is_so, seconds=120):
    """Polls until it is so."""
    deadline = time.monotonic() + seconds
    while not is_so():
        assert time.monotonic() < deadline, f"{what} did not come"
        time.sleep(0.2)


@pytest.fixture
def slurm(tmp_path):
    """A running Slurm of two workers, as a function that runs its commands."""
    if missing := [name for name in DAEMONS if shutil.which(name) is None]:
        pytest.skip(f"{', '.join(missing)} is missing: apt-get install slurm-wlm munge")
    if os.geteuid() != 0:
        pytest.skip("Slurm's daemons need root")
    folder = tmp_path / "slurm"
    for name in ("munge", "state"):
        (folder / name).mkdir(parents=True, mode=0o700)
    key = folder / "munge" / "key"
    key.write_bytes(os.urandom(32))
    key.chmod(0o400)
    configuration = folder / "slurm.conf"
    configuration.write_text(CONFIGURATION.format(folder=folder, ports=free_ports(3)))
    environment = os.environ | {"SLURM_CONF": str(configuration), "RELUME": str(RELUME)}

    def run(*command, **options):
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, **options)
        assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
        return done.stdout

    own = [f"--{name}={folder}/munge/{name}" for name in ("socket", "key-file", "pid-file", "log-file", "seed-file")]
    own[1] = f"--key-file={key}"
    daemons = [["munged", "--foreground", "--force", *own], ["slurmctld", "-D"]]
    daemons += [["slurmd", "-D", "-N", name] for name in ("worker1", "worker2")]
    with ExitStack() as stack:
        for daemon in daemons:
            log = stack.enter_context((folder / f"{daemon[0]}-{daemon[-1]}.out".replace("/", "_")).open("w"))
            process = subprocess.Popen(daemon, env=environment, stdout=log, stderr=log)
            stack.callback(process.wait)
            stack.callback(process.terminate)
            if daemon[0] == "munged":
                wait_for("munged", (folder / "munge" / "socket").exists)
        wait_for("the workers", lambda: "2 idle" in _states(environment))
        yield run


def _states(environment):
    found = subprocess.run(["sinfo", "-h", "-o", "%D %t"], env=environment, capture_output=True, text=True)
    return found.stdout


@pytest.mark.parametrize("farm", ["openjd", "openjd-chunks"])
def test_open_job_description_runs_the_job(tmp_path, farm):
    openjd = os.environ.get("OPENJD") or shutil.which("openjd", path=RELUME.parent)
    if openjd is None:
        pytest.skip("openjd-cli is not installed beside this Python")
    options = [*ROOM, "--samples", "16"]
    relume("trace", *options, "--out", "whole", cwd=tmp_path)
    relume("plan", *options, "--out", "job", "--parts", "8", "--emit", farm, cwd=tmp_path)
    template = tmp_path / "job" / "template.json"
    for words in (["check"], ["run", "--step", "Collect", "--run-dependencies", "-p", f"Relume={RELUME}"]):
        command = [openjd, words[0], template, *words[1:]]
        done = subprocess.run(command, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stdout + done.stderr
    assert contents(tmp_path / "job" / "room") == contents(tmp_path / "whole")


def relume(*words, cwd):
    """Runs the program."""
    subprocess.run([RELUME, *words, "--quiet"], cwd=cwd, check=True, capture_output=True, text=True)


def contents(folder):
    """Names and bytes of a folder's files."""
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_a_bake_in_eight_parts_one_of_them_killed(slurm, tmp_path):
    options = [*ROOM, "--samples", "4096"]
    relume("trace", *options, "--out", "whole", cwd=tmp_path)
    relume("plan", *options, "--out", "job", "--parts", "8", "--emit", "slurm", cwd=tmp_path)
    job = tmp_path / "job"

    submitted = slurm("sh", "slurm.sh", cwd=job)
    wait_for("the first shards", lambda: any((job / "room").glob("tile_*")))
    running = slurm("squeue", "-h", "-t", "R", "-o", "%A %N %i").split("\n")
    nodes = {line.split()[1] for line in running if line}
    assert len(nodes) == 2, running
    killed = running[0].split()[2]
    slurm("scancel", "--signal=KILL", "--full", killed)
    wait_for("its end", lambda: "JobState=RUNNING" not in slurm("scontrol", "show", "job", killed))
    wait_for("the end of all jobs", lambda: slurm("squeue", "-h") == "", 300)
    log = (job / f"slurm-{submitted.strip()}.out").read_text()
    assert "missing or damaged" in log and "relume work . --part" in log, log

    submitted = slurm("sh", "slurm.sh", cwd=job)
    wait_for("the end of all jobs", lambda: slurm("squeue", "-h") == "", 300)
    log = (job / f"slurm-{submitted.strip()}.out").read_text()
    assert "1 bakes, sound" in log, log
    assert contents(job / "room") == contents(tmp_path / "whole")
