//! Polygons to triangles: quads along the diagonal that keeps both halves facing the same way, others by
//! cutting ears, so that polygons with a dent stay what they are.

use glam::{Vec2, Vec3};

/// Polygons with more corners are cut as fans, since cutting ears takes their square in time.
const MOST: usize = 1024;

/// Vertex indices of a mesh's triangles. Points and lines have none.
pub fn triangles(mesh: &tobj::Mesh) -> Vec<u32> {
    let at = |index: u32| {
        let start = 3 * index as usize;
        mesh.positions.get(start..start + 3).map_or(Vec3::ZERO, Vec3::from_slice)
    };
    if mesh.face_arities.is_empty() {
        return mesh.indices[..mesh.indices.len() / 3 * 3].to_vec();
    }
    let mut list = Vec::with_capacity(mesh.indices.len());
    let mut rest = mesh.indices.as_slice();
    for &corners in &mesh.face_arities {
        let (face, after) = rest.split_at((corners as usize).min(rest.len()));
        rest = after;
        match face {
            [] | [_] | [_, _] => {}
            [a, b, c] => list.extend([a, b, c]),
            _ => {
                let corners: Vec<Vec3> = face.iter().map(|&index| at(index)).collect();
                list.extend(cut(&corners).into_iter().flatten().map(|corner| face[corner]));
            }
        }
    }
    list
}

/// The triangles of a polygon, as numbers of its corners.
fn cut(corners: &[Vec3]) -> Vec<[usize; 3]> {
    let fan = || (1..corners.len() - 1).map(|i| [0, i, i + 1]).collect();
    let flat = flatten(corners);
    let turns: Vec<bool> = (0..flat.len())
        .map(|i| turn(flat[(i + flat.len() - 1) % flat.len()], flat[i], flat[(i + 1) % flat.len()]) < 0.0)
        .collect();
    if corners.len() > MOST || !turns.contains(&true) {
        return fan();
    }
    ears(&flat).unwrap_or_else(fan)
}

/// The polygon in its plane (Newell's normal), counter-clockwise.
fn flatten(corners: &[Vec3]) -> Vec<Vec2> {
    let next = corners.iter().cycle().skip(1);
    let normal: Vec3 = corners.iter().zip(next).map(|(a, b)| (*a - corners[0]).cross(*b - corners[0])).sum();
    let normal = normal.try_normalize().unwrap_or(Vec3::Z);
    let (u, v) = normal.any_orthonormal_pair();
    corners.iter().map(|&p| Vec2::new((p - corners[0]).dot(u), (p - corners[0]).dot(v))).collect()
}

/// Twice the area of a triangle; positive where it turns left.
fn turn(a: Vec2, b: Vec2, c: Vec2) -> f32 {
    (b - a).perp_dot(c - b)
}

/// Cuts ears off; `None` where no ear is left, as in polygons that cross themselves.
fn ears(flat: &[Vec2]) -> Option<Vec<[usize; 3]>> {
    let mut left: Vec<usize> = (0..flat.len()).collect();
    let mut cut = Vec::with_capacity(flat.len() - 2);
    while left.len() > 3 {
        let n = left.len();
        let corner = |i: usize| [left[(i + n - 1) % n], left[i], left[(i + 1) % n]];
        let ear = (0..n).find(|&i| is_ear(flat, corner(i), &left))?;
        cut.push(corner(ear));
        left.remove(ear);
    }
    cut.push([left[0], left[1], left[2]]);
    Some(cut)
}

fn is_ear(flat: &[Vec2], ear: [usize; 3], left: &[usize]) -> bool {
    let [a, b, c] = ear.map(|i| flat[i]);
    let inside = |p: Vec2| turn(a, b, p) >= 0.0 && turn(b, c, p) >= 0.0 && turn(c, a, p) >= 0.0;
    turn(a, b, c) > 0.0
        && !left
            .iter()
            .any(|i| !ear.contains(i) && !ear.iter().any(|e| flat[*e] == flat[*i]) && inside(flat[*i]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(corners: &[Vec3], triangles: &[[usize; 3]]) -> (f32, bool) {
        let crosses: Vec<Vec3> = triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|i| corners[i]);
                (b - a).cross(c - a) * 0.5
            })
            .collect();
        (crosses.iter().map(|c| c.length()).sum(), crosses.iter().all(|c| c.z >= 0.0))
    }

    #[test]
    fn dented_polygons_keep_their_area_and_side() {
        let point = |x: f32, y: f32| Vec3::new(x, y, 0.0);
        // A dart whose dent is opposite to its first corner, and not; an L; a star.
        let dart = [point(0.0, 0.0), point(2.0, 1.0), point(0.5, 1.0), point(0.0, 3.0)];
        let turned = [dart[1], dart[2], dart[3], dart[0]];
        let l = [(0.0, 0.0), (3.0, 0.0), (3.0, 1.0), (1.0, 1.0), (1.0, 3.0), (0.0, 3.0)]
            .map(|(x, y)| point(x, y));
        for (corners, truth) in [(&dart[..], 1.0), (&turned[..], 1.0), (&l[..], 5.0)] {
            let triangles = cut(corners);
            assert_eq!(triangles.len(), corners.len() - 2);
            let (sum, front) = area(corners, &triangles);
            let exact: f32 = corners
                .iter()
                .zip(corners.iter().cycle().skip(1))
                .map(|(a, b)| a.x * b.y - b.x * a.y)
                .sum::<f32>()
                * 0.5;
            assert!((sum - exact).abs() < 1e-5 && front, "{sum} of {exact} ({truth})");
        }
    }

    #[test]
    fn polygons_without_an_ear_become_fans() {
        let bow = [Vec3::ZERO, Vec3::new(1.0, 1.0, 0.0), Vec3::X, Vec3::Y];
        assert_eq!(cut(&bow).len(), 2);
        assert_eq!(cut(&[Vec3::ZERO; 5]).len(), 3);
    }
}
