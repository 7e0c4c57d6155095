"""Other programs on the same problems, each in an environment of its own, taking turns with ours on one processor.

    python benchmarks/peers.py [--environments FOLDER]     writes its sections of results.md again

A program is ``peers/NAME.py`` and what it needs ``peers/NAME.txt``; its environment is made once (about 1.5 GB for all)
under ``benchmarks/.peers``. Starting points are given to the peers and not counted. A ratio is given only where every
row that both solved agrees to 1e-3 m. What can't be installed or fails is a row of the table that says why.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import venv
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import kernels
import numpy as np
import outliers
import scipy
from timing import best_of

import nlosctl
from nlosctl.contract.batches import BearingBatch
from nlosctl.methods import bearings_ls, bearings_mixture_ml, bearings_ml

_HERE = Path(__file__).parent
ENVIRONMENTS = _HERE / ".peers"
_ROUNDS = 5
_AGREE_M = 1e-3
_SOLVED_SHARE = 0.9
_INSTALL_SECONDS = 1200
_OURS = f"nlosctl {nlosctl.__version__}, numpy {np.__version__}"


class Peer(NamedTuple):
    """A program of another project: the stem of its two files, what it is, and on how many snapshots it is timed."""

    stem: str
    words: str
    snapshots: int


_ML_PEERS = (
    Peer("jax_vmap", "jax, Levenberg-Marquardt vmapped and compiled", kernels.SNAPSHOTS),
    Peer("gtsam_loop", "gtsam, loop: `CustomFactor`, Levenberg-Marquardt", 400),
    Peer("pyceres_loop", "pyceres, loop: `CostFunction` in Python, dense QR", 400),
    Peer("stonesoup_loop", "Stone Soup, loop: iterated Kalman update, 8 bearings stacked, 10 km prior", 100),
)
_RANSAC = Peer("skimage_ransac", "scikit-image, loop: `ransac` over lines of bearing", 300)


class PeerError(Exception):
    """A peer that can't be installed or has failed; the message is one line."""


def _one_line(text: str, fallback: str) -> str:
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    chosen = next((line for line in lines if line.startswith("ERROR")), lines[-1] if lines else fallback)
    return re.sub(r"https?://\S+|host='[^']*'", "...", chosen).replace("|", "/")[:200]


def environment(stem: str, folder: Path, programs: Path = _HERE / "peers") -> Path:
    """Return the interpreter of a peer's environment, made if it is not there for these very requirements."""
    requirements = programs / f"{stem}.txt"
    home, wanted = folder / stem, requirements.read_text(encoding="utf-8")
    python, made_for = home / "bin" / "python", home / "made-for.txt"
    if made_for.exists() and made_for.read_text(encoding="utf-8") == wanted:
        return python
    venv.create(home, clear=True, symlinks=True)
    install = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet", "-r", str(requirements)]
    try:
        done = subprocess.run(
            install, capture_output=True, text=True, timeout=_INSTALL_SECONDS, cwd=programs, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise PeerError(f"not installed: pip took more than {_INSTALL_SECONDS} s") from error
    if done.returncode:
        raise PeerError(f"not installed: {_one_line(done.stderr, 'pip gave no reason')}")
    made_for.write_text(wanted, encoding="utf-8")
    return python


class Running:
    """A peer's process: a call is one round over its problems; ``answers`` ends it and gives its positions."""

    def __init__(self, python: Path, script: Path, problems: Path):
        self._answers = problems.with_suffix(".npy")
        self._errors = problems.with_suffix(".log").open("w+", encoding="utf-8")
        clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        self._process = subprocess.Popen(
            [str(python), str(script), str(problems), str(self._answers)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            bufsize=1,
            env=clean,
        )

    def __call__(self) -> None:
        """Ask for a round and wait for it."""
        with suppress(BrokenPipeError):
            self._process.stdin.write("round\n")
        if self._process.stdout.readline() != "done\n":
            self._process.kill()
            self._process.wait()
            self._errors.seek(0)
            reason = _one_line(self._errors.read(), "it gave no reason")
            self.close()
            raise PeerError(f"failed: {reason}")

    def answers(self) -> np.ndarray:
        """Return the positions (N, 2) of the last round."""
        self._process.stdin.close()
        self._process.wait()
        return np.load(self._answers, allow_pickle=False)

    def close(self) -> None:
        """End the process, if it has not ended, and its streams."""
        self._process.kill()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout, self._errors):
            with suppress(BrokenPipeError):
                stream.close()


def disagreement(ours: np.ndarray, theirs: np.ndarray) -> str | None:
    """Return why a ratio would not compare the same work, or None; positions are (N, 2), NaN without a fix."""
    apart = np.hypot(*(ours - theirs).T)
    solved = np.isfinite(apart)
    if np.mean(solved) < _SOLVED_SHARE:
        return f"no ratio: both solved only {np.mean(solved):.1%}"
    if apart[solved].max() > _AGREE_M:
        return f"no ratio: {np.mean(apart[solved] > _AGREE_M):.1%} apart by more than {_AGREE_M:g} m"
    return None


@contextmanager
def _one_processor():
    """Hold this process, and those that it starts meanwhile, to one processor where the system can."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(before)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def _problems(batch: BearingBatch, snapshots: int, path: Path) -> Path:
    """Write the first snapshots, with least-squares starts, where a peer reads them."""
    start = bearings_ls.solve(batch, bearings_ls.METHOD.options()).estimates.position_m
    np.savez(
        path,
        sensor_xy_m=np.ascontiguousarray(batch.sensor_xy_m[:snapshots]),
        bearing_rad=np.ascontiguousarray(batch.bearing_rad[:snapshots]),
        bearing_std_rad=np.ascontiguousarray(batch.bearing_std_rad[:snapshots]),
        start_m=np.nan_to_num(start[:snapshots]),
    )
    return path


def _time(batch: BearingBatch, peers: tuple[Peer, ...], environments: Path, programs: dict):
    """Return seconds per snapshot of our programs, and of each peer that or its error, with its positions."""
    found: dict[str, PeerError | Running] = {}
    with tempfile.TemporaryDirectory() as scratch, ExitStack() as stack:
        for peer in peers:
            try:
                python = environment(peer.stem, environments)
                with _one_processor():
                    problems = _problems(batch, peer.snapshots, Path(scratch) / f"{peer.stem}.npz")
                    running = Running(python, _HERE / "peers" / f"{peer.stem}.py", problems)
                stack.callback(running.close)
                running()
                found[peer.stem] = running
            except PeerError as error:
                found[peer.stem] = error
        ready = [peer for peer in peers if isinstance(found[peer.stem], Running)]
        with _one_processor():
            seconds = best_of(_ROUNDS, *(run for run, _ in programs.values()), *(found[peer.stem] for peer in ready))
        ours = [time / count for time, (_, count) in zip(seconds, programs.values(), strict=False)]
        theirs = {
            peer.stem: (time / peer.snapshots, found[peer.stem].answers())
            for peer, time in zip(ready, seconds[len(ours) :], strict=True)
        }
    return ours, {peer.stem: theirs.get(peer.stem, found[peer.stem]) for peer in peers}


def _versions(stem: str) -> str:
    return (_HERE / "peers" / f"{stem}.txt").read_text(encoding="utf-8").replace("==", " ").strip().replace("\n", ", ")


def _ml_lines(environments: Path) -> list[str]:
    batch = kernels.make_batch(kernels.SNAPSHOTS, seed=1)
    options = bearings_ml.METHOD.options()
    position_m = bearings_ml.solve(batch, options).estimates.position_m
    programs = {
        "`ml`": (lambda: bearings_ml.solve(batch, options), len(position_m)),
        "scipy loop": (lambda: kernels.scipy_loop(batch, 400), 400),
    }
    ours, theirs = _time(batch, _ML_PEERS, environments, programs)
    lines = [
        "## Peers: maximum likelihood of 8 direct bearings, with covariances",
        "",
        f"The snapshots of the kernels above, alternating on one processor, best of {_ROUNDS}. The same optimum of the "
        "same residuals; peers receive the least-squares initial estimates, `ml` and the scipy loop compute theirs. A "
        "ratio is stated only if all rows that both solved, at least nine in ten, agree to 1e-3 m.",
        "",
        "| program | version | solved by both | worst apart (m) | microseconds per snapshot "
        "| throughput of `ml` against it |",
        "|---|---|---|---|---|---|",
        f"| `ml` | {_OURS} | | | {ours[0] * 1e6:.2f} | 1 |",
        f"| scipy loop | scipy {scipy.__version__} | | | {ours[1] * 1e6:.1f} | {ours[1] / ours[0]:.0f} |",
    ]
    for peer in _ML_PEERS:
        start = f"| {peer.words} | {_versions(peer.stem)}"
        result = theirs[peer.stem]
        if isinstance(result, PeerError):
            lines.append(f"{start} | | | | {result} |")
            continue
        seconds, answers = result
        apart = np.hypot(*(position_m[: len(answers)] - answers).T)
        ratio = disagreement(position_m[: len(answers)], answers) or _figure(seconds / ours[0])
        both = np.isfinite(apart)
        solved, worst = f"{np.mean(both):.2%} of {len(both)}", apart[both].max(initial=0.0)
        lines.append(f"{start} | {solved} | {worst:.1g} | {seconds * 1e6:.1f} | {ratio} |")
    return [*lines, ""]


def _ransac_lines(environments: Path) -> list[str]:
    batch, truth = outliers.make_batch()
    options = bearings_mixture_ml.METHOD.options(alpha=0.25, field_of_view_deg=360.0)
    estimates = bearings_mixture_ml.solve(batch, options).estimates
    position_m = estimates.position_m[estimates.alternative == 0]
    programs = {"`mixture-ml`": (lambda: bearings_mixture_ml.solve(batch, options), len(truth))}
    (ours,), theirs = _time(batch, (_RANSAC,), environments, programs)
    result = theirs[_RANSAC.stem]
    lines = [
        "## Peers: 2 bearings of 8 uniform over the circle",
        "",
        "The optima differ, so the table has the errors beside the times and requires no agreement: RANSAC ends with a "
        "linear fix of the lines that agree to 2.5 standard deviations, `mixture-ml` (with the search region and the "
        "share of outliers given) with the best mode of a likelihood and its covariance. Alternating "
        f"on one processor, best of {_ROUNDS}.",
        "",
        "| program | version | median error (m) | 95 % of the errors below (m) | microseconds per snapshot "
        "| throughput of `mixture-ml` against it |",
        "|---|---|---|---|---|---|",
        f"| `mixture-ml` | {_OURS} | {_errors(position_m, truth, _RANSAC.snapshots)} | {ours * 1e6:.1f} | 1 |",
    ]
    start = f"| {_RANSAC.words} | {_versions(_RANSAC.stem)}"
    if isinstance(result, PeerError):
        return [*lines, f"{start} | | | | {result} |", ""]
    seconds, answers = result
    return [
        *lines,
        f"{start} | {_errors(answers, truth, _RANSAC.snapshots)} | {seconds * 1e6:.1f} | {_figure(seconds / ours)} |",
        "",
    ]


def _figure(ratio: float) -> str:
    return f"{ratio:.1f}" if ratio < 10.0 else f"{ratio:.0f}"


def _errors(positions: np.ndarray, truth: np.ndarray, snapshots: int) -> str:
    error = np.hypot(*(positions[:snapshots] - truth[:snapshots]).T)
    error = np.where(np.isfinite(error), error, np.inf)
    return f"{np.median(error):.1f} | {np.percentile(error, 95):.1f}"


def report(environments: Path = ENVIRONMENTS) -> list[str]:
    """Return the lines of both tables."""
    return _ml_lines(environments) + _ransac_lines(environments)


def replaced(text: str, lines: list[str]) -> str:
    """Return the page with its sections of peers replaced by ``lines``, before the end-to-end ones if it had none."""
    head, *sections = re.split(r"(?m)^(?=## )", text)
    others = [section for section in sections if not section.startswith("## Peers")]
    place = next((n for n, section in enumerate(others) if section.startswith("## End to end")), len(others))
    return "".join([head, *others[:place], "\n".join(lines) + "\n", *others[place:]])


def main() -> None:
    """Run the peers alone and write their sections of the page."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--environments", type=Path, default=ENVIRONMENTS, help="folder of the peers' environments")
    lines = report(parser.parse_args().environments)
    page = _HERE / "results.md"
    page.write_text(replaced(page.read_text(encoding="utf-8"), lines), encoding="utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
