"""Rows 18 to 21 of the fault list: pictures turned, deep, of another size, or of another range of levels."""

import numpy as np
import pytest

from strandcast.camera.flat import flat_camera
from strandcast.errors import StrandcastError
from strandcast.tracking.preconditions import check_size
from strandcast.video.reader import open_video

from .conftest import SIZE, Trial, noisy, write_film


def test_row18_a_rotation_tag_is_reported_and_not_applied(trial: Trial):
    write_film(trial.folder / "video.mp4", rotation=90)
    found = trial.outcome()
    assert "requests a rotation by" in found.printed
    assert "90 degrees, which is not applied" in found.printed
    assert found.frames[0].shape == SIZE[::-1]


@pytest.mark.parametrize("size", [SIZE[::-1], (320, 240)])
def test_rows18_and_20_pictures_of_another_size_than_the_calibrations_are_refused(trial: Trial, size):
    path = write_film(trial.folder / "video.mp4")
    facts = trial.ingest().video
    check_size(facts, flat_camera(*SIZE, 1e-3, (0, 0)), path)
    with pytest.raises(StrandcastError) as caught:
        check_size(facts, flat_camera(*size, 1e-3, (0, 0)), path)
    assert caught.value.code == "SC-C012"
    assert "160 x 120 px, but the calibration is for" in caught.value.what
    assert "calibration" in (caught.value.fix or "")


@pytest.mark.parametrize(("pixels", "bits"), [("gray10le", 10), ("gray12le", 12), ("gray16le", 16)])
def test_row19_deep_pixels_are_kept(trial: Trial, pixels, bits):
    pictures = [picture >> (16 - bits) for picture in noisy(5, kind=np.uint16)]
    write_film(trial.folder / "video.mkv", "ffv1", pixels, pictures, options={"strict": "experimental"})
    found = trial.outcome()
    assert found.error is None
    for grey, true in zip(found.frames, pictures, strict=True):
        assert grey.dtype == np.uint16
        np.testing.assert_array_equal(grey, true)
    with open_video(trial.video) as video:
        assert video.info.max_level == (1 << bits) - 1


def test_row21_levels_are_the_same_whatever_the_range(trial: Trial):
    """A ramp of levels, as limited luma, full luma and grey: one full-range picture."""
    ramp = np.repeat(np.arange(256, dtype=np.uint8)[None], 64, axis=0)
    limited = np.rint(16 + ramp * 219.0 / 255.0).astype(np.uint8)
    pictures = []
    for name, pixels, picture, full in (
        ("a.mkv", "gray", ramp, False),
        ("b.mkv", "yuv420p", ramp, True),
        ("c.mkv", "yuv420p", limited, False),
    ):
        path = write_film(trial.root / name, "ffv1", pixels, [picture] * 2, full_range=full)
        with open_video(path) as video:
            pictures.append(next(iter(video))[2].copy())
    np.testing.assert_array_equal(pictures[0], ramp)
    np.testing.assert_array_equal(pictures[1], ramp)
    assert np.abs(pictures[2].astype(int) - ramp).max() <= 1


def test_row21_a_range_that_the_levels_do_not_keep_to_is_reported(trial: Trial):
    rng = np.random.default_rng(0)
    dark = [rng.integers(0, 60, SIZE[::-1]).astype(np.uint8) for _ in range(10)]
    write_film(trial.folder / "video.mkv", "ffv1", "yuv420p", dark)
    assert (
        "are beyond the limited range that its header states (16 to 235): they are clipped"
        in trial.outcome().printed
    )
