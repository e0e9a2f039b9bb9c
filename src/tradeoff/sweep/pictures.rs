//! Pictures and error maps for the page.

use super::Bench;
use crate::error::Result;
use crate::math::view::View;
use crate::metrics::{Display, Picture, flip};
use crate::tradeoff::judge::split;
use crate::tradeoff::reference::Reference;

impl Bench<'_> {
    /// Keeps the first eye's picture and its error map for the page.
    pub(super) fn keep_pictures(
        &self,
        name: &str,
        picture: &Picture,
        references: &[Reference; 2],
        eyes: &[View],
    ) -> Result<()> {
        let shown = Display::from_picture(picture, self.viewing.exposure);
        let shown = split(&shown, eyes).swap_remove(0);
        let truth = split(&references[0].display, eyes).swap_remove(0);
        let map = flip::error_map(&shown, &truth, self.viewing.pixels_per_degree);
        let heat = Display { pixels: map.iter().map(|error| heat(*error)).collect(), ..shown.clone() };
        self.store.write_bytes(&format!("{name} picture"), "jpg", &jpeg(&shown))?;
        self.store.write_bytes(&format!("{name} error"), "jpg", &jpeg(&heat))
    }
}

/// Black over violet and orange to pale yellow, brighter with every step: near Matplotlib's "inferno".
fn heat(error: f32) -> [f32; 3] {
    const STOPS: [[f32; 3]; 5] =
        [[0.0, 0.0, 0.02], [0.34, 0.06, 0.43], [0.74, 0.22, 0.33], [0.98, 0.56, 0.04], [0.99, 1.0, 0.64]];
    let at = error.clamp(0.0, 1.0) * 4.0;
    let low = (at as usize).min(3);
    let part = at - low as f32;
    [0, 1, 2].map(|c| STOPS[low][c] + (STOPS[low + 1][c] - STOPS[low][c]) * part)
}

pub(super) fn jpeg(picture: &Display) -> Vec<u8> {
    let byte = |code: &f32| (code.clamp(0.0, 1.0) * 255.0).round() as u8;
    let bytes: Vec<u8> = picture.pixels.iter().flatten().map(byte).collect();
    let mut out = Vec::new();
    let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut out, 88);
    let kind = image::ExtendedColorType::Rgb8;
    // Writing to memory fails only for sizes that no view has.
    match image::ImageEncoder::write_image(encoder, &bytes, picture.width, picture.height, kind) {
        Ok(()) => out,
        Err(_) => Vec::new(),
    }
}
