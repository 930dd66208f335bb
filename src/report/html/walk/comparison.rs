//! The pictures on the page: as shown, as they should be, and their differences.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use maud::{Markup, html};
#[cfg(feature = "lab")]
use trimaran_cull::Image;
use trimaran_cull::RgbImage;

#[cfg(feature = "lab")]
use super::flip::flip_map;
use crate::report::format::{figure, plural};
use crate::report::schema::{Frame, Report};

/// The longer side of an embedded picture, at most.
const SIDE: u32 = 512;
/// How many frames are shown at most.
const FRAMES: usize = 3;

/// The pictures of a frame, to be shown side by side.
#[derive(Debug)]
pub(in crate::report) struct Comparison {
    /// The frame.
    pub(in crate::report) frame: u32,
    /// Why it was chosen.
    pub(in crate::report) why: &'static str,
    /// The picture that RVG showed.
    pub(in crate::report) shown: RgbImage,
    /// The same LOD cut without culling.
    pub(in crate::report) unculled: Option<RgbImage>,
    /// Full detail without culling.
    pub(in crate::report) full: Option<RgbImage>,
}

/// The most interesting frames with pictures, each with a reason: the worst by culling error, the worst by
/// level-of-detail error, and a typical one.
pub(in crate::report) fn choose(report: &Report) -> Vec<(u32, &'static str)> {
    let shown: Vec<&Frame> = report.frames.iter().filter(|f| f.pictures.shown.is_some()).collect();
    let compared: Vec<&Frame> = shown
        .iter()
        .copied()
        .filter(|f| f.pictures.unculled.is_some() || f.pictures.full.is_some())
        .collect();
    let candidates = if compared.is_empty() { shown } else { compared };

    let mut chosen: Vec<(u32, &str)> = Vec::new();
    let mut add = |frame: Option<&&Frame>, why| {
        if let Some(frame) = frame.filter(|f| chosen.len() < FRAMES && chosen.iter().all(|c| c.0 != f.frame))
        {
            chosen.push((frame.frame, why));
        }
    };
    let wrong = |f: &&&Frame| f.cut_mismatch_pixels.unwrap_or(0).max(f.false_culled_pixels.unwrap_or(0));
    add(candidates.iter().filter(|f| wrong(f) > 0).max_by_key(wrong), "the most pixels changed by culling");
    let error = |f: &Frame| f.full_detail.and_then(|e| e.flip_mean);
    let mut by_error: Vec<&Frame> = candidates.iter().copied().filter(|f| error(f).is_some()).collect();
    by_error.sort_by(|a, b| error(a).partial_cmp(&error(b)).unwrap_or(std::cmp::Ordering::Equal));
    add(by_error.last(), "the largest level-of-detail error (FLIP)");
    add(by_error.get(by_error.len() / 2), "a typical level-of-detail error");
    add(candidates.get(candidates.len() / 2), "the middle of the walk");
    add(candidates.first(), "the first with pictures");
    chosen
}

pub(super) fn comparisons(report: &Report, comparisons: &[Comparison]) -> Markup {
    html! {
        @if !comparisons.is_empty() {
            h2 #pictures { "Pictures" }
            p.hint { "Click a picture to enlarge it. Pictures are scaled down; frames/ has them in full." }
            @for comparison in comparisons {
                section.comparison {
                    h3 { "Frame " (comparison.frame) ": " (comparison.why) }
                    div.panes { (panes(report, comparison)) }
                }
            }
        }
    }
}

fn panes(report: &Report, Comparison { frame, shown, unculled, full, .. }: &Comparison) -> Markup {
    let frame = report.frames.iter().find(|f| f.frame == *frame);
    html! {
        (pane("shown", "what RVG drew after culling", shown, Shrink::Mean))
        @if let Some(unculled) = unculled {
            (pane("unculled", "the same LOD cut without culling", unculled, Shrink::Mean))
            @if let Some(lit) = lit(shown, unculled) {
                (pane("shown against unculled", &culling_error(frame), &lit, Shrink::Brightest))
            }
        }
        @if let Some(full) = full {
            (pane("full detail", "finest levels, no culling", full, Shrink::Mean))
            @if let Some(map) = flip_map(full, shown) {
                (pane("shown against full detail", &detail_error(frame), &map, Shrink::Brightest))
            }
        }
    }
}

fn culling_error(frame: Option<&Frame>) -> String {
    match frame.and_then(|f| f.cut_mismatch_pixels) {
        None => "differing pixels are lit".to_owned(),
        Some(0) => "culling changed no pixel; one that differs would be lit".to_owned(),
        Some(pixels) => format!("culling changed the {} that are lit", plural(pixels, "pixel", "pixels")),
    }
}

fn detail_error(frame: Option<&Frame>) -> String {
    let Some(error) = frame.and_then(|f| f.full_detail) else { return String::new() };
    let psnr = error.psnr_db.map_or_else(|| "equal".to_owned(), |db| format!("PSNR {} dB", figure(db)));
    let flip = error.flip_mean.map_or_else(String::new, |f| format!(", mean FLIP {}", figure(f)));
    format!("{psnr}{flip}; brighter is more visible")
}

/// How to shrink a picture.
#[derive(Clone, Copy)]
pub(super) enum Shrink {
    /// By averaging: pictures.
    Mean,
    /// By taking the brightest pixel: differences, where a single wrong pixel must survive.
    Brightest,
}

pub(super) fn pane(title: &str, text: &str, image: &RgbImage, shrink: Shrink) -> Markup {
    let factor = image.width.max(image.height).div_ceil(SIDE);
    let small = match shrink {
        Shrink::Mean => image.shrink(factor, mean),
        Shrink::Brightest => image.shrink(factor, brightest),
    };
    html! {
        @if let Ok(file) = small.encode(png::Compression::Balanced) {
            figure {
                button.zoom type="button" aria-label="enlarge" {
                    img alt=(title) width=(small.width) height=(small.height)
                        src={ "data:image/png;base64," (STANDARD.encode(file)) };
                }
                figcaption { b { (title) } " " (text) }
            }
        }
    }
}

/// A picture as a pane; nothing if it has no pixels.
#[cfg(feature = "lab")]
pub(crate) fn pane_of(title: &str, text: &str, image: &Image) -> Markup {
    RgbImage::of(image).map_or_else(Markup::default, |image| pane(title, text, &image, Shrink::Mean))
}

fn mean(block: &[[u8; 3]]) -> [u8; 3] {
    let count = block.len().max(1);
    std::array::from_fn(|c| (block.iter().map(|p| usize::from(p[c])).sum::<usize>() / count) as u8)
}

fn brightest(block: &[[u8; 3]]) -> [u8; 3] {
    block.iter().copied().max_by_key(|p| p.iter().map(|&c| u32::from(c)).sum::<u32>()).unwrap_or_default()
}

/// White where the pictures differ, black where they agree; `None` if the sizes differ.
fn lit(a: &RgbImage, b: &RgbImage) -> Option<RgbImage> {
    if (a.width, a.height) != (b.width, b.height) {
        return None;
    }
    let pixels =
        a.pixels.iter().zip(&b.pixels).map(|(a, b)| if a == b { [0; 3] } else { [255; 3] }).collect();
    Some(RgbImage { width: a.width, height: a.height, pixels })
}

/// Without the laboratory no map is made.
#[cfg(not(feature = "lab"))]
fn flip_map(_: &RgbImage, _: &RgbImage) -> Option<RgbImage> {
    None
}
