"""Words made from records: the verdict, the methods paragraph, warnings, provenance."""

from __future__ import annotations

from typing import NamedTuple

from strandcast.records.files import sha256_file
from strandcast.records.manifest import LogFacts
from strandcast.records.summary import Verdict
from strandcast.report.facts import Facts
from strandcast.report.numbers import UNKNOWN, significant
from strandcast.report.reportlet import Table
from strandcast.report.results import FILES, Results

CITATION = (
    "K. Tabata, H. Seki, T. Tsuji and T. Hiramitsu, “Casting Manipulation With Unknown String via Motion "
    "Generation, Actual Manipulation, and Parameter Estimation”, IEEE Access"
)


class Chip(NamedTuple):
    """A state as word, shape and style of colour."""

    word: str
    shape: str
    style: str


def verdict_chip(verdict: Verdict | None, excluded: str | None) -> Chip:
    """Return how a trial went, so that colour alone never tells it."""
    if excluded is not None:
        return Chip("EXCLUDED", "◌", "excluded")
    if verdict is None:
        return Chip("NO VERDICT", "✕", "failed")
    if verdict.miss_m is None:
        return Chip("NOT SEEN", "◇", "unseen")
    return Chip("HIT", "●", "hit") if verdict.hit else Chip("MISS", "▲", "miss")


def warnings_of(results: Results) -> list[tuple[str, str]]:
    """Return all records' warnings: the file that holds them, and what they say."""
    said = []
    for name in ("manifest", "track_summary", "alignment", "estimate"):
        record = results.get(name)
        said += [(FILES[name], text) for text in (record.warnings if record is not None else [])]
    motion = results.get("motion")
    if motion is not None and motion.provenance is not None:
        said += [(FILES["motion"], f"planner's flag: {flag}") for flag in motion.provenance.flags]
    return said


def methods(results: Results) -> str:
    """Return a paragraph for a paper; a stage without results is left out."""
    said = [_recording(results), _camera(results), _tracking(results), _clocks(results), _fit(results)]
    said.append(
        f"The loop is that of {CITATION}, as implemented by strandcast; search and planner are named above "
        "(“paper” is the paper's own procedure, every other name strandcast's); eq. 4 is read with x_r − x_s "
        "and y_r − y_s, and every E is unweighted (w = 0) where not said otherwise. Values of w, β, χ₀, "
        "counts, time step and hit tolerance are not given in the paper."
    )
    return " ".join(sentence for sentence in said if sentence)


def _recording(results: Results) -> str:
    manifest = results.get("manifest")
    if manifest is None:
        return ""
    video = manifest.video
    return (
        f"The throw was recorded at {video.frame_rate_hz:g} frames/s and {video.width_px} × "
        f"{video.height_px} px ({video.codec})" + _joint_rate(manifest.joint_log)
    )


def _joint_rate(log: LogFacts | None) -> str:
    return "." if log is None else f", the joints at {log.rate_hz:g} Hz."


def _camera(results: Results) -> str:
    camera = results.get("camera")
    if camera is None:
        return ""
    return (
        f"Lens and plane of motion were calibrated ({camera.source}) to {camera.lens.rms_px:.2f} px and "
        f"{camera.plane_rms_px:.2f} px rms; one pixel is {camera.scale_m_per_px * 1e3:.2f} mm."
    )


def _tracking(results: Results) -> str:
    summary = results.get("track_summary")
    if summary is None:
        return ""
    return (
        f"The string of {summary.length_m * 1e3:.0f} mm was represented by {summary.points} mass points; "
        f"{summary.tracked_fraction * 100:.1f} % of them were seen without a flag (median σ "
        f"{summary.median_sigma_m * 1e3:.2f} mm)."
    )


def _clocks(results: Results) -> str:
    alignment = results.get("alignment")
    if alignment is None or alignment.offset_se_s is None:
        return ""
    error_ms = alignment.offset_se_s * 1e3
    return f"Camera and robot clocks were aligned by the hand's path to ± {error_ms:.2f} ms (standard error)."


def _fit(results: Results) -> str:
    estimate = results.get("estimate")
    if estimate is None:
        return ""
    change = estimate.step_change_m
    halved = "" if change is None else f" (halved, the string moves by {significant(1e3 * change)} mm)"
    return (
        "String parameters and relative masses were estimated from trials "
        f"{', '.join(map(str, estimate.trials_used))} by {estimate.search} ({estimate.evaluations} "
        f"simulations, ranges “{estimate.ranges}”, reading “{estimate.reading}”, integrator "
        f"{estimate.integrator} with {estimate.dt_s * 1e3:g} ms steps{halved}, "
        f"start shape {estimate.start_shape}, evaluation in the {estimate.evaluation} frame, "
        f"w = {estimate.w:g}, seed {estimate.seed}); E = {significant(estimate.E_m * 1e3)} mm."
    )


def provenance(results: Results, facts: Facts) -> list[Table]:
    """Return the tables of hashes, seeds, software and settings."""
    files = [
        [name, sha256_file(results.folder / name)]
        for name in FILES.values()
        if (results.folder / name).is_file()
    ]
    tables = [
        Table(["file of results", "sha256"], files),
        Table(["raw data and seeds", "value"], _origins(results)),
    ]
    if facts.software:
        tables.append(Table(["software", "version"], [list(pair) for pair in sorted(facts.software.items())]))
    if facts.settings:
        tables.append(Table(["setting", "value"], [list(pair) for pair in facts.flat_settings()]))
    return tables


def _origins(results: Results) -> list[list[str]]:
    rows = []
    manifest, estimate, motion = (results.get(name) for name in ("manifest", "estimate", "motion"))
    if manifest is not None:
        rows += [
            [f"video {manifest.video.file}, sha256", manifest.video.sha256],
        ]
        log = manifest.joint_log
        rows += [[f"joint log {log.file}, sha256", log.sha256]] if log is not None else []
        rows.append(["motion as played, content sha256", manifest.motion_sha256 or UNKNOWN])
    if motion is not None:
        rows.append(["motion as planned, content sha256", motion.content_sha256()])
        if motion.provenance is not None:
            rows.append(["seed of the plan", str(motion.provenance.seed)])
            rows += [
                [f"planned from {name}", sha] for name, sha in sorted(motion.provenance.planned_from.items())
            ]
    if estimate is not None:
        rows.append(["seed of the estimate", str(estimate.seed)])
        rows += [[f"estimated from {name}", sha] for name, sha in sorted(estimate.planned_from.items())]
    return rows
