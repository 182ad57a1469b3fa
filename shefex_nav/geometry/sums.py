"""Sums of many numbers in compiled code, pairwise as NumPy does it, so that rounding does not pile up.

Higham, The accuracy of floating point summation, SIAM J. Sci. Comput. 14 (1993).
"""

from shefex_nav.compiled import inner

BLOCK = 128  # numbers that are added in eight sums side by side; more are divided


@inner
def pairwise(a):
    """Sum of (n,) numbers, n up to 2 `BLOCK`, to the last digit what `a.sum()` is."""
    n = len(a)
    if n <= BLOCK:
        return _block(a, 0, n)
    half = n // 2 - n // 2 % 8
    return _block(a, 0, half) + _block(a, half, n - half)


@inner
def _block(a, first, n):
    """Sum of n numbers from `first` on."""
    done = n - n % 8 if n >= 8 else 0
    total = 0.0
    if done:
        b, c, d, e = a[first], a[first + 1], a[first + 2], a[first + 3]
        f, g, h, i = a[first + 4], a[first + 5], a[first + 6], a[first + 7]
        for k in range(first + 8, first + done, 8):
            b, c, d, e = b + a[k], c + a[k + 1], d + a[k + 2], e + a[k + 3]
            f, g, h, i = f + a[k + 4], g + a[k + 5], h + a[k + 6], i + a[k + 7]
        total = ((b + c) + (d + e)) + ((f + g) + (h + i))
    for k in range(first + done, first + n):
        total += a[k]
    return total
