//! Tangents by MikkTSpace where a normal map needs them and the file has none.

use std::collections::HashMap;

use bevy_mikktspace::{Geometry, TangentSpace, generate_tangents};
use glam::{Vec2, Vec3, Vec4};

/// What MikkTSpace reads, and its answer for each corner of each triangle.
struct Corners<'a> {
    triangles: &'a [[u32; 3]],
    positions: &'a [Vec3],
    normals: &'a [Vec3],
    uvs: &'a [Vec2],
    tangents: Vec<Vec4>,
}

impl Geometry for Corners<'_> {
    fn num_faces(&self) -> usize {
        self.triangles.len()
    }

    fn num_vertices_of_face(&self, _face: usize) -> usize {
        3
    }

    fn position(&self, face: usize, vert: usize) -> [f32; 3] {
        self.positions[self.triangles[face][vert] as usize].into()
    }

    fn normal(&self, face: usize, vert: usize) -> [f32; 3] {
        self.normals[self.triangles[face][vert] as usize].into()
    }

    fn tex_coord(&self, face: usize, vert: usize) -> [f32; 2] {
        // glTF's v runs down the picture, MikkTSpace's up.
        let uv = self.uvs[self.triangles[face][vert] as usize];
        [uv.x, 1.0 - uv.y]
    }

    fn set_tangent(&mut self, tangent_space: Option<TangentSpace>, face: usize, vert: usize) {
        self.tangents[3 * face + vert] = tangent_space.map_or(Vec4::ZERO, |t| t.tangent_encoded().into());
    }
}

/// Tangents, one for each vertex, once vertices whose corners disagree have been doubled.
pub struct Tangents {
    /// For each vertex beyond the given ones: which of those it repeats.
    pub doubles: Vec<u32>,
    /// Tangents of all vertices; zero where nothing defines one.
    pub tangents: Vec<Vec4>,
}

/// Computes tangents and points the corners of `triangles` to doubled vertices where needed.
///
/// `uvs` are the coordinates with which the normal map is read, its transform included.
pub fn generate(triangles: &mut [[u32; 3]], positions: &[Vec3], normals: &[Vec3], uvs: &[Vec2]) -> Tangents {
    let tangents = vec![Vec4::ZERO; 3 * triangles.len()];
    let mut corners = Corners { triangles, positions, normals, uvs, tangents };
    // Its error type has no values.
    if generate_tangents(&mut corners).is_err() {
        corners.tangents.fill(Vec4::ZERO);
    }
    let of_corners = corners.tangents;
    assign(triangles, positions.len(), &of_corners)
}

fn assign(triangles: &mut [[u32; 3]], vertices: usize, of_corners: &[Vec4]) -> Tangents {
    let mut tangents: Vec<Option<Vec4>> = vec![None; vertices];
    let mut doubles = Vec::new();
    let mut known = HashMap::<(u32, [u32; 4]), u32>::new();
    for (corner, &tangent) in triangles.iter_mut().flatten().zip(of_corners) {
        if *tangents[*corner as usize].get_or_insert(tangent) == tangent {
            continue;
        }
        let key = (*corner, tangent.to_array().map(f32::to_bits));
        *corner = *known.entry(key).or_insert_with(|| {
            doubles.push(key.0);
            tangents.push(Some(tangent));
            (tangents.len() - 1) as u32
        });
    }
    Tangents { doubles, tangents: tangents.into_iter().map(Option::unwrap_or_default).collect() }
}

#[cfg(test)]
mod tests {
    use super::super::vectors::usable_tangent;
    use super::*;

    #[test]
    fn corners_that_disagree_get_vertices_of_their_own() {
        // Two triangles share an edge, but the second one's texture is mirrored.
        let positions = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::new(1.0, 1.0, 0.0)];
        let uvs = [Vec2::new(0.0, 1.0), Vec2::new(1.0, 1.0), Vec2::ZERO, Vec2::new(0.0, 1.0)];
        let mut triangles = [[0, 1, 2], [2, 1, 3]];
        let made = generate(&mut triangles, &positions, &[Vec3::Z; 4], &uvs);
        assert_eq!(made.tangents.len(), 4 + made.doubles.len());
        assert_eq!(made.doubles.len(), 2);
        let of = |triangle: [u32; 3]| triangle.map(|i| made.tangents[i as usize].w);
        assert_eq!(of(triangles[0]), [1.0; 3]);
        assert_eq!(of(triangles[1]), [-1.0; 3]);
        for (&double, vertex) in made.doubles.iter().zip(4..) {
            assert!(triangles[1].contains(&vertex) && [1, 2].contains(&double));
        }
    }

    #[test]
    fn broken_coordinates_give_usable_tangents() {
        let mut state = 1_u64;
        let mut pick = |n: usize| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as usize % n
        };
        let numbers = [0.0, 1.0, -1.0, 0.5, 1e-30, 1e38, -3e38, 1e-45];
        for _ in 0..300 {
            let count = 3 + pick(8);
            let mut number = || numbers[pick(numbers.len())];
            let positions: Vec<Vec3> = (0..count).map(|_| Vec3::new(number(), number(), number())).collect();
            let uvs: Vec<Vec2> = (0..count).map(|_| Vec2::new(number(), number())).collect();
            let mut triangles: Vec<[u32; 3]> = (0..9).map(|_| [0; 3].map(|_| pick(count) as u32)).collect();
            let normals = vec![Vec3::Z; count];
            let made = generate(&mut triangles, &positions, &normals, &uvs);
            assert!(made.tangents.iter().all(|&t| {
                let usable = usable_tangent(t, Vec3::Z);
                usable.is_finite() && (usable.truncate().length() - 1.0).abs() < 1e-5
            }));
        }
    }
}
