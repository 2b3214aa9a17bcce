"""The experiment's page shows what the arm's file states wrongly, as the newest estimate has it."""

from pathlib import Path

from strandcast.core.trial_names import trial_name
from strandcast.records.estimate import Estimate, RigOffset, RigOffsets
from strandcast.report.panels.page_data import ExperimentPageData
from strandcast.report.panels.rig_offsets import compares_arm, offsets_finding, rig_offsets
from strandcast.report.results import read_results
from strandcast.report.summary import summarise

GIVEN = {"string_length_m": 0.3, "target_m": [0.606, 0.674], "hit_radius_m": 0.02}
LINK = RigOffset(
    name="link 2",
    unit="m",
    value=0.0041,
    sd=0.0012,
    hand_m=0.0041,
    wrong_probability=0.99,
    state="wrong",
    says="link 2 is 4.1 ± 1.2 mm longer than the arm's file says",
    fix="measure it",
)
ZERO = LINK.model_copy(
    update={"name": "zero of joint_1", "unit": "rad", "value": None, "sd": None, "hand_m": 0.0001}
    | {"wrong_probability": 0.03, "state": "right", "says": "joint_1 reads 0.3 ± 2.0 mrad too much"}
)
WARNING = "link 2 is 4.1 ± 1.2 mm longer than the arm's file says: measure it"
OFFSETS = RigOffsets(
    trials=[1, 2],
    right_probability=0.01,
    together_m=0.0042,
    zero_scatter_rad=1e-3,
    numbers=[LINK, ZERO],
    warnings=[WARNING],
)


def test_the_newest_estimate_says_what_is_wrong_with_the_arms_file(results: Path, tmp_path: Path) -> None:
    trials = {k: results / trial_name(k) for k in (1, 2, 3)}
    summary = summarise("swing", trials, **GIVEN)
    page = ExperimentPageData(summary, {k: read_results(each) for k, each in trials.items()}, results)
    assert not compares_arm(page)
    (tmp_path / "trial-03").mkdir()
    estimate = Estimate.read(results / "trial-03" / "estimate.json")
    estimate.model_copy(update={"rig_offsets": OFFSETS}).write(tmp_path / "trial-03" / "estimate.json")
    trials[3] = tmp_path / "trial-03"
    page = ExperimentPageData(summary, {k: read_results(each) for k, each in trials.items()}, results)
    assert compares_arm(page)
    made = rig_offsets(page)
    assert made.finding == f"L{WARNING[1:]}."
    assert made.sources == ["trial-03/estimate.json"]
    rows = [[cell.replace("\u00a0", " ") for cell in row] for row in made.tables[0].rows]
    assert rows == [
        ["link 2", "4.1 ± 1.2 mm", "99 %", "4.1 mm", "▲ wrong"],
        ["zero of joint_1", "–", "3 %", "0.1 mm", ""],
    ]


def test_an_undecided_file_and_a_right_one_are_told_apart() -> None:
    unsure = OFFSETS.model_copy(update={"warnings": [], "right_probability": 0.3})
    assert "may be wrong (with 70" in offsets_finding(unsure)
    assert "most likely link 2 is 4.1 ± 1.2 mm longer" in offsets_finding(unsure)
    right = unsure.model_copy(update={"right_probability": 0.9, "together_m": 0.0003})
    assert offsets_finding(right).startswith("Nothing that trials 1, 2 show contradicts the arm’s file: 0.3")
