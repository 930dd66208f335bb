//! Detects a file's format: by its name, confirmed by its first bytes.

use std::path::Path;

use super::ImportError;
use super::rvm::is_review_file;
use super::stl::is_stl;

/// A file format that can be imported.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Format {
    /// glTF 2.0, as one binary file (.glb) or as JSON with its buffers beside it (.gltf).
    Gltf,
    /// AVEVA review file, in its binary or its text form.
    Rvm,
    /// Wavefront OBJ, with its materials (.mtl) beside it.
    Obj,
    /// STEP (ISO 10303-21).
    Step,
    /// IGES, in its text form.
    Iges,
    /// STL, in its binary or its text form.
    Stl,
    /// PLY (the Stanford polygon format), in its text form or either binary form.
    Ply,
    /// IFC in its STEP form (ISO 10303-21), or a ZIP archive of that.
    Ifc,
}

impl Format {
    /// How many first bytes of a review file [`Self::of`] reads.
    pub(super) const START: u64 = 256;

    /// Whether a file has the name of a review file.
    pub(super) fn is_named_as_review(path: &Path) -> bool {
        matches!(ending(path).as_deref(), Some("rvm" | "rev"))
    }

    /// The format of a file with this name and these bytes.
    ///
    /// # Errors
    /// The name's ending is unknown, or the bytes contradict it.
    pub fn of(path: &Path, bytes: &[u8]) -> Result<Self, ImportError> {
        let wrong = |expected, magic| Err(ImportError::WrongMagic { path: path.to_owned(), expected, magic });
        match ending(path).as_deref() {
            // Either form under either name: the bytes decide.
            Some("glb" | "gltf") if bytes.starts_with(b"glTF") || first_visible(bytes) == Some(b'{') => {
                Ok(Self::Gltf)
            }
            Some("glb") => wrong(".glb", "the letters glTF"),
            Some("gltf") => wrong(".gltf", "a brace: it is JSON"),
            Some("rvm" | "rev") if is_review_file(bytes) => Ok(Self::Rvm),
            Some("rvm" | "rev") => wrong(
                ".rvm",
                "the word HEAD: four bytes a letter in the binary form, a line in the text form",
            ),
            // Text of any kind: it has no characteristic first bytes.
            Some("obj") => Ok(Self::Obj),
            Some("stl") if is_stl(bytes) => Ok(Self::Stl),
            Some("stl") => wrong(
                ".stl",
                "the word solid in the text form, and with 80 bytes and a count in the binary form",
            ),
            Some("ply") if bytes.starts_with(b"ply") => Ok(Self::Ply),
            Some("ply") => wrong(".ply", "the letters ply"),
            Some("step" | "stp" | "stpz" | "p21") if is_step(bytes) => Ok(Self::Step),
            Some("step" | "stp" | "stpz" | "p21") => wrong(".step", "ISO-10303-21"),
            Some("iges" | "igs") if is_iges(bytes) => Ok(Self::Iges),
            Some("iges" | "igs") => wrong(".iges", "a line that has the letter S in its column 73"),
            // Either form under either name.
            Some("ifc" | "ifczip") if is_step(bytes) || bytes.starts_with(b"PK\x03\x04") => Ok(Self::Ifc),
            Some("ifc") => wrong(".ifc", "ISO-10303-21"),
            Some("ifczip") => wrong(".ifczip", "the letters PK: it is a ZIP archive"),
            other => Err(match other.and_then(converted_by) {
                Some((format, way)) => ImportError::ToBeConverted { path: path.to_owned(), format, way },
                None => ImportError::UnknownFormat { path: path.to_owned() },
            }),
        }
    }
}

/// The name of a format that is not read, by its ending, and the way to convert it.
fn converted_by(ending: &str) -> Option<(&'static str, &'static str)> {
    const AT_HOME: &str = "by exporting it as STEP or glTF from the program that made it";
    const BLENDER: &str = "by exporting it as glTF from Blender";
    const MESHLAB: &str = "by exporting it as PLY from MeshLab";
    const SURFACE: &str = "by making a surface of its points and saving that as PLY, as with CloudCompare";
    Some(match ending {
        "ifcxml" => ("IFC as XML", "by exporting it as .ifc from the program that made it"),
        "brep" | "brp" | "fcstd" => {
            ("a FreeCAD or Open CASCADE model", "by exporting it as STEP from FreeCAD")
        }
        "dwg" | "dxf" | "dgn" => ("a drawing", AT_HOME),
        "nwd" | "nwc" | "nwf" => ("a Navisworks model", AT_HOME),
        "rvt" | "rfa" => ("a Revit model", AT_HOME),
        "sldprt" | "sldasm" | "ipt" | "iam" | "catpart" | "catproduct" | "prt" | "asm" | "par" => {
            ("a part or assembly of a CAD program", AT_HOME)
        }
        "jt" | "x_t" | "x_b" | "sat" | "3dm" | "skp" | "vue" => ("a model of a CAD program", AT_HOME),
        "fbx" | "dae" | "3ds" | "blend" | "x3d" | "wrl" | "usd" | "usdz" | "usda" | "usdc" | "abc" => {
            ("a model of an animation program", BLENDER)
        }
        "3mf" | "amf" | "off" => ("a mesh", MESHLAB),
        "las" | "laz" | "e57" | "pcd" | "pts" | "ptx" | "xyz" | "rcp" | "rcs" => ("a point cloud", SURFACE),
        _ => return None,
    })
}

/// Whether a file begins as STEP does.
fn is_step(bytes: &[u8]) -> bool {
    let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes).trim_ascii_start();
    bytes.starts_with(b"ISO-10303-21")
}

/// Whether a file begins as IGES does: its lines have 80 columns, and the 73rd names the section.
fn is_iges(bytes: &[u8]) -> bool {
    bytes.get(72) == Some(&b'S')
}

/// The ending of a file's name, in lower case.
pub(super) fn ending(path: &Path) -> Option<String> {
    path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase())
}

/// The first byte that is neither white space nor part of a byte order mark.
fn first_visible(bytes: &[u8]) -> Option<u8> {
    let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
    bytes.iter().copied().find(|byte| !byte.is_ascii_whitespace())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_without_regard_to_case() {
        assert_eq!(Format::of(Path::new("A.GLB"), b"glTF").unwrap(), Format::Gltf);
        assert_eq!(Format::of(Path::new("a.gLtF"), b"\xEF\xBB\xBF \n{").unwrap(), Format::Gltf);
    }

    #[test]
    fn either_form_of_a_review_file_may_have_either_name() {
        for start in [&b"\0\0\0H\0\0\0E\0\0\0A\0\0\0D"[..], b"HEAD\r\n     1     2\r\n"] {
            assert_eq!(Format::of(Path::new("a.RVM"), start).unwrap(), Format::Rvm);
            assert_eq!(Format::of(Path::new("a.rev"), start).unwrap(), Format::Rvm);
        }
        let wrong = Format::of(Path::new("a.rev"), b"\0\0\0H\0\0\0E");
        assert!(matches!(wrong, Err(ImportError::WrongMagic { expected: ".rvm", .. })));
        assert!(Format::is_named_as_review(Path::new("b/a.Rev")));
        assert!(!Format::is_named_as_review(Path::new("rvm")));
    }

    #[test]
    fn either_form_of_gltf_may_have_either_name() {
        assert_eq!(Format::of(Path::new("a.gltf"), b"glTF\x02").unwrap(), Format::Gltf);
        assert_eq!(Format::of(Path::new("a.glb"), b" {}").unwrap(), Format::Gltf);
    }

    #[test]
    fn bytes_must_agree_with_the_name() {
        let wrong = Format::of(Path::new("a.glb"), b"v 0 0 0");
        assert!(matches!(wrong, Err(ImportError::WrongMagic { expected: ".glb", .. })));
        assert!(matches!(Format::of(Path::new("a.gltf"), b""), Err(ImportError::WrongMagic { .. })));
    }

    #[test]
    fn an_unknown_ending_is_named() {
        let error = Format::of(Path::new("plant.doc"), b"").unwrap_err();
        assert!(error.to_string().starts_with("plant.doc is of no known format"), "{error}");
        assert!(matches!(Format::of(Path::new("glb"), b"glTF"), Err(ImportError::UnknownFormat { .. })));
    }

    #[test]
    fn a_format_that_is_not_read_names_its_converter() {
        let said = |name: &str| Format::of(Path::new(name), b"").unwrap_err().to_string();
        assert_eq!(
            said("a/b.JT"),
            "a/b.JT is a model of a CAD program, which is not read: convert it first, by exporting it as \
             STEP or glTF from the program that made it"
        );
        assert!(said("a.ifcXML").contains("exporting it as .ifc"));
        assert!(said("a.fbx").contains("Blender") && said("a.e57").contains("point cloud"));
    }

    #[test]
    fn ifc_is_known_packed_or_not() {
        for name in ["a.ifc", "a.IFCZIP"] {
            for bytes in [&b"ISO-10303-21;\n"[..], b"PK\x03\x04"] {
                assert_eq!(Format::of(Path::new(name), bytes).unwrap(), Format::Ifc);
            }
            let wrong = Format::of(Path::new(name), b"<?xml").unwrap_err().to_string();
            assert!(wrong.contains("is not what its name says"), "{wrong}");
        }
    }

    #[test]
    fn step_and_iges_are_known_by_their_first_line() {
        let step = |name: &str, bytes| Format::of(Path::new(name), bytes);
        assert_eq!(step("a.STP", b"\r\nISO-10303-21;\n").unwrap(), Format::Step);
        assert!(matches!(step("a.step", b"<html>"), Err(ImportError::WrongMagic { expected: ".step", .. })));
        let line = format!("{:72}S      1\n", "made by a test");
        assert_eq!(step("a.igs", line.as_bytes()).unwrap(), Format::Iges);
        assert!(matches!(step("a.iges", b"IGES"), Err(ImportError::WrongMagic { expected: ".iges", .. })));
    }
}
