"""What of the measured rate is noise: scale factor and misalignment of the gyros are not driven by it.

A scale factor s turns the attitude by s times the rate of the body. The rate that is measured has the noise
which has turned the attitude, too. Taken as measured, each star fix that finds the angle of the noise again
would teach a scale factor of -1, by as much as the noise of a tick is larger than that of the fix, and a body
at rest under the stars would know the scale factors of its gyros.

So these errors are driven by a rate w that follows the measured one and leaves its noise behind. It is the
mean of the last `FOLLOWS_S`, but never further from what is measured than chance explains: `BAND` sigma of
white noise and rounding. A turn is followed at once; what is left out of it is at most `BAND` times the
noise of a tick for the time `FOLLOWS_S`, times a scale factor.

Not covered: while the rate changes by more than the band within `FOLLOWS_S`, w has the noise of each tick.
A longer mean would be a bias that the filter does not know yet, and a rate of zero within the band would
leave out all that a slow turn does. Both taught more falsehoods than they avoided.
"""

import numpy as np

from shefex_nav.compiled import inner
from shefex_nav.onboard.navigation import momentary

FOLLOWS_S = 1.0  # [E] longer than ten star fixes a second need to find the angle of the noise
BAND = 4.0  # sigma, which noise exceeds once in 16 000 ticks


@inner(forceinline=True)
def of_tick(model, errors, extra, before, now, T):
    """The noise n of a tick, of one axis: rad/s.

    model : row of `error_model.record`;  errors : (2, 3) of `momentary`
    extra : rad^2/s, white noise of more, as of an ImuWindow
    before : w of the tick before;  now : mean of what is measured in this one, T seconds
    """
    _, swing2 = momentary.variances(errors, 0.0)
    band = BAND * np.sqrt((model.gyro_random_walk**2 + extra) / T + 2.0 * swing2 / T**2)
    follows = before + min(T / FOLLOWS_S, 1.0) * (now - before)
    return now - min(max(follows, now - band), now + band)


@inner(forceinline=True)
def mean(increments, first, n, axis, T):
    """Mean rate, as measured, of n samples of (N, 6) increments from `first` on, in all T seconds: rad/s."""
    turned = 0.0
    for k in range(first, first + n):
        turned += increments[k, axis]
    return turned / T
