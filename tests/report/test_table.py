"""The table of all trials in a real browser: sorted by its heads, filtered, complete without a script."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from strandcast.records.files import write_text
from strandcast.report.campaign_page import campaign_page

from .campaigns import campaign_in_memory
from .chromium import Browser, Page

COLUMN = "[...document.querySelectorAll('.sortable tbody tr')].map((row) => row.cells[%d].textContent)"
HEAD = "document.querySelectorAll('.sortable th')[%d]"
MISS = 4
REMARK = 15
ROWS = 12 * 20 + 2


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the page of a campaign."""
    path = tmp_path_factory.mktemp("campaign") / "report.html"
    write_text(path, campaign_page(campaign_in_memory()))
    return path


@pytest.fixture
def page(browser: Browser, table: Path) -> Iterator[Page]:
    with browser.page(table) as opened:
        yield opened


def press(page: Page, column: int) -> list[str]:
    """Press a head with the keyboard; return the cells of its column."""
    page.value(f"{HEAD % column}.querySelector('button').focus()")
    page.press(" ")
    return list(page.value(COLUMN % column))


def numbers(cells: list[str]) -> list[float]:
    return [float(re.split(r"[^0-9.]", cell)[0]) for cell in cells if cell != "–"]


def test_a_head_sorts_by_number_up_and_down_with_the_unknown_last(page: Page) -> None:
    first = page.value(COLUMN % MISS)
    assert len(first) == ROWS
    assert first[:2] == ["–", "–"]  # what is unknown comes first as the page is opened
    up = press(page, MISS)
    assert numbers(up) == sorted(numbers(up))
    assert up[-2:] == ["–", "–"]
    assert page.value(f"{HEAD % MISS}.getAttribute('aria-sort')") == "ascending"
    down = press(page, MISS)
    assert numbers(down) == sorted(numbers(down), reverse=True)
    assert down[-2:] == ["–", "–"]
    assert sorted(first) == sorted(up) == sorted(down)
    names = press(page, 0)
    assert names == sorted(names)
    assert page.value("document.querySelectorAll('[aria-sort]').length") == 1


def test_remarks_sort_as_text_before_the_empty_ones(page: Page) -> None:
    cells = press(page, REMARK)
    written = [cell for cell in cells if cell]
    assert len(written) >= 5
    assert cells[: len(written)] == written


def test_the_filter_shows_rows_that_have_all_words(page: Page) -> None:
    page.value(
        "(() => {const f = document.querySelector('[type=search]'); f.value = 'STRING-03 miss of'; "
        "f.dispatchEvent(new Event('input'))})()"
    )
    shown = "[...document.querySelectorAll('.sortable tbody tr')].filter((row) => !row.hidden)"
    assert page.value(f"{shown}.map((row) => row.cells[1].textContent)") == ["4"]
    assert page.value("document.querySelector('output').textContent").strip() == f"1 of {ROWS} trials"
