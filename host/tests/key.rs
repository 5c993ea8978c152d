//! Signing keys in files and images sealed with them: `loadtwin key`, keys of OpenSSL, refused
//! files.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use loadtwin::key::{SigningKey, identity, read_public, save_page};
use loadtwin::seal::{SealError, seal};
use loadtwin_common::io::signed_image::{Identity, ImageError, open, open_signed};

/// RFC 8032, section 7.1, test 1; the files are by OpenSSL, see `rfc8032_key.sh`.
const PUBLIC: [u8; 32] = [
    0xd7, 0x5a, 0x98, 0x01, 0x82, 0xb1, 0x0a, 0xb7, 0xd5, 0x4b, 0xfe, 0xd3, 0xc9, 0x64, 0x07, 0x3a,
    0x0e, 0xe1, 0x72, 0xf3, 0xda, 0xa6, 0x23, 0x25, 0xaf, 0x02, 0x1a, 0x68, 0xf7, 0x07, 0x51, 0x1a,
];

fn mode(path: &Path) -> u32 {
    fs::metadata(path).unwrap().permissions().mode() & 0o777
}

#[test]
fn a_pair_is_saved_once_and_signs_what_its_public_half_accepts() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("plant.key");
    let key = SigningKey::generate().unwrap();
    let files = key.save(&path, "plant").unwrap();
    assert_eq!(
        (mode(&files.private), mode(&files.public) & 0o600),
        (0o600, 0o600)
    );
    let public = read_public(&files.public).unwrap();
    assert_eq!(
        Identity::from_page(&fs::read(&files.page).unwrap()),
        Some(identity(public, "plant"))
    );
    let page_of_another = |machine| SigningKey::page_of_another_machine(&path, machine);
    assert_eq!(page_of_another("plant"), None);
    assert_eq!(page_of_another("mill"), Some(files.page.clone()));
    let image = seal(
        b"model",
        "plant",
        3,
        Some(4),
        Some(&SigningKey::read(&path).unwrap()),
    )
    .unwrap();
    let (header, payload) = open_signed(&image, Some(&identity(public, "plant"))).unwrap();
    assert_eq!(
        (header.issue, header.replaces, payload),
        (3, 4, &b"model"[..])
    );

    // One more board, on another machine, with the same key.
    let second = dir.path().join("second.page");
    save_page(public, "second", &second).unwrap();
    let second = Identity::from_page(&fs::read(&second).unwrap()).unwrap();
    assert_eq!(
        open_signed(&image, Some(&second)),
        Err(ImageError::WrongMachine)
    );

    let before = fs::read(&path).unwrap();
    let other = SigningKey::generate().unwrap();
    let error = other.save(&path, "plant").unwrap_err().to_string();
    assert!(
        error.ends_with("plant.key: is there already; a key is never overwritten"),
        "{error}"
    );
    assert_eq!(fs::read(&path).unwrap(), before);
    assert_ne!(other.public(), public);
}

#[test]
fn nothing_is_left_behind_when_a_file_of_the_pair_is_in_the_way() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("k");
    fs::write(dir.path().join("k.page"), b"mine").unwrap();
    assert!(
        SigningKey::generate()
            .unwrap()
            .save(&path, "plant")
            .is_err()
    );
    assert!(!path.exists() && !dir.path().join("k.pub").exists());
    assert_eq!(fs::read(dir.path().join("k.page")).unwrap(), b"mine");
}

#[test]
fn keys_of_openssl_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("key.pem");
    fs::write(&path, include_bytes!("reference/rfc8032_key.pem")).unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o640)).unwrap();
    let error = SigningKey::read(&path).unwrap_err().to_string();
    assert!(
        error.contains("found mode 0640, allowed: no access for others"),
        "{error}"
    );
    fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
    let key = SigningKey::read(&path).unwrap();
    assert_eq!(key.public().as_bytes(), &PUBLIC);

    let public = dir.path().join("key.pem.pub");
    fs::write(&public, include_bytes!("reference/rfc8032_key.pem.pub")).unwrap();
    assert_eq!(read_public(&public).unwrap(), key.public());
    // What is written is what OpenSSL writes, to the byte.
    let again = key.save(&dir.path().join("again"), "plant").unwrap();
    assert_eq!(
        fs::read(again.private).unwrap(),
        include_bytes!("reference/rfc8032_key.pem")
    );
    assert_eq!(
        fs::read(again.public).unwrap(),
        include_bytes!("reference/rfc8032_key.pem.pub")
    );
}

#[test]
fn other_files_are_refused_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("key.pem");
    fs::write(&path, include_bytes!("reference/rfc8032_key.pem.pub")).unwrap();
    fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
    let error = SigningKey::read(&path).unwrap_err().to_string();
    assert!(
        error.ends_with("key.pem: found no Ed25519 private key in PEM"),
        "{error}"
    );
    assert!(
        SigningKey::read(&dir.path().join("none"))
            .unwrap_err()
            .to_string()
            .contains("none: ")
    );
}

#[test]
fn an_image_without_a_signature_is_for_the_host_only() {
    let image = seal(b"model", "plant", 1, None, None).unwrap();
    assert_eq!(open(&image).unwrap().1, b"model");
    let board = SigningKey::generate().unwrap().identity("plant");
    assert_eq!(open_signed(&image, Some(&board)), Err(ImageError::Unsigned));
    assert_eq!(seal(b"", "plant", 1, None, None), Err(SealError(0)));
}
