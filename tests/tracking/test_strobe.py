"""Which instants make the strobe picture, and what it is made of."""

import numpy as np

from strandcast.tracking.strobe import INSTANTS, choose_instants, moving_frames, strobe_picture


def swing():
    """A hand that moves from frame 100 to 200, and a tip whose speed grows meanwhile."""
    frame = np.arange(400)
    share = np.clip((frame - 100) / 100, 0, 1)
    points = np.zeros((400, 3, 2))
    points[:, 0, 0] = 0.6 * share
    points[:, 2, 0] = share**2
    return points


def test_instants_are_even_along_the_tips_path_while_the_hand_moves():
    points = swing()
    assert moving_frames(points[:, 0]) == (101, 213)
    assert moving_frames(points[:205, 0]) == (101, 204)  # a film that ends before that
    instants = choose_instants(np.arange(0, 400, 2), points)
    assert len(instants) == INSTANTS
    assert instants[0] == 102
    steps = np.diff(points[instants, 2, 0])
    assert steps.max() < 1.5 * np.median(steps)


def test_instants_without_a_tip_are_not_chosen():
    points = swing()
    points[110:150, 2] = np.nan
    instants = choose_instants(np.arange(0, 400, 2), points)
    assert not ((instants >= 110) & (instants < 150)).any()


def test_each_pixel_shows_the_frame_in_which_it_changed_most(scene):
    background = np.full((scene.HEIGHT, scene.WIDTH), 80, np.uint8)
    dark, bright = background.copy(), background.copy()
    dark[:10], bright[5:15] = 50, 200
    picture = strobe_picture(background, [dark, bright], np.zeros((0, 3, 2)), scene.flat_camera())
    np.testing.assert_array_equal(picture[[2, 7, 12, 20], 30, 0], [50, 200, 200, 80])
