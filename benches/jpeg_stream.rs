//! The cost of a stream of JPEG pictures of a walk that are as good as the pictures that a display draws of
//! the scene itself. Compare it with the figures of `empty_display` for the same walk.
//!
//! `cargo bench --bench jpeg_stream -- X.scene [FRAMES [EPSILON [EVERY]]]`: an automatic walk without a jump
//! of 120 frames at 2 px, if not given, of which each twelfth picture is looked at. As good is what differs
//! from full detail by no more: the mean of FLIP (Andersson et al. 2020). The stream has pictures of full
//! detail, at the least quality for that; at the best one where that is not as good.

use std::{error::Error, path::Path, sync::Arc};

use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageFormat};
use trimaran_audit::metrics::{ImageRef, flip};
use trimaran_cull::{Image, LodRule, View, Viewport, draw_order, lod_cut};
use trimaran_gpu::{Gpu, GpuOptions, GpuScene, PicturePass};
use trimaran_proto::FrameNumber;
use trimaran_scene::{
    Scene,
    path::{AutoPathOptions, auto},
};

type Outcome<T> = Result<T, Box<dyn Error>>;

const SIDE: u32 = 1024;
/// Pictures a second.
const HZ: f64 = 30.0;
/// So small that the finest level of everything is drawn.
const FINEST_PX: f64 = 1e-9;

fn main() -> Outcome<()> {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect();
    let [scene, rest @ ..] = words.as_slice() else {
        println!("skipped: give a cooked scene: cargo bench --bench jpeg_stream -- X.scene [FRAMES ..]");
        return Ok(());
    };
    let frames = rest.first().map_or(Ok(120), |word| word.parse())?;
    let epsilon = rest.get(1).map_or(Ok(2.0), |word| word.parse())?;
    let every = rest.get(2).map_or(Ok(12), |word| word.parse())?;
    let scene = Arc::new(Scene::open(Path::new(scene))?);
    let size = Viewport::new(SIDE, SIDE)?;
    let drawn = GpuScene::new(&Gpu::open(&GpuOptions::default())?, &scene)?;
    let mut screen = Screen { pass: PicturePass::new(&drawn, size)?, scene: Arc::clone(&scene) };
    let options = AutoPathOptions { frames, seed: 1, teleport: false };
    let path = auto(&scene, &options)?.path;
    let near = path.near().unwrap_or(0.1);
    let mut found = Vec::new();
    for pose in path.frames().iter().step_by(every) {
        let view = View::new(pose.camera(path.vfov_deg(), near, FrameNumber(0))?, size);
        let (shown, full) = (screen.draw(&view, epsilon)?, screen.draw(&view, FINEST_PX)?);
        let bound = difference(&full, &shown)?;
        found.push((bound, as_good(&full, bound)?));
    }
    println!("| pictures | FLIP, mean | JPEG as good | quality: median | bytes: median | Mbit/s |");
    println!("|---|---|---|---|---|---|");
    let jpegs = || found.iter().map(|(_, jpeg)| jpeg);
    let bytes = jpegs().map(|jpeg| jpeg.bytes as f64);
    println!(
        "| {} | {:.5} | {} | {:.0} | {:.0} | {:.1} |",
        found.len(),
        found.iter().map(|(bound, _)| bound).sum::<f64>() / found.len() as f64,
        jpegs().filter(|jpeg| jpeg.is_as_good).count(),
        median(jpegs().map(|jpeg| f64::from(jpeg.quality))),
        median(bytes.clone()),
        8e-6 * HZ * bytes.sum::<f64>() / found.len() as f64,
    );
    Ok(())
}

/// A picture of the stream.
struct Jpeg {
    quality: u8,
    bytes: usize,
    is_as_good: bool,
}

/// The JPEG of least quality that differs from the picture by no more than `bound`.
fn as_good(picture: &Image, bound: f64) -> Outcome<Jpeg> {
    let (mut least, mut most) = (1, 101);
    while least < most {
        let quality = (least + most) / 2;
        match difference(picture, &decoded(&encoded(picture, quality)?)?)? <= bound {
            true => most = quality,
            false => least = quality + 1,
        }
    }
    let quality = least.min(100);
    Ok(Jpeg { quality, bytes: encoded(picture, quality)?.len(), is_as_good: least <= 100 })
}

fn encoded(picture: &Image, quality: u8) -> Outcome<Vec<u8>> {
    let rgb: Vec<u8> = picture.rgba.chunks_exact(4).flat_map(|pixel| pixel[..3].to_vec()).collect();
    let mut jpeg = Vec::new();
    let mut encoder = JpegEncoder::new_with_quality(&mut jpeg, quality);
    encoder.encode(&rgb, picture.width, picture.height, ExtendedColorType::Rgb8)?;
    Ok(jpeg)
}

fn decoded(jpeg: &[u8]) -> Outcome<Image> {
    let picture = image::load_from_memory_with_format(jpeg, ImageFormat::Jpeg)?.into_rgba8();
    Ok(Image { width: picture.width(), height: picture.height(), rgba: picture.into_raw() })
}

fn difference(reference: &Image, picture: &Image) -> Outcome<f64> {
    Ok(flip(&ImageRef::of(reference)?, &ImageRef::of(picture)?)?.mean())
}

struct Screen {
    scene: Arc<Scene>,
    pass: PicturePass,
}

impl Screen {
    fn draw(&mut self, view: &View, epsilon: f64) -> Outcome<Image> {
        let mut ids = lod_cut(&self.scene, view, LodRule::new(epsilon)?);
        draw_order(&self.scene, view, &mut ids);
        let mut picture = Image::default();
        self.pass.begin(view)?;
        self.pass.draw(&ids)?;
        self.pass.finish()?;
        self.pass.read(&mut picture)?;
        Ok(picture)
    }
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<_> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
