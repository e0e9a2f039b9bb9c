//! From the runtime's mesh of what the lenses hide to hidden pixels.

use glam::DVec2;

use crate::foveation::BitMask;
use crate::math::view::FieldOfView;

/// Triangles of a mesh at most; real ones have a few hundred.
const MOST_TRIANGLES: usize = 1 << 16;

/// A mesh of hidden triangles in the plane one metre ahead of the eye, X right and Y up.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HiddenMesh {
    triangles: Vec<[DVec2; 3]>,
}

impl HiddenMesh {
    /// From the runtime's vertices and indices; what makes no triangle is left out.
    pub fn new(vertices: &[[f32; 2]], indices: &[u32]) -> Self {
        let vertex = |&index: &u32| {
            let [x, y] = *vertices.get(index as usize)?;
            let vertex = DVec2::new(x.into(), y.into());
            vertex.is_finite().then_some(vertex)
        };
        let triangle = |corners: &[u32]| {
            let corners: Option<Vec<_>> = corners.iter().map(vertex).collect();
            corners.and_then(|corners| <[DVec2; 3]>::try_from(corners).ok())
        };
        let triangles = indices.chunks_exact(3).take(MOST_TRIANGLES).filter_map(triangle).collect();
        HiddenMesh { triangles }
    }

    /// The pixels that are hidden with all four of their corners; `None` where none are, or all, which no
    /// headset means.
    pub fn pixels(&self, fov: &FieldOfView, width: u32, height: u32) -> Option<BitMask> {
        let (across, down) = (width as usize + 1, height as usize + 1);
        let mut hidden = vec![false; across * down];
        let scale =
            DVec2::new(f64::from(width) / (fov.right - fov.left), f64::from(height) / (fov.down - fov.up));
        for triangle in &self.triangles {
            let corners = triangle.map(|corner| (corner - DVec2::new(fov.left, fov.up)) * scale);
            cover(&mut hidden, across, down, corners);
        }
        let corner = |x: u32, y: u32| hidden[y as usize * across + x as usize];
        let pixel = |x, y| corner(x, y) && corner(x + 1, y) && corner(x, y + 1) && corner(x + 1, y + 1);
        let mask = BitMask::from_fn(width, height, pixel);
        let count = mask.count();
        (count > 0 && count < width as usize * height as usize).then_some(mask)
    }
}

/// Marks the points of a grid, one apart, that lie in a triangle or on its edge.
fn cover(hidden: &mut [bool], across: usize, down: usize, [a, b, c]: [DVec2; 3]) {
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    let range = |low: f64, high: f64, count: usize| {
        let first = (low - SLACK).ceil().clamp(0.0, count as f64) as usize;
        first..((high + SLACK).floor() + 1.0).clamp(0.0, count as f64) as usize
    };
    let area = (b - a).perp_dot(c - a);
    if area.abs() < 1e-12 {
        return;
    }
    let sides = [(a, b), (b, c), (c, a)].map(|(from, to)| {
        let edge = (to - from) * area.signum();
        (from, edge, -SLACK * edge.length())
    });
    for y in range(low.y, high.y, down) {
        for x in range(low.x, high.x, across) {
            let point = DVec2::new(x as f64, y as f64);
            hidden[y * across + x] |=
                sides.iter().all(|(from, edge, least)| edge.perp_dot(point - *from) >= *least);
        }
    }
}

/// Pixels by which a triangle is widened, so that points on the edge of two are in one, and points on the
/// edge of the view are in what runtimes, which round to single precision, hide up to that edge.
const SLACK: f64 = 1e-3;

#[cfg(test)]
mod tests {
    use super::*;

    const FOV: FieldOfView = FieldOfView { left: -1.2, right: 0.8, up: 1.0, down: -1.0 };

    /// A mesh that hides the view beyond a circle of that radius around the axis.
    fn ring(radius: f64) -> HiddenMesh {
        let (mut vertices, mut indices) = (Vec::new(), Vec::new());
        for step in 0..=64u32 {
            let (sin, cos) = (f64::from(step) / 64.0 * std::f64::consts::TAU).sin_cos();
            for radius in [radius, 3.0] {
                vertices.push([(cos * radius) as f32, (sin * radius) as f32]);
            }
            if step > 0 {
                let at = 2 * step;
                indices.extend([at - 2, at - 1, at, at, at - 1, at + 1]);
            }
        }
        HiddenMesh::new(&vertices, &indices)
    }

    #[test]
    fn pixels_beyond_a_ring_are_hidden_and_none_within() {
        let (width, height) = (100, 110);
        let mask = ring(0.9).pixels(&FOV, width, height).unwrap();
        for y in 0..height {
            for x in 0..width {
                let corner = |dx: u32, dy: u32| {
                    let u = f64::from(x + dx) / f64::from(width);
                    let v = f64::from(y + dy) / f64::from(height);
                    (FOV.left + (FOV.right - FOV.left) * u).hypot(FOV.up + (FOV.down - FOV.up) * v)
                };
                let radii = [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)];
                // The ring is a polygon: a little inside the circle.
                if radii.iter().any(|&radius| radius < 0.89) {
                    assert!(!mask.get(x, y), "({x}, {y}) is seen");
                } else if radii.iter().all(|&radius| radius > 0.901) {
                    assert!(mask.get(x, y), "({x}, {y}) is hidden");
                }
            }
        }
    }

    #[test]
    fn meshes_that_hide_nothing_or_everything_are_none() {
        let none = |vertices: &[[f32; 2]], indices: &[u32]| {
            HiddenMesh::new(vertices, indices).pixels(&FOV, 20, 20).is_none()
        };
        assert!(none(&[], &[]) && none(&[[0.0, 0.0]], &[0, 1, 2]));
        assert!(none(&[[0.0, 0.0], [f32::NAN, 1.0], [1.0, 0.0]], &[0, 1, 2]));
        assert!(none(&[[-9.0, -9.0], [40.0, -9.0], [-9.0, 40.0]], &[0, 1, 2]));
        assert!(none(&[[0.0, 0.0], [0.5, 0.5], [0.2, 0.2]], &[0, 1, 2, 0]));
        assert!(none(&[[1e30, -1e30], [2e30, 5.0], [f32::MAX, f32::MAX]], &[0, 1, 2]));
    }
}
