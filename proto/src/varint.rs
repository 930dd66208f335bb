//! Varints as in postcard: 7 bits a byte, low bits first, the top bit set on all but the last. Overlong forms
//! are accepted.

use bytes::BufMut;

/// Appends `value`: 1 to 5 bytes.
pub(crate) fn put_varint(out: &mut impl BufMut, mut value: u32) {
    while value >= 0x80 {
        out.put_u8(value as u8 | 0x80);
        value >>= 7;
    }
    out.put_u8(value as u8);
}

/// Takes a number off the front of `bytes`; `None` if it is cut short or above 32 bits.
pub(crate) fn get_varint(bytes: &mut &[u8]) -> Option<u32> {
    let mut value = 0;
    for shift in (0..35).step_by(7) {
        let (byte, rest) = bytes.split_first()?;
        *bytes = rest;
        value |= u64::from(byte & 0x7f) << shift;
        if byte & 0x80 == 0 {
            return u32::try_from(value).ok();
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_take_a_byte_for_every_seven_bits() {
        for (value, size) in [(0, 1), (127, 1), (128, 2), (16_383, 2), (16_384, 3), (u32::MAX, 5)] {
            let mut out = Vec::new();
            put_varint(&mut out, value);
            assert_eq!(out.len(), size, "{value}");
            let rest = &mut out.as_slice();
            assert_eq!(get_varint(rest), Some(value));
            assert!(rest.is_empty());
        }
    }

    #[test]
    fn what_is_cut_short_or_too_large_is_no_number() {
        for bytes in [&[][..], &[0x80], &[0xff, 0xff, 0xff, 0xff, 0x10], &[0x80; 6]] {
            assert_eq!(get_varint(&mut &*bytes), None, "{bytes:?}");
        }
        assert_eq!(get_varint(&mut [0xff, 0xff, 0xff, 0xff, 0x0f].as_slice()), Some(u32::MAX));
    }
}
