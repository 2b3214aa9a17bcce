"""`track.hand`, the name of `track.tracker` in 0.1, is still accepted."""

import pytest

from strandcast.config.load import load_experiment
from strandcast.config.track import TrackSettings
from strandcast.errors import StrandcastError

HEAD = "string: {length_m: 0.3}\ntarget_m: [0.5, 0.5]\n"


@pytest.mark.parametrize(("hand", "tracker"), [("pivot", "pendulum"), ("marker", "chain")])
def test_hand_names_a_tracker(tmp_path, caplog, hand, tracker):
    path = tmp_path / "experiment.yaml"
    path.write_text(HEAD + f"track: {{hand: {hand}, polarity: dark}}\n")
    assert load_experiment(path).track == TrackSettings(tracker=tracker, polarity="dark")
    assert f"{path}:3: track.hand is now called track.tracker" in caplog.text


@pytest.mark.parametrize("track", ["{hand: 3}", "{hand: pivot, tracker: chain}"])
def test_a_hand_that_names_no_tracker_or_another_one_is_refused(tmp_path, track):
    path = tmp_path / "experiment.yaml"
    path.write_text(HEAD + f"track: {track}\n")
    with pytest.raises(StrandcastError, match=r"track\.tracker") as caught:
        load_experiment(path)
    assert "experiment.yaml:3" in str(caught.value)
