"""Trials are excluded and included in experiment.yaml; all other lines stay as they are."""

from pathlib import Path

import pytest

from strandcast.config.exclude import set_excluded
from strandcast.config.load import load_experiment
from strandcast.errors import StrandcastError

START = """\
# One string.
string: {length_m: 0.30, weights: [{place_m: 0.30}]}   # with a weight
target_m: [0.50,   0.5e0]

# The search:
estimate: {evaluations: 400}
"""
LIST = 'excluded:   # by hand\n  # a bad one\n  - {trial: 2, reason: "slipped"}  # see the notebook\n'


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "experiment.yaml"


def reasons(file: Path) -> dict[int, str]:
    return {each.trial: each.reason for each in load_experiment(file).excluded}


def test_a_trial_that_is_held_out_can_be_excluded_and_included_again(file: Path) -> None:
    before = START + "held_out: [2]\n"
    file.write_text(before)
    assert not set_excluded(file, 2, None)
    assert set_excluded(file, 2, "slipped")
    assert reasons(file) == {2: "slipped"}
    assert set_excluded(file, 2, None)
    assert file.read_text() == before


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_an_exclusion_adds_one_line_and_its_removal_restores_the_file(file: Path, newline: str) -> None:
    before = START.replace("\n", newline).encode()
    file.write_bytes(before)
    assert set_excluded(file, 1, "Gerät: 'x' # \"y\"")
    after = file.read_bytes()
    assert after.startswith(before)
    assert after.count(b"\n") == before.count(b"\n") + 2
    assert (b"\r\n" in after) == (newline == "\r\n")
    assert reasons(file) == {1: "Gerät: 'x' # \"y\""}
    assert set_excluded(file, 1, None)
    assert file.read_bytes() == before


def test_a_title_may_hold_other_ends_of_lines(file: Path) -> None:
    before = f'title: "one\u2028two\x85three"\n{START}excluded: []\n'
    file.write_text(before, encoding="utf-8")
    assert set_excluded(file, 2, "slipped")
    assert reasons(file) == {2: "slipped"}
    assert file.read_text(encoding="utf-8").startswith(before.removesuffix("excluded: []\n"))


def test_comments_and_other_exclusions_stay(file: Path) -> None:
    file.write_text(START.replace("# The search", LIST + "\n# The search"))
    assert set_excluded(file, 3, "cut")
    assert file.read_text() == START.replace(
        "# The search", LIST + "  - {trial: 3, reason: cut}\n\n# The search"
    )
    assert set_excluded(file, 2, "it slipped")
    assert reasons(file) == {2: "it slipped", 3: "cut"}
    assert "# by hand" in file.read_text()
    assert "# see the notebook" in file.read_text()


def test_a_list_in_one_line_stays_one(file: Path) -> None:
    file.write_text("excluded: [{trial: 1, reason: a}]\n" + START)
    set_excluded(file, 2, "b")
    assert file.read_text() == "excluded: [{trial: 1, reason: a}, {trial: 2, reason: b}]\n" + START


def test_nothing_is_written_twice(file: Path) -> None:
    file.write_text(START)
    assert not set_excluded(file, 1, None)
    assert set_excluded(file, 1, "a")
    assert not set_excluded(file, 1, "a")


def test_a_link_stays_a_link(file: Path) -> None:
    real = file.with_name("settings.yaml")
    real.write_text(START)
    file.symlink_to(real.name)
    set_excluded(file, 1, "a")
    assert file.is_symlink()
    assert reasons(real) == {1: "a"}


@pytest.mark.parametrize(
    ("text", "reason", "code"),
    [
        ("{string: {length_m: 0.3}, target_m: [0.5, 0.5]}\n", "a", "SC-F003"),
        ("---\n" + START + "...\n", "a", "SC-F003"),
        (START + "sede: 1\n", "a", "SC-F003"),
        (START + "excluded: [\n", "a", "SC-F002"),
        (START, "", "SC-F003"),
        (START, "a" * 501, "SC-F003"),
    ],
)
def test_a_file_that_cannot_be_edited_is_left_as_it_is(file: Path, text: str, reason: str, code: str) -> None:
    file.write_text(text)
    with pytest.raises(StrandcastError) as caught:
        set_excluded(file, 1, reason)
    assert caught.value.code == code
    assert file.read_text() == text
