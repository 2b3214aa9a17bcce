"""The experiment's page shows how much throws differ on the rig, if that was planned with."""

from pathlib import Path

from strandcast.core.trial_names import trial_name
from strandcast.records.motion import Motion, RigScatter
from strandcast.report.panels.page_data import ExperimentPageData
from strandcast.report.panels.rig_scatter import learns_scatter, rig_scatter
from strandcast.report.results import read_results
from strandcast.report.summary import summarise

GIVEN = {"string_length_m": 0.3, "target_m": [0.606, 0.674], "hit_radius_m": 0.02}
LENGTH = RigScatter(
    quantity="grasp_length_m",
    unit="m",
    prior_median=0.0015,
    prior_factor=2.0,
    measured={1: [0.3021], 2: [0.2983]},
    errors={1: [0.0002], 2: [0.0002]},
    median=0.0024,
    low=0.0011,
    high=0.0062,
    warnings=["grasp_length_m: drifts from trial to trial"],
)
ZEROS = LENGTH.model_copy(
    update={
        "quantity": "joint_zero_rad",
        "unit": "rad",
        "measured": {2: [0.0011, None, -0.0004]},
        "errors": {2: [0.0002, None, 0.0002]},
        "warnings": [],
    }
)


def test_the_newest_motion_says_what_was_learnt(results: Path, tmp_path: Path) -> None:
    trials = {k: results / trial_name(k) for k in (1, 2, 3)}
    summary = summarise("swing", trials, **GIVEN)
    page = ExperimentPageData(summary, {k: read_results(each) for k, each in trials.items()}, results)
    assert not learns_scatter(page)
    (tmp_path / "trial-03").mkdir()
    motion = Motion.read(results / "trial-03" / "motion.json")
    assert motion.provenance is not None
    known = motion.provenance.model_copy(update={"scatter": [LENGTH, ZEROS]})
    motion.model_copy(update={"provenance": known}).write(tmp_path / "trial-03" / "motion.json")
    trials[3] = tmp_path / "trial-03"
    page = ExperimentPageData(summary, {k: read_results(each) for k, each in trials.items()}, results)
    assert learns_scatter(page)
    made = rig_scatter(page)
    assert made.finding == "grasp_length_m: drifts from trial to trial."
    assert made.sources == ["trial-03/motion.json"]
    heads, rows = made.tables[0].heads, made.tables[0].rows
    assert heads == ["quantity", "unit", "expected", "trial 1", "trial 2", "learnt", "90 %", "from"]
    expected = ["1.5 ×÷ 2", "302.1", "298.3", "2.4", "1.1 to 6.2", "2 trials"]
    assert rows[0] == ["length out of the clamp", "mm", *expected]
    assert rows[1][3:5] == ["–", "1.1, –, -0.4"]
    assert rows[1][-1] == "1 trial"
