"""The page of `report` in a headless Chromium: it loads nothing, answers keys, filters, sorts, shows names as text."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from chromium import Browser, Page, chromium_path
from program import run_here

import nlosctl

pytestmark = [pytest.mark.process, pytest.mark.xdist_group("browser")]

HOSTILE = ("<script>alert(1)</script>", "</script><img src=x onerror=alert(2)>", "<!--<script>")
TITLES = "[...document.querySelectorAll('#{} thead th')].map((cell) => cell.textContent)"
FIRST_COLUMN = "[...document.querySelectorAll('#table tbody tr td:nth-child({})')].map((cell) => cell.textContent)"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """One browser for all tests; without one they are skipped, except where CI is true."""
    program = chromium_path()
    if program is None:
        if os.environ.get("CI") == "true":
            pytest.fail("chromium is not installed; .ci/run installs it with apt")
        pytest.skip("chromium is not installed (apt-get install chromium)")
    with Browser(program) as opened:
        yield opened


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Bearings with outliers, fixes and flags, and their page."""
    path = tmp_path_factory.mktemp("page")
    for line in (
        "simulate ring -n 120 -p outlier_fraction=0.2 -q -o m.parquet",
        "localize m.parquet -m mixture-ml -q -o e.parquet --flags-out f.parquet",
        "report f.parquet e.parquet -q -o r.html",
    ):
        assert run_here(*line.split(), folder=path).returncode == 0, line
    return path


def pictures(page: Page) -> list[str]:
    """What each canvas of the map shows, as the URL of an image."""
    page.evaluate("new Promise((done) => requestAnimationFrame(() => setTimeout(done, 50)))")
    return list(page.evaluate("[...document.querySelectorAll('canvas')].map((canvas) => canvas.toDataURL())"))


def test_the_page_loads_from_the_disk_and_nothing_else(browser: Browser, folder: Path) -> None:
    """No message, no exception, no request; every status has its count, errors and residuals their tables."""
    page = browser.open(folder / "r.html")
    assert page.complaints() == []
    assert page.evaluate("document.documentElement.lang") == "en"
    text = page.evaluate("document.getElementById('statistics').textContent")
    for words in ("Statuses", "RMSE", "coverage of 95 % ellipses", "Residuals by sensor", "share of outliers"):
        assert words in text
    assert len(pictures(page)) == 2
    assert min(len(picture) for picture in pictures(page)) > 5000
    page.close()


def test_keys_change_the_snapshot_and_its_rays(browser: Browser, folder: Path) -> None:
    """The control takes the focus; an arrow key and Enter choose another snapshot, whose rays are drawn and listed."""
    page = browser.open(folder / "r.html")
    before, title = pictures(page), "document.getElementById('chosen-title').textContent"
    assert page.evaluate(title).startswith("Snapshot 0: 8 bearings")
    page.evaluate("document.getElementById('snapshot').focus()")
    page.press("ArrowRight", 39)
    assert page.evaluate(title).startswith("Snapshot 1: 8 bearings")
    assert page.evaluate("document.getElementById('snapshot').getAttribute('aria-valuetext')") == "1"
    after = pictures(page)
    assert after[1] != before[1]
    assert after[0] == before[0]
    page.evaluate("document.getElementById('identifier').value = '77'; document.getElementById('identifier').focus()")
    page.press("Enter", 13)
    assert page.evaluate(title).startswith("Snapshot 77: 8 bearings")
    page.evaluate("document.getElementById('next').focus()")
    page.press("Enter", 13)
    assert page.evaluate(title).startswith("Snapshot 78")
    assert page.evaluate("document.querySelectorAll('#rows tbody tr').length") == 8
    assert page.complaints() == []
    page.close()


def test_outliers_differ_in_colour_and_dash(browser: Browser, folder: Path) -> None:
    """The legend shows flagged rays in another colour and dash than direct ones, and the list marks their rows."""
    page = browser.open(folder / "r.html")
    looks = page.evaluate(
        "[...document.querySelectorAll('#legend li')].filter((item) => item.textContent.startsWith('ray'))"
        ".map((item) => [item.textContent, getComputedStyle(item.querySelector('line')).stroke, "
        "item.querySelector('line').getAttribute('stroke-dasharray')])"
    )
    direct, flagged = (next(look for look in looks if word in look[0]) for word in ("direct", "outlier"))
    assert direct[1] != flagged[1]
    assert direct[2] != flagged[2]
    marked = page.evaluate("document.querySelectorAll('#rows tr.flagged').length")
    assert f", {marked} flagged" in page.evaluate("document.getElementById('chosen-title').textContent")
    page.close()


def test_the_table_filters_and_sorts(browser: Browser, folder: Path) -> None:
    """The filter leaves the rows with its text; a header sorts by numbers, up and down, and reports it."""
    page = browser.open(folder / "r.html")
    matches = "document.getElementById('matches').textContent"
    assert page.evaluate(matches) == "120 rows of 120"
    head = page.evaluate(TITLES.format("table"))
    error = head.index("Error, m")
    press = f"document.querySelectorAll('#table thead button')[{error}].click()"
    for direction in ("ascending", "descending"):
        page.evaluate(press)
        cells = page.evaluate(FIRST_COLUMN.format(error + 1))
        values = [float(cell) for cell in cells if cell]
        assert values == sorted(values, reverse=direction == "descending")
        assert len(values) > 40
        assert page.evaluate(f"document.querySelectorAll('#table th')[{error}].getAttribute('aria-sort')") == direction
    page.evaluate(
        "{const f = document.getElementById('filter'); f.value = 'AMBIG'; f.dispatchEvent(new Event('input'));}"
    )
    status = page.evaluate(FIRST_COLUMN.format(head.index("Status") + 1))
    assert status
    assert set(status) == {"ambiguous"}
    assert page.evaluate(matches) == f"{len(status)} row{'s' if len(status) > 1 else ''} of 120"
    assert page.complaints() == []
    page.close()


def test_names_stay_text(browser: Browser, tmp_path: Path) -> None:
    """Sensors and snapshots named like markup are shown as they are: no element of theirs, no dialog, no message."""
    header = "snapshot,sensor,sensor_x_m,sensor_y_m,bearing_deg,bearing_std_deg\n"
    places = ((0, 0, 45), (100, 0, 135), (0, 100, -45))
    lines = [
        f'"{name}","{sensor}",{x},{y},{bearing},1\n'
        for name in HOSTILE
        for sensor, (x, y, bearing) in zip(HOSTILE, places, strict=True)
    ]
    (tmp_path / "m.csv").write_text(header + "".join(lines))
    assert run_here("localize", "m.csv", "-q", "-o", "e.csv", folder=tmp_path).returncode == 0
    done = run_here("report", "m.csv", "e.csv", "-q", "--title", HOSTILE[1], "-o", "r.html", folder=tmp_path)
    assert done.returncode == 0
    page = browser.open(tmp_path / "r.html")
    assert page.complaints() == []
    assert page.evaluate("document.querySelectorAll('img, iframe').length") == 0
    assert page.evaluate("document.querySelectorAll('script').length") == 3
    assert page.evaluate("document.querySelector('h1').textContent") == HOSTILE[1]
    assert page.evaluate("document.title") == HOSTILE[1]
    rows = page.evaluate("[...document.querySelectorAll('#rows tbody td:first-child')].map((cell) => cell.textContent)")
    assert set(rows) == set(HOSTILE)
    assert sorted(set(page.evaluate(FIRST_COLUMN.format(1)))) == sorted(HOSTILE)
    tips = page.evaluate("[...document.querySelectorAll('.leaflet-tooltip')].map((tip) => tip.textContent)")
    assert set(tips) == set(HOSTILE)
    page.close()


@pytest.mark.parametrize(("width", "dark"), [(390, True), (1280, False)])
def test_the_page_fits_the_window(browser: Browser, folder: Path, width: int, dark: bool) -> None:
    """On a phone and on a desktop nothing is wider than the window; the colours follow the system."""
    page = browser.open(folder / "r.html", width=width, dark=dark)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    shade = page.evaluate("getComputedStyle(document.body).backgroundColor.match(/[0-9]+/g).map(Number)")
    assert (max(shade) < 100) == dark
    columns = page.evaluate(
        "getComputedStyle(document.querySelector('.columns')).gridTemplateColumns.split(' ').length"
    )
    assert columns == (1 if width < 600 else 2)
    page.close()


def test_hyperbolas_have_the_difference_of_their_row(browser: Browser, folder: Path) -> None:
    """Every point of a curve is farther from the sensor than from the reference by the difference, on both sides."""
    page = browser.open(folder / "r.html")
    script = (Path(nlosctl.__file__).parent / "pipeline/report/assets/page.js").read_text()
    source = script[script.index("function hyperbola") : script.index("function arc")]
    world = "const sensors = {x: [-30, 50], y: [20, -40]}, reach = 500, at = (x, y) => [x, y];"
    for difference in (60.0, -25.0, 0.0):
        points = np.array(page.evaluate(f"(() => {{{world} {source} return hyperbola(0, 1, {difference});}})()"))
        away = [np.hypot(*(points - place).T) for place in ((-30.0, 20.0), (50.0, -40.0))]
        np.testing.assert_allclose(away[0] - away[1], difference, atol=1e-6)
        assert np.ptp(points, axis=0).max() > 400.0
    assert page.evaluate(f"(() => {{{world} {source} return hyperbola(0, 1, 101);}})()") is None
    page.close()


def test_a_posterior_is_drawn(browser: Browser, folder: Path) -> None:
    """The regions of a map are an image that is made in the page, with its name, and in the legend."""
    for line in (
        "posterior m.parquet --snapshot 3 --cell 20 -q --overwrite -o map.parquet",
        "report map.parquet e.parquet -q --overwrite -o map.html",
    ):
        assert run_here(*line.split(), folder=folder).returncode == 0, line
    page = browser.open(folder / "map.html")
    assert page.complaints() == []
    assert page.evaluate("document.querySelectorAll('canvas.region').length") == 1
    image = "const canvas = document.querySelector('canvas.region'), context = canvas.getContext('2d');"
    drawn = "context.getImageData(0, 0, canvas.width, canvas.height).data.filter((value) => value > 0).length"
    assert page.evaluate(f"(() => {{{image} return {drawn};}})()") > 0
    assert "95 % of the posterior" in page.evaluate("document.getElementById('legend').textContent")
    page.close()


def test_controls_have_names(browser: Browser, folder: Path) -> None:
    """Every field, button and region has a name for screen readers, and the first link skips to the content."""
    page = browser.open(folder / "r.html")
    page.call("Accessibility.enable")
    nodes = page.call("Accessibility.getFullAXTree")["nodes"]
    roles = {"button", "slider", "textbox", "searchbox", "combobox", "checkbox", "region"}
    found = [node for node in nodes if not node.get("ignored") and node["role"]["value"] in roles]
    assert {"slider", "searchbox", "checkbox"} <= {node["role"]["value"] for node in found}
    assert [node["role"] for node in found if not node.get("name", {}).get("value")] == []
    assert page.evaluate("document.querySelector('a').hash") == "#main"
    page.close()
