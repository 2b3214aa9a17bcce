"""Weights and pipes are seen where they are, and nothing is seen on a bare string."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from strandcast.records.track import SeenSection, SeenWeight
from strandcast.tracking.attachments import Attachments, find_attachments, see_attachments
from strandcast.tracking.picture import Picture
from strandcast.tracking.pixelmap import tabulate
from strandcast.tracking.typed import against_typed
from strandcast.tracking.widths import choose_frames, places_along, widths_along

LENGTH_M, LINKS, THICK_PX = 0.36, 72, 2.2
WEIGHT_M, WEIGHT_RADIUS_PX = 0.12, 5.5
PIPE_M, PIPE_PX = (0.20, 0.28), 4.6
WALL, CORD = 90.0, 200.0
GRAIN = np.random.default_rng(5).normal(size=(640, 840)).astype(np.float32)


def chains(scene, frames=32, pipe=None):
    """Nodes (F, LINKS + 1, 2) of a string that whips about; links within `pipe` keep one direction."""
    share = (np.arange(LINKS) + 0.5) / LINKS
    nodes = []
    for f in range(frames):
        ease = f / frames
        wave = 0.9 * np.sin(2 * np.pi * (0.8 * share - 1.6 * ease))
        heading = -np.pi / 2 + 2.0 * (ease - 0.3) + wave
        if pipe is not None:
            inside = (share * LENGTH_M > pipe[0]) & (share * LENGTH_M < pipe[1])
            heading[inside] = heading[inside].mean()
        steps = LENGTH_M / LINKS * np.column_stack([np.cos(heading), np.sin(heading)])
        start = np.array([0.15 * np.cos(2 * ease), 0.12 + 0.1 * ease])
        nodes.append(np.concatenate([start[None], start + np.cumsum(steps, axis=0)]))
    return np.stack(nodes)


def draw(scene, background, nodes, rng, noise, weight=None, pipe=None, blur_px=0.0, bystander=False):
    image = background.copy()
    line = scene.to_pixels(nodes)
    scene.draw_line(image, line, THICK_PX, CORD)
    if pipe is not None:
        first, last = (round(place / LENGTH_M * LINKS) for place in pipe)
        scene.draw_line(image, line[first : last + 1], PIPE_PX, CORD + 10)
    if weight is not None:
        at = line[round(weight / LENGTH_M * LINKS)]
        spot = np.rint(at * 16).astype(int).tolist()
        cv2.circle(image, spot, int(WEIGHT_RADIUS_PX * 16), CORD - 25, -1, cv2.LINE_AA, 4)
    if bystander:
        scene.draw_line(image, np.array([[250.0, 0.0], [420.0, 600.0]]), 30, 40)
    if blur_px:
        image = cv2.GaussianBlur(image, (0, 0), blur_px)
    grain = np.roll(GRAIN, rng.integers(0, 500, 2).tolist(), (0, 1))[: image.shape[0], : image.shape[1]]
    return np.clip(np.rint(image + noise * grain), 0, 255).astype(np.uint8)


def drawn_width_m(scene):
    """The width that a drawn line has: what it changes, in the change of a covered pixel."""
    image = np.full((scene.HEIGHT, scene.WIDTH), WALL, np.float32)
    scene.draw_line(image, np.array([[400.3, 100.0], [400.3, 500.0]]), THICK_PX, CORD)
    return float((image[200:400] - WALL).sum(axis=1).mean()) / (CORD - WALL) * scene.SCALE_M


def see(scene, nodes, seed=0, noise=3.0, slide_px=0.0, passes_every=0, **drawn):
    """What is seen on the string `nodes`, tracked with an error of up to a pixel across and along."""
    rng = np.random.default_rng(seed)
    rough = cv2.GaussianBlur(rng.normal(0, 1, (scene.HEIGHT, scene.WIDTH)), (0, 0), 9)
    background = (WALL + 12 * rough / rough.std()).astype(np.float32)
    plane = tabulate(scene.flat_camera(), 0.0)
    still = np.clip(np.rint(background), 0, 255).astype(np.uint8)

    def picture(frame):
        passes = passes_every and frame % passes_every == 0
        image = draw(scene, background, nodes[frame], rng, noise, bystander=bool(passes), **drawn)
        return Picture(image, 0, 0, still, plane, np.zeros(7))

    tracked = nodes + scene.SCALE_M * rng.normal(0, 0.5, (len(nodes), 1, 2))
    return see_attachments(picture, tracked, np.ones(nodes.shape[:2]), CORD, CORD - WALL)


@pytest.mark.parametrize(("seed", "blur_px"), [(0, 0.6), (1, 1.6)])
def test_a_weight_and_a_pipe_are_seen_where_they_are(scene, seed, blur_px):
    seen = see(scene, chains(scene, pipe=PIPE_M), seed, blur_px=blur_px, weight=WEIGHT_M, pipe=PIPE_M)
    (weight,), (pipe,) = seen.weights, seen.sections
    assert abs(weight.place_m - WEIGHT_M) < 0.0015
    assert weight.half_width_m == pytest.approx(WEIGHT_RADIUS_PX * scene.SCALE_M, rel=0.2)
    # The pipe is drawn with round ends.
    cap_m = 0.5 * PIPE_PX * scene.SCALE_M
    assert -cap_m - 0.001 < pipe.from_m - PIPE_M[0] < 0.0015
    assert -0.0015 < pipe.to_m - PIPE_M[1] < cap_m + 0.001
    for off, sigma in (
        (weight.place_m - WEIGHT_M, weight.sigma_m),
        (pipe.from_m - PIPE_M[0], pipe.from_sigma_m),
        (pipe.to_m - PIPE_M[1], pipe.to_sigma_m),
    ):
        assert abs(off) < 3 * sigma < 0.012
    assert pipe.stiff is True
    assert pipe.width_m > 1.5 * seen.width_m


def test_a_stretch_that_is_wider_but_bends_is_told_from_a_pipe(scene):
    (section,) = see(scene, chains(scene), pipe=PIPE_M).sections
    assert section.stiff is False


def test_a_ball_at_the_tip_is_a_weight_there(scene):
    (weight,) = see(scene, chains(scene), weight=LENGTH_M).weights
    assert weight.place_m == pytest.approx(LENGTH_M, abs=0.002)


@pytest.mark.parametrize("seed", range(3))
def test_nothing_is_seen_on_a_bare_string(scene, seed):
    seen = see(scene, chains(scene), seed, noise=8.0, passes_every=3)
    assert (seen.weights, seen.sections) == ((), ())
    assert seen.width_m == pytest.approx(drawn_width_m(scene), rel=0.1)


def test_what_passes_in_some_frames_does_not_hide_a_weight(scene):
    (weight,) = see(scene, chains(scene), passes_every=3, weight=WEIGHT_M).weights
    assert abs(weight.place_m - WEIGHT_M) < 0.002


def test_a_string_that_does_not_move_tells_nothing(scene):
    nodes = np.repeat(chains(scene, 8)[:1], 40, axis=0)
    seen = see(scene, nodes, weight=WEIGHT_M)
    assert (seen.weights, seen.frames) == ((), 0)


def test_frames_are_chosen_that_show_the_string_well_and_elsewhere(scene):
    nodes = chains(scene, 12)
    quality = np.ones(nodes.shape[:2])
    quality[4] = 0.3
    nodes[7] = np.nan
    nodes[9] = nodes[8]
    assert choose_frames(nodes, quality, scene.SCALE_M).tolist() == [0, 1, 2, 3, 5, 6, 8, 10, 11]


@pytest.mark.parametrize("blur_px", [0.5, 1.5, 3.0])
def test_blur_does_not_widen_the_string(scene, blur_px):
    nodes = chains(scene)[10]
    rng = np.random.default_rng(0)
    background = np.full((scene.HEIGHT, scene.WIDTH), WALL, np.float32)
    image = draw(scene, background, nodes, rng, 0.0, blur_px=blur_px)
    still = np.rint(background).astype(np.uint8)
    picture = Picture(image, 0, 0, still, tabulate(scene.flat_camera(), 0.0), np.zeros(7))
    places = places_along(LENGTH_M, scene.SCALE_M)
    widths = widths_along(picture, nodes, places, CORD, CORD - WALL)
    middle = widths[(places > 0.03) & (places < LENGTH_M - 0.03)]
    assert np.median(middle) == pytest.approx(drawn_width_m(scene), rel=0.04)


def test_places_about_which_frames_do_not_agree_are_not_told(scene):
    rng = np.random.default_rng(0)
    places = places_along(LENGTH_M, scene.SCALE_M)
    widths = 0.003 + 0.0002 * rng.normal(size=(40, len(places)))
    widths[:, places > LENGTH_M] *= 0.01
    bump = np.abs(places - 0.15) < 0.008
    widths[:20, bump] += 0.012  # a knot that half of the frames do not have
    seen = find_attachments(places, widths, LENGTH_M, scene.SCALE_M, chains(scene, 40))
    assert seen.weights == ()
    widths[20:, bump] += 0.012
    (weight,) = find_attachments(places, widths, LENGTH_M, scene.SCALE_M, chains(scene, 40)).weights
    assert weight.place_m == pytest.approx(0.15, abs=0.0005)


def plain_widths(places, frames=40):
    """Widths (F, K) of a bare string, with a little noise."""
    widths = 0.003 + 0.0002 * np.random.default_rng(0).normal(size=(frames, len(places)))
    widths[:, places > LENGTH_M] *= 0.01
    return widths


def test_the_hands_shadow_is_not_taken_for_a_weight(scene):
    places = places_along(LENGTH_M, scene.SCALE_M)
    widths = plain_widths(places)
    near = places < 0.035
    widths[:, near] = np.random.default_rng(1).uniform(0.0, 0.03, (40, near.sum()))
    seen = find_attachments(places, widths, LENGTH_M, scene.SCALE_M, chains(scene, 40))
    assert seen.weights == ()
    assert seen.seen_from_m > 0.034


@pytest.mark.parametrize(("more_m", "weights"), [(0.0015, 0), (0.006, 1)])
def test_a_knot_is_no_weight(scene, more_m, weights):
    places = places_along(LENGTH_M, scene.SCALE_M)
    widths = plain_widths(places)
    widths[:, np.abs(places - 0.15) < 0.004] += more_m
    seen = find_attachments(places, widths, LENGTH_M, scene.SCALE_M, chains(scene, 40))
    assert len(seen.weights) == weights


def found(weights=(), sections=()):
    seen = [SeenWeight(place_m=place, sigma_m=0.0013, half_width_m=0.01) for place in weights]
    return Attachments(tuple(seen), tuple(sections), 0.003, 0.04, 100)


def test_a_typed_weight_that_is_seen_elsewhere_is_warned_of():
    (warning,) = against_typed(found([0.19, 0.30]), [0.15, 0.301], [], 0.30)
    assert "typed at 150 mm" in warning
    assert "190 ± 1.3 mm: 40 mm off" in warning


def test_typed_places_that_fit_or_cannot_be_seen_are_not_warned_of():
    assert against_typed(found([0.296]), [0.31, 0.1], [], 0.30) == []  # beyond the clamped length: at the tip
    assert against_typed(found([0.19]), [], [], 0.30) == []


def test_an_unsure_place_is_no_contradiction():
    seen = found([0.165])
    unsure = seen.weights[0].model_copy(update={"sigma_m": 0.005})
    assert len(against_typed(seen, [0.15], [], 0.30)) == 1
    assert against_typed(replace(seen, weights=(unsure,)), [0.15], [], 0.30) == []


def test_a_weight_more_than_typed_is_warned_of():
    (warning,) = against_typed(found([0.15, 0.22]), [0.15], [], 0.30)
    assert "not typed is seen at 220" in warning


def test_a_typed_section_is_held_against_the_seen_one():
    seen = SeenSection(
        from_m=0.20, from_sigma_m=0.002, to_m=0.28, to_sigma_m=0.002, width_m=0.006, stiff=True
    )
    assert against_typed(found(sections=[seen]), [], [(0.205, 0.285)], 0.36) == []
    (warning,) = against_typed(found(sections=[seen]), [], [(0.16, 0.28)], 0.36)
    assert "seen from 200 ± 2.0 mm to 280 ± 2.0 mm" in warning
    soft = seen.model_copy(update={"stiff": False})
    (warning,) = against_typed(found(sections=[soft]), [], [(0.20, 0.28)], 0.36)
    assert warning.endswith("seen to bend")
