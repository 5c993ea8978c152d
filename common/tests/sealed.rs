//! Sealed images (`signed_image`): the one that Python made (`reference/sealed.py`) opens; every
//! bit flip and truncation, other signers and machines, older issues and 400 000 strings of random
//! bytes are refused, each with its reason.

use ed25519_compact::{KeyPair, Seed};
use loadtwin_common::io::signed_image::{
    CRC, Header, Identity, ImageError, KEY_PAGE_LEN, MachineId, OVERHEAD, PublicKey, SIGNED_LEN,
    open, open_signed,
};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

/// Made by `reference/sealed.py`, Python 3.11.7 with cryptography 50.0.2.
const REFERENCE: &[u8] = include_bytes!("reference/sealed.bin");
const KEY_PAGE: &[u8] = include_bytes!("reference/key_page.bin");

fn pair(seed: u8) -> KeyPair {
    KeyPair::from_seed(Seed::new([seed; 32]))
}

/// The board of these tests, with the public key of `pair`.
fn board(pair: &KeyPair) -> Identity {
    Identity {
        key: PublicKey::from_bytes(*pair.pk).unwrap(),
        machine: MachineId::of("bench"),
    }
}

fn image(header: &Header, payload: &[u8]) -> Vec<u8> {
    let mut bytes = [&header.to_bytes()[..], payload].concat();
    bytes.extend(CRC.checksum(&bytes).to_le_bytes());
    bytes
}

fn signed(payload: &[u8], issue: u32, replaces: u32, pair: &KeyPair) -> Vec<u8> {
    let mut header = Header::for_payload(payload, MachineId::of("bench"), issue, replaces).unwrap();
    header.signature = *pair.sk.sign(header.signed_bytes(), None);
    image(&header, payload)
}

/// Puts the CRC right again, as a forger would.
fn repair(bytes: &mut [u8]) {
    let (body, crc) = bytes.split_last_chunk_mut::<4>().unwrap();
    *crc = CRC.checksum(body).to_le_bytes();
}

#[test]
fn the_image_of_another_implementation_opens() {
    let board = Identity::from_page(KEY_PAGE).unwrap();
    assert_eq!(board.machine, MachineId::of("Prüfstand 3"));
    let (header, payload) = open_signed(REFERENCE, Some(&board)).unwrap();
    let expected: Vec<u8> = (0..300).map(|i| ((7 * i + i / 9) % 256) as u8).collect();
    assert_eq!((header.issue, header.replaces), (42, 43));
    assert_eq!(payload, expected);
    assert_eq!(board.to_page(), KEY_PAGE);
    assert_eq!(image(&header, payload), REFERENCE);
}

#[test]
fn every_bit_flip_and_every_truncation_is_refused() {
    let key = board(&pair(1));
    let bytes = signed(&[0x5A; 333], 7, 0, &pair(1));
    assert!(open_signed(&bytes, Some(&key)).is_ok());
    let mut accepted = 0;
    for bit in 0..bytes.len() * 8 {
        let mut bent = bytes.clone();
        bent[bit / 8] ^= 1 << (bit % 8);
        accepted += usize::from(open(&bent).is_ok());
        if bit / 8 < bytes.len() - 4 {
            repair(&mut bent);
            accepted += usize::from(open_signed(&bent, Some(&key)).is_ok());
        }
    }
    for length in 0..bytes.len() {
        accepted += usize::from(open(&bytes[..length]).is_ok());
    }
    accepted += usize::from(open(&[&bytes[..], &[0]].concat()).is_ok());
    assert_eq!(accepted, 0);
}

#[test]
fn each_reason_is_told() {
    let good = signed(b"model", 7, 0, &pair(1));
    let key = board(&pair(1));
    let refusal = |bytes: &[u8]| open_signed(bytes, Some(&key)).unwrap_err();
    let bent = |at: usize| {
        let mut b = good.clone();
        b[at] ^= 1;
        repair(&mut b);
        b
    };
    assert_eq!(refusal(&bent(0)), ImageError::BadMagic);
    assert_eq!(refusal(&bent(4)), ImageError::BadVersion);
    assert_eq!(refusal(&bent(16)), ImageError::BadLength);
    assert_eq!(refusal(&good[..good.len() - 1]), ImageError::BadLength);
    assert_eq!(refusal(&[]), ImageError::BadLength);
    assert_eq!(refusal(&bent(8)), ImageError::BadSignature, "another issue");
    assert_eq!(
        refusal(&bent(12)),
        ImageError::BadSignature,
        "another permission"
    );
    assert_eq!(refusal(&bent(20)), ImageError::WrongMachine);
    assert_eq!(refusal(&bent(SIGNED_LEN)), ImageError::BadSignature);
    assert_eq!(refusal(&bent(OVERHEAD - 4)), ImageError::BadDigest);
    let mut crc = good.clone();
    *crc.last_mut().unwrap() ^= 1;
    assert_eq!(refusal(&crc), ImageError::BadCrc);
    assert_eq!(open_signed(&good, None), Err(ImageError::NoKey));
    assert_eq!(
        open_signed(&good, Some(&board(&pair(2)))),
        Err(ImageError::BadSignature)
    );
    let unsigned = image(
        &Header::for_payload(b"model", MachineId::of("bench"), 7, 0).unwrap(),
        b"model",
    );
    assert!(open(&unsigned).is_ok());
    assert_eq!(refusal(&unsigned), ImageError::Unsigned);
    assert!(Header::for_payload(&[], MachineId::of("bench"), 1, 0).is_none());
    let other = Identity {
        machine: MachineId::of("another"),
        ..key
    };
    assert_eq!(
        open_signed(&good, Some(&other)),
        Err(ImageError::WrongMachine)
    );
}

#[test]
fn only_the_signer_lets_an_image_go_back() {
    let header = |issue, replaces| {
        Header::for_payload(b"m", MachineId::of("bench"), issue, replaces).unwrap()
    };
    let running = header(7, 0);
    for (issue, replaces, allowed) in [
        (8, 0, true),
        (7, 0, false),
        (6, 0, false),
        (6, 7, true),
        (6, 8, false),
        (7, 7, false),
    ] {
        let verdict = header(issue, replaces).may_replace(Some(&running));
        assert_eq!(
            verdict.is_ok(),
            allowed,
            "issue {issue}, replaces {replaces}"
        );
        assert!(header(issue, replaces).may_replace(None).is_ok());
    }
    // 0 permits nothing, not even over issue 0.
    assert_eq!(
        header(0, 0).may_replace(Some(&header(0, 0))),
        Err(ImageError::Downgrade)
    );
}

#[test]
fn a_key_page_is_whole_or_nothing() {
    let page = board(&pair(1)).to_page();
    assert_eq!(Identity::from_page(&page), Some(board(&pair(1))));
    for bit in 0..KEY_PAGE_LEN * 8 {
        let mut bent = page;
        bent[bit / 8] ^= 1 << (bit % 8);
        assert_eq!(Identity::from_page(&bent), None);
    }
    assert_eq!(Identity::from_page(&[0xFF; KEY_PAGE_LEN]), None);
    // Points of small order verify signatures that nobody made.
    let mut one = [0; 32];
    one[0] = 1;
    assert_eq!(PublicKey::from_bytes(one), None);
    assert_eq!(PublicKey::from_bytes([0; 32]), None);
}

#[test]
fn codes_and_reasons_are_one_to_one() {
    for (i, refusal) in ImageError::ALL.into_iter().enumerate() {
        assert_eq!(usize::from(refusal.code()), 0xF0 + i);
        assert_eq!(ImageError::from_code(refusal.code()), Some(refusal));
    }
    for code in (0..0xF0).chain(0xFF..=0xFF) {
        assert_eq!(ImageError::from_code(code), None);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400_000, failure_persistence: None, rng_seed: RngSeed::Fixed(1), ..ProptestConfig::default() })]

    #[test]
    fn no_bytes_make_the_parser_panic_or_accept(
        bytes in prop::collection::vec(any::<u8>(), 0..160),
        seal in 0..3u8,
        at in 0..200usize,
    ) {
        // A third as they come, a third behind a right start, a third in place
        // of a piece of a valid image, with the CRC put right.
        let bytes = match seal {
            0 => bytes,
            1 => [b"LTMI\x02\0\0\0", &bytes[..]].concat(),
            _ => {
                let mut b = REFERENCE.to_vec();
                let end = b.len().min(at + bytes.len());
                b.splice(at.min(end)..end, bytes);
                repair(&mut b);
                b
            }
        };
        let board = Identity::from_page(KEY_PAGE).unwrap();
        if let Ok((header, _)) = open_signed(&bytes, Some(&board)) {
            prop_assert_eq!(&bytes, REFERENCE, "accepted: {:?}", header);
        }
        let _ = Identity::from_page(&bytes);
    }
}
