"""Writes an unsorted MDF4 file, block by block: asammdf writes none."""

import struct
import zlib

import numpy as np


def block(name, links, data):
    size = 24 + 8 * len(links) + len(data)
    return struct.pack("<4s4xQQ", name, size, len(links)) + struct.pack(f"<{len(links)}Q", *links) + data


def zipped(part, width):
    """A compressed data block: deflate, of bytes transposed in so many columns where `width` is not 0."""
    whole = len(part) // width * width if width else 0
    table = np.frombuffer(part[:whole], "u1").reshape(-1, max(width, 1)).T.tobytes() + part[whole:]
    packed = zlib.compress(table)
    return block(b"##DZ", [], struct.pack("<2sBxIQQ", b"DT", int(width > 0), width, len(part), len(packed)) + packed)


def unsorted_mdf(groups, split=None, width=None, id_size=1):
    """Records of all groups in the order of time, each behind the number of its group: MDF 4.10.

    With `split` in data blocks of so many bytes, wherever a record ends; with `width` these are
    compressed, see `zipped`.
    """
    out = bytearray(64 + 104)

    def put(data):
        out.extend(bytes(-len(out) % 8))
        at = len(out)
        out.extend(data)
        return at

    def text(words):
        words = words.encode() + b"\0"
        return put(block(b"##TX", [], words + bytes(-len(words) % 8)))

    def channel(following, name, unit, at, master):
        kind = struct.pack("<BBBBIIIIBxH6d", 2 if master else 0, int(master), 4, 0, at, 64, 0, 0, 0, 0, *[0.0] * 6)
        return put(block(b"##CN", [following, 0, text(name), 0, 0, 0, text(unit), 0], kind))

    first = 0
    for number in range(len(groups), 0, -1):
        t, columns = groups[number - 1]
        following = 0
        named = [("time", "s"), *((name, unit) for name, (_, unit) in columns.items())]
        for k in range(len(named) - 1, -1, -1):
            following = channel(following, *named[k], 8 * k, k == 0)
        counts = struct.pack("<QQHH4xII", number, len(t), 0, 0, 8 * len(named), 0)
        first = put(block(b"##CG", [first, following, 0, 0, 0, 0], counts))
    records = []
    for number, (t, columns) in enumerate(groups, 1):
        table = np.column_stack([t, *(values for values, _ in columns.values())])
        records += [(row[0], number, row) for row in table]
    records.sort(key=lambda record: record[:2])
    stream = b"".join(number.to_bytes(id_size, "little") + row.astype("<f8").tobytes() for _, number, row in records)
    parts = [stream[at:at + (split or len(stream))] for at in range(0, len(stream), split or len(stream))]
    stored = [put(block(b"##DT", [], part) if width is None else zipped(part, width)) for part in parts]
    data = stored[0]
    if split:
        starts = [split * k for k in range(len(parts))]
        flags = struct.pack("<B3xI", 0, len(parts)) + struct.pack(f"<{len(parts)}Q", *starts)
        data = put(block(b"##DL", [0, *stored], flags))
        if width is not None:
            data = put(block(b"##HL", [data], struct.pack("<HB5x", 0, int(width > 0))))
    group = put(block(b"##DG", [0, first, data, 0], struct.pack("<B7x", id_size)))
    history = put(block(b"##FH", [0, put(block(b"##MD", [], b"<FHcomment><TX/></FHcomment>\0\0\0\0"))],
                        struct.pack("<QhhB3x", 0, 0, 0, 0)))
    out[:64] = struct.pack("<8s8s8s4xH30xHH", b"MDF     ", b"4.10    ", b"loadtwin", 410, 0, 0)
    head = struct.pack("<QhhBBBxdd", 0, 0, 0, 0, 0, 0, 0.0, 0.0)
    out[64:168] = block(b"##HD", [group, history, 0, 0, 0, 0], head)
    return bytes(out)
