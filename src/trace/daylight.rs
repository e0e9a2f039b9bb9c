//! Light from infinitely far that changes: what a sun that moves changes of a scene in a device's memory, made once for
//! all devices.
//!
//! Directions to aim at are drawn from the sky averaged over blocks of four by four texels, which is brighter than 0
//! wherever the sky is, so that nothing gets a bias. The cache of light and light that is reused over time forget as the
//! sun moves: they hold no more frames than it takes for two degrees, or for 4 % of all light (reuse), and twice that
//! (the cache, four frames at least). At dusk that is a frame or two of a day of a minute, at noon all that there are.
//! The sun's own light is found anew for each pixel of each frame, so that its shadows never lag.

use std::f64::consts::TAU;
use std::sync::Arc;

use super::scene_buffers::{pack_directions, pack_environment};
use crate::layout;
use crate::scene::Sun;
use crate::scene::environment::luminance;
use crate::scene::importance::DirectionTable;
use crate::scene::sky::day::{Day, DayCycle, MAPS, SkyMap};

/// How far the sun may go, in radians, and what part of all light may come or go while light that was found is reused.
const TURNED: f32 = 0.035;
const CHANGED: f32 = 0.04;
/// Frames after which the cache of light has forgotten half, beside those that are reused, and at least.
const CACHED: f32 = 2.0;
const LEAST_CACHED: f32 = 4.0;

/// A sky whose sun moves.
#[derive(Debug)]
pub struct MovingSky {
    day: Day,
    map: Option<Arc<PackedSky>>,
    last: Option<Sun>,
    /// All light when the map was made, as a logarithm, and how much that changes a radian of the sun's way.
    brightness: f32,
    rate: f32,
    serial: u64,
}

/// Light from infinitely far at an instant, all of it.
#[derive(Debug)]
pub struct SkyState {
    /// Tells one from the next, from 1 on.
    pub serial: u64,
    /// The sun; its light is 0 where it is below the horizon.
    pub sun: Sun,
    /// A fiftieth of the mean radiance of the sky without it: the least that glossy surfaces expect.
    pub least_expected: f32,
    /// Frames of which light holds that is reused, at least 1.
    pub reused: f32,
    /// Frames after which the cache of light may have forgotten half.
    pub(super) half_life: f32,
    pub(super) map: Arc<PackedSky>,
}

/// A sky as kernels read it.
#[derive(Debug)]
pub(super) struct PackedSky {
    number: i64,
    pub texels: Vec<layout::EnvironmentTexel>,
    pub directions: Vec<layout::DirectionCell>,
    pub mirrored: Option<Vec<[f32; 4]>>,
    /// Texels across and down, of the map and of the table.
    pub size: [u32; 2],
    pub cells: [u32; 2],
    pub irradiance: f32,
    least_expected: f32,
}

impl MovingSky {
    /// The sky of a day; `glossy` says whether some surface mirrors it.
    pub fn new(cycle: DayCycle, glossy: bool) -> Self {
        MovingSky {
            day: Day::new(cycle, glossy),
            map: None,
            last: None,
            brightness: 0.0,
            rate: 0.0,
            serial: 0,
        }
    }

    /// Everything at a time in seconds, after the last time that was asked for.
    pub fn at(&mut self, time: f64) -> SkyState {
        let (sun, map) = (self.day.sun(time), self.day.map(time));
        let turned = self.last.replace(sun).map_or(0.0, |last| (last.direction - sun.direction).length());
        self.serial += 1;
        let known = self.map.take();
        let packed = match known {
            Some(known) if known.number == map.number => known,
            _ => {
                let packed = Arc::new(PackedSky::of(&map));
                let brightness = (packed.irradiance + irradiance(&sun)).max(f32::MIN_POSITIVE).ln();
                let change = (brightness - std::mem::replace(&mut self.brightness, brightness)).abs();
                let way = known.map_or(f32::INFINITY, |known| known.way_to(&packed));
                self.rate = change / way;
                packed
            }
        };
        let map = self.map.insert(packed);
        let reused = (TURNED / turned).min(CHANGED / (self.rate * turned));
        SkyState {
            serial: self.serial,
            sun,
            least_expected: map.least_expected,
            reused: reused.max(1.0),
            half_life: (CACHED * reused).max(LEAST_CACHED),
            map: map.clone(),
        }
    }
}

/// Luminance of the irradiance that level ground has from a sun.
fn irradiance(sun: &Sun) -> f32 {
    (luminance(sun.radiance) * sun.solid_angle()) as f32 * sun.direction.y.max(0.0)
}

impl PackedSky {
    /// How far the sky has turned between two maps, in radians.
    fn way_to(&self, other: &PackedSky) -> f32 {
        (other.number - self.number).unsigned_abs() as f32 * (TAU / MAPS) as f32
    }

    fn of(map: &SkyMap) -> Self {
        let environment = &map.environment;
        let directions = DirectionTable::new(&environment.reduced(4));
        PackedSky {
            number: map.number,
            texels: pack_environment(environment),
            directions: pack_directions(&directions),
            mirrored: map.mirrored.clone(),
            size: [environment.width, environment.height],
            cells: [directions.width, directions.height],
            irradiance: environment.irradiance(),
            least_expected: environment.least_expected(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::sky::Sky;

    /// What the third of three instants `step` seconds apart says, of a day of a minute.
    fn third(start: f64, step: f64) -> SkyState {
        let mut sky = MovingSky::new(DayCycle { sky: Sky::default(), seconds: 60.0, scale: 1.0 }, false);
        [0.0, 1.0, 2.0].map(|frame| sky.at(start + frame * step)).into_iter().last().unwrap()
    }

    #[test]
    fn light_is_kept_the_shorter_the_faster_it_changes() {
        let (slow, fast, dusk) = (third(3.0, 0.04), third(3.0, 0.4), third(16.0, 0.04));
        assert!(slow.reused > 6.0 && slow.half_life > 12.0, "{} {}", slow.reused, slow.half_life);
        assert!((1.0..2.0).contains(&fast.reused) && fast.half_life == LEAST_CACHED, "{}", fast.reused);
        assert!(dusk.reused < 0.6 * slow.reused, "{} {}", dusk.reused, slow.reused);
        let still = third(3.0, 0.0);
        assert!(still.reused == f32::INFINITY && still.half_life == f32::INFINITY);
        assert_eq!((slow.serial, still.serial), (3, 3));
    }

    #[test]
    fn maps_are_packed_once_each() {
        let mut sky = MovingSky::new(DayCycle { sky: Sky::default(), seconds: 3600.0, scale: 1.0 }, false);
        let states = [0.0, 0.1, 0.2, 7.0].map(|time| sky.at(time));
        assert!(Arc::ptr_eq(&states[0].map, &states[2].map) && !Arc::ptr_eq(&states[2].map, &states[3].map));
        assert!(states[0].sun.direction != states[2].sun.direction, "its own sun for each instant");
        assert!(states.iter().all(|state| state.least_expected > 1e-6 && state.map.irradiance > 0.0));
    }
}
