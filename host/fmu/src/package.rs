//! Packs an FMU (`pack`): a zip archive of model description, shared library and resources, as
//! bytes, for FMI 3.0 or 2.0. `FMU` recognises a file that was written so.

use std::io::{self, Cursor, Write};

use loadtwin_files::file_kind::FileKind;
use thiserror::Error;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use crate::interface::Interface;
use crate::library::{IDENTIFIER, Library, Platform};
use crate::model_description;
use crate::resources::{IMAGE, INTERFACE, Resources};

/// What is written as an FMU. The model description comes first and is not compressed.
pub const FMU: FileKind = FileKind {
    noun: "FMU",
    suffixes: &["fmu"],
    is_same: |file| {
        let is_zip = file.start().starts_with(b"PK\x03\x04");
        Ok(is_zip && file.contains(&["modelDescription.xml", "generationTool=\"loadtwin "])?)
    },
};

/// Version of the standard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FmiVersion {
    /// 3.0
    V3,
    /// 2.0
    V2,
}

impl FmiVersion {
    /// As the standard writes it.
    pub fn name(self) -> &'static str {
        match self {
            Self::V3 => "3.0",
            Self::V2 => "2.0",
        }
    }

    /// Folder of a platform's library.
    fn folder(self, platform: Platform) -> &'static str {
        match (self, platform) {
            (Self::V3, Platform::X86) => "x86_64-linux",
            (Self::V2, Platform::X86) => "linux64",
            (_, Platform::Arm) => "aarch64-linux",
        }
    }
}

/// Why there is no FMU.
#[derive(Debug, Error)]
pub enum PackageError {
    /// A name of the machine has no TOML.
    #[error("the description of the inputs cannot be written: {0}")]
    Interface(#[from] toml::ser::Error),
    /// A text of the machine has no XML.
    #[error("the model description cannot be written: {0}")]
    Description(#[from] io::Error),
    /// A file is larger than an archive holds.
    #[error("the archive cannot be written: {0}")]
    Archive(#[from] zip::result::ZipError),
}

/// The FMU of a machine with the sealed model image `image`, as bytes.
///
/// # Errors
/// [`PackageError`].
pub fn pack(
    interface: &Interface,
    image: &[u8],
    library: &Library,
    version: FmiVersion,
) -> Result<Vec<u8>, PackageError> {
    let resources = Resources {
        image: image.to_vec(),
        interface: interface.to_toml()?,
    };
    let description = model_description::xml(interface, &resources.token(), version)?;
    let folder = version.folder(library.platform);
    let binary = format!("binaries/{folder}/{IDENTIFIER}.so");
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    let stored = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    let deflated = stored.compression_method(CompressionMethod::Deflated);
    let program = deflated.unix_permissions(0o755);
    let files: [(&str, &[u8], _); 4] = [
        ("modelDescription.xml", &description, stored),
        (&binary, &library.bytes, program),
        (&format!("resources/{IMAGE}"), &resources.image, deflated),
        (
            &format!("resources/{INTERFACE}"),
            resources.interface.as_bytes(),
            deflated,
        ),
    ];
    for (name, bytes, options) in files {
        zip.start_file(name, options)?;
        zip.write_all(bytes)?;
    }
    Ok(zip.finish()?.into_inner())
}
