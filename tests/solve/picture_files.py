"""Picture files with 16 bits a channel in colour, written by hand: Pillow writes none."""

import struct
import zlib

import numpy as np


def png(pixels, *, filters=(0, 1, 2, 3, 4), interlaced=False):
    """PNG of (rows, columns, channels) uint16, its lines filtered in turn."""
    rows, columns, channels = pixels.shape
    parts = [pixels]
    if interlaced:
        steps = (
            (0, 0, 8, 8),
            (0, 4, 8, 8),
            (4, 0, 8, 4),
            (0, 2, 4, 4),
            (2, 0, 4, 2),
            (0, 1, 2, 2),
            (1, 0, 2, 1),
        )
        parts = [pixels[r::dr, c::dc] for r, c, dr, dc in steps]
    raw = b"".join(filtered(part, filters) for part in parts if part.shape[1] > 0)
    colour = {2: 4, 3: 2, 4: 6}[channels]
    head = struct.pack(">IIBBBBB", columns, rows, 16, colour, 0, 0, int(interlaced))
    packed = zlib.compress(raw)
    half = len(packed) // 2
    chunks = chunk(b"IHDR", head) + chunk(b"IDAT", packed[:half]) + chunk(b"IDAT", packed[half:])
    return b"\x89PNG\r\n\x1a\n" + chunks + chunk(b"IEND", b"")


def chunk(kind, content):
    """One chunk of a PNG."""
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def filtered(pixels, filters):
    """Lines with their filters, as the specification defines them, one after the other."""
    step = 2 * pixels.shape[2]
    before = np.zeros(step + pixels.shape[1] * step, dtype=int)
    out = b""
    for k, row in enumerate(pixels):
        kind = filters[k % len(filters)]
        line = np.concatenate(
            [np.zeros(step, dtype=int), np.frombuffer(row.astype(">u2").tobytes(), np.uint8)]
        )
        left, up, corner = line[:-step], before[step:], before[:-step]
        p = np.stack([np.abs(up - corner), np.abs(left - corner), np.abs(left + up - 2 * corner)])
        paeth = np.choose(
            p.argmin(axis=0), [left, up, corner]
        )  # argmin takes the first of equals, as PNG does
        guess = (np.zeros_like(left), left, up, (left + up) // 2, paeth)[kind]
        out += bytes([kind]) + ((line[step:] - guess) % 256).astype(np.uint8).tobytes()
        before = line
    return out


def tiff(pixels, *, compression=1, predictor=1, rows_per_strip=50, order="<", orientation=1):
    """TIFF of (rows, columns, channels) uint16."""
    rows, columns, channels = pixels.shape
    strips = []
    for first in range(0, rows, rows_per_strip):
        part = pixels[first : first + rows_per_strip]
        if predictor == 2:
            part = np.concatenate([part[:, :1], np.diff(part, axis=1)], axis=1)  # wraps as uint16 does
        raw = part.astype(f"{order}u2").tobytes()
        strips.append({1: lambda b: b, 5: lzw, 8: zlib.compress}[compression](raw))
    at, offsets, n = 8, [], len(strips)
    for strip in strips:
        offsets.append(at)
        at += len(strip)
    body = b"".join(strips) + b"\0" * (at % 2)
    at += at % 2
    longs = b"".join(struct.pack(f"{order}{n}I", *values) for values in (offsets, [len(s) for s in strips]))
    bits = struct.pack(f"{order}{channels}H", *[16] * channels)
    entries = [
        (256, 4, 1, columns), (257, 4, 1, rows), (258, 3, channels, at + 8 * n), (259, 3, 1, compression),
        (262, 3, 1, 2),
        (273, 4, n, at if n > 1 else offsets[0]), (274, 3, 1, orientation), (277, 3, 1, channels),
        (278, 4, 1, rows_per_strip), (279, 4, n, at + 4 * n if n > 1 else len(strips[0])), (284, 3, 1, 1),
        (317, 3, 1, predictor),
    ]  # fmt: skip
    table = struct.pack(f"{order}H", len(entries))
    for tag, kind, count, value in entries:
        inline = f"{order}HHIHH" if kind == 3 and count == 1 else f"{order}HHII"
        table += struct.pack(
            inline, tag, kind, count, *((value, 0) if kind == 3 and count == 1 else (value,))
        )
    where = at + len(longs) + len(bits)
    head = (b"II" if order == "<" else b"MM") + struct.pack(f"{order}HI", 42, where)
    return head + body + longs + bits + table + struct.pack(f"{order}I", 0)


def lzw(data):
    """LZW of TIFF: codes of 9 to 12 bits, highest bit first."""
    codes, bits, n_bits, out = {}, 0, 0, bytearray()
    width, piece = 9, b""

    def put(code):
        nonlocal bits, n_bits
        bits, n_bits = (bits << width) | code, n_bits + width
        while n_bits >= 8:
            n_bits -= 8
            out.append((bits >> n_bits) & 255)
        bits &= (1 << n_bits) - 1

    def code_of(piece):
        return piece[0] if len(piece) == 1 else codes[piece]

    put(256)
    for k in range(len(data)):
        longer = piece + data[k : k + 1]
        if len(longer) == 1 or longer in codes:
            piece = longer
            continue
        put(code_of(piece))
        codes[longer] = 258 + len(codes)
        piece = data[k : k + 1]
        if len(codes) + 258 == 4094:
            put(256)
            codes, width = {}, 9
        elif len(codes) + 258 > (1 << width) - 1:
            width += 1
    put(code_of(piece))
    put(257)
    if n_bits:
        out.append((bits << (8 - n_bits)) & 255)
    return bytes(out)
