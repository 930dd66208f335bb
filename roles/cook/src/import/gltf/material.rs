//! A material's colour: its base colour, the texture over it, and the meaning of alpha.

use trimaran_scene::Rgba8;

use super::objects::objects;

objects! {
    pub(super) struct Material {
        pub name: Option<String>,
        pbr_metallic_roughness: Metallic,
        alpha_mode: Option<Box<str>>,
        alpha_cutoff: Option<f32>,
        extensions: Option<Box<MaterialExtensions>>,
    }

    struct Metallic {
        /// Linear red, green, blue, alpha.
        base_color_factor: Option<[f32; 4]>,
        base_color_texture: Option<TextureInfo>,
    }

    struct MaterialExtensions {
        specular_glossiness: Option<SpecularGlossiness> = "KHR_materials_pbrSpecularGlossiness",
    }

    struct SpecularGlossiness {
        diffuse_factor: Option<[f32; 4]>,
        diffuse_texture: Option<TextureInfo>,
    }

    /// A reference to a texture, and its mapping.
    pub(super) struct TextureInfo {
        pub index: u32,
        tex_coord: u32,
        extensions: Option<Box<TextureInfoExtensions>>,
    }

    struct TextureInfoExtensions {
        transform: Option<TextureTransform> = "KHR_texture_transform",
    }

    pub(super) struct TextureTransform {
        pub offset: Option<[f32; 2]>,
        /// Radians, counter-clockwise about the upper left corner.
        pub rotation: Option<f32>,
        pub scale: Option<[f32; 2]>,
        pub tex_coord: Option<u32>,
    }

    pub(super) struct Texture {
        pub sampler: Option<u32>,
        source: Option<u32>,
        extensions: Option<Box<TextureExtensions>>,
    }

    struct TextureExtensions {
        webp: Option<TextureSource> = "EXT_texture_webp",
        basisu: Option<TextureSource> = "KHR_texture_basisu",
        dds: Option<TextureSource> = "MSFT_texture_dds",
    }

    struct TextureSource {
        source: Option<u32>,
    }

    pub(super) struct Sampler {
        pub wrap_s: Option<u32>,
        pub wrap_t: Option<u32>,
    }

    pub(super) struct Image {
        pub name: Option<String>,
        pub uri: Option<String>,
        pub buffer_view: Option<u32>,
    }
}

impl TextureInfo {
    /// The index of its texture coordinates.
    pub(super) fn coordinates(&self) -> u32 {
        self.transform().and_then(|transform| transform.tex_coord).unwrap_or(self.tex_coord)
    }

    pub(super) fn transform(&self) -> Option<&TextureTransform> {
        self.extensions.as_ref()?.transform.as_ref()
    }
}

impl Texture {
    /// Its image: the first that can be read.
    pub(super) fn image(&self) -> Option<u32> {
        let extensions = self.extensions.as_ref();
        let webp = extensions.and_then(|of| of.webp.as_ref()?.source);
        let other = || extensions.and_then(|of| of.basisu.as_ref().or(of.dds.as_ref())?.source);
        webp.or(self.source).or_else(other)
    }
}

/// The meaning of alpha.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Alpha {
    /// Nothing.
    Opaque,
    /// Alpha below this, of 255, is a hole; the rest is solid.
    Mask(u8),
    /// Alpha is opacity.
    Blend,
}

impl Material {
    /// Replaces NaN by defaults, and returns the names of the values.
    pub(super) fn settle(&mut self) -> Vec<&'static str> {
        let mut found = Vec::new();
        let glossy = self.extensions.as_mut().and_then(|all| all.specular_glossiness.as_mut());
        let (factor, texture) = match glossy {
            Some(glossy) => (&mut glossy.diffuse_factor, &mut glossy.diffuse_texture),
            None => {
                let metallic = &mut self.pbr_metallic_roughness;
                (&mut metallic.base_color_factor, &mut metallic.base_color_texture)
            }
        };
        for channel in factor.as_mut().into_iter().flatten().filter(|channel| channel.is_nan()) {
            *channel = 1.0;
            found.push("values of the base colour that are no numbers: taken as 1");
        }
        if self.alpha_cutoff.take_if(|cutoff| cutoff.is_nan()).is_some() {
            found.push("an alpha cutoff that is no number: taken as 0.5");
        }
        let extensions = texture.as_mut().and_then(|info| info.extensions.as_mut());
        if let Some(transform) = extensions.and_then(|all| all.transform.as_mut()) {
            let is_none = |pair: &mut [f32; 2]| pair.iter().any(|number| !number.is_finite());
            let offset = transform.offset.take_if(is_none).is_some();
            let scale = transform.scale.take_if(is_none).is_some();
            if transform.rotation.take_if(|angle| !angle.is_finite()).is_some() || offset || scale {
                found.push("texture transforms that are no numbers: left out");
            }
        }
        found
    }

    /// Linear red, green, blue, alpha.
    pub(super) fn factor(&self) -> [f32; 4] {
        let factor = match self.specular_glossiness() {
            Some(colours) => colours.diffuse_factor,
            None => self.pbr_metallic_roughness.base_color_factor,
        };
        factor.unwrap_or([1.0; 4])
    }

    /// The texture that its base colour is multiplied by.
    pub(super) fn texture(&self) -> Option<&TextureInfo> {
        match self.specular_glossiness() {
            Some(colours) => colours.diffuse_texture.as_ref(),
            None => self.pbr_metallic_roughness.base_color_texture.as_ref(),
        }
    }

    /// The meaning of its colours' alpha. Some programs write modes in lower case, and extensions add others,
    /// which blend.
    pub(super) fn alpha(&self) -> Alpha {
        match self.alpha_mode.as_deref() {
            None => Alpha::Opaque,
            Some(mode) if mode.eq_ignore_ascii_case("OPAQUE") => Alpha::Opaque,
            Some(mode) if mode.eq_ignore_ascii_case("MASK") => Alpha::Mask(byte(self.cutoff())),
            Some(_) => Alpha::Blend,
        }
    }

    /// The meaning of its texture's alpha, before it is multiplied by the base colour's.
    pub(super) fn texture_alpha(&self) -> Alpha {
        match self.alpha() {
            // 0 by 0 is no hole: nothing is below 0.
            Alpha::Mask(_) => Alpha::Mask(byte(self.cutoff() / self.factor()[3])),
            alpha => alpha,
        }
    }

    fn cutoff(&self) -> f32 {
        self.alpha_cutoff.unwrap_or(0.5)
    }

    fn specular_glossiness(&self) -> Option<&SpecularGlossiness> {
        self.extensions.as_ref()?.specular_glossiness.as_ref()
    }
}

/// A linear colour with straight alpha, in the stored form.
pub(super) fn encoded([r, g, b, a]: [f32; 4]) -> Rgba8 {
    Rgba8([byte(srgb(r)), byte(srgb(g)), byte(srgb(b)), byte(a)])
}

/// Linear light to sRGB (IEC 61966-2-1).
pub(super) fn srgb(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// sRGB to linear light.
pub(super) fn linear(srgb: f32) -> f32 {
    if srgb <= 0.040_45 { srgb / 12.92 } else { ((srgb + 0.055) / 1.055).powf(2.4) }
}

/// 0..1 to 0..255; the cast clamps, and makes NaN 0.
pub(super) fn byte(value: f32) -> u8 {
    (value * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    fn material(json: &str) -> Material {
        serde_json::from_str(json).unwrap()
    }

    #[test]
    fn colours_go_from_linear_to_srgb_and_back() {
        assert_eq!(encoded([0.5, 0.0, 1.0, 0.5]), Rgba8([188, 0, 255, 128]));
        assert_eq!(encoded([f32::NAN, -1.0, 9.0, f32::INFINITY]), Rgba8([0, 0, 255, 255]));
        for value in 0..=255u8 {
            assert_eq!(byte(srgb(linear(f32::from(value) / 255.0))), value);
        }
    }

    #[test]
    fn specular_glossiness_outranks_metallic_roughness() {
        let both = material(
            r#"{"pbrMetallicRoughness":{"baseColorFactor":[0,1,0,1]},"extensions":{"KHR_materials_pbrSpecularGlossiness":
            {"diffuseFactor":[1,0,0,0.5],"diffuseTexture":{"index":3,"texCoord":1}}}}"#,
        );
        assert_eq!(both.factor(), [1.0, 0.0, 0.0, 0.5]);
        assert_eq!(both.texture().map(|info| (info.index, info.coordinates())), Some((3, 1)));
        let plain = material(r#"{"pbrMetallicRoughness":{"baseColorFactor":[0,1,0,1]},"extensions":{}}"#);
        assert_eq!(plain.factor(), [0.0, 1.0, 0.0, 1.0]);
    }

    #[test]
    fn what_is_null_or_left_out_has_the_format_s_default() {
        let nulls =
            r#"{"pbrMetallicRoughness":{"baseColorFactor":null},"alphaMode":null,"alphaCutoff":null}"#;
        for json in ["{}", nulls] {
            let material = material(json);
            assert_eq!((material.factor(), material.alpha()), ([1.0; 4], Alpha::Opaque));
        }
        assert_eq!(material(r#"{"alphaMode":"MASK"}"#).alpha(), Alpha::Mask(128));
        assert_eq!(material(r#"{"alphaMode":"SOMETHING"}"#).alpha(), Alpha::Blend);
    }
}
