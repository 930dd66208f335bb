//! The colours of material numbers.

use std::collections::HashMap;

/// Numbers 1 to 32, and again 33 to 64, of the standard colour list of PDMS.
const BASIC: [u32; 32] = [
    0x00_00_00, // black
    0xcc_00_00, // red
    0xed_99_00, // orange
    0xcc_cc_00, // yellow
    0x00_cc_00, // green
    0x00_ed_ed, // cyan
    0x00_00_cc, // blue
    0xdd_00_dd, // magenta
    0xcc_2b_2b, // brown
    0xff_ff_ff, // white
    0xf9_7f_70, // salmon
    0xbf_bf_bf, // light grey
    0xa8_a8_a8, // grey
    0x8c_66_8c, // plum
    0xf4_f4_f4, // white smoke
    0x8e_23_6b, // maroon
    0x00_ff_7f, // spring green
    0xf4_dd_b2, // wheat
    0xed_c9_33, // gold
    0x47_75_ff, // royal blue
    0xed_e8_aa, // light gold
    0xed_11_89, // deep pink
    0x23_8e_23, // forest green
    0xff_a5_00, // bright orange
    0xed_ed_e0, // ivory
    0xed_75_21, // chocolate
    0x47_82_b5, // steel blue
    0xff_ff_ff, // white
    0x2d_2d_4f, // midnight
    0x00_00_7f, // navy blue
    0xcc_91_9e, // pink
    0xcc_5b_44, // coral red
];

/// Numbers 206 to 255 of the list.
const NAMED: [u32; 50] = [
    0x00_00_00, // black
    0xff_ff_ff, // white
    0xf4_f4_f4, // white smoke
    0xed_ed_e0, // ivory
    0xa8_a8_a8, // grey
    0xbf_bf_bf, // light grey
    0x51_8c_8c, // dark grey
    0x2d_4f_4f, // dark slate
    0xcc_00_00, // red
    0xff_00_00, // bright red
    0xcc_5b_44, // coral red
    0xff_63_47, // tomato
    0x8c_66_8c, // plum
    0xed_11_89, // deep pink
    0xcc_91_9e, // pink
    0xf9_7f_70, // salmon
    0xed_99_00, // orange
    0xff_a5_00, // bright orange
    0xff_7f_00, // orange red
    0x8e_23_6b, // maroon
    0xcc_cc_00, // yellow
    0xed_c9_33, // gold
    0xed_ed_d1, // light yellow
    0xed_e8_aa, // light gold
    0x99_cc_33, // yellow green
    0x00_ff_7f, // spring green
    0x00_cc_00, // green
    0x23_8e_23, // forest green
    0x2d_4f_2d, // dark green
    0x00_ed_ed, // cyan
    0x00_bf_cc, // turquoise
    0x75_ed_c6, // aquamarine
    0x00_00_cc, // blue
    0x47_75_ff, // royal blue
    0x00_00_7f, // navy blue
    0xaf_e0_e5, // powder blue
    0x2d_2d_4f, // midnight
    0x47_82_b5, // steel blue
    0x33_00_66, // indigo
    0x66_00_99, // mauve
    0xed_82_ed, // violet
    0xdd_00_dd, // magenta
    0xf4_f4_db, // beige
    0xf4_dd_b2, // wheat
    0xdb_93_70, // tan
    0xf4_a5_5e, // sandy brown
    0xcc_2b_2b, // brown
    0x9e_9e_5e, // khaki
    0xed_75_21, // chocolate
    0x8c_44_14, // dark brown
];

/// The colour for unknown numbers.
pub(super) const GREY: [u8; 3] = [0x78; 3];

/// The colour of `material`: the file's own definition, else the standard one.
pub(super) fn of(material: u32, redefined: &HashMap<u32, [u8; 3]>) -> Option<[u8; 3]> {
    redefined.get(&material).copied().or_else(|| {
        let standard = match material {
            1..=64 => BASIC.get((material as usize - 1) % BASIC.len()),
            206.. => NAMED.get(material as usize - 206),
            _ => None,
        };
        standard.map(|colour| {
            let [_, r, g, b] = colour.to_be_bytes();
            [r, g, b]
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_their_standard_colours() {
        let rgb = |material| of(material, &HashMap::new());
        assert_eq!(rgb(2), Some([0xcc, 0, 0]));
        assert_eq!(rgb(32), rgb(64));
        assert_eq!(rgb(206), Some([0, 0, 0]));
        assert_eq!(rgb(255), Some([0x8c, 0x44, 0x14]));
        for unknown in [0, 65, 205, 256, u32::MAX] {
            assert_eq!(rgb(unknown), None, "{unknown}");
        }
    }

    #[test]
    fn a_file_can_redefine_them() {
        assert_eq!(of(2, &HashMap::from([(2, [1, 2, 3])])), Some([1, 2, 3]));
    }
}
