"""Captures in space: units, axes, poses and points are converted; what does not fit is named."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from strandcast.errors import StrandcastError, StrandcastErrors
from strandcast.imports.capture import CapturedTrial, import_capture
from strandcast.imports.capture_mapping import CaptureMapping, capture_mapping_of
from strandcast.imports.mapping import check_mapping, load_mapping
from strandcast.records.alignment import HAND, ends_of
from strandcast.records.tables import read_table
from strandcast.records.track import read_track

from . import space_captures as captures


@pytest.fixture(scope="module")
def named():
    return captures.columns(0.2, seconds=0.6)


def imported(tmp_path, named, data, length_m=captures.LENGTH_M, name="capture.csv"):
    path = tmp_path / name
    if name.endswith(".parquet"):
        pd.DataFrame(named).to_parquet(path)
    else:
        captures.write_csv(path, named)
    mapping = check_mapping(data, CaptureMapping)
    return import_capture(path, tmp_path / "out", mapping, CapturedTrial("e", 1, length_m, 8))


@pytest.mark.parametrize("name", ["capture.csv", "capture.parquet"])
def test_millimetres_with_y_up_become_metres_with_z_up(tmp_path, named, name):
    summary = imported(tmp_path, named, captures.mapping_data(), name=name)
    assert summary.warnings == []
    assert summary.points == 4
    np.testing.assert_allclose(summary.places_m()[1:], captures.PLACES_M)
    track = read_track(tmp_path / "out/track.parquet", 4)
    np.testing.assert_allclose(track.points_m[0, 0], [0.0, 0.0, 1.0], atol=1e-6)
    np.testing.assert_allclose(track.points_m[0, 4], [0.0, 0.0, 0.2], atol=0.03)
    (end,) = ends_of(read_table(tmp_path / "out/hand.parquet", HAND))
    # The body turns, but at the start the string leaves it straight down.
    np.testing.assert_allclose(end.direction[0], [0.0, 0.0, -1.0], atol=1e-5)
    assert abs((end.direction * end.normal).sum(axis=1)).max() < 1e-9
    turned = np.degrees(np.arccos(-end.direction[-1, 2]))
    assert 10.0 < turned < 60.0


def test_a_marker_may_be_where_the_string_begins(tmp_path, named):
    data = captures.mapping_data()
    first = {"place_m": 0.0, "position": ["hand"]}
    summary = imported(tmp_path, named, data | {"markers": [first, *data["markers"]]})
    np.testing.assert_allclose(summary.places_m(), [0.0, 0.0, *captures.PLACES_M])


def test_two_points_give_the_direction_and_leave_the_roll_open(tmp_path, named):
    imported(tmp_path, named, captures.mapping_data())
    (pose,) = ends_of(read_table(tmp_path / "out/hand.parquet", HAND))
    imported(tmp_path, named, captures.mapping_data(pose=False))
    (end,) = ends_of(read_table(tmp_path / "out/hand.parquet", HAND))
    assert end.normal is None
    np.testing.assert_allclose(end.direction / 0.03, pose.direction, atol=1e-4)


@pytest.mark.parametrize("order", ["XYZ", "ZYX", "xyz"])
def test_angles_in_a_stated_order_are_the_same_orientation(tmp_path, named, order):
    data = captures.mapping_data()
    imported(tmp_path, named, data)
    (pose,) = ends_of(read_table(tmp_path / "out/hand.parquet", HAND))
    q = np.column_stack([named[f"hand_q{axis}"] for axis in "wxyz"])
    angles = Rotation.from_quat(q, scalar_first=True).as_euler(order, degrees=True)
    turned = named | {f"r{k}": angles[:, k] for k in range(3)}
    turned["r1"] = np.where(np.arange(len(angles)) == 5, np.nan, turned["r1"])
    del data["hand"]["quaternion"]
    data["hand"] |= {"euler": ["r0", "r1", "r2"], "euler_order": order}
    with pytest.raises(StrandcastError, match="SC-I008.*: r0: an angle of .* rad"):
        imported(tmp_path, turned, data)
    imported(tmp_path, turned, data | {"angle_unit": "deg"})
    (end,) = ends_of(read_table(tmp_path / "out/hand.parquet", HAND))
    assert len(end.direction) == len(pose.direction) - 1  # in one row an angle is not known
    np.testing.assert_allclose(end.direction, np.delete(pose.direction, 5, axis=0), atol=1e-5)
    np.testing.assert_allclose(end.normal, np.delete(pose.normal, 5, axis=0), atol=1e-5)


def test_angles_without_an_order_are_refused(named):
    data = captures.mapping_data()
    data["hand"] = {"position": ["hand"], "euler": ["r"], "leaves": [0, 0, -1]}
    with pytest.raises(StrandcastErrors, match="euler_order"):
        check_mapping(data, CaptureMapping)


def test_a_pivot_at_rest_is_a_place_in_numbers(tmp_path):
    time_s = np.arange(0.0, 1.0, 0.01)
    named = {"t": time_s}
    for k, place_m in enumerate(captures.PLACES_M):
        swing = 0.1 * place_m * np.sin(3.0 * time_s)
        path = np.column_stack(
            [0.2 + swing, np.full_like(time_s, -0.1), 1.5 - np.sqrt(place_m**2 - swing**2)]
        )
        named |= captures.triple(f"m{k + 1}", path)
    data = captures.mapping_data(hand={"position": ["200.0", "1500.0", "100.0"]})
    imported(tmp_path, named, data)
    (end,) = ends_of(read_table(tmp_path / "out/hand.parquet", HAND))
    np.testing.assert_allclose(end.place_m, np.tile([0.2, -0.1, 1.5], (100, 1)), atol=1e-9)


def test_a_mirrored_file_and_its_copy_give_the_same(tmp_path, named):
    mirrored = {name: -column if name.endswith(".z") else column for name, column in named.items()}
    imported(tmp_path, named, captures.mapping_data(pose=False))
    plain = read_track(tmp_path / "out/track.parquet", 4).points_m
    imported(tmp_path, mirrored, captures.mapping_data(pose=False, handedness="left"))
    np.testing.assert_allclose(read_track(tmp_path / "out/track.parquet", 4).points_m, plain, atol=1e-9)


@pytest.mark.parametrize("up", ["x", "y", "z", "-x", "-y", "-z"])
def test_axes_are_right_handed_and_the_named_one_is_up(up):
    mapping = check_mapping(captures.mapping_data(up=up), CaptureMapping)
    matrix, axis = mapping.to_world(), np.zeros(3)
    axis["xyz".index(up[-1])] = -1.0 if up[0] == "-" else 1.0
    np.testing.assert_array_equal(matrix @ axis, [0.0, 0.0, 1.0])
    assert np.linalg.det(matrix) == pytest.approx(1.0)


def test_the_command_line_names_the_same_mapping():
    mapping = capture_mapping_of(
        "hand",
        ["0.33:m2", "0.8:a,b,c"],
        up="y",
        length_unit="mm",
        time="t",
        time_unit="s",
        behind="hand_behind",
        far="far",
        far_behind="p,q,r",
    )
    assert mapping.hand.behind == ["hand_behind"]
    assert mapping.far is not None
    assert mapping.far.behind == ["p", "q", "r"]
    assert [marker.position for marker in mapping.markers] == [["m2"], ["a", "b", "c"]]


def test_a_file_of_columns_in_space_is_recognised(tmp_path):
    path = tmp_path / "columns.toml"
    path.write_text('hand = {position = ["a"]}\nmarkers = [{place_m = 0.1, position = ["m"]}]\n')
    mapping = load_mapping(path, CaptureMapping)
    assert mapping.in_space
    assert (mapping.up, mapping.length_unit) == (None, None)  # the file's, or an error


@pytest.mark.parametrize("missing", ["up", "length_unit"])
def test_neither_axis_nor_unit_is_guessed(tmp_path, named, missing):
    with pytest.raises(StrandcastError, match=f"SC-I011.*: {missing}: the file does not say"):
        imported(tmp_path, named, captures.mapping_data(**{missing: None}))
    assert not (tmp_path / "out").exists()


def test_a_wrong_option_is_named_with_what_was_given():
    with pytest.raises(StrandcastErrors) as caught:
        capture_mapping_of("h", ["far:m1"], up="q", length_unit="mile", time="t", time_unit="s")
    said = "\n".join(str(error) for error in caught.value.problems)
    for words in (
        r"up: Input .*, not 'q'\n.*--up",
        r"length_unit: .*\n.*--length-unit",
        r"not 'far'\n.*--marker",
    ):
        assert re.search(words, said), words
    with pytest.raises(StrandcastErrors, match="ERROR  give time or rate_hz, not both"):
        capture_mapping_of("h", ["0.2:m1"], up="z", length_unit="m", time="t", rate_hz=100.0)


def test_a_wrong_entry_of_a_file_is_named_with_the_keys_only_where_they_help(tmp_path):
    path = tmp_path / "columns.toml"
    path.write_text('hand = {position = ["a"], back = ["b"]}\nmarker = 3\nup = "z"\nlength_unit = "mile"\n')
    with pytest.raises(StrandcastErrors) as caught:
        load_mapping(path, CaptureMapping)
    fixes = {error.field: error.fix for error in caught.value.problems}
    assert all(error.file == str(path) for error in caught.value.problems)
    assert fixes["hand.back"] == fixes["length_unit"] == "correct it in this file"
    assert fixes["marker"] == fixes["markers"]
    assert fixes["markers"].startswith("the keys are time, ")


def broken(named, **changes):
    kept = {name: column for name, column in named.items() if changes.get(name, swapped) is not None}
    return kept | {name: change(named[name].copy()) for name, change in changes.items() if change is not None}


def swapped(column):
    column[10], column[11] = column[11], column[10]
    return column


def emptied(column):
    return np.full_like(column, np.nan)


REFUSED = {
    "metres for millimetres": ("SC-I027", {}, {"length_unit": "m"}),
    "time that goes back": ("SC-I007", {"t": swapped}, {}),
    "quaternion not of length one": ("SC-I025", {"hand_qw": lambda q: 2.0 * q}, {}),
    "no driven end": ("SC-I021", {"hand.x": emptied}, {}),
    "marker never seen": ("SC-I021", {"m2.y": emptied}, {}),
    "marker beyond the string": (
        "SC-I013",
        {},
        {"markers": [{"place_m": 0.3, "position": ["m1"]}, {"place_m": 0.9, "position": ["m2"]}]},
    ),
    "two markers at one place": (
        "SC-I013",
        {},
        {"markers": [{"place_m": 0.3, "position": ["m1"]}, {"place_m": 0.3, "position": ["m2"]}]},
    ),
    "one marker twice": (
        "SC-I013",
        {},
        {"markers": [{"place_m": 0.3, "position": ["m1"]}, {"place_m": 0.5, "position": ["m1"]}]},
    ),
    "no time": ("SC-I011", {"t": None}, {"time": None}),
    "unknown column": ("SC-I004", {}, {"time": "seconds"}),
}


IN_SPACE_ONLY = ("quaternion not of length one",)


def in_plane(data):
    """Return the mapping of the same capture as one in the plane of its x and y."""

    def two(named):
        return {"position": [f"{named['position'][0]}.{axis}" for axis in "xy"]}

    kept = {name: value for name, value in data.items() if name not in ("up", "hand")}
    markers = [marker | two(marker) for marker in data["markers"]]
    return kept | {"hand": two(data["hand"]), "markers": markers, "angle_offset_rad": -np.pi / 2}


@pytest.mark.parametrize(
    ("what", "seen"),
    [
        (what, seen)
        for what in REFUSED
        for seen in ("space", "plane")
        if (seen, what) != ("plane", *IN_SPACE_ONLY)
    ],
)
def test_what_does_not_fit_is_refused_and_nothing_is_written(tmp_path, named, what, seen):
    code, changes, data = REFUSED[what]
    mapping = captures.mapping_data(**data)
    with pytest.raises(StrandcastError) as caught:
        imported(tmp_path, broken(named, **changes), mapping if seen == "space" else in_plane(mapping))
    error = caught.value
    assert error.code == code
    assert (Path(str(error.file)).name, bool(error.field), bool(error.fix)) == ("capture.csv", True, True)
    assert not (tmp_path / "out").exists()


def test_the_same_capture_in_the_plane_and_in_space_has_the_same_places(tmp_path, named):
    imported(tmp_path, named, captures.mapping_data(pose=False))
    space = read_track(tmp_path / "out/track.parquet", 4).points_m
    imported(tmp_path, named, in_plane(captures.mapping_data()))
    plane = read_track(tmp_path / "out/track.parquet", 8).points_m
    marked = np.isfinite(plane).all(axis=(0, 2))
    np.testing.assert_array_equal(plane[:, marked], space[:, :, [0, 2]])


def test_a_string_that_leaves_backwards_is_refused_near_the_end_and_else_warned_of(tmp_path, named):
    data = captures.mapping_data(pose=False)
    data["hand"] = {"position": ["hand_behind"], "behind": ["hand"]}
    data["markers"][0]["place_m"] = 0.08
    near = named | captures.triple("m1", np.outer(np.ones(len(named["t"])), [0.0, 0.0, 0.95]))
    with pytest.raises(StrandcastError, match="SC-I029"):
        imported(tmp_path, near, data)
    (warning,) = [
        each
        for each in imported(tmp_path, named, data | {"markers": captures.mapping_data()["markers"]}).warnings
        if "direction" in each
    ]
    assert "behind" in warning


def test_a_wrong_axis_up_is_warned_of(tmp_path, named):
    (warning,) = imported(tmp_path, named, captures.mapping_data(pose=False, up="z")).warnings
    assert "check `up`" in warning


def test_gaps_stay_gaps(tmp_path, named):
    gap = named | {name: np.where(named["t"] < 0.2, np.nan, named[name]) for name in ("m2.x", "m2.y", "m2.z")}
    lost = np.abs(named["t"] - 0.4) < 0.07
    gap |= {f"hand.{axis}": np.where(lost, np.nan, named[f"hand.{axis}"]) for axis in "xyz"}
    summary = imported(tmp_path, gap, captures.mapping_data())
    assert summary.tracked_fraction == pytest.approx(1.0 - 0.25 * (named["t"] < 0.2).mean())
    assert any("were not measured for 0.1" in each for each in summary.warnings)
    assert len(read_table(tmp_path / "out/hand.parquet", HAND)["x_m"]) == (~lost).sum()


def test_instants_of_a_parquet_file_are_seconds(tmp_path, named):
    stamped = named | {
        "t": pd.Timestamp("2026-11-20 23:59:59.9", tz="UTC") + pd.to_timedelta(named["t"], "s")
    }
    imported(tmp_path, stamped, captures.mapping_data(), name="capture.parquet")
    track = read_track(tmp_path / "out/track.parquet", 4)
    np.testing.assert_allclose(np.diff(track.camera_time_s), np.diff(named["t"]), atol=1e-6)


def test_a_marker_that_jumps_to_zero_was_not_measured_there(tmp_path, named):
    lost = (named["t"] > 0.2) & (named["t"] < 0.4)
    zeros = named | {name: np.where(lost, 0.0, named[name]) for name in ("m2.x", "m2.y", "m2.z")}
    summary = imported(tmp_path, zeros, captures.mapping_data())
    track = read_track(tmp_path / "out/track.parquet", 4)
    assert np.isnan(track.points_m[:, 2]).any(axis=1).tolist() == lost.tolist()
    said = " ".join(summary.warnings)
    assert re.search(f"{lost.sum()} rows of m2.x, m2.y, m2.z are exactly 0", said)
    assert re.search(r"not measured for long.*: m2 for 0.2[0-9]* s after 0.[12]", said)
    still = named | {f"hand_behind.{axis}": np.zeros_like(lost, float) for axis in "xyz"}
    imported(tmp_path, still, captures.mapping_data())  # a place at the origin


def test_exchanged_markers_are_refused_and_a_hand_that_jumps_is_warned_of(tmp_path, named):
    late = named["t"] >= 0.3

    def exchanged(one, other):
        pairs = [(f"{one}.{axis}", f"{other}.{axis}") for axis in "xyz"]
        pairs += [pair[::-1] for pair in pairs]
        return named | {to: np.where(late, named[source], named[to]) for to, source in pairs}

    with pytest.raises(StrandcastError, match=r"SC-I029.*points 2 and 3 .* from frame 15 on, at 0.300 s"):
        imported(tmp_path, exchanged("m2", "m3"), captures.mapping_data())
    gap = exchanged("m2", "m3")
    gap["m2.x"] = np.where(np.abs(named["t"] - 0.29) < 0.02, np.nan, gap["m2.x"])
    with pytest.raises(StrandcastError, match="SC-I029.*points 2 and 3"):
        imported(tmp_path, gap, captures.mapping_data())
    moved = {name: np.where(late, named[name] + 150.0, named[name]) for name in ("hand.x", "m1.x", "m2.x")}
    said = imported(tmp_path, named | moved, captures.mapping_data()).warnings
    assert any("the hand jumps by more than 5 m/s 1 times, first in frame 15" in each for each in said)


def test_a_rate_is_compared_with_the_column_of_the_time_and_held_rows_are_left_out(tmp_path, named):
    data = captures.mapping_data()
    with pytest.raises(StrandcastError, match="SC-I028.*is 60, the file's column t has 50 rows per second"):
        imported(tmp_path, named, data | {"time": None, "rate_hz": 60.0})
    gap = {name: np.delete(column, slice(10, 15)) for name, column in named.items()}
    with pytest.raises(StrandcastError, match="SC-I028.*is 50, .* has 41.38 rows per second with its gaps"):
        imported(tmp_path, gap, data | {"time": None, "rate_hz": 50.0})
    time_s = np.arange(4 * len(named["t"])) * 0.005
    held = {name: np.repeat(column, 4) for name, column in named.items()} | {"t": time_s}
    assert any("the markers change 50 times" in each for each in imported(tmp_path, held, data).warnings)
    track = read_track(tmp_path / "out/track.parquet", 4)
    np.testing.assert_allclose(track.camera_time_s, named["t"], atol=1e-9)
