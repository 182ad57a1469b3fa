"""From electrons to grey values: shot noise, full well, read noise, gain, 8 bits.

In: the mean background of every pixel and the mean light of the few pixels that stars reach. Out: the
frame. A grey value is round((min(n, full well) + r) / (electrons per DN) + black level), clipped to
0..255, with n ~ Poisson(mean) and r ~ N(0, read noise^2).

Most pixels hold background alone and share one distribution over the 256 grey values. It is computed
exactly and drawn through a table of 65536 cells, 30 times as fast as Poisson and normal draws. A cell
that lies across the border of two grey values is resolved by a second draw; with rounded borders the
noise would end at 4.2 sigma and every figure about false alarms would flatter.
"""

from math import erfc, exp, lgamma, log, sqrt

import numpy as np
from numba import njit

CELLS = 65536  # of the inverse distribution table: one per 16-bit word

# SplitMix64 (Steele, Lea & Flood 2014, OOPSLA 49(10), 453): a counter made random by two multiplications
_GAMMA = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_S16, _S27, _S30, _S31 = np.uint64(16), np.uint64(27), np.uint64(30), np.uint64(31)
_S32, _S48, _WORD = np.uint64(32), np.uint64(48), np.uint64(0xFFFF)


def electrons_per_dn(params, gain_db):
    """Electrons for one grey value at an amplifier gain in dB (20 log10 of the amplitude)."""
    return params.electrons_per_dn * 10.0 ** (-gain_db / 20.0)


def digitise(params, gain_db, mean_electrons, rng):
    """Noisy grey values of pixels drawn one by one. (n,) mean electrons -> (n,) uint8."""
    bounded = np.minimum(mean_electrons, 10.0 * params.full_well_electrons)  # far beyond it all look alike
    collected = np.minimum(rng.poisson(bounded), params.full_well_electrons)
    amplified = collected + params.read_noise_electrons * rng.standard_normal(len(collected))
    grey = np.floor(amplified / electrons_per_dn(params, gain_db) + params.black_level_dn + 0.5)
    return np.clip(grey, 0.0, 255.0).astype(np.uint8)


def grey_distribution(params, gain_db, mean_electrons):
    """P(grey value <= k) of a pixel with the given mean electrons: (256,)."""
    cdf = np.zeros(256)
    _distribution_kernel(
        mean_electrons,
        params.read_noise_electrons,
        params.full_well_electrons,
        electrons_per_dn(params, gain_db),
        params.black_level_dn,
        cdf,
    )
    return np.minimum(np.maximum.accumulate(cdf), 1.0)  # against rounding


@njit(cache=True)
def _distribution_kernel(mean, read_noise, full_well, per_dn, black_level, cdf):
    """Sum over the electron count of its probability times the normal distribution of the read noise."""
    spread = 8.0 * sqrt(mean) + 20.0  # what is outside has a probability below 1e-15
    n_first = max(0, int(mean - spread))
    n_last = int(min(mean + spread, full_well))
    n_first = min(n_first, n_last)
    left = 1.0
    log_mean = log(max(mean, 1e-300))
    for n in range(n_first, n_last + 1):
        probability = left  # of the last one: what is above the full well is held at it
        if n < n_last:
            probability = exp(n * log_mean - mean - lgamma(n + 1.0))
        left -= probability
        # grey value <= k when the amplified charge is below (k + 0.5 - black level) electrons-per-DN
        first = max(0, int(np.ceil((n - 9.0 * read_noise) / per_dn + black_level - 0.5)))
        for k in range(first, 255):
            deviation = ((k + 0.5 - black_level) * per_dn - n) / read_noise
            if deviation > 9.0:  # this and all higher k: certain
                _add_step(cdf, k, probability)
                break
            cdf[k] += probability * 0.5 * erfc(-deviation / sqrt(2.0))
    cdf[255] = 1.0


@njit(cache=True)
def _add_step(cdf, first, probability):
    for k in range(first, 255):
        cdf[k] += probability


def background(n_pixels, cdf, rng):
    """Grey values of n pixels, independent, from their distribution cdf (256,): (n,) uint8."""
    table = np.empty(CELLS, dtype=np.uint8)
    rarest = _table_kernel(cdf, table)
    grey = np.empty((n_pixels + 3) // 4 * 4, dtype=np.uint8)
    _words_kernel(table, rng.integers(0, 2**64 - 1, dtype=np.uint64, endpoint=True), grey)
    # whatever shows the rarest grey value is drawn again among the cells that do, to all digits
    cells = np.flatnonzero(table == rarest)
    doubtful = np.flatnonzero(grey == rarest)
    x = (cells[rng.integers(0, len(cells), len(doubtful))] + rng.random(len(doubtful))) / CELLS
    grey[doubtful] = np.searchsorted(cdf, x, side="right")
    return grey[:n_pixels]


@njit(cache=True)
def _table_kernel(cdf, table):
    """Write the grey value of each cell, or the rarest grey value where a cell lies across a border.

    Cell c stands for c/CELLS <= x < (c + 1)/CELLS; grey value k for cdf[k - 1] <= x < cdf[k]. Returns the
    grey value with the fewest cells of its own.
    """
    rarest, fewest = 0, table.size + 1
    first = 0
    for k in range(256):
        last = int(np.floor(cdf[k] * table.size))
        table[first:last] = k
        if last - first < fewest:
            rarest, fewest = k, last - first
        first = max(first, int(np.ceil(cdf[k] * table.size)))
    for k in range(255):
        border = cdf[k] * table.size
        if border > np.floor(border):
            table[int(border)] = rarest
    return rarest


@njit(cache=True)
def _words_kernel(table, seed, grey):
    """Write table entries of random 16-bit words, four from each 64-bit number."""
    for k in range(grey.size // 4):
        z = seed + np.uint64(k) * _GAMMA
        z = (z ^ (z >> _S30)) * _MIX_1
        z = (z ^ (z >> _S27)) * _MIX_2
        z = z ^ (z >> _S31)
        grey[4 * k] = table[z & _WORD]
        grey[4 * k + 1] = table[(z >> _S16) & _WORD]
        grey[4 * k + 2] = table[(z >> _S32) & _WORD]
        grey[4 * k + 3] = table[z >> _S48]
