"""All readers of bytes from outside, each with a valid file to damage."""

import hashlib
import io
import json
import os
import random
import shutil
import struct
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, lru_cache, partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from unittest import mock
from unittest.mock import patch

import av
import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import tifffile

from strandcast.arm.load import load_arm
from strandcast.arm.urdf import posed
from strandcast.config.load import load_experiment
from strandcast.errors import StrandcastError
from strandcast.executor.checks import check_motion
from strandcast.imports.capture import CapturedTrial, import_capture
from strandcast.imports.capture_mapping import CaptureMapping
from strandcast.imports.joints import Played, Reading, import_joints
from strandcast.imports.mapping import JointMapping, load_mapping
from strandcast.imports.ros_bags import SUFFIXES
from strandcast.imports.track_checks import check_supplied
from strandcast.records.alignment import Alignment
from strandcast.records.estimate import Estimate
from strandcast.records.files import content_sha256
from strandcast.records.joint_log import read_joint_log, read_run
from strandcast.records.lineage import Lineage
from strandcast.records.load import RECORDS, TABLES, load
from strandcast.records.motion import Motion, Robot, StartPosture, points_of
from strandcast.records.observations import read_observations
from strandcast.records.page import check_page, write_page
from strandcast.records.record import Record, content_of
from strandcast.records.tables import (
    TableSpec,
    arrow_sha256,
    write_arrow,
    write_table,
)
from strandcast.records.track import TrackSummary
from strandcast.report.experiment_page import _thumbnail
from strandcast.report.results import FILES, read_results
from strandcast.report.summary import summarise
from strandcast.source_code import NAME, _known, code_of, save_codes
from strandcast.video.checks import check_recorded
from strandcast.video.ingest import inspect_video
from strandcast.video.photo import decode_photo
from strandcast.video.registry import reader_of
from strandcast.workflow import locks

from ..report.conftest import LENGTH_M, TARGET_M, build_trial
from ..video.test_native import photron
from .conftest import noisy, write_film
from .fuzzing import Reader
from .test_damaged_imports import CAPTURE, HELD, LOG, READING

ROOT = Path(__file__).resolve().parents[2]
ARM = ROOT / "config" / "arms" / "planar3.toml"
ROWS = 24  # of the tables: enough for every branch
EXPERIMENT = "swing"


@cache
def trial() -> Path:
    """Return a folder with all results of a trial, its tables cut to their first rows."""
    folder = Path(tempfile.mkdtemp()) / EXPERIMENT / "trial-01"
    folder.mkdir(parents=True)
    build_trial(folder, EXPERIMENT, 1)
    for path in folder.glob("*.parquet"):
        write_arrow(path, pq.read_table(path).slice(0, ROWS))
    shorten(folder)
    summary = summarise(
        EXPERIMENT, {1: folder}, string_length_m=LENGTH_M, target_m=TARGET_M, hit_radius_m=0.02
    )
    summary.write(folder / "summary.json")
    (folder / "log.csv").write_text(LOG)
    import_joints(folder / "log.csv", folder, READING)
    for name, spec in TABLES.items():
        write_table(folder / f"{name.rpartition('/')[2]}-any.parquet", spec, any_columns(spec))
    shutil.copyfile(folder.parent / "cameras" / "main.json", folder / "main.json")
    return folder


def shorten(folder: Path) -> None:
    """Keep a few points and steps of the long records: damage to one of many alike adds nothing."""
    motion = Motion.read(folder / "motion.json")
    assert motion.predicted is not None
    lists = {name: getattr(motion.predicted, name)[:3] for name in ("time_s", "hand_m", "tip_m")}
    shorter = {"points": motion.points[:4], "predicted": motion.predicted.model_copy(update=lists)}
    motion.model_copy(update=shorter).write(folder / "motion.json")
    estimate = Estimate.read(folder / "estimate.json")
    estimate.model_copy(update={"convergence": estimate.convergence[:3]}).write(folder / "estimate.json")


def any_columns(spec: TableSpec) -> dict[str, Any]:
    """Return a few rows of each of a table's columns."""
    values = {"f8": np.linspace(0.1, 0.5, 6), "i4": np.arange(6), "i8": np.arange(6), "str": ["main"] * 6}
    return {name: values[column.dtype] for name, column in spec.columns.items()}


def copied(*names: str) -> Callable[[Path], Path]:
    """Return a function that copies files of the trial; the first is the one to damage."""

    def write(folder: Path) -> Path:
        for name in names:
            shutil.copyfile(trial() / name, folder / name)
        return folder / names[0]

    return write


def written(name: str, content: str | bytes) -> Callable[[Path], Path]:
    """Return a function that writes a file."""

    def write(folder: Path) -> Path:
        path = folder / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return write


# Records and tables


def record_files() -> dict[str, str]:
    """Return a file of the trial for each kind of record."""
    return {json.loads(path.read_text())["schema"]: path.name for path in sorted(trial().glob("*.json"))}


def loaded(path: Path) -> Any:
    """Return what `strandcast.load` returns, as plain data, without the versions that made the file."""
    found = load(path)
    if isinstance(found, Record):
        return found.content(), found.lineage
    facts = {key: value for key, value in found.attrs.items() if key != "made_by"}
    return found.to_json(), [str(kind) for kind in found.dtypes], facts


ODD_NUMBERS = [0, -1, 1, 3, 0.5, 1e300, -1e300, 5e-324, 2**31 - 1, -(2**31)]
ODD_VALUES = [
    *ODD_NUMBERS,
    2**62,
    None,
    True,
    "",
    "x",
    "../x",
    "1",
    [],
    [[]],
    [0.1],
    [0.1, 0.2, 0.3],
    {},
    {"a": 1},
]


def resealed_record(rng: random.Random, valid: bytes) -> bytes:
    """Return a record with one value changed, and the hash of what it then says."""
    data = json.loads(valid)
    node, keys = data, []
    while isinstance(node, dict | list) and node and (not keys or rng.random() < 0.8):
        keys.append(rng.choice(sorted(node) if isinstance(node, dict) else range(len(node))))
        node = node[keys[-1]]
    parent = data
    for key in keys[:-1]:
        parent = parent[key]
    if rng.random() < 0.2:
        del parent[keys[-1]]
    else:
        parent[keys[-1]] = rng.choice(
            [*ODD_VALUES, [node, node], [node] * 3, str(node)[:50], data.get("version")]
        )
    if keys[0] not in ("content_sha256", "lineage"):
        data["content_sha256"] = content_sha256(content_of(data))
    return json.dumps(data).encode()


@lru_cache(maxsize=1)
def parsed(valid: bytes) -> pa.Table:
    """Return a table from the bytes of its file."""
    return pq.read_table(io.BytesIO(valid))


def resealed_table(rng: random.Random, valid: bytes) -> bytes:
    """Return a table with one column or its metadata changed; its hash fits, or it has none."""
    table = parsed(valid)
    metadata = dict(table.schema.metadata)
    name = rng.choice(table.column_names)
    at = table.column_names.index(name)
    values = table.column(name).to_pylist()
    numeric = isinstance(values[0], int | float)

    def put(column: Any, kind: Any = None) -> pa.Table:
        return table.set_column(at, name, pa.array(column, type=kind))

    def odd_value() -> pa.Table:
        column = list(values)
        odd = [*ODD_NUMBERS, None, float("nan"), float("inf")]
        for _ in range(rng.choice((1, 1, 3, len(column)))):
            value = rng.choice(odd) if numeric else rng.choice([None, "", "x", "\0", "measured", "é"])
            column[rng.randrange(len(column))] = value
        try:
            return put(column, table.schema.field(name).type)
        except (pa.ArrowInvalid, pa.ArrowTypeError, OverflowError):
            return put([float(v) if v is not None else None for v in column])

    changes: list[Callable[[], pa.Table]] = [
        odd_value,
        odd_value,
        odd_value,
        lambda: table.drop_columns([name]),
        lambda: table.rename_columns([rng.choice(["", "x", "z_m", column]) for column in table.column_names]),
        lambda: table.append_column(rng.choice([name, "z_m", "var_xx_m2", "x"]), table.column(name)),
        lambda: table.slice(0, rng.choice((0, 1, 2))),
        lambda: pa.concat_tables([table, table]),
        lambda: table.take(pa.array(rng.sample(range(len(values)), len(values)))),
        lambda: put([str(value) for value in values]),
        lambda: (
            put(pa.array(values).cast(rng.choice([pa.float32(), pa.int64(), pa.float64()]), safe=False))
            if numeric
            else put(pa.array(values).dictionary_encode())
        ),
        lambda: put([[value] for value in values]),
        lambda: put([None] * len(values), table.schema.field(name).type),
        lambda: table.replace_schema_metadata(
            metadata
            | {
                rng.choice([b"facts", b"made_by", b"lineage", b"version", b"schema"]): rng.choice(
                    [
                        b"",
                        b"{}",
                        b"[]",
                        b"null",
                        b"3",
                        b'"x"',
                        b"\xff",
                        b"[" * 3000,
                        b'{"cameras": {"main": {}}}',
                        b"1e999",
                    ]
                )
            }
        ),
    ]
    table = rng.choice(changes)()
    metadata = dict(table.schema.metadata or metadata)
    metadata.pop(b"content_sha256", None)
    if rng.random() < 0.5:
        try:
            metadata[b"content_sha256"] = arrow_sha256(table).encode()
        except (ValueError, TypeError, KeyError, RecursionError):  # of two columns of one name, for example
            metadata[b"content_sha256"] = b"0" * 64
    out = io.BytesIO()
    pq.write_table(table.replace_schema_metadata(metadata), out, compression="zstd", write_page_checksum=True)
    return out.getvalue()


def on_page(name: str) -> Callable[[Path], Any]:
    """Return a function that reads a result as the pages do."""

    def read(path: Path) -> Any:
        results = read_results(path.parent)
        return repr(results.need(name))

    return read


def supplied(path: Path) -> Any:
    """Read a track that was measured elsewhere."""
    alignment, summary = (kind.read(path.with_name(name)) for kind, name in SUPPLIED)
    return check_supplied(path.with_name("track.parquet"), path.with_name("hand.parquet"), alignment, summary)


SUPPLIED = [(Alignment, "alignment.json"), (TrackSummary, "track.json")]


def sealed_readers() -> list[Reader]:
    """Return the readers of records and tables, of damaged ones and of those that only look right."""
    readers = []
    for schema, name in record_files().items():
        kind = schema.rpartition("/")[2]
        readers.append(Reader(kind, copied(name), loaded, sealed=True, text=True))
        readers.append(
            Reader(f"{kind}, other content", copied(name), RECORDS[schema].read, change=resealed_record)
        )
    old = (ROOT / "tests" / "records" / "estimate-v1.json").read_bytes()
    readers.append(
        Reader("estimate, version 1", written("estimate.json", old), Estimate.read, change=resealed_record)
    )
    for schema in TABLES:
        kind = schema.rpartition("/")[2]
        readers.append(Reader(kind, copied(f"{kind}-any.parquet"), loaded, sealed=True))
    beside = {
        "hand": [],
        "track": ["track.json"],
        "simulated": [],
        "predicted": [],
        "ensemble": [],
        "lab_truth": [],
    }
    for name, others in beside.items():
        read = on_page(name)
        readers.append(
            Reader(f"{name}, on a page", copied(FILES[name], *others), read, change=resealed_table)
        )
    readers.append(
        Reader(
            "observations, other content",
            observed,
            lambda path: repr(read_observations(path)),
            change=resealed_table,
        )
    )
    names = ["alignment.json", "track.json"]
    for name, other in (("track", "hand"), ("hand", "track")):
        write = copied(f"{name}.parquet", f"{other}.parquet", *names)
        readers.append(Reader(f"{name}, supplied", write, supplied, change=resealed_table))
    for name, other in (("alignment", "track"), ("track", "alignment")):
        write = copied(f"{name}.json", f"{other}.json", "track.parquet", "hand.parquet")
        readers.append(Reader(f"{name}.json, supplied", write, supplied, change=resealed_record))
    return readers


def observed(folder: Path) -> Path:
    """Write a table of observations: one frame of a string of three points, and one marker."""
    spec = TABLES["strandcast/observations"]
    columns = any_columns(spec) | {"frame": np.zeros(6, int), "camera_time_s": np.zeros(6)}
    columns |= {"marker": np.array([-1, -1, 0, 0, 0, 0]), "point": np.array([0, 1, 0, 1, 2, 3])}
    shape = {"size_m": 0.05, "offset_m": 0.0}
    write_table(
        folder / "observations.parquet",
        spec,
        columns,
        {"cameras": {"main": {"points": 2, "markers": {"0": shape}}}},
    )
    return folder / "observations.parquet"


# Logs, captures, motions


def joint_log(path: Path) -> Any:
    run, log = read_run(path.parent)
    return run.content(), log.q_rad.tobytes(), log.time_s.tobytes(), log.flags.tobytes()


def imported(reading: Reading, path: Path) -> Any:
    """Import a joint log, and read what the import wrote."""
    (path.parent / "run.json").unlink(missing_ok=True)
    import_joints(path, path.parent, reading)
    return joint_log(path.with_name("run.json"))


def captured(path: Path) -> Any:
    out = path.parent / "out"
    shutil.rmtree(out, ignore_errors=True)
    return import_capture(path, out, HELD, CapturedTrial("e", 1, 0.4, 4)).content()


def mapped(kind: type[JointMapping] | type[CaptureMapping], path: Path) -> Any:
    return load_mapping(path, kind).model_dump_json()


def played(path: Path) -> Any:
    """Read a motion, and a log that is said to be of it."""
    motion, arm = Motion.read(path), load_arm(ARM).planar()
    return import_joints(
        path.with_name("log.csv"), path.parent, Reading(), played=Played(motion, arm)
    ).content()


def checked(path: Path) -> Any:
    """Check a motion as the player does before anything is sent."""
    motion = Motion.read(path)
    return repr(check_motion(path, motion, load_arm(ARM).planar()))


def maker_logs() -> dict[str, str]:
    """Return a joint log of each maker: three joints that rise, and their commands."""
    rows = LOG.splitlines()[1:]
    six = [f"{row},{row.split(',', 1)[1]}" for row in rows]
    outputs = "actual_digital_output_bits"
    franka = ["time", *(f"q[{k}]" for k in range(2)), *(f"q_d[{k}]" for k in range(2))]
    ur = ["timestamp", *(f"actual_q_{k}" for k in range(2)), *(f"target_q_{k}" for k in range(2)), outputs]
    return {
        "auto": "\n".join([",".join(franka), *rows, ""]),
        "libfranka": "\n".join([",".join(franka), *rows, ""]),
        "ur_rtde": "\n".join([",".join(ur), *(f"{row},{8 * (k > 9)}" for k, row in enumerate(rows)), ""]),
        "ur": "\n".join([*(f"{row},{','.join(['0.1'] * 4)}" for row in six), ""]),
    }


def motion_file(folder: Path) -> Path:
    """Write a short motion of the arm's three joints that a robot could play."""
    arm = load_arm(ARM).planar()
    time_s = np.linspace(0.0, 0.4, 21)
    share = time_s / time_s[-1]
    q = np.array([1.2, 0.3, 0.2]) + 0.02 * (10 * share**3 - 15 * share**4 + 6 * share**5)[:, None]
    qd = np.gradient(q, time_s, axis=0)
    qdd = np.gradient(qd, time_s, axis=0)
    qd[[0, -1]] = qdd[[0, -1]] = 0.0
    motion = Motion(
        experiment=EXPERIMENT,
        trial=1,
        target_m=[0.5, 0.5],
        robot=Robot(name=arm.name, file_sha256=arm.sha256, urdf_sha256=arm.urdf_sha256),
        joint_names=list(arm.joints),
        start=StartPosture(positions_rad=q[0].tolist(), tolerance_rad=[0.01] * 3),
        bezier=None,
        points=points_of(np.round(time_s * 1e9).astype(int), q, qd, qdd),
        predicted=None,
        provenance=None,
    )
    motion.write(folder / "motion.json")
    rows = (
        ",".join(map(str, [1 + t, *angles, *angles])) for t, angles in zip(time_s, q.tolist(), strict=True)
    )
    (folder / "log.csv").write_text("\n".join([PLAYED_LOG, *rows, ""]))
    return folder / "motion.json"


PLAYED_LOG = "time,q[0],q[1],q[2],q_d[0],q_d[1],q_d[2]"


JOINT_MAPPING = 'time: t\nq: [a, b]\nq_cmd: [ca, cb]\nrate_hz: 100\noutputs: "7"\ntime_unit: ms\n'
CAPTURE_MAPPING = """\
time: t
time_unit: s
hand_x: x
hand_y: y
hand_angle: w
markers:
  - {place_m: 0.2, x: mx, y: my}
"""


def import_readers() -> list[Reader]:
    """Return the readers of joint logs, captures, mappings and motions."""
    readers: list[Reader] = [
        Reader(
            "joints.csv, with run.json", copied("joints.csv", "run.json"), joint_log, sealed=True, text=True
        ),
        Reader(
            "run.json, with joints.csv", copied("run.json", "joints.csv"), joint_log, sealed=True, text=True
        ),
        Reader(
            "joints.csv alone",
            copied("joints.csv"),
            lambda path: read_joint_log(path).q_rad.tobytes(),
            text=True,
        ),
        Reader("log, named columns", written("log.csv", LOG), partial(imported, READING), text=True),
        Reader("capture", written("capture.csv", CAPTURE), captured, text=True),
        Reader("motion, of a log", motion_file, played, change=resealed_record),
        Reader("motion, to be played", motion_file, checked, change=resealed_record),
    ]
    for name, log in maker_logs().items():
        reading = Reading(dialect=name, sync_output=3 if name == "ur_rtde" else None)
        readers.append(Reader(f"log, {name}", written("log.csv", log), partial(imported, reading), text=True))
    for suffix, text in (
        ("yaml", JOINT_MAPPING),
        ("toml", 'time = "t"\nq = ["a", "b"]\nq_cmd = ["ca", "cb"]\nrate_hz = 100\n'),
    ):
        read = partial(mapped, JointMapping)
        readers.append(Reader(f"joint mapping, {suffix}", written(f"m.{suffix}", text), read, text=True))
    read = partial(mapped, CaptureMapping)
    return [*readers, Reader("capture mapping", written("m.yaml", CAPTURE_MAPPING), read, text=True)]


# Settings and arms

SETTINGS = """\
string: {length_m: 0.3, weights: [{place_m: 0.3}], points: 10}
arm: planar3
target_m: [0.5, 0.5]
hit_radius_m: 0.02
workspace_m: {x_m: [-0.75, 1.25], y_m: [-0.32, 0.80]}
excluded: [{trial: 2, reason: "the string slipped"}]
objective: {kind: swing, height_m: 0.8}
camera:
  plane_photo: plane.png
  plane: {dictionary: DICT_4X4_50, size_m: 0.08, markers: [{id: 0, x_m: -0.65, y_m: 0.7}]}
plan: {evaluations: 800}
"""


def arm_file(damaged: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        for name in ("planar3.toml", "planar3.urdf"):
            shutil.copyfile(ARM.with_name(name), folder / name)
        return folder / damaged

    return write


def arm(path: Path) -> Any:
    found = load_arm(path.with_suffix(".toml")).planar()
    return (
        found.joints,
        found.limits.lower_rad.tolist(),
        posed(found.model(), found.held).qpos.tolist(),
    )


# Videos, photos


@contextmanager
def enough_memory(path: Path) -> Iterator[None]:
    """Raise the error that the decoding process reports where a damaged size needs absurdly much memory."""
    try:
        yield
    except MemoryError:
        raise StrandcastError("SC-V005", "needs too much memory", file=path) from None


def decoded(path: Path) -> Any:
    """Inspect and decode a video in this process: in its own, an error of ours would look like a crash."""
    with enough_memory(path):
        return _decoded(path)


def _decoded(path: Path) -> Any:
    has_clock = path.suffix in (".cine", ".cih", ".cihx")
    reader = reader_of(path)
    with patch("strandcast.video.ingest.probe_isolated", reader.probe):
        facts = inspect_video(path, frame_rate_hz=None if has_clock else 500.0)
    digest = hashlib.sha256()
    with reader.open_source(path, 1, None) as source:
        for time_s, raw in source.raws:
            grey = source.to_grey(raw, None)
            digest.update(f"{time_s} {grey.shape}".encode() + grey.tobytes())
    return facts.time_stamps, digest.hexdigest()


def film(name: str, *coding: Any, **more: Any) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        path = write_film(folder / name, *coding, pictures=noisy(5, (64, 48)), **more)
        return path

    return write


def phone_film(folder: Path) -> Path:
    """Write a film as phones do, with the rate of filming among its metadata."""
    plain = write_film(folder / "plain.mp4", pictures=noisy(5, (64, 48)))
    path = folder / "video.mp4"
    with (
        av.open(str(plain)) as source,
        av.open(str(path), "w", options={"movflags": "use_metadata_tags"}) as out,
    ):
        stream = out.add_stream_from_template(source.streams.video[0])
        out.metadata["com.android.capture.fps"] = "500.0"
        for packet in source.demux(source.streams.video[0]):
            if packet.dts is not None:
                packet.stream = stream
                out.mux(packet)
    plain.unlink()
    return path


CINE_SETUP_BYTES = 0x163C
CINE_TIMES_AT = 84 + CINE_SETUP_BYTES


def cine_file(folder: Path) -> Path:
    """Write three frames as a Phantom camera does: headers, the block of time stamps, the table of images."""
    width, height, count, setup, length = 32, 24, 3, 84, CINE_SETUP_BYTES
    times = struct.pack("<IHH", 8 + 8 * count, 1002, 0) + b"".join(
        struct.pack("<II", k << 20, 9) for k in range(count)
    )
    table = setup + length + len(times)
    images = [
        struct.pack("<II", 8, width * height) + bytes([40 * k]) * (width * height)
        for k in range(1, count + 1)
    ]
    places = [table + 8 * count + sum(map(len, images[:k])) for k in range(count)]
    head = b"CI" + struct.pack("<HHHiIiIIII", 44, 0, 1, 0, count, 0, count, 44, setup, table) + bytes(8)
    bitmap = struct.pack("<IiiHHIIiiII", 40, width, height, 1, 8, 0, width * height, 0, 0, 0, 0)
    body = bytearray(length)
    body[140:144] = b"ST" + struct.pack("<H", length)
    struct.pack_into("<I", body, 768, 500)
    path = folder / "video.cine"
    path.write_bytes(
        head + bitmap + bytes(body) + times + struct.pack(f"<{count}Q", *places) + b"".join(images)
    )
    return path


def photron_pair(suffix: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        frames = np.random.default_rng(0).integers(0, 4096, (3, 24, 32)).astype(np.uint16)
        path = photron(folder, frames, 12)
        if suffix == "cih":
            return path
        path.unlink()
        path = path.with_suffix(".cihx")
        path.write_text(CIHX)
        return path

    return write


CIHX = """\
<cih><imageDataInfo><resolution><width>32</width><height>24</height></resolution>
<colorInfo><bit>12</bit><type>Mono</type></colorInfo><effectiveBit><depth>12</depth><side>Lower</side></effectiveBit>
</imageDataInfo><frameInfo><totalFrame>3</totalFrame></frameInfo><recordInfo><recordRate>2000</recordRate></recordInfo></cih>
"""


def tiff_pages(folder: Path) -> Path:
    path = folder / "video.tif"
    tifffile.imwrite(path, np.stack(noisy(3, (32, 24))), photometric="minisblack", compression="zlib")
    return path


def numbered_picture(suffix: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        (folder / "video").mkdir()
        for number, picture in enumerate(noisy(3, (32, 24))):
            path = folder / "video" / f"f{number}.{suffix}"
            cv2.imwrite(str(path), picture, [cv2.IMWRITE_TIFF_COMPRESSION, 1] if suffix == "tif" else [])
        return folder / "video" / f"f1.{suffix}"

    return write


def photo(suffix: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        path = folder / f"plane.{suffix}"
        cv2.imwrite(str(path), np.random.default_rng(1).integers(0, 255, (24, 32, 3)).astype(np.uint8))
        return path

    return write


def photographed(path: Path) -> Any:
    with enough_memory(path):
        picture = decode_photo(str(path), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH)
    if picture is None:
        raise StrandcastError("SC-C031", "is not a picture", file=path)  # as the calibration says
    return picture.shape, picture.tobytes()


def thumbnail(path: Path) -> Any:
    """Read the picture of a throw as the experiment's page does."""
    return _thumbnail(path.read_bytes())


def picture_readers() -> list[Reader]:
    """Return the readers of videos and photos."""
    films = {
        "h264 in mp4": film("video.mp4"),
        "mp4 of a phone": phone_film,
        "mjpeg in avi": film("video.avi", "mjpeg", "yuvj420p", full_range=True),
        "raw avi": film("video.avi", "rawvideo", "gray"),
        "ffv1 in mkv": film("video.mkv", "ffv1", "gray", options={"slicecrc": "1", "level": "3"}),
        "vp9 in webm": film("video.webm", "libvpx-vp9", options={"lag-in-frames": "0", "cpu-used": "8"}),
        "mov, turned": film("video.mov", rotation=90),
        "cine": cine_file,
        "photron cihx": photron_pair("cihx"),
        "tiff pages": tiff_pages,
    }
    readers = [Reader(f"video, {name}", write, decoded, memory_mb=1500) for name, write in films.items()]
    readers.append(Reader("video, photron cih", photron_pair("cih"), decoded, text=True))
    for suffix in ("png", "tif"):
        read = lambda path: decoded(path.parent)  # noqa: E731
        readers.append(Reader(f"video, folder of {suffix}", numbered_picture(suffix), read, memory_mb=1500))
    for suffix in ("png", "jpg", "tif", "webp", "bmp"):
        # OpenCV believes the size of a damaged chunk, up to 2 GB; the decoding process has less.
        readers.append(Reader(f"photo, {suffix}", photo(suffix), photographed, memory_mb=2500))
    return [*readers, Reader("picture of a page", photo("webp"), thumbnail, memory_mb=1500)]


# Pages, leases, hashes beside videos, the cache


def page(folder: Path) -> Path:
    path = folder / "results" / "swing" / "report.html"
    write_page(path, "<!DOCTYPE html>\n<title>swing</title>\n<p>The tip hit.</p>\n")
    return path


def seen_page(path: Path) -> Any:
    lineage: Lineage | None = check_page(path)
    return lineage, path.read_bytes().rpartition(b"\n<!-- ")[0]


def recorded(path: Path) -> Any:
    """Check a video against the hash beside it; returns whether the hash was found and right."""
    from strandcast.records.manifest import Manifest

    return check_recorded(path.with_suffix(""), Manifest.read(path.with_name("manifest.json")).video, None)


def hash_file(folder: Path) -> Path:
    copied("manifest.json")(folder)
    return written("video.mp4.sha256", f"{'1' * 64}  video.mp4\n")(folder)


def owned(folder: Path) -> Path:
    path = folder / "results" / EXPERIMENT / ".lease-owner.json"
    path.parent.mkdir(parents=True)
    owner = locks.Owner(1234, "host", "2026-01-01T00:00:00+00:00", "strandcast run")
    path.write_text(json.dumps(owner._asdict()))
    return path


def lease(folder: Path) -> Path:
    """Write the lease of a process that has ended."""
    take = f"held = take(pathlib.Path({str(folder)!r}), {EXPERIMENT!r})"
    program = f"import os, pathlib; from strandcast.workflow.locks import take; {take}; os._exit(0)"
    subprocess.run([sys.executable, "-c", program], check=True)
    path = locks._lease_file(folder, EXPERIMENT)
    locks._owner_file(path).unlink()
    return path


def held(path: Path) -> Any:
    # Most cases only wait for an owner's name: both waits are fifty times shorter here.
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("filelock._soft.MALFORMED_LOCK_AGE_THRESHOLD", 0.04)
        patch.setattr(locks, "UNNAMED_S", 0.06)
        return locks.refuse_if_held(path.parents[2], EXPERIMENT)


def cached_code(path: Path) -> Any:
    with mock.patch.dict(os.environ, {"XDG_CACHE_HOME": str(path.parents[1])}):
        _known.cache_clear()
        return code_of(path.with_name("code.py"))


def cache_file(folder: Path) -> Path:
    (folder / "strandcast").mkdir()
    code = written("code.py", "from math import pi\n\nTURN = 2 * pi\n")(folder / "strandcast")
    with mock.patch.dict(os.environ, {"XDG_CACHE_HOME": str(folder)}):
        _known.cache_clear()
        code_of(code)
        save_codes()
    return code.with_name(NAME)


def other_readers() -> list[Reader]:
    """Return the readers of settings, arms, pages, leases and caches."""
    settings = lambda path: load_experiment(path).model_dump_json()  # noqa: E731
    return [
        Reader("experiment", written("experiment.yaml", SETTINGS), settings, text=True),
        Reader("arm", arm_file("planar3.toml"), arm, text=True),
        Reader("URDF", arm_file("planar3.urdf"), arm, text=True),
        Reader("page", page, seen_page, sealed=True, text=True),
        Reader("hash beside a video", hash_file, recorded, text=True),
        Reader(
            "owner of a lease", owned, lambda path: locks.owner_of(path.parents[2], EXPERIMENT), text=True
        ),
        Reader("lease", lease, held, text=True),
        Reader("cache of source code", cache_file, cached_code, text=True),
    ]


def bag_readers() -> list[Reader]:
    """Return the readers of ROS bags; none where rosbags is not installed."""
    if find_spec("rosbags") is None:
        return []
    from ..executor.drivers.test_rosbag import ARM as NAMES
    from ..executor.drivers.test_rosbag import KINDS, joint_states, write_bag

    def bag(kind: str, folder: Path) -> Path:
        path: Path = write_bag(folder, kind, joint_states(count=20))
        return next(file for file in path.iterdir() if file.suffix in SUFFIXES) if path.is_dir() else path

    def read(path: Path) -> Any:
        out = path.parent / "out"
        shutil.rmtree(out, ignore_errors=True)
        import_joints(path, out, namings=[NAMES])
        log = joint_log(out / "run.json")
        return log[1:]

    return [Reader(f"bag, {kind}", partial(bag, kind), read) for kind in KINDS]


@cache
def readers() -> dict[str, Reader]:
    """Return all readers by name."""
    every = [*sealed_readers(), *import_readers(), *other_readers(), *picture_readers(), *bag_readers()]
    return {reader.name: reader for reader in every}
