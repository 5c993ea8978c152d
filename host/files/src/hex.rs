//! Writes bytes, as of a hash, as hexadecimal digits.

/// Two hexadecimal digits for each byte, in lower case.
pub fn hex(bytes: impl AsRef<[u8]>) -> String {
    let bytes = bytes.as_ref().iter();
    let digits: Vec<String> = bytes.map(|byte| format!("{byte:02x}")).collect();
    digits.concat()
}
