"""Writes files of other formats (gzip, ZIP, TDMS, HDF5, MAT, BLF, MDF 3) for `recording_peer.py`: the reader
refuses each by the name of its format.
"""

import gzip
import zipfile
from pathlib import Path

from asammdf import MDF


def write_foreign_files(writer):
    plain = ("t [s],ta1 [µm/m]\n0,1\n0.002,2\n").encode()
    put = lambda name, says, data: writer.add(name, "refused", says).write_bytes(data)
    put("rec.csv.gz", "gzip", gzip.compress(plain))
    for name, inside, says in (("rec.zip", "rec.csv", "ZIP"), ("rec.xlsx", "[Content_Types].xml", "XLSX")):
        with zipfile.ZipFile(writer.add(name, "refused", says), "w") as archive:
            archive.writestr(inside, plain)
    put("rec.tdms", "npTDMS", b"TDSm\x0e\0\0\0\x69\x12\0\0" + bytes(100))
    put("rec.h5", "HDF5", b"\x89HDF\r\n\x1a\n" + bytes(100))
    put("rec.mat", "MAT v5", b"MATLAB 5.0 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\1IM" + bytes(64))
    put("rec73.mat", "MAT v7.3", b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512) + b"\x89HDF\r\n\x1a\n")
    put("rec.blf", "BLF", b"LOGG\x90\0\0\0" + bytes(140))
    put("rec.asc", "ASC", b"date Thu Nov 26 10:00:00.000 2026\nbase hex  timestamps absolute\n")
    put("rec.log", "loadtwin prove", b"(1436509052.249713) can0 501#0011223344556677\n" * 9)
    put("rec.xls", "XLS", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600))
    for version in ("3.00", "3.10", "3.20", "3.30", "2.14"):
        path = writer.add(f"mdf-{version}.mdf", "refused", "MDF 3; ")
        writer.manifest[-1]["says"] = "format MDF 3"
        mdf = MDF(version=version)
        mdf.append([writer.signal("ta1")], common_timebase=True)
        saved = mdf.save(path, overwrite=True)
        mdf.close()
        assert Path(saved) == path
