"""Trackers by name: ``track.tracker``."""

from strandcast.config.track import TrackSettings
from strandcast.core.registry import Registry
from strandcast.errors import StrandcastError
from strandcast.tracking.result import Tracked
from strandcast.tracking.track_video import track_video
from strandcast.tracking.tracker import Tracker, TrackerInput

TRACKERS: Registry[Tracker] = Registry(
    "tracker", "strandcast.trackers", "track.tracker", {"chain": Tracker(track_video)}
)


def track(given: TrackerInput, settings: TrackSettings) -> Tracked:
    """Track one video with the tracker that the settings name (SC-W021 if there is none)."""
    tracker = TRACKERS.get(settings.tracker, given.settings_file)
    refuse_unused(tracker, given, settings)
    return tracker.track(given, settings)


def refuse_unused(tracker: Tracker, given: TrackerInput, settings: TrackSettings) -> None:
    """Refuse settings that the tracker does not read but that differ from their defaults (SC-E008)."""
    values = {"camera.exposure_s": given.exposure_s, "align.led": given.led}
    defaults = {name: None for name in values}
    for name, field in TrackSettings.model_fields.items():
        values[f"track.{name}"], defaults[f"track.{name}"] = getattr(settings, name), field.default
    unused = [name for name in tracker.unused_settings if values[name] != defaults[name]]
    if unused:
        raise StrandcastError(
            "SC-E008",
            f"the tracker {settings.tracker!r} does not use {', '.join(unused)}",
            file=given.settings_file,
            field=unused[0],
            fix="remove what it does not use, or choose another track.tracker",
        )
