//! Thirty-two bytes as text: 64 hexadecimal digits.

use std::fmt;

use zeroize::Zeroizing;

/// Writes the digits in lower case.
pub(super) fn write(bytes: &[u8; 32], f: &mut fmt::Formatter<'_>) -> fmt::Result {
    bytes.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
}

/// Reads 64 digits, with or without colons between the bytes.
pub(super) fn read(text: &str) -> Option<[u8; 32]> {
    // The digits may be secret.
    let digits: Zeroizing<String> = Zeroizing::new(match text.len() {
        64 => text.to_owned(),
        95 => text
            .bytes()
            .enumerate()
            .filter(|(i, byte)| i % 3 != 2 || *byte != b':')
            .map(|(_, byte)| char::from(byte))
            .collect(),
        _ => return None,
    });
    let mut bytes = [0; 32];
    let (pairs, rest) = digits.as_bytes().as_chunks::<2>();
    if pairs.len() != bytes.len() || !rest.is_empty() {
        return None;
    }
    for (byte, [high, low]) in bytes.iter_mut().zip(pairs) {
        let digit = |c: u8| char::from(c).to_digit(16).map(|d| d as u8);
        *byte = digit(*high).zip(digit(*low)).map(|(high, low)| high << 4 | low)?;
    }
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_text_of_another_shape_is_refused() {
        for text in ["", "ab", &"g".repeat(64), &"0".repeat(63), &"0".repeat(95), &"é".repeat(32)] {
            assert_eq!(read(text), None);
        }
    }

    proptest! {
        #[test]
        fn what_is_written_is_read_with_and_without_colons(bytes: [u8; 32]) {
            let pairs: Vec<_> = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
            prop_assert_eq!(read(&pairs.concat()), Some(bytes));
            prop_assert_eq!(read(&pairs.join(":").to_lowercase()), Some(bytes));
        }

        #[test]
        fn no_text_panics(text in any::<String>()) {
            let _ = read(&text);
        }
    }
}
