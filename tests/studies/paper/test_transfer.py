"""A throw predicted with its own fit and with another's; the model itself throws known strings."""

from pathlib import Path

import numpy as np
import pytest

from strandcast.config.estimate import EstimateSettings
from strandcast.core.strings import StringBatch
from strandcast.dynamics.batch import HandPath
from strandcast.dynamics.masses import mass_layout
from strandcast.dynamics.model import StringModel
from strandcast.estimation.fit_objective import simulate_throw
from strandcast.estimation.throws import PreparedThrow
from strandcast.estimation.unknowns import prior_exponents, space_of
from strandcast.records.alignment import HAND, Alignment
from strandcast.records.estimate import ENSEMBLE
from strandcast.records.summary import ExperimentSummary
from strandcast.records.tables import write_table
from strandcast.records.track import TRACK, Track, TrackSummary
from strandcast.report.results import read_results
from strandcast.report.summary import trial_summary
from strandcast.stages.estimate_record import ensemble_table
from strandcast_studies.paper import transfer_stage as transfer
from strandcast_studies.paper.gather import last_of
from strandcast_studies.paper.records import Transfer

LENGTH_M, N = 0.30, 10
MODEL, LAYOUT = StringModel(LENGTH_M, N), mass_layout(LENGTH_M, N, [0.30])
EXPERIMENT = """\
string: {length_m: 0.30, weights: [{place_m: 0.30}]}
target_m: [0.5, 0.5]
estimate: {start_shape: hanging, horizon_s: null}
"""


def hand(turn_rad: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times and the poses of a hand at 0.6 m that rests, swings over, and rests."""
    time_s = np.arange(0.0, 1.0, 0.002)
    share = np.clip((time_s - 0.2) / 0.5, 0.0, 1.0)
    angle = 2.4 - turn_rad * (share - np.sin(2 * np.pi * share) / (2 * np.pi))
    return time_s, np.column_stack(
        [0.6 * np.cos(angle), 0.6 * np.sin(angle), np.full(len(angle), -np.pi / 2)]
    )


def throws(turn_rad: float, strings: StringBatch) -> np.ndarray:
    """Return the points (B, F, n+1, 2) of strings that hang at rest and are swung over."""
    time_s, pose = hand(turn_rad)
    nothing = np.zeros(0)
    return simulate_throw(
        MODEL, PreparedThrow(nothing, time_s, nothing, nothing, HandPath(time_s, pose)), strings
    )[0]


def thrown(root: Path, name: str, turn_rad: float, strings: StringBatch) -> None:
    """Write an experiment with one throw of the first string, observed without error."""
    time_s, pose = hand(turn_rad)
    points = throws(turn_rad, strings)
    folder = root / "results" / name / "trial-01"
    track = Track(
        np.arange(len(time_s)),
        time_s,
        points[0],
        np.full((len(time_s), N + 1), 1e-9),
        np.zeros((len(time_s), N + 1), int),
    )
    write_table(folder / "track.parquet", TRACK, track.columns())
    columns = dict(zip(("x_m", "y_m", "angle_rad"), pose.T, strict=True))
    source = np.full(len(time_s), "measured", dtype=object)
    write_table(folder / "hand.parquet", HAND, {"source": source, "robot_time_s": time_s} | columns)
    Alignment(
        experiment=name,
        trial=1,
        source="supplied",
        offset_s=0.0,
        offset_se_s=None,
        drift=0.0,
        drift_se=None,
        drift_prior=5e-5,
        residual_rms_m=None,
        frames=len(time_s),
        motion_start_s=0.2,
        motion_end_s=0.7,
        marker_shift_m=None,
        marker_turn_rad=None,
        sync_events=[],
    ).write(folder / "alignment.json")
    TrackSummary(
        experiment=name,
        trial=1,
        source="supplied",
        points=N,
        length_m=LENGTH_M,
        decoded_frames=len(time_s),
        expected_frames=len(time_s),
        tracked_fraction=1.0,
        tip_fraction=1.0,
        marker_fraction=1.0,
        median_sigma_m=1e-9,
        choices={},
        warnings=[],
    ).write(folder / "track.json")
    write_table(folder / "ensemble.parquet", ENSEMBLE, ensemble_table(strings, np.zeros(len(strings))))
    ExperimentSummary(
        experiment=name,
        string_length_m=LENGTH_M,
        target_m=[0.5, 0.5],
        hit_radius_m=0.02,
        verdict="no hit",
        hit_trial=None,
        trials=[trial_summary(1, read_results(folder), None)],
        next_motion_sha256=None,
    ).write(folder.parent / "summary.json")
    data = root / "data" / name / "experiment.yaml"
    data.parent.mkdir(parents=True)
    data.write_text(EXPERIMENT)


@pytest.fixture(scope="module")
def strings() -> StringBatch:
    """Return a string, and the same with another weight."""
    space = space_of(EstimateSettings(forces="paper"), LAYOUT)
    chi = prior_exponents(space, MODEL, 1, np.random.default_rng(2))
    heavy = chi.copy()
    heavy[0, 10] = min(heavy[0, 10] + 0.3, 1.0)
    return space.strings(np.concatenate([chi, heavy]))


@pytest.fixture
def root(tmp_path, project_root, strings):
    (tmp_path / "config").mkdir()
    (tmp_path / "config" / "arms").symlink_to(project_root / "config" / "arms")
    thrown(tmp_path, "one", 2.0, strings)
    thrown(tmp_path, "two", 2.6, strings.take(1))
    return tmp_path


def test_a_throw_is_predicted_by_the_string_that_made_it(root, strings):
    transfer.run(root, "one", ["one", "two"])
    found = Transfer.read(root / "results" / "one" / "transfer.json")
    own, other = found.fits
    assert (own.experiment, other.experiment, found.trial) == ("one", "two", 1)
    assert own.E_m < 1e-5  # the string that made it
    assert own.ensemble_E_m[0] == own.E_m
    # The other experiment's string is this one's second member: the same E by either way.
    assert other.E_m == pytest.approx(own.ensemble_E_m[1], rel=1e-9)
    light, heavy = throws(2.0, strings)
    apart = np.linalg.norm(light - heavy, axis=-1)[hand(2.0)[0] > 0.2, 1:]
    assert other.E_m == pytest.approx(apart.mean(), rel=0.1)  # of the motion, every point alike
    assert other.E_m > 1e-3
    named = last_of(root, ["one", "two"], "ensemble.parquet")
    assert list(found.planned_from) == [path.removeprefix("results/") for path in named]
