"""Frames as picture files, every grey value as it was read: PNG of 8 or 16 bits, FITS.

Nothing is stretched: 12 bits of a detector are the numbers 0 to 4095 in a picture of 16 bits.
"""

import numpy as np

from shefex_nav.files import whole

FORMATS = ("png", "fits")


def write(path, image_dn, keywords):
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
