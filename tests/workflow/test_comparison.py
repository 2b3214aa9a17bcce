"""Which results the two names of a comparison stand for."""

from pathlib import Path

import pytest

from strandcast.errors import StrandcastError
from strandcast.records.verdict import Verdict
from strandcast.workflow.comparison import compare_results

SETTINGS = "string: {length_m: 0.3}\ntarget_m: [0.5, 0.5]\n"


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a project with results of two experiments, and an older copy of one's."""
    for name, miss_m in (
        ("results/rope", 0.010),
        ("results/rope-before", 0.020),
        ("old/results/cord", 0.030),
    ):
        verdict = Verdict(
            experiment="rope",
            trial=1,
            target_m=[0.5, 0.5],
            hit_radius_m=0.02,
            miss_m=miss_m,
            miss_sigma_m=0.001,
            hit=True,
            closest_frame=3,
            closest_robot_time_s=0.1,
            closest_m=[0.5, 0.5],
            reason=None,
        )
        folder = tmp_path / name / "trial-01"
        folder.mkdir(parents=True)
        verdict.write(folder / "verdict.json")
    for name in ("rope", "cord"):
        (tmp_path / "data" / name).mkdir(parents=True)
        (tmp_path / "data" / name / "experiment.yaml").write_text(SETTINGS)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("other", "difference_m"),
    [("rope-before", 0.010), ("results/rope-before", 0.010), ("old/results/cord", 0.020)],
)
def test_a_side_is_an_experiment_or_any_folder(root: Path, other: str, difference_m: float) -> None:
    """A copy under another name is read too, though its records name the experiment that they are of."""
    found = compare_results(Path(), "rope", other)
    assert found.rows[0].difference.value == pytest.approx(difference_m)


@pytest.mark.parametrize(
    ("a", "b", "code"),
    [
        ("rope", "rope", "SC-W022"),
        ("rope", "results/rope/", "SC-W022"),
        ("rope", "cord", "SC-W022"),
        ("rope", "rpe", "SC-F001"),
        ("rope", "no/such/folder", "SC-W022"),
        ("rope", "data", "SC-F001"),
        ("rope", "data/rope", "SC-W022"),
        ("rope", "", "SC-W022"),
    ],
)
def test_what_cannot_be_compared_is_refused(root: Path, a: str, b: str, code: str) -> None:
    with pytest.raises(StrandcastError) as caught:
        compare_results(Path(), a, b)
    assert caught.value.code == code
    assert caught.value.fix
