//! A sky whose sun goes round: the same for all who ask for the same time.
//!
//! **A day.** At time 0 the sun stands where the settings say. From there the sky turns once a day around a pole that
//! is 40 degrees above +Z, as at 40 degrees south where -Z is north: the sun rises over +X and sets over -X. Its
//! direction and its light are exact at each time. The sky around it depends on how high it stands alone, but for a
//! turn around the zenith: so it is made once for each second degree of that, and below 6 degrees for each (a table of
//! 256 rows and 129 angles from the sun's azimuth, and what glossy surfaces mirror of it), and what lies between is
//! blended. A day makes at most 59 of them, each when it is first needed and the next one ahead of time in a thread of
//! its own; later days make none. A map is unrolled from them for each fifth of a degree that the sky has turned, so
//! that slow days write few maps. Nothing of this depends on when a thread is ready, only on the time that is asked for.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};

use glam::{DQuat, DVec3, Vec3};
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use super::atmosphere::Atmosphere;
use super::{AZIMUTHS, HEIGHT, SCALE, Sky, WIDTH};
use crate::scene::glossy::{self, LEVELS};
use crate::scene::{Environment, Sun};

/// Elevation of the pole around which the sky turns, in degrees.
const POLE_ELEVATION: f64 = 40.0;
/// The lowest sun that a sky is made for, in degrees. Up to [`TWILIGHT`] there is one for each degree, above for each
/// second one.
const LOWEST: f64 = -10.0;
const TWILIGHT: f64 = 6.0;
/// Maps that a day has.
pub const MAPS: f64 = 1800.0;
/// Texels across of what glossy surfaces mirror, at most: a sky has nothing finer but its horizon.
const MIRRORED: u32 = 256;

/// A sky that turns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DayCycle {
    /// The sky at time 0.
    pub sky: Sky,
    /// Seconds in which it turns once, above 0.
    pub seconds: f64,
    /// Factor for all of its light.
    pub scale: f32,
}

impl DayCycle {
    /// The sky at a time in seconds.
    pub fn at(&self, time: f64) -> Sky {
        let angle = time.rem_euclid(self.seconds) / self.seconds * TAU;
        if angle == 0.0 {
            return self.sky;
        }
        let direction = DQuat::from_axis_angle(pole(), angle) * self.sky.sanitised().sun_direction();
        Sky {
            sun_elevation_deg: direction.y.clamp(-1.0, 1.0).asin().to_degrees() as f32,
            sun_azimuth_deg: direction.x.atan2(-direction.z).to_degrees() as f32,
            ..self.sky
        }
    }

    /// The greatest elevation of the sun, in degrees.
    fn highest(&self) -> f64 {
        let from_pole = pole().angle_between(self.sky.sanitised().sun_direction()).to_degrees();
        90.0 - (90.0 - POLE_ELEVATION - from_pole).abs()
    }
}

/// Where among skies that are made one of an elevation in degrees is.
fn place(elevation: f64) -> f64 {
    let (low, high) = (elevation.min(TWILIGHT) - LOWEST, elevation.max(TWILIGHT) - TWILIGHT);
    low.max(0.0) + high / 2.0
}

/// The elevation of a sky that is made, in degrees.
fn elevation(index: usize) -> f64 {
    let (low, high) = ((index as f64).min(TWILIGHT - LOWEST), index as f64 - (TWILIGHT - LOWEST));
    (LOWEST + low + 2.0 * high.max(0.0)).min(90.0)
}

/// What the sky turns around, a unit vector.
fn pole() -> DVec3 {
    let (sin, cos) = POLE_ELEVATION.to_radians().sin_cos();
    DVec3::new(0.0, sin, cos)
}

/// The light of a day that goes on.
#[derive(Debug)]
pub struct Day {
    maker: Arc<Maker>,
    known: BTreeMap<usize, Arc<KnownSky>>,
    coming: Option<(usize, Receiver<KnownSky>)>,
    worker: Option<ThreadPool>,
    last: Option<Arc<SkyMap>>,
}

/// What skies are made of.
struct Maker {
    cycle: DayCycle,
    atmosphere: Atmosphere,
    glossy: bool,
}

impl std::fmt::Debug for Maker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.cycle.fmt(f)
    }
}

/// The sky around a sun of one elevation: its light has [`SCALE`] and the cycle's.
#[derive(Debug)]
struct KnownSky {
    /// Rows of [`AZIMUTHS`] angles from the sun's azimuth.
    rows: Vec<Vec<Vec3>>,
    /// Mean of all.
    brightness: f32,
    /// See [`glossy::prefiltered_halves`]; the sun's azimuth is in the centre. Empty where nothing is glossy.
    mirrored: Vec<(u32, Vec<Vec3>)>,
}

/// The sky without its sun, for a while.
#[derive(Debug)]
pub struct SkyMap {
    /// Tells one from another: of all maps of all days, from that of time 0 on.
    pub number: i64,
    /// The map; it has no sun.
    pub environment: Environment,
    /// As [`glossy::prefiltered`], where that is needed.
    pub mirrored: Option<Vec<[f32; 4]>>,
}

impl Day {
    /// A day of which nothing is known yet; `glossy` says whether some surface mirrors it.
    pub fn new(cycle: DayCycle, glossy: bool) -> Self {
        let sky = cycle.sky.sanitised();
        let maker = Maker { cycle: DayCycle { sky, ..cycle }, atmosphere: sky.atmosphere(), glossy };
        Day { maker: Arc::new(maker), known: BTreeMap::new(), coming: None, worker: None, last: None }
    }

    /// The sun at a time; its light is 0 where it is below the horizon.
    pub fn sun(&self, time: f64) -> Sun {
        let sky = self.maker.cycle.at(time);
        let mut sun = sky.sun(&self.maker.atmosphere).unwrap_or(Sun {
            direction: sky.sun_direction().as_vec3().normalize(),
            cos_radius: super::SUN_RADIUS_DEG.to_radians().cos() as f32,
            radiance: Vec3::ZERO,
        });
        sun.radiance *= self.maker.cycle.scale;
        sun
    }

    /// The sky at a time.
    pub fn map(&mut self, time: f64) -> Arc<SkyMap> {
        let length = self.maker.cycle.seconds / MAPS;
        let number = (time / length).round() as i64;
        if let Some(last) = self.last.as_ref().filter(|last| last.number == number) {
            return last.clone();
        }
        let rises = |time: f64| f64::from(self.maker.cycle.at(time).sun_elevation_deg);
        let sky = self.maker.cycle.at(number as f64 * length);
        let is_rising = rises((number + 1) as f64 * length) > rises(number as f64 * length);
        let position = place(f64::from(sky.sun_elevation_deg));
        let (below, share) = (position as usize, position.fract() as f32);
        let low = self.known(below);
        let high = if share > 0.0 { self.known(below + 1) } else { low.clone() };
        self.foresee(if is_rising { Some(below + 2) } else { below.checked_sub(1) });
        let map = unrolled(
            [&low, &high],
            weights([&low, &high], share),
            f64::from(sky.sun_azimuth_deg).to_radians(),
            number,
        );
        self.last.insert(Arc::new(map)).clone()
    }

    /// The day's brightest light, about: the sun at its highest.
    pub fn brightest(&mut self) -> Environment {
        let elevation = self.maker.cycle.highest();
        let sky = Sky { sun_elevation_deg: elevation as f32, ..self.maker.cycle.sky };
        let known = self.known(place(elevation) as usize);
        let mut sun = sky.sun(&self.maker.atmosphere);
        if let Some(sun) = &mut sun {
            sun.radiance *= self.maker.cycle.scale;
        }
        Environment { sun, ..unrolled([&known, &known], ALONE, 0.0, 0).environment }
    }

    fn known(&mut self, index: usize) -> Arc<KnownSky> {
        if let Some((_, coming)) = self.coming.take_if(|(of, _)| *of == index) {
            // A thread that is gone has left nothing: what it owed is made here.
            if let Ok(sky) = coming.recv() {
                self.known.insert(index, Arc::new(sky));
            }
        }
        let maker = &self.maker;
        self.known.entry(index).or_insert_with(|| Arc::new(maker.make(index))).clone()
    }

    /// Has a sky made that will be needed soon.
    fn foresee(&mut self, index: Option<usize>) {
        let highest = place(self.maker.cycle.highest()) as usize + 1;
        let Some(index) = index.filter(|index| *index <= highest && !self.known.contains_key(index)) else {
            return;
        };
        if self.coming.as_ref().is_some_and(|(of, _)| *of == index) {
            return;
        }
        // One thread: what is not urgent takes no more than one core from what is.
        if self.worker.is_none() {
            let named = ThreadPoolBuilder::new().num_threads(1).thread_name(|_| "sky".into());
            self.worker = named.build().ok();
        }
        let Some(worker) = &self.worker else { return };
        let (sender, receiver) = channel();
        let maker = self.maker.clone();
        worker.spawn(move || drop(sender.send(maker.make(index))));
        self.coming = Some((index, receiver));
    }
}

impl Maker {
    fn make(&self, index: usize) -> KnownSky {
        let sky = Sky { sun_elevation_deg: elevation(index) as f32, sun_azimuth_deg: 0.0, ..self.cycle.sky };
        let scale = SCALE * f64::from(self.cycle.scale);
        let row = |row: Vec<DVec3>| row.into_iter().map(|light| (light * scale).as_vec3()).collect();
        let rows: Vec<Vec<Vec3>> = sky.rows(&self.atmosphere).into_iter().map(row).collect();
        let sum: f32 = rows.iter().flatten().map(|light| light.element_sum()).sum();
        let brightness = sum / (AZIMUTHS as f32 * HEIGHT as f32);
        let mut known = KnownSky { rows, brightness, mirrored: Vec::new() };
        if self.glossy {
            let map = unrolled([&known, &known], ALONE, 0.0, 0).environment;
            known.mirrored = glossy::prefiltered_halves(&map, MIRRORED);
        }
        known
    }
}

/// Weights of two skies of which one counts alone.
const ALONE: [f32; 2] = [1.0, 0.0];

/// Weights of two skies for one that is `share` of the way from the first to the second. Twilight fades by a factor for each
/// degree: how bright it is goes by the geometric mean, what it looks like by the other.
fn weights(skies: [&KnownSky; 2], share: f32) -> [f32; 2] {
    let [low, high] = skies.map(|sky| sky.brightness.max(f32::MIN_POSITIVE));
    let brightness = low.powf(1.0 - share) * high.powf(share);
    [(1.0 - share) * (brightness / low), share * (brightness / high)]
}

/// The map of two skies with their weights, for a sun of that azimuth in radians.
fn unrolled(skies: [&KnownSky; 2], weights: [f32; 2], azimuth: f64, number: i64) -> SkyMap {
    let columns = columns(WIDTH, AZIMUTHS, azimuth, |apart| apart * (AZIMUTHS - 1) as f64);
    let row = |y: u32| {
        let [low, high] = skies.map(|sky| &sky.rows[y as usize]);
        blended(low, high, weights, &columns)
    };
    let texels: Vec<Vec3> = (0..HEIGHT).into_par_iter().flat_map_iter(row).collect();
    let is_mirrored = skies.iter().all(|sky| !sky.mirrored.is_empty());
    SkyMap {
        number,
        environment: Environment { width: WIDTH, height: HEIGHT, texels, sun: None },
        mirrored: is_mirrored.then(|| mirrored(skies, weights, azimuth)),
    }
}

/// The same of all levels of what glossy surfaces mirror, for a sun of that azimuth.
fn mirrored(skies: [&KnownSky; 2], weights: [f32; 2], azimuth: f64) -> Vec<[f32; 4]> {
    let mut texels = Vec::new();
    for ((_, width), levels) in LEVELS.into_iter().zip(skies[0].mirrored.iter().zip(&skies[1].mirrored)) {
        let ((known, low), (_, high)) = levels;
        let half = (known / 2) as usize;
        // Columns run from opposite of the sun to where it is, each with its centre between its edges.
        let columns = columns(width, half, azimuth, |apart| (1.0 - apart) * half as f64 - 0.5);
        let row = |y: u32| -> Vec<[f32; 4]> {
            let at = (f64::from(y) + 0.5) * f64::from(*known) / f64::from(width) - 0.5;
            let at = at.clamp(0.0, (half - 1) as f64);
            let (above, down) = (at as usize, at.fract() as f32);
            let below = (above + 1).min(half - 1);
            let of = |row: usize| {
                blended(&low[row * half..][..half], &high[row * half..][..half], weights, &columns)
            };
            of(above).zip(of(below)).map(|(a, b)| a.lerp(b, down).extend(0.0).to_array()).collect()
        };
        texels.par_extend((0..width / 2).into_par_iter().flat_map_iter(row));
    }
    texels
}

/// For each of `width` columns of a map the entry of a row, and the share of the next one; `place` tells where in the row an
/// angle from the sun's azimuth is, 0 to 1 for 0 to half a turn.
fn columns(width: u32, entries: usize, azimuth: f64, place: impl Fn(f64) -> f64) -> Vec<(usize, f32)> {
    let column = |x: u32| {
        let here = ((f64::from(x) + 0.5) / f64::from(width) - 0.5) * TAU;
        let apart = (here - azimuth + TAU / 2.0).rem_euclid(TAU) - TAU / 2.0;
        let at = place(apart.abs() / (TAU / 2.0)).clamp(0.0, (entries - 1) as f64);
        let index = (at as usize).min(entries - 2);
        (index, (at - index as f64) as f32)
    };
    (0..width).map(column).collect()
}

/// A row between two, read at columns.
fn blended<'a>(
    low: &'a [Vec3],
    high: &'a [Vec3],
    weights: [f32; 2],
    columns: &'a [(usize, f32)],
) -> impl Iterator<Item = Vec3> + 'a {
    let row: Vec<Vec3> =
        low.iter().zip(high).map(|(low, high)| *low * weights[0] + *high * weights[1]).collect();
    columns.iter().map(move |&(index, across)| row[index].lerp(row[index + 1], across))
}

#[cfg(test)]
mod tests;
