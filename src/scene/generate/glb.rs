//! A small writer of binary glTF 2.0: what our own scenes need, and no more.

use std::f32::consts::TAU;

use glam::Quat;
use serde_json::{Value, json};

use super::shapes::Shape;

/// glTF's component types.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
#[repr(u32)]
pub enum Component {
    I8 = 5120,
    U8 = 5121,
    U16 = 5123,
    U32 = 5125,
    F32 = 5126,
}

/// What a buffer view's bytes are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Use {
    /// Vertex attributes, this many bytes (a multiple of 4) from vertex to vertex.
    Vertices(usize),
    /// Triangle indices.
    Indices,
    /// A picture, or keys of an animation.
    Other,
}

/// How a buffer view is to be read.
#[derive(Clone, Debug)]
pub struct Accessor {
    /// Type of one component.
    pub component: Component,
    /// Integers stand for 0..1 or -1..1.
    pub normalized: bool,
    /// Elements.
    pub count: usize,
    /// `SCALAR`, `VEC2`, `VEC3` or `VEC4`.
    pub kind: &'static str,
    /// Least and greatest value of each component; POSITION must have them.
    pub bounds: Option<(Vec<f64>, Vec<f64>)>,
}

/// A glTF document in the making. Everything added gets the index that the method returns.
#[derive(Debug, Default)]
pub struct Glb {
    binary: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    images: Vec<Value>,
    samplers: Vec<Value>,
    textures: Vec<Value>,
    materials: Vec<Value>,
    meshes: Vec<Value>,
    cameras: Vec<Value>,
    nodes: Vec<Value>,
    animations: Vec<Value>,
    extensions: Vec<(String, bool)>,
}

impl Glb {
    /// Names an extension that the document uses, and whether a loader must know it.
    pub fn extension(&mut self, name: &str, required: bool) {
        if !self.extensions.iter().any(|(known, _)| known == name) {
            self.extensions.push((name.to_string(), required));
        }
    }

    /// Adds a buffer view with the bytes that `fill` appends.
    pub fn view(&mut self, usage: Use, fill: impl FnOnce(&mut Vec<u8>)) -> usize {
        let start = self.binary.len();
        fill(&mut self.binary);
        let mut view = json!({ "buffer": 0, "byteOffset": start, "byteLength": self.binary.len() - start });
        match usage {
            Use::Vertices(stride) => {
                view["target"] = json!(34962);
                view["byteStride"] = json!(stride);
            }
            Use::Indices => view["target"] = json!(34963),
            Use::Other => {}
        }
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        push(&mut self.views, view)
    }

    /// Adds an accessor of all of `view`.
    pub fn accessor(&mut self, view: usize, accessor: Accessor) -> usize {
        let mut value = json!({
            "bufferView": view, "componentType": accessor.component as u32, "count": accessor.count,
            "type": accessor.kind,
        });
        if accessor.normalized {
            value["normalized"] = json!(true);
        }
        if let Some((min, max)) = accessor.bounds {
            value["min"] = json!(min);
            value["max"] = json!(max);
        }
        push(&mut self.accessors, value)
    }

    /// Makes room for `bytes` more of binary data at once.
    pub fn reserve(&mut self, bytes: usize) {
        self.binary.reserve_exact(bytes);
    }

    /// Adds a PNG picture as a texture that repeats; `nearest` shows its texels as squares.
    pub fn texture(&mut self, name: &str, png: &[u8], nearest: bool) -> usize {
        let view = self.view(Use::Other, |binary| binary.extend_from_slice(png));
        let image = json!({ "name": name, "bufferView": view, "mimeType": "image/png" });
        let image = push(&mut self.images, image);
        let (mag, min) = if nearest { (9728, 9986) } else { (9729, 9987) };
        let sampler = json!({ "magFilter": mag, "minFilter": min, "wrapS": 10497, "wrapT": 10497 });
        let sampler = match self.samplers.iter().position(|s| *s == sampler) {
            Some(known) => known,
            None => push(&mut self.samplers, sampler),
        };
        push(&mut self.textures, json!({ "source": image, "sampler": sampler }))
    }

    /// Adds a material, as glTF's JSON has it.
    pub fn material(&mut self, material: Value) -> usize {
        push(&mut self.materials, material)
    }

    /// Makes a material seen from both sides.
    pub fn double_sided(&mut self, material: usize) {
        self.materials[material]["doubleSided"] = json!(true);
    }

    /// Adds the data of a shape and returns a primitive of it for [`Glb::mesh`].
    pub fn primitive(&mut self, shape: &Shape, material: usize) -> Value {
        let floats =
            |binary: &mut Vec<u8>, data: &[f32]| binary.extend_from_slice(bytemuck::cast_slice(data));
        let count = shape.positions.len();
        let accessor =
            |kind, bounds| Accessor { component: Component::F32, normalized: false, count, kind, bounds };
        let view = self.view(Use::Vertices(12), |b| floats(b, bytemuck::cast_slice(&shape.positions)));
        let positions = self.accessor(view, accessor("VEC3", Some(shape.bounds())));
        let view = self.view(Use::Vertices(12), |b| floats(b, bytemuck::cast_slice(&shape.normals)));
        let normals = self.accessor(view, accessor("VEC3", None));
        let view = self.view(Use::Vertices(8), |b| floats(b, bytemuck::cast_slice(&shape.uvs)));
        let uvs = self.accessor(view, accessor("VEC2", None));
        let view = self.view(Use::Indices, |b| b.extend_from_slice(bytemuck::cast_slice(&shape.indices)));
        let indices = Accessor {
            component: Component::U32,
            normalized: false,
            count: shape.indices.len(),
            kind: "SCALAR",
            bounds: None,
        };
        let indices = self.accessor(view, indices);
        json!({
            "attributes": { "POSITION": positions, "NORMAL": normals, "TEXCOORD_0": uvs },
            "indices": indices, "material": material,
        })
    }

    /// Adds a mesh of primitives.
    pub fn mesh(&mut self, name: &str, primitives: Vec<Value>) -> usize {
        push(&mut self.meshes, json!({ "name": name, "primitives": primitives }))
    }

    /// Adds a perspective camera; the vertical field of view is in radians.
    pub fn camera(&mut self, name: &str, fov_y: f64) -> usize {
        let perspective = json!({ "yfov": fov_y, "znear": 0.05 });
        push(&mut self.cameras, json!({ "name": name, "type": "perspective", "perspective": perspective }))
    }

    /// Adds a node, as glTF's JSON has it.
    pub fn node(&mut self, node: Value) -> usize {
        push(&mut self.nodes, node)
    }

    /// Adds an animation in which nodes turn about their own +Y, from the rotations that they have: each once in so many
    /// seconds, the other way round where these are negative. It is as long as the longest of them, and repeats without
    /// a jump where that is a multiple of all.
    pub fn turning(&mut self, name: &str, nodes: &[(usize, Quat, f32)]) {
        let length = nodes.iter().map(|(_, _, seconds)| seconds.abs()).fold(0.0, f32::max);
        let (mut samplers, mut channels) = (Vec::new(), Vec::new());
        for &(node, rest, seconds) in nodes {
            // Between keys a third of a turn apart the way is plain.
            let steps = (3.0 * length / seconds.abs()).round() as usize;
            let share = |step: usize| step as f32 / steps as f32;
            let times: Vec<f32> = (0..=steps).map(|step| length * share(step)).collect();
            let angle = |step: usize| TAU * step as f32 / 3.0 * seconds.signum();
            let turned = |step: usize| (rest * Quat::from_rotation_y(angle(step))).to_array();
            let turns: Vec<[f32; 4]> = (0..=steps).map(turned).collect();
            let bounds = Some((vec![0.0], vec![f64::from(length)]));
            let input = self.keys(bytemuck::cast_slice(&times), times.len(), "SCALAR", bounds);
            let output = self.keys(bytemuck::cast_slice(&turns), turns.len(), "VEC4", None);
            channels
                .push(json!({ "sampler": samplers.len(), "target": { "node": node, "path": "rotation" } }));
            samplers.push(json!({ "input": input, "output": output }));
        }
        let animation = json!({ "name": name, "channels": channels, "samplers": samplers });
        self.animations.push(animation);
    }

    fn keys(
        &mut self,
        bytes: &[u8],
        count: usize,
        kind: &'static str,
        bounds: Option<(Vec<f64>, Vec<f64>)>,
    ) -> usize {
        let view = self.view(Use::Other, |binary| binary.extend_from_slice(bytes));
        self.accessor(view, Accessor { component: Component::F32, normalized: false, count, kind, bounds })
    }

    /// The file, with one scene of these root nodes. Its size must stay below 4 GiB, glTF's limit.
    pub fn finish(mut self, roots: &[usize]) -> Vec<u8> {
        let mut document = json!({
            "asset": { "version": "2.0", "generator": concat!("foveate ", env!("CARGO_PKG_VERSION")) },
            "scene": 0,
            "scenes": [{ "nodes": roots }],
            "buffers": [{ "byteLength": self.binary.len() }],
        });
        let lists = [
            ("bufferViews", std::mem::take(&mut self.views)),
            ("accessors", std::mem::take(&mut self.accessors)),
            ("images", std::mem::take(&mut self.images)),
            ("samplers", std::mem::take(&mut self.samplers)),
            ("textures", std::mem::take(&mut self.textures)),
            ("materials", std::mem::take(&mut self.materials)),
            ("meshes", std::mem::take(&mut self.meshes)),
            ("cameras", std::mem::take(&mut self.cameras)),
            ("nodes", std::mem::take(&mut self.nodes)),
            ("animations", std::mem::take(&mut self.animations)),
        ];
        // glTF allows no empty lists.
        for (name, list) in lists.into_iter().filter(|(_, list)| !list.is_empty()) {
            document[name] = Value::Array(list);
        }
        let names = |required: bool| -> Vec<&String> {
            self.extensions.iter().filter(|(_, r)| *r || !required).map(|(name, _)| name).collect()
        };
        for (key, names) in [("extensionsUsed", names(false)), ("extensionsRequired", names(true))] {
            if !names.is_empty() {
                document[key] = json!(names);
            }
        }
        self.assemble(document.to_string().into_bytes())
    }

    /// Header, JSON chunk and binary chunk. The binary data is moved within its own memory, so that there is
    /// never a second copy of a large scene.
    fn assemble(mut self, mut document: Vec<u8>) -> Vec<u8> {
        document.resize(document.len().next_multiple_of(4), b' ');
        let total = 12 + 8 + document.len() + 8 + self.binary.len();
        assert!(total <= u32::MAX as usize, "a binary glTF file is smaller than 4 GiB");
        let mut head = Vec::with_capacity(28 + document.len());
        head.extend_from_slice(b"glTF");
        head.extend_from_slice(&2u32.to_le_bytes());
        head.extend_from_slice(&(total as u32).to_le_bytes());
        head.extend_from_slice(&(document.len() as u32).to_le_bytes());
        head.extend_from_slice(b"JSON");
        head.extend_from_slice(&document);
        head.extend_from_slice(&(self.binary.len() as u32).to_le_bytes());
        head.extend_from_slice(b"BIN\0");
        self.binary.reserve_exact(head.len());
        self.binary.splice(0..0, head);
        self.binary
    }
}

fn push(list: &mut Vec<Value>, value: Value) -> usize {
    list.push(value);
    list.len() - 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn a_document_is_read_back_as_it_was_written() {
        let mut glb = Glb::default();
        let mut shape = Shape::default();
        shape.cuboid(Vec3::ZERO, Vec3::ONE);
        let material = glb.material(json!({ "name": "plain" }));
        let primitive = glb.primitive(&shape, material);
        let mesh = glb.mesh("cube", vec![primitive]);
        let node = glb.node(json!({ "mesh": mesh, "name": "here" }));
        let bytes = glb.finish(&[node]);
        let read = gltf::Gltf::from_slice(&bytes).unwrap();
        let blob = read.blob.as_deref();
        let mesh = read.meshes().next().unwrap();
        let primitive = mesh.primitives().next().unwrap();
        let reader = primitive.reader(|_| blob);
        assert_eq!(reader.read_indices().unwrap().into_u32().collect::<Vec<_>>(), shape.indices);
        let positions: Vec<Vec3> = reader.read_positions().unwrap().map(Vec3::from).collect();
        assert_eq!(positions, shape.positions);
        assert_eq!(read.nodes().next().unwrap().name(), Some("here"));
    }
}
