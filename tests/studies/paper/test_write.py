"""Experiments are written once and never overwrite another one."""

import pytest

from strandcast.errors import StrandcastErrors
from strandcast_studies.paper.cases import FILE, cases, load_plan
from strandcast_studies.paper.write import write_experiments


@pytest.fixture(scope="module")
def plan(project_root):
    return load_plan(project_root / FILE)


def test_existing_files_are_not_changed(plan, tmp_path):
    chosen = cases(plan, seeds=1, strings=[5])
    written = write_experiments(tmp_path, plan, chosen)
    assert [path.parent.name for path in written] == [case.name for case in chosen]
    before = {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in written}
    assert write_experiments(tmp_path, plan, chosen) == []
    assert {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in written} == before


def test_a_comment_does_not_change_an_experiment(plan, tmp_path):
    chosen = cases(plan, seeds=1, strings=[5], methods=["default"])
    (path,) = write_experiments(tmp_path, plan, chosen)
    path.write_text("# mine\n" + path.read_text())
    assert write_experiments(tmp_path, plan, chosen) == []
    assert path.read_text().startswith("# mine")


@pytest.mark.parametrize("text", ["seed: 7\n", "{", "\x00"])
def test_another_experiment_is_not_overwritten(plan, tmp_path, text):
    chosen = cases(plan, seeds=1, strings=[5])
    path = tmp_path / "data" / chosen[1].name / "experiment.yaml"
    path.parent.mkdir(parents=True)
    path.write_text(text)
    with pytest.raises(StrandcastErrors) as caught:
        write_experiments(tmp_path, plan, chosen)
    (problem,) = caught.value.problems
    assert problem.code == "SC-Z004"
    assert chosen[1].name in problem.fix
    assert path.read_text() == text
    assert not (tmp_path / "data" / chosen[0].name).exists()


def test_invalid_settings_are_refused_before_anything_is_written(plan, tmp_path):
    wrong = plan.model_copy(update={"common": plan.common | {"max_trials": 0}})
    with pytest.raises(StrandcastErrors) as caught:
        write_experiments(tmp_path, wrong, cases(plan, seeds=1))
    assert caught.value.problems[0].field == "max_trials"
    assert list(tmp_path.iterdir()) == []
