//! Cameras and punctual lights, placed by their nodes.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

use glam::{DMat4, DVec3, Vec3};

use super::Outcome;
use super::json::{self, Document};
use super::nodes::Nodes;
use crate::math::pose::Pose;
use crate::scene::animation::{Glow, orientation};
use crate::scene::{Camera, Light, LightKind};

/// The scene's cameras; world positions are absolute.
pub fn cameras(document: &Document, nodes: &Nodes, warnings: &mut Vec<String>) -> Vec<Camera> {
    let placed = nodes.shown.iter().filter_map(|&node| Some((node, document.nodes[node].camera?.0)));
    placed
        .filter_map(|(node, index)| {
            let (camera, world) = (&document.cameras[index], &nodes.pose.world[node]);
            if !world.is_finite() {
                warnings.push(format!("camera {index} has no finite position and was left out"));
                return None;
            }
            let fov_y = camera.perspective.as_ref().map(|p| p.yfov).filter(|y| (1e-6..PI).contains(y));
            if camera.perspective.is_some() && fov_y.is_none() {
                warnings.push(format!(
                    "camera {index} has a field of view that is not between 0 and 180 degrees"
                ));
            }
            let world_from_eye = Pose::new(orientation(world), world.w_axis.truncate());
            let up = world.y_axis.truncate().length();
            let half_height = camera.orthographic.as_ref().map(|ortho| ortho.ymag.abs() * up);
            let half_height = half_height.filter(|height| height.is_finite() && *height > 0.0);
            let name = camera.name.clone().unwrap_or_default();
            Some(Camera { name, world_from_eye, fov_y, half_height })
        })
        .collect()
}

/// A light of the scene, its node, and its number in the file.
pub struct PlacedLight {
    /// The node that places it.
    pub node: usize,
    /// Index of the document's light.
    pub number: usize,
    /// Where it is at the instant that is shown.
    pub light: Light,
}

/// The scene's lights (KHR_lights_punctual), relative to `anchor`. Those that are dark are left out, unless that changes.
pub fn lights(
    document: &Document,
    nodes: &Nodes,
    anchor: DVec3,
    warnings: &mut Vec<String>,
) -> Outcome<Vec<PlacedLight>> {
    let Some(list) = &document.extensions.lights else { return Ok(Vec::new()) };
    let placed = nodes
        .shown
        .iter()
        .filter_map(|&node| Some((node, document.nodes[node].extensions.light.as_ref()?.light.0)));
    let mut lights = Vec::new();
    for (node, index) in placed {
        let glow = nodes.pose.lights.get(&index).copied();
        let light =
            place(&list.lights[index], index, glow.unwrap_or_default(), &nodes.pose.world[node], anchor)?;
        if !light.position.is_finite() {
            warnings.push(format!("light {index} has no finite position and was left out"));
        } else if light.intensity != Vec3::ZERO || glow.is_some() {
            lights.push(PlacedLight { node, number: index, light });
        }
    }
    Ok(lights)
}

fn place(light: &json::Light, index: usize, glow: Glow, world: &DMat4, anchor: DVec3) -> Outcome<Light> {
    let kind = match light.kind.as_str() {
        "point" => LightKind::Point,
        "directional" => LightKind::Directional,
        "spot" => spot(light),
        other => return Err(format!("light {index} has the unknown type {other:?}; export the scene again")),
    };
    let position = match kind {
        LightKind::Directional => Vec3::ZERO,
        _ => (world.w_axis.truncate() - anchor).as_vec3(),
    };
    Ok(Light {
        kind,
        intensity: glow.radiated(light.color, light.intensity),
        position,
        direction: (orientation(world) * DVec3::NEG_Z).as_vec3().normalize(),
        range: light.range.filter(|&range| range > 0.0).map_or(f32::INFINITY, |range| range as f32),
    })
}

fn spot(light: &json::Light) -> LightKind {
    let spot = light.spot.as_ref();
    let outer = spot.and_then(|s| s.outer_cone_angle).unwrap_or(FRAC_PI_4).clamp(0.0, FRAC_PI_2);
    let inner = spot.and_then(|s| s.inner_cone_angle).unwrap_or(0.0).clamp(0.0, outer);
    LightKind::Spot { cos_inner: inner.cos() as f32, cos_outer: outer.cos() as f32 }
}
