//! One device with one scene, and what it makes of a view.

use std::sync::{Mutex, MutexGuard, PoisonError};

use foveate::bvh::{Trees, WideBvh};
use foveate::foveation::{Law, Pattern};
use foveate::gpu::opencl::{Buffer, Device, device};
use foveate::gpu::vulkan::Context;
use foveate::layout::{HitRecord, SampleRecord, VisibilityRecord};
use foveate::math::pose::Pose;
use foveate::math::view::{FieldOfView, View};
use foveate::scene::{Environment, Features, Scene};
use foveate::trace::{SceneData, SceneState, Settings, Tracer, Traversal, Traversals, Turn};
use glam::{DVec2, DVec3};

/// What every kernel can: one program for all scenes that do not ask for less.
pub const EVERYTHING: Features = Features {
    textures: true,
    normal_maps: true,
    alpha: true,
    vertex_colors: true,
    sun: true,
    emitters: true,
    layers: true,
    glass: true,
    glossy: true,
    // Others have none, and buffers for none.
    instances: false,
};

/// 32 rays, no bounces, records of radiance.
pub const PLAIN: Settings = Settings {
    rays: 32,
    bounces: 0,
    cached: false,
    edge_rays: 0,
    guided: false,
    seed: 1,
    jitter: false,
    fewer_rays: None,
    turn: Turn::ALL,
    turn_in_motion: Turn::ALL,
};

/// Runs a test on every OpenCL device, one test at a time. On machines that promise a device (CI=true) it
/// is a failure that there is none.
pub fn on_every_device(test: impl Fn(&Device)) {
    static TURN: Mutex<()> = Mutex::new(());
    let _turn: MutexGuard<()> = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let devices = device::list();
    if !devices.iter().any(|d| d.unusable.is_none()) {
        assert!(std::env::var("CI").as_deref() != Ok("true"), "no OpenCL device");
        println!("not run: no OpenCL device");
        return;
    }
    for info in devices.iter().filter(|d| d.unusable.is_none()) {
        println!("device: {} ({})", info.name, info.platform);
        test(&Device::open(info).unwrap());
    }
}

/// A scene on a device.
pub struct Bench {
    bvh: Option<WideBvh>,
    tracer: Tracer,
    device: Device,
}

/// What one trace left behind.
pub struct Picture {
    pub samples: Vec<SampleRecord>,
    pub visibility: Vec<VisibilityRecord>,
    /// Triangles are the mesh's own, but those of a bench with instances.
    pub hits: Vec<HitRecord>,
    pub rays: u64,
    pub dropped: u32,
}

impl Bench {
    pub fn new(device: &Device, scene: &Scene, environment: &Environment) -> Self {
        Self::with(device, scene, environment, &EVERYTHING)
    }

    pub fn with(device: &Device, scene: &Scene, environment: &Environment, features: &Features) -> Self {
        Self::walking(device, scene, environment, features, Traversal::for_device(device))
    }

    pub fn walking(
        device: &Device,
        scene: &Scene,
        environment: &Environment,
        features: &Features,
        traversal: Traversal,
    ) -> Self {
        let bvh = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
        Self::over(device, scene, environment, features, traversal, bvh)
    }

    /// With a tree that is there already.
    pub fn over(
        device: &Device,
        scene: &Scene,
        environment: &Environment,
        features: &Features,
        traversal: impl Into<Traversals>,
        bvh: WideBvh,
    ) -> Self {
        let tracer = Tracer::with_features(device, scene, &bvh, environment, features, traversal).unwrap();
        Bench { bvh: Some(bvh), tracer, device: device.clone() }
    }

    /// With trees of which hits are not to be told by the mesh's triangles.
    pub fn grown(
        device: &Device,
        scene: &Scene,
        environment: &Environment,
        features: &Features,
        traversal: Traversal,
        trees: Trees,
    ) -> Self {
        let tracer = Tracer::with_features(device, scene, trees, environment, features, traversal).unwrap();
        Bench { bvh: None, tracer, device: device.clone() }
    }

    /// With rays that ray queries trace; hits are told by the mesh's triangles where `bvh` is its tree.
    pub fn by_ray_queries(
        device: &Device,
        context: &Context,
        scene: &Scene,
        environment: &Environment,
        trees: Trees,
        bvh: Option<WideBvh>,
    ) -> Self {
        let data = SceneData::pack(scene, trees, environment).unwrap();
        let tracer = Tracer::with_hardware_rays(device, &data, context).unwrap();
        Bench { bvh, tracer, device: device.clone() }
    }

    /// With a tracer that is there already, whose hits are not told by the mesh's triangles.
    pub fn of(device: &Device, tracer: Tracer) -> Self {
        Bench { bvh: None, tracer, device: device.clone() }
    }

    /// Brings the scene to an instant.
    pub fn move_to(&mut self, state: &SceneState) {
        self.tracer.move_to(state).unwrap();
    }

    /// Makes steps of the cache of light, where a pattern's samples look.
    pub fn light(
        &mut self,
        view: &View,
        settings: &Settings,
        pattern: &Pattern,
        steps: std::ops::Range<u64>,
    ) {
        let uploaded = self.tracer.pattern(pattern).unwrap();
        for step in steps {
            self.tracer.update_light(view, settings, &uploaded, step + 1).unwrap();
        }
    }

    /// Traces the samples of a pattern.
    pub fn trace(&mut self, view: &View, settings: &Settings, pattern: &Pattern) -> Picture {
        let count = pattern.samples.len();
        let samples = Buffer::new(&self.device, count).unwrap();
        let visibility = settings.guided.then(|| Buffer::new(&self.device, view.pixels()).unwrap());
        let uploaded = self.tracer.pattern(pattern).unwrap();
        let work = self.tracer.enqueue(view, settings, &uploaded, &samples, visibility.as_ref()).unwrap();
        let done = self.tracer.finish(work).unwrap();
        let rays = if settings.guided { view.pixels() } else { count };
        let mut hits = self.tracer.hits(rays).unwrap();
        if let Some(bvh) = &self.bvh {
            for hit in hits.iter_mut().filter(|hit| hit.triangle != u32::MAX) {
                hit.triangle = bvh.order[hit.triangle as usize].triangle;
            }
        }
        Picture {
            samples: samples.to_vec().unwrap(),
            visibility: visibility.map_or_else(Vec::new, |v| v.to_vec().unwrap()),
            hits,
            rays: done.rays,
            dropped: done.dropped,
        }
    }

    /// The samples of a pattern in the second of two frames of one view: what they see is known from the first one, where
    /// [`Settings::fewer_rays`] asks for that.
    pub fn trace_again(&mut self, view: &View, settings: &Settings, pattern: &Pattern) -> Vec<SampleRecord> {
        let samples = Buffer::new(&self.device, pattern.samples.len()).unwrap();
        let visibility = Buffer::new(&self.device, view.pixels()).unwrap();
        let uploaded = self.tracer.pattern(pattern).unwrap();
        let (whole, mut past) = (std::slice::from_ref(uploaded.whole()), None);
        for _ in 0..2 {
            let records = (&samples, Some(&visibility));
            let work = self
                .tracer
                .enqueue_parts(view, settings, &uploaded, whole, records, Some(&mut past))
                .unwrap();
            assert_eq!(self.tracer.finish(work).unwrap().dropped, 0);
        }
        samples.to_vec().unwrap()
    }
}

/// Every pixel, row after row.
pub fn all_pixels(view: &View) -> Pattern {
    let samples = (0..view.pixels() as u32).map(|i| (i % view.width) | (i / view.width) << 16).collect();
    Pattern { samples, ..Pattern::new(view, &Law::Full, DVec2::ZERO, 1) }
}

/// The centres of `across` by `down` cells of a view.
pub fn spread(view: &View, across: u32, down: u32) -> Pattern {
    let place = |i: u32, cells: u32, size: u32| (2 * i + 1) * size / (2 * cells);
    let samples = (0..across * down)
        .map(|i| place(i % across, across, view.width) | place(i / across, down, view.height) << 16)
        .collect();
    Pattern { samples, ..all_pixels(view) }
}

/// A view from `eye` to `target`, its vertical angle in degrees.
pub fn view(eye: DVec3, target: DVec3, angle: f64, (width, height): (u32, u32)) -> View {
    View {
        world_from_eye: Pose::look_at(eye, target),
        fov: FieldOfView::symmetric(angle.to_radians(), f64::from(width) / f64::from(height)),
        width,
        height,
        spacing: Default::default(),
    }
}
