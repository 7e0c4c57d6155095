"""A Dask cluster on loopback: the bytes of a local run, also after any process is killed."""

from __future__ import annotations

import contextlib
import json
import re
import shutil
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import pyarrow.parquet
import pytest
from calibration_worlds import ROOM, session
from cli_support import PROGRAM, Outcome, plain_environment, process

from nlosctl.cli.main import run

pytestmark = [pytest.mark.process, pytest.mark.xdist_group("dask_cluster")]

distributed = pytest.importorskip("distributed")

Cli = Callable[..., Outcome]
PARTS = 8
SNAPSHOTS = 800  # in each
WORDS = ["localize", "in", "-m", "mixture-ml", "-q"]


class Cluster:
    """A scheduler and its workers, in separate processes, started from Dask's command line in ``folder``."""

    def __init__(self, address: str, folder: Path, stack: ExitStack) -> None:
        self.address, self.workers = address, []
        self._folder, self._stack = folder, stack

    def start_worker(self) -> None:
        """Start another worker."""
        local = str(self._folder / f"worker{len(self.workers)}")
        words = ("worker", self.address, "--nthreads", "1", "--no-nanny", "--local-directory", local)
        self.workers.append(self._stack.enter_context(started(*words, cwd=self._folder)))

    @property
    def words(self) -> list[str]:
        """The arguments that select the cluster."""
        return ["--engine", "dask", "--scheduler", self.address]


def start_cluster(folder: Path, stack: ExitStack) -> tuple[Cluster, subprocess.Popen[bytes]]:
    """Start a scheduler and return the cluster, which has no worker yet, and the scheduler's process."""
    address_file = folder / "scheduler.json"
    words = ("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(address_file))
    scheduler = stack.enter_context(started(*words, cwd=folder))
    deadline = time.monotonic() + 60
    while (
        not (address_file.exists() and address_file.read_text().rstrip().endswith("}")) and time.monotonic() < deadline
    ):
        time.sleep(0.05)
    return Cluster(str(json.loads(address_file.read_text())["address"]), folder, stack), scheduler


@contextmanager
def started(*words: str, cwd: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Start a process of Dask and kill it at the end."""
    environment = plain_environment(OMP_NUM_THREADS="1", DASK_DISTRIBUTED__ADMIN__EVENT_LOOP="asyncio")
    command = [sys.executable, "-m", "dask", *words, "--no-dashboard"]
    with (
        (cwd / f"{words[0]}.log").open("ab") as log,
        subprocess.Popen(command, cwd=cwd, env=environment, stdout=log, stderr=log) as running,
    ):
        try:
            yield running
        finally:
            running.kill()


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """A cluster whose processes are gone at the end of the tests."""
    with ExitStack() as stack:
        cluster, _ = start_cluster(tmp_path_factory.mktemp("cluster"), stack)
        cluster.start_worker()
        cluster.start_worker()
        yield cluster


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with parts of measurements with outliers, and their local results."""
    folder = tmp_path_factory.mktemp("solved")
    parameters = ("-p", "nlos_receivers=2", "-p", "nlos_span_deg=360", "-p", "bearing_std_deg=2")
    with contextlib.chdir(folder):
        assert run(["simulate", "madhow-ring", "-n", str(PARTS * SNAPSHOTS), *parameters, "-o", "m.parquet", "-q"]) == 0
        table = pyarrow.parquet.read_table("m.parquet")
        cuts = [index * table.num_rows // PARTS + (3 if 0 < index < PARTS else 0) for index in range(PARTS + 1)]
        Path("in").mkdir()
        for number, (first, behind) in enumerate(pairwise(cuts)):  # within snapshots
            pyarrow.parquet.write_table(table.slice(first, behind - first), f"in/p{number}.parquet")
        Path("m.parquet").unlink()
        assert run([*WORDS, "-o", "local/", "--flags-out", "local_flags/"]) == 0
    return folder


@pytest.fixture
def folder(solved: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the solved folder, which is the current one."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(solved, tmp_path, dirs_exist_ok=True)
    return tmp_path


def content(folder: Path) -> dict[str, bytes]:
    """Return the bytes of every file in a folder."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def done(folder: Path) -> int:
    """Return the number of completed parts of a running command."""
    return len(list(folder.glob("_unfinished/0*.json")))


def when_half_way(running: subprocess.Popen[bytes], folder: Path, strike: Callable[[], None]) -> None:
    """Wait until some parts are complete and some are not, then call ``strike``."""
    deadline = time.monotonic() + 90
    while done(folder) < 2 and running.poll() is None and time.monotonic() < deadline:
        time.sleep(0.005)
    assert 2 <= done(folder) < PARTS, (
        f"the run must be half-way: {running.poll()} {running.stderr and running.stderr.read()!r}"
    )
    strike()


def test_a_lost_worker_changes_no_byte(cluster: Cluster, folder: Path) -> None:
    """Single files and folders equal a local run, also if one of two workers is lost."""
    words = [*WORDS, "--overwrite", "-o", "one.parquet", "--flags-out", "flags.csv"]
    names = ("one.parquet", "flags.csv")
    assert run(words) == 0
    local = [(folder / name).read_bytes() for name in names]
    outcome = process(*words, *cluster.words, cwd=folder)
    assert outcome.code == 0, outcome.err
    assert [(folder / name).read_bytes() for name in names] == local
    assert not [path for path in folder.iterdir() if path.name.startswith(".")]

    command = [str(PROGRAM), *WORDS, "-o", "out/", "--flags-out", "out_flags/", *cluster.words]
    with subprocess.Popen(command, cwd=folder, env=plain_environment()) as running:
        when_half_way(running, folder / "out", cluster.workers[0].kill)
        assert running.wait(timeout=90) == 0
    cluster.start_worker()
    assert content(folder / "out") == content(folder / "local")
    assert content(folder / "out_flags") == content(folder / "local_flags")


def test_options_are_estimated_by_the_cluster(cluster: Cluster, folder: Path) -> None:
    """A share of outliers that is estimated from the input has the bits of a local run."""
    Path("few").mkdir()
    table = pyarrow.parquet.read_table("in/p0.parquet").slice(0, 800)
    for number, part in enumerate([table.slice(0, 403), table.slice(403)]):
        pyarrow.parquet.write_table(part, f"few/p{number}.parquet")
    words = ["localize", "few", *WORDS[2:], "-p", "alpha=estimate", "--overwrite", "-o", "one.csv"]
    assert run(words) == 0
    local = (folder / "one.csv").read_bytes()
    outcome = process(*words, *cluster.words, cwd=folder)
    assert outcome.code == 0, outcome.err
    assert (folder / "one.csv").read_bytes() == local


def test_a_killed_driver_is_resumed(cluster: Cluster, folder: Path) -> None:
    """After kill -9 of the command ``--resume`` completes the run with the same bytes."""
    words = [*WORDS, "-o", "out/", "--flags-out", "out_flags/", *cluster.words]
    with subprocess.Popen([str(PROGRAM), *words], cwd=folder, env=plain_environment()) as running:
        when_half_way(running, folder / "out", lambda: running.send_signal(signal.SIGKILL))
    assert not (folder / "out" / "_manifest.json").exists()
    outcome = process(*words, "--resume", cwd=folder)
    assert outcome.code == 0, outcome.err
    assert content(folder / "out") == content(folder / "local")
    assert content(folder / "out_flags") == content(folder / "local_flags")


@pytest.fixture
def short_lived(tmp_path: Path) -> Iterator[tuple[Cluster, subprocess.Popen[bytes]]]:
    """A cluster of one worker that a test may destroy, and its scheduler."""
    with ExitStack() as stack:
        cluster, scheduler = start_cluster(tmp_path, stack)
        cluster.start_worker()
        yield cluster, scheduler


@pytest.mark.parametrize(
    ("lost", "number"),
    [
        ("scheduler", signal.SIGKILL),
        ("worker", signal.SIGSTOP),
        pytest.param("scheduler", signal.SIGSTOP, marks=pytest.mark.slow),
        pytest.param("worker", signal.SIGKILL, marks=pytest.mark.slow),
    ],
)
def test_a_lost_cluster_ends_the_run(
    short_lived: tuple[Cluster, subprocess.Popen[bytes]], folder: Path, lost: str, number: int
) -> None:
    """Without scheduler or worker for ``--worker-timeout`` the run exits 1 with one line; ``--resume`` completes it."""
    cluster, scheduler = short_lived
    victim = scheduler if lost == "scheduler" else cluster.workers[0]
    words = [*WORDS, "-o", "out/", "--flags-out", "out_flags/"]
    command = [str(PROGRAM), *words, *cluster.words, "--worker-timeout", "5"]
    with subprocess.Popen(command, cwd=folder, env=plain_environment(), stderr=subprocess.PIPE) as running:
        when_half_way(running, folder / "out", lambda: victim.send_signal(number))
        _, err = running.communicate(timeout=60)
    assert (running.returncode, err.count(b"\n")) == (1, 1), err
    of_scheduler = "the Dask scheduler does not answer|the connection to the Dask scheduler was lost"
    expected = of_scheduler if lost == "scheduler" else "no Dask worker (answers|is left)"
    assert re.match(f"nlosctl: --scheduler {cluster.address}: ({expected})", err.decode()), err
    for one in (*cluster.workers, scheduler):  # a stopped worker would keep its temporary file
        one.kill()
        one.wait(timeout=30)
    outcome = process(*words, "--resume", cwd=folder)
    assert outcome.code == 0, outcome.err
    assert content(folder / "out") == content(folder / "local")


def test_no_one_can_connect_to_a_local_cluster(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A local cluster communicates within the process, its web servers show nothing, and the bytes are the same."""
    addresses: list[str] = []
    codes: list[int] = []

    class Recorded(distributed.LocalCluster):  # type: ignore[misc]
        def close(self, timeout: Any = None) -> Any:
            if not addresses:
                servers = [self.scheduler, *self.workers.values()]
                addresses.extend(server.address for server in servers)
                for server in servers:
                    for page in ("/health", "/metrics", "/info/main/workers.html", "/json/counts.json"):
                        url = f"http://127.0.0.1:{server.http_server.port}{page}"
                        with pytest.raises(urllib.error.HTTPError) as refused:
                            urllib.request.urlopen(url, timeout=30)
                        codes.append(refused.value.code)
                        refused.value.close()
            return super().close(timeout)

    monkeypatch.setattr(distributed, "LocalCluster", Recorded)
    words = [*WORDS, "-o", "out/", "--flags-out", "out_flags/", "--engine", "dask", "--jobs", "2"]
    assert run(words) == 0
    assert [address.partition("://")[0] for address in addresses] == ["inproc"] * 3
    assert codes == [404] * 12
    assert content(folder / "out") == content(folder / "local")


def test_errors_of_a_worker(cli: Cli, cluster: Cluster, folder: Path) -> None:
    """A bad row on a worker gives the line and exit code of a local run."""
    path = folder / "in" / "p4.parquet"
    table = pyarrow.parquet.read_table(path)
    negative = pyarrow.array([-0.5] * table.num_rows)
    index = table.column_names.index("bearing_std_rad")
    pyarrow.parquet.write_table(table.set_column(index, "bearing_std_rad", negative), path)
    local = cli(*WORDS, "-o", "bad/")
    there = cli(*WORDS, "-o", "bad2/", *cluster.words)
    assert (there.code, there.err) == (local.code, local.err)
    assert local.code == 1


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["--engine", "dusk"], 2, "did you mean 'dask'"),
        (["--scheduler", "tcp://127.0.0.1:1"], 2, "set --engine to dask"),
        (["--engine", "dask", "--bad-rows", "bad.csv"], 2, "a folder each"),
    ],
)
def test_engine_usage_errors(cli: Cli, tmp_path: Path, words: list[str], code: int, message: str) -> None:
    """Unknown engines, and a scheduler without its engine, give one line."""
    from cli_support import GOOD

    outcome = cli("localize", GOOD, "-o", "e.csv", *words)
    assert (outcome.code, outcome.err.count("\n")) == (code, 1), outcome.err
    assert message in outcome.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["ranges", "arrivals"])
def test_a_calibration_of_a_cluster_has_the_bytes_of_a_local_one(
    cli: Cli, cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    """Every pass over a folder whose parts cut snapshots runs on the workers; file and table are the same."""
    monkeypatch.chdir(tmp_path)
    table = pyarrow.table(session(kind, 60, seed=3, outliers=0.1, sensors=ROOM[:, :2])[0])
    Path("in").mkdir()
    for number, (first, behind) in enumerate(pairwise([0, 131, 250, table.num_rows])):
        pyarrow.parquet.write_table(table.slice(first, behind - first), f"in/p{number}.parquet")
    words = ("calibrate", "in", "-m", "mixture-ml", "-q")
    assert cli(*words, "-o", "here.toml", "--table-out", "here.csv", "--jobs", "1").code == 0
    outcome = cli(*words, "-o", "there.toml", "--table-out", "there.csv", *cluster.words)
    assert outcome.code == 0, outcome.err
    for end in ("toml", "csv"):
        assert Path(f"there.{end}").read_bytes() == Path(f"here.{end}").read_bytes()
    assert "covariance" in Path("there.toml").read_text()
