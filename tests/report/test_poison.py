"""Pages of records whose every text is an attack, in a real browser: the text is shown, and nothing runs.

The policy of a page (CSP) blocks scripts and requests. Here it is removed, so that escaping alone must hold;
the last test shows that the policy alone would hold too.
"""

import json
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from markupsafe import Markup
from pydantic import ValidationError

from strandcast.core.trial_names import trial_name
from strandcast.records.camera import Camera
from strandcast.records.load import RECORDS
from strandcast.records.record import Record
from strandcast.report.experiment_page import experiment_page
from strandcast.report.facts import Facts
from strandcast.report.pages import page_script
from strandcast.report.panels import content
from strandcast.report.summary import summarise
from strandcast.report.trial_page import trial_page

from .chromium import Browser

RUN = "document.title='RUN'"
POISON = (
    f"<script>{RUN}</script>\"'><img src=http://127.0.0.1:9/a onerror={RUN}><svg onload={RUN}>"
    f"</title></style></script>--><a href=javascript:{RUN}>&lt;b&gt; "
    "{{7*7}} {% raise %} ${7*7} $x^2$ \u202eright to left\u202c \0end"
)
POLICY = '<meta http-equiv="Content-Security-Policy"'
# CSV is saved as a file, not shown.
INSIDE = ("#", "data:image/", "data:video/mp4;base64,", "data:text/csv;charset=utf-8,", "..")
# Texts that select what a page shows: without them there is little more than boxes with problems.
STRUCTURE = {"source", "parameters", "name", "kind", "choices", "cameras", "method", "over", "of", "cause"}


# What the browser made of a page: its elements, and what they hold.
SHOWN = """(() => {
    const all = [...document.querySelectorAll("*")], scripts = [...document.scripts].map(s => s.textContent);
    const attributes = all.flatMap(each => [...each.attributes].map(a => [a.name, a.value]));
    document.querySelectorAll("script").forEach(script => script.remove());
    return {tags: all.map(each => each.localName), attributes, scripts, title: document.title,
            text: document.documentElement.textContent};
})()"""
# The film of the throw is drawn, or cannot be.
SETTLED = "[...document.querySelectorAll('.viewer')].every(film => film.hidden || film.dataset.shown)"


def opened(browser: Browser, path: Path) -> SimpleNamespace:
    """Open a page; return what is shown, the addresses that were asked for, and what was refused."""
    with browser.page(path) as page:
        page.wait(SETTLED)
        return SimpleNamespace(**page.value(SHOWN), asked=page.asked(), blocked=page.blocked())


def poisoned(record: Record, everything: bool) -> Record:
    """Return a record with the poison for every text that its schema allows; `everything`: structure too."""
    content = record.content()
    for node, key in texts(content, everything):
        text, node[key] = node[key], POISON
        try:
            type(record).model_validate(content)
        except ValidationError:
            node[key] = text  # one of a few words
    return type(record).model_validate(content)


def texts(node: Any, everything: bool) -> list[tuple[Any, Any]]:
    """Return each text in plain data as what holds it, and its key or index there."""
    found = []
    for key, child in node.items() if isinstance(node, dict) else enumerate(node):
        if not everything and key in STRUCTURE:
            continue
        if isinstance(child, str):
            found.append((node, key))
        elif isinstance(child, dict | list):
            found += texts(child, everything)
    return found


def poison_folder(folder: Path, everything: bool) -> None:
    """Poison all records of an experiment, and the versions that made them."""
    for path in folder.rglob("*.json"):
        kind = RECORDS[json.loads(path.read_text())["schema"]]
        record = poisoned(kind.read(path), everything)
        if isinstance(record, Camera):
            record.warnings.append(POISON)
        record._made_by = {POISON: POISON}
        record.write(path)


@pytest.fixture(
    scope="module",
    params=[False, pytest.param(True, marks=pytest.mark.thorough)],
    ids=["texts", "everything"],
)
def pages(
    request: pytest.FixtureRequest, results: Path, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, str]:
    """Return the pages of a trial and of an experiment made from poisoned records and settings."""
    folder = tmp_path_factory.mktemp("poison") / "swing"
    shutil.copytree(results, folder)
    poison_folder(folder, request.param)
    odd = folder / 'trial-02"><img src=x onerror=alert(1)>'
    shutil.copytree(folder / "trial-02", odd)
    facts = Facts(
        title=POISON, excluded={2: POISON}, play_command=POISON, settings={POISON: {POISON: [POISON]}}
    )
    next_motion = folder / "trial-04" / "motion.json"
    trials = {trial: folder / trial_name(trial) for trial in (1, 2, 3)}
    summary = summarise(
        POISON, trials, string_length_m=0.3, target_m=[0.6, 0.7], hit_radius_m=0.02, excluded={2: POISON}
    )
    trial = trial_page(
        folder / "trial-03", trial=3, experiment=POISON, previous=odd, next_motion=next_motion, facts=facts
    )
    with pytest.MonkeyPatch.context() as patch:  # the figures are on the page before
        patch.setattr(
            content, "to_svg", lambda drawn, _: Markup('<svg aria-label="{}"></svg>').format(drawn.alt)
        )
        excluded = trial_page(folder / "trial-02", trial=2, experiment=POISON, facts=facts)
    return {
        "trial": trial,
        "excluded": excluded,
        "experiment": experiment_page(summary, trials, next_motion=next_motion, facts=facts),
    }


@pytest.mark.parametrize("name", ["trial", "excluded", "experiment"])
def test_poison_is_shown_and_not_run(
    browser: Browser, pages: dict[str, str], tmp_path: Path, name: str
) -> None:
    check_inert(browser, pages[name], tmp_path / f"{name}.html", least=10)


def check_inert(browser: Browser, html: str, path: Path, least: int) -> None:
    """Open a page without its policy: the poison is shown so often; it does not run or ask for anything."""
    before, _, after = html.partition(POLICY)
    path.write_text(before + after.partition(">")[2], encoding="utf-8")
    shown = opened(browser, path)
    assert set(shown.scripts) <= {page_script()}
    assert not set(shown.tags) & {"iframe", "object", "embed", "form", "base", "link"}
    assert [name for name, _ in shown.attributes if name.startswith("on")] == []
    links = [value for name, value in shown.attributes if name.endswith(("href", "src"))]
    assert [link for link in links if not link.startswith(INSIDE) and ":" in link] == []
    assert_inert(shown)
    assert shown.text.count(POISON.replace("\0", "")) >= least  # browsers leave NUL out


def assert_inert(shown: SimpleNamespace) -> None:
    """Assert that no poison ran or asked for anything."""
    assert [address for address in shown.asked if "127.0.0.1" in address] == []
    assert shown.title != "RUN"


@pytest.fixture(scope="module")
def escaped(pages: dict[str, str]) -> str:
    """Return a page with one text that is not escaped."""
    return pages["trial"].replace("</h1>", f"</h1>{POISON}", 1)


def test_a_script_would_be_found(browser: Browser, escaped: str, tmp_path: Path) -> None:
    """What the test above rests on: the text runs, asks, and is found."""
    with pytest.raises(AssertionError):
        check_inert(browser, escaped, tmp_path / "page.html", least=5)
    shown = opened(browser, tmp_path / "page.html")
    assert shown.title == "RUN"
    assert "http://127.0.0.1:9/a" in shown.asked


def test_the_policy_stops_what_escapes(browser: Browser, escaped: str, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text(escaped, encoding="utf-8")
    shown = opened(browser, page)
    assert set(shown.scripts) > {page_script()}
    assert shown.title.startswith("<script>")
    assert_inert(shown)
    assert shown.blocked != []
