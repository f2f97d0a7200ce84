//! Checksums of the small files of a bake folder, in which no other reader would see a changed bit.

/// CRC-32 of some bytes (that of zlib and PNG), in eight hex digits.
pub(crate) fn crc32(bytes: &[u8]) -> String {
    format!("{:08x}", crc32fast::hash(bytes))
}

/// A JSON text with an empty `"checksum"`, which is filled in: with the CRC-32 of the text as it was.
pub(crate) fn with_own(text: &str) -> String {
    text.replacen(&field(""), &field(&crc32(text.as_bytes())), 1)
}

/// Refuses a JSON text that is not as it was when it got this checksum of its own.
pub(crate) fn check_own(text: &str, checksum: &str) -> Result<(), String> {
    let plain = text.replacen(&field(checksum), &field(""), 1);
    if crc32(plain.as_bytes()) == checksum { Ok(()) } else { Err("its checksum does not fit".into()) }
}

fn field(checksum: &str) -> String {
    format!("\"checksum\": \"{checksum}\"")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_fits_its_own_checksum_alone() {
        assert_eq!(crc32(b"123456789"), "cbf43926");
        let text = with_own(r#"{"files": ["a"], "checksum": ""}"#);
        let sum = &text[text.len() - 10..text.len() - 2];
        assert_eq!(check_own(&text, sum), Ok(()));
        assert!(check_own(&text.replace("\"a\"", "\"b\""), sum).is_err());
    }
}
