"""The background's median is numpy's, and frames at rest do not outvote those in motion."""

import numpy as np
import pytest

from strandcast.tracking.background import Samples, learn_background, pixel_median


@pytest.mark.parametrize(("dtype", "count"), [(np.uint8, 7), (np.uint8, 10), (np.uint16, 5)])
def test_median_is_numpys_lower_one(dtype, count):
    stack = np.random.default_rng(0).integers(0, np.iinfo(dtype).max + 1, (count, 13, 17)).astype(dtype)
    expected = np.sort(stack, axis=0)[(count - 1) // 2]
    np.testing.assert_array_equal(pixel_median(stack), expected)


def test_a_string_at_rest_most_of_the_time_is_not_background():
    rng = np.random.default_rng(1)
    pictures = []
    for k in range(60):
        picture = np.full((64, 96), 100, np.uint8) + rng.integers(0, 5, (64, 96)).astype(np.uint8)
        column = 32 if k < 45 else 32 + 3 * (k - 44)
        picture[:, column : column + 17] = 200  # broad, so that the thumbnails see it
        pictures.append(picture)
    background, chosen = learn_background(pictures, 15)
    assert (np.median(np.stack(pictures), axis=0)[:, 40] > 190).all()
    assert background.max() < 110
    assert (chosen >= 44).sum() >= 10


def test_samples_are_spread_and_bounded():
    samples = Samples(packets=1000, frame_bytes=3_000_000)
    for index in range(1000):
        samples.offer(index, np.zeros((2, 2), np.uint8))
    assert len(samples.pictures) * 3_000_000 <= 130e6
    assert samples.indices[-1] > 900
