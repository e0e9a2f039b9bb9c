//! A scene's triangles, rays and answers in one file, for other tracers to be measured on the same.
//!
//! Little-endian: the eight bytes `FVRAYS01`; five `u32`: vertices, triangles, pixels, samples, bundles;
//! then `f32` unless said otherwise: the eye (3), vertices (3 each), triangles (3 `u32` each), directions
//! of camera rays through pixels, of those through samples, origins of bundles, directions of bundles
//! (32 each); then the answers: distances of the pixels' hits and of the samples' hits (infinite for
//! misses), for each bundle the rays that hit something (bits of a `u32`), and the distances of the
//! bundles' nearest hits. Pixels are in Morton order in blocks of 4 by 4, so that packets of any width
//! stay together.

use std::io::Write;
use std::path::Path;

use bytemuck::cast_slice;

use super::workload::{Workload, camera_direction};
use crate::error::{Error, Result};
use crate::layout::HitRecord;
use crate::scene::Scene;
use crate::trace::probe::{Probe, RayKind};
use crate::whole_file;

/// How such a file begins.
pub const MAGIC: &[u8; 8] = b"FVRAYS01";

/// Writes the file; `probe` has the workload loaded.
///
/// # Errors
/// [`Error::File`] where it cannot be written, [`Error::Device`] where the device fails.
pub fn write(path: &Path, shape: &Scene, work: &Workload, probe: &Probe) -> Result<()> {
    for kind in RayKind::ALL {
        probe.trace(kind)?;
    }
    let order = pixels_in_blocks(work.view.width, work.view.height);
    let pixels: Vec<[f32; 3]> =
        order.iter().map(|&(x, y)| camera_direction(&work.view, x, y).to_array()).collect();
    let samples: Vec<[f32; 3]> = work
        .pattern
        .samples
        .iter()
        .map(|&pixel| camera_direction(&work.view, pixel & 0xffff, pixel >> 16).to_array())
        .collect();
    let pixel_hits = probe.hits(RayKind::Pixels)?;
    let in_blocks: Vec<HitRecord> =
        order.iter().map(|&(x, y)| pixel_hits[(y * work.view.width + x) as usize]).collect();
    let distances = |hits: &[HitRecord]| hits.iter().map(|hit| hit.t).collect::<Vec<f32>>();
    let answers = [
        distances(&in_blocks),
        distances(&probe.hits(RayKind::Samples)?),
        distances(&probe.hits(RayKind::Bounce)?),
    ];
    let hidden = probe.hidden()?;
    let eye = (work.view.world_from_eye.position - shape.anchor).as_vec3().to_array();
    let counts = [
        shape.mesh.positions.len(),
        shape.mesh.triangles.len(),
        pixels.len(),
        samples.len(),
        work.bundles.origins.len(),
    ]
    .map(|count| count as u32);
    whole_file::write(path, |file| {
        let parts: [&[u8]; 13] = [
            MAGIC,
            cast_slice(&counts),
            cast_slice(&eye),
            cast_slice(&shape.mesh.positions),
            cast_slice(&shape.mesh.triangles),
            cast_slice(&pixels),
            cast_slice(&samples),
            cast_slice(&work.bundles.origins),
            cast_slice(&work.bundles.directions),
            cast_slice(&answers[0]),
            cast_slice(&answers[1]),
            cast_slice(&hidden),
            cast_slice(&answers[2]),
        ];
        parts.iter().try_for_each(|part| file.write_all(part)).map_err(|e| Error::writing(path, &e))
    })
}

/// All pixels, block of 4 by 4 after block, each in Morton order.
fn pixels_in_blocks(width: u32, height: u32) -> Vec<(u32, u32)> {
    let mut pixels = Vec::with_capacity(width as usize * height as usize);
    for top in (0..height).step_by(4) {
        for left in (0..width).step_by(4) {
            for i in 0..16u32 {
                let (x, y) = (left + (i & 1 | i >> 1 & 2), top + (i >> 1 & 1 | i >> 2 & 2));
                if x < width && y < height {
                    pixels.push((x, y));
                }
            }
        }
    }
    pixels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_hold_every_pixel_once() {
        let mut pixels = pixels_in_blocks(9, 6);
        assert_eq!(&pixels[..5], &[(0, 0), (1, 0), (0, 1), (1, 1), (2, 0)]);
        pixels.sort_unstable();
        pixels.dedup();
        assert_eq!(pixels.len(), 54);
    }
}
