"""What a log with a lower rate keeps."""

from collections import Counter

import numpy as np
import pytest
import synthetic_run

from shefex_nav import records as rec
from shefex_nav.log.thinning import thinned

THINNED = {rec.TruthSample, rec.ImuBlock, rec.NavSolution}


@pytest.mark.parametrize("start_s", [231.0, 231.034])
@pytest.mark.parametrize("rate", [100.0, 50.0, 20.0, 10.0])
def test_steady_records_are_thinned_and_all_others_stay(rate, start_s):
    options = synthetic_run.Options(start_s=start_s, end_s=start_s + 5.0, frame_pixels=False)
    everything = list(synthetic_run.simulate(options))
    kept = list(thinned(everything, rate, start_s))
    before, after = Counter(map(type, everything)), Counter(map(type, kept))
    assert before[rec.TruthSample] == 501
    for kind, count in before.items():
        assert after[kind] == (5 * rate + 1 if kind in THINNED else count), kind
    times = {kind: [r.t_s for r in kept if type(r) is kind] for kind in (rec.TruthSample, rec.NavSolution)}
    assert times[rec.TruthSample] == times[rec.NavSolution]
    covariances = [r.t_s for r in kept if type(r) is rec.NavCovariance]
    assert np.isin(np.round(covariances, 6), np.round(times[rec.NavSolution], 6)).all()


@pytest.mark.parametrize("rate", [1.0, 30.0, 40.0, 200.0])
def test_other_rates_are_refused(rate):
    with pytest.raises(ValueError, match="samples a second"):
        list(thinned([], rate, 0.0))
