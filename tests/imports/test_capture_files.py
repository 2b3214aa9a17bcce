"""Files of capture systems as each maker writes them: names, units, rate, axes and gaps are the file's."""

import re
from datetime import timedelta
from decimal import Decimal
from importlib.util import find_spec
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from strandcast.cli.app import app
from strandcast.errors import StrandcastError
from strandcast.imports.capture import CapturedTrial, import_capture
from strandcast.imports.capture_mapping import CaptureMapping, capture_mapping_of
from strandcast.imports.capture_table import read_capture, times_of, with_units
from strandcast.imports.mapping import check_mapping
from strandcast.records.track import read_track

RATE_HZ, ROWS, LENGTH_M = 240.0, 48, 0.8
MARKERS = {"tip": 0.8, "middle": 0.4}
SWING = 0.3 * np.sin(2 * np.pi * 0.8 * np.arange(ROWS) / RATE_HZ)
WORLD_M = {  # z up
    "hand": np.column_stack([0.02 * SWING, np.zeros(ROWS), np.full(ROWS, 1.5)]),
    "middle": np.column_stack([0.4 * np.sin(SWING), np.zeros(ROWS), 1.5 - 0.4 * np.cos(SWING)]),
    "tip": np.column_stack([0.8 * np.sin(SWING), np.zeros(ROWS), 1.5 - 0.8 * np.cos(SWING)]),
}
GAP = slice(10, 13)  # of the tip
QUATERNION = [0.0, 0.0, 0.6, 0.8]  # x, y, z, w


def cells(values, missing=""):
    return [missing if np.isnan(value) else f"{value:.6f}" for value in values]


def seen(name, scale, y_up):
    place = scale * WORLD_M[name]
    if y_up:
        place = np.column_stack([place[:, 0], place[:, 2], -place[:, 1]])
    if name == "tip":
        place[GAP] = np.nan
    return place


def optitrack(version="1.23"):
    name = {"hand": "hand", "tip": "string:tip", "middle": "string:middle"}
    kinds = ["Rotation"] * 4 + ["Position"] * 3 + ["Mean Marker Error"]
    facts = {
        "Format Version": version,
        "Take Name": "Take 1",
        "Capture Frame Rate": "240.000000",
        "Export Frame Rate": "240.000000",
        "Rotation Type": "Quaternion",
        "Length Units": "Meters",
    }
    head = [
        [cell for fact in facts.items() for cell in fact],
        [],
        ["", "Type", *["Rigid Body"] * 8, *["Marker"] * 6],
        ["", "Name", *["hand"] * 8, *[name[each] for each in ("tip", "middle") for _ in range(3)]],
        ["", "ID", *["1"] * 8, *["27:A5"] * 6],
        *([["", "Parent", *[""] * 13, "x"]] if version > "1.23" else []),
        ["", "", *kinds, *["Position"] * 6],
        ["Frame", "Time (Seconds)", *"XYZWXYZ", "", *"XYZXYZ"],
    ]
    places = [seen(each, 1.0, True) for each in ("hand", "tip", "middle")]
    for k in range(ROWS):
        body = [*QUATERNION, *places[0][k], 1e-4]
        head.append([str(k), f"{k / RATE_HZ:.6f}", *cells([*body, *places[1][k], *places[2][k]])])
    return "\r\n".join(",".join(row) for row in head) + "\r\n"


def vicon():
    forces = ["Devices", "960", ",,Plate - Force,,", "Frame,Sub Frame,Fx,Fy,Fz", ",,N,N,N"]
    forces += [f"{1 + k // 4},{k % 4},0,0,1" for k in range(4 * ROWS)]
    names = ["hand", "tip", "middle"]
    rows = [
        "",
        "Trajectories",
        "240",
        ",,hand,,,string:tip,,,string:middle",
        "Frame,Sub Frame" + ",X,Y,Z" * 3,
    ]
    rows += [",," + ",".join(["mm"] * 9)]
    places = [seen(name, 1e3, False) for name in names]
    rows += [f"{101 + k},0," + ",".join(cells(np.hstack([each[k] for each in places]))) for k in range(ROWS)]
    return "\n".join(forces + rows) + "\n\n"


def qualisys(header=True):
    facts = {
        "NO_OF_FRAMES": ROWS,
        "NO_OF_CAMERAS": 8,
        "NO_OF_MARKERS": 3,
        "FREQUENCY": 240,
        "NO_OF_ANALOG": 0,
    }
    facts |= {"DESCRIPTION": "--", "TIME_STAMP": "2026-11-20, 17:01:02\t12.5", "DATA_INCLUDED": "3D"}
    lines = [f"{name}\t{value}" for name, value in facts.items()]
    lines.append("MARKER_NAMES\thand\tstring:tip\tstring:middle")
    if header:
        lines.append("Frame\tTime\t" + "\t".join(f"{name} {axis}" for name in "abc" for axis in "XYZ"))
    for k in range(ROWS):
        row = np.hstack([seen(name, 1e3, False)[k] for name in ("hand", "tip", "middle")])
        before = [str(k + 1), f"{k / RATE_HZ:.5f}"] if header else []
        lines.append("\t".join([*before, *cells(row, "0.000000")]) + "\t")
    return "\n".join(lines) + "\n"


def trc():
    lines = ["PathFileType\t4\t(X/Y/Z)\ttake.trc", "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits"]
    lines += [f"240\t240\t{ROWS}\t3\tmm", "Frame#\tTime\thand\t\t\tstring:tip\t\t\tstring:middle\t\t"]
    lines += ["\t\t" + "\t".join(f"{axis}{k}" for k in (1, 2, 3) for axis in "XYZ"), ""]
    for k in range(ROWS):
        row = np.hstack([seen(name, 1e3, True)[k] for name in ("hand", "tip", "middle")])
        lines.append("\t".join([str(k + 1), f"{k / RATE_HZ:.5f}", *cells(row)]))
    return "\n".join(lines) + "\n"


def vicon_with_all_tables():
    """Return joint angles and a modelled point in a table of their own, as Nexus exports them before."""
    rows = ["Model Outputs", "240", ",,knee,,,com,,", "Frame,Sub Frame,X,Y,Z,X,Y,Z", ",,deg,deg,deg,mm,mm,mm"]
    rows += [f"{101 + k},0,1,2,3,4,5,6" for k in range(ROWS)]
    return "\n".join(rows) + "\n\n" + vicon()


def optitrack_with_time_code():
    """Return version 1.24 with a third column of the time code."""
    rows = [row.split(",") for row in optitrack("1.24").split("\r\n")]
    for row in rows[2:-1]:
        row.insert(2, "TimeCode" if row[0] == "Frame" else "15:26:46:12.02" if row[0] else "")
    return "\r\n".join(",".join(row) for row in rows)


def qualisys_later():
    """Return version 2.0.0 of QTM's format, on an external time base, with NULL for gaps."""
    text = "FILE_VERSION\t2.0.0\n" + qualisys().replace("FREQUENCY\t240", "FREQUENCY\tEXT")
    return text.replace("\t0.000000" * 3, "\tNULL" * 3)


FILES = {
    "optitrack.csv": (optitrack, None),
    "optitrack-new.csv": (lambda: optitrack("1.25"), None),
    "vicon.csv": (vicon, None),
    "qualisys.tsv": (qualisys, None),
    "qualisys-bare.tsv": (lambda: qualisys(header=False), None),
    "take.trc": (trc, "y"),  # the format names no axis
    "optitrack-1.22.csv": (lambda: re.sub(",ID,.*\r\n", "", optitrack("1.22")), None),
    "optitrack-1.24.csv": (optitrack_with_time_code, None),
    "optitrack-comma.csv": (lambda: optitrack().replace("Take 1", "swing, fast"), None),
    "vicon-tables.csv": (vicon_with_all_tables, None),
    "vicon.txt": (lambda: vicon().replace(",", "\t"), None),
    "qualisys-later.tsv": (qualisys_later, None),
    "qualisys-commas.tsv": (lambda: qualisys().replace(".", ","), None),
}


@pytest.mark.parametrize("name", FILES)
def test_what_the_file_says_need_not_be_given(tmp_path, name):
    text, up = FILES[name]
    (tmp_path / name).write_text(text(), newline="")
    markers = [f"{place}:string:{marker}" for marker, place in MARKERS.items()]
    mapping = capture_mapping_of("hand", markers, up=up)
    summary = import_capture(tmp_path / name, tmp_path / "out", mapping, CapturedTrial("e", 1, LENGTH_M, 8))
    track = read_track(tmp_path / "out/track.parquet", 2)
    time_s = track.camera_time_s - track.camera_time_s[0]
    np.testing.assert_allclose(time_s, np.arange(ROWS) / RATE_HZ, atol=1e-5)
    expected = np.stack([WORLD_M[each] for each in ("hand", "middle", "tip")], axis=1)
    expected[GAP, 2] = np.nan
    np.testing.assert_allclose(track.points_m, expected, atol=1e-6)
    assert [("up" in each) for each in summary.warnings] == ([] if up else [True])


def qualisys_smpte():
    lines = qualisys().split("\n")
    return "\n".join(
        re.sub(r"^(Frame\tTime|\d+\t[\d.]+)", r"\1\t" + ("SMPTE" if "Frame" in line else "01:02:03:04"), line)
        if line.count("\t") > 8
        else line
        for line in lines
    )


def test_a_column_of_smpte_times_is_no_marker(tmp_path):
    (tmp_path / "take.tsv").write_text(qualisys_smpte())
    table = read_capture(tmp_path / "take.tsv")
    np.testing.assert_allclose(table.column("hand.z"), 1500.0)
    assert table.names[:3] == ["frame", "time", "smpte"]


@pytest.mark.parametrize("cut", [2, 70])  # characters of the last number, or whole cells
def test_the_last_row_of_a_take_that_was_cut_is_left_out(tmp_path, cut):
    (tmp_path / "take.csv").write_text(optitrack()[: -2 - cut], newline="")
    table = read_capture(tmp_path / "take.csv")
    assert len(table.values) == ROWS - 1
    assert "was cut" in table.notes[0]


def test_eulers_angles_are_named(tmp_path):
    text = optitrack().replace("Rotation Type,Quaternion", "Rotation Type,XYZ")
    (tmp_path / "take.csv").write_text(text, newline="")
    body = {"position": ["hand"], "quaternion": ["hand"], "leaves": [0, 0, -1]}
    mapping = check_mapping(
        {"hand": body, "markers": [{"place_m": 0.8, "position": ["string:tip"]}]}, CaptureMapping
    )
    with pytest.raises(StrandcastError, match="angles of hand about three axes") as caught:
        import_capture(tmp_path / "take.csv", tmp_path / "out", mapping, CapturedTrial("e", 1, LENGTH_M, 8))
    assert caught.value.fix == "export quaternions, or give euler = ['hand'] and euler_order"


def plain(name, first, places=tuple(range(ROWS))):
    """Return a CSV of no maker, with one column before the markers."""
    lines = [",".join([name, *(f"{each}.{axis}" for each in WORLD_M for axis in "xyz")])]
    lines += [",".join([first(k), *cells(np.hstack([each[k] for each in WORLD_M.values()]))]) for k in places]
    return "\n".join(lines) + "\n"


def test_rounded_times_are_those_of_the_even_clock(tmp_path):
    rows = "".join(f"{k / RATE_HZ:.3f},0,0,{k}\n" for k in range(500))
    (tmp_path / "take.csv").write_text("t,tip.x,tip.y,tip.z\n" + rows)
    time_s, notes = times_of(read_capture(tmp_path / "take.csv"), capture_mapping_of("tip", ["0.8:tip"]))
    np.testing.assert_allclose(time_s, np.arange(500) / RATE_HZ, atol=1e-9)
    assert notes == ["its times are rounded to 0.001 s: those of 240 rows per second are used"]


@pytest.mark.parametrize("name", ["Frame", "frame_no", "FRAME #"])
def test_rows_that_are_missing_between_numbered_frames_take_their_time(tmp_path, name):
    kept = [k for k in range(ROWS) if k not in (20, 21, 30)]
    (tmp_path / "take.csv").write_text(plain(name, lambda k: str(100 + k), kept))
    mapping = capture_mapping_of("hand", ["0.8:tip"], rate_hz=RATE_HZ)
    time_s, _ = times_of(read_capture(tmp_path / "take.csv"), mapping)
    np.testing.assert_allclose(time_s - time_s[0], np.array(kept) / RATE_HZ)


@pytest.mark.parametrize("numbers", ["0", "4 * k", "'world'"])  # no numbers of the rows
def test_a_column_named_frame_that_does_not_number_the_rows_is_none(tmp_path, numbers):
    (tmp_path / "take.csv").write_text(plain("frame", lambda k: str(eval(numbers, {"k": k}))))
    time_s, _ = times_of(
        read_capture(tmp_path / "take.csv"), capture_mapping_of("hand", ["0.8:tip"], rate_hz=RATE_HZ)
    )
    np.testing.assert_allclose(time_s, np.arange(ROWS) / RATE_HZ)


def test_times_in_another_unit_than_stated_are_no_clock(tmp_path):
    (tmp_path / "take.csv").write_text(plain("t", lambda k: f"{k / RATE_HZ:.6f}"))
    mapping = capture_mapping_of("hand", ["0.8:tip"], time_unit="us")
    assert times_of(read_capture(tmp_path / "take.csv"), mapping)[0][1] == pytest.approx(4.167e-9)


@pytest.mark.parametrize("kind", [pa.duration("us"), pa.decimal128(12, 6)])
def test_durations_and_decimals_of_parquet_are_times(tmp_path, kind):
    times = [timedelta(microseconds=k * 4000) for k in range(4)]
    if pa.types.is_decimal(kind):
        times = [Decimal(k * 4) / 1000 for k in range(4)]
    pq.write_table(pa.table({"t": pa.array(times, kind)}), tmp_path / "take.parquet")
    table = read_capture(tmp_path / "take.parquet")
    np.testing.assert_allclose(table.times("t", 1.0), 0.004 * np.arange(4))


def test_a_header_without_its_first_line_needs_the_unit_alone(tmp_path):
    (tmp_path / "take.csv").write_text(optitrack().split("\r\n", 2)[2])
    table = read_capture(tmp_path / "take.csv")
    assert table.points() == ["hand", "string:tip", "string:middle"]
    assert (table.maker, table.time, table.length_unit) == ("OptiTrack", ("time", 1.0), None)


@pytest.mark.parametrize("word", ["in", "inches"])
def test_inches_are_a_unit_and_an_unknown_one_is_named(tmp_path, word):
    mapping = capture_mapping_of("hand", ["0.8:string:tip"], up="y")
    (tmp_path / "take.trc").write_text(trc().replace("\t3\tmm", f"\t3\t{word}"))
    assert with_units(read_capture(tmp_path / "take.trc"), mapping)[0].unit_m() == 0.0254
    (tmp_path / "take.trc").write_text(trc().replace("\t3\tmm", "\t3\tum"))
    table = read_capture(tmp_path / "take.trc")
    with pytest.raises(StrandcastError, match="SC-I011.*unit of length is 'um'"):
        with_units(table, mapping)
    assert with_units(table, mapping.model_copy(update={"length_unit": "mm"}))[0].unit_m() == 1e-3


def test_a_body_tracked_with_its_orientation_is_named_once(tmp_path):
    (tmp_path / "take.csv").write_text(optitrack())
    table = read_capture(tmp_path / "take.csv")
    assert table.points() == ["hand", "string:tip", "string:middle"]
    quaternion = table.columns([f"hand.q{axis}" for axis in "xyzw"])
    np.testing.assert_allclose(quaternion, np.tile(QUATERNION, (ROWS, 1)))


def test_a_body_of_six_axes_has_a_quaternion(tmp_path):
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # by 90° about z
    lines = ["NO_OF_FRAMES\t3", "FREQUENCY\t100", "DATA_INCLUDED\t6D", "BODY_NAMES\thand"]
    lines.append("X\tY\tZ\tRoll\tPitch\tYaw\tResidual\t" + "\t".join(f"Rot[{k}]" for k in range(9)))
    row = [100.0, 200.0, 300.0, 0.0, 0.0, 90.0, 0.1, *turn.T.ravel()]
    lines += ["\t".join(f"{value:.6f}" for value in row)] * 2 + ["\t".join(["0.000000"] * 16)]
    (tmp_path / "6d.tsv").write_text("\n".join(lines) + "\n")
    table = read_capture(tmp_path / "6d.tsv")
    q = table.columns([f"hand.q{axis}" for axis in "wxyz"])
    np.testing.assert_allclose(q[:2], [[np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]] * 2, atol=1e-6)
    assert np.isnan(q[2]).all()
    assert np.isnan(table.column("hand.x")[2])
    np.testing.assert_allclose(
        times_of(table, capture_mapping_of("hand", ["0.8:hand"]))[0], [0.0, 0.01, 0.02]
    )


def test_an_empty_column_between_bodies_is_no_number_of_theirs(tmp_path):
    rows = ["NO_OF_FRAMES\t3", "FREQUENCY\t100", "DATA_INCLUDED\t6D", "BODY_NAMES\tone\ttwo"]
    rows += [f"{k}\t{0.01 * k}\t" + "\t".join(["1"] * 16) + "\t\t" + "\t".join(["2"] * 16) for k in range(3)]
    (tmp_path / "6d.tsv").write_text("\n".join(rows) + "\n")
    table = read_capture(tmp_path / "6d.tsv")
    assert table.columns(["time", "one.z", "two.x", "two.Rot[8]"])[2].tolist() == [0.02, 1, 2, 2]
    assert table.listed().startswith("one, two, frame, time, one.roll")


@pytest.mark.parametrize("name", FILES)
def test_a_file_cut_within_its_header_is_one_message(tmp_path, name):
    lines = FILES[name][0]().splitlines()
    for kept in range(1, 12):
        (tmp_path / name).write_text("\n".join(lines[:kept]) + "\n")
        try:
            assert len(read_capture(tmp_path / name).values) > 0
        except StrandcastError as error:
            assert error.code in ("SC-I001", "SC-I004")


def test_another_unit_or_rate_than_the_files_is_refused(tmp_path):
    (tmp_path / "take.csv").write_text(vicon())
    for more, code in (({"length_unit": "m"}, "SC-I027"), ({"rate_hz": 100.0}, "SC-I028")):
        mapping = capture_mapping_of("hand", ["0.8:string:tip"], **more)
        with pytest.raises(StrandcastError, match=f"{code}.*the file says"):
            import_capture(
                tmp_path / "take.csv", tmp_path / "out", mapping, CapturedTrial("e", 1, LENGTH_M, 8)
            )


def test_the_command_names_what_the_file_has_and_takes_two_columns_in_a_plane(
    tmp_path, project_root, monkeypatch
):
    from strandcast.cli import exchange

    monkeypatch.setattr(exchange, "ROOT", tmp_path)
    (tmp_path / "config").symlink_to(project_root / "config")
    folder = tmp_path / "data/swung"
    folder.mkdir(parents=True)
    (folder / "experiment.yaml").write_text("string: {length_m: 0.8, points: 8}\n")
    (tmp_path / "take.csv").write_text(optitrack())
    run = CliRunner().invoke(app, ["import", "track", "swung", "1", str(tmp_path / "take.csv")])
    assert run.exit_code == 2
    said = " ".join(re.sub(r"[│\n]", " ", run.output).split())
    assert "hand, string:tip, string:middle" in said
    context = SimpleNamespace(params={"captures": [tmp_path / "take.csv"]})
    assert exchange.complete_point(context, "") == ["hand", "string:tip", "string:middle"]
    assert exchange.complete_point(context, "0.8:string:t") == ["0.8:string:tip"]
    plane = ["--hand", "hand.x,hand.y", "--marker", "0.4:string:middle.x,string:middle.y"]
    plane += ["--angle-offset", "-1.5708", "--marker", "0.8:string:tip.x,string:tip.y"]
    run = CliRunner().invoke(app, ["import", "track", "swung", "1", str(tmp_path / "take.csv"), *plane])
    assert run.exit_code == 0, run.output
    track = read_track(folder / "trial-01/track.parquet", 8)
    np.testing.assert_allclose(track.points_m[0, 4], WORLD_M["middle"][0, ::2], atol=1e-6)
    line = [
        "import",
        "track",
        "swung",
        "1",
        "take.csv",
        "--columns",
        "columns.toml",
        "--rate",
        "60",
        "--up",
        "z",
    ]
    run = CliRunner().invoke(app, [*line, "--replace"])
    assert run.exit_code == 2
    assert "--up, --rate: write this into the file" in run.output


def write_c3d(path, units=("mm",), screen="+Z", rate_hz=RATE_HZ):
    import ezc3d

    file = ezc3d.c3d()
    names = ["hand", "string:tip", "string:middle"]
    place = np.stack([seen(name.split(":")[-1], 1e3, False).T for name in names], axis=1)
    gaps = np.isnan(place).any(axis=0)
    file["parameters"]["POINT"]["RATE"]["value"] = [rate_hz]
    file["parameters"]["POINT"]["LABELS"]["value"] = names
    file["parameters"]["POINT"]["UNITS"]["value"] = list(units)
    if screen:
        file.add_parameter("POINT", "Y_SCREEN", [screen])
    file["data"]["points"] = np.concatenate([place, np.ones((1, *place.shape[1:]))])
    file["data"]["meta_points"]["residuals"] = np.where(gaps, -1.0, 0.0)[None]
    file["data"]["meta_points"]["camera_masks"] = np.zeros((7, *place.shape[1:]), bool)
    file.write(str(path))


needs_ezc3d = pytest.mark.skipif(
    find_spec("ezc3d") is None, reason="the optional package ezc3d is not installed"
)


@needs_ezc3d
@pytest.mark.parametrize(
    ("units", "screen"), [(("mm",), "+Z"), (("Millimeters",), "+Z"), (("mm", "MM", "mm"), "-Z"), ((), None)]
)
def test_a_c3d_file_gives_rate_unit_and_axis(tmp_path, units, screen):
    write_c3d(tmp_path / "take.c3d", units, screen)
    markers = [f"{place}:string:{marker}" for marker, place in MARKERS.items()]
    more = {"length_unit": None if units else "mm", "up": None if screen == "+Z" else "z"}
    mapping = capture_mapping_of("hand", markers, **more)
    import_capture(tmp_path / "take.c3d", tmp_path / "out", mapping, CapturedTrial("e", 1, LENGTH_M, 8))
    track = read_track(tmp_path / "out/track.parquet", 2)
    np.testing.assert_allclose(track.camera_time_s, np.arange(ROWS) / RATE_HZ, atol=1e-9)
    assert np.isnan(track.points_m[GAP, 2]).all()
    np.testing.assert_allclose(track.points_m[:, 1], WORLD_M["middle"], atol=1e-6)


@needs_ezc3d
def test_a_c3d_file_of_no_rate_needs_one(tmp_path):
    write_c3d(tmp_path / "take.c3d", rate_hz=1.1e-30)  # ezc3d writes no 0
    data = (tmp_path / "take.c3d").read_bytes()
    (tmp_path / "take.c3d").write_bytes(data.replace(np.float32(1.1e-30).tobytes(), bytes(4)))
    table = read_capture(tmp_path / "take.c3d")
    with pytest.raises(StrandcastError, match="SC-I011.*no rate"):
        times_of(table, capture_mapping_of("hand", ["0.8:string:tip"]))
    assert times_of(table, capture_mapping_of("hand", ["0.8:string:tip"], rate_hz=100.0))[0][1] == 0.01


@needs_ezc3d
def test_all_points_of_a_large_c3d_file_have_their_names(tmp_path):
    import ezc3d

    file = ezc3d.c3d()
    names = [f"marker {k}" for k in range(300)]
    file["parameters"]["POINT"]["RATE"]["value"] = [100.0]
    file["parameters"]["POINT"]["LABELS"]["value"] = names
    file["data"]["points"] = np.ones((4, len(names), 3))
    file.write(str(tmp_path / "take.c3d"))
    assert read_capture(tmp_path / "take.c3d").points() == names


@needs_ezc3d
def test_a_damaged_c3d_file_is_refused(tmp_path):
    (tmp_path / "take.c3d").write_bytes(b"\x02\x50" + bytes(600))
    with pytest.raises(StrandcastError, match="SC-I001"):
        read_capture(tmp_path / "take.c3d")


@needs_ezc3d
@pytest.mark.parametrize(
    ("name", "points", "unit", "up"),
    [
        ("Vicon", 51, "mm", "z"),
        ("Qualisys", 55, "mm", None),
        ("Optotrak", 54, "mm", None),
        ("FP_Type1", 22, "m", "y"),
    ],
)
def test_c3d_files_of_several_makers_are_read(real_data, name, points, unit, up):
    table = read_capture(real_data / f"c3d/{name}.c3d")
    assert (len(table.points()), table.length_unit, table.up) == (points, unit, up)
    assert 0.0 < np.isfinite(table.values).mean() <= 1.0
