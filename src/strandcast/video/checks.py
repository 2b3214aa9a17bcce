"""A video held against what else is known of it: its hash when recorded, the throw, itself a moment later."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.records.joint_log import Run
from strandcast.records.manifest import LogFacts, VideoFacts
from strandcast.video.files import files_of, video_sha256

QUIET_S = 1.0  # a file must not have changed for so long before it is read
LEAST_COVER = 0.5  # of the motion must be in the video
SLOW_MOTION = 3.0  # times as long as the joint log: then the video is no recording in real time


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
        # Half a file has all kinds of faults: that it is half is the one to tell.
        _refuse_change(path, before)
        raise
    _refuse_change(path, before)


def _state(path: str | Path) -> list[tuple[str, int, int]]:
    files = [file for file in files_of(path) if file.is_file()]
    return [(file.name, file.stat().st_size, file.stat().st_mtime_ns) for file in files]


def _refuse_change(path: str | Path, before: list[tuple[str, int, int]]) -> None:
    after = _state(path)
    if after != before:
        sizes = [sum(size for _, size, _ in state) for state in (before, after)]
        raise StrandcastError(
            "SC-V022", f"is still being written: it went from {sizes[0]} to {sizes[1]} bytes", file=path,
            fix="wait until the camera has copied all of it, then run again")  # fmt: skip


def check_recorded(path: str | Path, facts: VideoFacts, run: Run | None) -> None:
    """Refuse a video that is not the one that was recorded (SC-V021).

    Its hash then stands in run.json (``video: {"sha256": ...}``), or beside it as ``sha256sum`` writes it.
    """
    path = Path(path)
    beside = path.with_name(path.name + ".sha256")
    told = {"run.json": str(run.video.get("sha256") or "") if run is not None else ""}
    if beside.is_file():
        told[beside.name] = beside.read_text(encoding="utf-8", errors="replace")
    for where, text in told.items():
        found = re.match(r"\s*\\?([0-9a-fA-F]{64})\b", text)
        if found and found[1].lower() != facts.sha256:
            raise _another(path, f"is not the file that was recorded: {where} has another SHA-256", "SC-V021")
        if text and not found:
            raise StrandcastError(
                "SC-V021", f"{where} holds no SHA-256 of it", file=path.with_name(where), field="sha256",
                exit_code=INTEGRITY, fix=f"write what `sha256sum {path.name}` prints there")  # fmt: skip


def check_same(path: str | Path, facts: VideoFacts) -> None:
    """Refuse a video that is not the one that its manifest speaks of, bit by bit (SC-V021)."""
    if video_sha256(path)[0] != facts.sha256:
        raise _another(
            path, "is not the file that manifest.json speaks of: its SHA-256 is another", "SC-V021"
        )


def _another(path: str | Path, what: str, code: str) -> StrandcastError:
    return StrandcastError(
        code, what, file=path, field="sha256", exit_code=INTEGRITY,
        cost="damaged pictures, or another throw's, would be tracked",
        fix="copy the file again from the camera")  # fmt: skip


def check_cover(path: str | Path, facts: VideoFacts, run: Run | None) -> None:
    """Refuse a video too short to be one of the throw (SC-V019): a wrong rate, or frames left out."""
    if run is None or run.motion_start_s is None or run.motion_end_s is None:
        return
    motion_s = run.motion_end_s - run.motion_start_s
    if _filmed_s(facts) < LEAST_COVER * motion_s:
        raise StrandcastError(
            "SC-V019",
            f"its {facts.packets} frames at {facts.frame_rate_hz:.6g} frames/s last {_filmed_s(facts):.3g} "
            f"s, but the motion took {motion_s:.3g} s: a conversion left frames out, or the rate is wrong",
            file=path, field="camera.frame_rate_hz", exit_code=INTEGRITY,
            cost="the string would seem to move at another speed than it did",
            fix="give the camera's own file; camera.frame_rate_hz is the rate of filming")  # fmt: skip


def warnings_of(facts: VideoFacts, log: LogFacts | None) -> list[str]:
    """Return what is to be told of a video that is taken all the same."""
    found = [f"{facts.file}: {note}" for note in facts.notes]
    if facts.gaps:
        worst = max(gap.duration_s for gap in facts.gaps)
        missing = sum(gap.missing for gap in facts.gaps)
        found.append(f"{facts.file}: {missing} frames missing in {len(facts.gaps)} gaps, up to {worst:.4f} s")
    if facts.duplicates:
        found.append(f"{facts.file}: {facts.duplicates} frames with the time stamp of the one before")
    return found if log is None else found + _against_log(facts, log)


def _against_log(facts: VideoFacts, log: LogFacts) -> list[str]:
    logged_s = log.end_s - log.start_s
    if logged_s <= 0 or _filmed_s(facts) < SLOW_MOTION * logged_s:
        return []
    fitting_hz = float(f"{facts.packets / logged_s:.2g}")
    return [
        f"{facts.file} lasts {_filmed_s(facts):.1f} s at its {facts.frame_rate_hz:.6g} frames/s, the joint "
        f"log {logged_s:.1f} s: if it is a slow-motion export (some {fitting_hz:g} frames/s would fit), "
        "give camera.frame_rate_hz in experiment.yaml"
    ]


def _filmed_s(facts: VideoFacts) -> float:
    return facts.time_stamps[-1] * facts.time_base_s + 1.0 / facts.frame_rate_hz
