"""Motion capture brought into a trial's folder: track, hand and alignment are supplied."""

from __future__ import annotations

from pathlib import Path

from strandcast.arm.load import load_arm
from strandcast.imports.capture import import_capture
from strandcast.imports.mapping import CaptureMapping
from strandcast.records.track import TrackSummary
from strandcast.stages.context import context_of, free_length_m, refuse_replacing


def run(
    root: Path, name: str, trial: int, capture: Path, mapping: CaptureMapping, replace: bool = False
) -> TrackSummary:
    """Import a capture; `supply` takes it into the results."""
    context = context_of(root, name)
    string = context.settings.string
    refuse_replacing(context.folder.trial(trial).data / "track.json", replace)
    return import_capture(
        capture,
        context.folder.trial(trial).data,
        mapping,
        experiment=name,
        trial=trial,
        length_m=free_length_m(context, load_arm(context.arm_file).clamp.swallowed_m),
        points=string.n,
    )
