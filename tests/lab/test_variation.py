"""The scatter of a rig that is drawn: its own for each experiment, the same for all its throws."""

import numpy as np

from strandcast.config.lab import TYPICAL, LabSettings
from strandcast.lab.variation import DRAWN_FACTORS, TYPICAL_RIG, LabScatter, draw_variation, scatter_of


def test_a_rig_that_is_not_drawn_scatters_as_its_settings_say() -> None:
    assert scatter_of("demo", 1, LabSettings()) == TYPICAL_RIG
    assert scatter_of("demo", 1, LabSettings(noise=2.0)).sizes["sway_rad"] == 2.0 * TYPICAL["sway_rad"]
    wild = scatter_of("demo", 1, LabSettings(noise={"sway_rad": 0.5}, draws="heavy_tails"))
    assert wild == LabScatter(TYPICAL | {"sway_rad": 0.5}, heavy_tails=True)
    # A throw takes each size by its name, in whatever order they are given.
    noise = {name: float(k) for k, name in enumerate(reversed(TYPICAL), 1)}
    drawn = draw_variation(np.random.default_rng(0), 1, 1.0, scatter_of("demo", 1, LabSettings(noise=noise)))
    normal = np.random.default_rng(0).standard_normal(7)
    assert drawn.grasp_length_m == normal[0] * noise["grasp_length_m"]
    assert drawn.servo_gain == 1.0 + normal[6] * noise["servo_gain"]
    assert drawn.log_noise_rad == noise["joint_log_rad"]


def test_drawn_rigs_differ_in_sizes_and_tails() -> None:
    drawn = LabSettings(draws="unknown_rig")
    rigs = [scatter_of("lab", seed, drawn) for seed in range(400)]
    assert scatter_of("lab", 7, drawn) == rigs[7]
    assert scatter_of("other", 7, drawn) != rigs[7]
    factors = np.log([[rig.sizes[name] / sd for name, sd in TYPICAL.items()] for rig in rigs])
    low, high = np.log(DRAWN_FACTORS)
    assert low < factors.min() < 0.97 * low
    assert 0.97 * high < factors.max() < high
    np.testing.assert_allclose(factors.mean(axis=0), 0.5 * (low + high), atol=0.12)
    calm = LabSettings(draws="unknown_rig", noise={"sway_rad": 0.0})
    assert scatter_of("lab", 7, calm).sizes["sway_rad"] == 0.0
    # Each size is drawn by itself.
    assert np.abs(np.corrcoef(factors.T) - np.eye(len(TYPICAL))).max() < 0.2
    assert 0.42 < np.mean([rig.heavy_tails for rig in rigs]) < 0.58


def test_throws_have_the_rigs_sizes_and_tails() -> None:
    for heavy_tails in (False, True):
        rig = LabScatter(TYPICAL | {"sway_rad_s": 0.2}, heavy_tails)
        random = np.random.default_rng(2)
        rates = np.array([draw_variation(random, 3, 1.0, rig).sway_rad_s for _ in range(4000)])
        np.testing.assert_allclose(np.sqrt(np.mean(rates**2)), 0.2, rtol=0.1)
        far = np.mean(np.abs(rates) > 3 * 0.2)
        assert (far > 0.006) == heavy_tails
