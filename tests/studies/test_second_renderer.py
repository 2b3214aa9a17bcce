"""The second renderer draws a string where it is, and its end as it is."""

from dataclasses import replace

import numpy as np
import pytest

from strandcast.arm.load import load_arm
from strandcast_studies.second_renderer.film import Filming, thread_of
from strandcast_studies.second_renderer.render import CUT, INSTANTS, ROUND
from strandcast_studies.second_renderer.rigs import RIGS, optics_of

RIG = replace(
    RIGS["cord-cut"],
    string=replace(RIGS["cord-cut"].string, diameter_m=0.03),
    size_px=(320, 200),
    shade=0.0,
    defocus_px=0.0,
)


def test_a_place_is_seen_where_its_ray_meets_the_plane():
    optics = optics_of(RIG, np.random.default_rng(1))
    assert abs(optics.division) > 0.01
    uv = np.random.default_rng(2).uniform(0, 200, (50, 2))
    for height_m in (0.0, 0.02, -0.25):
        np.testing.assert_allclose(optics.pixels(optics.on_plane(uv, height_m), height_m), uv, atol=1e-9)


@pytest.mark.thorough
@pytest.mark.parametrize("end", [CUT, ROUND])
def test_a_string_is_where_it_should_be_and_ends_as_it_should(end, project_root):
    random = np.random.default_rng(3)
    optics = optics_of(RIG, random)
    # From the picture's left third to its middle, along a row, far from the arm.
    ends_m = optics.on_plane(np.array([[60.0, 40.0], [150.0, 40.0]]))
    places_m = np.linspace(0.0, float(np.linalg.norm(ends_m[1] - ends_m[0])), 31)
    nodes_m = ends_m[0] + np.linspace(0.0, 1.0, 31)[:, None] * (ends_m[1] - ends_m[0])
    string = replace(RIG.string, length_m=float(places_m[-1]))
    rig = replace(RIG, end=end, string=string)
    filming = Filming(
        rig,
        optics,
        load_arm(project_root / "config/arms/planar3.toml").planar(),
        np.zeros((200, 320)),
        random,
    )
    q_rad = np.tile([-2.0, -0.5, -0.5], (INSTANTS, 1))
    light = filming.exposure(q_rad, np.tile(nodes_m, (INSTANTS, 1, 1)), thread_of(rig, places_m, random))
    shown = light[20:61, 55:170] / rig.tones[0]
    middle = (shown * np.arange(20, 61)[:, None]).sum(axis=0)[20:80] / shown.sum(axis=0)[20:80]
    line_px = optics.pixels(nodes_m)
    expected = np.interp(np.arange(75, 135), line_px[:, 0], line_px[:, 1])
    assert np.abs(middle - expected).max() < 0.15
    width_px = float(np.median(shown.sum(axis=0)[20:80]))
    assert width_px == pytest.approx(0.03 / float(np.abs(filming.slopes[40, 105]).max()), rel=0.03)
    beyond_px = (
        shown[:, 150 - 55 :].sum() / width_px + 0.5 - 1.0
    )  # the pixel of the end itself counts by half
    assert beyond_px == pytest.approx(np.pi / 8 * width_px if end == ROUND else 0.0, abs=0.6)
