"""Pictures in colour with 16 bits a channel, of which Pillow keeps only the upper 8.

In: an opened PNG or TIFF. Out: all its bits. PNG: W3C "Portable Network Graphics (PNG) Specification", 3rd
ed., sections 7 to 10. TIFF: Adobe "TIFF Revision 6.0", sections 8, 13 and 14; strips with interleaved
channels, not compressed, by LZW or by deflate.
"""

import struct
import zlib

import numpy as np

from shefex_nav.compiled import kernel

# start row, start column, row step, column step of the passes of an interlaced PNG
PASSES = ((0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2), (0, 1, 2, 2), (1, 0, 2, 1))
PNG_CHANNELS = {2: 3, 4: 2, 6: 4}  # by colour type; grey (0) is left to Pillow
WIDTH, HEIGHT = 256, 257
BITS, COMPRESSION, STRIPS, SAMPLES, ROWS_PER_STRIP, LENGTHS = 258, 259, 273, 277, 278, 279
INTERLEAVED, PREDICTOR, TILES, FORMAT = 284, 317, 324, 339
NONE, LZW, DEFLATE, OLD_DEFLATE = 1, 5, 8, 32946
CLEAR, END, FIRST, LARGEST = 256, 257, 258, 4096  # codes of LZW


def read(path, image):
    """All bits of a 16-bit picture in colour, (rows, columns, channels) uint16; None if it is none.

    path : of the file; image : the same, opened by Pillow. Errors: ValueError, zlib.error, struct.error.
    """
    if image.format == "PNG":
        return _png(path.read_bytes())
    if image.format == "TIFF":
        bits = image.tag_v2.get(BITS, (1,))
        if len(bits) > 1 and set(bits) == {16}:
            return _tiff(path.read_bytes(), image)
    return None


def _png(data):
    """Pixels of a PNG with 16 bits and several channels, else None."""
    width, height, depth, colour, _, _, interlaced = struct.unpack(">IIBBBBB", data[16:29])
    if depth != 16 or colour not in PNG_CHANNELS:
        return None
    channels = PNG_CHANNELS[colour]
    passes = PASSES if interlaced else ((0, 0, 1, 1),)
    shapes = [(-(-(height - r) // dr), -(-(width - c) // dc)) for r, c, dr, dc in passes]
    sizes = [rows * (1 + 2 * channels * columns) if columns > 0 else 0 for rows, columns in shapes]
    stream = _inflate(b"".join(_chunks(data, b"IDAT")), sum(sizes))
    pixels = np.zeros((height, width, channels), dtype=np.uint16)
    begin = 0
    for (r, c, dr, dc), (rows, columns), size in zip(passes, shapes, sizes, strict=True):
        if size > 0:
            lines = np.frombuffer(stream, np.uint8, size, begin).reshape(rows, -1).copy()
            if not unfilter(lines, 2 * channels):
                raise ValueError("unknown filter of a PNG")
            values = np.ascontiguousarray(lines[:, 1:]).view(">u2")
            pixels[r::dr, c::dc] = values.reshape(rows, columns, channels)
        begin += size
    return pixels


def _chunks(data, wanted):
    """Contents of the chunks of one kind."""
    at = 8
    while at + 12 <= len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        kind, content = data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        if len(content) < length:
            raise ValueError("the file ends early")
        if kind == wanted:
            yield content
        at += 12 + length


def _inflate(packed, size):
    """Exactly `size` bytes of a deflated stream."""
    stream = zlib.decompressobj().decompress(packed, size)
    if len(stream) < size:
        raise ValueError("the file ends early")
    return stream[:size]


@kernel
def unfilter(lines, step):
    """Undo the filters of PNG in place: each line begins with its filter; False for an unknown one."""
    rows, length = lines.shape
    for r in range(rows):
        kind = lines[r, 0]
        if kind > 4:
            return False
        for k in range(1, length):
            left = np.int64(lines[r, k - step]) if k > step else 0
            up = np.int64(lines[r - 1, k]) if r > 0 else 0
            corner = np.int64(lines[r - 1, k - step]) if r > 0 and k > step else 0
            if kind == 1:
                guess = left
            elif kind == 2:
                guess = up
            elif kind == 3:
                guess = (left + up) // 2
            elif kind == 4:  # Paeth: the one nearest to left + up - corner
                p, q, s = abs(up - corner), abs(left - corner), abs(left + up - 2 * corner)
                guess = left if p <= q and p <= s else (up if q <= s else corner)
            else:
                guess = 0
            lines[r, k] = (np.int64(lines[r, k]) + guess) & 255
    return True


def _tiff(data, image):
    """Pixels of a TIFF whose channels all have 16 bits."""
    tags = image.tag_v2
    width, height = int(tags[WIDTH]), int(tags[HEIGHT])  # as stored; Pillow's size is as displayed
    channels, compression = int(tags[SAMPLES]), int(tags.get(COMPRESSION, NONE))
    formats = set(np.atleast_1d(tags.get(FORMAT, 1)).tolist())
    odd = tags.get(INTERLEAVED, 1) != 1 or TILES in tags or formats != {1}
    if odd or compression not in (NONE, LZW, DEFLATE, OLD_DEFLATE):
        raise ValueError("16-bit colour: expected strips of interleaved integers, plain, LZW or deflate")
    per_strip = min(int(tags.get(ROWS_PER_STRIP, height)), height)
    pixels = np.zeros((height, width, channels), dtype=np.uint16)
    order = ">u2" if data[:2] == b"MM" else "<u2"
    for k, (begin, length) in enumerate(zip(tags[STRIPS], tags[LENGTHS], strict=True)):
        rows = min(per_strip, height - k * per_strip)
        size, packed = 2 * rows * width * channels, data[begin : begin + length]
        if compression == LZW:
            strip, n = unpack_lzw(np.frombuffer(packed, np.uint8), size)
            strip = strip.tobytes() if n == size else b""
        else:
            strip = packed[:size] if compression == NONE else _inflate(packed, size)
        if len(strip) < size:
            raise ValueError("the file ends early")
        values = np.frombuffer(strip, order).reshape(rows, width, channels).astype(np.uint16)
        if tags.get(PREDICTOR, 1) == 2:  # differences to the pixel on the left
            values = np.cumsum(values, axis=1, dtype=np.uint16)
        pixels[k * per_strip : k * per_strip + rows] = values
    return pixels


@kernel
def unpack_lzw(packed, size):
    """LZW as TIFF has it: codes of 9 to 12 bits, highest bit first. -> (size,) uint8, how many were found."""
    out = np.zeros(size, dtype=np.uint8)
    # each code is a piece of what has been written: where it begins and how long it is
    begin, length = np.zeros(LARGEST, dtype=np.int64), np.zeros(LARGEST, dtype=np.int64)
    n, next_code, bits, before = 0, FIRST, 9, -1
    held, n_held = 0, 0
    last_begin, last_length = 0, 0
    for byte in packed:
        held = ((held << 8) | byte) & 0xFFFFFF
        n_held += 8
        if n_held < bits:
            continue
        n_held -= bits
        code = (held >> n_held) & ((1 << bits) - 1)
        if code == END or n == size:
            break
        if code == CLEAR:
            next_code, bits, before = FIRST, 9, -1
            continue
        at = n
        if code < CLEAR:
            out[n] = code
            n += 1
        else:
            if code > next_code or (code == next_code and before < 0):
                break  # no such code: damaged
            known = code < next_code
            start = begin[code] if known else last_begin
            count = length[code] if known else last_length + 1
            for k in range(min(count, size - n)):  # a piece may reach into itself
                out[n] = out[start + k]
                n += 1
        if before >= 0 and next_code < LARGEST:
            begin[next_code], length[next_code] = last_begin, last_length + 1
            next_code += 1
        last_begin, last_length, before = at, n - at, code
        if next_code + 1 >= 1 << bits and bits < 12:
            bits += 1
    return out, n
