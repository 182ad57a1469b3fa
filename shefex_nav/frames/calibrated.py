"""The camera file that a calibration makes of another: what the pictures tell is put in, the rest stays."""

from typing import NamedTuple

from shefex_nav.frames.camera_file import HEAD
from shefex_nav.scenario.load import normalised
from shefex_nav.solve.calibration import calibrate, lens_fit, pictures


class Values(NamedTuple):
    """Values of a camera file."""

    optics: dict
    detector: dict
    bad_pixels: list


def known(base):
    """calibrate.Known of a camera_file.Base."""
    return calibrate.Known(base.detector.black_level, base.camera.params.camera.electrons_per_dn)


def told(base, fov_deg=None, julian_year=None):
    """pictures.Told of a camera_file.Base. julian_year : comes before that of the file"""
    hole = base.camera.params.camera.pinhole
    year = base.camera.julian_year if julian_year is None else julian_year
    return pictures.Told(fov_deg, year, ((hole.width_px, hole.height_px), base.camera.bits))


def values(found, base):
    """Values of a Calibration, with the pixel size and the gain of the amplifier of a Base."""
    value = dict(zip(lens_fit.NAMES, found.lens.values.tolist(), strict=True))
    sigma = dict(zip(lens_fit.NAMES, found.lens.sigma.tolist(), strict=True))
    focal_px = value["focal_length_px"]
    optics = {
        "focal_length": f"{focal_px * base.detector.pixel_size * 1e3:.9g} mm",
        "focal_length_error": f"{100.0 * sigma['focal_length_px'] / focal_px:.3g} %",
        "principal_point": [f"{value['cx_px']:.6g} pix", f"{value['cy_px']:.6g} pix"],
        "principal_point_error": f"{max(sigma['cx_px'], sigma['cy_px']):.3g} pix",
        "distortion": [float(f"{value[name]:.9g}") for name in ("k1", "k2", "p1", "p2", "k3")],
    }
    detector = {}
    if found.psf_sigma is not None:
        optics["psf_sigma"] = f"{found.psf_sigma[0]:.4g} pix"
    if found.noise is not None and found.noise.gain is not None:
        at_0_db = found.noise.gain[0] * 10.0 ** (base.gain_db / 20.0)
        detector["conversion"] = f"{at_0_db:.5g} electron/DN"
    if found.noise is not None and found.noise.read_noise is not None:
        detector["read_noise"] = f"{found.noise.read_noise[0]:.4g} electron"
    bad = {tuple(one) for one in base.camera.params.camera.bad_pixels.tolist()}
    bad |= {tuple(one) for one in found.hot.row_column.tolist()}
    return Values(
        optics,
        detector,
        [list(one) for one in sorted(bad)],
    )


def written(found, base):
    """Text of the camera file of a Calibration and a Base."""
    new, old = values(found, base), base.tree
    camera = old["star_camera"]
    tree = {
        **old,
        "description": f"calibrated from {len(found.pictures)} pictures, {found.n_stars} stars",
        "star_camera": {
            **camera,
            "optics": {**camera["optics"], **new.optics},
            "detector": {**camera["detector"], **new.detector},
        },
        "bad_pixels": new.bad_pixels,
    }
    return HEAD + normalised(tree)
