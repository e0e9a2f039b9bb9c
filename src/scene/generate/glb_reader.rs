//! Reads generated files back for their tests, through the `gltf` crate's parser.

use glam::{DMat4, DVec3};
use gltf::accessor::DataType;

/// All triangles of all nodes and the cameras, in world space.
pub(super) struct Read {
    pub(super) triangles: Vec<[DVec3; 3]>,
    cameras: Vec<(String, DVec3)>,
}

impl Read {
    pub(super) fn new(bytes: &[u8]) -> Self {
        // The crate's own validation refuses KHR_mesh_quantization, which it does not know, and nothing
        // else is allowed to be wrong.
        let file = match gltf::Gltf::from_slice(bytes) {
            Ok(file) => file,
            Err(gltf::Error::Validation(problems)) => {
                let known = |p: &String| p.starts_with("extensionsRequired");
                let problems: Vec<String> =
                    problems.iter().map(|(path, problem)| format!("{path}: {problem}")).collect();
                assert!(problems.iter().all(known), "{problems:?}");
                gltf::Gltf::from_slice_without_validation(bytes).unwrap()
            }
            Err(problem) => panic!("{problem}"),
        };
        let mut read = Read { triangles: Vec::new(), cameras: Vec::new() };
        let blob = file.blob.as_deref().unwrap();
        for node in file.default_scene().unwrap().nodes() {
            read.visit(&node, DMat4::IDENTITY, blob);
        }
        read
    }

    fn visit(&mut self, node: &gltf::Node, parent: DMat4, blob: &[u8]) {
        let own = node.transform().matrix().map(|column| column.map(f64::from));
        let world = parent * DMat4::from_cols_array_2d(&own);
        if node.camera().is_some() {
            self.cameras.push((node.name().unwrap_or_default().to_string(), world.w_axis.truncate()));
        }
        for primitive in node.mesh().iter().flat_map(|mesh| mesh.primitives().collect::<Vec<_>>()) {
            let positions = positions(&primitive.get(&gltf::Semantic::Positions).unwrap(), blob);
            let indices = primitive.reader(|_| Some(blob)).read_indices().unwrap().into_u32();
            let corners: Vec<DVec3> =
                indices.map(|i| world.transform_point3(positions[i as usize])).collect();
            self.triangles.extend(corners.chunks_exact(3).map(|c| [c[0], c[1], c[2]]));
        }
        for child in node.children() {
            self.visit(&child, world, blob);
        }
    }

    pub(super) fn camera(&self, name: &str) -> DVec3 {
        self.cameras.iter().find(|(known, _)| known == name).unwrap().1
    }

    pub(super) fn bounds(&self) -> (DVec3, DVec3) {
        let corners = || self.triangles.iter().flatten().copied();
        (corners().reduce(DVec3::min).unwrap(), corners().reduce(DVec3::max).unwrap())
    }

    /// Panics at a triangle that is not finite or has no area.
    pub(super) fn assert_sound(&self) {
        for triangle in &self.triangles {
            let [a, b, c] = *triangle;
            let area = (b - a).cross(c - a).length() / 2.0;
            assert!(area.is_finite() && area > 1e-10, "{triangle:?}");
        }
    }

    /// Panics when a triangle is nearer to `place` than `radius`.
    pub(super) fn assert_free(&self, place: DVec3, radius: f64) {
        let distance = self.distance(place);
        assert!(distance >= radius, "something is {distance} m from {place}");
    }

    /// Distance from `place` to the nearest triangle.
    pub(super) fn distance(&self, place: DVec3) -> f64 {
        self.triangles.iter().map(|t| nearest(t, place).distance(place)).fold(f64::INFINITY, f64::min)
    }
}

/// The point of a triangle nearest to `p`: Ericson, Real-Time Collision Detection, 2005, section 5.1.5.
fn nearest(&[a, b, c]: &[DVec3; 3], p: DVec3) -> DVec3 {
    let (ab, ac) = (b - a, c - a);
    let normal = ab.cross(ac);
    let on_plane = p - normal * ((p - a).dot(normal) / normal.length_squared());
    let inside =
        [(a, b), (b, c), (c, a)].iter().all(|&(s, e)| (e - s).cross(on_plane - s).dot(normal) >= 0.0);
    if inside {
        return on_plane;
    }
    let on_edge = |(s, e): (DVec3, DVec3)| {
        s + (e - s) * ((p - s).dot(e - s) / (e - s).length_squared()).clamp(0.0, 1.0)
    };
    [(a, b), (b, c), (c, a)]
        .map(on_edge)
        .into_iter()
        .min_by(|x, y| x.distance(p).total_cmp(&y.distance(p)))
        .unwrap()
}

fn positions(accessor: &gltf::Accessor, blob: &[u8]) -> Vec<DVec3> {
    let view = accessor.view().unwrap();
    let start = view.offset() + accessor.offset();
    (0..accessor.count())
        .map(|i| {
            let bytes = &blob[start + i * view.stride().unwrap()..];
            let component = |axis: usize| match accessor.data_type() {
                DataType::F32 => f64::from(f32::from_le_bytes(bytes[axis * 4..][..4].try_into().unwrap())),
                DataType::U16 => f64::from(u16::from_le_bytes(bytes[axis * 2..][..2].try_into().unwrap())),
                other => panic!("positions are not {other:?}"),
            };
            DVec3::new(component(0), component(1), component(2))
        })
        .collect()
}
