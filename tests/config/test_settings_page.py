"""The page of all settings: current, complete, and each setting says when to change it."""

import re

import pytest

from strandcast.config.experiment import Experiment
from strandcast.config.schema import fields
from strandcast.config.settings_page import allowed, groups, is_group, settings_page, unit
from strandcast.config.string import String

ADVICE = re.compile(r"(^|[.;:] )(Set|Give|Raise|Lower|Change|Use|Leave|Measure)\b")


def test_the_page_is_current(project_root):
    page = (project_root / "docs" / "reference" / "settings.md").read_text(encoding="utf-8")
    assert page == settings_page(), (
        "run: python -m strandcast.config.settings_page > docs/reference/settings.md"
    )


def test_the_page_has_every_setting():
    rows = [f"{path}{name}" for path, _, settings in groups(Experiment, "", "") for name, _ in settings]
    plain = sorted(re.sub(r"\[\]|\.NAME| \(\w+\)", "", row) for row in rows)
    assert plain == sorted(path for path, field in fields() if not is_group(field))


def test_every_setting_says_what_it_does_and_one_with_a_default_when_to_change_it():
    assert [path for path, field in fields() if len(field.description or "") < 12] == []
    optional = [(path, field) for path, field in fields() if not field.is_required() and not is_group(field)]
    assert [path for path, field in optional if not ADVICE.search(field.description or "")] == []


@pytest.mark.parametrize(
    ("path", "values", "its_unit"),
    [
        ("hit_radius_m", "0 < x ≤ 0.5", "m"),
        ("string.points", "2 ≤ n ≤ 100", ""),
        ("target_m", "2 to 3 × (-10 ≤ x ≤ 10)", "m"),
        ("plan.paper.altered_rad_s", "0 < x ≤ 10", "rad/s"),
        ("estimate.paper.beta", "0 < x < 1", ""),
        ("track.polarity", "`auto`, `bright`, `dark`", ""),
        ("estimate.ranges", "`wide`, `paper` or by name: 2 × (x)", ""),
        ("lab.string.bending_stiffness_n_m2", "0 ≤ x ≤ 1", "N m²"),
    ],
)
def test_ranges_and_units(path, values, its_unit):
    assert allowed(dict(fields())[path]) == values
    assert unit(path) == its_unit


def test_a_group_has_no_values_of_its_own():
    assert is_group(Experiment.model_fields["align"])
    assert not is_group(String.model_fields["points"])
