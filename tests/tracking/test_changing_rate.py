"""A film exported with a speed ramp: every eighth frame of its first and last part, evenly stamped."""

import numpy as np
import pytest

from strandcast.tracking.events.frame_rate import changing_rate_warnings

RATE_HZ, RAMP_S, POINTS = 240.0, 0.3, 12


def swing(taken_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return places, sigma and flags of a string that swings with two of its modes, seen at these times."""
    rng = np.random.default_rng(3)
    along_m = np.linspace(0.0, 0.4, POINTS)
    swing_m = along_m * np.sin(5.0 * taken_s)[:, None]
    swing_m += 0.05 * np.sin(8.0 * along_m) * np.cos(12.0 * taken_s)[:, None]
    places_m = np.stack([swing_m, np.broadcast_to(-along_m, swing_m.shape)], axis=2)
    places_m = places_m + 2e-4 * rng.standard_normal(places_m.shape)
    return places_m, np.full(swing_m.shape, 3e-4), np.zeros(swing_m.shape, dtype=int)


def taken(every: int) -> np.ndarray:
    """Return when the frames of an export were filmed."""
    all_s = np.arange(360) / RATE_HZ
    ends = (all_s < RAMP_S) | (all_s >= all_s[-1] - RAMP_S)
    return all_s[~ends | (np.arange(360) % every == 0)]


@pytest.mark.parametrize("every", [4, 8])
def test_a_speed_ramp_is_warned_of_with_its_frame_and_factor(every):
    taken_s = taken(every)
    [warning] = changing_rate_warnings(np.arange(len(taken_s)) / RATE_HZ, *swing(taken_s))
    at = int(warning.split("at frame ")[1].split(",")[0])
    steps = np.diff(taken_s)
    assert abs(steps[at] / steps[at - 1] - 1.0) > 0.5
    assert "times as slow" in warning


@pytest.mark.parametrize("rate_hz", [30.0, 120.0, 240.0, 1000.0])
def test_one_rate_lost_frames_and_true_uneven_times_are_no_ramp(rate_hz):
    even_s = np.arange(0.0, 1.5, 1.0 / rate_hz)
    for taken_s in (even_s, np.delete(even_s, [10, 11, 12, 30]), taken(8)):
        assert changing_rate_warnings(taken_s, *swing(taken_s)) == []
