"""Links between the pages work as plain files; `make docs` checks those of the site."""

import re
from pathlib import Path

import pytest

from .pages import PAGES, ROOT


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as the site and code hosts make them."""
    titles = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    plain = [re.sub(r"[^\w\- ]", "", re.sub(r"\]\([^)]*\)", "]", title)).strip().lower() for title in titles]
    return {title.replace(" ", "-") for title in plain}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        name, _, anchor = target.partition("#")
        if "://" in name:
            continue
        file = (page.parent / name).resolve() if name else page
        assert file.exists(), f"{target}: there is no such file"
        assert not anchor or anchor in anchors(file), f"{target}: there is no such heading"


def test_versions_are_those_of_the_lock_files():
    locks = "\n".join(lock.read_text() for lock in (ROOT / "requirements").glob("*.lock"))
    stated = re.findall(r"`([\w-]+==[\d.]+)`", (ROOT / "docs/reference/files.md").read_text(encoding="utf-8"))
    assert len(stated) >= 5
    for package in stated:
        assert re.search(rf"^{re.escape(package)} ", locks, re.MULTILINE), f"{package} is in no lock file"
