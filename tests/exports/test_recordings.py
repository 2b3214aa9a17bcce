"""csv, dataset, mcap and rerun: each opened by its own reader, and the same throw in all of them."""

import json
import sys
from dataclasses import replace
from importlib.util import find_spec
from itertools import islice

import av
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

import strandcast
from strandcast.errors import StrandcastError
from strandcast.exports.csv import export_csv
from strandcast.exports.dataset import common_rate_hz, export_dataset, usable_video
from strandcast.exports.mcap import export_mcap
from strandcast.exports.rerun import export_rerun
from strandcast.exports.throw import ThrowData, read_throw

OPTIONAL = "is not installed: make test-drivers"


@pytest.fixture
def throw(trial) -> ThrowData:
    return read_throw(trial)


def test_the_fitted_string_is_in_the_frames_of_the_track(trial, throw) -> None:
    flight = throw.robot_time_s <= trial.verdict.closest_robot_time_s
    points_m, fitted_m = throw.points_m[flight], throw.fitted_m[flight]
    apart_m = np.linalg.norm(points_m - fitted_m, axis=2)[-10:, 1:]
    shifted_m = np.linalg.norm(points_m[1:] - fitted_m[:-1], axis=2)[-10:, 1:]
    assert np.nanmedian(apart_m) < 3 * trial.estimate.record.E_m < np.nanmedian(shifted_m)


def test_csv_holds_the_tables_and_both_clocks(trial, tmp_path) -> None:
    files = export_csv(trial, tmp_path / "out")
    assert {path.stem for path in files} == {"track", "observations", "hand", "joints", "simulated"}
    track = pd.read_csv(tmp_path / "out" / "track.csv")
    pd.testing.assert_frame_equal(
        track.drop(columns="robot_time_s"), trial.track, check_exact=True, check_dtype=False
    )
    assert (track["robot_time_s"] == trial.alignment.robot_time_s(track["camera_time_s"])).all()
    joints = pd.read_csv(tmp_path / "out" / "joints.csv", index_col="seq")
    assert (joints["q_joint_2_rad"] == trial.joints["q_joint_2_rad"]).all()


def test_csv_of_a_trial_that_does_not_exist_is_refused(project, tmp_path) -> None:
    with pytest.raises(StrandcastError, match="SC-W030"):
        export_csv(strandcast.open(project)["small"].trial(9), tmp_path / "out")


def test_dataset_is_one_of_lerobot_with_both_clocks(project, throw, tmp_path) -> None:
    frames = export_dataset(strandcast.open(project)["small"], tmp_path / "set")
    info = json.loads((tmp_path / "set" / "meta" / "info.json").read_text())
    episode = pq.read_table(
        tmp_path / "set" / "meta" / "episodes" / "chunk-000" / "file-000.parquet"
    ).to_pylist()[0]
    assert info["codebase_version"] == "v3.0"
    assert info["total_frames"] == frames == episode["length"]
    path = info["data_path"].format(
        chunk_index=episode["data/chunk_index"], file_index=episode["data/file_index"]
    )
    rows = pq.read_table(tmp_path / "set" / path)
    kinds = {"float32": "float", "float64": "double", "int64": "int64"}
    for name, feature in info["features"].items():
        if feature["dtype"] != "video":
            width = 1 if feature["shape"] == [1] else len(rows[name][0])
            assert [width] == feature["shape"]
            assert kinds[feature["dtype"]] in str(rows.schema.field(name).type)
    data = rows.to_pandas()
    assert np.diff(data["timestamp"]) == pytest.approx(1 / info["fps"], rel=1e-3)
    tracked = data["frame_index"].to_numpy()[throw.frame - throw.frame[0]]
    assert (data["camera_time_s"].to_numpy()[tracked] == throw.camera_time_s).all()
    assert (data["robot_time_s"].to_numpy()[tracked] == throw.robot_time_s).all()
    string = np.stack(data["observation.string"]).reshape(frames, -1, 2)
    assert np.nanmax(np.abs(string[tracked] - throw.points_m)) < 1e-6
    at = np.stack(data["observation.state"])[:, 1]
    assert np.abs(at - np.interp(data["robot_time_s"], throw.joint_time_s, throw.q_rad[:, 1])).max() < 1e-6
    assert pd.read_parquet(tmp_path / "set" / "meta" / "tasks.parquet")["task_index"].tolist() == [0]
    video = "videos/observation.images.main"
    with av.open(str(tmp_path / "set" / video / "chunk-000" / "file-000.mp4")) as film:
        pictures = sum(1 for _ in film.decode(video=0))
    assert episode[f"{video}/to_timestamp"] <= pictures / info["fps"] + 1e-9
    with pytest.raises(StrandcastError, match="SC-E005"):
        export_dataset(strandcast.open(project)["small"], tmp_path / "set")


def test_throws_of_a_dataset_share_one_rate_which_is_that_of_its_videos(trial, throw, tmp_path) -> None:
    rate_hz = common_rate_hz([throw, throw])
    with pytest.raises(StrandcastError, match="SC-E009"):
        common_rate_hz([throw, replace(throw, camera_time_s=throw.camera_time_s / 2)])
    assert common_rate_hz([throw, replace(throw, camera_time_s=throw.camera_time_s * 1.0006)]) == rate_hz
    assert usable_video(trial, replace(throw, video=tmp_path / "GX01.MP4"), rate_hz) is not None
    assert usable_video(trial, throw, 8 * rate_hz) is None  # slow motion


def test_rerun_reads_the_dataset(project, tmp_path) -> None:
    pytest.importorskip("rerun", reason=f"rerun {OPTIONAL}")
    from rerun.experimental import LeRobotReader

    export_dataset(strandcast.open(project)["small"], tmp_path / "set")
    reader = LeRobotReader(tmp_path / "set")
    assert (reader.version, reader.episodes()) == ("v3", [0])
    assert len(list(reader.stream(0).to_chunks())) > 5


def test_lerobot_reads_rows_and_pictures_of_the_dataset(project, throw, tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    reader = pytest.importorskip("lerobot.datasets.lerobot_dataset", reason="lerobot (8 GB) is not installed")
    frames = export_dataset(strandcast.open(project)["small"], tmp_path / "set")
    dataset = reader.LeRobotDataset("lab/small", root=tmp_path / "set", video_backend="pyav")
    assert (len(dataset), dataset.num_episodes) == (frames, 1)
    tracked = int(throw.frame[-1] - throw.frame[0])
    row = dataset[tracked]
    assert row["observation.string"].numpy() == pytest.approx(
        throw.points_m[-1].ravel(), abs=1e-6, nan_ok=True
    )
    assert float(row["camera_time_s"]) == pytest.approx(throw.camera_time_s[-1], abs=1e-6)
    video = tmp_path / "set/videos/observation.images.main/chunk-000/file-000.mp4"
    with av.open(str(video)) as film:
        picture = next(islice(film.decode(video=0), tracked, None)).to_ndarray(format="rgb24")
    shown = row["observation.images.main"].numpy().transpose(1, 2, 0)
    assert np.abs(255.0 * shown - picture).max() <= 1.0


def test_mcap_holds_ros_messages_in_order(throw, tmp_path) -> None:
    reader = pytest.importorskip("mcap.reader", reason=f"mcap {OPTIONAL}")
    count = export_mcap(throw, tmp_path / "throw.mcap")
    with (tmp_path / "throw.mcap").open("rb") as file:
        messages = list(reader.make_reader(file).iter_messages())
    assert len(messages) == count
    stamps = [message.log_time for _, _, message in messages]
    assert stamps == sorted(stamps)
    found = {channel.topic: (schema.name, message) for schema, channel, message in messages}
    assert set(found) == {"/joint_states", "/joint_commands", "/string/measured", "/string/fitted"}
    if find_spec("rosbags"):
        from rosbags.typesys import Stores, get_typestore

        types = get_typestore(Stores.ROS2_HUMBLE)
        states, path = (
            types.deserialize_cdr(found[t][1].data, found[t][0]) for t in ("/joint_states", "/string/fitted")
        )
        assert states.name == list(throw.arm.joints)
        assert states.position.tolist() == throw.q_rad[-1].tolist()
        last = np.flatnonzero(np.isfinite(throw.fitted_m).all(axis=(1, 2)))[-1]
        tip = path.poses[-1].pose.position
        assert [tip.x, tip.y, tip.z] == throw.in_space(throw.fitted_m[last, -1]).tolist()


def test_mcap_takes_a_camera_that_starts_before_the_robots_clock(throw, tmp_path) -> None:
    reader = pytest.importorskip("mcap.reader", reason=f"mcap {OPTIONAL}")
    early = replace(throw, joint_time_s=throw.joint_time_s - 90.0, robot_time_s=throw.robot_time_s - 90.0)
    assert early.robot_time_s[0] < 0.0
    export_mcap(early, tmp_path / "throw.mcap")
    with (tmp_path / "throw.mcap").open("rb") as file:
        first = next(reader.make_reader(file).iter_messages())[2]
    assert first.log_time == first.publish_time == 0
    assert int.from_bytes(first.data[4:8], "little", signed=True) < 0  # the message's own stamp stays


def test_rerun_holds_arm_strings_video_and_curves_on_one_clock(throw, tmp_path) -> None:
    pytest.importorskip("rerun", reason=f"rerun {OPTIONAL}")
    from rerun.chunk import RrdReader

    export_rerun(throw, tmp_path / "throw.rrd")
    timelines: dict[str, set[str]] = {}
    for chunk in RrdReader(tmp_path / "throw.rrd").stream().to_chunks():
        timelines.setdefault(chunk.entity_path, set()).update(chunk.timeline_names)
    wanted = {
        "arm",
        "string/measured",
        "string/fitted",
        "joints/measured",
        "joints/commanded",
        "apart_mm/tip",
    }
    assert {f"/{name}" for name in wanted | {"video", "target"}} <= set(timelines)
    for name in wanted:
        assert "robot_time" in timelines[f"/{name}"]


@pytest.mark.parametrize(("package", "export"), [("mcap", export_mcap), ("rerun", export_rerun)])
def test_a_missing_package_is_named_with_its_extra(throw, tmp_path, monkeypatch, package, export) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.setitem(sys.modules, f"{package}.writer", None)
    with pytest.raises(StrandcastError, match="SC-W012") as refused:
        export(throw, tmp_path / "out")
    assert f"strandcast[{package}]" in str(refused.value)
    assert not (tmp_path / "out").exists()
