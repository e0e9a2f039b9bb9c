//! A headset of one's own: `cargo run --release --example own_poses -- scene.glb`.
//!
//! Whatever knows poses and shows pictures implements `Headset`; the frame loop brings the rest: gaze filter, late
//! correction, held frame times. This one turns round once, and tells what it was given to show.

use std::path::Path;
use std::time::Instant;

use foveate::config::{Config, Stereo};
use foveate::error::{Error, Result};
use foveate::frame::{Loaded, Output, Renderer};
use foveate::gpu::opencl::{Device, device, why_none};
use foveate::gpu::vulkan::{Context, ContextOptions, Format, Image};
use foveate::headset::{Canvas, Deadline, EyeView, Fault, Frame, Headset, Input, Keys, Next, Outcome};
use foveate::math::pose::Pose;
use foveate::math::view::FieldOfView;
use foveate::scene::default_viewpoint;
use foveate::session::{FrameLoop, Link, Observer, Rig, Shown};
use glam::{DQuat, DVec3};

/// Pixels of each eye's picture, and nanoseconds between two of them.
const EYE: (u32, u32) = (160, 160);
const PERIOD: i64 = 50_000_000;
const FRAMES: i64 = 20;

/// A head that turns round.
struct Carousel {
    start: Instant,
    begun: i64,
    image: Image,
}

impl Headset for Carousel {
    fn next_frame(&mut self) -> Outcome<Next> {
        if self.begun == FRAMES {
            return Ok(Next::End);
        }
        self.begun += 1;
        // The next beat of a display that shows twenty pictures a second.
        let time = (self.now() / PERIOD + 1) * PERIOD;
        Ok(Next::Frame(Frame { time, should_render: true, began: Instant::now() }))
    }

    fn sizes(&self) -> Vec<(u32, u32)> {
        vec![EYE; 2]
    }

    fn now(&self) -> i64 {
        self.start.elapsed().as_nanos() as i64
    }

    fn deadline(&self, frame: &Frame) -> Deadline {
        Deadline { time: frame.time, period: Some(PERIOD) }
    }

    /// A real one would ask its tracker where the head will be then.
    fn locate(&mut self, time: i64) -> Outcome<Option<Vec<EyeView>>> {
        let head = DQuat::from_rotation_y(0.5 * time as f64 * 1e-9);
        let fov = FieldOfView { left: -1.0, right: 1.0, up: 1.0, down: -1.0 };
        let eye = |x: f64| EyeView { space_from_eye: Pose::new(head, head * DVec3::X * x), fov };
        Ok(Some(vec![eye(-0.032), eye(0.032)]))
    }

    fn surprises(&self) -> bool {
        true
    }

    fn input(&mut self, _: i64) -> Outcome<Input> {
        Ok(Input::default())
    }

    fn acquire(&mut self) -> Outcome<Option<Vec<Canvas>>> {
        Ok(Some(Canvas::side_by_side(self.image.target(), &self.sizes())))
    }

    /// A real one would show the image now.
    fn end(&mut self, _: &Frame, _: Option<&[EyeView]>) -> Outcome<()> {
        Ok(())
    }
}

/// Prints what was done.
struct Printer;

impl Observer for Printer {
    fn note(&mut self, sentence: &str) {
        eprintln!("note: {sentence}");
    }

    fn shown(&mut self, shown: Shown) -> Result<()> {
        println!("{}: {:.0} ms, {} samples", shown.index, shown.frame_ms, shown.report.samples);
        Ok(())
    }
}

fn main() -> Result<()> {
    let scene = std::env::args().nth(1).unwrap_or_else(|| "scene.glb".to_string());
    let mut config = Config::default();
    config.view.stereo = Stereo::PerEye;
    let loaded = Loaded::from_file(Path::new(&scene), &config)?;
    let context = Context::new(&ContextOptions::default())?;
    let usable = device::list().into_iter().find(|info| info.unusable.is_none());
    let info = usable.ok_or_else(|| Error::NoDevice { kind: "OpenCL", problem: why_none() })?;
    let device = Device::open(&info)?;
    let (mut renderer, _) = Renderer::new(&device, &context, &loaded, &config, Output::Display)?;

    let image = Image::new(&context, Format::R8G8B8A8_UNORM, 2 * EYE.0, EYE.1)?;
    let mut headset = Carousel { start: Instant::now(), begun: 0, image };
    let rest = default_viewpoint(&loaded.scene, config.view.fov_y).world_from_eye;
    let rig = Rig::new(rest, &loaded.scene, &config.headset);
    let mut frame_loop = FrameLoop::new(&config, &loaded.scene, rig, None, None);
    let mut link = Link { headset: &mut headset, draw: &mut renderer, observer: &mut Printer };
    while frame_loop.step(&mut link, &Keys::default()).map_err(Fault::into_error)? {}
    Ok(())
}
