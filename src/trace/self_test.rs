//! What a device has to show before it takes part: a floor under an even sky, whose picture is known.

use glam::{DVec2, DVec3, Vec3, Vec4};

use super::tracer::Programs;
use super::{SceneData, Settings, Tracer, Turn};
use crate::bvh::WideBvh;
use crate::error::{Error, Result};
use crate::foveation::{Law, Pattern};
use crate::gpu::opencl::{Buffer, Device};
use crate::gpu::vulkan::Context;
use crate::math::pose::Pose;
use crate::math::view::{FieldOfView, View};
use crate::scene::{Environment, Material, Scene};

/// Pixels along a side of the test's view.
const SIDE: u32 = 32;
/// The floor reflects half of the light.
const ALBEDO: f32 = 0.5;
/// Relative deviation that is allowed of distances, which are exact but for rounding, and of radiance, whose
/// rays are few.
const DEPTH: f64 = 1e-3;
const RADIANCE: f64 = 0.1;

/// Traces the floor by built kernels, with rays by ray queries where they want that, and compares every sample with what is known of it.
///
/// # Errors
/// [`Error::Device`] where the device fails, or computes something else.
pub fn run(device: &Device, programs: &Programs, hardware: Option<&Context>) -> Result<()> {
    let scene = floor();
    let bvh = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
    let data = SceneData::pack(&scene, &bvh, &Environment::constant(Vec3::ONE))?;
    let mut tracer = Tracer::with_programs(device, programs, &data, hardware)?;
    let view = View {
        world_from_eye: Pose::look_at(DVec3::new(0.0, 1.0, 0.3), DVec3::new(0.0, 0.0, -1.0)),
        fov: FieldOfView::symmetric(1.6, 1.0),
        width: SIDE,
        height: SIDE,
        spacing: Default::default(),
    };
    let pattern = Pattern::new(&view, &Law::Full, DVec2::splat(0.5), usize::MAX);
    let uploaded = tracer.pattern(&pattern)?;
    for guided in [false, true] {
        let settings = Settings {
            rays: 32,
            bounces: 0,
            cached: false,
            edge_rays: 0,
            guided,
            seed: 1,
            jitter: false,
            fewer_rays: None,
            turn: Turn::ALL,
            turn_in_motion: Turn::ALL,
        };
        let samples = Buffer::new(device, pattern.samples.len())?;
        let visibility = guided.then(|| Buffer::new(device, view.pixels())).transpose()?;
        let work = tracer.enqueue(&view, &settings, &uploaded, &samples, visibility.as_ref())?;
        tracer.finish(work)?;
        let records = samples.to_vec()?;
        let mut light = [0.0f64; 2];
        for (&at, record) in pattern.samples.iter().zip(&records) {
            let (depth, lit) = expected(&view, at);
            let found = f64::from(record.depth);
            let error = (found - depth).abs();
            if error.is_nan() || error > DEPTH * depth.max(1e-3) {
                return Err(wrong(
                    device,
                    format!("sees a floor {found:.4} m away that is {depth:.4} m away"),
                ));
            }
            if lit {
                light[0] += record.first.iter().map(|&v| f64::from(v)).sum::<f64>() / 3.0;
                light[1] += if guided { 1.0 } else { f64::from(ALBEDO) };
            }
        }
        let ratio = light[0] / light[1];
        // A little of the light is reflected as by plastic.
        if !((1.0 - RADIANCE)..(1.0 + RADIANCE)).contains(&ratio) {
            return Err(wrong(device, format!("finds {ratio:.3} times the light that there is")));
        }
    }
    Ok(())
}

fn wrong(device: &Device, what: String) -> Error {
    Error::Device {
        device: device.info().name.clone(),
        problem: format!(
            "it fails its self-test: it {what}; update its driver, or leave it out with --devices"
        ),
    }
}

/// A square floor of 20 metres, at height 0.
fn floor() -> Scene {
    let mut scene = Scene {
        materials: vec![Material {
            base_color: Vec4::new(ALBEDO, ALBEDO, ALBEDO, 1.0),
            metallic: 0.0,
            roughness: 1.0,
            double_sided: true,
            ..Material::default()
        }],
        ..Scene::default()
    };
    let mesh = &mut scene.mesh;
    for (x, z) in [(-10.0, 10.0), (10.0, 10.0), (10.0, -10.0), (-10.0, -10.0)] {
        mesh.positions.push(Vec3::new(x, 0.0, z));
        mesh.normals.push(Vec3::Y);
        mesh.tangents.push(Vec4::new(1.0, 0.0, 0.0, 1.0));
        mesh.uvs[0].push(glam::Vec2::ZERO);
    }
    mesh.triangles.extend([[0, 1, 2], [0, 2, 3]]);
    mesh.materials.extend([0, 0]);
    scene
}

/// Depth along the view's axis of what a pixel's centre sees, 0 for the sky; and whether it is the floor.
fn expected(view: &View, at: u32) -> (f64, bool) {
    let pixel = DVec2::new(f64::from(at & 0xffff), f64::from(at >> 16)) + 0.5;
    let eye = view.world_from_eye;
    let in_eye = view.eye_direction(pixel);
    let direction = eye.rotation * in_eye;
    let t = -eye.position.y / direction.y;
    let hit = eye.position + direction * t;
    let on_floor = t > 0.0 && hit.x.abs() < 10.0 && hit.z.abs() < 10.0;
    (if on_floor { -in_eye.z * t } else { 0.0 }, on_floor)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::opencl::device;
    use crate::trace::{Traversal, source};

    /// The test's verdict on kernels of which a piece is replaced.
    fn verdict(device: &Device, piece: &str, wrong: &str) -> Result<()> {
        let text = source::text();
        assert!(text.contains(piece), "the kernels have no {piece:?}");
        let (features, traversals) =
            (crate::scene::Features::default(), Traversal::for_device(device).into());
        let programs = Programs::build_text(device, &text.replace(piece, wrong), &features, 12, traversals)?;
        run(device, &programs, None)
    }

    #[test]
    fn devices_that_compute_wrongly_are_refused() {
        let Some(info) = device::list().into_iter().find(|d| d.unusable.is_none()) else {
            assert!(std::env::var("CI").as_deref() != Ok("true"), "no OpenCL device");
            println!("not run: no OpenCL device");
            return;
        };
        let device = Device::open(&info).unwrap();
        let depth = "sample->depth = view_depth(camera, d, hit.t);";
        assert_eq!(verdict(&device, depth, depth).map_err(|e| e.to_string()), Ok(()));
        let light = "diffuse = weight->diffuse * brought";
        for (piece, wrong, told) in [
            (depth, "sample->depth = 1.01f * view_depth(camera, d, hit.t);", "sees a floor"),
            (light, "diffuse = 0.8f * weight->diffuse * brought", "times the light"),
        ] {
            let problem = verdict(&device, piece, wrong).unwrap_err().to_string();
            assert!(problem.contains("fails its self-test") && problem.contains(told), "{problem}");
        }
    }
}
