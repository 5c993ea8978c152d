"""The other end of `host/tests/recording_asammdf.rs`: asammdf 8.8.28.

asammdf_peer.py read FILE    prints what asammdf finds in FILE, as JSON
asammdf_peer.py write DIR    writes the files that the test reads
"""

import json
import sys
from pathlib import Path

import numpy as np
from asammdf import MDF, Signal

ROWS = 20_000


def read(path):
    with MDF(path) as mdf:
        channels = []
        for signal in mdf.iter_channels(skip_master=True):
            invalid = signal.invalidation_bits
            invalid = [] if invalid is None else np.flatnonzero(np.asarray(invalid))
            channels.append(
                {
                    "name": signal.name,
                    "unit": signal.unit,
                    "kind": signal.samples.dtype.name,
                    "t": signal.timestamps.tolist(),
                    "values": np.nan_to_num(signal.samples).tolist(),
                    "invalid": [int(i) for i in invalid],
                }
            )
    json.dump({"version": mdf.version, "channels": channels}, sys.stdout)


def signals():
    i = np.arange(ROWS)
    t = i / 500.0
    adc = {"a": 0.25, "b": -1000.0}  # word -> µm/m
    invalid = i % 100 == 7
    return [
        Signal(((i * 31) % 8192).astype("<u2"), t, name="ta1", unit="µm/m", conversion=adc),
        Signal((i * 17 % 8192).astype("<u4"), t, name="enc", unit="counts"),
        Signal((i * 1e-3).astype("<f4"), t, name="torque", unit="kNm", invalidation_bits=invalid),
        Signal(-(i.astype("<i8")), t, name="index", unit="counts"),
    ]


def write(folder):
    for version in ("4.00", "4.10", "4.11", "4.20"):
        for compression in (0, 1, 2):
            mdf = MDF(version=version)
            # Another rate in a group of its own, with a time channel of the same name.
            slow = np.arange(0, ROWS / 500.0, 1.0)
            mdf.append([Signal(slow + 20.0, slow, name="oil", unit="degC")])
            mdf.append(signals())
            text = np.array([b"start", b"stop"])
            mdf.append([Signal(text, np.array([0.0, 1.0]), name="note", encoding="utf-8")])
            name = f"{version}-{compression}.mf4"
            mdf.save(folder / name, compression=compression, overwrite=True)
            mdf.close()


if __name__ == "__main__":
    {"read": read, "write": write}[sys.argv[1]](Path(sys.argv[2]))
