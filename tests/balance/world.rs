//! A made-up world for a fleet of made-up devices: what places cost, and how devices take their time.

use std::ops::Range;

use foveate::foveation::{Law, Part, Pattern, Workload};
use foveate::frame::balance::{Observation, Slice};
use foveate::math::pose::Pose;
use foveate::math::view::{FieldOfView, View};
use glam::DVec2;

/// A reproducible sequence (splitmix64).
pub struct Random(pub u64);

impl Random {
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub fn uniform(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A normal variate: the sum of twelve uniform ones.
    pub fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

/// What the eye sees: walls, foliage that costs two and a half times as much, and sky that costs nearly
/// nothing, in patches all around. Two scenes share no patch.
#[derive(Clone, Copy)]
pub struct World {
    pub scene: u64,
}

impl World {
    /// Share of samples that meet a surface, and the cost of a sample, at a place in tiles around and down.
    pub fn at(self, x: f64, y: f64) -> (f32, f64) {
        let patch = |size: f64| {
            let cell =
                ((x / size).floor() as i64 as u64) << 32 | (y / size).floor() as i64 as u64 & 0xffff_ffff;
            Random(cell ^ self.scene.wrapping_mul(0x1234_5678_9abc_def1)).uniform()
        };
        let horizon = 14.0 + 12.0 * patch(27.0);
        let rough = 0.75 + 0.5 * patch(1.0);
        if y < horizon && patch(9.0) > 0.25 {
            return (0.0, 0.02);
        }
        if patch(13.0) > 0.7 { (0.7, 2.5 * rough) } else { (1.0, rough) }
    }
}

/// A view of 80 by 50 tiles with the paper's 55,000 samples.
pub struct Eye {
    pub pattern: Pattern,
    pub workload: Workload,
}

impl Eye {
    pub fn new(gaze: DVec2, dense: bool) -> Self {
        let fov = FieldOfView::symmetric(1.4, 1.6);
        let view = View {
            world_from_eye: Pose::IDENTITY,
            fov,
            width: 1280,
            height: 800,
            spacing: Default::default(),
        };
        let pattern = Pattern::new(&view, &Law::default(), gaze, 55_000);
        Eye { workload: Workload::new(&pattern, dense), pattern }
    }

    /// What each tile sees with the head turned by `yaw` tiles: surface share, cost of a pixel, of a sample.
    pub fn tiles(&self, world: World, yaw: f64) -> Vec<(f32, f64, f64)> {
        let across = self.pattern.tiles_x();
        let place = |&tile: &u32| {
            let (x, y) = (f64::from(tile % across), f64::from(tile / across));
            let (seen, sample) = world.at(x + yaw, y);
            (seen, if self.workload.dense { 0.03 * (0.3 + 0.7 * sample) } else { 0.0 }, sample)
        };
        self.pattern.order.iter().map(place).collect()
    }
}

/// A device: work a millisecond, the time that any part takes at least, noise of its times.
#[derive(Clone, Copy)]
pub struct Device {
    pub speed: f64,
    pub overhead_ms: f64,
    /// Relative standard deviation of each time.
    pub noise: f64,
    /// Chance that a time is three times as long.
    pub accident: f64,
    /// What its maker says of its speed, over what is true.
    pub boast: f64,
    /// Parts that it is timed by.
    pub slices: u32,
}

impl Device {
    pub fn plain(speed: f64) -> Self {
        Device { speed, overhead_ms: 0.1, noise: 0.0, accident: 0.0, boast: 1.0, slices: 4 }
    }

    pub fn noisy(speed: f64) -> Self {
        Device { noise: 0.04, accident: 0.01, ..Device::plain(speed) }
    }

    /// True time of a part without noise.
    pub fn time(&self, workload: &Workload, tiles: &[(f32, f64, f64)], part: &Part) -> f64 {
        let [pixels, samples] = self.times(workload, tiles, part);
        self.overhead_ms + pixels + samples
    }

    fn times(&self, workload: &Workload, tiles: &[(f32, f64, f64)], part: &Part) -> [f64; 2] {
        let mut work = [0.0; 2];
        let inside = |tile: usize| {
            let range = workload.tile(tile);
            let (start, end) = (range.start.max(part.samples.start), range.end.min(part.samples.end));
            f64::from(end.saturating_sub(start))
        };
        let end = part.tiles.end.max(workload.tile_of(part.samples.end.saturating_sub(1)) + 1);
        for tile in part.first_traced..end.min(tiles.len() as u32) {
            let (_, pixel, sample) = tiles[tile as usize];
            work[0] += pixel * 256.0;
            work[1] += sample * inside(tile as usize);
        }
        work.map(|w| w / self.speed)
    }

    /// What is measured of a part.
    pub fn measure(
        &self,
        device: usize,
        workload: &Workload,
        tiles: &[(f32, f64, f64)],
        part: &Part,
        random: &mut Random,
    ) -> Observation {
        let spike = if random.uniform() < self.accident { 3.0 } else { 1.0 };
        let slices = workload
            .slices(part, self.slices)
            .into_iter()
            .map(|part| {
                let [pixels, samples] = self.times(workload, tiles, &part);
                let mut noise = || spike * (1.0 + self.noise * random.normal()).max(0.1);
                let (pixels_ms, samples_ms) = (pixels * noise(), samples * noise());
                Slice { part, pixels_ms, samples_ms }
            })
            .collect();
        Observation { device, slices, overhead_ms: self.overhead_ms }
    }
}

/// The shortest time in which the devices can do it all, each a part of the order: by bisection.
pub fn ideal(devices: &[Device], tiles: &[(f32, f64, f64)], workload: &Workload) -> f64 {
    let work: f64 = (0..tiles.len())
        .map(|tile| {
            let range: Range<u32> = workload.tile(tile);
            tiles[tile].1 * 256.0 + tiles[tile].2 * f64::from(range.end - range.start)
        })
        .sum();
    let done = |time: f64| devices.iter().map(|d| d.speed * (time - d.overhead_ms).max(0.0)).sum::<f64>();
    let (mut low, mut high) = (0.0, 1e9);
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if done(middle) < work { low = middle } else { high = middle }
    }
    high
}
