"""The tracking benchmark's films agree with their truth, and the benchmark runs end to end."""

import json
from collections import Counter
from dataclasses import replace

import cv2
import numpy as np
import pytest

from strandcast.arm.load import load_arm
from strandcast.errors import StrandcastError
from strandcast.video.reader import open_video
from strandcast_studies.benchmarks.video import cases as video_cases
from strandcast_studies.benchmarks.video import run as video
from strandcast_studies.benchmarks.video import scenes as video_scenes
from strandcast_studies.benchmarks.video.cases import LEAST_CNR, TIP_SPEEDS_M_S, TONES_BY_CONTRAST
from strandcast_studies.benchmarks.video.motion import LARGEST_BEND_RAD, sharpest_bend
from strandcast_studies.benchmarks.video.scenes import (
    ARM_FILE,
    check_contrast,
    describe,
    film_case,
    read_case,
    shoot,
)
from strandcast_studies.benchmarks.video.speed import CODECS, decode_bare, encode
from strandcast_studies.benchmarks.video.truth import Truth


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    return tmp_path_factory.mktemp("video-bench")


@pytest.fixture(scope="module")
def folder(work):
    return film_case(video_cases.quick()[0], load_arm(ARM_FILE).planar(), work)


@pytest.fixture(scope="module")
def frames(folder):
    with open_video(folder / "video.mp4") as video:
        return [grey.copy() for _, _, grey in video]


def test_the_design_is_balanced_and_separate_from_tuning():
    cases = video_cases.held_out()
    assert min(Counter(case.string for case in cases).values()) >= 4
    assert len(Counter(case.string for case in cases)) == 7
    for factor, least in (("speed", 8), ("background", 10), ("noise_grey", 14), ("exposure_s", 14)):
        assert min(Counter(getattr(case, factor) for case in cases).values()) >= least
    seeds = {case.seed for case in cases}
    assert len(seeds) == len(cases)
    assert min(seeds) >= 9000
    assert not seeds & {case.seed for case in video_cases.tuning()}


@pytest.mark.thorough
def test_the_video_shows_the_string_where_the_truth_says(folder, frames):
    truth = Truth.read(folder)
    places = np.arange(0.03, float(truth.arrays.length_m) - 0.03, 0.01)
    visible = truth.visible(places)
    offsets = []
    for frame in range(0, len(frames), 10):
        line = truth.pixels(truth.at(places)[frame])
        along = truth.pixels((truth.at(places) + 1e-4 * truth.directions(places))[frame]) - line
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        across = np.arange(-4.0, 4.01, 0.25)
        uv = (line[:, None] + across[:, None] * np.column_stack([-along[:, 1], along[:, 0]])[:, None]).astype(
            np.float32
        )
        profile = cv2.remap(frames[frame], uv[..., 0], uv[..., 1], cv2.INTER_LINEAR).astype(float)
        bright = np.clip(profile - profile.max(axis=1, keepdims=True) / 2, 0, None)
        offsets.append(((bright * across).sum(axis=1) / bright.sum(axis=1))[visible[frame]])
    offset = np.concatenate(offsets)
    assert len(offset) > 100
    assert abs(np.median(offset)) < 0.1
    assert np.median(np.abs(offset)) < 0.25


@pytest.mark.thorough
def test_contrast_over_noise_is_that_of_the_picture(folder, frames):
    case, facts = read_case(folder)
    truth = Truth.read(folder)
    assert facts["points"] == 10
    assert np.median(truth.arrays.cnr) > LEAST_CNR
    # A bright string before a dark wall through the lens: some 100 grey levels over 2.5 of noise.
    assert 20 < np.median(truth.arrays.cnr) < 60
    assert case.name in describe(folder)
    check_contrast(case, truth.arrays)
    with pytest.raises(StrandcastError, match="SC-L012"):
        check_contrast(case, replace(truth.arrays, cnr=np.array([5.0, 6.0, 30.0])))


@pytest.mark.thorough
def test_hidden_parts_are_recorded(folder, frames):
    truth = Truth.read(folder)
    hidden = truth.arrays.hidden
    assert hidden[:, :3].all()  # the clamp is inside the hand
    assert not hidden[:, -1].all()
    assert truth.visible(np.array([0.0])).sum() == 0


@pytest.mark.thorough
def test_the_tip_speed_is_in_the_cases_range(folder):
    case, _ = read_case(folder)
    truth = Truth.read(folder)
    assert truth.arrays.tip_speed_m_s.max() <= TIP_SPEEDS_M_S[case.speed][1] * 1.2
    assert len(truth.arrays.hand) == case.most_frames
    assert sharpest_bend(truth.arrays.nodes_m) < LARGEST_BEND_RAD
    blur_px = truth.arrays.tip_speed_m_s * case.exposure_s / truth.camera.scale_m_per_px
    np.testing.assert_allclose(truth.arrays.tip_blur_px, blur_px, rtol=0.1)


def test_bends_are_unwrapped_past_half_a_turn():
    turn = np.linspace(0.0, 1.5 * np.pi, 40)
    nodes = np.zeros((40, 3, 2))
    nodes[:, 1] = [1.0, 0.0]
    nodes[:, 2] = nodes[:, 1] + np.column_stack([np.cos(turn), np.sin(turn)])
    assert sharpest_bend(nodes) == pytest.approx(1.5 * np.pi)
    assert sharpest_bend(nodes[:10]) == pytest.approx(turn[9])


@pytest.mark.thorough
def test_strings_may_be_dark():
    case = video_cases.quick()[0]
    bright = shoot(case, load_arm(ARM_FILE).planar())
    actors = replace(bright.actors, tones=TONES_BY_CONTRAST["dark"])
    dark = replace(bright, actors=actors)
    pictures = [next(taken.frames(case)).astype(float) for taken in (bright, dark)]
    empty = bright.scene.still * bright.scene.gain
    assert (pictures[0] - pictures[1]).max() > 100.0
    assert (pictures[1] - empty)[np.abs(pictures[0] - pictures[1]) > 100.0].max() < -20.0


@pytest.mark.thorough
def test_an_existing_video_is_not_filmed_again(folder, work, monkeypatch):
    monkeypatch.setattr(video_scenes, "shoot", None)
    assert film_case(video_cases.quick()[0], load_arm(ARM_FILE).planar(), work) == folder


@pytest.mark.thorough
@pytest.mark.parametrize("codec", CODECS, ids=lambda codec: codec.encoder)
def test_speed_is_measured_on_the_frames_as_they_are(codec, frames, tmp_path):
    path = tmp_path / f"v{codec.suffix}"
    encode(path, frames[:12], codec)
    assert decode_bare(path) == 12
    with open_video(path) as opened:
        again = np.stack([grey.copy() for _, _, grey in opened])
    off = again.astype(float) - np.stack(frames[:12])
    assert abs(off.mean()) < 0.5  # full range both ways
    assert np.abs(off).mean() < 3.0


@pytest.mark.thorough
def test_the_whole_benchmark_runs(folder, work, tmp_path, monkeypatch):
    monkeypatch.setattr(video, "CODECS", CODECS[1:])
    out = tmp_path / "bench-video.json"
    video.main(["--quick", "--work", str(work), "--out", str(out)])
    found = json.loads(out.read_text())
    assert {one["peer"] for one in found["peers"]} == {"skeleton", "least bending", "point drift"}
    assert found["scores"][0]["frames"] == video_cases.QUICK_FRAMES
    assert 0.0 < found["scores"][0]["across_median_px"] < 0.3
    assert {one["of"] for one in found["targets"]} == {1}
    assert found["speeds"][0]["pass_cpu_ms"]["value"] > found["speeds"][0]["bare_cpu_ms"]["value"]
    page = out.with_suffix(".md").read_text()
    assert "| quick |" in page
    image = cv2.imread(str(tmp_path / found["pictures"]["quick"]))
    assert image is not None
    assert min(image.shape[:2]) >= 400
