"""Heads of a FITS file, checked before astropy reads what they describe: `FitsError` says what is wrong.

Astropy trusts them: a head of 10^9 axes takes all memory, and a word in the place of a number is a TypeError.
Source: FITS standard 4.0, sections 4.4.1 (mandatory keywords), 7.3 (binary tables) and 10.1 (tiled pictures).
"""

import math
import re

BLOCK = 2880  # bytes
KINDS = (8, 16, 32, 64, -32, -64)  # BITPIX: bits of a value, negative of floating point
MOST_AXES = 999
MOST_HEADS = 1000  # before that of the picture, which has few: astropy reads all of them
LARGEST = 2**63 - 1
ONCE = re.compile(  # keywords
    r"SIMPLE|XTENSION|GROUPS|[PG]COUNT|Z?BITPIX|Z?NAXIS[0-9]*|BSCALE|BZERO|BLANK|ZIMAGE|DATE-OBS|EXPTIME|VEL[XYZ]"
    r"|ROWORDER"
)
PLANES = 1, 3  # of a picture: grey, in colour


class FitsError(Exception):
    """A head that cannot be meant; the text says why."""


def is_picture(axes):
    """Whether axes of these lengths, the one that changes fastest first, are a picture, grey or in colour."""
    return len(axes) == 2 or (len(axes) == 3 and axes[2] in PLANES)


def check(file):
    """FitsError unless all heads up to that of the first picture are possible.

    file : open for its bytes, at its beginning
    """
    from astropy.io.fits import Header

    size = file.seek(0, 2)
    file.seek(0)
    heads = 0
    while (at := file.tell()) < size:
        if heads == MOST_HEADS:
            raise FitsError(f"has no picture in its first {MOST_HEADS} parts; later ones are not read")
        heads += 1
        try:
            head = Header.fromfile(file)
        except EOFError:  # what follows is no head
            return
        except (OSError, ValueError):
            raise FitsError(f"its head at byte {at} has no END") from None
        _once(head)
        start, stored = file.tell(), _bytes(head)
        is_packed = head.get("ZIMAGE", False) is True and is_picture(_axes(head, "Z")[1])
        for key in ("BSCALE", "BZERO"):
            _finite(head, key)
        if head.get("BSCALE") == 0:
            raise FitsError("BSCALE is 0, by which all values are the same; expected another number")
        is_table = head.get("XTENSION", "IMAGE") != "IMAGE"
        if is_packed or (not is_table and is_picture(_axes(head)[1])):
            if start + stored > size:
                raise FitsError(f"ends after {size - start} of the {stored} bytes of its picture")
            return
        file.seek(start + -(-stored // BLOCK) * BLOCK)


def _once(head):
    """FitsError if a keyword that is read is there twice and says different things: who reads what is open.

    Astropy itself reads the first of some and the last of others.
    """
    said = {}
    for card in head.cards:
        key, _, text = card.image.partition("=")
        key, value = key.strip(), text.partition(" /")[0].strip()
        if ONCE.fullmatch(key) and (first := said.setdefault(key, value)) != value:
            raise FitsError(
                f"{key} is there twice, as {_short(first)} and as {_short(value)}; keep one of them"
            )


def _bytes(head):
    """Number of bytes of what follows a head."""
    bits, axes = _axes(head)
    groups = head.get("GROUPS", False) is True and axes[:1] == [0]
    values = math.prod(axes[1:] if groups else axes) if axes else 0
    more, count = _whole(head, "PCOUNT", 0, LARGEST, 0), _whole(head, "GCOUNT", 1, LARGEST, 1)
    stored = abs(bits) // 8 * count * (more + values)
    if stored > LARGEST:
        raise FitsError(f"claims to hold {stored:.3g} bytes")
    return stored


def _axes(head, prefix=""):
    """BITPIX and the list of the lengths of the axes. prefix : 'Z' for those of a compressed picture"""
    bits = _whole(head, f"{prefix}BITPIX", -64, 64)
    if bits not in KINDS:
        raise FitsError(f"{prefix}BITPIX is {bits}; expected one of {', '.join(map(str, KINDS))}")
    count = _whole(head, f"{prefix}NAXIS", 0, MOST_AXES)
    return bits, [_whole(head, f"{prefix}NAXIS{k}", 0, LARGEST) for k in range(1, count + 1)]


def _whole(head, key, least, most, otherwise=None):
    """A whole number of a head. otherwise : what holds where it does not give it; None: it must"""
    if otherwise is not None and key not in head:
        return otherwise
    value = _value(head, key)
    if type(value) is not int or not least <= value <= most:  # True is no number
        bounds = f"from {least} to {most}" if most < LARGEST else f"of {least} or more"
        raise FitsError(f"{key} is {_shown(value)}; expected a whole number {bounds}")
    return value


def _finite(head, key):
    """FitsError if a number of a head, which need not be there, is none."""
    if key in head:
        value = _value(head, key)
        if type(value) not in (int, float) or not math.isfinite(value):
            raise FitsError(f"{key} is {_shown(value)}; expected a finite number")


def _value(head, key):
    from astropy.io.fits import VerifyError

    try:
        return head[key]
    except KeyError:
        raise FitsError(f"{key} is missing in a head") from None
    except VerifyError:
        raise FitsError(f"{key} has a value that cannot be read") from None


def _shown(value):
    return _short(repr(value))


def _short(text):
    return text if len(text) <= 40 else f"{text[:37]}..."
