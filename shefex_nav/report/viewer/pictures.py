"""Pictures of more than eight bits as the viewer can show them.

The log has the grey values as measured. The viewer takes 16-bit pictures to be bright at 65535, whatever the
camera's range, and can be told of no other; twelve bits of a sky would be black. So their grey values are
mapped to eight bits for the recording: the same ones over the whole recording, that pictures can be compared.
"""

import numpy as np

BELOW_SIGMA, ABOVE_SIGMA = 3.0, 20.0  # of the sky's noise about its level: black and white; streaks are faint
_U16, _U8 = 8, 6  # rerun's numbers of the two kinds of pixels


def grey_of_sky(image_dn):
    """Grey value, 0 to 255, of every 16-bit value: from a little below the sky to well above its noise.

    image_dn : (n,) uint16, pixels of a frame as read out. Returns (65536,) uint8.
    """
    level = float(np.median(image_dn))
    sigma = max(1.4826 * float(np.median(np.abs(image_dn.astype(float) - level))), 1.0)  # normal noise
    return _ramp(level - BELOW_SIGMA * sigma, level + ABOVE_SIGMA * sigma)


def grey_of_bits(bits):
    """The same over the whole range of a camera, where no frame was kept as read out."""
    return _ramp(0.0, 2.0**bits - 1.0)


def _ramp(black, white):
    values = 255.0 * (np.arange(65536) - black) / (white - black)
    return np.rint(np.clip(values, 0.0, 255.0)).astype(np.uint8)


def is_wide(batch):
    """Whether a record batch of rerun holds 16-bit pictures."""
    if "Image:format" not in batch.schema.names:
        return False
    formats = [row[0] for row in batch.column("Image:format").to_pylist() if row]
    return bool(formats) and all(one["channel_datatype"] == _U16 for one in formats)


def values(batch):
    """Pixels of all pictures of a batch, one after the other: (n,) uint16."""
    bytes_ = batch.column("Image:buffer").flatten().flatten().to_numpy(zero_copy_only=False)
    return np.ascontiguousarray(bytes_).view("<u2")


def _offsets(lengths):
    """Where each of some lists begins, and the end of the last one: int32, as Arrow has it."""
    return np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)


def narrowed(batch, grey):
    """The batch with eight bits a pixel by a table of `grey_of_sky` or `grey_of_bits`."""
    import pyarrow as pa

    k = batch.schema.get_field_index("Image:buffer")
    outer = batch.column(k)
    pictures = outer.flatten()
    ends = pa.array(_offsets(pictures.value_lengths().to_numpy() // 2))
    inner = pa.ListArray.from_arrays(ends, pa.array(grey[values(batch)]), type=outer.type.value_type)
    rows = pa.array(_offsets(outer.value_lengths().fill_null(0).to_numpy()))
    batch = batch.set_column(k, batch.schema.field(k), pa.ListArray.from_arrays(rows, inner, type=outer.type))
    k = batch.schema.get_field_index("Image:format")
    formats = [
        None if row is None else [{**one, "channel_datatype": _U8} for one in row]
        for row in batch.column(k).to_pylist()
    ]
    return batch.set_column(k, batch.schema.field(k), pa.array(formats, type=batch.schema.field(k).type))
