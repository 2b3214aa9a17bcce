"""Real video files to damage, and the way that a trial's video goes: ingest, then the decoding pass."""

import hashlib
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from strandcast.errors import StrandcastError
from strandcast.records.joint_log import JointLog, LogTiming, Run, write_joint_log
from strandcast.records.manifest import Manifest
from strandcast.stages.run import run_stage
from strandcast.tracking.preconditions import check_count, open_ingested

from .kinds import SilentFault

RATE = 500
SIZE = (160, 120)
EXPERIMENT = "string: {{length_m: 0.3}}\ntarget_m: [0, 0]\ncamera: {camera}\n"


def noisy(count: int, size: tuple[int, int] = SIZE, kind: type = np.uint8) -> list[np.ndarray]:
    """Return pictures that no camera would take twice."""
    rng = np.random.default_rng(4)
    top = np.iinfo(kind).max
    return [rng.integers(0.2 * top, 0.8 * top, size[::-1]).astype(kind) for _ in range(count)]


def write_film(path: Path, *coding: Any, options: dict[str, str] | None = None, **more: Any) -> Path:
    """Write a video, see `_write_film`; one of the usual pictures is encoded once."""
    if len(coding) > 2 or not more.keys().isdisjoint(("pictures", "stamps")):
        return _write_film(path, *coding, options=options, **more)
    path.write_bytes(_usual_film(path.suffix, coding, tuple((options or {}).items()), tuple(more.items())))
    return path


@cache
def _usual_film(suffix: str, coding: Any, options: Any, more: Any) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        return _write_film(
            Path(folder, f"film{suffix}"), *coding, options=dict(options), **dict(more)
        ).read_bytes()


def _write_film(
    path: Path,
    codec: str = "libx264",
    pixels: str = "yuv420p",
    pictures: list[np.ndarray] | None = None,
    stamps: Iterable[int] | None = None,
    rate: int = RATE,
    options: dict[str, str] | None = None,
    faststart: bool = False,
    full_range: bool = False,
    rotation: int = 0,
) -> Path:
    """Write a video; the pictures become its luma or grey plane as they are."""
    pictures = noisy(60) if pictures is None else pictures
    stamps = range(len(pictures)) if stamps is None else stamps
    with av.open(str(path), "w", options={"movflags": "faststart"} if faststart else {}) as container:
        stream = container.add_stream(codec, rate=rate, options=options or {})
        stream.height, stream.width, stream.pix_fmt = *pictures[0].shape, pixels
        stream.codec_context.time_base = Fraction(1, rate)
        if full_range:
            stream.codec_context.color_range = 2
        if rotation:
            stream.set_display_rotation(rotation)
        for stamp, picture in zip(stamps, pictures, strict=True):
            frame = as_frame(picture, pixels, full_range)
            frame.pts, frame.time_base = stamp, Fraction(1, rate)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def as_frame(picture: np.ndarray, pixels: str, full_range: bool) -> av.VideoFrame:
    frame = av.VideoFrame(picture.shape[1], picture.shape[0], pixels)
    if full_range:
        frame.color_range = 2
    for number, plane in enumerate(frame.planes):
        rows = np.zeros(
            (plane.buffer_size // plane.line_size, plane.line_size // picture.itemsize), picture.dtype
        )
        if number == 0:
            rows[: picture.shape[0], : picture.shape[1]] = picture
        else:
            rows[:] = 128
        plane.update(rows)
    return frame


def damage(path: Path, change: Callable[[bytearray], bytearray]) -> Path:
    """Change a file's bytes."""
    path.write_bytes(change(bytearray(path.read_bytes())))
    return path


def cut(share: float) -> Callable[[bytearray], bytearray]:
    return lambda data: data[: int(share * len(data))]


def zeroed(share: float, count: int) -> Callable[[bytearray], bytearray]:
    def change(data: bytearray) -> bytearray:
        start = int(share * len(data))
        data[start : start + count] = bytes(count)
        return data

    return change


def removed(share: float, count: int) -> Callable[[bytearray], bytearray]:
    def change(data: bytearray) -> bytearray:
        start = int(share * len(data))
        del data[start : start + count]
        return data

    return change


def flipped(first: float, last: float, bits: int = 50) -> Callable[[bytearray], bytearray]:
    def change(data: bytearray) -> bytearray:
        rng = np.random.default_rng(0)
        for place in rng.integers(int(first * len(data)), int(last * len(data)), bits):
            data[place] ^= 1 << int(rng.integers(8))
        return data

    return change


@dataclass
class Outcome:
    """The outcome of a trial's video: an error, or a manifest, the frames' times and the printed messages."""

    error: StrandcastError | None = None
    manifest: Manifest | None = None
    warnings: list[str] = field(default_factory=list)
    frames: list[np.ndarray] = field(default_factory=list)

    def refused(self, code: str) -> StrandcastError:
        """Return the error that the video ended in, which must have this code."""
        if self.error is None and not self.warnings:
            raise SilentFault(f"neither an error nor a warning, but {code} is expected")
        assert self.error is not None, self.warnings
        assert self.error.code == code, self.error
        return self.error

    @property
    def printed(self) -> str:
        return self.error.message() if self.error is not None else "\n".join(self.warnings)


@dataclass
class Trial:
    """A trial's folder in an experiment of its own."""

    root: Path

    @property
    def folder(self) -> Path:
        return self.root / "data" / "film" / "trial-01"

    @property
    def video(self) -> Path:
        return next(path for path in sorted(self.folder.iterdir()) if path.stem == "video")

    def settings(self, camera: str) -> None:
        (self.folder.parent / "experiment.yaml").write_text(EXPERIMENT.format(camera=camera))

    def log(self, seconds: float, video: dict | None = None) -> None:
        """Write a joint log whose motion takes so long."""
        time_s = np.linspace(0, seconds, 1 + round(100 * seconds))
        joints = np.zeros((len(time_s), 1))
        log = JointLog(
            ["j"], time_s, joints, joints, joints, joints, time_s, np.zeros(len(time_s), dtype=int)
        )
        Run(
            complete=True,
            status="imported",
            reason=None,
            joints_sha256=write_joint_log(self.folder / "joints.csv", log),
            rows=len(time_s),
            motion_sha256=None,
            arm_sha256=None,
            driver="test",
            controller={},
            joint_names=["j"],
            clock="controller",
            motion_start_s=0.0,
            motion_end_s=seconds,
            sync_events=[],
            timing=LogTiming(nominal_rate_hz=100.0, rate_hz=100.0, gaps=[], duplicates=0),
            video=video or {},
        ).write(self.folder / "run.json")

    def ingest(self) -> Manifest:
        run_stage("ingest", self.root, "film", 1)
        return Manifest.read(self.root / "results" / "film" / "trial-01" / "manifest.json")

    def outcome(self) -> Outcome:
        """Ingest and decode; raw files must stay as they are."""
        before = self._hashes()
        try:
            found = self._go()
        except StrandcastError as error:
            found = Outcome(error)
        assert self._hashes() == before
        return found

    def _go(self) -> Outcome:
        manifest = self.ingest()
        with open_ingested(self.video, manifest.video) as video:
            frames = [grey.copy() for _, _, grey in video]
        check_count(len(frames), manifest.video, self.video)
        return Outcome(None, manifest, manifest.warnings + video.warnings(), frames)

    def _hashes(self) -> dict[str, str]:
        files = (path for path in self.folder.rglob("*") if path.is_file())
        return {str(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.fixture
def trial(tmp_path) -> Trial:
    made = Trial(tmp_path)
    made.folder.mkdir(parents=True)
    made.settings("{}")
    return made
