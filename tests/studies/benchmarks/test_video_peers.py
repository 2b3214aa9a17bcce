"""The peers of the tracking benchmark: skeletons, point drift, the mask."""

import cv2
import numpy as np
import pytest

from strandcast_studies.benchmarks.video.cpd import NODES, PointDrift
from strandcast_studies.benchmarks.video.peers import even_shares, string_mask
from strandcast_studies.benchmarks.video.skeleton import NoPathError, least_bending_path, longest_path

HAND = np.array([40.0, 150.0])


def mask_of(line: np.ndarray) -> np.ndarray:
    mask = np.zeros((300, 500), np.uint8)
    cv2.polylines(mask, [np.rint(line * 16).astype(np.int32)], False, 1, 3, cv2.LINE_8, 4)
    return mask > 0


def straight() -> np.ndarray:
    return np.column_stack([np.linspace(40, 400, 200), np.linspace(150, 120, 200)])


def looped() -> np.ndarray:
    """Return a trochoid from left to right with one loop, which crosses itself at a right angle."""
    turn = np.linspace(-np.pi, np.pi, 300)
    return np.column_stack([240 + 45 * turn - 90 * np.sin(turn), 170 - 80 * np.cos(turn)])


def length(line: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


@pytest.mark.parametrize("read_off", [longest_path, least_bending_path])
def test_a_plain_string_is_read_off(read_off):
    line = straight()
    points = even_shares(read_off(mask_of(line), HAND), 11)
    assert np.linalg.norm(points - even_shares(line, 11), axis=1).max() < 2.0


def test_the_longest_path_cuts_a_loop_short_and_least_bending_follows_it():
    line = looped()
    mask = mask_of(line)
    short, whole = longest_path(mask, line[0]), least_bending_path(mask, line[0])
    assert length(short) < 0.75 * length(line)
    assert length(whole) == pytest.approx(length(line), rel=0.05)
    off = np.linalg.norm(even_shares(whole, 21) - even_shares(line, 21), axis=1)
    assert off.max() < 6.0


@pytest.mark.parametrize("read_off", [longest_path, least_bending_path])
def test_nothing_is_no_path(read_off):
    with pytest.raises(NoPathError):
        read_off(np.zeros((50, 50), bool), HAND)
    with pytest.raises(NoPathError):
        read_off(mask_of(straight()), np.array([480.0, 290.0]))


def test_the_drift_follows_a_string_that_moves():
    line = straight()
    drift = PointDrift(line, length(line))
    for step in range(1, 16):
        moved = line + np.column_stack([np.zeros(200), 3.0 * step * np.linspace(0, 1, 200) ** 2])
        nodes = drift.step(mask_of(moved), HAND)
    assert np.linalg.norm(nodes - even_shares(moved, NODES), axis=1).max() < 5.0
    links = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    np.testing.assert_allclose(links, length(line) / (NODES - 1), rtol=1e-6)


def test_the_mask_contains_the_string_and_not_the_arm():
    random = np.random.default_rng(0)
    empty = np.full((300, 500), 80.0, np.float32)
    line = mask_of(straight())
    grey = np.clip(np.where(line, 200.0, empty) + random.normal(0, 3, empty.shape), 0, 255).astype(np.uint8)
    arm = np.zeros_like(line)
    arm[:, :100] = True
    mask = string_mask(grey, empty, arm)
    assert not mask[:, :100].any()
    assert (mask & line)[:, 100:].sum() > 0.98 * line[:, 100:].sum()
    assert (mask & ~line).sum() < 20
