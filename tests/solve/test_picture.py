"""Picture files of all kinds, and files that are none."""

import io

import numpy as np
import picture_files
import pytest
from PIL import Image

from shefex_nav.solve import picture
from shefex_nav.solve.picture import PictureError, read, stored


@pytest.fixture
def pixels():
    """A dark linear picture in colour, 16 bits a channel; its signal is in the lower 8."""
    rng = np.random.default_rng(1)
    return rng.normal(1000.0, 20.0, (101, 130, 3)).clip(0, 65535).astype(np.uint16)


def put(folder, name, content):
    path = folder / name
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("interlaced", [False, True])
def test_colour_png_with_16_bits(tmp_path, pixels, interlaced):
    path = put(tmp_path, "deep.png", picture_files.png(pixels, interlaced=interlaced))
    np.testing.assert_array_equal(read(path).grey, pixels.mean(axis=2, dtype=np.float32))


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("compression", [1, 5, 8])
@pytest.mark.parametrize("predictor", [1, 2])
def test_colour_tiff_with_16_bits(tmp_path, pixels, compression, predictor, order):
    content = picture_files.tiff(pixels, compression=compression, predictor=predictor, order=order)
    path = put(tmp_path, "deep.tif", content)
    np.testing.assert_array_equal(read(path).grey, pixels.mean(axis=2, dtype=np.float32))


@pytest.mark.parametrize("name", ["a.png", "a.tif"])
def test_grey_with_16_bits(tmp_path, pixels, name):
    Image.fromarray(pixels[:, :, 0]).save(tmp_path / name)
    np.testing.assert_array_equal(read(tmp_path / name).grey, pixels[:, :, 0].astype(np.float32))


def test_alpha_and_palette_and_jpeg(tmp_path, pixels):
    small = (pixels // 256 * 20).astype(np.uint8)
    small[:50] += 100
    grey = small.mean(axis=2)
    Image.fromarray(np.dstack([small, np.full(small.shape[:2], 7, np.uint8)])).save(tmp_path / "alpha.png")
    np.testing.assert_allclose(read(tmp_path / "alpha.png").grey, grey, atol=1e-4)
    Image.fromarray(small).quantize(16).save(tmp_path / "palette.png")
    Image.fromarray(small).save(tmp_path / "a.jpg", quality=95)
    for name in ("palette.png", "a.jpg"):
        assert np.abs(read(tmp_path / name).grey - grey).mean() < 3.0


@pytest.mark.parametrize("channels", [3, 4])
@pytest.mark.parametrize("kind", ["u1", "u2", ">u2", "i4", "f4", "f8"])
def test_grey_of_colours_is_their_mean(kind, channels):
    """To a rounding of float32 or two; the fourth channel is transparency."""
    values = np.random.default_rng(4).uniform(0.0, 250.0, (70, 80, channels)).astype(kind)
    values[:, :, 3:] = 255
    values[0, 0, :3] = np.iinfo(kind).max if np.dtype(kind).kind in "ui" else 1e30
    grey = picture.grey(values)
    assert grey.dtype == np.float32
    np.testing.assert_allclose(grey, values[:, :, :3].mean(axis=2, dtype=np.float64), rtol=3e-7)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("colour", [True, False])
def test_infinite_values_of_either_sign_are_refused(colour):
    values = np.ones((70, 80, 3), dtype=np.float32)
    values[3, 4, :2] = np.inf, -np.inf
    values[3, 5, 0] = -np.inf
    with pytest.raises(PictureError, match=r"^image: contains NaN or infinite values"):
        picture.grey(values if colour else values[:, :, 0])


@pytest.mark.filterwarnings("error")
def test_values_that_no_pixel_holds_are_not_called_infinite():
    values = np.ones((70, 80))
    values[3, 4] = 1e307
    with pytest.raises(PictureError, match=r"^image: contains values beyond 3\.4e\+38$"):
        picture.grey(values)


def test_date_of_the_picture(tmp_path):
    exif = Image.Exif()
    exif.get_ifd(picture.EXIF_BLOCK)[picture.EXIF_TAKEN] = "2019:07:29 20:47:26"
    image = Image.new("L", (100, 80))
    image.save(tmp_path / "a.jpg", exif=exif)
    assert abs(read(tmp_path / "a.jpg").julian_year - 2019.57) < 0.01
    image.save(tmp_path / "b.jpg")
    assert read(tmp_path / "b.jpg").julian_year is None
    exif.get_ifd(picture.EXIF_BLOCK)[picture.EXIF_TAKEN] = "0000:00:00 00:00:00"
    image.save(tmp_path / "c.jpg", exif=exif)
    assert read(tmp_path / "c.jpg").julian_year is None


def saved(image, kind, **options):
    file = io.BytesIO()
    image.save(file, kind, **options)
    return file.getvalue()


def hostile():
    """Name, content and what the message says, of files that are no picture to solve."""
    rng = np.random.default_rng(2)
    noise = Image.fromarray(rng.integers(0, 255, (120, 160), dtype=np.uint8))
    deep = rng.integers(0, 65535, (120, 160, 3), dtype=np.uint16)
    jpeg, png, tiff = saved(noise, "JPEG"), saved(noise, "PNG"), saved(noise, "TIFF")
    deep_png, deep_lzw = picture_files.png(deep), picture_files.tiff(deep, compression=5)
    size = (60_000).to_bytes(4, "big") * 2
    huge = png[:8] + picture_files.chunk(b"IHDR", size + png[24:29]) + png[33:]
    frames = [noise, noise.rotate(90.0), noise.rotate(180.0)]
    yield "empty.png", b"", "is empty"
    yield "words.jpg", b"this is a shopping list: milk, bread\n" * 20, "not a picture"
    yield "zeros.tif", bytes(5000), "not a picture"
    yield "only_magic.png", png[:8], "damaged|not a picture"
    yield "cut.jpg", jpeg[: len(jpeg) // 2], "damaged"
    yield "cut.png", png[: len(png) // 2], "damaged"
    yield "cut.tif", tiff[: len(tiff) // 2], "damaged|not a picture"
    yield "cut_deep.png", deep_png[: len(deep_png) // 2], "damaged"
    yield "cut_lzw.tif", deep_lzw[:5000] + bytes(len(deep_lzw) - 8000) + deep_lzw[-3000:], "damaged"
    yield "wrong_bytes.png", png[:60] + bytes(200) + png[260:], "damaged"
    yield "huge.png", huge, "pixels"
    for value in (np.nan, np.inf):
        one = np.full((120, 160), 10.0, dtype=np.float32)
        one[31, 40] = value
        yield f"one_{value}.tif", saved(Image.fromarray(one), "TIFF"), "contains NaN or infinite values"
    yield "tiny.png", saved(Image.new("L", (1, 1)), "PNG"), "1 x 1 pixels"
    yield "line.png", saved(Image.new("L", (5000, 3)), "PNG"), "5000 x 3 pixels"
    yield "moving.gif", saved(frames[0], "GIF", save_all=True, append_images=frames[1:]), "3 pictures"
    yield "pages.tif", saved(frames[0], "TIFF", save_all=True, append_images=frames[1:]), "3 pictures"
    yield "drawing.svg", b'<svg xmlns="http://www.w3.org/2000/svg"><circle r="5"/></svg>', "not a picture"


HOSTILE = list(hostile())


@pytest.mark.parametrize("name, content, says", HOSTILE, ids=[name for name, _, _ in HOSTILE])
def test_hostile_files_are_refused(tmp_path, name, content, says):
    path = put(tmp_path, name, content)
    with pytest.raises(PictureError, match=says) as caught:
        read(path)
    assert str(path) in str(caught.value)


def test_missing_file_and_folder(tmp_path):
    with pytest.raises(PictureError, match="no such file"):
        read(tmp_path / "nowhere.png")
    with pytest.raises(PictureError, match="is a folder"):
        read(tmp_path)


def test_a_format_that_runs_a_program_is_not_opened(tmp_path):
    """Pillow would start Ghostscript for it."""
    path = tmp_path / "picture.eps"
    Image.new("L", (80, 80)).save(path, "EPS")
    with pytest.raises(picture.PictureError, match="not a picture that can be read; expected PNG"):
        picture.read(path)


HEADS = {  # cards in the place of others of a good head: words
    ("NAXIS   =                   -1",): "NAXIS is -1; expected a whole number from 0 to 999",
    ("NAXIS   =           1000000000",): "NAXIS is 1000000000; expected",  # took all memory
    ("NAXIS   = 'two     '",): "NAXIS is 'two'; expected",
    ("NAXIS   =                    3",): "NAXIS3 is missing in a head",
    ("NAXIS1  = 'abc     '",): "NAXIS1 is 'abc'; expected a whole number of 0 or more",
    ("NAXIS1  = 9999999999999999999999",): "NAXIS1 is 9999999999999999999999; expected",
    ("NAXIS1  =                 64.5",): "NAXIS1 is 64.5; expected",
    ("NAXIS1  =                 2000",): "ends after 5760 of the 128000 bytes of its picture",
    ("NAXIS1  =   100000000000000000",): "ends after 5760 of the ",
    ("BITPIX  =                    7",): "BITPIX is 7; expected one of 8, 16, 32, 64, -32, -64",
    ("PCOUNT  =              -100000",): "PCOUNT is -100000; expected",
    ("BSCALE  = 'abc     '",): "BSCALE is 'abc'; expected a finite number",
    ("BSCALE  =                  0.0",): "BSCALE is 0, by which all values are the same; expected another",
    (
        "BLANK   =                    1",
        "BLANK   =                    2",
    ): "BLANK is there twice, as 1 and as 2",
    ("BSCALE  =                  1.0", "BSCALE  =                  2.0"): "BSCALE is there twice, as 1.0 and",
    (
        "EXPTIME =                  1.0",
        "EXPTIME =                  2.0",
    ): "EXPTIME is there twice, as 1.0 and",
    ("ZIMAGE  =                    T", "ZBITPIX = 'x'"): "ZBITPIX is 'x'; expected",
}


@pytest.mark.parametrize("cards", HEADS, ids=" ".join)
def test_a_fits_head_that_makes_no_sense_is_refused_in_words(cards, tmp_path):
    good = [
        f"{key:8}= {value:>20}"
        for key, value in (("BITPIX", 8), ("NAXIS", 2), ("NAXIS1", 64), ("NAXIS2", 64))
    ]
    replaced = [next((card for card in cards if card[:8] == one[:8]), one) for one in good]
    added = [card for card in cards if card not in replaced]

    def content(lines):
        head = "".join(f"{line:80}" for line in (f"SIMPLE  = {'T':>20}", *lines, "END")).encode()
        return head.ljust(2880) + bytes(5760)

    for more in (b"", b"\n", b"x" * 3000):  # behind the picture nobody reads
        assert read(put(tmp_path, "good.fits", content(good) + more)).grey.shape == (64, 64)
    with pytest.raises(PictureError) as caught:
        read(put(tmp_path, "bad.fits", content(replaced + added)))
    assert f"bad.fits: is no FITS picture that can be read: {HEADS[cards]}" in str(caught.value)


def test_the_number_of_axes_given_twice_is_refused(tmp_path):
    """Astropy took the second, and went through all of them for ever."""
    cards = (
        ("SIMPLE", "T"),
        ("BITPIX", 8),
        ("NAXIS", 2),
        ("NAXIS", 1000000000),
        ("NAXIS1", 64),
        ("NAXIS2", 64),
    )
    head = "".join(f"{key:8}= {value:>20}".ljust(80) for key, value in cards) + "END"
    with pytest.raises(PictureError, match="NAXIS is there twice, as 2 and as 1000000000; keep one of them"):
        read(put(tmp_path, "bad.fits", head.encode().ljust(2880) + bytes(5760)))


@pytest.mark.parametrize(
    "value, words", [("fast", "VELY: expected a number such as"), (None, "VELY: is missing")]
)
def test_a_velocity_that_cannot_be_read_is_refused(tmp_path, value, words):
    """It was left out, and the aberration with it."""
    from astropy.io import fits

    part = fits.PrimaryHDU(np.zeros((64, 64), np.uint8))
    part.header.update({"VELX": 1.0, "VELZ": 2.0, "EXPTIME": "long"} | ({"VELY": value} if value else {}))
    part.writeto(tmp_path / "bad.fits")
    with pytest.raises(PictureError, match=rf"bad\.fits: {words}"):
        read(tmp_path / "bad.fits")
    part.header["VELY"] = 3.0
    part.writeto(tmp_path / "good.fits")  # the exposure is not asked for
    assert read(tmp_path / "good.fits").velocity_i.tolist() == [1.0, 3.0, 2.0]


def test_what_follows_a_packed_picture_is_not_looked_at(tmp_path):
    from astropy.io import fits

    grey = np.arange(4096, dtype=np.int16).reshape(64, 64)
    packed = fits.HDUList([fits.PrimaryHDU(), fits.CompImageHDU(grey)])
    packed.writeto(tmp_path / "packed.fits")
    content = (tmp_path / "packed.fits").read_bytes()
    for more in (b"", b"\n", b"x" * 3000):
        assert np.array_equal(read(put(tmp_path, "more.fits", content + more)).grey, grey)


def test_a_fits_file_of_heads_alone_is_refused(tmp_path):
    """Astropy took 26 s for 60 000 of them."""

    def head(first, axes):
        cards = (f"{first:10}", f"BITPIX  = {8:>20}", *axes, "END")
        return "".join(f"{card:80}" for card in cards).encode().ljust(2880)

    empty, flat = (
        (f"NAXIS   = {0:>20}",),
        tuple(f"{k:8}= {n:>20}" for k, n in (("NAXIS", 2), ("NAXIS1", 64), ("NAXIS2", 64))),
    )
    first, other = f"SIMPLE  = {'T':>20}", "XTENSION= 'IMAGE   '"
    picture = head(other, flat) + bytes(5760)
    good = head(first, empty) + 998 * head(other, empty) + picture
    assert read(put(tmp_path, "good.fits", good)).grey.shape == (64, 64)
    with pytest.raises(PictureError, match="has no picture in its first 1000 parts"):
        read(put(tmp_path, "bad.fits", head(first, empty) + 999 * head(other, empty) + picture))


@pytest.mark.parametrize("kind", ["PNG", "GIF", "PPM", "TIFF", "WEBP", "BMP"])
def test_a_picture_that_is_cut_off_is_told_in_our_words(kind, tmp_path):
    path = tmp_path / "picture"
    values = np.random.default_rng(1).integers(0, 255, (80, 90), np.uint8)
    Image.fromarray(values).save(path, kind)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) * 2 // 3])
    with pytest.raises(picture.PictureError, match=r"picture: is cut off, .* BMP, GIF, PPM or FITS$") as told:
        picture.read(path)
    assert "Error" not in str(told.value)


def test_rows_of_a_fits_file_are_turned_as_it_says(tmp_path):
    """Its first row is the top one, unless ROWORDER says that it is the lowest."""
    from astropy.io import fits

    grey = np.random.default_rng(1).integers(0, 4000, (70, 90)).astype(np.uint16)
    for order, turned in ((None, False), ("TOP-DOWN", False), ("BOTTOM-UP", True), ("bottom-up", True)):
        part = fits.PrimaryHDU(grey[::-1] if turned else grey)
        if order:
            part.header["ROWORDER"] = order
        part.writeto(tmp_path / "rows.fits", overwrite=True)
        assert np.array_equal(read(tmp_path / "rows.fits").grey, grey)
        assert np.array_equal(stored(tmp_path / "rows.fits").values, grey)  # as cameras that are told see it


@pytest.mark.parametrize("kind", ["PrimaryHDU", "CompImageHDU"])
def test_a_fits_file_of_three_planes_is_a_picture_in_colour(tmp_path, kind):
    from astropy.io import fits

    cube = np.random.default_rng(2).integers(0, 4000, (3, 70, 90)).astype(np.int16)
    path = tmp_path / "cube.fits"
    parts = [fits.PrimaryHDU(cube)] if kind == "PrimaryHDU" else [fits.PrimaryHDU(), fits.CompImageHDU(cube)]
    fits.HDUList(parts).writeto(path)
    assert stored(path).values.shape == (70, 90, 3)
    np.testing.assert_allclose(read(path).grey, cube.mean(axis=0), rtol=1e-6)
    fits.PrimaryHDU(cube[:1]).writeto(tmp_path / "one.fits")
    np.testing.assert_array_equal(stored(tmp_path / "one.fits").values, cube[0])
    fits.PrimaryHDU(np.zeros((5, 70, 90), np.uint8)).writeto(tmp_path / "five.fits")
    with pytest.raises(PictureError, match=r"five\.fits: holds no picture: expected one of two axes"):
        read(tmp_path / "five.fits")
