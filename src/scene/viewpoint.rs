//! Where a scene is seen from when nobody says.
//!
//! The file's own camera comes first. Without one, a small or single thing is seen from outside, and a
//! place is seen from inside: standing in it, at a person's eye height.

mod rays;

use glam::DVec3;

use super::{Camera, Mesh, Scene};
use crate::math::pose::Pose;

/// Height of a standing person's eyes in metres.
const EYE_HEIGHT: f64 = 1.65;
/// Diagonal of the bounds in metres below which nobody could stand in a scene.
const SMALL: f64 = 6.0;
/// Diagonal above which a scene is taken not to be in metres: the eye height grows along with it.
const LARGE: f64 = 2000.0;
/// Least width of a place in eye heights.
const NARROW: f64 = 0.6;
/// Free space ahead, in eye heights, that makes a place worth standing in: outdoors and indoors.
const ROOM_OUTDOORS: f64 = 2.0;
const ROOM_INDOORS: f64 = 1.0;
/// Least height of a room in eye heights.
const HEADROOM: f64 = 1.2;
/// Share of the bounds' height above which what the sky sees is a roof or a summit rather than ground.
const GROUND_SHARE: f64 = 0.5;
/// Height over the longer side below which a scene is a landscape, which may be seen from its top.
const LANDSCAPE: f64 = 0.2;
/// Field of view in degrees for settings that are none.
const FALLBACK_FOV: f64 = 70.0;
/// Field of view, in radians, of the perspective camera that stands for an orthographic one: one degree.
const FAR_FOV: f64 = std::f64::consts::PI / 180.0;
/// Share of the field of view that a thing seen from outside fills.
const FILLED: f64 = 0.9;

/// A camera: where it is and how much it sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// Where the eye is in the world, in metres; it looks along its -Z.
    pub world_from_eye: Pose,
    /// Vertical field of view in radians.
    pub fov_y: f64,
}

/// The viewpoint for a scene that is given none. Always finite.
///
/// 1. The camera that was asked for ([`Scene::camera`]); else the file's one named "viewer", else its first
///    perspective one, else its first orthographic one.
/// 2. From outside, all of it in the picture where that is at least as wide as high: bounds with a
///    diagonal below 6 m, walls with no depth, single things with nowhere to stand, and things on an open
///    floor that nobody who stands there has in sight with room before them.
/// 3. Else from inside, 1.65 m above what is highest under the open sky at the centre of the bounds, or
///    near it where a roof is there, or under that roof. The eye looks along the longer side of the
///    bounds, the way that has more room. Bounds with a diagonal above 2 km raise the eye in proportion.
///
/// `fov_y_deg`, in degrees, is for cases 2 and 3.
pub fn default_viewpoint(scene: &Scene, fov_y_deg: f64) -> Viewpoint {
    let asked = scene.camera.and_then(|index| scene.cameras.get(index)).and_then(through);
    if let Some(viewpoint) = asked.or_else(|| file_camera(&scene.cameras)) {
        return viewpoint;
    }
    let fov_y = if fov_y_deg.is_finite() { fov_y_deg.clamp(1.0, 175.0) } else { FALLBACK_FOV }.to_radians();
    let pose = match scene.bounds() {
        None => Pose::new(glam::DQuat::IDENTITY, DVec3::Y * EYE_HEIGHT),
        Some((low, high)) => {
            let bounds = Bounds { low: low.as_dvec3(), high: high.as_dvec3() };
            inside(&scene.outlines(), &bounds).unwrap_or_else(|| outside(&bounds, fov_y))
        }
    };
    Viewpoint { world_from_eye: Pose { position: scene.anchor + pose.position, ..pose }, fov_y }
}

/// An axis-aligned box relative to the scene's anchor.
struct Bounds {
    low: DVec3,
    high: DVec3,
}

impl Bounds {
    fn size(&self) -> DVec3 {
        self.high - self.low
    }

    fn centre(&self) -> DVec3 {
        self.low + self.size() * 0.5
    }

    fn corners(&self) -> impl Iterator<Item = DVec3> + '_ {
        (0..8u32).map(|i| {
            let share = DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2));
            self.low + self.size() * share
        })
    }

    /// How far it is from a point inside to the side wall in a horizontal unit direction.
    fn exit(&self, from: DVec3, direction: DVec3) -> f64 {
        let to_wall = |low: f64, high: f64, from: f64, way: f64| match way {
            way if way > 0.0 => (high - from) / way,
            way if way < 0.0 => (low - from) / way,
            _ => f64::INFINITY,
        };
        let x = to_wall(self.low.x, self.high.x, from.x, direction.x);
        x.min(to_wall(self.low.z, self.high.z, from.z, direction.z)).max(0.0)
    }
}

fn file_camera(cameras: &[Camera]) -> Option<Viewpoint> {
    let viewer = cameras.iter().filter(|camera| camera.name.eq_ignore_ascii_case("viewer")).find_map(through);
    let perspective = || cameras.iter().filter(|camera| camera.fov_y.is_some()).find_map(through);
    viewer.or_else(perspective).or_else(|| cameras.iter().find_map(through))
}

/// What a camera sees. An orthographic one is replaced by a perspective one that is so far away that what it
/// frames spans one degree; things at twice the frame's height from it are then larger by 2 %.
fn through(camera: &Camera) -> Option<Viewpoint> {
    let Pose { rotation, position } = camera.world_from_eye;
    let usable = camera.fov_y.filter(|fov| *fov > 0.0 && *fov < std::f64::consts::PI);
    if let Some(fov_y) = usable {
        return Some(Viewpoint { world_from_eye: Pose::new(rotation, position), fov_y });
    }
    let half = camera.half_height.filter(|half| half.is_finite() && *half > 0.0)?;
    let away = half / (FAR_FOV * 0.5).tan();
    Some(Viewpoint {
        world_from_eye: Pose::new(rotation, position + rotation * DVec3::Z * away),
        fov_y: FAR_FOV,
    })
}

/// A three-quarter view that frames the bounds.
fn outside(bounds: &Bounds, fov_y: f64) -> Pose {
    let centre = bounds.centre();
    let away = DVec3::new(0.6, 0.4, 1.0).normalize();
    let axes = Pose::look_at(away, DVec3::ZERO).rotation;
    let tangent = (fov_y * 0.5).tan() * FILLED;
    // A corner at (x, y, z) in the eye's axes is in the picture from the distance d where
    // max(|x|, |y|) <= tangent * (d - z).
    let distance = bounds
        .corners()
        .map(|corner| axes.conjugate() * (corner - centre))
        .map(|corner| corner.x.abs().max(corner.y.abs()) / tangent + corner.z)
        .fold(0.0, f64::max);
    let distance = if distance > 0.0 { distance } else { 1.0 };
    Pose::new(axes, centre + away * distance)
}

/// A standing view; `None` where there is nowhere to stand.
fn inside(mesh: &Mesh, bounds: &Bounds) -> Option<Pose> {
    let size = bounds.size();
    let diagonal = size.length();
    let eye_height = EYE_HEIGHT * (diagonal / LARGE).max(1.0);
    if diagonal < SMALL || size.x.min(size.z) < NARROW * eye_height {
        return None;
    }
    let place = Place { mesh, bounds, eye_height };
    place.outdoors().or_else(|| place.indoors()).or_else(|| place.summit())
}

/// A scene in which somebody looks for a place to stand.
struct Place<'a> {
    mesh: &'a Mesh,
    bounds: &'a Bounds,
    eye_height: f64,
}

impl Place<'_> {
    /// On the ground under the open sky, at the centre or as near to it as there is room.
    fn outdoors(&self) -> Option<Pose> {
        let columns = self.columns();
        let highest_ground = self.bounds.low.y + self.bounds.size().y * GROUND_SHARE;
        let tops = rays::tops(self.mesh, &columns);
        // Where nothing at all is below the centre, things stand around it on ground that is not drawn.
        let over_nothing = |i: usize| (i == 0).then_some(self.bounds.low.y);
        let grounds =
            tops.into_iter().enumerate().filter_map(|(i, top)| Some((i, top.or_else(|| over_nothing(i))?)));
        grounds
            .filter(|&(_, ground)| ground <= highest_ground)
            .find_map(|(i, ground)| self.stand(columns[i], ground, ROOM_OUTDOORS, true))
    }

    /// Under a roof at the centre, on the floor with the most headroom.
    fn indoors(&self) -> Option<Pose> {
        let centre = self.columns()[0];
        let layers = rays::layers(self.mesh, centre);
        let (floor, headroom) = layers
            .windows(2)
            .filter(|pair| pair[0].1)
            .map(|pair| (pair[0].0, pair[1].0 - pair[0].0))
            .max_by(|a, b| a.1.total_cmp(&b.1))?;
        (headroom >= HEADROOM * self.eye_height).then(|| self.stand(centre, floor, ROOM_INDOORS, false))?
    }

    /// On top of a landscape at its centre, where that is not the top of one thing alone.
    fn summit(&self) -> Option<Pose> {
        let size = self.bounds.size();
        let columns = self.columns();
        let tops = rays::tops(self.mesh, &columns);
        let top = tops[0]?;
        let as_high = tops.iter().flatten().filter(|&&other| other > top - self.eye_height).count();
        let landscape = size.y < LANDSCAPE * size.x.max(size.z) && as_high * 5 >= columns.len();
        landscape.then(|| self.stand(columns[0], top, 0.0, false))?
    }

    /// Places (x, z) worth a try: the centre, then a grid over the middle half, nearest first.
    fn columns(&self) -> Vec<(f64, f64)> {
        let (centre, size) = (self.bounds.centre(), self.bounds.size());
        let mut steps: Vec<(i32, i32)> = (-2..=2).flat_map(|x| (-2..=2).map(move |z| (x, z))).collect();
        steps.sort_by_key(|(x, z)| x * x + z * z);
        let at = |centre: f64, size: f64, step: i32| centre + size * f64::from(step) / 8.0;
        steps.into_iter().map(|(x, z)| (at(centre.x, size.x, x), at(centre.z, size.z, z))).collect()
    }

    /// The view of somebody who stands there; `None` with less room ahead than that many eye heights, and
    /// where nothing stands in sight though something should.
    fn stand(&self, (x, z): (f64, f64), ground: f64, room: f64, in_sight: bool) -> Option<Pose> {
        let eye = DVec3::new(x, ground + self.eye_height, z);
        let size = self.bounds.size();
        let (long, short) = if size.x > size.z { (DVec3::X, DVec3::Z) } else { (DVec3::Z, DVec3::X) };
        let ways = [-long, long, -short, short];
        let seen = self.look(eye, ways);
        // What shows something comes before what shows only the way out.
        let rank = |way: usize| (!in_sight || seen[way].something, seen[way].free);
        let freer = |a: usize, b: usize| if rank(b) > rank(a) { b } else { a };
        let (along, across) = (freer(0, 1), freer(2, 3));
        let enough = room.max(1.0) * self.eye_height;
        let best = if rank(along) >= (true, enough) { along } else { freer(along, across) };
        let target = eye + ways[best] * size.length();
        (rank(best) >= (true, room * self.eye_height)).then(|| Pose::look_at(eye, target))
    }

    /// What five rays each way find, inside the bounds.
    fn look(&self, eye: DVec3, ways: [DVec3; 4]) -> [Seen; 4] {
        const TURNS: [f64; 5] = [-0.7, -0.35, 0.0, 0.35, 0.7];
        let fan = ways.map(|way| TURNS.map(|turn| glam::DQuat::from_rotation_y(turn) * way));
        let directions = fan.concat();
        let free = rays::free_distances(self.mesh, eye, &directions, self.bounds.size().length());
        std::array::from_fn(|way| {
            let first = way * TURNS.len();
            let exit = |ray: usize| self.bounds.exit(eye, directions[first + ray]);
            let meets = |ray: usize| free[first + ray] < exit(ray);
            Seen {
                free: (1..4).map(|ray| free[first + ray].min(exit(ray))).sum::<f64>() / 3.0,
                // Ahead, or on both sides.
                something: meets(2) || ((meets(0) || meets(1)) && (meets(3) || meets(4))),
            }
        })
    }
}

/// What is one way.
struct Seen {
    /// Mean length of the rays in the middle.
    free: f64,
    /// Something is in sight, apart from what is at one edge of it.
    something: bool,
}

#[cfg(test)]
mod tests;
