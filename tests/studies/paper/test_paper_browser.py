"""The paper's page in a real browser."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from strandcast.records.files import write_text
from strandcast_studies.paper.report.page import paper_page

from ...report.chromium import Browser
from ...report.test_browser import light_and_dark
from ...report.test_poison import POISON, check_inert, poisoned


@pytest.mark.thorough
@pytest.mark.thorough
def test_the_papers_page_in_light_and_dark(paper: Any, tmp_path: Path, browser: Browser) -> None:
    page = tmp_path / "report.html"
    write_text(page, paper_page(*paper))
    light_and_dark(page, browser)


@pytest.mark.thorough
def test_poison_is_shown_and_not_run(paper: Any, tmp_path: Path, browser: Browser) -> None:
    summary, folders, facts = paper
    summary = poisoned(summary, everything=False)
    settings = {method: {POISON: POISON} for method in facts.settings}
    html = paper_page(summary, {POISON: next(iter(folders.values()))}, replace(facts, settings=settings))
    check_inert(browser, html, tmp_path / "report.html", least=5)
