//! Normals, tangents and areas: how they transform, and what replaces broken ones.

use std::collections::HashMap;

use glam::{DMat3, DVec3, Vec3, Vec4};
use rayon::prelude::*;

use crate::scene::LeftOut;

/// Vectors that one thread looks at, at least.
const FEW: usize = 2048;

impl LeftOut {
    /// Keeps the triangles that have an area, and counts the others.
    pub fn filter(&mut self, triangles: &mut Vec<[u32; 3]>, positions: &[Vec3]) {
        triangles.retain(|triangle| {
            let [a, b, c] = triangle.map(|i| positions[i as usize]);
            if !(a.is_finite() && b.is_finite() && c.is_finite()) {
                self.not_finite += 1;
                return false;
            }
            let area = cross(a, b, c) != DVec3::ZERO;
            self.no_area += usize::from(!area);
            area
        });
    }

    /// Keeps the triangles whose corners are finite, and counts the others.
    pub fn filter_finite(&mut self, triangles: &mut Vec<[u32; 3]>, positions: &[Vec3]) {
        let before = triangles.len();
        triangles.retain(|triangle| triangle.iter().all(|&i| positions[i as usize].is_finite()));
        self.not_finite += before - triangles.len();
    }

    /// Adds `times` another count.
    pub fn add(&mut self, other: LeftOut, times: usize) {
        self.not_finite += other.not_finite * times;
        self.no_area += other.no_area * times;
        self.empty_primitives += other.empty_primitives * times;
    }
}

/// Twice the area of a triangle along its normal.
pub fn cross(a: Vec3, b: Vec3, c: Vec3) -> DVec3 {
    let a = a.as_dvec3();
    (b.as_dvec3() - a).cross(c.as_dvec3() - a)
}

/// A unit normal under a linear map that may mirror or flatten: the cofactor matrix is the inverse
/// transpose times the determinant, and exists for every matrix. Zero where no direction is left.
pub fn transform_normal(matrix: &DMat3, normal: Vec3) -> Vec3 {
    let n = normal.as_dvec3();
    let (x, y, z) = (matrix.x_axis, matrix.y_axis, matrix.z_axis);
    let image = y.cross(z) * n.x + z.cross(x) * n.y + x.cross(y) * n.z;
    let sign = if matrix.determinant() < 0.0 { -1.0 } else { 1.0 };
    (image.normalize_or_zero() * sign).as_vec3()
}

/// A tangent under a linear map; mirroring turns the bitangent's sign.
pub fn transform_tangent(matrix: &DMat3, tangent: Vec4) -> Vec4 {
    let sign = if matrix.determinant() < 0.0 { -1.0 } else { 1.0 };
    let image = *matrix * tangent.truncate().as_dvec3();
    image.normalize_or_zero().as_vec3().extend(tangent.w * sign)
}

/// Normals made unit; those without a direction get that of the triangles around them.
pub fn unit_normals(normals: &[Vec3], positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Vec3> {
    let unit = |n: &Vec3| n.as_dvec3().try_normalize().map_or(Vec3::ZERO, |unit| unit.as_vec3());
    let mut units: Vec<Vec3> = normals.par_iter().with_min_len(FEW).map(unit).collect();
    let missing: Vec<usize> = (0..units.len()).filter(|&i| units[i] == Vec3::ZERO).collect();
    if missing.is_empty() {
        return units;
    }
    let mut sums: HashMap<usize, DVec3> = missing.into_iter().map(|i| (i, DVec3::ZERO)).collect();
    for triangle in triangles {
        let [a, b, c] = triangle.map(|i| positions[i as usize]);
        for &corner in triangle {
            sums.entry(corner as usize).and_modify(|sum| *sum += cross(a, b, c));
        }
    }
    for (i, sum) in sums {
        units[i] = sum.try_normalize().unwrap_or(DVec3::Y).as_vec3();
    }
    units
}

/// A tangent that spans a frame with the unit normal: itself, made unit, where it can, else any.
pub fn usable_tangent(tangent: Vec4, normal: Vec3) -> Vec4 {
    let unit = tangent.truncate().try_normalize().filter(|unit| unit.cross(normal).length_squared() > 1e-8);
    unit.unwrap_or_else(|| normal.any_orthonormal_vector()).extend(if tangent.w < 0.0 { -1.0 } else { 1.0 })
}
