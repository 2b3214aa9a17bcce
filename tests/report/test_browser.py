"""The pages in a real browser: nothing blocked or asked from outside, light and dark, accessible to all."""

import io
import re
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

from .campaigns import campaign_in_memory
from .chromium import Browser, Page

# Readers are given a figure's alternative text, and axe knows the CSS colour of text in SVG, not its fill.
EMPTY_FIGURES = "document.querySelectorAll('svg[role=img]').forEach(figure => figure.replaceChildren())"
VIOLATIONS = """axe.run().then(found =>
    found.violations.map(v => [v.id, v.nodes.length, v.nodes[0].html.slice(0, 200)].join(" ")))"""


@pytest.fixture(scope="module")
def page(drawn: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the page of a trial."""
    path = tmp_path_factory.mktemp("pages") / "report.html"
    write_text(path, drawn)
    return path


def test_the_page_in_light_and_dark(page: Path, browser: Browser) -> None:
    light_and_dark(page, browser)


def light_and_dark(page: Path, browser: Browser) -> None:
    """Open a page both ways: nothing is blocked or asked for, paper is white and black, and not empty."""
    with browser.page(page, width=1000, height=1600) as opened:
        light, dark = seen(opened, "light"), seen(opened, "dark")
        assert opened.blocked() == []
        assert {each for each in opened.asked() if not each.startswith("data:")} == {page.as_uri()}
    assert np.median(light) > 240
    assert np.median(dark) < 60
    assert light.std() > 20
    assert dark.std() > 20


def seen(page: Page, scheme: str) -> np.ndarray:
    """Return the grey values of a page's window in a colour scheme."""
    page.prefer("color-scheme", scheme)
    return np.asarray(Image.open(io.BytesIO(page.picture())).convert("L"), float)


@pytest.mark.parametrize(
    "changes",
    [
        {"</h1>": "</h1><script>1</script>"},
        {"img-src data:": "img-src data: http:", "</h1>": "</h1><img alt='' src='http://127.0.0.1:9/a'>"},
        {"prefers-color-scheme: dark": "prefers-color-scheme: light"},
    ],
    ids=["blocked", "asked for", "white in the dark"],
)
def test_a_fault_would_be_found(
    page: Path, tmp_path: Path, browser: Browser, changes: dict[str, str]
) -> None:
    with pytest.raises(AssertionError):
        light_and_dark(worse(page, tmp_path, changes), browser)


def worse(page: Path, folder: Path, changes: dict[str, str]) -> Path:
    """Write a page with changes of its text; return its path."""
    text = page.read_text()
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    write_text(folder / "worse.html", text)
    return folder / "worse.html"


def test_the_page_is_complete_on_paper(page: Path, browser: Browser) -> None:
    with browser.page(page) as opened:
        printed = opened.printed()
        opened.value("document.querySelectorAll('details').forEach(each => each.open = true)")
        unfolded = opened.printed()
    sheets = [len(re.findall(rb"/Type\s*/Page\b", each)) for each in (printed, unfolded)]
    assert sheets[0] == sheets[1] >= 4
    assert b"/Subtype /Image" in printed  # the strobe picture


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
        "campaign": campaign_page(campaign_in_memory(7, throws=6)),
    }
    for name, text in made.items():
        write_text(page.with_name(f"{name}.html"), text)
    return [page, *(page.with_name(f"{name}.html") for name in made)]


def test_axe_finds_no_violation(pages: list[Path], browser: Browser) -> None:
    for each in pages:
        widths = {"light": 1400, "dark": 390} if each is pages[0] else {"dark": 390}
        assert (each.stem, violations(each, browser, widths)) == (each.stem, set())


@pytest.mark.thorough
@pytest.mark.parametrize("width_px", [768, 1400])
def test_axe_finds_no_violation_at_another_width(pages: list[Path], browser: Browser, width_px: int) -> None:
    for each in pages:
        assert (each.stem, violations(each, browser, {"light": width_px})) == (each.stem, set())


def test_axe_would_find_one(pages: list[Path], tmp_path: Path, browser: Browser) -> None:
    changed = worse(pages[2], tmp_path, {"--muted: #555c64": "--muted: #b5bcc4", 'lang="en"': ""})
    found = {each.split()[0] for each in violations(changed, browser, {"light": 1400})}
    assert found >= {"color-contrast", "html-has-lang"}


def violations(page: Path, browser: Browser, widths_px: dict[str, int]) -> set[str]:
    """Return what axe finds on a page in colour schemes, each at a width of the window."""
    spec = find_spec("axe_core_python")
    if spec is None or spec.origin is None:
        pytest.skip("axe-core-python is not installed")
    found: set[str] = set()
    with browser.page(page) as opened:
        opened.value(EMPTY_FIGURES)
        opened.value("document.querySelectorAll('details').forEach(each => each.open = true)")
        opened.value((Path(spec.origin).parent / "axe.min.js").read_text())
        for scheme, width_px in widths_px.items():
            opened.resize(width_px)
            opened.prefer("color-scheme", scheme)
            found.update(opened.value(VIOLATIONS))
    return found
