"""The pages in a real browser: nothing blocked or asked from outside, light and dark, accessible to all."""

import html
import json
import re
import shutil
import subprocess
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from strandcast.core.trial_names import trial_name
from strandcast.records.files import write_text
from strandcast.report.campaign_page import campaign_page
from strandcast.report.comparison import TrialRecords, compare, read_records
from strandcast.report.comparison_page import comparison_page
from strandcast.report.experiment_page import experiment_page
from strandcast.report.summary import summarise
from strandcast.report.trial_page import trial_page

from .campaigns import campaign_in_memory

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
QUIET = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
    "--enable-logging=stderr",
]


@pytest.fixture(scope="session")
def browser() -> str:
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip(f"no browser ({', '.join(BROWSERS)}) is installed")
    return found


def shoot(browser: str, page: Path, picture: Path, *more: str) -> str:
    return open_page(browser, page, picture, f"--screenshot={picture}", *more)


def open_page(browser: str, page: Path, out: Path, *more: str) -> str:
    """Open a page and return what the browser said; its profile lies beside `out`."""
    command = [browser, *QUIET, f"--user-data-dir={out.with_suffix('.profile')}", "--window-size=1000,1600"]
    done = subprocess.run(
        [*command, *more, page.as_uri()], capture_output=True, text=True, timeout=120, check=True
    )
    return done.stderr


@pytest.fixture(scope="module")
def page(results: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the page of a trial."""
    path = tmp_path_factory.mktemp("pages") / "report.html"
    next_motion = results / "trial-04" / "motion.json"
    write_text(path, trial_page(results / "trial-03", trial=3, experiment="swing", next_motion=next_motion))
    return path


def test_the_page_in_light_and_dark(page: Path, tmp_path: Path, browser: str) -> None:
    light_and_dark(page, tmp_path, browser)


def test_the_page_is_complete_on_paper(page: Path, tmp_path: Path, browser: str) -> None:
    paper = tmp_path / "paper.pdf"
    open_page(browser, page, paper, f"--print-to-pdf={paper}", "--no-pdf-header-footer")
    printed = paper.read_bytes()
    assert len(re.findall(rb"/Type\s*/Page\b", printed)) >= 4
    assert b"/Subtype /Image" in printed  # the strobe picture


def light_and_dark(page: Path, folder: Path, browser: str) -> None:
    """Open a page both ways: nothing is blocked, paper is white and black, and there is something on it."""
    said = shoot(browser, page, folder / "light.png")
    shoot(browser, page, folder / "dark.png", "--blink-settings=preferredColorScheme=0")
    light, dark = (
        np.asarray(Image.open(folder / f"{name}.png").convert("L"), float) for name in ("light", "dark")
    )
    assert "Content Security Policy" not in said
    assert np.median(light) > 240
    assert np.median(dark) < 60
    assert light.std() > 20
    assert dark.std() > 20


@pytest.fixture(scope="module")
def pages(page: Path, results: Path) -> list[Path]:
    """Return the pages of a trial, an experiment with an excluded trial, a comparison and a campaign."""
    trials = {trial: results / trial_name(trial) for trial in (1, 2, 3)}
    summary = summarise(
        "swing",
        trials,
        string_length_m=0.3,
        target_m=[0.606, 0.674],
        hit_radius_m=0.02,
        excluded={2: "the string slipped"},
    )
    records = {trial: TrialRecords(read_records(folder)) for trial, folder in trials.items()}
    made = {
        "experiment": experiment_page(summary, trials),
        "comparison": comparison_page(compare(("old", "new"), records, records)),
        "campaign": campaign_page(campaign_in_memory(7)),
    }
    for name, text in made.items():
        write_text(page.with_name(f"{name}.html"), text)
    return [page, *(page.with_name(f"{name}.html") for name in made)]


# Colours do not depend on the width.
@pytest.mark.parametrize(
    ("width_px", "scheme"), [(1400, 1), (390, 0), pytest.param(768, 1, marks=pytest.mark.thorough)]
)
def test_axe_finds_no_violation(
    pages: list[Path], tmp_path: Path, browser: str, width_px: int, scheme: int
) -> None:
    found = {each.stem: violations(each, tmp_path / "axe.html", browser, width_px, scheme) for each in pages}
    assert found == {each.stem: [] for each in pages}


def test_axe_would_find_one(page: Path, tmp_path: Path, browser: str) -> None:
    worse = tmp_path / "worse.html"
    write_text(
        worse, page.read_text().replace("--muted: #555c64", "--muted: #b5bcc4").replace('lang="en"', "")
    )
    found = " ".join(violations(worse, tmp_path / "axe.html", browser, 1400, 1))
    assert "color-contrast" in found
    assert "html-has-lang" in found


def violations(page: Path, copy: Path, browser: str, width_px: int, scheme: int) -> list[str]:
    """Return what axe finds on a copy of a page, which has axe in it and no policy against scripts."""
    spec = find_spec("axe_core_python")
    if spec is None or spec.origin is None:
        pytest.skip("axe-core-python is not installed")
    axe = (Path(spec.origin).parent / "axe.min.js").read_text()
    report = (
        "axe.run().then(found => {const out = document.createElement('pre'); out.id = 'axe-result'; "
        "out.textContent = JSON.stringify(found.violations.map(v => [v.id, v.nodes.length, "
        "v.nodes[0].html.slice(0, 200)])); document.body.appendChild(out)})"
    )
    text = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", page.read_text())
    write_text(copy, text.replace("</body>", f"<script>{axe}</script><script>{report}</script></body>"))
    command = [
        browser,
        *QUIET,
        f"--user-data-dir={copy.with_suffix('.profile')}",
        f"--window-size={width_px},1000",
    ]
    command += [
        f"--blink-settings=preferredColorScheme={scheme}",
        "--virtual-time-budget=30000",
        "--dump-dom",
    ]
    done = subprocess.run([*command, copy.as_uri()], capture_output=True, text=True, timeout=120, check=True)
    found = re.search(r'<pre id="axe-result">(.*?)</pre>', done.stdout, re.DOTALL)
    assert found is not None, "axe gave no result"
    return [" ".join(map(str, each)) for each in json.loads(html.unescape(found[1]))]
