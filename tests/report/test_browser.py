"""The pages in a real browser: nothing blocked, nothing asked from outside, light and dark not the same."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from strandcast.records.files import write_text
from strandcast.report.trial_page import trial_page

pytestmark = pytest.mark.browser
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


@pytest.fixture
def page(results: Path, tmp_path: Path) -> Path:
    """Return the page of a trial."""
    path = tmp_path / "report.html"
    next_motion = results / "trial-04" / "motion.json"
    write_text(path, trial_page(results / "trial-03", trial=3, experiment="swing", next_motion=next_motion))
    return path


@pytest.mark.slow
def test_the_page_in_light_and_dark(page: Path, tmp_path: Path, browser: str) -> None:
    light_and_dark(page, tmp_path, browser)


@pytest.mark.slow
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
