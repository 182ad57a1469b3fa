"""Files that claim more than the memory holds are refused before it is full."""

import io
import zipfile
import zlib

import numpy as np
import pytest

from shefex_nav import files


def test_what_zlib_packed_is_unpacked_up_to_a_limit():
    packed = zlib.compress(b"a" * 1000)
    assert files.unpacked(packed, 1000) == b"a" * 1000
    with pytest.raises(ValueError, match="more than 999 bytes unpacked"):
        files.unpacked(packed, 999)
    with pytest.raises(ValueError, match="cut off"):
        files.unpacked(packed[:-2], 1000)
    with pytest.raises(zlib.error):
        files.unpacked(b"junk", 1000)


def npy(shape):
    """Bytes of an .npy file that claims a shape and has no numbers."""
    out = io.BytesIO()
    np.lib.format.write_array_header_1_0(out, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return out.getvalue()


def test_arrays_larger_than_the_limit_are_refused(monkeypatch):
    file = io.BytesIO()
    np.savez_compressed(file, a=np.zeros(100_000))
    assert files.arrays_of(io.BytesIO(file.getvalue()))["a"].shape == (100_000,)
    monkeypatch.setattr(files, "LARGEST_ARRAYS", 1 << 10)
    with pytest.raises(ValueError, match="GiB of arrays"):
        files.arrays_of(io.BytesIO(file.getvalue()))


def test_an_array_that_claims_a_size_it_does_not_have_is_refused():
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("a.npy", npy((1 << 50,)))
    with pytest.raises(files.UNREADABLE):
        files.arrays_of(io.BytesIO(file.getvalue()))
