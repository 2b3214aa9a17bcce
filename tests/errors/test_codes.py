"""Every error code is declared once, raised, and documented; what it says stands in one place."""

import ast
import pickle
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import strandcast
import strandcast_studies
from strandcast.errors import StrandcastError, StrandcastErrors
from strandcast.errors.registry import CODES_FILE, general_fixes, merged_codes, read_codes
from strandcast_studies.errors_page import errors_page

PROJECT = Path(__file__).resolve().parents[2]
PRODUCT, STUDIES = (Path(str(package.__file__)).parent for package in (strandcast, strandcast_studies))
CODE = re.compile(r"SC-[A-Z]\d{3}")


def trees(package: Path) -> Iterator[ast.Module]:
    """Yield the parsed modules of a package that name a code."""
    texts = (source.read_text(encoding="utf-8") for source in package.rglob("*.py"))
    yield from (ast.parse(text) for text in texts if CODE.search(text))


def codes_in(tree: ast.Module) -> set[str]:
    """Return the codes with which string constants of a module begin, those of docstrings left out."""
    statements = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    texts = [
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in statements
    ]
    return {match[0] for text in texts if (match := CODE.match(text))}


@cache
def raised(package: Path) -> set[str]:
    """Return the codes that a package uses."""
    return {code for tree in trees(package) for code in codes_in(tree)}


@pytest.mark.parametrize(
    ("package", "registry"), [(PRODUCT, CODES_FILE), (STUDIES, STUDIES / "error_codes.toml")]
)
def test_every_raised_code_is_registered_and_every_registered_one_is_raised(package, registry) -> None:
    used, declared = raised(package), set(read_codes(registry)[1])
    assert used - declared == set(), "declare them"
    assert declared - used == set(), "nothing raises them"


def test_no_error_repeats_the_fix_of_its_code() -> None:
    fixes = set(general_fixes().values())
    texts = {
        each.value for tree in trees(PRODUCT) for each in ast.walk(tree) if isinstance(each, ast.Constant)
    }
    assert len(fixes) > 50
    assert texts & fixes == set(), "leave it out"


def test_an_error_without_a_fix_of_its_own_has_that_of_its_code() -> None:
    general = StrandcastError("SC-X007", "the arm still moves")
    assert general.message().endswith("\n        Fix: wait until it is at rest")
    assert general.to_json()["fix"] == "wait until it is at rest"
    assert StrandcastError("SC-X007", "the arm still moves", fix="brake it").fix == "brake it"
    assert StrandcastError("SC-Z001", "an error of another package").fix is None


def test_a_code_of_a_former_version_leads_to_a_present_one() -> None:
    present, merged = set(read_codes()[1]), merged_codes()
    assert set(merged.values()) <= present
    assert set(merged) & present == set()
    assert merged["SC-A013"] == "SC-A012"


def test_product_and_studies_share_no_code() -> None:
    assert raised(PRODUCT) & raised(STUDIES) == set()


@pytest.mark.parametrize("registry", [CODES_FILE, STUDIES / "error_codes.toml"])
def test_titles_are_unique_and_every_letter_has_a_subject(registry) -> None:
    letters, codes = read_codes(registry)
    assert len({entry.title for entry in codes.values()}) == len(codes)
    assert {code[3] for code in codes} == set(letters)
    for entry in codes.values():
        assert entry.title
        assert entry.fix
        assert not entry.cause or entry.cause.endswith(".")


def test_the_documented_codes_are_current() -> None:
    page = (PROJECT / "docs" / "errors.md").read_text(encoding="utf-8")
    assert page == errors_page(), "run: python -m strandcast_studies.errors_page > docs/errors.md"


def test_errors_come_whole_from_another_process() -> None:
    one = StrandcastError("SC-W021", "there is none", file="a.json", line=3, cost="a minute", exit_code=4)
    for error in (one, StrandcastErrors([one, one])):
        copy = pickle.loads(pickle.dumps(error))
        assert (type(copy), str(copy), copy.exit_code) == (type(error), str(error), 4)
