//! Where the corners of all triangles are at a time: read by the gltf crate, computed in `f64` by the specification's
//! formulas (glTF 2.0, 3.7 "Geometry" and appendix C), one vertex and one joint after the other.

use std::collections::HashMap;

use glam::{DMat4, DQuat, DVec3};
use gltf::animation::Interpolation;
use gltf::animation::util::ReadOutputs;

/// World positions of the corners of the triangles that a file shows when all of its animations have played for
/// `time` seconds.
pub fn corners(document: &gltf::Document, buffers: &[Vec<u8>], time: f64) -> Vec<DVec3> {
    let data = |buffer: gltf::Buffer<'_>| buffers.get(buffer.index()).map(Vec::as_slice);
    let mut moved: HashMap<(usize, &'static str), Vec<f64>> = HashMap::new();
    for animation in document.animations() {
        let end = |channel: gltf::animation::Channel<'_>| {
            channel.reader(data).read_inputs().unwrap().fold(0.0, |end, key| f64::from(key).max(end))
        };
        let seconds = animation.channels().map(end).fold(0.0, f64::max);
        let time = if (0.0..=seconds).contains(&time) { time } else { time.rem_euclid(seconds) };
        for channel in animation.channels() {
            let reader = channel.reader(data);
            let keys: Vec<f64> = reader.read_inputs().unwrap().map(f64::from).collect();
            let (name, values): (_, Vec<f64>) = match reader.read_outputs().unwrap() {
                ReadOutputs::Translations(values) => {
                    ("translation", values.flatten().map(f64::from).collect())
                }
                ReadOutputs::Scales(values) => ("scale", values.flatten().map(f64::from).collect()),
                ReadOutputs::Rotations(values) => {
                    ("rotation", values.into_f32().flatten().map(f64::from).collect())
                }
                ReadOutputs::MorphTargetWeights(values) => {
                    ("weights", values.into_f32().map(f64::from).collect())
                }
            };
            let value = sample(channel.sampler().interpolation(), &keys, &values, time, name == "rotation");
            moved.insert((channel.target().node().index(), name), value);
        }
    }
    let parents: HashMap<usize, usize> =
        document.nodes().flat_map(|node| node.children().map(move |c| (c.index(), node.index()))).collect();
    let nodes: Vec<gltf::Node<'_>> = document.nodes().collect();
    let local = |node: usize| {
        let (t, r, s) = nodes[node].transform().decomposed();
        let part = |name, rest: Vec<f64>| moved.get(&(node, name)).cloned().unwrap_or(rest);
        let t = part("translation", t.map(f64::from).to_vec());
        let r = part("rotation", r.map(f64::from).to_vec());
        let s = part("scale", s.map(f64::from).to_vec());
        let rotation = DQuat::from_slice(&r).normalize();
        DMat4::from_translation(DVec3::from_slice(&t))
            * DMat4::from_quat(rotation)
            * DMat4::from_scale(DVec3::from_slice(&s))
    };
    let world = |mut node: usize| {
        let mut matrix = local(node);
        while let Some(&parent) = parents.get(&node) {
            matrix = local(parent) * matrix;
            node = parent;
        }
        matrix
    };
    let mut corners = Vec::new();
    for node in document.nodes() {
        let Some(mesh) = node.mesh() else { continue };
        for primitive in mesh.primitives() {
            let reader = primitive.reader(data);
            let mut positions: Vec<DVec3> =
                reader.read_positions().unwrap().map(|p| DVec3::from_array(p.map(f64::from))).collect();
            let rest = || mesh.weights().unwrap_or(&[]).iter().map(|&w| f64::from(w)).collect();
            let weights = moved.get(&(node.index(), "weights")).cloned().unwrap_or_else(rest);
            for (target, weight) in reader.read_morph_targets().zip(weights) {
                for (position, delta) in positions.iter_mut().zip(target.0.unwrap()) {
                    *position += weight * DVec3::from_array(delta.map(f64::from));
                }
            }
            match (node.skin(), reader.read_joints(0), reader.read_weights(0)) {
                (Some(skin), Some(joints), Some(weights)) => {
                    let bind: Vec<DMat4> = skin
                        .reader(data)
                        .read_inverse_bind_matrices()
                        .unwrap()
                        .map(|m| DMat4::from_cols_array_2d(&m.map(|column| column.map(f64::from))))
                        .collect();
                    let matrices: Vec<DMat4> =
                        skin.joints().zip(bind).map(|(joint, bind)| world(joint.index()) * bind).collect();
                    for ((p, joints), weights) in
                        positions.iter_mut().zip(joints.into_u16()).zip(weights.into_f32())
                    {
                        let total: f64 = weights.iter().map(|&w| f64::from(w)).sum();
                        let at = |i: usize| matrices[joints[i] as usize].transform_point3(*p);
                        *p = (0..4).map(|i| at(i) * f64::from(weights[i])).sum::<DVec3>() / total;
                    }
                }
                _ => {
                    let matrix = world(node.index());
                    positions.iter_mut().for_each(|p| *p = matrix.transform_point3(*p));
                }
            }
            match reader.read_indices() {
                Some(indices) => corners.extend(indices.into_u32().map(|i| positions[i as usize])),
                None => corners.extend(positions),
            }
        }
    }
    corners
}

fn sample(interpolation: Interpolation, keys: &[f64], values: &[f64], time: f64, turns: bool) -> Vec<f64> {
    let spline = interpolation == Interpolation::CubicSpline;
    let width = values.len() / keys.len() / if spline { 3 } else { 1 };
    let value = |key: usize, part: usize| {
        let first = if spline { (key * 3 + part) * width } else { key * width };
        &values[first..first + width]
    };
    if time <= keys[0] {
        return value(0, 1).to_vec();
    }
    let Some(next) = keys.iter().position(|&key| key > time) else {
        return value(keys.len() - 1, 1).to_vec();
    };
    let (start, end) = (keys[next - 1], keys[next]);
    let t = (time - start) / (end - start);
    let (a, b) = (value(next - 1, 1), value(next, 1));
    match interpolation {
        Interpolation::Step => a.to_vec(),
        Interpolation::Linear if turns => {
            let cosine: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
            let (angle, sign) = (cosine.abs().min(1.0).acos(), cosine.signum());
            if angle < 1e-6 {
                return a.to_vec();
            }
            let mix = |(a, b): (&f64, &f64)| {
                (angle * (1.0 - t)).sin() / angle.sin() * a + sign * (angle * t).sin() / angle.sin() * b
            };
            a.iter().zip(b).map(mix).collect()
        }
        Interpolation::Linear => a.iter().zip(b).map(|(a, b)| a * (1.0 - t) + b * t).collect(),
        Interpolation::CubicSpline => (0..width)
            .map(|i| {
                let (out, into) = (value(next - 1, 2)[i], value(next, 0)[i]);
                let span = end - start;
                (2.0 * t.powi(3) - 3.0 * t.powi(2) + 1.0) * a[i]
                    + span * (t.powi(3) - 2.0 * t.powi(2) + t) * out
                    + (-2.0 * t.powi(3) + 3.0 * t.powi(2)) * b[i]
                    + span * (t.powi(3) - t.powi(2)) * into
            })
            .collect(),
    }
}
