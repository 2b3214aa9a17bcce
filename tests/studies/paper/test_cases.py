"""config/paper.yaml as it ships: the paper's strings at their targets, all of them valid."""

import numpy as np
import pytest

from strandcast.arm.load import load_arm
from strandcast.config.load import load_experiment
from strandcast.errors import StrandcastError
from strandcast.lab.strings import PAPER_STRINGS
from strandcast_studies.paper.cases import (
    FILE,
    PaperCase,
    case_of,
    cases,
    load_plan,
    merged,
    numbers_in,
    settings_of,
)
from strandcast_studies.paper.write import write_experiments


@pytest.fixture(scope="module")
def plan(project_root):
    return load_plan(project_root / FILE)


def refusal(call, *given, **named) -> StrandcastError:
    with pytest.raises(StrandcastError) as caught:
        call(*given, **named)
    return getattr(caught.value, "problems", [caught.value])[0]


def test_the_strings_are_those_of_the_lab(plan):
    for one in plan.strings:
        thread = PAPER_STRINGS[f"paper-{one.number}"]
        assert one.string.length_m == thread.length_m
        assert [weight.place_m for weight in one.string.weights] == [place for place, _ in thread.weights]
        assert [(s.from_m, s.to_m) for s in one.string.stiff_sections] == [p[:2] for p in thread.pipes]


def test_each_string_has_the_target_of_fig_5(plan):
    assert [one.target for one in plan.strings] == [1, 1, 2, 3, 3, 3, 4]
    assert {1, *plan.string(1).also} >= {1, 2, 3}
    assert plan.target(1).target_m == (0.50, 0.50)
    assert [target.number for target in plan.targets if target.source == "paper"] == [1]


def test_every_target_is_out_of_the_arms_reach_and_within_the_strings(plan, project_root):
    arm = load_arm(project_root / "config/arms/planar3.toml").planar()
    for one in plan.strings:
        for number in (one.target, *one.also):
            away = np.hypot(*plan.target(number).target_m)
            assert arm.chain.lengths_m.sum() < away < arm.chain.lengths_m.sum() + one.string.length_m


@pytest.mark.thorough
def test_all_experiments_can_be_loaded(plan, tmp_path):
    chosen = [*cases(plan), *cases(plan, quick=True)]
    assert len(set(chosen)) == len(chosen) == 2 * (10 * plan.seeds + len(plan.quick.strings))
    for path in write_experiments(tmp_path, plan, chosen):
        case = case_of(path.parent.name)
        experiment = load_experiment(path)
        assert experiment.seed == case.seed >= plan.first_seed
        assert experiment.target_m == plan.target(case.target).target_m
        assert experiment.lab.string == f"paper-{case.string}"
        assert experiment.method == ("paper" if case.method == "paper" else None)


def test_the_papers_method_is_the_papers(plan):
    settings = settings_of(plan, PaperCase("paper", 101, 5, 3, "paper"))
    assert settings["start_string"] == "minima"
    assert settings["plan"]["duration_s"] == [0.2, 1.2]
    assert settings["method"] == "paper"
    wanted = {"search": "paper", "ranges": "paper", "trials": "latest", "horizon_s": None}
    assert wanted.items() <= settings["estimate"].items()
    assert "estimate" not in settings_of(plan, PaperCase("paper", 101, 5, 3, "default"))


def test_a_name_gives_the_case():
    case = PaperCase("paper-quick", 103, 5, 3, "default")
    assert case.name == "paper-quick-string5-target3-seed103-default"
    assert case_of(case.name) == case
    assert case_of("demo") is None
    assert case_of("paper-string1-target1-seed1-other") is None


def test_the_quick_form_is_less_of_the_same(plan):
    quick, whole = (
        settings_of(plan, PaperCase(form, 101, 1, 1, "paper")) for form in ("paper-quick", "paper")
    )
    assert quick["estimate"]["evaluations"] < whole["estimate"]["evaluations"]
    assert quick["estimate"]["search"] == "paper"
    assert {case.seed for case in cases(plan, quick=True)} == {plan.first_seed}


def test_a_choice_leaves_only_what_was_chosen(plan):
    chosen = cases(plan, seeds=2, strings=[1, 4], targets=[1, 2], methods=["default"])
    assert [(case.seed, case.string, case.target) for case in chosen] == [
        (plan.first_seed, 1, 1),
        (plan.first_seed, 1, 2),
        (plan.first_seed + 1, 1, 1),
        (plan.first_seed + 1, 1, 2),
    ]
    assert {case.method for case in chosen} == {"default"}
    assert refusal(cases, plan, strings=[8]).code == "SC-Z003"
    assert "there is no string 9" in str(refusal(cases, plan, strings=[1, 9]))
    assert "there is no target 8" in str(refusal(cases, plan, targets=[5, 8]))
    assert "one of default, paper" in refusal(cases, plan, methods=["default", "papr"]).fix
    assert "not every string" in refusal(cases, plan, strings=[2], targets=[5]).fix
    assert numbers_in(" 1, 3,") == [1, 3]
    assert refusal(numbers_in, "1;3").code == "SC-Z003"


def test_later_settings_override_earlier_ones():
    assert merged({"a": {"b": 1, "c": 2}}, {"a": {"c": [3]}, "d": None}) == {
        "a": {"b": 1, "c": [3]},
        "d": None,
    }


@pytest.mark.parametrize(
    ("old", "new", "code", "field"),
    [
        ("also: [2, 3, 5]", "also: [2, 3, 9]", "SC-Z002", ""),
        ("seeds: 3", "seeds: three", "SC-Z002", "seeds"),
        ("length_m: 0.61", "length_m: 610", "SC-Z002", "strings.6.string.length_m"),
        ("seeds: 3", "seeds: [3", "SC-Z001", None),
    ],
)
def test_a_wrong_file_is_refused(project_root, tmp_path, old, new, code, field):
    text = (project_root / FILE).read_text()
    assert old in text
    (tmp_path / "paper.yaml").write_text(text.replace(old, new))
    problem = refusal(load_plan, tmp_path / "paper.yaml")
    assert (problem.code, problem.field) == (code, field)
    assert problem.file.endswith("paper.yaml")
