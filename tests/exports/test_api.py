"""The Python interface on a small experiment: the numbers of the stages, units, refusals, its page."""

import re
import subprocess
import sys

import numpy as np
import pytest

import strandcast
from strandcast.arm.kinematics import hand_pose
from strandcast.errors import StrandcastError
from strandcast.records.motion import Motion


def test_the_page_of_the_interface_runs_as_printed(project, project_root, monkeypatch) -> None:
    monkeypatch.chdir(project.parent)
    monkeypatch.setenv("MPLBACKEND", "agg")
    page = (project_root / "docs" / "reference" / "api.md").read_text().replace('"demo"', '"small"')
    names: dict = {}
    for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL):
        exec(compile(block, "docs/reference/api.md", "exec"), names)
    assert names["motion"].target_m == [0.55, 0.45]
    assert set(names["spread"].index.get_level_values("point")) == set(range(11))


@pytest.mark.thorough
def test_plan_returns_the_bytes_of_the_stage(project, trial) -> None:
    planned = Motion.read(project / "results" / "small" / "trial-02" / "motion.json")
    assert trial.estimate.plan().content_sha256() == planned.content_sha256()
    assert trial.estimate.plan(target_m=(0.6, 0.4)).target_m == [0.6, 0.4]


def test_score_is_the_stages_and_follows_the_target(trial) -> None:
    assert trial.score().content() == trial.verdict.content()
    tip = trial.track[trial.track["point"] == 10]
    on_path = tuple(tip[["x_m", "y_m"]].to_numpy()[len(tip) // 2])
    assert trial.score(target_m=on_path).miss_m < 0.003
    far = trial.score(target_m=(-0.7, 0.8))
    assert not far.hit
    assert far.miss_m is None or far.miss_m > 0.1  # None: the tip was hidden where it may have been nearest


def test_simulate_repeats_the_planners_prediction(project, trial) -> None:
    motion = Motion.read(project / "results" / "small" / "trial-02" / "motion.json")
    path = trial.estimate.simulate(motion)
    hand = path[path["point"] == 0].set_index("time_s")[["x_m", "y_m"]]
    arm, trajectory = strandcast.open(project)["small"].arm, motion.trajectory()
    commanded = hand_pose(arm.chain, arm.clamp, trajectory.q_rad).position_m
    predicted = np.array(motion.predicted.hand_m)[: len(commanded)]
    simulated = hand.to_numpy()[: len(commanded)]
    # The planner repeats the errors that the joints made in the trial; both lag behind the command alike.
    assert np.abs(simulated - predicted).max() < 0.2 * np.abs(commanded - predicted).max()
    assert path.attrs["units"]["x_m"] == "m"
    assert len(trial.estimate.simulate(motion, members=2)) == 2 * len(path)
    with pytest.raises(StrandcastError, match="SC-X004"):
        trial.estimate.simulate(motion.model_copy(update={"joint_names": motion.joint_names[::-1]}))


def test_tables_have_units_and_the_track_its_points(trial) -> None:
    assert trial.track.attrs["units"]["camera_time_s"] == "s"
    assert trial.track["point"].max() == 10
    assert {"planned", "fitted"} >= set(trial.simulated["source"])
    assert trial.joints.attrs["units"]["controller_time_s"] == "s"


def test_trials_are_rows_of_a_table(project) -> None:
    opened = strandcast.open(project)["small"]
    assert opened.table.trial.tolist() == [1]
    assert opened.table.miss_m[0] == opened.trials[1].verdict.miss_m
    with pytest.raises(KeyError, match="there is no trial 9; there are files of: 1, 2"):
        opened.trials[9]


def test_what_is_not_there_is_refused(project, tmp_path) -> None:
    opened = strandcast.open(project)
    assert list(opened) == ["small"]
    for code, ask in (
        ("SC-W001", lambda: strandcast.open(tmp_path)),
        ("SC-F001", lambda: opened["dmeo"]),
        ("SC-R001", lambda: opened["small"].trials[2].track),
    ):
        with pytest.raises(StrandcastError) as refused:
            ask()
        assert refused.value.code == code


def test_importing_strandcast_loads_no_library() -> None:
    heavy = ("numpy", "numba", "pandas", "pydantic", "mujoco")
    code = f"import sys, strandcast; strandcast.open; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("settings", "field"),
    [({"hit_radius_m": -1.0}, "hit_radius_m"), ({"target": (0.6, 0.4)}, "target")],
)
def test_settings_that_are_invalid_are_refused_as_those_of_a_file(trial, settings, field) -> None:
    with pytest.raises(StrandcastError, match=field) as caught:
        trial.score(**settings)
    assert caught.value.code == "SC-F003"
