//! The colours of objects: from materials, vertices and textures.

use std::collections::HashSet;
use std::io::Cursor;

use image::{ImageFormat, Rgba, RgbaImage};
use trimaran_cook::Mesh;
use trimaran_cook::import::WarningKind;
use trimaran_scene::Rgba8;

use super::document::Document;

use crate::import_files::{floats, import_beside, import_bytes};

const NODE: &str = r#""nodes":[{"name":"tank","mesh":0}]"#;
const RED: [u8; 4] = [255, 0, 0, 255];
const GREEN: [u8; 4] = [0, 255, 0, 255];
const BLACK: [u8; 4] = [0, 0, 0, 255];
const WHITE: [u8; 4] = [255; 4];

fn encoded(width: u32, height: u32, texels: &[[u8; 4]], format: ImageFormat) -> Vec<u8> {
    let image = RgbaImage::from_fn(width, height, |x, y| Rgba(texels[(y * width + x) as usize]));
    let mut file = Cursor::new(Vec::new());
    match format {
        ImageFormat::Jpeg => image::DynamicImage::from(image).into_rgb8().write_to(&mut file, format),
        _ => image.write_to(&mut file, format),
    }
    .unwrap();
    file.into_inner()
}

fn png(width: u32, height: u32, texels: &[[u8; 4]]) -> Vec<u8> {
    encoded(width, height, texels, ImageFormat::Png)
}

/// One triangle with texture coordinates, with a material and a texture.
fn textured(coordinates: [[f32; 2]; 3], image: &[u8], material: &str, texture: &str, more: &str) -> Vec<u8> {
    let mut document = Document::triangle();
    let uv = document.coordinates(&coordinates);
    let view = document.view(image, "");
    document.glb(&format!(
        r#"{NODE},"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":{uv}}},"material":0}}]}}],
        "materials":[{material}],"textures":[{texture}],"images":[{{"name":"paint","bufferView":{view}}}]{more}"#
    ))
}

const BASE: &str = r#"{"name":"shell","pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}"#;
const SOURCE: &str = r#"{"source":0}"#;

fn mesh(file: &[u8]) -> Mesh {
    import_bytes("a.glb", file).unwrap().model.meshes.remove(0)
}

/// The colour of all triangles, if they have one.
fn colour(mesh: &Mesh) -> [u8; 4] {
    let all: HashSet<[u8; 4]> = mesh.colours.iter().map(|colour| colour.0).collect();
    assert_eq!(all.len(), 1, "{all:?}");
    all.into_iter().next().unwrap()
}

fn about(colour: [u8; 4], expected: [u8; 4], tolerance: u8) {
    let near = colour.into_iter().zip(expected).all(|(a, b)| a.abs_diff(b) <= tolerance);
    assert!(near, "{colour:?} is not {expected:?}");
}

#[test]
fn a_palette_s_texel_is_the_triangle_s_colour() {
    let palette = png(4, 1, &[RED, GREEN, [0, 0, 255, 255], WHITE]);
    for (at, texel) in [(0.125, RED), (0.375, GREEN), (0.875, WHITE)] {
        let file = textured([[at, 0.5]; 3], &palette, BASE, SOURCE, "");
        let imported = import_bytes("a.glb", &file).unwrap();
        assert_eq!(colour(&imported.model.meshes[0]), texel);
        assert_eq!(imported.report.warnings, [], "nothing is lost");
    }
}

#[test]
fn a_texture_is_its_mean_over_the_triangle_in_linear_light_and_that_is_said() {
    let columns: Vec<_> = (0..64 * 64).map(|at| if at % 64 / 4 % 2 == 0 { BLACK } else { WHITE }).collect();
    let file = textured([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]], &png(64, 64, &columns), BASE, SOURCE, "");
    let imported = import_bytes("a.glb", &file).unwrap();
    // Half the light of white is 188 in sRGB, not 128.
    about(colour(&imported.model.meshes[0]), [188, 188, 188, 255], 6);
    let warning = &imported.report.warnings[0];
    assert_eq!((warning.kind, &*warning.detail), (WarningKind::TextureAveraged, "shell"));
}

#[test]
fn each_triangle_has_the_mean_of_its_own_part() {
    let mut document = Document::default();
    let (low, high) = ([0.0, 0.0, 0.0], [1.0, 1.0, 0.0]);
    document.positions(&[low, [1.0, 0.0, 0.0], [0.5; 3], high, [0.0, 1.0, 0.0], [0.5; 3]]);
    let uv = document.coordinates(&[[0.1, 0.1], [0.2, 0.1], [0.1, 0.1], [0.9, 0.9], [0.8, 0.9], [0.9, 0.9]]);
    let corners = document.indices(&[0, 1, 2, 3, 4, 5]);
    let view = document.view(&png(2, 1, &[RED, GREEN]), "");
    let file = document.glb(&format!(
        r#"{NODE},"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":{uv}}},"indices":{corners},
        "material":0}}]}}],"materials":[{BASE}],"textures":[{SOURCE}],"images":[{{"bufferView":{view}}}]"#
    ));
    let mesh = mesh(&file);
    let first = |triangle: usize| mesh.colours[mesh.indices[3 * triangle] as usize].0;
    assert_eq!([first(0), first(1)], [RED, GREEN]);
}

#[test]
fn factor_and_vertex_colours_multiply_the_texture() {
    let mut document = Document::triangle();
    let uv = document.coordinates(&[[0.5; 2]; 3]);
    let tint = document.accessor(&floats(&[0.5, 1.0, 1.0].repeat(3)), 5126, "VEC3", 3);
    let view = document.view(&png(1, 1, &[[255, 188, 255, 255]]), "");
    let file = document.glb(&format!(
        r#"{NODE},"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":{uv},"COLOR_0":{tint}}},
        "material":0}}]}}],"materials":[{{"pbrMetallicRoughness":{{"baseColorFactor":[1,1,0,1],
        "baseColorTexture":{{"index":0}}}}}}],"textures":[{SOURCE}],"images":[{{"bufferView":{view}}}]"#
    ));
    about(colour(&mesh(&file)), [188, 188, 0, 255], 1);
}

#[test]
fn texture_coordinates_wrap_and_are_transformed_as_the_document_says() {
    let image = png(2, 2, &[RED, GREEN, BLACK, WHITE]);
    let at = |coordinates: [f32; 2], info: &str, sampler: &str| {
        let material = format!(r#"{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0{info}}}}}}}"#);
        let file = textured(
            [coordinates; 3],
            &image,
            &material,
            r#"{"source":0,"sampler":0}"#,
            &format!(r#","samplers":[{sampler}]"#),
        );
        colour(&mesh(&file))
    };
    assert_eq!(at([1.25, 0.25], "", "{}"), RED, "repeated");
    assert_eq!(at([1.25, 0.25], "", r#"{"wrapS":33648}"#), GREEN, "mirrored");
    assert_eq!(at([1.25, 0.25], "", r#"{"wrapS":33071}"#), GREEN, "clamped");
    assert_eq!(at([0.25, -0.25], "", r#"{"wrapT":33071}"#), RED, "clamped");
    let transform = |members: &str| format!(r#","extensions":{{"KHR_texture_transform":{{{members}}}}}"#);
    assert_eq!(at([0.25, 0.25], &transform(r#""offset":[0.5,0]"#), "{}"), GREEN);
    assert_eq!(at([0.25, 0.25], &transform(r#""scale":[3,3]"#), "{}"), WHITE);
    // A quarter turn: (0.75, 0.25) goes to (0.25, -0.75), which is (0.25, 0.25).
    assert_eq!(at([0.75, 0.25], &transform(r#""rotation":1.5707964"#), "{}"), RED);
    assert_eq!(at([0.75, 0.25], "", "{}"), GREEN);
    let other = textured(
        [[0.25; 2]; 3],
        &image,
        &BASE.replace(r#""index":0"#, r#""index":0,"texCoord":1"#),
        SOURCE,
        "",
    );
    let imported = import_bytes("a.glb", &other).unwrap();
    assert_eq!(colour(&imported.model.meshes[0]), WHITE, "it has no second coordinates");
    let warning = &imported.report.warnings[0];
    assert_eq!((warning.kind, &*warning.detail), (WarningKind::TexturedMaterial, "shell"));
}

#[test]
fn images_may_be_png_jpeg_or_webp_in_the_file_beside_it_or_in_an_address() {
    for (format, texture) in [
        (ImageFormat::Png, SOURCE),
        (ImageFormat::Jpeg, SOURCE),
        (ImageFormat::WebP, r#"{"extensions":{"EXT_texture_webp":{"source":0}}}"#),
    ] {
        let image = encoded(8, 8, &[[200, 40, 40, 255]; 64], format);
        let file = textured([[0.2, 0.2], [0.8, 0.2], [0.5, 0.8]], &image, BASE, texture, "");
        about(colour(&mesh(&file)), [200, 40, 40, 255], 8);
    }
    let mut document = Document::triangle();
    let uv = document.coordinates(&[[0.5; 2]; 3]);
    let file = document.glb(&format!(
        r#"{NODE},"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":{uv}}},"material":0}}]}}],
        "materials":[{BASE}],"textures":[{SOURCE}],"images":[{{"uri":"my%20paint.png"}}]"#
    ));
    let beside = import_beside("a.glb", &file, &[("my paint.png", &png(1, 1, &[GREEN]))]).unwrap();
    assert_eq!(colour(&beside.model.meshes[0]), GREEN);
    let lost = import_bytes("a.glb", &file).unwrap();
    let warning = &lost.report.warnings[0];
    assert_eq!((colour(&lost.model.meshes[0]), warning.kind), (WHITE, WarningKind::TextureUnread));
    assert!(warning.detail.starts_with("my%20paint.png: cannot read"), "{warning:?}");
}

#[test]
fn a_texture_that_cannot_be_read_is_named_and_leaves_the_base_colour() {
    let material = r#"{"pbrMetallicRoughness":{"baseColorFactor":[1,0,0,1],"baseColorTexture":{"index":0}}}"#;
    let mut damaged = png(4, 4, &[GREEN; 16]);
    damaged.truncate(50);
    // A JPEG's header says its size: here 65,500 x 65,500.
    let mut huge = encoded(8, 8, &[GREEN; 64], ImageFormat::Jpeg);
    let frame = huge.windows(2).position(|two| two == [0xff, 0xc0]).unwrap();
    huge[frame + 5..frame + 9].copy_from_slice(&[0xff, 0xdc, 0xff, 0xdc]);
    for (image, why) in [(&damaged, ""), (&huge, "--max-vertices"), (&b"\xABKTX 20\xBB".to_vec(), "")] {
        let imported = import_bytes("a.glb", &textured([[0.5; 2]; 3], image, material, SOURCE, "")).unwrap();
        assert_eq!(colour(&imported.model.meshes[0]), RED);
        let warning = &imported.report.warnings[0];
        assert_eq!((warning.kind, warning.count), (WarningKind::TextureUnread, 1));
        assert!(warning.detail.starts_with("paint: ") && warning.detail.contains(why), "{warning:?}");
    }
    let none = textured([[0.5; 2]; 3], &damaged, material, "{}", "");
    let imported = import_bytes("a.glb", &none).unwrap();
    assert_eq!(imported.report.warnings[0].detail, "texture 0: it names no image");
}

#[test]
fn specular_glossiness_has_a_diffuse_colour_and_texture() {
    let glossy = |members: &str| {
        format!(r#"{{"extensions":{{"KHR_materials_pbrSpecularGlossiness":{{{members}}}}}}}"#)
    };
    let image = png(1, 1, &[GREEN]);
    let plain = textured([[0.5; 2]; 3], &image, &glossy(r#""diffuseFactor":[1,0,0,1]"#), SOURCE, "");
    assert_eq!(colour(&mesh(&plain)), RED);
    let material = glossy(r#""diffuseTexture":{"index":0}"#);
    let file = textured(
        [[0.5; 2]; 3],
        &image,
        &material,
        SOURCE,
        r#","extensionsRequired":["KHR_materials_pbrSpecularGlossiness"]"#,
    );
    assert_eq!(colour(&mesh(&file)), GREEN);
}

/// One triangle with these vertex colours and a material.
fn coloured(bytes: &[u8], component: u32, kind: &str, more: &str, material: &str) -> Vec<u8> {
    let mut document = Document::triangle();
    let view = document.view(bytes, "");
    let colours = document.raw_accessor(&format!(
        r#"{{"bufferView":{view},"componentType":{component},"count":3,"type":"{kind}"{more}}}"#
    ));
    document.glb(&format!(
        r#"{NODE},"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"COLOR_0":{colours}}},"material":0}}]}}],
        "materials":[{material}]"#
    ))
}

#[test]
fn vertex_colours_of_every_type_multiply_the_base_colour() {
    let material = r#"{"alphaMode":"BLEND","pbrMetallicRoughness":{"baseColorFactor":[1,0.5,1,0.5]}}"#;
    let normalized = r#","normalized":true"#;
    let three: Vec<u8> = [255, 255, 0].repeat(3);
    let four: Vec<u8> = [255, 255, 0, 128].repeat(3);
    let wide = |bytes: &[u8]| bytes.iter().flat_map(|&byte| [byte, byte]).collect::<Vec<u8>>();
    let real = |bytes: &[u8]| floats(&bytes.iter().map(|&byte| f32::from(byte) / 255.0).collect::<Vec<_>>());
    for (bytes, component, kind, more, alpha) in [
        (three.clone(), 5121, "VEC3", normalized, 128),
        (four.clone(), 5121, "VEC4", normalized, 64),
        (four.clone(), 5121, "VEC4", "", 64),
        (wide(&three), 5123, "VEC3", normalized, 128),
        (wide(&four), 5123, "VEC4", normalized, 64),
        (real(&three), 5126, "VEC3", "", 128),
        (real(&four), 5126, "VEC4", "", 64),
    ] {
        let file = coloured(&bytes, component, kind, more, material);
        about(colour(&mesh(&file)), [255, 188, 0, alpha], 1);
    }
}

#[test]
fn a_gradient_of_vertex_colours_survives_in_pieces_of_about_one_colour() {
    let gradient = floats(&[1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0]);
    let mesh = mesh(&coloured(&gradient, 5126, "VEC3", "", "{}"));
    let firsts: HashSet<[u8; 4]> =
        mesh.indices.chunks(3).map(|corners| mesh.colours[corners[0] as usize].0).collect();
    assert!(
        firsts.len() > 12 && mesh.triangle_count() < 1_000,
        "{} of {}",
        firsts.len(),
        mesh.triangle_count()
    );
    assert!(firsts.contains(&RED) && mesh.colours.contains(&Rgba8([0, 0, 255, 255])));
    // The pieces cover the triangle, each in its place's colour.
    for (at, colour) in mesh.positions.iter().zip(&mesh.colours) {
        assert!(at.min_element() >= 0.0 && at.x + at.y <= 1.0 + 1e-6 && at.z == 0.0, "{at}");
        let light = f64::from(at.x);
        let blue = if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 };
        assert!((f64::from(colour.0[2]) - blue * 255.0).abs() <= 1.0, "{at} {colour:?}");
    }
}

#[test]
fn alpha_means_what_the_mode_says() {
    let alphas = floats(&[1.0, 1.0, 1.0, 0.4].repeat(3));
    let of = |mode: &str| {
        let file = coloured(&alphas, 5126, "VEC4", "", &format!("{{{mode}}}"));
        let imported = import_bytes("a.glb", &file).unwrap();
        imported.model.meshes.first().map(colour)
    };
    assert_eq!(of(""), Some(WHITE), "opaque");
    assert_eq!(of(r#""alphaMode":"BLEND""#), Some([255, 255, 255, 102]));
    assert_eq!(of(r#""alphaMode":"MASK""#), None, "below the cutoff of a half");
    assert_eq!(of(r#""alphaMode":"MASK","alphaCutoff":0.3"#), Some(WHITE), "solid above the cutoff");
}

#[test]
fn a_mask_texture_is_as_opaque_as_it_has_no_holes() {
    let grating: Vec<_> = (0..64).map(|at| [90, 90, 90, if at % 2 == 0 { 200 } else { 10 }]).collect();
    let material = BASE.replace(r#""name":"shell""#, r#""alphaMode":"MASK""#);
    let file = textured([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], &png(8, 8, &grating), &material, SOURCE, "");
    about(colour(&mesh(&file)), [90, 90, 90, 128], 20);
    let hole = textured([[0.5; 2]; 3], &png(1, 1, &[[0; 4]]), &material, SOURCE, "");
    let imported = import_bytes("a.glb", &hole).unwrap();
    assert_eq!(imported.report.counts(), [(WarningKind::EmptyObject, 1)]);
}
