"""Every error code is declared once, raised in one room, and documented."""

import ast
import re
from collections import defaultdict
from pathlib import Path

import pytest

import strandcast
import strandcast_studies
from strandcast.errors.registry import CODES_FILE, errors_page, read_codes

PROJECT = Path(__file__).resolve().parents[2]
PRODUCT, STUDIES = (Path(str(package.__file__)).parent for package in (strandcast, strandcast_studies))
CODE = re.compile(r"SC-[A-Z]\d{3}")


def codes_in(source: Path) -> set[str]:
    """Return the codes with which string constants of a module begin, those of docstrings left out."""
    tree = ast.parse(source.read_text(encoding="utf-8"))
    statements = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    texts = [
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in statements
    ]
    return {match[0] for text in texts if (match := CODE.match(text))}


def raised(package: Path) -> dict[str, set[str]]:
    """Return for every code the rooms that use it."""
    rooms = defaultdict(set)
    for source in package.rglob("*.py"):
        for code in codes_in(source):
            rooms[code].add(source.relative_to(package).parts[0].removesuffix(".py"))
    return rooms


@pytest.mark.parametrize(
    ("package", "registry"), [(PRODUCT, CODES_FILE), (STUDIES, STUDIES / "error_codes.toml")]
)
def test_every_raised_code_is_registered_and_every_registered_one_is_raised(package, registry) -> None:
    used, declared = set(raised(package)), set(read_codes(registry)[1])
    assert used - declared == set(), "declare them"
    assert declared - used == set(), "nothing raises them"


def test_a_code_belongs_to_one_room() -> None:
    several = {code: rooms for code, rooms in raised(PRODUCT).items() if len(rooms) > 1}
    assert several == {}, "a second cause needs a number of its own"


def test_product_and_studies_share_no_code() -> None:
    assert set(raised(PRODUCT)) & set(raised(STUDIES)) == set()


@pytest.mark.parametrize("registry", [CODES_FILE, STUDIES / "error_codes.toml"])
def test_titles_are_unique_and_every_letter_has_a_subject(registry) -> None:
    letters, codes = read_codes(registry)
    assert len({entry.title for entry in codes.values()}) == len(codes)
    assert {code[3] for code in codes} == set(letters)
    for entry in codes.values():
        assert entry.title
        assert entry.fix
        assert entry.cause.endswith(".")


def test_the_documented_codes_are_current() -> None:
    page = (PROJECT / "docs" / "errors.md").read_text(encoding="utf-8")
    assert page == errors_page(), "run: python -m strandcast.errors > docs/errors.md"
