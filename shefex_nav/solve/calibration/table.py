"""A calibration for people, and as numbers."""

import numpy as np
from rich.table import Table

from shefex_nav.solve.calibration.lens_fit import NAMES

UNITS = dict.fromkeys(NAMES, "") | dict.fromkeys(NAMES[:3], "px")
TITLES = {"focal_length_px": "focal length", "cx_px": "principal point x", "cy_px": "principal point y"}
UNTOLD = "not told by these stars; the sigma is that of lenses nobody has measured"
SHOWN = 10  # hot pixels
BLURRED = "with what stars moved during the exposure, focus and air: of the pictures, not of the lens alone"
SAME_PLACE = 0.1  # of the field of view, width
SAME_STARS = "all look at nearly the same stars at nearly the same places: turn the camera between pictures"


def as_numbers(found):
    """Plain values of a Calibration: dict."""
    lens, noise, hot = found.lens, found.noise, found.hot
    pairs = {
        "psf_sigma_px": found.psf_sigma,
        "background_noise_dn": None if noise is None else noise.background,
        "gain_electrons_per_dn": None if noise is None else noise.gain,
        "read_noise_electrons": None if noise is None else noise.read_noise,
    }
    return {
        "size_px": [int(n) for n in found.size_px],
        "pictures": found.pictures,
        "unsolved": [{"file": one.name, "reason": one.reason} for one in found.unsolved],
        "stars": found.n_stars,
        "largest_angle_between_pictures_deg": float(np.degrees(found.apart)),
        "residual_px": lens.residual_px,
        "lens": {
            name: {"value": float(value), "sigma": float(sigma), "told": bool(is_told)}
            for name, value, sigma, is_told in zip(NAMES, lens.values, lens.sigma, lens.is_told, strict=True)
        },
        "lens_covariance": lens.covariance.tolist(),
        **{name: None if pair is None else _pair(pair) for name, pair in pairs.items()},
        "background_level_dn": None if noise is None else noise.level_dn,
        "hot_pixels": None
        if hot.why
        else [
            {"row": int(r), "column": int(c), "excess_dn": float(excess), "sigma_dn": float(sigma)}
            for (r, c), excess, sigma in zip(hot.row_column, hot.excess, hot.sigma, strict=True)
        ],
        "notes": found.notes,
        "not_told": found.why | ({"hot_pixels": hot.why} if hot.why else {}),
    }


def lens(found):
    """rich Table of the lens of a Calibration."""
    table = _empty(f"lens, from {found.n_stars} stars in {len(found.pictures)} pictures")
    fit = found.lens
    for name, value, sigma, told in zip(NAMES, fit.values, fit.sigma, fit.is_told, strict=True):
        words = found.notes.get(name, "") if told else UNTOLD
        table.add_row(TITLES.get(name, name), *_digits(value, sigma), UNITS[name], words)
    return table


def _empty(title):
    """rich Table of values, without rows."""
    table = Table(title=title)
    for head in ("", "value", "1 sigma", "unit", ""):
        table.add_column(head, justify="right" if head in ("value", "1 sigma") else "left")
    return table


def detector(found):
    """rich Table of what else a Calibration found."""
    noise, table = found.noise, _empty("spots and detector")
    rows = (
        ("width of a spot", "psf_sigma", found.psf_sigma, "px"),
        ("noise of the sky", "noise", None if noise is None else noise.background, "DN"),
        ("gain", "gain", None if noise is None else noise.gain, "electron/DN"),
        ("read noise", "read_noise", None if noise is None else noise.read_noise, "electron"),
    )
    for title, name, pair, unit in rows:
        words = found.why.get(name, "")
        if pair is None:
            table.add_row(title, "-", "-", unit, words or found.why.get("noise", ""))
        else:
            table.add_row(title, *_digits(*pair), unit, _remark(found, name))
    hot = found.hot
    table.add_row("hot pixels", "-" if hot.why else str(len(hot.excess)), "", "", hot.why or _brightest(hot))
    if len(found.pictures) > 1:
        table.add_row("pictures look apart by", f"{np.degrees(found.apart):.3g}", "", "deg", _alike(found))
    words = found.notes.get("residual_px", "")
    table.add_row("stars off the lens", f"{found.lens.residual_px:.3f}", "", "px rms", words)
    return table


def _remark(found, name):
    """Words about a value that was found."""
    if name == "noise":
        return f"where the sky is at {found.noise.level_dn:.4g} DN"
    return BLURRED if name == "psf_sigma" else found.why.get(f"{name}_gain", "")


def _alike(found):
    """Words where all pictures look in one direction; the lens is then known at few places."""
    field = 2.0 * np.arctan(0.5 * found.size_px[0] / found.lens.values[0])
    return SAME_STARS if found.apart < SAME_PLACE * field else ""


def _brightest(hot):
    """The brightest hot pixels in words."""
    order = np.argsort(-hot.excess)[:SHOWN]
    said = [f"({r}, {c})" for r, c in hot.row_column[order].tolist()]
    return f"brightest at (row, column) {', '.join(said)}" if said else ""


def _digits(value, sigma):
    """A value with the digits that its sigma, of two, allows; both as text."""
    digits = max(0, 1 - int(np.floor(np.log10(sigma)))) if 0.0 < sigma < np.inf else 4
    return f"{value:.{digits}f}", f"{sigma:.2g}"


def _pair(pair):
    return {"value": float(pair[0]), "sigma": float(pair[1])}
