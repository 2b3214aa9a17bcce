"""Checks of a video: unchanged while it is read, the recorded hash, the duration of the joint log."""

import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PureWindowsPath

from strandcast.errors import StrandcastError
from strandcast.records.folders import files_of_video
from strandcast.records.joint_log import Run
from strandcast.records.known_hashes import content_sha256_of
from strandcast.records.manifest import LogFacts, VideoFacts
from strandcast.video.files import damaged, video_sha256
from strandcast.video.ingest import RATE_TOLERANCE

QUIET_S = 1.0  # chosen: time without changes before a file is read
MIN_COVER = 0.5  # chosen: share of the motion that the video must cover
LONGEST_HASH_BYTES = 4096  # of a line of `sha256sum`: the hash, then a name
HASH_LINE = re.compile(r"^\s*\\?([0-9a-fA-F]{64})\b[ *]*(.*?)\s*$", re.MULTILINE)
CAMERA_CLOCKS = ("cine", "mraw")  # containers whose times are those of filming
LEAST_RATE_HZ = 240.0  # below, a fast tip moves by decimetres between frames (the README asks for 240)
SLOW_MOTION = 3.0  # chosen: duration relative to the joint log above which slow motion is suspected


@contextmanager
def unchanged(path: str | Path) -> Iterator[None]:
    """Refuse a video that is still being written (SC-V022), before and after the block."""
    before = _state(path)
    if not before:
        yield
        return
    age_s = time.time() - max(changed for _, _, changed in before) / 1e9
    if 0 <= age_s < QUIET_S:
        time.sleep(QUIET_S - age_s)
    try:
        yield
    except StrandcastError:
        # An incomplete file causes all kinds of errors; report that it is incomplete.
        _refuse_change(path, before)
        raise
    _refuse_change(path, before)


def _state(path: str | Path) -> list[tuple[str, int, int]]:
    files = [file for file in files_of_video(Path(path)) if file.is_file()]
    return [(file.name, file.stat().st_size, file.stat().st_mtime_ns) for file in files]


def _refuse_change(path: str | Path, before: list[tuple[str, int, int]]) -> None:
    after = _state(path)
    if after != before:
        sizes = [sum(size for _, size, _ in state) for state in (before, after)]
        what = f"is still being written: it went from {sizes[0]} to {sizes[1]} bytes"
        raise StrandcastError("SC-V022", what, file=path)


def check_recorded(path: str | Path, facts: VideoFacts, run: Run | None) -> None:
    """Refuse a video that is not the recorded one (SC-V005).

    The recorded hash is in run.json (``video: {"sha256": ...}``), or in a ``sha256sum`` file beside the video
    or beside one of its files, which may list them all.
    """
    path = Path(path)
    files = {file.name: file for file in files_of_video(path)}
    hashes = {"run.json": str(run.video.get("sha256") or "") if run is not None else ""}
    for name in [path.name] if path.is_dir() else [path.name, *files]:
        beside = path.with_name(f"{name}.sha256")
        if beside.is_file():
            with beside.open("rb") as file:
                hashes[beside.name] = file.read(LONGEST_HASH_BYTES * len(files)).decode(errors="replace")
    for where, text in hashes.items():
        lines = [(digest.lower(), PureWindowsPath(name).name) for digest, name in HASH_LINE.findall(text)]
        if text and not lines:
            fix = f"write the output of `sha256sum {path.name}` to it"
            what = f"{where} contains no SHA-256 of it"
            raise damaged("SC-V005", what, path.with_name(where), field="sha256", fix=fix)
        bare = [(digest, where.removesuffix(".sha256")) for digest, _ in lines[:1]]
        for digest, name in [line for line in lines if line[1] in files] or bare:
            is_part = len(files) > 1 and name in files
            if digest != facts.sha256 and not (is_part and digest == content_sha256_of(files[name])):
                raise _different(path, f"is not the recorded file: {where} has another SHA-256")


def check_same(path: str | Path, facts: VideoFacts) -> None:
    """Refuse a video whose hash is not the manifest's (SC-V005)."""
    if video_sha256(path)[0] != facts.sha256:
        raise _different(path, "is not the file listed in manifest.json: its SHA-256 differs")


def _different(path: str | Path, what: str) -> StrandcastError:
    cost = "damaged frames, or those of another throw, would be tracked"
    return damaged("SC-V005", what, path, field="sha256", cost=cost)


def check_cover(path: str | Path, facts: VideoFacts, run: Run | None) -> None:
    """Refuse a video too short to show the throw (SC-V017): a wrong rate, or dropped frames."""
    if run is None or run.motion_start_s is None or run.motion_end_s is None:
        return
    motion_s = run.motion_end_s - run.motion_start_s
    filmed_s = _filmed_s(facts)
    if filmed_s < MIN_COVER * motion_s:
        raise damaged(
            "SC-V017",
            f"its {facts.packets} frames at {facts.frame_rate_hz:.6g} frames/s last {filmed_s:.3g} s, but "
            f"the motion took {motion_s:.3g} s: a conversion dropped frames, or the rate is wrong",
            path,
            field="camera.frame_rate_hz",
            cost="the string's speed would be wrong",
            fix="use the camera's original file; camera.frame_rate_hz is the rate of filming",
        )


def file_warnings(facts: VideoFacts) -> list[str]:
    """Return what is noted of a video file, and its missing and doubled frames."""
    found = [f"{facts.file}: {note}" for note in facts.notes]
    if facts.gaps:
        worst = max(gap.duration_s for gap in facts.gaps)
        missing = sum(gap.missing for gap in facts.gaps)
        found.append(f"{facts.file}: {missing} frames missing in {len(facts.gaps)} gaps, up to {worst:.4f} s")
    if facts.duplicates:
        found.append(f"{facts.file}: {facts.duplicates} frames with the previous frame's time stamp")
    return found


def warnings_of(facts: VideoFacts, log: LogFacts | None) -> list[str]:
    """Return warnings about a video that is accepted."""
    of_rate = (_against_log(facts, log) if log is not None else []) or slow_rate_warning(facts)
    return file_warnings(facts) + of_rate


def slow_rate_warning(facts: VideoFacts) -> list[str]:
    """Return a warning about a low frame rate that a file's header gives: slow motion, or too slow."""
    rate_hz = facts.frame_rate_hz
    if facts.frame_rate_source == "experiment" or rate_hz >= (1.0 - RATE_TOLERANCE) * LEAST_RATE_HZ:
        return []
    needs = f"a throw needs {LEAST_RATE_HZ:g} or more"
    if facts.container in CAMERA_CLOCKS:
        return [f"{facts.file} was filmed at {rate_hz:.6g} frames/s; {needs}"]
    return [
        f"{facts.file} states {rate_hz:.6g} frames/s; {needs}. If it was filmed faster and plays in slow "
        "motion, give the rate of filming in camera.frame_rate_hz, otherwise all speeds are wrong"
    ]


def _against_log(facts: VideoFacts, log: LogFacts) -> list[str]:
    logged_s = log.end_s - log.start_s
    if facts.frame_rate_source == "experiment" or facts.container in CAMERA_CLOCKS:
        return []
    if logged_s <= 0 or _filmed_s(facts) < SLOW_MOTION * logged_s:
        return []
    return [
        f"{facts.file} lasts {_filmed_s(facts):.1f} s at its {facts.frame_rate_hz:.6g} frames/s, the joint "
        f"log {logged_s:.1f} s: if it is a slow-motion export, give the rate of filming in "
        "camera.frame_rate_hz"
    ]


def _filmed_s(facts: VideoFacts) -> float:
    return facts.time_stamps[-1] * facts.time_base_s + 1.0 / facts.frame_rate_hz
