"""`export dataset`: an experiment's throws as a LeRobot dataset (v3.0), one episode per trial.

LeRobot's `timestamp` counts frames at a constant rate from the episode's start; the true times on both
clocks, the camera's and the robot's, stand beside it in every row.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from strandcast.api import ExperimentView, TrialView
from strandcast.errors import StrandcastError
from strandcast.exports.throw import ThrowData, read_throw, refuse_filled
from strandcast.records.files import write_text
from strandcast.records.manifest import Manifest, VideoFacts

VIDEO = "observation.images.main"
CHUNK = "chunk-000/file-{:03d}"
TASK = "Hit the target with the tip of the string"
COUNTERS = {
    "timestamp": "float32",
    **dict.fromkeys(("frame_index", "episode_index", "index", "task_index"), "int64"),
}
CLOCKS = ("camera_time_s", "robot_time_s")


def export_dataset(experiment: ExperimentView, folder: Path) -> int:
    """Write all estimated trials of an experiment that are not excluded; return the number of frames.

    Raises
    ------
    StrandcastError
        SC-E005 the folder is not empty; SC-W030 no trial has been estimated; SC-E009 frame rates differ.
    """
    refuse_filled(folder, "a dataset")
    trials = [t for t in experiment.trials.values() if (t.folder.results / "estimate.json").is_file()]
    counted = experiment.context.counted(t.number for t in trials)
    trials = [trial for trial in trials if trial.number in counted]
    throws = [read_throw(trial) for trial in trials]
    if not throws:
        what, fix = "has no estimated trial to export", f"strandcast run {experiment.name}"
        raise StrandcastError("SC-W030", what, file=experiment.context.folder.results, fix=fix)
    rate_hz = common_rate_hz(throws)
    videos = [usable_video(*each, rate_hz) for each in zip(trials, throws, strict=True)]
    filmed = None not in videos
    columns, episodes, start = [], [], 0
    for episode, throw in enumerate(throws):
        table = _rows(throw, rate_hz, episode, start)
        columns.append(table)
        _write(folder / "data" / f"{CHUNK.format(episode)}.parquet", _arrow(table))
        episodes.append(_episode(throw, table, rate_hz, filmed))
        if filmed and throw.video is not None:
            target = folder / "videos" / VIDEO / f"{CHUNK.format(episode)}.mp4"
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(throw.video, target)
        start += len(table["index"])
    _write(folder / "meta" / "episodes" / f"{CHUNK.format(0)}.parquet", pa.Table.from_pylist(episodes))
    import pandas as pd

    tasks = pd.DataFrame({"task_index": [0]}, index=pd.Index([TASK], name="task"))
    tasks.to_parquet(folder / "meta" / "tasks.parquet")
    whole = {name: np.concatenate([table[name] for table in columns]) for name in columns[0]}
    _write_json(folder / "meta" / "stats.json", {name: _stats(values) for name, values in whole.items()})
    video = videos[0] if filmed else None
    features = _features(throws[0]) | ({} if video is None else {VIDEO: _video_feature(video, rate_hz)})
    _write_json(
        folder / "meta" / "info.json", _info(experiment, features, len(throws), start, rate_hz, filmed)
    )
    return start


def common_rate_hz(throws: list[ThrowData]) -> float:
    """Return the frame rate of all throws, which LeRobot stores once; raise SC-E009 if theirs differ."""
    rates_hz = [_rate_hz(throw) for throw in throws]
    for throw, rate_hz in zip(throws, rates_hz, strict=True):
        if not is_same_rate(rate_hz, rates_hz[0]):
            what = f"{throws[0].name} has {rates_hz[0]:.6g} frames/s and {throw.name} {rate_hz:.6g}"
            fix = "exclude the trials of other rates, or export them from an experiment of their own"
            raise StrandcastError("SC-E009", f"a dataset has one frame rate, but {what}", fix=fix)
    whole_hz = round(rates_hz[0])
    return whole_hz if is_same_rate(rates_hz[0], whole_hz) else rates_hz[0]


def usable_video(trial: TrialView, throw: ThrowData, rate_hz: float) -> VideoFacts | None:
    """Return a throw's video if it is an MP4 with time stamps at the rate of filming, None otherwise.

    It is copied as it is, and LeRobot finds pictures by their time stamps: wrong ones in slow motion.
    """
    if throw.video is None or throw.video.suffix.lower() != ".mp4":
        return None
    video = Manifest.read(trial.folder.results / "manifest.json").video
    stamped_hz = video.time_stamp_rate_hz
    return video if stamped_hz is not None and is_same_rate(stamped_hz, rate_hz) else None


def is_same_rate(rate_hz: float, other_hz: float) -> bool:
    """Return whether two rates differ by less than a thousandth."""
    return abs(rate_hz / other_hz - 1.0) < 1e-3


def _rate_hz(throw: ThrowData) -> float:
    """Return the frame rate by the camera's time."""
    return float((throw.frame[-1] - throw.frame[0]) / (throw.camera_time_s[-1] - throw.camera_time_s[0]))


def _rows(throw: ThrowData, rate_hz: float, episode: int, start: int) -> dict[str, np.ndarray]:
    """Return the columns of an episode: a row for each frame from the first tracked one to the last."""
    frames = np.arange(throw.frame[0], throw.frame[-1] + 1)
    camera_s = np.interp(frames, throw.frame, throw.camera_time_s)
    robot_s = np.interp(frames, throw.frame, throw.robot_time_s)
    string = np.full((len(frames), *throw.points_m.shape[1:]), np.nan)
    string[throw.frame - frames[0]] = throw.points_m
    count = np.arange(len(frames))
    return {
        "observation.state": throw.joints_at(robot_s, throw.q_rad).astype(np.float32),
        "action": throw.joints_at(robot_s, throw.q_cmd_rad).astype(np.float32),
        "observation.string": string.reshape(len(frames), -1).astype(np.float32),
        "camera_time_s": camera_s,
        "robot_time_s": robot_s,
        "timestamp": (count / rate_hz).astype(np.float32),
        "frame_index": count,
        "episode_index": np.full(len(frames), episode),
        "index": start + count,
        "task_index": np.zeros(len(frames), np.int64),
    }


def _arrow(table: dict[str, np.ndarray]) -> pa.Table:
    def column(values: np.ndarray) -> pa.Array:
        if values.ndim == 1:
            return pa.array(values)
        return pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), values.shape[1])

    return pa.table({name: column(values) for name, values in table.items()})


def _episode(throw: ThrowData, table: dict[str, np.ndarray], rate_hz: float, filmed: bool) -> dict[str, Any]:
    episode, length = int(table["episode_index"][0]), len(table["index"])
    row = {
        "episode_index": episode,
        "tasks": [TASK],
        "length": length,
        "data/chunk_index": 0,
        "data/file_index": episode,
        "dataset_from_index": int(table["index"][0]),
        "dataset_to_index": int(table["index"][-1]) + 1,
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
    }
    if filmed:
        start_s = float(throw.frame[0] / rate_hz)
        row |= {
            f"videos/{VIDEO}/chunk_index": 0,
            f"videos/{VIDEO}/file_index": episode,
            f"videos/{VIDEO}/from_timestamp": start_s,
            f"videos/{VIDEO}/to_timestamp": start_s + length / rate_hz,
        }
    return row


def _features(throw: ThrowData) -> dict[str, Any]:
    joints = [f"{name}_rad" for name in throw.arm.joints]
    points = [f"{axis}_{point}_m" for point in range(throw.points_m.shape[1]) for axis in "xy"]
    vectors = {"observation.state": joints, "action": joints, "observation.string": points}
    features: dict[str, Any] = {
        name: {"dtype": "float32", "shape": [len(names)], "names": names} for name, names in vectors.items()
    }
    scalars = dict.fromkeys(CLOCKS, "float64") | COUNTERS
    return features | {name: {"dtype": kind, "shape": [1], "names": None} for name, kind in scalars.items()}


def _video_feature(video: VideoFacts, rate_hz: float) -> dict[str, Any]:
    return {
        "dtype": "video",
        "shape": [video.height_px, video.width_px, 3],
        "names": ["height", "width", "channels"],
        "info": {
            "video.height": video.height_px,
            "video.width": video.width_px,
            "video.codec": video.codec,
            "video.pix_fmt": video.pixel_format,
            "video.is_depth_map": False,
            "video.fps": rate_hz,
            "video.channels": 3,
            "has_audio": False,
        },
    }


def _info(
    experiment: ExperimentView,
    features: dict[str, Any],
    episodes: int,
    frames: int,
    rate_hz: float,
    filmed: bool,
) -> dict[str, Any]:
    path = "chunk-{chunk_index:03d}/file-{file_index:03d}"
    return {
        "codebase_version": "v3.0",
        "robot_type": experiment.arm.name,
        "total_episodes": episodes,
        "total_frames": frames,
        "total_tasks": 1,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 500,
        "fps": rate_hz,
        "splits": {"train": f"0:{episodes}"},
        "data_path": f"data/{path}.parquet",
        "video_path": f"videos/{{video_key}}/{path}.mp4" if filmed else None,
        "features": features,
    }


def _stats(values: np.ndarray) -> dict[str, list[float]]:
    """Return the statistics of the rows that are complete, as LeRobot normalises with them."""
    rows = values.reshape(len(values), -1).astype(float)
    rows = rows[np.isfinite(rows).all(axis=1)]
    if not len(rows):
        rows = np.zeros((1, values.reshape(len(values), -1).shape[1]))
    made = {name: getattr(rows, name)(axis=0).tolist() for name in ("min", "max", "mean", "std")}
    return made | {"count": [len(rows)]}


def _write(path: Path, table: pa.Table) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(table, path)


def _write_json(path: Path, content: dict[str, Any]) -> None:
    write_text(path, json.dumps(content, indent=2) + "\n")
