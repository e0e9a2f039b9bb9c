//! One foveated picture: `cargo run --release --example picture -- scene.glb picture.png`.

use std::path::Path;

use foveate::config::Config;
use foveate::error::{Error, Result};
use foveate::frame::{Loaded, Output, Plan, Renderer};
use foveate::gpu::opencl::{Device, device, why_none};
use foveate::gpu::vulkan::{Context, ContextOptions};
use foveate::math::view::{FieldOfView, View};
use foveate::scene::default_viewpoint;
use glam::DVec2;

const SIZE: (u32, u32) = (640, 480);

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let mut next = |usual: &str| arguments.next().unwrap_or_else(|| usual.to_string());
    let (scene, out) = (next("scene.glb"), next("picture.png"));

    // Settings are those of configs/default.toml; all of them are fields.
    let mut config = Config::default();
    config.trace.rays = 16;
    let loaded = Loaded::from_file(Path::new(&scene), &config)?;
    loaded.warnings.iter().for_each(|warning| eprintln!("{warning}"));

    let context = Context::new(&ContextOptions::default())?;
    let usable = device::list().into_iter().find(|info| info.unusable.is_none());
    let info = usable.ok_or_else(|| Error::NoDevice { kind: "OpenCL", problem: why_none() })?;
    let device = Device::open(&info)?;
    let (mut renderer, _) = Renderer::new(&device, &context, &loaded, &config, Output::Display)?;

    let eye = default_viewpoint(&loaded.scene, config.view.fov_y);
    let (width, height) = SIZE;
    let fov = FieldOfView::symmetric(eye.fov_y, f64::from(width) / f64::from(height));
    let plan = Plan::mono(View {
        world_from_eye: eye.world_from_eye,
        fov,
        width,
        height,
        spacing: Default::default(),
    });
    // The eye looks a little to the left of the middle.
    let report = renderer.frame(&plan, &[DVec2::new(0.4, 0.5)], config.trace.seed)?;
    let save = image::save_buffer(&out, &renderer.picture()?, width, height, image::ColorType::Rgba8);
    save.map_err(|error| Error::File { path: out.into(), problem: error.to_string() })?;
    println!("{} samples for {} pixels, {:.0} ms", report.samples, width * height, report.frame_ms);
    Ok(())
}
