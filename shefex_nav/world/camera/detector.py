"""From electrons to grey values: shot noise, full well, read noise, gain, 8 to 16 bits.

In: the mean background of every pixel and the mean light of the few pixels that stars reach. Out: the
frame. A grey value is round((min(n, full well) + r) / (electrons per DN) + black level), clipped to
0 .. 2^bits - 1, with n ~ Poisson(mean) and r ~ N(0, read noise^2).

Most pixels hold background alone and share one distribution over the grey values. It is computed exactly,
and two neighbours at a time are drawn from a table of 65536 cells with a 16-bit word, 60 times as fast as by
Poisson and normal draws. A pair of grey values gets as many whole cells as its probability has; what the
fractions leave over is in cells of its own that are resolved by a second draw among the fractions. With
rounded probabilities the noise would end at 3 sigma and every figure about false alarms would flatter.
Where a distribution has so many grey values that most pairs have no whole cell, they are drawn one by one.
"""

from functools import lru_cache
from math import erfc, sqrt
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel

CELLS = 65536  # of the table: one per 16-bit word
GUIDE = 1024  # parts of the fractions
# Above this mean a Poisson number is drawn as a normal one with its variance and, by the first term of
# Cornish and Fisher's expansion, its skewness: sigma (z^2 - 1) skew / 6 = (z^2 - 1) / 6.
MANY_ELECTRONS = 1000.0
WORTH_A_CALL = 1000  # pixels with so many electrons; for fewer the kernel costs more to call than it saves
MOST_IN_PAIRS = 160  # grey values; with more the pairs leave over too much

# SplitMix64 (Steele, Lea & Flood 2014, OOPSLA 49(10), 453): a counter made random by two multiplications
_GAMMA = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_S16, _S27, _S30, _S31 = np.uint64(16), np.uint64(27), np.uint64(30), np.uint64(31)
_S11, _S32, _S48, _WORD = np.uint64(11), np.uint64(32), np.uint64(48), np.uint64(0xFFFF)


class Cells(NamedTuple):
    """Distribution of the grey values of one or two pixels, made ready to draw from.

    An outcome is one grey value, or two side by side in one word of twice the bits.
    """

    table: np.ndarray  # (CELLS,) uint16 or uint32, outcomes
    marker: int  # in a cell of the table: to be drawn among the fractions; no outcome that has a cell
    fractions: np.ndarray  # (m,) running sum of what the whole cells leave over
    outcomes: np.ndarray  # (m,) to which the fractions belong
    guide: np.ndarray  # (GUIDE + 1,) where equal parts of the sum begin among the fractions
    together: int  # grey values in an outcome, 1 or 2


class Electronics(NamedTuple):
    """What shapes the noise: a detector at a gain of its amplifier."""

    read_noise: float  # electrons, > 0
    full_well: float  # electrons
    electrons_per_dn: float  # for one grey value
    black_level: float  # grey values
    bits: int = 8  # of a grey value


def electronics(settings, gain_db):
    """Electronics at an amplifier gain in dB (20 log10 of the amplitude). camera_settings.Detector"""
    return Electronics(
        settings.read_noise,
        settings.full_well,
        settings.conversion * 10.0 ** (-gain_db / 20.0),
        settings.black_level,
        settings.bits,
    )


def digitise(electronics, mean_electrons, rng):
    """Noisy grey values of pixels drawn one by one. (n,) mean electrons -> (n,) uint8 or uint16."""
    read_noise, full_well, per_dn, black_level, bits = electronics
    bounded = np.minimum(mean_electrons, 10.0 * full_well)  # far beyond it all look alike
    pixel, few = np.uint8 if bits == 8 else np.uint16, bounded < MANY_ELECTRONS
    n_many = len(bounded) - np.count_nonzero(few)
    if n_many < WORTH_A_CALL:
        collected = np.minimum(rng.poisson(bounded), full_well)
        amplified = collected + read_noise * rng.standard_normal(len(collected))
        grey = np.floor(amplified / per_dn + black_level + 0.5)
        return np.clip(grey, 0.0, 2.0**bits - 1.0).astype(pixel)
    collected, grey = np.empty(len(bounded)), np.empty(len(bounded), dtype=pixel)
    collected[few] = rng.poisson(bounded[few])
    normals = rng.standard_normal(len(bounded) + n_many)
    _digitise_kernel(bounded, collected, normals, tuple(electronics), grey)
    return grey


@kernel
def _digitise_kernel(mean, collected, normals, electronics, grey):
    """Grey values; the charge of pixels with many electrons is drawn here, that of the others collected.

    normals : of charge, where it is drawn, and of read noise, pixel after pixel
    """
    read_noise, full_well, per_dn, black_level, bits = electronics
    largest, i = 2.0**bits - 1.0, 0
    for k in range(mean.size):
        electrons = collected[k]
        if mean[k] >= MANY_ELECTRONS:
            z = normals[i]
            i += 1
            electrons = np.floor(mean[k] + sqrt(mean[k]) * z + (z * z - 1.0) / 6.0 + 0.5)
        amplified = min(electrons, full_well) + read_noise * normals[i]
        i += 1
        value = np.floor(amplified / per_dn + black_level + 0.5)
        grey[k] = int(min(max(value, 0.0), largest))


def grey_distribution(electronics, mean_electrons):
    """P(grey value <= k) of a pixel with the given mean electrons: (2^bits,)."""
    *rest, bits = electronics
    cdf, certain = np.zeros(2**bits), np.zeros(2**bits)
    _distribution_kernel(mean_electrons, *rest, cdf, certain)
    cdf += np.cumsum(certain)
    cdf[-1] = 1.0
    return np.minimum(np.maximum.accumulate(cdf), 1.0)  # against rounding


@kernel
def _distribution_kernel(mean, read_noise, full_well, per_dn, black_level, cdf, certain):
    """Sum over the electron count of its probability times the normal distribution of the read noise.

    What is certain from a grey value on is written there alone, to certain: its running sum belongs to cdf.
    """
    first, probability = _poisson(mean)
    well = int(full_well)  # what is above it is held at it
    held = 0.0
    for k in range(probability.size):
        if first + k < well:
            _add_count(first + k, probability[k], read_noise, per_dn, black_level, cdf, certain)
        else:
            held += probability[k]
    if held > 0.0:
        _add_count(well, held, read_noise, per_dn, black_level, cdf, certain)


@inner
def _poisson(mean):
    """First count and the probabilities from it on; what is outside has less than 1e-15.

    Up and down from the most probable count by p(n + 1) = p(n) mean / (n + 1): relative errors of 1e-13.
    """
    spread = 8.0 * sqrt(mean) + 20.0
    first, top = max(0, int(mean - spread)), int(mean)
    p = np.zeros(int(mean + spread) - first + 1)
    p[top - first] = 1.0
    for n in range(top, first, -1):
        p[n - 1 - first] = p[n - first] * n / mean
    for n in range(top + 1, first + p.size):
        p[n - first] = p[n - 1 - first] * mean / n
    return first, p / p.sum()


@inner
def _add_count(n, probability, read_noise, per_dn, black_level, cdf, certain):
    """Add the grey values of n electrons: at most k when what is amplified is below k + 1/2."""
    first = max(0, int(np.ceil((n - 9.0 * read_noise) / per_dn + black_level - 0.5)))
    for k in range(first, cdf.size - 1):
        deviation = ((k + 0.5 - black_level) * per_dn - n) / read_noise
        if deviation > 9.0:  # this and all higher k: certain
            certain[k] += probability
            break
        cdf[k] += probability * 0.5 * erfc(-deviation / sqrt(2.0))


@lru_cache(maxsize=4)
def background_cells(electronics, mean_electrons):
    """Cells of pixels with the given mean electrons; those asked for last are kept."""
    return cells(grey_distribution(electronics, mean_electrons))


def cells(cdf):
    """Cells of independent pixels that follow cdf: (256,) for uint8, (512 .. 65536,) for uint16."""
    probability = np.diff(cdf, prepend=0.0)
    greys = np.flatnonzero(probability)
    each, bits = probability[greys], 8 if len(cdf) == 256 else 16
    if len(greys) > MOST_IN_PAIRS and bits > 8:
        return _cells(each, greys.astype(np.uint16), 1)
    both = (greys[:, None] << bits) + greys
    return _cells(np.outer(each, each).ravel(), both.ravel().astype(np.uint16 if bits == 8 else np.uint32), 2)


def _cells(probability, outcomes, together):
    """Cells of outcomes (m,) with their probability (m,)."""
    expected = CELLS * probability
    whole = np.floor(expected).astype(np.int64)
    filled = np.repeat(outcomes, whole)
    has_cell = np.zeros(len(outcomes) + 1, dtype=bool)  # of the numbers from 0 on: one of them has none
    low = outcomes[(whole > 0) & (outcomes <= len(outcomes))]
    has_cell[low] = True
    marker = int(np.argmin(has_cell))
    table = np.full(CELLS, marker, dtype=outcomes.dtype)
    table[: len(filled)] = filled
    fractions = np.cumsum(expected - whole)
    guide = np.searchsorted(fractions, fractions[-1] * np.arange(GUIDE + 1) / GUIDE, side="right")
    return Cells(table, marker, fractions, outcomes, np.minimum(guide, len(fractions) - 1), together)


def background(n_pixels, cells, rng):
    """Grey values of n pixels, independent, drawn from Cells: (n,) uint8 or uint16."""
    pixel = np.dtype(f"u{cells.table.itemsize // cells.together}")
    drawn = np.empty(-(-n_pixels // (4 * cells.together)) * 4, dtype=cells.table.dtype)
    seed = rng.integers(0, 2**64 - 1, dtype=np.uint64, endpoint=True)
    _draw_kernel(
        cells.table,
        cells.table.dtype.type(cells.marker),
        cells.fractions,
        cells.outcomes,
        cells.guide,
        seed,
        drawn,
    )
    return drawn.view(pixel)[:n_pixels]


@inner
def _random_word(seed, k):
    """Number k of the sequence that starts at seed, 64 random bits."""
    z = seed + np.uint64(k) * _GAMMA
    z = (z ^ (z >> _S30)) * _MIX_1
    z = (z ^ (z >> _S27)) * _MIX_2
    return z ^ (z >> _S31)


@kernel
def _draw_kernel(table, marker, fractions, outcomes, guide, seed, drawn):
    """Write outcomes, four for each random number; what shows the marker takes another number each."""
    n = drawn.size // 4
    spare = n
    for k in range(n):
        z = _random_word(seed, k)
        a, b = table[z & _WORD], table[(z >> _S16) & _WORD]
        c, d = table[(z >> _S32) & _WORD], table[z >> _S48]
        drawn[4 * k], drawn[4 * k + 1], drawn[4 * k + 2], drawn[4 * k + 3] = a, b, c, d
        if (a == marker) | (b == marker) | (c == marker) | (d == marker):
            for j in range(4 * k, 4 * k + 4):
                if drawn[j] == marker:
                    drawn[j] = outcomes[_fraction(fractions, guide, _random_word(seed, spare))]
                    spare += 1


@inner
def _fraction(fractions, guide, word):
    """Index of an outcome drawn among what the whole cells leave over."""
    part = (word >> _S11) * 2.0**-53
    x, j = part * fractions[-1], int(part * GUIDE)
    low, high = guide[j], guide[j + 1]  # the first running sum above x is in low ... high
    while low < high:
        middle = (low + high) // 2
        if fractions[middle] > x:
            high = middle
        else:
            low = middle + 1
    return low
