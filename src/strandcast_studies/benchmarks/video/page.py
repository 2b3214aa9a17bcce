"""The results page of the tracking benchmark: tables and pictures in Markdown."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from strandcast_studies.benchmarks.simulation.timing import Spread
from strandcast_studies.benchmarks.video.cases import VideoCase
from strandcast_studies.benchmarks.video.score import TARGETS, Score
from strandcast_studies.benchmarks.video.speed import CODECS, Speed


@dataclass(frozen=True)
class FilmedVideo:
    """A filmed case in numbers: contrast-to-noise ratio, blur [px] and tip speed [m/s]."""

    case: VideoCase
    frames: int
    cnr: float
    cnr_low: float
    blur_px: float
    tip_blur_px: float
    tip_speed_m_s: float
    crossing_frames: int


@dataclass(frozen=True)
class PeerScore:
    """A peer's score on one video, and the number of frames on which it failed."""

    peer: str
    score: Score
    failed: int


@dataclass(frozen=True)
class Results:
    """All results of a benchmark run; pictures by video, as paths relative to the page."""

    filmed: list[FilmedVideo]
    scores: list[Score]
    peers: list[PeerScore]
    speeds: list[Speed]
    pictures: dict[str, str]
    machine: dict[str, str]


def page(results: Results) -> str:
    """Return the page."""
    parts = [
        "# Tracking, measured",
        "Meaning of the figures: `docs/explanation/tracking-benchmark.md`. Lengths are in pixels.",
        ", ".join(f"{name} {value}" for name, value in results.machine.items()) + ".",
        "## Targets",
        _targets(results.scores),
        "## Speed",
        _speeds(results.speeds),
        "## Peers on the same frames",
        _peers(results),
        "## Video by video",
        _videos(results.scores),
        "## What was filmed",
        _filmed(results.filmed),
        "## The worst frame of each video",
        "Green: the truth; blue rings: true points that are hidden. "
        "Red: the track; orange: the track where it is flagged as uncertain.",
    ]
    for name, path in results.pictures.items():
        parts.append(f"### {name}\n\n![{name}: truth and track in its worst frame]({path})")
    return "\n\n".join(part for part in parts if part) + "\n"


def table(head: str, rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table; the head is separated by bars, all columns but the first are numbers."""
    rule = ["---", *["---:"] * head.count(" | ")]
    return "\n".join("| " + " | ".join(line) + " |" for line in ([head], rule, *rows))


def _targets(scores: list[Score]) -> str:
    rows = []
    for target in TARGETS:
        values = np.array([target.of(one) for one in scores], float)
        met = sum(target.met(one) for one in scores)
        bounds = f"≤ {target.most:.3g}" if target.least < target.most else f"= {target.most:.3g}"
        bounds = f"{target.least:.3g} to {target.most:.3g}" if np.isfinite(target.least) else bounds
        middle = f"{np.nanmedian(values):.3g}" if np.isfinite(values).any() else "–"
        ends = [f"{end:.3g}" for end in (np.nanmin(values), np.nanmax(values))]
        rows.append([target.name, bounds, f"{met} of {len(scores)}", middle, *ends])
    return table("target, per video | bound | met by | median | least | greatest", rows)


def _speeds(speeds: list[Speed]) -> str:
    least = {codec.name: codec.least_share for codec in CODECS}
    rows = [
        [
            f"{one.codec} ({one.megabits_s:.0f} Mbit/s, {one.frames} frames)",
            _figure(one.bare_cpu_ms),
            _figure(one.markers_cpu_ms),
            _figure(one.tracking_cpu_ms),
            _figure(one.pass_cpu_ms),
            _figure(one.bare_rate, 0),
            _figure(one.pass_rate, 0),
            _figure(one.rate_share),
            f"{least[one.codec]:.1f}",
            _figure(one.share_on_two_cores),
            f"{one.load[0]:.1f}, {one.load[1]:.1f}",
        ]
        for one in speeds
    ]
    head = (
        "file | bare decoder, CPU ms | markers | tracking | whole pass | bare, frames/s | pass, frames/s | "
        "pass over bare | wanted | if the cores were free | load before, after"
    )
    return table(head, rows)


def _figure(one: Spread, digits: int = 2) -> str:
    return f"{one.value:.{digits}f} ({one.least:.{digits}f} to {one.greatest:.{digits}f})"


def _peers(results: Results) -> str:
    """Return one row per tracker: medians over the videos."""
    names = list(dict.fromkeys(one.peer for one in results.peers))
    rows = [_peer_row("strandcast", results.scores, 0)]
    for name in names:
        own = [one for one in results.peers if one.peer == name]
        rows.append(_peer_row(name, [one.score for one in own], sum(one.failed for one in own)))
    head = (
        "tracker | across, median px | overall, mean px | overall, rms px | frames off by 5 px or lost | "
        "frames in wrong order, of those with a crossing | frames failed | frames/s of CPU"
    )
    return table(head, rows) + "\n\nMedians over the videos; counts are sums."


def _peer_row(name: str, scores: list[Score], failed: int) -> list[str]:
    def middle(of: Callable[[Score], float], digits: int) -> str:
        return f"{np.nanmedian([of(one) for one in scores]):.{digits}f}" if scores else "–"

    frames = sum(one.frames for one in scores)
    crossings = sum(one.crossing_frames for one in scores)
    return [
        name,
        middle(lambda s: s.across_median_px, 3),
        middle(lambda s: s.mean_px, 2),
        middle(lambda s: s.rms_px, 2),
        middle(lambda s: 100 * s.far_share, 1) + " %",
        f"{sum(one.wrong_order_frames for one in scores)} of {crossings}",
        f"{failed} of {frames}",
        middle(lambda s: 1e3 / s.cpu_ms_per_frame, 0),
    ]


def _videos(scores: list[Score]) -> str:
    rows = [
        [
            one.name,
            f"{one.across_median_px:.3f}",
            f"{one.along_mean_px:.2f}",
            f"{one.along_rms_px:.2f}",
            f"{one.mean_px:.2f}",
            f"{one.rms_px:.2f}",
            f"{100 * one.far_share:.1f}",
            f"{100 * one.far_flagged_share:.0f}",
            str(one.silent_frames),
            f"{100 * one.unflagged_share:.0f}",
            f"{one.wrong_order_unflagged}/{one.wrong_order_frames}/{one.crossing_frames}",
            f"{one.unflagged.rms:.2f}",
            f"{100 * one.unflagged.within_1:.0f}, {100 * one.unflagged.within_2:.0f}",
            f"{100 * one.flagged.within_1:.0f}, {100 * one.flagged.within_2:.0f}",
        ]
        for one in scores
    ]
    head = (
        "video | across, median | along, mean | along, rms | mean | rms | frames off, % | "
        "of those flagged, % | silent frames | points unflagged, % | wrong order: no flag/all/crossings | "
        "error/σ, rms | unflagged within 1, 2 σ, % | flagged within 1, 2 σ, %"
    )
    return table(head, rows)


def _filmed(filmed: list[FilmedVideo]) -> str:
    rows = [
        [
            one.case.name,
            one.case.speed,
            f"{one.tip_speed_m_s:.1f}",
            one.case.background,
            one.case.contrast,
            f"{one.case.noise_grey:g}",
            f"{1e3 * one.case.exposure_s:g}",
            f"{one.blur_px:.1f}",
            f"{one.tip_blur_px:.1f}",
            f"{one.cnr:.0f} ({one.cnr_low:.0f})",
            str(one.crossing_frames),
            str(one.frames),
        ]
        for one in filmed
    ]
    head = (
        "video | motion | tip's peak, m/s | background | string | noise, grey | exposure, ms | "
        "greatest blur, px | tip's, px | contrast/noise: median (5 %) | frames with crossings | frames"
    )
    return table(head, rows)
