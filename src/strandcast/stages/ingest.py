"""Raw video, joint log and played motion to manifest.json: hashes, counts, time stamps, gaps."""

from __future__ import annotations

from pathlib import Path

from strandcast.errors import INTEGRITY, StrandcastError
from strandcast.records.joint_log import read_run
from strandcast.records.manifest import LogFacts, Manifest, VideoFacts
from strandcast.records.motion import Motion
from strandcast.stages.context import context_of
from strandcast.video.ingest import inspect_video


def run(root: Path, name: str, trial: int) -> None:
    """Write results/<experiment>/trial-NN/manifest.json; the raw files stay as they are."""
    context = context_of(root, name)
    folder = context.folder.trial(trial)
    video = inspect_video(folder.video(), context.settings.camera.frame_rate_hz)
    log = _log_facts(folder.data) if (folder.data / "run.json").is_file() else None
    played = None if folder.played_motion is None else Motion.read(folder.played_motion)
    motion = None if played is None else played.content_sha256()
    if log is not None and motion is not None:
        _check_played(folder.data, motion)
    Manifest(
        experiment=name,
        trial=trial,
        video=video,
        joint_log=log,
        motion_sha256=motion,
        warnings=_warnings(video, log) + _foreign(played, name, trial),
    ).write(folder.results / "manifest.json")


def _log_facts(folder: Path) -> LogFacts:
    run_record, log = read_run(folder)
    return LogFacts(
        file="joints.csv",
        sha256=run_record.joints_sha256,
        rows=run_record.rows,
        start_s=float(log.time_s[0]),
        end_s=float(log.time_s[-1]),
        rate_hz=run_record.timing.rate_hz,
        gaps=run_record.timing.gaps,
        duplicates=run_record.timing.duplicates,
    )


def _check_played(data: Path, played: str) -> None:
    """Hold the motion beside the raw files against what run.json says was played."""
    said = read_run(data)[0].motion_sha256
    if said is not None and said != played:
        raise StrandcastError(
            "SC-X020",
            "is not the motion that run.json says was played",
            file=data / "motion.json",
            cost="the fit would be made for another motion",
            fix="copy the folder again from the machine that played the motion",
            exit_code=INTEGRITY,
        )


def _foreign(played: Motion | None, name: str, trial: int) -> list[str]:
    """Tell of a motion that was planned for another throw: a repeated one, or a folder in the wrong place."""
    if played is None or (played.experiment, played.trial) == (name, trial):
        return []
    return [f"motion.json was planned for {played.experiment} trial {played.trial}"]


def _warnings(video: VideoFacts, log: LogFacts | None) -> list[str]:
    found = []
    if video.gaps:
        worst = max(gap.duration_s for gap in video.gaps)
        missing = sum(gap.missing for gap in video.gaps)
        found.append(f"{video.file}: {missing} frames missing in {len(video.gaps)} gaps, up to {worst:.4f} s")
    if video.duplicates:
        found.append(f"{video.file}: {video.duplicates} frames with the time stamp of the one before")
    return found if log is None else found + _log_warnings(video, log)


def _log_warnings(video: VideoFacts, log: LogFacts) -> list[str]:
    found = []
    if log.gaps:
        worst = max(gap.duration_s for gap in log.gaps)
        found.append(f"{log.file}: {len(log.gaps)} gaps, up to {worst:.4f} s")
    if log.duplicates:
        found.append(f"{log.file}: {log.duplicates} rows with the time of the one before")
    filmed_s = video.packets / video.frame_rate_hz
    logged_s = log.end_s - log.start_s
    if filmed_s > 3.0 * logged_s:
        found.append(
            f"{video.file} lasts {filmed_s:.1f} s and the joint log {logged_s:.1f} s: "
            "if it is a slow-motion export, give camera.frame_rate_hz in experiment.yaml"
        )
    return found
