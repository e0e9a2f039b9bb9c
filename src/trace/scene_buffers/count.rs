//! How large a scene's buffers will be, without making those that hold something for each triangle or texel.

use super::pack::texel_count;
use super::{BufferBytes, SceneData};
use crate::bvh::{LEAF_TRIANGLES, Trees, WideBvh};
use crate::error::Result;
use crate::layout;
use crate::scene::{Environment, Scene};
use crate::trace::Traversals;

impl SceneData {
    /// The list that [`SceneData::bytes`] of the packed scene would give, for the memory of what is neither of its mesh nor
    /// of its textures.
    ///
    /// # Errors
    /// As [`SceneData::pack`].
    pub fn count<'a>(
        scene: &Scene,
        trees: impl Into<Trees<'a>>,
        environment: &Environment,
        traversals: Traversals,
    ) -> Result<Vec<BufferBytes>> {
        let trees = trees.into();
        let mut buffers = Self::pack_around_mesh(scene, trees, environment)?.bytes(traversals);
        for buffer in &mut buffers {
            if let Some(bytes) = mesh_bytes(buffer.name, scene, trees) {
                buffer.bytes = bytes;
            }
        }
        Ok(buffers)
    }
}

/// Bytes of a buffer that holds something for each node, triangle, vertex or texel.
fn mesh_bytes(name: &str, scene: &Scene, trees: Trees) -> Option<usize> {
    let of =
        |part: &dyn Fn(&WideBvh) -> usize| part(trees.world) + trees.shapes.iter().map(part).sum::<usize>();
    let (nodes, places) = (of(&|tree| tree.nodes.len()), of(&|tree| tree.order.len()));
    let vertices: usize = scene.meshes().map(|mesh| mesh.positions.len()).sum();
    let (count, each) = match name {
        "nodes" => (nodes, size_of::<layout::WideNode>()),
        "compact nodes" => (nodes, size_of::<layout::CompactNode>()),
        "leaves" => (places * 9 + LEAF_TRIANGLES, size_of::<f32>()),
        "triangles" => (places, size_of::<layout::Triangle>()),
        "normals" => (vertices, size_of::<u32>()),
        "tangents" => (vertices, size_of::<[f32; 4]>()),
        "uv 0" => (vertices, size_of::<[f32; 2]>()),
        "uv 1" => (vertices, size_of::<[f32; 2]>()),
        "texels" => (texel_count(scene), size_of::<[u8; 4]>()),
        "colors" => (vertices, size_of::<[u16; 4]>()),
        _ => return None,
    };
    Some(count.max(1) * each)
}

/// Bytes of what rays walk, of all buffers: nodes, vertices in leaf order, and what hits need to know of a triangle.
pub fn tree_bytes(buffers: &[BufferBytes]) -> usize {
    let tree = ["nodes", "compact nodes", "leaves", "triangles"];
    buffers.iter().filter(|buffer| tree.contains(&buffer.name)).map(|buffer| buffer.bytes).sum()
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::sync::Arc;

    use glam::{Vec2, Vec3, Vec4};

    use super::*;
    use crate::scene::generate::demo;
    use crate::scene::instanced::{Instance, InstancedShape};
    use crate::scene::{Features, Instanced};
    use crate::trace::Traversal;

    /// The demo scene, alone and with all that a mesh can have.
    #[test]
    fn counted_buffers_are_as_large_as_packed_ones() {
        let light = Environment::constant(Vec3::ONE);
        let plain = Scene::from_glb(Path::new("demo"), &demo::generate()).unwrap();
        let mut full = plain.clone();
        let vertices = full.mesh.positions.len();
        full.mesh.uvs = [vec![Vec2::ZERO; vertices], vec![Vec2::ONE; vertices]];
        full.mesh.tangents = vec![Vec4::X; vertices];
        full.mesh.colors = vec![Vec4::splat(0.5); vertices];
        let features = Features::required_by(&full, &light);
        assert!(features.textures && features.normal_maps && features.vertex_colors);
        let mut shared = plain.clone();
        let place = Instance { shape: 0, anchor_from_shape: [[1.0, 0.0, 0.0, 9.0]; 3] };
        shared.instanced = Some(Arc::new(Instanced {
            shapes: vec![InstancedShape {
                triangles: 0..full.mesh.triangles.len(),
                vertices: 0..full.mesh.positions.len(),
            }],
            mesh: full.mesh.clone(),
            instances: vec![place; 3],
        }));
        for scene in [plain, full, shared] {
            let bvh = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
            let shapes = scene.instanced.iter().map(|_| bvh.clone()).collect::<Vec<_>>();
            let trees = Trees { world: &bvh, shapes: &shapes };
            let packed = SceneData::pack(&scene, trees, &light).unwrap();
            for traversals in Traversal::ALL.map(Traversals::from) {
                let counted = SceneData::count(&scene, trees, &light, traversals).unwrap();
                assert_eq!(counted, packed.bytes(traversals));
                assert!(tree_bytes(&counted) > scene.mesh.triangles.len() * 52);
            }
        }
    }
}
