"""The scatter of a rig that is drawn: its own for each experiment, the same for all its throws."""

import numpy as np

from strandcast.config.lab import TYPICAL, LabScatter, LabSettings
from strandcast.lab.variation import DRAWN_FACTORS, draw_variation, scatter_of


def test_a_rig_that_is_not_drawn_scatters_as_its_settings_say() -> None:
    assert scatter_of("demo", 1, LabSettings()) == TYPICAL
    wild = LabScatter(sway_rad=0.5)
    assert scatter_of("demo", 1, LabSettings(scatter=wild)) == wild


def test_drawn_rigs_differ_in_sizes_and_tails() -> None:
    drawn = LabSettings(scatter=LabScatter(draws="unknown_rig"))
    rigs = [scatter_of("lab", seed, drawn) for seed in range(400)]
    assert scatter_of("lab", 7, drawn) == rigs[7]
    assert scatter_of("other", 7, drawn) != rigs[7]
    typical = TYPICAL.model_dump(exclude={"draws"})
    factors = np.log([[getattr(rig, name) / sd for name, sd in typical.items()] for rig in rigs])
    low, high = np.log(DRAWN_FACTORS)
    assert low < factors.min() < 0.97 * low
    assert 0.97 * high < factors.max() < high
    np.testing.assert_allclose(factors.mean(axis=0), 0.5 * (low + high), atol=0.12)
    calm = LabSettings(scatter=LabScatter(draws="unknown_rig", sway_rad=0.0))
    assert scatter_of("lab", 7, calm).sway_rad == 0.0
    # Each size is drawn by itself.
    assert np.abs(np.corrcoef(factors.T) - np.eye(len(typical))).max() < 0.2
    assert 0.42 < np.mean([rig.draws == "heavy_tails" for rig in rigs]) < 0.58


def test_throws_have_the_rigs_sizes_and_tails() -> None:
    for draws in ("normal", "heavy_tails"):
        rig = LabScatter(sway_rad_s=0.2, draws=draws)
        random = np.random.default_rng(2)
        rates = np.array([draw_variation(random, 3, 1.0, rig).sway_rad_s for _ in range(4000)])
        np.testing.assert_allclose(np.sqrt(np.mean(rates**2)), 0.2, rtol=0.1)
        far = np.mean(np.abs(rates) > 3 * 0.2)
        assert (far > 0.006) == (draws == "heavy_tails")
