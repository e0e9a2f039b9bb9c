//! Frames of a made-up fleet, split by the balancer or by simpler rules.

use foveate::foveation::{ALIGNMENT, Part};
use foveate::frame::balance::{Balancer, Observation};

use crate::world::{Device, Eye, Random, World, ideal};

/// How frames are split.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rule {
    /// By [`Balancer`].
    Balanced,
    /// As many samples for each device.
    Equal,
    /// Samples in proportion to what makers say of their devices.
    PeakRate,
    /// Samples in proportion to the samples a millisecond of the last frame.
    LastFrame,
}

impl Rule {
    /// As the table calls it.
    pub fn name(self) -> &'static str {
        match self {
            Rule::Balanced => "balanced",
            Rule::Equal => "equal shares",
            Rule::PeakRate => "static, by peak rate",
            Rule::LastFrame => "last frame, proportional",
        }
    }
}

/// What a frame came to, without the noise of its times.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// The slowest device's time.
    pub ms: f64,
    /// The best that these devices could do.
    pub ideal_ms: f64,
    /// How much earlier the first device finished, as a part of the last one's time.
    pub spread: f64,
}

pub struct Fleet {
    pub devices: Vec<Device>,
    pub present: Vec<bool>,
    pub eye: Eye,
    pub balancer: Balancer,
    pub rule: Rule,
    random: Random,
    /// Samples a millisecond of the last frame.
    last: Vec<f64>,
}

impl Fleet {
    pub fn new(devices: Vec<Device>, eye: Eye, rule: Rule) -> Self {
        let count = devices.len();
        let balancer = Balancer::new(count);
        Fleet {
            devices,
            present: vec![true; count],
            eye,
            balancer,
            rule,
            random: Random(7),
            last: vec![1.0; count],
        }
    }

    pub fn set_present(&mut self, device: usize, present: bool) {
        self.present[device] = present;
        self.balancer.set_present(device, present);
    }

    pub fn split(&mut self) -> Vec<(usize, Part)> {
        let weights: Vec<f64> = match self.rule {
            Rule::Balanced => return self.balancer.split(0, &self.eye.workload),
            Rule::Equal => vec![1.0; self.devices.len()],
            Rule::PeakRate => self.devices.iter().map(|d| d.speed * d.boast).collect(),
            Rule::LastFrame => self.last.clone(),
        };
        let (sum, samples) = (weights.iter().sum::<f64>(), self.eye.workload.samples());
        let running = weights.iter().scan(0.0, |sum, w| {
            *sum += w;
            Some(*sum)
        });
        let at: Vec<u32> = running
            .take(weights.len() - 1)
            .map(|w| (w / sum * f64::from(samples / ALIGNMENT)) as u32 * ALIGNMENT)
            .collect();
        (0..weights.len()).zip(self.eye.workload.cut(&self.eye.workload.whole(), &at)).collect()
    }

    /// One frame of a world, seen with the head turned by `yaw` tiles.
    pub fn frame(&mut self, world: World, yaw: f64) -> Frame {
        let tiles = self.eye.tiles(world, yaw);
        let parts = self.split();
        self.check(&parts);
        let workload = self.eye.workload.clone();
        let times: Vec<f64> =
            parts.iter().map(|(d, part)| self.devices[*d].time(&workload, &tiles, part)).collect();
        let observed: Vec<Observation> = parts
            .iter()
            .map(|(d, part)| self.devices[*d].measure(*d, &workload, &tiles, part, &mut self.random))
            .collect();
        for o in &observed {
            let (_, part) = parts.iter().find(|(d, _)| *d == o.device).unwrap();
            self.last[o.device] = f64::from(part.samples.end - part.samples.start).max(1.0) / o.busy_ms();
        }
        let seen: Vec<f32> = (0..tiles.len())
            .map(|tile| if workload.tile(tile).is_empty() { f32::NAN } else { tiles[tile].0 })
            .collect();
        self.balancer.observe(0, &workload, &seen, &observed);
        let slowest = times.iter().copied().fold(0.0, f64::max);
        let fastest = times.iter().copied().fold(f64::INFINITY, f64::min);
        let present: Vec<Device> =
            self.devices.iter().zip(&self.present).filter(|(_, p)| **p).map(|(d, _)| *d).collect();
        Frame {
            ms: slowest,
            ideal_ms: ideal(&present, &tiles, &workload),
            spread: (slowest - fastest) / slowest,
        }
    }

    /// Parts follow each other without gap or overlap, and only present devices have any.
    fn check(&self, parts: &[(usize, Part)]) {
        let whole = self.eye.workload.whole();
        assert_eq!(parts.first().unwrap().1.samples.start, 0);
        assert_eq!(parts.last().unwrap().1.samples.end, whole.samples.end);
        assert_eq!(parts.last().unwrap().1.tiles.end, whole.tiles.end);
        for pair in parts.windows(2) {
            assert_eq!(pair[0].1.samples.end, pair[1].1.samples.start);
            assert_eq!(pair[0].1.tiles.end, pair[1].1.tiles.start);
        }
        if self.rule == Rule::Balanced {
            assert!(parts.iter().all(|(d, _)| self.present[*d]));
        }
    }
}
