//! A sequence of both eyes' pictures along a path: `cargo run --release --example sequence -- scene.glb out`.
//!
//! Frames that follow each other share what they have found: each needs few rays.

use std::path::{Path, PathBuf};

use foveate::config::Config;
use foveate::error::{Error, Result};
use foveate::frame::stereo::parallel_eyes;
use foveate::frame::{Loaded, Output, Plan, Renderer};
use foveate::gpu::opencl::{Device, device, why_none};
use foveate::gpu::vulkan::{Context, ContextOptions};
use foveate::headset::mock::{PictureSink, Script};
use foveate::math::view::FieldOfView;
use foveate::scene::default_viewpoint;

/// Pixels of each eye's picture.
const EYE: (u32, u32) = (320, 320);
const FRAMES: u32 = 24;
const SECONDS: f64 = 2.0;

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let scene = arguments.next().unwrap_or_else(|| "scene.glb".to_string());
    let out = PathBuf::from(arguments.next().unwrap_or_else(|| "out/sequence".to_string()));

    let mut config = Config::default();
    config.view.stereo = foveate::config::Stereo::PerEye;
    let loaded = Loaded::from_file(Path::new(&scene), &config)?;
    let context = Context::new(&ContextOptions::default())?;
    let usable = device::list().into_iter().find(|info| info.unusable.is_none());
    let info = usable.ok_or_else(|| Error::NoDevice { kind: "OpenCL", problem: why_none() })?;
    let device = Device::open(&info)?;
    let (mut renderer, _) = Renderer::new(&device, &context, &loaded, &config, Output::Display)?;

    // Heads and gazes may come from anywhere; here a formula tells them.
    let eye = default_viewpoint(&loaded.scene, config.view.fov_y);
    let path = Script::demo(eye.world_from_eye, SECONDS);
    let fov = FieldOfView::symmetric(eye.fov_y, f64::from(EYE.0) / f64::from(EYE.1));
    // Writes frame_0000.png and so on, a contact sheet and an animation.
    let mut sink = PictureSink::create(&out)?;
    for frame in 0..FRAMES {
        let time = SECONDS * f64::from(frame) / f64::from(FRAMES);
        let eyes = parallel_eyes(path.head_at(time), config.view.ipd, fov, EYE.0, EYE.1);
        let plan = Plan::stereo(eyes, config.view.stereo)?;
        let report = renderer.frame(&plan, &plan.gaze_points(path.gaze_at(time)), frame)?;
        sink.push(frame as usize, plan.width, plan.height, renderer.picture()?)?;
        println!("frame {frame}: {:.0} ms, {} rays", report.frame_ms, report.rays);
    }
    println!("{} pictures in {}", sink.finish()?.pictures, out.display());
    Ok(())
}
