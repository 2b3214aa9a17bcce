"""The page of all settings: current, complete, and each setting says when to change it."""

import re

import pytest

from strandcast.config.camera import Board
from strandcast.config.experiment import Experiment
from strandcast.config.string import String
from strandcast_studies.settings_page import allowed, fields, groups, is_group, settings_page

ADVICE = re.compile(r"(^|[.;:] )(Set|Give|Raise|Lower|Change|Use|Leave|Measure)\b")
ADVICE_FOR_ALL = re.compile(r"(^|[.;:] )(Set|Change) them\b")  # of a group, for its settings


def test_the_page_is_current(project_root):
    page = (project_root / "docs" / "reference" / "settings.md").read_text(encoding="utf-8")
    assert page == settings_page(), (
        "run: python -m strandcast_studies.settings_page > docs/reference/settings.md"
    )


def test_the_page_has_every_setting():
    rows = [f"{path}{name}" for path, _, settings in groups(Experiment, "", "") for name, _ in settings]
    plain = sorted(re.sub(r"\[\]|\.NAME| \(\w+\)", "", row) for row in rows)
    inherited = {f"cameras.plane.board.{name}" for name in Board.model_fields}  # named in the group's text
    assert plain == sorted(path for path, field in fields() if not is_group(field) and path not in inherited)


def test_every_setting_says_what_it_does_and_one_with_a_default_when_to_change_it():
    assert [path for path, field in fields() if len(field.description or "") < 12] == []
    advised = {path for path, field in fields() if ADVICE_FOR_ALL.search(field.description or "")}
    optional = [
        (path, field)
        for path, field in fields()
        if not (field.is_required() or is_group(field) or path.rpartition(".")[0] in advised)
    ]
    assert [path for path, field in optional if not ADVICE.search(field.description or "")] == []


@pytest.mark.parametrize(
    ("path", "values"),
    [
        ("hit_radius_m", ""),
        ("string.points", ""),
        ("target_m", "list of x"),
        ("workspace_m.x_m", "[x, x]"),
        ("objective.ends_m", "[[x, x], [x, x]]"),
        ("track.polarity", "`auto`, `bright`, `dark`"),
        ("estimate.ranges", "`wide`, `paper` or by name: [x, x]"),
        ("estimate.profiles", ""),
        ("held_out", "list of n"),
    ],
)
def test_values(path, values):
    assert allowed(dict(fields())[path]) == values


def test_a_group_has_no_values_of_its_own():
    assert is_group(Experiment.model_fields["align"])
    assert not is_group(String.model_fields["points"])
