//! Base colour textures. A model has one colour per triangle and no textures: that of a textured triangle is
//! the mean of the texels under it, in linear light.

use std::collections::HashMap;
use std::io::Cursor;
use std::sync::LazyLock;

use image::{ImageReader, Limits, RgbaImage};
use rayon::prelude::*;

use super::accessor::Accessors;
use super::buffers::{Bytes, Resources, is_data};
use super::json::Document;
use super::material::{Alpha, Material, TextureInfo, TextureTransform, encoded, linear};
use crate::import::budget::Budget;
use crate::import::report::{ImportReport, WarningKind};

/// The textures that a document's base colours need.
pub(super) struct Textures {
    /// By image and the meaning of its alpha.
    pyramids: HashMap<(u32, Alpha), Pyramid>,
}

impl Textures {
    /// The textures of the given materials. An unreadable one causes a warning, and is absent.
    pub(super) fn load<'a>(
        document: &Document,
        accessors: &Accessors<'_>,
        resources: &mut Resources<'_, '_>,
        materials: impl Iterator<Item = &'a Material>,
        budget: &Budget,
        report: &mut ImportReport,
    ) -> Self {
        let mut wanted: Vec<(u32, Alpha)> = Vec::new();
        for material in materials {
            let Some(info) = material.texture() else { continue };
            match document.textures.get(info.index as usize).and_then(super::material::Texture::image) {
                Some(image) => wanted.push((image, material.texture_alpha())),
                None => {
                    let detail = format!("texture {}: it names no image", info.index);
                    report.warn_about(WarningKind::TextureUnread, &detail, 1);
                }
            }
        }
        wanted.sort_unstable_by_key(|&(image, alpha)| (image, format!("{alpha:?}")));
        wanted.dedup();
        let files: Vec<_> = wanted
            .into_iter()
            .map(|key| (key, encoded_image(document, accessors, resources, key.0)))
            .collect();
        let decoded: Vec<_> = files
            .into_par_iter()
            .map(|(key, bytes)| {
                (key, bytes.and_then(|bytes| Pyramid::decode(bytes.as_slice(), key.1, budget)))
            })
            .collect();
        let mut pyramids = HashMap::new();
        for (key, pyramid) in decoded {
            match pyramid {
                Ok(pyramid) => {
                    pyramids.insert(key, pyramid);
                }
                Err(why) => {
                    let detail = format!("{}: {why}", image_name(document, key.0));
                    report.warn_about(WarningKind::TextureUnread, &detail, 1);
                }
            }
        }
        Self { pyramids }
    }

    /// The texture of a material and its mapping, if it has one that could be read.
    pub(super) fn of<'t>(&'t self, document: &Document, material: &'t Material) -> Option<Placed<'t>> {
        let info = material.texture()?;
        let texture = document.textures.get(info.index as usize)?;
        let pyramid = self.pyramids.get(&(texture.image()?, material.texture_alpha()))?;
        let sampler = texture.sampler.and_then(|sampler| document.samplers.get(sampler as usize));
        let wrap = sampler.map_or([None; 2], |sampler| [sampler.wrap_s, sampler.wrap_t]).map(Wrap::of);
        Some(Placed { pyramid, wrap, info })
    }
}

/// The name of an image in a warning.
fn image_name(document: &Document, index: u32) -> String {
    let image = document.images.get(index as usize);
    let file = |uri: &&str| !is_data(uri);
    let name = image.and_then(|image| image.name.as_deref().or(image.uri.as_deref().filter(file)));
    name.map_or_else(|| format!("image {index}"), str::to_owned)
}

/// The bytes of an image's file.
fn encoded_image<'a>(
    document: &Document,
    accessors: &Accessors<'a>,
    resources: &mut Resources<'_, '_>,
    index: u32,
) -> Result<Bytes<'a>, String> {
    let image = document.images.get(index as usize).ok_or("it does not exist")?;
    match (&image.uri, image.buffer_view) {
        (_, Some(view)) => Ok(Bytes::Within(accessors.view_bytes(view)?)),
        (Some(uri), None) => {
            let bytes = resources.fetch(uri).map_err(|error| error.to_string())?;
            Ok(Bytes::Shared { length: bytes.len(), bytes })
        }
        (None, None) => Err("it has no address and no bytes".into()),
    }
}

/// How a texture continues beyond its edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Wrap {
    Repeat,
    Mirror,
    Clamp,
}

impl Wrap {
    fn of(code: Option<u32>) -> Self {
        match code {
            Some(33071) => Self::Clamp,
            Some(33648) => Self::Mirror,
            _ => Self::Repeat,
        }
    }

    /// The texel of `size` at a coordinate.
    fn texel(self, at: f32, size: u32) -> u32 {
        let at = if at.is_finite() { f64::from(at) } else { 0.0 };
        let within = match self {
            Self::Repeat => at.rem_euclid(1.0),
            Self::Mirror => 1.0 - (at.rem_euclid(2.0) - 1.0).abs(),
            Self::Clamp => at.clamp(0.0, 1.0),
        };
        ((within * f64::from(size)) as u32).min(size.saturating_sub(1))
    }
}

/// A texture with a material's mapping.
pub(super) struct Placed<'t> {
    pyramid: &'t Pyramid,
    wrap: [Wrap; 2],
    info: &'t TextureInfo,
}

/// The colour of a texture over a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Mean {
    /// Linear, with straight alpha.
    pub colour: [f32; 4],
    /// Whether the texture has more than one colour there.
    pub varies: bool,
}

/// A triangle is sampled at most at the square of this many places: twice as dense as its texels.
const MOST_STEPS: u32 = 16;

impl Placed<'_> {
    /// The index of its texture coordinates.
    pub(super) fn coordinates(&self) -> u32 {
        self.info.coordinates()
    }

    /// The mean over a triangle with these texture coordinates.
    pub(super) fn mean(&self, corners: [[f32; 2]; 3]) -> Mean {
        let transform = self.info.transform();
        let [a, b, c] = corners.map(|corner| transform.map_or(corner, |transform| transform.apply(corner)));
        let texels = |from: [f32; 2], to: [f32; 2]| {
            let [width, height] = self.pyramid.size().map(|size| size as f32);
            ((to[0] - from[0]).abs() * width).max((to[1] - from[1]).abs() * height)
        };
        let wanted = 2.0 * texels(a, b).max(texels(b, c)).max(texels(c, a));
        // The casts clamp, and make NaN 0.
        let steps = (wanted.ceil() as u32).clamp(1, MOST_STEPS);
        let level = (wanted / MOST_STEPS as f32).log2().ceil().max(0.0) as usize;
        let level = self.pyramid.level(level);
        let mut sum = Sum::default();
        for (s, t) in centres(steps) {
            let at = [0, 1].map(|axis| a[axis] + (b[axis] - a[axis]) * s + (c[axis] - a[axis]) * t);
            let [x, y] = [self.wrap[0].texel(at[0], level.width), self.wrap[1].texel(at[1], level.height)];
            level.add(&mut sum, x, y);
        }
        Mean { colour: sum.mean(), varies: sum.varies }
    }
}

/// The centres of the `steps`² equal pieces of a triangle, as shares of its second and third corner.
fn centres(steps: u32) -> impl Iterator<Item = (f32, f32)> {
    let at = move |row: u32, column: u32, third: f32| {
        ((row as f32 + third) / steps as f32, (column as f32 + third) / steps as f32)
    };
    (0..steps).flat_map(move |row| {
        let upright = (0..steps - row).map(move |column| at(row, column, 1.0 / 3.0));
        let turned = (0..steps - row - 1).map(move |column| at(row, column, 2.0 / 3.0));
        upright.chain(turned)
    })
}

impl TextureTransform {
    /// KHR_texture_transform: scaled, then rotated, then moved. Texture coordinates grow downwards, so
    /// rotations appear counter-clockwise.
    fn apply(&self, [u, v]: [f32; 2]) -> [f32; 2] {
        let [scale_u, scale_v] = self.scale.unwrap_or([1.0; 2]);
        let [move_u, move_v] = self.offset.unwrap_or_default();
        let (sine, cosine) = self.rotation.unwrap_or_default().sin_cos();
        let (u, v) = (u * scale_u, v * scale_v);
        [cosine * u + sine * v + move_u, cosine * v - sine * u + move_v]
    }
}

/// A mip pyramid: each texel is the mean of those that it covers, so sampling a triangle costs the same for
/// any number of texels.
#[derive(Debug)]
struct Pyramid {
    /// The finest first, the coarsest a single texel.
    levels: Vec<Level>,
}

#[derive(Debug)]
struct Level {
    width: u32,
    height: u32,
    /// sRGB with straight alpha, by rows.
    texels: Vec<[u8; 4]>,
    /// Whether each covers several colours; in the finest level none does.
    mixed: Vec<bool>,
}

impl Pyramid {
    /// Decodes an image. Its size is counted before memory is allocated.
    fn decode(bytes: &[u8], alpha: Alpha, budget: &Budget) -> Result<Self, String> {
        let reader = || -> Result<_, String> {
            let mut reader = ImageReader::new(Cursor::new(bytes))
                .with_guessed_format()
                .map_err(|error| error.to_string())?;
            reader.limits(Limits::no_limits());
            Ok(reader)
        };
        let (width, height) = reader()?.into_dimensions().map_err(|error| error.to_string())?;
        let texels = u64::from(width) * u64::from(height);
        if texels == 0 {
            return Err("it is empty".into());
        }
        if !budget.texels(texels) {
            return Err(format!(
                "its {width} x {height} texels are more than --max-vertices leaves room for"
            ));
        }
        let mut reader = reader()?;
        let mut limits = Limits::no_limits();
        limits.max_image_width = Some(width);
        limits.max_image_height = Some(height);
        limits.max_alloc = Some(16 * texels + (1 << 20));
        reader.limits(limits);
        let image = reader.decode().map_err(|error| error.to_string())?.into_rgba8();
        Ok(Self::of(image, alpha))
    }

    fn of(image: RgbaImage, alpha: Alpha) -> Self {
        let (width, height) = image.dimensions();
        let mut texels = image.into_raw().as_chunks::<4>().0.to_vec();
        for [.., a] in &mut texels {
            *a = match alpha {
                Alpha::Opaque => 255,
                Alpha::Mask(cutoff) if *a < cutoff => 0,
                Alpha::Mask(_) => 255,
                Alpha::Blend => *a,
            };
        }
        let mut levels = vec![Level { width, height, texels, mixed: Vec::new() }];
        while let Some(half) = levels.last().and_then(Level::half) {
            levels.push(half);
        }
        Self { levels }
    }

    fn size(&self) -> [u32; 2] {
        self.levels.first().map_or([0; 2], |level| [level.width, level.height])
    }

    /// The level after this many halvings, or the coarsest.
    fn level(&self, halvings: usize) -> &Level {
        static NONE: Level = Level { width: 0, height: 0, texels: Vec::new(), mixed: Vec::new() };
        self.levels.get(halvings).or(self.levels.last()).unwrap_or(&NONE)
    }
}

impl Level {
    /// Adds one texel.
    fn add(&self, sum: &mut Sum, x: u32, y: u32) {
        let at = y as usize * self.width as usize + x as usize;
        sum.add(self.texels.get(at).copied().unwrap_or([255; 4]));
        sum.varies |= self.mixed.get(at).copied().unwrap_or(false);
    }

    /// The next coarser level; none of a single texel.
    fn half(&self) -> Option<Self> {
        if self.width <= 1 && self.height <= 1 {
            return None;
        }
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let row = |y: u32| {
            (0..width).map(move |x| {
                let mut sum = Sum::default();
                let right = (2 * x + 1).min(self.width - 1);
                let below = (2 * y + 1).min(self.height - 1);
                for (x, y) in [(2 * x, 2 * y), (right, 2 * y), (2 * x, below), (right, below)] {
                    self.add(&mut sum, x, y);
                }
                (encoded(sum.mean()).0, sum.varies)
            })
        };
        let (texels, mixed) = (0..height).flat_map(row).unzip();
        Some(Self { width, height, texels, mixed })
    }
}

/// Texels added up in linear light. Colours are weighted by opacity: clear ones have no weight.
#[derive(Default)]
struct Sum {
    first: Option<[u8; 4]>,
    varies: bool,
    count: f32,
    opaque: [f32; 3],
    plain: [f32; 3],
    alpha: f32,
}

static LINEAR: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|value| linear(value as f32 / 255.0)));

impl Sum {
    fn add(&mut self, texel: [u8; 4]) {
        self.varies |= *self.first.get_or_insert(texel) != texel;
        let [r, g, b, a] = texel;
        let alpha = f32::from(a) / 255.0;
        self.count += 1.0;
        self.alpha += alpha;
        for (channel, value) in [r, g, b].into_iter().enumerate() {
            let light = LINEAR[usize::from(value)];
            self.opaque[channel] += light * alpha;
            self.plain[channel] += light;
        }
    }

    fn mean(&self) -> [f32; 4] {
        let count = self.count.max(1.0);
        let [r, g, b] = if self.alpha > 0.0 {
            self.opaque.map(|light| light / self.alpha)
        } else {
            self.plain.map(|light| light / count)
        };
        [r, g, b, self.alpha / count]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgba;

    fn pyramid(width: u32, height: u32, texel: impl Fn(u32, u32) -> [u8; 4], alpha: Alpha) -> Pyramid {
        Pyramid::of(RgbaImage::from_fn(width, height, |x, y| Rgba(texel(x, y))), alpha)
    }

    fn mean(pyramid: &Pyramid, wrap: Wrap, corners: [[f32; 2]; 3]) -> Mean {
        let info = TextureInfo::default();
        Placed { pyramid, wrap: [wrap; 2], info: &info }.mean(corners)
    }

    #[test]
    fn the_centres_share_a_triangle_evenly() {
        for steps in 1..=MOST_STEPS {
            let all: Vec<_> = centres(steps).collect();
            assert_eq!(all.len() as u32, steps * steps);
            let (s, t) = all.iter().fold((0.0, 0.0), |sum, at| (sum.0 + at.0, sum.1 + at.1));
            let third = all.len() as f32 / 3.0;
            assert!((s - third).abs() < 1e-3 && (t - third).abs() < 1e-3, "{steps}: {s} {t}");
            assert!(all.iter().all(|&(s, t)| s > 0.0 && t > 0.0 && s + t < 1.0));
        }
    }

    #[test]
    fn a_point_of_a_palette_is_its_texel() {
        let palette = pyramid(4, 1, |x, _| [60 * x as u8, 0, 0, 255], Alpha::Opaque);
        for x in 0..4 {
            let at = [(x as f32 + 0.5) / 4.0, 0.5];
            let mean = mean(&palette, Wrap::Repeat, [at; 3]);
            assert_eq!((encoded(mean.colour).0, mean.varies), ([60 * x as u8, 0, 0, 255], false));
        }
    }

    #[test]
    fn black_and_white_make_the_grey_of_half_the_light_at_any_size() {
        for size in [2, 8, 64, 1024] {
            let board = pyramid(size, size, |x, y| [[0, 255][((x + y) % 2) as usize]; 4], Alpha::Opaque);
            let mean = mean(&board, Wrap::Repeat, [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]);
            assert!(mean.varies, "{size}");
            let [grey, .., a] = encoded(mean.colour).0;
            assert!((180..=196).contains(&grey) && a == 255, "{size}: {grey}");
        }
    }

    #[test]
    fn what_is_clear_has_no_colour() {
        let texel = |x, _| if x == 0 { [255, 0, 0, 255] } else { [0, 255, 0, 0] };
        let whole = [[0.25, 0.5], [0.75, 0.5], [0.5, 0.5]];
        let blend = mean(&pyramid(2, 1, texel, Alpha::Blend), Wrap::Clamp, whole);
        assert_eq!(&encoded(blend.colour).0[..3], [255, 0, 0]);
        assert!((0.2..0.8).contains(&blend.colour[3]), "{blend:?}");
        let opaque = mean(&pyramid(2, 1, texel, Alpha::Opaque), Wrap::Clamp, whole);
        assert!(opaque.colour[1] > 0.1 && opaque.colour[3] == 1.0, "{opaque:?}");
        let mask = pyramid(2, 1, |x, _| [9, 9, 9, [127, 128][x as usize]], Alpha::Mask(128));
        let [left, right] = [0.1, 0.9].map(|u| mean(&mask, Wrap::Clamp, [[u, 0.5]; 3]).colour[3]);
        assert_eq!([left, right], [0.0, 1.0]);
    }

    #[test]
    fn coordinates_beyond_the_edge_repeat_mirror_or_stop() {
        let texels = |wrap: Wrap| [-1.25, -0.25, 0.25, 0.75, 1.25, 2.25].map(|at| wrap.texel(at, 2));
        assert_eq!(texels(Wrap::Repeat), [1, 1, 0, 1, 0, 0]);
        assert_eq!(texels(Wrap::Mirror), [1, 0, 0, 1, 1, 0]);
        assert_eq!(texels(Wrap::Clamp), [0, 0, 0, 1, 1, 1]);
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
            for at in [f32::NAN, f32::INFINITY, f32::MIN, f32::MAX, 1.0, -0.0] {
                assert!(wrap.texel(at, 7) < 7);
            }
        }
    }

    #[test]
    fn a_transform_scales_then_turns_then_moves() {
        let transform = TextureTransform {
            offset: Some([0.5, 0.25]),
            rotation: Some(std::f32::consts::FRAC_PI_2),
            scale: Some([2.0, 3.0]),
            tex_coord: None,
        };
        let [u, v] = transform.apply([1.0, 1.0]);
        assert!((u - 3.5).abs() < 1e-6 && (v + 1.75).abs() < 1e-6, "{u} {v}");
        assert_eq!(TextureTransform::default().apply([0.3, 0.7]), [0.3, 0.7]);
    }
}
