import json

import numpy as np
import pytest

from strandcast.alignment.shared_drift import main, shared_drift
from strandcast.config.align import AlignSettings
from strandcast.core.trial_names import trial_name
from strandcast.errors import StrandcastError
from strandcast.records.alignment import Alignment


def aligned(trial: int, drift: float, se: float, prior: float = 5e-5, known: float = 0.0) -> Alignment:
    """A trial with the drift `drift` ± `se` by its motion alone, as a fit with a prior reports it."""
    total = se**-2.0 + prior**-2.0
    return Alignment(
        experiment="e",
        trial=trial,
        source="fit",
        offset_s=0.0,
        offset_se_s=1e-4,
        drift=(drift * se**-2.0 + known * prior**-2.0) / total,
        drift_se=total**-0.5,
        drift_prior=prior,
        known_drift=known,
        residual_rms_m=1e-4,
        frames=100,
        motion_start_s=0.0,
        motion_end_s=1.0,
    )


def test_the_prior_counts_once():
    found = shared_drift([aligned(k + 1, 8e-5, 1e-4) for k in range(9)])
    total = 9 * 1e-4**-2.0 + 5e-5**-2.0
    assert found.se == pytest.approx(total**-0.5)
    assert found.drift == pytest.approx(8e-5 * 9 * 1e-4**-2.0 / total)
    assert found.odd == ()


def test_a_trial_without_information_changes_nothing():
    some = [aligned(k + 1, 8e-5, 1e-4) for k in range(3)]
    vague = aligned(4, 0.0, 1.0).model_copy(update={"drift": 4e-5, "drift_se": 5.1e-5})
    assert shared_drift([*some, vague]) == shared_drift(some)


def test_a_trial_of_another_clock_is_named():
    trials = [aligned(k + 1, 1e-5, 2e-5) for k in range(5)] + [aligned(6, 9e-4, 2e-5)]
    assert 6 in shared_drift(trials).odd


@pytest.mark.thorough
def test_lab_throws_that_share_a_drift(throw, fit):
    """Four throws with a drift of 300 ppm, which a single one hardly determines."""
    trials = [throw(seed, drift=0.0) for seed in (0, 5, 9, 14)]
    found = []
    for number, trial in enumerate(trials):
        columns = trial.markers | {"camera_time_s": trial.markers["camera_time_s"] / 1.0003}
        found.append(
            fit(trial, markers=columns, settings=AlignSettings(drift=(0.0, 1e-3))).model_copy(
                update={"trial": number}
            )
        )
    shared = shared_drift(found)
    assert shared.se < 0.75 * min(one.drift_se for one in found)
    assert shared.drift == pytest.approx(3e-4, abs=3.5 * shared.se)
    assert shared.odd == ()


def test_the_command_prints_settings(tmp_path, capsys):
    for trial in (1, 2):
        aligned(trial, 8e-5, 1e-4).write(tmp_path / trial_name(trial) / "alignment.json")
    main([str(tmp_path)])
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("# drift of 2 trials: +")
    name, _, values = lines[-1].partition(": ")
    assert name == "  drift"
    assert np.isfinite(json.loads(values)).all()
    with pytest.raises(SystemExit, match="SC-W030"):
        main([str(tmp_path / "nothing")])
    with pytest.raises(StrandcastError):
        shared_drift([])
