"""One version, wherever it is written."""

import re

import strandcast


def test_changelog_and_citation_name_this_version(project_root):
    newest = re.search(r"^## (\S+)", (project_root / "CHANGELOG.md").read_text(), re.M)
    cited = re.search(r"^version: (\S+)", (project_root / "CITATION.cff").read_text(), re.M)
    assert newest is not None
    assert cited is not None
    assert newest[1] == cited[1] == strandcast.__version__


def test_the_image_has_this_version(project_root):
    pages = "".join((project_root / name).read_text() for name in ("Dockerfile", "docs/how-to/install.md"))
    assert set(re.findall(r"strandcast:(\d[\w.]*)", pages)) == {strandcast.__version__}
