//! Scenes and lights that tests are made of.

use foveate::reference::Random;
use foveate::scene::texture::{Image, Sampling, Wrap};
use foveate::scene::{Environment, Material, Scene, Texture, TextureRef};
use glam::{DVec3, Mat2, Vec2, Vec3, Vec4};

/// A scene without triangles.
pub fn scene_of(materials: Vec<Material>) -> Scene {
    Scene { materials, ..Scene::default() }
}

/// A double-sided scene of white triangles.
pub fn shape(triangles: impl IntoIterator<Item = [Vec3; 3]>) -> Scene {
    let mut scene = scene_of(vec![Material { double_sided: true, ..matt(0.5) }]);
    for corners in triangles {
        triangle(&mut scene, corners, 0);
    }
    scene
}

/// A rough material without metalness.
pub fn matt(color: f32) -> Material {
    Material { base_color: Vec4::new(color, color, color, 1.0), metallic: 0.0, ..Material::default() }
}

/// A metal of this colour.
pub fn metal(color: Vec3, roughness: f32) -> Material {
    Material { base_color: color.extend(1.0), roughness, ..Material::default() }
}

pub fn triangle(scene: &mut Scene, corners: [Vec3; 3], material: u32) {
    polygon(scene, &corners, &[Vec2::ZERO, Vec2::X, Vec2::ONE]);
    let first = scene.mesh.positions.len() as u32 - 3;
    scene.mesh.triangles.push([first, first + 1, first + 2]);
    scene.mesh.materials.push(material);
}

/// A parallelogram whose corners run counter-clockwise seen from its front; u grows along the first edge.
pub fn quad(scene: &mut Scene, corners: [Vec3; 4], material: u32) {
    polygon(scene, &corners, &[Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y]);
    let first = scene.mesh.positions.len() as u32 - 4;
    scene.mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    scene.mesh.materials.extend([material, material]);
}

fn polygon(scene: &mut Scene, corners: &[Vec3], uvs: &[Vec2]) {
    let (along, other) = ((corners[1] - corners[0]).as_dvec3(), (corners[2] - corners[0]).as_dvec3());
    let normal = along.cross(other).try_normalize().unwrap_or(DVec3::Y).as_vec3();
    let tangent = along.try_normalize().unwrap_or(DVec3::X).as_vec3().extend(1.0);
    let mesh = &mut scene.mesh;
    mesh.positions.extend(corners);
    mesh.normals.extend(corners.iter().map(|_| normal));
    mesh.tangents.extend(corners.iter().map(|_| tangent));
    mesh.uvs[0].extend(uvs);
}

/// The floor y = `height` of the square that reaches `size` metres from the y axis.
pub fn floor(scene: &mut Scene, size: f32, height: f32, material: u32) {
    let corners = [[-size, size], [size, size], [size, -size], [-size, -size]];
    quad(scene, corners.map(|[x, z]| Vec3::new(x, height, z)), material);
}

/// A box's six sides, seen from outside.
pub fn cuboid(scene: &mut Scene, low: Vec3, high: Vec3, material: u32) {
    let (middle, half) = ((low + high) * 0.5, (high - low) * 0.5);
    for axis in [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z] {
        let right = if axis.y != 0.0 { Vec3::X } else { Vec3::Y.cross(axis) };
        let up = axis.cross(right);
        let corner = |x: f32, y: f32| middle + half * (axis + right * x + up * y);
        quad(scene, [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)], material);
    }
}

/// A uniform unit vector.
pub fn on_sphere(random: &mut Random) -> DVec3 {
    let z = 2.0 * random.uniform() - 1.0;
    let (sin, cos) = (random.uniform() * std::f64::consts::TAU).sin_cos();
    let r = (1.0 - z * z).sqrt();
    DVec3::new(r * cos, r * sin, z)
}

/// Triangles of `extent` metres scattered in a ball of 10 times that.
pub fn soup(seed: u64, count: usize, extent: f64) -> Scene {
    let mut random = Random::new(seed);
    shape((0..count).map(|_| {
        let centre = on_sphere(&mut random) * random.uniform() * 10.0 * extent;
        [0; 3].map(|_| (centre + on_sphere(&mut random) * extent).as_vec3())
    }))
}

/// Slivers of 10 m that are 1 mm to 1 cm wide, in all directions.
pub fn slivers(seed: u64, count: usize) -> Scene {
    let mut random = Random::new(seed);
    shape((0..count).map(|_| {
        let start = on_sphere(&mut random) * 5.0;
        let end = start + on_sphere(&mut random) * 10.0;
        let width = 1e-3 * 10f64.powf(random.uniform());
        [start, end, end + on_sphere(&mut random) * width].map(|p| p.as_vec3())
    }))
}

/// A height field of `cells` by `cells` squares of `step` metres around the origin, in the plane z = 0
/// but for a bump every third vertex.
pub fn grid(cells: usize, step: f32) -> Scene {
    let half = cells as f32 * step * 0.5;
    let at = |x: usize, y: usize| {
        let bump = if (x + y).is_multiple_of(3) { 0.25 * step } else { 0.0 };
        Vec3::new(x as f32 * step - half, y as f32 * step - half, bump)
    };
    let mut scene = shape([]);
    for i in 0..cells * cells {
        let (x, y) = (i % cells, i / cells);
        quad(&mut scene, [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)], 0);
    }
    scene
}

/// An icosahedron whose sides are cut in four `levels` times, seen from inside.
pub fn sphere(levels: u32, centre: Vec3, radius: f32, material: Material) -> Scene {
    let mut faces = icosahedron();
    for _ in 0..levels {
        faces = faces.iter().flat_map(|&face| cut(face)).collect();
    }
    let mut scene = scene_of(vec![material]);
    for face in faces {
        let [a, b, c] = face.map(|p| (p.as_vec3() * radius) + centre);
        triangle(&mut scene, [a, c, b], 0);
    }
    scene
}

/// The same ball seen from outside, whose corners' normals are its own: few triangles that are shown as a round surface.
pub fn round_ball(levels: u32, material: Material) -> Scene {
    let mut scene = sphere(levels, Vec3::ZERO, 1.0, material);
    scene.mesh.triangles.iter_mut().for_each(|corners| corners.swap(1, 2));
    scene.mesh.normals = scene.mesh.positions.iter().map(|p| p.normalize()).collect();
    scene
}

fn cut([a, b, c]: [DVec3; 3]) -> [[DVec3; 3]; 4] {
    let [ab, bc, ca] = [a + b, b + c, c + a].map(DVec3::normalize);
    [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
}

fn icosahedron() -> Vec<[DVec3; 3]> {
    let golden = (1.0 + 5f64.sqrt()) / 2.0;
    let mut corners = Vec::new();
    for (a, b) in [(1.0, golden), (1.0, -golden), (-1.0, golden), (-1.0, -golden)] {
        corners.extend([DVec3::new(0.0, a, b), DVec3::new(a, b, 0.0), DVec3::new(b, 0.0, a)]);
    }
    let near = |a: DVec3, b: DVec3| (a.distance(b) - 2.0).abs() < 1e-9;
    let mut faces = Vec::new();
    for i in 0..12 {
        for j in i + 1..12 {
            for k in j + 1..12 {
                let [a, b, c] = [corners[i], corners[j], corners[k]];
                if near(a, b) && near(b, c) && near(c, a) {
                    let outward = (b - a).cross(c - a).dot(a) > 0.0;
                    faces.push(if outward { [a, b, c] } else { [a, c, b] }.map(DVec3::normalize));
                }
            }
        }
    }
    assert_eq!(faces.len(), 20);
    faces
}

/// A texture of 4x4 texels, repeated, from the red, green, blue and alpha at each of 16 places.
pub fn texture(srgb: bool, texel: impl Fn(u32) -> [u8; 4]) -> Texture {
    let image = Image { texels: (0..16).map(texel).collect(), width: 4, height: 4 };
    Texture::from_image(image, Sampling { srgb, wrap: [Wrap::Repeat; 2], nearest: false })
}

/// Texture `index`, `times` times along both directions.
pub fn mapped(index: u32, times: f32) -> Option<TextureRef> {
    let matrix = Mat2::from_diagonal(Vec2::splat(times));
    Some(TextureRef { texture: index, uv_slot: 0, matrix, offset: Vec2::new(0.13, 0.31) })
}

/// A map of 32x16 texels.
pub fn sky(radiance: impl Fn(u32, u32) -> Vec3) -> Environment {
    let texels = (0..32 * 16).map(|i| radiance(i % 32, i / 32)).collect();
    Environment { width: 32, height: 16, texels, sun: None }
}

/// A smooth map with another colour in every direction.
pub fn colourful() -> Environment {
    sky(|x, y| {
        let turn = (x as f32 / 32.0 * std::f32::consts::TAU).sin();
        Vec3::new(1.0 + 0.8 * turn, 0.3 + 0.1 * y as f32, 1.2 - 0.5 * turn)
    })
}
