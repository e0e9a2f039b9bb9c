//! Triangle shapes in metres, +Y up, counter-clockwise seen from outside. Texture coordinates are in
//! metres too where nothing else is said: materials scale them.

use std::f32::consts::TAU;

use glam::{Affine3A, Vec2, Vec3};

/// Triangles of one material.
#[derive(Clone, Debug, Default)]
pub struct Shape {
    /// Vertex positions.
    pub positions: Vec<Vec3>,
    /// Unit normals.
    pub normals: Vec<Vec3>,
    /// Texture coordinates.
    pub uvs: Vec<Vec2>,
    /// Three for each triangle.
    pub indices: Vec<u32>,
}

/// Triangles of less area, in square metres, are left out.
const LEAST_AREA: f32 = 1e-9;

impl Shape {
    /// Least and greatest corner.
    pub fn bounds(&self) -> (Vec<f64>, Vec<f64>) {
        let fold = |f: fn(Vec3, Vec3) -> Vec3| {
            let corner = self.positions.iter().copied().reduce(f).unwrap_or_default();
            corner.to_array().map(f64::from).to_vec()
        };
        (fold(Vec3::min), fold(Vec3::max))
    }

    /// Number of triangles.
    pub fn triangles(&self) -> usize {
        self.indices.len() / 3
    }

    fn vertex(&mut self, position: Vec3, normal: Vec3, uv: Vec2) -> u32 {
        self.positions.push(position);
        self.normals.push(normal);
        self.uvs.push(uv);
        (self.positions.len() - 1) as u32
    }

    fn triangle(&mut self, corners: [u32; 3]) {
        let [a, b, c] = corners.map(|i| self.positions[i as usize]);
        if (b - a).cross(c - a).length() > 2.0 * LEAST_AREA {
            self.indices.extend(corners);
        }
    }

    /// Adds a copy of `other`, moved by `transform` (rotation, translation, even scale).
    pub fn append(&mut self, other: &Shape, transform: Affine3A) {
        let base = self.positions.len() as u32;
        self.positions.extend(other.positions.iter().map(|&p| transform.transform_point3(p)));
        self.normals.extend(other.normals.iter().map(|&n| transform.transform_vector3(n).normalize()));
        self.uvs.extend(&other.uvs);
        self.indices.extend(other.indices.iter().map(|i| base + i));
    }

    /// The parallelogram from `corner` along `u` and `v`; it faces u × v. `uv` spans the texture
    /// coordinates of its corners.
    pub fn quad_with(&mut self, corner: Vec3, u: Vec3, v: Vec3, uv: [Vec2; 2]) {
        let normal = u.cross(v).normalize();
        let at = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
        let [a, b, c, d] = at.map(|(s, t)| {
            self.vertex(corner + u * s + v * t, normal, uv[0] + (uv[1] - uv[0]) * Vec2::new(s, t))
        });
        self.triangle([a, b, c]);
        self.triangle([a, c, d]);
    }

    /// [`Shape::quad_with`] with texture coordinates in metres; the picture's top is towards +v.
    pub fn quad(&mut self, corner: Vec3, u: Vec3, v: Vec3) {
        self.quad_with(corner, u, v, [Vec2::new(0.0, v.length()), Vec2::new(u.length(), 0.0)]);
    }

    /// A box by its centre and half its size.
    pub fn cuboid(&mut self, centre: Vec3, half: Vec3) {
        let [x, y, z] = [Vec3::X * half.x, Vec3::Y * half.y, Vec3::Z * half.z];
        for (out, u, v) in [(x, -z, y), (-x, z, y), (z, x, y), (-z, -x, y), (y, x, -z), (-y, x, z)] {
            self.quad(centre + out - u - v, u * 2.0, v * 2.0);
        }
    }

    /// A box between two points with a square section, `half` wide to each side.
    pub fn beam(&mut self, from: Vec3, to: Vec3, half: f32) {
        let mut made = Shape::default();
        made.cuboid(Vec3::ZERO, Vec3::new(half, half, from.distance(to) / 2.0));
        let towards = (to - from).normalize();
        let up = if towards.y.abs() > 0.99 { Vec3::X } else { Vec3::Y };
        let right = up.cross(towards).normalize();
        let rotation = glam::Mat3::from_cols(right, towards.cross(right), towards);
        self.append(&made, Affine3A::from_mat3_translation(rotation, (from + to) / 2.0));
    }

    /// A surface of `size` cells over the unit square. Normals follow from differences and face
    /// ∂f/∂u × ∂f/∂v.
    pub fn surface(&mut self, size: [usize; 2], uv_scale: Vec2, f: impl Fn(f32, f32) -> Vec3) {
        let base = self.positions.len() as u32;
        let [columns, rows] = size;
        let h = 1e-3;
        for y in 0..=rows {
            for x in 0..=columns {
                let (u, v) = (x as f32 / columns as f32, y as f32 / rows as f32);
                let normal = (f(u + h, v) - f(u - h, v)).cross(f(u, v + h) - f(u, v - h));
                self.vertex(f(u, v), normal.try_normalize().unwrap_or(Vec3::Y), Vec2::new(u, v) * uv_scale);
            }
        }
        let at = |x: usize, y: usize| base + (y * (columns + 1) + x) as u32;
        for y in 0..rows {
            for x in 0..columns {
                self.triangle([at(x, y), at(x + 1, y), at(x + 1, y + 1)]);
                self.triangle([at(x, y), at(x + 1, y + 1), at(x, y + 1)]);
            }
        }
    }

    /// A profile of (radius, height), turned around +Y. Going up along the profile, the outside is where
    /// the radius grows. Edges sharper than 40 degrees stay sharp.
    pub fn lathe(&mut self, profile: &[(f32, f32)], segments: usize) {
        self.lathe_with(profile, segments, |_| 1.0);
    }

    /// [`Shape::lathe`] around an axis through `at`, from where heights count.
    pub fn lathe_at(&mut self, at: Vec3, profile: &[(f32, f32)], segments: usize) {
        let mut made = Shape::default();
        made.lathe(profile, segments);
        self.append(&made, Affine3A::from_translation(at));
    }

    /// [`Shape::lathe`] with the radius multiplied by `scale(angle)`, such as fluting.
    pub fn lathe_with(&mut self, profile: &[(f32, f32)], segments: usize, scale: impl Fn(f32) -> f32) {
        let slopes: Vec<Vec2> = profile
            .windows(2)
            .map(|w| Vec2::new(w[1].1 - w[0].1, w[0].0 - w[1].0).normalize_or(Vec2::X))
            .collect();
        let smooth = |a: Vec2, b: Vec2| if a.dot(b) > 0.766 { (a + b).normalize() } else { a };
        let widest = profile.iter().fold(0.0f32, |w, p| w.max(p.0));
        let mut along = 0.0;
        for (i, ends) in profile.windows(2).enumerate() {
            let low = smooth(slopes[i], slopes[i.saturating_sub(1)]);
            let high = smooth(slopes[i], slopes[(i + 1).min(slopes.len() - 1)]);
            let step = Vec2::from(ends[0]).distance(ends[1].into());
            let base = self.positions.len() as u32;
            for s in 0..=segments {
                let angle = TAU * (s % segments) as f32 / segments as f32;
                let (sin, cos) = angle.sin_cos();
                let slope = (scale(angle + 1e-3) - scale(angle - 1e-3)) / 2e-3 / scale(angle);
                let out = Vec3::new(cos, 0.0, sin) - Vec3::new(-sin, 0.0, cos) * slope;
                let u = TAU * s as f32 / segments as f32 * widest;
                for (&(radius, height), normal, v) in [(&ends[0], low, along), (&ends[1], high, along + step)]
                {
                    let r = radius * scale(angle);
                    let normal = (out * normal.x + Vec3::Y * normal.y).normalize();
                    self.vertex(Vec3::new(cos * r, height, sin * r), normal, Vec2::new(u, -v));
                }
            }
            for s in 0..segments as u32 {
                let a = base + 2 * s;
                self.triangle([a, a + 1, a + 2]);
                self.triangle([a + 2, a + 1, a + 3]);
            }
            along += step;
        }
    }

    /// A sphere of `segments` around and half as many rings.
    pub fn sphere(&mut self, centre: Vec3, radius: f32, segments: usize) {
        let rings = segments / 2;
        let profile: Vec<(f32, f32)> = (0..=rings)
            .map(|i| {
                let (sin, cos) = (TAU / 2.0 * i as f32 / rings as f32).sin_cos();
                (if i == 0 || i == rings { 0.0 } else { radius * sin }, -radius * cos)
            })
            .collect();
        let mut made = Shape::default();
        made.lathe(&profile, segments);
        for (position, normal) in made.positions.iter().zip(&mut made.normals) {
            *normal = *position / radius;
        }
        self.append(&made, Affine3A::from_translation(centre));
    }

    /// A tube along `points`, at least two and none on top of its successor; `radius` by the part of the way,
    /// 0 to 1. A closed one joins its last point to its first.
    pub fn tube(&mut self, points: &[Vec3], sides: usize, closed: bool, radius: impl Fn(f32) -> f32) {
        let n = points.len();
        let base = self.positions.len() as u32;
        let rings = if closed { n + 1 } else { n };
        let tangent = |i: usize| {
            let (before, after) = match closed {
                true => (points[(i + n - 1) % n], points[(i + 1) % n]),
                false => (points[i.saturating_sub(1)], points[(i + 1).min(n - 1)]),
            };
            (after - before).normalize()
        };
        let first = tangent(0);
        let start = first.any_orthonormal_vector();
        let mut frame = start;
        let mut along = 0.0;
        for ring in 0..rings {
            let i = ring % n;
            let t = tangent(i);
            // Each frame is the last one with the new tangent taken out: little twist.
            frame = if ring == n { start } else { (frame - t * frame.dot(t)).normalize() };
            let side = t.cross(frame);
            if ring > 0 {
                along += points[i].distance(points[(ring - 1) % n]);
            }
            let r = radius(ring as f32 / (rings - 1) as f32);
            for s in 0..=sides {
                let (sin, cos) = (TAU * (s % sides) as f32 / sides as f32).sin_cos();
                let normal = frame * cos + side * sin;
                let u = TAU * radius(0.0) * s as f32 / sides as f32;
                self.vertex(points[i] + normal * r, normal, Vec2::new(u, along));
            }
        }
        let at = |ring: usize, s: usize| base + (ring * (sides + 1) + s) as u32;
        for ring in 0..rings - 1 {
            for s in 0..sides {
                self.triangle([at(ring, s), at(ring, s + 1), at(ring + 1, s)]);
                self.triangle([at(ring, s + 1), at(ring + 1, s + 1), at(ring + 1, s)]);
            }
        }
    }

    /// A ring around +Y.
    pub fn ring(&mut self, radius: f32, thickness: f32, segments: usize, sides: usize) {
        let points: Vec<Vec3> = (0..segments)
            .map(|i| {
                let (sin, cos) = (TAU * i as f32 / segments as f32).sin_cos();
                Vec3::new(cos, 0.0, sin) * radius
            })
            .collect();
        self.tube(&points, sides, true, |_| thickness);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every triangle's face must look the way its vertices' normals do.
    fn check(shape: &Shape) {
        assert!(shape.triangles() > 0);
        for corners in shape.indices.chunks_exact(3) {
            let [a, b, c] = [0, 1, 2].map(|i| shape.positions[corners[i] as usize]);
            let face = (b - a).cross(c - a).normalize();
            for &i in corners {
                let normal = shape.normals[i as usize];
                assert!((normal.length() - 1.0).abs() < 1e-3, "{normal}");
                assert!(face.dot(normal) > 0.2, "{face} {normal} at {}", shape.positions[i as usize]);
            }
        }
    }

    /// Volume by the divergence theorem: positive when faces look outwards.
    fn volume(shape: &Shape) -> f32 {
        let corner = |i: u32| shape.positions[i as usize];
        shape.indices.chunks_exact(3).map(|t| corner(t[0]).dot(corner(t[1]).cross(corner(t[2]))) / 6.0).sum()
    }

    fn made(make: impl Fn(&mut Shape)) -> Shape {
        let mut shape = Shape::default();
        make(&mut shape);
        check(&shape);
        shape
    }

    #[test]
    fn faces_look_outwards_and_enclose_the_right_volume() {
        let near = |got: f32, expected: f32| assert!((got / expected - 1.0).abs() < 0.05, "{got} {expected}");
        let half = Vec3::new(1.0, 2.0, 3.0);
        near(volume(&made(|s| s.cuboid(Vec3::splat(9.0), half))), 48.0);
        near(volume(&made(|s| s.beam(Vec3::ONE, Vec3::new(1.0, 5.0, 1.0), 0.5))), 4.0);
        near(volume(&made(|s| s.sphere(Vec3::X, 1.0, 48))), 4.189);
        near(
            volume(&made(|s| s.lathe(&[(0.0, 0.0), (1.0, 0.0), (1.0, 2.0), (0.0, 2.0)], 64))),
            std::f32::consts::TAU,
        );
        near(volume(&made(|s| s.ring(1.0, 0.2, 64, 24))), 0.7896);
    }

    #[test]
    fn open_shapes_are_sound_too() {
        made(|s| s.quad(Vec3::ZERO, Vec3::X, Vec3::Y));
        made(|s| s.surface([8, 8], Vec2::ONE, |u, v| Vec3::new(u, (3.0 * u + v).sin() * 0.2, -v)));
        made(|s| s.lathe_with(&[(1.0, 0.0), (0.8, 1.0)], 96, |a| 1.0 - 0.05 * (12.0 * a).cos().abs()));
        made(|s| s.tube(&[Vec3::ZERO, Vec3::Y, Vec3::new(1.0, 2.0, 0.0)], 6, false, |t| 0.1 - 0.05 * t));
    }
}
