"""Pages of records whose every text is an attack, in a real browser: the text is shown, and nothing runs.

The policy of a page (CSP) blocks scripts and requests. Here it is removed, so that escaping alone must hold;
the last test shows that the policy alone would hold too.
"""

import json
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from strandcast.core.trial_names import trial_name
from strandcast.records.camera import Camera
from strandcast.records.load import RECORDS
from strandcast.records.record import Record
from strandcast.report.experiment_page import experiment_page
from strandcast.report.facts import Facts
from strandcast.report.pages import page_script
from strandcast.report.summary import summarise
from strandcast.report.trial_page import trial_page

from .test_browser import QUIET
from .test_browser import browser as browser

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


class Shown(HTMLParser):
    """What the browser made of a page: tags, attributes, and the text in between."""

    def __init__(self, dom: str) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.attributes: list[tuple[str, str]] = []
        self.text = self.title = ""
        self.scripts: list[str] = []
        self._open = ""
        self.feed(dom)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self._open = tag
        self.scripts += [""] if tag == "script" else []
        self.attributes += [(name, value or "") for name, value in attrs]

    def handle_data(self, data: str) -> None:
        if self._open == "script":
            self.scripts[-1] += data
            return
        self.text += data
        self.title += data if self._open == "title" else ""

    def handle_endtag(self, tag: str) -> None:
        self._open = ""


def opened(browser: str, page: Path) -> tuple[Shown, list[str], str]:
    """Open a page; return what is shown, the addresses that were asked for, and the browser's log."""
    log = page.with_suffix(".net.json")
    command = [browser, *QUIET, f"--user-data-dir={page.with_suffix('.profile')}", f"--log-net-log={log}"]
    done = subprocess.run(
        [*command, "--virtual-time-budget=3000", "--dump-dom", page.as_uri()],
        capture_output=True,
        text=True,
        timeout=240,
        check=True,
    )
    return Shown(done.stdout), asked(log), done.stderr


def asked(log: Path) -> list[str]:
    """Return the addresses in a browser's log of its network, without its own upkeep."""
    events = json.loads(log.read_text())["events"]
    return sorted({event["params"]["url"] for event in events if "url" in event.get("params", {})})


def poisoned(record: Record, everything: bool) -> Record:
    """Return a record with the poison for every text that its schema allows; `everything`: structure too."""
    content = record.content()
    for place in texts(content, everything):
        other = with_text(content, place)
        try:
            type(record).model_validate(other)
        except ValidationError:
            continue  # one of a few words
        content = other
    return type(record).model_validate(content)


def texts(node: Any, everything: bool, place: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the places of all texts in plain data."""
    if isinstance(node, str):
        return [place]
    if not isinstance(node, dict | list):
        return []
    children = node.items() if isinstance(node, dict) else enumerate(node)
    kept = [(key, child) for key, child in children if everything or key not in STRUCTURE]
    return [found for key, child in kept for found in texts(child, everything, (*place, key))]


def with_text(content: Any, place: tuple[Any, ...]) -> Any:
    """Return a copy of plain data with the poison at a place."""
    other = json.loads(json.dumps(content))
    node = other
    for key in place[:-1]:
        node = node[key]
    node[place[-1]] = POISON
    return other


def poison_folder(folder: Path, everything: bool) -> None:
    """Poison all records of an experiment, and the versions that made them."""
    for path in folder.rglob("*.json"):
        kind = RECORDS[json.loads(path.read_text())["schema"]]
        record = poisoned(kind.read(path), everything)
        if isinstance(record, Camera):
            record.warnings.append(POISON)
        record._made_by = {POISON: POISON}
        record.write(path)


@pytest.fixture(scope="module", params=[False, True], ids=["texts", "everything"])
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
    return {
        "trial": trial,
        "excluded": trial_page(folder / "trial-02", trial=2, experiment=POISON, facts=facts),
        "experiment": experiment_page(summary, trials, next_motion=next_motion, facts=facts),
    }


@pytest.mark.parametrize("name", ["trial", "excluded", "experiment"])
def test_poison_is_shown_and_not_run(browser: str, pages: dict[str, str], tmp_path: Path, name: str) -> None:
    check_inert(browser, pages[name], tmp_path / f"{name}.html", least=10)


def check_inert(browser: str, html: str, page: Path, least: int) -> None:
    """Open a page without its policy: the poison is shown so often; it does not run or ask for anything."""
    before, _, after = html.partition(POLICY)
    page.write_text(before + after.partition(">")[2], encoding="utf-8")
    shown, asked_for, _ = opened(browser, page)
    assert set(shown.scripts) <= {page_script()}
    assert not shown.tags & {"iframe", "object", "embed", "form", "base", "link"}
    assert [name for name, _ in shown.attributes if name.startswith("on")] == []
    links = [value for name, value in shown.attributes if name.endswith(("href", "src"))]
    assert [link for link in links if not link.startswith(INSIDE) and ":" in link] == []
    assert [address for address in asked_for if "127.0.0.1" in address] == []
    assert shown.title != "RUN"
    assert shown.text.count(POISON.replace("\0", "")) >= least  # browsers leave NUL out


def test_a_script_would_be_found(browser: str, pages: dict[str, str], tmp_path: Path) -> None:
    """What the test above rests on: one text that is not escaped."""
    html = pages["trial"].replace("</h1>", f"</h1>{POISON}", 1)
    with pytest.raises(AssertionError):
        check_inert(browser, html, tmp_path / "page.html", least=5)


def test_the_policy_stops_what_escapes(browser: str, pages: dict[str, str], tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text(pages["trial"].replace("</h1>", f"</h1>{POISON}", 1), encoding="utf-8")
    shown, asked_for, log = opened(browser, page)
    assert set(shown.scripts) > {page_script()}
    assert shown.title.startswith("<script>")
    assert [address for address in asked_for if "127.0.0.1" in address] == []
    assert "Content Security Policy" in log
