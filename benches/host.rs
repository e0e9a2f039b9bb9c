//! What frames cost the host beside waiting: `cargo bench --bench host [-- --frames 12 --set devices.profile=false]`.
//!
//! Both eyes of the demo scene, with a head that sways and a gaze that holds, in two sizes. Told is the time that processors
//! spent on the program's own threads: on the one that makes frames, and on those that give OpenCL devices their work; in
//! it is what drivers do within their calls, and not what their own threads do, which trace and draw where there is no GPU.
//! Medians of frames and the least, in milliseconds, beside the time from a frame's start to its end. Works where the
//! system tells how long threads ran (Linux). The last column is a sum over all pictures: builds that make the same ones
//! have the same.

use std::fs::{self, File};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::{Read, Seek};
use std::time::Duration;

use foveate::config::{Config, Layers, Stereo};
use foveate::frame::stereo::parallel_eyes;
use foveate::frame::{Loaded, Output, Plan, Renderer};
use foveate::gpu::interop::{self, Sharing};
use foveate::gpu::opencl::{Device, device};
use foveate::gpu::vulkan::{Context, ContextOptions};
use foveate::math::pose::Pose;
use foveate::math::view::FieldOfView;
use foveate::metrics::stats::median;
use foveate::scene::{default_viewpoint, generate};
use glam::{DQuat, DVec2, DVec3};

/// Each eye's pixels: both together are 1280x800, and a headset of today.
const SIZES: [(u32, u32); 2] = [(640, 800), (2064, 2208)];
/// Frames before any is counted: drivers build kernels in the first, and what is kept over frames begins.
const WARM: usize = 4;

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let value = |flag: &str| arguments.iter().position(|a| a == flag).and_then(|at| arguments.get(at + 1));
    let frames: usize = value("--frames").map_or(12, |number| number.parse().expect("a number"));
    let mut layers = Layers::default();
    let set = arguments.iter().zip(arguments.iter().skip(1)).filter(|(flag, _)| *flag == "--set");
    set.for_each(|(_, assignment)| layers.assign(assignment).expect("a setting"));
    let config = layers.finish().expect("settings that fit");
    let context = Context::new(&ContextOptions::default()).expect("a Vulkan device");
    let info = device::list().into_iter().find(|d| d.unusable.is_none()).expect("an OpenCL device");
    let open = if config.devices.profile { Device::open } else { Device::open_untimed };
    let device = open(&info).expect("the OpenCL device");
    let loaded = Loaded::from_glb("demo", &generate::demo::generate(), &config).expect("the demo");
    println!("{} (OpenCL), {} (Vulkan), {frames} frames\n", info.name, context.report().name);
    println!("| pixels | samples cross | frames' thread | devices' threads | both | frame | pictures |");
    println!("| --- | --- | --- | --- | --- | --- | --- |");
    let shared = interop::probe(&device, &context) == Sharing::ZeroCopy;
    for size in SIZES {
        for sharing in [Sharing::ZeroCopy, Sharing::Staged] {
            if sharing == Sharing::Staged || shared {
                let row = row(&device, &context, &loaded, &config, size, sharing, frames);
                println!("| 2 x {}x{} | {sharing} | {row} |", size.0, size.1);
            }
        }
    }
}

/// The cells of a line.
fn row(
    device: &Device,
    context: &Context,
    loaded: &Loaded,
    config: &Config,
    (width, height): (u32, u32),
    sharing: Sharing,
    frames: usize,
) -> String {
    let made = Renderer::with_sharing(device, context, loaded, config, Output::Display, sharing);
    let mut renderer = made.expect("a renderer").0;
    let fov = FieldOfView::symmetric(1.5, f64::from(width) / f64::from(height));
    let rest = default_viewpoint(&loaded.scene, 70.0).world_from_eye;
    let mut columns: [Vec<f64>; 4] = Default::default();
    let mut pictures = DefaultHasher::new();
    let threads = Threads::find();
    for frame in 0..frames + WARM {
        let sway = DQuat::from_rotation_y(0.002 * (frame as f64 * 0.9).sin());
        let eyes = parallel_eyes(rest.then(Pose::new(sway, DVec3::ZERO)), 0.063, fov, width, height);
        let plan = Plan::stereo(eyes, Stereo::PerEye).expect("two eyes");
        let gaze = plan.gaze_points(DVec2::splat(0.5));
        let before = [threads.of_devices(), threads.own()];
        let report = renderer.frame(&plan, &gaze, frame as u32).expect("a frame");
        let after = [threads.own(), threads.of_devices()];
        renderer.picture().expect("the picture").hash(&mut pictures);
        if frame >= WARM {
            let [own, devices] = [0, 1].map(|threads| (after[threads] - before[1 - threads]) as f64 * 1e-6);
            for (column, ms) in columns.iter_mut().zip([own, devices, own + devices, report.frame_ms]) {
                column.push(ms);
            }
        }
    }
    let cell = |times: &Vec<f64>| {
        let least = times.iter().copied().fold(f64::INFINITY, f64::min);
        format!("{:.2} (least {least:.2})", median(times).unwrap_or(0.0))
    };
    format!("{} | {:016x}", columns.each_ref().map(cell).join(" | "), pictures.finish())
}

/// The program's threads that frames are made by, and what the system tells of them: files that stay open, since counting is
/// part of what is counted.
struct Threads {
    own: File,
    devices: Vec<File>,
}

impl Threads {
    /// Those that there are; looked for once, since that takes longer than some frames' work.
    fn find() -> Threads {
        let statistics =
            |thread: &fs::DirEntry| File::open(thread.path().join("schedstat")).expect("times of threads");
        let (id, mut own, mut devices) = (std::process::id().to_string(), None, Vec::new());
        for thread in fs::read_dir("/proc/self/task").expect("the system's list of threads").flatten() {
            let name = fs::read_to_string(thread.path().join("comm")).unwrap_or_default();
            if thread.file_name().to_string_lossy() == id {
                own = Some(statistics(&thread));
            } else if name.starts_with("device ") {
                devices.push(statistics(&thread));
            }
        }
        Threads { own: own.expect("this thread"), devices }
    }

    /// Nanoseconds that this thread was on processors so far.
    fn own(&self) -> u64 {
        // The system adds up what a thread has run when it may stop running: before that some milliseconds may be missing.
        std::thread::yield_now();
        spent(&self.own)
    }

    /// The same of those that give devices their work, once they have stopped.
    fn of_devices(&self) -> u64 {
        std::thread::sleep(Duration::from_millis(1));
        self.devices.iter().map(spent).sum()
    }
}

fn spent(mut statistics: &File) -> u64 {
    let mut text = [0; 64];
    statistics.rewind().expect("the beginning of a file");
    let length = statistics.read(&mut text).expect("times of a thread");
    let text = std::str::from_utf8(&text[..length]).expect("numbers");
    text.split(' ').next().and_then(|ns| ns.parse().ok()).expect("a number")
}
