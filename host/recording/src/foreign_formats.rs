//! Recognises file formats that are not read (MATLAB, HDF5, XLSX, CAN logs, archives, ...) by the
//! first bytes of a file (`recognise`), and returns name and advice on the conversion for the error
//! message.

/// Bytes of a file that are looked at.
pub(super) const HEAD: usize = 1024;

/// A format that is not read.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Foreign {
    /// Its name.
    pub(super) name: &'static str,
    /// What makes a recording of it.
    pub(super) remedy: &'static str,
}

/// Advice for archives whose tool is not known.
const UNPACK: &str = "unpack it first";

/// Advice for logs of CAN buses.
const CAN_LOG: &str = "recompute its frames with `loadtwin prove MACHINE LOG`, or decode it to MDF4 with \
     asammdf and the bus's DBC file";

/// Advice for files of MATLAB.
const MATLAB: &str = "write CSV or Parquet in MATLAB: `writetable(table(t, ta1), 'out.csv')` or \
     `parquetwrite`";

/// Advice for spreadsheets.
const SPREADSHEET: &str = "save the sheet as CSV";

/// Formats and how they begin: offset and bytes.
const MAGIC: &[(usize, &[u8], &str, &str)] = &[
    (
        0,
        b"TDSm",
        "TDMS (LabVIEW)",
        "write Parquet with npTDMS: \
         `TdmsFile(\"in.tdms\")[\"GROUP\"].as_dataframe(time_index=True).to_parquet(\"out.parquet\")`",
    ),
    (0, b"MATLAB 7.3 MAT-file", "MAT v7.3 (MATLAB)", MATLAB),
    (0, b"MATLAB 5.0 MAT-file", "MAT v5 (MATLAB)", MATLAB),
    (
        0,
        b"\x89HDF\r\n\x1a\n",
        "HDF5",
        "write Parquet with pandas or h5py: `pandas.read_hdf(\"in.h5\").to_parquet(\"out.parquet\")`",
    ),
    (
        512,
        b"\x89HDF\r\n\x1a\n",
        "HDF5",
        "write Parquet with pandas or h5py",
    ),
    (0, b"LOGG", "BLF (Vector)", CAN_LOG),
    (0, b";$FILEVERSION", "TRC (PEAK)", CAN_LOG),
    (
        0,
        b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1",
        "XLS (Excel)",
        SPREADSHEET,
    ),
    (0, b"\x1f\x8b", "gzip", "unpack it first: `gunzip FILE`"),
    (
        0,
        b"\x28\xb5\x2f\xfd",
        "Zstandard",
        "unpack it first: `unzstd FILE`",
    ),
    (0, b"BZh", "bzip2", "unpack it first: `bunzip2 FILE`"),
    (0, b"\xfd7zXZ\0", "xz", "unpack it first: `unxz FILE`"),
    (0, b"7z\xbc\xaf\x27\x1c", "7-Zip", UNPACK),
    (0, b"Rar!\x1a\x07", "RAR", UNPACK),
    (257, b"ustar", "tar", UNPACK),
    (
        0,
        b"ARROW1",
        "Arrow IPC (Feather)",
        "write Parquet: `pandas.read_feather(\"in.feather\").to_parquet(\"out.parquet\")`",
    ),
    (0, b"\x93NUMPY", "NumPy", "write CSV or Parquet with pandas"),
    (
        0,
        b"CDF\x01",
        "netCDF",
        "write Parquet with xarray and pandas",
    ),
    (
        0,
        b"CDF\x02",
        "netCDF",
        "write Parquet with xarray and pandas",
    ),
    (0, b"ORC", "ORC", "write Parquet with pyarrow"),
    (
        0,
        b"SQLite format 3\0",
        "SQLite",
        "export the table as CSV: `sqlite3 -header -csv FILE \"SELECT ...\"`",
    ),
    (0, b"|CF,", "imc FAMOS", "export it as CSV or MDF4 in FAMOS"),
    (
        0,
        b"RIFF",
        "WAV",
        "write CSV or Parquet with scipy and pandas",
    ),
    (
        0,
        b"%PDF",
        "PDF",
        "give the recording itself: CSV, Parquet or MDF4",
    ),
    (0, b"{\\rtf", "RTF", "save it as plain text"),
];

/// The format of a file that begins with `head`, where it is one that is not read.
pub(super) fn recognise(head: &[u8]) -> Option<Foreign> {
    let known = MAGIC
        .iter()
        .find(|(at, magic, ..)| head.get(*at..).is_some_and(|rest| rest.starts_with(magic)));
    if let Some(&(_, _, name, remedy)) = known {
        return Some(Foreign { name, remedy });
    }
    if head.starts_with(b"PK\x03\x04") {
        return Some(archive(head));
    }
    if is_old_mdf(head) {
        return Some(Foreign {
            name: "MDF 3",
            remedy: "convert it to MDF4 with asammdf: \
                     `MDF(\"in.mdf\").convert(\"4.10\").save(\"out.mf4\")`",
        });
    }
    text(head)
}

/// What a ZIP archive holds, by the name of its first file.
fn archive(head: &[u8]) -> Foreign {
    let holds = |name: &[u8]| memchr::memmem::find(head, name).is_some();
    if holds(b"[Content_Types].xml") || holds(b"xl/") || holds(b"docProps/") {
        Foreign {
            name: "XLSX (Excel)",
            remedy: SPREADSHEET,
        }
    } else if holds(b"application/vnd.oasis.opendocument.spreadsheet") {
        Foreign {
            name: "ODS (LibreOffice)",
            remedy: SPREADSHEET,
        }
    } else {
        Foreign {
            name: "ZIP",
            remedy: "unpack it first: `unzip FILE`",
        }
    }
}

/// Whether it is an MDF before version 4: the version is text at byte 8.
fn is_old_mdf(head: &[u8]) -> bool {
    let is_mdf = head.starts_with(b"MDF ") || head.starts_with(b"UnFinMF ");
    is_mdf && matches!(head.get(8), Some(b'2' | b'3'))
}

/// Formats of text that are no tables.
fn text(head: &[u8]) -> Option<Foreign> {
    let start = head.trim_ascii_start();
    if is_asc(start) {
        return Some(Foreign {
            name: "ASC (Vector)",
            remedy: CAN_LOG,
        });
    }
    if is_candump(start) {
        return Some(Foreign {
            name: "candump log",
            remedy: CAN_LOG,
        });
    }
    if start.starts_with(b"<?xml") && memchr::memmem::find(head, b"tdm").is_some() {
        return Some(Foreign {
            name: "TDM (DIAdem)",
            remedy: "export it as CSV in DIAdem",
        });
    }
    let is_uff = head.starts_with(b"    -1") && memchr::memmem::find(head, b"    58").is_some();
    is_uff.then_some(Foreign {
        name: "UFF 58",
        remedy: "write Parquet with pyuff and pandas",
    })
}

/// An ASC log begins with its date, then the base of its numbers.
fn is_asc(start: &[u8]) -> bool {
    let has = |what: &[u8]| memchr::memmem::find(start, what).is_some();
    start.starts_with(b"date ") && (has(b"base hex") || has(b"base dec"))
}

/// `(1436509052.249713) can0 501#0011`, or the same without the bus' syntax of `candump -L`.
fn is_candump(start: &[u8]) -> bool {
    let line = start.split(|&b| b == b'\n').next().unwrap_or(start);
    let Some(end) = memchr::memchr(b')', line).filter(|_| line.starts_with(b"(")) else {
        return false;
    };
    let stamp = &line[1..end];
    !stamp.is_empty()
        && stamp.iter().all(|b| b.is_ascii_digit() || *b == b'.')
        && (line.contains(&b'#') || line.contains(&b'['))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_format_by_its_name() {
        let mut mat = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".to_vec();
        mat.resize(512, b' ');
        mat.extend(b"\x89HDF\r\n\x1a\n");
        let mut user_block = vec![0; 512];
        user_block.extend(b"\x89HDF\r\n\x1a\n");
        for (head, name) in [
            (&b"TDSm\x0e\0\0\0"[..], "TDMS (LabVIEW)"),
            (&mat, "MAT v7.3 (MATLAB)"),
            (&user_block, "HDF5"),
            (b"\x89HDF\r\n\x1a\n\0", "HDF5"),
            (b"MATLAB 5.0 MAT-file, Platform", "MAT v5 (MATLAB)"),
            (b"LOGG\x90\0\0\0", "BLF (Vector)"),
            (
                b"date Thu Nov 26 10:00:00 2026\nbase hex  timestamps absolute\n",
                "ASC (Vector)",
            ),
            (
                b"PK\x03\x04\x14\0\x06\0\x08\0\0\0!\0...[Content_Types].xml",
                "XLSX (Excel)",
            ),
            (b"PK\x03\x04\x14\0\0\0\x08\0\0\0!\0...rec.csv", "ZIP"),
            (b"MDF     3.30    ", "MDF 3"),
            (b"MDF     2.14    ", "MDF 3"),
            (b"\x1f\x8b\x08\0", "gzip"),
            (b"(1436509052.249713) can0 501#00", "candump log"),
            (
                b" (1436509052.249713)  can0  501   [2]  00 11",
                "candump log",
            ),
        ] {
            assert_eq!(recognise(head).map(|f| f.name), Some(name));
        }
        for head in [
            &b"PAR1"[..],
            b"MDF     4.10    ",
            b"UnFinMF 4.10    ",
            b"t [s],ta1 [m/m]\n0,1\n",
            b"date,value\n",
            b"(t),x\n0,1\n",
            b"",
        ] {
            assert_eq!(recognise(head), None);
        }
    }
}
