"""Films with a frame rate that changes within them: all that moves jumps in speed at once."""

import numpy as np

# Chosen on 18 throws of the lab at 30 to 500 frames/s: none is warned of. With a sharp ramp of eight
# times, ten of them are; with one that sets in over 20 frames, none is.
JUMP, EVEN, ALIKE = 3.0, 1.6, 0.8
LEAST_POINTS = 3
SIGMAS = 2.0  # of a point, that it moves from frame to frame
SLOWEST_HZ = 90.0  # below, a throw changes as much from one frame to the next


def changing_rate_warnings(
    time_s: np.ndarray, places_m: np.ndarray, sigma_m: np.ndarray, flags: np.ndarray
) -> list[str]:
    """Warn of a film in which hand and string (F, n + 1, 2) go on at a multiple of their speed.

    No motion does that in one frame, the same for every point, with an even pace before and after.
    """
    interval_s = np.diff(time_s)
    if len(interval_s) < 4 or np.median(interval_s) * SLOWEST_HZ > 1.0:
        return []
    seen = np.isfinite(places_m).all(axis=2) & (flags == 0)
    moved_m = np.where((seen[1:] & seen[:-1])[..., None], np.diff(places_m, axis=0), np.nan)
    velocity = moved_m / interval_s[:, None, None]
    four = np.stack([velocity[k : len(velocity) - 3 + k] for k in range(4)])  # (4, F - 4, n + 1, 2)
    both = np.asarray(np.isfinite(four).all(axis=(0, 3)))
    four = np.where(both[None, :, :, None], four, 0.0)
    count = np.maximum(both.sum(axis=1), 1)
    speed = np.sqrt((four**2).sum(axis=(2, 3)) / count)
    noise = SIGMAS * np.sqrt(np.nansum(np.where(both, sigma_m[2:-2], np.nan) ** 2, axis=1) / count)
    slowest = np.maximum(speed.min(axis=0), 1e-12)
    steps = np.log(np.maximum(speed[1:], 1e-12) / np.maximum(speed[:-1], 1e-12))
    along = (four[1] * four[2]).sum(axis=(1, 2)) / (count * np.maximum(speed[1] * speed[2], 1e-12))
    jumps = (
        (both.sum(axis=1) >= LEAST_POINTS)
        & (slowest * np.median(interval_s) > noise)
        & (np.abs(steps[1]) > np.log(JUMP))
        & (np.abs(steps[[0, 2]]).max(axis=0) < np.log(EVEN))
        & (along > ALIKE)
    )
    if not jumps.any():
        return []
    at = int(np.flatnonzero(jumps)[0])
    times = float(np.exp(steps[1, at]))
    pace = f"{times:.2g} times as fast" if times > 1.0 else f"{1.0 / times:.2g} times as slow"
    return [
        f"the frame rate seems to change in the film: at frame {at + 2}, hand and string go on {pace} "
        "from one frame to the next, as in an exported speed ramp; times and speeds are then wrong in part: "
        "give the camera's original film, not an export (docs/how-to/film-with-a-phone.md)"
    ]
