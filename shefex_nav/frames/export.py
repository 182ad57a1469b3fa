"""A folder of frames: pictures, their truth, the camera.

PICTURES frame_000001.png or .fits, in the order of their numbers; `truth.csv`; `camera.yaml`, the camera as
the flight software knows it; `camera_true.yaml`, as it is in this run. In a picture every grey value is as it
was read, PNG of 8 or 16 bits, FITS; nothing is stretched: 12 bits of a detector are the numbers 0 to 4095 in
a picture of 16 bits.
"""

import numpy as np

from shefex_nav.files import put, whole
from shefex_nav.frames import camera_file, header, truth

FORMATS = ("png", "fits")
TRUTH, TOLD, TRUE = "truth.csv", "camera.yaml", "camera_true.yaml"


def write_picture(path, image_dn, keywords):
    """Write a new file of grey values (rows, columns) uint8 or uint16; its ending says the format.

    keywords : {keyword: (value, comment)}
    """
    with whole(path) as half:
        {".png": _png, ".fits": _fits}[path.suffix](half, image_dn, keywords)


def _png(path, image_dn, keywords):
    from PIL import Image, PngImagePlugin

    texts = PngImagePlugin.PngInfo()
    for key, (value, _) in keywords.items():
        texts.add_text(key, value if isinstance(value, str) else repr(value))
    Image.fromarray(np.ascontiguousarray(image_dn)).save(path, "PNG", pnginfo=texts)


def _fits(path, image_dn, keywords):
    from astropy.io import fits

    plane = fits.PrimaryHDU(image_dn)
    plane.header["ROWORDER"] = ("TOP-DOWN", "the first row of the file is the top one")
    for key, (value, comment) in keywords.items():
        plane.header[key] = (value, comment)
    plane.writeto(path, overwrite=True)


def write(folder, flight, shots, kind="png"):
    """Write Shots of a Flight into a folder, which is there, one after the other.

    kind : of FORMATS

    Yields
    ------
    Shot, each when its file is written; truth and cameras are written at the end, of an early end too
    """
    scenario, mission = flight.scenario, flight.scenario.mission
    camera, rows = camera_file.true_lens(scenario, flight.world), []
    try:
        for shot in shots:
            if not rows:
                _take_away(folder)
            name = f"frame_{shot.frame.number:06d}.{kind}"
            told = header.keywords(shot, mission, flight.seed) | header.angles(shot.truth.q_ic, camera)
            if kind == "fits":
                told |= header.wcs(shot.truth.q_ic, camera)
            write_picture(folder / name, shot.frame.image_dn, told)
            rows.append(truth.row(name, shot, mission.epoch))
            yield shot
    finally:  # of an export that ends early, what there is has its truth
        if rows:
            truth.write(folder / TRUTH, rows)
            for name, true in ((TOLD, False), (TRUE, True)):
                text = camera_file.written(scenario, flight.world, true=true)
                put(folder / name, text)


def _take_away(folder):
    """Frames of an earlier export: those of another flight would have no truth."""
    for ending in FORMATS:
        for name in folder.glob(f"frame_*.{ending}"):
            name.unlink()
