"""The comparison with other programs: conditions and missing peers."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

pytestmark = pytest.mark.process

_BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


@pytest.fixture
def peers(monkeypatch):
    """Return the driver, imported from its own folder."""
    monkeypatch.syspath_prepend(str(_BENCHMARKS))
    import peers

    return peers


def test_differing_rows_invalidate_the_ratio(peers):
    """One row more than 1e-3 m apart, or a tenth unsolved, gives no ratio; NaN rows only are allowed."""
    ours = np.random.default_rng(3).normal(size=(100, 2))
    theirs = ours + 5e-4
    assert peers.disagreement(ours, theirs) is None
    theirs[:10] = np.nan
    assert peers.disagreement(ours, theirs) is None
    theirs[10] = np.nan
    assert "both solved only 89.0%" in peers.disagreement(ours, theirs)
    theirs = ours.copy()
    theirs[7, 1] += 1.1e-3
    assert "1.0% apart by more than 0.001 m" in peers.disagreement(ours, theirs)


def test_failed_installations_are_reported(peers, tmp_path):
    """An environment that pip can't build is an error of one line, and is tried again next time."""
    (tmp_path / "absent.txt").write_text("./no-such-folder\n", encoding="utf-8")
    for _ in range(2):
        with pytest.raises(peers.PeerError, match=r"^not installed: ERROR: .*no-such-folder.*$"):
            peers.environment("absent", tmp_path / "made", tmp_path)


def test_peers_answer_rounds(peers, tmp_path):
    """A peer's positions are returned as sent; one that ends early is an error with its last output."""
    start = np.random.default_rng(5).normal(size=(4, 2))
    script = tmp_path / "peer.py"
    head = f"import sys\nsys.path.insert(0, {str(_BENCHMARKS / 'peers')!r})\nfrom rounds import serve\n"
    for solve in ("lambda problems: 2.0 * problems['start_m']", "lambda problems: problems['no such array']"):
        script.write_text(f"{head}serve({solve})\n", encoding="utf-8")
        problems = tmp_path / "problems.npz"
        np.savez(problems, start_m=start)
        running = peers.Running(Path(sys.executable), script, problems)
        if "2.0" in solve:
            running()
            running()
            np.testing.assert_array_equal(running.answers(), 2.0 * start)
        else:
            with pytest.raises(peers.PeerError, match=r"^failed: KeyError: .*no such array"):
                running()
        running.close()


def test_the_page_keeps_its_other_sections(peers):
    """Writing the peers' sections again replaces only them, at any position in the page."""
    page = "# Benchmarks\n\nwords\n\n## Kernels\n\nk\n\n## Peers: old\n\np\n\n## End to end: 5\n\ne\n"
    new = ["## Peers: new", "", "n", ""]
    written = peers.replaced(page, new)
    assert written == page.replace("## Peers: old\n\np\n", "## Peers: new\n\nn\n")
    assert peers.replaced(page.replace("## Peers: old\n\np\n\n", ""), new) == written
    assert peers.replaced(written, new) == written
