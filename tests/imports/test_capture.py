import numpy as np
import pytest

from strandcast.errors import StrandcastError, StrandcastErrors
from strandcast.imports.capture import CapturedTrial, import_capture
from strandcast.imports.capture_mapping import CaptureMapping, capture_mapping_of
from strandcast.imports.mapping import load_mapping
from strandcast.records.alignment import Alignment, read_hand
from strandcast.records.track import SUPPLIED, TrackSummary, read_track

ROWS = "ms,hx,hy,deg,mx,my,ex,ey\n0,0,900,0,0,700,0,500\n10,10,900,10,5,700,,\n20,20,900,20,8,700,2,500\n"


def capture(tmp_path, mapping: CaptureMapping, text: str = ROWS, points: int = 4) -> TrackSummary:
    path = tmp_path / "capture.csv"
    path.write_text(text)
    return import_capture(path, tmp_path / "out", mapping, CapturedTrial("e", 2, 0.4, points))


def mapping_of(**more) -> CaptureMapping:
    units = {"time_unit": "ms", "angle_unit": "deg", "length_unit": "mm"}
    return capture_mapping_of("hx,hy,deg", ["0.2:mx,my", "0.4:ex,ey"], time="ms", **(units | more))


def test_units_places_angles_and_missing_markers(tmp_path):
    summary = capture(tmp_path, mapping_of(angle_sign=-1, angle_offset_rad=-np.pi / 2, sigma_m=5e-4))
    track = read_track(tmp_path / "out/track.parquet", 4)
    np.testing.assert_allclose(track.camera_time_s, [0, 0.01, 0.02])
    np.testing.assert_allclose(track.points_m[:, 0], [[0, 0.9], [0.01, 0.9], [0.02, 0.9]])
    np.testing.assert_allclose(track.points_m[:, 2, 0], [0, 0.005, 0.008])
    np.testing.assert_allclose(track.points_m[[0, 2], 4], [[0, 0.5], [0.002, 0.5]])
    assert np.isnan(track.points_m[:, [1, 3]]).all()
    assert np.isnan(track.points_m[1, 4]).all()
    assert track.flags[0, 4] == SUPPLIED
    assert track.sigma_m[0, 4] == 5e-4
    time_s, pose = read_hand(tmp_path / "out/hand.parquet", "measured")
    np.testing.assert_allclose(pose.angle_rad, -np.pi / 2 - np.radians([0, 10, 20]))
    np.testing.assert_allclose(time_s, track.camera_time_s)
    assert summary.tracked_fraction == pytest.approx(5 / 6)
    assert summary.tip_fraction == pytest.approx(2 / 3)
    assert summary.warnings == []
    assert TrackSummary.read(tmp_path / "out/track.json") == summary
    alignment = Alignment.read(tmp_path / "out/alignment.json")
    assert (alignment.source, alignment.offset_s, alignment.trial) == ("supplied", 0.0, 2)
    assert (alignment.motion_start_s, alignment.motion_end_s) == (0.0, 0.02)


def test_markers_between_points_are_reported_with_a_better_number(tmp_path):
    summary = capture(tmp_path, mapping_of(), points=5)
    assert "40.0 mm along the string" in summary.warnings[0]
    assert "string.points: 4" in summary.warnings[0]


def test_a_hand_without_angle_is_warned_of_unless_the_direction_is_given(tmp_path):
    units = {"time": "ms", "time_unit": "ms", "length_unit": "mm"}
    markers = ["0.2:mx,my", "0.4:ex,ey"]
    (warning,) = capture(tmp_path, capture_mapping_of("hx,hy", markers, **units)).warnings
    assert "always leaves the hand along x" in warning
    down = capture_mapping_of("hx,hy", markers, **units, angle_offset_rad=-np.pi / 2)
    assert capture(tmp_path, down).warnings == []


def test_points_may_be_named(tmp_path):
    mapping = capture_mapping_of(
        "hx,hy", ["0.2@3:mx,my", "0.4:ex,ey"], time="ms", time_unit="ms", length_unit="mm"
    )
    summary = capture(tmp_path, mapping, points=5)
    track = read_track(tmp_path / "out/track.parquet", 5)
    assert np.isfinite(track.points_m[0]).all(axis=1).tolist() == [True, False, False, True, False, True]
    assert summary.choices["point_3_place_m"] == 0.2


def test_wrong_units_are_refused_with_the_distance_that_shows_them(tmp_path):
    with pytest.raises(StrandcastError, match=r"SC-I027 .* 0\.2 m along the string, is 200 m from the hand"):
        capture(tmp_path, mapping_of(length_unit="m"))
    assert not (tmp_path / "out").exists()


HAND_IN_FILE = {
    "positions": 'hand = {position = ["hx", "hy"]}\n',
    "column by column": 'hand_x = "hx"\nhand_y = "hy"\n',
}
MARKERS_IN_FILE = {
    "positions": '[[markers]]\nplace_m = 0.2\nposition = ["mx", "my"]\n'
    '[[markers]]\nplace_m = 0.4\nposition = ["ex", "ey"]\n',
    "column by column": '[[markers]]\nplace_m = 0.2\nx = "mx"\ny = "my"\n'
    '[[markers]]\nplace_m = 0.4\nx = "ex"\ny = "ey"\n',
}


@pytest.mark.parametrize("spelling", HAND_IN_FILE)
def test_a_mapping_file_says_the_same_as_options(tmp_path, spelling):
    units = 'time = "ms"\ntime_unit = "ms"\nhand_angle = "deg"\nangle_unit = "deg"\nlength_unit = "mm"\n'
    (tmp_path / "m.toml").write_text(HAND_IN_FILE[spelling] + units + MARKERS_IN_FILE[spelling])
    assert load_mapping(tmp_path / "m.toml", CaptureMapping) == mapping_of()


def test_a_second_point_of_the_hand_gives_its_direction_in_the_plane_too(tmp_path):
    angle = np.radians([-100.0, -80.0, -90.0])
    behind = np.array([[0, 900], [10, 900], [20, 900]]) - 30.0 * np.column_stack(
        [np.cos(angle), np.sin(angle)]
    )
    lines = ROWS.splitlines()
    rows = [f"{line},{x},{y}" for line, (x, y) in zip(lines[1:], behind, strict=True)]
    mapping = capture_mapping_of(
        "hx,hy",
        ["0.2:mx,my", "0.4:ex,ey"],
        behind="bx,by",
        time="ms",
        time_unit="ms",
        length_unit="mm",
    )
    summary = capture(tmp_path, mapping, "\n".join([f"{lines[0]},bx,by", *rows]) + "\n")
    assert summary.warnings == []
    np.testing.assert_allclose(read_hand(tmp_path / "out/hand.parquet", "measured")[1].angle_rad, angle)


def test_a_gap_of_the_hand_is_warned_of_in_the_plane_too(tmp_path):
    rows = [f"{10 * k},{'' if 10 < k < 25 else 0},900,{k},0,700,0,500" for k in range(40)]
    (warning,) = capture(tmp_path, mapping_of(), "\n".join([ROWS.splitlines()[0], *rows]) + "\n").warnings
    assert "were not measured for 0.15 s after 0.10 s" in warning


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"far": "ex,ey"}, "for far"),
        ({"up": "y"}, "for up"),
        ({"hand": "hx,hy,deg", "behind": "mx,my"}, "an angle is of"),
        ({"hand": "h"}, "as many columns"),
        ({"hand": "h", "markers": ["0.2@3:m"]}, "leave point out"),
        ({"rate_hz": 100.0, "time": "ms"}, "time or rate_hz"),
    ],
)
def test_an_option_that_would_not_count_is_refused(more, words):
    options = {"hand": "hx,hy", "markers": ["0.2:mx,my"]} | more
    with pytest.raises(StrandcastErrors, match=f"SC-I011(?s:.)*{words}"):
        capture_mapping_of(**options)


def test_what_cannot_be_is_refused(tmp_path):
    with pytest.raises(StrandcastError, match=r"points \[2, 2\] of 4"):
        capture(tmp_path, capture_mapping_of("hx,hy", ["0.2:mx,my", "0.21:ex,ey"], time="ms"))
    with pytest.raises(StrandcastError, match="time does not rise") as refusal:
        capture(tmp_path, mapping_of(), ROWS + "20,0,0,0,0,0,0,0\n")
    assert refusal.value.line == 5
    in_degrees = ROWS.replace("900,10", "900,25")
    with pytest.raises(StrandcastError, match="SC-I008.*: deg: an angle of 25.0 rad"):
        capture(tmp_path, mapping_of(angle_unit=None), in_degrees)
    with pytest.raises(StrandcastError, match="not PLACE:X,Y"):
        capture_mapping_of("hx,hy", ["mx,my"])
    with pytest.raises(StrandcastError, match="place_m"):
        capture_mapping_of("hx,hy", ["half:mx,my"])


@pytest.mark.parametrize(("series", "rows"), [("dynamic", 114), ("free_swing", None)])
def test_the_real_cable_comes_in_with_options_alone(real_data, tmp_path, series, rows):
    mapping = capture_mapping_of(
        "x_base,z_base,phi",
        ["0.2:x_mid,z_mid", "0.4:x_end,z_end"],
        time="t",
        angle_sign=-1,
        angle_offset_rad=-np.pi / 2,
    )
    path = real_data / "pac_cable" / series / "black_short_unweighted.markers_rebuilt.csv"
    summary = import_capture(path, tmp_path, mapping, CapturedTrial("pac", 1, 0.4, 12))
    track = read_track(tmp_path / "track.parquet", 12)
    assert rows is None or len(track.frame) == rows
    assert summary.warnings == []
    assert summary.tracked_fraction == 1.0
    detected = np.isfinite(track.points_m).all(axis=2)
    assert detected.all(axis=0).nonzero()[0].tolist() == [0, 6, 12]
    reach_m = np.linalg.norm(track.points_m[:, 12] - track.points_m[:, 0], axis=1)
    assert reach_m.max() < 0.401  # a cable does not stretch
    _, pose = read_hand(tmp_path / "hand.parquet", "measured")
    upper = track.points_m[:, 6] - track.points_m[:, 0]
    off = np.abs(np.arctan2(upper[:, 1], upper[:, 0]) - pose.angle_rad)
    assert np.median(off) < 0.6  # the cable leaves the hand downwards, along the angle given
