"""Tracks measured elsewhere are checked for meaning before they become results."""

import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from strandcast.core.trial_names import trial_name
from strandcast.errors import StrandcastError
from strandcast.imports.track_checks import check_supplied
from strandcast.records.alignment import HAND, Alignment
from strandcast.records.tables import read_table, write_table
from strandcast.records.track import SUPPLIED, TRACK, Track, TrackSummary
from strandcast.stages.run import run_stage

SETTINGS = "string: {length_m: 0.4, points: 4}\ntarget_m: [0.5, 0.5]\narm: planar3\n"
TIME_S = 10.0 + np.arange(60) / 100
HAND_M = np.stack([0.3 + 0.2 * np.sin(3 * (TIME_S - 10)), 0.3 + 0.1 * (TIME_S - 10) ** 2], axis=1)
ANGLE_RAD = -1.2 + 0.8 * (TIME_S - 10)

Rows = dict[str, np.ndarray]
Damage = Callable[[Rows], Rows]


@dataclass
class Supplied:
    """An experiment's root, and the four supplied files of one trial."""

    root: Path
    trial: int = 1

    @property
    def folder(self) -> Path:
        return self.root / "data" / "swung" / trial_name(self.trial)

    def register(self) -> TrackSummary:
        run_stage("register_track", self.root, "swung", 1)
        return TrackSummary.read(self.root / "results" / "swung" / "trial-01" / "track.json")

    def damage(self, name: str, change: Damage) -> None:
        spec = TRACK if name == "track" else HAND
        path = self.folder / f"{name}.parquet"
        write_table(path, spec, change(read_table(path, spec)))


@pytest.fixture
def supplied(tmp_path: Path, project_root: Path) -> Supplied:
    return supplied_in(tmp_path, project_root)


@pytest.fixture(scope="module")
def supplied_once(tmp_path_factory: pytest.TempPathFactory, project_root: Path) -> Supplied:
    return supplied_in(tmp_path_factory.mktemp("fuzz"), project_root)


def supplied_in(tmp_path: Path, project_root: Path, trial: int = 1) -> Supplied:
    """Write a track of a straight string in a slow swing."""
    if not (tmp_path / "config").exists():
        (tmp_path / "config").symlink_to(project_root / "config")
    made = Supplied(tmp_path, trial)
    made.folder.mkdir(parents=True)
    (made.folder.parent / "experiment.yaml").write_text(SETTINGS)
    # A straight string of 0.4 m along the hand's angle.
    along = np.stack([np.cos(ANGLE_RAD), np.sin(ANGLE_RAD)], axis=1)
    points_m = HAND_M[:, None] + np.linspace(0, 0.4, 5)[:, None] * along[:, None]
    shape = points_m.shape[:2]
    sigma_m, flags = np.full(shape, 1e-3), np.full(shape, SUPPLIED, np.int32)
    track = Track(np.arange(60), TIME_S, points_m, sigma_m, flags)
    write_table(made.folder / "track.parquet", TRACK, track.columns())
    write_table(
        made.folder / "hand.parquet",
        HAND,
        {
            "source": np.full(60, "measured", dtype=object),
            "robot_time_s": TIME_S,
            "x_m": HAND_M[:, 0],
            "y_m": HAND_M[:, 1],
            "angle_rad": ANGLE_RAD,
        },
    )
    for record, name in ((summary_of(), "track.json"), (alignment_of(), "alignment.json")):
        record.model_copy(update={"trial": trial}).write(made.folder / name)
    return made


def summary_of(length_m: float = 0.4) -> TrackSummary:
    return TrackSummary(
        experiment="swung",
        trial=1,
        source="supplied",
        points=4,
        length_m=length_m,
        decoded_frames=60,
        expected_frames=60,
        tracked_fraction=1.0,
        tip_fraction=1.0,
        marker_fraction=1.0,
        median_sigma_m=1e-3,
        choices={},
        warnings=[],
    )


def alignment_of(offset_s: float = 0.0, motion_s: tuple[float, float] = (10.1, 10.5)) -> Alignment:
    return Alignment(
        experiment="swung",
        trial=1,
        source="supplied",
        offset_s=offset_s,
        offset_se_s=None,
        drift=0.0,
        drift_se=None,
        drift_prior=None,
        residual_rms_m=None,
        frames=60,
        motion_start_s=motion_s[0],
        motion_end_s=motion_s[1],
    )


def put(rows: Rows, name: str, index: int | slice, value: float) -> Rows:
    column = rows[name].copy()
    column[index] = value
    return rows | {name: column}


def scaled(rows: Rows, factor: float, *names: str) -> Rows:
    return rows | {name: rows[name] * factor for name in names}


def taken(rows: Rows, index: np.ndarray | slice) -> Rows:
    return {name: values[index] for name, values in rows.items()}


def backwards(rows: Rows) -> Rows:
    """The throw played backwards, its frames numbered again by time."""
    return rows | {"frame": 59 - rows["frame"], "camera_time_s": 20.59 - rows["camera_time_s"]}


@pytest.mark.parametrize("missing", [(), (20, 21)])
def test_a_good_track_is_registered_unchanged(supplied: Supplied, missing: tuple[int, ...]) -> None:
    supplied.damage("track", lambda t: taken(t, ~np.isin(t["frame"], missing)))
    assert supplied.register().warnings == []
    for name in ("track.parquet", "hand.parquet"):
        spec = TRACK if name == "track.parquet" else HAND
        registered = read_table(supplied.root / "results/swung/trial-01" / name, spec)
        for column, values in read_table(supplied.folder / name, spec).items():
            np.testing.assert_array_equal(registered[column], values)


@pytest.mark.parametrize(
    ("damage", "code", "words"),
    [
        (lambda t: scaled(t, 1e3, "x_m", "y_m"), "SC-I029", r"stays \d\.\d+e\+05 mm"),
        (
            lambda t: put(scaled(t, 1e3, "x_m", "y_m"), "x_m", t["point"] == 0, np.nan),
            "SC-I027",
            "m from the",
        ),
        (lambda t: scaled(t, -1, "x_m"), "SC-I029", "with left and right exchanged, .* mm remain"),
        (lambda t: scaled(t, -1, "y_m"), "SC-I029", "with up and down exchanged, .* mm remain"),
        (backwards, "SC-I029", r"stays \d+ mm rms from the hand's path; with time reversed, .* mm remain"),
        (lambda t: scaled(t, -1, "camera_time_s"), "SC-I007", r"frame 1 at -10\.01 s .59 such steps"),
        (lambda t: put(t, "camera_time_s", 7, np.nan), "SC-I025", "is nan in row 8 .1 such rows of 300"),
        (lambda t: put(t, "camera_time_s", slice(-5, None), 1e300), "SC-I028", r"span 1e\+300 s"),
        (lambda t: put(t, "camera_time_s", 7, 1e300), "SC-I007", r"at 1e\+300 s .\d such steps"),
        (lambda t: scaled(t, 1e3, "camera_time_s"), "SC-I028", "rows are 10 s apart, 0.1 per second"),
        (lambda t: scaled(t, 1e-6, "camera_time_s"), "SC-I028", "rows are 1e-08 s apart"),
        (lambda t: put(t, "x_m", slice(None), np.nan), "SC-I024", "none of its 300 rows has a place"),
        (lambda t: put(t, "x_m", 7, np.inf), "SC-I025", "is inf in row 8"),
        (lambda t: put(t, "x_m", 7, 1e300), "SC-I027", r"the farthest 1e\+300 m in frame 1, point 2"),
        (lambda t: put(t, "sigma_m", 7, 0.0), "SC-I025", "sigma_m: is 0.0 in row 8"),
        (
            lambda t: taken(t, np.repeat(np.arange(300), 2)),
            "SC-I025",
            "frame 0, point 0 has 2 rows.*300 rows",
        ),
        (lambda t: taken(t, slice(0)), "SC-I024", "none of its 0 rows"),
        (lambda t: taken(t, t["frame"] < 2), "SC-I024", "2 frames are no motion"),
        (lambda t: taken(t, t["point"] == 0), "SC-I024", "0 of 4 points of the string"),
        (lambda t: put(t, "point", 7, 9), "SC-R021", "points from 0 to 9"),
        (lambda t: put(t, "point", 7, -1), "SC-R021", "points from -1"),
        (lambda t: t | {"point": 4 - t["point"]}, "SC-I029", "stays 400 mm rms"),
        (
            lambda t: scaled(t, 1.0, "x_m") | {"camera_time_s": t["camera_time_s"] + 5},
            "SC-I033",
            "0 frames in",
        ),
    ],
)
def test_a_track_without_meaning_is_refused(
    supplied: Supplied, damage: Damage, code: str, words: str
) -> None:
    supplied.damage("track", damage)
    with pytest.raises(StrandcastError, match=f"(?s){code} .*{words}") as refusal:
        supplied.register()
    assert refusal.value.file.endswith("track.parquet")
    assert refusal.value.fix
    assert not (supplied.root / "results").exists()


@pytest.mark.parametrize(
    ("damage", "code", "words"),
    [
        (lambda h: taken(h, slice(0)), "SC-I024", "0 rows"),
        (lambda h: put(h, "robot_time_s", 7, np.nan), "SC-I025", "is nan in row 8"),
        (lambda h: put(h, "x_m", 7, np.inf), "SC-I025", "is inf in row 8"),
        (
            lambda h: put(h, "robot_time_s", 7, 10.0),
            "SC-I007",
            r"row 8 is at 10 s, the one before it at 10\.06",
        ),
        (lambda h: put(h, "robot_time_s", -1, 1e300), "SC-I028", r"span 1e\+300 s"),
        (lambda h: scaled(h, 1e3, "robot_time_s"), "SC-I033", "0 frames in common"),
        (lambda h: scaled(h, 1e3, "x_m", "y_m"), "SC-I029", "mm rms"),
        (lambda h: scaled(h, -1, "x_m"), "SC-I029", "with left and right exchanged"),
    ],
)
def test_a_hand_without_meaning_is_refused(supplied: Supplied, damage: Damage, code: str, words: str) -> None:
    supplied.damage("hand", damage)
    with pytest.raises(StrandcastError, match=f"(?s){code} .*{words}"):
        supplied.register()
    assert not (supplied.root / "results").exists()


@pytest.mark.parametrize(
    "alignment", [alignment_of(1e300), alignment_of(3.0), alignment_of(0.0, (12.0, 10.0))]
)
def test_clocks_that_do_not_meet_are_refused(supplied: Supplied, alignment: Alignment) -> None:
    alignment.write(supplied.folder / "alignment.json")
    with pytest.raises(StrandcastError, match=r"SC-I033 .* 0 frames in common"):
        supplied.register()


def test_a_summary_in_millimetres_is_refused(supplied: Supplied) -> None:
    summary_of(400.0).write(supplied.folder / "track.json")
    with pytest.raises(StrandcastError, match=r"SC-I027 .* is 400 m, the experiment's string 0\.4 m"):
        supplied.register()


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        # The string alone is mirrored, at the hand.
        (
            lambda t: t | {"x_m": 2 * np.repeat(HAND_M[:, 0], 5) - t["x_m"]},
            "1.21 rad from the hand's angle, with left and right exchanged 0.00 rad",
        ),
        (lambda t: put(t, "x_m", 7, 1.5), "1 places are farther .* the farthest 1.21 m in frame 1, point 2"),
        (
            lambda t: t | {"camera_time_s": t["camera_time_s"] + 0.15 * (t["frame"] > 40)},
            "160.0 ms per frame after frame 40",
        ),
    ],
)
def test_what_is_doubtful_is_a_warning_with_its_number(
    supplied: Supplied, damage: Damage, words: str
) -> None:
    supplied.damage("track", damage)
    warnings = supplied.register().warnings
    assert len(warnings) == 1
    assert re.search(words, warnings[0])


def test_a_track_in_space_follows_its_driven_end(supplied: Supplied) -> None:
    """Its hand's path and track are those of the plane, with y as height, and the track mirrored."""
    columns = {"x_m": "x_m", "z_m": "y_m", "y_m": "x_m"}
    for name in ("track", "hand"):
        supplied.damage(name, lambda t: t | {name: t[of] for name, of in columns.items()})
    supplied.damage("hand", lambda t: {name: values for name, values in t.items() if name != "angle_rad"})
    (supplied.folder.parent / "experiment.yaml").write_text("string: {length_m: 0.6}\n")
    summary_of(0.6).write(supplied.folder / "track.json")
    supplied.register()
    supplied.damage("track", lambda t: scaled(t, -1, "y_m"))
    with pytest.raises(StrandcastError, match=r"SC-I029 .* with front and back exchanged, .* mm remain"):
        supplied.register()


def test_a_limp_cord_that_hangs_from_the_hand_is_not_mirrored(supplied: Supplied) -> None:
    """It leaves the hand 2 rad from its angle, and its mirror image 1 rad."""

    def hang(t: Rows) -> Rows:
        hand_m = np.repeat(HAND_M, 5, axis=0)
        out_m = np.hypot(t["x_m"] - hand_m[:, 0], t["y_m"] - hand_m[:, 1])
        angle_rad = np.repeat(ANGLE_RAD, 5) - 2.0
        along = np.stack([np.cos(angle_rad), np.sin(angle_rad)])
        return t | {f"{axis}_m": hand_m[:, k] + out_m * along[k] for k, axis in enumerate("xy")}

    supplied.damage("track", hang)
    assert supplied.register().warnings == []


CASES = int(os.environ.get("STRANDCAST_FUZZ_CASES", "100"))
NUMBERS = [np.nan, np.inf, -np.inf, 0.0, -1.0, 1e-320, 1e300, -1e300, 1e9, 0.5, 10.2]
CHANGES = st.lists(
    st.tuples(
        st.sampled_from(["one", "some", "scale", "twice", "without", "shuffled"]),
        st.sampled_from([*TRACK.columns, "robot_time_s", "angle_rad"]),
        st.integers(0, 299),
        st.sampled_from(NUMBERS),
    ),
    min_size=1,
    max_size=3,
)


@settings(max_examples=CASES, deadline=None, derandomize=CASES == 100)
@given(st.sampled_from(["track", "hand"]), CHANGES)
def test_any_values_are_refused_or_kept(
    supplied_once: Supplied, name: str, changes: list[tuple[str, str, int, float]]
) -> None:
    """Whatever is in the tables: one clear error, or all finite numbers as they were supplied."""
    files = {"track": supplied_once.folder / "track.parquet", "hand": supplied_once.folder / "hand.parquet"}
    spec, good = (TRACK if name == "track" else HAND), files[name].read_bytes()
    rows = read_table(files[name], spec)
    for what, column, k, value in changes:
        rows = altered(rows, what, column, k, value)
    write_table(files[name], spec, rows)
    summary = TrackSummary.read(supplied_once.folder / "track.json")
    try:
        check_supplied(files["track"], files["hand"], alignment_of(), summary)
    except StrandcastError as refusal:
        assert refusal.file in map(str, files.values())
        assert re.search(r"\d", refusal.what)
    else:
        there = np.isfinite(rows["x_m"]) & np.isfinite(rows["y_m"])
        for column in rows.keys() - {"source", "x_m", "y_m"}:
            assert np.isfinite(rows[column][there]).all()
        assert np.nanmax(np.abs(rows["x_m"])) < 10
    finally:
        files[name].write_bytes(good)


def altered(rows: Rows, what: str, column: str, k: int, value: float) -> Rows:
    """Return a table's rows after one change."""
    count = len(rows["x_m"])
    if column in rows and rows[column].dtype == np.int32:
        value = int(np.clip(np.nan_to_num(value), -(2**31), 2**31 - 1))
    if what in ("one", "some", "scale") and column in rows and count:
        index = k % count if what == "one" else slice(k % count, None)
        with np.errstate(all="ignore"):
            return put(rows, column, index, rows[column][index] * value if what == "scale" else value)
    order = np.arange(count)
    if what == "twice":
        order = np.concatenate([order, order[k % max(count, 1) :]])
    elif what == "without":
        order = order[: k % max(count, 1)]
    elif what == "shuffled":
        order = np.random.default_rng(k).permutation(order)
    return taken(rows, order)
