//! Converts a `file:` URI (RFC 8089), as FMI 2.0 has it in `fmuResourceLocation`, to a path. A text
//! without that scheme is a path already; a URI of another host is refused.

use std::path::PathBuf;

use crate::refusal::Refusal;

/// The path; a text without scheme is one already.
pub(crate) fn path(uri: &str) -> Result<PathBuf, Refusal> {
    const ALLOWED: &str = "fmuResourceLocation (allowed: a file: URI of this machine)";
    let Some(rest) = uri.strip_prefix("file:") else {
        return Ok(uri.into());
    };
    let local = match rest.strip_prefix("//") {
        Some(at) => at.strip_prefix("localhost").unwrap_or(at),
        None => rest,
    };
    let mut bytes = Vec::with_capacity(local.len());
    let mut left = local.bytes();
    while let Some(byte) = left.next() {
        if byte == b'%' {
            let mut digit = || char::from(left.next()?).to_digit(16);
            let code = digit().zip(digit()).ok_or(Refusal::Text(ALLOWED))?;
            bytes.push((16 * code.0 + code.1) as u8);
        } else {
            bytes.push(byte);
        }
    }
    let path = String::from_utf8(bytes).map_err(|_| Refusal::Text(ALLOWED))?;
    if path.starts_with('/') {
        Ok(path.into())
    } else {
        Err(Refusal::Text(ALLOWED))
    }
}

#[cfg(test)]
mod tests {
    use super::path;

    #[test]
    fn a_uri_is_a_path_and_no_other_machine() {
        let is = |uri, expected: &str| assert_eq!(path(uri).unwrap().to_str(), Some(expected));
        is("file:///models/a%20b/resources", "/models/a b/resources");
        is("file://localhost/models", "/models");
        is("file:/models/%C3%A9", "/models/é");
        is("/models/100%", "/models/100%");
        for wrong in [
            "file://server/x",
            "file:///%zz",
            "file:///%2",
            "file:///%ff",
        ] {
            assert!(path(wrong).is_err(), "{wrong}");
        }
    }
}
