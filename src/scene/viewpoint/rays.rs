//! The few rays that finding a viewpoint takes, by brute force: cheaper than a tree for a single use.

use glam::DVec3;
use rayon::prelude::*;

use crate::scene::Mesh;

/// The corners of a triangle, relative to the scene's anchor.
fn corners(mesh: &Mesh, triangle: [u32; 3]) -> [DVec3; 3] {
    triangle.map(|index| mesh.positions[index as usize].as_dvec3())
}

/// The height at which a vertical line meets a triangle, edges included, and whether the triangle's front
/// faces up; `None` beside it or where the triangle itself is vertical.
fn height_at(x: f64, z: f64, [a, b, c]: [DVec3; 3]) -> Option<(f64, bool)> {
    let edge = |p: DVec3, q: DVec3| (q.x - p.x) * (z - p.z) - (q.z - p.z) * (x - p.x);
    let (u, v, w) = (edge(b, c), edge(c, a), edge(a, b));
    let area = u + v + w;
    let outside = (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0);
    if outside || area == 0.0 {
        return None;
    }
    let y = (a.y * u + b.y * v + c.y * w) / area;
    y.is_finite().then_some((y, area < 0.0))
}

/// For each column (x, z) the height of what lies highest under the open sky there.
pub fn tops(mesh: &Mesh, columns: &[(f64, f64)]) -> Vec<Option<f64>> {
    let higher = |a: Option<f64>, b: Option<f64>| match (a, b) {
        (Some(a), Some(b)) => Some(a.max(b)),
        (a, b) => a.or(b),
    };
    let none = || vec![None; columns.len()];
    mesh.triangles
        .par_iter()
        .fold(none, |mut tops: Vec<Option<f64>>, &triangle| {
            let corners = corners(mesh, triangle);
            for (top, &(x, z)) in tops.iter_mut().zip(columns) {
                *top = higher(*top, height_at(x, z, corners).map(|(y, _)| y));
            }
            tops
        })
        .reduce(none, |a, b| a.into_iter().zip(b).map(|(a, b)| higher(a, b)).collect())
}

/// All heights at which a vertical line meets the scene, from below, each with whether the front of what
/// it meets faces up.
pub fn layers(mesh: &Mesh, (x, z): (f64, f64)) -> Vec<(f64, bool)> {
    let mut layers: Vec<(f64, bool)> =
        mesh.triangles.par_iter().filter_map(|&triangle| height_at(x, z, corners(mesh, triangle))).collect();
    layers.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    layers
}

/// For each horizontal unit direction how far a ray from `eye` gets, at most `limit`.
pub fn free_distances(mesh: &Mesh, eye: DVec3, directions: &[DVec3], limit: f64) -> Vec<f64> {
    let full = || vec![limit; directions.len()];
    mesh.triangles
        .par_iter()
        .fold(full, |mut free: Vec<f64>, &triangle| {
            let corners = corners(mesh, triangle);
            let [a, b, c] = corners.map(|corner| corner.y);
            if a.min(b).min(c) <= eye.y && eye.y <= a.max(b).max(c) {
                for (free, &direction) in free.iter_mut().zip(directions) {
                    *free = free.min(distance(eye, direction, corners).unwrap_or(limit));
                }
            }
            free
        })
        .reduce(full, |a, b| a.into_iter().zip(b).map(|(a, b)| a.min(b)).collect())
}

/// Möller and Trumbore, "Fast, Minimum Storage Ray-Triangle Intersection", 1997, from both sides.
fn distance(origin: DVec3, direction: DVec3, [a, b, c]: [DVec3; 3]) -> Option<f64> {
    let (ab, ac, to_origin) = (b - a, c - a, origin - a);
    let p = direction.cross(ac);
    let inverse = 1.0 / ab.dot(p);
    let q = to_origin.cross(ab);
    let (u, v) = (to_origin.dot(p) * inverse, direction.dot(q) * inverse);
    let t = ac.dot(q) * inverse;
    // A ray in the triangle's plane makes these infinite or NaN, which no comparison lets through.
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0 && t.is_finite()).then_some(t)
}
