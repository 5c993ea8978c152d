"""Logs of one traffic in the formats that python-can writes, and those of can-utils: can_peer.py LOG FOLDER

LOG is that of `candump -L`. In FOLDER: one file for each format, named after it.
"""

import sys
from pathlib import Path

import can
from can.io.trc import TRCFileVersion

log, folder = sys.argv[1], Path(sys.argv[2])
messages = list(can.CanutilsLogReader(log))
for message in messages:
    message.channel = 1
is_fd = any(message.is_fd for message in messages)


def written(name, writer, those=None):
    with writer as output:
        for message in those if those is not None else messages:
            output.on_message_received(message)
    return folder / name


written("asc", can.ASCWriter(str(folder / "asc"), channel=1))
written("blf", can.BLFWriter(folder / "blf", channel=1))
written("plain.blf", can.BLFWriter(folder / "plain.blf", channel=1, compression_level=0))
written("python.log", can.CanutilsLogWriter(folder / "python.log", channel="can0"))
if not is_fd:
    for version in TRCFileVersion.V1_0, TRCFileVersion.V2_1:
        name = version.name.lower() + ".trc"
        writer = can.TRCWriter(str(folder / name), channel=1)
        writer.file_version = version
        written(name, writer)

# What candump prints, by its sources (can-utils 2025.01, lib.c: snprintf_long_canframe).
start = messages[0].timestamp


def view(message):
    width = "{:08X}" if message.is_extended_id else "{:03X}"
    length = f"[{len(message.data):02d}]" if message.is_fd else f" [{len(message.data)}]"
    data = " ".join(f"{byte:02X}" for byte in message.data)
    return f"{width.format(message.arbitration_id)}  {length}  {data}"


def lines(name, line):
    (folder / name).write_text("".join(line(message) + "\n" for message in messages))


lines("view", lambda m: f"  can0  {view(m)}")
lines("ta", lambda m: f" ({m.timestamp:.6f})  can0  {view(m)}")
lines("tz", lambda m: f" ({m.timestamp - start:010.6f})  can0  {view(m)}")
lines("x-a", lambda m: f" ({m.timestamp:.6f})  can0  RX - -  {view(m)}   '{'.' * len(m.data)}'")


def compact(message):
    return f"{message.arbitration_id:03X}" + ("##0" if message.is_fd else "#") + message.data.hex().upper()


lines("nano.log", lambda m: f"({m.timestamp:.6f}123) can0 {compact(m)}")
