"""The paper's page in a real browser."""

from pathlib import Path
from typing import Any

import pytest

from strandcast.records.files import write_text
from strandcast_studies.paper.report.page import paper_page

from ...report.test_browser import browser as browser
from ...report.test_browser import light_and_dark

pytestmark = pytest.mark.browser


@pytest.mark.slow
def test_the_papers_page_in_light_and_dark(paper: Any, tmp_path: Path, browser: str) -> None:
    page = tmp_path / "report.html"
    write_text(page, paper_page(*paper))
    light_and_dark(page, tmp_path, browser)
