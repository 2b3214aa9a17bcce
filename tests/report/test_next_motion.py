"""The pages show the prediction of a motion, and the place from which a miss is measured."""

import shutil
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from strandcast.records.motion import Motion
from strandcast.records.verdict import Verdict
from strandcast.report.facts import Facts
from strandcast.report.panels.next_motion import _draw_prediction, next_motion
from strandcast.report.panels.page_data import TrialPageData
from strandcast.report.results import read_results
from strandcast.report.trial_page import trial_page


def rows_of(motion: Motion, folder: Path) -> tuple[str, dict[str, str]]:
    motion.write(folder / "motion.json")
    content = next_motion(TrialPageData(read_results(folder), next_motion=folder / "motion.json"))
    return content.finding, {row[0]: row[1] for row in content.tables[0].rows}


def test_misses_with_disturbances_and_use_of_each_limit_are_shown(results: Path, tmp_path: Path) -> None:
    motion = Motion.read(results / "trial-02" / "motion.json")
    assert motion.predicted is not None
    assert motion.provenance is not None
    simulated = motion.predicted.model_copy(update={"calibrated": False})
    _, plain = rows_of(motion.model_copy(update={"predicted": simulated}), tmp_path)
    assert "predicted miss, simulated" in plain
    assert plain["objective"] == "point"
    joints = len(motion.joint_names)
    predicted = motion.predicted.model_copy(
        update={
            "miss_quantiles_m": {"p10": 0.002, "p50": 0.005, "p90": 0.0125},
            "hit_probability": 0.62,
            "simulated_hit_probability": 0.75,
            "calibrated": True,
            "peak_torque_n_m": [12.0] * joints,
            "limits": {"torque_n_m": [48.0] * (joints - 1) + [16.0], "jerk_rad_s3": [None] * joints},
            "workspace_room_m": 0.031,
        }
    )
    source = motion.provenance.model_copy(update={"objective": "bar from (0.8, 0.2) to (0.8, 0.4) m"})
    finding, rows = rows_of(
        motion.model_copy(update={"predicted": predicted, "provenance": source}), tmp_path
    )
    words = "5.0 mm (2.0 mm to 12.5 mm in four of five throws), 62 % likely to hit"
    assert finding.replace("\u00a0", " ") == f"Predicted miss of trial 2: {words}."
    row = rows["predicted miss, as throws like this one missed in the lab"]
    assert row.replace("\u00a0", " ") == words
    assert rows["most of a limit of torque used"].startswith("75")
    assert "most of a limit of jerk used" not in rows
    assert rows["least room to the workspace's edge"].startswith("31")
    assert rows["objective"] == "bar from (0.8, 0.2) to (0.8, 0.4) m"


@pytest.mark.parametrize(("aims_m", "marks"), [(None, 1), ([(0.8, 0.2), (0.8, 0.4)], 2), ([], 0)])
def test_only_places_aimed_at_are_marked(
    results: Path, aims_m: list[tuple[float, float]] | None, marks: int
) -> None:
    axes = Figure().add_subplot()
    motion = Motion.read(results / "trial-02" / "motion.json")
    _draw_prediction(axes, motion, Facts(aims_m=aims_m), [0, 1])
    assert len(axes.patches) == marks
    labels = [line.get_label() for line in axes.lines]
    assert labels.count("target") == min(marks, 1)


@pytest.mark.usefixtures("undrawn")
def test_a_page_says_from_where_the_miss_is_measured(results: Path, tmp_path: Path) -> None:
    folder = tmp_path / "it"
    shutil.copytree(results, folder)
    path = folder / "trial-03" / "verdict.json"
    verdict = Verdict.read(path)

    def page() -> str:
        return trial_page(folder / "trial-03", trial=3, experiment="it")

    assert "the target at" in page()
    bar = [[0.6, 0.6], [0.6, 0.8]]
    verdict.model_copy(update={"objective": "segment", "bar_m": bar}).write(path)
    assert "the bar from" in page()
    swing = {"objective": "swing", "wanted": "swing, the tip 0.7 m high at least"}
    verdict.model_copy(update=swing).write(path)
    assert "swing, the tip 0.7 m high at least; a shortfall in" in page()
