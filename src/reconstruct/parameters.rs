//! What the passes are told, as the shaders take it.

use bytemuck::{Pod, Zeroable};
use glam::DVec2;

use super::tables::Tables;
use super::{Frame, NEAREST_DEPTH, Settings};
use crate::gpu::vulkan::Encoding;
use crate::math::view::View;
use crate::scene::Sun;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub(super) struct Rays {
    pub corner: [f32; 4],
    pub across: [f32; 4],
    pub down: [f32; 4],
}

/// How far apart a view's pixels are, as shaders take it: from the centre of the first one.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub(super) struct PackedSpacing {
    pub columns: [f32; 4],
    pub rows: [f32; 4],
}

impl PackedSpacing {
    pub fn of(view: &View) -> PackedSpacing {
        PackedSpacing { columns: view.spacing.columns.packed(-0.5), rows: view.spacing.rows.packed(-0.5) }
    }
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub(super) struct FilterParameters {
    pub rays: Rays,
    pub spacing: PackedSpacing,
    pub count: u32,
    pub neighbours: u32,
    pub normal_power: f32,
    pub plane_tolerance: f32,
    pub first_deviation: f32,
    pub second_deviation: f32,
    pub pixel_width: f32,
    pub least_expected: f32,
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub(super) struct PixelParameters {
    pub rays: Rays,
    pub shift_x: i32,
    pub shift_y: i32,
    pub width: u32,
    pub first_row: u32,
    pub rows: u32,
    pub neighbours: u32,
    pub first_sample: u32,
    pub exposure: f32,
    pub encoding: u32,
    pub normal_power: f32,
    pub plane_tolerance: f32,
    pub pixel_width: f32,
    pub count: u32,
    pub sample_neighbours: u32,
    pub sun: [f32; 3],
    pub nearest_depth: f32,
    pub sun_radius: f32,
    pub least_expected: f32,
}

/// Where the pixels of the view's picture look, in world orientation, at depth 1 metre.
/// The fourth components hold the direction towards the sun.
pub(super) fn rays(view: &View, sun: Option<Sun>) -> Rays {
    let view = &view.picture();
    let toward = |x: f64, y: f64| view.world_from_eye.rotation * view.eye_direction(DVec2::new(x, y));
    let corner = toward(0.5, 0.5);
    let sun = sun.map_or(glam::Vec3::ZERO, |sun| sun.direction);
    let vector = |v: glam::DVec3, w: f32| [v.x as f32, v.y as f32, v.z as f32, w];
    Rays {
        corner: vector(corner, sun.x),
        across: vector(toward(1.5, 0.5) - corner, sun.y),
        down: vector(toward(0.5, 1.5) - corner, sun.z),
    }
}

impl PixelParameters {
    /// For the whole view, without what depends on the output.
    pub fn new(
        tables: &Tables,
        settings: &Settings,
        frame: &Frame<'_>,
        rays: Rays,
        pixel_width: f32,
    ) -> Self {
        let guided = settings.guided();
        PixelParameters {
            rays,
            shift_x: 0,
            shift_y: 0,
            width: tables.width,
            first_row: 0,
            rows: tables.height,
            neighbours: tables.k,
            first_sample: 0,
            exposure: 1.0,
            encoding: 0,
            normal_power: guided.normal_power,
            plane_tolerance: guided.plane_tolerance,
            pixel_width,
            count: tables.count as u32,
            sample_neighbours: tables.neighbours,
            sun: frame.sun.map_or([0.0; 3], |sun| (sun.radiance * sun.solid_angle() as f32).to_array()),
            nearest_depth: NEAREST_DEPTH,
            sun_radius: frame.sun.map_or(0.0, |sun| (0.5 * (1.0 - sun.cos_radius)).sqrt()),
            least_expected: frame.least_expected,
        }
    }
}

/// As shaders number them.
pub(super) fn encoding(encoding: Encoding) -> u32 {
    match encoding {
        Encoding::Radiance => 0,
        Encoding::DisplayLinear => 1,
        Encoding::DisplaySrgb => 2,
    }
}
